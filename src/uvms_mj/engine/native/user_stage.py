"""A user's stage as machine code: the compiled function between copies of its numbers and checks of its results."""

import types
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...physics.frames import rotation
from ...stages.base import Room
from .compilation import NativeFunction, native_stage
from .memory import SAME, UNIT, attitudes, call_code, call_step, floats, integers, layout, settle_modes, triples

if TYPE_CHECKING:  # global names of the function below, set for each stage
    function: Any = None
    call_stage: Any = None
    foreign: Any = None
    settings: Any = None
    states: Any = None
    signals: Any = None
    output: Any = None
    SETTINGS, STATE, STATE_DOT, OUT, MATRIX, FOREIGN = 0, 0, 0, 0, 0, 0  # offsets in the stage's own memory [bytes]
    REFS_IN, VALUES_IN, REFS_OUT, VALUES_OUT = 0, 0, 0, 0  # offsets in the record of an FMU [bytes]
    N_STATE, N_GIVEN, N_OUT, N_INPUTS, N_OUTPUTS = 0, 0, 0, 0, 0  # numbers
    GET_BEFORE = False
    QUATERNIONS: Any = ()  # places in the output [words]
    ROTATIONS: Any = ()  # places of a quaternion and of its rotation matrix

MAGNITUDE, INFINITE = 0x7FFFFFFFFFFFFFFF, 0x7FF0000000000000
"""Bits of a number without its sign, and the bits of infinity; a NaN has larger ones."""


class _Wrong(Exception):
    """The stage gave something that is not finite, or not an attitude; or one of a library did not return 0."""


def _of_python(own_at, state_at, given_at, state_dot_at, out_at):
    function(settings(own_at + SETTINGS), states(state_at), signals(given_at), states(state_dot_at), output(out_at))


def _of_library(own_at, state_at, given_at, state_dot_at, out_at):
    library = foreign(own_at + FOREIGN)
    library.returned = _c_int(call_code(library.code_at, own_at + SETTINGS, state_at, given_at, state_dot_at, out_at))
    settle_modes()
    if library.returned != 0:
        raise _Wrong


def _of_unit(own_at, state_at, given_at, state_dot_at, out_at):
    unit, given, out = foreign(own_at + FOREIGN), floats(given_at, N_GIVEN), floats(out_at, N_OUT)
    for i in range(N_INPUTS):
        unit.values_in[i] = given[unit.places_in[i]]
        _check_range(unit, 3 + i, unit.values_in[i], unit.range_in[i])
    at = own_at + FOREIGN
    if N_INPUTS > 0:
        _note(unit, 0, _c_int(call_code(unit.fmi2SetReal, unit.instance, at + REFS_IN, N_INPUTS, at + VALUES_IN)))
    if GET_BEFORE:
        _note(unit, 2, _c_int(call_code(unit.fmi2GetReal, unit.instance, at + REFS_OUT, N_OUTPUTS, at + VALUES_OUT)))
    _note(unit, 1, call_step(unit.fmi2DoStep, unit.instance, given_at))
    if not GET_BEFORE:
        _note(unit, 2, _c_int(call_code(unit.fmi2GetReal, unit.instance, at + REFS_OUT, N_OUTPUTS, at + VALUES_OUT)))
    for i in range(N_OUTPUTS):
        _check_range(unit, 3 + N_INPUTS + i, unit.values_out[i], unit.range_out[i])
    settle_modes()
    if unit.returned != 0:
        raise _Wrong
    for i in range(N_OUTPUTS):
        out[unit.places_out[i]] = unit.values_out[i]


def _c_int(word):
    """A C int, which has 32 bits, from the word that a call returned."""
    return word << 32 >> 32


def _check_range(unit, call, value, limits):
    """Note a variable, which stands for a call behind the three, with a value out of its range."""
    if value < limits[0] or value > limits[1]:
        _note(unit, call, -1)


def _note(unit, call, status):
    """Keep the first status beyond a warning."""
    if unit.returned == 0 and not 0 <= status <= 1:
        unit.returned, unit.call = status, call


def _call(own_at, state_at, given_at, state_dot_at, out_at):
    its_state, its_dot = integers(state_at, N_STATE), integers(state_dot_at, N_STATE)
    kept = integers(own_at + OUT, N_OUT)
    # Copies are registers where the stage is Python: their way through memory takes 3 % of a step in free_body.
    state, state_dot, out = its_state.copy(), its_dot.copy(), kept.copy()
    call_stage(own_at, state, given_at, state_dot, out)
    kept[:] = out
    if not _sound(own_at, state, state_dot, out):
        integers(own_at + STATE, N_STATE)[:] = state
        integers(own_at + STATE_DOT, N_STATE)[:] = state_dot
        raise _Wrong
    its_state[:] = state
    its_dot[:] = state_dot
    integers(out_at, N_OUT)[:] = out


def _sound(own_at, state, state_dot, out):
    """Whether all numbers are finite, and attitudes are such."""
    largest = 0
    for i in range(N_OUT):
        largest = max(largest, out[i] & MAGNITUDE)
    for i in range(N_STATE):
        largest = max(largest, state[i] & MAGNITUDE, state_dot[i] & MAGNITUDE)
    if largest >= INFINITE:
        return False
    for place in QUATERNIONS:
        q = floats(out, N_OUT)[place : place + 4]
        if abs(q @ q - 1.0) > UNIT:
            return False
    for place, matrix in ROTATIONS:
        R = triples(own_at + MATRIX, 3)
        rotation(floats(out, N_OUT)[place : place + 4], R)
        for i in range(9):
            if abs(floats(out, N_OUT)[matrix + i] - floats(own_at + MATRIX, 9)[i]) > SAME:
                return False
    return True


def compile_user_stage(
    stage: types.FunctionType | np.dtype,
    room: Room,
    kinds: tuple[np.dtype, np.dtype, np.dtype, np.dtype],
    get_before: bool = False,
) -> NativeFunction:
    """Compile a user's stage to a function of five addresses: its own memory (:class:`.memory.OwnMemory`), its states,
    its inputs, the derivatives of its states, its output. ``kinds`` are the kinds of settings, states, inputs and
    output.

    ``stage`` is a function, or the record in the stage's own memory from which the loop calls a library or an FMU, with
    ``get_before`` its outputs before its step. It returns 0, or the number that says why and where it ended early; then
    states and output are as before. Raises Mistake if the stage is wrong, and NotCompiled if the language lacks what it
    uses.
    """
    return native_stage(*between_copies(stage, room, kinds, get_before))


def between_copies(
    stage: types.FunctionType | np.dtype,
    room: Room,
    kinds: tuple[np.dtype, np.dtype, np.dtype, np.dtype],
    get_before: bool = False,
) -> tuple[types.FunctionType, dict[Any, tuple[np.dtype, str]]]:
    """The function of :func:`compile_user_stage` before it is compiled, and the functions in it that stand for the
    record at an address, each with its dtype and why it can't be changed."""
    its_settings, state, given, out = kinds
    own = None if isinstance(stage, types.FunctionType) else stage
    at: Any = layout(*kinds, own).fields
    places: Any = out.fields or {}
    quaternions = attitudes(out)
    names = {
        "function": stage,
        "N_STATE": state.itemsize // 8,
        "N_OUT": out.itemsize // 8,
        "MATRIX": at["matrix"][1],
        "QUATERNIONS": tuple(places[quat][1] // 8 for quat, _ in quaternions),
        "ROTATIONS": tuple((places[quat][1] // 8, places[R][1] // 8) for quat, R in quaternions if R),
        **{name.upper(): at[name][1] for name in ("settings", "state", "state_dot", "out")},
    }
    called = dict(zip(("settings", "state", "given", "state_dot", "out"), room.arguments, strict=True))
    only_read = f"{called['given']} can only be read; change a copy"
    records = {
        "settings": (its_settings, f"a {room.setting} is constant during a run"),
        "states": (state, ""),
        "signals": (given, only_read),
        "output": (out, ""),
    }
    caller: Any = _of_python
    if own is not None:
        records["foreign"] = (own, "")
        inner: Any = own.fields
        names |= {"FOREIGN": at["foreign"][1], "GET_BEFORE": get_before, "N_GIVEN": given.itemsize // 8}
        names |= {name.upper(): inner[name][1] for name in inner if name.startswith(("refs", "values"))}
        names |= {"N_INPUTS": inner["values_in"][0].shape[0]} if "values_in" in inner else {}
        names |= {"N_OUTPUTS": inner["values_out"][0].shape[0]} if "values_out" in inner else {}
        caller = _of_unit if "instance" in inner else _of_library
    readers = {name: _reader(name) for name in records}
    known = globals() | names | readers
    for name, each in {"call_stage": caller, "_sound": _sound}.items():
        known[name] = types.FunctionType(each.__code__, known, each.__name__)
    call = types.FunctionType(_call.__code__, known, _call.__name__)
    return call, {readers[name]: records[name] for name in records}


def _reader(name: str) -> Any:
    """The stand-in, in the function above, for the record or the array at an address."""

    def reader(address: int) -> Any:
        raise NotImplementedError(name)

    return reader


def is_check(file: str) -> bool:
    """Whether a stage that ended early in this file did so because of what it gave."""
    return Path(file) == Path(__file__)
