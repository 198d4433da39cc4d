r"""Hydrodynamics and dynamics of a vehicle with an arm, one link after another.

A vehicle with joints is a tree of links; the base is link 0. Its velocity is :math:`\zeta = [\nu; \dot q]` (6 + n),
with the velocity nu of the base in B and the joint velocities. Each link has a 6x6 inertia M about the origin of its
frame, in its axes; with added mass in it, it is not the inertia of a rigid body.

The motion V of link k, its acceleration A without the joints' share, and the axis S of its joint are spatial vectors
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
from typing import Any

import numpy as np

from .fossen import damping, turned_momentum
from .frames import compose_poses, motion_at, motion_from
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
        ("M_RB", "f8", (6, 6)),  # of a law's model, both parts of M with the factor of its Coriolis wrench
        ("M_A", "f8", (6, 6)),
        ("M_diagonal", "i8"),  # whether M is a diagonal, which most links have; 0 if nobody looked
        ("A_diagonal", "i8"),  # whether M_A is
        ("D_diagonal", "i8"),  # whether both damping matrices are
        ("mass", "f8"),  # whose weight counts, at r_g [kg, m]
        ("r_g", "f8", (3,)),
        ("displaced_mass", "f8"),  # [kg]
        ("r_b", "f8", (3,)),  # centre of buoyancy [m]
        ("f_ext", "f8", (6,)),  # contact forces, as a wrench about B's origin in B [N, N m]
        # of one instant
        ("V", "f8", (6,)),  # motion, and acceleration without the joints' share, about B's origin in B
        ("A", "f8", (6,)),
        ("nu", "f8", (6,)),  # the same at the link's origin in its axes
        ("a", "f8", (6,)),
        ("a_c_W", "f8", (3,)),  # in a sea: acceleration of the water at its centre of buoyancy less that at B [m/s^2]
        ("F", "f8", (6,)),  # wrench of the link and all that it carries, about B's origin in B
        ("F_C", "f8", (6,)),  # of a law's model, the wrenches of C and D; F then has the wrench of g
        ("F_D", "f8", (6,)),
        # blocks A, G, D of the inertia [A G; G^T D] of the link and all that it carries, about B's origin in B
        ("composite", "f8", (9, 3)),
    ],
    align=True,
)
"""One link of a tree: coefficients, motion, wrench and composite inertia."""


DAMPING = ("D_linear", "D_quadratic")


def link_records(vehicle: Any) -> np.ndarray:
    """LINK records (1 + n,) of a vehicle and its arm; the coefficients are zero."""
    links = np.zeros(1 + len(vehicle.arm.links), LINK)
    links["coriolis"] = 1.0
    return links


def find_diagonals(links: np.ndarray) -> None:
    """Note which matrices of LINK records (n,) are diagonals: their products take a sixth of the time."""
    beside = ~np.eye(6, dtype=bool)
    M, M_A, *D = (~links[name][:, beside].any(axis=1) for name in ("M", "M_A", *DAMPING))
    links["M_diagonal"], links["A_diagonal"], links["D_diagonal"] = M, M_A, D[0] & D[1]


@kernel
def place(frame, parent, q):
    """Set the pose of a link in B and the motion S of its joint, at the joint position q [rad or m]; ``parent`` is the
    frame of the link that carries it."""
    frame.R_PL[:] = frame.R_still + (math.cos(q) * frame.R_cos + math.sin(q) * frame.R_sin)
    frame.p_PL[:] = (frame.p_0 + frame.slope * q) - frame.R_PL @ frame.anchor
    compose_poses(parent.R_BL, parent.p_BL, frame.R_PL, frame.p_PL, frame.R_BL, frame.p_BL)
    motion_from(frame.R_BL, frame.p_BL, frame.axis, frame.S)


@kernel
def move(link, S, parent, q_dot):
    """Set V and A of a link from its parent's, at the velocity q_dot [rad/s or m/s] of its joint with the motion
    S (6,)."""
    v, omega, own = parent.V[:3], parent.V[3:], S * q_dot
    link.V[:] = parent.V + own
    link.A[:3] = parent.A[:3] + (np.cross(omega, own[:3]) + np.cross(v, own[3:]))  # (V x) S q_dot
    link.A[3:] = parent.A[3:] + np.cross(omega, own[3:])


@kernel
def move_base(base):
    """Set nu and a of the base from V and A."""
    base.nu[:], base.a[:] = base.V, base.A


@kernel
def move_frame(link, frame):
    """Set nu and a of a link behind a joint from V and A."""
    motion_at(frame.R_BL, frame.p_BL, link.V, link.nu)
    motion_at(frame.R_BL, frame.p_BL, link.A, link.a)


@kernel
def multiply(M, is_diagonal, x, out):
    """Set out (6,) to M x, for M (6, 6), which is known to be a diagonal unless ``is_diagonal`` is 0."""
    if is_diagonal != 0:
        out[:] = np.diag(M) * x
    else:
        out[:] = M @ x


@kernel
def momenta(link, C_nu, M_a):
    """Set C(nu) nu and M a (6,) of a link at its origin."""
    momentum = np.zeros(6)
    multiply(link.M, link.M_diagonal, link.nu, momentum)
    multiply(link.M, link.M_diagonal, link.a, M_a)
    turned_momentum(momentum, link.nu, C_nu)


@kernel
def coriolis_wrench(link, out):
    """Set out (6,) to M a + C(nu) nu of a link at its origin, without the links that it carries."""
    C_nu, M_a = np.zeros(6), np.zeros(6)
    momenta(link, C_nu, M_a)
    out[:] = link.coriolis * (C_nu + M_a)


@kernel
def damping_wrench(link, nu, out):
    """Set out (6,) to D(nu) nu of a link at its origin, for its velocity nu (6,) there."""
    D, Q = link.D_linear, link.D_quadratic
    if link.D_diagonal != 0:
        out[:] = np.diag(D) * nu + np.diag(Q) * (np.abs(nu) * nu)
    else:
        damping(D, Q, nu, out)


@kernel
def restoring_wrench(link, frame, gravity_B, out):
    """Set out (6,) to the restoring wrench g of a link about B's origin in B, minus its weight and its buoyancy, for
    the acceleration of gravity (3,) in B [m/s^2]."""
    m, d = link.mass, link.displaced_mass
    moment = frame.R_BL @ (m * link.r_g - d * link.r_b) + (m - d) * frame.p_BL  # of the masses [kg m]
    out[:3], out[3:] = (d - m) * gravity_B, np.cross(gravity_B, moment)


@kernel
def hand_down(link, parent):
    """Add the wrench F of a link to its parent's."""
    parent.F += link.F


@kernel
def along_joint(S, F) -> float:
    """The force or torque S^T F along a joint with the motion S (6,), of a wrench F (6,) about B's origin."""
    return S[:3] @ F[:3] + S[3:] @ F[3:]


@fused
def place_links(frames, q, first):
    """Set the frames (1 + n,) of all links at the joint positions, which are in q from the index ``first`` on."""
    for k in range(1, frames.shape[0]):
        place(frames[k], frames[frames[k].parent], q[first + k - 1])


@kernel
def move_links(links, frames, q_dot, first):
    """Set velocities and accelerations of all links from the base's and the joint velocities, which are in q_dot
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
    out[:6] = links[0].F


@kernel
def base_inertia(base):
    """Set the composite inertia of the base to its own."""
    M, J = base.M, base.composite
    for i in range(3):
        J[i], J[3 + i], J[6 + i] = M[i, :3], M[i, 3:], M[3 + i, 3:]


@kernel
def own_inertia(link, frame):
    r"""Set the composite inertia of a link behind a joint to its own, about B's origin in B.

    With the blocks A, B, D of the inertia in B's axes and S = S(p), X^T M X has the blocks A, G = B - A S and
    D - B^T S + S G.
    """
    M, R, p, J = link.M, frame.R_BL, frame.p_BL, link.composite
    if link.M_diagonal != 0:
        turn_diagonal(M, R, J)
    else:
        turn_blocks(M, R, J)
        for i in range(3):
            J[6 + i] -= np.cross(J[3:6, i], p)
    for i in range(3):
        J[3 + i] -= np.cross(J[i], p)
    for j in range(3):
        J[6:, j] += np.cross(p, J[3:6, j])


@kernel
def turn_diagonal(M, R, out):
    """Set out (9, 3) as :func:`turn_blocks` does, for a diagonal inertia M (6, 6), whose block B is zero."""
    m, inertia = np.diag(M)[:3], np.diag(M)[3:]
    out[:3], out[3:6], out[6:] = (R * m) @ R.T, 0.0, (R * inertia) @ R.T


@kernel
def turn_blocks(M, R, out):
    """Set out (9, 3) to R (block) R^T of the blocks A, B and D of an inertia M (6, 6)."""
    turn_block(M[:3, :3], R, out[:3])
    turn_block(M[:3, 3:], R, out[3:6])
    turn_block(M[3:, 3:], R, out[6:])


@kernel
def turn_block(block, R, out):
    """Set out (3, 3) to R (block) R^T."""
    for i in range(3):
        out[i] = R[i] @ block @ R.T


@kernel
def add_composite(link, parent):
    """Add the composite inertia of a link to its parent's."""
    parent.composite += link.composite


@kernel
def full_inertia(blocks, M):
    """Set M (6, 6) to the inertia with the blocks (9, 3) of a composite inertia."""
    for i in range(3):
        M[i, :3], M[i, 3:], M[3:, i], M[3 + i, 3:] = blocks[i], blocks[3 + i], blocks[3 + i], blocks[6 + i]


@kernel
def joint_column(link, S):
    """Set F of a link to its composite inertia times the motion S (6,) of its joint: the wrench that accelerates the
    joint alone."""
    A, G, D, v, omega = link.composite[:3], link.composite[3:6], link.composite[6:], S[:3], S[3:]
    for i in range(3):
        link.F[i], link.F[3 + i] = A[i] @ v + G[i] @ omega, G[:, i] @ v + D[i] @ omega


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
def measured_frames(run):
    """The frames (1 + n,) of the links at the measured positions of the joints: the true ones if the encoder is
    perfect."""
    if run.encoded == 0:
        return run.plant.frames
    place_links(run.frames_m, run.joints.q_m, 0)
    return run.frames_m
