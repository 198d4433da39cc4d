"""A change of a setup, and which parts of a setup a function reads.

A function need not be called again for a setup that differs in other parts.

A part is a key of a plain table, ``wall.stiffness``, a stage or a list of tables as a whole, ``controller`` and
``walls``, or one of ``design`` and ``contacts``. The plant is none: no change reaches it.
"""

import dataclasses
import functools
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Set
from typing import Any

import numpy as np

from ..control.design import Design
from ..errors import Fault, InputError
from ..physics.effects import counted
from ..plant.build import check_fit, task_inertias
from ..plant.contacts import contacts_of
from ..scenario import CHOICES, Scenario
from ..stages.base import Stage
from .base import Setup
from .checks import CHECKS, faults_of_stage, no_overflow, refuse


class Reads:
    """The parts of a setup that functions read, each found by one call.

    A function depends on its arguments and the setup alone, which is the last of them. So it gives the same, and reads
    the same, of each setup that agrees with this one in the parts that it reads of this one.
    """

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self.found: dict[Hashable, Set[str]] = {}
        self.users = {table for table, stage in setup.scenario.named_stages.items() if not stage.is_shipped}

    def find(self, function: Callable[..., Any], *arguments: Any) -> Set[str]:
        """The parts that a function reads."""
        found = set[str]()
        made = function(*arguments, watched(self._setup, found))
        if isinstance(made, Iterator):
            deque(made, maxlen=0)
        self.found[function, *arguments] = found
        return found


class Change:
    """Overrides of a scenario by dotted keys, as :func:`uvms_mj.quantities.overrides_of` gives them, and which
    functions of its setup they concern: all of them without :class:`Reads` of this setup."""

    def __init__(self, overrides: Mapping[str, Any], reads: Reads | None = None) -> None:
        self.overrides, self._reads = overrides, reads
        whole = [key.partition("[")[0] for key in overrides]
        self._parts = {*whole, *(key.partition(".")[0] for key in whole)}

    def add(self, parts: Iterable[str]) -> None:
        """Add parts that have been made anew."""
        self._parts |= {*parts}

    def concerns(self, function: Callable[..., Any], *arguments: Any) -> bool:
        """Whether a function of arguments and a setup has to be called again."""
        if self._reads is None:
            return True
        found = self._reads.found.get((function, *arguments))
        return not self._parts.isdisjoint(self._reads.find(function, *arguments) if found is None else found)

    def concerns_stage(self, function: Callable[..., Any], table: str, *arguments: Any) -> bool:
        """As :meth:`concerns`, for a function of the name of a table and more that calls a method of its stage. A
        user's method may read anything."""
        return self._reads is None or table in self._reads.users or self.concerns(function, table, *arguments)


ANYTHING = Change({})
"""A change that concerns every function."""


def changed(base: Setup, change: Change, place: str) -> Setup:
    """``base`` with a change of its scenario.

    Raises:
        InputError: a key or value is invalid, or needs another plant or other machine code. ``place`` is the caller's
            name in the message.
    """
    try:
        setup = Setup(base.scenario.updated(change.overrides), base.plant, base.design, base.contacts)
        _refuse_other_code(base, setup.scenario, place)
        with no_overflow(setup.scenario):
            if change.concerns(_check_fit):
                _check_fit(setup)
            parts = {name: part(setup) for name, part in _PARTS.items() if change.concerns(part)}
            if parts:
                made: dict[str, Any] = {"design": base.design, "contacts": base.contacts} | parts
                setup = Setup(setup.scenario, base.plant, **made)
                change.add(parts)
            if setup.contacts.kinds != base.contacts.kinds:
                wrong = f"{place} can't change which contacts there are; make a new Simulation"
                keys = ("wall.present", "bumper.stiffness")
                raise InputError([Fault(key, wrong) for key in change.overrides if key in keys or key[:5] == "walls"])
            named, there = setup.scenario.named_stages, change.concerns_stage
            stages = {table: stage for table, stage in named.items() if there(_stage_faults, table)}
            refuse(setup, stages, [check for check in CHECKS if change.concerns(check)])
            if change.concerns(_effects):
                _refuse_more_effects(base, setup, place)
    except InputError as error:
        raise InputError(error.faults, place) from None
    return setup


def _check_fit(setup: Setup) -> None:
    check_fit(setup.scenario, setup.nominal)


def _stage_faults(table: str, setup: Setup) -> list[Fault]:
    return faults_of_stage(table, setup.scenario.stage(table), setup)


def _effects(setup: Setup) -> np.ndarray:
    return setup.effects


_PARTS: dict[str, Callable[[Setup], Any]] = {
    "design": lambda setup: Design.of(setup.scenario, *task_inertias(setup.scenario, setup.nominal)),
    "contacts": lambda setup: contacts_of(setup.scenario, setup.plant.probe, setup.nominal),
}
"""The parts of a setup that follow from its scenario and its plant."""


def _refuse_more_effects(base: Setup, setup: Setup, place: str) -> None:
    there, now = dict(counted(base.effects)), dict(counted(setup.effects))
    wrong = f"{place} can't add an effect of the water, only change or remove one of the run; make a new Simulation"
    faults = [Fault(name, wrong) for name, n in now.items() if n > there.get(name, 0)]
    if now.get("nodes", 0) not in (0, there.get("nodes", 0)):
        faults = [Fault("tether.elements", f"{place} can't change the number of elements; make a new Simulation")]
    if faults:
        raise InputError(faults)


def _refuse_other_code(setup: Setup, scenario: Scenario, place: str) -> None:
    base, faults = setup.scenario, []
    if scenario.vehicle is not base.vehicle and scenario.vehicle != base.vehicle:
        keys = [key for key, value in vars(scenario.vehicle).items() if value != getattr(base.vehicle, key)]
        faults += [Fault(f"vehicle.{key}", f"{place} can't change the vehicle; make a new Simulation") for key in keys]
    if scenario.simulation.integrator != base.simulation.integrator:
        faults.append(Fault("simulation.integrator", f"{place} can't change the integrator; make a new Simulation"))
    if scenario.task.frame != base.task.frame:
        faults.append(Fault("task.frame", f"{place} can't change the frame of the task; make a new Simulation"))
    changed_tables = [name for name in CHOICES if getattr(scenario, name) is not getattr(base, name)]
    there = scenario.named_stages if changed_tables else {}
    faults += [
        Fault(f"{table}.name", f"{place} can't change a stage, only its settings; make a new Simulation")
        for table, new in there.items()
        if type(base.named_stages.get(table, new)) is not type(new)
    ]
    if len(scenario.effects) != len(base.effects):
        faults.append(Fault("effects", f"{place} can't add or remove an effect; make a new Simulation"))
    else:
        faults += [
            Fault(f"effects[{i}].at", f"{place} can't change the frame of an effect; make a new Simulation")
            for i, (new, old) in enumerate(zip(scenario.effects, base.effects, strict=True))
            if new.at != old.at
        ]
    if faults:
        raise InputError(faults)


def watched(setup: Setup, found: set[str]) -> Any:
    """A copy of a setup that notes in ``found`` the parts that are read of it."""
    tables = {f.name: getattr(setup.scenario, f.name) for f in dataclasses.fields(setup.scenario)}
    plain = {
        name: _noting(table, found, f"{name}.")
        for name, table in tables.items()
        if dataclasses.is_dataclass(table) and not isinstance(table, Stage)
    }
    scenario = _noting(setup.scenario, found, "", plain)
    return _noting(setup, found, "", {"scenario": scenario, "plant": setup.plant})


def _noting(value: Any, found: set[str], prefix: str, unnoted: dict[str, Any] | None = None) -> Any:
    """A copy of a dataclass, without its cached values, that notes which of its fields are read, but for fields whose
    values are given."""
    given, names = unnoted or {}, [f.name for f in dataclasses.fields(value)]
    copy = object.__new__(_noting_class(type(value), prefix, frozenset(names).difference(given)))
    fields = {name: getattr(value, name) for name in names} | given
    object.__getattribute__(copy, "__dict__").update(fields, _found=found)
    return copy


@functools.cache
def _noting_class(kind: Any, prefix: str, noted: frozenset[str]) -> type:
    read = object.__getattribute__

    def note(self: Any, part: str) -> None:
        read(self, "__dict__").get("_found", set()).add(part)  # a changed copy has none; who made it has read all

    def __getattribute__(self: Any, name: str) -> Any:
        if name in noted:
            note(self, prefix + name)
        elif name == "__dict__" and prefix:
            note(self, prefix[:-1])
        return read(self, name)

    def __eq__(self: Any, other: object) -> bool:
        names = [f.name for f in dataclasses.fields(kind)]
        return isinstance(other, kind) and all(getattr(self, name) == getattr(other, name) for name in names)

    methods: dict[str, Any] = {"__getattribute__": __getattribute__}
    if kind.__eq__ is not object.__eq__:
        methods |= {"__eq__": __eq__, "__hash__": kind.__hash__}
    return type(kind.__name__, (kind,), methods)
