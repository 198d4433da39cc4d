"""The record of a run besides its samples: the header, known before the first step, and the outcome."""

import enum
import functools
import hashlib
import importlib.metadata
import inspect
import itertools
import platform
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Protocol

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from ..actuation.joints import read_motion
from ..control.base import NoClosedForm, SteadyState, Udp
from ..errors import InputError, suggestion
from ..physics.frames import BODY
from ..plant.contacts import Probe
from ..plant.geometry import Geometry
from ..plant.mjcf import Mjcf
from ..quantities import STRICT, NonNegative
from ..scenario import CHOICES, Scenario, table_at
from ..stages.base import Stage
from ..stages.contract import listed_files
from ..stages.foreign import SHARED, UNIT
from ..stages.namespace import name_beside, source_files
from ..stages.signals import OF_JOINTS, Signal, no_signal
from ..stages.written import class_source

MEASURED = "measured"
"""The engine of the log of a real vehicle."""
_PACKAGES = ("uvms-mj", "mujoco", "numpy", "llvmlite", "mcap")


class Status(enum.Enum):
    """How a run ended. Logs contain these texts, so a change makes older logs unreadable."""

    completed = "the run went on to its end"
    unstable = "a variable left its bound and the run was stopped"
    interrupted = "the run was stopped from outside"
    failed = "the law or a sink failed and the run was stopped"
    truncated = "the log ends before the run did"


@dataclass(frozen=True)
class StageSource:
    """Source of a stage: name of a shipped one, or ``file.py:ClassName`` with the text of the file, or of the class if
    there is no file, and its digest; the sizes of its states by name; and the contents of the files that it imports or
    lists."""

    source: str
    sha256: str | None
    code: str = field(repr=False)
    states: Mapping[str, int]
    files: Mapping[str, bytes] = field(default_factory=dict, repr=False)

    @property
    def digests(self) -> dict[str, str]:
        """The digests of the files that it imports or lists, by name."""
        return {name: hashlib.sha256(data).hexdigest() for name, data in self.files.items()}

    @classmethod
    def of(cls, stage: Stage, counts: Mapping[str, int] | None = None) -> "StageSource":
        """The source of a stage for a vehicle with so many ``thrusters`` and ``joints``."""
        kind, source = type(stage), type(stage).source()
        record = kind.state_record((counts or {}).get(kind.room.counts, 0)).dtype
        states = {name: record[name].itemsize // 8 for name in kind.states}
        if source in CHOICES[kind.room.table].shipped:
            return cls(source, None, "", states)
        path = Path(source.rpartition(":")[0])
        code = path.read_bytes() if path.is_file() else b""
        if not code:
            try:
                code = _source_of(kind).encode()
            except (OSError, TypeError):  # defined at a prompt
                return cls(f"{path.name}:{kind.__name__}", None, "", states)
        digest = hashlib.sha256(code).hexdigest()
        code = b"" if path.suffix in (*SHARED, UNIT) else code  # of machine code a log has the digest alone
        files = {name: file.read_bytes() for name, file in listed_files(kind).items()}
        if path.suffix == ".py" and path.is_file():
            own = path.resolve()
            imported = [each for each in source_files(sys.modules[kind.__module__]) if each != own]
            files |= {name_beside(own, each): each.read_bytes() for each in imported}
        return cls(f"{path.name}:{kind.__name__}", digest, code.decode(errors="replace"), states, files)


def _source_of(kind: type[Stage]) -> str:
    """The source of a class without a file. Raises OSError or TypeError if there is none."""
    try:
        return inspect.getsource(kind)
    except (OSError, TypeError):  # inspect knows no class of a cell
        return class_source(kind)


@dataclass(frozen=True, eq=False)
class Column:
    """One component of a signal at all instants: its name, unit, signal and values (n,)."""

    name: str
    unit: str
    signal: Signal
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class Header:
    """The part of a run's record that is known before the first step.

    Attributes:
        row_steps: time steps from one row to the next.
        rest: :attr:`analytic`, or a function that gives it and is called when somebody asks.
        notes: the warnings that the user was given.
        sources: sources of the stages by their table in the scenario: reference, navigation, controller, actuation.
        versions: versions of the packages that made the run, by name.
        engine: name of the engine that stepped the run: mujoco or free_body; "measured" for the log of a real vehicle.
    """

    scenario: Scenario
    signals: tuple[Signal, ...]
    row_steps: int
    rest: SteadyState | NoClosedForm | Callable[[], SteadyState | NoClosedForm] = field(repr=False)
    notes: tuple[str, ...]
    mjcf: Mjcf
    geometry: Geometry
    sources: Mapping[str, StageSource]
    versions: Mapping[str, str]
    engine: str = "mujoco"

    @property
    def measured(self) -> bool:
        """Whether the record is the log of a real vehicle (:mod:`uvms_mj.records.measured`)."""
        return self.engine == MEASURED

    @property
    def law(self) -> StageSource:
        return self.sources["controller"]

    @functools.cached_property
    def analytic(self) -> SteadyState | NoClosedForm:
        """The predicted rest state, or the reason why there is no closed form."""
        return self.rest() if callable(self.rest) else self.rest

    def __getstate__(self) -> dict[str, Any]:
        """The fields, with the rest state solved, as copy and pickle need them."""
        return {**self.__dict__, "rest": self.analytic}

    @functools.cached_property
    def places(self) -> dict[str, slice]:
        """Slice of each signal in a row."""
        ends = itertools.accumulate(signal.size for signal in self.signals)
        return {s.name: slice(end - s.size, end) for s, end in zip(self.signals, ends, strict=True)}

    @functools.cached_property
    def by_name(self) -> dict[str, Signal]:
        return {signal.name: signal for signal in self.signals}

    def components(self, signal: Signal) -> tuple[str, ...]:
        """Names of a signal's components; the joints' if it has one number a joint."""
        return tuple(link.joint for link in self.geometry.links) if self._of_joints(signal) else signal.components

    def part(self, name: str) -> tuple[Signal, int | None]:
        """The recorded signal of a name, and the index of the component if the name has one, ``tau.x``. Raises
        InputError if there is none."""
        first, dot, component = name.partition(".")
        if first not in self.by_name:
            raise InputError(no_signal(first, self.by_name))
        signal = self.by_name[first]
        parts = self.components(signal)
        if dot and (not component or component not in parts):
            known = suggestion(component, parts) if any(parts) else "it is a single number"
            raise InputError(f"{first} has no component {component!r}; {known}")
        return signal, parts.index(component) if dot else None

    def units(self, signal: Signal) -> tuple[str, ...]:
        """Units of a signal's components; "rad or m" is rad for a hinge and m for a slide."""
        if not self._of_joints(signal) or " or " not in signal.unit:
            return signal.units
        hinge, slide = signal.unit.split(" or ")
        return tuple(slide if link.slide else hinge for link in self.geometry.links)

    def columns(self, arrays: Mapping[str, np.ndarray]) -> Iterator[Column]:
        """Samples (n, ...) component by component: ``t``, ``p_WB.x``, ``p_WB.y``, ..."""
        for signal in self.signals:
            values = arrays[signal.name].reshape(-1, signal.size)
            for i, (component, unit) in enumerate(zip(self.components(signal), self.units(signal), strict=True)):
                yield Column(f"{signal.name}.{component}" if component else signal.name, unit, signal, values[:, i])

    def _of_joints(self, signal: Signal) -> bool:
        return signal.name in OF_JOINTS and signal.size == len(self.geometry.links)

    @property
    def task_frame(self) -> tuple[str, str, str]:
        """Names of the position, the attitude and the velocity of the frame of the task, B or the tool."""
        at_tool = "p_WT" in self.by_name and self.scenario.task.frame != BODY
        return ("p_WT", "quat_WT", "nu_T") if at_tool else ("p_WB", "quat_WB", "nu")

    @property
    def probe_radius(self) -> float:
        """Distance from the origin of the frame of the task to the wall's face at the beginning of contact [m]."""
        if self.scenario.task.frame == BODY:
            return self.geometry.reach
        return Probe.of(self.scenario.task.frame, self.mjcf).radius

    @property
    def width(self) -> int:
        """Numbers in a row."""
        return sum(signal.size for signal in self.signals)

    def portable_scenario(self) -> dict[str, Any]:
        """The scenario's tables with file names without folders, and without the host of another machine; the
        log contains the files. The numbers of ``joints.motion_file`` stand in ``joints.motion``."""
        tables = self.scenario.to_dict()
        if Path(tables["vehicle"]["model"]).name != tables["vehicle"]["model"]:
            tables["vehicle"]["model"] = self.mjcf.name
        for name, stage in self.sources.items():
            table_at(tables, name)["name"] = stage.source
        if (motion := tables["joints"].pop("motion_file", None)) is not None:
            times, values = read_motion(motion, self.mjcf.vehicle.arm.joints)
            rows = zip(times.tolist(), values.tolist(), strict=True)
            tables["joints"]["motion"] = [{"time": time, "joints": joints} for time, joints in rows]
        if "host" in tables["controller"] and self.law.sha256 is None:
            tables["controller"]["host"] = Udp.host  # no log says where this machine sends
        return tables


_Number = bool | int | float
Values = dict[str, _Number | list[_Number | list[_Number]]]
"""Numbers of a scenario by dotted key. No text is among them: a name of a stage or of a file would be loaded."""
LIVE_NOTE = "numbers of the scenario could be changed from outside while the run went on"
"""Note of a run with guides."""


@checked(frozen=True, config=STRICT)
class Outcome:
    """How a run ended: the status, truncated if the log lacks it; the reason why it stopped before its end; the number
    of time steps done; the wall time of the stepping [s]; and the changes of the scenario that were made in the run,
    each with the number of steps that were done before it."""

    status: Status
    message: str
    steps: Annotated[int, Field(ge=0)]
    wall_time_s: NonNegative
    changes: tuple[tuple[Annotated[int, Field(ge=0)], Values], ...] = ()


class Sink(Protocol):
    """Receiver of a run's samples during the run."""

    def begin(self, header: Header) -> None:
        """Called before the first step, after the input was checked."""

    def write(self, rows: np.ndarray) -> None:
        """Called with the next rows (n, width), a few milliseconds of wall time."""

    def end(self, outcome: Outcome) -> None:
        """Called after the last row, however the run ended."""


def code_file(table: str, source: str) -> str:
    """Name of a log's attachment with the code of the stage of a table."""
    return f"{'law' if table == 'controller' else table}/{source.rpartition(':')[0]}"


def sources_of(scenario: Scenario, counts: Mapping[str, int]) -> dict[str, StageSource]:
    """The sources of a scenario's stages by table, for a vehicle with so many ``thrusters`` and ``joints``."""
    return {name: StageSource.of(stage, counts) for name, stage in scenario.named_stages.items()}


@functools.cache
def versions() -> dict[str, str]:
    """Versions of the packages that affect a run's numbers and of Python, and the machine's system and architecture."""
    found = {name: importlib.metadata.version(name) for name in _PACKAGES}
    return found | {"python": platform.python_version(), "machine": f"{platform.system()} {platform.machine()}"}
