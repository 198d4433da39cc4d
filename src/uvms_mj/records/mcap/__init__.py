"""Logs: a run's samples as ROS 2 messages in an MCAP file, written during the run and read back exactly."""

from .reader import read, read_files
from .sink import McapLog

__all__ = ["McapLog", "read", "read_files"]
