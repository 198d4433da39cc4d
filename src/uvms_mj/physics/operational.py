r"""The dynamics of a vehicle with joints at its tool: operational space (Khatib, IEEE J. Robotics and Automation 3,
1987).

The tool's frame T is fixed to one link. With the velocity :math:`\nu_T = J \zeta` of T, in T, and the equations of the
whole tree, :math:`M \dot\zeta + h = \tau + J^\top \tau_c` with :math:`h = C\zeta + D\zeta + g`,

.. math::

    \Lambda \dot\nu_T + \bar J^\top h - \Lambda \dot J \zeta = F + \tau_c, \qquad
    \Lambda = (J M^{-1} J^\top)^{-1}, \quad \bar J = M^{-1} J^\top \Lambda, \quad \tau = J^\top F.

This has the form of the paper's eq. (10): Lambda is M, and the rest is C nu + D nu + g. Torques
:math:`N^\top \tau_0 = \tau_0 - J^\top \bar J^\top \tau_0` do not accelerate the tool.

**No singularity at the tool.** The base is free: its columns X of J are as for a rigid body, and invertible. With
M_BB, the inertia of the vehicle with locked joints,

.. math:: J M^{-1} J^\top \succeq X M_{BB}^{-1} X^\top, \qquad \Lambda \preceq X^{-\top} M_{BB} X^{-1},

because a locked joint is a constraint. Where the arm is singular, the vehicle moves the tool alone in the directions
that the joints lack. Lambda and its inverse are bounded, so nothing is damped here. The measure

.. math:: w = \sqrt{\det M_{BB} \, \det (J M^{-1} J^\top)} \ge 1

is how much larger the volume of the tool's accelerations is than with locked joints: Yoshikawa's dynamic manipulability
(1985) over the locked arm's. It has no unit, and is the same for every choice of frames. It is 1 if no joint
moves the tool.

**Posture.** Secondary tasks of a vehicle with joints in strict priority, in the motion that its tool leaves
free (Sentis and Khatib, "Synthesis of whole-body behaviors through hierarchical control of behavioral primitives",
2005).

zeta = [nu; q_dot] (N,) has the inertia M. P (N, N) maps generalised forces to the accelerations that are free:
:math:`P = N M^{-1} N^\top = M^{-1} N^\top` for the projector N of the tasks above. It is symmetric, positive
semi-definite and J P = 0 for each of these tasks. A level with the Jacobian J demands the acceleration b. With
the acceleration a_prev of the levels above,

.. math::

    S = J P J^\top, \quad F = S^{+} (b - J a_{prev}), \quad a = a_{prev} + P J^\top F, \quad
    P \leftarrow P - P J^\top S^{+} J P.

S^+ is the inertia Lambda that the level has in the motion that is left to it, J P J^T = J_prev M^{-1} J_prev^T with
J_prev = J N. The torque N^T J^T F is M P J^T F, so the torque of all levels is M a.

**Joints.** The level ``joints`` has all that is left. Its inertia is the joints' while the task is held,
:math:`(J P_1 J^\top)^{-1}` with the P_1 that the task leaves, which is never singular:

.. math:: F = (J P_1 J^\top)^{-1} (b - J a_{prev}).

If nothing is between, the demand is met. Otherwise the deviations are the least in the metric of this inertia.

**Freedom.** The rows of ``attitude`` and ``station`` are first divided by the Cholesky factor of what they have
without a task, J M^-1 J^T. The eigenvalues of S are then shares of freedom, from 1 to 0. S^+ has the function of each
eigenvalue

.. math::

    f(\sigma) = 1/\sigma \quad (\sigma \ge \epsilon), \qquad
    f(\sigma) = (3 - 2 \sigma/\epsilon)\, \sigma/\epsilon^2 \quad (\sigma < \epsilon),

which is continuous with its derivative. Above epsilon a demand is met and no lower level disturbs it. Below, the demand
fades, and with it the claim on the motion, :math:`\sigma f`; the joints take over in proportion. The acceleration is at
most :math:`1.03/\sqrt{\epsilon}` times the torque of the same demand with all freedom, and falls to zero with sigma.
"""

import math

import numpy as np

from .frames import quat_error
from .kernels import kernel
from .linear_algebra import backward, cholesky, forward, inverse, symmetric_eigen

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
    """Set the first six rows of J^T (N, 6): the velocity of T by the base's."""
    R = tool.R_BT
    J_T[:3, :3], J_T[:3, 3:], J_T[3:6, 3:] = R, 0.0, R
    for i in range(3):
        J_T[3:6, i] = np.cross(tool.p_BT, R[:, i])  # R^T (omega x p)


@kernel
def task_inertia(M, J_T, L, MJ_T, Lambda, J_bar, manipulability):
    """Set Lambda (6, 6), M^-1 J^T and J_bar (N, 6), and the manipulability (1,), from M (N, N) and J^T (N, 6). L (N, N)
    is set to the factor of M."""
    L_task = np.zeros((6, 6))
    cholesky(M, L)
    MJ_T[:] = J_T
    forward(L, MJ_T)
    mobility = MJ_T.T @ MJ_T  # J M^-1 J^T
    backward(L, MJ_T)
    cholesky(mobility, L_task)
    inverse(L_task, Lambda)
    J_bar[:] = MJ_T @ Lambda
    manipulability[0] = 1.0 / np.prod(np.diag(L)[:6] * np.diag(L_task))  # L has the reciprocals on its diagonal


FREEDOM = 1e-2
"""Share of freedom epsilon below which the demand of attitude or station fades."""
ATTITUDE, STATION, JOINTS = range(3)
"""The levels."""


@kernel
def free_of_base(M, P):
    """Set P (N, N) for a task that holds the base, J = [I 0]: the inverse inertia of the joints."""
    L = M[6:, 6:].copy()
    cholesky(L, L)
    P[:] = 0.0
    inverse(L, P[6:, 6:])


@kernel
def posture(settings, known, zeta, q, M, M_inv, P, a):
    """Add the levels' accelerations within the free motion to the task's, a (N,).

    Args:
        settings: record with levels (3,): in order of priority, ATTITUDE, STATION, JOINTS or -1; frequency (3,) [rad/s]
            and damping (3,) [1/s], 2 zeta omega, of each of these levels in their own order; yaw, whether the attitude
            has three components; quat_d (4,), up_d (3,), the world's up direction in B at quat_d; p_d (3,) [m, W];
            joints, n of them or more [rad or m]; free_damping [1/s].
        known: record with p_WB, quat_WB and R_WB of the base.
        zeta, q: [nu; q_dot] (N,) and the positions of the joints (n,).
        M, M_inv: inertia and its inverse (N, N).
        P: free mobility (N, N); the levels take their part of it.
        a: (N,) [m/s^2, rad/s^2].
    """
    P_qq = P[6:, 6:].copy()  # of the joints, below the task
    for k in range(3):
        kind = int(settings.levels[k])
        if kind == ATTITUDE:
            T, b = np.zeros((3, 3)), np.zeros(3)
            rows = attitude(settings, known, zeta, T, b)
            govern(T, b, rows, a[3:6], M_inv[3:6, 3:6], P[3:6], P[3:6, 3:6], P, a)
        elif kind == STATION:
            T, b = np.eye(3), np.zeros(3)
            station(settings, known, zeta, b)
            govern(T, b, 3, a[:3], M_inv[:3, :3], P[:3], P[:3, :3], P, a)
        elif kind == JOINTS:
            joints(settings, zeta, q, P, P_qq, a)
            return
    if settings.free_damping > 0.0:
        a -= settings.free_damping * (P @ (M @ zeta))  # the motion that no level governs decays


@kernel
def attitude(settings, known, zeta, T, b) -> int:
    """Set the rows T (3, 3) of the angular velocity and their demand b (3,). Returns the number of rows, 3 or 2.

    With yaw, e is twice the vector part of the error quaternion. Without, it is e = n 2 sin(theta/2), for the angle
    theta and the axis n by which the up direction in B is off, and the rows span the plane normal to that direction.
    """
    omega, damping = settings.frequency[ATTITUDE], settings.damping[ATTITUDE]
    if settings.yaw:
        quat_e = np.zeros(4)
        quat_error(settings.quat_d, known.quat_WB, quat_e)
        T[:] = np.eye(3)
        b[:] = -omega * omega * 2.0 * quat_e[1:] - damping * zeta[3:6]
        return 3
    up, up_d = known.R_WB[2], settings.up_d
    tangents(up, T)
    half = math.sqrt(max(0.5 + 0.5 * (up @ up_d), 1e-6))  # cos(theta/2)
    b[:] = T @ (-omega * omega / half * np.cross(up, up_d) - damping * zeta[3:6])
    return 2


@kernel
def tangents(n, T):
    """Set the first two rows of T to unit vectors normal to the unit vector n (3,) and to each other (Duff et al.,
    "Building an orthonormal basis, revisited", 2017)."""
    x, y, z = n
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    T[0] = np.array([1.0 + sign * x * x * a, sign * x * y * a, -sign * x])
    T[1] = np.array([x * y * a, sign + y * y * a, -y])


@kernel
def station(settings, known, nu, b):
    """Set the demand b (3,) of the linear velocity, from the error in B.

    B rotates: v_dot = R_WB^T p_ddot - omega x v.
    """
    omega, damping = settings.frequency[STATION], settings.damping[STATION]
    e = known.R_WB.T @ (known.p_WB - settings.p_d)
    b[:] = -omega * omega * e - damping * nu[:3] - np.cross(nu[3:6], nu[:3])


@kernel
def joints(settings, zeta, q, P, P_qq, a):
    """Add the acceleration of the level joints to a (N,). It has all the motion that is left. P_qq (n, n) is lost."""
    omega, damping = settings.frequency[JOINTS], settings.damping[JOINTS]
    F = -omega * omega * (q - settings.joints[: len(q)]) - damping * zeta[6:] - a[6:]
    cholesky(P_qq, P_qq)
    forward(P_qq, F)
    backward(P_qq, F)
    a += P[:, 6:] @ F


@kernel
def govern(T, b, rows, own, own_M_inv, own_P, own_block, P, a):
    """Add the acceleration of attitude or station to a (N,), and take its motion out of P (N, N).

    Its Jacobian J has T (3, 3) in three columns, of which the first ``rows`` rows count, and b (3,) is its demand. Both
    are lost. ``own`` (3,) and own_P (3, N) are the rows of a and P in these columns, own_M_inv and own_block (3, 3) the
    blocks of M^-1 and P.
    """
    whiten(T, b, rows, own, own_M_inv)
    JP, S, V = T @ own_P, T @ own_block @ T.T, np.zeros((3, 3))  # S = J P J^T
    symmetric_eigen(S, V)
    for i in range(3):
        sigma = S[i, i]
        f = 1.0 / sigma if sigma >= FREEDOM else (3.0 - 2.0 * sigma / FREEDOM) * sigma / (FREEDOM * FREEDOM)
        x = V[i] @ JP
        a += f * (V[i] @ b) * x
        P -= np.outer(f * x, x)


@kernel
def whiten(T, b, rows, own, own_M_inv):
    """T becomes L^-1 T and b becomes L^-1 (b - T a), for L L^T = T M^-1 T^T, so that the rows are as free as each
    other and without coupling while nothing is taken. A row that does not count has no freedom: it stays zero."""
    G = T @ own_M_inv @ T.T
    b -= T @ own
    for i in range(rows, 3):
        G[i, i] = 1.0
    cholesky(G, G)
    forward(G, T)
    forward(G, b)
