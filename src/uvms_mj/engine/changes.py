"""The changes of a reset: overrides of a scenario whose plant and machine code stay as they are."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from ..analysis.ranges import no_overflow
from ..analysis.sampling import refuse
from ..analysis.setup import Setup, design_of
from ..errors import Fault, InputError
from ..quantities import overrides_of
from ..scenario import STAGES, Scenario

_TABLES = [field.name for field in dataclasses.fields(Scenario)]


def changed(base: Setup, current: Setup, overrides: Mapping[str, Any], place: str) -> tuple[Setup, frozenset[str]]:
    """As :func:`_changed`; ``place`` is the caller's name in messages."""
    try:
        return _changed(base, current, overrides)
    except InputError as error:
        raise InputError(error.faults, place) from None


def _changed(base: Setup, current: Setup, overrides: Mapping[str, Any]) -> tuple[Setup, frozenset[str]]:
    """``base`` with overrides by dotted keys, and what differs from it or from ``current``, the setup of the run before
    the reset: tables of the scenario, ``seed`` if nothing else of ``simulation`` differs, and ``design`` if the design
    matrices differ. Raises InputError if a key or value is invalid, or needs another plant or other machine code."""
    scenario = _updated(base.scenario, overrides_of(overrides))
    _refuse_other_code(base.scenario, scenario)
    before, now = current.scenario, base.scenario
    tables, old, oldest = scenario.__dict__, before.__dict__, now.__dict__
    touched = {name for name in _TABLES if tables[name] is not old[name] or tables[name] is not oldest[name]}
    if "simulation" in touched and _stepping(scenario) == _stepping(before) == _stepping(now):
        touched = touched - {"simulation"} | {"seed"}
    design = base.design
    if _design_inputs(scenario) != _design_inputs(base.scenario):
        with no_overflow(scenario):
            design = design_of(scenario, base.nominal)
    if design is not base.design or design is not current.design:
        touched.add("design")
    setup = Setup(scenario, base.plant, design)
    if touched:
        refuse(setup, touched)
    return setup, frozenset(touched)


def _updated(scenario: Scenario, overrides: Mapping[str, Any]) -> Scenario:
    """As :meth:`Scenario.updated`, but only the tables that have an override are made anew."""
    tables: dict[str, dict[str, Any]] = {}
    for key, value in overrides.items():
        table, _, word = key.partition(".")
        tables.setdefault(table, {})[word] = value
    try:
        made = {}
        for name, values in tables.items():
            old = getattr(scenario, name)
            made[name] = type(old)(**(vars(old) | values))
        return _with(scenario, made)
    except (AttributeError, KeyError, TypeError, ValidationError, InputError):  # said in full, or a key of another kind
        full = scenario.updated(overrides)
    old_and_new = ((name, getattr(scenario, name), getattr(full, name)) for name in _TABLES)
    return _with(scenario, {name: new for name, old, new in old_and_new if new != old})


def _with(scenario: Scenario, tables: Mapping[str, Any]) -> Scenario:
    """A copy of a scenario with valid tables."""
    copy = object.__new__(Scenario)
    copy.__dict__.update(scenario.__dict__ | dict(tables))
    return copy


def _design_inputs(scenario: Scenario) -> tuple[Any, ...]:
    return scenario.impedance, scenario.estimates.inertia, scenario.reference.attitude_deg


def _stepping(scenario: Scenario) -> tuple[Any, ...]:
    table = scenario.simulation
    return table.timestep, table.duration, table.integrator


def _refuse_other_code(base: Scenario, scenario: Scenario) -> None:
    faults = []
    if scenario.vehicle != base.vehicle:
        keys = [key for key, value in vars(scenario.vehicle).items() if value != getattr(base.vehicle, key)]
        faults += [Fault(f"vehicle.{key}", "reset can't change the vehicle; make a new Simulation") for key in keys]
    if scenario.simulation.integrator != base.simulation.integrator:
        faults.append(Fault("simulation.integrator", "reset can't change the integrator; make a new Simulation"))
    faults += [
        Fault(f"{table}.name", "reset can't change a stage, only its settings; make a new Simulation")
        for table in STAGES
        if type(getattr(scenario, table)) is not type(getattr(base, table))
    ]
    if faults:
        raise InputError(faults)
