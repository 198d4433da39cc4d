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

Secondary tasks of a vehicle with joints in strict priority, in the motion that its tool leaves free.

Source: Sentis and Khatib, "Synthesis of whole-body behaviors through hierarchical control of behavioral primitives"
(2005).

zeta = [nu; q_dot] (N,) has the inertia M. P (N, N) maps generalised forces to the accelerations that are free:
:math:`P = N M^{-1} N^\top = M^{-1} N^\top` for the projector N of the tasks above. It is symmetric, positive
semi-definite and J P = 0 for each of these tasks. A level with the Jacobian J demands the acceleration b. With that of
the levels above, a_prev,

.. math::

    S = J P J^\top, \quad F = S^{+} (b - J a_{prev}), \quad a = a_{prev} + P J^\top F, \quad
    P \leftarrow P - P J^\top S^{+} J P.

S^+ is the inertia Lambda that the level has in the motion that is left to it, J P J^T = J_prev M^{-1} J_prev^T with
J_prev = J N. The torque N^T J^T F is M P J^T F, so the torque of all levels is M a.

**Joints.** The level ``joints`` has all that is left. Its inertia is that of the joints while the task is held,
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
most :math:`1.03/\sqrt{\epsilon}` times that of the same demand with all freedom, and falls to zero with sigma.
"""

import math

import numpy as np

from .frames import quat_error
from .kernels import kernel
from .linear_algebra import backward, cholesky, forward, gram, inverse, product, symmetric_eigen

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


FREEDOM = 1e-2
"""Share of freedom epsilon below which the demand of attitude or station fades."""
ATTITUDE, STATION, JOINTS = range(3)
"""The levels."""


def work_dtype(n: int) -> np.dtype:
    """Memory of the posture of a vehicle with n joints. Matrices are flat arrays, row by row; N = 6 + n."""
    N = 6 + n
    return np.dtype(
        [
            ("a", "f8", (N,)),  # acceleration of the task and of all levels
            ("x", "f8", (N,)),
            ("b", "f8", (max(3, n),)),  # demand of a level
            *((name, "f8", (9,)) for name in ("T", "G", "S", "V")),
            ("X", "f8", (max(3 * N, n * n),)),
            ("zeta", "f8", (N,)),
            ("h", "f8", (N,)),  # C zeta + D zeta + g
            ("free", "f8", (N,)),  # P h, without the acceleration of the task
            ("P_qq", "f8", (n * n,)),  # of the joints, below the task
            ("M_inv", "f8", (N * N,)),
            ("P", "f8", (N * N,)),
        ],
        align=True,
    )


@kernel
def free_of_tool(M_inv, MJ_T, J_bar, N, P):
    """Set P (N, N) to M^-1 - J_bar J M^-1, for MJ_T = M^-1 J^T (N, 6) and J_bar (N, 6)."""
    for i in range(N):
        for j in range(i + 1):
            value = M_inv[N * i + j]
            for k in range(6):
                value -= J_bar[6 * i + k] * MJ_T[6 * j + k]
            P[N * i + j] = value
            P[N * j + i] = value


@kernel
def free_of_base(M, N, G, X, P):
    """Set P (N, N) for a task that holds the base, J = [I 0]: the inverse inertia of the joints; G and X (N - 6, N - 6)
    are scratch."""
    n = N - 6
    for i in range(n):
        for j in range(n):
            G[n * i + j] = M[N * (6 + i) + 6 + j]
    cholesky(G, n, G)
    inverse(G, n, X)
    for i in range(N):
        for j in range(N):
            P[N * i + j] = X[n * (i - 6) + j - 6] if i >= 6 and j >= 6 else 0.0


@kernel
def posture(settings, known, zeta, q, N, M, M_inv, P, work):
    """Add to work.a, the acceleration (N,) that the task gives, what the levels demand within the motion that is free.

    Args:
        settings: record with levels (3,): in order of priority, ATTITUDE, STATION, JOINTS or -1; frequency (3,) [rad/s]
            and damping (3,) [1/s], 2 zeta omega, of each of these levels in their own order; yaw, whether the attitude
            has three components; quat_d (4,), up_d (3,), the world's up direction in B at quat_d; p_d (3,) [m, W];
            joints (N - 6,) [rad or m]; free_damping [1/s].
        known: record with p_WB, quat_WB and R_WB of the base.
        zeta, q: [nu; q_dot] (N,) and the positions of the joints (N - 6,).
        M, M_inv: inertia and its inverse (N, N).
        P: free mobility (N, N); becomes what the levels leave.
        work: a WORK record.
    """
    n = N - 6
    for i in range(n):
        for j in range(n):
            work.P_qq[n * i + j] = P[N * (6 + i) + 6 + j]
    for k in range(3):
        kind = int(settings.levels[k])
        if kind == ATTITUDE:
            rows = attitude(settings, known, zeta, work)
            govern(3, rows, N, M_inv, P, work)
        elif kind == STATION:
            station(settings, known, zeta, work)
            govern(0, 3, N, M_inv, P, work)
        elif kind == JOINTS:
            joints(settings, zeta, q, N, P, work)
            return
    if settings.free_damping > 0.0:
        slow(settings.free_damping, zeta, N, M, P, work)


@kernel
def attitude(settings, known, zeta, work) -> int:
    """Set the rows T (rows, 3) of the angular velocity and their demand b. Returns the number of rows.

    With yaw, e is twice the vector part of the error quaternion. Without, it is e = n 2 sin(theta/2), for the angle
    theta and the axis n by which the up direction in B is off, and the rows span the plane normal to that direction.
    """
    omega, damping = settings.frequency[ATTITUDE], settings.damping[ATTITUDE]
    T, b, x, R, k_d = work.T, work.b, work.x, known.R_WB, settings.up_d
    if settings.yaw:
        quat_error(settings.quat_d, known.quat_WB, x)
        for i in range(3):
            for j in range(3):
                T[3 * i + j] = 1.0 if i == j else 0.0
            b[i] = -omega * omega * 2.0 * x[1 + i] - damping * zeta[3 + i]
        return 3
    k_x, k_y, k_z = R[2, 0], R[2, 1], R[2, 2]
    tangents(k_x, k_y, k_z, T)
    half = math.sqrt(max(0.5 + 0.5 * (k_x * k_d[0] + k_y * k_d[1] + k_z * k_d[2]), 1e-6))  # cos(theta/2)
    scale = omega * omega / half
    b_x = -scale * (k_y * k_d[2] - k_z * k_d[1]) - damping * zeta[3]
    b_y = -scale * (k_z * k_d[0] - k_x * k_d[2]) - damping * zeta[4]
    b_z = -scale * (k_x * k_d[1] - k_y * k_d[0]) - damping * zeta[5]
    for i in range(2):
        b[i] = T[3 * i] * b_x + T[3 * i + 1] * b_y + T[3 * i + 2] * b_z
    return 2


@kernel
def tangents(k_x, k_y, k_z, T):
    """Set the rows of T (2, 3) to unit vectors normal to the unit vector k and to each other (Duff et al., "Building an
    orthonormal basis, revisited", 2017)."""
    sign = 1.0 if k_z >= 0.0 else -1.0
    a = -1.0 / (sign + k_z)
    b = k_x * k_y * a
    T[0], T[1], T[2] = 1.0 + sign * k_x * k_x * a, sign * b, -sign * k_x
    T[3], T[4], T[5] = b, sign + k_y * k_y * a, -k_y


@kernel
def station(settings, known, nu, work):
    """Set the rows T (3, 3) of the linear velocity and their demand b, from the error in B.

    B rotates: v_dot = R_WB^T p_ddot - omega x v.
    """
    omega, damping, R = settings.frequency[STATION], settings.damping[STATION], known.R_WB
    x = known.p_WB[0] - settings.p_d[0]
    y = known.p_WB[1] - settings.p_d[1]
    z = known.p_WB[2] - settings.p_d[2]
    for i in range(3):
        for j in range(3):
            work.T[3 * i + j] = 1.0 if i == j else 0.0
        e = R[0, i] * x + R[1, i] * y + R[2, i] * z
        work.b[i] = -omega * omega * e - damping * nu[i]
    work.b[0] -= nu[4] * nu[2] - nu[5] * nu[1]
    work.b[1] -= nu[5] * nu[0] - nu[3] * nu[2]
    work.b[2] -= nu[3] * nu[1] - nu[4] * nu[0]


@kernel
def joints(settings, zeta, q, N, P, work):
    """Add the acceleration of the level joints to work.a. It has what is left."""
    omega, damping, n, a, F = settings.frequency[JOINTS], settings.damping[JOINTS], N - 6, work.a, work.b
    for i in range(n):
        F[i] = -omega * omega * (q[i] - settings.joints[i]) - damping * zeta[6 + i] - a[6 + i]
    cholesky(work.P_qq, n, work.P_qq)
    forward(work.P_qq, n, F, 1)
    backward(work.P_qq, n, F, 1)
    for c in range(N):
        for j in range(n):
            a[c] += P[N * c + 6 + j] * F[j]


@kernel
def govern(first, rows, N, M_inv, P, work):
    """Add the acceleration of attitude or station to work.a, and take its motion out of P. Its Jacobian is T (rows, 3)
    in the columns from ``first`` on, and b its demand; both are lost."""
    T, b, X, S, V, x, a = work.T, work.b, work.X, work.S, work.V, work.x, work.a
    whiten(first, rows, N, M_inv, work)
    for i in range(rows):  # X = J P, S = X J^T
        for c in range(N):
            X[N * i + c] = 0.0
            for k in range(3):
                X[N * i + c] += T[3 * i + k] * P[N * (first + k) + c]
    for i in range(rows):
        for j in range(rows):
            S[rows * i + j] = 0.0
            for k in range(3):
                S[rows * i + j] += X[N * i + first + k] * T[3 * j + k]
    symmetric_eigen(S, rows, V)
    for i in range(rows):
        sigma = S[rows * i + i]
        f = 1.0 / sigma if sigma >= FREEDOM else (3.0 - 2.0 * sigma / FREEDOM) * sigma / (FREEDOM * FREEDOM)
        demand = 0.0
        for j in range(rows):
            demand += V[rows * i + j] * b[j]
        for c in range(N):
            x[c] = 0.0
            for j in range(rows):
                x[c] += V[rows * i + j] * X[N * j + c]
        for c in range(N):
            a[c] += f * demand * x[c]
            for d in range(N):
                P[N * c + d] -= f * x[c] * x[d]


@kernel
def whiten(first, rows, N, M_inv, work):
    """T becomes L^-1 T and b becomes L^-1 (b - T a), for L L^T = T M^-1 T^T, so that the rows are as free as each
    other and without coupling while nothing is taken."""
    T, b, X, G = work.T, work.b, work.X, work.G
    for i in range(rows):
        for c in range(3):
            X[3 * i + c] = 0.0
            for k in range(3):
                X[3 * i + c] += T[3 * i + k] * M_inv[N * (first + k) + first + c]
            b[i] -= T[3 * i + c] * work.a[first + c]
    for i in range(rows):
        for j in range(rows):
            G[rows * i + j] = 0.0
            for c in range(3):
                G[rows * i + j] += X[3 * i + c] * T[3 * j + c]
    cholesky(G, rows, G)
    forward(G, rows, T, 3)
    forward(G, rows, b, 1)


@kernel
def slow(rate, zeta, N, M, P, work):
    """Let the motion that no level governs, P M zeta, decay with the rate [1/s]."""
    for i in range(N):
        work.x[i] = 0.0
        for j in range(N):
            work.x[i] += M[N * i + j] * zeta[j]
    for i in range(N):
        for j in range(N):
            work.a[i] -= rate * P[N * i + j] * work.x[j]
