"""Compiling a law: any class of :mod:`uvms_mj.control`, ours or a user's, to one function that the loop calls by its address."""

import inspect
import sys
import types as python_types

import numba
import numpy as np
from numba import carray, cfunc, types

from ..compilation import cache_folder, fingerprint, global_values, source_files
from ..control.base import Controller
from ..signals import GIVEN, record_dtype
from .symbols import pointer

_SIGNALS = record_dtype(GIVEN)


def _adapter(gains_at, state_at, signals_at, state_dot_at, tau_cmd_at):
    gains = carray(pointer(gains_at), (1,), _GAINS)[0]  # noqa: F821 - the names in capitals are set for each law
    state = carray(pointer(state_at), (1,), _STATE)[0]  # noqa: F821
    state_dot = carray(pointer(state_dot_at), (1,), _STATE)[0]  # noqa: F821
    signals = carray(pointer(signals_at), (1,), _SIGNALS)[0]
    tau_cmd = carray(pointer(tau_cmd_at), (6,), np.float64)
    try:
        _LAW(gains, state, signals, state_dot, tau_cmd)  # noqa: F821
    except Exception:
        return 1
    return 0


class NotCompiled(Exception):
    """A law that numba can't compile; the message is numba's own reason."""


def compile_law(controller: Controller):
    """The law as a cfunc of five addresses (gains, state, signals, state_dot, tau_cmd) that returns 0, or 1 if the law raised.

    Array bounds are checked and a division by zero raises, so that a mistake in a law is an exception and not a wild number.

    Raises:
        NotCompiled: numba can't compile it.
    """
    law = type(controller).law
    gains, state = _padded(controller.record()), _padded(type(controller).state_record())
    source = inspect.getmodule(law)
    parts = [repr((law.__qualname__, gains.dtype, state.dtype)).encode(), law.__code__.co_code]
    if source is not None and getattr(source, "__file__", None):
        parts += [path.read_bytes() for path in source_files(source)] + [global_values(source)]
    else:
        parts.append(repr((law.__code__.co_consts, law.__code__.co_names)).encode())
    template = dict(vars(sys.modules[__name__]))
    with cache_folder(f"law-{fingerprint(parts)[:12]}"):
        try:
            template |= {
                "_GAINS": gains.dtype,
                "_STATE": state.dtype,
                "_LAW": numba.njit(boundscheck=True, error_model="python")(law),
            }
            adapter = python_types.FunctionType(_adapter.__code__, template, _adapter.__name__)
            return cfunc(types.int32(*[types.intp] * 5), cache=True)(adapter)
        except Exception as error:  # numba raises more kinds than its own when it meets what it doesn't know
            lines = [line.strip() for line in str(error).splitlines() if line.strip()]
            reason = next((line for line in lines if not line.startswith("Failed in")), type(error).__name__)
            raise NotCompiled(reason) from error


def _padded(record: np.ndarray) -> np.ndarray:
    """A record of no fields has no address; it gets a field that nobody reads."""
    return record if record.dtype.itemsize else np.zeros(1, np.dtype([("none", "f8")]))


def memory_of(controller: Controller) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gains, state and state_dot as record arrays (1,) that a law works on."""
    state = _padded(type(controller).state_record())
    return _padded(controller.record()), state, state.copy()


