r"""The axes that thrusters span, and the pseudoinverse of their allocation matrix over these axes.

A file prints angles and directions with some digits. Right angles of 1.571 give a BlueROV2 a sixth axis with 1e-4 of
the strongest one: its pseudoinverse would ask for thousands of newtons. The singular values that count belong to the
scaled matrix

.. math:: S B N, \qquad S = \mathrm{diag}(1, 1, 1, 1/L, 1/L, 1/L),

with the greatest lever arm L of a thruster and N that gives each column the length 1. It has no units, and neither a
vehicle's size nor the thrusters' units change it. An axis with less than :data:`LEAST` of the strongest one does not
count. Two digits leave 0.05 rad open, more digits less: no axis counts that the rounding of a file may have made.
"""

import functools

import numpy as np

LEAST = 0.05
"""Least singular value over the largest with which an axis counts [1]."""
WEAK = 0.15
"""Below this an axis counts, and is worth a note [1]."""
ROUNDED = 1e-12
"""Below this an axis comes from rounding alone [1]."""
_EXACT, _DROPPED = 1e-16, 1e-9
"""Below these the pseudoinverse leaves an axis out by itself, and out of a matrix that lacks it [1]."""


def axis_strengths(B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Strengths (6,) of the axes over the strongest one, decreasing [1], and the axes (6, 6) as columns of wrenches in
    B's frame, of length 1 in the scaled units, for an allocation matrix (6, n)."""
    U, sigma, _ = _scaled(B)
    strengths = np.zeros(6)
    strengths[: len(sigma)] = sigma / max(sigma[0], 1e-300) if len(sigma) else 0.0
    return strengths, U


def axes_spanned(B: np.ndarray) -> int:
    """Number of axes that thrusters with the allocation matrix (6, n) span."""
    return int((axis_strengths(B)[0] >= LEAST).sum())


def spanning(B: np.ndarray) -> np.ndarray:
    """The allocation matrix (6, n) without the axes that do not count. B itself, if it has none."""
    strengths, U = axis_strengths(B)
    dropped = U[:, (strengths < LEAST) & (strengths > _EXACT)]
    if not dropped.size:
        return B
    S = _scaled(B)[2][:, None]
    kept: np.ndarray = B - dropped @ (dropped.T @ (S * B)) / S
    return kept


def unreached(B: np.ndarray) -> np.ndarray:
    """(6, k) an orthonormal basis of the wrenches of which thrusters with the allocation matrix (6, n) have no part."""
    return np.linalg.svd(spanning(B))[0][:, axes_spanned(B) :]


def is_unreached(B: np.ndarray) -> np.ndarray:
    """(6,) whether the thrusters have no part of an axis, but for what the rounding of a file may have made."""
    lost: np.ndarray = np.linalg.norm(unreached(B), axis=1) > 1.0 - LEAST**2 / 2.0
    return lost


def pseudoinverse(B: np.ndarray, rows: np.ndarray | None = None, columns: np.ndarray | None = None) -> np.ndarray:
    """The pseudoinverse (n, 6) over the axes that count, of B with weights of its rows (6,) and columns (n,) if given:
    the generalised inverse with the least weighted error, and of these the least weighted thrust."""
    kept = spanning(B)
    weighted = kept if columns is None else kept / columns
    weighted = weighted if rows is None else rows[:, None] * weighted
    inverse = np.linalg.pinv(weighted) if kept is B else np.linalg.pinv(weighted, rcond=_DROPPED)
    inverse = inverse if rows is None else inverse * rows
    return inverse if columns is None else inverse / columns[:, None]


def _scaled(B: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Left singular vectors (6, 6), singular values and row scales (6,) of the scaled matrix."""
    return _scaled_of(np.asarray(B, float).tobytes())


@functools.lru_cache(maxsize=32)  # each run of a study asks for the same vehicle
def _scaled_of(numbers: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    B = np.frombuffer(numbers).reshape(6, -1)
    force, moment = np.linalg.norm(B[:3], axis=0), np.linalg.norm(B[3:], axis=0)
    pushes = force > ROUNDED * moment.max(initial=0.0)
    L = float((moment[pushes] / force[pushes]).max(initial=0.0)) or 1.0
    scales = np.repeat([1.0, 1.0 / L], 3)
    scaled = scales[:, None] * B
    size = np.linalg.norm(scaled, axis=0)
    U, sigma, _ = np.linalg.svd(scaled / np.where(size > 0.0, size, 1.0))
    for each in (U, sigma, scales):
        each.flags.writeable = False
    return U, sigma, scales
