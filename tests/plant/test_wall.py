"""Contact with the wall: accurate impacts, and notes where the step is too long."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from pressed import K_C, M, pressed
from uvms_mj import Controller, Scenario, simulate
from uvms_mj.physics.contacts import pair_force


def test_the_push_after_the_impact_does_not_depend_on_the_step():
    """Under GSTA the vehicle hits the wall while it moves along it: it sticks, slips and turns."""
    peaks = []
    for timestep in (2e-4, 1e-4, 5e-5):
        overrides = {
            "simulation.timestep": timestep,
            "simulation.duration": 4.0,
            "wall.friction": 0.2,
            "initial.position": [0.97, 0.0, 0.0],
            "reference.step_time": 0.0,
            "reference.waypoints": [
                {"time": 0.0, "position": [1.05, 0.2, 0.0]},
                {"time": 2.0, "position": [1.05, 0.0, 0.1]},
            ],
        }
        trace = simulate(Scenario.load("push_wall", overrides), log_rate="full")
        late = trace.t > trace.first_contact[-1] + 1.0
        assert (trace.push[late] > 0.0).all()
        peaks.append(trace.push[late].max())
    assert np.ptp(peaks) < 0.01 * peaks[-1]


@pytest.mark.slow
def test_the_impact_is_that_of_the_continuous_loop():
    """Peak force and impulse of the paper's scenario converge with order 1 and are accurate at the default step.

    17.872 N is the peak force of an independent integration of the continuous loop.
    """
    peak, impulse = [], []
    for timestep in (1e-4, 5e-5, 2.5e-5):
        overrides = {"simulation.timestep": timestep, "simulation.duration": 8.0}
        trace = simulate(Scenario.load("push_wall", overrides), log_rate=100)
        peak.append(trace.force_peak[-1])
        impulse.append(trace.impulse[-1])
    assert peak[0] == pytest.approx(17.872, rel=5e-4)
    for values, tolerance in ((peak, 5e-4), (impulse, 5e-5)):
        limit = 2.0 * values[2] - values[1]
        assert values[0] == pytest.approx(limit, rel=tolerance)
        assert (values[0] - limit) / (values[1] - limit) == pytest.approx(2.0, rel=0.05)  # order 1


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [8e5, 8.5e5, 3e6])
def test_a_stiff_wall_comes_to_rest_where_the_law_runs_at_every_step(stiffness):
    trace = simulate(
        Scenario.load("push_wall", {"wall.stiffness": stiffness, "simulation.duration": 12.0}), log_rate=100
    )
    assert trace.notes == ()
    assert trace.final_high[-1] - trace.final_low[-1] < 1e-4
    assert trace.push[-1] == pytest.approx(trace.analytic.force, rel=1e-5)


@dataclass(frozen=True)
class Coast(Controller):
    """A law without thrust."""

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = 0.0


def rebound(vehicle: Path, timestep: float, start: float) -> float:
    """Coefficient of restitution of an impact on a wall of 1e5 N/m without damping."""
    overrides = {
        "vehicle.model": str(vehicle),
        "current.speed": 0.0,
        "wall.position": 0.0,
        "initial.position": [start, 0.0, 0.0],
        "initial.velocity": [0.1, 0.0, 0.0, 0.0, 0.0, 0.0],
        "simulation.timestep": timestep,
        "simulation.duration": 0.2,
    }
    trace = simulate(Scenario.load("push_wall", overrides), Coast(), log_rate="full")
    assert trace.touches[-1] == 1
    return float(-trace.nu[-1, 0] / 0.1)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning")
def test_a_wall_that_the_step_resolves_badly_is_noted(slippery):
    """The warning is given exactly if the rebound has an error of more than about 1 %."""
    w = np.sqrt(K_C / M[0])
    for h_w, noted in ((0.05, False), (0.28, False), (0.5, True), (1.3, True)):
        timestep = round(h_w / w, 6)
        errors = [abs(rebound(slippery, timestep, -0.01 - phase * 0.1 * timestep) - 1.0) for phase in (0.0, 0.25, 0.6)]
        assert (max(errors) > 0.012) == noted
        overrides = {"simulation.timestep": timestep, "simulation.duration": timestep}
        notes = simulate(Scenario.load("push_wall", overrides, "impedance"), log_rate="full").notes
        assert any("an impact is badly resolved" in note for note in notes) == noted


@pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning")
def test_a_start_inside_the_wall_is_noted():
    start = {"initial.position": [1.2, 0.0, 0.0], "simulation.duration": 1e-3}
    (note,) = simulate(Scenario.load("push_wall", start)).notes
    assert "starts 0.2 m inside the wall, which pushes it out with 2e+04 N" in note
    resting = {"initial.position": [1.000015, 0.0, 0.0], "simulation.duration": 1e-3}
    assert simulate(Scenario.load("push_wall", resting)).notes == ()


@pytest.mark.parametrize("depth", [1e-17, 2.2e-16, 1e-12, 1e-8, 1e-3])
def test_the_normal_is_the_walls_at_any_depth(depth):
    """Also where the depth is rounding alone."""
    pair, surface = pressed(1e5, 0.0, 0.3, radius=0.241, face=0.7 + 0.241)
    contact = pair.contact
    contact.damping = 100.0
    nu = np.array([0.5, 0.3, 0.1, 0.0, 0.0, 0.0])
    pair_force(pair, surface, np.array([0.7 + depth, 0.1, -0.2]), np.eye(3), nu, 1e-4)
    assert abs(pair.depth - depth) < 3e-16
    normal = (K_C * pair.depth + 100.0 * 0.5) * (pair.depth > 0.0)
    assert contact.f_W[0] == pytest.approx(-normal, rel=1e-9)
    assert np.hypot(*contact.f_W[1:]) <= 0.3 * normal * (1.0 + 1e-9)
    if normal:
        assert contact.normal_W.tolist() == [-1.0, 0.0, 0.0]
