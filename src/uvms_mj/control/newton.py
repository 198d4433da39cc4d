"""Newton's method for six equations that are smooth in pieces."""

from collections.abc import Callable

import numpy as np

_HALVES = 12
"""Number of times that a step is halved where the set of contacts changes."""


def newton(of: Callable[[np.ndarray], np.ndarray], x: np.ndarray, careful: bool) -> np.ndarray:
    """A root (6,) of ``of``, a function of x (6,), near x. Sixty steps at most, each of at most 0.5; if
    ``careful``, each of them lowers the residual if it can."""
    for _ in range(60):
        residual = of(x)
        columns = [(of(x + e) - of(x - e)) / 2e-6 for e in 1e-6 * np.eye(6)]  # of the Jacobian
        step = np.linalg.lstsq(np.array(columns).T, residual, rcond=None)[0]
        step = step * min(1.0, 0.5 / max(np.abs(step).max(), 1e-300))
        if careful:
            size = np.abs(residual).max()
            halves = (step * 0.5**k for k in range(_HALVES))
            step = next((each for each in halves if np.abs(of(x - each)).max() < size), step)
        x = x - step
        if np.abs(step).max() < 1e-14:
            break
    return x
