"""A module of LLVM under construction; and memory, loops and checks in the code of one of its functions."""

import ast
import types
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np
from llvmlite import ir

from .refusals import STOPPED, Lacking, Mistake, code_of
from .values import BOOL, BYTE, FLAG, POINTER, SCALARS, WORD, Entries, Kind, Place, Value, dense, scalar, whole, word

Intrinsic = Callable[["Emission", Sequence[ir.Value]], "Value | None"]

UNROLLED = 16
"""So many elements are written out one by one if nothing else is asked for."""
FRAME = 1 << 18
"""Most bytes of local arrays in a unit. They are on the stack."""
PATIENCE = 1 << 20
"""Turns of a loop from one look for an interrupt to the next: about a millisecond."""


@dataclass
class Module:
    """The common state of a translation's parts.

    Attributes:
        name: of the module.
        checked: whether indices that are not constants, divisions of integers and conversions to integers are checked.
            A function then returns 0, or a number that says why and where it ended early (:mod:`.refusals`).
        intrinsics: functions with code of their own, which get their arguments as integers, an array by its address.
        instead: functions that others replace.
        fused: functions in which, and in all that they call, a product and a sum may be rounded once.
        interrupted: writes code for a number that is not 0 if a user's loop shall end.
        cells: the record whose numbers are known, or in cells (:mod:`.cells`); otherwise None.
        unrolled: up to so many elements are written out one by one; more are a loop.
        left_out: files and lines of statements that are not translated, in search of what else a function lacks.
        frame: bytes of local arrays so far.
        files: the sources' files, by their number in the codes.
    """

    name: str
    checked: bool = False
    intrinsics: Mapping[Any, Intrinsic] = field(default_factory=dict)
    fused: Collection[Any] = ()
    interrupted: Callable[[ir.IRBuilder], ir.Value] | None = None
    cells: Any = None
    unrolled: int = UNROLLED
    instead: Mapping[Any, Any] = field(default_factory=dict)
    left_out: Collection[tuple[str, int]] = ()

    def __post_init__(self) -> None:
        self.module = ir.Module(self.name)
        self.own: Mapping[str, Any] = {}  # the functions of libm, by their names in C
        self.frame, self.files = 0, list[str]()
        self._constants: dict[tuple, ir.Value] = {}
        self.within: dict[tuple, tuple[types.FunctionType, tuple[str, ...]]] = {}  # functions within functions
        self.trees: dict[types.FunctionType, tuple[ast.FunctionDef, Sequence[str]]] = {}  # of each

    def file(self, name: str) -> int:
        """The number of a file."""
        if name not in self.files:
            self.files.append(name)
        return self.files.index(name)

    def constant_array(self, array: np.ndarray) -> ir.Value:
        """Memory with the numbers of an array, which only is read."""
        key = (array.dtype, array.tobytes())
        if key not in self._constants:
            of = ir.IntType(8) if array.dtype == bool else SCALARS[array.dtype]
            kind = ir.ArrayType(of, array.size)
            memory = ir.GlobalVariable(self.module, kind, self.module.get_unique_name("constant"))
            memory.linkage, memory.global_constant = "internal", True
            memory.initializer = kind((array.view(np.uint8) if array.dtype == bool else array).ravel().tolist())
            memory.type = POINTER
            self._constants[key] = memory
        return self._constants[key]

    def call(
        self, at: Any, function: types.FunctionType, arguments: Sequence[Value], fused: bool = False
    ) -> Value | None:
        """Write a call."""
        raise NotImplementedError  # Unit translates the function


_PACKAGE = __name__.partition(".")[0]


class Emission:
    """Writes the code of one function: ``at`` is where it is, ``entry`` where its memory is reserved."""

    at: ir.IRBuilder
    entry: ir.IRBuilder

    def __init__(self, unit: Module, function: types.FunctionType, source: Sequence[str], fused: bool) -> None:
        self.unit, self.function, self.source = unit, function, source
        self.rounding = ("contract",) if fused else ()  # of a sum of products: once, or at each operation
        self.ours = function.__module__.partition(".")[0] == _PACKAGE  # what wraps there may
        self.line = 1
        self.given: Sequence[ir.Value] = ()  # where the cells are
        self.reserved = 0  # bytes of its own memory

    def mistake(self, reason: str) -> NoReturn:
        raise Mistake(self.function, self.line, self._words(), reason)

    def forbid(self, reason: str) -> NoReturn:
        found = Mistake(self.function, self.line, self._words(), reason)
        found.forbidden = True
        raise found

    def lack(self, reason: str) -> NoReturn:
        raise Lacking(self.function, self.line, self._words(), reason)

    def _words(self) -> str:
        return self.source[self.line - 1].strip() if self.line <= len(self.source) else ""

    # memory

    def reserve(self, size: int) -> ir.Value:
        """Bytes of the function's own memory."""
        self.unit.frame += size
        self.reserved += size
        if self.unit.frame > FRAME:
            self.lack(f"the local arrays would need more than {FRAME >> 10} kB; keep them in a state or a memory")
        memory = self.entry.alloca(ir.ArrayType(WORD, -(-size // 8)))
        memory.type = POINTER  # whatever is stored there
        return memory

    def temporary(self, base: np.dtype, shape: Sequence[int], axes: Sequence[int] = ()) -> Value:
        """A new array; its axes in the order of memory are the usual ones, or ``axes``."""
        kind = dense(base, tuple(shape), axes)
        return Value(kind, (self.reserve(kind.size * base.itemsize),), fresh=True)

    def made(self, base: np.dtype, shape: Sequence[int], axes: Sequence[int] = ()) -> Value:
        """A new array whose entries are :meth:`put`, one after the other on the way that the code takes. A small one
        needs no memory if only its entries are asked for. ``axes`` as of :meth:`temporary`."""
        kind = dense(base, tuple(shape), axes)
        if kind.size > self.unit.unrolled:
            return self.temporary(base, shape, axes)
        return Value(kind, Entries(kind.size, lambda entries: self._written(entries, base)), fresh=True)

    def _written(self, entries: Entries, base: np.dtype) -> ir.Value:
        """Memory with the entries of a small array, written where the last one was made."""
        memory, here = self.reserve(len(entries.numbers) * base.itemsize), self.at
        if entries.end is not None:
            block, last = entries.end
            self.at = ir.IRBuilder(block)
            self.at.position_at_start(block) if last is None else self.at.position_after(last)
            for k, number in enumerate(entries.numbers):
                if number is not None:
                    self.store(number, self.shifted(memory, word(k * base.itemsize)))
            self.at = here
            here.position_at_end(here.block)
        return memory

    def put(self, number: ir.Value, array: Value, indices: Sequence[ir.Value]) -> None:
        """Set an entry of an array that is being made."""
        entries = array.llvm
        if not isinstance(entries, Entries) or entries.memory is not None:
            self.store(number, self.pointer(array, indices))
            return
        entries.numbers[self._number_of(array, indices)] = number
        block = self.at.block
        entries.end = block, block.instructions[-1] if block.instructions else None

    def _number_of(self, array: Value, indices: Sequence[ir.Value]) -> int:
        """The place of an entry in a small array, by constant indices."""
        at = sum(i.constant * stride for i, stride in zip(indices, array.kind.strides, strict=True))
        return at // array.kind.base.itemsize

    def shifted(self, pointer: Any, distance: ir.Value) -> Any:
        if isinstance(pointer, Place):
            assert isinstance(distance, ir.Constant), "an index that is not known reaches memory only"
            return Place(pointer.offset + distance.constant)
        if isinstance(distance, ir.Constant):
            if distance.constant == 0:
                return pointer
            if isinstance(pointer, ir.GEPInstr) and isinstance(pointer.indices[0], ir.Constant):
                return self.shifted(pointer.pointer, word(pointer.indices[0].constant + distance.constant))
        return self.at.gep(pointer, [distance], source_etype=BYTE)

    def load(self, pointer: Any, base: np.dtype) -> Value:
        if isinstance(pointer, Place) and base in SCALARS:
            if (known := self.unit.cells.known(pointer, base)) is not None:
                return known
            pointer = self.unit.cells.cell(self, pointer)
        if base == BOOL:
            return scalar(self.at.trunc(self.at.load(pointer, typ=BYTE), FLAG), BOOL)
        if base in SCALARS:
            return scalar(self.at.load(pointer, typ=SCALARS[base]), base)
        return Value(Kind(base), (pointer,))

    def store(self, number: ir.Value, pointer: Any) -> None:
        if isinstance(pointer, Place):
            if not self.unit.cells.holds(pointer.offset // 8):
                self.lack("all runs of a fleet share its tables")
            self.unit.cells.writes(pointer, 8 if number.type != FLAG else 1)
            pointer = self.unit.cells.cell(self, pointer)
        self.at.store(self.at.zext(number, BYTE) if number.type == FLAG else number, pointer)

    def distance(self, indices: Sequence[ir.Value], strides: Sequence[int]) -> ir.Value:
        """Bytes from the first entry of an array to another one; a constant if all indices are."""
        known, total = 0, None
        for index, stride in zip(indices, strides, strict=True):
            if isinstance(index, ir.Constant):
                known += index.constant * stride
            else:
                each = self.at.mul(index, word(stride))
                total = each if total is None else self.at.add(total, each)
        if total is None:
            return word(known)
        return self.at.add(total, word(known)) if known else total

    def _own(self, array: Value, indices: Sequence[ir.Value]) -> list[ir.Value]:
        """The indices of an entry. The last axes are indexed where an array has fewer of them; a size of 1 is
        repeated."""
        n = len(array.kind.strides)
        of_these = zip(array.kind.shape or (), indices[len(indices) - n :], strict=True)
        return [word(0) if size == 1 else index for size, index in of_these]

    def pointer(self, array: Value, indices: Sequence[ir.Value]) -> ir.Value:
        """Of an entry."""
        own = self._own(array, indices)
        array = self.reached(array, own)
        return self.shifted(array.llvm[0], self.distance(own, array.kind.strides))

    def reached(self, array: Value, indices: Sequence[ir.Value]) -> Value:
        """An array whose entries these indices reach: in memory, if one of them is not known when compiling."""
        if array.place is None or all(isinstance(each, ir.Constant) for each in indices):
            return array
        return self.unit.cells.in_memory(self, array)

    def element(self, value: Value, indices: Sequence[ir.Value]) -> Value:
        """An entry of an array; a number is itself."""
        if not value.kind.is_array:
            return value
        entries, own = value.llvm, self._own(value, indices)
        if isinstance(entries, Entries) and entries.memory is None and all(isinstance(i, ir.Constant) for i in own):
            number = entries.numbers[self._number_of(value, own)]
            if number is not None:
                return scalar(number, value.kind.base)
        return self.load(self.pointer(value, indices), value.kind.base)

    # loops

    def each(self, shape: Sequence[int], body: Callable[[list[ir.Value]], None]) -> None:
        """Code for each index of a shape: written out if they are few, otherwise a loop for each axis."""
        if int(np.prod(shape, dtype=int)) <= self.unit.unrolled:
            for indices in np.ndindex(*shape):
                body([word(i) for i in indices])
            return

        def axis(so_far: list[ir.Value]) -> None:
            if len(so_far) == len(shape):
                body(so_far)
            else:
                self.turns(WORD(shape[len(so_far)]), lambda i: axis([*so_far, i]))

        axis([])

    def turns(self, n: ir.Value, body: Callable[[ir.Value], None]) -> None:
        """A loop of n turns, written as a loop."""
        self.loop(WORD(0), n, 1, lambda i, advance, end: body(i))

    def loop(
        self,
        start: ir.Value,
        stop: ir.Value,
        step: int,
        body: Callable[[ir.Value, ir.Block, ir.Block], None],
        then: Callable[[], None] = lambda: None,
    ) -> None:
        """A loop over integers, whose body may leave a turn for the blocks with which it goes on and ends; ``then``
        writes what each turn ends with."""
        counter = self.entry.alloca(WORD)
        self.at.store(start, counter)
        test, inside, advance, end = (self.at.append_basic_block() for _ in range(4))
        self.at.branch(test)
        self.at.position_at_end(test)
        count = self.at.load(counter, typ=WORD)
        self.at.cbranch(self.at.icmp_signed("<" if step > 0 else ">", count, stop), inside, end)
        self.at.position_at_end(inside)
        body(count, advance, end)
        if not self.at.block.is_terminated:
            self.at.branch(advance)
        self.at.position_at_end(advance)
        then()
        self.at.store(self.at.add(self.at.load(counter, typ=WORD), WORD(step)), counter)
        self.at.branch(test)
        self.at.position_at_end(end)

    def folded(
        self,
        n: int,
        first: Sequence[ir.Value],
        step: Callable[[Sequence[ir.Value], ir.Value], Sequence[ir.Value]],
        most: int | None = None,
    ) -> Sequence[ir.Value]:
        """The numbers of ``step(numbers so far, index)`` after the indices from 1 to n - 1, in their order, from those
        of index 0. Up to ``most`` steps are written out."""
        if n - 1 <= (self.unit.unrolled if most is None else most):
            for i in range(1, n):
                first = step(first, WORD(i))
            return first
        slots = [self.entry.alloca(each.type) for each in first]

        def load() -> list[ir.Value]:
            return [self.at.load(slot, typ=each.type) for slot, each in zip(slots, first, strict=True)]

        def keep(numbers: Sequence[ir.Value]) -> None:
            for slot, number in zip(slots, numbers, strict=True):
                self.at.store(number, slot)

        keep(first)
        self.turns(WORD(n - 1), lambda i: keep(step(load(), self.at.add(i, WORD(1)))))
        return load()

    # checks

    def code(self, why: int) -> int:
        """The number that says why and where a function ended early."""
        place = self.function.__code__
        return code_of(why, self.unit.file(place.co_filename), place.co_firstlineno + self.line - 1)

    def demand(self, condition: ir.Value, why: int) -> None:
        """End the function unless a condition holds. Shipped kernels are trusted."""
        if self.unit.checked:
            with self.at.if_then(self.at.not_(condition), likely=False):
                self.at.ret(WORD(self.code(why)))

    def look_for_interrupt(self) -> None:
        """At the end of a turn of a user's loop: every so many turns, look whether somebody wants the run to end."""
        if not self.unit.checked or self.unit.interrupted is None:
            return
        turns = self.entry.alloca(WORD)
        self.entry.store(WORD(0), turns)
        count = self.at.add(self.at.load(turns, typ=WORD), WORD(1))
        self.at.store(count, turns)
        due = self.at.icmp_signed("==", self.at.and_(count, WORD(PATIENCE - 1)), WORD(0))
        with self.at.if_then(due, likely=False):
            stop = self.at.icmp_signed("!=", self.unit.interrupted(self.at), WORD(0))
            with self.at.if_then(stop, likely=False):
                self.at.ret(WORD(self.code(STOPPED)))

    def known_index(self, index: int, size: int) -> ir.Value:
        """A constant index, counted from the front."""
        if not -size <= index < size:
            self.mistake(f"index {index} is out of bounds for size {size}")
        return whole(index % size).llvm[0]
