r"""Check that the damping of a vehicle dissipates energy in every motion.

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
"""

import itertools

import numpy as np

_ROUNDING = 1e-9
"""Tolerance of the power, relative to the largest coefficient in scaled units."""
_ZERO = 1e-12
"""A coefficient counts as zero below this, relative to the largest."""
_ITERATIONS = 300


def damping_notes(body: str, D_linear: np.ndarray, D_quadratic: np.ndarray) -> list[str]:
    """One sentence for each of D_linear and D_quadratic, (6, 6), that can feed energy into the vehicle. It gives a
    velocity at which both together do so."""
    notes = []
    for name, find, D in (("D_linear", linear_gain, D_linear), ("D_quadratic", quadratic_gain, D_quadratic)):
        nu = find(D)
        if nu is None:
            continue
        first, second = nu @ D_linear @ nu, nu @ D_quadratic @ (np.abs(nu) * nu)
        if first < 0.0 < second:
            nu = nu * (-first / second * 2.0 / 3.0)  # the speed of the largest gain
        elif second < 0.0 < first:
            nu = nu * (first / -second * 2.0)  # twice the speed at which the gain begins
        shown = np.where(np.abs(nu) < _ROUNDING * np.abs(nu).max(), 0.0, nu)
        power = -(nu @ D_linear @ nu + nu @ D_quadratic @ (np.abs(nu) * nu))
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


def quadratic_gain(D: np.ndarray) -> np.ndarray | None:
    """A velocity nu (6,) with nu^T D (abs(nu) nu) < 0, or None if none is found; D is (6, 6)."""
    unit = _units(D, 3)
    C = D / np.outer(unit, unit**2)  # in y = unit nu, with a diagonal of ones and zeros
    cross = np.abs(C - np.diag(np.diag(C)))
    if (cross.sum(axis=1) / 3.0 + cross.sum(axis=0) * 2.0 / 3.0 <= np.diag(C)).all():
        return None  # Young's inequality
    y = np.array([start for start in itertools.product((-1.0, 0.0, 1.0), repeat=6) if start > (0.0,) * 6])
    bound = 6.0 * np.linalg.norm(C, 2)  # on the second derivatives, so that no step increases the power
    for _ in range(_ITERATIONS):
        y /= np.linalg.norm(y, axis=1)[:, None]
        square = np.abs(y) * y
        power = (y * (square @ C.T)).sum(axis=1)
        least = power.argmin()
        if power[least] < -_ROUNDING * np.abs(C).max():
            return y[least] / unit
        y -= (square @ C.T + 2.0 * np.abs(y) * (y @ C)) / bound
    return None


def _units(D: np.ndarray, degree: int) -> np.ndarray:
    """(6,) scales that make the diagonal of a form of this degree one, except where it is zero up to rounding."""
    diagonal = np.diag(D)
    return np.where(diagonal > _ZERO * np.abs(D).max(), diagonal, 1.0) ** (1.0 / degree)
