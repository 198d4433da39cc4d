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

The surface is at :math:`\eta = a \cos\theta`. The pressure exceeds the pressure of still water by

.. math::

    p = \rho g a\, \frac{\cosh k(z + d)}{\cosh k d} \cos\theta = \rho\, \frac{\omega}{k}\, u,

and :math:`p / \rho g` is its head: a sensor of the pressure reads so much more depth. The theory is linear in the
steepness; the water's acceleration is taken whole, with :math:`(v \cdot \nabla) v`, which measured loads on a submerged
vehicle ask for (Sayer, Ocean Engineering 35, 2008, p. 41).
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
        ("head", "f8"),  # omega / (g k), pressure head over u [s]
    ],
    align=True,
)
"""One component of the sea."""


_TO_WHOLE = 6755399441055744.0
"""1.5 2^52: added to a number of up to 2^51 and taken off again, it leaves the nearest integer."""
_PER_TURN, _TURN, _TURN_LOW = 0.15915494309189535, 6.2831853069365025, 2.430840202602477e-10
"""One over 2 pi, and 2 pi in two parts, of which the first has 32 bits."""
_MIDDLE = 2.061153622438558e-09
"""e^-20."""


@kernel
def turned(theta):
    """The cosine and the sine of an angle up to 1e6 rad, within 1e-14 and a rounding of the angle.

    They are series up to pi / 4 of a quarter of what is left of whole turns, which is doubled twice. There is no branch
    and no table, so that a processor computes several components at once, each with the bits that it has alone.
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
def decayed(x):
    """e^x of a number x <= 0, within 1e-14 of itself, and e^-40 below -40.

    It is a series of x / 64, about the middle of its range, that is squared six times, without a branch or a table as
    in :func:`turned`.
    """
    r = (max(x, -40.0) + 20.0) * (1.0 / 64.0)
    q, q2 = r * r, (r * r) * (r * r)
    y = ((1.0 + r) + q * (0.5 + r * (1.0 / 6.0))) + q2 * (
        (1.0 / 24.0 + r * (1.0 / 120.0)) + q * (1.0 / 720.0 + r * (1.0 / 5040.0))
    )
    y += (q2 * q2) * (
        ((1.0 / 40320.0 + r * (1.0 / 362880.0)) + q * (1.0 / 3628800.0 + r * (1.0 / 39916800.0)))
        + q2 * (1.0 / 479001600.0 + r * (1.0 / 6227020800.0))
    )
    for _ in range(6):
        y *= y
    return y * _MIDDLE


@kernel
def add_waves(waves, t, p_W, v, v_dot, gradient) -> float:
    """Add the motion of the water by the components (n,) of a sea at the place p_W (3,) [m, W] and the time t [s]: its
    velocity to v (3,) [m/s, W], the time derivative at this place to v_dot (3,), and the derivatives of v_i by x_j to
    gradient (3, 3) [1/s]. All components of a sea have one surface. Returns the pressure head of the waves [m]."""
    x, y = p_W[0], p_W[1]
    z = min(p_W[2] - waves[0].surface, 0.0)  # behind the sea's records a reset may leave empty ones
    count = waves.shape[0]
    full = (count + 3) // 4 * 4 if count > 1 else 1  # whole vectors: a rest of them would take as long as they do
    theta, down, up, cosine, sine = np.zeros((5, full))
    for n in range(count):
        wave = waves[n]
        theta[n] = wave.k * (wave.e[0] * x + wave.e[1] * y) - wave.omega * t + wave.phase
        down[n] = wave.k * z
    for n in range(full):
        cosine[n], sine[n] = turned(theta[n])
        decay = decayed(down[n])
        down[n], up[n] = decay, 1.0 / decay
    head, v_x, v_y, v_z, a_x, a_y, a_z = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    g_xx, g_xy, g_yy, g_xz, g_yz = 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(count):
        wave = waves[n]
        k, omega, e_x, e_y = wave.k, wave.omega, wave.e[0], wave.e[1]
        falling, rising = wave.rate * down[n], wave.rate * (wave.bottom * up[n])
        c, s = falling + rising, falling - rising
        u, w = c * cosine[n], s * sine[n]  # along e, and up
        head += wave.head * u
        v_x, v_y, v_z = v_x + u * e_x, v_y + u * e_y, v_z + w
        u, w = c * sine[n], s * cosine[n]  # a quarter turn later
        a_x, a_y, a_z = a_x + omega * (u * e_x), a_y + omega * (u * e_y), a_z - omega * w
        s_x, s_y, shear = k * u * e_x, k * u * e_y, k * w  # of -du/de = dw/dz, and du/dz = dw/de
        g_xx, g_xy, g_yy = g_xx - s_x * e_x, g_xy - s_x * e_y, g_yy - s_y * e_y
        g_xz, g_yz = g_xz + shear * e_x, g_yz + shear * e_y
    v[0], v[1], v[2] = v[0] + v_x, v[1] + v_y, v[2] + v_z
    v_dot[0], v_dot[1], v_dot[2] = v_dot[0] + a_x, v_dot[1] + a_y, v_dot[2] + a_z
    gradient[0, 0] += g_xx
    gradient[0, 1] += g_xy
    gradient[1, 0] += g_xy
    gradient[1, 1] += g_yy
    gradient[2, 0] += g_xz
    gradient[2, 1] += g_yz
    if z < 0.0:
        gradient[0, 2] += g_xz
        gradient[1, 2] += g_yz
        gradient[2, 2] -= g_xx + g_yy
    return head


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
