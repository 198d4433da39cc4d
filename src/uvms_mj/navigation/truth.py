"""True values for the ideal law, eq. (13): velocity in the water, wrenches. A real vehicle can't measure them."""

from ..physics.frames import to_body
from ..physics.hydrodynamics import disturbance
from ..physics.kernels import kernel
from ..physics.model import model_wrenches


@kernel
def reveal(coefficients, water, signals, truth, work):
    """Set a :data:`uvms_mj.stages.signals.TRUTH` record, except M, from the true coefficients; work is (6,) scratch."""
    nu, nu_r, nu_c_dot = signals.nu, truth.nu_r, truth.nu_c_dot
    to_body(signals.R_WB, water.v_c_W, work)
    for i in range(3):
        nu_r[i] = nu[i] - work[i]
        nu_r[i + 3] = nu[i + 3]
    nu_c_dot[0] = nu[5] * work[1] - nu[4] * work[2]  # -omega x v_c: constant in W
    nu_c_dot[1] = nu[3] * work[2] - nu[5] * work[0]
    nu_c_dot[2] = nu[4] * work[0] - nu[3] * work[1]
    model_wrenches(coefficients, nu_r, signals.R_WB, truth.C_nu_r, truth.D_nu_r, truth.g_eta)
    disturbance(water, signals.t, truth.tau_dist)
