"""Bands: least and largest values since the row before, against a log of every step, bit for bit."""

import numpy as np
import pytest

from uvms_mj import McapLog, Scenario, Simulation, Trace, simulate
from uvms_mj.stages.signals import BAND, BANDED, band_signals

SPHERE = {"shape": "sphere", "radius": 0.15, "stiffness": 2e4, "position": [0.4, 0.002, 0.0]}
EARLY = {"wall.position": 0.1, "reference.step_time": 0.1, "simulation.duration": 1.0}
"""A run that touches the wall at once."""
CASES = {
    "gsta": ("push_wall", EARLY, "gsta", "free_body"),
    "gsta of mujoco": ("push_wall", EARLY, "gsta", "mujoco"),
    "fosm": ("push_wall", EARLY, "fosm", "free_body"),
    "without the task": ("push_wall", EARLY, "pid", "free_body"),
    "several walls, a shorter last row": (
        "push_wall",
        EARLY | {"walls": [SPHERE], "controller.period": 5e-4, "simulation.duration": 1.0003},
        "gsta",
        "free_body",
    ),
    "an arm's tool": ("tool_push", {"simulation.duration": 1.0}, None, "mujoco"),
}


def extremes(full: Trace, rows: Trace, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Extremes of the signal of every step between two rows, the later one included."""
    values = full.push if name == "push" else full[name]
    at = np.searchsorted(full.t, rows.t - 1e-9)
    starts = np.concatenate([[0], at[:-1] + 1])
    return np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)


@pytest.mark.parametrize("case", CASES)
def test_a_band_has_the_extremes_of_every_step_since_the_row_before(case, tmp_path):
    name, overrides, law, engine = CASES[case]
    scenario = Scenario.load(name, overrides, law)
    full = simulate(scenario, engine=engine, log_rate="full")
    rows = simulate(scenario, engine=engine, log_rate=100, sinks=[McapLog(tmp_path / "run.mcap")])
    assert rows.header.row_steps > 1
    recorded = [each for each in BANDED if each == "push" or each in full.arrays]
    assert len(recorded) == (3 if "s" not in full.arrays else 5 if "q" in full.arrays else 4)
    for trace in (rows, Trace.load(tmp_path / "run.mcap")):
        for each in recorded:
            for found, expected in zip(trace.band(each), extremes(full, trace, each), strict=True):
                assert found.tobytes() == expected.tobytes(), each
    for each in full:  # the bands change no other signal
        at = np.searchsorted(full.t, rows.t - 1e-9)
        assert rows[each].tobytes() == full[each][at].tobytes(), each


def test_a_law_that_alternates_has_a_band_where_its_rows_show_one_side():
    """At 10 kHz GSTA's thrust alternates at each step; every tenth step has the same sign."""
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 3.0}), engine="free_body")
    late, z = trace.t > 2.5, 2
    low, high = (edge[late, z] for edge in trace.band("tau"))
    assert np.ptp(trace.tau[late, z]) < 1e-3 * (high - low).min()
    assert (low < 0.0).all()
    assert (high > 0.0).all()
    seen = np.abs(np.diff(trace.tau_variation[late, z])) / 10
    assert np.allclose(seen, (high - low)[1:], rtol=1e-6)  # a step crosses the band


def test_an_export_at_a_lower_rate_has_the_bands_of_a_log_at_that_rate():
    scenario = Scenario.load("push_wall", EARLY)
    quick, slow = (simulate(scenario, engine="free_body", log_rate=rate) for rate in (1000, 100))
    fewer = quick.at_rate(100.0)
    for name in slow:
        assert fewer[name].tobytes() == slow[name].tobytes(), name


def test_a_log_of_every_step_and_a_simulation_have_no_bands():
    full = simulate(Scenario.load("push_wall", {"simulation.duration": 0.01}), log_rate="full")
    names = {edge for edges in BAND.values() for edge in edges}
    assert not names & set(full.arrays)
    assert full.band("tau")[0] is full.tau
    assert np.array_equal(full.band("push")[1], full.push)
    with Simulation(Scenario.load("push_wall")) as sim:
        assert not names & {*sim.signals}
        sim.record(10)
        bands = [signal for signal in sim.recorded if signal.name in names]
        assert len(bands) == 8
        assert tuple(bands[:2]) == band_signals(next(each for each in sim.recorded if each.name == "tau"))
        sim.record(1)
        assert not names & {signal.name for signal in sim.recorded}


def test_a_band_begins_anew_after_a_reset():
    def rows(sim, memory):
        sim.run(1000, np.inf)
        found = memory.taken().copy()
        memory.clear()
        return found

    with Simulation(Scenario.load("push_wall", EARLY), engine="free_body") as sim:
        memory = sim.record(10)
        first = rows(sim, memory)
        sim.run(7, np.inf)
        sim.reset()
        assert np.array_equal(rows(sim, memory), first)
