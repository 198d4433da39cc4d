"""Whether a law holds a level: Wald's sequential test of the share of draws that it passes.

After each draw the likelihood of the share :data:`HELD` is compared with the likelihood of :data:`NOT_HELD`. The test
ends as soon as their ratio leaves Wald's bounds for two errors of :data:`ERROR`, or after :data:`MOST` draws, where the
larger likelihood decides. A law that passes 90 % of all possible draws lies between the two shares.

A. Wald, Sequential tests of statistical hypotheses, Ann. Math. Statist. 16, 1945.
"""

import math
from collections.abc import Iterable

HELD, NOT_HELD = 0.95, 0.8
"""Shares of draws [1]: a law that passes the first holds the level, a law that passes the second doesn't."""
ERROR = 0.05
"""Probability of a wrong verdict at each of the two shares, but for the cut at :data:`MOST` draws [1]."""
MOST = 60
"""Draws after which the test is cut."""
_PASSED, _FAILED = math.log(HELD / NOT_HELD), math.log((1.0 - HELD) / (1.0 - NOT_HELD))
_BOUND = math.log((1.0 - ERROR) / ERROR)


def verdict(passed: Iterable[bool], most: int = MOST) -> tuple[bool | None, int]:
    """Judge a level by its draws in their order.

    Args:
        passed: whether each draw is passed; later draws than the test needs have no effect.
        most: draws after which the test is cut.

    Returns:
        Whether the level is held, None while more draws are needed; and the number of draws that decided it, or were
        given.
    """
    ratio, n = 0.0, 0
    for each in passed:
        ratio, n = ratio + (_PASSED if each else _FAILED), n + 1
        if abs(ratio) >= _BOUND or n == most:
            return ratio > 0.0, n
    return None, n


def chance(share: float, most: int = MOST) -> tuple[float, float]:
    """The probability that a law with a share of passed draws [1] is found to hold a level, and the mean number of
    draws that the test takes; by recursion over the numbers of failures, exact but for rounding."""
    going, held, draws = {0: 1.0}, 0.0, 0.0
    for n in range(1, most + 1):
        draws += sum(going.values())
        next_going: dict[int, float] = {}
        for failed, weight in going.items():
            for more, part in ((0, share), (1, 1.0 - share)):
                next_going[failed + more] = next_going.get(failed + more, 0.0) + weight * part
        going = {}
        for failed, weight in next_going.items():
            ratio = (n - failed) * _PASSED + failed * _FAILED
            if abs(ratio) < _BOUND and n < most:
                going[failed] = weight
            elif ratio > 0.0:
                held += weight
    return held, draws
