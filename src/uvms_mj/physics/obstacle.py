r"""The current in front of a face, and around a pile: two-dimensional potential flow, with the current far away.

In the plane across the edges of the face, or across the axis of the pile, a place is :math:`Z = X + iY`, X along the
unit vector n and Y along e, from the middle of the face or from the axis. The part of the water's velocity in this
plane is :math:`u_n - i u_e = w(Z)` with w analytic, so that the flow has no divergence and no curl. Its part along
n x e stays the current's. With the current :math:`U_n, U_e` far away (Milne-Thomson, "Theoretical hydrodynamics",
1968)

.. math::

    w = U_n \frac{Z}{\sqrt{Z^2 + L^2}} - i U_e, \qquad w = U_n - i U_e - (U_n + i U_e) \frac{a^2}{Z^2}

for a plate of the half width L with the normal n, and for a pile of the radius a. No water crosses either. Both are
linear in the current, which may change with time. Behind the plate and behind the pile real water has a wake, which is
not in it.

The gradient follows from :math:`w' = dw/dZ`: :math:`\partial_X u_n = -\partial_Y u_e = \mathrm{Re}\, w'` and
:math:`\partial_Y u_n = \partial_X u_e = -\mathrm{Im}\, w'`.
"""

import math

import numpy as np

from .kernels import kernel

OBSTACLE = np.dtype(
    [
        ("half_width", "f8"),  # L of a face, 0 for a pile [m]
        ("radius", "f8"),  # a of a pile, 0 for a face [m]
        ("point", "f8", (3,)),  # in the middle of the face, or on the axis [m, W]
        ("n", "f8", (3,)),  # out of the face; across the axis [W]
        ("e", "f8", (3,)),  # along the face, across its edges; across the axis and n [W]
    ],
    align=True,
)
"""The obstacles in the way of the current."""


@kernel
def turn_aside(obstacle, p_W, v, v_dot, gradient):
    """Add what an obstacle changes in a uniform current, whose velocity v (3,) [m/s, W] and time derivative v_dot (3,)
    are given, at the place p_W (3,) [m, W]; and add dv_i/dx_j to gradient (3, 3) [1/s]."""
    n, e, L, a = obstacle.n, obstacle.e, obstacle.half_width, obstacle.radius
    q = p_W[:3] - obstacle.point
    X, Y = n @ q, e @ q
    U_n, U_e, rate_n, rate_e = n @ v, e @ v, n @ v_dot, e @ v_dot
    if L > 0.0:  # c = Z/sqrt(Z^2 + L^2) - 1 multiplies U_n, and so does its derivative g
        X = max(X, 0.0)
        s_re, s_im = root(X * X - Y * Y + L * L, 2.0 * X * Y, L)
        size = s_re * s_re + s_im * s_im
        c_re, c_im = (X * s_re + Y * s_im) / size - 1.0, (Y * s_re - X * s_im) / size
        cube = size * size * size / (L * L)
        g_re = (s_re * s_re - 3.0 * s_im * s_im) * s_re / cube
        g_im = -(3.0 * s_re * s_re - s_im * s_im) * s_im / cube
        U_e, rate_e = 0.0, 0.0
    else:  # c = -(a/Z)^2 and its derivative multiply U_n + i U_e
        size = X * X + Y * Y
        if size < a * a:  # as at its surface
            if size == 0.0:
                X, size = 1.0, 1.0
            scale = a / math.sqrt(size)
            X, Y, size = scale * X, scale * Y, a * a
        share = a * a / (size * size)
        c_re, c_im = -share * (X * X - Y * Y), share * 2.0 * X * Y
        g_re, g_im = -2.0 * (c_re * X + c_im * Y) / size, -2.0 * (c_im * X - c_re * Y) / size
    v += (c_re * U_n - c_im * U_e) * n - (c_re * U_e + c_im * U_n) * e
    v_dot += (c_re * rate_n - c_im * rate_e) * n - (c_re * rate_e + c_im * rate_n) * e
    stretch, shear = g_re * U_n - g_im * U_e, -(g_re * U_e + g_im * U_n)
    for i in range(3):
        for j in range(3):
            gradient[i, j] += stretch * (n[i] * n[j] - e[i] * e[j]) + shear * (n[i] * e[j] + e[i] * n[j])


@kernel
def root(x, y, L):
    """The square root of x + i y with a real part that is not negative, at least of 1e-12 L in size: at the edges of a
    plate the velocity is infinite."""
    size = math.hypot(x, y)
    large = math.sqrt(0.5 * (size + abs(x)))
    if large < 1e-12 * L:
        return 1e-12 * L, 0.0
    small = 0.5 * abs(y) / large
    re, im = large, small
    if x < 0.0:
        re, im = small, large
    if y < 0.0:
        im = -im
    return re, im
