"""Rows of a part of a run, and running integrals over them."""

import numpy as np

from ..records.trace import Trace


def window(trace: Trace, start: float, end: float) -> tuple[int, int]:
    """First and last row of a part of a run."""
    first = int(np.searchsorted(trace.t, start - 1e-9))
    last = int(np.searchsorted(trace.t, end + 1e-9, side="right")) - 1
    first = min(first, len(trace) - 1)
    return first, max(first, last)


def gain(trace: Trace, name: str, start: float, end: float) -> tuple[np.ndarray, float]:
    """Increase of a running signal over a part of a run, and the duration of that part [s]."""
    first, last = window(trace, start, end)
    return trace[name][last] - trace[name][first], float(trace.t[last] - trace.t[first])


def grid(trace: Trace, start: float, end: float, apart: float) -> np.ndarray:
    """Indices of rows at intervals of ``apart`` [s]; of all rows if the log is slower than that."""
    first, last = window(trace, start, end)
    instants = np.arange(trace.t[first], trace.t[last] + 1e-9, apart)
    rows = np.searchsorted(trace.t, instants - 1e-9)
    return np.unique(np.minimum(rows, last))


def cumulative(t: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Running integral (n, m) of y (n, m) over t by the trapezoidal rule."""
    steps = 0.5 * np.diff(t)[:, None] * (y[1:] + y[:-1])
    return np.concatenate([np.zeros((1, y.shape[1])), np.cumsum(steps, axis=0)])
