r"""Hydrodynamics of one vehicle, a tree of links: its added inertia and its wrench for one state.

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
the displaced mass is buoyant in gravity minus a_c (Newman, "Marine Hydrodynamics", 1977, sec. 4.17; Fossen
2021, sec. 10.3, has constant currents only). It is included. Eq. (10), in which M = M_RB + M_A multiplies nu_r_dot,
holds as it stands for a vehicle whose weight and buoyancy balance in size and place. For any other one g(eta) is to be
taken in the accelerated frame of the water (:func:`uvms_mj.control.model.reveal`). In uniform water that accelerates, a
neutral vehicle therefore moves as in still water, seen from the water.

**Waves at links.** In a sea each link has the flow at its own centre of buoyancy. The tree moves in the flow at B, and
a link adds the difference: with d = v_c,L - v_c of the water's velocity, and omega of the link,

.. math::

    v_r \mathrel{-}= R_{WL}^\top d, \qquad
    \dot v_r \mathrel{+}= \omega \times R_{WL}^\top d - R_{WL}^\top \dot d,

with the rates along the paths of the two places, and the difference of the accelerations of the water in its buoyancy.
A uniform flow has no difference.

MuJoCo itself computes rigid-body Coriolis forces, weight and thrust.
"""

import numpy as np

from .buoyancy import meet_surface
from .effects import add_inertia_wrenches, add_sea
from .frames import add_wrench_from
from .kernels import fused, kernel
from .tree import damping_wrench, gather_wrenches, momenta, move_links

WATER = np.dtype(
    [
        ("unsteady", "i8"),  # whether the water does not move the same at all times and places
        # at the vehicle, at one instant
        ("t", "f8"),  # [s]
        ("fresh", "i8"),  # whether it is the instant in hand of a closed loop
        ("v_c_W", "f8", (3,)),  # velocity of the current in W [m/s]
        ("v_c_dot_W", "f8", (3,)),  # its time derivative along the vehicle's path [m/s^2]; zero if it is constant
        ("a_c_W", "f8", (3,)),  # acceleration of the water [m/s^2]; zero if the current is constant
        ("gradient_W", "f8", (3, 3)),  # of its velocity, dv_i/dx_j [1/s]
        ("wave_head", "f8"),  # pressure of the waves over rho g; zero without waves [m]
        ("tau_dist", "f8", (6,)),  # disturbance in B, with the effects [N, N m]
    ],
    align=True,
)
"""The motion of the water at a vehicle, and the disturbance, at one instant."""


@kernel
def added_inertia(M_A, R_WB, lower):
    """Set lower (21,) to the lower triangle of T^T M_A T, row by row, as MuJoCo stores it for a free joint."""
    n = 0
    for i in range(3):
        turned = R_WB[i] @ M_A[:3, :3]  # of R_WB M_A[:3, :3] R_WB^T
        for j in range(i + 1):
            lower[n] = turned @ R_WB[j]
            n += 1
    for i in range(3, 6):
        for j in range(3):
            lower[n] = M_A[i, :3] @ R_WB[j]  # of M_A[3:, :3] R_WB^T
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
    nu_r[:3], nu_r[3:] = nu[:3] - R_WB.T @ water.v_c_W, nu[3:]


@fused
def water_wrench(plant, R_WB, nu, out):
    """Set out (6 + n,) to the generalised wrench of the water on a vehicle and its links, in B at its origin [N, N m],
    with the disturbance and the contact forces on the links behind joints, and without the part in the inertia matrix.

    Args:
        plant: record with links, frames (1 + n,), water, tau_effects (k, 6), effect_frames (k,) or none if all of them
            act at B, gravity_W, and qvel, whose entries from 6 on belong to the joints. ``nu_r`` is set to the
            velocity of the base relative to the water.
        R_WB: (3, 3).
        nu: (6,) velocity of the base in B [m/s, rad/s].
    """
    links, frames, water, part = plant.links, plant.frames, plant.water, np.zeros(6)
    base, nu_r, a = links[0], plant.nu_r, links[0].A
    relative_velocity(water, R_WB, nu, nu_r)
    base.V[:], base.F[:], a[:] = nu_r, water.tau_dist, 0.0
    if plant.effect_frames.shape[0] == 0:
        for k in range(plant.tau_effects.shape[0]):
            base.F += plant.tau_effects[k]
    a[:3] = -(np.cross(nu_r[3:], nu_r[:3]))  # -(omega x v_r + R^T v_c_dot)
    if water.unsteady != 0:
        a[:3] -= R_WB.T @ water.v_c_dot_W
    move_links(links, frames, plant.qvel, 6)
    if plant.effects.sea.shape[0] != 0:
        for k in range(1, links.shape[0]):
            meet_waves(plant, links[k], frames[k], R_WB, nu)
    if plant.wet.shape[0] != 0:
        subtract_water(base, part)
        base.F += plant.wet[0].fraction * part
        meet_surface(plant, base, R_WB, nu)
    else:
        subtract_water(base, base.F)
        add_buoyancy(base, plant, R_WB, base.r_b)
    for k in range(1, links.shape[0]):
        link, frame = links[k], frames[k]
        part[:], link.F[:] = 0.0, link.f_ext
        subtract_water(link, part)
        add_wrench_from(frame.R_BL, frame.p_BL, part, link.F)
        centre = frame.p_BL + frame.R_BL @ link.r_b
        add_buoyancy(link, plant, R_WB, centre)
        if plant.effects.sea.shape[0] != 0:
            f = link.displaced_mass * (R_WB.T @ link.a_c_W)
            link.F[:3] += f
            link.F[3:] += np.cross(centre, f)
    if links.shape[0] > 1:
        for k in range(plant.effects.couplings.shape[0]):  # which the disturbance has in it
            at_link, tau = plant.effects.couplings[k].link, plant.effects.couplings_state[k].tau
            if at_link > 0:
                base.F -= tau
                links[at_link].F += tau
    add_inertia_wrenches(plant, R_WB, nu)
    for k in range(plant.effect_frames.shape[0]):
        at = plant.effect_frames[k]
        add_wrench_from(at.R_BC, at.p_BC, plant.tau_effects[k], links[at.link].F)
    gather_wrenches(links, frames, out)


@kernel
def meet_waves(plant, link, frame, R_WB, nu):
    """Set nu and a of a link to its motion relative to the water at its centre of buoyancy, and its a_c_W, from the
    motion relative to the water at B; nu (6,) is the velocity of the base."""
    water, p_WB = plant.water, plant.qpos[:3]
    R = R_WB @ frame.R_BL
    v_B, v_dot_B, gradient_B = np.zeros(3), np.zeros(3), np.zeros((3, 3))
    v_L, v_dot_L, gradient_L = np.zeros(3), np.zeros(3), np.zeros((3, 3))
    add_sea(plant.effects, water.t, p_WB, v_B, v_dot_B, gradient_B)
    p_WL = p_WB + R_WB @ (frame.p_BL + frame.R_BL @ link.r_b)
    add_sea(plant.effects, water.t, p_WL, v_L, v_dot_L, gradient_L)
    path = R @ (link.nu[:3] + np.cross(link.nu[3:], link.r_b)) + water.v_c_W  # of the centre of buoyancy
    d = v_L - v_B
    rate = (v_dot_L + gradient_L @ path) - (v_dot_B + gradient_B @ (R_WB @ nu[:3]))
    link.a_c_W[:] = (v_dot_L + gradient_L @ (water.v_c_W + d)) - (v_dot_B + gradient_B @ water.v_c_W)
    here = R.T @ d
    link.a[:3] += np.cross(link.nu[3:], here) - R.T @ rate
    link.nu[:3] -= here


@kernel
def subtract_water(link, out):
    """Subtract C_A nu_r + D nu_r + M_A a of a link from out (6,), at its origin in its axes."""
    C_nu, D_nu, M_a = np.zeros(6), np.zeros(6), np.zeros(6)
    momenta(link, C_nu, M_a)
    damping_wrench(link, link.nu, D_nu)
    out[:] = out - C_nu - D_nu - M_a


@kernel
def add_buoyancy(link, plant, R_WB, centre):
    """Add the buoyancy of a link to its wrench F about B's origin, at its centre (3,) in B: in gravity minus the
    acceleration of the water."""
    d = link.displaced_mass
    f = R_WB.T @ (-(d * plant.gravity_W) + d * plant.water.a_c_W)
    link.F[:3] += f
    link.F[3:] += np.cross(centre, f)
