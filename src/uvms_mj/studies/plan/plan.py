"""A study file as a plan: the list of runs of one base scenario, several laws, and keys that vary."""

import functools
import hashlib
import os
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...errors import InputError
from ...files import shortened, tables_of, toml_path
from ...scenario import Scenario
from .draws import Variation
from .metrics import Limit
from .places import overrides_at
from .reading import Law, fields_of
from .study_file import PATHS, Logs


@dataclass(frozen=True)
class Run:
    """One run of a plan.

    Attributes:
        law: label of its law.
        seed: its simulation.seed. Draw and repeat decide it, so that the laws are compared with the same numbers.
        values: of each varied key; None if the key does not vary for this law.
        overrides: dotted keys; ``plan.base.updated(overrides)`` is its scenario.
    """

    index: int
    draw: int
    law: str
    repeat: int
    seed: int
    values: dict[str, Any]
    overrides: dict[str, Any]


@dataclass(frozen=True, eq=False)
class Plan:
    """The runs of a study.

    Attributes:
        tables: the study file with absolute paths and its base scenario inline: ``Plan.from_dict(plan.tables)`` gives
            the same plan.
        laws: at least one; labels are unique.
        variations: the entries of ``[[vary]]``; keys of one entry move together.
        varied: the dotted keys that vary, or components of them, in order.
        units: unit of each varied key; empty without one.
        points: the values of each draw, in the order of ``varied``.
        design: "grid", "random", "sobol", "latin_hypercube" or "sobol_indices".
        repeats: runs of each draw and law, which differ in their seed.
        metrics: places in a run's summary, or path/to/file.py:function.
        engine: "auto", "mujoco" or "free_body".
        tolerance: largest relative difference of a metric between the engines [1].
        time_limit_s: wall time after which a run ends [s]; None without a limit.
        success: what a run must meet besides its completion, by metric; empty if it must have settled.
        notes: warnings about the plan.
        trusted: names of users' stages whose files may be imported; None: all. Others have placeholders.
    """

    name: str
    description: str
    tables: dict[str, Any]
    base: Scenario
    laws: tuple[Law, ...]
    variations: tuple[Variation, ...]
    varied: tuple[str, ...]
    units: dict[str, str]
    points: tuple[tuple[Any, ...], ...]
    design: str
    repeats: int
    seed: int
    metrics: tuple[str, ...]
    logs: Logs
    engine: str
    tolerance: float
    time_limit_s: float | None
    success: Mapping[str, Limit]
    notes: tuple[str, ...]
    trusted: Container[str] | None = None

    @classmethod
    def load(cls, study: str | os.PathLike, overrides: Mapping[str, Any] | None = None) -> "Plan":
        """Load a study from a TOML file, or a shipped one by its name.

        Args:
            study: path of a TOML file, or a name.
            overrides: dotted keys with values: of the tables design, keep and run, ``{"design.runs": 10}``, or of the
                base scenario, ``{"simulation.duration": 2.0}``.

        Raises:
            InputError: the file or an override is invalid; lists every error.
        """
        path = toml_path(study, "study", "studies")
        return cls.from_dict(tables_of(path, "study"), path.parent, overrides, place=str(study))

    @classmethod
    def that_ran(cls, study: Path, trusted: Container[str] = ()) -> "Plan":
        """Load the plan of a study that ran, for its results. Nothing is imported but the stages ``trusted``, by their
        names in the file; all others of users' files have placeholders, as in a log. Raises InputError if the file is
        invalid."""
        return cls(**fields_of(tables_of(study, "study"), study.parent, None, str(study), trusted))

    @classmethod
    def from_dict(
        cls,
        tables: Mapping[str, Any],
        folder: Path | None = None,
        overrides: Mapping[str, Any] | None = None,
        place: str = "study",
    ) -> "Plan":
        """Make a plan from nested tables, as TOML has them. Paths in them are relative to ``folder``; overrides and
        errors are those of :meth:`load`."""
        if not isinstance(tables, Mapping):
            raise InputError(f"{place}: {shortened(tables)} is not a mapping of tables")
        return cls(**fields_of(tables, folder or Path.cwd(), overrides, place))

    @property
    def draws(self) -> int:
        return len(self.points)

    @property
    def runs(self) -> int:
        """Number of runs: draws x laws x repeats. The index of a run is (draw * laws + law) * repeats + repeat."""
        return self.draws * len(self.laws) * self.repeats

    @functools.cached_property
    def steps(self) -> int:
        """Number of time steps of all runs."""
        return self.repeats * sum(sum(self._steps(law)) for law in self.laws)

    def _steps(self, law: Law) -> Iterator[int]:
        """Number of time steps of each draw of a law."""
        stepping = law.scenario.simulation
        places = {"simulation.timestep": stepping.timestep, "simulation.duration": stepping.duration}
        covered = [each.covers(law.label) for each in self._variation_of_keys]
        varied = {key: i for i, key in enumerate(self.varied) if key in places and covered[i]}
        if not varied:
            yield law.scenario.steps * self.draws
            return
        for point in self.points:
            now = places | {key: point[i] for key, i in varied.items()}
            yield max(1, round(now["simulation.duration"] / now["simulation.timestep"]))

    @functools.cached_property
    def _variation_of_keys(self) -> list[Variation]:
        return [each for each in self.variations for _ in each.keys]

    def _law(self, index: int) -> Law:
        return self.laws[index // self.repeats % len(self.laws)]

    def run(self, index: int) -> Run:
        """The run of an index."""
        if not 0 <= index < self.runs:
            raise IndexError(f"run {index}: the study has {self.runs} runs, from 0 to {self.runs - 1}")
        draw, law, repeat = index // self.repeats // len(self.laws), self._law(index), index % self.repeats
        values = self._values(index)
        given = {key: value for key, value in values.items() if value is not None}
        seed = run_seed(self.seed, draw, repeat)
        own = {"controller.name": law.source, **law.overrides}
        overrides = {**own, **overrides_at(given, law.tables), "simulation.seed": seed}
        return Run(index, draw, law.label, repeat, seed, values, overrides)

    def _values(self, index: int) -> dict[str, Any]:
        """The values of each varied key in a run; None if the key does not vary for its law."""
        law, point = self._law(index), self.points[index // self.repeats // len(self.laws)]
        each = zip(self.varied, point, self._variation_of_keys, strict=True)
        return {key: value if entry.covers(law.label) else None for key, value, entry in each}

    def names(self, index: int) -> dict[str, str]:
        """The names of the stages and of the files of a run, by dotted key."""
        tables, values = self._law(index).tables, self._values(index)
        places = [(key, *key.split(".")) for key in PATHS]
        named = {key: tables[table][word] for key, table, word in places if word in tables[table]}
        return named | {key: value for key, value in values.items() if key in PATHS and value is not None}

    def scenario(self, index: int) -> Scenario:
        """The scenario of a run. Raises InputError if its values can't be used together."""
        overrides = self.run(index).overrides
        return self._law(index).scenario.updated(overrides, place=f"run {index}", trusted=self.trusted)

    def text(self) -> str:
        """Number of runs and steps, the laws, and the range of each key: the text of a dry run."""
        counts = [f"{self.draws} draws ({self.design.replace('_', ' ')})"]
        counts += [f"{n} {what}" for n, what in ((len(self.laws), "laws"), (self.repeats, "repeats")) if n > 1]
        lines = [
            f"{self.name}: {self.runs} runs, {' x '.join(counts)}; {self.steps:.4g} time steps",
            f"base: {self.base.name}; {'laws' if len(self.laws) > 1 else 'law'}: "
            f"{', '.join(law.label for law in self.laws)}; engine: {self.engine}",
        ]
        for each in self.variations:
            unit = self.units[each.keys[0]]
            names = ", ".join(each.keys) + (f" [{unit}]" if unit else "")
            lines.append(f"{names}: {each.range()}" + (f"; {', '.join(each.laws)} only" if each.laws else ""))
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])


def run_seed(seed: int, draw: int, repeat: int) -> int:
    """simulation.seed of a run, below 2^48, which a double has exactly."""
    return int.from_bytes(hashlib.sha256(f"{seed} {draw} {repeat}".encode()).digest()[:6])
