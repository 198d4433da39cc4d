r"""The water between a vehicle and a wall: before a pad an inertial film that grows as the gap closes, and a viscous
one; about a hull and about links an added mass that grows.

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
c = 3/16 and 3/32. Only the difference to 1/2 is added, since the vehicle's M_A has the rest. A sphere's turn moves no
water.

**A spheroid** of the radius a has an axis e, along which it is up to 2.5 times as long. Its centre is at
:math:`h = g + \sqrt{a^2 + (l^2/4 - a^2)\, s^2}` for the length l and :math:`s = n^\top e`. Its masses for motions of
the centre are a table by g/a, s and its slenderness (:mod:`uvms_mj.plant.spheroid`), right to 1e-3 of the displaced
mass between the gaps 0.02 a, below which nothing grows, and 8 a, beyond which they fall as (1 + g/a)^-3. What the wall
changes about its turn is left out, and the coupling of turn and motion with it.

**A cylinder**, on the base or on a link of an arm, is a row of strips across its axis e, each with the added mass
:math:`\pi \rho a^2 C` a length in plane flow, in every direction across e alike. With the distance H of the wall
across the axis, :math:`\cosh \alpha = H/a` and :math:`q = e^{-2\alpha}` (multipoles of the circle and its mirror image,
summed),

.. math::

    C = 4 \sinh^2\!\alpha \sum_{n \ge 1} \frac{2n\, q^n}{1 - q^n} - 1,

1 far away and :math:`\pi^2/3 - 1` at the touch, here to 2e-9: by the series far away, and near the wall by its modular
transform :math:`\sum = \frac{1}{12} - \frac{1}{2\alpha} + \frac{\pi^2}{\alpha^2}(\frac{1}{12} - 2 e^{-2\pi^2/\alpha})`.
The strips are eight, at Gauss's places. A strip at p is at :math:`H = h/\cos\beta` for a distance h of p and an angle
:math:`\beta` between axis and wall, :math:`\sin\beta = n^\top e`: an axis along the normal has no wall beside it. Its
mass is :math:`\pi \rho a^2 (C - 1) (I - e e^\top)`. The flow about its ends is not in it, as in the strip theory of the
links' own added mass.

**The equations of all three** describe masses at places p that move with a link, with an axis e that turns with it:

.. math::

    M_p = A I + B\, n n^\top + C\, e e^\top + D\, (n e^\top + e n^\top),

with A to D by h and s. A sphere has :math:`A = m_t`, :math:`B = m_n - m_t` and a strip :math:`A = -C`. With the
velocity v of p and its acceleration a without the accelerations of base and joints, Lagrange's equation gives a force
at p and a moment beside the inertia :math:`J^\top M_p J`, :math:`J = [I, -S(r)]`,

.. math::

    -M_p a - \dot M_p v + \frac{\partial T}{\partial h}\, n, \qquad
    e \times \left( (C\, e^\top v + D\, n^\top v)\, v + \frac{\partial T}{\partial s}\, n \right), \qquad
    T = \tfrac12 v^\top M_p v.
"""

import math

import numpy as np

from .kernels import kernel


def _before_wall(*more: tuple) -> np.dtype:
    """A record of a body before a plane wall, with more fields."""
    fields = [
        ("radius", "f8"),  # [m]
        ("r", "f8", (3,)),  # centre in the frame of its link, B for the base [m]
        ("point", "f8", (3,)),  # of the wall's face [m, W]
        ("normal", "f8", (3,)),  # out of the wall [W]
        ("rho", "f8"),  # [kg/m^3]
        ("least", "f8"),  # g_0 [m]
    ]
    return np.dtype([*fields, *more], align=True)


PAD = _before_wall(("viscosity", "f8"))  # mu [Pa s]
"""One pad before one plane wall."""
HULL = _before_wall(
    ("shape", "i8"),  # its place in SHAPES
    ("strips", "i8"),  # places at which its mass is, 1, or more along a cylinder
    ("link", "i8"),  # index of the link that it is on; the base is link 0
    ("axis", "f8", (3,)),  # of a cylinder or a spheroid, in the frame of the link
    ("length", "f8"),  # of a cylinder or a spheroid [m]
    ("series", "f8", (4, 10, 6)),  # of a spheroid, Chebyshev's coefficients of A, B, C and D/s by ln(g/a) and w
)
"""One sphere, cylinder or spheroid before one plane wall."""
SHAPES = ("sphere", "cylinder", "spheroid")
STRIPS = 8
"""Strips of a cylinder."""

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
_NOME = math.exp(-3.0)
"""q above which the series about the touch is taken: both are then right to 1e-9."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(STRIPS)
"""Places and weights of the strips of a cylinder between -1 and 1."""
_NEAREST, _FARTHEST = math.log(0.02), math.log(8.0)
"""ln(g/a) between which the series of a spheroid is; nearer nothing grows, farther away its coefficients stay."""
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
def cylinder_mass(t):
    """C - 1 of a cylinder whose axis is at the distance a/t from the wall, and its derivative by t over t."""
    root = math.sqrt(1.0 - t * t)  # tanh(alpha)
    q = (t / (1.0 + root)) ** 2
    if q < _NOME:  # far away, by powers of q
        value, rate, power = -2.0 * q, -2.0, 1.0
        left = (1.0 - q) * (1.0 - q)
        for n in range(2, 12):
            power *= q  # q^(n-1)
            below = 1.0 - power * q
            term = 2.0 * n * power / below
            value += left * term
            rate += left * term * ((n - 1.0) / q + n * power / below) - 2.0 * (1.0 - q) * term
        return value, rate * 2.0 / (root * (1.0 + root) ** 2)
    alpha = -0.5 * math.log(q)
    sinh = root / t
    x = math.exp(-2.0 * math.pi * math.pi / alpha)
    s = (math.pi / alpha) ** 2 * (1.0 / 12.0 - 2.0 * x) - 0.5 / alpha + 1.0 / 12.0
    by_alpha = -2.0 * (math.pi / alpha) ** 2 / alpha * (1.0 / 12.0 - 2.0 * x) + 0.5 / (alpha * alpha)
    by_alpha -= 4.0 * x * (math.pi / alpha) ** 4
    slope = 8.0 * sinh / t * s + 4.0 * sinh * sinh * by_alpha
    return 4.0 * sinh * sinh * s - 2.0, -slope / (t * t * root)


@kernel
def sphere_tensor(hull, h, W):
    """As :func:`tensor`, of a sphere."""
    g = h - hull.radius
    m_n, m_t, slope_n, slope_t = sphere_mass(max(g, hull.least) / hull.radius)
    scale = 4.0 / 3.0 * math.pi * hull.rho * hull.radius**3
    by_h = scale / hull.radius if g > hull.least else 0.0
    W[0, 0], W[0, 1] = scale * m_t, by_h * slope_t
    W[1, 0], W[1, 1] = scale * (m_n - m_t), by_h * (slope_n - slope_t)


@kernel
def cylinder_tensor(hull, s, h, W):
    """As :func:`tensor`, of a unit of length of a cylinder."""
    a, far = hull.radius, max(h, hull.least)
    scale = math.pi * hull.rho * a * a
    t, most = a * math.sqrt(max(0.0, 1.0 - s * s)) / far, a / (a + hull.least)
    mass, rate = cylinder_mass(max(1e-9, min(t, most)))
    W[0, 0] = scale * mass
    if t <= most:
        W[0, 2] = -scale * rate * (a / far) ** 2 * s
        if h > hull.least:
            W[0, 1] = -scale * rate * t * t / far
    W[2] = -W[0]


@kernel
def spheroid_tensor(hull, s, h, W):
    """As :func:`tensor`, of a spheroid."""
    a = hull.radius
    longer = 0.5 * hull.length / a + 1.0
    more = longer * (longer - 2.0)
    root = math.sqrt(1.0 + more * s * s)
    reach, w = a * root, longer * s * s / (1.0 + root)  # of its centre over its nearest point; 0 to 1 as it turns
    least = max(hull.least, a * math.exp(_NEAREST))
    g = h - reach
    x = max(g, least) / a
    y = min(math.log(x), _FARTHEST)
    near = 1.0 / (1.0 + x)
    scale = 2.0 / 3.0 * math.pi * hull.rho * a * a * hull.length * near * near * near
    P, Q = np.zeros((2, 10)), np.zeros((2, 6))  # Chebyshev's polynomials and their slopes
    chebyshev((2.0 * y - (_NEAREST + _FARTHEST)) / (_FARTHEST - _NEAREST), 10, P)
    chebyshev(2.0 * w - 1.0, 6, Q)
    inside = 1.0 if y < _FARTHEST else 0.0
    for k in range(4):
        value, by_y, by_w = P[0] @ hull.series[k] @ Q[0], P[1] @ hull.series[k] @ Q[0], P[0] @ hull.series[k] @ Q[1]
        by_g, by_s = 0.0, 2.0 * longer * s / root * by_w
        if g > least:
            by_g = (inside * by_y * 2.0 / ((_FARTHEST - _NEAREST) * x) - 3.0 * near * value) / a
            by_s -= by_g * a * more * s / root
        if k == 3:
            by_g *= s
            by_s = by_s * s + value
            value *= s
        W[k, 0], W[k, 1], W[k, 2] = scale * value, scale * by_g, scale * by_s


@kernel
def chebyshev(x, n, out):
    """Set out (2, n) to Chebyshev's polynomials at x and their derivatives."""
    out[0, 0], out[0, 1], out[1, 0], out[1, 1] = 1.0, x, 0.0, 1.0
    for k in range(2, n):
        out[0, k] = 2.0 * x * out[0, k - 1] - out[0, k - 2]
        out[1, k] = 2.0 * out[0, k - 1] + 2.0 * x * out[1, k - 1] - out[1, k - 2]


@kernel
def tensor(hull, s, h, W):
    """Set W (4, 3) to A, B, C and D of the mass A I + B n n^T + C e e^T + D (n e^T + e n^T) of the water beyond open
    water's [kg], at the distance h [m] of a place from the wall and s = n^T e, and to their derivatives by h and s."""
    W[:] = 0.0
    if hull.shape == 0:
        sphere_tensor(hull, h, W)
    elif hull.shape == 1:
        cylinder_tensor(hull, s, h, W)
    else:
        spheroid_tensor(hull, s, h, W)


@kernel
def times(W, n, e, x):
    """The mass of :func:`tensor` times a vector (3,)."""
    along, across = e @ x, n @ x
    return W[0] * x + (W[1] * across + W[3] * along) * n + (W[2] * along + W[3] * across) * e


@kernel
def add_mass(W, n, e, r, M):
    """Add the inertia of a mass of :func:`tensor` at r (3,) to M (6, 6)."""
    K, G = np.zeros((3, 3)), np.zeros((3, 3))
    for i in range(3):
        K[i, i] = 1.0
        K[i] = times(W, n, e, K[i])
        G[i] = np.cross(r, K[i])
    for i in range(3):
        M[i, :3] += K[i]
        M[i, 3:] += G[i]
        M[3:, i] += G[i]
    for i in range(3):
        M[3:, 3 + i] += np.cross(r, G[:, i])


@kernel
def share(hull, k):
    """Place of strip k of a hull along its axis [m], and its length [m]; 0 and 1 of a hull that is no cylinder."""
    if hull.strips == 1:
        return 0.0, 1.0
    return 0.5 * hull.length * _NODES[k], 0.5 * hull.length * _WEIGHTS[k]


@kernel
def distance(hull, p_WB, R_WB, r):
    """The distance of r (3,) in B from the wall of a hull [m]."""
    return hull.normal @ (p_WB + R_WB @ r - hull.point)


@kernel
def add_hull_inertia(hull, R_BL, p_BL, p_WB, R_WB, M):
    """Add the inertia of the water about a hull at a wall to M (6, 6), about B's origin in B; R_BL (3, 3) and p_BL (3,)
    are the frame of its link."""
    n, e, centre, W = hull.normal @ R_WB, R_BL @ hull.axis, p_BL + R_BL @ hull.r, np.zeros((4, 3))
    for k in range(hull.strips):
        place, length = share(hull, k)
        r = centre + place * e
        tensor(hull, n @ e, distance(hull, p_WB, R_WB, r), W)
        add_mass(length * W[:, 0], n, e, r, M)


@kernel
def add_hull_wrench(hull, R_BL, p_BL, p_WB, R_WB, V, A, F):
    """Add the wrench of the water about a hull at a wall to F (6,), beside the wrench of its inertia. V (6,) and A (6,)
    are motion and acceleration of its link, as in :mod:`.tree`, relative to W and without the accelerations of the
    base and of the joints."""
    n, e, centre, W = hull.normal @ R_WB, R_BL @ hull.axis, p_BL + R_BL @ hull.r, np.zeros((4, 3))
    omega = V[3:]
    e_dot = np.cross(omega, e)
    for k in range(hull.strips):
        place, length = share(hull, k)
        r = centre + place * e
        tensor(hull, n @ e, distance(hull, p_WB, R_WB, r), W)
        W *= length
        v = V[:3] + np.cross(omega, r)
        a = A[:3] + np.cross(A[3:], r) + np.cross(omega, v)
        across, along, turned = n @ v, e @ v, e_dot @ v
        squares = np.array([v @ v, across * across, along * along, 2.0 * across * along])
        by_h, by_s, rate = (
            0.5 * (W[:, 1] @ squares),
            0.5 * (W[:, 2] @ squares),
            W[:, 1] * across + W[:, 2] * (n @ e_dot),
        )
        f = -times(W[:, 0], n, e, a) - times(rate, n, e, v) + by_h * n
        f -= (W[2, 0] * turned) * e + (W[2, 0] * along + W[3, 0] * across) * e_dot + (W[3, 0] * turned) * n
        F[:3] += f
        F[3:] += np.cross(r, f) + np.cross(e, (W[2, 0] * along + W[3, 0] * across) * v + by_s * n)
