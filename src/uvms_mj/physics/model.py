"""Model estimates for the law: M, C, D and g of the vehicle, without the current and the disturbance.

The estimates use the same equations as the plant, with the true coefficients times the scenario's factors (default 1).
Their errors are terms of the lumped disturbance of the paper's eq. (11).
"""

from .fossen import coriolis_added_mass, coriolis_rigid_body, damping, restoring
from .kernels import kernel


@kernel
def model_wrenches(coefficients, nu, R_WB, C_nu, D_nu, g_eta):
    """Set C(nu) nu, D(nu) nu and g(eta), (6,) each [N, N m, B], from nu (6,) and R_WB (3, 3).

    ``coefficients`` is a record with M_RB, M_A, D_linear, D_quadratic, mass, displaced_mass, r_g, r_b and gravity_W.
    """
    coriolis_rigid_body(coefficients.M_RB, nu, C_nu)
    coriolis_added_mass(coefficients.M_A, nu, g_eta)  # scratch until restoring sets it
    for i in range(6):
        C_nu[i] += g_eta[i]
    damping(coefficients.D_linear, coefficients.D_quadratic, nu, D_nu)
    mass, displaced_mass = coefficients.mass, coefficients.displaced_mass
    restoring(mass, displaced_mass, coefficients.r_g, coefficients.r_b, coefficients.gravity_W, R_WB, g_eta)
