r"""Couplings of two vehicles: a spring and a damper between a point of one and a point of the other.

With the points :math:`x_1, x_2` in W, their velocities, :math:`d = x_2 - x_1` and :math:`w = \dot x_2 - \dot x_1`, the
force on the first vehicle is for a **joint**, a spring without length that keeps two points together,

.. math::

    f = k d + b w,

and for a **spring** of the natural length L, a **cable**, which never pushes, and a **contact** of two spheres about
the points, whose radii together are L, which never pulls,

.. math::

    f = T \frac{d}{|d|}, \qquad T = k (|d| - L) + b\, \frac{d^\top w}{|d|}, \qquad
    T_{cable} = \begin{cases} \max(0, T) & |d| > L \\ 0 & \text{otherwise,} \end{cases} \qquad
    T_{contact} = \begin{cases} \min(0, T) & |d| < L \\ 0 & \text{otherwise.} \end{cases}

The force on the second vehicle is :math:`-f`. Both act at the middle of the two points, so that neither their sum nor
the sum of their moments is other than zero: the momentum of both vehicles together does not change, nor their angular
momentum about any point. The force of an instant acts during the step that begins then, as every force of a step of
semi-implicit Euler does.
"""

import math

import numpy as np

from .frames import rotation
from .kernels import kernel

COUPLING = np.dtype([("r", "f8", (3,))], align=True)
"""The point of a coupling in B [m]."""

PULLED = np.dtype(
    [
        ("tau", "f8", (6,)),  # about B's origin in B [N, N m]
        ("tau_next", "f8", (6,)),  # of the step that begins next
        ("f_W_next", "f8", (3,)),  # its force in W [N]
    ],
    align=True,
)
"""The wrench of a coupling on a vehicle."""

PULL = np.dtype([("f_W", "f8", (3,))], align=True)
"""Its force in W [N]. All pulls of a vehicle lie densely, as a recorded signal does."""

TIE = np.dtype(
    [
        ("r", "f8", (2, 3)),  # the points in B of each vehicle [m]
        ("stiffness", "f8"),  # k [N/m]
        ("damping", "f8"),  # b [N s/m]
        ("length", "f8"),  # L [m]
        ("kind", "i8"),  # a number of KINDS
    ],
    align=True,
)
"""A spring and damper between two vehicles."""

KINDS = {"joint": 0, "spring": 1, "cable": 2, "contact": 3}
"""The kinds of ties by name."""
_JOINT, _CABLE, _CONTACT = KINDS["joint"], KINDS["cable"], KINDS["contact"]
_TOUCHING = 1e-12
"""Distance of two points below which their direction is not known [m]."""


@kernel
def place_point(qpos, qvel, r, R, x, v):
    """Set the attitude R (3, 3), and the place x (3,) and velocity v (3,) in W of a point r (3,) in B."""
    rotation(qpos[3:7] / math.sqrt(qpos[3:7] @ qpos[3:7]), R)
    x[:] = qpos[:3] + R @ r
    v[:] = qvel[:3] + R @ np.cross(qvel[3:6], r)


@kernel
def pull_together(tie, qpos_1, qvel_1, qpos_2, qvel_2, pulled_1, pulled_2):
    """Set the force of a tie in the step that begins next, from the poses (7,) and velocities (6,) of two vehicles as
    free joints have them."""
    R_1, R_2 = np.zeros((3, 3)), np.zeros((3, 3))
    x_1, x_2, v_1, v_2 = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    place_point(qpos_1, qvel_1, tie.r[0], R_1, x_1, v_1)
    place_point(qpos_2, qvel_2, tie.r[1], R_2, x_2, v_2)
    d, w, f = x_2 - x_1, v_2 - v_1, np.zeros(3)
    distance = math.sqrt(d @ d)
    if tie.kind == _JOINT:
        f[:] = tie.stiffness * d + tie.damping * w
    elif distance > _TOUCHING:
        tension = tie.stiffness * (distance - tie.length) + tie.damping * (d @ w) / distance
        if tie.kind == _CABLE:
            tension = max(0.0, tension) if distance > tie.length else 0.0
        elif tie.kind == _CONTACT:
            tension = min(0.0, tension) if distance < tie.length else 0.0
        f[:] = tension / distance * d
    middle = 0.5 * (x_1 + x_2)
    pulled_1.f_W_next[:], pulled_2.f_W_next[:] = f, -f
    pulled_1.tau_next[:3], pulled_1.tau_next[3:] = R_1.T @ f, R_1.T @ np.cross(middle - qpos_1[:3], f)
    pulled_2.tau_next[:3], pulled_2.tau_next[3:] = -R_2.T @ f, -R_2.T @ np.cross(middle - qpos_2[:3], f)


@kernel
def begin_pull(pulled, pull):
    """Begin the step whose force has been found."""
    pull.f_W[:], pulled.tau[:] = pulled.f_W_next, pulled.tau_next
