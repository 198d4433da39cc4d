r"""Checks that the damping and the products of velocities of a vehicle's file feed no energy into the vehicle.

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

Products of velocities (:mod:`uvms_mj.physics.effects`) are forces of the same degree as D_quadratic. Powers with the
same velocities are summed, so that products without work together, such as Coriolis
terms, cancel. In the certificate, a term :math:`c\, y_i y_j y_k` is at least
:math:`-|c| (|y_i|^3 + |y_j|^3 + |y_k|^3)/3`.
"""

import itertools

import numpy as np

from ..physics.effects import PRODUCT

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
    y_i y_j abs(y_k) with bars; terms that cancel are left out."""
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
