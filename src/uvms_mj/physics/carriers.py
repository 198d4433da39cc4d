"""Frames that contact bodies are fixed to on a vehicle with an arm: B, the frame of a link, or that of a site.

A contact is computed in the frame C of its carrier, as that of a rigid vehicle is in B. The force then acts on the link
that carries C.
"""

import numpy as np

from .frames import compose_poses, motion_at
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
        ("V", "f8", (6,)),  # velocity about B's origin in B
        ("nu", "f8", (6,)),  # velocity, in C [m/s, rad/s]
        ("tau", "f8", (6,)),  # forces of the springs of all contacts as a wrench at C's origin, in C [N, N m]
        ("f_W", "f8", (3,)),  # contact force that acted in the step [N]
        # of the instant before, for the work on the walls
        ("p_before", "f8", (3,)),  # position in W
        ("f_before_W", "f8", (3,)),
        ("moment_before", "f8", (3,)),  # in C
    ],
    align=True,
)
"""One carrier: its place on a link, its pose and velocity, and the contact forces on it."""


@kernel
def ride(carrier, p_WB, R_WB, nu):
    """Set the pose of a carrier in W from that of B, and start its velocity with that of the base, nu (6,)."""
    compose_poses(R_WB, p_WB, carrier.R_BC, carrier.p_BC, carrier.R_WC, carrier.p_WC)
    for i in range(6):
        carrier.V[i] = nu[i]


@kernel
def arrive(carrier):
    """Finish the velocity of a carrier."""
    motion_at(carrier.R_BC, carrier.p_BC, carrier.V, carrier.nu)
