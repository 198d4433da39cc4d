"""Tracking errors: actual minus desired, in B."""

from ..physics.frames import quat_error, to_body
from ..physics.kernels import kernel


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
    v_d = nu_e  # in B; nu_e is set from it below
    to_body(R_WB, given.p_d_dot, v_d)
    to_body(R_WB, given.p_d_ddot, out.nu_d_dot)
    out.nu_d_dot[0] -= nu[4] * v_d[2] - nu[5] * v_d[1]  # a_d = R^T p_d_ddot - omega x R^T p_d_dot
    out.nu_d_dot[1] -= nu[5] * v_d[0] - nu[3] * v_d[2]
    out.nu_d_dot[2] -= nu[3] * v_d[1] - nu[4] * v_d[0]
    for i in range(3):
        nu_e[i] = nu[i] - v_d[i]
        nu_e[i + 3] = nu[i + 3]  # the desired attitude is constant
        out.nu_d_dot[i + 3] = 0.0
