"""What is recorded of a run besides its samples: what was known before the first step, and how it ended."""

import enum
import functools
import hashlib
import importlib.metadata
import inspect
import itertools
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from .closed_forms import NoClosedForm, SteadyState
from .control import Controller
from .control.loader import BUILT_IN
from .geometry import Geometry
from .mjcf import Mjcf
from .scenario import Scenario
from .signals import Signal

_PACKAGES = ("uvms-mj", "mujoco", "numpy", "numba", "llvmlite", "mcap")


class Status(enum.Enum):
    """How a run ended."""

    completed = "the run went on to its end"
    unstable = "a variable left its bound and the run was stopped"
    interrupted = "the run was stopped from outside"
    failed = "the law or a sink failed and the run was stopped"
    truncated = "the log ends before the run did"


@dataclass(frozen=True)
class Law:
    """Where a law came from.

    Attributes:
        source: name of one that ships, or ``file.py:ClassName``.
        sha256: of its file, or None where there is none.
        code: text of its file; empty for a law that ships.
        states: names and sizes.
    """

    source: str
    sha256: str | None
    code: str = field(repr=False)
    states: Mapping[str, int]

    @classmethod
    def of(cls, controller: Controller) -> "Law":
        law, source = type(controller), type(controller).source()
        states = dict(law.states)
        if source in BUILT_IN:
            return cls(source, None, "", states)
        path = Path(source.rpartition(":")[0])
        code = path.read_bytes() if path.is_file() else b""
        if not code:
            try:
                code = inspect.getsource(law).encode()
            except (OSError, TypeError):  # defined at a prompt
                return cls(f"{path.name}:{law.__name__}", None, "", states)
        digest = hashlib.sha256(code).hexdigest()
        return cls(f"{path.name}:{law.__name__}", digest, code.decode(errors="replace"), states)


@dataclass(frozen=True, eq=False)
class Header:
    """What is known before the first step.

    Attributes:
        scenario: with every default written out.
        signals: what a row consists of, side by side.
        row_steps: time steps from one row to the next.
        analytic: where the run should come to rest, or why no closed form tells.
        notes: what the user was warned of.
        mjcf: the vehicle's model.
        geometry: what the vehicle looks like.
        law: where the law came from.
        versions: of the packages that made the run, by name.
    """

    scenario: Scenario
    signals: tuple[Signal, ...]
    row_steps: int
    analytic: SteadyState | NoClosedForm
    notes: tuple[str, ...]
    mjcf: Mjcf
    geometry: Geometry
    law: Law
    versions: Mapping[str, str]

    @functools.cached_property
    def places(self) -> dict[str, slice]:
        """Where each signal stands in a row."""
        ends = itertools.accumulate(signal.size for signal in self.signals)
        return {s.name: slice(end - s.size, end) for s, end in zip(self.signals, ends, strict=True)}

    @property
    def width(self) -> int:
        """Numbers in a row."""
        return sum(signal.size for signal in self.signals)

    def portable_scenario(self) -> dict[str, Any]:
        """The scenario's tables without a user's folders: the files' names alone, for the files are in the log."""
        tables = self.scenario.to_dict()
        if Path(tables["vehicle"]["model"]).name != tables["vehicle"]["model"]:
            tables["vehicle"]["model"] = self.mjcf.name
        tables["controller"]["name"] = self.law.source
        return tables

    def step_of_row(self, row: int) -> int:
        """The time step that a row belongs to; the last row of a run is the state at its end."""
        return min(row * self.row_steps, self.scenario.steps)


@dataclass(frozen=True)
class Outcome:
    """How a run ended.

    Attributes:
        status: completed, unstable, interrupted or failed; truncated, where a log doesn't say.
        message: why a run that did not complete stopped.
        steps: time steps that were done.
        wall_time_s: how long the stepping took [s].
    """

    status: Status
    message: str
    steps: int
    wall_time_s: float


class Sink(Protocol):
    """Where the samples of a run go while it goes on."""

    def begin(self, header: Header) -> None:
        """Before the first step; what can't run has been refused already."""

    def write(self, rows: np.ndarray) -> None:
        """Rows (n, width) in order, some milliseconds' worth; they are not kept."""

    def end(self, outcome: Outcome) -> None:
        """After the last row, however the run ended."""


def versions() -> dict[str, str]:
    """Versions of what decides a run's bits, and the machine's architecture."""
    found = {name: importlib.metadata.version(name) for name in _PACKAGES}
    return found | {"python": platform.python_version(), "machine": f"{platform.system()} {platform.machine()}"}
