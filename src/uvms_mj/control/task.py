r"""The impedance task, and what changes its matrices on the way: a schedule, and the natural inertia.

**Task.** Most laws share the tracking errors and the impedance task. The paper's eqs. (14), (15), (21) and (23) share
one term, the acceleration of the desired impedance,

.. math::

    w = M_d^{-1} (K_d \tilde\eta + D_d \tilde\nu - K_f (\tau_c - F_d)),

with K_f and F_d of the generalised impedance, eq. (7). The impedance of eq. (12) has K_f = I and F_d = 0. F_d is the
desired wrench of the wall on the vehicle: to push on a wall in front, F_d along x is negative. With w and the gains of
eq. (21), eq. (15) becomes

.. math::

    \dot\zeta = A \zeta + F_2^{-1} (w + A' F_1 \tilde\eta + (A' - \bar F_1) \tilde\nu),

where :math:`A' = F_2 A F_2^{-1} = A` for diagonal matrices. The nominal control (23) becomes
:math:`\hat M (\dot\nu_d - w) - \tau_c + \hat C \nu + \hat D \nu + \hat g`.

**Schedule.** A hybrid of force and motion over time has K_f and F_d of eq. (7) by a schedule. From the time of an entry
on, K_f and F_d go to its values within its ramp, along :math:`10 x^3 - 15 x^4 + 6 x^5`, so that their first two
derivatives are continuous. Without a schedule they are constants, and this stage does not exist.

**Natural inertia.** With ``impedance.M_d = "natural"`` the task is classical impedance control without a force. With
M_d = M_hat the contact force cancels in the nominal control (23), as in the paper's eq. (4) with Lambda_des = Lambda:

.. math:: \tau_{nom} = \hat M \dot\nu_d + \hat C \nu + \hat D \nu + \hat g - K_d \tilde\eta - D_d \tilde\nu
    + (K_f - I) \tau_c - K_f F_d.

M_hat of a tool, Lambda_hat, changes with the posture of the arm, so the damping has to change with it. Ott (2008), sec.
3.3: with M_d = L L^T and the eigenvectors V of :math:`L^{-1} K_d L^{-T} = V \operatorname{diag}(k) V^\top`,

.. math:: D_d = 2 \zeta\, (L V) \operatorname{diag}(\sqrt{k})\, (L V)^\top,

gives every mode of the frozen system the damping ratio zeta. It is 2 zeta times the geometric mean of M_d and K_d.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic.dataclasses import dataclass as table

from ..errors import Fault, InputError
from ..physics.frames import BODY, cross, quat_error, to_body
from ..physics.kernels import kernel
from ..physics.linear_algebra import backward, cholesky, forward, symmetric_eigen
from ..quantities import STRICT, Factors, Step, Time, Wrench, refusing
from ..stages.base import Room, Stage, shared
from ..stages.setup import SetupLike
from ..stages.signals import CLOCK, IMPEDANCE, SCHEDULED, TASK, TASK_GIVEN
from .base import Diagonal

_NonzeroDiagonal = Annotated[Diagonal, refusing(lambda x: 0.0 in x, "must not have a zero: F_2 has to be invertible")]
_POSITIVE = "must not have a positive entry: A is negative semi-definite (eq. 8)"
_NegativeDiagonal = Annotated[Diagonal, refusing(lambda x: max(x) > 0.0, _POSITIVE)]


@dataclasses.dataclass(frozen=True)
class ImpedanceTask(Stage):
    """The impedance task: sliding variable s, state zeta and nominal control of the desired impedance."""

    period: Step | None = shared(None, "s", "must be omitted: the task runs at the control period")
    F_1: Diagonal = shared(1.0, "1/s", "gain of the pose error in s, eq. (14)")
    F_2: _NonzeroDiagonal = shared(1.0, "1", "gain of zeta in s, eq. (14)")
    A: _NegativeDiagonal = shared(-100.0, "1/s", "pole of zeta, eq. (15)")
    inertia_period: Step = shared(
        1e-3, "s", "with joints or a tool: time between two computations of M_hat, rounded to control periods"
    )
    frame: str = shared(BODY, "-", "frame of the task: body, or the name of a site of the vehicle, its tool")
    integral: bool = shared(False, "-", "true: s is M_d^-1 times the integral of eq. (6): A is 0, and s(0) is 0")

    name = "impedance_task"
    states: ClassVar = {"zeta": 6}
    units: ClassVar = {"zeta": "m/s, rad/s"}
    room: ClassVar[Room] = Room("control", "task", lambda thrusters: TASK_GIVEN, TASK, "task", "gain")

    def check_settings(self) -> None:
        super().check_settings()
        if self.period is not None:
            fault = Fault("task.period", f"{self.period!r} must be omitted: the task runs at controller.period")
            raise InputError([fault], "the gains of the task")
        if self.integral:  # with A = 0, eq. (20) integrates the impedance's residual
            if any(self.A) and self.A != (-100.0,) * 6:
                fault = Fault("task.A", f"{list(self.A)!r} must be 0 or omitted if integral is true")
                raise InputError([fault], "the gains of the task")
            object.__setattr__(self, "A", (0.0,) * 6)

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        own = {"M_d_inv": setup.design.M_d_inv, "natural": setup.scenario.impedance.natural}
        return {**super().constants(setup), "frame": None, "inertia_period": None, **own}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        """Set the signals :data:`uvms_mj.stages.signals.TASK` and zeta_dot, eq. (15) with the gains of eq. (21)."""
        eta_e, nu_e, w, zeta = given.eta_e, given.nu_e, out.w, state.zeta
        F_1, F_2, A = settings.F_1, settings.F_2, settings.A
        if settings.integral and given.instant == 0:
            zeta[:] = -(nu_e + F_1 * eta_e) / F_2  # s = 0 in eq. (14)
        # M_d w
        demand = given.K_d * eta_e + given.D_d @ nu_e - given.K_f * (given.tau_contact_m_B - given.F_d)
        if settings.natural:
            solve_natural(given.M_d, demand, w)
        else:
            w[:] = settings.M_d_inv @ demand
        out.tau_nom[:] = given.M_hat @ (given.nu_d_dot - w) - given.tau_contact_m_B  # eq. (23)
        out.tau_nom += given.C_hat_nu + given.D_hat_nu + given.g_hat
        eta_e_dot = np.zeros(6)
        pose_error_rate(given.quat_e, nu_e, eta_e_dot)
        state_dot.zeta[:] = A * zeta + (w + A * F_1 * eta_e + A * nu_e - F_1 * eta_e_dot) / F_2  # eqs. (15), (21)
        out.s[:] = nu_e + F_1 * eta_e + F_2 * zeta  # eq. (14)
        out.zeta[:], out.F_1[:], out.F_2[:], out.A[:] = zeta, F_1, F_2, A


@kernel
def pose_error_rate(quat_e, nu_e, eta_e_dot):
    """Set eta_e_dot (6,), eq. (18), from the error quaternion (4,) and the error of the velocity (6,)."""
    omega_e = nu_e[3:]
    eta_e_dot[:3] = nu_e[:3]
    eta_e_dot[3:] = 0.5 * (quat_e[0] * omega_e + cross(quat_e[1:], omega_e))  # U(q_e) omega_e, eq. (17)


@kernel
def solve_natural(M, force, w):
    """Set w (6,) to M^-1 force, for M (6, 6) that changes."""
    L = np.zeros((6, 6))
    cholesky(M, L)
    w[:] = force
    forward(L, w)
    backward(L, w)


@kernel
def tracking_errors(given, out):
    """Set quat_e, eta_e, nu_e and nu_d_dot of out from the measurements and the reference."""
    R_WB, nu, nu_d = given.R_WB, given.nu, np.zeros(6)
    to_body(R_WB, given.p_WB - given.p_d, out.eta_e)
    quat_error(given.quat_d, given.quat_WB, out.quat_e)
    out.eta_e[3:] = out.quat_e[1:]  # below eq. (12)
    desired(R_WB, nu[3:], given.p_d_dot, given.p_d_ddot, nu_d[:3], out.nu_d_dot[:3])
    desired(R_WB, nu[3:], given.omega_d, given.omega_d_dot, nu_d[3:], out.nu_d_dot[3:])
    out.nu_e[:] = nu - nu_d


@kernel
def desired(R_WB, omega, x_dot_W, x_ddot_W, x_dot, x_ddot):
    """Set x_dot (3,) in B and its time derivative x_ddot (3,) from a velocity and an acceleration in W.

    B rotates with omega (3,): the time derivative of R^T x_dot is R^T x_ddot - omega x R^T x_dot.
    """
    to_body(R_WB, x_dot_W, x_dot)
    to_body(R_WB, x_ddot_W, x_ddot)
    x_ddot -= cross(omega, x_dot)


MOST_ENTRIES = 100


@table(frozen=True, config=STRICT)
class Change:
    """An entry of the schedule. A value that is not given stays as it is before."""

    time: Time
    K_f: Factors | None = None
    F_d: Wrench | None = None
    ramp: Time = 0.0


def in_order(changes: tuple[Change, ...]) -> tuple[Change, ...]:
    """Check that each entry begins after the entry before it has ended. Raises ValueError."""
    if len(changes) > MOST_ENTRIES:
        raise ValueError(f"has {len(changes)} entries; at most {MOST_ENTRIES} are allowed")
    for before, change in itertools.pairwise(changes):
        ends = before.time + before.ramp
        early = change.time < ends and not math.isclose(change.time, ends)  # 0.1 + 0.2 is above 0.3
        if early or change.time <= before.time:
            raise ValueError(
                f"has an entry at {change.time:g} s, but the entry before it begins at {before.time:g} s and "
                f"ends at {ends:g} s"
            )
    return changes


@dataclass(frozen=True)
class Schedule(Stage):
    """K_f and F_d over time."""

    name = "schedule"
    room: ClassVar[Room] = Room("control", "impedance", lambda thrusters: CLOCK, SCHEDULED)

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """Times (n,), infinite for entries that are not given, and ramps (n,) [s]; values (n + 1, 12) of K_f and F_d
        before the first entry and after each."""
        impedance = setup.scenario.impedance
        times, ramps = np.full(MOST_ENTRIES, np.inf), np.zeros(MOST_ENTRIES)
        values = np.zeros((MOST_ENTRIES + 1, 12))
        values[0] = *impedance.K_f, *impedance.F_d
        for n, change in enumerate(impedance.schedule):
            times[n], ramps[n], values[n + 1] = change.time, change.ramp, values[n]
            if change.K_f is not None:
                values[n + 1, :6] = change.K_f
            if change.F_d is not None:
                values[n + 1, 6:] = change.F_d
        return {"times": times, "ramps": ramps, "values": values}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        times, ramps, values = settings.times, settings.ramps, settings.values
        n = 0
        for k in range(times.shape[0]):
            if given.t < times[k]:
                break
            n = k + 1
        x = 1.0
        if n > 0 and given.t < times[n - 1] + ramps[n - 1]:
            x = (given.t - times[n - 1]) / ramps[n - 1]
        blend = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
        out.K_f[:], out.F_d[:] = values[n, :6], values[n, 6:]
        if x < 1.0:
            out.K_f[:] = values[n - 1, :6] + blend * (values[n, :6] - values[n - 1, :6])
            out.F_d[:] = values[n - 1, 6:] + blend * (values[n, 6:] - values[n - 1, 6:])


@dataclass(frozen=True)
class NaturalInertia(Stage):
    """M_d = M_hat of every control instant, with D_d of Ott's design unless it is given."""

    name = "natural_inertia"
    room: ClassVar[Room] = Room("control", "natural", lambda thrusters: TASK_GIVEN, IMPEDANCE[:2])

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """Damping ratio; number of control instants from one D_d to the next, or 0 if D_d is given."""
        scenario = setup.scenario
        impedance = scenario.impedance
        every = max(1, round(impedance.damping_period / scenario.control_period)) if impedance.D_d is None else 0
        return {"damping_ratio": impedance.damping_ratio, "every": every}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        every = int(settings.every)
        out.M_d[:] = given.M_hat
        if every > 0 and given.instant % every == 0:
            natural_damping(given.M_hat, given.K_d, settings.damping_ratio, out.D_d)


@kernel
def natural_damping(M, K_d, damping_ratio, D_d):
    """Set D_d (6, 6) to Ott's design for M (6, 6) and K_d (6,), as :func:`.design.ott_damping` does."""
    L, V = np.linalg.cholesky(M), np.zeros((6, 6))
    Y = np.linalg.solve(L, np.diag(np.sqrt(K_d)))
    A = Y @ Y.T  # L^-1 K_d L^-T
    symmetric_eigen(A, V)
    LV = L @ V.T
    D_d[:] = 2.0 * damping_ratio * (LV * np.sqrt(np.maximum(np.diag(A), 0.0))) @ LV.T
