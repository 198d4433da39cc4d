"""Types and values of translated kernels: numbers, records and arrays, and the LLVM values that represent them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from llvmlite import ir

POINTER, BYTE, WORD, DOUBLE, FLAG = ir.PointerType(), ir.IntType(8), ir.IntType(64), ir.DoubleType(), ir.IntType(1)
INT, FLOAT, BOOL = np.dtype("i8"), np.dtype("f8"), np.dtype("?")
SCALARS = {INT: WORD, FLOAT: DOUBLE, BOOL: FLAG}
NUMBERS: dict[Any, np.dtype] = {int: INT, float: FLOAT, bool: BOOL}


@dataclass(frozen=True)
class Kind:
    """A number or a record (structured dtype); with ``inner`` an array of them: its dimensions after the first."""

    base: np.dtype
    inner: tuple[int, ...] | None = None

    @property
    def llvm(self) -> list[ir.Type]:
        """The types of the LLVM values that represent it: of an array, pointer and length."""
        return [SCALARS.get(self.base, POINTER)] if self.inner is None else [POINTER, WORD]

    @property
    def is_number(self) -> bool:
        return self.inner is None and self.base in SCALARS


@dataclass(frozen=True)
class Value:
    """The LLVM values of a number, a record or an array."""

    kind: Kind
    llvm: tuple[ir.Value, ...]


def scalar(value: ir.Value, base: np.dtype) -> Value:
    """A number."""
    return Value(Kind(base), (value,))


def view(pointer: ir.Value, dtype: np.dtype) -> Value:
    """The record or, if the dtype has a shape, the array at a pointer."""
    if dtype.subdtype is None:
        return Value(Kind(dtype), (pointer,))
    base, shape = dtype.subdtype
    return Value(Kind(base, tuple(shape[1:])), (pointer, WORD(shape[0])))
