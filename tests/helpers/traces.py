"""Traces for tests."""

import dataclasses

import numpy as np

from uvms_mj import Trace

TASK = ("s", "zeta", "tau_nom", "boundary_layer_time")
"""Signals that a law without the impedance task does not have."""


def without(trace: Trace, *names: str) -> Trace:
    """The same run without some signals."""
    left = tuple(signal for signal in trace.signals if signal.name not in names)
    rows = np.hstack([trace[signal.name].reshape(len(trace), -1) for signal in left])
    return Trace.of(dataclasses.replace(trace.header, signals=left), rows, trace.outcome)


def products_are_plain_sums() -> bool:
    """Whether NumPy rounds R.T @ x of a rotation (3, 3) and x @ y as machine code does, as a sum in order of rounded
    products. OpenBLAS chooses its kernels by the processor, and some fuse the multiplication and the addition."""
    rng = np.random.default_rng(0)
    pairs = [(rng.normal(size=(3, 3)), rng.normal(size=3)) for _ in range(50)]
    turns = all(np.array_equal(R.T @ x, R[0] * x[0] + R[1] * x[1] + R[2] * x[2]) for R, x in pairs)
    return turns and all(R[0] @ x == R[0, 0] * x[0] + R[0, 1] * x[1] + R[0, 2] * x[2] for R, x in pairs)


def assert_rounded_alike(found, expected) -> None:
    """Machine code and plain Python: equal, or within the rounding of NumPy's products where they are fused."""
    tolerance = 0.0 if products_are_plain_sums() else 1e-9
    np.testing.assert_allclose(found, expected, rtol=tolerance, atol=tolerance)
