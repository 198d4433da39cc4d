r"""Drag of a tether on the vehicle, as a lumped quadratic drag at the point of attachment.

With the velocity :math:`w` of the water relative to the vehicle at the point :math:`r_t`, the force of a cable of the
length L and the diameter d is

.. math::

    f = \tfrac12 \rho\, C_d\, d\, L\, |w|\, w, \qquad w = -(v_r + \omega \times r_t),

the cross-flow drag of a cylinder (Fossen 2021, sec. 6.4.3, Morison's equation without inertia). The cable's own motion,
weight, tension and inertia are neglected. L is the length whose drag the vehicle bears: half of a straight cable across
the current that is held at its other end. Its power in the water is never positive.
"""

import math

from .kernels import kernel

RHO = 1000.0
"""Density of the water for the drag of the tether [kg/m^3]. Sea water has 2.5 % more, which is far less than the drag
coefficient is uncertain."""


def drag_factor(length: float, diameter: float, drag_coefficient: float) -> float:
    """f / (abs(w) w) of a cable [N s^2/m^2]."""
    return 0.5 * RHO * drag_coefficient * diameter * length


@kernel
def add_tether(factor, r_t, nu_r, tau):
    """Add the wrench of a tether at r_t (3,) [m, B] to tau (6,) [N, N m, B]; nu_r (6,) is the velocity relative to the
    water [m/s, rad/s, B], ``factor`` that of :func:`drag_factor`."""
    x = -(nu_r[0] + nu_r[4] * r_t[2] - nu_r[5] * r_t[1])
    y = -(nu_r[1] + nu_r[5] * r_t[0] - nu_r[3] * r_t[2])
    z = -(nu_r[2] + nu_r[3] * r_t[1] - nu_r[4] * r_t[0])
    drag = factor * math.sqrt(x * x + y * y + z * z)
    tau[0] += drag * x
    tau[1] += drag * y
    tau[2] += drag * z
    tau[3] += drag * (r_t[1] * z - r_t[2] * y)
    tau[4] += drag * (r_t[2] * x - r_t[0] * z)
    tau[5] += drag * (r_t[0] * y - r_t[1] * x)
