"""Draws: distributions by Kolmogorov-Smirnov, designs by their evenness, independence of keys and of later entries."""

import itertools
import math

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from uvms_mj import InputError
from uvms_mj.studies.plan.file import Vary, entries, quantile
from uvms_mj.studies.plan.plan import points, unit_cube

DISTRIBUTIONS = {
    "uniform": ({"low": -2.0, "high": 3.0}, stats.uniform(-2.0, 5.0)),
    "loguniform": ({"low": 2e4, "high": 2e5}, stats.loguniform(2e4, 2e5)),
    "normal": ({"mean": 1.0, "deviation": 0.1}, stats.norm(1.0, 0.1)),
    "truncated_normal": (
        {"mean": 1.0, "deviation": 0.5, "low": 0.8, "high": 2.5},
        stats.truncnorm(-0.4, 3.0, 1.0, 0.5),
    ),
}
RANDOM = ("random", "sobol", "latin_hypercube")


def varied(**table) -> Vary:
    faults = []
    found = entries([table], faults)
    assert faults == []
    return found["vary[0]"]


def drawn_from(design, keys, runs, seed):
    """The draws of a design."""
    return points(design, {f"vary[{i}]": each for i, each in enumerate(keys)}, runs, seed)[0]


def uniform(key: str) -> Vary:
    return varied(key=key, distribution="uniform", low=0, high=1)


THREE = ("wall.stiffness", "wall.damping", "wall.position")


@pytest.mark.parametrize("design", RANDOM)
@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_the_draws_have_their_distribution(name, design):
    parameters, law = DISTRIBUTIONS[name]
    drawn = np.array(drawn_from(design, [varied(key="wall.stiffness", distribution=name, **parameters)], 4096, 3))[:, 0]
    assert stats.kstest(drawn, law.cdf).pvalue > 1e-3
    assert drawn.min() >= parameters.get("low", -math.inf)
    assert drawn.max() <= parameters.get("high", math.inf)


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_a_quantile_is_the_inverse_of_the_distribution_function_up_to_the_ends(name):
    parameters, law = DISTRIBUTIONS[name]
    u = np.linspace(0.001, 0.999, 301)
    np.testing.assert_allclose(law.cdf(quantile(name, u, **parameters)), u, rtol=1e-9)
    ends = quantile(name, np.array([0.0, 1.0]), **parameters)
    assert np.isfinite(ends).all()
    if "low" in parameters:
        np.testing.assert_allclose(ends, [parameters["low"], parameters["high"]], rtol=1e-9)


@pytest.mark.parametrize("design", RANDOM)
def test_values_are_drawn_equally_often(design):
    drawn = [each for (each,) in drawn_from(design, [varied(key="wall.friction", values=[0.0, 0.2, 0.5])], 3000, 1)]
    counts = [drawn.count(value) for value in (0.0, 0.2, 0.5)]
    assert sum(counts) == 3000
    assert stats.chisquare(counts).pvalue > 1e-3


def test_sobol_and_latin_hypercube_points_are_more_even_than_random_ones():
    uneven = {design: qmc.discrepancy(unit_cube(design, THREE, 256, 5)) for design in RANDOM}
    assert uneven["sobol"] < 0.2 * uneven["random"]
    assert uneven["latin_hypercube"] < 0.5 * uneven["random"]


@pytest.mark.parametrize("design", ["sobol", "latin_hypercube"])
def test_each_of_n_equal_parts_of_a_key_has_one_of_n_draws(design):
    u = unit_cube(design, THREE[:2], 64, 2)
    for column in u.T:
        assert sorted((column * 64).astype(int)) == list(range(64))


def test_a_random_key_keeps_its_values_when_keys_and_runs_are_added():
    first, second, _ = THREE
    alone = unit_cube("random", [first], 100, 7)[:, 0]
    np.testing.assert_array_equal(unit_cube("random", [first, second], 100, 7)[:, 0], alone)
    np.testing.assert_array_equal(unit_cube("random", [second, first], 100, 7)[:, 1], alone)
    np.testing.assert_array_equal(unit_cube("random", [first], 500, 7)[:100, 0], alone)
    assert (unit_cube("random", [first], 100, 8)[:, 0] != alone).all()


def test_random_keys_are_independent():
    u = unit_cube("random", THREE, 4000, 7)
    correlations = np.corrcoef(u.T)[np.triu_indices(3, 1)]
    assert np.abs(correlations).max() < 4.0 / math.sqrt(4000)


@pytest.mark.parametrize("design", [*RANDOM, "sobol_indices"])
def test_the_seed_decides_the_points(design):
    once, again, other = (unit_cube(design, THREE[:2], 64, seed) for seed in (4, 4, 5))
    np.testing.assert_array_equal(once, again)
    assert not np.array_equal(once, other)


def test_a_grid_is_the_product_of_its_levels_and_the_last_key_changes_fastest():
    stiffness = varied(key="wall.stiffness", low=1e3, high=1e5, number=3, spacing="log")
    speed = varied(key="current.speed", low=0, high=1, number=5)
    pair = varied(keys=["estimates.damping", "estimates.coriolis"], values=[[0.5, 1.5], 1])
    grid = drawn_from("grid", [stiffness, speed, pair], 30, 0)
    expected = itertools.product([1e3, 1e4, 1e5], [0.0, 0.25, 0.5, 0.75, 1.0], [(0.5, 1.5), (1.0, 1.0)])
    np.testing.assert_allclose(grid, [(k, v, *both) for k, v, both in expected])


@pytest.mark.parametrize("design", RANDOM)
def test_keys_of_one_entry_move_together(design):
    keys = ["estimates.damping", "estimates.coriolis", "estimates.restoring"]
    pair = varied(keys=keys, distribution="uniform", low=[0.5, 1.0, 3.0], high=[1.5, 3.0, 5.0])
    drawn = np.array(drawn_from(design, [pair], 50, 2))
    np.testing.assert_allclose(drawn[:, 1], 2.0 * drawn[:, 0])
    np.testing.assert_allclose(drawn[:, 2], 2.0 * drawn[:, 0] + 2.0)
    same = varied(keys=keys, distribution="uniform", low=0.5, high=1.5)
    assert all(len(set(point)) == 1 for point in drawn_from(design, [same], 20, 2))


def test_sobol_indices_of_a_known_function_come_out():
    from SALib.analyze import sobol

    u = unit_cube("sobol_indices", THREE, 2048 * 5, 1)
    problem = {"num_vars": 3, "names": ["a", "b", "c"], "bounds": [[0.0, 1.0]] * 3}
    found = sobol.analyze(problem, 3.0 * u[:, 0] + u[:, 1], calc_second_order=False, seed=1)
    np.testing.assert_allclose(found["S1"], [0.9, 0.1, 0.0], atol=0.02)
    np.testing.assert_allclose(found["ST"], [0.9, 0.1, 0.0], atol=0.02)


GRID = [{"key": "wall.friction", "values": [0.0, 0.2]}, {"key": "current.speed", "low": 0, "high": 1, "number": 4}]


@pytest.mark.parametrize(
    ("design", "tables", "runs", "key", "words"),
    [
        ("sobol_indices", None, 100, "design.runs", "4 times a power of two; the nearest are 64 and 128"),
        ("sobol_indices", [], 64, "design.kind", "need a key that varies"),
        ("random", None, None, "design.runs", "the number of draws of the design random"),
        ("grid", None, None, "vary[0].distribution", "a grid needs values"),
        ("grid", GRID, 9, "design.runs", "product of the grid, 8"),
    ],
)
def test_a_design_that_can_not_have_so_many_runs_is_an_error(design, tables, runs, key, words):
    keys = [uniform("wall.stiffness"), uniform("wall.damping")] if tables is None else [varied(**x) for x in tables]
    with pytest.raises(InputError) as raised:
        drawn_from(design, keys, runs, 0)
    assert raised.value.faults[0].key == key
    assert words in raised.value.faults[0].message


def test_a_design_has_its_number_of_runs():
    keys, grid = [uniform("wall.stiffness"), uniform("wall.damping")], [varied(**each) for each in GRID]
    assert [len(drawn_from("grid", grid, runs, 0)) for runs in (None, 8)] == [8, 8]
    for design, runs in (("random", 60), ("sobol", 64), ("sobol_indices", 128)):
        assert len(drawn_from(design, keys, runs, 0)) == runs
    found, notes = points("sobol", dict(zip("ab", keys, strict=True)), 60, 0)
    assert len(found) == 60
    assert notes == ["60 Sobol points are less even than a power of two, 32 or 64"]


@pytest.mark.parametrize(
    ("table", "place", "words"),
    [
        ({"values": [1.0]}, "vary[0]", "give key"),
        ({"key": "wall.friction", "keys": ["a.b"], "values": [1.0]}, "vary[0]", "give key"),
        ({"key": "wall.friction"}, "vary[0]", "give one of values, a grid"),
        ({"key": "wall.friction", "low": 0, "high": 1}, "vary[0]", "give one of values, a grid"),
        ({"key": "wall.friction", "values": [0.1], "number": 3}, "vary[0]", "give one of values, a grid"),
        ({"key": "wall.friction", "values": []}, "vary[0].values", "is empty"),
        ({"key": "wall.friction", "values": [0.1], "low": 0}, "vary[0].low", "has no effect"),
        ({"key": "wall.friction", "low": 0, "number": 3}, "vary[0].high", "lacks this key"),
        ({"key": "wall.friction", "low": 1, "high": 0, "number": 3}, "vary[0].low", "must be less than high"),
        ({"key": "wall.friction", "low": 0, "high": 1, "number": 3, "spacing": "log"}, "vary[0].low", "logarithm"),
        ({"key": "wall.friction", "distribution": "uniform", "low": 0}, "vary[0].high", "lacks this key"),
        ({"key": "wall.friction", "distribution": "normal", "mean": 0}, "vary[0].deviation", "lacks this key"),
        ({"key": "wall.friction", "distribution": "loguniform", "low": 0, "high": 1}, "vary[0].low", "logarithm"),
        ({"key": "wall.friction", "distribution": "normal", "mean": 0, "deviation": 0}, "vary[0].deviation", "than 0"),
        (
            {"key": "wall.friction", "distribution": "normal", "mean": 0, "deviation": 1, "low": 0},
            "vary[0].low",
            "has no effect",
        ),
        (
            {"key": "a.b", "distribution": "truncated_normal", "mean": 0, "deviation": 1, "low": 50, "high": 60},
            "vary[0]",
            "no number can be drawn",
        ),
        ({"keys": ["a.b", "a.c"], "values": [[1, 2, 3]]}, "vary[0].values[0]", "give one, or 2"),
        ({"keys": ["a.b", "a.c"], "low": [1, 2, 3], "high": 9, "number": 2}, "vary[0].low", "give one, or 2"),
        ({"key": "stiffness", "values": [1]}, "vary[0].key", "is not a dotted key"),
        ({"key": "simulation.seed", "values": [1]}, "vary[0].key", "design.repeats"),
        ({"key": "wall.friction", "values": [1], "laws": []}, "vary[0].laws", "is empty"),
    ],
)
def test_an_entry_that_can_not_be_drawn_is_an_error_at_its_key(table, place, words):
    faults = []
    assert entries([table], faults) == {}
    assert [fault.key for fault in faults] == [place]
    assert words in faults[0].message
