"""Scenarios: all inputs of a run, as frozen dataclasses that are read from and written to TOML.

Units are SI; angles are in degrees where a key ends in ``_deg``. The defaults are the paper's scenario (sec. 5).
"""

import dataclasses
import os
import re
import warnings
from collections.abc import Callable, Container, Iterable, Mapping, Sequence, Set
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from pydantic import TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from . import actuation, control, display, guidance, navigation
from .actuation import Actuation, Auto, IdealThrusters, Joints, PseudoInverse, Thrusters
from .control import Controller, Gsta, ImpedanceTask
from .control.design import INNER_TABLES, Estimates, Impedance
from .control.posture import Posture
from .errors import Fault, InputError, faults_of, shortened
from .files import is_file, plain, tables_of, toml_path
from .guidance import FilteredSteps, Guidance
from .navigation import Encoder, Navigation, NoObserver, NoWrist, Observer, Perfect, PerfectEncoder, Wrist
from .physics.effects import FLOWS, INERTIAS, PUSHES
from .plant.buoyancy import Buoyancy, Volume
from .plant.coupling import OF_COUPLINGS, Coupling
from .plant.effect import Effect, numbers_of
from .plant.obstacle import Obstacle
from .plant.sea import Sea
from .plant.settings import (
    OF_VEHICLE,
    Bumper,
    Initial,
    Stepping,
    Surface,
    VehicleChoice,
    Wall,
    overridden_in_vain,
)
from .plant.tether import Tether
from .plant.water import EFFECT_TABLES, Current, Disturbance, Drag, Fin, NearWall, Pad
from .quantities import STRICT, overrides_of, unit_of
from .stages.base import Stage
from .stages.foreign import parted
from .stages.loader import USERS, Choice, is_a_table, no_table, not_dotted, stage_of, table_of, tables_by_word

STAGES: dict[str, Choice] = {
    "reference": Choice(Guidance, guidance.SHIPPED, FilteredSteps),
    "navigation": Choice(Navigation, navigation.SHIPPED, Perfect),
    "encoder": Choice(Encoder, navigation.ENCODERS, PerfectEncoder),
    "wrist": Choice(Wrist, navigation.WRISTS, NoWrist),
    "observer": Choice(Observer, navigation.OBSERVERS, NoObserver),
    "controller": Choice(Controller, control.SHIPPED, Gsta),
    "actuation": Choice(Actuation, actuation.SHIPPED, PseudoInverse),
    "joints": Choice(Joints, actuation.JOINTS, Auto),
    "thrusters": Choice(Thrusters, actuation.THRUSTERS, IdealThrusters),
}
"""The tables that name a stage."""
STAGE_LISTS: dict[str, Choice] = {"effects": Choice(Effect, {}, Effect)}
"""The lists of tables that name a stage each."""
CHOICES = STAGES | STAGE_LISTS
"""All stages to choose from."""


@dataclass(frozen=True, repr=False, config=STRICT)
class Scenario:
    """All inputs of a run. Frozen; :meth:`updated` returns a changed copy.

    Raises:
        InputError: in :meth:`load`, :meth:`from_dict` and :meth:`updated`; it lists every error of the input.
    """

    name: str = "push_wall"
    description: str = ""
    vehicle: VehicleChoice = VehicleChoice()
    simulation: Stepping = Stepping()
    initial: Initial = Initial()
    current: Current = Current()
    disturbance: Disturbance = Disturbance()
    obstacle: Obstacle = Obstacle()
    sea: Sea = Sea()
    tether: Tether = Tether()
    pads: tuple[Pad, ...] = ()
    near_wall: tuple[NearWall, ...] = ()
    buoyancy: Buoyancy = Buoyancy()
    fins: tuple[Fin, ...] = ()
    drag: tuple[Drag, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    effects: tuple[Effect, ...] = ()
    wall: Wall = Wall()
    walls: tuple[Surface, ...] = ()
    bumper: Bumper = Bumper()
    reference: Guidance = FilteredSteps()
    impedance: Impedance = Impedance()
    estimates: Estimates = Estimates()
    navigation: Navigation = Perfect()
    encoder: Encoder = PerfectEncoder()
    wrist: Wrist = NoWrist()
    observer: Observer = NoObserver()
    task: ImpedanceTask = ImpedanceTask()
    posture: Posture = Posture()
    controller: Controller = Gsta()
    actuation: Actuation = PseudoInverse()
    joints: Joints = Auto()
    thrusters: Thrusters = IdealThrusters()

    @property
    def stages(self) -> tuple[Stage, ...]:
        """The stages that run: the task, if the law uses it, and the stages that tables and lists name."""
        task = (self.task,) if self.controller.uses_task else ()
        return tuple(stage for stage in (*task, *self.named_stages.values()) if stage.runs)

    def _tables(self, names: Iterable[str]) -> list[Any]:
        """The tables of some effects."""
        given = (getattr(self, name) for name in names)
        return [each for table in given for each in (table if isinstance(table, tuple) else (table,))]

    @property
    def balanced_tables(self) -> Sequence[str]:
        """The names of the tables of those effects of the water whose records are in a balance at rest."""
        return tuple(name for name, table in EFFECT_TABLES.items() if table.balanced)

    @property
    def unsteady_flow(self) -> str:
        """The reason why the water at a place does not move the same at all times; empty if it does."""
        return next((table.unsteady for table in self._tables(FLOWS) if table.unsteady), "")

    @property
    def constant_flow(self) -> bool:
        """Whether the water moves the same at all times and places."""
        return all(table.constant for table in self._tables(FLOWS))

    @property
    def mean_flow_W(self) -> np.ndarray:
        """(3,) constant part of the water's velocity in W, where no depth changes it [m/s]."""
        return np.sum([table.velocity_W for table in self._tables(FLOWS)], axis=0)

    @property
    def push_rate(self) -> np.ndarray:
        """(6,) bound on the rate of the wrench of the effects of the time alone in B [N/s, N m/s]."""
        return np.sum([table.rate for table in self._tables(PUSHES)], axis=0)

    @property
    def with_inertia(self) -> list[str]:
        """The names of the effects that change the inertia of the vehicle."""
        return [name for name in INERTIAS if getattr(self, name) != getattr(Scenario, name)]

    @property
    def named_stages(self) -> dict[str, Stage]:
        """The stages by the tables that name them, ``controller`` or ``effects[0]``."""
        found: dict[str, Stage] = {name: getattr(self, name) for name in STAGES}
        for name in STAGE_LISTS:
            found |= {f"{name}[{i}]": stage for i, stage in enumerate(getattr(self, name))}
        return found

    def stage(self, table: str) -> Stage:
        """The stage of a table, ``controller`` or ``effects[0]``."""
        name, _, index = table.rstrip("]").partition("[")
        return getattr(self, name)[int(index)] if index else getattr(self, name)

    def recorded_name(self, table: str, state: str) -> str:
        """The name under which a run records a state of the stage of a table: its own, and of several effects of one
        class with their numbers."""
        name, _, index = table.rstrip("]").partition("[")
        return f"{state}{numbers_of(getattr(self, name))[int(index)]}" if index else state

    @property
    def steps(self) -> int:
        """Number of time steps: the duration rounded to whole steps, at least one."""
        return max(1, round(self.simulation.duration / self.simulation.timestep))

    @property
    def control_period(self) -> float:
        """Time between control instants [s]."""
        return self.controller.period or self.simulation.timestep

    @classmethod
    def load(
        cls,
        scenario: str | os.PathLike = "push_wall",
        overrides: Mapping[str, Any] | None = None,
        controller: str | None = None,
    ) -> "Scenario":
        """Load a scenario from a TOML file, or a built-in one by its name.

        Args:
            scenario: path of a TOML file, or the name of a built-in scenario.
            overrides: dotted keys with values that replace the file's, ``{"wall.stiffness": 1e4}``.
            controller: name of a law, or ``path/to/my_law.py:MyLaw``; replaces the file's law. The file's gains are
                kept only if they belong to this law, as are a table's settings if an override replaces its ``name``;
                a warning names the gains that are left out. Settings of every stage of a table stay: the period of the
                table, ``controller.delay`` and ``reference.attitude_deg`` belong to the loop.
        """
        path = toml_path(scenario, "scenario", "scenarios")
        tables = tables_of(path, "scenario")
        return cls.from_dict(tables, overrides, controller, path.parent, str(scenario), note=warnings.warn)

    @classmethod
    def from_dict(
        cls,
        tables: Mapping[str, Any],
        overrides: Mapping[str, Any] | None = None,
        controller: str | None = None,
        folder: Path | None = None,
        place: str = "scenario",
        known: Mapping[str, type[Stage]] | None = None,
        note: Callable[[str], Any] = lambda said: None,
        trusted: Container[str] | None = None,
        valid: Set[str] = frozenset(),
    ) -> "Scenario":
        """Make a scenario from nested tables, as TOML has them, with overrides and controller as in :meth:`load`. The
        value of a table may also be its object, or a stage.

        Args:
            folder: of relative paths in ``tables``; paths in ``overrides`` are relative to the working directory.
            place: name of the tables in error messages.
            known: classes of stages that are already loaded, by table.
            note: is called with a sentence for each stage that is replaced and whose settings are left out.
            trusted: names of users' stages whose files may be imported; default: all. Others have placeholders, as in a
                log, which can be shown and not run.
            valid: names of tables that have the values of a scenario, and that no override changes.
        """
        tables = dict(tables)
        for name in tables.keys() - valid:
            if isinstance(tables[name], Mapping):
                tables[name] = dict(tables[name])
        faults, left_out = list[Fault](), list[str]()
        overrides = overrides_of(overrides)
        _anchor(tables, folder)
        if "vehicles" in tables:
            several = "are a world of several vehicles, which World.load and uvms-mj run take; here is one vehicle"
            raise InputError([Fault("vehicles", f"{several} needed")], place)
        meant = tables_by_word(CHOICES) if tables.keys() - _KEYS[""] else {}
        for word in [word for word in tables if word in meant and word not in _KEYS[""]] if meant else ():
            faults.append(Fault(word, no_table(word, "name", _TABLES, CHOICES)))
            del tables[word]
        given = [name for name in (*STAGES, "task") if name not in valid]
        for name in given:
            if not isinstance(tables.setdefault(name, {}), dict | Stage):
                faults.append(Fault(name, f"{tables[name]!r} is not a table"))
                tables[name] = {}
        chosen = {name: overrides.get(f"{name}.name") for name in STAGES if name not in valid}
        if controller is not None and chosen["controller"] not in (None, controller):
            both = f"{chosen['controller']!r} and {controller!r} are given; choose one"
            faults.append(Fault("controller.name", both))
        if controller is not None:
            chosen["controller"] = chosen["controller"] or controller
        for name, source in chosen.items():
            if source is not None:
                own = (known or {}).get(name)
                tables[name] = STAGES[name].replaced(tables[name], source, overrides, left_out, own, trusted)
        for key, value in overrides.items():
            faults += _override(tables, key, value)
        _load_stages(given, tables, known or {}, trusted, faults)
        for name in STAGE_LISTS.keys() - {*valid}:
            _load_list(name, tables, known or {}, trusted, faults)
        try:
            scenario = _VALIDATOR.validate_python(tables)
            faults += overridden_in_vain(scenario, overrides)
        except ValidationError as error:
            faults += faults_of(error, choices=_KEYS | _INNER_KEYS, units=_UNITS, defaults=_DEFAULTS)
        if faults:
            raise InputError(faults, place)
        for said in left_out:
            note(said)
        return scenario

    def updated(
        self,
        overrides: Mapping[str, Any],
        controller: str | None = None,
        place: str = "scenario",
        note: Callable[[str], Any] = lambda said: None,
        trusted: Container[str] | None = None,
    ) -> "Scenario":
        """Return a copy with dotted keys replaced, ``{"wall.stiffness": 1e4, "controller.k_1": 8.0}``.

        A user's stage of a log is loaded from the file that an override of its ``name`` gives, with its recorded
        settings if it is the same class. ``place`` names the scenario in error messages; ``note`` and ``trusted`` are
        as in :meth:`from_dict`.
        """
        overrides = overrides_of(overrides)
        tables = {name: getattr(self, name) for name in _KEYS[""]}
        changed = {key.partition(".")[0].partition("[")[0] for key in (*overrides, "controller" if controller else "")}
        for name in changed & tables.keys():
            tables[name] = plain(_as_tables(name, tables[name]))
        chosen = self.named_stages if changed & CHOICES.keys() else {}
        known = {name: type(stage) for name, stage in chosen.items() if name.partition("[")[0] in changed}
        for name, kind in list(known.items()):
            own = overrides.get(f"{name}.name", controller if name == "controller" else None)
            if own is not None and kind.of_log:
                del known[name]
                recorded: Any = kind
                in_a_log = not Path(recorded.source()).is_absolute()
                if recorded.source() == own or (in_a_log and parted(own)[1] == kind.__name__):
                    table_at(tables, name)["name"] = own
        valid = tables.keys() - changed
        return Scenario.from_dict(tables, overrides, controller, None, place, known, note, trusted, valid)

    def with_fresh_stages(self) -> "Scenario":
        """The scenario with the stages of users' files loaded anew, the files of a folder together: nothing that an
        earlier run left in their modules is in them, and an edited file is seen. Raises InputError if a file has
        changed so that its stage can't be made."""
        namespaces: dict[Path, Any] = {}
        faults, fresh = list[Fault](), dict[str, Any]()
        for name, choice in CHOICES.items():
            own: Any = getattr(self, name)
            try:
                if isinstance(own, tuple):
                    new: Any = tuple(choice.again(stage, namespaces) for stage in own)
                    changed = any(a is not b for a, b in zip(new, own, strict=True))
                else:
                    new = choice.again(own, namespaces)
                    changed = new is not own
                fresh |= {name: new} if changed else {}
            except InputError as error:
                faults += error.faults
        if faults:
            raise InputError(faults, "scenario")
        same = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        # a scenario that was loaded has this validator made, and replace() would make another one
        return _VALIDATOR.validate_python(same | fresh) if fresh else self

    def to_dict(self) -> dict[str, Any]:
        """Nested tables with every default. Keys whose value is None are left out, since TOML has no null."""
        tables: dict[str, Any] = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return plain({name: _as_tables(name, table) for name, table in tables.items()})

    def to_toml(self) -> str:
        """The tables of :meth:`to_dict` as TOML text."""
        return tomli_w.dumps(self.to_dict())

    def changes(self, units: bool = False) -> list[tuple[str, str, str]]:
        """Every key that differs from its default, with its value and its default as texts, on request with units."""
        values: list[tuple[str, Any, Any]] = []
        for name, kind in _TABLES.items():
            table = getattr(self, name)
            if name in STAGES and name != "controller":
                values.append((f"{name}.name", Path(table.source()).name, kind.source()))
            values += [(f"{name}.{f.name}", getattr(table, f.name), f.default) for f in dataclasses.fields(table)]
        values += [(name, getattr(self, name), ()) for name in LISTS]
        own = {f"controller.{f.name}": unit_of(f) for f in dataclasses.fields(self.controller)}

        def text(key: str, value: Any) -> str:
            unit = (_UNITS | own).get(key, "") if units and isinstance(value, float | tuple) else ""
            return f"{shortened(value)} {unit}".rstrip()

        differ = [each for each in values if each[1] not in (each[2], (each[2],) * 6)]
        return [(key, text(key, value), text(key, default)) for key, value, default in differ]

    def __repr__(self) -> str:
        """Name, law, and every key that differs from its default."""
        other = [f"{key} = {value}" for key, value, _ in self.changes()]
        what = "other than the defaults:" if other else "defaults"
        return "\n    ".join([f"<Scenario {self.name!r}, {self.controller.label()}, {what}", *other]) + ">"

    def _repr_html_(self) -> str:
        """The table in a notebook."""
        return display.html(self)


_VALIDATOR = TypeAdapter(Scenario)
_TABLES: dict[str, Any] = {
    f.name: type(f.default) for f in dataclasses.fields(Scenario) if dataclasses.is_dataclass(f.default)
}
_KEYS: dict[str, list[str]] = {"": [f.name for f in dataclasses.fields(Scenario)]} | {
    name: [f.name for f in dataclasses.fields(table)] for name, table in _TABLES.items()
}
LISTS: dict[str, Any] = {
    "walls": Surface,
    "pads": Pad,
    "near_wall": NearWall,
    "fins": Fin,
    "drag": Drag,
    "couplings": Coupling,
    "effects": Effect,
}
"""The tables of each list of tables."""
TABLES: dict[str, Any] = {f.name: _TABLES.get(f.name) or LISTS[f.name] for f in dataclasses.fields(Scenario)[2:]}
"""The class of each table, or of the tables of each list, by name. Its ``of_world`` says whose it is."""
_INNER: dict[str, Any] = {**INNER_TABLES, **OF_VEHICLE, **LISTS, **OF_COUPLINGS, "buoyancy.shapes": Volume}
_INNER_KEYS = {name: [f.name for f in dataclasses.fields(table)] for name, table in _INNER.items()}
"""The keys of the tables within a table."""
_UNITS = {
    f"{name}.{f.name}": unit_of(f) for name, table in (_TABLES | _INNER).items() for f in dataclasses.fields(table)
}
_DEFAULTS = {f"{name}.{f.name}": f.default for name, table in _TABLES.items() for f in dataclasses.fields(table)}


def _anchor(tables: dict[str, Any], folder: Path | None) -> None:
    """Make paths absolute that are relative to the folder of the scenario file."""
    if folder is None:
        return
    named = [("vehicle", "model"), ("joints", "motion_file"), *((name, "name") for name in STAGES)]
    places: list[tuple[Any, str]] = [(tables.get(table), key) for table, key in named]
    for name in STAGE_LISTS:
        if isinstance(tables.get(name), list | tuple):
            tables[name] = [dict(each) if isinstance(each, Mapping) else each for each in tables[name]]
            places += [(each, "name") for each in tables[name]]
    for table, key in places:
        value = table.get(key) if isinstance(table, dict) else None
        if isinstance(value, str) and is_file(folder / value.split(":")[0]):
            table[key] = str((folder / value).absolute())


def _load_stages(
    names: Iterable[str], tables: dict[str, Any], known: Mapping[str, type[Stage]], trusted: Container[str] | None,
    faults: list[Fault],
) -> None:  # fmt: skip
    """Replace the tables of stages, the task among them, by the stages; one with an error is left out."""
    for name in names:
        if isinstance(tables[name], Stage):
            continue
        try:
            if name == "task":
                tables[name] = stage_of(ImpedanceTask, tables[name])
            else:
                tables[name] = STAGES[name].load(tables[name], known.get(name), trusted)
        except InputError as error:
            del tables[name]
            faults += error.faults


def table_at(tables: Mapping[str, Any], name: str) -> Any:
    """The table of a name of :attr:`Scenario.named_stages`, ``controller`` or ``effects[0]``."""
    of, _, index = name.rstrip("]").partition("[")
    return tables[of][int(index)] if index else tables[of]


def _as_tables(name: str, value: Any) -> Any:
    """The value of a table, or of a list of tables, in which a stage is the table that makes it."""
    if name in STAGES:
        return table_of(value)
    return [table_of(stage) for stage in value] if name in STAGE_LISTS else value


def _load_list(
    name: str, tables: dict[str, Any], known: Mapping[str, type[Stage]], trusted: Container[str] | None,
    faults: list[Fault],
) -> None:  # fmt: skip
    """Replace the tables of a list of stages by the stages; a list with an error is left out."""
    choice, listed, found, wrong = STAGE_LISTS[name], tables.get(name, ()), list[Any](), list[Fault]()
    if not isinstance(listed, list | tuple):
        del tables[name]
        hint = f'{name} = [{{name = "{listed}"}}]' if isinstance(listed, str) else choice.base.room.name_key
        faults.append(Fault(name, f"is a list of tables; write {hint}"))
        return
    for i, table in enumerate(listed):
        key = f"{name}[{i}]"
        if isinstance(table, Stage):
            found.append(table)
            continue
        if not isinstance(table, Mapping) or "name" not in table:
            wrong.append(Fault(key, f"{shortened(table)} needs a name, {USERS}, as of a table"))
            continue
        try:
            found.append(choice.load(table, known.get(key), trusted))
        except InputError as error:
            wrong += [Fault(key + each.key.removeprefix(name), each.message) for each in error.faults]
    tables[name] = tuple(found)
    if wrong:
        del tables[name]
        faults += wrong


OF_LIST = re.compile(r"(\w+)(?:\[(\d{1,9})\]\.(\w+)(?:\.(\w+))?)?")
"""The keys ``walls``, ``walls[0].stiffness`` and ``couplings[0].surface.stiffness`` of an override."""


def _override_list(tables: dict[str, Any], key: str, found: re.Match, value: Any) -> list[Fault]:
    """Replace a list of tables of a scenario, or a key of one of them; ``found`` is the match of :data:`OF_LIST` with
    the key."""
    name, index, word, inner = found.groups()
    if index is None:
        tables[name] = value
        return []
    each = tables.get(name, [])
    if not isinstance(each, list | tuple) or int(index) >= len(each):
        return [Fault(key, f"the scenario has {len(each) if isinstance(each, list | tuple) else 0} [[{name}]]")]
    each = [table_of(table) if isinstance(table, Stage) else table for table in each]
    tables[name] = [dict(table) if isinstance(table, Mapping) else table for table in each]
    if isinstance(tables[name][int(index)], dict):  # otherwise the validator reports it
        table = tables[name][int(index)]
        if inner is None:
            table[word] = value
        elif f"{name}.{word}" not in _INNER:
            return [Fault(key, f"{word} is no table; its key is {name}[{index}].{word}")]
        elif not isinstance(table.get(word), Mapping):
            return [Fault(key, f"{name}[{index}] has no {word}")]
        else:
            table[word] = {**table[word], inner: value}
    return []


def _override(tables: dict[str, Any], key: str, value: Any) -> list[Fault]:
    if (found := OF_LIST.fullmatch(key)) and found[1] in LISTS:
        return _override_list(tables, key, found, value)
    table, _, word = key.partition(".")
    if not word:
        if table in ("name", "description"):
            tables[table] = value
            return []
        if isinstance(value, Stage):
            return [
                Fault(key, f"is a stage; give it to simulate(scenario, controller=...) or replace(scenario, {key}=...)")
            ]
        if table in _TABLES:
            return [Fault(key, is_a_table(table, value, _KEYS[table], STAGES.get(table)))]
        if table in tables_by_word(STAGE_LISTS):
            return [Fault(key, no_table(table, "name", _TABLES, CHOICES))]
        return [Fault(key, not_dotted(table, value, _KEYS, STAGES, tables))]
    if (listed := table.partition("[")[0]) in LISTS:
        first = f"{listed}[0].{word.rpartition('.')[2]}"
        return [Fault(key, f"{listed} is a list of tables; a key of its first one is {first}")]
    if table not in _TABLES:
        return [Fault(key, no_table(table, word, _TABLES, CHOICES))]
    if "[" in word:
        return [Fault(key, f"a part of a list can't be set; give the whole list, {table}.{word.partition('[')[0]}")]
    if not isinstance(tables.get(table, {}), dict):
        return []  # the validator reports it
    tables.setdefault(table, {})[word] = value
    return []


def keys() -> Iterable[tuple[str, Any, str]]:
    """Every key of a scenario with default and meaning. Of [controller], only the keys common to all laws."""
    for name, table in _TABLES.items():
        if name in STAGES:
            noun = STAGES[name].base.room.noun
            yield f"{name}.name", table.name, f"name of the {noun}, or {USERS}"
        for field in dataclasses.fields(Controller if name == "controller" else table):
            unit = f" [{field.metadata['unit']}]" if "unit" in field.metadata else ""
            yield f"{name}.{field.name}", field.default, field.metadata.get("meaning", "") + unit
    for name, table in LISTS.items():
        words = ", ".join(field.name for field in dataclasses.fields(table))
        of_class = f"name, which is {USERS}, the settings of the class, "
        yield name, (), f"list of tables of {of_class if name in STAGE_LISTS else ''}{words}"
