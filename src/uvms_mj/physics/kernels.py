"""Pure functions that can run as machine code."""

import functools
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np

Function = TypeVar("Function", bound=Callable)

kernels: list[Callable] = []
"""All functions marked with :func:`kernel`."""


def kernel(function: Function) -> Function:
    """Mark a pure function of floats, arrays and records.

    Called from Python, it runs as plain Python, which a debugger can step through. Called from compiled code, it is
    compiled and inlined. Array shapes are then known, and a product with a 6x6 matrix takes a third of the time.
    """
    kernels.append(function)
    return function


class Record(np.record):  # type: ignore[misc]  # NumPy's stubs have it as Any
    """A record as the compiler has it: its fields come before the attributes of NumPy's records, such as ``mean``."""

    def __getattribute__(self, name: str) -> Any:
        dtype = np.void.__getattribute__(self, "dtype")
        if name not in (dtype.names or ()):
            return super().__getattribute__(name)
        value = self[name]
        base = value.dtype
        return value.view(np.dtype((Record, base))) if base.names and base.type is not Record else value


def record_of(array: np.ndarray) -> Any:
    """The record in an array (1,) of records, as kernels and stages have it in plain Python."""
    return array.view(np.dtype((Record, array.dtype)))[0]


fused_kernels: set[Callable] = set()
"""All functions marked with :func:`fused`."""


def fused(function: Function) -> Function:
    """Mark a kernel in which, and in all that it calls, a product and a sum may be rounded once, as a fused
    multiply-add.

    It takes a tenth less time, and its last digits may differ from plain Python's and from another processor's. So
    it is done for a vehicle with joints only, and not for a rigid one.
    """
    fused_kernels.add(function)
    return kernel(function)


compilers: list[Callable[[Callable, Sequence[np.ndarray]], Callable[..., Any] | None]] = []
"""Functions that make machine code of a kernel on arrays, or None where all runs as plain Python. The engine enters
it."""


def machine_code(function: Callable, *arrays: np.ndarray) -> Callable[..., Any] | None:
    """A kernel on arrays as machine code, which Python calls as :func:`called_on` says; None if there is none."""
    return compilers[0](function, arrays) if compilers else None


def called_on(function: Callable, *arrays: np.ndarray) -> Callable[..., Any]:
    """A kernel on arrays that lie densely in memory, which Python calls with what follows, integers: its machine code,
    or itself where there is none. A record is an array (1,)."""
    return machine_code(function, *arrays) or plain_on(function, *arrays)


def plain_on(function: Callable, *arrays: np.ndarray) -> Callable[..., Any]:
    """As :func:`called_on`, the kernel itself, for a few calls: to make machine code takes a tenth of a second."""
    records = [each.view(np.dtype((Record, each.dtype))) if each.dtype.names else each for each in arrays]
    return functools.partial(function, *(each[0] if each.shape == (1,) else each for each in records))
