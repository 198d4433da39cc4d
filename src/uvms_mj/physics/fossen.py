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
    term = np.zeros(6)
    add_effects(effects, body.nu_r, body.d)
    coriolis_added_mass(body.M_A, body.nu_r, term)
    body.d[:] = body.d - term
    damping(body.D_linear, body.D_quadratic, body.nu_r, term)
    body.d[:] = body.d - term
    restoring(body.mass, body.displaced_mass, body.r_g, body.r_b, body.gravity_W, body.R_WB, body.g)


@kernel
def coriolis_rigid_body(M_RB, nu, out):
    """out = C_RB(nu) nu (6,) [N, N m], Fossen (2021), eq. (3.63), with the blocks of M_RB (6, 6) [kg, kg m, kg m^2]."""
    m = M_RB[0, 0]
    a_x = nu[4] * nu[2] - nu[5] * nu[1]  # omega x v
    a_y = nu[5] * nu[0] - nu[3] * nu[2]
    a_z = nu[3] * nu[1] - nu[4] * nu[0]
    b_x = M_RB[0, 3] * nu[3] + M_RB[0, 4] * nu[4] + M_RB[0, 5] * nu[5]  # -m S(r_g) omega
    b_y = M_RB[1, 3] * nu[3] + M_RB[1, 4] * nu[4] + M_RB[1, 5] * nu[5]
    b_z = M_RB[2, 3] * nu[3] + M_RB[2, 4] * nu[4] + M_RB[2, 5] * nu[5]
    h_x = M_RB[3, 3] * nu[3] + M_RB[3, 4] * nu[4] + M_RB[3, 5] * nu[5]  # I_b omega
    h_y = M_RB[4, 3] * nu[3] + M_RB[4, 4] * nu[4] + M_RB[4, 5] * nu[5]
    h_z = M_RB[5, 3] * nu[3] + M_RB[5, 4] * nu[4] + M_RB[5, 5] * nu[5]
    out[0] = m * a_x + nu[4] * b_z - nu[5] * b_y
    out[1] = m * a_y + nu[5] * b_x - nu[3] * b_z
    out[2] = m * a_z + nu[3] * b_y - nu[4] * b_x
    out[3] = M_RB[3, 0] * a_x + M_RB[3, 1] * a_y + M_RB[3, 2] * a_z + nu[4] * h_z - nu[5] * h_y
    out[4] = M_RB[4, 0] * a_x + M_RB[4, 1] * a_y + M_RB[4, 2] * a_z + nu[5] * h_x - nu[3] * h_z
    out[5] = M_RB[5, 0] * a_x + M_RB[5, 1] * a_y + M_RB[5, 2] * a_z + nu[3] * h_y - nu[4] * h_x


@kernel
def coriolis_added_mass(M_A, nu, out):
    """out = C_A(nu) nu (6,) [N, N m], Fossen (2021), eq. (6.44), M_A (6, 6) symmetric [kg, kg m, kg m^2]."""
    matvec(M_A, nu, out)
    turn_momentum(nu, out)


@kernel
def turn_momentum(nu, out):
    """Set out (6,), a momentum M nu, to the wrench C(nu) nu that turns it, in place."""
    a_0, a_1, a_2, a_3, a_4, a_5 = out[0], out[1], out[2], out[3], out[4], out[5]
    out[0], out[1], out[2], out[3], out[4], out[5] = (  # at once: of columns (6, n), a_0 to a_5 are views of out
        nu[4] * a_2 - nu[5] * a_1,
        nu[5] * a_0 - nu[3] * a_2,
        nu[3] * a_1 - nu[4] * a_0,
        nu[1] * a_2 - nu[2] * a_1 + nu[4] * a_5 - nu[5] * a_4,  # the first two terms are the Munk moment
        nu[2] * a_0 - nu[0] * a_2 + nu[5] * a_3 - nu[3] * a_5,
        nu[0] * a_1 - nu[1] * a_0 + nu[3] * a_4 - nu[4] * a_3,
    )


@kernel
def damping(D_linear, D_quadratic, nu, out):
    """out = D(nu) nu (6,) [N, N m] = D_linear nu + D_quadratic (abs(nu) nu), both (6, 6); paper eq. (33), there with
    diagonal matrices. The terms are summed in pairs, as in :func:`matvec`."""
    x_0, x_1, x_2, x_3, x_4, x_5 = nu[0], nu[1], nu[2], nu[3], nu[4], nu[5]
    y_0, y_1, y_2 = abs(x_0) * x_0, abs(x_1) * x_1, abs(x_2) * x_2
    y_3, y_4, y_5 = abs(x_3) * x_3, abs(x_4) * x_4, abs(x_5) * x_5
    D, Q = D_linear, D_quadratic
    for i in range(6):
        linear = (D[i, 0] * x_0 + D[i, 1] * x_1) + (D[i, 2] * x_2 + D[i, 3] * x_3) + (D[i, 4] * x_4 + D[i, 5] * x_5)
        square = (Q[i, 0] * y_0 + Q[i, 1] * y_1) + (Q[i, 2] * y_2 + Q[i, 3] * y_3) + (Q[i, 4] * y_4 + Q[i, 5] * y_5)
        out[i] = linear + square


@kernel
def restoring(mass, displaced_mass, r_g, r_b, gravity_W, R_WB, out):
    """out = g(eta) (6,) [N, N m] for the rigid and the displaced mass [kg] at r_g and r_b (3,) [m, B]; gravity_W (3,)
    [m/s^2]."""
    k_x = -(R_WB[0, 0] * gravity_W[0] + R_WB[1, 0] * gravity_W[1] + R_WB[2, 0] * gravity_W[2])  # g k in B
    k_y = -(R_WB[0, 1] * gravity_W[0] + R_WB[1, 1] * gravity_W[1] + R_WB[2, 1] * gravity_W[2])
    k_z = -(R_WB[0, 2] * gravity_W[0] + R_WB[1, 2] * gravity_W[1] + R_WB[2, 2] * gravity_W[2])
    m_x = mass * r_g[0] - displaced_mass * r_b[0]
    m_y = mass * r_g[1] - displaced_mass * r_b[1]
    m_z = mass * r_g[2] - displaced_mass * r_b[2]
    out[0] = (mass - displaced_mass) * k_x
    out[1] = (mass - displaced_mass) * k_y
    out[2] = (mass - displaced_mass) * k_z
    out[3] = m_y * k_z - m_z * k_y
    out[4] = m_z * k_x - m_x * k_z
    out[5] = m_x * k_y - m_y * k_x


@kernel
def matvec(A, x, out):
    """out = A x for A (6, 6); out must not be x. The terms are summed in pairs, which a processor does in parallel."""
    x_0, x_1, x_2, x_3, x_4, x_5 = x[0], x[1], x[2], x[3], x[4], x[5]
    for i in range(6):
        out[i] = (A[i, 0] * x_0 + A[i, 1] * x_1) + (A[i, 2] * x_2 + A[i, 3] * x_3) + (A[i, 4] * x_4 + A[i, 5] * x_5)
