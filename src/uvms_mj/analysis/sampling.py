"""Checks of a run before its first step: errors, and warnings of a sampled loop that chatters or limit-cycles."""

from collections.abc import Container, Iterator

import numpy as np

from ..control import Controller, Fosm, Gsta, Ideal, Impedance, Sta
from ..control.design import Design
from ..errors import Fault, InputError
from ..physics.dissipation import damping_notes
from ..plant.vehicle import Vehicle
from ..scenario import Scenario
from ..stages.base import is_shipped
from .ranges import aliased
from .setup import Setup
from .wall import wall_faults, wall_notes

DEFAULT_LOG_RATE = 1000.0
_ALL = ("wall", "design", "simulation", "disturbance")


class SamplingWarning(UserWarning):
    """The controller chatters or limit-cycles at this time step or with these gains."""


def refuse(setup: Setup, touched: Container[str] = _ALL) -> None:
    """Raise for a scenario that cannot run.

    Args:
        setup: the scenario, its vehicle and the design.
        touched: tables of the scenario, or "design", to which the checks are limited.

    Raises:
        InputError: for example, the wall is too stiff for the time step, or a period is not a multiple of it.
    """
    scenario = setup.scenario
    faults = []
    if any(table in touched for table in ("wall", "design", "simulation")):
        faults += wall_faults(scenario, setup.design, setup.reach)
    if scenario.controller.uses_truth and not is_shipped(scenario.controller):
        faults.append(Fault("controller.uses_truth", "is reserved for ideal, the yardstick law"))
    if any(table in touched for table in ("disturbance", "simulation")):
        faults += aliased(scenario)
    faults += _period_faults(scenario)
    if faults:
        raise InputError(faults, "scenario")


def _period_faults(scenario: Scenario) -> Iterator[Fault]:
    h = scenario.simulation.timestep
    for stage in scenario.stages:
        period = getattr(stage, "period", None)
        if period is not None and (round(period / h) < 1 or abs(period / h - round(period / h)) > 1e-6):
            n = max(1, int(period / h))
            yield Fault(
                f"{stage.room.table}.period",
                f"{period:g} s is not a multiple of the time step {h:g} s; "
                f"the nearest are {n * h:g} and {(n + 1) * h:g} s",
            )


def notes(setup: Setup) -> list[str]:
    """Warnings for a scenario that runs badly."""
    scenario, vehicle, design = setup.scenario, setup.vehicle, setup.design
    notes = [*wall_notes(scenario, design, setup.reach), *_sampling(scenario, vehicle, design)]
    rank = np.linalg.matrix_rank(vehicle.B)
    if rank < 6:
        notes.append(
            f"the {len(vehicle.thrusters)} thrusters of {vehicle.body} span {rank} of 6 axes: "
            "tau is the wrench closest to tau_cmd that they can produce"
        )
    return notes + damping_notes(vehicle.body, vehicle.D_linear, vehicle.D_quadratic)


def force_feedback_limit(scenario: Scenario, design: Design) -> float:
    """Largest mean age of the fed back contact force at which the contact stays damped [s]; see :func:`force_age`.

    Against a spring k_c, feedback of the contact force with unit gain and age T acts as a negative damping k_c T. The
    sliding mode laws impose M_d and D_d on any vehicle: their limit along the normal is D_d/(K_f k_c). The laws
    impedance and ideal feed back only M M_d^-1 K_f - I, which is inertia shaping, eq. (4): for M_d < M this takes
    (M/M_d - 1) k_c T from a damping of M/M_d D_d. With G the matrix before D_d v in v_dot, the vibration against a
    stiff wall is along v = G K_f n, and its damping is n^T G D_d v / n^T v.
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
    """Mean age of the contact force in tau relative to the force in the contact itself [s].

    The law gets the force of the same instant. tau is held for a control period T, a mean age of T/2. The contact
    force itself is held for a time step h, a mean age of h/2. A law that runs at every step feeds back the force
    that acts.
    """
    return 0.5 * (control_period(scenario) - scenario.simulation.timestep)


def held_growth(scenario: Scenario, design: Design) -> float:
    """Growth per control period of a vibration against the wall under a held impedance or ideal law [1].

    Along the vibration of :func:`force_feedback_limit`, between two control instants

        a = -w^2 x + u_k,    u_k = -(G K_d + fed back k_c) x_k - G D_d v_k,    w^2 = k_c n^T M^-1 n,

    which symplectic Euler takes over the steps of a period: the spectral radius of Phi + Gamma (du/dx, du/dv). Above 1
    the vibration grows. The hold of D_d alone has this effect if the contact makes half a vibration in a period. The
    growth is 0 for other laws.
    """
    if not isinstance(scenario.controller, Impedance | Ideal):
        return 0.0
    h = scenario.simulation.timestep
    n, k_c = design.normal, scenario.wall.stiffness
    M_hat = design.M_hat if isinstance(scenario.controller, Impedance) else design.M
    G = np.linalg.solve(design.M, M_hat @ np.linalg.inv(design.M_d))
    v = G @ (np.array(scenario.impedance.K_f) * n)
    if n @ v <= 0.0:
        return 0.0
    compliance = 1.0 / design.along_normal(design.M)
    gain_x = float(n @ G @ design.K_d @ v) / float(n @ v) + (float(n @ v) - compliance) * k_c
    gain_v = float(n @ G @ design.D_d @ v) / float(n @ v)
    stiff = h * k_c * compliance  # h w^2
    step, force = np.array([[1.0 - h * stiff, h], [-stiff, 1.0]]), np.array([h * h, h])
    free = np.linalg.matrix_power(step, round(control_period(scenario) / h))
    forced = np.linalg.solve(np.eye(2) - step, (np.eye(2) - free) @ force)
    return float(np.abs(np.linalg.eigvals(free - np.outer(forced, [gain_x, gain_v]))).max())


def zeta_limit(controller: Controller) -> float:
    """Control period above which the explicit Euler steps of zeta, eq. (15), grow: |1 + A T| > 1 [s]."""
    fastest = max(abs(a) for a in controller.A)
    return 2.0 / fastest if fastest > 0.0 else np.inf


def bouncing_growth(scenario: Scenario, vehicle: Vehicle, design: Design) -> float:
    """Largest growth rate, over the amplitude of s, of a vibration against the wall under super-twisting [1/s].

    With the nominal control, the vehicle's response to a contact force is g = M_hat/M times the one that M_d
    prescribes; without it, M_d/M times. If this is too small, super-twisting has to supply the rest at the contact's
    frequency. For an amplitude S, phi_1 and phi_2 have the slopes a = k_1 (S^(-1/2) + beta) and
    b = k_2 (1/(2 S) + 3/2 beta S^(-1/2) + beta^2). With K_c = k_c n n^T along the wall's normal, linearized at rest
    and for translation only,

        v_des_dot = -M_d^-1 ((K_f K_c + K_d) x + D_d v),    s_dot = A s + v_dot - v_des_dot,    z_dot = -b s,
        v_dot = g (v_des_dot - A s - a s + z), or without nominal control  -M^-1 (K_c x + D v) + g (z - a s).

    A positive value means that a vibration grows if it begins large enough; a small one always decays.
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
"""Amplitudes of s [m/s]. The largest is that of an impact at a few decimetres per second."""


SLOWLY_DAMPED = 0.75
"""If more than this fraction of the damping against the wall is lost, a vibration lasts for many seconds."""


_FASTEST = 0.5
"""Largest bandwidth times control period [rad] at which the law sees the reference as a motion, not as a jump."""


_GROWS = 1e-3
"""A growth rate above this is more than rounding [1/s]."""


def boundary_layer_limit(controller: Fosm, design: Design) -> float:
    """Largest control period at which the first-order law does not chatter inside its boundary layer [s].

    In the layer, s_dot = -(M^-1 M_hat K_s/epsilon - A) s + ... With explicit sampling this is stable if the period is
    below 2 divided by the fastest rate.
    """
    gain = np.linalg.solve(design.M, design.M_hat) * controller.K_s / controller.epsilon
    rate = float(np.abs(np.linalg.eigvals(gain - np.diag(controller.A))).max())
    return 2.0 / rate if rate > 0 else np.inf


def control_period(scenario: Scenario) -> float:
    """Time between control instants [s]."""
    return scenario.controller.period or scenario.simulation.timestep


def _sampling(scenario: Scenario, vehicle: Vehicle, design: Design) -> Iterator[str]:
    controller, h = scenario.controller, control_period(scenario)
    if scenario.reference.bandwidth * h > _FASTEST:
        yield (
            f"the law sees the reference as a jump: with reference.bandwidth = {scenario.reference.bandwidth:g} rad/s "
            f"it ends within a few control periods of {h:g} s; choose less than {_FASTEST / h:g} rad/s"
        )
    if h > (limit := zeta_limit(controller)):
        yield (
            f"zeta, and with it s, grows without bound at a control period of {h:g} s: A = {min(controller.A):g} 1/s "
            f"in eq. (15) needs a period of at most {limit:.4g} s"
        )
    if not is_shipped(controller):
        return
    if held_growth(scenario, design) > 1.0:
        yield (
            f"{controller.label()} oscillates against the wall at a control period of {h:g} s: at wall.stiffness "
            f"{scenario.wall.stiffness:g} N/m the contact vibrates faster than a held command can damp; a period below "
            f"{2.5 / np.sqrt(scenario.wall.stiffness / design.along_normal(design.M)):.2g} s usually suffices"
        )
    if isinstance(controller, Fosm) and h >= (limit := boundary_layer_limit(controller, design)):
        yield (
            f"{controller.label()} chatters at a control period of {h:g} s: K_s = {controller.K_s:g} and "
            f"epsilon = {controller.epsilon:g} need a period below {limit:.4g} s"
        )
    limit, age = force_feedback_limit(scenario, design), force_age(scenario)
    if age > SLOWLY_DAMPED * limit or (age == limit == 0.0):
        longest = 2.0 * limit + scenario.simulation.timestep
        what = "limit-cycles against the wall" if age >= limit else "hardly damps the vibration against the wall"
        yield (
            f"{controller.label()} {what} at a control period of {h:g} s: it holds the contact force so long that "
            f"{min(1.0, age / limit) if limit else 1.0:.0%} of the damping D_d is lost at wall.stiffness "
            f"{scenario.wall.stiffness:g} N/m; all is lost at a period of {longest:.4g} s"
        )
    if bouncing_growth(scenario, vehicle, design) > _GROWS:
        yield (
            f"{controller.label()} may bounce or oscillate against the wall without end: with these gains and "
            "estimates it compensates the contact force too late"
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
