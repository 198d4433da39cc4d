"""What is known of a run that is over, for the axes of its plots and the scale of its arrows."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ..trace import Trace

MOST_STEPS = 5
"""Rerun numbers an axis at multiples of a power of ten only, and as many of them as this can be read in its plots."""
_LARGEST = 1e12
"""No axis goes further."""
_EDGE = 0.07
"""How far a number must be from the end of its axis, as part of its length."""
_RESTS = 0.1
"""The last part of a run, in which its force has come to rest, if it does."""


@dataclass(frozen=True)
class Extents:
    """Of one run.

    Attributes:
        ranges: (size, 2) least and greatest value of each number of each signal, by the signal's name.
        rest: the largest push in the last tenth of the run [N].
        peak: the largest push [N].
        force: the largest of all forces that are drawn as arrows [N].
    """

    ranges: Mapping[str, np.ndarray]
    rest: float
    peak: float
    force: float

    @classmethod
    def of(cls, trace: Trace) -> "Extents":
        """What a trace shows."""
        ranges = {}
        for signal in trace.signals:
            values = _drawable(trace[signal.name].reshape(len(trace), signal.size))
            values = values if len(values) else np.zeros((1, signal.size))
            ranges[signal.name] = np.stack([values.min(axis=0), values.max(axis=0)], axis=1)
        push = _drawable(trace.push)
        late = push[trace.t >= (1.0 - _RESTS) * trace.t[-1]] if len(trace) else push
        forces = [_drawable(f) for f in (trace.f_contact_W, trace.tau[:, :3])]
        force = max(float(np.linalg.norm(f, axis=1).max(initial=0.0)) for f in forces)
        return cls(ranges, float(late.max(initial=0.0)), float(push.max(initial=0.0)), force)


def _drawable(values: np.ndarray) -> np.ndarray:
    """Values, with 0 for those that are not finite or that a run which diverges reaches at its very end."""
    return np.where(np.abs(values) < _LARGEST, values, 0.0)


def readable(limits: Iterable[tuple[float, float]]) -> tuple[float, float]:
    """The range of an axis that holds all of some ranges, and two multiples of a power of ten at least, which are
    numbered, but no more than can be read."""
    lows, highs = zip(*limits, strict=True)
    low, high = float(min(lows)), float(max(highs))
    margin = 0.05 * (high - low) or 0.5 * abs(high) or 0.5
    low, high = low - margin, high + margin
    step = 10.0 ** math.ceil(math.log10((high - low) / MOST_STEPS))
    edge = _EDGE * (high - low)  # a number at the very edge is not shown
    while (first := math.ceil((low + edge) / step)) + 1 > (last := math.floor((high - edge) / step)):
        if (last + 1) * step - high <= low - (first - 1) * step:
            high = (last + 1) * step + 2.0 * edge
        else:
            low = (first - 1) * step - 2.0 * edge
    return low, high
