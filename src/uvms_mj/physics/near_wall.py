r"""The water between a pad of a vehicle and a wall: an inertial film that grows as the gap closes, and a viscous one.

A pad is a rigid disc of the radius R that faces a plane at the gap g. In ideal flow its added mass along the normal is
a function of x = g/R alone (Love's integral equation of two coaxial discs, Quart. J. Mech. Appl. Math. 2, 1949, p. 428,
for a disc and its mirror image),

.. math::

    m(g) = \rho R^3 \left( \frac{\pi}{8 x} + c(\ln x) \right),

with the film of lubrication theory and a rest c that is smooth: a series of Chebyshev's polynomials between x = 0.005
and 20, whose numbers are of this equation, right to 1e-6 of m. Far away m is the mass of a disc in open water, 8/3 rho
R^3, which belongs to the vehicle's M_A already, so that only the difference is added.

With :math:`\dot g = J^\top \nu`, :math:`J = [n_B;\; r \times n_B]` for the unit vector n out of the wall, the kinetic
energy :math:`\tfrac12 m(g) \dot g^2` adds :math:`m J J^\top` to the inertia, and Lagrange's equation the wrench

.. math::

    -\left( m\, n_B^\top (\omega \times (\omega \times r)) + \tfrac12 m'(g)\, \dot g^2 + c_\mu \dot g \right) J,
    \qquad c_\mu = \frac{3 \pi \mu R^4}{2 g^3},

the last term being Stefan's viscous film. The gap is at least g_0, the height of the roughness, below which neither
grows: then m' = 0. Water that flows past is not in it.
"""

import math

import numpy as np

from .kernels import kernel

PAD = np.dtype(
    [
        ("radius", "f8"),  # R [m]
        ("r", "f8", (3,)),  # centre in B [m]
        ("point", "f8", (3,)),  # of the wall's face [m, W]
        ("normal", "f8", (3,)),  # out of the wall [W]
        ("rho", "f8"),  # [kg/m^3]
        ("viscosity", "f8"),  # mu [Pa s]
        ("least", "f8"),  # g_0 [m]
    ],
    align=True,
)
"""One pad before one plane wall."""

_LOW, _HIGH = math.log(0.005), math.log(20.0)
_REST = np.array(
    [
        *(2.727161136, -0.3388055217, 0.3888987601, -0.09509446405, -0.0617522674, 0.01279790717),
        *(0.01835680498, 0.001032651177, -0.005439193883, -0.00202423873, 0.001271208577, 0.001162970775),
        *(-9.518974301e-05, -0.0004867874546, -0.0001273109755, 0.000155271198, 0.0001058879684, -2.936414518e-05),
        *(-5.523300324e-05, -5.989252635e-06, 2.211195078e-05, 1.001359993e-05, -6.509713397e-06, -6.605870505e-06),
    ]
)
"""Coefficients of c."""
FAR = 8.0 / 3.0
"""m/(rho R^3) in open water."""


@kernel
def disc_mass(x):
    """m/(rho R^3) of a disc at the gap x R, and its derivative by x."""
    y = math.log(x)
    s = (2.0 * min(max(y, _LOW), _HIGH) - (_LOW + _HIGH)) / (_HIGH - _LOW)
    before, now, slope_before, slope = 1.0, s, 0.0, 1.0
    value, rate = _REST[0] + _REST[1] * s, _REST[1]
    for k in range(2, 24):
        after, slope_after = 2.0 * s * now - before, 2.0 * now + 2.0 * s * slope - slope_before
        before, now, slope_before, slope = now, after, slope, slope_after
        value += _REST[k] * now
        rate += _REST[k] * slope
    rate *= 2.0 / (_HIGH - _LOW)  # by ln x
    if y > _HIGH:
        return FAR, 0.0
    value += rate * min(y - _LOW, 0.0)
    return math.pi / (8.0 * x) + value, -math.pi / (8.0 * x * x) + rate / x


@kernel
def gap_of(pad, p_WB, R_WB, J):
    """Set J (6,) with g_dot = J nu, and return the gap g [m], the mass m beyond open water's [kg], and its
    derivative m' [kg/m]."""
    n_B = pad.normal @ R_WB
    J[:3], J[3:] = n_B, np.cross(pad.r, n_B)
    g = pad.normal @ (p_WB + R_WB @ pad.r - pad.point)
    mass, rate = disc_mass(max(g, pad.least) / pad.radius)
    scale = pad.rho * pad.radius**3
    return g, scale * (mass - FAR), scale * rate / pad.radius


@kernel
def add_pad_inertia(pad, p_WB, R_WB, M):
    """Add the inertia m J J^T of the water before a pad to M (6, 6), about B's origin in B."""
    J = np.zeros(6)
    _, m, _ = gap_of(pad, p_WB, R_WB, J)
    M += m * np.outer(J, J)


@kernel
def add_pad_wrench(pad, p_WB, R_WB, nu, tau):
    """Add the wrench of the water before a pad to tau (6,), beside the wrench of its inertia."""
    J, omega = np.zeros(6), nu[3:]
    g, m, slope = gap_of(pad, p_WB, R_WB, J)
    rate = J @ nu
    force = m * (J[:3] @ np.cross(omega, np.cross(omega, pad.r)))
    if g > pad.least:
        force += 0.5 * slope * rate * rate
    gap = max(g, pad.least)
    force += 1.5 * math.pi * pad.viscosity * pad.radius**4 / gap**3 * rate
    tau -= force * J
