"""Integral terms with a limit: the kernel that laws share, and the limit's part in the balance at rest.

Beyond its limit an integral keeps the limit (clamping, the simplest protection against windup). At rest it therefore
has a rate of zero, or it is at a limit and its rate points outwards. Both cases are one equation,

    xi = min(limit, max(-limit, xi + rate)),

which :func:`at_limit` gives as a residual.
"""

import math
from typing import Any

import numpy as np

from ..physics.kernels import kernel


@kernel
def within(x, limit) -> float:
    """x, or the nearest number from -limit to limit."""
    return min(limit, max(-limit, x))


def at_limit(xi: Any, rate: Any, limit: Any) -> Any:
    """Residual of a limited integral at rest, a number or an array: zero if it stays at xi. The rate may have any
    positive factor."""
    return xi - np.clip(xi + rate, -limit, limit)


class Integral:
    """A limited integral on the way to a rest, for a residual of :mod:`.balance`.

    Attributes:
        limit: a number or an array.
        step: of implicit Euler on the way [s]; infinite at rest.
        value: at the end of the latest step.
    """

    def __init__(self, limit: Any) -> None:
        self.limit, self.step, self.value, self._next = limit, math.inf, 0.0 * limit, 0.0 * limit

    def left(self, needed: Any, rate: Any) -> Any:
        """What is left of the value that holds the vehicle at a pose, at rest :func:`at_limit`, for the rate there."""
        if math.isinf(self.step):
            return at_limit(needed, rate, self.limit)
        self._next = np.clip(self.value + self.step * rate, -self.limit, self.limit)
        return needed - self._next

    def advance(self) -> None:
        """Keep the value that the latest residual has found."""
        self.value = self._next

    def begin(self) -> None:
        """Start at zero."""
        self.value = 0.0 * self.limit
