"""One stage of the loop with its records and its machine code."""

import functools
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...stages.base import Stage, is_shipped, packs_itself
from ...stages.signals import Signal, record_dtype
from .arena import MARGIN, NEARBY, Arena
from .compilation import NotCompiled
from .plain_stage import PlainStage, StageFault
from .reasons import in_users_words
from .stage_code import RAISED, compile_stage

SEARCH_S = 0.25
"""Wall time from one search of a stage's margins to the next [s]. A search takes a few milliseconds."""


class Entry:
    """One stage of the loop with its records (1,). ``given`` and ``out``, a record or an array, are in the loop's
    memory; ``states`` is how many numbers of ``state`` advance."""

    def __init__(
        self, stage: Stage, settings: np.ndarray, state: np.ndarray, given: np.ndarray, out: np.ndarray, states: int
    ) -> None:
        self.stage, self.settings, self.state = stage, settings, state
        self.given, self.out, self.states = given, out, states
        needs = type(stage).needs
        self.needs = () if needs is None and not packs_itself(type(stage)) else needs
        self.shapes = {name: settings.dtype[name].shape for name in settings.dtype.names or () if name != "_"}
        self.state_dot = np.zeros_like(state)
        self.constants: dict[str, Any] = {}
        self.guarded, self._searched = not is_shipped(stage), time.monotonic()
        self._out_kind = out.dtype if out.dtype.names else np.dtype(("f8", out.shape))
        self.code, self.not_compiled = None, ""
        try:
            kinds = settings.dtype, state.dtype, given.dtype, self._out_kind
            self.code = compile_stage(type(stage).function(), *kinds, guarded=self.guarded)
        except NotCompiled as reason:
            arguments = (settings.dtype, state.dtype, given.dtype, state.dtype, self._out_kind)
            self.not_compiled = in_users_words(str(reason), type(stage).function(), arguments)

    def new(self, constants: Mapping[str, Any]) -> dict[str, Any]:
        """The constants that may differ from those in memory."""
        old = self.constants
        return {name: value for name, value in constants.items() if value is not old.get(name) or _mutable(value)}

    @functools.cached_property
    def arena(self) -> Arena:
        return Arena(self.stage.room, self.settings, self.state, self.given.dtype, self._out_kind)

    @functools.cached_property
    def _plain(self) -> PlainStage:
        return PlainStage(self.stage, self.arena)

    def fill(self, row: np.void) -> None:
        """Set the addresses of a STAGE record."""
        row["code_at"] = self.code.address if self.code is not None else 0
        row["settings_at"] = self.arena.address if self.guarded else self.settings.ctypes.data
        row["state_at"], row["state_dot_at"] = self.state.ctypes.data, self.state_dot.ctypes.data
        row["given_at"], row["out_at"], row["states"] = self.given.ctypes.data, self.out.ctypes.data, self.states

    def call_plain(self) -> None:
        """Run the stage as plain Python. Raises StageFault if the stage raised or violated its contract."""
        self.arena.fill(self.given, self.state)
        self._plain()
        self.arena.take(self.state, self.state_dot, self.out)

    def check(self, everything: bool) -> None:
        """Search the arena's margins, all of them from time to time or if ``everything`` is true. Raises StageFault if
        the stage wrote beyond one of its arrays."""
        now = time.monotonic()
        everything = everything or now - self._searched > SEARCH_S
        if everything:
            self._searched = now
        fault = self.arena.overrun(MARGIN if everything else NEARBY)
        if fault:
            raise self._plain.fault(fault)

    def explain(self, code: int) -> StageFault:
        """The exception for a compiled stage that stopped the run with this return code."""
        fault = self.arena.fault() if code != RAISED else ""
        self.arena.reset()
        self.arena.fill(self.given, self.state)
        return self._plain.explain(fault)

    @property
    def slow(self) -> str:
        """A note on a stage that runs as plain Python; empty for a compiled one."""
        if self.code is not None:
            return ""
        slow = "runs as plain Python, which is slow, because numba can't compile it"
        hint = "; mark the called function with numba.njit" if "<class 'function'>" in str(self.not_compiled) else ""
        return f"{self.stage.label()} {slow}: {self.not_compiled}{hint}"


def _mutable(value: Any) -> bool:
    return value.flags.writeable if isinstance(value, np.ndarray) else not isinstance(value, _CONSTANT)


_CONSTANT = (float, int, tuple)  # a union is made anew at each use


def part(record: np.ndarray, signals: tuple[Signal, ...]) -> np.ndarray:
    """Consecutive fields of a record (1,) as a record of their own (1,), in the same memory."""
    offset = record.dtype.fields[signals[0].name][1]  # type: ignore[index]  # records have fields
    return np.ndarray(1, record_dtype(signals), record.view(np.uint8), offset)
