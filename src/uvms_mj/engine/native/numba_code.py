"""Compilation of a user's law by numba. Imported only for a law that is not the package's own."""

import contextlib
import functools
import re
from collections.abc import Callable, Iterator
from typing import Any

import numba
import numpy as np
from numba import carray, types
from numba.core.registry import cpu_target
from numba.extending import intrinsic, overload, register_jitable

from ...physics.kernels import kernels
from . import memory
from .guarded import guarded
from .objects import keep

_INLINED = {"error_model": "numpy", "forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_alive: list[Any] = []  # machine code lives as long as numba's object


def add_symbols() -> None:
    """Register the symbols of numba's runtime with LLVM. A law that raises or allocates refers to them."""
    cpu_target.target_context.refresh()


def compiled(prepare: Callable[[], Callable], arguments: int, name: str) -> int:
    """Compile a function of 64-bit integers that returns one, keep its object on disk and return its address."""
    with _compiler():
        _register()
        for each in kernels:
            _make_compilable(each)
        with guarded():
            function: Any = numba.cfunc(types.int64(*[types.int64] * arguments), error_model="numpy")(prepare())
        library = function._library
        code = library.serialize_using_object_code()[2][0]
    _alive.append(function)
    declared = {f.name for f in library._final_module.functions if f.is_declaration and f.name[:5] != "llvm."}
    if _stands_alone(str(library._final_module)):
        keep(name, code, function.native_name, declared)
    return int(function.address)


@contextlib.contextmanager
def _compiler() -> Iterator[None]:
    """Within this context numba compiles, whether or not NUMBA_DISABLE_JIT is set."""
    config: Any = numba.config
    before, config.DISABLE_JIT = config.DISABLE_JIT, 0
    try:
        yield
    finally:
        config.DISABLE_JIT = before


def _stands_alone(code: str) -> bool:
    """Whether code, given as LLVM's text, uses nothing of the compiling process: no address, as of a function of ctypes
    or of a large array, and no Python object, as printing does.

    An address that numba takes is a constant of LLVM that is made a pointer. Numba keeps Python objects in an
    environment for each function; its own functions, whose mangled names begin with ``5numba``, use theirs only for the
    texts of exceptions.
    """
    environments = re.findall(r"load [^@\n]*@\"?_ZN08NumbaEnv(\w+)", code)
    return "inttoptr (i" not in code and all(owner.startswith("5numba") for owner in environments)


@functools.cache
def _make_compilable(function: Callable) -> None:
    """Register a kernel with numba as a function that compiled code may call; once for each kernel."""
    register_jitable(**_INLINED)(function)


@intrinsic
def pointer(typing_context, address):
    """An address as the pointer that numba.carray takes."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.intp), generate


@functools.cache
def _register() -> None:
    """Register with numba, once, the code to compile in place of the plain functions."""

    @overload(memory.floats)
    def _(address, n):
        return lambda address, n: carray(pointer(address), (n,), np.float64)

    @overload(memory.triples)
    def _(address, n):
        return lambda address, n: carray(pointer(address), (n, 3), np.float64)

    @overload(memory.integers)
    def _(address, n):
        return lambda address, n: carray(pointer(address), (n,), np.int64)
