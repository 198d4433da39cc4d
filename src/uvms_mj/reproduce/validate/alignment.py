"""Two clocks: the time between them, and the error of a simulated angle against a measured one."""

from dataclasses import dataclass

import numpy as np

LAGS = np.arange(-1.0, 1.001, 0.02)
"""Times between two clocks that are tried [s]."""


@dataclass(frozen=True)
class Error:
    """The error of a simulated angle: root mean square, greatest and mean, simulated minus measured [rad]."""

    rms: float
    peak: float
    mean: float


def lag(t: np.ndarray, value: np.ndarray, of: np.ndarray, other: np.ndarray) -> float:
    """The time by which ``value``(t) is later than ``other``(of), one of :data:`LAGS` [s].

    It is the lag with the greatest correlation. Correlation does not see an offset or a scale, so that the lag takes up
    neither a wrong trim nor a wrong stiffness.
    """
    return float(max(LAGS, key=lambda late: _correlation(t, value, of + late, other)))


def _correlation(t: np.ndarray, value: np.ndarray, of: np.ndarray, other: np.ndarray) -> float:
    both = (t >= of[0]) & (t <= of[-1])
    return float(np.corrcoef(value[both], np.interp(t[both], of, other))[0, 1])


def error(t: np.ndarray, measured: np.ndarray, of: np.ndarray, simulated: np.ndarray, since: float = -np.inf) -> Error:
    """The error at the samples of the measurement which both have, from a time on [s]; nothing is taken off."""
    both = (t >= max(of[0], since)) & (t <= of[-1])
    difference = np.interp(t[both], of, simulated) - measured[both]
    rms = float(np.sqrt(np.mean(difference**2)))
    return Error(rms, float(np.abs(difference).max()), float(difference.mean()))
