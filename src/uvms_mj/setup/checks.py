"""Checks of a run before its first step: errors, and warnings of a sampled loop that chatters or limit-cycles."""

import functools
import itertools
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from ..control.design import ATTITUDE_KEYS, no_overflow
from ..control.posture import posture_faults, posture_notes
from ..control.theory.predictions import stage_notes
from ..control.theory.sampled import delay_faults, zeta_limit
from ..errors import Fault, InputError
from ..physics.varying import FINEST
from ..plant.vehicle import AXES, notes_on_damping
from ..plant.water import Current, Disturbance
from ..quantities import radians_notes
from ..scenario import STAGES
from ..stages.base import Stage
from .base import Setup
from .free_motion import free_motion_notes
from .task_frame import task_faults, task_notes
from .wall import wall_faults, wall_notes

_WALLS = ("wall", "walls", "bumper")
_EVERYTHING = frozenset({"simulation.timestep", "posture"})
_TIMING = ("simulation.timestep", "controller.delay", *(f"{table}.period" for table in STAGES))
_CONTACT = (*_WALLS, *ATTITUDE_KEYS, "simulation.timestep")
_WATER = ("current", "disturbance", "simulation.timestep")


class SamplingWarning(UserWarning):
    """The controller chatters or limit-cycles at this time step or with these gains."""


def refuse(setup: Setup, touched: frozenset[str] = _EVERYTHING) -> None:
    """Raise for a scenario that cannot run. Only checks of the tables and dotted keys in ``touched`` are made.

    Raises:
        InputError: for example, the wall is too stiff for the time step, or a period is not a multiple of it.
    """
    kinds = tuple([type(getattr(setup.scenario, table)) for table in STAGES])
    faults = [fault for check in _checks(touched, kinds) for fault in check(setup)]
    if faults:
        raise InputError(faults, "scenario")


@functools.lru_cache(maxsize=64)
def _checks(touched: frozenset[str], kinds: tuple[type[Stage], ...]) -> list[Callable[[Setup], Iterable[Fault]]]:
    """The checks that depend on ``touched``, in a scenario with stages of these classes."""
    of_stages = [
        ((*_TIMING, table, *(touched if kind.needs is None else kind.needs)), _stage_faults(table))
        for table, kind in zip(STAGES, kinds, strict=True)
        if kind.faults is not Stage.faults and kind.runs
    ]
    return [check for keys, check in (*of_stages, *_CHECKS) if not touched.isdisjoint(keys)]


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


def _stage_faults(table: str) -> Callable[[Setup], Iterable[Fault]]:
    return lambda setup: getattr(setup.scenario, table).faults(setup)


def _water_faults(setup: Setup) -> Iterable[Fault]:
    scenario = setup.scenario
    return water_faults(scenario.current, scenario.disturbance, scenario.simulation.timestep)


_CHECKS: tuple[tuple[tuple[str, ...], Callable[[Setup], Iterable[Fault]]], ...] = (
    (_TIMING, _timing_faults),
    (("simulation.timestep", "task"), task_faults),
    (_CONTACT, wall_faults),
    (_WATER, _water_faults),
    (("posture",), posture_faults),
)
"""Tables or dotted keys of a scenario, and the check that depends on them."""


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
