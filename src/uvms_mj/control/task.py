r"""The terms that all laws share: pose errors, sliding variable, nominal control.

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

import numpy as np

from ..physics.fossen import matvec
from ..physics.frames import quat_error, to_body
from ..physics.kernels import kernel

TASK = np.dtype(
    [
        ("M_d_inv", "f8", (6, 6)),
        ("F_1", "f8", (6,)),
        ("F_2", "f8", (6,)),
        ("A", "f8", (6,)),
        ("work", "f8", (6,)),
    ],
    align=True,
)
"""Constants of the desired impedance and of the sliding variable, and scratch memory."""


@kernel
def pose_errors(signals):
    """Set quat_e, eta_e, nu_e and nu_d_dot of signals. Errors are actual minus desired, in B."""
    R_WB, nu, eta_e, nu_e = signals.R_WB, signals.nu, signals.eta_e, signals.nu_e
    x = signals.p_WB[0] - signals.p_d[0]
    y = signals.p_WB[1] - signals.p_d[1]
    z = signals.p_WB[2] - signals.p_d[2]
    for i in range(3):
        eta_e[i] = R_WB[0, i] * x + R_WB[1, i] * y + R_WB[2, i] * z
    quat_error(signals.quat_d, signals.quat_WB, signals.quat_e)
    for i in range(3):
        eta_e[i + 3] = signals.quat_e[i + 1]  # below eq. (12)
    to_body(R_WB, signals.p_d_dot, nu_e)  # v_d in B, for now
    to_body(R_WB, signals.p_d_ddot, signals.nu_d_dot)
    signals.nu_d_dot[0] -= nu[4] * nu_e[2] - nu[5] * nu_e[1]  # a_d = R^T p_d_ddot - omega x R^T p_d_dot
    signals.nu_d_dot[1] -= nu[5] * nu_e[0] - nu[3] * nu_e[2]
    signals.nu_d_dot[2] -= nu[3] * nu_e[1] - nu[4] * nu_e[0]
    for i in range(3):
        nu_e[i] = nu[i] - nu_e[i]
        nu_e[i + 3] = nu[i + 3]  # the desired attitude is constant


@kernel
def sliding_variable(task, signals, zeta_dot):
    """Set signals.s, eq. (14), signals.w, and zeta_dot, eq. (15) with the gains of eq. (21)."""
    eta_e, nu_e, w, work = signals.eta_e, signals.nu_e, signals.w, task.work
    F_1, F_2, A = task.F_1, task.F_2, task.A
    matvec(signals.D_d, nu_e, work)
    for i in range(6):
        work[i] += signals.K_d[i] * eta_e[i] - signals.K_f[i] * (signals.tau_contact_m_B[i] - signals.F_d[i])
    matvec(task.M_d_inv, work, w)
    q_w, q_x, q_y, q_z = signals.quat_e[0], signals.quat_e[1], signals.quat_e[2], signals.quat_e[3]
    for i in range(3):
        work[i] = nu_e[i]  # eta_e_dot, eq. (18)
    work[3] = 0.5 * (q_w * nu_e[3] + q_y * nu_e[5] - q_z * nu_e[4])  # U(q_e) omega_e, eq. (17)
    work[4] = 0.5 * (q_w * nu_e[4] + q_z * nu_e[3] - q_x * nu_e[5])
    work[5] = 0.5 * (q_w * nu_e[5] + q_x * nu_e[4] - q_y * nu_e[3])
    for i in range(6):
        signals.s[i] = nu_e[i] + F_1[i] * eta_e[i] + F_2[i] * signals.zeta[i]  # eq. (14)
        zeta_dot[i] = (
            A[i] * signals.zeta[i] + (w[i] + A[i] * F_1[i] * eta_e[i] + A[i] * nu_e[i] - F_1[i] * work[i]) / F_2[i]
        )


@kernel
def nominal_control(task, signals):
    """Set signals.tau_nom, eq. (23), from the estimates. Call it after sliding_variable."""
    work = task.work
    for i in range(6):
        work[i] = signals.nu_d_dot[i] - signals.w[i]
    matvec(signals.M_hat, work, signals.tau_nom)
    for i in range(6):
        signals.tau_nom[i] += signals.C_hat_nu[i] + signals.D_hat_nu[i] + signals.g_hat[i] - signals.tau_contact_m_B[i]
