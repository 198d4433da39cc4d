r"""Contacts whose damping is a restitution: Hunt and Crossley's, and Hertz's with the same damping.

The force at the depth :math:`\delta` is (Hunt and Crossley, "Coefficient of restitution interpreted as damping in
vibroimpact", J. Applied Mechanics 42, 1975, p. 440)

.. math::

    F_n = \max\left(0, k\, \delta^n (1 + a\, \dot\delta)\right),

with n = 1, or with n = 3/2 and Hertz's :math:`k = \frac43 E^* \sqrt R` for two bodies of the curvature 1/R together and
the modulus E* of both materials (Johnson, "Contact mechanics", 1985, eq. (4.23)). It has no jump at the touch, at which
a damper :math:`b\, \dot\delta` has the force b v. A mass m that hits with the speed v and no other force leaves with
e v. Its equation :math:`m\, v\, dv/d\delta = -k\, \delta^n (1 + a v)` separates, so that e depends neither on the mass
nor on k or n:

.. math::

    a v (1 + e) = \ln \frac{1 + a v}{1 - a v e}.

For slow impacts it is :math:`e = 1 - \frac23 a v`.
"""

import math
from collections.abc import Callable

UP_TO = 1.0
"""Speed of the impacts that a time step has to resolve [m/s]."""


def dissipation_of(restitution: float, speed: float) -> float:
    """The a [s/m] with which an impact at a speed [m/s] has a restitution in (0, 1]."""
    if restitution == 1.0:
        return 0.0

    def left(x: float) -> float:  # x = a v e is below one
        r = x / restitution
        return r + x - math.log1p(r) + math.log1p(-x)

    return _root(left, 1e-9 * (1.0 - restitution), 1.0 - 1e-15) / (restitution * speed)


def restitution_of(dissipation: float, speed: float) -> float:
    """The restitution of an impact at a speed [m/s] with an a [s/m]."""
    r = dissipation * speed
    if r < 1e-6:
        return 1.0 - 2.0 / 3.0 * r

    def left(x: float) -> float:
        return r + x - math.log1p(r) + math.log1p(-x)

    return _root(left, 0.0, min(r, 1.0 - 1e-15)) / r


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    from scipy.optimize import brentq  # late: a command that needs no restitution starts without SciPy

    return float(brentq(function, low, high, xtol=1e-15))


def stiffness_of_hertz(modulus: float, radius: float, wall_radius: float | None) -> float:
    """k [N/m^1.5] of a sphere of a radius [m] against a plane, or against a sphere of ``wall_radius`` [m], for the
    modulus E* [Pa]."""
    together = radius if wall_radius is None else radius * wall_radius / (radius + wall_radius)
    return 4.0 / 3.0 * modulus * math.sqrt(together)


def deepest(k: float, power: float, dissipation: float, mass: float) -> float:
    """Greatest depth [m] of an impact of a mass [kg] at UP_TO: k delta^(n + 1)/(n + 1) is m times the integral of
    v/(1 + a v) from 0."""
    r = dissipation * UP_TO
    work = 0.5 * UP_TO**2 if r < 1e-6 else (r - math.log1p(r)) / dissipation**2
    return float((mass * work * (power + 1.0) / k) ** (1.0 / (power + 1.0)))
