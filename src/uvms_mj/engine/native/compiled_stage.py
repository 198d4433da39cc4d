"""One stage of the loop with its records and its machine code."""

import functools
from pathlib import Path

import numpy as np

from ...compiler.codes import CONVERSION, DIVISION, INDEX, RAISED, STOPPED, place
from ...errors import InputError
from ...stages.base import Stage, is_shipped
from .compilation import PLAIN, NativeFunction, NotCompiled, native_function, plain_python
from .memory import at_address
from .own_memory import OwnMemory, layout
from .plain_stage import PlainStage, StageFault, called
from .record import Field, Image
from .user_stage import compile_user_stage, is_check


class CompiledStage:
    """One stage of the loop with its records (1,). What it is given, and its output where it is no array, are parts of
    the record of the run; settings, states and memory are behind it (:attr:`layout`).

    Args:
        stage, settings: the stage, and its constants as a record (1,).
        state: its states at the start as a record (1,), or None for a stage that works on the whole record of the run.
        given, out: parts of the record of the run.
        states: how many numbers of ``state`` advance.
        run: the dtype of the record of the run, as kernels have it.
        fused: whether sums of products may be rounded once.
    """

    def __init__(
        self, stage: Stage, settings: np.ndarray, state: np.ndarray | None, given: Field, out: Field, states: int,
        run: np.dtype, fused: bool,
    ) -> None:  # fmt: skip
        self.stage, self._given, self._out, self.states = stage, given, out, states
        self._start = {"settings": settings} | ({} if state is None else {"state": state})
        self.shapes = {name: settings.dtype[name].shape for name in settings.dtype.names or () if name != "_"}
        self.users = not is_shipped(stage)
        self._fused = fused
        self.kinds = settings.dtype, run if state is None else state.dtype, given.dtype, out.dtype
        self.code, self.not_compiled = None, ""
        try:
            self.code = self._compiled()
        except NotCompiled as reason:
            self.not_compiled = str(reason)
        self.apart = self.users or self.code is None

    @property
    def layout(self) -> np.dtype:
        """The records of the stage behind the record of the run."""
        own = [(name, each.dtype) for name, each in self._start.items()]
        own += [("state_dot", self._start["state"].dtype)] if "state" in self._start else []
        own += [("own", layout(*self.kinds))] if self.apart and "state" in self._start else []
        return np.dtype(own, align=True)

    def bind(self, image: Image, record: np.ndarray) -> None:
        """Take the memory of a run: an image, and the stage's record (1,) of :attr:`layout` in it."""
        for name, start in self._start.items():
            record[name] = start
        self.settings, self.given, self.out = record["settings"], image.view(self._given), image.view(self._out)
        self.state = record["state"] if "state" in self._start else image.record("run")
        self.state_dot = record["state_dot"] if "state" in self._start else self.state
        arguments = ("settings", "state", "given", "state_dot", "out")
        self.places = {name: image.place(getattr(self, name)) for name in arguments}
        self.own = None
        if "own" in (record.dtype.names or ()):
            self.own = OwnMemory(self.stage.room, record["own"], self.settings)
            if self.users:
                self.places["settings"] = image.place(record["own"])

    def _compiled(self) -> NativeFunction:
        """The machine code. Raises InputError if the stage is wrong, and NotCompiled if the language lacks what it
        uses."""
        function = type(self.stage).function()
        kinds = self.kinds
        if not self.users:
            if plain_python():
                raise NotCompiled(f"{PLAIN} is set")
            return native_function(function, [*kinds[:3], kinds[1], kinds[3]], self._fused)
        from ...compiler.refusals import Mistake

        try:
            return compile_user_stage(function, self.stage.room, kinds)
        except Mistake as mistake:
            where = f"{Path(mistake.file).name}, line {mistake.line}"
            said = f"{called(self.stage)} is wrong in {where}: {mistake.words}: {mistake.reason}"
            raise InputError(said) from mistake

    @functools.cached_property
    def _plain(self) -> PlainStage:
        assert self.own is not None
        return PlainStage(self.stage, self.own)

    def fill(self, row: np.void) -> None:
        """Set the code and the places of a STAGE record."""
        row["code_at"] = self.code.address if self.code is not None else 0
        row["states"] = self.states
        for name, its_place in self.places.items():
            row[name] = its_place

    def call_plain(self) -> None:
        """Run the stage as plain Python. Raises StageFault if the stage raised or violated its contract."""
        if self.own is None:
            self._on_the_run()
            return
        self.own.fill(self.given, self.state)
        self._plain()
        self.own.take(self.state, self.state_dot, self.out)

    def _on_the_run(self) -> None:
        """Run a shipped stage that works on the whole record of the run as plain Python."""
        places = (self.settings, self.state, self.given, self.state_dot, self.out)
        kinds = (*self.kinds[:3], self.kinds[1], self.kinds[3])
        words = (int(each.ctypes.data) for each in places)
        type(self.stage).function()(*(at_address(word, kind) for word, kind in zip(words, kinds, strict=True)))

    def explain(self, code: int) -> StageFault:
        """The exception for a compiled stage that stopped the run with this return code."""
        assert self.code is not None
        why, file, line = place(code, self.code.files)
        assert self.own is not None
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
