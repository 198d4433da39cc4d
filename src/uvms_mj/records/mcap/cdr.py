"""ROS 2 messages of fixed size in Common Data Representation (CDR): constant bytes with holes for numbers.

A message begins with four bytes that mean "little-endian CDR". After them, every number is aligned to a multiple of its
size (OMG, DDS-XTypes 1.3, sec. 7.4.1, "plain CDR"). A string is its length including the final zero, then its
characters. A sequence is its length, then its elements.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

HEADER = b"\x00\x01\x00\x00"
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

    def put(self, kind: str, *values: ArrayLike) -> Self:
        """Append constants of a NumPy type, without their number."""
        self._align(int(kind[1]))
        self.data += np.array(values, f"<{kind}").tobytes()
        return self

    def text(self, value: str) -> Self:
        """Append a constant string."""
        encoded = value.encode() + b"\x00"
        self.put("u4", len(encoded)).data += encoded
        return self

    def hole(self, name: str, kind: str = "f8", count: int = 1) -> Self:
        """Append a hole for numbers."""
        size = int(kind[1])
        self._align(size)
        self.holes[name] = Hole(len(self.data), f"<{kind}", count)
        self.data += bytes(size * count)
        return self

    def header(self, frame: str) -> Self:
        """Append a std_msgs/Header with a hole for its stamp, seconds and nanoseconds. All stamps are equal."""
        return self.hole(f"{STAMP}{len(self.holes)}", "u4", 2).text(frame)
