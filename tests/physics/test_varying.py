"""Gauss-Markov processes against their theory, and the interpolation of a table."""

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from uvms_mj.engine.native.compilation import native_function
from uvms_mj.physics.random import key_of
from uvms_mj.physics.varying import (
    NODES,
    NODES_PER_CORRELATION_TIME,
    add_gauss_markov,
    add_interpolated,
    draw_block,
    rate_deviation,
    varying,
)

PHI = np.exp(-1.0 / NODES_PER_CORRELATION_TIME)
SIZE = 3 * (NODES + 1)


def series_of(seed: int, correlation_time: float = 5.0) -> np.recarray:
    series = np.zeros(1, varying(3))
    series["deviation"], series["key"], series["block"] = 1.0, key_of(seed, "current"), -1
    series["spacing"] = correlation_time / NODES_PER_CORRELATION_TIME
    series["kept"], series["kick"] = PHI, np.sqrt(1.0 - PHI**2)
    return series.view(np.recarray)


@pytest.fixture(scope="module")
def block():
    """A function of seed and number that gives the nodes (NODES + 1, 3) of a block, from machine code."""
    draw = native_function(draw_block, [varying(3), np.dtype(("f8", (SIZE,))), "i8"]).ctypes

    def nodes_of(seed: int, number: int = 0) -> np.ndarray:
        series, nodes = series_of(seed), np.zeros(SIZE)
        series["block"] = number
        draw(series.ctypes.data, nodes.ctypes.data, 3)
        return nodes.reshape(-1, 3)

    return nodes_of


@pytest.fixture(scope="module")
def many(block):
    """(NODES + 1, 2400): independent processes of unit variance."""
    return np.concatenate([block(seed) for seed in range(800)], axis=1)


def in_band(statistic: float, degrees: int) -> bool:
    """Whether a chi-square statistic is within its central 99.9 % band."""
    return bool(chi2.ppf(5e-4, degrees) < statistic < chi2.ppf(1.0 - 5e-4, degrees))


@pytest.mark.parametrize("node", [0, 1, 700, NODES - 1, NODES])
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


def test_the_rate_of_change_has_its_stated_deviation(many):
    rates = np.diff(many, axis=0)[::8] * NODES_PER_CORRELATION_TIME / 5.0
    expected = rate_deviation(np.ones(1), 5.0)[0]
    assert rates.std() == pytest.approx(expected, rel=0.01)
    assert expected == pytest.approx(11.3 / 5.0, rel=0.01)


def test_between_the_nodes_the_variance_is_half_a_percent_low(many):
    middle = 0.5 * (many[:-1] + many[1:])  # the least, of all times between two nodes
    assert (middle**2).mean() / (many**2).mean() == pytest.approx((1.0 + PHI) / 2.0, rel=1e-3)


def test_blocks_join_and_continue_one_process(block):
    first, second, again = block(3, 6), block(3, 7), block(3, 6)
    assert np.array_equal(first, again)
    assert np.allclose(first[-1], second[0], rtol=0.0, atol=1e-13)
    assert not np.allclose(first[:-1], second[:-1], atol=0.1)
    assert not np.allclose(first, block(4, 6), atol=0.1)


def test_plain_python_draws_the_same_block(block):
    series, nodes = series_of(5), np.zeros(SIZE)
    series["block"] = 2
    series["deviation"] = [0.0, 1.0, 0.0]  # others are not drawn
    draw_block(series[0], nodes, 3)
    assert np.array_equal(nodes.reshape(-1, 3)[:, 1], block(5, 2)[:, 1])
    assert not nodes.reshape(-1, 3)[:, [0, 2]].any()


def test_between_two_nodes_the_process_is_linear(block):
    series, flat = series_of(5), block(5, 0).ravel().copy()
    series["block"], series["deviation"] = 0, [0.5, 1.0, 2.0]
    spacing = float(series["spacing"][0])
    values, rates = np.zeros((4, 3)), np.zeros((4, 3))
    for i, t in enumerate((-1.0, 7.0 * spacing, 7.25 * spacing, 8.0 * spacing)):
        add_gauss_markov(series[0], flat, t, values[i], rates[i])
    nodes = flat.reshape(-1, 3) * [0.5, 1.0, 2.0]
    assert np.allclose(values, [nodes[0], nodes[7], 0.75 * nodes[7] + 0.25 * nodes[8], nodes[8]], rtol=1e-12)
    assert np.allclose(rates[2], (nodes[8] - nodes[7]) / spacing, rtol=1e-12)


@pytest.mark.parametrize("rows", [1, 2, 3, 50])
def test_a_table_is_interpolated_as_numpy_does(rows, rng):
    table = np.column_stack([np.sort(rng.uniform(1.0, 9.0, rows)), rng.normal(size=(rows, 2))])
    for t in (*rng.uniform(0.0, 10.0, 40), *table[:, 0]):
        value, rate, step = np.ones(2), np.zeros(2), 1e-7
        add_interpolated(table.ravel(), t, value, rate)
        expected = [[np.interp(t + dt, *table[:, [0, j]].T) for j in (1, 2)] for dt in (0.0, step)]
        assert np.allclose(value - 1.0, expected[0], rtol=1e-12, atol=1e-12)
        assert np.allclose(rate, np.subtract(expected[1], expected[0]) / step, rtol=1e-4, atol=1e-5)
