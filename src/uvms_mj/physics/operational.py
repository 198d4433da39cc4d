r"""The dynamics of a vehicle with joints at its tool: operational space (Khatib, IEEE J. Robotics and Automation 3,
1987).

The tool's frame T is fixed to one link. With the velocity :math:`\nu_T = J \zeta` of T, in T, and the equations of the
whole tree, :math:`M \dot\zeta + h = \tau + J^\top \tau_c` with :math:`h = C\zeta + D\zeta + g`,

.. math::

    \Lambda \dot\nu_T + \bar J^\top h - \Lambda \dot J \zeta = F + \tau_c, \qquad
    \Lambda = (J M^{-1} J^\top)^{-1}, \quad \bar J = M^{-1} J^\top \Lambda, \quad \tau = J^\top F.

This has the form of the paper's eq. (10): Lambda is M, and the rest is C nu + D nu + g. Torques
:math:`N^\top \tau_0 = \tau_0 - J^\top \bar J^\top \tau_0` do not accelerate the tool.

**No singularity at the tool.** The base is free: its columns X of J are those of a rigid body, and invertible. With
M_BB, the inertia of the vehicle with locked joints,

.. math:: J M^{-1} J^\top \succeq X M_{BB}^{-1} X^\top, \qquad \Lambda \preceq X^{-\top} M_{BB} X^{-1},

because a locked joint is a constraint. Where the arm is singular, the vehicle moves the tool alone in the directions
that the joints lack. Lambda and its inverse are bounded, so nothing is damped here. The measure

.. math:: w = \sqrt{\det M_{BB} \, \det (J M^{-1} J^\top)} \ge 1

is how much larger the volume of the tool's accelerations is than with locked joints: Yoshikawa's dynamic manipulability
(1985) over that of the locked arm. It has no unit, and is the same for every choice of frames. It is 1 if no joint
moves the tool.

Matrices are flat arrays, row by row; J^T is (N, 6) with N = 6 + n.
"""

import numpy as np

from .dense import backward, cholesky, forward, gram, inverse, product, transposed_product
from .kernels import kernel

TOOL = np.dtype(
    [
        ("link", "i8"),  # index of the link that carries it; the base is link 0
        ("p_LT", "f8", (3,)),  # pose in the link's frame [m]
        ("R_LT", "f8", (3, 3)),
        # of one instant
        ("p_BT", "f8", (3,)),  # pose in B
        ("R_BT", "f8", (3, 3)),
    ],
    align=True,
)
"""The frame T of a tool."""


@kernel
def tool_in_base(tool, link):
    """Set the pose of a tool in B from that of its link."""
    R, p, own, out = link.R_BL, tool.p_LT, tool.R_LT, tool.R_BT
    for i in range(3):
        a, b, c = R[i, 0], R[i, 1], R[i, 2]
        tool.p_BT[i] = link.p_BL[i] + a * p[0] + b * p[1] + c * p[2]
        for j in range(3):
            out[i, j] = a * own[0, j] + b * own[1, j] + c * own[2, j]


@kernel
def tool_in_world(tool, p_WB, R_WB, p_WT, R_WT):
    """Set the pose of a tool in W, p_WT (3,) and R_WT (3, 3), from that of B."""
    p, own = tool.p_BT, tool.R_BT
    for i in range(3):
        a, b, c = R_WB[i, 0], R_WB[i, 1], R_WB[i, 2]
        p_WT[i] = p_WB[i] + a * p[0] + b * p[1] + c * p[2]
        for j in range(3):
            R_WT[i, j] = a * own[0, j] + b * own[1, j] + c * own[2, j]


@kernel
def base_rows(tool, J_T):
    """Set the first six rows of J^T: the velocity of T by that of the base."""
    R, p = tool.R_BT, tool.p_BT
    for i in range(3):
        x, y, z = R[0, i], R[1, i], R[2, i]
        for j in range(3):
            J_T[6 * j + i] = R[j, i]
            J_T[6 * j + 3 + i] = 0.0
            J_T[18 + 6 * j + 3 + i] = R[j, i]
        J_T[18 + i] = p[1] * z - p[2] * y  # R^T (omega x p)
        J_T[24 + i] = p[2] * x - p[0] * z
        J_T[30 + i] = p[0] * y - p[1] * x


@kernel
def joint_row(tool, link, row, J_T):
    """Set a row of J^T: the velocity of T by the joint of one of the links that carry it."""
    R, S, own, p = tool.R_BT, link.S, link.R_BL, link.p_BL
    x, y, z = tool.p_BT[0] - p[0], tool.p_BT[1] - p[1], tool.p_BT[2] - p[2]
    a = own[0, 0] * S[3] + own[0, 1] * S[4] + own[0, 2] * S[5]
    b = own[1, 0] * S[3] + own[1, 1] * S[4] + own[1, 2] * S[5]
    c = own[2, 0] * S[3] + own[2, 1] * S[4] + own[2, 2] * S[5]
    v_x = own[0, 0] * S[0] + own[0, 1] * S[1] + own[0, 2] * S[2] + b * z - c * y
    v_y = own[1, 0] * S[0] + own[1, 1] * S[1] + own[1, 2] * S[2] + c * x - a * z
    v_z = own[2, 0] * S[0] + own[2, 1] * S[1] + own[2, 2] * S[2] + a * y - b * x
    for i in range(3):
        J_T[6 * row + i] = R[0, i] * v_x + R[1, i] * v_y + R[2, i] * v_z
        J_T[6 * row + 3 + i] = R[0, i] * a + R[1, i] * b + R[2, i] * c


@kernel
def at_tool(tool, of_link, out):
    """Set out (6,) to a velocity or an acceleration of the tool's link, as one of T in T."""
    R, p, a = tool.R_LT, tool.p_LT, of_link
    x = a[0] + a[4] * p[2] - a[5] * p[1]
    y = a[1] + a[5] * p[0] - a[3] * p[2]
    z = a[2] + a[3] * p[1] - a[4] * p[0]
    for i in range(3):
        out[i] = R[0, i] * x + R[1, i] * y + R[2, i] * z
        out[3 + i] = R[0, i] * a[3] + R[1, i] * a[4] + R[2, i] * a[5]


@kernel
def wrench_at_tool(tool, f, out):
    """Set out (6,) to a wrench f (6,) at B's origin, in B, as one at T's origin, in T."""
    R, p = tool.R_BT, tool.p_BT
    x = f[3] - (p[1] * f[2] - p[2] * f[1])
    y = f[4] - (p[2] * f[0] - p[0] * f[2])
    z = f[5] - (p[0] * f[1] - p[1] * f[0])
    for i in range(3):
        out[i] = R[0, i] * f[0] + R[1, i] * f[1] + R[2, i] * f[2]
        out[3 + i] = R[0, i] * x + R[1, i] * y + R[2, i] * z


@kernel
def task_inertia(M, N, J_T, L, MJ_T, L_task, Lambda, manipulability):
    """Set Lambda (6, 6), M^-1 J^T (N, 6) and the manipulability (1,).

    L (N, N) is set to the factor of M (N, N), and L_task (6, 6) to that of J M^-1 J^T.
    """
    cholesky(M, N, L)
    for i in range(6 * N):
        MJ_T[i] = J_T[i]
    forward(L, N, MJ_T, 6)
    gram(MJ_T, N, 6, Lambda)
    backward(L, N, MJ_T, 6)
    cholesky(Lambda, 6, L_task)
    inverse(L_task, 6, Lambda)
    roots = 1.0  # of the inverse determinants of M_BB and of J M^-1 J^T
    for i in range(6):
        roots *= L[N * i + i] * L_task[7 * i]
    manipulability[0] = 1.0 / roots


@kernel
def at_task(Lambda, MJ_T, N, h, work, out):
    """Set out (6,) to J_bar^T h, for h (N,); work is (6,) scratch."""
    transposed_product(MJ_T, N, 6, h, work)
    product(Lambda, 6, 6, work, 1, out)


@kernel
def resolve(J_T, N, F, tau):
    """Set tau (N,) to J^T F."""
    product(J_T, N, 6, F, 1, tau)
