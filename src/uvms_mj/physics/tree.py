r"""Hydrodynamics and dynamics of a vehicle with an arm, one link after another.

A vehicle with joints is a tree of links; the base is link 0. Its velocity is :math:`\zeta = [\nu; \dot q]` (6 + n),
with the velocity nu of the base in B and the joint velocities. Each link has a 6x6 inertia M about the origin of its
frame, in its axes, which is not that of a rigid body if it has added mass in it. With the velocity :math:`\nu_k` of
link k in its own axes, linear first, the passes of Featherstone (2008, ch. 5 and 6) are

.. math::

    \nu_k &= X_k \nu_p + S_k \dot q_k, \qquad a_k = X_k a_p + (\nu_k \times) S_k \dot q_k

    f_k &= M_k a_k + (\nu_k \times^*) M_k \nu_k + D_k(\nu_k) \nu_k + g_k + \sum_{children} X_c^\top f_c, \qquad
    \tau_k = S_k^\top f_k

    I_k &= M_k + \sum_{children} X_c^\top I_c X_c, \qquad M_{kk} = S_k^\top I_k S_k

with the parent p of k and its transform X_k. :math:`(\nu \times^*) M \nu` is C_A(nu) nu of Fossen (2021), eq. (6.44).
With zero joint accelerations :math:`\tau = C\zeta + D\zeta + g`, and the I_k give M(q).

For the water, M is the added mass, nu the velocity relative to the current, and the acceleration of the base
:math:`a_0 = -[\omega \times v_r + R_{WB}^\top \dot v_c; 0]`, as in :mod:`.hydrodynamics`. The current is that at B's
origin. For the model of a law, M is the estimate of M_RB + M_A, and nu the measured velocity.
"""

import math

import numpy as np

from .fossen import coriolis_added_mass, damping, matvec, turn_momentum
from .frames import to_body, to_world
from .kernels import kernel

MOST_JOINTS = 30
"""Joints of a vehicle that are computed."""

LINK = np.dtype(
    [
        ("parent", "i8"),  # index of the link that carries it; the base is link 0
        ("depth", "i8"),  # number of joints from the base to the link
        ("slide", "i8"),  # whether its joint is a slide, otherwise it is a hinge
        ("p_0", "f8", (3,)),  # pose in the parent's frame at q = 0 [m]
        ("R_0", "f8", (3, 3)),
        ("axis", "f8", (3,)),  # of the joint, in the link's frame
        ("anchor", "f8", (3,)),  # a point of the hinge's axis [m]
        ("S", "f8", (6,)),  # velocity of the link per unit of q_dot, in the link's axes
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
        ("f_ext", "f8", (6,)),  # force of a contact as a wrench at the link's origin, in its axes [N, N m]
        # of one instant
        ("R_PL", "f8", (3, 3)),  # pose in the parent's frame
        ("p_PL", "f8", (3,)),
        ("R_BL", "f8", (3, 3)),  # pose in B
        ("p_BL", "f8", (3,)),
        ("nu", "f8", (6,)),  # velocity
        ("a", "f8", (6,)),  # acceleration without that of the joints, nu_dot in the link's axes
        ("gravity", "f8", (3,)),  # acceleration of gravity in the link's axes [m/s^2]
        ("f", "f8", (6,)),  # wrench on the link and all that it carries
        ("composite", "f8", (6, 6)),  # inertia of the link and all that it carries
        ("work", "f8", (6,)),
        ("turned", "f8", (9, 3)),  # scratch of the composite inertia
        ("G", "f8", (3, 3)),
    ],
    align=True,
)
"""One link of a tree: constants, pose, velocity, wrench and composite inertia."""


@kernel
def place(link, parent, q):
    """Set the pose of a link in its parent's frame and in B, at the joint position q [rad or m]."""
    R_0, R, p, axis, anchor = link.R_0, link.R_PL, link.p_PL, link.axis, link.anchor
    if link.slide != 0:
        for i in range(3):
            p[i] = link.p_0[i] + (R_0[i, 0] * axis[0] + R_0[i, 1] * axis[1] + R_0[i, 2] * axis[2]) * q
            for j in range(3):
                R[i, j] = R_0[i, j]
    else:
        c, s = math.cos(q), math.sin(q)
        x, y, z = axis[0], axis[1], axis[2]
        v = 1.0 - c
        for i in range(3):  # R_0 times the rotation about the axis
            a, b, d = R_0[i, 0], R_0[i, 1], R_0[i, 2]
            R[i, 0] = a * (c + v * x * x) + b * (v * x * y + s * z) + d * (v * x * z - s * y)
            R[i, 1] = a * (v * x * y - s * z) + b * (c + v * y * y) + d * (v * y * z + s * x)
            R[i, 2] = a * (v * x * z + s * y) + b * (v * y * z - s * x) + d * (c + v * z * z)
        for i in range(3):
            still = (R_0[i, 0] - R[i, 0]) * anchor[0] + (R_0[i, 1] - R[i, 1]) * anchor[1]
            p[i] = link.p_0[i] + still + (R_0[i, 2] - R[i, 2]) * anchor[2]
    to_world(parent.R_BL, p, link.p_BL)
    for i in range(3):
        link.p_BL[i] += parent.p_BL[i]
        a, b, d = parent.R_BL[i, 0], parent.R_BL[i, 1], parent.R_BL[i, 2]
        for j in range(3):
            link.R_BL[i, j] = a * R[0, j] + b * R[1, j] + d * R[2, j]


@kernel
def to_link(link, of_parent, out):
    """Set out = X of_parent: a velocity or an acceleration (6,) of the parent as one at the link's origin."""
    R, p, v = link.R_PL, link.p_PL, link.work
    x, y, z = of_parent[3], of_parent[4], of_parent[5]
    v[0] = of_parent[0] + y * p[2] - z * p[1]
    v[1] = of_parent[1] + z * p[0] - x * p[2]
    v[2] = of_parent[2] + x * p[1] - y * p[0]
    to_body(R, v, out)
    for i in range(3):
        out[i + 3] = R[0, i] * x + R[1, i] * y + R[2, i] * z


@kernel
def move(link, parent, q_dot):
    """Set nu, a and gravity of a link from those of its parent, at the joint velocity q_dot [rad/s or m/s]."""
    to_link(link, parent.nu, link.nu)
    to_link(link, parent.a, link.a)
    to_body(link.R_PL, parent.gravity, link.gravity)
    nu, a, S = link.nu, link.a, link.S
    for i in range(6):
        nu[i] += S[i] * q_dot
    v_x, v_y, v_z, p, q, r = nu[0], nu[1], nu[2], nu[3], nu[4], nu[5]
    a[0] += (q * S[2] - r * S[1] + v_y * S[5] - v_z * S[4]) * q_dot
    a[1] += (r * S[0] - p * S[2] + v_z * S[3] - v_x * S[5]) * q_dot
    a[2] += (p * S[1] - q * S[0] + v_x * S[4] - v_y * S[3]) * q_dot
    a[3] += (q * S[5] - r * S[4]) * q_dot
    a[4] += (r * S[3] - p * S[5]) * q_dot
    a[5] += (p * S[4] - q * S[3]) * q_dot


@kernel
def coriolis_wrench(link, out):
    """Set out (6,) to M a + C(nu) nu of a link, without the links that it carries."""
    M, nu, a, work = link.M, link.nu, link.a, link.work
    if link.M_diagonal != 0:
        for i in range(6):
            out[i] = M[i, i] * nu[i]
            work[i] = M[i, i] * a[i]
        turn_momentum(nu, out)
    else:
        coriolis_added_mass(M, nu, out)
        matvec(M, a, work)
    for i in range(6):
        out[i] = link.coriolis * (out[i] + link.work[i])


@kernel
def damping_wrench(link, out):
    """Set out (6,) to D(nu) nu of a link."""
    D, Q, nu = link.D_linear, link.D_quadratic, link.nu
    if link.D_diagonal != 0:
        for i in range(6):
            out[i] = D[i, i] * nu[i] + Q[i, i] * (abs(nu[i]) * nu[i])
    else:
        damping(D, Q, nu, out)


@kernel
def restoring_wrench(link, out):
    """Set out (6,) to the restoring wrench g of a link: minus its weight and its buoyancy."""
    m, d, r_g, r_b, g = link.mass, link.displaced_mass, link.r_g, link.r_b, link.gravity
    x, y, z = m * r_g[0] - d * r_b[0], m * r_g[1] - d * r_b[1], m * r_g[2] - d * r_b[2]
    for i in range(3):
        out[i] = (d - m) * g[i]
    out[3] = z * g[1] - y * g[2]
    out[4] = x * g[2] - z * g[0]
    out[5] = y * g[0] - x * g[1]


@kernel
def to_parent(link, f):
    """Turn a wrench f (6,) at the link's origin into one at its parent's, in place."""
    R, p = link.R_PL, link.p_PL
    x = R[0, 0] * f[0] + R[0, 1] * f[1] + R[0, 2] * f[2]
    y = R[1, 0] * f[0] + R[1, 1] * f[1] + R[1, 2] * f[2]
    z = R[2, 0] * f[0] + R[2, 1] * f[1] + R[2, 2] * f[2]
    a = R[0, 0] * f[3] + R[0, 1] * f[4] + R[0, 2] * f[5] + p[1] * z - p[2] * y
    b = R[1, 0] * f[3] + R[1, 1] * f[4] + R[1, 2] * f[5] + p[2] * x - p[0] * z
    c = R[2, 0] * f[3] + R[2, 1] * f[4] + R[2, 2] * f[5] + p[0] * y - p[1] * x
    f[0], f[1], f[2], f[3], f[4], f[5] = x, y, z, a, b, c


@kernel
def hand_down(link, parent):
    """Add the wrench f of a link, as one at its parent's origin, to that of the parent."""
    R, p, f, out = link.R_PL, link.p_PL, link.f, parent.f
    x = R[0, 0] * f[0] + R[0, 1] * f[1] + R[0, 2] * f[2]
    y = R[1, 0] * f[0] + R[1, 1] * f[1] + R[1, 2] * f[2]
    z = R[2, 0] * f[0] + R[2, 1] * f[1] + R[2, 2] * f[2]
    a = R[0, 0] * f[3] + R[0, 1] * f[4] + R[0, 2] * f[5] + p[1] * z - p[2] * y
    b = R[1, 0] * f[3] + R[1, 1] * f[4] + R[1, 2] * f[5] + p[2] * x - p[0] * z
    c = R[2, 0] * f[3] + R[2, 1] * f[4] + R[2, 2] * f[5] + p[0] * y - p[1] * x
    out[0] += x
    out[1] += y
    out[2] += z
    out[3] += a
    out[4] += b
    out[5] += c


@kernel
def along_joint(link, f) -> float:
    """The force or torque of a wrench f (6,) on a link along its joint, S^T f."""
    S = link.S
    return (S[0] * f[0] + S[1] * f[1]) + (S[2] * f[2] + S[3] * f[3]) + (S[4] * f[4] + S[5] * f[5])


@kernel
def start_composite(link):
    """Set the composite inertia of a link to its own."""
    for i in range(6):
        for j in range(6):
            link.composite[i, j] = link.M[i, j]


@kernel
def add_composite(link, parent):
    r"""Add the composite inertia of a link, as one about its parent's origin, to that of the parent.

    With the blocks A, B, D of the inertia in the parent's axes and S = S(p), X^T I X has the blocks A, G = B - A S and
    D - B^T S + S G.
    """
    own, R, p, out, t, G = link.composite, link.R_PL, link.p_PL, parent.composite, link.turned, link.G
    for block in range(3):  # R (block) R^T of the blocks A, B, D
        first, second = 3 * (block // 2), 3 * ((block + 1) // 2)
        for i in range(3):
            for j in range(3):
                a, b, c = own[first, second + j], own[first + 1, second + j], own[first + 2, second + j]
                t[3 * block + i, j] = R[i, 0] * a + R[i, 1] * b + R[i, 2] * c
        for i in range(3):
            a, b, c = t[3 * block + i, 0], t[3 * block + i, 1], t[3 * block + i, 2]
            for j in range(3):
                t[3 * block + i, j] = a * R[j, 0] + b * R[j, 1] + c * R[j, 2]
    x, y, z = p[0], p[1], p[2]
    for i in range(3):
        a, b, c = t[i, 0], t[i, 1], t[i, 2]
        G[i, 0] = t[3 + i, 0] - (b * z - c * y)
        G[i, 1] = t[3 + i, 1] - (c * x - a * z)
        G[i, 2] = t[3 + i, 2] - (a * y - b * x)
        a, b, c = t[3, i], t[4, i], t[5, i]
        t[6 + i, 0] -= b * z - c * y
        t[6 + i, 1] -= c * x - a * z
        t[6 + i, 2] -= a * y - b * x
    for j in range(3):
        a, b, c = G[0, j], G[1, j], G[2, j]
        t[6, j] += y * c - z * b
        t[7, j] += z * a - x * c
        t[8, j] += x * b - y * a
    for i in range(3):
        for j in range(3):
            out[i, j] += t[i, j]
            out[i, 3 + j] += G[i, j]
            out[3 + j, i] += G[i, j]
            out[3 + i, 3 + j] += t[6 + i, j]


@kernel
def joint_column(link):
    """Set f of a link to its composite inertia times S: the wrench that accelerates its joint alone."""
    matvec(link.composite, link.S, link.f)
