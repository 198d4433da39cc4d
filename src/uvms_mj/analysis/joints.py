"""The joints of a vehicle at the end of a run: those that are not where they were to be, and those at a stop."""

import contextlib

import numpy as np

from ..records.trace import Trace
from .setup import set_up

OFF = 0.01
"""Error of a position or a velocity from which a joint is off its target [rad or m, and per second]."""
AT_STOP = 1e-4
"""Distance from an end of its range up to which a joint is at its stop [rad or m]."""


def off_target(trace: Trace) -> dict[str, float]:
    """Errors of the joints that are off the target of a servo at the end, by joint [rad or m, of the velocity interface
    per second]. Empty without a servo, or if a log lacks the file of its motion."""
    errors = np.zeros(0)
    with contextlib.suppress(ValueError):  # the file can't be read, or does not fit the vehicle
        setup = set_up(trace.scenario, trace.header.mjcf)
        targets = setup.interface.target_at(setup, float(trace.t[-1]))
        if targets is not None:
            errors = trace[setup.interface.follows][-1] - targets
    return {link.joint: float(e) for link, e in zip(trace.header.geometry.links, errors, strict=False) if abs(e) > OFF}


def at_stops(trace: Trace) -> dict[str, float]:
    """Positions of the joints that are at a stop at the end, by joint [rad or m]."""
    found = {}
    for link, q in zip(trace.header.geometry.links, trace.q[-1].tolist(), strict=True):
        low, high = link.range or (-np.inf, np.inf)
        if not low + AT_STOP < q < high - AT_STOP:
            found[link.joint] = q
    return found
