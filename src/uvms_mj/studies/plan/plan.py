"""The runs of a study: one base scenario, several laws, and draws of the keys that vary.

Every design of draws gives each entry of ``[[vary]]`` a number u from 0 to 1 a draw. In a random design each entry has
a stream of its own, decided by the seed and its keys: neither other entries nor the number of runs change its draws.
"""

import contextlib
import dataclasses
import functools
import hashlib
import itertools
import math
import os
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import Fault, InputError, suggestion
from ...files import plain, shortened, tables_of, toml_path
from ...scenario import Scenario
from ...setup.world import VEHICLES, World
from .file import (
    PATHS,
    Distribution,
    Keep,
    Logs,
    StudyFile,
    Vary,
    absolute,
    entries,
    read,
    with_absolute_values,
)
from .laws import KeyChecks, Law, base_of, combination_faults, laws_of, split_overrides
from .metrics import Limit, column_is_taken, kept_column, limits, metric_of, number_of, of_each, parted
from .places import of_vehicle, overrides_at, table_in, unit_of

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
        base: the base scenario, or the world.
        laws: at least one; labels are unique.
        variations: the entries of ``[[vary]]``; places of one entry move together.
        varied: the dotted keys that vary, or components of them, in order.
        units: unit of each varied key; empty without one.
        points: the values of each draw, in the order of ``varied``.
        design: "grid", "random", "sobol", "latin_hypercube" or "sobol_indices".
        repeats: runs of each draw and law, which differ in their seed.
        metrics: places in a run's summary, in a world behind the name of a vehicle, or path/to/file.py:function.
        engine: "auto", "mujoco", "free_body" or "gpu".
        tolerance: largest relative difference of a metric between the engines [1].
        time_limit_s: wall time after which a run ends [s]; None without a limit.
        success: what a run must meet besides its completion, by metric; empty if it must have settled.
        about: what readers should know, from the file.
        notes: warnings about the plan.
        trusted: names of users' stages whose files may be imported; None: all. Others have placeholders.
    """

    name: str
    description: str
    tables: dict[str, Any]
    base: Scenario | World
    laws: tuple[Law, ...]
    variations: tuple[Vary, ...]
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
    about: Mapping[str, Any]
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
        return plan_of(tables_of(study, "study"), study.parent, None, str(study), trusted)

    @classmethod
    def from_dict(
        cls,
        tables: Mapping[str, Any],
        folder: Path | None = None,
        overrides: Mapping[str, Any] | None = None,
        place: str = "study",
    ) -> "Plan":
        """Make a plan from nested tables, as TOML has them. Paths in them are relative to ``folder``; overrides and
        errors are as for :meth:`load`."""
        if not isinstance(tables, Mapping):
            raise InputError(f"{place}: {shortened(tables)} is not a mapping of tables")
        return plan_of(tables, folder or Path.cwd(), overrides, place)

    @property
    def draws(self) -> int:
        return len(self.points)

    @property
    def vehicles(self) -> tuple[str, ...]:
        """The names of the vehicles of a world; none of a scenario."""
        return _vehicles(self.base)

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
    def _variation_of_keys(self) -> list[Vary]:
        return [each for each in self.variations for _ in each.places]

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
        own = {**law.chosen, **law.overrides}
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
        given = {key: value for key, value in values.items() if of_vehicle(key)[1] in PATHS and value is not None}
        if isinstance(self.base, World):
            own = self.base.overrides_of_each(given)
            given = {f"{VEHICLES}[{name}].{key}": value for name in own for key, value in own[name].items()}
        keys = [f"{VEHICLES}[{name}].{key}" for name in self.vehicles for key in PATHS] or PATHS
        places = [(key, *key.rpartition(".")[::2]) for key in keys]
        named = {key: found[word] for key, table, word in places if word in (found := table_in(table, tables))}
        return named | given

    def scenario(self, index: int) -> Scenario:
        """The scenario of a run of one vehicle. Raises InputError if its values can't be used together, or the run is
        of a world."""
        found = self.scenario_or_world(index)
        if isinstance(found, World):
            raise InputError(f"{self.name}: run {index} is of a world of several vehicles; here is one vehicle needed")
        return found

    def scenario_or_world(self, index: int) -> Scenario | World:
        """The scenario of a run, or its world. Raises InputError if its values can't be used together."""
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
            unit = self.units[each.places[0]]
            names = ", ".join(each.places) + (f" [{unit}]" if unit else "")
            lines.append(f"{names}: {each.range()}" + (f"; {', '.join(each.laws)} only" if each.laws else ""))
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])


def run_seed(seed: int, draw: int, repeat: int) -> int:
    """simulation.seed of a run, below 2^48, which a double has exactly."""
    return int.from_bytes(hashlib.sha256(f"{seed} {draw} {repeat}".encode()).digest()[:6])


def points(
    kind: str, variations: Mapping[str, Vary], runs: int | None, seed: int
) -> tuple[tuple[tuple[Any, ...], ...], list[str]]:
    """The values of all places for each draw of a design, and notes about it. A grid is the product of the levels; the
    last entry changes fastest. Raises InputError if the design can't have so many runs."""
    d, each = len(variations), list(variations.values())
    if kind == "grid":
        no_grid = [where for where, entry in variations.items() if isinstance(entry, Distribution)]
        if no_grid:
            hint = "a grid needs values, or low, high and number; or choose another kind"
            raise InputError([Fault(f"{where}.distribution", hint) for where in no_grid])
        product = math.prod(len(entry.levels) for entry in each)
        if runs not in (None, product):
            raise _error("design.runs", f"{runs} differs from the product of the grid, {product}; leave it out")
        if product > MOST_RUNS:
            raise _error("design", f"the grid has {product} points; at most {MOST_RUNS} are allowed")
        return tuple(tuple(itertools.chain(*x)) for x in itertools.product(*(entry.levels for entry in each))), []
    if runs is None:
        raise _error("design.runs", f"lacks this key: the number of draws of the design {kind}")
    notes = []
    if kind == "sobol" and runs & (runs - 1):
        below = 1 << (runs.bit_length() - 1)
        notes = [f"{runs} Sobol points are less even than a power of two, {below} or {2 * below}"]
    if kind == "sobol_indices":
        samples, rest = divmod(runs, d + 2)
        if d == 0:
            raise _error("design.kind", "Sobol indices need a key that varies")
        if rest or not samples or samples & (samples - 1):
            below = (d + 2) << max(0, samples.bit_length() - 1)
            nearest = f"{runs} is not {d + 2} times a power of two; the nearest are {below} and {2 * below}"
            raise _error("design.runs", f"Sobol indices of {d} keys: {nearest}")
    u = unit_cube(kind, [" ".join(entry.places) for entry in each], runs, seed)
    columns = [column for entry, numbers in zip(each, u.T, strict=True) for column in entry.at(numbers)]
    return (tuple(zip(*columns, strict=True)) if columns else ((),) * runs), notes


def _error(key: str, message: str) -> InputError:
    return InputError([Fault(key, message)])


def unit_cube(kind: str, names: Sequence[str], runs: int, seed: int) -> np.ndarray:
    """Points (runs, d) of a design in the unit cube of d entries, by their names; ``kind`` is not "grid"."""
    d = len(names)
    if d == 0:
        return np.zeros((runs, 0))
    if kind == "random":
        return np.column_stack([_stream(seed, name).random(runs) for name in names])
    generator = _stream(seed, kind)
    if kind == "sobol_indices":
        from SALib.sample import sobol

        problem = {"num_vars": d, "names": names, "bounds": [[0.0, 1.0]] * d}
        return sobol.sample(problem, runs // (d + 2), calc_second_order=False, seed=generator)
    from scipy.stats import qmc

    if kind == "latin_hypercube":
        return qmc.LatinHypercube(d, seed=generator).random(runs)
    return qmc.Sobol(d, seed=generator).random_base2(max(0, math.ceil(math.log2(runs))))[:runs]


def _stream(seed: int, name: str) -> np.random.Generator:
    """Random numbers that the seed and a name decide."""
    digest = hashlib.sha256(f"{seed} {name}".encode()).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest)))


def plan_of(
    tables: Mapping[str, Any],
    folder: Path,
    overrides: Mapping[str, Any] | None,
    place: str,
    trusted: Container[str] | None = None,
) -> Plan:
    """The plan of a study file. It has the arguments of :meth:`Plan.from_dict` and :meth:`Plan.that_ran`; of a study
    that ran, which has ``trusted``, what needs its files is not checked again."""
    ran = trusted is not None
    faults: list[Fault] = []
    changed, of_base = split_overrides(tables, overrides, faults)
    study = read(changed, faults)
    of_tables = [*faults]
    base = base_of(study.base, folder, of_base, faults, trusted)
    faults, of_its_base = of_tables, faults[len(of_tables) :]
    study = _completed(study, folder, base)
    variations = entries(study.vary, faults)
    faults += of_its_base
    if isinstance(base, World):
        of_base = {base.named(key): value for key, value in of_base.items()}
        faults += [Fault("run.engine", _NO_GPU)] if study.run.engine == "gpu" else []
    left_out: list[str] = []
    laws = laws_of(study.laws, base, folder, faults, left_out, trusted) if base is not None else []
    faults += combination_faults(variations, laws, of_base, _none(faults, "laws"))
    design = study.design
    drawn, notes = _drawn(study, variations, faults)
    runs = len(drawn) * len(laws) * design.repeats
    if runs > MOST_RUNS:
        faults.append(Fault("design", f"{runs} runs; at most {MOST_RUNS} are allowed"))
    varied = tuple(place for each in variations.values() for place in each.places)
    faults += [] if ran else _keep_faults(study.keep, runs, varied, base)
    success = limits(study.success, study.keep.metrics, folder, faults)
    faults += [] if ran else KeyChecks(variations, laws, drawn).faults()
    if faults or base is None:
        raise InputError(faults, place)
    return Plan(
        name=study.name,
        description=study.description,
        tables={
            "name": study.name,
            "description": study.description,
            **({"about": plain(study.about)} if study.about else {}),
            "base": base.to_dict(),
            "laws": [law.written for law in laws],
            **{table: plain(getattr(study, table)) for table in ("vary", "design", "keep", "run")},
            "success": plain(success),
        },
        base=base,
        laws=tuple(laws),
        variations=tuple(variations.values()),
        varied=varied,
        units={key: next((u for law in laws if (u := unit_of(key, law.scenario))), "") for key in varied},
        points=drawn,
        design=str(design.kind),
        repeats=design.repeats,
        seed=design.seed,
        metrics=tuple(study.keep.metrics),
        logs=study.keep.logs,
        engine=study.run.engine,
        tolerance=study.run.tolerance,
        time_limit_s=study.run.time_limit_s,
        success=success,
        about=study.about,
        notes=(*left_out, *notes),
        trusted=trusted,
    )


def _none(faults: list[Fault], table: str) -> bool:
    """Whether no error is of a table."""
    return not any(fault.key.replace("[", ".").partition(".")[0] == table for fault in faults)


def _vehicles(base: Scenario | World | None) -> tuple[str, ...]:
    return tuple(base.scenarios) if isinstance(base, World) else ()


_NO_GPU = "a GPU runs one vehicle, and the base is a world of several; take auto"


def _with_names(table: Any, world: World) -> Any:
    """An entry of ``[[vary]]`` whose keys have the names of vehicles in place of their numbers."""
    if not isinstance(table, Mapping):
        return table
    named = {**table, "key": world.named(key)} if isinstance(key := table.get("key"), str) else dict(table)
    if isinstance(keys := table.get("keys"), list):
        named["keys"] = [world.named(key) if isinstance(key, str) else key for key in keys]
    return named


def _completed(study: StudyFile, folder: Path, base: Scenario | World | None) -> StudyFile:
    """A study file with absolute paths, the kind of its design, the metrics and keys of a world with the names of its
    vehicles, and the column of the metric of the worst logs."""
    vary = [with_absolute_values(each, folder) for each in study.vary]
    if isinstance(base, World):
        vary = [_with_names(each, base) for each in vary]
    grid = all(isinstance(each, Mapping) and ("values" in each or "number" in each) for each in vary)
    design = dataclasses.replace(study.design, kind=study.design.kind or ("grid" if grid else "random"))
    metrics, logs = [absolute(name, folder) for name in study.keep.metrics], study.keep.logs
    metrics = of_each(metrics, _vehicles(base))
    if logs.metric is not None:
        with contextlib.suppress(InputError):  # said with the other errors of keep
            logs = dataclasses.replace(logs, metric=kept_column(logs.metric, metrics, folder)[1])
    return dataclasses.replace(study, vary=vary, design=design, keep=Keep(metrics=metrics, logs=logs))


def _drawn(
    study: StudyFile, variations: Mapping[str, Vary], faults: list[Fault]
) -> tuple[tuple[tuple[Any, ...], ...], list[str]]:
    """The draws of a study without errors in its entries and its design, and notes about them."""
    if len(variations) == len(study.vary) and _none(faults, "design"):
        try:
            return points(str(study.design.kind), variations, study.design.runs, study.design.seed)
        except InputError as error:
            faults += error.faults
    return (), []


def _keep_faults(keep: Keep, runs: int, varied: Sequence[str], base: Scenario | World | None) -> Iterator[Fault]:
    """Errors of the table keep."""
    metrics, logs, vehicles = keep.metrics, keep.logs, _vehicles(base)
    for i, name in enumerate(metrics):
        try:
            if name in metrics[:i]:
                raise InputError(f"{name!r} is given twice")
            metric_of(name)
            if (vehicle := parted(name)[0]) and vehicle not in vehicles and base is not None:
                there = suggestion(vehicle, vehicles) if vehicles else "the base scenario is of one"
                raise InputError(f"{name!r}: no vehicle {vehicle!r}; {there}")
            if not number_of(name) and column_is_taken(name, metrics[:i], varied):
                raise InputError(f"{name!r}: a column of the rows has this name already; rename the function")
        except InputError as error:
            yield from (Fault(f"keep.metrics[{i}]", fault.message) for fault in error.faults)
    if logs.metric is not None:
        try:
            kept_column(logs.metric, metrics, Path())
        except InputError as error:
            yield from (Fault("keep.logs.metric", f"{logs.metric!r} {fault.message}") for fault in error.faults)
    for i, index in enumerate(logs.indices):
        if runs and index >= runs:
            yield Fault(f"keep.logs.indices[{i}]", f"no run {index}: the study has {runs} runs, from 0 to {runs - 1}")
