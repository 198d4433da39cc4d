"""Compilation of pure Python functions to machine code before the run.

A function marked as a kernel (:mod:`uvms_mj.physics.kernels`) stays a plain Python function. The package's own
functions are translated by :mod:`.translator`; numba compiles users' laws (:mod:`.numba_code`). Both are kept on disk
(:mod:`.objects`), so a warm start compiles nothing, and imports numba only for a user's law.
"""

import ctypes
import functools
import os
import re
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numpy as np

from ...errors import no_lost_interrupt
from .objects import keep, link, load, object_name, target_machine

_DISABLE = "NUMBA_DISABLE_JIT"
"""Environment variable for debugging: a user's law then runs as plain Python, the core still as machine code."""
_PLACE = re.compile(r"^During: .* at (.+\.py) \((\d+)\)$")
_lock = threading.RLock()


@dataclass(frozen=True)
class NativeFunction:
    """Machine code: its address, and a ctypes function to call it from Python."""

    address: int
    ctypes: Any


class NotCompiled(Exception):
    """Numba can't compile a function; the message is numba's reason."""


def native_function(function: Any, parameters: Sequence[np.dtype | str]) -> NativeFunction:
    """A C function of 64-bit integers from one of the package's functions (:mod:`.translator`), loaded from disk or
    compiled. It returns the number that the function returns, or 0.

    ``parameters`` are int64 or dtypes: a record or an array is passed by its address.
    """
    with _lock:
        return _native_function(function, tuple(np.dtype(each) for each in parameters))


@functools.cache
def _native_function(function: Any, dtypes: tuple[np.dtype, ...]) -> NativeFunction:
    layout = [repr((each.descr, each.shape, each.isalignedstruct)) for each in dtypes]
    source = Path(function.__code__.co_filename).read_bytes()
    name = object_name([source, function.__qualname__.encode(), *(each.encode() for each in layout)])
    return _callable(load(name) or _translated(function, dtypes, name), len(dtypes))


def native_law(arguments: int, parts: Iterable[bytes], prepare: Callable[[], Callable[..., int]]) -> NativeFunction:
    """A C function of 64-bit integers from a user's law, loaded from disk or compiled by numba with checks.

    ``parts`` are the contents that the machine code depends on, besides the package's sources. ``prepare`` returns the
    function to compile; it is called only if no object is on disk. Raises NotCompiled if numba can't compile the
    function.
    """
    if os.environ.get(_DISABLE, "0") not in ("", "0"):
        raise NotCompiled(f"{_DISABLE} is set")
    name = object_name([b"law", *parts])
    with _lock, no_lost_interrupt():
        from . import numba_code

        numba_code.add_symbols()
        address = load(name)
        if address is None:
            try:
                address = numba_code.compiled(prepare, arguments, name)
            except Exception as error:  # for unsupported code numba raises not only its own exceptions
                raise NotCompiled(_reason(error)) from error
    return _callable(address, arguments)


def _callable(address: int, arguments: int) -> NativeFunction:
    return NativeFunction(address, ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * arguments)(address))


def _translated(function: Any, parameters: Sequence[np.dtype], name: str) -> int:
    """Compile a function, keep its object on disk and return its address."""
    from .intrinsics import kernel_module

    machine = target_machine()
    symbol = f"uvms_mj_{name}"
    module = llvm.parse_assembly(str(kernel_module(function, parameters, symbol)))
    module.triple, module.data_layout = llvm.get_process_triple(), str(machine.target_data)
    module.verify()
    tuning = llvm.create_pipeline_tuning_options(speed_level=3)  # without vectors of neighbours, which cost a tenth
    passes = llvm.create_pass_builder(machine, tuning)
    passes.getModulePassManager().run(module, passes)
    code = machine.emit_object(module)
    symbols = (*module.functions, *module.global_variables)
    externals = [each.name for each in symbols if each.is_declaration and not each.name.startswith("llvm.")]
    keep(name, code, symbol, externals)
    address = link(code, symbol, externals)
    assert address is not None, f"{function.__qualname__} uses an unknown symbol among {externals}"
    return address


def _reason(error: Exception) -> str:
    """Numba's reason in one line, with the place in the user's file where numba names one."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    lines = [line for line in lines if not line.startswith("Failed in")]
    if not lines:
        return f"{type(error).__name__} without a reason; arrays of different lengths are a common cause"
    reason = f"{lines[0]} {lines[1].removeprefix('>>> ')}" if lines[0].endswith(":") and lines[1:] else lines[0]
    places = [found for line in lines[1:] if (found := _PLACE.search(line)) and "/numba/" not in found[1]]
    return f"{reason} ({Path(places[0][1]).name}, line {places[0][2]})" if places else reason
