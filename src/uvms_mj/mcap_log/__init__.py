"""Logs: samples as ROS 2 messages in an MCAP file, written while a run goes on, and read back number by number."""

from .reader import read, read_files
from .sink import McapLog

__all__ = ["McapLog", "read", "read_files"]
