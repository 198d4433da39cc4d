"""The trace of a run: its samples as named read-only arrays, its header and its outcome."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import display
from ..control.base import NoClosedForm, SteadyState
from ..errors import InputError
from ..scenario import Scenario
from ..stages.signals import BAND, Signal, no_signal
from .header import Column, Header, Outcome, Status

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class UnknownSignal(InputError, KeyError):
    """A trace has no signal of that name."""

    def __str__(self) -> str:
        return str(self.args[0])  # without the quotes that KeyError puts around a key


class MissingSignal(InputError, AttributeError):
    """A trace has no attribute of that name; a log of a real vehicle has the signals that were measured."""


class Columns(Mapping[str, np.ndarray]):
    """The signals of blocks of rows (n, width), one after the other. Each becomes an array when it is read first: few
    are, of the many of a run."""

    def __init__(self, header: Header, blocks: Sequence[np.ndarray]) -> None:
        self.header, self.blocks, self.made = header, blocks or [np.zeros((0, header.width))], dict[str, np.ndarray]()

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.made:
            place, shape = self.header.places[name], self.header.by_name[name].shape
            array = np.concatenate([block[:, place] for block in self.blocks])
            array.setflags(write=False)
            self.made[name] = array.reshape(len(array), *shape)
        return self.made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.header.places)

    def __len__(self) -> int:
        return len(self.header.places)


@dataclass(frozen=True, eq=False)
class Trace:
    """The samples of a run: ``trace.s``, ``trace["f_contact_W"]``, each a read-only array (n, ...).

    Row k of every signal belongs to the same instant ``trace.t[k]``. ``trace.signals`` is a tuple with the shape, unit,
    frame and meaning of each signal. A trace from memory and one from a log are the same. ``trace.header`` has the
    facts known before the first step: scenario, signals by name, model, geometry, versions and more.
    """

    header: Header = field(repr=False)
    arrays: Mapping[str, np.ndarray] = field(repr=False)
    outcome: Outcome

    @classmethod
    def of(cls, header: Header, rows: np.ndarray, outcome: Outcome) -> "Trace":
        """A trace of rows (n, width)."""
        return cls(header, Columns(header, [rows]), outcome)

    @classmethod
    def load(cls, path: str | os.PathLike) -> "Trace":
        """Load the trace of a log, ``run.mcap``, or of a real vehicle's log, by a table in TOML
        (:mod:`uvms_mj.records.measured`).

        A log that was cut off gives the rows that it has. The status is then ``truncated``, and the message names the
        missing part.

        Raises:
            InputError: the file can't be read, is not a log of this project, or is damaged.
        """
        if Path(path).suffix.lower() == ".toml":
            from .measured import load

            return cls.of(*load(path))
        from .mcap import read  # most runs read no log

        header, rows, outcome, _ = read(path)
        return cls.of(header, rows, outcome)

    def save(self, path: str | os.PathLike) -> None:
        """Write the trace as a log.

        Raises:
            FileExistsError: the file exists.
            InputError: the trace lacks the beginning of its run, which a log must have.
        """
        if self.header.measured:
            raise InputError(f"{os.fspath(path)}: the trace is of a real vehicle's log, which is no run; export it")
        if len(self) and self.t[0] > 0.0:
            raise InputError(
                f"{os.fspath(path)}: the trace begins at {self.t[0]:g} s because of keep_s, but a log must "
                "begin at 0 s; give simulate sinks=[McapLog(...)] to write the whole run"
            )
        from .mcap import McapLog

        log = McapLog(path)
        log.begin(self.header)
        log.write(self.rows())
        log.end(self.outcome)

    def to_dataframe(self) -> "pd.DataFrame":
        """The samples as a pandas DataFrame: one row for each instant, one column for each component.

        The column of a component is ``name.component``, as in ``p_WB.x``; ``attrs["units"]`` and ``attrs["frames"]``
        give the unit and frame of each column.
        """
        import pandas as pd

        columns = list(self.columns())
        frame = pd.DataFrame({column.name: column.values for column in columns})
        units = {column.name: column.unit for column in columns}
        frames = {column.name: column.signal.frame for column in columns}
        frame.attrs = {"units": units, "frames": frames, "scenario": self.scenario.name}
        return frame

    def columns(self) -> Iterator[Column]:
        """The samples component by component: ``t``, ``p_WB.x``, ``p_WB.y``, ..."""
        return self.header.columns(self.arrays)

    def rows(self) -> np.ndarray:
        """The samples side by side (n, width), as :meth:`of` takes them."""
        return np.concatenate([self[s.name].reshape(len(self), s.size) for s in self.signals], axis=1)

    def __reduce__(self) -> tuple[Any, ...]:
        """Function and arguments that rebuild the trace, as copy and pickle need them."""
        return Trace.of, (self.header, self.rows(), self.outcome)

    def __getattr__(self, name: str) -> np.ndarray:
        try:
            return self.__dict__["arrays"][name]
        except KeyError:
            raise MissingSignal(no_signal(name, {*self.__dict__.get("arrays", {}), "push"})) from None

    def __getitem__(self, name: str) -> np.ndarray:
        try:
            return self.arrays[name]
        except KeyError:
            raise UnknownSignal(no_signal(name, self.arrays)) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.arrays)

    def __len__(self) -> int:
        return len(self.arrays["t"])

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.arrays]

    def plot(
        self,
        what: str | Sequence[str] = "summary",
        *,
        width: str | float | None = None,
        fonts: str | None = None,
        height: str | float | None = None,
    ) -> "Figure":
        """Draw the run as a matplotlib Figure, which a notebook shows. pyplot does not know it and keeps it not open.

        Args:
            what: one or several of position, attitude, velocity, force, sliding, tau, thrusters, integral, joints and
                summary, of the names of recorded signals, or of their components, ``tau.x``.
            width: of the figure: "column" (252 pt of TeX), "page" (516 pt), "elsevier-page" and others of
                :data:`uvms_mj.views.figures.WIDTHS`, a length with its unit, "88mm", or a number [in]; default: page
                for the summary, otherwise column.
            fonts: "sans" (default), "serif" (Times), "cm" (Computer Modern), or "latex": LaTeX sets the texts when the
                figure is written as .pdf or .pgf.
            height: of the figure, a length with its unit, or a number [in]; default: by its panels.

        :func:`uvms_mj.plot` draws several runs on the same axes. Raises InputError if the run has no such quantity, or
        fewer than two samples.
        """
        return display.figure(self, what, width, fonts, height)

    def between(self, start: float | None = None, end: float | None = None) -> "Trace":
        """The rows from a time to a time [s]; default: the first and the last one. Raises InputError unless there are
        two of them."""
        if (start is None and end is None) or len(self) < 2:
            return self
        first, last = float(self.t[0]), float(self.t[-1])
        low, high = first if start is None else start, last if end is None else end
        half = 0.5 * self.header.row_steps * self.scenario.simulation.timestep
        chosen = (self.t > low - half) & (self.t < high + half)
        if chosen.sum() < 2:
            found = f"{chosen.sum()} samples from {low:g} to {high:g} s"
            raise InputError(f"has {found}; its samples are from {first:g} to {last:g} s")
        return Trace.of(self.header, self.rows()[chosen], self.outcome)

    def apart(self, other: "Trace") -> tuple[str, ...] | None:
        """The signals of both traces that differ, in a bit or in their shape; None if the traces have other times."""
        if not _same_bits(self.t, other.t):
            return None
        return tuple(name for name in self if name in other.arrays and not _same_bits(self[name], other[name]))

    def at_rate(self, rate: float) -> "Trace":
        """The rows at a rate [Hz] that divides the trace's own, from t = 0 on, with the bands over all steps between
        them. Raises InputError for another rate."""
        recorded = 1.0 / (self.header.row_steps * self.scenario.simulation.timestep)
        every = round(recorded / rate) if rate > 0.0 else 0
        if every < 1 or abs(every * rate - recorded) > 1e-6 * recorded:
            above = max(1, int(recorded / rate)) if rate > 0.0 else 1
            near = [f"{recorded / n:.6g}" for n in (above + 1, above)] if 0.0 < rate < recorded else [f"{recorded:.6g}"]
            raise InputError(
                f"{rate:g} Hz does not divide the log's {recorded:.6g} Hz; the nearest: {' and '.join(near)}"
            )
        steps = np.rint(self.t / self.scenario.simulation.timestep).astype(int)
        rows, kept = self.rows(), np.flatnonzero(steps % (every * self.header.row_steps) == 0)
        starts = np.concatenate([[0], kept[:-1] + 1])
        bands = [edges for edges in BAND.values() if {*edges} <= self.arrays.keys() and len(kept)]
        for edges in bands:
            for name, extreme in zip(edges, (np.minimum, np.maximum), strict=True):
                place = self.header.places[name]
                rows[kept, place] = extreme.reduceat(rows[: kept[-1] + 1, place], starts)
        return Trace.of(self.header, rows[kept], self.outcome)

    def export(
        self,
        path: str | os.PathLike,
        signals: Sequence[str] = (),
        *,
        rate: float | None = None,
        replace: bool = False,
    ) -> None:
        """Write the samples to a file in the format of its ending, .csv, .parquet, .npz or .mat, with their units.

        Args:
            path: the file.
            signals: names of signals and, in CSV and Parquet, of components, ``tau.x``; default: all.
            rate: rows per second, which must divide the trace's own [Hz]; default: all rows.
            replace: whether to replace a file that exists.

        Raises InputError for an unknown ending, signal or rate, and if the file exists.
        """
        from .export import WRITERS, export

        kind = Path(path).suffix.lower().removeprefix(".")
        if kind not in WRITERS:
            raise InputError(f"{path}: the name must end in one of .{', .'.join(WRITERS)}")
        kept = self if rate is None else self.at_rate(rate)
        export(kept.header, kept.arrays, kind, Path(path), replace, signals)

    def _repr_html_(self) -> str:
        """The picture in a notebook."""
        return display.html(self)

    @property
    def scenario(self) -> Scenario:
        """The scenario of the run, with every default written out."""
        return self.header.scenario

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Shape, unit, frame and meaning of each array."""
        return self.header.signals

    @property
    def analytic(self) -> SteadyState | NoClosedForm:
        """Predicted steady state from scenario and gains alone, or the reason why no closed form exists."""
        if self.outcome.changes:
            return NoClosedForm(f"{', '.join(self.changed)} changed in the run")
        return self.header.analytic

    @property
    def changed(self) -> tuple[str, ...]:
        """The keys of the scenario that were changed while the run went on."""
        return tuple(dict.fromkeys(key for _, values in self.outcome.changes for key in values))

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings that were given before the first step."""
        return self.header.notes

    @property
    def status(self) -> Status:
        """How the run ended."""
        return self.outcome.status

    @property
    def message(self) -> str:
        """Reason why the run did not complete."""
        return self.outcome.message

    @property
    def steps(self) -> int:
        """Number of time steps done."""
        return self.outcome.steps

    @property
    def wall_time_s(self) -> float:
        """Wall-clock time of the stepping [s]."""
        return self.outcome.wall_time_s

    @property
    def duration_s(self) -> float:
        """Simulated time [s]."""
        return self.steps * self.scenario.simulation.timestep

    @property
    def push(self) -> np.ndarray:
        """(n,) pushing force of the vehicle on the walls [N], zero or positive: the sum of the normal forces."""
        if "f_normal" in self.arrays:
            return self.arrays["f_normal"]
        return np.maximum(0.0, 0.0 - self.arrays["f_contact_W"][:, 0])

    def band(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest value (n, ...) of a signal, or of ``push``, since the row before, at every step.

        A law may alternate faster than rows, which then show one side of it only. The signal itself, twice, if every
        step is a row, or if the log has no band of it.
        """
        low, high = BAND.get(name, (name, name))
        if low in self.arrays:
            return self.arrays[low], self.arrays[high]
        values = self.push if name == "push" else self[name]
        return values, values


def _same_bits(one: np.ndarray, other: np.ndarray) -> bool:
    return one.shape == other.shape and np.array_equal(
        np.ascontiguousarray(one, float).view(np.uint64), np.ascontiguousarray(other, float).view(np.uint64)
    )
