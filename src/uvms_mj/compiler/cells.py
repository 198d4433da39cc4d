"""A record whose numbers are known when compiling, or in cells of their own.

Code for one run at a time reads all numbers of its record from memory. Code for a fleet is compiled for the record that
its runs begin with: a number that no run changes, and that all runs share, is a constant of the code, so that what it
switches off is no code at all. Any other number is a word of the cells, an array of the function itself whose words
LLVM moves to registers. An array with an index that is not known when compiling needs memory instead: it is a region.

Which numbers change is known only when everything is translated. So a function that took such a number for a constant
is translated again, with its callers, as long as :attr:`Cells.grown` says that a store, or a region, was met for the
first time. A new region changes the arguments of each function: then all are.
"""

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from llvmlite import ir

from .values import BOOL, BYTE, FLAG, INT, POINTER, SCALARS, WORD, Place, Value, scalar

CELLS = "cells: "
"""Begins the reason why an array in memory is only read, until it is known to be written."""
ROOMS = "lacks: all runs of a fleet share its tables"
"""The reason why the tables behind the record are only read."""


@dataclass
class Region:
    """Words of the record from ``first`` to ``end`` that an index may reach."""

    first: int
    end: int
    written: bool = False


class Cells:
    """The record of a fleet while its code is translated.

    Args:
        template: its bytes at the start, of one of the runs.
        varying: the words of 8 bytes in which runs differ at the start.

    Attributes:
        written: the words that the code changes; ``regions`` is the memory that it reaches by indices.
        used: the words that it reads or changes.
        grown: whether one of them has grown since it was set to False.
    """

    def __init__(self, template: np.ndarray, varying: Collection[int] = ()) -> None:
        self.template, self.varying = template.view(np.uint8), set(varying)
        self.written, self.used, self.regions = set[int](), set[int](), list[Region]()
        self.grown = False
        self._arranged: list[Region] = []
        self._constants = set[int]()

    def begin(self) -> bool:
        """Begin a translation with the words and regions known so far. Returns whether the regions differ from the last
        translation's."""
        before = [(each.first, each.end) for each in self._arranged]
        self.grown, self._arranged = False, [replace(each) for each in self.regions]
        return before != [(each.first, each.end) for each in self._arranged]

    @contextmanager
    def within(self) -> Iterator[set[int]]:
        """Translate a function. Gives the words that it, or a function that it calls, takes for constants."""
        before, self._constants = self._constants, set()
        try:
            yield self._constants
        finally:
            self._constants = before

    def take(self, constants: Collection[int]) -> None:
        """Note the words that a called function takes for constants."""
        self._constants.update(constants)

    @property
    def pointers(self) -> int:
        """How many pointers each function is given: to the cells, to the rooms behind the record, and to the
        regions."""
        return 2 + len(self._arranged)

    def changes(self, word: int) -> bool:
        """Whether a word is in a cell: it changes, or differs between runs."""
        return word in self.written or word in self.varying

    def is_own(self, region: Region) -> bool:
        """Whether each run has its own memory of a region."""
        return region.written or any(word in self.varying for word in range(region.first, region.end))

    def words_of_regions(self, which: Callable[[Region], bool]) -> set[int]:
        """The words of some regions."""
        return {word for each in self.regions if which(each) for word in range(each.first, each.end)}

    def known(self, place: Place, base: np.dtype) -> Value | None:
        """The number at a place, if it is a constant of the code."""
        word = place.offset // 8
        if not self.holds(word):
            return None
        self.used.add(word)
        if self.changes(word) or self._region(self.regions, word) is not None:
            return None
        self._constants.add(word)
        number = self.template[place.offset : place.offset + base.itemsize].view(base)[0]
        if base == BOOL:
            return scalar(FLAG(bool(number)), BOOL)
        return scalar(SCALARS[base](int(number) if base == INT else float(number)), base)

    def holds(self, word: int) -> bool:
        """Whether a word is in the record. Those behind it are in the rooms, which all runs read."""
        return 8 * (word + 1) <= len(self.template)

    def writes(self, place: Place, size: int) -> None:
        """Note that a number is stored."""
        for word in range(place.offset // 8, (place.offset + size - 1) // 8 + 1):
            self.used.add(word)
            region = self._region(self.regions, word)
            if region is not None:
                self.grown |= not region.written
                region.written = True
            elif word not in self.written:
                self.written.add(word)
                self.grown = True

    def cell(self, at: Any, place: Place) -> ir.Value:
        """The pointer to a number that is no constant."""
        if not self.holds(place.offset // 8):
            return at.at.gep(at.given[1], [WORD(place.offset)], source_etype=BYTE)
        for k, region in enumerate(self._arranged):
            if region.first <= place.offset // 8 < region.end:
                return at.at.gep(at.given[2 + k], [WORD(place.offset - 8 * region.first)], source_etype=BYTE)
        return at.at.gep(at.given[0], [WORD(place.offset)], source_etype=BYTE)

    def in_memory(self, at: Any, array: Value) -> Value:
        """An array, or a record, with a pointer in place of its place."""
        place = array.place
        assert place is not None
        first, end = place.offset // 8, (place.offset + _extent(array) + 7) // 8
        if not self.has(array):  # all numbers: a table in the rooms
            rooms = at.at.gep(at.given[1], [WORD(place.offset)], source_etype=BYTE)
            return replace(array, kind=replace(array.kind, readonly=array.kind.readonly or ROOMS), llvm=(rooms,))
        self._reach(first, end)
        why = array.kind.readonly or f"{CELLS}{first}"
        return replace(array, kind=replace(array.kind, readonly=why), llvm=(self._pointer(at, place),))

    def has(self, array: Value) -> bool:
        """Whether an array at a place is in the record with all its entries."""
        assert array.place is not None
        return array.place.offset + _extent(array) <= len(self.template)

    def writes_memory(self, readonly: str) -> None:
        """Note that an array in memory is written."""
        region = self._region(self.regions, int(readonly.removeprefix(CELLS)))
        assert region is not None
        self.grown |= not region.written
        region.written = True

    def _pointer(self, at: Any, place: Place) -> ir.Value:
        if self._region(self._arranged, place.offset // 8) is None:  # it is new, and everything is translated again
            return ir.Constant(POINTER, None)
        return self.cell(at, place)

    def _reach(self, first: int, end: int) -> None:
        """Note that an index reaches words."""
        found = self._region(self.regions, first)
        if found is not None and end <= found.end:
            return
        others = [each for each in self.regions if each.first < end and first < each.end]
        words = set(range(first, end))
        region = Region(min([first, *(o.first for o in others)]), max([end, *(o.end for o in others)]))
        region.written = any(other.written for other in others) or bool(words & self.written)
        self.regions = sorted([*(each for each in self.regions if each not in others), region], key=lambda r: r.first)
        self.written -= set(range(region.first, region.end))
        self.grown = True

    @staticmethod
    def _region(regions: list[Region], word: int) -> Region | None:
        return next((each for each in regions if each.first <= word < each.end), None)


def _extent(array: Value) -> int:
    """Bytes from the first entry of an array, or of a record, to its end."""
    kind = array.kind
    size = kind.base.itemsize
    return size + sum((n - 1) * stride for n, stride in zip(kind.sizes, kind.strides, strict=True) if n)
