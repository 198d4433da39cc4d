r"""Hydrodynamics of one vehicle: its added inertia and its wrench for one state.

Added mass belongs in the inertia matrix: a force -M_A nu_dot, computed from an earlier acceleration, diverges if the
added mass exceeds the rigid mass. With T = blockdiag(R_WB^T, I), nu = T qvel, the joint-space inertia grows by
T^T M_A T. The rest is a force. From v_dot = R_WB^T a_W - omega x v and v_c_dot = R_WB^T v_c_dot_W - omega x v_c in B,

.. math::

    M_A \dot\nu_r = M_A T\, \ddot q - M_A \begin{bmatrix} \omega \times v_r + R_{WB}^\top \dot v_c \\ 0 \end{bmatrix},

where the derivative of the current v_c in W is taken along the vehicle's path. The wrench on the right-hand side of the
paper's eq. (10) is

.. math::

    -C_A(\nu_r)\nu_r - D(\nu_r)\nu_r
        + M_A \begin{bmatrix} \omega \times v_r + R_{WB}^\top \dot v_c \\ 0 \end{bmatrix}
        + \text{buoyancy} + \tau_{dist}(t).

**Froude-Krylov force.** The pressure gradient that accelerates the water, a_c = Dv_c/Dt, acts on the vehicle as well:
the buoyancy of the displaced mass is that of gravity minus a_c (Newman, "Marine Hydrodynamics", 1977, sec. 4.17; Fossen
2021, sec. 10.3, has constant currents only). It is included. Eq. (10), in which M = M_RB + M_A multiplies nu_r_dot,
holds as it stands for a vehicle whose weight and buoyancy balance in size and place. For any other one g(eta) is to be
taken in the accelerated frame of the water (:func:`uvms_mj.control.model.reveal`). In uniform water that accelerates, a
neutral vehicle therefore moves as in still water, seen from the water.

MuJoCo itself computes rigid-body Coriolis forces, weight and thrust.
"""

import numpy as np

from .fossen import coriolis_added_mass, damping
from .frames import to_body
from .kernels import kernel

WATER = np.dtype(
    [
        ("M_A", "f8", (6, 6)),  # added mass [kg, kg m, kg m^2]
        ("D_linear", "f8", (6, 6)),  # D(nu) nu = D_linear nu + D_quadratic (abs(nu) nu) [N s/m, N s, N m s]
        ("D_quadratic", "f8", (6, 6)),  # [N s^2/m^2, N s^2/m, N s^2, N m s^2]
        ("buoyancy_W", "f8", (3,)),  # buoyant force in W [N]
        ("displaced_mass", "f8"),  # [kg]
        ("r_b", "f8", (3,)),  # centre of buoyancy in B [m]
        ("tether", "f8"),  # factor of the tether's drag [N s^2/m^2], or 0
        ("r_t", "f8", (3,)),  # its point of attachment in B [m]
        ("unsteady", "i8"),  # whether the current is not constant
        # at the vehicle, at one instant
        ("fresh", "i8"),  # whether it is the instant in hand of a closed loop
        ("v_c_W", "f8", (3,)),  # velocity of the current in W [m/s]
        ("v_c_dot_W", "f8", (3,)),  # its time derivative along the vehicle's path [m/s^2]; zero if it is constant
        ("a_c_W", "f8", (3,)),  # acceleration of the water [m/s^2]; zero if the current is constant
        ("tau_dist", "f8", (6,)),  # disturbance in B, with the tether [N, N m]
    ],
    align=True,
)
"""Hydrodynamic coefficients of one vehicle, and the motion of the water at this instant."""


@kernel
def added_inertia(M_A, R_WB, lower):
    """Set lower (21,) to the lower triangle of T^T M_A T, row by row, as MuJoCo stores it for a free joint."""
    n = 0
    for i in range(3):  # R_WB M_A[:3, :3] R_WB^T
        a = R_WB[i, 0] * M_A[0, 0] + R_WB[i, 1] * M_A[1, 0] + R_WB[i, 2] * M_A[2, 0]
        b = R_WB[i, 0] * M_A[0, 1] + R_WB[i, 1] * M_A[1, 1] + R_WB[i, 2] * M_A[2, 1]
        c = R_WB[i, 0] * M_A[0, 2] + R_WB[i, 1] * M_A[1, 2] + R_WB[i, 2] * M_A[2, 2]
        for j in range(i + 1):
            lower[n] = a * R_WB[j, 0] + b * R_WB[j, 1] + c * R_WB[j, 2]
            n += 1
    for i in range(3, 6):
        for j in range(3):  # M_A[3:, :3] R_WB^T
            lower[n] = M_A[i, 0] * R_WB[j, 0] + M_A[i, 1] * R_WB[j, 1] + M_A[i, 2] * R_WB[j, 2]
            n += 1
        for j in range(3, i + 1):
            lower[n] = M_A[i, j]
            n += 1


@kernel
def factor(lower, L, D_inverse):
    """L^T D L factorisation of a symmetric 6x6 matrix in MuJoCo's order, from the last row up.

    Args:
        lower: (21,) lower triangle of the matrix, row by row.
        L: (21,) is set to L below the diagonal and D on it.
        D_inverse: (6,) is set to the inverse of D.
    """
    for n in range(21):
        L[n] = lower[n]
    for k in range(5, -1, -1):
        row = k * (k + 1) // 2
        D_inverse[k] = 1.0 / L[row + k]
        for i in range(k - 1, -1, -1):
            scale = L[row + i] * D_inverse[k]
            above = i * (i + 1) // 2
            for j in range(i + 1):
                L[above + j] -= scale * L[row + j]
            L[row + i] = scale


@kernel
def relative_velocity(water, R_WB, nu, nu_r):
    """Set nu_r (6,) to the velocity relative to the current, from nu (6,) [m/s, rad/s, B]."""
    to_body(R_WB, water.v_c_W, nu_r)
    for i in range(3):
        nu_r[i] = nu[i] - nu_r[i]
        nu_r[i + 3] = nu[i + 3]


@kernel
def water_wrench(water, R_WB, nu, nu_r, work, out):
    """The hydrodynamic wrench on the vehicle, with the disturbance and without the part in the inertia matrix.

    Args:
        water: a WATER record.
        R_WB: (3, 3).
        nu: (6,) velocity in B [m/s, rad/s].
        nu_r: (6,) is set to the velocity relative to the current.
        work: (6,) scratch.
        out: (6,) is set to the wrench at B's origin, in B [N, N m].
    """
    relative_velocity(water, R_WB, nu, nu_r)
    coriolis_added_mass(water.M_A, nu_r, work)
    for i in range(6):
        out[i] = water.tau_dist[i] - work[i]
    damping(water.D_linear, water.D_quadratic, nu_r, work)
    for i in range(6):
        out[i] -= work[i]
    a_x = nu_r[4] * nu_r[2] - nu_r[5] * nu_r[1]  # omega x v_r
    a_y = nu_r[5] * nu_r[0] - nu_r[3] * nu_r[2]
    a_z = nu_r[3] * nu_r[1] - nu_r[4] * nu_r[0]
    if water.unsteady != 0:
        to_body(R_WB, water.v_c_dot_W, work)
        a_x, a_y, a_z = a_x + work[0], a_y + work[1], a_z + work[2]
    for i in range(6):
        out[i] += water.M_A[i, 0] * a_x + water.M_A[i, 1] * a_y + water.M_A[i, 2] * a_z
    for i in range(3):
        work[i] = water.buoyancy_W[i] + water.displaced_mass * water.a_c_W[i]
    to_body(R_WB, work, work)
    r_b = water.r_b
    for i in range(3):
        out[i] += work[i]
    out[3] += r_b[1] * work[2] - r_b[2] * work[1]
    out[4] += r_b[2] * work[0] - r_b[0] * work[2]
    out[5] += r_b[0] * work[1] - r_b[1] * work[0]
