"""Every signal of a run reaches trace, log, export and table by itself, and an absent one is left out."""

import dataclasses
import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from everything import everything
from recorded import decoded, same
from traces import TASK, without
from uvms_mj import InputError, Scenario, Simulation, Trace, simulate
from uvms_mj.cli import main
from uvms_mj.stages.signals import (
    AXES,
    BAND,
    EFFECT_WRENCH,
    GIVEN,
    Signal,
    contact_signals,
    deflection_signal,
    joint_torque_signal,
    pulse_signal,
    recordable,
    tether_signals,
    thruster_signal,
)


def xyz(v):
    return [v.x, v.y, v.z]


def test_any_signal_reaches_trace_log_and_export_without_a_topic_of_its_own(logged, tmp_path):
    """A number, a vector and a matrix with names that no topic knows, and signals that have a message type."""
    trace, _ = logged
    added = (
        Signal("depth", (), "m", "W", "depth of something"),
        Signal("wind_W", (3,), "m/s", "W", "a wind"),
        Signal("J_foot", (2, 6), "1", "B", "a Jacobian"),
        Signal("p_WB_m", (3,), "m", "W", "measured position"),
        Signal("quat_WB_m", (4,), "1", "W", "measured attitude"),
        Signal("nu_m", (6,), "m/s, rad/s", "B", "measured velocity"),
    )
    rng = np.random.default_rng(7)
    rows = np.hstack([trace.rows(), rng.normal(size=(len(trace), sum(signal.size for signal in added)))])
    more = Trace.of(dataclasses.replace(trace.header, signals=(*trace.signals, *added)), rows, trace.outcome)
    more.save(tmp_path / "run.mcap")
    loaded = Trace.load(tmp_path / "run.mcap")
    same(more, loaded)
    assert loaded.signals == more.signals
    topics = decoded(tmp_path / "run.mcap")
    assert np.array_equal([m.data for _, m in topics["/signals/depth"]], more.depth)
    assert np.array_equal([m.data for _, m in topics["/signals/wind_W"]], more.wind_W)
    assert np.array_equal([m.data for _, m in topics["/signals/J_foot"]], more.J_foot.reshape(len(more), 12))
    measured = [xyz(m.pose.position) for _, m in topics["/measured/pose"]]
    assert np.array_equal(measured, more.p_WB_m)
    assert np.array_equal([xyz(m.twist.angular) for _, m in topics["/measured/twist"]], more.nu_m[:, 3:])
    for pose in ([m.transforms[1].transform.rotation for _, m in topics["/tf"]],):
        assert np.array_equal([[q.w, q.x, q.y, q.z] for q in pose], more.quat_d)
    assert np.array_equal([m.pose.orientation.w for _, m in topics["/measured/pose"]], more.quat_WB_m[:, 0])
    loaded.export(tmp_path / "run.npz")
    assert np.array_equal(np.load(tmp_path / "run.npz")["J_foot"], more.J_foot)
    loaded.export(tmp_path / "run.csv")
    assert "wind_W.y [m/s]" in (tmp_path / "run.csv").read_text().partition("\n")[0]


def test_a_signal_that_is_not_recorded_has_no_topic(logged, tmp_path):
    """A law without the impedance task has no s, zeta and tau_nom."""
    trace, _ = logged
    less = without(trace, *TASK, "f_contact_m_W", "stretch_W", "tau_dist")
    less.save(tmp_path / "run.mcap")
    same(less, Trace.load(tmp_path / "run.mcap"))
    assert not decoded(tmp_path / "run.mcap", "/s", "/zeta", "/tau_nom", "/running/boundary_layer_time")
    without(less, "touches").save(tmp_path / "bad.mcap")
    with pytest.raises(InputError, match="signals differ"):
        Trace.load(tmp_path / "bad.mcap")


def test_every_signal_is_in_the_table_of_the_command():
    shown = CliRunner().invoke(main, ["signals"], env={"COLUMNS": "200"}).output
    for name in (*(each.name for each in (*GIVEN, *recordable())), *itertools.chain(*BAND.values())):
        assert re.search(rf"\b{name}\b", shown), name


def test_runs_with_all_elements_record_each_signal_of_the_table_and_no_other():
    """But for the forces of couplings, which a vehicle alone has not; p_WS0 and quat_WS0 stand for every wall."""
    at_tool = {"encoder.name": "encoder", "wrist.name": "sensor", "wrist.site": "tool"}
    afloat = {
        "buoyancy.shapes": [{"shape": "sphere", "radius": 0.1632, "position": [0.0, 0.0, 0.01]}],
        "sea.height": 0.1,
    }
    moored = {"tether.length": 3.0, "tether.elements": 3, "tether.anchor": [-2.5, 0.0, 0.0]}
    table, found = {each.name: each for each in recordable()}, dict[str, Signal]()
    for scenario, engine in (
        (everything("sensors"), "free_body"),
        (everything("filter"), "free_body"),
        (Scenario.load("tool_slide", at_tool), "mujoco"),
        (Scenario.load("steer_lauv", afloat), "free_body"),
        (Scenario.load("push_wall", moored), "free_body"),
    ):
        with Simulation(scenario, engine=engine) as sim:
            found |= {
                each.name: each for each in sim.recorded if each.name in table or not each.meaning.startswith("state ")
            }
    assert found.keys() == table.keys() - {"f_couplings_W"}
    for name, signal in found.items():
        assert (signal.unit, signal.meaning, len(signal.shape)) == (
            table[name].unit,
            table[name].meaning,
            len(table[name].shape),
        )


def test_bands_make_a_log_about_a_quarter_larger(tmp_path):
    """As docs/reference/log.md says."""
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 2.0}), engine="free_body")
    trace.save(tmp_path / "with.mcap")
    without(trace, *itertools.chain(*(BAND[name] for name in ("tau", "s", "u", "push")))).save(
        tmp_path / "without.mcap"
    )
    ratio = (tmp_path / "with.mcap").stat().st_size / (tmp_path / "without.mcap").stat().st_size
    assert 1.2 < ratio < 1.3


@pytest.mark.parametrize("wrong", [{"unit": "N"}, {"shape": (3,)}, {"frame": "W"}, {"name": "alone"}])
def test_a_log_with_a_band_unlike_its_signal_is_refused(logged, tmp_path, wrong):
    trace, _ = logged
    odd = tuple(dataclasses.replace(s, **wrong) if s.name == "tau_low" else s for s in trace.signals)
    arrays = {s.name: np.zeros((len(trace), *s.shape)) if s.name not in trace.arrays else trace[s.name] for s in odd}
    arrays |= {s.name: np.zeros((len(trace), *s.shape)) for s in odd if s.shape != arrays[s.name].shape[1:]}
    Trace(dataclasses.replace(trace.header, signals=odd), arrays, trace.outcome).save(tmp_path / "odd.mcap")
    with pytest.raises(InputError, match="signals differ"):
        Trace.load(tmp_path / "odd.mcap")


@pytest.mark.parametrize("n", [1, 3, 4, 6])
def test_a_number_of_each_thruster_contact_or_fin_is_counted_and_has_no_axes(n):
    """Three contacts, four fins and six thrusters are no vector, quaternion or twist."""
    of_each = (*contact_signals(n)[2:3], deflection_signal(n), tether_signals(n + 1)[1])
    of_each += (thruster_signal(n), pulse_signal(n), joint_torque_signal(n))
    for signal in of_each:
        assert signal.components == tuple(str(k + 1) for k in range(n))
    forces = contact_signals(1)[1]
    assert forces.components == ("x", "y", "z")
    assert EFFECT_WRENCH.components == dataclasses.replace(EFFECT_WRENCH, frame="-").components == AXES


def test_a_state_with_a_number_of_each_thruster_is_counted():
    """The BlueROV1 has six, as many as a twist has components."""
    example = Path(__file__).parents[2] / "examples" / "lagging_thrusters.py"
    scenario = Scenario.load("push_wall", {"actuation.name": f"{example}:LaggingThrusters"})
    with Simulation(scenario, engine="free_body") as sim:
        lagging = [each for each in sim.recorded if each.name in ("thrust", "u_cmd")]
    assert len(lagging) == 2
    for state in lagging:
        assert state.components == ("1", "2", "3", "4", "5", "6")
        assert state.frame == "-"
