"""What a run leaves: named read-only arrays, how it ended, and what it was."""

import enum
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .closed_forms import NoClosedForm, SteadyState
from .scenario import Scenario
from .signals import Signal


class Status(enum.Enum):
    """How a run ended."""

    completed = "the run went on to its end"
    unstable = "a variable left its bound and the run was stopped"
    interrupted = "the run was stopped from outside"


@dataclass(frozen=True, eq=False)
class Trace:
    """The samples of a run: ``trace.s``, ``trace["f_contact_W"]``, each an array (n, ...) that can't be written to.

    Row k of every signal belongs to the same instant ``trace.t[k]``. :mod:`uvms_mj.signals` says what each is.
    """

    scenario: Scenario
    signals: tuple[Signal, ...]
    arrays: Mapping[str, np.ndarray] = field(repr=False)
    status: Status
    message: str
    """Why a run that did not complete stopped."""
    steps: int
    """Number of time steps that were done."""
    wall_time_s: float
    """How long the stepping took [s]."""
    analytic: SteadyState | NoClosedForm
    """Where the run should come to rest, from scenario and gains alone, or why no closed form tells."""
    notes: tuple[str, ...] = ()
    """What the user was warned of."""

    def __getattr__(self, name: str) -> np.ndarray:
        try:
            return self.__dict__["arrays"][name]
        except KeyError:
            known = ", ".join(self.__dict__.get("arrays", ()))
            raise AttributeError(f"no signal {name!r}; this trace has {known}") from None

    def __getitem__(self, name: str) -> np.ndarray:
        return self.arrays[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.arrays)

    def __len__(self) -> int:
        return len(self.arrays["t"])

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.arrays]

    @property
    def duration_s(self) -> float:
        """Simulated time [s]."""
        return self.steps * self.scenario.simulation.timestep

    @property
    def push(self) -> np.ndarray:
        """(n,) force with which the vehicle pushes on the wall [N], zero or positive."""
        return np.maximum(0.0, 0.0 - self.arrays["f_contact_W"][:, 0])

    def save(self, path: Path) -> None:
        """Write every signal under its name to a NumPy ``.npz`` file, which is there only once it is whole."""
        part = path.with_name(f"{path.name}.part")
        with open(part, "wb") as file:
            np.savez(file, allow_pickle=False, **self.arrays)
        os.replace(part, path)
