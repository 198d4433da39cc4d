"""The scenario tool_push: every law rests at its own closed form."""

import numpy as np
import pytest

from uvms_mj import Scenario, Trace, simulate
from uvms_mj.analysis.metrics import final_force
from uvms_mj.control.design import demanded_force

WRONG = [
    {"name": "upper_arm", "inertia": 0.6, "restoring": 1.3},
    {"name": "forearm", "inertia": 1.4, "damping": 0.5, "coriolis": 0.0},
]
K_X, K_Z, K_C, DEPTH = 150.0, 1500.0, 1e5, 0.01


def push(law: str, duration: float, **overrides) -> Trace:
    settings = {"simulation.timestep": 2e-4, "simulation.duration": duration} | overrides
    return simulate(Scenario.load("tool_push", settings, law), log_rate=100)


@pytest.mark.parametrize("estimates", [{}, {"estimates.links": WRONG, "estimates.inertia": 1.2}])
def test_super_twisting_rests_at_the_force_of_the_turned_stiffness(estimates):
    trace = push("gsta", 12.0, **estimates)
    pitch = np.radians(35.0)
    by_hand = DEPTH / (np.cos(pitch) ** 2 / K_X + np.sin(pitch) ** 2 / K_Z + 1.0 / K_C)
    assert demanded_force(trace.scenario) == pytest.approx(by_hand, rel=1e-12)
    assert trace.analytic.force == pytest.approx(by_hand, rel=1e-9)
    assert trace.final_impulse[-1] / 0.5 == pytest.approx(by_hand, rel=1e-5)
    assert trace.notes == ()


def test_the_first_order_law_rests_at_its_own_closed_form():
    """Impedance control at a tool: test_tool_rest.py."""
    trace = push("fosm", 16.0, **{"controller.epsilon": 3e-3})
    assert abs(trace.analytic.force / demanded_force(trace.scenario) - 1.0) > 3e-3
    assert trace.final_impulse[-1] / 0.5 == pytest.approx(trace.analytic.force, rel=1e-4)
    np.testing.assert_allclose(trace.s[-1], trace.analytic.s, atol=1e-4 * np.abs(trace.analytic.s).max())


def in_current(velocity: np.ndarray, **overrides) -> Trace:
    """A run in a current with the velocity (3,) in W [m/s]. A rest does not depend on the time step."""
    x, y, z = velocity.tolist()
    current = {"current.speed": float(np.hypot(x, y)), "current.vertical": z, "simulation.timestep": 4e-4}
    current["current.direction_deg"] = float(np.degrees(np.arctan2(y, x)))
    return push("gsta", 20.0, **current, **overrides)


def check_rest(trace: Trace) -> None:
    force, settled = final_force(trace)
    assert settled
    assert force == pytest.approx(demanded_force(trace.scenario), abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("azimuth", [0.0, 180.0])
def test_it_stands_a_current_from_any_side(azimuth):
    """Towards the wall, too: no motion is free that the current could drive."""
    angle = np.radians(azimuth)
    trace = in_current(0.5 * np.array([np.cos(angle), np.sin(angle), 0.0]))
    check_rest(trace)
    assert trace.notes == ()
    assert trace.touches[-1] == 2
    assert trace.saturation_time[-1] == 0.0


def test_it_stands_a_current_from_above():
    check_rest(in_current(np.array([0.0, 0.0, -0.5])))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning")
@pytest.mark.parametrize("azimuth", [60.0])
def test_the_alpha_5_holds_its_tool_where_its_gears_do_not_stick(azimuth):
    """The joints come near their speed limits, and the inertia of the rotors keeps the tool on the wall."""
    angle, alpha = np.radians(azimuth), {"vehicle.model": "bluerov2_alpha5", "vehicle.coulomb_friction": 0.0}
    trace = in_current(
        0.5 * np.array([np.cos(angle), np.sin(angle), 0.0]), **alpha, **{"initial.joints": [0.0, 1.0, 1.961, 0.0]}
    )
    check_rest(trace)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning")
def test_a_run_that_does_not_rest_says_so_before_it_starts():
    """Random currents up to 0.8 m/s, start postures and levels of the posture."""
    rng, orders = np.random.default_rng(3), (["attitude", "joints"], ["joints"], ["attitude"], ["station", "joints"])
    for k in range(4):
        direction, q = rng.normal(size=3), rng.uniform((-1.4, 0.2), (0.4, 2.0))
        pitch = float(np.degrees(q.sum()))
        given = {
            "initial.joints": q.tolist(),
            "reference.attitude_deg": [0.0, pitch, 0.0],
            "posture.order": orders[k],
        }
        velocity = rng.uniform(0.1, 0.8) * direction / np.linalg.norm(direction)
        trace = in_current(velocity, **given)
        force, settled = final_force(trace)
        rests = settled and force == pytest.approx(demanded_force(trace.scenario), rel=1e-5)
        assert rests or trace.notes, (velocity, given)
