"""The offset of two clocks, from a signal that both records have: the offset with the greatest correlation of all
samples that both have, refined by a parabola."""

import math

import numpy as np

from .columns import Series

_GAP = 2.5
"""Times the median distance of two samples from which there is a gap between them."""
_VALLEY, _SMALL = 0.25, 1e-3
"""Depth in correlation between two offsets that are apart, and a part of the variance that samples can miss."""
LEAST = 0.5
"""Least correlation of a shared signal with which clocks are aligned, and least share of the shorter record that both
must have."""


def in_gap(t: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Whether times lie between two samples that are further apart than :data:`_GAP` of them usually are."""
    if len(t) < 2:
        return np.zeros(len(at), bool)
    apart = np.diff(t)
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(apart) - 1)
    on = (np.abs(at - t[k]) < 1e-9) | (np.abs(at - t[k + 1]) < 1e-9)
    return (apart[k] > _GAP * np.median(apart)) & ~on


def aligned(ours: Series, theirs: Series) -> tuple[float, float, float]:
    """The offset [s] that is added to our times, with the greatest correlation of two records, this correlation, and
    another offset that is as good, NaN if there is none.

    Both are sampled at the smaller of their usual distances; samples in gaps do not count. At least half of the shorter
    record must be in both, and eight samples of each. The correlation is NaN if no offset has one.
    """
    dt, coarse = sorted(float(np.median(np.diff(t))) for t, _ in (ours, theirs))
    if min(t[-1] - t[0] for t, _ in (ours, theirs)) < 7.0 * coarse:
        return 0.0, math.nan, math.nan
    (x, m), (y, w) = (_sampled(t, v, dt) for t, v in (ours, theirs))
    size = 1 << (len(x) + len(y) - 1).bit_length()
    X, M, Y, W, XX, YY = (np.fft.rfft(each, size) for each in (x, m, y, w, x * x, y * y))

    def crossed(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.fft.irfft(np.conj(a) * b, size)

    n = np.maximum(crossed(M, W), 0.0)
    enough = n >= max(LEAST * min(m.sum(), w.sum()), 8.0 * coarse / dt)
    n = np.where(enough, n, 1.0)
    sum_x, sum_y = crossed(X, W), crossed(M, Y)
    variance = np.maximum((crossed(XX, W) - sum_x**2 / n) * (crossed(M, YY) - sum_y**2 / n), 0.0)
    scale = np.sqrt(variance)
    whole = np.sqrt((x * x).sum() * (y * y).sum())
    usable = enough & (scale > 1e-6 * whole)
    r = np.where(usable, (crossed(X, Y) - sum_x * sum_y / n) / np.where(usable, scale, 1.0), -np.inf)
    k = int(np.argmax(r))
    if not np.isfinite(r[k]):
        return 0.0, math.nan, math.nan
    before, at, after = r[k - 1], r[k], r[(k + 1) % size]
    bend = before - 2.0 * at + after
    fine = 0.5 * (before - after) / bend if np.isfinite(bend) and bend < 0.0 else 0.0
    begin = float(theirs[0][0] - ours[0][0])
    other = _other(np.roll(r, size - len(y)), n[k] * dt / coarse)
    return begin + _lag(k + fine, size, y) * dt, float(min(r[k], 1.0)), begin + (other - (size - len(y))) * dt


def _lag(k: float, size: int, y: np.ndarray) -> float:
    return k if k < len(y) else k - size


def _other(r: np.ndarray, n: float) -> float:
    """The place of another correlation that is as good as the greatest one, of n samples: the part of the variance that
    it leaves is not significantly larger, and they are apart. NaN if there is none. In a short record noise gives many,
    and a periodic signal has one each period."""
    k = int(np.argmax(r))
    low = np.flatnonzero(r < r[k] - _VALLEY)
    before, behind = low[low < k], low[low > k]
    apart = r.copy()
    apart[before[-1] + 1 if len(before) else 0 : behind[0] if len(behind) else len(r)] = -np.inf
    other = int(np.argmax(apart))
    if apart[other] <= 0.0:
        return math.nan
    left = 1.0 - min(float(apart[other]), 1.0) ** 2
    return other if left < _SMALL + (1.0 + 8.0 / math.sqrt(n)) * (1.0 - min(float(r[k]), 1.0) ** 2) else math.nan


def _sampled(t: np.ndarray, values: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """A record at equal times from its first one on, about its mean, and 1 where it is known; 0 in gaps."""
    at = t[0] + dt * np.arange(int((t[-1] - t[0]) / dt + 1e-9) + 1)
    known = np.where(in_gap(t, at), 0.0, 1.0)
    return (np.interp(at, t, values) - values.mean()) * known, known
