"""ROS 2 messages of fixed size in Common Data Representation (CDR): constant bytes with holes for numbers.

A message begins with four bytes that mean "little-endian CDR". After them, every number is aligned to a multiple of its
size (OMG, DDS-XTypes 1.3, sec. 7.4.1, "plain CDR"). A string is its length including the final zero, then its
characters. A sequence is its length, then its elements.
"""

import struct
from dataclasses import dataclass
from typing import Self

import numpy as np

HEADER = b"\x00\x01\x00\x00"
_CODES = {"f8": "d", "f4": "f", "i4": "i", "u4": "I", "u1": "B"}
"""Codes of the module struct."""
STAMP = "stamp."
"""Prefix of the names of holes for stamps. States of a law are identifiers, so a name with a point is not a state."""


@dataclass(frozen=True)
class Hole:
    """Place for numbers in a message: ``count`` numbers of type ``kind`` at byte ``offset``."""

    offset: int
    kind: str
    count: int


class Message:
    """A message under construction: its bytes, zero in the holes, and the holes by name. Constants are written; numbers
    that change from row to row leave a hole."""

    def __init__(self) -> None:
        self.data = bytearray(HEADER)
        self.holes: dict[str, Hole] = {}

    def _align(self, size: int) -> None:
        self.data += b"\x00" * (-(len(self.data) - len(HEADER)) % size)

    def put(self, kind: str, *values: float) -> Self:
        """Append constants of a NumPy type, "f8", "f4", "i4", "u4" or "u1"."""
        self._align(int(kind[1]))
        self.data += struct.pack(f"<{len(values)}{_CODES[kind]}", *values)
        return self

    def array(self, values: np.ndarray) -> Self:
        """Append constants, each aligned to its size, without their number."""
        self._align(values.itemsize)
        self.data += np.ascontiguousarray(values).tobytes()
        return self

    def text(self, value: str) -> Self:
        """Append a constant string."""
        encoded = value.encode() + b"\x00"
        self._align(4)
        self.data += struct.pack("<I", len(encoded)) + encoded
        return self

    def hole(self, name: str, kind: str = "f8", count: int = 1) -> Self:
        """Append a hole for numbers."""
        size = np.dtype(kind).itemsize
        self._align(size)
        self.holes[name] = Hole(len(self.data), f"<{kind}", count)
        self.data += bytes(size * count)
        return self

    def stamp(self) -> Self:
        """Append a hole for a builtin_interfaces/Time, seconds and nanoseconds. All stamps of a message are equal."""
        return self.hole(f"{STAMP}{len(self.holes)}", "u4", 2)
