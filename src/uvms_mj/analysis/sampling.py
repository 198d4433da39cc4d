"""Checks of a run before its first step: errors, and warnings of a sampled loop that chatters or limit-cycles."""

from collections.abc import Container, Iterator

import numpy as np

from ..control.sampled import zeta_limit
from ..control.theory import stage_notes
from ..errors import Fault, InputError
from ..physics.dissipation import damping_notes
from ..scenario import Scenario
from ..stages.base import is_shipped
from .ranges import aliased
from .setup import Setup
from .wall import wall_faults, wall_notes

DEFAULT_LOG_RATE = 1000.0
_CHECKED = ("wall", "design", "simulation", "disturbance")


class SamplingWarning(UserWarning):
    """The controller chatters or limit-cycles at this time step or with these gains."""


def refuse(setup: Setup, touched: Container[str] = _CHECKED) -> None:
    """Raise for a scenario that cannot run. Only checks of the tables in ``touched``, or of the "design", are made.

    Raises:
        InputError: for example, the wall is too stiff for the time step, or a period is not a multiple of it.
    """
    scenario, faults = setup.scenario, list(_stage_faults(setup.scenario))
    if any(table in touched for table in ("wall", "design", "simulation")):
        faults += wall_faults(setup)
    if any(table in touched for table in ("disturbance", "simulation")):
        faults += aliased(scenario)
    if faults:
        raise InputError(faults, "scenario")


def warnings_of(setup: Setup) -> list[str]:
    """Warnings for a scenario that runs badly."""
    scenario, vehicle = setup.scenario, setup.vehicle
    notes = [
        *wall_notes(setup),
        *stage_notes(scenario.reference, setup),
        *_sampling_notes(setup),
        *stage_notes(scenario.controller, setup),
    ]
    rank = np.linalg.matrix_rank(vehicle.B)
    if rank < 6:
        notes.append(
            f"the {len(vehicle.thrusters)} thrusters of {vehicle.body} span {rank} of 6 axes: "
            "tau is the wrench closest to tau_cmd that they can produce"
        )
    return notes + damping_notes(vehicle.body, vehicle.D_linear, vehicle.D_quadratic)


def _stage_faults(scenario: Scenario) -> Iterator[Fault]:
    if scenario.controller.uses_truth and not is_shipped(scenario.controller):
        yield Fault("controller.uses_truth", "is reserved for ideal, the yardstick law")
    h = scenario.simulation.timestep
    for stage in scenario.stages:
        period = stage.period
        if period is not None and (round(period / h) < 1 or abs(period / h - round(period / h)) > 1e-6):
            n = max(1, int(period / h))
            nearest = f"the nearest are {n * h:g} and {(n + 1) * h:g} s"
            yield Fault(
                f"{stage.room.table}.period", f"{period:g} s is not a multiple of the time step {h:g} s; {nearest}"
            )


def _sampling_notes(setup: Setup) -> Iterator[str]:
    """Warnings for any law that uses the task: a zeta that grows."""
    period = setup.scenario.control_period
    if setup.scenario.controller.uses_task and period > (limit := zeta_limit(setup)):
        yield (
            f"zeta, and with it s, grows without bound at a control period of {period:g} s: A = "
            f"{min(setup.task.A):g} 1/s in eq. (15) needs a period of at most {limit:.4g} s"
        )


def row_steps_of(timestep: float, log_rate: float | str | None) -> int:
    """Number of time steps between recorded rows.

    Args:
        timestep: [s].
        log_rate: [Hz], or "full" for every step, or None for the rate nearest to 1 kHz that divides the step rate.

    Raises:
        InputError: the rate does not divide the step rate; the message gives the nearest rates that do.
    """
    step_rate = 1.0 / timestep
    if log_rate is None:
        return max(1, round(step_rate / DEFAULT_LOG_RATE))
    if log_rate == "full":
        return 1
    try:
        rate = float(log_rate)
    except ValueError:
        rate = -1.0
    if not 1e-9 < rate < np.inf:
        raise InputError(f"log rate {log_rate!r}: must be a number of samples per second, or 'full'")
    row_steps = max(1, round(step_rate / rate))
    if abs(row_steps * rate - step_rate) > 1e-6 * step_rate:
        above = max(1, int(step_rate / rate))
        neighbours = f"{step_rate / (above + 1):.12g} and {step_rate / above:.12g} Hz"
        if rate > step_rate:
            neighbours = f"{step_rate:.6g} Hz, or 'full'"
        raise InputError(
            f"log rate {rate:g} Hz: must divide the step rate {step_rate:.6g} Hz; the nearest are {neighbours}"
        )
    return row_steps
