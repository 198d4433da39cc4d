"""The native loop at a tool is that of scripts/numpy_arm_loop.py, which has its kinematics and its inertia from MuJoCo
and the rest of the law from dense algebra in NumPy."""

import numpy as np
import pytest

from numpy_arm_loop import NumpyArmLoop
from tool_arm import arm_file
from uvms_mj import Scenario, simulate
from uvms_mj.setup.base import set_up

STEPS = 600
TOLERANCES = {"p_WB": 1e-13, "quat_WB": 1e-13, "q": 1e-12, "nu": 1e-12, "q_dot": 2e-11, "zeta": 2e-11, "z": 1e-10}
"""Rounding of the states. That of F is larger: the condition number of Lambda is 3e5."""


class Rows(NumpyArmLoop):
    """The loop in NumPy with a row of signals for each step."""

    def __init__(self, scenario):
        self.rows = {name: [] for name in (*TOLERANCES, "tau_cmd", "manipulability")}
        super().__init__(scenario, STEPS)

    def callback(self, model, data):
        R, qpos, qvel = data.xmat[self.plant.body_id].reshape(3, 3), data.qpos.copy(), data.qvel.copy()
        states = {"zeta": self.zeta, "z": self.z, "nu": np.r_[R.T @ qvel[:3], qvel[3:6]], "q_dot": qvel[6:]}
        super().callback(model, data)
        poses = {"p_WB": qpos[:3], "quat_WB": qpos[3:7], "q": qpos[7:]}
        for name, value in {**states, **poses, "tau_cmd": self.F, "manipulability": self.manipulability}.items():
            self.rows[name].append(value)


@pytest.fixture(scope="module")
def at_tool(tmp_path_factory):
    """The tool moves in all six directions: s is zero nowhere, where rounding would decide on its sign."""
    start = {
        "vehicle.model": str(arm_file(tmp_path_factory.mktemp("armed"))),
        "initial.joints": [0.3, 0.6, -0.9, 0.5, 0.2],
        "initial.velocity": [0.05, -0.03, 0.02, 0.02, -0.01, 0.03],
        "initial.attitude_deg": [5.0, -4.0, 20.0],
        "task.frame": "tool",
        "simulation.duration": STEPS * 1e-4,
    }
    scenario = Scenario.load("push_wall", start)
    x, y, z = set_up(scenario).initial.position
    reference = {"target": [x + 0.02, y, z], "step_time": 0.0, "bandwidth": 20.0}
    turned = np.add(set_up(scenario).initial.attitude_deg, [3.0, -2.0, 4.0]).tolist()
    wanted = {f"reference.{key}": value for key, value in reference.items()}
    return scenario.updated(wanted | {"reference.attitude_deg": turned, "wall.position": x + 5.0})


CASES = {
    "free in the current": ({}, ["attitude", "joints"]),
    "pressing on the wall": ({"wall.position": -3e-4}, ["attitude", "joints"]),
    "with a motion that no level governs": ({}, ["attitude"]),
    "with joints below the task": ({}, ["joints"]),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the law sees a jump")
@pytest.mark.parametrize("case", CASES)
def test_the_loop_is_that_in_numpy(at_tool, case):
    wall, order = CASES[case]
    face = {key: set_up(at_tool).initial.position[0] + behind for key, behind in wall.items()}
    scenario = at_tool.updated({"posture.order": order, **face})
    trace, rows = simulate(scenario, log_rate="full"), Rows(scenario).rows
    pressed = np.count_nonzero(trace.f_contact_W[:STEPS, 0] < -1.0)
    assert pressed > STEPS // 3 if wall else pressed == 0
    assert np.abs(trace.s[:STEPS]).min() > 1e-7
    for name, tolerance in TOLERANCES.items():
        np.testing.assert_allclose(getattr(trace, name)[:STEPS], rows[name], rtol=0, atol=tolerance, err_msg=name)
    np.testing.assert_allclose(trace.tau_cmd[:STEPS], rows["tau_cmd"], rtol=0, atol=2e-9)
    np.testing.assert_allclose(trace.manipulability[:STEPS], rows["manipulability"], rtol=1e-11)
