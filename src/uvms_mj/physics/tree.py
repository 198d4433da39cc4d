r"""Hydrodynamics and dynamics of a vehicle with an arm, one link after another.

A vehicle with joints is a tree of links; the base is link 0. Its velocity is :math:`\zeta = [\nu; \dot q]` (6 + n),
with the velocity nu of the base in B and the joint velocities. Each link has a 6x6 inertia M about the origin of its
frame, in its axes, which is not that of a rigid body if it has added mass in it.

The motion V of link k, its acceleration A without that of the joints, and the axis S of its joint are spatial vectors
about B's origin in B, linear first, and so are the wrenches. There the vectors and inertias of links are added as they
are (Featherstone 2008, ch. 2, 5 and 6), with the parent p of k:

.. math::

    V_k &= V_p + S_k \dot q_k, \qquad A_k = A_p + (V_k \times) S_k \dot q_k

    F_k &= X_k^\top \left( M_k a_k + (\nu_k \times^*) M_k \nu_k + D_k(\nu_k) \nu_k \right) + g_k +
        \sum_{children} F_c, \qquad \tau_k = S_k^\top F_k

    I_k &= X_k^\top M_k X_k + \sum_{children} I_c, \qquad M_{jk} = S_j^\top I_k S_k

:math:`\nu_k = X_k V_k` and :math:`a_k = X_k A_k` are at the link's origin in its axes, where drag and added mass have
their coefficients. :math:`(\nu \times^*) M \nu` is C_A(nu) nu of Fossen (2021), eq. (6.44). With zero joint
accelerations :math:`\tau = C\zeta + D\zeta + g`, and the I_k give M(q).

For the water, M is the added mass, nu the velocity relative to the current, and the acceleration of the base
:math:`A_0 = -[\omega \times v_r + R_{WB}^\top \dot v_c; 0]`, as in :mod:`.hydrodynamics`. The current is that at B's
origin. For the model of a law, M is the estimate of M_RB + M_A, and nu the measured velocity.
"""

import math

import numpy as np

from .fossen import damping, turn_momentum
from .frames import add_wrench_from, compose_poses, motion_at, motion_from
from .kernels import fused, kernel

MOST_JOINTS = 30
"""Joints of a vehicle that are computed."""

FRAME = np.dtype(
    [
        ("parent", "i8"),  # index of the link that carries it; the base is link 0
        ("depth", "i8"),  # number of joints from the base to the link
        # pose in the parent's frame: R = R_still + R_cos cos q + R_sin sin q, p = p_0 + slope q - R anchor
        ("R_still", "f8", (3, 3)),
        ("R_cos", "f8", (3, 3)),
        ("R_sin", "f8", (3, 3)),
        ("p_0", "f8", (3,)),  # [m]
        ("slope", "f8", (3,)),  # of a slide
        ("anchor", "f8", (3,)),  # a point of the hinge's axis in the link's frame
        ("axis", "f8", (6,)),  # motion of the link per unit of q_dot, at its origin in its axes
        # of one instant
        ("R_PL", "f8", (3, 3)),  # pose in the parent's frame
        ("p_PL", "f8", (3,)),
        ("R_BL", "f8", (3, 3)),  # pose in B
        ("p_BL", "f8", (3,)),
        ("S", "f8", (6,)),  # motion of the link per unit of q_dot, about B's origin in B
    ],
    align=True,
)
"""The frame of one link of a tree: how its joint carries it, and its pose. Trees at the same joint positions can share
the frames."""

LINK = np.dtype(
    [
        ("M", "f8", (6, 6)),  # inertia [kg, kg m, kg m^2]
        ("coriolis", "f8"),  # factor of the Coriolis and centripetal wrench of M
        ("D_linear", "f8", (6, 6)),
        ("D_quadratic", "f8", (6, 6)),
        ("M_diagonal", "i8"),  # whether M is a diagonal, which most links have; 0 if nobody looked
        ("D_diagonal", "i8"),  # whether both damping matrices are
        ("mass", "f8"),  # whose weight counts, at r_g [kg, m]
        ("r_g", "f8", (3,)),
        ("displaced_mass", "f8"),  # [kg]
        ("r_b", "f8", (3,)),  # centre of buoyancy [m]
        ("f_ext", "f8", (6,)),  # contact forces, as a wrench about B's origin in B [N, N m]
        # of one instant
        ("V", "f8", (6,)),  # motion, and acceleration without that of the joints, about B's origin in B
        ("A", "f8", (6,)),
        ("nu", "f8", (6,)),  # the same at the link's origin in its axes
        ("a", "f8", (6,)),
        ("work", "f8", (6,)),
        ("F", "f8", (6,)),  # wrench of the link and all that it carries, about B's origin in B
        ("F_C", "f8", (6,)),  # of a law's model, those of C and D; F is then that of g
        ("F_D", "f8", (6,)),
        # blocks A, G, D of the inertia [A G; G^T D] of the link and all that it carries, about B's origin in B
        ("composite", "f8", (9, 3)),
    ],
    align=True,
)
"""One link of a tree: coefficients, motion, wrench and composite inertia."""


@kernel
def place(frame, parent, q):
    """Set the pose of a link in B and the motion S of its joint, at the joint position q [rad or m]; ``parent`` is the
    frame of the link that carries it."""
    R, p, anchor, c, s = frame.R_PL, frame.p_PL, frame.anchor, math.cos(q), math.sin(q)
    for i in range(3):
        a = frame.R_still[i, 0] + (c * frame.R_cos[i, 0] + s * frame.R_sin[i, 0])
        b = frame.R_still[i, 1] + (c * frame.R_cos[i, 1] + s * frame.R_sin[i, 1])
        e = frame.R_still[i, 2] + (c * frame.R_cos[i, 2] + s * frame.R_sin[i, 2])
        R[i, 0], R[i, 1], R[i, 2] = a, b, e
        p[i] = (frame.p_0[i] + frame.slope[i] * q) - (a * anchor[0] + b * anchor[1] + e * anchor[2])
    compose_poses(parent.R_BL, parent.p_BL, R, p, frame.R_BL, frame.p_BL)
    motion_from(frame.R_BL, frame.p_BL, frame.axis, frame.S)


@kernel
def move(link, S, parent, q_dot):
    """Set V and A of a link from those of its parent, at the velocity q_dot [rad/s or m/s] of its joint with the motion
    S (6,)."""
    V, A, before, at = link.V, link.A, parent.V, parent.A
    v_x, v_y, v_z, p, q, r = before[0], before[1], before[2], before[3], before[4], before[5]
    x, y, z, a, b, c = S[0] * q_dot, S[1] * q_dot, S[2] * q_dot, S[3] * q_dot, S[4] * q_dot, S[5] * q_dot
    V[0], V[1], V[2], V[3], V[4], V[5] = v_x + x, v_y + y, v_z + z, p + a, q + b, r + c
    A[0] = at[0] + ((q * z - r * y) + (v_y * c - v_z * b))
    A[1] = at[1] + ((r * x - p * z) + (v_z * a - v_x * c))
    A[2] = at[2] + ((p * y - q * x) + (v_x * b - v_y * a))
    A[3] = at[3] + (q * c - r * b)
    A[4] = at[4] + (r * a - p * c)
    A[5] = at[5] + (p * b - q * a)


@kernel
def move_base(base):
    """Set nu and a of the base from V and A."""
    for i in range(6):
        base.nu[i], base.a[i] = base.V[i], base.A[i]


@kernel
def move_frame(link, frame):
    """Set nu and a of a link behind a joint from V and A."""
    motion_at(frame.R_BL, frame.p_BL, link.V, link.nu)
    motion_at(frame.R_BL, frame.p_BL, link.A, link.a)


@kernel
def momenta(link, out):
    """Set out (6,) to C(nu) nu, and ``link.work`` (6,) to M a, of a link at its origin."""
    M, nu, a, work = link.M, link.nu, link.a, link.work
    if link.M_diagonal != 0:
        for i in range(6):
            out[i] = M[i, i] * nu[i]
            work[i] = M[i, i] * a[i]
    else:
        x_0, x_1, x_2, x_3, x_4, x_5 = nu[0], nu[1], nu[2], nu[3], nu[4], nu[5]
        y_0, y_1, y_2, y_3, y_4, y_5 = a[0], a[1], a[2], a[3], a[4], a[5]
        for i in range(6):
            b, c, d, e, f, g = M[i, 0], M[i, 1], M[i, 2], M[i, 3], M[i, 4], M[i, 5]
            out[i] = (b * x_0 + c * x_1) + (d * x_2 + e * x_3) + (f * x_4 + g * x_5)
            work[i] = (b * y_0 + c * y_1) + (d * y_2 + e * y_3) + (f * y_4 + g * y_5)
    turn_momentum(nu, out)


@kernel
def coriolis_wrench(link, out):
    """Set out (6,) to M a + C(nu) nu of a link at its origin, without the links that it carries."""
    momenta(link, out)
    for i in range(6):
        out[i] = link.coriolis * (out[i] + link.work[i])


@kernel
def damping_wrench(link, out):
    """Set out (6,) to D(nu) nu of a link at its origin."""
    D, Q, nu = link.D_linear, link.D_quadratic, link.nu
    if link.D_diagonal != 0:
        for i in range(6):
            out[i] = D[i, i] * nu[i] + Q[i, i] * (abs(nu[i]) * nu[i])
    else:
        damping(D, Q, nu, out)


@kernel
def add_to_base(frame, wrench, out):
    """Add to out (6,), a wrench about B's origin in B, a wrench (6,) at the origin of a link in its axes."""
    if frame.depth == 0:
        for i in range(6):
            out[i] += wrench[i]
    else:
        add_wrench_from(frame.R_BL, frame.p_BL, wrench, out)


@kernel
def restoring_wrench(link, frame, gravity_B, out):
    """Set out (6,) to the restoring wrench g of a link about B's origin in B, minus its weight and its buoyancy, for
    the acceleration of gravity (3,) in B [m/s^2]."""
    m, d, r_g, r_b, R, p = link.mass, link.displaced_mass, link.r_g, link.r_b, frame.R_BL, frame.p_BL
    g_x, g_y, g_z = gravity_B[0], gravity_B[1], gravity_B[2]
    a, b, c = m * r_g[0] - d * r_b[0], m * r_g[1] - d * r_b[1], m * r_g[2] - d * r_b[2]
    x = (R[0, 0] * a + R[0, 1] * b + R[0, 2] * c) + (m - d) * p[0]
    y = (R[1, 0] * a + R[1, 1] * b + R[1, 2] * c) + (m - d) * p[1]
    z = (R[2, 0] * a + R[2, 1] * b + R[2, 2] * c) + (m - d) * p[2]
    out[0], out[1], out[2] = (d - m) * g_x, (d - m) * g_y, (d - m) * g_z
    out[3], out[4], out[5] = z * g_y - y * g_z, x * g_z - z * g_x, y * g_x - x * g_y


@kernel
def hand_down(link, parent):
    """Add the wrench F of a link to that of its parent."""
    for i in range(6):
        parent.F[i] += link.F[i]


@kernel
def along_joint(S, F) -> float:
    """The force or torque S^T F along a joint with the motion S (6,), of a wrench F (6,) about B's origin."""
    return (S[0] * F[0] + S[1] * F[1]) + (S[2] * F[2] + S[3] * F[3]) + (S[4] * F[4] + S[5] * F[5])


@fused
def place_links(frames, q, first):
    """Set the frames (1 + n,) of all links at the joint positions, which are in q from the index ``first`` on."""
    for k in range(1, frames.shape[0]):
        place(frames[k], frames[frames[k].parent], q[first + k - 1])


@kernel
def move_links(links, frames, q_dot, first):
    """Set velocities and accelerations of all links from those of the base and the joint velocities, which are in q_dot
    from the index ``first`` on."""
    move_base(links[0])
    for k in range(1, links.shape[0]):
        link, frame = links[k], frames[k]
        move(link, frame.S, links[frame.parent], q_dot[first + k - 1])
        move_frame(link, frame)


@kernel
def gather_wrenches(links, frames, out):
    """Set out (6 + n,) to the generalised wrench of the wrenches F of all links, which are summed towards the base."""
    for k in range(links.shape[0] - 1, 0, -1):
        link, frame = links[k], frames[k]
        out[5 + k] = along_joint(frame.S, link.F)
        hand_down(link, links[frame.parent])
    for i in range(6):
        out[i] = links[0].F[i]
