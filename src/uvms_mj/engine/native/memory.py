"""Access of kernels to memory and functions outside of the record. :mod:`.intrinsics` has the compiled versions.

:class:`OwnMemory` has the numbers of a user's stage, or of one that runs as plain Python: copies of the loop's, which
the loop takes back when the stage has returned and its results are sound.
"""

import ctypes
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import mujoco
import numpy as np

from ...physics.frames import rotation_matrix
from ...physics.kernels import Record
from ...stages.base import Room

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
"""The time on MuJoCo's clock while it is stopped (:func:`.callback.stopped_clock`)."""

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
    if dtype.base.names is not None:
        memory = (ctypes.c_char * dtype.itemsize).from_address(int(word))
        return np.frombuffer(memoryview(memory), np.dtype((Record, dtype.base))).reshape(dtype.shape)
    numbers = integers if dtype.base.kind == "i" else floats
    return numbers(word, dtype.itemsize // 8).reshape(dtype.shape)


def registered() -> np.ndarray:
    """The registry."""
    return registry


def frozen_clock() -> np.ndarray:
    """The time of the stopped clock (1,)."""
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


_fesetenv = ctypes.CDLL(None).fesetenv
_fesetenv.argtypes, _fesetenv.restype = [ctypes.c_void_p], ctypes.c_int
if sys.platform == "darwin":
    DEFAULT_MODES = ctypes.addressof(ctypes.c_byte.in_dll(ctypes.CDLL(None), "_FE_DFL_ENV"))
else:
    DEFAULT_MODES = -1
"""Address of the floating-point modes with which a process begins."""


def settle_modes() -> None:
    """Set the floating-point modes of this thread to the modes of a run: rounding to the nearest, with numbers
    below the normal ones. Every call of a user's machine code may change them, and so does loading a library that was
    linked with -ffast-math."""
    _fesetenv(DEFAULT_MODES)


UNSET = 0x7FF8DECADE0FACEE
"""Contents of the output before the first call: a NaN that no computation produces, so that an entry that the stage did
not set is known."""
UNIT = 1e-6
"""Largest difference of a quaternion's squared length from 1."""
SAME = 1e-5
"""Largest difference of an entry of a rotation matrix from the matrix of its quaternion."""


def attitudes(out: np.dtype) -> tuple[tuple[str, str], ...]:
    """The names of the quaternions of an output, each with the name of its rotation matrix, or empty."""
    names = out.names or ()
    found = [(name, name.replace("quat", "R")) for name in names if name.startswith("quat")]
    return tuple((quat, R if R in names else "") for quat, R in found)


def layout(
    settings: np.dtype, state: np.dtype, given: np.dtype, out: np.dtype, foreign: np.dtype | None = None
) -> np.dtype:
    """The record of a stage's own memory. ``matrix`` is for a rotation matrix to compare with; ``foreign`` is what the
    loop needs to call machine code of the user's."""
    parts = {"settings": settings, "state": state, "given": given, "state_dot": state, "out": out}
    own = [("foreign", foreign)] if foreign is not None else []
    return np.dtype([*parts.items(), ("matrix", "f8", (9,)), *own], align=True)


class OwnMemory:
    """The arguments of a stage: settings (1,), what it is given, states (1,), their derivatives and its output, a
    record or an array of float64. ``memory`` is a record (1,) of :func:`layout`. The messages use the words of the
    stage's room."""

    def __init__(self, room: Room, memory: np.ndarray, settings: np.ndarray) -> None:
        self.room = room
        self.names = dict(zip(("settings", "state", "given", "state_dot", "out"), room.arguments, strict=True))
        self._use(memory)
        self.take_settings(settings)
        self.start()

    def _use(self, memory: np.ndarray) -> None:
        self.memory = memory
        self.arrays = {name: memory[name] for name in self.names}
        if self.arrays["out"].dtype.names is None:
            self.arrays["out"] = self.arrays["out"][0]

    def move(self) -> np.ndarray:
        """Move to a new place, and return it. Arrays of the former place keep what they show."""
        self._use(self.memory.copy())
        return self.memory

    def take_settings(self, settings: np.ndarray) -> None:
        """Copy other settings (1,)."""
        self.arrays["settings"][:] = settings

    def clear(self) -> None:
        """Set the derivatives and the output to zero."""
        self._numbers("state_dot")[:] = 0
        self._numbers("out")[:] = 0

    def start(self) -> None:
        """Prepare for a run. At each instant the states are the loop's."""
        self.clear()
        self._numbers("out")[:] = UNSET
        for name in self.room.optional:
            self.arrays["out"][name] = 0.0

    def fill(self, given: np.ndarray, state: np.ndarray) -> None:
        """Copy what a stage is given at an instant, a record (1,), and its states (1,)."""
        self.arrays["given"][:] = given
        self.arrays["state"][:] = state

    def take_over(self, other: "OwnMemory") -> None:
        """Copy the derivatives and the output that the stage has set in another memory."""
        for name in ("state_dot", "out"):
            self._numbers(name)[:] = other._numbers(name)

    def take(self, state: np.ndarray, state_dot: np.ndarray, out: np.ndarray) -> None:
        """Copy states (1,), their derivatives (1,) and the output to the loop's."""
        state[:], state_dot[:] = self.arrays["state"], self.arrays["state_dot"]
        out[:] = self.arrays["out"]

    def _numbers(self, name: str) -> np.ndarray:
        """The numbers of an argument as integers. A view."""
        fields: Any = self.memory.dtype.fields
        kind, place = fields[name][:2]
        return self.memory.view(np.uint8)[place : place + kind.itemsize].view(np.int64)

    def wrong(self) -> str:
        """The stage's fault, as a predicate, e.g. "set tau_cmd[2] to nan"; empty if nothing."""
        return self.not_finite() or self.wrong_attitude()

    def not_finite(self) -> str:
        """The first entry of the output, of state_dot or of state that is not finite or was never set, as a predicate;
        empty if there is none."""
        out, called = self.arrays["out"], self.names["out"]
        fields = {f"{called}.{name}": out[name].reshape(-1) for name in out.dtype.names or ()} or {called: out}
        for name, values in fields.items():
            for i, value in enumerate(values):
                if values.view(np.int64)[i] == UNSET:
                    return f"left {name}[{i}] unset: {self._demand()}; its return value is ignored"
                if not math.isfinite(value):
                    return f"set {name}[{i}] to {value}"
        for record in ("state_dot", "state"):
            for name in self.arrays[record].dtype.names or ():
                for place, value in np.ndenumerate(self.arrays[record][name][0]):
                    if not math.isfinite(value):
                        verb, i = "set" if record == "state_dot" else "let", ", ".join(map(str, place))
                        return f"{verb} {record}.{name}[{i}] {'to' if verb == 'set' else 'become'} {value}"
        return ""

    def wrong_attitude(self) -> str:
        """The first quaternion of the output that is not a unit quaternion, or the rotation matrix that has another
        attitude, as a predicate; empty if there is none."""
        out, called = self.arrays["out"], self.names["out"]
        for name, R in attitudes(out.dtype):
            quat = out[name][0]
            if not abs(quat @ quat - 1.0) <= UNIT:
                return f"set {called}.{name} to length {math.sqrt(quat @ quat):.9g}: it must be a unit quaternion"
            if R and not (abs(out[R][0] - rotation_matrix(quat)) <= SAME).all():
                same = f"uvms_mj.physics.frames.rotation({called}.{name}, {called}.{R}) sets it"
                return f"set {called}.{R} to another attitude than {called}.{name}: {same}"
        return ""

    def _demand(self) -> str:
        fields, called = self.arrays["out"].dtype.names, self.names["out"]
        who = f"{'an' if self.room.noun[0] in 'aeiou' else 'a'} {self.room.noun}"
        if fields:
            return f"{who} must set {', '.join(fields)} of {called}"
        number = {6: "six"}.get(len(self.arrays["out"]), len(self.arrays["out"]))
        return f"{who} must fill all {number} entries of {called}, as in {called}[:] = ..."
