"""Ranges of the signals of a finished run, for the axes of its plots and the scale of its arrows."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ...records.trace import Trace

MOST_STEPS = 5
"""Most readable numbers on an axis. Rerun puts numbers at multiples of a power of ten only."""
_LARGEST = 1e12
"""Largest magnitude on an axis."""
_EDGE = 0.07
"""Least distance of a number from the end of its axis, as a fraction of the axis."""
_RESTS = 0.1
"""Final fraction of a run in which the largest force counts as the force at rest."""


@dataclass(frozen=True)
class Extents:
    """Extents of one run: ranges (size, 2) of each signal's components by its name, the largest push in the last tenth
    of the run [N], the largest push [N], and the largest of all forces that are drawn as arrows [N]."""

    ranges: Mapping[str, np.ndarray]
    rest: float
    peak: float
    force: float

    @classmethod
    def of(cls, trace: Trace) -> "Extents":
        ranges = {}
        for signal in trace.signals:
            values = _drawable(trace[signal.name].reshape(len(trace), signal.size))
            values = values if len(values) else np.zeros((1, signal.size))
            ranges[signal.name] = np.stack([values.min(axis=0), values.max(axis=0)], axis=1)
        push = _drawable(trace.band("push")[1])
        late = push[trace.t >= (1.0 - _RESTS) * trace.t[-1]] if len(trace) else push
        forces = [_drawable(f) for f in (trace.f_contact_W, trace.tau[:, :3])]
        force = max(float(np.linalg.norm(f, axis=1).max(initial=0.0)) for f in forces)
        return cls(ranges, float(late.max(initial=0.0)), float(push.max(initial=0.0)), force)


def _drawable(values: np.ndarray) -> np.ndarray:
    """Values, with 0 for those that are not finite or too large to draw, as at the end of a run that diverged."""
    return np.where(np.abs(values) < _LARGEST, values, 0.0)


def readable(limits: Iterable[tuple[float, float]]) -> tuple[float, float]:
    """Range of an axis that contains all given ranges.

    The range also contains at least two multiples of a power of ten, where Rerun puts numbers, but no more of them than
    are readable.
    """
    lows, highs = zip(*limits, strict=True)
    low, high = float(min(lows)), float(max(highs))
    margin = 0.05 * (high - low) or 0.5 * abs(high) or 0.5
    low, high = low - margin, high + margin
    step = 10.0 ** math.ceil(math.log10((high - low) / MOST_STEPS))
    edge = _EDGE * (high - low)  # Rerun shows no number at the edge
    while (first := math.ceil((low + edge) / step)) + 1 > (last := math.floor((high - edge) / step)):
        if (last + 1) * step - high <= low - (first - 1) * step:
            high = (last + 1) * step + 2.0 * edge
        else:
            low = (first - 1) * step - 2.0 * edge
    return low, high
