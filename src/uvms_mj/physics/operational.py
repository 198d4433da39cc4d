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

from .dense import backward, cholesky, forward, gram, inverse, product
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
def base_rows(tool, J_T):
    """Set the first six rows of J^T: the velocity of T by that of the base."""
    rows, R = J_T[:36].reshape(6, 6), tool.R_BT
    rows[:3, :3], rows[:3, 3:], rows[3:, 3:] = R, 0.0, R
    for i in range(3):
        rows[3:, i] = np.cross(tool.p_BT, R[:, i])  # R^T (omega x p)


@kernel
def task_inertia(M, N, J_T, L, MJ_T, L_task, Lambda, J_bar, manipulability):
    """Set Lambda (6, 6), M^-1 J^T and J_bar (N, 6), and the manipulability (1,).

    L (N, N) is set to the factor of M (N, N), and L_task (6, 6) to that of J M^-1 J^T.
    """
    cholesky(M, N, L)
    MJ_T[:] = J_T
    forward(L, N, MJ_T, 6)
    gram(MJ_T, N, 6, Lambda)
    backward(L, N, MJ_T, 6)
    cholesky(Lambda, 6, L_task)
    inverse(L_task, 6, Lambda)
    product(MJ_T, N, 6, Lambda, 6, J_bar)
    roots = 1.0  # of the inverse determinants of M_BB and of J M^-1 J^T
    for i in range(6):
        roots *= L[N * i + i] * L_task[7 * i]
    manipulability[0] = 1.0 / roots


@kernel
def resolve(J_T, N, F, tau):
    """Set tau (N,) to J^T F."""
    product(J_T, N, 6, F, 1, tau)
