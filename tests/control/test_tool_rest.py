"""The rest of a tool against its closed forms: whatever the posture, the wall, the gains and the estimates are."""

from pathlib import Path

import numpy as np
import pytest

import sweep_rests
from at_the_tool import random_push
from tool_arm import arm_file
from uvms_mj import Scenario, Simulation, simulate
from uvms_mj.control.base import NoClosedForm
from uvms_mj.control.design import demanded_force
from uvms_mj.control.theory.predictions import steady_state
from uvms_mj.setup.base import set_up

COARSE, FINE = {"simulation.timestep": 4e-4}, {"simulation.timestep": 2e-4}
"""A rest does not depend on the time step; at a coarse one the first-order law chatters."""


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> str:
    return str(arm_file(tmp_path_factory.mktemp("vehicle")))


def pushes(model: str, seed: int, n: int) -> list[tuple[float, float, float, float]]:
    """Mean force at rest of n random pushes, the force by hand, the one that the impedance demands, and the closed form
    of the law [N]."""
    rng, found = np.random.default_rng(seed), []
    drawn = [random_push(model, rng) for _ in range(n)]
    with Simulation(Scenario.load("push_wall", drawn[0][0] | COARSE | {"simulation.duration": 12.0})) as sim:
        for overrides, by_hand in drawn:
            sim.reset(overrides=overrides)
            found.append((rest(sim), by_hand, demanded_force(sim.scenario), steady_state(sim.setup).force))
    return found


def rest(sim: Simulation) -> float:
    """Mean force over 0.5 s when four such means, one after the other, agree to 3e-5 [N]; the last one after 12 s."""
    block, means = round(0.5 / COARSE["simulation.timestep"]), []
    while len(means) < 24 and (len(means) < 4 or np.ptp(means[-4:]) > 3e-5 * means[-1]):
        before = float(sim.signals.impulse)
        sim.step(block)
        means.append((float(sim.signals.impulse) - before) / 0.5)
    return means[-1]


def check(found: list[tuple[float, float, float, float]]) -> None:
    measured, by_hand, demanded, closed = np.array(found).T
    np.testing.assert_allclose(demanded, by_hand, rtol=1e-12)
    np.testing.assert_allclose(closed, by_hand, rtol=1e-9)
    np.testing.assert_allclose(measured, by_hand, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning")
def test_super_twisting_rests_at_the_force_that_the_impedance_demands_at_the_tool(model):
    """Of random postures, walls and gains."""
    check(pushes(model, 4, 4))


WRONG = [{"name": "hand", "inertia": 1.1, "restoring": 0.3}, {"name": "upper_arm", "inertia": 0.7, "restoring": 1.6}]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "overrides"),
    [
        ("impedance", {"current.speed": 0.2, "estimates.links": WRONG}),
        ("fosm", FINE | {"controller.epsilon": 3e-3, "estimates.links": WRONG, "wall.damping": 50.0}),
    ],
)
def test_a_law_without_an_integral_rests_where_the_whole_tree_leaves_it(model, law, overrides):
    """Force, sliding variable and thrust, in the current and with weights and buoyancies of all links."""
    base = {
        "vehicle.model": model,
        "task.frame": "tool",
        "initial.joints": [0.1, -0.8, 1.2, 0.2, 0.1],
        "reference.target": [0.86, 0.0, 0.1],
        "reference.attitude_deg": [5.73, 34.38, 5.73],
        "wall.position": 0.85,
        "simulation.duration": 24.0,
    }
    trace = simulate(Scenario.load("push_wall", base | COARSE | overrides, law), log_rate=50)
    state = trace.analytic
    assert not isinstance(state, NoClosedForm), state.reason
    assert state.force > 0.5
    assert abs(state.force / demanded_force(trace.scenario) - 1.0) > 1e-3  # that of super-twisting would be wrong
    assert trace.push[-1] == pytest.approx(state.force, rel=1e-4)
    np.testing.assert_allclose(trace.s[-1], state.s, atol=1e-4 * np.abs(state.s).max())
    np.testing.assert_allclose(trace.tau[-1], state.tau, atol=1e-3)


def test_an_integral_to_which_impedance_control_does_not_answer_moves_no_tool():
    """The sliding variable alone grows with it. Its rest was refused for a division by zero."""
    runs = [
        simulate(Scenario.load("tool_push", COARSE | {"task.integral": each, "simulation.duration": 0.4}, "impedance"))
        for each in (False, True)
    ]
    without, grown = (trace.analytic for trace in runs)
    assert grown.force == pytest.approx(without.force, rel=1e-12)
    assert (runs[0].p_WT == runs[1].p_WT).all()
    assert without.s is not None
    assert grown.s is None
    assert not np.allclose(runs[0].s, runs[1].s)


def test_friction_of_the_gears_and_other_laws_have_no_closed_form(model, tmp_path):
    rubbing = tmp_path / "rubbing.xml"
    rubbing.write_text(Path(model).read_text().replace('damping="0.2"', 'damping="0.2" frictionloss="0.1"'))
    at_tool = {"task.frame": "tool", "reference.target": [1.11, 0.0, 0.1], "wall.position": 1.1}
    for law, file, reason in (
        ("impedance", str(rubbing), "friction in the joints"),
        ("pid", model, "known for a rigid vehicle at B"),
    ):
        state = steady_state(set_up(Scenario.load("push_wall", at_tool | {"vehicle.model": file}, law)))
        assert isinstance(state, NoClosedForm)
        assert reason in state.reason


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning")
def test_a_wall_of_the_list_is_the_same_wall_at_the_tool(model):
    """With friction, in flight, impact and rest, but for the inerter of MuJoCo's pair."""
    overrides, _ = random_push(model, np.random.default_rng(5))
    face = overrides["wall.position"] + 0.02
    same = {"stiffness": 2e4, "damping": 30.0, "friction": 0.3, "tangential_damping": 50.0}
    overrides |= {f"wall.{key}": value for key, value in same.items()} | {"simulation.duration": 1.0}
    overrides["reference.target"] = [
        a + b for a, b in zip(overrides["reference.target"], (0.0, 0.02, 0.01), strict=True)
    ]
    plane = {"shape": "plane", "position": [face, 7.0, -3.0], **same}
    papers = simulate(Scenario.load("push_wall", overrides), log_rate=1000)
    listed = simulate(Scenario.load("push_wall", overrides | {"wall.present": False, "walls": [plane]}), log_rate=1000)
    assert papers.push.max() > 1.0
    assert np.abs(listed.p_WT - papers.p_WT).max() < 1e-5
    assert np.abs(listed.q - papers.q).max() < 1e-4
    assert listed.force_peak[-1] == pytest.approx(papers.force_peak[-1], rel=1e-3)
    assert listed.wall_work[-1] == pytest.approx(papers.wall_work[-1], rel=1e-2)
    assert np.abs(papers.f_contact_W[:, 1:]).max() > 0.1


def test_a_rest_whose_joints_come_to_their_speed_limits_is_not_announced():
    """The run of this case of the sweep loses the wall, and its joints stay at their limits for ever."""
    found = sweep_rests.tried((5, 15, True))
    assert (found.kind, found.measured) == ("not settled", None)
    assert "speed limits" in found.reason
