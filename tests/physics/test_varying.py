"""Gauss-Markov processes against their theory, and the interpolation of a table."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.stats import chi2, kstest

from plain_noise import with_own_functions
from uvms_mj.engine.native.compilation import native_function
from uvms_mj.physics.random import key_of
from uvms_mj.physics.varying import (
    FINEST,
    NODES,
    ROWS,
    add_gauss_markov,
    add_interpolated,
    draw_block,
    rate_deviation,
    varying,
)

PHI = np.exp(-1.0 / FINEST)
SIZE = 3 * ROWS


def series_of(seed: int, correlation_time: float = 5.0) -> np.recarray:
    series = np.zeros(1, varying(3))
    series["deviation"], series["key"], series["block"] = 1.0, key_of(seed, "current"), -1
    series["spacing"] = correlation_time / FINEST
    series["kept"], series["kick"] = PHI, np.sqrt(1.0 - PHI**2)
    return series.view(np.recarray)


@pytest.fixture(scope="module")
def block():
    """A function of seed and number that gives the nodes (ROWS, 3) of a block, from machine code."""
    draw = native_function(draw_block, [varying(3), np.dtype(("f8", (SIZE,))), "i8"]).ctypes

    def nodes_of(seed: int, number: int = 0) -> np.ndarray:
        series, nodes = series_of(seed), np.zeros(SIZE)
        series["block"] = number
        draw(series.ctypes.data, nodes.ctypes.data, 3)
        return nodes.reshape(-1, 3)

    return nodes_of


@pytest.fixture(scope="module")
def many(block):
    """(ROWS, 2400): independent processes of unit variance."""
    return np.concatenate([block(seed) for seed in range(800)], axis=1)


def in_band(statistic: float, degrees: int) -> bool:
    """Whether a chi-square statistic is within its central 99.9 % band."""
    return bool(chi2.ppf(5e-4, degrees) < statistic < chi2.ppf(1.0 - 5e-4, degrees))


@pytest.mark.parametrize("node", [0, 1, 700, NODES, ROWS - 1])
def test_the_variance_is_one_at_every_node(many, node):
    assert in_band((many[node] ** 2).sum(), many.shape[1])
    assert abs(many[node].mean()) < 4.0 / np.sqrt(many.shape[1])


@pytest.mark.parametrize("lag", [1, 16, 64, 128])
def test_the_correlation_time_is_T(many, lag):
    """What a later node does not have of an earlier one has the variance 1 - exp(-2 lag/T), and is independent of it.
    Nodes 16 T apart are independent draws."""
    kept, pairs = PHI**lag, [(k, k + lag) for k in range(0, NODES - lag, 1024)]
    early, late = (np.concatenate([many[pair[i]] for pair in pairs]) for i in (0, 1))
    rest = late - kept * early
    assert in_band((rest**2).sum() / (1.0 - kept**2), len(rest))
    assert abs(np.corrcoef(rest, early)[0, 1]) < 4.0 / np.sqrt(len(rest))
    wrong = late - PHI ** (0.5 * lag) * early  # of twice the correlation time
    assert not in_band((wrong**2).sum() / (1.0 - PHI**lag), len(wrong))


def test_the_distribution_is_normal_and_components_are_independent(many):
    spread = many[::512].ravel()
    assert kstest(spread, "norm").pvalue > 1e-3
    for a in range(3):
        x, y = many[1000, a::3], many[1000, (a + 1) % 3 :: 3]
        assert abs(np.corrcoef(x, y)[0, 1]) < 4.0 / np.sqrt(len(x))


def cubic(many, part: float, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Values and rates at this part of every 8th interval, by Catmull and Rom's definition as a Hermite cubic."""
    before, here, there, after = (many[i : i + NODES : 8] for i in range(4))
    slopes = np.stack([there - before, after - here]) / (2.0 * spacing)
    curve = CubicHermiteSpline([0.0, spacing], np.stack([here, there]), slopes)
    return curve(part * spacing), curve.derivative()(part * spacing)


def test_the_rate_of_change_has_its_stated_deviation(many):
    """In the middle between two nodes, where it is largest."""
    spacing = 5.0 / FINEST
    spread = [cubic(many, part, spacing)[1].std() for part in (0.0, 0.25, 0.5)]
    expected = rate_deviation(np.ones(1), 5.0, spacing)[0]
    assert spread[2] == pytest.approx(expected, rel=0.01)
    assert spread[0] < spread[1] < spread[2]


@pytest.mark.parametrize("nodes_in_T", [1.0, 5.0, 64.0])
def test_the_deviation_of_the_rate_is_that_of_the_covariance_of_four_nodes(nodes_in_T):
    phi, weights = np.exp(-1.0 / nodes_in_T), np.array([1.0, -11.0, 11.0, -1.0]) / 8.0
    covariance = phi ** np.abs(np.subtract.outer(range(4), range(4)))
    expected = np.sqrt(weights @ covariance @ weights) * nodes_in_T / 3.0
    assert rate_deviation(np.ones(2), 3.0, 3.0 / nodes_in_T) == pytest.approx([expected] * 2, rel=1e-12)


def test_between_the_nodes_the_variance_is_a_third_of_a_percent_low(many):
    middle = cubic(many, 0.5, 1.0)[0]
    expected = (164.0 + 126.0 * PHI - 36.0 * PHI**2 + 2.0 * PHI**3) / 256.0
    assert 1.0 - expected == pytest.approx(0.0036, abs=1e-4)
    assert (middle**2).mean() / (many[1 : 1 + NODES : 8] ** 2).mean() == pytest.approx(expected, rel=1e-3)


def test_blocks_join_and_continue_one_process(block):
    first, second, again = block(3, 6), block(3, 7), block(3, 6)
    assert np.array_equal(first, again)
    assert np.allclose(first[NODES:], second[: ROWS - NODES], rtol=0.0, atol=1e-13)
    assert not np.allclose(first, second, atol=0.1)
    assert not np.allclose(first, block(4, 6), atol=0.1)


def test_plain_python_draws_the_same_block(block, monkeypatch):
    with_own_functions(monkeypatch)
    series, nodes = series_of(5), np.zeros(SIZE)
    series["block"] = 2
    series["deviation"] = [0.0, 1.0, 0.0]  # others are not drawn
    draw_block(series[0], nodes, 3)
    assert np.array_equal(nodes.reshape(-1, 3)[:, 1], block(5, 2)[:, 1])
    assert not nodes.reshape(-1, 3)[:, [0, 2]].any()


def test_between_two_nodes_the_process_is_the_cubic(block):
    series, flat = series_of(5), block(5, 0).ravel().copy()
    series["block"], series["deviation"] = 0, [0.5, 1.0, 2.0]
    spacing, nodes = float(series["spacing"][0]), flat.reshape(-1, 3) * [0.5, 1.0, 2.0]
    for part in (0.0, 0.25, 0.999):
        values, rates = cubic(nodes, part, spacing)
        for k in (0, 8, 800):
            value, rate = np.zeros(3), np.zeros(3)
            add_gauss_markov(series[0], flat, (k + part) * spacing, value, rate)
            assert np.allclose(value, values[k // 8], rtol=1e-9, atol=1e-9)
            assert np.allclose(rate, rates[k // 8], rtol=1e-9, atol=1e-9)
    start = np.zeros(3)
    add_gauss_markov(series[0], flat, -1.0, start, np.zeros(3))  # before the start it is held
    assert np.array_equal(start, nodes[1])


@pytest.mark.parametrize("rows", [1, 2, 3, 50])
def test_a_table_is_interpolated_as_numpy_does(rows, rng):
    table = np.column_stack([np.sort(rng.uniform(1.0, 9.0, rows)), rng.normal(size=(rows, 2))])
    for t in (*rng.uniform(0.0, 10.0, 40), *table[:, 0]):
        value, rate, step = np.ones(2), np.zeros(2), 1e-7
        add_interpolated(table.ravel(), 0, rows, t, value, rate)
        expected = [[np.interp(t + dt, *table[:, [0, j]].T) for j in (1, 2)] for dt in (0.0, step)]
        assert np.allclose(value - 1.0, expected[0], rtol=1e-12, atol=1e-12)
        assert np.allclose(rate, np.subtract(expected[1], expected[0]) / step, rtol=1e-4, atol=1e-5)
