"""The closed loop of a vehicle with joints against the independent twin: its plant, and the model of its law."""

import numpy as np
import pytest

from random_trees import random_tree, still, tree_xml
from tree_twin import acceleration, inertia, resistance, velocities
from twin import rotation
from uvms_mj import Scenario, Simulation, simulate

TREE = random_tree(31, 4, chain=1.0, v_c_W=np.array([0.3, 0.0, 0.0]))
BASE = {
    "task.frame": "tool",
    "current.speed": 0.3,
    "current.direction_deg": 0.0,
    "disturbance.bias": TREE.disturbance_bias.tolist(),
    "disturbance.amplitude": TREE.disturbance_amplitude.tolist(),
    "disturbance.frequency_hz": TREE.disturbance_frequency_hz.tolist(),
    "initial.attitude_deg": [10.0, -8.0, 15.0],
    "initial.velocity": [0.1, -0.1, 0.05, 0.1, 0.2, -0.1],
    "initial.joints": [0.3, -0.2, 0.4, 0.1],
    "wall.position": 50.0,
    "simulation.duration": 0.05,
}


@pytest.fixture
def scenario(tmp_path):
    (tmp_path / "tree.xml").write_text(tree_xml(TREE))
    return Scenario.load("push_wall", BASE | {"vehicle.model": str(tmp_path / "tree.xml")})


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_plant_of_the_loop_is_the_twins(scenario):
    """(nu, q_dot) after a step of semi-implicit Euler is that before plus h times the twin's acceleration."""
    trace, h = simulate(scenario, log_rate="full"), scenario.simulation.timestep
    assert np.abs(trace.tau_q).max() > 1.0
    for k in range(0, 500, 50):
        R, R_next = rotation(trace.quat_WB[k]), rotation(trace.quat_WB[k + 1])
        zeta, after = (np.r_[trace.nu[i], trace.q_dot[i]] for i in (k, k + 1))
        zeta_dot = acceleration(TREE, R, trace.q[k], zeta, np.r_[trace.tau[k], trace.tau_q[k]], trace.t[k])
        v_W = R @ zeta[:3] + h * R @ (zeta_dot[:3] + np.cross(zeta[3:6], zeta[:3]))
        expected = np.r_[R_next.T @ v_W, zeta[3:] + h * zeta_dot[3:]]
        assert np.abs(after - expected).max() < 1e-9 * h * np.abs(zeta_dot).max() + 1e-14
        assert np.allclose(trace.q[k + 1], trace.q[k] + h * after[6:], rtol=0.0, atol=1e-14)


def jacobian(q):
    """nu_T = J zeta, (6, 6 + n)."""
    return np.array([velocities(TREE, q, e)[-1] for e in np.eye(10)]).T


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_model_that_a_law_is_given_at_the_tool_is_the_twins(scenario):
    """Lambda, and the bias J_bar^T h - Lambda J_dot zeta in still water, whose g is what is left without motion."""
    with Simulation(scenario) as sim:
        sim.step(300)
        given = {name: np.array(sim.signals[name]) for name in ("M_hat", "C_hat_nu", "D_hat_nu", "g_hat", "nu_T")}
        R, q = rotation(sim.signals.quat_WB), np.array(sim.signals.q)
        zeta = np.r_[sim.signals.nu, sim.signals.q_dot]
    J, M, step = jacobian(q), inertia(TREE, q), 1e-3
    J_dot = sum(
        w / step * (jacobian(q + i * step * zeta[6:]) - jacobian(q - i * step * zeta[6:]))
        for i, w in {1: 45.0 / 60.0, 2: -9.0 / 60.0, 3: 1.0 / 60.0}.items()
    )
    calm = still(TREE)
    Lambda = np.linalg.inv(J @ np.linalg.solve(M, J.T))
    bias = Lambda @ (J @ np.linalg.solve(M, resistance(calm, R, q, zeta)) - J_dot @ zeta)
    g = Lambda @ (J @ np.linalg.solve(M, resistance(calm, R, q, np.zeros(10))))
    size = np.abs(bias).max()
    assert np.allclose(given["nu_T"], J @ zeta, rtol=0.0, atol=1e-12)
    assert np.allclose(given["M_hat"], Lambda, rtol=0.0, atol=1e-10 * np.abs(Lambda).max())
    assert np.allclose(given["g_hat"], g, rtol=0.0, atol=1e-10 * size)
    assert np.allclose(given["C_hat_nu"] + given["D_hat_nu"] + given["g_hat"], bias, rtol=0.0, atol=1e-8 * size)
