"""What the pulses of a run as deployed leave of a push, against the thrusters of a run."""

import numpy as np
import pytest
from click.testing import CliRunner

from uvms_mj import Scenario, Simulation
from uvms_mj.actuation import T200, General
from uvms_mj.actuation.propeller import STANDARD_GRAVITY
from uvms_mj.cli import main
from uvms_mj.setup.base import set_up
from uvms_mj.setup.checks import warnings_of
from uvms_mj.setup.deployment import AS_DEPLOYED, as_deployed, pushed, resolution

COARSE = General(
    curve_command=[1100.0, 1500.0, 1528.0, 1600.0, 1700.0, 1800.0, 1900.0],
    curve_thrust=[-39.9, 0.0, 0.0, *(0.01 * STANDARD_GRAVITY * f for f in (60.0, 182.0, 342.0, 525.0))],
    quantum=1.0,
)
"""The T200 at 16 V, known at few pulses."""
PARTS = np.full(4, np.cos(np.pi / 4.0))


@pytest.mark.parametrize(
    ("push", "thrust", "pulse", "step", "share"),
    [
        (1.5, 0.530, 1534.5, 0.231, 0.15),
        (5.0, 1.77, 1549.6, 0.231, 0.046),
        (20.0, 7.07, 1610.0, 0.339, 0.017),
        (60.0, 21.2, 1721.4, 0.444, 0.007),
    ],
)
def test_four_thrusters_at_45_degrees_have_the_table_of_a_curve_of_few_points(push, thrust, pulse, step, share):
    found = pushed(COARSE, *COARSE.curves(), PARTS, 0.25 / PARTS, push)
    assert found.thrusts[0] == pytest.approx(thrust, rel=2e-3)
    assert abs(found.commands[0] - pulse) < 0.1
    assert abs(found.step - step) < 1e-3
    assert found.step / push == pytest.approx(share, rel=0.07)


BY_HAND = {
    "thrusters.name": "t200",
    "thrusters.lag": "none",
    "vehicle.model": "bluerov2_heavy",
    "controller.name": "external",
    "actuation.name": "external",
    "simulation.timestep": 1e-3,
}
"""Thrusts from the caller, and no lag."""
SETTINGS = (
    {},
    {"voltage": 14.3},
    {"efficiency": 0.8},
    {"quantum": 3.0},
    {"dead_band": 60.0},
    {"voltage": 15.0, "assumed_voltage": 16.0},
)


@pytest.fixture(scope="module", params=SETTINGS, ids=str)
def scanned(request):
    """The settings of the thrusters, the setup, the demands (m,) and the thrusts (m, n) of a run for them."""
    settings = request.param
    made = Scenario.load("push_wall", BY_HAND | {f"thrusters.{key}": value for key, value in settings.items()})
    setup = set_up(made.updated({"actuation.name": "pseudo_inverse"}))
    share = np.linalg.pinv(setup.vehicle.B) @ np.eye(6)[0]
    demands, thrusts = np.concatenate([np.linspace(0.0, 12.0, 4000), [1.5, 5.0, 20.0]]), []
    with Simulation(made, engine="free_body") as sim:
        for demand in demands:
            sim.u[:] = share * demand
            sim.step()
            thrusts.append(sim.signals.u.copy())
    return settings, setup, demands, np.array(thrusts)


def test_the_push_of_a_law_that_does_not_correct_it_is_that_of_the_thrusters_of_a_run(scanned):
    _, setup, demands, thrusts = scanned
    for demand, u in zip(demands[-3:], thrusts[-3:], strict=True):
        assert resolution(setup, demand).given == pytest.approx(setup.vehicle.B[0] @ u, abs=1e-9)


def test_the_least_push_has_the_first_thrust_of_each_thruster_of_a_run(scanned):
    """Each thruster's first thrust above zero in a fine scan of the demand."""
    _, setup, _, thrusts = scanned
    parts = setup.vehicle.B[0]
    working = (np.abs(parts) > 0.1) & (np.abs(thrusts[:-3]).max(axis=0) > 0.0)
    assert working.sum() == 4
    first = [np.abs(column[column != 0.0]).min() for column in thrusts[:-3, working].T]
    assert resolution(setup, 5.0).smallest == pytest.approx(np.abs(parts[working]) @ first, abs=1e-9)


@pytest.mark.parametrize("push", [1.4, 5.0, 20.0])
def test_the_step_is_the_derivative_of_the_push_by_the_pulses(scanned, push):
    settings, setup, _, _ = scanned
    found, parts = resolution(setup, push), setup.vehicle.B[0]
    curve, away = T200(**settings).curves()[0], 1e-4 * np.sign(found.thrusts)
    change = parts @ (curve.at(found.commands + away) - curve.at(found.commands - away)) / 2e-4
    assert found.step == pytest.approx(
        change * settings.get("quantum", 1.0) * settings.get("efficiency", 1.0), rel=1e-6
    )


def test_the_preset_is_behind_what_is_given_and_leaves_other_thrusters_alone():
    assert as_deployed({"controller.delay": 0.4})["controller.delay"] == 0.4
    other = as_deployed({"thrusters.name": "general"})
    assert [key for key in other if key.startswith("thrusters.")] == ["thrusters.name"]
    assert other["actuation.period"] == AS_DEPLOYED["actuation.period"]


def test_a_run_as_deployed_says_first_what_is_left_of_the_push(tmp_path):
    words = ["run", "--as-deployed", "vehicle.model=bluerov2_heavy", "simulation.duration=0.1", "--engine", "free_body"]
    done = CliRunner().invoke(main, [*words, "--out", str(tmp_path / "run"), "--json"])
    assert done.exit_code == 0, done.output
    assert "as deployed: the smallest push that can be held is 0.139 N" in done.stderr
    recorded = Scenario.load(tmp_path / "run" / "scenario.toml")
    assert (recorded.controller.delay, recorded.actuation.period, recorded.thrusters.voltage) == (0.01, 0.005, 15.0)


_OF_EACH = {
    "press_together": [
        "left, as deployed: the smallest push that can be held is ",
        "right, as deployed: the smallest push",
    ],
    "press_bar": [
        "left, as deployed: what is left of the push is not known: there is no [wall]",
        "bar, as deployed: what is left of the push is not known: the vehicle has no thrusters",
    ],
}


@pytest.mark.parametrize("world", _OF_EACH)
def test_of_a_world_as_deployed_each_vehicle_is_named(tmp_path, world):
    """A load has no thrusters, and nothing is left of its push."""
    words = ["run", world, "--as-deployed", "simulation.duration=0.05", "--engine", "free_body", "--json"]
    done = CliRunner().invoke(main, [*words, "--out", str(tmp_path / "run")])
    assert done.exit_code == 0, done.output
    assert all(said in done.stderr for said in _OF_EACH[world])


@pytest.mark.parametrize(("dead_band", "warned"), [(0.0, False), (100.0, True)])
def test_a_push_below_the_least_one_is_warned_of(dead_band, warned):
    keys = {"thrusters.name": "t200", "thrusters.dead_band": dead_band, "vehicle.model": "bluerov2_heavy"}
    notes = warnings_of(set_up(Scenario.load("push_wall", keys)))
    assert any("the demanded push, 1.5 N, can't be held" in note for note in notes) == warned


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"thrusters.name": "ideal"}, "thrusters.name is ideal without a curve that is inverted"),
        ({"thrusters.name": "general"}, "without a curve that is inverted"),
        ({"thrusters.name": "t200", "thrusters.failed": 2}, "thruster 2 fails"),
        ({"thrusters.name": "t200", "vehicle.model": "bluerov2_alpha5"}, "has joints"),
    ],
)
def test_what_is_not_known_is_said(keys, said):
    assert said in resolution(set_up(Scenario.load("push_wall", keys)))
