"""Tracking errors: actual minus desired, in B."""

from ..physics.frames import quat_error, to_body
from ..physics.kernels import kernel


@kernel
def tracking_errors(signals):
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
