r"""Fossen's equations of motion, term by term, as pure compiled functions.

.. math::

    M \dot\nu_r + C(\nu_r)\nu_r + D(\nu_r)\nu_r + g(\eta) = \tau + \tau_c + \tau_{dist} \qquad \text{paper eq. (10)}

with :math:`M = M_{RB} + M_A`, :math:`C = C_{RB} + C_A`, :math:`\nu_r = \nu - \nu_c`, in the body frame B at its origin:

.. math::

    M_{RB} &= \begin{bmatrix} m I & -m S(r_g) \\ m S(r_g) & I_b \end{bmatrix}
        && \text{Fossen (2021), eq. (3.49)}

    C_{RB}(\nu) &= \begin{bmatrix} m S(\omega) & -m S(\omega) S(r_g) \\
                                  m S(r_g) S(\omega) & -S(I_b \omega) \end{bmatrix}
        && \text{Fossen (2021), eq. (3.63)}

    C_A(\nu) &= \begin{bmatrix} 0 & -S(a_1) \\ -S(a_1) & -S(a_2) \end{bmatrix}, \quad
        \begin{bmatrix} a_1 \\ a_2 \end{bmatrix} = M_A \nu
        && \text{Fossen (2021), eq. (6.44)}

    D(\nu)\nu &= D_{linear}\, \nu + D_{quadratic} \left( |\nu| \odot \nu \right)
        && \text{paper eq. (33), there with diagonal matrices}

    g(\eta) &= \begin{bmatrix} (W - B)\, k \\ (W r_g - B r_b) \times k \end{bmatrix}, \quad k = R_{WB}^\top e_{up}

C_RB does not contain the linear velocity. For a constant irrotational current M_RB nu_r_dot + C_RB(nu_r) nu_r therefore
equals M_RB nu_dot + C_RB(nu) nu, which MuJoCo integrates.
"""

import numpy as np

from .effects import add_effects
from .frames import cross
from .kernels import kernel

IN_WATER = np.dtype(
    [
        *((name, "f8", (6, 6)) for name in ("M_A", "D_linear", "D_quadratic")),
        *((name, "f8") for name in ("mass", "displaced_mass")),
        *((name, "f8", (3,)) for name in ("r_g", "r_b", "gravity_W")),
        ("R_WB", "f8", (3, 3)),
        ("nu_r", "f8", (6,)),  # velocity relative to the water
        ("d", "f8", (6,)),  # wrench of the water without inertia and buoyancy: given the disturbance
        ("g", "f8", (6,)),  # g(eta)
    ],
    align=True,
)
"""A rigid vehicle in the water at one instant."""


@kernel
def water_at_rest(body, effects):
    """Set d and g of an :data:`IN_WATER` record: the wrench of current, effects and disturbance on a vehicle with a
    constant velocity, d = tau_dist + tau_effects - C_A(nu_r) nu_r - D(nu_r) nu_r, and g(eta)."""
    C_nu, D_nu = np.zeros(6), np.zeros(6)
    add_effects(effects, body.nu_r, body.d)
    coriolis_added_mass(body.M_A, body.nu_r, C_nu)
    damping(body.D_linear, body.D_quadratic, body.nu_r, D_nu)
    body.d[:] = body.d - C_nu - D_nu
    restoring(body.mass, body.displaced_mass, body.r_g, body.r_b, body.gravity_W, body.R_WB, body.g)


@kernel
def coriolis_rigid_body(M_RB, nu, out):
    """out = C_RB(nu) nu (6,) [N, N m], Fossen (2021), eq. (3.63), with the blocks of M_RB (6, 6) [kg, kg m, kg m^2]."""
    v, omega = nu[:3], nu[3:]
    a = cross(omega, v)
    out[:3] = M_RB[0, 0] * a + cross(omega, M_RB[:3, 3:] @ omega)  # M_RB[:3, 3:] = -m S(r_g)
    out[3:] = M_RB[3:, :3] @ a + cross(omega, M_RB[3:, 3:] @ omega)


@kernel
def coriolis_added_mass(M_A, nu, out):
    """out = C_A(nu) nu (6,) [N, N m], Fossen (2021), eq. (6.44), M_A (6, 6) symmetric [kg, kg m, kg m^2]."""
    turned_momentum(M_A @ nu, nu, out)


@kernel
def turned_momentum(momentum, nu, out):
    """out = C(nu) nu (6,), the wrench that turns a momentum (6,), M nu."""
    v, omega, a_1, a_2 = nu[:3], nu[3:], momentum[:3], momentum[3:]
    out[:3] = cross(omega, a_1)
    out[3:] = cross(v, a_1) + cross(omega, a_2)  # the first term is the Munk moment


@kernel
def damping(D_linear, D_quadratic, nu, out):
    """out = D(nu) nu (6,) [N, N m] = D_linear nu + D_quadratic (abs(nu) nu), both (6, 6); paper eq. (33), there with
    diagonal matrices."""
    out[:] = D_linear @ nu + D_quadratic @ (np.abs(nu) * nu)


@kernel
def restoring(mass, displaced_mass, r_g, r_b, gravity_W, R_WB, out):
    """out = g(eta) (6,) [N, N m] for the rigid and the displaced mass [kg] at r_g and r_b (3,) [m, B]; gravity_W (3,)
    [m/s^2]."""
    g_k = -(gravity_W @ R_WB)
    out[:3] = (mass - displaced_mass) * g_k
    out[3:] = cross(mass * r_g - displaced_mass * r_b, g_k)
