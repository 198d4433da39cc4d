r"""The water between a vehicle and a wall: before a pad an inertial film that grows as the gap closes, and a viscous
one; about a hull an added mass that grows.

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

**A hull** is a sphere of the radius a whose centre is at the distance h = a + g from the wall. In ideal flow its added
mass is :math:`\tfrac43 \pi \rho a^3 C` with one C along the normal and one along the wall, functions of g/a alone
(multipoles of the sphere and its mirror image: Lamb, "Hydrodynamics", 1932, sec. 98 and 99, to all orders), 1/2 far
away, and here

.. math::

    C(h) = \tfrac12 + c(\ln(g/a))\, (a/h)^3,

with Chebyshev's polynomials c of each between g/a = 0.001 and 20, right to 1e-6 of C. Beyond 20 it is the first term,
c = 3/16 and 3/32. Only the difference to 1/2 is added, since the vehicle's M_A has the rest. With the mass
:math:`M_p = m_t I + (m_n - m_t)\, n n^\top` at the centre p, whose velocity is v, Lagrange's equation gives the force

.. math::

    -M_p\, \omega \times (\omega \times r) - M_p'\, \dot g\, v + \tfrac12 (v^\top M_p' v)\, n

at p, beside the inertia :math:`J^\top M_p J`, :math:`J = [I, -S(r)]`. A sphere's turn moves no water.
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
HULL = np.dtype(
    [
        ("radius", "f8"),  # a [m]
        ("r", "f8", (3,)),  # centre in B [m]
        ("point", "f8", (3,)),  # of the wall's face [m, W]
        ("normal", "f8", (3,)),  # out of the wall [W]
        ("rho", "f8"),  # [kg/m^3]
        ("least", "f8"),  # g_0 [m]
    ],
    align=True,
)
"""One sphere before one plane wall."""
_LEAST, _MOST = math.log(1e-3), math.log(20.0)
_NORMAL = np.array(
    [
        *(0.2369932612, -0.06564353114, 0.008857784896, 0.0122672286, -0.002973937601),
        *(-0.003376824447, 0.000695891282, 0.0009985115843, -7.778521505e-05, -0.0002854626227),
        *(-2.808852018e-05, 7.231049519e-05, 2.353485186e-05, -1.433492363e-05, -1.025292925e-05),
        *(1.30225723e-06, 3.348246613e-06, 5.913668033e-07, -8.431776432e-07, -4.396979919e-07),
    ]
)
"""Coefficients of c along the normal."""
_ALONG = np.array(
    [
        *(0.1060828032, -0.01602223849, 0.001528644891, 0.003383842956, -0.0005496466991),
        *(-0.001039306591, 0.0001237849229, 0.0003329074186, -2.226930922e-06, -0.000102198002),
        *(-1.532176603e-05, 2.824735352e-05, 1.015275754e-05, -6.427102719e-06, -4.557640126e-06),
        *(8.877913829e-07, 1.644464061e-06, 1.503489778e-07, -4.863854978e-07, -1.842227121e-07),
    ]
)
"""Coefficients of c along the wall."""
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


@kernel
def sphere_mass(x):
    """C - 1/2 of a sphere at the gap x a along the normal and along the wall, and their derivatives by x."""
    y = min(max(math.log(x), _LEAST), _MOST)
    s = (2.0 * y - (_LEAST + _MOST)) / (_MOST - _LEAST)
    near = 1.0 / (1.0 + math.exp(y))
    share = near * near * near
    if x > math.exp(_MOST):
        near = 1.0 / (1.0 + x)
        share = near * near * near
        return 3.0 / 16.0 * share, 3.0 / 32.0 * share, -9.0 / 16.0 * share * near, -9.0 / 32.0 * share * near
    before, now, slope_before, slope = 1.0, s, 0.0, 1.0
    c_n, c_t = _NORMAL[0] + _NORMAL[1] * s, _ALONG[0] + _ALONG[1] * s
    rate_n, rate_t = _NORMAL[1], _ALONG[1]
    for k in range(2, 20):
        after, slope_after = 2.0 * s * now - before, 2.0 * now + 2.0 * s * slope - slope_before
        before, now, slope_before, slope = now, after, slope, slope_after
        c_n += _NORMAL[k] * now
        c_t += _ALONG[k] * now
        rate_n += _NORMAL[k] * slope
        rate_t += _ALONG[k] * slope
    if math.log(x) < _LEAST:
        return c_n * share, c_t * share, 0.0, 0.0
    by_x = 2.0 / ((_MOST - _LEAST) * x)
    slope_n, slope_t = share * (rate_n * by_x - 3.0 * near * c_n), share * (rate_t * by_x - 3.0 * near * c_t)
    return c_n * share, c_t * share, slope_n, slope_t


@kernel
def hull_masses(hull, p_WB, R_WB, n_B):
    """Set n_B (3,) to the normal in B, and return the masses along the normal and along the wall beyond open water's
    [kg], and their derivatives by the gap [kg/m]."""
    n_B[:] = hull.normal @ R_WB
    g = hull.normal @ (p_WB + R_WB @ hull.r - hull.point) - hull.radius
    m_n, m_t, slope_n, slope_t = sphere_mass(max(g, hull.least) / hull.radius)
    scale = 4.0 / 3.0 * math.pi * hull.rho * hull.radius**3
    by_gap = scale / hull.radius if g > hull.least else 0.0
    return scale * m_n, scale * m_t, by_gap * slope_n, by_gap * slope_t


@kernel
def add_hull_inertia(hull, p_WB, R_WB, M):
    """Add the inertia of the water about a hull at a wall to M (6, 6), about B's origin in B."""
    n_B, J = np.zeros(3), np.zeros((3, 6))
    m_n, m_t, _, _ = hull_masses(hull, p_WB, R_WB, n_B)
    for i in range(3):
        e = np.zeros(3)
        e[i] = 1.0
        J[i, :3], J[i, 3:] = e, np.cross(hull.r, e)
    along = n_B @ J
    M += (m_n - m_t) * np.outer(along, along)
    for i in range(3):
        M += m_t * np.outer(J[i], J[i])


@kernel
def add_hull_wrench(hull, p_WB, R_WB, nu, tau):
    """Add the wrench of the water about a hull at a wall to tau (6,), beside the wrench of its inertia."""
    n_B, omega = np.zeros(3), nu[3:]
    m_n, m_t, slope_n, slope_t = hull_masses(hull, p_WB, R_WB, n_B)
    v, inward = nu[:3] + np.cross(omega, hull.r), np.cross(omega, np.cross(omega, hull.r))
    rate = n_B @ v
    changed = slope_t * v + (slope_n - slope_t) * rate * n_B  # M_p' v
    f = -(m_t * inward) - (m_n - m_t) * (n_B @ inward) * n_B - rate * changed + 0.5 * (v @ changed) * n_B
    tau[:3] += f
    tau[3:] += np.cross(hull.r, f)
