r"""Surfaces in the water, and the signed distance of a point from them: planes, spheres, cylinders, boxes
and capsules.

A surface has a frame S with the attitude R_WS. In S, the face of a plane is x = 0 and the water is at x < 0, as in
front of the paper's wall; the axis of a cylinder or a capsule is z, and a cylinder has no ends; a box and a capsule are
centred. The distance is negative
inside, and its gradient is the normal out of the surface. For a point q in S:

.. math::

    d = -q_x, \qquad d = |q| - r, \qquad d = \sqrt{q_x^2 + q_y^2} - r, \qquad
    d = \left|\max(|q| - a, 0)\right| + \min(\max_i(|q_i| - a_i), 0)

for a plane, a sphere, a cylinder of the radius r and a box of the half edges a. A capsule is all points within r of a
segment of the half length b: the sphere about :math:`q_z` clipped to b.

**Motion.** A surface moves as a rigid body. Its place without motion turns about a pivot c by the rotation vector
:math:`\theta(t)`, in axes of W, and is displaced by u(t):

.. math::

    p_{WS} = c + R(\theta)\,(p_0 - c) + u, \qquad R_{WS} = R(\theta) R_0, \qquad
    \theta, u = a \sin(2\pi f t + \varphi) + \sum (c_k \cos\omega_k t + s_k \sin\omega_k t).

u also has a table over time, linear between its rows. The velocity of the surface's point at x is :math:`\dot p_{WS} +
\omega \times (x - p_{WS})`. With the unit quaternion :math:`Q = (\cos|\theta|/2,\ S\theta)`, :math:`S =
\sin(|\theta|/2)/|\theta|`, a smooth function of :math:`|\theta|^2`, the angular velocity is
:math:`\omega = 2\, \mathrm{vec}(\dot Q \bar Q)` and its rate :math:`2\, \mathrm{vec}(\ddot Q \bar Q)`.
"""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .frames import multiply, rotation, to_body, to_world, turning
from .kernels import kernel, record_of


@dataclass(frozen=True)
class Shape:
    """A shape of a wall beside its distance.

    Attributes:
        keys: of its size in a scenario [m].
        extent: the numbers (3,) of a SURFACE record from the values of the keys.
        size: the least length over which it is curved, from the extent; None of a flat one [m].
        drawn: its picture, from the extent: a geom's type with its size as in MJCF, or None for a plate.
    """

    keys: tuple[str, ...]
    extent: Callable[..., tuple[float, float, float]]
    size: Callable[[Sequence[float]], float] | None
    drawn: Callable[[Sequence[float]], tuple[Any, tuple[float, float, float]]] | None


DRAWN_LENGTH = 1.5
"""Length of the drawn part of an endless shape [m], of a cylinder at least its diameter."""
SHAPES: dict[str, Shape] = {
    "plane": Shape((), lambda: (0.0, 0.0, 0.0), None, None),
    "sphere": Shape(
        ("radius",), lambda r: (r, 0.0, 0.0), lambda e: e[0], lambda e: ("sphere", (e[0], 0.0, 0.0))
    ),
    "cylinder": Shape(
        ("radius",), lambda r: (r, 0.0, 0.0), lambda e: e[0],
        lambda e: ("cylinder", (e[0], max(0.5 * DRAWN_LENGTH, e[0]), 0.0)),
    ),
    "box": Shape(
        ("edges",), lambda edges: (0.5 * edges[0], 0.5 * edges[1], 0.5 * edges[2]), min,
        lambda e: ("box", (e[0], e[1], e[2])),
    ),
    "capsule": Shape(
        ("radius", "length"), lambda r, length: (r, 0.5 * length, 0.0), lambda e: e[0],
        lambda e: ("capsule", (e[0], e[1], 0.0)),
    ),
}  # fmt: skip
"""The shapes by name. A SURFACE record has the index. A shape that the kernels do not know is refused
(:func:`is_computed`)."""
PLANE, SPHERE, CYLINDER, BOX, CAPSULE = range(len(SHAPES))

SURFACE = np.dtype(
    [
        ("kind", "i8"),
        ("extent", "f8", (3,)),  # radius, or half edges [m]
        ("R_WS", "f8", (3, 3)),
        ("p_WS", "f8", (3,)),  # at this instant [m]
        ("v_W", "f8", (3,)),  # velocity at this instant [m/s]
        ("moves", "i8"),
        ("start_W", "f8", (3,)),  # p_WS without motion [m]
        ("table", "i8"),  # place in the numbers of the record; rows (time, displacement (3,) in W)
        ("rows", "i8"),
        ("row", "i8"),  # the latest one that has begun
        ("amplitude_W", "f8", (3,)),  # of the sine [m]
        ("frequency", "f8"),  # [Hz]
        ("phase", "f8"),  # [rad]
        ("swell", "i8"),  # place in the numbers; rows (omega [rad/s], c (3,), s (3,) [m, W])
        ("swell_rows", "i8"),
        ("turns", "i8"),
        ("pivot", "f8", (3,)),  # c [m, W]
        ("R_start", "f8", (3, 3)),  # R_WS without motion
        ("quat_start", "f8", (4,)),  # as a quaternion
        ("quat_WS", "f8", (4,)),  # at this instant
        ("turn_W", "f8", (3,)),  # amplitude of the sine of theta [rad]
        ("turn_frequency", "f8"),  # [Hz]
        ("turn_phase", "f8"),  # [rad]
        ("tilt", "i8"),  # place in the numbers; rows of theta, like the rows of the swell [rad/s, rad, rad]
        ("tilt_rows", "i8"),
        ("omega_W", "f8", (3,)),  # angular velocity at this instant [rad/s]
    ],
    align=True,
)
"""One surface: its shape, and its motion."""


@kernel
def move(surface, numbers, t):
    """Set position and velocity of a surface at the time t [s]. Times must not decrease from call to call.

    Before its first row and after its last one, the surface keeps the displacement of this row. Its table is in
    ``numbers``: rows of a time [s] and a displacement in W [m]. So are the rows of its swell.
    """
    p, v, unused = surface.p_WS, surface.v_W, np.zeros(3)
    p[:], v[:] = surface.start_W, 0.0
    add_sine(surface.amplitude_W, surface.frequency, surface.phase, t, p, v, unused)
    add_waves(numbers, surface.swell, surface.swell_rows, t, p, v, unused)
    if surface.turns != 0:
        turn(surface, numbers, t)
    if surface.rows == 0:
        return
    table = surface.table
    for k in range(surface.row + 1, surface.rows):
        if numbers[table + 4 * k] > t:
            break
        surface.row = k
    now = table + 4 * surface.row
    past = t - numbers[now]
    for i in range(3):
        here = numbers[now + 1 + i]
        if surface.row + 1 < surface.rows and past >= 0.0:
            rate = (numbers[now + 5 + i] - here) / (numbers[now + 4] - numbers[now])
            surface.v_W[i] += rate
            here += rate * past
        surface.p_WS[i] += here


@kernel
def add_sine(amplitude, frequency, phase, t, x, x_dot, x_ddot):
    """Add a sine of the amplitude (3,) and its first two time derivatives to x, x_dot and x_ddot (3,)."""
    omega = 2.0 * math.pi * frequency
    angle = omega * t + phase
    sine, cosine = math.sin(angle), omega * math.cos(angle)
    x += amplitude * sine
    x_dot += amplitude * cosine
    x_ddot -= amplitude * (omega * omega * sine)


@kernel
def add_waves(numbers, first, rows, t, x, x_dot, x_ddot):
    """Add the waves whose rows begin at a place in the numbers, and their time derivatives, to x, x_dot and x_ddot
    (3,)."""
    for k in range(rows):
        wave = first + 7 * k
        omega = numbers[wave]
        cosine, sine = math.cos(omega * t), math.sin(omega * t)
        for i in range(3):
            c, s = numbers[wave + 1 + i], numbers[wave + 4 + i]
            x[i] += c * cosine + s * sine
            x_dot[i] += omega * (s * cosine - c * sine)
            x_ddot[i] -= omega * omega * (c * cosine + s * sine)


@kernel
def turn(surface, numbers, t):
    """Add the turn of a surface to its place and its velocity."""
    theta, rate, unused = np.zeros(3), np.zeros(3), np.zeros(3)
    Q, Q_dot, R = np.zeros(4), np.zeros(4), np.zeros((3, 3))
    add_sine(surface.turn_W, surface.turn_frequency, surface.turn_phase, t, theta, rate, unused)
    add_waves(numbers, surface.tilt, surface.tilt_rows, t, theta, rate, unused)
    quaternion_of(theta, rate, unused, Q, Q_dot, np.zeros(4))
    rotation(Q, R)
    arm = surface.start_W - surface.pivot
    turned = R @ arm
    surface.omega_W[:] = 2.0 * turning(Q_dot, Q)
    surface.p_WS += turned - arm
    surface.v_W += np.cross(surface.omega_W, turned)
    surface.R_WS[:] = R @ surface.R_start
    multiply(Q, surface.quat_start, surface.quat_WS)


@kernel
def quaternion_of(theta, theta_dot, theta_ddot, Q, Q_dot, Q_ddot):
    """Set Q (4,), the unit quaternion of a rotation vector theta (3,) [rad], and its first two time derivatives."""
    m, m_dot = theta @ theta, 2.0 * (theta @ theta_dot)
    m_ddot = 2.0 * (theta_dot @ theta_dot + theta @ theta_ddot)
    C = math.cos(0.5 * math.sqrt(m))  # and S with its derivatives by m
    if m < 0.03:
        S = 0.5 - m / 48.0 * (1.0 - m / 80.0 * (1.0 - m / 168.0 * (1.0 - m / 288.0)))
        S_1 = -1.0 / 48.0 + m / 1920.0 * (1.0 - m / 112.0 * (1.0 - m / 216.0))
        S_2 = 1.0 / 1920.0 - m / 107520.0 * (1.0 - m / 144.0)
    else:
        S = math.sin(0.5 * math.sqrt(m)) / math.sqrt(m)
        S_1 = (C - 2.0 * S) / (4.0 * m)
        S_2 = (-0.25 * S - 6.0 * S_1) / (4.0 * m)
    Q[0], Q[1:] = C, S * theta
    Q_dot[0], Q_dot[1:] = -0.25 * S * m_dot, S_1 * m_dot * theta + S * theta_dot
    Q_ddot[0] = -0.25 * (S_1 * m_dot * m_dot + S * m_ddot)
    Q_ddot[1:] = (S_2 * m_dot * m_dot + S_1 * m_ddot) * theta + 2.0 * S_1 * m_dot * theta_dot + S * theta_ddot


@kernel
def surface_velocity(surface, x_W, v_W):
    """Set v_W (3,) to the velocity of the point of a surface's body at x_W (3,) [m/s]."""
    v_W[:] = surface.v_W
    if surface.turns != 0:
        v_W += np.cross(surface.omega_W, x_W - surface.p_WS)


@kernel
def signed_distance(surface, c_W, n_W) -> float:
    """The distance of a point c_W (3,) from a surface [m], negative inside. Sets the normal n_W (3,) out of it."""
    q, R = c_W - surface.p_WS, surface.R_WS
    if surface.kind == PLANE:
        n_W[:] = -R[:, 0]
        return -(R[:, 0] @ q)
    to_body(R, q, q)
    distance = 0.0
    if surface.kind == BOX:
        distance = from_box(q, surface.extent)
    elif surface.kind == SPHERE or surface.kind == CYLINDER or surface.kind == CAPSULE:
        if surface.kind == CYLINDER:
            q[2] = 0.0
        elif surface.kind == CAPSULE:
            q[2] -= min(surface.extent[1], max(-surface.extent[1], q[2]))
        distance = normalise(q) - surface.extent[0]
    else:  # a shape without a line here
        distance = math.nan
    to_world(R, q, n_W)
    return distance


@kernel
def normalise(q) -> float:
    """Make q (3,) a unit vector, -x if it is zero, and return its length."""
    size = math.sqrt(q @ q)
    if size == 0.0:
        q[:] = np.array([-1.0, 0.0, 0.0])
    else:
        q /= size
    return size


@kernel
def from_box(q, half) -> float:
    """The distance of a point q (3,) from a box of the half edges half (3,) [m]. Sets q to the normal, in S."""
    nearest = 0
    for i in range(1, 3):
        if abs(q[i]) - half[i] > abs(q[nearest]) - half[nearest]:
            nearest = i
    inside = abs(q[nearest]) - half[nearest]
    if inside <= 0.0:
        out = 1.0 if q[nearest] >= 0.0 else -1.0
        q[:] = 0.0
        q[nearest] = out
        return inside
    q -= np.clip(q, -half, half)
    return normalise(q)


@kernel
def nearest_on_segment(surface, a_W, b_W) -> float:
    """Where on the segment from a_W (3,) to b_W (3,) the point nearest to the centre of a sphere, or to the axis of a
    cylinder, is: 0 at a_W, 1 at b_W, 0.5 if the segment is parallel to the axis. NaN of another shape."""
    d, e, axis = b_W - a_W, surface.p_WS - a_W, surface.R_WS[:, 2]
    along, size, length = d @ e, d @ d, d @ d
    if surface.kind == CYLINDER:  # across the axis only
        axial = d @ axis
        along -= axial * (e @ axis)
        size -= axial * axial
    elif surface.kind != SPHERE:
        return math.nan
    if size <= 1e-12 * length:
        return 0.5
    return min(1.0, max(0.0, along / size))


@functools.cache
def is_computed(shape: str, capsule: bool = False) -> bool:
    """Whether the kernels know a shape: its distance from a point, or from the axis of a capsule."""
    surface, a, b = record_of(np.zeros(1, SURFACE)), np.array([0.5, 0.5, 0.5]), np.array([2.0, 1.0, 0.5])
    surface.kind, surface.extent[:], surface.R_WS[:] = list(SHAPES).index(shape), 0.25, np.eye(3)
    found = signed_distance(surface, a, np.zeros(3))
    if capsule and SHAPES[shape].size is not None:  # a flat shape is touched by both ends
        found += nearest_on_segment(surface, a, b)
    return math.isfinite(found)
