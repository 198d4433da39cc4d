"""The rest of a tool against its closed forms: whatever the posture, the wall, the gains and the estimates are."""

import numpy as np
import pytest

from at_the_tool import random_push
from tool_arm import arm_file
from uvms_mj import Scenario, Simulation, simulate
from uvms_mj.analysis.rest import demanded_force
from uvms_mj.control.theory import steady_state

SHORT = {"simulation.timestep": 2e-4, "simulation.duration": 8.0}


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> str:
    return str(arm_file(tmp_path_factory.mktemp("vehicle")))


def pushes(model: str, seed: int, n: int) -> list[tuple[float, float, float, float]]:
    """Mean force over the last 0.5 s of n random pushes, the force by hand, the one that the impedance demands, and the
    closed form of the law [N]."""
    rng, found = np.random.default_rng(seed), []
    drawn = [random_push(model, rng) for _ in range(n)]
    with Simulation(Scenario.load("push_wall", drawn[0][0] | SHORT)) as sim:
        for overrides, by_hand in drawn:
            sim.reset(overrides=overrides)
            sim.step(sim.scenario.steps)
            mean = float(sim.signals.final_impulse) / (0.5 - SHORT["simulation.timestep"])  # without the last step
            found.append((mean, by_hand, demanded_force(sim.scenario), steady_state(sim.setup).force))
    return found


def check(found: list[tuple[float, float, float, float]]) -> None:
    measured, by_hand, demanded, closed = np.array(found).T
    np.testing.assert_allclose(demanded, by_hand, rtol=1e-12)
    np.testing.assert_allclose(closed, by_hand, rtol=1e-9)
    np.testing.assert_allclose(measured, by_hand, rtol=1e-4)


@pytest.mark.filterwarnings("ignore::uvms_mj.analysis.sampling.SamplingWarning")
def test_super_twisting_rests_at_the_force_that_the_impedance_demands_at_the_tool(model):
    check(pushes(model, 3, 5))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uvms_mj.analysis.sampling.SamplingWarning")
def test_fifty_random_postures_walls_and_gains(model):
    check(pushes(model, 4, 50))


@pytest.mark.filterwarnings("ignore::uvms_mj.analysis.sampling.SamplingWarning")
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
