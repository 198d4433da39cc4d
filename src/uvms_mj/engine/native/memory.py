"""Access of kernels to memory and functions outside of the record. :mod:`.intrinsics` has the compiled versions."""

import ctypes
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import mujoco
import numpy as np

from ...physics.kernels import Record

CAPACITY = 1024
"""Rows of the registry: one more than the number of vehicles that a process can have attached at once."""

registry = np.zeros((CAPACITY, 3), dtype=np.int64)
"""Rows (address of mjData, of the record, of its code), zero if free. Row 0 is (last row ever used, 0, 0).

Every callback reads it without a lock; writers hold a lock. A row never moves. Its first number is written last and
cleared first, so that a callback in another thread never reads half a row.
"""


def _mujoco_library() -> ctypes.CDLL:
    """The MuJoCo library that this process has already loaded."""
    pattern = "libmujoco*.dylib" if sys.platform == "darwin" else "libmujoco.so.*"
    return ctypes.CDLL(str(min(Path(mujoco.__file__).parent.glob(pattern))))


mujoco_library = _mujoco_library()
_factorM = mujoco_library.mj_factorM
_factorM.argtypes, _factorM.restype = [ctypes.c_void_p] * 2, None

stopped = np.zeros(1, dtype=np.int64)
"""Set by the machine code of a stage in whose loop a signal handler raised, as it does at Ctrl-C."""

clock = np.zeros(1)
"""What MuJoCo's clock shows while it is stopped (:func:`.callback.stopped_clock`)."""

llvm.add_symbol("uvms_mj_registry", registry.ctypes.data)
llvm.add_symbol("uvms_mj_clock", clock.ctypes.data)
llvm.add_symbol("uvms_mj_stopped", stopped.ctypes.data)
llvm.add_symbol("mj_factorM", ctypes.cast(_factorM, ctypes.c_void_p).value)


def mj_factorM(model: int, data: int) -> None:
    """Factor mjData.M with MuJoCo's own function."""
    _factorM(model, data)


def floats(address: int, n: int) -> np.ndarray:
    """The n float64 numbers at an address."""
    return np.ctypeslib.as_array((ctypes.c_double * n).from_address(int(address)))


def triples(address: int, n: int) -> np.ndarray:
    """The array (n, 3) of float64 numbers at an address."""
    return floats(address, 3 * n).reshape(n, 3)


def integers(address: int, n: int) -> np.ndarray:
    """The n int64 numbers at an address."""
    return np.ctypeslib.as_array((ctypes.c_int64 * n).from_address(int(address)))


def _reader(dtype: np.dtype) -> Callable[[int], Any]:
    """A function that gives the record at an address."""
    kind = np.dtype((Record, dtype))

    def record_at(address: int) -> Any:
        memory = (ctypes.c_char * dtype.itemsize).from_address(int(address))
        return np.frombuffer(memoryview(memory), kind)[0]

    return record_at


def at_address(word: int, dtype: np.dtype) -> Any:
    """An argument of machine code as Python has it: a number, or the record or array at an address."""
    if dtype.names is not None:
        return _reader(dtype)(word)
    if dtype.subdtype is None:
        return word
    numbers = integers if dtype.base.kind == "i" else floats
    return numbers(word, dtype.itemsize // 8).reshape(dtype.shape)


def registered() -> np.ndarray:
    """The registry."""
    return registry


def frozen_clock() -> np.ndarray:
    """What the stopped clock shows (1,)."""
    return clock


def call_step(function: int, instance: int, clock: int) -> int:
    """Call the fmi2DoStep at an address with an instance and the time and step of the clock at an address; its
    status."""
    t, h = floats(clock, 2)
    kind = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)
    return int(kind(int(function))(int(instance), t, h, 1))


def call_code(function: int, *words: int) -> int:
    """Call machine code by its address with 64-bit integers; what it returns."""
    kind = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * len(words))
    return kind(int(function))(*map(int, words))
