"""Checks of a run before its first step: the setup of a scenario, or of the scenario of a run with overrides, that was
checked whole; and warnings of a sampled loop that chatters or limit-cycles."""

import contextlib
import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from ..control.delay import delay_faults
from ..control.design import Design
from ..control.posture import posture_faults, posture_notes
from ..control.theory.predictions import stage_notes
from ..control.theory.stability import zeta_limit
from ..errors import Fault, InputError
from ..physics.flow import FINEST
from ..plant.build import check_fit, task_inertias
from ..plant.contacts import contacts_of
from ..plant.mjcf import Mjcf
from ..plant.vehicle import AXES, notes_on_damping
from ..plant.water import Current, Disturbance
from ..quantities import leaves, radians_notes
from ..scenario import STAGES, Scenario
from .base import Setup, set_up
from .free_motion import free_motion_notes
from .task_frame import task_faults, task_notes
from .wall import wall_faults, wall_notes

_SMALL, _LARGE = 1e-6, 1e8
"""If an equation overflows, the message names the keys with numbers outside this range."""


class SamplingWarning(UserWarning):
    """The controller chatters or limit-cycles at this time step or with these gains."""


def checked(scenario: Scenario, mjcf: Mjcf | None = None) -> Setup:
    """Check a scenario and its stages, and build its plant and its design. The arguments are those of
    :func:`.base.set_up`. Raises InputError if the scenario cannot run."""
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


@contextlib.contextmanager
def no_overflow(scenario: Scenario) -> Iterator[None]:
    """Name the keys with extreme values if an equation of the design has no finite result.

    Raises:
        InputError: in place of NumPy's exception.
    """
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            yield
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        extreme = [
            Fault(key, f"{value:g} is too {'large' if abs(value) > 1.0 else 'small'} relative to the other numbers")
            for key, value in leaves(dataclasses.asdict(scenario))
            if isinstance(value, int | float) and value and not _SMALL <= abs(value) <= _LARGE
        ]
        what = f"an equation of the design has no finite result: {error}"
        raise InputError(extreme or [Fault("", what)], what if extreme else "scenario") from None


def refuse(setup: Setup) -> None:
    """Raise for a scenario that cannot run.

    Raises:
        InputError: for example, the wall is too stiff for the time step, or a period is not a multiple of it.
    """
    stages = [getattr(setup.scenario, table) for table in STAGES]
    faults = [fault for stage in stages if stage.runs for fault in stage.faults(setup)]
    for check in (_timing_faults, task_faults, wall_faults, _water_faults, posture_faults):
        faults += check(setup)
    if faults:
        raise InputError(faults, "scenario")


def warnings_of(setup: Setup) -> list[str]:
    """Warnings for a scenario that runs badly. Raises InputError if numbers are so extreme that an equation
    overflows."""
    scenario, vehicle = setup.scenario, setup.vehicle
    with no_overflow(scenario):
        notes = [
            *wall_notes(setup),
            *stage_notes(scenario.reference, setup),
            *_sampling_notes(setup),
            *posture_notes(setup),
            *task_notes(setup),
            *free_motion_notes(setup),
            *stage_notes(scenario.controller, setup),
        ]
    rank = np.linalg.matrix_rank(vehicle.B)
    if rank < 6:
        n = len(vehicle.thrusters)
        thrusters = f"the {n} thrusters of {vehicle.body} span" if n > 1 else f"the thruster of {vehicle.body} spans"
        missing = [axis for axis, row in zip(AXES, vehicle.B, strict=True) if np.abs(row).max(initial=0.0) < 1e-12]
        without = f", none gives {' or '.join(missing)}" if missing else ""
        notes.append(
            f"{thrusters} {rank} of 6 axes{without}: tau is the wrench closest to tau_cmd that they can produce"
        )
    return [*radians_notes(scenario.to_dict()), *notes, *notes_on_damping(vehicle)]


def _timing_faults(setup: Setup) -> Iterator[Fault]:
    scenario = setup.scenario
    h = scenario.simulation.timestep
    for stage in scenario.stages:
        period = stage.period
        if period is not None and (round(period / h) < 1 or abs(period / h - round(period / h)) > 1e-6):
            n = max(1, int(period / h))
            nearest = f"the nearest are {n * h:g} and {(n + 1) * h:g} s"
            yield Fault(
                f"{stage.room.table}.period", f"{period:g} s is not a multiple of the time step {h:g} s; {nearest}"
            )
    yield from delay_faults(scenario)


def _water_faults(setup: Setup) -> Iterable[Fault]:
    scenario = setup.scenario
    return water_faults(scenario.current, scenario.disturbance, scenario.simulation.timestep)


def _sampling_notes(setup: Setup) -> Iterator[str]:
    """Warnings for any law that uses the task: a zeta that grows."""
    period = setup.scenario.control_period
    if setup.scenario.controller.uses_task and period > (limit := zeta_limit(setup)):
        yield (
            f"zeta, and with it s, grows without bound at a control period of {period:g} s: A = "
            f"{min(setup.task.A):g} 1/s in eq. (15) needs a period of at most {limit:.4g} s"
        )


def water_faults(current: Current, disturbance: Disturbance, h: float) -> list[Fault]:
    """Errors for a motion of the water that a time step h [s] does not resolve, or that has no effect."""
    faults = []
    for name, motion in (("current", current), ("disturbance", disturbance)):
        for i, f in enumerate(motion.frequency_hz):
            if f * h >= 0.5 * (1.0 - 1e-9):
                wrong = (
                    f"{f:.12g} Hz must be below half the step rate, {0.5 / h:.6g} Hz: sampled every {h:g} s it would "
                    f"act as {abs(f - round(f * h) / h):.6g} Hz"
                )
                faults.append(Fault(f"{name}.frequency_hz[{i}]", wrong))
        if any(motion.deviation) and motion.spacing < h * (1.0 - 1e-9):
            wrong = f"{motion.correlation_time:g} s must be at least {FINEST * h:g} s, {FINEST:g} time steps"
            faults.append(Fault(f"{name}.correlation_time", wrong))
    gust, whole = current.shortest_gust, current.correlation_time
    if gust is not None and not whole / FINEST * (1.0 - 1e-9) <= gust <= whole * (1.0 + 1e-9):
        wrong = f"{gust:g} s must be from {whole / FINEST:g} to {whole:g} s at current.correlation_time {whole:g} s"
        faults.append(Fault("current.shortest_gust", wrong))
    for i, (amplitude, f) in enumerate(zip(current.amplitude, current.frequency_hz, strict=True)):
        if amplitude != 0.0 and f == 0.0:
            faults.append(Fault(f"current.amplitude[{i}]", f"{amplitude:g} m/s has no effect at the frequency 0 Hz"))
    times = [row[0] for row in current.table or ()]
    for i, (before, after) in enumerate(itertools.pairwise(times)):
        if after - before < h * (1.0 - 1e-9):
            wrong = (
                f"{after:g} s is less than a time step, {h:g} s, after the row before it: the acceleration of the "
                "water would act for a whole step or not at all"
            )
            faults.append(Fault(f"current.table[{i + 1}]", wrong))
    return faults
