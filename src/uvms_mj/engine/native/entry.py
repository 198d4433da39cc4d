"""One stage of the loop with its records and its machine code."""

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...compiler.codes import CONVERSION, DIVISION, INDEX, RAISED, STOPPED, place
from ...errors import InputError
from ...stages.base import Stage, has_own_constants, is_shipped
from ...stages.signals import Signal, record_dtype
from .compilation import NativeFunction, NotCompiled, native_function, plain_python
from .own_memory import OwnMemory
from .plain_stage import PlainStage, StageFault, called
from .user_stage import compile_user_stage, is_check


class Entry:
    """One stage of the loop with its records (1,). ``given`` and ``out``, a record or an array, are in the loop's
    memory; ``states`` is how many numbers of ``state`` advance."""

    def __init__(
        self, stage: Stage, settings: np.ndarray, state: np.ndarray, given: np.ndarray, out: np.ndarray, states: int
    ) -> None:
        self.stage, self.settings, self.state = stage, settings, state
        self.given, self.out, self.states = given, out, states
        needs = type(stage).needs
        self.needs = () if needs is None and not has_own_constants(type(stage)) else needs
        self.shapes = {name: settings.dtype[name].shape for name in settings.dtype.names or () if name != "_"}
        self.state_dot = np.zeros_like(state)
        self.constants: dict[str, Any] = {}
        self.users = not is_shipped(stage)
        self._out_kind = out.dtype if out.dtype.names else np.dtype(("f8", out.shape))
        self.code, self.not_compiled = None, ""
        try:
            self.code = self._compiled()
        except NotCompiled as reason:
            self.not_compiled = str(reason)

    def _compiled(self) -> NativeFunction:
        """The machine code. Raises InputError if the stage is wrong, and NotCompiled if the language lacks what it
        uses."""
        function = type(self.stage).function()
        kinds = self.settings.dtype, self.state.dtype, self.given.dtype, self._out_kind
        if not self.users:
            if plain_python():
                raise NotCompiled("all of it does")
            return native_function(function, [*kinds[:3], kinds[1], kinds[3]])
        from ...compiler.refusals import Mistake

        try:
            return compile_user_stage(function, self.stage.room, kinds)
        except Mistake as mistake:
            where = f"{Path(mistake.file).name}, line {mistake.line}"
            said = f"{called(self.stage)} is wrong in {where}: {mistake.words}: {mistake.reason}"
            raise InputError(said) from mistake

    def new(self, constants: Mapping[str, Any]) -> dict[str, Any]:
        """The constants that may differ from those in memory."""
        old = self.constants
        return {name: value for name, value in constants.items() if value is not old.get(name) or _mutable(value)}

    @functools.cached_property
    def own(self) -> OwnMemory:
        return OwnMemory(self.stage.room, self.settings, self.state, self.given.dtype, self._out_kind)

    @functools.cached_property
    def _plain(self) -> PlainStage:
        return PlainStage(self.stage, self.own)

    def fill(self, row: np.void) -> None:
        """Set the addresses of a STAGE record."""
        row["code_at"] = self.code.address if self.code is not None else 0
        row["settings_at"] = self.own.address if self.users else self.settings.ctypes.data
        row["state_at"], row["state_dot_at"] = self.state.ctypes.data, self.state_dot.ctypes.data
        row["given_at"], row["out_at"], row["states"] = self.given.ctypes.data, self.out.ctypes.data, self.states

    def call_plain(self) -> None:
        """Run the stage as plain Python. Raises StageFault if the stage raised or violated its contract."""
        self.own.fill(self.given, self.state)
        self._plain()
        self.own.take(self.state, self.state_dot, self.out)

    def explain(self, code: int) -> StageFault:
        """The exception for a compiled stage that stopped the run with this return code."""
        assert self.code is not None
        why, file, line = place(code, self.code.files)
        fault = self.own.wrong() if is_check(file) else ""
        self.own.clear()
        self.own.fill(self.given, self.state)
        return self._plain.explain(fault, "" if is_check(file) else f"{Path(file).name}, line {line}: {WHY[why]}")

    @property
    def slow(self) -> str:
        """A note on a stage that runs as plain Python; empty for a compiled one."""
        if self.code is not None:
            return ""
        return f"{self.stage.label()} runs as plain Python, which is slow: {self.not_compiled}"


WHY = {
    INDEX: "an index is out of bounds",
    DIVISION: "an integer is divided by zero",
    CONVERSION: "a number that is not finite, or too large, can't become an integer",
    RAISED: "it raises",
    STOPPED: "it was interrupted",
}
"""Why a compiled stage ended early."""


def _mutable(value: Any) -> bool:
    return value.flags.writeable if isinstance(value, np.ndarray) else not isinstance(value, _CONSTANT)


_CONSTANT = (float, int, tuple)  # a union is made anew at each use


def part(record: np.ndarray, signals: tuple[Signal, ...]) -> np.ndarray:
    """Consecutive fields of a record (1,) as a record of their own (1,), in the same memory."""
    offset = record.dtype.fields[signals[0].name][1]  # type: ignore[index]  # records have fields
    return np.ndarray(1, record_dtype(signals), record.view(np.uint8), offset)
