r"""Force between one surface and one contact body of the vehicle, from the state of the same instant.

A contact body is a sphere, or a capsule: all points within a radius of a segment. It is fixed to a frame C, which is B
for a rigid vehicle. The depth is
:math:`\delta = r - d`, with the distance d of the sphere's centre, or of the nearest point of the segment, from the
surface (:mod:`.surfaces`). The contact point is halfway between the two surfaces, and its velocity v is relative to the
wall, which may move. The wall yields by w, and the bumper of the contact body, in series with it, by x:

.. math::

    \delta = w + x, \qquad F_n = \max(0, F_c(w) + b_c \dot w) = \max(0, k_b x + b_b \dot x), \qquad
    F_c(w) = \begin{cases} k_c w & w \le w_1 \\ k_c w_1 + k_1 (w - w_1) & w > w_1 \end{cases}

A wall of one layer has :math:`w_1 = \infty`. A body without a bumper has x = 0. Otherwise x is a state. It follows from
the balance of both forces by one step of implicit Euler, which is stable for any step, exact without dampers and for a
motion of constant speed:

.. math::

    \frac{b_b + b_c}{h} (x_k - x_{k-1}) + k_b x_k = F_c(\delta_k - x_k) + b_c \dot\delta_k

Without contact the bumper returns by itself, :math:`k_b x + b_b \dot x = 0`, and the wall at once. Friction is that of
:mod:`.contact`.
"""

import numpy as np

from .contact import CONTACT, point_velocity, press, release
from .frames import to_world
from .kernels import kernel
from .surfaces import nearest_on_segment, signed_distance

PAIR = np.dtype(
    [
        ("contact", CONTACT),
        ("surface", "i8"),  # index of the SURFACE
        ("capsule", "i8"),  # whether the body has two ends
        ("carrier", "i8"),  # index of the frame C that the body is fixed to
        ("solved", "i8"),  # whether the engine's contact solver applies the normal force
        ("ends_C", "f8", (2, 3)),  # of the segment, or the centre, in C [m]
        ("radius", "f8"),  # [m]
        ("layer_depth", "f8"),  # w_1 [m]
        ("layer_stiffness", "f8"),  # k_1 [N/m]
        ("bumper_stiffness", "f8"),  # k_b [N/m], or 0 without a bumper
        ("bumper_damping", "f8"),  # b_b [N s/m]
        ("compression", "f8"),  # x, of the bumper [m]
        ("depth", "f8"),  # delta, or 0 [m]
        ("f_n", "f8"),  # normal force [N]
        ("centre_W", "f8", (3,)),
        ("end_W", "f8", (3,)),  # scratch
    ],
    align=True,
)
"""One contact body in front of one surface: settings, state, and force of the latest instant."""


@kernel
def pair_force(pair, surface, p_WC, R_WC, nu, timestep):
    """Set the force of a contact body at this instant, and advance the states of the contact. Call it once per step.

    Args:
        pair: a PAIR record.
        surface: its SURFACE record, at this instant.
        p_WC: (3,) position of C's origin [m].
        R_WC: (3, 3) attitude of C.
        nu: (6,) velocity of C, in C [m/s, rad/s].
        timestep: [s].
    """
    contact, c = pair.contact, pair.centre_W
    n, arm, v = contact.normal_W, contact.arm_W, contact.work
    for i in range(3):
        v[i] = pair.ends_C[0, i]
    to_world(R_WC, v, c)
    for i in range(3):
        c[i] += p_WC[i]
    if pair.capsule != 0:
        nearest_of_capsule(pair, surface, p_WC, R_WC)
    distance = signed_distance(surface, c, n) - pair.radius
    pair.depth = max(0.0, -distance)
    pair.f_n = 0.0
    if distance >= 0.0 or -distance <= recovered(pair, timestep):
        pair.compression = recovered(pair, timestep)
        release(contact)
        return
    for i in range(3):
        arm[i] = c[i] - p_WC[i] - (pair.radius + 0.5 * distance) * n[i]
    point_velocity(R_WC, nu, arm, v)
    v_n = 0.0
    for i in range(3):
        v[i] -= surface.v_W[i]
        v_n += n[i] * v[i]
    pair.f_n = series_force(pair, -distance, -v_n, timestep)
    press(contact, pair.f_n, v_n, R_WC, timestep)


@kernel
def nearest_of_capsule(pair, surface, p_WC, R_WC):
    """Move the centre from the first end to the point of the segment that is nearest to the surface."""
    c, end = pair.centre_W, pair.end_W
    for i in range(3):
        end[i] = pair.ends_C[1, i]
    to_world(R_WC, end, end)
    for i in range(3):
        end[i] += p_WC[i]
    part = nearest_on_segment(surface, c, end)
    for i in range(3):
        c[i] += part * (end[i] - c[i])


@kernel
def recovered(pair, timestep) -> float:
    """The bumper's compression after one more step without contact [m]."""
    if pair.bumper_damping == 0.0:
        return 0.0
    return pair.compression / (1.0 + timestep * pair.bumper_stiffness / pair.bumper_damping)


@kernel
def series_force(pair, depth, rate, timestep) -> float:
    """The normal force [N] of wall and bumper at a depth [m] that grows with a rate [m/s]; advances the bumper."""
    k, b, f_0 = pair.contact.stiffness, pair.contact.damping, 0.0
    k_b, b_b, x_0 = pair.bumper_stiffness, pair.bumper_damping, pair.compression
    if k_b == 0.0:
        if depth > pair.layer_depth:
            f_0 = (k - pair.layer_stiffness) * pair.layer_depth
            k = pair.layer_stiffness
        return max(0.0, f_0 + k * depth + b * rate)
    held = (b + b_b) / timestep
    x = (held * x_0 + k * depth + b * rate) / (held + k_b + k)
    if depth - x > pair.layer_depth:
        f_0 = (k - pair.layer_stiffness) * pair.layer_depth
        k = pair.layer_stiffness
        x = (held * x_0 + f_0 + k * depth + b * rate) / (held + k_b + k)
    f_n = k_b * x + b_b * (x - x_0) / timestep
    if f_n <= 0.0:
        pair.compression = recovered(pair, timestep)
        return 0.0
    pair.compression = x
    return f_n
