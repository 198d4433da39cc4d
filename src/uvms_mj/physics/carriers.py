"""Frames that contact bodies are fixed to on a vehicle with an arm: B, the frame of a link, or that of a site.

A contact is computed in the frame C of its carrier, as that of a rigid vehicle is in B. The force then acts on the link
that carries C.
"""

import numpy as np

from .frames import to_body, to_world
from .kernels import kernel

CARRIER = np.dtype(
    [
        ("link", "i8"),  # index of the link that it is fixed to; the base is link 0
        ("p_LC", "f8", (3,)),  # pose in the link's frame [m]
        ("R_LC", "f8", (3, 3)),
        # of one instant
        ("p_BC", "f8", (3,)),  # pose in B [m]
        ("R_BC", "f8", (3, 3)),
        ("p_WC", "f8", (3,)),  # pose in W [m]
        ("R_WC", "f8", (3, 3)),
        ("v_B", "f8", (6,)),  # velocity in B's axes
        ("nu", "f8", (6,)),  # velocity, in C [m/s, rad/s]
        ("tau", "f8", (6,)),  # all contact forces as a wrench at C's origin, in C [N, N m]
        ("applied", "f8", (6,)),  # the part that MuJoCo's contact solver does not apply
        # of the instant before, for the work on the walls
        ("p_before", "f8", (3,)),  # position in W
        ("f_before_W", "f8", (3,)),
        ("moment_before", "f8", (3,)),  # in C
    ],
    align=True,
)
"""One carrier: its place on a link, its pose and velocity, and the contact forces on it."""


@kernel
def stand_on(carrier, p_BL, R_BL):
    """Set the pose of a carrier in B from that of its link, p_BL (3,) [m] and R_BL (3, 3)."""
    R = carrier.R_LC
    to_world(R_BL, carrier.p_LC, carrier.p_BC)
    for i in range(3):
        carrier.p_BC[i] += p_BL[i]
        a, b, c = R_BL[i, 0], R_BL[i, 1], R_BL[i, 2]
        for j in range(3):
            carrier.R_BC[i, j] = a * R[0, j] + b * R[1, j] + c * R[2, j]


@kernel
def ride(carrier, p_WB, R_WB, nu):
    """Set the pose of a carrier in W from that of B, and start its velocity with the part of the base's nu (6,)."""
    p, R, v = carrier.p_BC, carrier.R_BC, carrier.v_B
    to_world(R_WB, p, carrier.p_WC)
    for i in range(3):
        carrier.p_WC[i] += p_WB[i]
        a, b, c = R_WB[i, 0], R_WB[i, 1], R_WB[i, 2]
        for j in range(3):
            carrier.R_WC[i, j] = a * R[0, j] + b * R[1, j] + c * R[2, j]
    v[0] = nu[0] + nu[4] * p[2] - nu[5] * p[1]
    v[1] = nu[1] + nu[5] * p[0] - nu[3] * p[2]
    v[2] = nu[2] + nu[3] * p[1] - nu[4] * p[0]
    for i in range(3):
        v[3 + i] = nu[3 + i]


@kernel
def ride_joint(carrier, link, q_dot):
    """Add the velocity by the joint of one of the links that carry a carrier, at q_dot [rad/s or m/s]."""
    R, S, v = link.R_BL, link.S, carrier.v_B
    x, y, z = carrier.p_BC[0] - link.p_BL[0], carrier.p_BC[1] - link.p_BL[1], carrier.p_BC[2] - link.p_BL[2]
    a = R[0, 0] * S[3] + R[0, 1] * S[4] + R[0, 2] * S[5]
    b = R[1, 0] * S[3] + R[1, 1] * S[4] + R[1, 2] * S[5]
    c = R[2, 0] * S[3] + R[2, 1] * S[4] + R[2, 2] * S[5]
    v[0] += (R[0, 0] * S[0] + R[0, 1] * S[1] + R[0, 2] * S[2] + b * z - c * y) * q_dot
    v[1] += (R[1, 0] * S[0] + R[1, 1] * S[1] + R[1, 2] * S[2] + c * x - a * z) * q_dot
    v[2] += (R[2, 0] * S[0] + R[2, 1] * S[1] + R[2, 2] * S[2] + a * y - b * x) * q_dot
    v[3] += a * q_dot
    v[4] += b * q_dot
    v[5] += c * q_dot


@kernel
def arrive(carrier):
    """Finish the velocity of a carrier, and take its forces of the last instant away."""
    R, v = carrier.R_BC, carrier.v_B
    to_body(R, v, carrier.nu)
    for i in range(3):
        carrier.nu[i + 3] = R[0, i] * v[3] + R[1, i] * v[4] + R[2, i] * v[5]
    for i in range(6):
        carrier.tau[i] = 0.0
        carrier.applied[i] = 0.0


@kernel
def add_turned(R, p, tau, out):
    """Add to out (6,) a wrench tau (6,) at the origin of a frame with the pose p (3,), R (3, 3), as one at the origin
    of the frame in which that pose is given."""
    x = R[0, 0] * tau[0] + R[0, 1] * tau[1] + R[0, 2] * tau[2]
    y = R[1, 0] * tau[0] + R[1, 1] * tau[1] + R[1, 2] * tau[2]
    z = R[2, 0] * tau[0] + R[2, 1] * tau[1] + R[2, 2] * tau[2]
    out[0] += x
    out[1] += y
    out[2] += z
    out[3] += R[0, 0] * tau[3] + R[0, 1] * tau[4] + R[0, 2] * tau[5] + p[1] * z - p[2] * y
    out[4] += R[1, 0] * tau[3] + R[1, 1] * tau[4] + R[1, 2] * tau[5] + p[2] * x - p[0] * z
    out[5] += R[2, 0] * tau[3] + R[2, 1] * tau[4] + R[2, 2] * tau[5] + p[0] * y - p[1] * x
