"""Compiling a law: any class of :mod:`uvms_mj.control`, ours or a user's, to one function that the loop calls by its
address."""

import inspect
import types
from typing import TYPE_CHECKING, Any

import numpy as np

from ..control.base import Controller
from ..control.loader import BUILT_IN
from .compilation import NativeFunction, native_function
from .layouts import SIGNALS, SIGNALS_AND_TRUTH
from .sources import global_values, source_files

if TYPE_CHECKING:  # names of the template below, set for each law
    carray: Any = None
    pointer: Any = None
    GAINS: Any = None
    STATE: Any = None
    law: Any = None


def _law(gains_at, state_at, signals_at, state_dot_at, tau_cmd_at):
    gains = carray(pointer(gains_at), (1,), GAINS)[0]
    state = carray(pointer(state_at), (1,), STATE)[0]
    state_dot = carray(pointer(state_dot_at), (1,), STATE)[0]
    signals = carray(pointer(signals_at), (1,), SIGNALS)[0]
    tau_cmd = carray(pointer(tau_cmd_at), (6,), np.float64)
    try:
        law(gains, state, signals, state_dot, tau_cmd)
    except Exception:  # the one kind that numba can catch; the law is then run again as plain Python for the details
        return 1
    return 0


def compile_law(controller: Controller) -> NativeFunction:
    """The law as a function of five addresses (gains, state, signals, state_dot, tau_cmd) that returns 0, or 1 if the
    law raised.

    Array bounds are checked and a division by zero raises, so that a mistake in a law is an exception and not a wild
    number.

    Raises:
        NotCompiled: numba can't compile it.
    """
    law = type(controller).law
    gains, state = controller.record().dtype, type(controller).state_record().dtype
    signals = SIGNALS_AND_TRUTH if controller.uses_truth else SIGNALS
    layout = (law.__qualname__, gains.descr, state.descr, signals.descr)
    parts = [repr(layout).encode(), law.__code__.co_code]
    module = inspect.getmodule(law)
    if module is not None and getattr(module, "__file__", None):
        parts += [path.read_bytes() for path in source_files(module)] + [global_values(module)]
    else:
        parts.append(repr((law.__code__.co_consts, law.__code__.co_names)).encode())

    def prepare():
        import numba

        from .intrinsics import pointer

        names = {
            "carray": numba.carray,
            "np": np,
            "pointer": pointer,
            "GAINS": gains,
            "STATE": state,
            "SIGNALS": signals,
            "law": numba.njit(boundscheck=True, error_model="python")(law),
            "__name__": __name__,
        }
        return types.FunctionType(_law.__code__, names, _law.__name__)

    # a law of ours neither raises nor allocates; a user's may do both
    self_contained = type(controller) in BUILT_IN.values()
    return native_function(_law, 5, True, parts=parts, prepare=prepare, self_contained=self_contained)
