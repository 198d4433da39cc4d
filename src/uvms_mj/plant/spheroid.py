"""The added mass of a spheroid near a wall, as a table of numbers, ``spheroid.csv``.

``scripts/spheroid_table.py`` makes the numbers: ideal flow about a spheroid and its mirror image, by sources on
confocal spheroids inside. A row has a slenderness (length over two radii), w, which grows from 0 to 1 as the axis
turns from along the wall to along its normal, ln(g/a) of the gap g and the radius a, and A, B, C and D/s of
:func:`uvms_mj.physics.near_wall.tensor`, less the coefficients in open water, over the displaced mass and (1 + g/a)^-3.
Values between the rows are right to 1e-3 of the displaced mass.
"""

import functools
from pathlib import Path

import numpy as np

LONGEST = 2.5
"""Greatest slenderness of the table."""
_SLENDERNESSES, _TILTS, _GAPS = 5, 6, 10


@functools.cache
def _series() -> tuple[np.ndarray, np.ndarray]:
    """The slendernesses (5,), and Chebyshev's coefficients (5, 4, 10, 6) by ln(g/a) and w at each."""
    text = Path(__file__).with_name("spheroid.csv").read_text()
    rows = np.array([line.split(",") for line in text.splitlines() if not line.startswith("#")][1:], float)
    rows = rows.reshape(_SLENDERNESSES, _TILTS, _GAPS, 7)
    x, u = (_polynomials(n) for n in (_GAPS, _TILTS))
    return rows[:, 0, 0, 0], np.einsum("lugk,mg,nu->lkmn", rows[..., 3:], x, u)


def _polynomials(n: int) -> np.ndarray:
    """Chebyshev's coefficients (n, n) of a function by its values at the n roots, from the greatest one down."""
    angles = np.pi * (np.arange(n) + 0.5) / n
    found: np.ndarray = 2.0 / n * np.cos(np.outer(np.arange(n), angles))
    found[0] *= 0.5
    return found


def spheroid_series(slenderness: float) -> np.ndarray:
    """Chebyshev's coefficients (4, 10, 6) of A, B, C and D/s of a spheroid, by Lagrange's polynomial in the logarithm
    of its slenderness."""
    nodes, series = _series()
    x, y = np.log(slenderness), np.log(nodes)
    weights = [np.prod([(x - b) / (a - b) for b in y if b != a]) for a in y]
    found: np.ndarray = np.tensordot(weights, series, 1)
    return found
