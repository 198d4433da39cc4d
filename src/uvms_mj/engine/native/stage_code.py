"""Compilation of a stage, shipped or a user's, to one function that the loop calls by its address."""

import ast
import inspect
import os
import sys
import sysconfig
import types
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...files import parsed
from ...physics.frames import rotation
from .arena import NEAR, PATTERN, REGIONS, SAME, UNIT, attitudes, offsets, spread
from .compilation import NativeFunction, native_function, native_law
from .memory import floats, integers, triples

if TYPE_CHECKING:  # global names of the templates below, set for each stage
    carray: Any = None
    pointer: Any = None
    function: Any = None
    output: Any = None
    call: Any = None
    SETTINGS: Any = None
    STATE: Any = None
    GIVEN: Any = None
    OUT: Any = None
    N_SETTINGS, N_GIVEN, N_STATE, N_OUT = 0, 0, 0, 0  # numbers
    OWN_SETTINGS, SETTINGS_, GIVEN_, STATE_, STATE_DOT_, OUT_ = 0, 0, 0, 0, 0, 0  # offsets in the arena
    STATES: Any = ()  # of each state: place in the arena's record [bytes], first number in the loop's, size
    ENDS: Any = ()
    QUATERNIONS: Any = np.zeros(0, int)  # places in the output [bytes]
    ROTATIONS: Any = np.zeros((0, 2), int)  # places of a quaternion and of its rotation matrix
    MATRIX = 0  # offset in the arena

_PACKAGE = Path(__file__).parents[2]
_FOREIGN = tuple(Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib"))
_INSTALLED = tuple(f"{sysconfig.get_path(name)}{os.sep}" for name in ("stdlib", "platstdlib", "purelib", "platlib"))
RETURNED, RAISED, OVERRAN, CHANGED_SETTINGS, NOT_FINITE, NOT_ATTITUDE = range(6)
"""Return codes of a stage's machine code."""
_INNER: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of numba for functions that only machine code calls: without entries from Python and C, which cost a tenth of
the compilation."""
MAGNITUDE, INFINITE = 0x7FFFFFFFFFFFFFFF, 0x7FF0000000000000
"""Bits of a number without its sign, and those of infinity; those of a NaN are larger."""


def _record(address):
    return carray(pointer(address), (1,), OUT)[0]


def _array(address):
    return carray(pointer(address), (N_OUT,), np.float64)


def _call(settings_at, state_at, given_at, state_dot_at, out_at):
    settings = carray(pointer(settings_at), (1,), SETTINGS)[0]
    state = carray(pointer(state_at), (1,), STATE)[0]
    state_dot = carray(pointer(state_dot_at), (1,), STATE)[0]
    given = carray(pointer(given_at), (1,), GIVEN)[0]
    out = output(out_at)
    try:
        function(settings, state, given, state_dot, out)
    except (
        Exception
    ):  # the only class that numba can catch; the stage is then run again as plain Python for the details
        return RAISED
    return RETURNED


def _call_in_arena(arena_at, state_at, given_at, state_dot_at, out_at):
    state, state_dot, out = floats(state_at, N_STATE), floats(state_dot_at, N_STATE), integers(out_at, N_OUT)
    given, its_given = integers(given_at, N_GIVEN), integers(arena_at + GIVEN_, N_GIVEN)
    for i in range(N_GIVEN):
        its_given[i] = given[i]
    for place, first, n in STATES:
        its_state = floats(arena_at + STATE_ + place, n)
        for i in range(n):
            its_state[i] = state[first + i]
    settings_at = arena_at + SETTINGS_
    done = call(settings_at, arena_at + STATE_, arena_at + GIVEN_, arena_at + STATE_DOT_, arena_at + OUT_)
    other = 0  # loops without an exit, of which the processor does several turns at once
    for end in ENDS:
        near = integers(arena_at + end, NEAR)
        for i in range(NEAR):
            other |= near[i] ^ PATTERN
    if other != 0:
        return OVERRAN
    settings, own_settings = integers(settings_at, N_SETTINGS), integers(arena_at + OWN_SETTINGS, N_SETTINGS)
    for i in range(N_SETTINGS):
        other |= settings[i] ^ own_settings[i]
    if other != 0:
        return CHANGED_SETTINGS
    if done != RETURNED:
        return done
    bits, largest = integers(arena_at + OUT_, N_OUT), 0
    for place, _, n in STATES:
        its_state, its_state_dot = integers(arena_at + STATE_ + place, n), integers(arena_at + STATE_DOT_ + place, n)
        for i in range(n):
            largest = max(largest, its_state[i] & MAGNITUDE, its_state_dot[i] & MAGNITUDE)
    for i in range(N_OUT):
        largest = max(largest, bits[i] & MAGNITUDE)
    if largest >= INFINITE:
        return NOT_FINITE
    for k in range(len(QUATERNIONS)):
        q = floats(arena_at + OUT_ + QUATERNIONS[k], 4)
        if abs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0) > UNIT:
            return NOT_ATTITUDE
    for k in range(len(ROTATIONS)):
        its_R, R = triples(arena_at + OUT_ + ROTATIONS[k, 1], 3), triples(arena_at + MATRIX, 3)
        rotation(floats(arena_at + OUT_ + ROTATIONS[k, 0], 4), R)
        for i in range(3):
            for j in range(3):
                if abs(its_R[i, j] - R[i, j]) > SAME:
                    return NOT_ATTITUDE
    for place, first, n in STATES:
        its_state, its_state_dot = floats(arena_at + STATE_ + place, n), floats(arena_at + STATE_DOT_ + place, n)
        for i in range(n):
            state[first + i] = its_state[i]
            state_dot[first + i] = its_state_dot[i]
    for i in range(N_OUT):
        out[i] = bits[i]
    return RETURNED


def compile_stage(
    stage: types.FunctionType, settings: np.dtype, state: np.dtype, given: np.dtype, out: np.dtype, guarded: bool
) -> NativeFunction:
    """Compile a stage to a function of five addresses (settings, state, given, state_dot, out).

    A user's stage, which is ``guarded``, returns one of the codes above, and the address of its arena takes the place
    of the settings' one. It and the functions that it calls check indices and shapes and raise on a division by zero,
    so that a mistake raises an exception. A shipped stage returns 0. ``out`` is a record or an array of float64. Raises
    NotCompiled if numba can't compile the stage.
    """
    if not guarded:
        return native_function(stage, [settings, state, given, state, out])
    layout = (stage.__qualname__, settings.descr, state.descr, given.descr, str(out))
    parts = [repr(layout).encode(), stage.__code__.co_code]
    module = inspect.getmodule(stage)
    if module is not None and getattr(module, "__file__", None):
        files = source_files(module)
        parts += [path.read_bytes() for path in files] + [
            part for own in _modules(files) for part in _frozen(vars(own))
        ]
    else:
        parts.append(repr((stage.__code__.co_consts, stage.__code__.co_names)).encode())
    parts += _frozen(inspect.getclosurevars(stage).nonlocals)

    def prepare():
        import numba

        from .guarded import guarded_function
        from .numba_code import pointer

        names = {
            "carray": numba.carray,
            "np": np,
            "pointer": pointer,
            "SETTINGS": settings,
            "STATE": spread(state),
            "GIVEN": given,
            "OUT": out,
            "N_OUT": out.itemsize // 8,
            "RAISED": RAISED,
            "RETURNED": RETURNED,
            "function": guarded_function(stage, error_model="python", **_INNER),
            "__name__": __name__,
        }
        view = _array if out.names is None else _record
        names["output"] = numba.njit(types.FunctionType(view.__code__, names, view.__name__), **_INNER)
        call = types.FunctionType(_call.__code__, names, _call.__name__)
        places = _places(settings.itemsize, state, given.itemsize, out) | {"call": numba.njit(call, **_INNER)}
        return types.FunctionType(_call_in_arena.__code__, globals() | places, _call_in_arena.__name__)

    return native_law(5, parts, prepare)


def _places(settings: int, state: np.dtype, given: int, out: np.dtype) -> dict[str, Any]:
    """The constants of :func:`_call_in_arena`, from the record of states, the output and the sizes of the
    others [bytes]."""
    states = spread(state)
    sizes = {"settings": settings, "given": given, "state": states.itemsize, "state_dot": states.itemsize}
    sizes["out"] = out.itemsize
    at = offsets(sizes)
    in_out: Any = out.fields or {}
    names, packed, spaced = state.names or (), dict(state.fields or {}), dict(states.fields or {})
    fields = [(spaced[name][1], packed[name][1], packed[name][0].itemsize) for name in names]
    spans = [(at[name], sizes[name]) for name in ("settings", "given", "out")]
    spans += [(at[name] + place, size) for name in ("state", "state_dot") for place, _, size in fields]
    return {
        "N_SETTINGS": settings // 8,
        "N_GIVEN": given // 8,
        "N_STATE": state.itemsize // 8,
        "N_OUT": out.itemsize // 8,
        "STATES": tuple((place, first // 8, size // 8) for place, first, size in fields),
        "ENDS": tuple(end for place, size in spans for end in (place - 8 * NEAR, place + size)),
        "OWN_SETTINGS": at["own_settings"],
        "MATRIX": at["matrix"],
        "QUATERNIONS": np.array([in_out[quat][1] for quat, _ in attitudes(out)], int),
        "ROTATIONS": np.array([(in_out[quat][1], in_out[R][1]) for quat, R in attitudes(out) if R], int).reshape(-1, 2),
        **{f"{name.upper()}_": at[name] for name in REGIONS},
    }


def source_files(module: types.ModuleType) -> list[Path]:
    """Files of a module and of its direct and indirect imports, except installed packages and the standard library.

    Imports are read from the source, because a constant imported from another file leaves no trace in the module.
    """
    found: dict[Path, None] = {}
    todo = [Path(str(module.__file__)).resolve()]
    while todo:
        path = todo.pop()
        if path in found or not path.is_file() or path.suffix != ".py":
            continue
        if found and any(path.is_relative_to(folder) for folder in (*_FOREIGN, _PACKAGE)):
            continue
        found[path] = None
        for node in ast.walk(parsed(path.read_bytes())):
            names: list[str] = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            todo += [origin for name in names if (origin := _origin(name)) is not None]
    return sorted(found)


def _origin(name: str) -> Path | None:
    loaded = sys.modules.get(name)
    if loaded is not None:
        file = getattr(loaded, "__file__", None)
        return Path(file).resolve() if file else None
    try:
        spec = find_spec(name)
    except (ImportError, ValueError, AttributeError):
        return None
    return Path(spec.origin).resolve() if spec is not None and spec.origin and spec.has_location else None


def _modules(files: Sequence[Path]) -> list[types.ModuleType]:
    """The loaded modules of these files, in their order."""
    loaded = [(module, str(module.__file__)) for module in sys.modules.values() if getattr(module, "__file__", None)]
    own = [(module, Path(file).resolve()) for module, file in loaded if not file.startswith(_INSTALLED)]
    return [module for file in files for module, its in own if its == file]


def _frozen(values: Mapping[str, Any]) -> Iterator[bytes]:
    """Bytes of the values among these that numba freezes into machine code, and of those within tuples."""
    for name, value in sorted(values.items()):
        if isinstance(value, tuple):
            yield from _frozen({f"{name}[{i}]": each for i, each in enumerate(value)})
        elif isinstance(value, np.ndarray):
            yield f"{name} {value.dtype} {value.shape} {value.strides}".encode() + value.tobytes()
        elif isinstance(value, bool | int | float | complex | str | np.generic) and name[:2] != "__":
            yield f"{name} {value!r}".encode()
