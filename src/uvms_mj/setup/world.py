"""Worlds: several vehicles in one scenario, each with a name and the tables of one vehicle.

A world is a :class:`.Scenario` for each vehicle, with the same water, walls and time. So every stage, closed form, note
and log of one vehicle is as it is for a vehicle alone.
"""

import dataclasses
import os
import re
import warnings
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import tomli_w

from ..errors import Fault, InputError, shortened, suggestion
from ..files import tables_of, toml_path
from ..plant.coupling import Coupling, coupling_faults
from ..plant.settings import NAME, Stepping
from ..quantities import overrides_of
from ..scenario import TABLES, Scenario
from .base import Setup
from .checks import checked

_Made = TypeVar("_Made")
OF_WORLD = tuple(name for name, table in TABLES.items() if table.of_world)
"""The tables of water, walls, time and couplings, which all vehicles share. Every other table is of a vehicle."""
VEHICLES = "vehicles"
OF_ONE = re.compile(rf"{VEHICLES}\[(\w+)\]\.(.+)")
"""The key ``vehicles[0].controller.k_1``, or with a name, ``vehicles[left].controller.k_1``."""


@dataclasses.dataclass(frozen=True, repr=False)
class World:
    """Several vehicles in the same water, among the same walls. Frozen; :meth:`updated` returns a changed copy.

    Attributes:
        scenarios: the scenario of each vehicle by the vehicle's name. A run of one of them alone gives the same trace
            as the run of the world, bit for bit, unless something couples it to another vehicle.
    """

    name: str
    description: str
    scenarios: Mapping[str, Scenario]

    @classmethod
    def load(
        cls, scenario: str | os.PathLike, overrides: Mapping[str, Any] | None = None, controller: str | None = None
    ) -> "World":
        """Load a world from a TOML file with ``[[vehicles]]``, or a built-in one by its name.

        Args:
            scenario: path of a TOML file, or a name.
            overrides: dotted keys with values. ``vehicles[0].controller.k_1``, or with the vehicle's name
                ``vehicles[left].controller.k_1``, is of one vehicle; ``controller.k_1`` is of all.
            controller: name of a law for all vehicles.

        Raises:
            InputError: the input is invalid; it lists every error.
        """
        tables, folder = _read(scenario)
        return cls.from_dict(tables, overrides, controller, folder, str(scenario), note=warnings.warn)

    @classmethod
    def from_dict(
        cls,
        tables: Mapping[str, Any],
        overrides: Mapping[str, Any] | None = None,
        controller: str | None = None,
        folder: Path | None = None,
        place: str = "world",
        note: Callable[[str], Any] = lambda said: None,
        trusted: Container[str] | None = None,
    ) -> "World":
        """Make a world from nested tables, as TOML has them; the arguments are as of :meth:`Scenario.from_dict`.

        ``[[vehicles]]`` has the name and the tables of each vehicle. A table at the top is of the world, or else of
        every vehicle that has no such table of its own.
        """
        names, listed = _listed(tables, place)
        common = {key: value for key, value in tables.items() if key not in ("name", "description", VEHICLES)}
        name, description = tables.get("name", "world"), tables.get("description", "")
        faults, own = list[Fault](), _of_each(overrides_of(overrides), names, place)
        merged = dict[str, dict[str, Any]]()
        for i, (vehicle, given) in enumerate(zip(names, listed, strict=True)):
            shared = [key for key in given if key in OF_WORLD]
            faults += [Fault(f"{VEHICLES}[{i}].{key}", _of_the_world(key)) for key in shared]
            found = {**common, **{key: value for key, value in given.items() if key not in (*OF_WORLD, "name")}}
            found |= {"name": name, "description": description}
            if isinstance(found.setdefault("vehicle", {}), Mapping):
                found["vehicle"] = {**found["vehicle"], "name": vehicle}
            merged[vehicle] = found

        def made(vehicle: str) -> Scenario:
            said = _of_vehicle(note, vehicle)
            return Scenario.from_dict(
                merged[vehicle], own[vehicle], controller, folder, place, note=said, trusted=trusted
            )

        return _world(each_vehicle(names, made, place, faults), place)

    def updated(
        self,
        overrides: Mapping[str, Any],
        controller: str | None = None,
        place: str = "world",
        note: Callable[[str], Any] = lambda said: None,
        trusted: Container[str] | None = None,
    ) -> "World":
        """Return a copy with dotted keys replaced, as in :meth:`load`; ``place``, ``note`` and ``trusted`` are as of
        :meth:`Scenario.updated`."""
        own = self.overrides_of_each(overrides, place)

        def made(vehicle: str) -> Scenario:
            said = _of_vehicle(note, vehicle)
            return self.scenarios[vehicle].updated(own[vehicle], controller, place, said, trusted)

        return _world(each_vehicle(self.scenarios, made, place), place)

    def overrides_of_each(self, overrides: Mapping[str, Any], place: str = "world") -> dict[str, dict[str, Any]]:
        """The overrides of each vehicle by its name. Raises InputError for a key that names no vehicle."""
        return _of_each(overrides_of(overrides), list(self.scenarios), place)

    @property
    def _first(self) -> Scenario:
        """The scenario of the first vehicle, which has the tables of the world as each of them has."""
        return next(iter(self.scenarios.values()))

    @property
    def simulation(self) -> Stepping:
        """Time step, duration and seed, which all vehicles share."""
        return self._first.simulation

    @property
    def steps(self) -> int:
        """Number of time steps."""
        return self._first.steps

    def named(self, key: str) -> str:
        """A key of one vehicle with the vehicle's name in place of its number; another key as it is."""
        if (found := OF_ONE.fullmatch(key)) and found[1].isdigit() and int(found[1]) < len(self.scenarios):
            return f"{VEHICLES}[{[*self.scenarios][int(found[1])]}].{found[2]}"
        return key

    @property
    def couplings(self) -> tuple[Coupling, ...]:
        """The couplings between vehicles."""
        return self._first.couplings

    @property
    def coupled(self) -> set[str]:
        """The names of the vehicles that are coupled to others."""
        return {name for coupling in self.couplings for name in coupling.vehicles}

    @property
    def label(self) -> str:
        """The names of the vehicles, as a text."""
        return ", ".join(self.scenarios)

    @cached_property
    def _tables(self) -> list[dict[str, Any]]:
        return [scenario.to_dict() for scenario in self.scenarios.values()]

    def to_dict(self) -> dict[str, Any]:
        """Nested tables with every default, as :meth:`from_dict` takes them."""
        first, found = self._tables[0], list[dict[str, Any]]()
        for name, tables in zip(self.scenarios, self._tables, strict=True):
            own = {key: value for key, value in tables.items() if key not in (*OF_WORLD, "name", "description")}
            own["vehicle"] = {key: value for key, value in own["vehicle"].items() if key != "name"}
            found.append({"name": name, **own})
        shared = {key: first[key] for key in OF_WORLD if key in first}
        return {"name": self.name, "description": self.description, **shared, VEHICLES: found}

    def to_toml(self) -> str:
        """The tables of :meth:`to_dict` as TOML text."""
        return tomli_w.dumps(self.to_dict())

    def __repr__(self) -> str:
        each = (f"{name}: {scenario!r}" for name, scenario in self.scenarios.items())
        return "\n  ".join([f"<World {self.name!r}, {len(self.scenarios)} vehicles", *each]) + ">"


def each_vehicle(
    names: Iterable[str], make: Callable[[str], _Made], place: str, faults: Sequence[Fault] = ()
) -> dict[str, _Made]:
    """The results of ``make`` for the vehicles of a world, by their names. Raises InputError with ``faults`` and every
    error of ``make``, with its key in the world."""
    made, found = dict[str, _Made](), list(faults)
    for i, name in enumerate(names):
        try:
            made[name] = make(name)
        except InputError as error:
            found += [
                fault
                if not fault.key or fault.key.partition(".")[0].partition("[")[0] in OF_WORLD
                else Fault(f"{VEHICLES}[{i}].{fault.key}", fault.message)
                for fault in error.faults
            ]
    if found:
        raise InputError(list(dict.fromkeys(found)), place)
    return made


def _world(scenarios: Mapping[str, Scenario], place: str) -> World:
    """The world of scenarios by the names of their vehicles. Raises InputError for a coupling unless it is of two of
    them."""
    first, faults = next(iter(scenarios.values())), list[Fault]()
    for i, coupling in enumerate(first.couplings):
        key, (one, two) = f"couplings[{i}].vehicles", coupling.vehicles
        faults += [
            Fault(key, f"no vehicle {x!r}; {suggestion(x, scenarios)}") for x in (one, two) if x not in scenarios
        ]
        faults += [Fault(key, f"{one!r} can't be coupled to itself")] if one == two else []
    if faults:
        raise InputError(faults, place)
    return World(first.name, first.description, scenarios)


def checked_world(world: World) -> None:
    """Check each vehicle as for its run, and then the couplings. Raises InputError with every error if the world cannot
    run."""
    setups = each_vehicle(world.scenarios, lambda name: checked(world.scenarios[name], in_world=True), "world")
    if faults := [*coupling_errors(world.couplings, setups, world.simulation.timestep)]:
        raise InputError(list(dict.fromkeys(faults)), "world")


def coupling_errors(couplings: Sequence[Coupling], setups: Mapping[str, Setup], timestep: float) -> Iterator[Fault]:
    """The errors of couplings of vehicles with these setups by name."""
    for i, coupling in enumerate(couplings):
        for fault in coupling_faults(coupling, [setups[name] for name in coupling.vehicles], timestep):
            yield Fault(f"couplings[{i}].{fault.key}", fault.message)


def one_world(scenarios: Sequence[Scenario]) -> bool:
    """Whether scenarios are of the vehicles of one world: they have names of their own, the same water, walls and
    time."""
    names = {scenario.vehicle.name for scenario in scenarios}
    shared = [[getattr(scenario, table) for table in OF_WORLD] for scenario in scenarios]
    return len(shared) > 1 and len(names) == len(shared) and "" not in names and all(x == shared[0] for x in shared)


def _read(scenario: str | os.PathLike) -> tuple[dict[str, Any], Path]:
    """The tables of a file or a built-in name, and the folder of relative paths in them. Raises InputError if there is
    none, or it can't be read."""
    path = toml_path(scenario, "scenario", "scenarios")
    return tables_of(path, "scenario"), path.parent


def loaded(
    scenario: str | os.PathLike,
    overrides: Mapping[str, Any],
    controller: str | None = None,
    trusted: Container[str] | None = None,
) -> Scenario | World:
    """The scenario of one vehicle, or the world, of a file or a built-in name; the arguments are as of
    :meth:`Scenario.load` and :meth:`Scenario.from_dict`."""
    tables, folder = _read(scenario)
    kind = World if VEHICLES in tables else Scenario
    return kind.from_dict(tables, overrides, controller, folder, str(scenario), note=warnings.warn, trusted=trusted)


def vehicles_of(scenario: str | os.PathLike) -> list[str]:
    """The names of the vehicles of a file or a built-in name, of which no code is run; none if it is of one vehicle.
    Raises InputError if there is none, or it can't be read."""
    tables, _ = _read(scenario)
    return _listed(tables, str(scenario))[0] if VEHICLES in tables else []


def _listed(tables: Mapping[str, Any], place: str) -> tuple[list[str], Sequence[Mapping[str, Any]]]:
    """The names of the vehicles, and their tables. Raises InputError for a wrong name, and for one that two of them
    have: on a file system without capitals, their logs would be one file."""
    listed = tables.get(VEHICLES, ())
    if not isinstance(listed, list | tuple) or not all(isinstance(each, Mapping) for each in listed) or not listed:
        raise InputError([Fault(VEHICLES, f"{shortened(listed)} is not a list of tables, one a vehicle")], place)
    faults, names = list[Fault](), list[str]()
    for i, table in enumerate(listed):
        key, name = f"{VEHICLES}[{i}].name", table.get("name")
        if not isinstance(name, str) or not NAME.fullmatch(name):
            given = "lacks this key" if name is None else f"{shortened(name)} is no name"
            faults.append(Fault(key, f"{given}: up to 40 letters, digits and underscores, with a letter first"))
            continue
        if name.lower() in (each.lower() for each in names):
            faults.append(Fault(key, f"{name!r} is the name of another vehicle; each needs its own"))
        names.append(name)
    if faults:
        raise InputError(faults, place)
    return names, listed


def _of_each(overrides: Mapping[str, Any], names: Sequence[str], place: str) -> dict[str, dict[str, Any]]:
    """The overrides of each vehicle by its name. Raises InputError for a key that names no vehicle, or that one vehicle
    can't have for itself."""
    faults, own = list[Fault](), {name: dict[str, Any]() for name in names}
    for key, value in overrides.items():
        found = OF_ONE.fullmatch(key)
        if found is None and key.partition(".")[0].partition("[")[0] == VEHICLES:
            faults.append(Fault(key, f"name one vehicle and its key, {VEHICLES}[{names[0]}].controller.k_1"))
        elif found is None:
            for each in own.values():
                each[key] = value
            continue
        else:
            which, word = found.groups()
            vehicle = names[int(which)] if which.isdigit() and int(which) < len(names) else which
            if vehicle not in own:
                known = f"the world has {len(names)} vehicles; {suggestion(which, names)}"
                faults.append(Fault(key, f"no such vehicle; {known}"))
            elif (table := word.partition(".")[0].partition("[")[0]) in OF_WORLD:
                faults.append(Fault(key, _of_the_world(table)))
            elif word in ("name", "description", "vehicle.name"):
                faults.append(Fault(key, "is given by the file; it can't be set"))
            else:
                own[vehicle][word] = value
    faults += [Fault(key, "each vehicle has its own") for key in overrides if key == "vehicle.name"]
    if faults:
        raise InputError(faults, place)
    return own


def _of_vehicle(note: Callable[[str], Any], name: str) -> Callable[[str], Any]:
    """A function that takes the notes about a vehicle, with its name."""
    return lambda said: note(f"{name}: {said}")


def _of_the_world(table: str) -> str:
    return f"is the world's, for all vehicles; write it at the top, as {table}"
