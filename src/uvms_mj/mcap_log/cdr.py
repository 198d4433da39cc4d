"""ROS 2's Common Data Representation of messages whose size is fixed: bytes with holes for numbers.

A message begins with four bytes that say "little-endian CDR"; every number stands at a multiple of its size, counted
from behind them (OMG, DDS-XTypes 1.3, sec. 7.4.1, "plain CDR"). A string is its length with the final zero, then its
characters; a sequence is its length, then its elements.
"""

import struct
from dataclasses import dataclass
from typing import Self

import numpy as np

HEADER = b"\x00\x01\x00\x00"
STAMP = "stamp."
"""What the name of a stamp's hole begins with. A law's state is an identifier: a hole with a point is no state."""


@dataclass(frozen=True)
class Hole:
    """Where numbers of a message stand: ``count`` of type ``kind`` at ``offset`` bytes."""

    offset: int
    kind: str
    count: int


class Message:
    """A message under construction: constants are written, numbers that change from sample to sample leave a hole.

    Attributes:
        data: the bytes, zero where the holes are.
        holes: by name.
    """

    def __init__(self) -> None:
        self.data = bytearray(HEADER)
        self.holes: dict[str, Hole] = {}

    def _align(self, size: int) -> None:
        self.data += b"\x00" * (-(len(self.data) - len(HEADER)) % size)

    def put(self, kind: str, *values: float) -> Self:
        """Constants of one of NumPy's types, "f8", "f4", "i4", "u4" or "u1"."""
        array = np.asarray(values, f"<{kind}")
        return self.array(array)

    def array(self, values: np.ndarray) -> Self:
        """Constants, each aligned to its size; their number is not written."""
        self._align(values.itemsize)
        self.data += np.ascontiguousarray(values).tobytes()
        return self

    def text(self, value: str) -> Self:
        """A constant string."""
        encoded = value.encode() + b"\x00"
        self._align(4)
        self.data += struct.pack("<I", len(encoded)) + encoded
        return self

    def hole(self, name: str, kind: str = "f8", count: int = 1) -> Self:
        """Room for numbers."""
        size = np.dtype(kind).itemsize
        self._align(size)
        self.holes[name] = Hole(len(self.data), f"<{kind}", count)
        self.data += bytes(size * count)
        return self

    def stamp(self) -> Self:
        """Room for a builtin_interfaces/Time, seconds and nanoseconds; all of a message's get the same."""
        return self.hole(f"{STAMP}{len(self.holes)}", "u4", 2)
