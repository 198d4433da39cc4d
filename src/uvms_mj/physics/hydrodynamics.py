r"""Hydrodynamics of one vehicle, a tree of links: its added inertia and its wrench for one state.

Added mass belongs in the inertia matrix: a force -M_A nu_dot, computed from an earlier acceleration, diverges if the
added mass exceeds the rigid mass. With T = blockdiag(R_WB^T, I), nu = T qvel, the joint-space inertia grows by
T^T M_A T. The rest is a force. From v_dot = R_WB^T a_W - omega x v and v_c_dot = R_WB^T v_c_dot_W - omega x v_c in B,

.. math::

    M_A \dot\nu_r = M_A T\, \ddot q - M_A \begin{bmatrix} \omega \times v_r + R_{WB}^\top \dot v_c \\ 0 \end{bmatrix},

where the derivative of the current v_c in W is taken along the vehicle's path. The wrench on the right-hand side of the
paper's eq. (10) is

.. math::

    -C_A(\nu_r)\nu_r - D(\nu_r)\nu_r
        + M_A \begin{bmatrix} \omega \times v_r + R_{WB}^\top \dot v_c \\ 0 \end{bmatrix}
        + \text{buoyancy} + \tau_{dist}(t).

**Froude-Krylov force.** The pressure gradient that accelerates the water, a_c = Dv_c/Dt, acts on the vehicle as well:
the buoyancy of the displaced mass is that of gravity minus a_c (Newman, "Marine Hydrodynamics", 1977, sec. 4.17; Fossen
2021, sec. 10.3, has constant currents only). It is included. Eq. (10), in which M = M_RB + M_A multiplies nu_r_dot,
holds as it stands for a vehicle whose weight and buoyancy balance in size and place. For any other one g(eta) is to be
taken in the accelerated frame of the water (:func:`uvms_mj.control.model.reveal`). In uniform water that accelerates, a
neutral vehicle therefore moves as in still water, seen from the water.

MuJoCo itself computes rigid-body Coriolis forces, weight and thrust.

Check that the damping of a vehicle dissipates energy in every motion.

At the velocity nu relative to the water, damping dissipates the power

.. math::

    P(\nu) = \nu^\top D_{linear}\, \nu + \nu^\top D_{quadratic} \left( |\nu| \odot \nu \right).

In each direction of nu, the first term dominates at low speed and the second, one degree higher, at high speed. Damping
is therefore dissipative at all speeds if and only if neither term is negative in any direction. For the first term this
means that the symmetric part of D_linear is positive semi-definite. For the second term no exact test is known. Two
tests are used instead, both independent of the units:

- A certificate: by Young's inequality, :math:`|y_i| y_j^2 \le (|y_i|^3 + 2 |y_j|^3)/3`, the term is never negative if
  the diagonal outweighs rows and columns.
- A counterexample: projected gradient descent minimises the power over all directions, from 364 starts, one for each
  choice of axes and signs. The power is negative at every velocity that it finds. It may miss a narrow range of them.

Products of velocities (:mod:`.effects`) are forces of the same degree as D_quadratic. Their powers are summed by what
they multiply, so that products that do no work together, such as Coriolis terms, cancel. In the certificate, a term
:math:`c\, y_i y_j y_k` is at least :math:`-|c| (|y_i|^3 + |y_j|^3 + |y_k|^3)/3`.
"""

import itertools

import numpy as np

from .effects import PRODUCT, add_inertia_wrenches
from .frames import add_wrench_from
from .kernels import fused, kernel
from .tree import damping_wrench, gather_wrenches, momenta, move_links

WATER = np.dtype(
    [
        ("unsteady", "i8"),  # whether the water does not move the same at all times and places
        # at the vehicle, at one instant
        ("fresh", "i8"),  # whether it is the instant in hand of a closed loop
        ("v_c_W", "f8", (3,)),  # velocity of the current in W [m/s]
        ("v_c_dot_W", "f8", (3,)),  # its time derivative along the vehicle's path [m/s^2]; zero if it is constant
        ("a_c_W", "f8", (3,)),  # acceleration of the water [m/s^2]; zero if the current is constant
        ("gradient_W", "f8", (3, 3)),  # of its velocity, dv_i/dx_j [1/s]
        ("tau_dist", "f8", (6,)),  # disturbance in B, with the effects [N, N m]
    ],
    align=True,
)
"""The motion of the water at a vehicle, and the disturbance, at one instant."""


@kernel
def added_inertia(M_A, R_WB, lower):
    """Set lower (21,) to the lower triangle of T^T M_A T, row by row, as MuJoCo stores it for a free joint."""
    n = 0
    for i in range(3):
        turned = R_WB[i] @ M_A[:3, :3]  # of R_WB M_A[:3, :3] R_WB^T
        for j in range(i + 1):
            lower[n] = turned @ R_WB[j]
            n += 1
    for i in range(3, 6):
        for j in range(3):
            lower[n] = M_A[i, :3] @ R_WB[j]  # of M_A[3:, :3] R_WB^T
            n += 1
        for j in range(3, i + 1):
            lower[n] = M_A[i, j]
            n += 1


@kernel
def factor(lower, L, D_inverse):
    """L^T D L factorisation of a symmetric 6x6 matrix in MuJoCo's order, from the last row up.

    Args:
        lower: (21,) lower triangle of the matrix, row by row.
        L: (21,) is set to L below the diagonal and D on it.
        D_inverse: (6,) is set to the inverse of D.
    """
    for n in range(21):
        L[n] = lower[n]
    for k in range(5, -1, -1):
        row = k * (k + 1) // 2
        D_inverse[k] = 1.0 / L[row + k]
        for i in range(k - 1, -1, -1):
            scale = L[row + i] * D_inverse[k]
            above = i * (i + 1) // 2
            for j in range(i + 1):
                L[above + j] -= scale * L[row + j]
            L[row + i] = scale


@kernel
def relative_velocity(water, R_WB, nu, nu_r):
    """Set nu_r (6,) to the velocity relative to the current, from nu (6,) [m/s, rad/s, B]."""
    nu_r[:3], nu_r[3:] = nu[:3] - R_WB.T @ water.v_c_W, nu[3:]


@fused
def water_wrench(plant, R_WB, nu, out):
    """Set out (6 + n,) to the generalised wrench of the water on a vehicle and its links, in B at its origin [N, N m],
    with the disturbance and the contact forces on the links behind joints, and without the part in the inertia matrix.

    Args:
        plant: record with links, frames (1 + n,), water, tau_effects (k, 6), effect_frames (k,) or none if all of them
            act at B, gravity_W, and qvel, whose entries from 6 on are those of the joints. ``nu_r`` is set to the
            velocity of the base relative to the water.
        R_WB: (3, 3).
        nu: (6,) velocity of the base in B [m/s, rad/s].
    """
    links, frames, water, part = plant.links, plant.frames, plant.water, np.zeros(6)
    base, nu_r, a = links[0], plant.nu_r, links[0].A
    relative_velocity(water, R_WB, nu, nu_r)
    base.V[:], base.F[:], a[:] = nu_r, water.tau_dist, 0.0
    if plant.effect_frames.shape[0] == 0:
        for k in range(plant.tau_effects.shape[0]):
            base.F += plant.tau_effects[k]
    a[:3] = -(np.cross(nu_r[3:], nu_r[:3]))  # -(omega x v_r + R^T v_c_dot)
    if water.unsteady != 0:
        a[:3] -= R_WB.T @ water.v_c_dot_W
    move_links(links, frames, plant.qvel, 6)
    subtract_water(base, base.F)
    add_buoyancy(base, plant, R_WB, base.r_b)
    for k in range(1, links.shape[0]):
        link, frame = links[k], frames[k]
        part[:], link.F[:] = 0.0, link.f_ext
        subtract_water(link, part)
        add_wrench_from(frame.R_BL, frame.p_BL, part, link.F)
        add_buoyancy(link, plant, R_WB, frame.p_BL + frame.R_BL @ link.r_b)
    add_inertia_wrenches(plant.effects, plant.qpos[:3], R_WB, nu, base.F)
    for k in range(plant.effect_frames.shape[0]):
        at = plant.effect_frames[k]
        add_wrench_from(at.R_BC, at.p_BC, plant.tau_effects[k], links[at.link].F)
    gather_wrenches(links, frames, out)


@kernel
def subtract_water(link, out):
    """Subtract C_A nu_r + D nu_r + M_A a of a link from out (6,), at its origin in its axes."""
    C_nu, D_nu, M_a = np.zeros(6), np.zeros(6), np.zeros(6)
    momenta(link, C_nu, M_a)
    damping_wrench(link, link.nu, D_nu)
    out[:] = out - C_nu - D_nu - M_a


@kernel
def add_buoyancy(link, plant, R_WB, centre):
    """Add the buoyancy of a link to its wrench F about B's origin, at its centre (3,) in B: that of gravity minus the
    acceleration of the water."""
    d = link.displaced_mass
    f = R_WB.T @ (-(d * plant.gravity_W) + d * plant.water.a_c_W)
    link.F[:3] += f
    link.F[3:] += np.cross(centre, f)


_ROUNDING = 1e-9
"""Tolerance of the power, relative to the largest coefficient in scaled units."""
_ZERO = 1e-12
"""A coefficient counts as zero below this, relative to the largest."""
_ITERATIONS = 300


_NO_PRODUCTS = np.zeros(0, PRODUCT)


def damping_notes(
    body: str, D_linear: np.ndarray, D_quadratic: np.ndarray, products: np.ndarray = _NO_PRODUCTS
) -> list[str]:
    """One sentence for each of D_linear and D_quadratic, (6, 6), the latter with PRODUCT records (n,), that can feed
    energy into the vehicle. It gives a velocity at which both together do so."""
    notes = []
    terms = _works(products, np.ones(6))

    def dissipated(nu: np.ndarray) -> tuple[float, float]:
        """The powers of D_linear, and of D_quadratic with the products [W]."""
        second = nu @ D_quadratic @ (np.abs(nu) * nu) - _work(terms, nu[None])[0][0]
        return float(nu @ D_linear @ nu), float(second)

    of_second = "D_quadratic and of the products of velocities" if products.size else "D_quadratic"
    for name, nu in (("D_linear", linear_gain(D_linear)), (of_second, quadratic_gain(D_quadratic, products))):
        if nu is None:
            continue
        first, second = dissipated(nu)
        if first < 0.0 < second:
            nu = nu * (-first / second * 2.0 / 3.0)  # the speed of the largest gain
        elif second < 0.0 < first:
            nu = nu * (first / -second * 2.0)  # twice the speed at which the gain begins
        shown = np.where(np.abs(nu) < _ROUNDING * np.abs(nu).max(), 0.0, nu)
        power = -sum(dissipated(nu))
        notes.append(
            f"the damping of {body} can feed energy in: at nu = [{' '.join(f'{x:.4g}' for x in shown)}] m/s, rad/s "
            f"relative to the water it adds {power:.3g} W; check the signs of the cross terms of {name}"
        )
    return notes


def linear_gain(D: np.ndarray) -> np.ndarray | None:
    """A velocity nu (6,) with nu^T D nu < 0, or None if there is none; D is (6, 6)."""
    unit = _units(D, 2)
    values, vectors = np.linalg.eigh((D + D.T) / 2.0 / np.outer(unit, unit))
    return vectors[:, 0] / unit if values[0] < -_ROUNDING * np.abs(values).max() else None


def quadratic_gain(D: np.ndarray, products: np.ndarray = _NO_PRODUCTS) -> np.ndarray | None:
    """A velocity nu (6,) at which D (6, 6) and PRODUCT records (n,) feed energy in, nu^T D (abs(nu) nu) - nu^T f < 0
    with the force f of the products, or None if none is found."""
    unit = _units(D, 3)
    C = D / np.outer(unit, unit**2)  # in y = unit nu, with a diagonal of ones and zeros
    terms = _works(products, unit)
    cross = np.abs(C - np.diag(np.diag(C)))
    outweighed = cross.sum(axis=1) / 3.0 + cross.sum(axis=0) * 2.0 / 3.0
    for factors, c in terms.items():
        np.add.at(outweighed, list(factors[:3]), abs(c) / 3.0)
    if (outweighed <= np.diag(C)).all():
        return None  # Young's inequality
    largest = max(np.abs(C).max(), *map(abs, terms.values())) if terms else np.abs(C).max()
    y = np.array([start for start in itertools.product((-1.0, 0.0, 1.0), repeat=6) if start > (0.0,) * 6])
    # on the second derivatives, so that no step increases the power
    bound = 6.0 * (np.linalg.norm(C, 2) + np.linalg.norm([*terms.values()]))
    if terms:  # of an odd part
        y = np.concatenate([y, -y])
    for _ in range(_ITERATIONS):
        y /= np.linalg.norm(y, axis=1)[:, None]
        square = np.abs(y) * y
        work, slope = _work(terms, y)
        power = (y * (square @ C.T)).sum(axis=1) - work
        least = power.argmin()
        if power[least] < -_ROUNDING * largest:
            return y[least] / unit
        y -= (square @ C.T + 2.0 * np.abs(y) * (y @ C) - slope) / bound
    return None


def _works(products: np.ndarray, unit: np.ndarray) -> dict[tuple[int, int, int, bool], float]:
    """The coefficients of the power of PRODUCT records (n,) in y = unit nu, summed by its factors y_i y_j y_k, or
    y_i y_j abs(y_k) with bars; without those that cancel."""
    found: dict[tuple[int, int, int, bool], list[float]] = {}
    for axis, first, second, bars, coefficient in products.tolist():
        i, j, k = (*sorted((axis, first)), second) if bars else sorted((axis, first, second))
        found.setdefault((i, j, k, bool(bars)), []).append(coefficient / float(unit[i] * unit[j] * unit[k]))
    return {key: sum(c) for key, c in found.items() if abs(sum(c)) > _ZERO * max(map(abs, c))}


def _work(terms: dict[tuple[int, int, int, bool], float], y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The power (m,) of products at velocities (m, 6), from :func:`_works`, and its derivatives (m, 6)."""
    work, slope = np.zeros(len(y)), np.zeros_like(y)
    for (i, j, k, bars), c in terms.items():
        a, b, last = y[:, i], y[:, j], np.abs(y[:, k]) if bars else y[:, k]
        work += c * a * b * last
        slope[:, i] += c * b * last
        slope[:, j] += c * a * last
        slope[:, k] += c * a * b * (np.sign(y[:, k]) if bars else 1.0)
    return work, slope


def _units(D: np.ndarray, degree: int) -> np.ndarray:
    """(6,) scales that make the diagonal of a form of this degree one, except where it is zero up to rounding."""
    diagonal = np.diag(D)
    return np.where(diagonal > _ZERO * np.abs(D).max(), diagonal, 1.0) ** (1.0 / degree)
