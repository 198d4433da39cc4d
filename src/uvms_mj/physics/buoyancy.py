r"""A vehicle that is partly below the surface: the volume below it, and what follows from the volume.

The displaced volume of a vehicle is a sum of spheres, boxes and capsules. A plane with the unit vector n up out of the
water cuts each of them. For the wet part, :math:`n^\top x \le D` about the shape's centre, which is D below the plane,
the volume V, its first moment, the waterplane's area A and its first moment are exact:

- of a sphere in closed form,
- of a box at any attitude from its faces, each cut at the plane, by the divergence theorem from a point of the plane,
- of a capsule as two hemispheres and a cylinder. With e, out of the flat side of a hemisphere of the radius 1,
  :math:`e_n = n^\top e`, :math:`e_t = \sqrt{1 - e_n^2}` and the integral over heights :math:`\zeta` up to D,

.. math::

    V = P \left( \tfrac{\pi}{2} + \alpha \right) + \tfrac13 e_n e_t\, (q - q^3) + \tfrac23 \beta, \quad
    P = D - \tfrac13 D^3, \quad q^2 = 1 - D^2/e_t^2, \quad \tan\alpha = \frac{e_n D}{e_t q}, \quad
    \tan\beta = \frac{e_t q}{e_n},

  and likewise its moments; of the cylinder the integral over its discs, each a segment of the angle :math:`\psi`, by
  Gauss's formula with twelve points in :math:`\psi`, where it is smooth: right to 1e-12.

With the density :math:`\rho` of the displaced mass over the shapes' volumes, the buoyancy is
:math:`\rho V (a_c - g)` at the centroid of the wet part. It is the slope of a potential, so that the stiffness is the
waterplane's, :math:`\rho g A` in heave (Newman, "Marine Hydrodynamics", 1977, sec. 6.16; Faltinsen, "Sea Loads", 1990).

**The other forces of the water.** The share :math:`\varphi` of the displaced mass that is wet scales added mass and
drag, which is a model. Of a sphere half in the water it is exact in heave for sudden motions and in surge for slow
ones, half of the wet displaced mass; the other limits are 0.83 and 0.27 of it (Hulme, J. Fluid Mech. 121, 1982,
p. 443). The kinetic energy is :math:`\tfrac12 \varphi\, \nu_r^\top M_A \nu_r`, and Lagrange's equation adds

.. math::

    -\dot\varphi\, M_A \nu_r + \tfrac12 (\nu_r^\top M_A \nu_r)\, \nabla\varphi, \qquad
    \dot\varphi = \nabla\varphi^\top \nu + \dot\varphi_\eta, \qquad
    \nabla\varphi = -\frac{\rho}{m_d} \begin{bmatrix} A n_B \\ \int r\, dA \times n_B \end{bmatrix},

where :math:`\dot\varphi_\eta` is the surface's own motion. So the water gives back what it has taken. A real entry
loses energy to the spray: by momentum alone (von Karman, NACA TN 321, 1929) the force is the first term.

**Thrusters.** A propeller in the air gives no thrust. At the surface its thrust is scaled by the share of a sphere of
its radius that is wet, a smooth model without ventilation.

**Waves.** Each shape has the tangent plane of the surface above its centre, by :math:`\eta` of linear theory.
"""

import math

import numpy as np

from .kernels import kernel
from .surfaces import BOX, SPHERE
from .waves import surface_of

VOLUME = np.dtype(
    [
        ("kind", "i8"),  # SPHERE, BOX or CAPSULE
        ("size", "f8", (3,)),  # radius and half length, or half edges [m]
        ("r", "f8", (3,)),  # centre in B [m]
        ("R_BS", "f8", (3, 3)),
        ("volume", "f8"),  # [m^3]; 0 of none, as a reset leaves it
        ("density", "f8"),  # displaced mass over volume [kg/m^3]
        ("surface", "f8"),  # z of the still surface in W [m]
        ("propeller", "f8"),  # radius of the propellers [m]
    ],
    align=True,
)
"""One shape of the displaced volume."""
WET = np.dtype(
    [
        ("fraction", "f8"),  # of the displaced mass below the surface
        ("mass", "f8"),  # displaced there [kg]
        ("moment", "f8", (3,)),  # and its first moment in B [kg m]
        ("slope", "f8", (6,)),  # of the fraction by a displacement and a rotation vector in B [1/m, 1]
        ("rate", "f8"),  # of the fraction by the motion of the surface [1/s]
        ("dry_time", "f8"),  # with nothing below the surface, until t_k [s]
    ],
    align=True,
)
"""The part of a vehicle below the surface at one instant."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


@kernel
def find_wet(effects, t, p_WB, R_WB, moment, slope):
    """The mass displaced below the surface at the time t [s], the mass of all shapes [kg], and the rate of the first by
    the motion of the surface [kg/s]. Adds its first moment (3,) in B [kg m] and its derivative by a displacement and a
    rotation vector (6,) in B [kg/m, kg] to ``moment`` and ``slope``."""
    mass, whole, rate = 0.0, 0.0, 0.0
    for k in range(effects.buoyancy.shape[0]):
        volume, found, n, rise = effects.buoyancy[k], np.zeros(8), np.zeros(3), np.zeros(3)
        if volume.volume > 0.0:
            place = p_WB + R_WB @ volume.r
            height = surface_of(effects.sea, t, place, rise, n)
            n_B = n @ R_WB
            below = n[2] * (volume.surface + height - place[2])
            cut(volume, n_B @ volume.R_BS, below, found)
            rho, V, A = volume.density, found[0], found[4]
            mass += rho * V
            whole += rho * volume.volume
            moment += rho * (V * volume.r + volume.R_BS @ found[1:4])
            at = R_WB @ (volume.R_BS @ found[5:])  # of the waterplane about the shape's centre, in W
            rate += rho * n[2] * (A * rise[0] + at[0] * rise[1] + at[1] * rise[2])
            slope[:3] -= (rho * A) * n_B
            slope[3:] -= rho * np.cross(A * volume.r + volume.R_BS @ found[5:], n_B)
    return mass, whole, rate


@kernel
def set_wet(effects, base, t, p_WB, R_WB, wet):
    """Set a :data:`WET` record at the time t [s]; ``base`` has the displaced mass of a vehicle without shapes."""
    wet.moment[:], wet.slope[:] = 0.0, 0.0
    mass, whole, rate = find_wet(effects, t, p_WB, R_WB, wet.moment, wet.slope)
    if whole > 0.0:
        wet.mass, wet.fraction, wet.rate = mass, mass / whole, rate / whole
        wet.slope /= whole
    else:
        wet.mass, wet.fraction, wet.rate = base.displaced_mass, 1.0, 0.0
        wet.moment[:] = base.displaced_mass * base.r_b


@kernel
def dry_fraction(effects, t, p_WB, R_WB) -> float:
    """The share of the displaced mass above the surface at the time t [s]."""
    mass, whole, _ = find_wet(effects, t, p_WB, R_WB, np.zeros(3), np.zeros(6))
    return 1.0 - mass / whole if whole > 0.0 else 0.0


@kernel
def covered(effects, t, place_W) -> float:
    """The share of its thrust that a propeller at place_W (3,) gives at the time t [s]: of a sphere of its radius
    there, the share below the surface."""
    volume, n, rise = effects.buoyancy[0], np.zeros(3), np.zeros(3)
    if volume.volume == 0.0:
        return 1.0
    below = volume.surface + surface_of(effects.sea, t, place_W, rise, n) - place_W[2]
    s = min(1.0, max(-1.0, below / volume.propeller))
    return 0.25 * (1.0 + s) * (1.0 + s) * (2.0 - s)


@kernel
def cut(volume, n, D, out):
    """Set out (8,) to the volume [m^3] of the wet part of a shape and its first moment (3,) about the shape's centre in
    its axes [m^4], the area of the waterplane [m^2] and its first moment (3,) [m^3]. The centre is D below the plane
    with the unit vector n (3,) out of the water, in the shape's axes."""
    size = volume.size
    if volume.kind == SPHERE:
        cut_sphere(size[0], n, D, out)
        return
    reach = size[0] + size[1] * abs(n[2])
    if volume.kind == BOX:
        reach = np.abs(n) @ size
    if reach <= D:
        out[0] = volume.volume
    elif -reach < D:
        if volume.kind == BOX:
            cut_box(size, n, D, out)
        else:
            cut_capsule(size[0], size[1], n, D, out)


@kernel
def cut_sphere(a, n, D, out):
    """As :func:`cut`, of a sphere of the radius a [m]."""
    s = min(a, max(-a, D))
    chord = (a - s) * (a + s)
    out[0], out[4] = math.pi / 3.0 * (a + s) * (a + s) * (2.0 * a - s), math.pi * chord
    out[1:4] = (-0.25 * math.pi * chord * chord) * n
    out[5:] = (math.pi * chord * s) * n


@kernel
def cut_box(h, n, D, out):
    """As :func:`cut`, of a box with the half edges h (3,) [m]."""
    apex, face = D * n, np.zeros((6, 3))  # the wet part of a face has at most five corners
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for side in (1.0, -1.0):
            corners, inside, leaves, enters = np.zeros((4, 3)), 0, np.zeros(3), np.zeros(3)
            for c in range(4):  # counter-clockwise, seen from outside
                corners[c, i] = side * h[i]
                corners[c, j] = h[j] if (c == 0 or c == 3) else -h[j]
                corners[c, k] = side * (h[k] if c < 2 else -h[k])
            for c in range(4):
                a, b = corners[c], corners[(c + 1) % 4]
                above, above_next = n @ a - D, n @ b - D
                if above <= 0.0:
                    face[inside] = a
                    inside += 1
                if (above <= 0.0) != (above_next <= 0.0):
                    at = a + above / (above - above_next) * (b - a)
                    face[inside] = at
                    inside += 1
                    if above <= 0.0:
                        leaves[:] = at
                    else:
                        enters[:] = at
            distance = h[i] - side * apex[i]
            for c in range(2, inside):
                part = 0.5 * side * np.cross(face[c - 1] - face[0], face[c] - face[0])[i] * distance / 3.0
                out[0] += part
                out[1:4] += (0.25 * part) * (apex + face[0] + face[c - 1] + face[c])
            if inside > 0:
                part = 0.5 * (n @ np.cross(enters - apex, leaves - apex))
                out[4] += part
                out[5:] += (part / 3.0) * (apex + enters + leaves)


@kernel
def cut_capsule(a, half, n, D, out):
    """As :func:`cut`, of a capsule of the radius a about a segment of the half length ``half`` along z [m]."""
    g, e_t = abs(n[2]), math.sqrt(n[0] * n[0] + n[1] * n[1])
    up = 1.0 if n[2] >= 0.0 else -1.0  # along z, the way out of the water
    for end in (1.0, -1.0):
        add_hemisphere(a, half * end, n, end, D - half * end * n[2], out)
    k = np.zeros(3)
    if e_t > 0.0:
        k[0], k[1] = n[0] / e_t, n[1] / e_t
    # the discs up to x = first are wet, the discs from x = last on are dry
    first, last = half if e_t * a <= D else -half, half if -e_t * a < D else -half
    if g > 0.0:
        first = min(half, max(-half, (D - e_t * a) / g))
        last = min(half, max(-half, (D + e_t * a) / g))
    disc = math.pi * a * a
    out[0] += disc * (first + half)
    out[3] += up * 0.5 * disc * (first - half) * (first + half)
    # u is sin psi of a disc's segment
    tiny = 1e-300
    high = 1.0 if first > -half else min(1.0, max(-1.0, (D + g * half) / (e_t * a + tiny)))
    low = -1.0 if last < half else min(1.0, max(-1.0, (D - g * half) / (e_t * a + tiny)))
    if not (last > first or (g > 0.5 and high > low)):
        return
    psi_high, psi_low = math.asin(high), math.asin(low)
    middle, spread = 0.5 * (psi_high + psi_low), 0.5 * (psi_high - psi_low)
    length = (high - low) * a / g if g > 0.5 else (last - first) / e_t  # along the plane
    curved = spread / math.sin(spread) if spread > 1e-8 else 1.0
    for i in range(12):
        node = _NODES[i]
        psi = middle + spread * node
        sine, cosine = math.sin(psi), math.cos(psi)
        along = _WEIGHTS[i] * 0.5 * length * curved * cosine / math.cos(middle)
        ahead = 0.5 * (1.0 - node)
        if spread > 1e-8:
            ahead = math.sin(spread * ahead) / math.sin(spread)
        ahead *= math.cos(middle + 0.5 * spread * (1.0 + node)) / math.cos(middle)
        x, dx = first + (last - first) * ahead, e_t * along
        segment, width = a * a * (0.5 * math.pi + psi + sine * cosine) * dx, 2.0 * a * cosine * along
        out[0] += segment
        out[3] += up * x * segment
        out[1:4] -= (2.0 / 3.0 * a * a * a * cosine * cosine * cosine * dx) * k
        out[4] += width
        out[7] += up * x * width
        out[5:] += (a * sine * width) * k


@kernel
def add_hemisphere(a, z, n, end, D, out):
    """Add to out (8,) as :func:`cut` a hemisphere of the radius a about (0, 0, z), on the side ``end`` of it, 1 or
    -1."""
    s = min(1.0, max(-1.0, D / a))
    e_n, e_t = end * n[2], math.sqrt(n[0] * n[0] + n[1] * n[1])
    q, slant = 0.0, 0.0
    if abs(s) < e_t:
        q = math.sqrt((e_t - s) * (e_t + s)) / e_t
        slant = e_n * s / e_t * q
    alpha, theta = math.atan2(e_n * s, e_t * q), math.atan2(s, e_t * q)
    circle = (1.0 - s) * (1.0 + s)
    twice = math.sin(theta) * math.cos(theta)
    four = twice * (1.0 - 2.0 * math.sin(theta) ** 2)
    P, Q = s - s * s * s / 3.0, -0.25 * circle * circle
    V = P * (0.5 * math.pi + alpha) + e_n * e_t * (q - q * q * q) / 3.0 + 2.0 / 3.0 * math.atan2(e_t * q, e_n)
    up = Q * (0.5 * math.pi + alpha) + 0.25 * e_n * (theta - 0.5 * e_t * e_t * (theta - twice))
    up += 0.125 * e_n * (e_t * e_t * (theta - four) + math.pi)
    aside = 2.0 / 3.0 * e_t * (0.375 * theta + 0.5 * twice + 0.125 * four + 0.1875 * math.pi)
    A = circle * (0.5 * math.pi + alpha) + slant
    h = np.zeros(3)  # across n, the way of the hemisphere
    if e_t > 0.0:
        h[0], h[1], h[2] = -e_n * n[0] / e_t, -e_n * n[1] / e_t, (end - e_n * n[2]) / e_t
    out[0] += a * a * a * V
    out[1:4] += a * a * a * a * (up * n + aside * h)
    out[3] += a * a * a * V * z
    out[4] += a * a * A
    out[5:] += a * a * a * (A * s * n + (2.0 / 3.0 * q * q * q) * h)
    out[7] += a * a * A * z


@kernel
def meet_surface(plant, base, R_WB, nu):
    """Add the wrench of the water on the base of a vehicle to its F, in the place of the wrench deep below, and with
    the wrench of the change of its added mass."""
    wet, momentum = plant.wet[0], base.M @ base.nu
    f = R_WB.T @ (plant.water.a_c_W - plant.gravity_W)
    base.F[:3] += wet.mass * f
    base.F[3:] += np.cross(wet.moment, f)
    base.F += (0.5 * (base.nu @ momentum)) * wet.slope - (wet.slope @ nu + wet.rate) * momentum
