"""Checks of a whole run before its first step: what is refused, and where the sampled loop itself would chatter."""

from collections.abc import Iterator

import numpy as np

from .control import Fosm, Gsta, Ideal, Impedance, Sta
from .design import Design
from .faults import Fault, InputError
from .scenario import Scenario
from .vehicle import Vehicle

DEFAULT_LOG_RATE = 1000.0


class SamplingWarning(UserWarning):
    """The law chatters or limit-cycles at this step, whatever its gains do in continuous time."""


def check(scenario: Scenario, vehicle: Vehicle, design: Design) -> list[str]:
    """Refuse what can't run; return warnings for what runs badly.

    Raises:
        InputError: the step is beyond the wall's stability limit, or the control period is no multiple of it.
    """
    h, wall = scenario.simulation.timestep, scenario.wall
    faults = []
    if scenario.controller.uses_truth and not isinstance(scenario.controller, Ideal):
        faults.append(Fault("controller.uses_truth", "is for the yardstick, ideal, alone"))
    m = design.along_normal(design.M)
    limit = (np.sqrt(wall.damping**2 + 4.0 * wall.stiffness * m) - wall.damping) / wall.stiffness
    if h >= limit:  # h^2 k/m + 2 h b/m < 4
        faults.append(
            Fault(
                "simulation.timestep",
                f"{h:g} s is beyond the wall's stability limit, {limit:.4g} s for {wall.stiffness:g} N/m, "
                f"{wall.damping:g} N s/m and {m:.4g} kg: take a smaller step or a softer wall",
            )
        )
    period = scenario.controller.period
    if period is not None and (round(period / h) < 1 or abs(period / h - round(period / h)) > 1e-6):
        n = max(1, int(period / h))
        faults.append(
            Fault(
                "controller.period",
                f"{period:g} s is not a multiple of the time step {h:g} s; "
                f"next to it are {n * h:g} and {(n + 1) * h:g} s",
            )
        )
    if faults:
        raise InputError(faults, "scenario")
    notes = list(_sampling(scenario, design))
    rank = np.linalg.matrix_rank(vehicle.B)
    if rank < 6:
        notes.append(
            f"the {len(vehicle.thrusters)} thrusters of {vehicle.body} span {rank} of 6 axes: "
            "tau is the nearest that they can give to tau_cmd"
        )
    return notes


def force_feedback_limit(scenario: Scenario, design: Design) -> float:
    """The greatest control period at which feeding back a contact force one step old leaves the contact damped [s].

    Against a spring k_c an old force is negative damping of about k_c h for each newton that is fed back. The sliding
    mode laws impose M_d, D_d whatever the vehicle, so that D_d/(K_f k_c) is the limit along the normal. The impedance
    law and the ideal one feed back only the part M M_d^-1 K_f - I, which is inertia shaping, eq. (4): where M_d < M it
    costs (M/M_d - 1) k_c h, and they have M/M_d D_d to pay with.
    """
    n, k_c = design.normal, scenario.wall.stiffness
    D_d, K_f = float(n @ design.D_d @ n), float(n @ np.diag(scenario.impedance.K_f) @ n)
    if isinstance(scenario.controller, Impedance | Ideal):
        inertia = design.M if isinstance(scenario.controller, Ideal) else design.M_hat
        ratio = float(n @ inertia @ np.linalg.solve(design.M_d, n))
        return ratio * D_d / ((ratio * K_f - 1.0) * k_c) if ratio * K_f > 1.0 + 1e-9 else np.inf
    return D_d / (K_f * k_c) if K_f > 0.0 else np.inf


def boundary_layer_limit(controller: Fosm, design: Design) -> float:
    """The greatest control period at which the first-order law does not chatter inside its boundary layer [s].

    There s_dot = -(M^-1 M_hat K_s/epsilon - A) s + ..., which explicit sampling keeps stable for h below 2 over its
    fastest rate.
    """
    gain = np.linalg.solve(design.M, design.M_hat) * controller.K_s / controller.epsilon
    rate = float(np.abs(np.linalg.eigvals(gain - np.diag(controller.A))).max())
    return 2.0 / rate if rate > 0 else np.inf


def control_period(scenario: Scenario) -> float:
    """The time between control instants [s]."""
    return scenario.controller.period or scenario.simulation.timestep


def _sampling(scenario: Scenario, design: Design) -> Iterator[str]:
    controller, h = scenario.controller, control_period(scenario)
    if isinstance(controller, Fosm) and h >= (limit := boundary_layer_limit(controller, design)):
        yield (
            f"fosm chatters at a control period of {h:g} s: K_s = {controller.K_s:g} and "
            f"epsilon = {controller.epsilon:g} need less than {limit:.4g} s"
        )
    if isinstance(controller, Fosm | Gsta | Ideal | Impedance | Sta):
        limit = force_feedback_limit(scenario, design)
        if h >= limit:
            yield (
                f"{controller.label()} limit-cycles against the wall at a control period of {h:g} s: with a measured "
                f"force one step old, D_d and {scenario.wall.stiffness:g} N/m need less than {limit:.4g} s"
            )


def row_steps_of(timestep: float, log_rate: float | str | None) -> int:
    """Time steps from one recorded row to the next.

    Args:
        timestep: [s].
        log_rate: [Hz], or "full", or None for 1 kHz or the rate nearest to it that divides the step rate.

    Raises:
        InputError: the rate doesn't divide the step rate; the message names the neighbours that do.
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
        raise InputError(f"log rate {log_rate!r}: must be a number of samples a second, or 'full'")
    row_steps = max(1, round(step_rate / rate))
    if abs(row_steps * rate - step_rate) > 1e-6 * step_rate:
        above = max(1, int(step_rate / rate))
        neighbours = f"{step_rate / (above + 1):.12g} and {step_rate / above:.12g} Hz"
        if rate > step_rate:
            neighbours = f"{step_rate:.6g} Hz, or 'full'"
        raise InputError(
            f"log rate {rate:g} Hz: must divide the step rate {step_rate:.6g} Hz; next to it are {neighbours}"
        )
    return row_steps
