"""The scenario tool_push: every law rests at its own closed form."""

import numpy as np
import pytest

from uvms_mj import Scenario, Trace, simulate
from uvms_mj.analysis.rest import demanded_force

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


@pytest.mark.parametrize(("law", "duration"), [("fosm", 16.0), ("impedance", 40.0)])
def test_the_other_laws_rest_at_their_own_closed_forms(law, duration):
    trace = push(law, duration, **({"controller.epsilon": 3e-3} if law == "fosm" else {}))
    assert abs(trace.analytic.force / demanded_force(trace.scenario) - 1.0) > 3e-3
    assert trace.final_impulse[-1] / 0.5 == pytest.approx(trace.analytic.force, rel=1e-4)
    np.testing.assert_allclose(trace.s[-1], trace.analytic.s, atol=1e-4 * np.abs(trace.analytic.s).max())
