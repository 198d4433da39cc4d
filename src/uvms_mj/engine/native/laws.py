"""Compilation of a law, built-in or a user's, to one function that the loop calls by its address."""

import inspect
import types
from typing import TYPE_CHECKING, Any

import numpy as np

from ...control.base import Controller
from ...stages.base import is_shipped
from .arena import NEAR, PATTERN, REGIONS, offsets, spread
from .compilation import NativeFunction, native_function
from .layouts import SIGNALS, SIGNALS_AND_TRUTH
from .memory import floats, integers
from .sources import global_values, source_files

if TYPE_CHECKING:  # global names of the templates below, set for each law
    carray: Any = None
    pointer: Any = None
    GAINS: Any = None
    STATE: Any = None
    N_GAINS, N_SIGNALS, N_STATE = 0, 0, 0  # numbers
    OWN_GAINS, GAINS_, SIGNALS_, STATE_, STATE_DOT_, TAU_CMD_ = 0, 0, 0, 0, 0, 0  # offsets in the arena
    STATES: Any = ()  # of each state: place in the arena's record [bytes], first number in the loop's, size
    ENDS: Any = ()
    call: Any = None
    law: Any = None

RETURNED, RAISED, OVERRAN, CHANGED_GAINS, NOT_FINITE = range(5)
"""Return codes of a law's machine code."""


def _call(gains_at, state_at, signals_at, state_dot_at, tau_cmd_at):
    gains = carray(pointer(gains_at), (1,), GAINS)[0]
    state = carray(pointer(state_at), (1,), STATE)[0]
    state_dot = carray(pointer(state_dot_at), (1,), STATE)[0]
    signals = carray(pointer(signals_at), (1,), SIGNALS)[0]
    tau_cmd = carray(pointer(tau_cmd_at), (6,), np.float64)
    try:
        law(gains, state, signals, state_dot, tau_cmd)
    except Exception:  # the only class that numba can catch; the law is then run again as plain Python for the details
        return RAISED
    return RETURNED


def _call_in_arena(arena_at, state_at, signals_at, state_dot_at, tau_cmd_at):
    state, state_dot, tau_cmd = floats(state_at, N_STATE), floats(state_dot_at, N_STATE), floats(tau_cmd_at, 6)
    its_tau_cmd = floats(arena_at + TAU_CMD_, 6)
    signals, its_signals = floats(signals_at, N_SIGNALS), floats(arena_at + SIGNALS_, N_SIGNALS)
    for i in range(N_SIGNALS):
        its_signals[i] = signals[i]
    for place, first, n in STATES:
        its_state = floats(arena_at + STATE_ + place, n)
        for i in range(n):
            its_state[i] = state[first + i]
    gains_at = arena_at + GAINS_
    done = call(gains_at, arena_at + STATE_, arena_at + SIGNALS_, arena_at + STATE_DOT_, arena_at + TAU_CMD_)
    for end in ENDS:
        near = integers(arena_at + end, NEAR)
        for i in range(NEAR):
            if near[i] != PATTERN:
                return OVERRAN
    gains, own_gains = integers(gains_at, N_GAINS), integers(arena_at + OWN_GAINS, N_GAINS)
    for i in range(N_GAINS):
        if gains[i] != own_gains[i]:
            return CHANGED_GAINS
    if done != RETURNED:
        return done
    odd = 0.0  # becomes NaN with the first number that is not finite
    for place, _, n in STATES:
        its_state, its_state_dot = floats(arena_at + STATE_ + place, n), floats(arena_at + STATE_DOT_ + place, n)
        for i in range(n):
            odd += 0.0 * its_state[i] + 0.0 * its_state_dot[i]
    for i in range(6):
        odd += 0.0 * its_tau_cmd[i]
    if odd != 0.0:
        return NOT_FINITE
    for place, first, n in STATES:
        its_state, its_state_dot = floats(arena_at + STATE_ + place, n), floats(arena_at + STATE_DOT_ + place, n)
        for i in range(n):
            state[first + i] = its_state[i]
            state_dot[first + i] = its_state_dot[i]
    for i in range(6):
        tau_cmd[i] = its_tau_cmd[i]
    return RETURNED


def compile_law(controller: Controller) -> NativeFunction:
    """Compile a law to a function of five addresses (gains, state, signals, state_dot, tau_cmd) that returns one of
    the codes above.

    For a user's law, the address of its arena takes the place of the gains' one. The law and the functions that it
    calls check indices and shapes and raise on a division by zero, so that a mistake raises an exception.

    Raises:
        NotCompiled: numba can't compile the law.
    """
    law, guarded = type(controller).function(), not is_shipped(controller)
    gains, state = controller.record().dtype, type(controller).state_record().dtype
    signals = SIGNALS_AND_TRUTH if controller.uses_truth else SIGNALS
    layout = (law.__qualname__, gains.descr, state.descr, signals.descr, guarded)
    parts = [repr(layout).encode(), law.__code__.co_code]
    module = inspect.getmodule(law)
    if module is not None and getattr(module, "__file__", None):
        parts += [path.read_bytes() for path in source_files(module)] + [global_values(module)]
    else:
        parts.append(repr((law.__code__.co_consts, law.__code__.co_names)).encode())

    def prepare():
        import numba

        from .guarded import guarded_function
        from .intrinsics import pointer

        names = {
            "carray": numba.carray,
            "np": np,
            "pointer": pointer,
            "GAINS": gains,
            "STATE": spread(state) if guarded else state,
            "SIGNALS": signals,
            "RAISED": RAISED,
            "RETURNED": RETURNED,
            "law": (guarded_function if guarded else numba.njit)(law, error_model="python"),
            "__name__": __name__,
        }
        call = types.FunctionType(_call.__code__, names, _call.__name__)
        if not guarded:
            return call
        names = _places(gains.itemsize, state, signals.itemsize) | {"call": numba.njit(call)}
        return types.FunctionType(_call_in_arena.__code__, globals() | names, _call_in_arena.__name__)

    # a built-in law neither raises nor allocates; a user's law may do both
    return native_function(_call, 5, True, parts=parts, prepare=prepare, self_contained=not guarded, law=guarded)


def _places(gains: int, state: np.dtype, signals: int) -> dict[str, Any]:
    """The constants of :func:`_call_in_arena`, from the record of states and the sizes of the others [bytes]."""
    states = spread(state)
    sizes = {"gains": gains, "signals": signals, "state": states.itemsize, "state_dot": states.itemsize, "tau_cmd": 48}
    at = offsets(sizes)
    names, packed, spaced = state.names or (), dict(state.fields or {}), dict(states.fields or {})
    fields = [(spaced[name][1], packed[name][1], packed[name][0].itemsize) for name in names]
    spans = [(at[name], sizes[name]) for name in ("gains", "signals", "tau_cmd")]
    spans += [(at[name] + place, size) for name in ("state", "state_dot") for place, _, size in fields]
    return {
        "N_GAINS": gains // 8,
        "N_SIGNALS": signals // 8,
        "N_STATE": state.itemsize // 8,
        "STATES": tuple((place, first // 8, size // 8) for place, first, size in fields),
        "ENDS": tuple(end for place, size in spans for end in (place - 8 * NEAR, place + size)),
        "OWN_GAINS": at["own_gains"],
        **{f"{name.upper()}_": at[name] for name in REGIONS},
    }
