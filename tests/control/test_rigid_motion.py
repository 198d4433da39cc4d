"""The motion to a rest as machine code is that of plain Python."""

import numpy as np
import pytest

from uvms_mj import Scenario
from uvms_mj.control.base import SteadyState
from uvms_mj.control.theory.predictions import steady_state
from uvms_mj.control.theory.rigid_motion import RigidMotion
from uvms_mj.setup.base import set_up

PILE = {"shape": "cylinder", "position": [1.0, 0.05, 0.0], "radius": 0.15, "stiffness": 8000.0, "damping": 100.0}
AMONG = {
    "wall.present": False,
    "walls": [PILE, {"shape": "plane", "position": [1.6, 0.0, 0.0], "stiffness": 1e4}],
    "reference.target": [0.9, 0.12, -0.05],
    "reference.attitude_deg": [3.0, -4.0, 8.0],
    "current.speed": 0.2,
    "current.direction_deg": 130.0,
    "disturbance.bias": [1.0, -0.5, 0.4, 0.05, 0.0, -0.02],
    "estimates.restoring": 1.1,
    "estimates.damping": 0.9,
    "controller.period": 0.001,
    "simulation.duration": 30.0,
}
BIASED = {
    "navigation.name": "sensors",
    "navigation.force_bias": [0.4, -0.3, 0.2],
    "navigation.position_bias": [0.004, 0.002, -0.003],
    "navigation.attitude_bias": [0.01, -0.02, 0.01],
    "navigation.velocity_bias": [0.002, -0.001, 0.0],
    "navigation.force_scale": 0.05,
}
FAR = {"reference.target": [1.6, 0.1, 0.0], "impedance.K_d": [400.0, 400.0, 400.0, 40.0, 40.0, 40.0]}
"""Behind the pile, where the thrusters come to their limits."""
SCHEDULE = {"impedance.schedule": [{"time": 3.0, "ramp": 2.0, "F_d": [-4.0, 1.0, 0.0, 0.0, 0.0, 0.0]}]}
WAY = {
    "reference.name": "path",
    "reference.poses": [{"position": [0.5, 0.3, 0.1]}, {"position": [0.9, 0.12, -0.05], "attitude_deg": [0, 0, 20]}],
}
CASES = [
    *(({}, law) for law in ("gsta", "impedance", "ideal", "admittance", "dob_impedance")),
    ({"layer": {"controller.epsilon": 0.3}}, "fosm"),
    ({"navigation": BIASED}, "admittance"),
    ({"navigation": BIASED}, "impedance"),
    ({"far": FAR}, "pid"),
    ({"far": FAR}, "admittance"),
    ({"schedule": SCHEDULE}, "parallel"),
    ({"way": WAY}, "pid"),
    ({"observer": {"observer.name": "momentum_observer", "estimates.restoring": 1.0}}, "impedance"),
]


@pytest.mark.parametrize(("changed", "law"), CASES)
def test_machine_code_finds_the_rest_of_plain_python(changed, law, monkeypatch):
    over = AMONG | {key: value for each in changed.values() for key, value in each.items()}
    if "way" in changed:
        over = {key: value for key, value in over.items() if key not in ("reference.target", "reference.attitude_deg")}
    setup = set_up(Scenario.load("push_wall", over, law))
    followed, known = [], RigidMotion.rest_from
    monkeypatch.setattr(RigidMotion, "rest_from", lambda *given: followed.append(0) or known(*given))
    compiled = steady_state(setup)
    assert followed
    monkeypatch.setattr(RigidMotion, "known", False)
    plain, count = steady_state(setup), len(followed)
    assert len(followed) == count
    assert type(compiled) is type(plain)
    if not isinstance(plain, SteadyState):
        assert compiled.reason == plain.reason
        return
    assert plain.position is not None
    np.testing.assert_allclose(compiled.force, plain.force, rtol=1e-9, atol=1e-9)
    for name in ("position", "quat", "tau"):
        np.testing.assert_allclose(getattr(compiled, name), getattr(plain, name), rtol=1e-9, atol=1e-9)
