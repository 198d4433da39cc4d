"""The sequential test of Contact-10: its errors, and that it asks for no more draws than it needs."""

import itertools
import math
import random

import pytest

from uvms_mj.reproduce.bench.sequential import ERROR, HELD, MOST, NOT_HELD, chance, verdict


@pytest.mark.parametrize("share", [0.3, NOT_HELD, 0.9, HELD, 1.0])
def test_the_chance_is_the_share_of_verdicts(share):
    """By a simulation of the draws, which knows nothing of the recursion."""
    generator = random.Random(1)
    n = 4000
    verdicts = [verdict(generator.random() < share for _ in range(MOST)) for _ in range(n)]
    held, mean = chance(share)
    assert sum(each for each, _ in verdicts) / n == pytest.approx(held, abs=3.0 * math.sqrt(0.25 / n))
    assert sum(draws for _, draws in verdicts) / n == pytest.approx(mean, rel=0.05)


def test_both_errors_are_what_wald_promises_but_for_the_cut():
    assert chance(NOT_HELD, 10_000)[0] <= ERROR / (1.0 - ERROR)
    assert 1.0 - chance(HELD, 10_000)[0] <= ERROR / (1.0 - ERROR)
    assert chance(NOT_HELD)[0] < 0.055
    assert 1.0 - chance(HELD)[0] < 0.045


def test_a_verdict_is_the_same_for_any_number_of_draws_that_run_at_once():
    generator = random.Random(2)
    for _ in range(200):
        passed = [generator.random() < 0.9 for _ in range(MOST)]
        whole = verdict(passed)
        first = next(n for n in itertools.count(1) if verdict(passed[:n])[0] is not None)
        assert whole == verdict(passed[:first]) == (whole[0], first)
        assert all(verdict(passed[:n]) == whole for n in range(first, MOST + 1))


def test_three_failures_at_once_end_a_level_and_eighteen_passes_hold_it():
    assert verdict([False] * 3) == (False, 3)
    assert verdict([False] * 2) == (None, 2)
    assert verdict([True] * 18) == (True, 18)
    assert verdict([True] * 17) == (None, 17)
    assert verdict([True] * 5, 5) == (True, 5)
    assert verdict([True] * 4 + [False], 5) == (False, 5)
