r"""Waves on the surface of the sea: the motion of the water below them in linear theory (Airy).

A component has the amplitude a, the angular frequency :math:`\omega` and the wave number k, which finite depth d joins
by the dispersion relation (Newman, "Marine Hydrodynamics", 1977, sec. 6.2; Faltinsen, "Sea Loads", 1990, table 2.1):

.. math::

    \omega^2 = g k \tanh k d.

It runs along the horizontal unit vector e. With the phase :math:`\theta = k\, e^\top x - \omega t + \varphi` and the
height :math:`z \le 0` above the mean surface, the water moves along e and z with

.. math::

    u = a \omega\, c(z) \cos\theta, \quad w = a \omega\, s(z) \sin\theta, \qquad
    c = \frac{\cosh k(z + d)}{\sinh k d}, \quad s = \frac{\sinh k(z + d)}{\sinh k d}.

Both are sums of exponentials that stay finite in any depth, :math:`c, s = (e^{kz} \pm b\, e^{-kz})/(1 - b)` with
:math:`b = e^{-2 k d}`. The field has no divergence and no curl, :math:`\partial_e u = -\partial_z w` and
:math:`\partial_z u = \partial_e w`. Above the mean surface the water moves as at the surface, without a gradient along
z.

The surface is at :math:`\eta = a \cos\theta`. The theory is linear in the steepness; the water's acceleration is taken
whole, with :math:`(v \cdot \nabla) v`, which measured loads on a submerged vehicle ask for (Sayer, Ocean Engineering
35, 2008, p. 41).
"""

import math

import numpy as np

from .kernels import kernel

WAVE = np.dtype(
    [
        ("rate", "f8"),  # a omega / (1 - b) [m/s]
        ("k", "f8"),  # [1/m]
        ("e", "f8", (2,)),  # in W
        ("omega", "f8"),  # [rad/s]
        ("phase", "f8"),  # [rad]
        ("surface", "f8"),  # z of the mean surface in W [m]
        ("bottom", "f8"),  # b; 0 for deep water
    ],
    align=True,
)
"""One component of the sea."""


@kernel
def add_wave(wave, t, p_W, v, v_dot, gradient):
    """Add the motion of the water at the place p_W (3,) [m, W] and the time t [s]: its velocity to v (3,) [m/s, W], the
    time derivative at this place to v_dot (3,), and the derivatives of v_i by x_j to gradient (3, 3) [1/s]."""
    k, omega, e_x, e_y, z = wave.k, wave.omega, wave.e[0], wave.e[1], min(p_W[2] - wave.surface, 0.0)
    theta = k * (e_x * p_W[0] + e_y * p_W[1]) - omega * t + wave.phase
    u = wave.rate * math.exp(k * z)
    w = u
    if wave.bottom != 0.0:
        below = wave.bottom * wave.rate * wave.rate / u
        u, w = u + below, w - below
    cosine, sine = math.cos(theta), math.sin(theta)
    along, up = u * cosine, w * sine
    v[0] += along * e_x
    v[1] += along * e_y
    v[2] += up
    along, up = u * sine, w * cosine
    v_dot[0] += omega * along * e_x
    v_dot[1] += omega * along * e_y
    v_dot[2] -= omega * up
    stretch, shear = k * along, k * up  # -du/de = dw/dz, du/dz = dw/de
    s_x, s_y = stretch * e_x, stretch * e_y
    gradient[0, 0] -= s_x * e_x
    gradient[0, 1] -= s_x * e_y
    gradient[1, 0] -= s_x * e_y
    gradient[1, 1] -= s_y * e_y
    gradient[2, 0] += shear * e_x
    gradient[2, 1] += shear * e_y
    if z < 0.0:
        gradient[0, 2] += shear * e_x
        gradient[1, 2] += shear * e_y
        gradient[2, 2] += stretch
