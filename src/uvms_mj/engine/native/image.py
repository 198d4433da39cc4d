"""The memory of a run as one image: its records one after the other, and room for numbers behind them."""

import mmap
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import Fault, InputError
from ...physics.flow import ROWS
from .record import NUMBERS

MOST_ROWS = 4096
"""Rows of a table that a reset may give, if the table at the start is no longer."""


@dataclass(frozen=True)
class Field:
    """A part of the first record of an image: its offset [bytes] and its dtype."""

    offset: int
    dtype: np.dtype

    @classmethod
    def of(cls, record: np.dtype, *names: str) -> "Field":
        """A field of a field of a record."""
        part, offset = record, 0
        for name in names:
            fields: Any = part.fields
            part, at = fields[name][:2]
            offset += at
        return cls(offset, part)

    @property
    def place(self) -> int:
        return self.offset // 8


class Image:
    """Memory with records by their names, and rooms of so many numbers each.

    Attributes:
        numbers: all of it as float64 numbers; a place is an index into them.
        fixed: the bytes of the records, without the rooms.
    """

    def __init__(self, records: Mapping[str, np.dtype], rooms: Mapping[str, int]) -> None:
        self._at: dict[str, tuple[int, np.dtype]] = {}
        at = 0
        for name, kind in records.items():
            self._at[name] = at, kind
            at += -(-kind.itemsize // 8) * 8
        self._rooms, size = dict[str, tuple[int, int]](), at
        for name, n in rooms.items():
            self._rooms[name] = size // 8, n
            size += 8 * n
        if size > 8 * NUMBERS:
            raise InputError(f"a run has room for {NUMBERS} numbers; its tables and settings have more")
        self.bytes = np.frombuffer(mmap.mmap(-1, size), np.uint8)  # pages that nobody touches take no memory
        self.fixed, self.numbers = self.bytes[:at], self.bytes.view(np.float64)
        self.address = int(self.bytes.ctypes.data)

    def record(self, name: str) -> np.ndarray:
        """A record (1,)."""
        at, kind = self._at[name]
        return np.ndarray(1, kind, self.bytes, at)

    def view(self, field: Field) -> np.ndarray:
        """A part of the first record: a record (1,), or an array."""
        if field.dtype.subdtype is None:
            return np.ndarray(1, field.dtype, self.bytes, field.offset)
        base, shape = field.dtype.subdtype
        return np.ndarray(shape, base, self.bytes, field.offset)

    def place(self, array: np.ndarray) -> int:
        """The place of the first number of an array in this memory."""
        return (int(array.ctypes.data) - self.address) // 8

    def room(self, name: str) -> tuple[int, np.ndarray]:
        """The place of a room and its numbers."""
        place, n = self._rooms[name]
        return place, self.numbers[place : place + n]

    def check_room(self, name: str, key: str, table: np.ndarray) -> None:
        """Raise InputError if the rows (n, width) of the table of a key are more than its room takes."""
        _, room = self.room(name)
        if table.size > room.size:
            most = room.size // table.shape[1]
            raise InputError([Fault(key, f"has {len(table)} rows; a reset takes {most}; make a new Simulation")])

    def put(self, name: str, table: np.ndarray) -> tuple[int, int]:
        """Put the rows (n, width) of a table into its room. Returns its place and n."""
        place, room = self.room(name)
        room[: table.size] = table.reshape(-1)
        return place, len(table)


def water_rooms() -> dict[str, int]:
    """The rooms for the tables of the water, and for the nodes of its Gauss-Markov processes."""
    widths = {"current.table": 4, "disturbance.table": 7, "current.shear": 2}
    nodes = {"current.nodes": 3 * ROWS, "disturbance.nodes": 6 * ROWS}
    return {name: MOST_ROWS * width for name, width in widths.items()} | nodes
