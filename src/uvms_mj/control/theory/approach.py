r"""The way to a rest: from the start, through free water, into contact.

A static balance may have several roots: on both sides of a pile, behind a wall, on top of a sphere. The vehicle rests
at the root that its motion reaches. With the coordinates y from the latest pose, this motion is

.. math:: I (\ddot y - \ddot y_d) + C (\dot y - \dot y_d) = F(y),

with the force F, which is zero at rest, and the path y_d of the reference. It is computed by implicit Euler, whose
steps grow as the motion ends (pseudo-transient continuation: Kelley and Keyes, SIAM J. Numerical Analysis 35, 1998), so
that an impact is plastic and a rest is a root of F. Newton's method then takes the root to rounding. It counts if
:math:`(I + C) \dot y = \partial F / \partial y \; y` does not grow.
"""

from typing import Any, Protocol

import numpy as np

MOST_STEPS = 2000
"""Most steps of a motion."""
FIRST_STEP, SHORTEST_STEP, LAST_STEP = 0.02, 1e-7, 1e3
"""The first step, the shortest one, and the one after which Newton's method takes over [s]."""
LONGEST_STEP = 0.25
"""The longest step while the reference moves [s]."""
MOST_ITERATIONS, ROUGH = 8, 1e-3
"""Most iterations of Newton's method in a step, and the change in one, relative to the whole, that ends them."""
FORCE_AT_REST = 1e-8
"""Largest force at rest [N, N m]."""
MOST_HALVES = 12
"""Number of times that a step of Newton's method is halved where the set of contacts changes."""
_FASTEST = 1e4
"""Walls and algebraic rows have rates above this [1/s]."""
SLOWEST = 1e-3
"""A slower rate or frequency is not seen in a run of minutes [1/s, rad/s]."""
LOST = "the motion from the start can't be followed"
ENDLESS = "the motion from the start comes to no rest"
NO_ROOT = "the static balance has no solution where the motion ends"
UNSTABLE = "the balance that the motion comes to is unstable"


class Motion(Protocol):
    """A motion as :func:`approach` needs it. y is anything.

    Attributes:
        inertia, damping: I and C (n, n); a row with neither is algebraic.
        sharp: change below which Newton's iteration within a step ends [m, rad].
        ends: when the reference is at rest [s].
    """

    inertia: np.ndarray
    damping: np.ndarray
    sharp: float
    ends: float

    @property
    def largest(self) -> float | np.ndarray:
        """Largest change of a coordinate in one step [m, rad], one number or (n,)."""

    def __call__(self, y: Any, /) -> np.ndarray:
        """F (n,)."""

    def jacobian(self, y: Any, /) -> np.ndarray:
        """The derivative (n, n) of F by the coordinates from y."""

    def leaves(self, y: Any, /) -> str:
        """The reason why the motion does not stay at a root of F; empty if it does."""

    def moved(self, y: Any, change: np.ndarray, /) -> Any:
        """y after a change (n,) of the coordinates."""

    def passed(self, t: float, y: Any, /) -> str:
        """Called after each step. Returns the reason why the motion can't go on, or an empty text."""

    def lead(self, y: Any, t: float, step: float, /) -> np.ndarray:
        """Set the reference to its pose at t + step. Returns its change (n,) since t in the coordinates from y."""


def approach(of: Motion, y: Any, velocity: np.ndarray, step: float = FIRST_STEP, steps: int = MOST_STEPS) -> Any:
    """The rest that the motion from y with a velocity (n,) relative to the reference reaches, or the reason why there
    is none. A first step beyond all times of the motion looks for the nearest root instead."""
    t, shortened = 0.0, False
    for _ in range(steps):
        lead = of.lead(y, t, step)
        change = _implicit(of, y, velocity, lead, step)
        if change is None:
            step, shortened = step / 4.0, True
            if step < SHORTEST_STEP:
                return LOST
            continue
        y, velocity, t = of.moved(y, change), (change - lead) / step, t + step
        if reason := of.passed(t, y):
            return reason
        if t >= of.ends and step > LAST_STEP:
            return polished(of, y)
        most = 1.0 if shortened else 10.0 if t >= of.ends else 2.0
        step *= min(most, max(1.0, 0.5 / max(np.max(np.abs(change) / of.largest), 1e-9)))
        shortened = False
        if t < of.ends:
            step = min(step, LONGEST_STEP)
    return ENDLESS


def _implicit(of: Motion, y: Any, velocity: np.ndarray, lead: np.ndarray, step: float) -> np.ndarray | None:
    """The change (n,) in one step of implicit Euler; None if the step is too long."""
    at, change = y, np.zeros(len(lead))
    both = of.inertia / step**2 + of.damping / step

    def missing(change: np.ndarray, at: Any) -> np.ndarray:
        left: np.ndarray = both @ (change - lead) - of.inertia @ velocity / step - of(at)
        return left

    left = missing(change, at)
    for _ in range(MOST_ITERATIONS):
        try:
            less = np.linalg.solve(both - of.jacobian(at), left)
        except np.linalg.LinAlgError:
            return None
        size = np.abs(left).max()
        for k in range(MOST_HALVES):
            moved = change - 0.5**k * less
            if not np.all(np.abs(moved) <= of.largest):
                return None
            if np.abs(less).max() <= max(of.sharp, ROUGH * np.abs(moved).max()):
                return moved
            at = of.moved(y, moved)
            left = missing(moved, at)
            if np.abs(left).max() < size:
                break
        else:  # at a kink, which a shorter step may not reach
            return None
        change = moved
    return None


def polished(of: Motion, y: Any) -> Any:
    """The root at y by Newton's method, or the reason why it is none, or not stable."""
    force = of(y)
    for _ in range(60):
        change = -np.linalg.lstsq(of.jacobian(y), force, rcond=None)[0]
        change *= min(1.0, 1.0 / max(np.max(np.abs(change) / of.largest), 1e-300))
        size = np.abs(force).max()
        for k in range(MOST_HALVES):
            moved = of.moved(y, 0.5**k * change)
            force = of(moved)
            if np.abs(force).max() < size:
                break
        y = moved
        if np.abs(change).max() < 1e-14 or (size < FORCE_AT_REST and np.abs(force).max() > 0.5 * size):
            break
    if not np.abs(force).max() < FORCE_AT_REST:
        return NO_ROOT
    return of.leaves(y) or y


def decays(J: np.ndarray, inertia: np.ndarray) -> bool:
    """Whether inertia y' = J y does not grow, which is algebraic in the rows without inertia."""
    inverses = np.linalg.eigvals(np.linalg.solve(J - inertia, inertia))  # of the rates minus one
    rates = 1.0 + 1.0 / inverses[np.abs(inverses) > 1.0 / _FASTEST]
    return bool(rates.real.max(initial=-np.inf) < SLOWEST)
