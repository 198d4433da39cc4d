"""MuJoCo's timers, which stand still while a Simulation steps.

MuJoCo's Python package sets ``mjcb_time``, with which ``mj_step`` reads the clock some thirty times a step for
``mjData.timer``. That takes a fifth of the step of a rigid vehicle, and nobody asks for these times in a run.
"""

import ctypes
import functools
import threading

from .compilation import native_function
from .memory import clock, frozen_clock, mujoco_library

_clock = ctypes.c_void_p.in_dll(mujoco_library, "mjcb_time")
_show = ctypes.CFUNCTYPE(ctypes.c_double)


def _stopped() -> float:
    return frozen_clock()[0]


@functools.cache
def stopped_clock() -> int:
    """The address of a clock that shows when it was stopped, loaded at the first call. Without a clock, a thread within
    mj_step might call none."""
    return native_function(_stopped, []).address


class _Timers:
    """Context in which the timers of all threads stand still, and after which they go on as if they had not; several
    threads can enter it at once."""

    def __init__(self) -> None:
        self._lock, self._inside, self._before = threading.Lock(), 0, _clock.value

    def __enter__(self) -> None:
        with self._lock:
            if self._inside == 0:
                self._before = _clock.value
                clock[0] = _show(self._before)() if self._before else 0.0
                _clock.value = stopped_clock()
            self._inside += 1

    def __exit__(self, *exception: object) -> None:
        with self._lock:
            self._inside -= 1
            if self._inside == 0 and _clock.value == stopped_clock():  # otherwise somebody has set another clock
                _clock.value = self._before


timers_stopped = _Timers()
