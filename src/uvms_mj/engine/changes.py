"""The changes of a reset: overrides of a scenario whose plant and machine code stay as they are."""

import contextlib
import dataclasses
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from ..analysis.sampling import no_overflow, refuse
from ..analysis.setup import Setup, design_of
from ..control.design import ATTITUDE_KEYS
from ..control.task import TASK_KEYS
from ..errors import Fault, InputError
from ..plant.contacts import Contacts, contacts_of
from ..plant.settings import VehicleChoice
from ..scenario import STAGES, Scenario
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


def changed(base: Setup, current: Setup, overrides: Mapping[str, Any], place: str) -> tuple[Setup, frozenset[str]]:
    """``base`` with overrides by dotted keys, as :func:`.quantities.overrides_of` gives them, and what differs from it
    or from ``current``, the setup of the run before the reset: tables of the scenario, their dotted keys, and
    ``design`` for the design matrices.

    Raises:
        InputError: a key or value is invalid, or needs another plant or other machine code. ``place`` is the caller's
            name in the message.
    """
    try:
        scenario = _updated(base.scenario, overrides)
        found = _differences(vars(scenario), vars(base.scenario), vars(current.scenario))
        design, redesigned = base.design, not found.isdisjoint(_DESIGN)
        touched = frozenset((*found, "design") if redesigned else found)
        if redesigned:
            with no_overflow(scenario) if "impedance" in touched else contextlib.nullcontext():
                design = design_of(scenario, base.nominal)
        contacts = base.contacts
        if not touched.isdisjoint(("wall", "walls", "bumper")):
            contacts = contacts_of(scenario, base.plant.probe, base.nominal)
            _refuse_other_contacts(base.contacts, contacts, overrides)
            if wrong := scenario.wall.overridden_in_vain(overrides):
                raise InputError(wrong)
        setup = Setup(scenario, base.plant, design, contacts)
        refuse(setup, touched)
    except InputError as error:
        raise InputError(error.faults, place) from None
    return setup, touched


def _updated(scenario: Scenario, overrides: Mapping[str, Any]) -> Scenario:
    """As :meth:`Scenario.updated`, but only the tables that have an override are made anew. Raises InputError if a key
    or value is invalid, or needs another plant or other machine code."""
    tables: dict[str, dict[str, Any]] = {}
    for key, value in overrides.items():
        table, _, word = key.partition(".")
        earlier = table == "controller" and word in TASK_KEYS and f"task.{word}" not in overrides
        tables.setdefault("task" if earlier else table, {})[word] = value
    try:
        if _OTHER_CODE.isdisjoint(overrides):
            return _with(scenario, {name: _replaced(getattr(scenario, name), new) for name, new in tables.items()})
    except (AttributeError, KeyError, TypeError, ValidationError, InputError):  # said in full, or a key of another kind
        pass
    full = scenario.updated(overrides)
    _refuse_other_code(scenario, full)
    old_and_new = ((name, getattr(scenario, name), getattr(full, name)) for name in _TABLES)
    return _with(scenario, {name: new for name, old, new in old_and_new if new != old})


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


def _differences(new: dict[str, Any], base: dict[str, Any], current: dict[str, Any]) -> set[str]:
    """The tables in which a scenario may differ from two others, and their dotted keys."""
    found = set()
    for name, table in new.items():
        if table is not base[name] or table is not current[name]:
            found.add(name)
            if hasattr(table, "__dict__"):
                one, two = vars(base[name]), vars(current[name])
                for key, value in vars(table).items():
                    a, b = one.get(key), two.get(key)
                    if (value is not a and value != a) or (value is not b and value != b):
                        found.add(f"{name}.{key}")
    return found


def _refuse_other_contacts(old: Contacts, new: Contacts, overrides: Mapping[str, Any]) -> None:
    if (len(old.surfaces), len(old.pairs), old.paper) != (len(new.surfaces), len(new.pairs), new.paper):
        keys = [key for key in overrides if key in ("wall.present", "bumper.stiffness") or key.startswith("walls")]
        wrong = "reset can't change which contacts there are; make a new Simulation"
        raise InputError([Fault(key, wrong) for key in keys])


def _refuse_other_code(base: Scenario, scenario: Scenario) -> None:
    faults = []
    if scenario.vehicle != base.vehicle:
        keys = [key for key, value in vars(scenario.vehicle).items() if value != getattr(base.vehicle, key)]
        faults += [Fault(f"vehicle.{key}", "reset can't change the vehicle; make a new Simulation") for key in keys]
    if scenario.simulation.integrator != base.simulation.integrator:
        faults.append(Fault("simulation.integrator", "reset can't change the integrator; make a new Simulation"))
    if scenario.task.frame != base.task.frame:
        faults.append(Fault("task.frame", "reset can't change the frame of the task; make a new Simulation"))
    faults += [
        Fault(f"{table}.name", "reset can't change a stage, only its settings; make a new Simulation")
        for table in STAGES
        if type(getattr(scenario, table)) is not type(getattr(base, table))
    ]
    if faults:
        raise InputError(faults)
