"""A study file as a plan: the list of runs of one base scenario, several laws, and keys that vary."""

import dataclasses
import functools
import hashlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import Fault, InputError
from ..files import parsed_toml, plain, shortened, text_of, toml_path
from ..scenario import Scenario
from .draws import Variation, design_faults, points, variation
from .entries import Law, absolute, base_of, laws_of, split_overrides, with_absolute_values
from .key_checks import combination_faults, key_faults
from .metric import metric_of
from .places import overrides_at, unit_of
from .study_file import Logs, StudyFile, read
from .success import Limit, limits

MOST_RUNS = 10_000_000


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
        try:
            tables = parsed_toml(text_of(path))
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: not a study in TOML: {error}") from None
        tables.setdefault("name", path.stem)
        return cls.from_dict(tables, path.parent, overrides, place=str(study))

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
        faults: list[Fault] = []
        changed, of_base = split_overrides(tables, overrides, faults)
        study = read(changed, faults)
        plan = _plan(study, folder or Path.cwd(), of_base, faults)
        if faults or plan is None:
            raise InputError(faults, place)
        return plan

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
        varied = {key: i for i, key in enumerate(self.varied) if key in places and self._covers(i, law)}
        if not varied:
            yield law.scenario.steps * self.draws
            return
        for point in self.points:
            now = places | {key: point[i] for key, i in varied.items()}
            yield max(1, round(now["simulation.duration"] / now["simulation.timestep"]))

    def _covers(self, i: int, law: Law) -> bool:
        return self._laws_of_key[i] is None or law.label in self._laws_of_key[i]

    @functools.cached_property
    def _laws_of_key(self) -> list[Any]:
        return [each.laws or None for each in self.variations for _ in each.keys]

    def _at(self, index: int) -> tuple[int, Law, int]:
        """Draw, law and repeat of a run."""
        if not 0 <= index < self.runs:
            raise IndexError(f"run {index}: the study has {self.runs} runs, from 0 to {self.runs - 1}")
        first, repeat = divmod(index, self.repeats)
        draw, law = divmod(first, len(self.laws))
        return draw, self.laws[law], repeat

    def _drawn(self, draw: int, law: Law, repeat: int) -> tuple[dict[str, Any], dict[str, Any]]:
        """Values of the varied keys, and the overrides of the law's scenario."""
        values = {
            key: value if self._covers(i, law) else None
            for i, (key, value) in enumerate(zip(self.varied, self.points[draw], strict=True))
        }
        given = {key: value for key, value in values.items() if value is not None}
        seed = run_seed(self.seed, draw, repeat)
        return values, overrides_at(given, law.tables) | {"simulation.seed": seed}

    def run(self, index: int) -> Run:
        """The run of an index."""
        draw, law, repeat = self._at(index)
        values, overrides = self._drawn(draw, law, repeat)
        whole = {"controller.name": law.source, **law.overrides, **overrides}
        return Run(index, draw, law.label, repeat, overrides["simulation.seed"], values, whole)

    def scenario(self, index: int) -> Scenario:
        """The scenario of a run. Raises InputError if its values can't be used together."""
        draw, law, repeat = self._at(index)
        return law.scenario.updated(self._drawn(draw, law, repeat)[1], place=f"run {index}")

    def text(self) -> str:
        """Number of runs and steps, the laws, and the range of each key: the text of a dry run."""
        counts = [f"{self.draws} draws ({self.design})", f"{len(self.laws)} laws", f"{self.repeats} repeats"]
        lines = [
            f"{self.name}: {self.runs} runs, {' x '.join(counts)}; {self.steps:.4g} time steps",
            f"base: {self.base.name}; laws: {', '.join(law.label for law in self.laws)}; engine: {self.engine}",
        ]
        for each in self.variations:
            unit = self.units[each.keys[0]]
            names = ", ".join(each.keys) + (f" [{unit}]" if unit else "")
            lines.append(f"{names}: {each.range()}" + (f"; {', '.join(each.laws)} only" if each.laws else ""))
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])


def run_seed(seed: int, draw: int, repeat: int) -> int:
    """simulation.seed of a run, below 2^48, which a double has exactly."""
    return int.from_bytes(hashlib.sha256(f"{seed} {draw} {repeat}".encode()).digest()[:6])


def _plan(study: StudyFile, folder: Path, overrides: Mapping[str, Any], faults: list[Fault]) -> Plan | None:
    """The plan of a study file. Every error is appended to ``faults``."""
    base = base_of(study.base, folder, overrides, faults)
    laws = laws_of(study.laws, base, folder, faults) if base is not None else []
    variations = []
    for i, each in enumerate(study.vary):
        place = f"vary[{i}]"
        if not any(fault.key.startswith(place) for fault in faults):
            found = variation(with_absolute_values(each, folder), place, faults)
            variations += [found] if found is not None else []
    faults += combination_faults(variations, laws, overrides)
    complete = len(variations) == len(study.vary)
    levels = all(each.levels for each in variations)
    kind = study.design.kind or ("grid" if levels else "random")
    draws, notes = 0, []
    if complete:
        draws, wrong, notes = design_faults(kind, variations, study.design.runs)
        faults += wrong
    runs = draws * len(laws) * study.design.repeats
    if runs > MOST_RUNS:
        faults.append(Fault("design", f"{runs} runs; at most {MOST_RUNS} are allowed"))
        draws = 0
    metrics = [absolute(name, folder) for name in study.keep.metrics]
    faults += _keep_faults(metrics, study.keep.logs, runs)
    success = limits(study.success, metrics, faults)
    drawn = points(kind, variations, draws, study.design.seed) if draws and complete else ()
    if laws and not any(fault.key.startswith("design") for fault in faults):
        faults += key_faults(variations, laws, drawn)
    if faults or base is None:
        return None
    varied = tuple(key for each in variations for key in each.keys)
    units = {key: next((u for law in laws if (u := unit_of(key, law.scenario))), "") for key in varied}
    return Plan(
        study.name,
        study.description,
        _tables(study, base, laws, kind, metrics, folder),
        base,
        tuple(laws),
        tuple(variations),
        varied,
        units,
        drawn,
        kind,
        study.design.repeats,
        study.design.seed,
        tuple(metrics),
        study.keep.logs,
        study.run.engine,
        study.run.tolerance,
        study.run.time_limit_s,
        success,
        tuple(notes),
    )


def _keep_faults(metrics: list[str], logs: Logs, runs: int) -> Iterator[Fault]:
    """Errors of the table keep."""
    for i, name in enumerate(metrics):
        try:
            if name in metrics[:i]:
                raise InputError(f"{name!r} is given twice")
            metric_of(name)
        except InputError as error:
            yield from (Fault(f"keep.metrics[{i}]", fault.message) for fault in error.faults)
    used = {"worst": ("k", "metric"), "listed": ("indices",)}.get(logs.kind, ())
    for field in dataclasses.fields(Logs)[1:]:
        value = getattr(logs, field.name)
        if field.name not in used and value not in (None, [], 5):
            yield Fault(f"keep.logs.{field.name}", f"has no effect for logs of kind {logs.kind!r}")
    if logs.kind == "worst" and logs.metric not in metrics:
        yield Fault("keep.logs.metric", f"{logs.metric!r} must be one of keep.metrics: {', '.join(metrics)}")
    if logs.kind == "listed" and not logs.indices:
        yield Fault("keep.logs.indices", "lists no run")
    for i, index in enumerate(logs.indices):
        if runs and index >= runs:
            yield Fault(f"keep.logs.indices[{i}]", f"no run {index}: the study has {runs} runs, from 0 to {runs - 1}")


def _tables(
    study: StudyFile, base: Scenario, laws: list[Law], kind: str, metrics: list[str], folder: Path
) -> dict[str, Any]:
    """The tables of a plan, complete, with absolute paths."""
    keep = plain(study.keep) | {"metrics": metrics}
    design = {key: value for key, value in plain(study.design).items() if key != "runs" or kind != "grid"}
    return {
        "name": study.name,
        "description": study.description,
        "base": base.to_dict(),
        "laws": [{"name": law.source, "label": law.label, **plain(law.overrides)} for law in laws],
        "vary": [plain(with_absolute_values(each, folder)) for each in study.vary],
        "design": design | {"kind": kind},
        "keep": keep,
        "run": plain(study.run),
        "success": plain(study.success),
    }
