"""Metrics of the hold against sums over every step, and against runs that are wrong by a known amount."""

import numpy as np
import pytest

from uvms_mj import Scenario, simulate
from uvms_mj.analysis import hold
from uvms_mj.analysis.summary import PARTS, summary
from uvms_mj.analysis.summary import rows as rows_of
from uvms_mj.records.trace import Trace

KEYS = {
    "initial.position": [0.98, 0.0, 0.0],
    "reference.target": [1.0, 0.0, 0.0],
    "impedance.F_d": [-5.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    "simulation.timestep": 2e-3,
    "simulation.duration": 7.2,
    "wall.stiffness": 1e3,
    "current.speed": 0.1,
}


def shaken(log_rate):
    """A run whose wall shakes, so that the push varies and is lost at times."""
    keys = {key: value for key, value in KEYS.items() if key != "wall.stiffness"} | {"wall.present": False}
    wall = {
        "shape": "plane",
        "position": [1.24, 0.0, 0.0],
        "stiffness": 1e3,
        "amplitude": [0.02, 0, 0],
        "frequency_hz": 1.0,
    }
    return simulate(Scenario.load("push_wall", keys | {"walls": [wall]}), engine="free_body", log_rate=log_rate)


@pytest.fixture(scope="module")
def every_step():
    return shaken(500.0)


@pytest.fixture(scope="module")
def rows():
    return shaken(50.0)


def test_rows_hide_nothing_of_the_steps(every_step, rows):
    late = every_step.t > every_step.t[-1] - hold.HOLD_S + 1e-9
    away = np.abs(every_step.push - 5.0)[late]
    assert hold.error(every_step) == pytest.approx(np.sqrt(np.mean(away**2)), rel=1e-12)
    assert hold.worst(rows) == hold.worst(every_step) == away.max()
    assert hold.error(rows) > hold.error(every_step)
    lost = 2e-3 * (every_step.push[late] == 0.0).sum()
    assert lost > 0.1
    assert hold.lost(every_step) == pytest.approx(lost)
    assert lost <= hold.lost(rows) <= lost + 0.02 * every_step.touches[-1]
    assert hold.contacts(every_step) == 0
    assert hold.bias(rows) == pytest.approx(hold.bias(every_step), abs=1e-9)
    assert hold.bias(every_step) == pytest.approx(every_step.push[late].mean() - 5.0, abs=0.02)
    assert hold.settling(every_step) is None


def test_the_course_is_the_push_in_parts(every_step, rows):
    found = hold.course(rows, PARTS)
    steps = np.arange(len(every_step) - 1) * PARTS // (len(every_step) - 1)
    parts = [every_step.push[1:][steps == i] for i in range(PARTS)]
    assert np.allclose(found["mean"], [part.mean() for part in parts], atol=0.15)  # half a step
    assert found["least"].tolist() == [part.min() for part in parts]
    assert found["greatest"].tolist() == [part.max() for part in parts]


def changed(trace, **arrays):
    return Trace(trace.header, {**trace.arrays, **arrays}, trace.outcome)


def test_a_sound_push_and_one_that_is_wrong_by_a_known_amount():
    trace = simulate(Scenario.load("push_wall", KEYS), engine="free_body")
    assert abs(hold.bias(trace)) < 1.0
    assert hold.lost(trace) == 0.0
    assert hold.contacts(trace) == 1
    since = hold.settling(trace)
    assert since is not None
    late = trace.t > trace.first_contact[-1] + since
    assert (np.abs(trace.push[late] - 5.0) <= 1.0).all()
    before = trace.t[hold.deviations(trace) > 1.0].max()
    assert since == pytest.approx(before + 2e-3 - trace.first_contact[-1], abs=1e-3)
    aside = trace.p_WB + np.array([0.5, 0.03, -0.04])
    assert hold.path_error(changed(trace, p_WB=aside)) == pytest.approx(0.05, abs=1e-4), "along the push does not count"
    yawed = np.tile([np.cos(np.pi / 8.0), 0.0, 0.0, np.sin(np.pi / 8.0)], (len(trace), 1))  # by 45 degrees
    across = np.hypot((0.5 - 0.03) / np.sqrt(2.0), 0.04)
    beside = changed(trace, p_WB=trace.p_d + np.array([0.5, 0.03, -0.04]), quat_WB=yawed)
    assert hold.path_error(beside) == pytest.approx(across, abs=1e-12), "the push turns with the vehicle"
    half = np.radians(3.0) / 2.0
    turned = np.tile([np.cos(half), 0.0, 0.0, np.sin(half)], (len(trace), 1))
    assert hold.turn_error(changed(trace, quat_WB=turned)) == pytest.approx(3.0)


def test_the_demanded_push_follows_the_schedule_and_no_push_has_no_hold():
    change = [{"time": 5.0, "F_d": [-8.0, 0, 0, 0, 0, 0], "ramp": 1.0}]
    trace = simulate(Scenario.load("push_wall", KEYS | {"impedance.schedule": change}), engine="free_body")
    force = np.linalg.norm(hold.demanded(trace), axis=1)
    assert (force[0], force[-1]) == (5.0, 8.0)
    assert 0.0 < hold.error(trace) < 3.0
    still = simulate(Scenario.load("push_wall", KEYS | {"impedance.F_d": [0.0] * 6}), engine="free_body")
    short = simulate(Scenario.load("push_wall", KEYS | {"simulation.duration": 1.0}), engine="free_body")
    for without in (still, short):
        assert (hold.bias(without), hold.error(without), hold.lost(without), hold.settling(without)) == (None,) * 4


@pytest.mark.parametrize("law", ["gsta", "impedance"])
def test_the_push_of_a_reference_is_demanded(law):
    """The bias is the closed form of the push at rest minus the reference's push: nothing of GSTA, and of impedance
    control in a current what it gives way."""
    wall = {"shape": "plane", "position": [1.3, 0.0, 0.0], "stiffness": 1e4, "damping": 100.0}
    body = {"position": [0.25, 0.0, 0.0], "radius": 0.04}
    surface = {"reference.name": "along_surface", "reference.push": 6.0, "reference.points": [[1.3, 0.0, 0.0]]}
    keys = {"wall.present": False, "walls": [wall], "vehicle.contact_bodies": [body], "simulation.timestep": 1e-3}
    keys |= surface | {"simulation.duration": 40.0, "current.speed": 0.1, "reference.approach": 0.05}
    trace = simulate(Scenario.load("push_wall", keys, law), engine="free_body")
    expected = trace.analytic.force - 6.0
    assert hold.bias(trace) == pytest.approx(expected, abs=1e-8)
    assert hold.error(trace) == pytest.approx(abs(expected), abs=5e-4)  # chatter of GSTA, a quarter at half the step
    assert (abs(expected) > 0.1) == (law == "impedance")
    assert hold.path_error(trace) < (1e-6 if law == "gsta" else 0.05)
    said = dict(rows_of(trace, summary(trace, {})))["off reference.push"]
    assert said == f"{hold.error(trace):.3g} N rms, {hold.worst(trace):.3g} N at most, of 6 N, over the last 5 s"
