"""Checks of a whole run before its first step: what is refused, and where the sampled loop itself would chatter."""

from collections.abc import Iterator

import numpy as np

from .contact_checks import wall_faults, wall_notes
from .control import Fosm, Gsta, Ideal, Impedance, Sta
from .control.loader import has_built_in_law
from .design import Design
from .dissipation import damping_notes
from .faults import Fault, InputError
from .ranges import aliased
from .scenario import Scenario
from .vehicle import Vehicle

DEFAULT_LOG_RATE = 1000.0


class SamplingWarning(UserWarning):
    """The law chatters or limit-cycles, at this step or with these gains."""


def check(scenario: Scenario, vehicle: Vehicle, design: Design, reach: float) -> list[str]:
    """Refuse what can't run; return warnings for what runs badly.

    Args:
        scenario: of the run.
        vehicle: of the run.
        design: of the two.
        reach: distance of the contact point from B's origin [m].

    Raises:
        InputError: the wall is too stiff for the step, or the control period is not a multiple of it.
    """
    h = scenario.simulation.timestep
    faults = list(wall_faults(scenario, design, reach))
    if scenario.controller.uses_truth and not has_built_in_law(scenario.controller):
        faults.append(Fault("controller.uses_truth", "is for the yardstick, ideal, alone"))
    faults += aliased(scenario)
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
    notes = [*wall_notes(scenario, design, reach), *_sampling(scenario, vehicle, design)]
    rank = np.linalg.matrix_rank(vehicle.B)
    if rank < 6:
        notes.append(
            f"the {len(vehicle.thrusters)} thrusters of {vehicle.body} span {rank} of 6 axes: "
            "tau is the nearest that they can give to tau_cmd"
        )
    return notes + damping_notes(vehicle.body, vehicle.D_linear, vehicle.D_quadratic)


def force_feedback_limit(scenario: Scenario, design: Design) -> float:
    """The greatest mean age of the fed back contact force at which the contact stays damped [s]; see :func:`force_age`.

    Against a spring k_c a force of age T is negative damping of k_c T for each newton that is fed back. The sliding
    mode laws impose M_d, D_d whatever the vehicle, so that D_d/(K_f k_c) is the limit along the normal. The impedance
    law and the ideal one feed back only the part M M_d^-1 K_f - I, which is inertia shaping, eq. (4): where M_d < M it
    costs (M/M_d - 1) k_c T, and they have M/M_d D_d to pay with. With G the matrix before D_d v in v_dot, the vibration
    against a stiff wall is along v = G K_f n, and what damps it n^T G D_d v / n^T v.
    """
    n, k_c = design.normal, scenario.wall.stiffness
    answers_itself = isinstance(scenario.controller, Impedance | Ideal)  # to the contact force, through its own M
    M_hat = design.M_hat if isinstance(scenario.controller, Impedance) else design.M
    G = np.linalg.solve(design.M, M_hat @ np.linalg.inv(design.M_d)) if answers_itself else np.linalg.inv(design.M_d)
    v = G @ (np.array(scenario.impedance.K_f) * n)
    fed_back = float(n @ v) - (1.0 / design.along_normal(design.M) if answers_itself else 0.0)
    if n @ v <= 0.0 or fed_back <= 1e-9 * n @ v:
        return np.inf
    return float(n @ G @ design.D_d @ v) / float(n @ v) / (fed_back * k_c)


def force_age(scenario: Scenario) -> float:
    """The mean age of the contact force in tau against that in the contact itself [s].

    The law gets the force of the same instant, and tau is held for a control period T: T/2. The contact force itself is
    held for a time step h: h/2. A law that runs at every step feeds back what acts.
    """
    return 0.5 * (control_period(scenario) - scenario.simulation.timestep)


def bouncing_growth(scenario: Scenario, vehicle: Vehicle, design: Design) -> float:
    """How fast super-twisting would feed a vibration against the wall [1/s], at the amplitude of s where it does most.

    The nominal control makes the vehicle answer to a contact force with g = M_hat/M of what M_d asks for; without it,
    with M_d/M. Where that is too little, super-twisting has to bring in the rest at the contact's frequency. For an
    amplitude S, phi_1 and phi_2 have the slopes a = k_1 (S^(-1/2) + beta) and b = k_2 (1/(2 S) + 3/2 beta S^(-1/2)
    + beta^2). With K_c = k_c n n^T along the wall's normal, about the rest and for the translation alone,

        v_des_dot = -M_d^-1 ((K_f K_c + K_d) x + D_d v),    s_dot = A s + v_dot - v_des_dot,    z_dot = -b s,
        v_dot = g (v_des_dot - A s - a s + z), or without nominal control  -M^-1 (K_c x + D v) + g (z - a s).

    Positive, it says that a vibration grows which begins large enough; a small one dies out always.
    """
    law = scenario.controller
    if not isinstance(law, Gsta | Sta):
        return -np.inf
    M, M_d, D_d, K_d = (each[:3, :3] for each in (design.M, design.M_d, design.D_d, design.K_d))
    g, beta, n = scenario.estimates.inertia, getattr(law, "beta", 0.0), design.normal[:3]
    K_c, K_f, A = scenario.wall.stiffness * np.outer(n, n), np.diag(scenario.impedance.K_f[:3]), np.diag(law.A[:3])
    zero, one = np.zeros((3, 3)), np.eye(3)
    desired = np.hstack([-np.linalg.solve(M_d, np.hstack([K_f @ K_c + K_d, D_d])), zero, zero])
    free = np.hstack([-np.linalg.solve(M, np.hstack([K_c, vehicle.D_linear[:3, :3]])), zero, zero])
    growing = np.hstack([zero, zero, A, zero])  # A s
    growth = []
    for S in _AMPLITUDES:
        a, b = law.k_1 * (S**-0.5 + beta), law.k_2 * (0.5 / S + 1.5 * beta * S**-0.5 + beta**2)
        u = g * np.hstack([zero, zero, -a * one, one])
        v_dot = g * (desired - growing) + u if getattr(law, "nominal", True) else free + u
        x_dot, z_dot = np.hstack([zero, one, zero, zero]), np.hstack([zero, zero, -b * one, zero])
        growth.append(np.linalg.eigvals(np.vstack([x_dot, v_dot, growing + v_dot - desired, z_dot])).real.max())
    return float(max(growth))


_AMPLITUDES = np.geomspace(1e-5, 2e-2, 30)
"""Of s [m/s], up to what an impact at some decimetres a second brings about."""


SLOWLY_DAMPED = 0.75
"""Where more than this part of the damping against the wall is lost, a vibration lasts for many seconds."""


_FASTEST = 0.5
"""A reference filter with more than this of a radian in a control period is not seen as a motion."""


_GROWS = 1e-3
"""Growth that is more than rounding [1/s]."""


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


def _sampling(scenario: Scenario, vehicle: Vehicle, design: Design) -> Iterator[str]:
    controller, h = scenario.controller, control_period(scenario)
    if scenario.reference.bandwidth * h > _FASTEST:
        yield (
            f"the reference is a jump for the law: with reference.bandwidth = {scenario.reference.bandwidth:g} rad/s "
            f"it is over within a few control periods of {h:g} s; less than {_FASTEST / h:g} rad/s shows"
        )
    if not has_built_in_law(controller):
        return
    if isinstance(controller, Fosm) and h >= (limit := boundary_layer_limit(controller, design)):
        yield (
            f"{controller.label()} chatters at a control period of {h:g} s: K_s = {controller.K_s:g} and "
            f"epsilon = {controller.epsilon:g} need less than {limit:.4g} s"
        )
    limit, age = force_feedback_limit(scenario, design), force_age(scenario)
    if age > SLOWLY_DAMPED * limit or (age == limit == 0.0):
        longest = 2.0 * limit + scenario.simulation.timestep
        what = "limit-cycles against the wall" if age >= limit else "hardly damps the vibration against the wall"
        yield (
            f"{controller.label()} {what} at a control period of {h:g} s: it holds the contact force for so long that "
            f"{min(1.0, age / limit) if limit else 1.0:.0%} of the damping D_d is lost at wall.stiffness "
            f"{scenario.wall.stiffness:g} N/m; all is lost at a period of {longest:.4g} s"
        )
    if bouncing_growth(scenario, vehicle, design) > _GROWS:
        yield (
            f"{controller.label()} may bounce or swing against the wall without end: with these gains and estimates, "
            "what it brings in of the contact force comes too late"
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
