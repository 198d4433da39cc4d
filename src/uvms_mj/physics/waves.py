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


_TO_WHOLE = 6755399441055744.0
"""1.5 2^52: added to a number of up to 2^51 and taken off again, it leaves the nearest integer."""
_PER_TURN, _TURN, _TURN_LOW = 0.15915494309189535, 6.2831853069365025, 2.430840202602477e-10
"""One over 2 pi, and 2 pi in two parts, of which the first has 32 bits."""


@kernel
def turned(theta):
    """The cosine and the sine of an angle up to 1e6 rad, within 1e-14 and a rounding of the angle.

    They are series up to pi / 4 of a quarter of what is left of whole turns, which is doubled twice. There is no branch
    and no long chain of products that wait for each other, so that a processor computes several components at once:
    with thirty of them a step takes four fifths of the time that it takes with the functions of ``math``.
    """
    turns = (theta * _PER_TURN + _TO_WHOLE) - _TO_WHOLE
    r = 0.25 * ((theta - turns * _TURN) - turns * _TURN_LOW)
    q = r * r
    q2, q4 = q * q, (q * q) * (q * q)
    s = ((1.0 - q * (1.0 / 6.0)) + q2 * (1.0 / 120.0 - q * (1.0 / 5040.0))) + q4 * (
        (1.0 / 362880.0 - q * (1.0 / 39916800.0)) + q2 * (1.0 / 6227020800.0 - q * (1.0 / 1307674368000.0))
    )
    c = ((1.0 - q * 0.5) + q2 * (1.0 / 24.0 - q * (1.0 / 720.0))) + q4 * (
        (1.0 / 40320.0 - q * (1.0 / 3628800.0)) + q2 * (1.0 / 479001600.0 - q * (1.0 / 87178291200.0))
    )
    s *= r
    s, c = 2.0 * s * c, 1.0 - 2.0 * (s * s)
    return 1.0 - 2.0 * (s * s), 2.0 * s * c


@kernel
def add_waves(waves, t, p_W, v, v_dot, gradient):
    """Add the motion of the water by the components (n,) of a sea at the place p_W (3,) [m, W] and the time t [s]: its
    velocity to v (3,) [m/s, W], the time derivative at this place to v_dot (3,), and the derivatives of v_i by x_j to
    gradient (3, 3) [1/s]. All components of a sea have one surface."""
    x, y, below = p_W[0], p_W[1], False
    v_x, v_y, v_z, a_x, a_y, a_z = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    g_xx, g_xy, g_yy, g_xz, g_yz = 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(waves.shape[0]):
        wave = waves[n]
        k, omega, e_x, e_y, z = wave.k, wave.omega, wave.e[0], wave.e[1], min(p_W[2] - wave.surface, 0.0)
        theta = k * (e_x * x + e_y * y) - omega * t + wave.phase
        u = wave.rate * math.exp(k * z)
        w = u
        if wave.bottom != 0.0:
            mirrored = wave.bottom * wave.rate * wave.rate / u
            u, w = u + mirrored, w - mirrored
        cosine, sine = turned(theta)
        along, up = u * cosine, w * sine
        v_x, v_y, v_z = v_x + along * e_x, v_y + along * e_y, v_z + up
        along, up = u * sine, w * cosine
        a_x, a_y, a_z = a_x + omega * (along * e_x), a_y + omega * (along * e_y), a_z - omega * up
        s_x, s_y, shear = k * along * e_x, k * along * e_y, k * up  # of -du/de = dw/dz, and du/dz = dw/de
        g_xx, g_xy, g_yy = g_xx - s_x * e_x, g_xy - s_x * e_y, g_yy - s_y * e_y
        g_xz, g_yz = g_xz + shear * e_x, g_yz + shear * e_y
        below = z < 0.0
    v[0], v[1], v[2] = v[0] + v_x, v[1] + v_y, v[2] + v_z
    v_dot[0], v_dot[1], v_dot[2] = v_dot[0] + a_x, v_dot[1] + a_y, v_dot[2] + a_z
    gradient[0, 0] += g_xx
    gradient[0, 1] += g_xy
    gradient[1, 0] += g_xy
    gradient[1, 1] += g_yy
    gradient[2, 0] += g_xz
    gradient[2, 1] += g_yz
    if below:
        gradient[0, 2] += g_xz
        gradient[1, 2] += g_yz
        gradient[2, 2] -= g_xx + g_yy


@kernel
def surface_of(waves, t, p_W, rise, n) -> float:
    """The height of the surface of a sea (n,) above the mean one at the place p_W (3,) and the time t [s]: [m]. Sets
    rise (3,) to its rate [m/s] and the rates of its slopes along x and y [1/s], and n (3,) to the unit vector normal to
    the surface, up."""
    height, slope_x, slope_y = 0.0, 0.0, 0.0
    rise[:] = 0.0
    for k in range(waves.shape[0]):
        wave = waves[k]
        if wave.omega > 0.0:  # a reset leaves an empty record of a wave that it takes away
            cosine, sine = turned(wave.k * (wave.e[0] * p_W[0] + wave.e[1] * p_W[1]) - wave.omega * t + wave.phase)
            a = wave.rate * (1.0 - wave.bottom) / wave.omega
            height += a * cosine
            slope_x -= a * wave.k * wave.e[0] * sine
            slope_y -= a * wave.k * wave.e[1] * sine
            rise[0] += a * wave.omega * sine
            rise[1] += a * wave.k * wave.omega * wave.e[0] * cosine
            rise[2] += a * wave.k * wave.omega * wave.e[1] * cosine
    up = 1.0 / math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    n[0], n[1], n[2] = -up * slope_x, -up * slope_y, up
    return height
