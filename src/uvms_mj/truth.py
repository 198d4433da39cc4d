"""The truth about a vehicle in its water, for the law that no vehicle can have: the yardstick, eq. (13)."""

from .fossen import coriolis_added_mass, coriolis_rigid_body, damping, restoring
from .frames import to_body
from .hydrodynamics import disturbance
from .kernels import kernel


@kernel
def reveal(coefficients, water, signals, truth, work):
    """Set a record of :data:`uvms_mj.signals.TRUTH` but for M; coefficients is a BELIEFS record that is true, work is
    (6,) scratch."""
    nu, nu_r, nu_c_dot = signals.nu, truth.nu_r, truth.nu_c_dot
    to_body(signals.R_WB, water.v_c_W, work)
    for i in range(3):
        nu_r[i] = nu[i] - work[i]
        nu_r[i + 3] = nu[i + 3]
    nu_c_dot[0] = nu[5] * work[1] - nu[4] * work[2]  # -omega x v_c: constant in W
    nu_c_dot[1] = nu[3] * work[2] - nu[5] * work[0]
    nu_c_dot[2] = nu[4] * work[0] - nu[3] * work[1]
    coriolis_rigid_body(coefficients.M_RB, nu_r, truth.C_nu_r)
    coriolis_added_mass(coefficients.M_A, nu_r, work)
    for i in range(6):
        truth.C_nu_r[i] += work[i]
    damping(coefficients.D_linear, coefficients.D_quadratic, nu_r, truth.D_nu_r)
    weight, buoyancy = coefficients.weight, coefficients.buoyancy
    restoring(weight, buoyancy, coefficients.r_g, coefficients.r_b, coefficients.up_W, signals.R_WB, truth.g_eta)
    disturbance(water, signals.t, truth.tau_dist)
