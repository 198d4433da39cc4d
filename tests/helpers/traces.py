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
