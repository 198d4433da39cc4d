"""What a law believes of the vehicle: estimates of M, C, D and g, never the current and never the disturbance.

The estimates are the true coefficients times the scenario's factors, 1 by default. The error in each is one of the
terms of the lumped disturbance of the paper's eq. (11).
"""

import numpy as np

from .fossen import coriolis_added_mass, coriolis_rigid_body, damping, restoring
from .kernels import kernel

BELIEFS = np.dtype(
    [
        ("M_RB", "f8", (6, 6)),  # with M_A, the inertia that C_hat is made of
        ("M_A", "f8", (6, 6)),
        ("D_linear", "f8", (6,)),
        ("D_quadratic", "f8", (6,)),
        ("weight", "f8"),
        ("buoyancy", "f8"),
        ("r_g", "f8", (3,)),
        ("r_b", "f8", (3,)),
        ("up_W", "f8", (3,)),
    ],
    align=True,
)
"""Coefficients, already scaled, from which the estimated wrenches follow."""


@kernel
def estimate(beliefs, signals, work):
    """Set signals.C_hat_nu, signals.D_hat_nu and signals.g_hat from signals.nu and signals.R_WB; work is (6,)
    scratch."""
    coriolis_rigid_body(beliefs.M_RB, signals.nu, signals.C_hat_nu)
    coriolis_added_mass(beliefs.M_A, signals.nu, work)
    for i in range(6):
        signals.C_hat_nu[i] += work[i]
    damping(beliefs.D_linear, beliefs.D_quadratic, signals.nu, signals.D_hat_nu)
    restoring(beliefs.weight, beliefs.buoyancy, beliefs.r_g, beliefs.r_b, beliefs.up_W, signals.R_WB, signals.g_hat)
