"""Kinds of values, and the LLVM values that represent them."""

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from llvmlite import ir

POINTER, BYTE, WORD, DOUBLE, FLAG = ir.PointerType(), ir.IntType(8), ir.IntType(64), ir.DoubleType(), ir.IntType(1)
INT, FLOAT, BOOL, NOTHING = np.dtype("i8"), np.dtype("f8"), np.dtype("?"), np.dtype("V0")
SCALARS = {INT: WORD, FLOAT: DOUBLE, BOOL: FLAG}
NUMBERS: dict[Any, np.dtype] = {int: INT, float: FLOAT, bool: BOOL}
RANK = (BOOL, INT, FLOAT)
"""Of two numbers in one operation, the later one's type is the result's."""


@dataclass(frozen=True)
class Form:
    """Python's value where a kind has items and it is no tuple.

    Attributes:
        of: ``list``, ``dict``, a class of named tuples, or a function that is written within another one.
        keys: of a dict; the names of a named tuple's fields, or of what such a function reads around it.
    """

    of: Any
    keys: tuple[Any, ...] = ()


class Known:
    """An object of Python that is known when compiling, as a text, a function, a class, or a dict of the module."""

    def __init__(self, of: Any) -> None:
        self.of = of

    def __eq__(self, other: object) -> bool:
        same = isinstance(other, Known) and type(self.of) is type(other.of)
        return same and (self.of is other.of or (type(self.of) is str and self.of == other.of))  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        return hash(self.of) if type(self.of) is str else id(self.of)


@dataclass(frozen=True)
class Kind:
    """The kind of a value: a number, a record (structured dtype), an array of either, a tuple, None, or an object that
    is known.

    Attributes:
        base: dtype of the number, the record or the entries; NOTHING of a tuple and of None.
        shape: of an array; its first size is None if it is known only at run time.
        strides: of an array [bytes].
        items: kinds of a tuple's items.
        constant: a number that is known when compiling, so that it can be a size, a bound or the result of a test.
        readonly: why nothing may be stored in it; empty if it may.
        place: of an argument whose place in a record with cells is known when compiling (:mod:`.cells`) [bytes].
        form: what items belong to if not to a tuple, or the object that is known.
    """

    base: np.dtype
    shape: tuple[int | None, ...] | None = None
    strides: tuple[int, ...] = ()
    items: tuple["Kind", ...] | None = None
    constant: int | bool | None = None
    readonly: str = ""
    place: int | None = None
    form: Form | Known | None = None

    @property
    def llvm(self) -> list[ir.Type]:
        """The types of the LLVM values that represent it: of an array, the pointer, and the length if it is needed."""
        if self.items is not None:
            return [each for leaf in self.leaves for each in leaf.llvm]
        if self.place is not None:
            return []
        if self.shape is not None:
            return [POINTER, WORD] if self.is_open else [POINTER]
        if self.constant is not None or self.base == NOTHING:
            return []
        return [SCALARS.get(self.base, POINTER)]

    @property
    def leaves(self) -> list["Kind"]:
        """The kinds of all parts that are no tuples."""
        return [self] if self.items is None else [each for item in self.items for each in item.leaves]

    @property
    def is_number(self) -> bool:
        return self.shape is None and self.base in SCALARS

    @property
    def is_none(self) -> bool:
        return self.items is None and self.base == NOTHING and self.form is None

    @property
    def is_array(self) -> bool:
        return self.shape is not None

    @property
    def is_open(self) -> bool:
        """Whether it is an array whose length is known only at run time."""
        return bool(self.shape) and self.shape[0] is None  # type: ignore[index]  # bool(None) is False

    @property
    def size(self) -> int:
        """Number of entries of an array of known shape."""
        return math.prod(self.sizes)

    @property
    def sizes(self) -> tuple[int, ...]:
        """The shape of an array of known shape, () of a number."""
        return tuple(int(each) for each in self.shape or ())  # type: ignore[arg-type]  # of known shape

    @property
    def variable(self) -> "Kind":
        """The kind of a variable that holds it: not of one value only."""
        if self.items is not None:
            return replace(self, items=tuple(each.variable for each in self.items))
        known = self.constant is not None or self.place is not None
        return replace(self, constant=None, place=None) if known else self

    def described(self) -> str:
        """In the words of a message."""
        if isinstance(self.form, Known):
            return f"the text {self.form.of!r}" if isinstance(self.form.of, str) else _named(self.form.of)
        if self.form is not None and self.form.of not in (list, dict):
            return _named(self.form.of)
        if self.items is not None:
            return f"a {self.form.of.__name__}" if self.form else f"a tuple of {len(self.items)}"
        if self.shape is not None:
            return f"an array of shape {shown(self.shape)}"
        names = {INT: "an integer", FLOAT: "a float", BOOL: "a truth value", NOTHING: "None"}
        return names.get(self.base, "a record")


NONE = Kind(NOTHING)


def _named(known: Any) -> str:
    name = getattr(known, "__name__", "")
    return f"{type(known).__name__} {name}" if name else f"a {type(known).__name__}"


def shown(shape: tuple[Any, ...]) -> str:
    """A shape as Python writes it."""
    return str(tuple("n" if each is None else each for each in shape)).replace("'", "")


def contiguous(base: np.dtype, shape: tuple[int | None, ...], readonly: str = "") -> Kind:
    """The kind of an array whose entries follow each other in memory."""
    strides, size = [], base.itemsize
    for n in reversed(shape):
        strides.append(size)
        size *= n or 1
    return Kind(base, shape, tuple(reversed(strides)), readonly=readonly)


def dense(base: np.dtype, shape: tuple[int, ...], axes: Sequence[int] = ()) -> Kind:
    """The kind of an array without gaps whose axes are in this order in memory, the last one with neighbours."""
    axes = axes or range(len(shape))
    strides = contiguous(base, tuple(shape[axis] for axis in axes)).strides
    return Kind(base, shape, tuple(strides[[*axes].index(axis)] for axis in range(len(shape))))


def is_dense(kind: Kind) -> bool:
    """Whether an array of known shape has no gaps in memory, in whichever order its axes are, and none backwards."""
    axes = sorted(range(len(kind.sizes)), key=lambda axis: -kind.strides[axis])
    strides = dense(kind.base, kind.sizes, axes).strides
    return kind.size == 0 or all(n == 1 or a == b for n, a, b in zip(kind.sizes, kind.strides, strides, strict=True))


@dataclass(frozen=True)
class Place:
    """A pointer into a record with cells (:mod:`.cells`): the distance from its start, known when compiling [bytes]."""

    offset: int


@dataclass(frozen=True, eq=False)
class Memory:
    """Memory that arrays may be in, apart from all other memory: the function's own, of one statement; or what its
    argument at a position has reached the function with; or, of neither, a constant's or the run's."""

    own: bool = False
    argument: int | None = None


OUTSIDE = Memory()


@dataclass(frozen=True)
class Value:
    """A value in the course of a function.

    Attributes:
        kind, llvm: its kind and its LLVM values.
        fresh: whether it is an array that the statement has just made, so that nothing else holds it.
        steady: whether its memory surely keeps its contents while a loop turns, except by a store.
        items: of a tuple.
        roots: what an array or a record that is not fresh may be a view of: names, and memory.
        fleeting: whether it may be in memory of this statement although it is not fresh.
        of_numpy: of a number, whether it surely is NumPy's, which has methods that Python's own has not.
    """

    kind: Kind
    llvm: Sequence[Any]  # ir.Value, or of an array or a record a Place
    fresh: bool = False
    steady: bool = True
    items: tuple["Value", ...] = ()
    roots: frozenset[str | Memory] = frozenset()
    fleeting: bool = False
    of_numpy: bool = False

    @property
    def constant(self) -> Any:
        """The number, if it is known when compiling; otherwise None."""
        if self.kind.is_number and isinstance(self.llvm[0], ir.Constant):
            return self.llvm[0].constant
        return None

    @property
    def place(self) -> Place | None:
        """Where it is in a record with cells, if it is an array or a record there."""
        if self.kind.items is not None or self.kind.is_number or isinstance(self.llvm, Entries) or not self.llvm:
            return None
        return self.llvm[0] if isinstance(self.llvm[0], Place) else None


class Entries(Sequence[ir.Value]):
    """The entries of a small array that a statement makes, in the order of memory. They are written to memory if
    somebody asks for its address.

    Attributes:
        numbers: the entries so far.
        end: where the last one was made: a block, and its last instruction.
        memory: where they are written.
    """

    def __init__(self, size: int, write: Callable[["Entries"], ir.Value]) -> None:
        self.numbers: list[ir.Value | None] = [None] * size
        self.end: tuple[ir.Block, ir.Instruction | None] | None = None
        self.memory: ir.Value | None = None
        self._write = write

    def __len__(self) -> int:
        return 1

    def __getitem__(self, index):
        if self.memory is None:
            self.memory = self._write(self)
        return (self.memory,)[index]


def scalar(value: ir.Value, base: np.dtype) -> Value:
    """A number."""
    return Value(_NUMBERS.get(base) or Kind(base), (value,))


_NUMBERS = {base: Kind(base) for base in SCALARS}


@functools.lru_cache(maxsize=4096)
def word(number: int) -> ir.Constant:
    """An integer of machine code, as indices and distances are. Most are asked for many times."""
    return WORD(int(number))


def known_object(of: Any) -> Value:
    """An object that is known when compiling."""
    return Value(Kind(NOTHING, form=Known(of)), ())


def whole(number: int) -> Value:
    """An integer that is known when compiling."""
    return scalar(WORD(number), INT)


def kind_of(dtype: np.dtype, readonly: str = "") -> Kind:
    """The kind of a record or, if the dtype has a shape, of an array."""
    if dtype.subdtype is None:
        return Kind(dtype, readonly=readonly)
    return contiguous(dtype.base, tuple(dtype.shape), readonly)


def view(pointer: ir.Value, dtype: np.dtype, readonly: str = "") -> Value:
    """The record or, if the dtype has a shape, the array at a pointer."""
    return Value(kind_of(dtype, readonly), (pointer,), roots=frozenset({OUTSIDE}))


def bundle(items: Sequence[Value], form: Any = None) -> Value:
    """A tuple, or what a form says."""
    return Value(
        Kind(NOTHING, items=tuple(argument_kind(item) for item in items), form=form),
        tuple(each for item in items for each in words_of(item)),
        any(item.fresh for item in items),
        all(item.steady for item in items),
        tuple(items),
        frozenset[str | Memory]().union(*(item.roots for item in items)),
        any(item.fleeting for item in items),
    )


def argument_kind(value: Value) -> Kind:
    """The kind of a value as an argument or a tuple's item: an integer, a truth value or a place that is known stays
    known."""
    if (place := value.place) is not None:
        return replace(value.kind, place=place.offset)
    known = value.constant
    if known is not None and value.kind.base in (INT, BOOL):
        return replace(value.kind, constant=int(known))
    return value.kind


def words_of(value: Value) -> Sequence[ir.Value]:
    """The LLVM values of a value as an argument or a tuple's item."""
    kind = argument_kind(value)
    return () if kind.constant is not None or kind.place is not None else value.llvm


def unbundled(kind: Kind, llvm: Sequence[ir.Value], like: Value) -> Value:
    """A value from its kind and LLVM values, with the properties of another one; a known number is a constant again."""
    if kind.constant is not None:
        return Value(replace(kind, constant=None), (SCALARS[kind.base](int(kind.constant)),))
    if kind.place is not None:
        return Value(replace(kind, place=None), (Place(kind.place),), roots=like.roots)
    return Value(kind, llvm, like.fresh, like.steady, roots=like.roots, fleeting=like.fleeting)


def items_of(value: Value) -> list[Value]:
    """The items of a tuple."""
    if value.items:
        return list(value.items)
    found, at = [], 0
    for kind in value.kind.items or ():
        n = len(kind.llvm)
        found.append(unbundled(kind, value.llvm[at : at + n], value))
        at += n
    return found


def leaves_of(value: Value) -> list[Value]:
    """All parts of a value that are no tuples."""
    return [value] if value.kind.items is None else [each for item in items_of(value) for each in leaves_of(item)]


def bundled(kind: Kind, leaves: Iterator[Value]) -> Value:
    """A value of a kind from its parts that are no tuples."""
    return next(leaves) if kind.items is None else bundle([bundled(item, leaves) for item in kind.items], kind.form)


def parts_of(kind: Kind) -> Iterator[Kind]:
    """A kind, and the kinds of its items and of theirs."""
    yield kind
    for item in kind.items or ():
        yield from parts_of(item)
