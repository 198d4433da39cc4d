"""Certificates of laws without a run."""

import math
from types import SimpleNamespace

import numpy as np
from scipy.optimize import brentq

from uvms_mj.control.task import ImpedanceTask
from uvms_mj.control.theory.certificate import Certificate, rate_bound


def certificate_of(law) -> Certificate:
    """The certificate of a law with the default gains of s."""
    return law.certificate(SimpleNamespace(task=ImpedanceTask()))


def lyapunov_matrix(k_1: float, k_2: float, rate: float, G_1: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """P (2, 2) of a V = xi^T P xi that decreases for every disturbance up to the rate, midway in the admissible range.

    Raises:
        ValueError: the rate is not below :func:`rate_bound`.
    """
    if not 0.0 <= rate < rate_bound(k_1, k_2, G_1):
        raise ValueError(f"rate {rate:g} is not below the certified {rate_bound(k_1, k_2, G_1):g}")
    a_min, a_max = k_1 - G_1[1], k_1 - G_1[0]
    low, high = math.sqrt(k_2 - 2.0 * rate), math.sqrt(k_2 + 2.0 * rate)

    def excess(p: float) -> float:
        """Slack of the second condition of the proof minus that of the first."""
        return low + high - math.sqrt(p * (a_min - p)) - math.sqrt(p * (a_max - p))

    p = a_min / 2.0
    if excess(p) < 0.0:
        p = brentq(excess, 0.0, p)
    D = (0.5 * (low + high)) ** 2  # halfway between sqrt(b_max) - m_min, here the larger one, and sqrt(b_min) + m_min
    return np.array([[D + p**2, -p], [-p, 1.0]])
