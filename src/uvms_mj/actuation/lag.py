"""Lags of a thrust behind its command, and their exact discretisation for a command that is held over a period."""

import functools

import numpy as np

THIRD_ORDER = ((6136.0, 108700.0), (1.0, 89.0, 9258.0, 108700.0))
"""Numerator and denominator, from the highest power of s, of the lag that von Benzon et al. (2022) identified on a
T200: it reaches 63 % of a step after 20 ms and 95 % after 32 ms."""
ORDER = 3


def transfer_function(lag: str, time_constant: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Numerator and denominator of a lag by its name, with the time constant of a first-order lag [s]."""
    return THIRD_ORDER if lag == "third_order" else ((1.0,), (time_constant, 1.0))


@functools.lru_cache(maxsize=8)
def discrete(lag: str, time_constant: float, period: float) -> dict[str, np.ndarray]:
    """The matrices of x' = Phi x + Gamma f, y = C x for a command f that is held over ``period`` [s].

    The states are those of the controllable form. The result is exact: Phi and Gamma are blocks of a matrix
    exponential. Lags of a lower order than three have zeros in their last rows and columns.
    """
    from scipy.linalg import expm  # imported where it is used, because it takes long

    numerator, denominator = (np.array(each) for each in transfer_function(lag, time_constant))
    n = len(denominator) - 1
    A, C = np.eye(n, k=-1), np.zeros(ORDER)
    A[0] = -denominator[1:] / denominator[0]
    C[n - len(numerator) : n] = numerator / denominator[-1]
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[0, n] = A, denominator[-1] / denominator[0]
    step = expm(block * period)
    Phi, Gamma = np.zeros((ORDER, ORDER)), np.zeros(ORDER)
    Phi[:n, :n], Gamma[:n] = step[:n, :n], step[:n, n]
    for matrix in (Phi, Gamma, C):
        matrix.setflags(write=False)
    return {"Phi": Phi, "Gamma": Gamma, "C": C}


def mean_delay(lag: str, time_constant: float) -> float:
    """Delay of slow changes [s]: minus the derivative at s = 0 of a transfer function whose gain is 1 there."""
    numerator, denominator = transfer_function(lag, time_constant)
    return denominator[-2] / denominator[-1] - (numerator[-2] / numerator[-1] if len(numerator) > 1 else 0.0)
