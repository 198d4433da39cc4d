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

The composite inertia I_k of a link and all that it carries is kept as the blocks A, G, D (9, 3) of :math:`I =
\begin{bmatrix} A & G \\ G^\top & D \end{bmatrix}`.

**Motors.** A motor gives at most its effort :math:`\hat\tau`. In the direction of motion the torque falls linearly to
zero at the speed limit :math:`\dot q_{max}`, the torque-speed line of a DC motor at a limited voltage, whose back EMF
is proportional to its speed. Against the motion, where it brakes, it gives the whole effort:

.. math::

    -\hat\tau \max(0, 1 + \min(0, \dot q) / \dot q_{max}) \le \tau \le
    \hat\tau \max(0, 1 - \max(0, \dot q) / \dot q_{max})
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


@kernel
def base_inertia(base):
    """Set the composite inertia of the base to its own."""
    M, J = base.M, base.composite
    for i in range(3):
        for j in range(3):
            J[i, j], J[3 + i, j], J[6 + i, j] = M[i, j], M[i, 3 + j], M[3 + i, 3 + j]


@kernel
def own_inertia(link, frame):
    r"""Set the composite inertia of a link behind a joint to its own, about B's origin in B.

    With the blocks A, B, D of the inertia in B's axes and S = S(p), X^T M X has the blocks A, G = B - A S and
    D - B^T S + S G.
    """
    M, R, p, J = link.M, frame.R_BL, frame.p_BL, link.composite
    if link.M_diagonal != 0:
        turn_diagonal(M, R, p, J)
        return
    turn_blocks(M, R, J)
    x, y, z = p[0], p[1], p[2]
    for i in range(3):
        a, b, c = J[3, i], J[4, i], J[5, i]
        J[6 + i, 0] -= b * z - c * y
        J[6 + i, 1] -= c * x - a * z
        J[6 + i, 2] -= a * y - b * x
    for i in range(3):
        a, b, c = J[i, 0], J[i, 1], J[i, 2]
        J[3 + i, 0] -= b * z - c * y
        J[3 + i, 1] -= c * x - a * z
        J[3 + i, 2] -= a * y - b * x
    for j in range(3):
        a, b, c = J[3, j], J[4, j], J[5, j]
        J[6, j] += y * c - z * b
        J[7, j] += z * a - x * c
        J[8, j] += x * b - y * a


@kernel
def turn_diagonal(M, R, p, J):
    """Set J (9, 3) as :func:`own_inertia` does, for a diagonal inertia M (6, 6), whose block B is zero."""
    x, y, z = p[0], p[1], p[2]
    a, b, c, d, e, f, g, h, k = R[0, 0], R[0, 1], R[0, 2], R[1, 0], R[1, 1], R[1, 2], R[2, 0], R[2, 1], R[2, 2]
    m_0, m_1, m_2, m_3, m_4, m_5 = M[0, 0], M[1, 1], M[2, 2], M[3, 3], M[4, 4], M[5, 5]
    u, v, w = m_0 * a, m_1 * b, m_2 * c
    A_xx, A_xy, A_xz = u * a + v * b + w * c, u * d + v * e + w * f, u * g + v * h + w * k
    u, v, w = m_0 * d, m_1 * e, m_2 * f
    A_yy, A_yz, A_zz = u * d + v * e + w * f, u * g + v * h + w * k, m_0 * g * g + m_1 * h * h + m_2 * k * k
    u, v, w = m_3 * a, m_4 * b, m_5 * c
    D_xx, D_xy, D_xz = u * a + v * b + w * c, u * d + v * e + w * f, u * g + v * h + w * k
    u, v, w = m_3 * d, m_4 * e, m_5 * f
    D_yy, D_yz, D_zz = u * d + v * e + w * f, u * g + v * h + w * k, m_3 * g * g + m_4 * h * h + m_5 * k * k
    G_xx, G_xy, G_xz = A_xz * y - A_xy * z, A_xx * z - A_xz * x, A_xy * x - A_xx * y
    G_yx, G_yy, G_yz = A_yz * y - A_yy * z, A_xy * z - A_yz * x, A_yy * x - A_xy * y
    G_zx, G_zy, G_zz = A_zz * y - A_yz * z, A_xz * z - A_zz * x, A_yz * x - A_xz * y
    D_xx, D_xy, D_xz = D_xx + (y * G_zx - z * G_yx), D_xy + (y * G_zy - z * G_yy), D_xz + (y * G_zz - z * G_yz)
    D_yy, D_yz = D_yy + (z * G_xy - x * G_zy), D_yz + (z * G_xz - x * G_zz)
    D_zz = D_zz + (x * G_yz - y * G_xz)
    J[0, 0], J[0, 1], J[0, 2], J[1, 0], J[1, 1], J[1, 2] = A_xx, A_xy, A_xz, A_xy, A_yy, A_yz
    J[2, 0], J[2, 1], J[2, 2], J[3, 0], J[3, 1], J[3, 2] = A_xz, A_yz, A_zz, G_xx, G_xy, G_xz
    J[4, 0], J[4, 1], J[4, 2], J[5, 0], J[5, 1], J[5, 2] = G_yx, G_yy, G_yz, G_zx, G_zy, G_zz
    J[6, 0], J[6, 1], J[6, 2], J[7, 0], J[7, 1], J[7, 2] = D_xx, D_xy, D_xz, D_xy, D_yy, D_yz
    J[8, 0], J[8, 1], J[8, 2] = D_xz, D_yz, D_zz


@kernel
def turn_blocks(M, R, out):
    """Set out (9, 3) to R (block) R^T of the blocks A, B and D of an inertia M (6, 6)."""
    for block in range(3):
        first, second = 3 * (block // 2), 3 * ((block + 1) // 2)
        for i in range(3):
            for j in range(3):
                a, b, c = M[first, second + j], M[first + 1, second + j], M[first + 2, second + j]
                out[3 * block + i, j] = R[i, 0] * a + R[i, 1] * b + R[i, 2] * c
        for i in range(3):
            a, b, c = out[3 * block + i, 0], out[3 * block + i, 1], out[3 * block + i, 2]
            for j in range(3):
                out[3 * block + i, j] = a * R[j, 0] + b * R[j, 1] + c * R[j, 2]


@kernel
def add_composite(link, parent):
    """Add the composite inertia of a link to that of its parent."""
    own, out = link.composite, parent.composite
    for i in range(9):
        for j in range(3):
            out[i, j] += own[i, j]


@kernel
def whole(blocks, M):
    """Set M (6, 6) to the inertia with the blocks (9, 3) of a composite inertia."""
    for i in range(3):
        for j in range(3):
            M[i, j], M[3 + i, 3 + j] = blocks[i, j], blocks[6 + i, j]
            M[i, 3 + j], M[3 + j, i] = blocks[3 + i, j], blocks[3 + i, j]


@kernel
def joint_column(link, S):
    """Set F of a link to its composite inertia times the motion S (6,) of its joint: the wrench that accelerates the
    joint alone."""
    J, F, x, y, z, a, b, c = link.composite, link.F, S[0], S[1], S[2], S[3], S[4], S[5]
    for i in range(3):
        F[i] = (J[i, 0] * x + J[i, 1] * y + J[i, 2] * z) + (J[3 + i, 0] * a + J[3 + i, 1] * b + J[3 + i, 2] * c)
        turned = J[3, i] * x + J[4, i] * y + J[5, i] * z
        F[3 + i] = turned + (J[6 + i, 0] * a + J[6 + i, 1] * b + J[6 + i, 2] * c)


@kernel
def compose_links(links, frames):
    """Set the composite inertias of all links (1 + n,), base first."""
    base_inertia(links[0])
    for k in range(1, links.shape[0]):
        own_inertia(links[k], frames[k])
    for k in range(links.shape[0] - 1, 0, -1):
        add_composite(links[k], links[frames[k].parent])


@kernel
def deliverable(tau, q_dot, effort, speed_limit) -> float:
    """The torque of a motor [N m or N] for a commanded one, at the joint velocity q_dot [rad/s or m/s].

    An infinite effort or speed limit is none.
    """
    if tau * q_dot > 0.0:
        effort *= max(0.0, 1.0 - abs(q_dot) / speed_limit)
    return min(effort, max(-effort, tau))


@kernel
def measured_frames(run, own):
    """The frames of the links at the measured positions of the joints: ``own`` (1 + n,), which are set here, or the
    true ones if the encoder is perfect and ``own`` is empty."""
    if own.shape[0] == 0:
        return run.plant.frames
    place_links(own, run.joints.q_m, 0)
    return own
