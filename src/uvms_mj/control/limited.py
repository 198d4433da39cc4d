"""Integral terms with a limit: the kernel that laws share, and the limit's part in the balance at rest.

Beyond its limit an integral keeps the limit (clamping, the simplest protection against windup). At rest it therefore
has a rate of zero, or it is at a limit and its rate points outwards. Both cases are one equation,

    xi = min(limit, max(-limit, xi + rate)),

which :func:`at_limit` gives as a residual.
"""

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
