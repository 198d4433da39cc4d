"""The changes of a reset: overrides of a scenario whose plant and machine code stay as they are."""

import contextlib
import dataclasses
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from ..control.design import ATTITUDE_KEYS, Design, no_overflow
from ..errors import Fault, InputError
from ..plant.contacts import Contacts, contacts_of
from ..plant.fit import check_fit
from ..plant.inertia import task_inertias
from ..plant.settings import VehicleChoice, overridden_in_vain
from ..scenario import STAGES, Scenario
from ..setup.base import Setup
from ..setup.checks import refuse
from ..stages.base import Stage, is_of_the_package, validator

_TABLES = [field.name for field in dataclasses.fields(Scenario)]
_OTHER_CODE = {
    "simulation.integrator",
    "task.frame",
    *(f"vehicle.{field.name}" for field in dataclasses.fields(VehicleChoice)),
}
_DESIGN = (
    *("impedance.M_d", "impedance.D_d", "impedance.K_d", "impedance.damping_ratio"),
    *("estimates.inertia", "estimates.links", "initial.joints", *ATTITUDE_KEYS),
)


def changed(base: Setup, overrides: Mapping[str, Any], place: str) -> tuple[Setup, frozenset[str]]:
    """``base`` with overrides by dotted keys, as :func:`.quantities.overrides_of` gives them, and what they touch:
    tables of the scenario, their dotted keys, and ``design`` for the design matrices.

    Raises:
        InputError: a key or value is invalid, or needs another plant or other machine code. ``place`` is the caller's
            name in the message.
    """
    try:
        tables, touched = _tables(base.scenario, overrides, place)
        scenario, design, contacts = _with(base.scenario, tables), base.design, base.contacts
        if not touched.isdisjoint(_DESIGN):
            touched.add("design")
            with no_overflow(scenario) if "impedance" in touched else contextlib.nullcontext():
                check_fit(scenario, base.nominal)
                design = Design.of(scenario, *task_inertias(scenario, base.nominal))
        if not touched.isdisjoint(("wall", "walls", "bumper")):
            contacts = contacts_of(scenario, base.plant.probe, base.nominal)
            _refuse_other_contacts(base.contacts, contacts, overrides, place)
            if wrong := overridden_in_vain(scenario, overrides):
                raise InputError(wrong)
        setup, found = Setup(scenario, base.plant, design, contacts), frozenset(touched)
        refuse(setup, found)
    except InputError as error:
        raise InputError(error.faults, place) from None
    return setup, found


def _tables(scenario: Scenario, overrides: Mapping[str, Any], place: str) -> tuple[dict[str, Any], set[str]]:
    """The tables that overrides change, by name, and their names with the dotted keys of what is new. Only these tables
    are made anew. Raises InputError if a key or value is invalid, or needs another plant or other machine code."""
    given: dict[str, dict[str, Any]] = {}
    for key, value in overrides.items():
        table, _, word = key.partition(".")
        given.setdefault(table, {})[word] = value
    try:
        if _OTHER_CODE.isdisjoint(overrides):
            tables = {name: _replaced(getattr(scenario, name), new) for name, new in given.items()}
            return tables, {*given, *(f"{name}.{word}" for name, new in given.items() for word in new)}
    except (AttributeError, KeyError, TypeError, ValidationError, InputError):  # said in full, or a key of another kind
        pass
    full = scenario.updated(overrides)
    _refuse_other_code(scenario, full, place)
    old_and_new = ((name, getattr(scenario, name), getattr(full, name)) for name in _TABLES)
    differing = {name: (old, new) for name, old, new in old_and_new if new != old}
    keys = {
        f"{name}.{word}"
        for name, (old, new) in differing.items()
        for word, value in getattr(new, "__dict__", {}).items()
        if value != getattr(old, word)
    }
    return {name: new for name, (_, new) in differing.items()}, {*differing, *keys}


def _replaced(table: Any, values: dict[str, Any]) -> Any:
    """A copy of a table of a scenario with other values. Only these are validated, unless the class is a user's."""
    kind: Any = type(table)
    if isinstance(table, Stage) and not is_of_the_package(kind):
        return kind(**(vars(table) | values))
    copy = _with(table, validator(kind, tuple(values)).validate_python(values))
    if isinstance(table, Stage):
        copy.check_settings()
    return copy


def _with(old: Any, values: Mapping[str, Any]) -> Any:
    """A copy of a scenario or of one of its tables with valid values."""
    copy = object.__new__(type(old))
    vars(copy).update(vars(old) | values)
    return copy


def _refuse_other_contacts(old: Contacts, new: Contacts, overrides: Mapping[str, Any], place: str) -> None:
    of_old, of_new = ((len(each.surfaces), len(each.pairs), each.paper is None) for each in (old, new))
    if of_old != of_new:
        keys = [key for key in overrides if key in ("wall.present", "bumper.stiffness") or key.startswith("walls")]
        wrong = f"{place} can't change which contacts there are; make a new Simulation"
        raise InputError([Fault(key, wrong) for key in keys])


def _refuse_other_code(base: Scenario, scenario: Scenario, place: str) -> None:
    faults = []
    if scenario.vehicle != base.vehicle:
        keys = [key for key, value in vars(scenario.vehicle).items() if value != getattr(base.vehicle, key)]
        faults += [Fault(f"vehicle.{key}", f"{place} can't change the vehicle; make a new Simulation") for key in keys]
    if scenario.simulation.integrator != base.simulation.integrator:
        faults.append(Fault("simulation.integrator", f"{place} can't change the integrator; make a new Simulation"))
    if scenario.task.frame != base.task.frame:
        faults.append(Fault("task.frame", f"{place} can't change the frame of the task; make a new Simulation"))
    faults += [
        Fault(f"{table}.name", f"{place} can't change a stage, only its settings; make a new Simulation")
        for table in STAGES
        if type(getattr(scenario, table)) is not type(getattr(base, table))
    ]
    if faults:
        raise InputError(faults)
