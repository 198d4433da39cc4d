"""The net: some instants of a user's compiled stage are computed by plain Python, too, and both must have equal bits.

Machine code and its twin in plain Python (:mod:`.twin`) get the same numbers, each in memory of its
own. If one number differs, the stage goes on as plain Python, with Python's number. In the first run of a stage in a
process the first instants are all compared, so that all that came before a difference is right. Further instants are
chosen at growing distances, by the seed. The comparisons of a stage take :data:`START_S` at its start, and then
:data:`SHARE` of the time; results do not depend on which instants they are.
"""

import os
import random
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .memory import OwnMemory, layout
from .plain_stage import PlainStage, StageFault
from .twin import twin

SWITCH = "UVMS_MJ_NET"
"""Environment variable: 0 turns the net off."""
FIRST = 50
"""Instants that are all compared at the start of a stage's first run."""
START_S, SHARE = 0.010, 0.01
"""Processor's time of comparisons: at the start [s], and as a share of the process's time since."""


class NetWarning(UserWarning):
    """A stage's machine code differs from plain Python."""


@dataclass
class Account:
    """The knowledge of a stage's machine code in this process, in all its runs.

    Attributes:
        instants, spent: compared so far, and the time that it took [s].
        since: when the first one was compared [s].
        differs: the difference that was found; such a stage runs as plain Python.
    """

    instants: int = 0
    spent: float = 0.0
    since: float = field(default_factory=time.process_time)
    differs: str = ""

    @property
    def is_new(self) -> bool:
        """Whether the first instants are being compared."""
        return self.instants < FIRST and self.spent < START_S

    @property
    def has_time(self) -> bool:
        return self.spent < START_S + SHARE * (time.process_time() - self.since)


_accounts: dict[str, Account] = {}


def account(machine_code: str) -> Account:
    """The account of machine code, by its name."""
    return _accounts.setdefault(machine_code, Account())


def wanted() -> bool:
    """Whether the net is on."""
    return os.environ.get(SWITCH, "1") not in ("", "0")


class Watch:
    """One compiled stage of a run, and its twin.

    Args:
        stage: a bound :class:`.pipeline.CompiledStage` of the user's, in Python.
        index: its number among the stages of the run.
    """

    def __init__(self, stage: Any, index: int) -> None:
        self.stage, self.index, self.account = stage, index, account(stage.code.name)
        self._memory = np.zeros(1, layout(*stage.kinds))
        self._own = OwnMemory(stage.stage.room, self._memory, stage.settings)
        self._plain = PlainStage(stage.stage, self._own)
        given, out = stage.given, stage.out
        own_fields = [each for each in given.dtype.names or () if not np.may_share_memory(given[each], out)]
        self._only_read = {"settings": stage.settings.dtype.names or (), "given": own_fields}
        self._twin: Any = None
        self._fault: StageFault | None = None

    def begin(self, key: int) -> None:
        """Choose the next instant, at the start of a run."""
        self._random = random.Random(key)
        self.in_first_run = self.account.instants < FIRST  # and every instant so far was compared
        self.next = 0 if self.in_first_run else int(10.0 ** self._random.uniform(0.0, 4.0)) - 1

    def steps_ahead(self, step: int, row: np.void) -> int:
        """The number of time steps to the next comparison, 0 if the stage is to be compared at the step in hand."""
        every, ahead = int(row["period_steps"]), max(0, self.next - int(row["instant"]))
        if ahead == 0 and not self.account.has_time:
            self._choose(int(row["instant"]))
            ahead = self.next - int(row["instant"])
        return -step % every + ahead * every

    def _choose(self, instant: int) -> None:
        """Choose the instant that is compared after this one."""
        near = instant + 1 < FIRST and self.account.has_time
        self.in_first_run = self.in_first_run and near
        self.next = instant + 1 if near else 2 * instant + FIRST + self._random.randrange(FIRST)

    def compare(self, instant: int) -> tuple[int, str]:
        """Call machine code and the twin. Returns what the machine code returned, and the difference, empty if there is
        none. Raises KeyboardInterrupt."""
        begun, stage, own = time.thread_time(), self.stage, self._own
        own.take_settings(stage.settings)
        own.fill(stage.given, stage.state)
        own.take_over(stage.own)  # the values that the stage has set before
        own.arrays["state_dot"][:] = stage.state_dot
        code, fault = stage.code.ctypes(*stage.words), self._call()
        self._choose(instant)
        self.account.instants += 1
        difference = ""
        if code and not fault:
            difference = f"machine code ended early ({stage.place_of(code)}), and Python does not"
        elif fault and not code:
            difference = f"Python says: {fault}"
        elif not code:
            difference = self._difference()
        self.account.spent += time.thread_time() - begun
        return code, difference

    def _call(self) -> str:
        """Call the twin. Returns what it raised, or did wrong; empty if nothing."""
        if self._twin is None:
            function: Any = type(self.stage.stage).function()
            self._twin = twin(getattr(function, "py_func", function))
        with np.errstate(all="ignore"):
            self._fault = self._plain.fault_of(self._twin)
        return str(self._fault or "")

    def _difference(self) -> str:
        """The first number that differs, as a sentence; 0.0 and -0.0 are equal, and all NaNs."""
        stage, own = self.stage, self._own
        for name in ("state", "state_dot", "out"):
            called = own.names[name]
            mine, pythons = np.asarray(getattr(stage, name)), own.arrays[name]
            if mine.tobytes() == pythons.tobytes():
                continue
            for label in pythons.dtype.names or ("",):
                a, b = (np.ravel(each[label] if label else each) for each in (mine, pythons))
                unequal = (a != b) & ~((a != a) & (b != b))
                if unequal.any():
                    k = int(unequal.argmax())
                    where = f"{called}{'.' if label else ''}{label}[{k}]"
                    return f"{where} is {a[k].item()!r} as machine code, and {b[k].item()!r} as Python"
        for name, mine in (("settings", stage.own.arrays["settings"]), ("given", stage.given)):
            for label in self._only_read[name]:  # in Python, a store there raises
                if mine[label].tobytes() != own.arrays[name][label].tobytes():
                    return f"{own.names[name]}.{label} is changed by machine code, and not by Python"
        return ""

    def give(self) -> None:
        """Let the run have Python's numbers of the instant that was compared last. Raises StageFault if Python did
        wrong."""
        stage = self.stage
        if self._fault is not None:
            raise self._fault
        self._own.take(stage.state, stage.state_dot, stage.out)
        stage.own.take_settings(stage.settings)
        for label in self._only_read["given"]:
            stage.given[label] = self._own.arrays["given"][label]
        stage.own.take_over(self._own)


class Net:
    """The stages of a run that are compared.

    Attributes:
        watches: by the numbers of their stages.
    """

    def __init__(self, stages: Sequence[Any], rows: np.ndarray) -> None:
        self._stages, self._rows = stages, rows
        self.watches: dict[int, Watch] = {}

    def begin(self) -> None:
        """At the start of a run."""
        users = [(i, stage) for i, stage in enumerate(self._stages) if stage.compared]
        users = users if users and wanted() else []
        self.watches = {i: self.watches.get(i) or Watch(stage, i) for i, stage in users}
        for watch in self.watches.values():
            watch.begin(int(self._rows["key"][watch.index]))

    def steps_ahead(self, step: int) -> int:
        """The number of time steps to the next comparison; 0 if there is one at the step in hand."""
        return min((w.steps_ahead(step, self._rows[w.index]) for w in self.watches.values()), default=1 << 62)

    def hold(self, step: int) -> list[Watch]:
        """Let the stages that are to be compared at the step in hand wait for Python."""
        held = [watch for watch in self.watches.values() if watch.steps_ahead(step, self._rows[watch.index]) == 0]
        for watch in held:
            self._rows["code_at"][watch.index] = 0
        return held

    def release(self, held: Sequence[Watch]) -> None:
        """Let the stages that were held be called as machine code."""
        for watch in held:
            if watch.stage.code is not None:
                self._rows["code_at"][watch.index] = watch.stage.code.address
