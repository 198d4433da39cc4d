"""The setup of a run that was checked whole: of a scenario, or of the scenario of a run with overrides."""

from collections.abc import Mapping
from typing import Any

from ..control.design import Design, no_overflow
from ..errors import Fault, InputError
from ..plant.contacts import contacts_of
from ..plant.fit import check_fit, task_inertias
from ..plant.mjcf import Mjcf
from ..scenario import STAGES, Scenario
from ..stages.loader import check_stage
from .base import Setup, set_up
from .checks import refuse


def checked(scenario: Scenario, mjcf: Mjcf | None = None) -> Setup:
    """Check a scenario and its stages, and build its plant and its design. The arguments are those of
    :func:`.base.set_up`. Raises InputError if the scenario cannot run."""
    for stage in scenario.stages:
        check_stage(stage)
    with no_overflow(scenario):
        setup = set_up(scenario, mjcf)
        refuse(setup)
    return setup


def changed(base: Setup, overrides: Mapping[str, Any], place: str) -> Setup:
    """``base`` with overrides by dotted keys, as :func:`uvms_mj.quantities.overrides_of` gives them.

    Raises:
        InputError: a key or value is invalid, or needs another plant or other machine code. ``place`` is the caller's
            name in the message.
    """
    try:
        scenario = base.scenario.updated(overrides)
        _refuse_other_code(base.scenario, scenario, place)
        with no_overflow(scenario):
            check_fit(scenario, base.nominal)
            design = Design.of(scenario, *task_inertias(scenario, base.nominal))
            contacts = contacts_of(scenario, base.plant.probe, base.nominal)
            if contacts.kinds != base.contacts.kinds:
                keys = [key for key in overrides if key in ("wall.present", "bumper.stiffness") or key[:5] == "walls"]
                wrong = f"{place} can't change which contacts there are; make a new Simulation"
                raise InputError([Fault(key, wrong) for key in keys])
            setup = Setup(scenario, base.plant, design, contacts)
            refuse(setup)
    except InputError as error:
        raise InputError(error.faults, place) from None
    return setup


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
