"""Pure functions that can run as machine code."""

from collections.abc import Callable
from typing import TypeVar

Function = TypeVar("Function", bound=Callable)

kernels: list[Callable] = []
"""All functions marked with :func:`kernel`."""


def kernel(function: Function) -> Function:
    """Mark a pure function of floats, arrays and records. From Python it runs as plain Python, which a debugger can
    follow.

    Where it is called by code that is compiled, it is compiled and inlined there: the shapes are known, and a product
    with a 6x6 matrix takes a third of the time.
    """
    kernels.append(function)
    return function
