r"""The stages before the law: tracking errors, and the impedance task, which most laws share.

The paper's eqs. (14), (15), (21) and (23) share one term, the acceleration of the desired impedance,

.. math::

    w = M_d^{-1} (K_d \tilde\eta + D_d \tilde\nu - K_f (\tau_c - F_d)),

with K_f and F_d of the generalised impedance, eq. (7). The impedance of eq. (12) has K_f = I and F_d = 0. F_d is the
desired wrench of the wall on the vehicle: to push on a wall in front, F_d along x is negative. With w and the gains of
eq. (21), eq. (15) becomes

.. math::

    \dot\zeta = A \zeta + F_2^{-1} (w + A' F_1 \tilde\eta + (A' - \bar F_1) \tilde\nu),

where :math:`A' = F_2 A F_2^{-1} = A` for diagonal matrices. The nominal control (23) becomes
:math:`\hat M (\dot\nu_d - w) - \tau_c + \hat C \nu + \hat D \nu + \hat g`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from ..errors import Fault, InputError
from ..physics.dense import backward, cholesky, forward
from ..physics.fossen import matvec
from ..physics.frames import BODY, quat_error
from ..physics.kernels import kernel
from ..quantities import Step, refusing
from ..stages.base import Room, Stage, shared
from ..stages.signals import TASK, TASK_GIVEN
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
    memory: ClassVar = {"L": 36}
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

    def constants(self, setup: Any) -> Mapping[str, Any]:
        own = {"M_d_inv": setup.design.M_d_inv, "natural": setup.scenario.impedance.natural}
        return {**super().constants(setup), "frame": None, "inertia_period": None, **own}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        """Set the signals :data:`uvms_mj.stages.signals.TASK` and zeta_dot, eq. (15) with the gains of eq. (21)."""
        eta_e, nu_e, quat_e, w = given.eta_e, given.nu_e, given.quat_e, out.w
        F_1, F_2, A = settings.F_1, settings.F_2, settings.A
        zeta, zeta_dot = state.zeta, state_dot.zeta
        if settings.integral and given.instant == 0:
            for i in range(6):  # s = 0 in eq. (14)
                zeta[i] = -(nu_e[i] + F_1[i] * eta_e[i]) / F_2[i]
        work = out.s  # set below
        matvec(given.D_d, nu_e, work)
        for i in range(6):
            work[i] += given.K_d[i] * eta_e[i] - given.K_f[i] * (given.tau_contact_m_B[i] - given.F_d[i])
        if settings.natural:
            solve_natural(given.M_d, work, state.L, w)
        else:
            matvec(settings.M_d_inv, work, w)
        for i in range(6):
            work[i] = given.nu_d_dot[i] - w[i]
        matvec(given.M_hat, work, out.tau_nom)  # eq. (23)
        for i in range(6):
            out.tau_nom[i] += given.C_hat_nu[i] + given.D_hat_nu[i] + given.g_hat[i] - given.tau_contact_m_B[i]
        q_w, q_x, q_y, q_z = quat_e[0], quat_e[1], quat_e[2], quat_e[3]
        for i in range(3):
            work[i] = nu_e[i]  # eta_e_dot, eq. (18)
        work[3] = 0.5 * (q_w * nu_e[3] + q_y * nu_e[5] - q_z * nu_e[4])  # U(q_e) omega_e, eq. (17)
        work[4] = 0.5 * (q_w * nu_e[4] + q_z * nu_e[3] - q_x * nu_e[5])
        work[5] = 0.5 * (q_w * nu_e[5] + q_x * nu_e[4] - q_y * nu_e[3])
        for i in range(6):
            driven = w[i] + A[i] * F_1[i] * eta_e[i] + A[i] * nu_e[i] - F_1[i] * work[i]
            zeta_dot[i] = A[i] * zeta[i] + driven / F_2[i]
        for i in range(6):
            out.s[i] = nu_e[i] + F_1[i] * eta_e[i] + F_2[i] * zeta[i]  # eq. (14)
            out.zeta[i], out.F_1[i], out.F_2[i], out.A[i] = zeta[i], F_1[i], F_2[i], A[i]


@kernel
def solve_natural(M, force, L, w):
    """Set w (6,) to M^-1 force, for M (6, 6) that changes; L (36,) is scratch."""
    for i in range(6):
        w[i] = force[i]
        for j in range(i + 1):
            L[6 * i + j] = M[i, j]
    cholesky(L, 6, L)
    forward(L, 6, w, 1)
    backward(L, 6, w, 1)


@kernel
def tracking_errors(given, out):
    """Set quat_e, eta_e, nu_e and nu_d_dot of out from the measurements and the reference."""
    R_WB, nu, eta_e, nu_e = given.R_WB, given.nu, out.eta_e, out.nu_e
    x = given.p_WB[0] - given.p_d[0]
    y = given.p_WB[1] - given.p_d[1]
    z = given.p_WB[2] - given.p_d[2]
    for i in range(3):
        eta_e[i] = R_WB[0, i] * x + R_WB[1, i] * y + R_WB[2, i] * z
    quat_error(given.quat_d, given.quat_WB, out.quat_e)
    for i in range(3):
        eta_e[i + 3] = out.quat_e[i + 1]  # below eq. (12)
    desired(R_WB, nu, given.p_d_dot, given.p_d_ddot, 0, nu_e, out.nu_d_dot)
    desired(R_WB, nu, given.omega_d, given.omega_d_dot, 3, nu_e, out.nu_d_dot)
    for i in range(6):
        nu_e[i] = nu[i] - nu_e[i]


@kernel
def desired(R_WB, nu, x_dot_W, x_ddot_W, first, nu_d, nu_d_dot):
    """Set three components of nu_d and nu_d_dot, from index ``first``, from a velocity and an acceleration in W.

    B rotates: the time derivative of R^T x_dot is R^T x_ddot - omega x R^T x_dot.
    """
    for i in range(3):
        nu_d[first + i] = R_WB[0, i] * x_dot_W[0] + R_WB[1, i] * x_dot_W[1] + R_WB[2, i] * x_dot_W[2]
        nu_d_dot[first + i] = R_WB[0, i] * x_ddot_W[0] + R_WB[1, i] * x_ddot_W[1] + R_WB[2, i] * x_ddot_W[2]
    nu_d_dot[first] -= nu[4] * nu_d[first + 2] - nu[5] * nu_d[first + 1]
    nu_d_dot[first + 1] -= nu[5] * nu_d[first] - nu[3] * nu_d[first + 2]
    nu_d_dot[first + 2] -= nu[3] * nu_d[first + 1] - nu[4] * nu_d[first]
