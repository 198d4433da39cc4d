"""Compilation of pure Python functions to machine code before the run.

A function marked as a kernel (:mod:`uvms_mj.physics.kernels`) stays a plain Python function. The package's own
functions and users' stages are translated by :mod:`uvms_mj.compiler`. Their machine code is kept on disk
(:mod:`.objects`): of a function of the package by its sources, so that a warm start translates nothing; of a user's
stage by what it is translated to.
"""

import contextlib
import ctypes
import functools
import gc
import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numpy as np

from ...compiler.targets import optimize
from .memory import at_address
from .objects import keep, link, load, object_name, target_machine

PLAIN = "UVMS_MJ_PLAIN"
"""Environment variable for debugging: if it is set, every stage and kernel runs as plain Python."""
_STAGE = "uvms_mj_stage"
_lock = threading.RLock()
Known = Mapping[tuple[np.dtype, str], int]


@dataclass(frozen=True)
class NativeFunction:
    """Machine code: its address, and a ctypes function to call it from Python. ``files`` are the sources that the
    number which it returns may refer to (:func:`uvms_mj.compiler.codes.place`)."""

    address: int
    ctypes: Any
    files: tuple[str, ...] = ()


class NotCompiled(Exception):
    """A function runs as plain Python; the message is the reason."""


@contextlib.contextmanager
def _compiling() -> Iterator[None]:
    """Compile alone, and without garbage collection: it would look at every instruction of a module in vain."""
    with _lock:
        collects = gc.isenabled()
        gc.disable()
        try:
            yield
        finally:
            if collects:
                gc.enable()


def plain_python() -> bool:
    """Whether everything runs as plain Python."""
    return os.environ.get(PLAIN, "0") not in ("", "0")


def native_function(function: Any, parameters: Sequence[np.dtype | str], fused: bool = False) -> NativeFunction:
    """A C function of 64-bit integers from one of the package's functions, loaded from disk or compiled. It returns the
    number that the function returns, or 0.

    ``parameters`` are int64 or dtypes: a record or an array is passed by its address. ``fused`` is whether functions
    marked so are rounded once (:func:`uvms_mj.physics.kernels.fused`).
    """
    (native,) = native_functions({function: parameters}, fused)
    return native


def native_functions(
    parameters: Mapping[Any, Sequence[np.dtype | str]], fused: bool = False
) -> tuple[NativeFunction, ...]:
    """As :func:`native_function`, several functions, which share what they call, from one module."""
    dtypes = [tuple(np.dtype(each) for each in kinds) for kinds in parameters.values()]
    with _compiling():
        if plain_python():
            return tuple(map(_plain_function, parameters, dtypes))
        return _native_functions(tuple(zip(parameters, dtypes, strict=True)), fused)


def native_stage(function: Any, records: Mapping[Any, tuple[np.dtype, str]]) -> NativeFunction:
    """A C function of five 64-bit integers from a user's stage (:mod:`.user_stage`). ``records`` are the functions that
    stand for the record at an address, each with its dtype and why it can't be changed. Raises Mistake or NotCompiled.
    """
    if plain_python():
        raise NotCompiled(f"{PLAIN} is set")
    from ...compiler.refusals import Lacking
    from .intrinsics import stage_module

    with _compiling():
        try:
            module, files = stage_module(function, records, _STAGE)
        except Lacking as lacking:
            where = f" ({Path(lacking.file).name}, line {lacking.line}: {lacking.words})" if lacking.words else ""
            raise NotCompiled(f"{lacking.reason}{where}") from lacking
        name = object_name([b"stage", module.encode()], sources=False)
        (address,) = load(name) or _compiled(module, name, [_STAGE])
    return _callable(address, 5, tuple(files))


@functools.cache
def _native_functions(parts: tuple[tuple[Any, tuple[np.dtype, ...]], ...], fused: bool) -> tuple[NativeFunction, ...]:
    made_of = [b"fused" if fused else b""]
    for function, dtypes in parts:
        layout = [repr(each) for each in dtypes]
        source = Path(function.__code__.co_filename).read_bytes()
        made_of += [source, function.__qualname__.encode(), *(each.encode() for each in layout)]
    name = object_name(made_of)
    addresses = load(name)
    if addresses is None:
        from .intrinsics import kernel_module

        symbols = {f"uvms_mj_{name}_{k}": part for k, part in enumerate(parts)}
        addresses = _compiled(str(kernel_module(symbols, fused)), name, list(symbols))
    return tuple(_callable(at, len(dtypes)) for at, (_, dtypes) in zip(addresses, parts, strict=True))


@functools.cache
def _plain_function(function: Callable, dtypes: tuple[np.dtype, ...]) -> NativeFunction:
    """The function itself, to be called like machine code."""

    def call(*words: int) -> int:
        result = function(*(at_address(word, dtype) for word, dtype in zip(words, dtypes, strict=True)))
        return 0 if result is None else int(result)

    code = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * len(dtypes))(call)
    return NativeFunction(ctypes.cast(code, ctypes.c_void_p).value or 0, code)


def _callable(address: int, arguments: int, files: tuple[str, ...] = ()) -> NativeFunction:
    kind = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * arguments)
    return NativeFunction(address, kind(address), files)


def _compiled(text: str, name: str, entries: list[str]) -> tuple[int, ...]:
    """Compile a module, keep its object on disk and return the addresses of its functions."""
    machine = target_machine()
    module = llvm.parse_assembly(text)
    optimize(module, machine, llvm.get_process_triple())
    code = machine.emit_object(module)
    symbols = (*module.functions, *module.global_variables)
    externals = [each.name for each in symbols if each.is_declaration and not each.name.startswith("llvm.")]
    keep(name, code, entries, externals)
    addresses = link(code, entries, externals)
    assert addresses is not None, f"{entries} use an unknown symbol among {externals}"
    return addresses
