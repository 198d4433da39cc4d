"""The law's model at a tool: inertia, bias and Jacobian against dense algebra, and the laws' closed loop there."""

import contextlib

import mujoco
import numpy as np
import pytest

from armed import armed_xml
from uvms_mj import Scenario, Simulation, Status, simulate
from uvms_mj.errors import InputError
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.physics.statics import Statics
from uvms_mj.setup.base import set_up
from uvms_mj.setup.checks import warnings_of

pytestmark = pytest.mark.filterwarnings("ignore:the law sees a jump")

STILL = {"wall.present": False, "current.speed": 0.0}


@pytest.fixture(scope="module", params=[1, 4])
def vehicle(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("armed") / "armed.xml"
    path.write_text(armed_xml(request.param, seed=request.param))
    return path, request.param


@pytest.fixture(scope="module")
def arm_of_four(tmp_path_factory):
    path = tmp_path_factory.mktemp("armed") / "armed.xml"
    path.write_text(armed_xml(4))
    return path


def at(path, overrides=None, law="impedance"):
    return Scenario.load(
        "push_wall", {"vehicle.model": str(path), "task.frame": "tool", **STILL, **(overrides or {})}, law
    )


def random_state(n, seed):
    rng = np.random.default_rng(seed)
    quat = rng.normal(size=4)
    return rng.normal(size=3), quat / np.linalg.norm(quat), rng.uniform(-1.0, 1.0, n), rng.normal(size=6 + n)


@contextlib.contextmanager
def simulation_at(scenario, p, quat, q, zeta):
    """A Simulation at a state, before its first step."""
    with Simulation(scenario) as sim:
        sim.data.qpos[:] = [*p, *quat, *q]
        sim.data.qvel[:] = [*(rotation_matrix(quat) @ zeta[:3]), *zeta[3:]]
        yield sim


def jacobian_of_mujoco(model, p, quat, q):
    """J (6, 6 + n) of the tool in its axes, for zeta, by mj_jacSite, and its pose."""
    data = mujoco.MjData(model)
    data.qpos[:] = [*p, *quat, *q]
    mujoco.mj_forward(model, data)
    site = model.site("tool").id
    J = np.zeros((6, model.nv))
    mujoco.mj_jacSite(model, data, J[:3], J[3:], site)
    R_WT = data.site_xmat[site].reshape(3, 3).copy()
    J[:, :3] = J[:, :3] @ rotation_matrix(quat)
    return np.vstack([R_WT.T @ J[:3], R_WT.T @ J[3:]]), data.site_xpos[site].copy(), R_WT


def moved(p, quat, q, zeta, h):
    """The state after a time h at a constant zeta, to first order and exactly for the attitude."""
    turned = np.zeros(4)
    mujoco.mju_copy(turned, quat)
    mujoco.mju_quatIntegrate(turned, zeta[3:6], h)
    return p + h * rotation_matrix(quat) @ zeta[:3], turned, q + h * zeta[6:]


def test_pose_velocity_and_jacobian_of_the_tool_are_those_of_mujoco(vehicle):
    path, n = vehicle
    model = mujoco.MjModel.from_xml_path(str(path))
    for seed in range(2):
        state = random_state(n, seed)
        with simulation_at(at(path), *state) as sim:
            signals, (J, p_WT, R_WT) = sim.signals, jacobian_of_mujoco(model, *state[:3])
            np.testing.assert_allclose(signals.p_WT, p_WT, rtol=0, atol=1e-13)
            np.testing.assert_allclose(rotation_matrix(signals.quat_WT), R_WT, rtol=0, atol=1e-13)
            np.testing.assert_allclose(signals.nu_T, J @ state[3], rtol=0, atol=1e-12)
            statics = Statics(sim.setup.vehicle, state[2])
            np.testing.assert_allclose(statics.jacobian(sim.setup.vehicle.arm.sites["tool"]), J, rtol=0, atol=1e-13)


def dense(setup, model, state):
    """Lambda, J_bar^T, J and J_dot zeta from dense algebra; the last one from finite differences of mj_jacSite."""
    p, quat, q, zeta = state
    J = jacobian_of_mujoco(model, p, quat, q)[0]
    M = Statics(setup.nominal, q).inertia()
    inverse = np.linalg.inv(M)
    Lambda = np.linalg.inv(J @ inverse @ J.T)
    h = 1e-6
    ahead, behind = (jacobian_of_mujoco(model, *moved(*state, sign * h))[0] for sign in (1.0, -1.0))
    return M, J, Lambda, Lambda @ J @ inverse, (ahead - behind) @ zeta / (2.0 * h)


def test_inertia_and_bias_at_the_tool_are_those_of_dense_algebra(vehicle):
    path, n = vehicle
    model = mujoco.MjModel.from_xml_path(str(path))
    for seed in range(2):
        state = random_state(n, seed)
        with simulation_at(at(path), *state) as sim:
            signals = sim.signals
            M, _, Lambda, J_bar_T, J_dot_zeta = dense(sim.setup, model, state)
            np.testing.assert_allclose(signals.M_hat, Lambda, rtol=0, atol=1e-11 * np.abs(Lambda).max())
            assert signals.manipulability == pytest.approx(
                np.sqrt(np.linalg.det(M[:6, :6]) / np.linalg.det(Lambda)), rel=1e-10
            )
            assert signals.manipulability >= 1.0
            law = sim._memory.run["model"]
            np.testing.assert_allclose(law["J_dot_zeta"][0], J_dot_zeta, rtol=0, atol=1e-8)
            C, D, g = (law[name][0] for name in "CDg")
            np.testing.assert_allclose(signals.C_hat_nu, J_bar_T @ C - Lambda @ J_dot_zeta, rtol=0, atol=1e-6)
            np.testing.assert_allclose(signals.D_hat_nu, J_bar_T @ D, rtol=0, atol=1e-10)
            np.testing.assert_allclose(signals.g_hat, J_bar_T @ g, rtol=0, atol=1e-10)


def test_a_wrench_at_the_tool_accelerates_it_as_lambda_and_the_bias_say(vehicle):
    """MuJoCo solves the whole tree with tau = J^T F; the 6 equations at the tool give the same acceleration."""
    path, n = vehicle
    model, F = mujoco.MjModel.from_xml_path(str(path)), np.array([3.0, -2.0, 1.0, 0.2, -0.1, 0.3])
    for seed in range(2):
        state = random_state(n, seed)
        with simulation_at(at(path, {"vehicle.thruster_offset": None}, "external"), *state) as sim:
            signals = {name: np.array(sim.signals[name]) for name in ("M_hat", "C_hat_nu", "D_hat_nu", "g_hat")}
            _, J, _, _, J_dot_zeta = dense(sim.setup, model, state)
            sim.tau_cmd[:] = F
            below = sim._memory.run["model"]["tau_posture"][0].copy()
            sim.step()
            np.testing.assert_allclose(np.r_[sim.signals.tau, sim.signals.tau_q], J.T @ F + below, rtol=0, atol=1e-12)
            zeta_dot = np.r_[sim.signals.nu_dot, sim.data.qacc[6:]]
        bias = signals["C_hat_nu"] + signals["D_hat_nu"] + signals["g_hat"]
        expected = np.linalg.solve(signals["M_hat"], F - bias)
        np.testing.assert_allclose(J @ zeta_dot + J_dot_zeta, expected, rtol=0, atol=2e-8 * np.abs(expected).max())


def residual(path, h):
    """Largest residual of the desired impedance in free motion, from the differences of the tool's velocity."""
    start = {"initial.joints": [0.3, -0.8, 0.5, 0.4], "initial.velocity": [0.1, 0.05, -0.1, 0.1, 0.0, 0.1]}
    wanted = {
        "reference.target": [0.6, 0.1, -0.5],
        "reference.step_time": 0.0,
        "simulation.duration": 0.5,
        "task.inertia_period": h,
    }
    settings = start | wanted | {"simulation.timestep": h, "reference.attitude_deg": [0.3, 35.0, -95.0]}
    trace = simulate(at(path, settings), log_rate="full")
    design = set_up(trace.scenario).design
    wished = -(trace.nu_e @ design.D_d.T + trace.eta_e @ design.K_d.T) @ design.M_d_inv.T
    acceleration = np.diff(trace.nu_T, axis=0) / h
    omega, moving = trace.nu_T[:, 3:], trace.nu_T[:, :3] - trace.nu_e[:, :3]
    p_ddot = np.einsum("nji,nj->ni", rotation_matrix(trace.quat_WT), trace.p_d_ddot) - np.cross(omega, moving)
    wished[:, :3] += p_ddot  # nu_d_dot in T, which turns
    return np.abs(acceleration - wished[:-1]).max(axis=0)


def test_the_tool_has_the_desired_impedance_to_first_order_of_the_time_step(arm_of_four):
    """M_d nu_e_dot + D_d nu_e + K_d eta_e = 0 in still water, with exact estimates and joints that move freely."""
    coarse, fine = residual(arm_of_four, 2e-4), residual(arm_of_four, 1e-4)
    assert (coarse > 1e-6).all()
    np.testing.assert_allclose(coarse / fine, 2.0, rtol=0.03)


def test_a_site_at_the_origin_of_a_rigid_vehicle_is_the_body(tmp_path):
    path = tmp_path / "rigid.xml"
    path.write_text(armed_xml(0))
    settings = {"initial.attitude_deg": [5.0, -10.0, 20.0], "simulation.duration": 2.0, "vehicle.model": str(path)}
    settings |= {"reference.target": [0.3, 0.1, -0.1], "wall.present": False, "estimates.coriolis": 0.8}
    body, site = (
        simulate(Scenario.load("push_wall", settings | {"task.frame": frame}, "gsta")) for frame in ("body", "origin")
    )
    for name in ("p_WB", "nu", "eta_e", "nu_e", "s"):
        np.testing.assert_allclose(site[name], body[name], rtol=0, atol=1e-10, err_msg=name)
    np.testing.assert_allclose(site.p_WT, site.p_WB, rtol=0, atol=1e-15)
    np.testing.assert_allclose(site.manipulability, 1.0, rtol=1e-12)


def test_a_users_law_runs_at_the_tool_as_it_stands(arm_of_four, tmp_path):
    law = tmp_path / "pd.py"
    law.write_text(
        "from dataclasses import dataclass\n"
        "from uvms_mj import Controller, gain\n\n\n"
        "@dataclass(frozen=True)\n"
        "class Pd(Controller):\n"
        '    k_p: float = gain(40.0, "1/s^2", "p")\n'
        "    uses_task = False\n\n"
        "    @staticmethod\n"
        "    def law(gains, state, signals, state_dot, tau_cmd):\n"
        "        for i in range(6):\n"
        "            tau_cmd[i] = signals.C_hat_nu[i] + signals.D_hat_nu[i] + signals.g_hat[i]\n"
        "            for j in range(6):\n"
        "                a = signals.nu_d_dot[j] - gains.k_p * signals.eta_e[j] - 12.0 * signals.nu_e[j]\n"
        "                tau_cmd[i] += signals.M_hat[i, j] * a\n"
    )
    settings = {"reference.target": [0.9, 0.1, -0.2], "simulation.duration": 4.0, "simulation.timestep": 1e-3}
    trace = simulate(at(arm_of_four, settings, f"{law}:Pd"))
    assert trace.status is Status.completed
    np.testing.assert_allclose(trace.eta_e[-1], 0.0, atol=2e-3)


def test_reference_and_desired_inertia_are_those_of_the_tool_at_the_start(arm_of_four):
    start = {"initial.position": [0.5, -0.2, 0.1], "initial.attitude_deg": [10.0, 20.0, -30.0]}
    start |= {"initial.joints": [0.3, -0.8, 0.5, 0.4], "simulation.duration": 1e-3}
    trace = simulate(at(arm_of_four, start))
    np.testing.assert_allclose(trace.p_d[0], trace.p_WT[0], rtol=0, atol=1e-14)
    with Simulation(at(arm_of_four, start)) as sim:
        np.testing.assert_allclose(sim.setup.design.M_d, sim.signals.M_hat, rtol=0, atol=1e-11)
        np.testing.assert_allclose(sim.setup.design.M, sim.signals.M_hat, rtol=0, atol=1e-11)


def test_a_delay_of_zero_changes_nothing(arm_of_four):
    settings = {"reference.attitude_deg": [-16.0, 23.0, -45.0], "simulation.duration": 0.05}
    now, later = (simulate(at(arm_of_four, settings | delay)) for delay in ({}, {"controller.delay": 0.0}))
    np.testing.assert_array_equal(later.p_WT, now.p_WT)
    np.testing.assert_array_equal(later.tau_cmd_delayed, later.tau_cmd)


@pytest.mark.parametrize("frame", ["body", "tool"])
def test_what_is_computed_for_a_rigid_vehicle_only_is_refused_by_name(arm_of_four, frame):
    for settings, law, key in (
        ({}, "ideal", "controller.name"),
        ({"observer.name": "momentum_observer"}, "gsta", "observer.name"),
    ):
        with pytest.raises(InputError) as raised:
            Simulation(at(arm_of_four, settings | {"task.frame": frame}, law))
        assert [fault.key for fault in raised.value.faults] == [key]
        assert "rov has joints" in str(raised.value)


def test_an_unknown_frame_link_or_joint_is_named_with_the_choices(arm_of_four):
    wrong = {"task.frame": "tol", "initial.joints": [0.0], "estimates.links": [{"name": "link9"}]}
    with pytest.raises(InputError) as raised:
        Simulation(at(arm_of_four, wrong))
    message = str(raised.value)
    assert "task.frame: 'tol' is not 'body' or a site; did you mean 'tool'?" in message
    assert "estimates.links[0].name: 'link9' is not a link of rov" in message
    assert "initial.joints: has 1 positions; rov has 4 (joint1, joint2, joint3, joint4)" in message


def test_a_joint_without_a_motor_is_noted(arm_of_four, tmp_path):
    path = tmp_path / "passive.xml"
    path.write_text(armed_xml(4, motors=False))
    assert "no motor drives joint1, joint2, joint3, joint4" in " ".join(warnings_of(set_up(at(path))))
    assert "no motor" not in " ".join(warnings_of(set_up(at(arm_of_four))))


def test_the_engine_without_joints_refuses_a_tool(tmp_path):
    path = tmp_path / "rigid.xml"
    path.write_text(armed_xml(0))
    with pytest.raises(InputError, match=r"task\.frame = 'origin' is not computed by the engine free_body"):
        Simulation(at(path, {"task.frame": "origin"}), engine="free_body")


@pytest.mark.slow
def test_biased_sensors_mislead_the_law_and_not_the_record(arm_of_four):
    """The law sees the tool where the biased position and the biased joints have it; p_WT is the true one."""
    q, bias = [0.3, -0.8, 0.5, 0.4], [0.02, -0.01, 0.03, 0.0]
    sensors = {"encoder.name": "encoder", "encoder.bias": bias, "encoder.velocity": "measured"}
    sensors |= {"navigation.name": "sensors", "navigation.position_bias": [0.1, 0.0, -0.05]}
    start = {"initial.joints": q, "initial.position": [0.5, -0.2, 0.1]}
    with Simulation(at(arm_of_four, sensors | start, "external")) as sim:
        site, p_WB = sim.setup.vehicle.arm.sites["tool"], np.array(start["initial.position"])
        true, seen = (p_WB + Statics(sim.setup.vehicle, np.array(each)).pose(site)[0] for each in (q, np.add(q, bias)))
        np.testing.assert_allclose(sim.signals.p_WT, true, rtol=0, atol=1e-14)
        seen_error = np.add(seen, [0.1, 0.0, -0.05]) - sim.signals.p_d
        R_WT = rotation_matrix(sim.signals.quat_WT)
        np.testing.assert_allclose(np.linalg.norm(sim.signals.eta_e[:3]), np.linalg.norm(seen_error), rtol=1e-12)
        assert np.abs(R_WT.T @ seen_error - sim.signals.eta_e[:3]).max() > 1e-4  # the law's axes are turned, too


def test_a_tool_on_a_rigid_vehicle_is_fixed_in_b(tmp_path):
    path = tmp_path / "rigid.xml"
    path.write_text(armed_xml(0))
    settings = {"reference.target": [0.3, 0.1, -0.1], "simulation.duration": 0.5, "initial.velocity": [0.1] * 6}
    trace = simulate(at(path, settings, "gsta"))
    site, R_WB = set_up(trace.scenario).vehicle.arm.sites["tool"], rotation_matrix(trace.quat_WB)
    np.testing.assert_allclose(trace.p_WT, trace.p_WB + R_WB @ site.p, rtol=0, atol=1e-14)
    np.testing.assert_allclose(rotation_matrix(trace.quat_WT), R_WB @ site.R, rtol=0, atol=1e-14)
    v_T = trace.nu[:, :3] + np.cross(trace.nu[:, 3:], site.p)
    np.testing.assert_allclose(trace.nu_T, np.hstack([v_T @ site.R, trace.nu[:, 3:] @ site.R]), rtol=0, atol=1e-14)
    np.testing.assert_allclose(trace.manipulability, 1.0, rtol=1e-12)
