"""The height of the centre of buoyancy that fits some trials, from the errors of all trials over a grid of heights."""

import itertools

import numpy as np
from scipy.interpolate import CubicSpline

from ...errors import InputError

HEIGHTS = tuple(round(0.012 + 0.004 * k, 3) for k in range(7))
"""Grid of heights [m]."""
FITTED_ON = 3
"""The height is fitted on this many trials, the first by name, and judged on the others."""
_FINE = np.arange(HEIGHTS[0], HEIGHTS[-1] + 1e-9, 1e-4)


def fitted_height(errors: np.ndarray, fitted_on: tuple[int, ...]) -> float:
    """The height [m], to 0.1 mm, with the least mean rms error of the trials ``fitted_on``.

    ``errors`` (trials, heights) are those of each trial at :data:`HEIGHTS`; a cubic spline joins their squares. Raises
    InputError if the least error is at the end of the grid.
    """
    best = int(np.argmin(_between(errors)[list(fitted_on)].mean(axis=0)))
    if best in (0, len(_FINE) - 1):
        reach = f"{HEIGHTS[0]:g} to {HEIGHTS[-1]:g} m"
        raise InputError(f"no height of the centre of buoyancy from {reach} fits the first {FITTED_ON} trials best")
    return float(_FINE[best].round(4))


def every_choice(errors: np.ndarray) -> np.ndarray:
    """Mean rms error of the trials that are left, for every choice of trials to fit on."""
    fine = _between(errors)
    trials = range(len(fine))
    found = []
    for chosen in itertools.combinations(trials, FITTED_ON):
        best = int(np.argmin(fine[list(chosen)].mean(axis=0)))
        found.append(fine[[k for k in trials if k not in chosen], best].mean())
    return np.array(found)


def _between(errors: np.ndarray) -> np.ndarray:
    """(trials, heights) errors on the fine grid."""
    return np.sqrt(np.maximum(CubicSpline(HEIGHTS, errors**2, axis=1)(_FINE), 0.0))
