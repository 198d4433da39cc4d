r"""Couplings of two vehicles: a spring and a damper between a point of one and a point of the other, or a contact body
of one in front of a surface of the other.

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

A **surface** is fixed to a frame of the second vehicle and moves as a rigid body with it. The force of a contact body
of the first vehicle on it is a wall's (:mod:`.contacts`), with the wall's velocity at the contact point, and its
reaction acts on the second vehicle at the same point.

A point, a contact body or a surface is fixed to a frame C of a vehicle: B, a link, or a site. With the motion V of the
link that carries it (:mod:`.tree`), a point at p in B has the velocity :math:`R_{WB} (V_v + V_\omega \times p)`. The
wrench at B's origin goes through the joints as a contact's does.

**Internal forces.** Of the forces f (3n) at n points :math:`x_i` of one body, the grasp map
:math:`G = [I \dots I;\ S(x_1) \dots S(x_n)]` gives the wrench G f. The part

.. math::

    f_{int} = (I - G^+ G) f

has none: it presses on the body, or pulls it apart, and moves nothing (Murray, Li and Sastry 1994, "A mathematical
introduction to robotic manipulation", ch. 5). At two points it is along their line.
"""

import math

import numpy as np

from .contacts import PAIR, pair_force
from .kernels import kernel
from .surfaces import SURFACE

COUPLING = np.dtype(
    [
        ("link", "i8"),  # that the frame C of the coupling is fixed to; the base is link 0
        ("p_LC", "f8", (3,)),  # pose of C in the link's frame [m]
        ("R_LC", "f8", (3, 3)),
    ],
    align=True,
)
"""One end of a coupling. Of a spring, the origin of C is its point."""

PULLED = np.dtype(
    [
        ("tau", "f8", (6,)),  # about B's origin in B [N, N m]
        ("tau_next", "f8", (6,)),  # of the step that begins next
        ("f_W_next", "f8", (3,)),  # its force in W [N]
        # the end at the instant at which this step begins
        ("p_WB", "f8", (3,)),
        ("R_WB", "f8", (3, 3)),
        ("p_WC", "f8", (3,)),
        ("R_WC", "f8", (3, 3)),
        ("v_W", "f8", (3,)),  # velocity of C's origin [m/s]
        ("omega_W", "f8", (3,)),  # angular velocity of C [rad/s]
    ],
    align=True,
)
"""The wrench of a coupling on a vehicle, and the motion of its end there."""

PULL = np.dtype([("f_W", "f8", (3,))], align=True)
"""Its force in W [N]. All pulls of a vehicle lie densely, as a recorded signal does."""

TIE = np.dtype(
    [
        ("stiffness", "f8"),  # k [N/m]
        ("damping", "f8"),  # b [N s/m]
        ("length", "f8"),  # L [m]
        ("kind", "i8"),  # a number of KINDS
    ],
    align=True,
)
"""A spring and damper between two vehicles."""

TOUCH = np.dtype([("timestep", "f8"), ("pair", PAIR), ("surface", SURFACE)], align=True)
"""A contact body of a vehicle in front of a surface of another one, with its state: settings, which whoever steps both
vehicles writes at the start, the stretch of its friction, and the latest force. ``start_W`` and ``R_start`` of the
surface are its pose in the frame C of its vehicle."""

KINDS = {"joint": 0, "spring": 1, "cable": 2, "contact": 3}
"""The kinds of ties by name."""
_JOINT, _CABLE, _CONTACT = KINDS["joint"], KINDS["cable"], KINDS["contact"]
_TOUCHING = 1e-12
"""Distance of two points below which their direction is not known [m]."""


@kernel
def pull_together(tie, pulled_1, pulled_2):
    """Set the force of a tie in the step that begins next, between its ends at two vehicles."""
    x_1, x_2 = pulled_1.p_WC, pulled_2.p_WC
    d, w, f = x_2 - x_1, pulled_2.v_W - pulled_1.v_W, np.zeros(3)
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
    act_at(pulled_1, pulled_2, f, 0.5 * (x_1 + x_2))


@kernel
def press_together(touch, pulled_1, pulled_2):
    """Set the force of a surface of the second vehicle on a contact body of the first one in the step that begins next,
    and advance the states of the contact. Call it once per step."""
    pair, surface, nu, f, at = touch.pair, touch.surface, np.zeros(6), np.zeros(3), pulled_1.p_WC.copy()
    arm, R = pulled_2.R_WC @ surface.start_W, pulled_1.R_WC
    surface.R_WS[:], surface.p_WS[:] = pulled_2.R_WC @ surface.R_start, pulled_2.p_WC + arm
    surface.v_W[:] = pulled_2.v_W + np.cross(pulled_2.omega_W, arm)
    surface.omega_W[:], surface.turns = pulled_2.omega_W, 1
    nu[:3], nu[3:] = R.T @ pulled_1.v_W, R.T @ pulled_1.omega_W
    pair_force(pair, surface, pulled_1.p_WC, R, nu, touch.timestep)
    if pair.contact.touching != 0:
        f[:] = pair.contact.f_W
        at += pair.contact.arm_W
    act_at(pulled_1, pulled_2, f, at)


@kernel
def act_at(pulled_1, pulled_2, f_W, x_W):
    """Let a force (3,) act at a point (3,) in W on the first vehicle, and its reaction on the second one."""
    R_1, R_2 = pulled_1.R_WB, pulled_2.R_WB
    pulled_1.f_W_next[:], pulled_2.f_W_next[:] = f_W, -f_W
    pulled_1.tau_next[:3], pulled_1.tau_next[3:] = R_1.T @ f_W, R_1.T @ np.cross(x_W - pulled_1.p_WB, f_W)
    pulled_2.tau_next[:3], pulled_2.tau_next[3:] = -R_2.T @ f_W, -R_2.T @ np.cross(x_W - pulled_2.p_WB, f_W)


@kernel
def begin_pull(pulled, pull):
    """Begin the step whose force has been found."""
    pull.f_W[:], pulled.tau[:] = pulled.f_W_next, pulled.tau_next


def internal_forces(points: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """The internal forces (..., n, 3) among forces (..., n, 3) that act at n points (..., n, 3) of one body, all in the
    same axes [N, m]: pushes and pulls against each other, without a force or a moment on the body. Its error is
    rounding."""
    x, f = np.asarray(points, float), np.asarray(forces, float)
    *before, n, _ = x.shape
    arms = x - x.mean(axis=-2, keepdims=True)  # the null space of G is the same about any point
    size = np.sqrt((arms**2).sum(axis=(-2, -1), keepdims=True))
    arms = arms / np.where(size > _TOUCHING, size, 1.0)
    G = np.zeros((*before, 6, n, 3))
    G[..., :3, :, :] = np.eye(3)[:, None, :]
    G[..., 3, :, 1], G[..., 3, :, 2] = -arms[..., 2], arms[..., 1]
    G[..., 4, :, 2], G[..., 4, :, 0] = -arms[..., 0], arms[..., 2]
    G[..., 5, :, 0], G[..., 5, :, 1] = -arms[..., 1], arms[..., 0]
    G, flat = G.reshape(*before, 6, 3 * n), f.reshape(*before, 3 * n, 1)
    moving = np.linalg.pinv(G, rcond=1e-9) @ (G @ flat)
    internal: np.ndarray = (flat - moving).reshape(f.shape)
    return internal
