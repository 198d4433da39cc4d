"""A motion that tells the models apart: axis d swings, at its speed limit, about the arm stretched forwards.

The trials of the pool are slow: a joint turns once from one posture to another, within ten seconds, and the vehicle
passes through attitudes near those of rest. Added mass and drag act on accelerations and speeds. They count when the
arm swings near the period in which the model swings freely in pitch, 2.8 s; the speed limit then leaves 13 degrees.
"""

import numpy as np
from scipy.interpolate import CubicSpline

from .data import Motion

STRETCHED = tuple(np.radians([0.0, 74.5, 164.5, 0.0]))
"""Joint angles, axes e to b, of the arm stretched forwards, .36 m long [rad]."""
FASTEST = np.radians(30.0)
"""Speed limit of the axes e, d and c of the Reach Alpha 5 [rad/s]."""
PERIOD, PERIODS = 2.8, 8
"""Of the swing [s], and how many of them."""
AMPLITUDE = FASTEST * PERIOD / (2.0 * np.pi)
"""Of axis d [rad], so that it reaches the limit in each half swing."""
_JOINT, _STEP = 1, 0.01


def swing() -> Motion:
    """The motion, which grows to its amplitude in the first period."""
    t = np.arange(0.0, PERIODS * PERIOD + 0.5 * _STEP, _STEP)
    share = np.clip(t / PERIOD, 0.0, 1.0)
    q = np.tile(STRETCHED, (len(t), 1))
    q[:, _JOINT] += AMPLITUDE * share**2 * (3.0 - 2.0 * share) * np.sin(2.0 * np.pi * t / PERIOD)
    return Motion(0.0, float(t[-1]), CubicSpline(t, q))
