"""The wrist sensor against an independent twin, MuJoCo's own sensors and static balances."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from random_trees import of_bodies, place_tree, random_state, random_tree, tree_xml
from tool_arm import arm_file
from tree_twin import _cross_motion, _from_parent, _resistance_of, poses
from twin import rotation
from two_joints import STILL, two_joints
from uvms_mj import InputError, Scenario, Simulation, simulate
from uvms_mj.engine.native.memory import call_code
from uvms_mj.physics.tree import place_links

_SWAP = [3, 4, 5, 0, 1, 2]
CURRENT = {"current.speed": 0.6, "current.direction_deg": -50.0}
V_C = 0.6 * np.array([np.cos(np.deg2rad(-50.0)), np.sin(np.deg2rad(-50.0)), 0.0])


@pytest.fixture
def scenario(tmp_path):
    """Makes a scenario of a twin's tree, with a sensor before ``link``."""

    def make(tree, link, overrides=None):
        (tmp_path / "tree.xml").write_text(tree_xml(tree))
        own = {"vehicle.model": str(tmp_path / "tree.xml"), "wrist.name": "sensor", "wrist.site": f"link{link}"}
        passive = {"joints.name": "torque", "controller.name": "external"}
        return Scenario.load("push_wall", STILL | passive | own | (overrides or {}))

    return make


def twin_wrench(tree, link, R, q, zeta, zeta_dot):
    """What the parent of a link exerts on it and all behind, (6,), linear part first, in the link's frame."""
    attitudes = [R for R, _ in poses(tree, np.zeros(3), R, q)]
    X, V, a = [np.eye(6)], [zeta[:6][_SWAP]], [zeta_dot[:6][_SWAP]]
    for body, x, rate, grows in zip(tree.bodies[1:], q, zeta[6:], zeta_dot[6:], strict=True):
        X.append(_from_parent(body, x))
        V.append(X[-1] @ V[body.parent] + body.S * rate)
        a.append(X[-1] @ a[body.parent] + _cross_motion(V[-1]) @ body.S * rate + body.S * grows)
    force = [_resistance_of(body, tree, *state) for body, *state in zip(tree.bodies, attitudes, V, a, strict=True)]
    for k in range(tree.n, link, -1):
        body = tree.bodies[k]
        force[body.parent] = force[body.parent] + X[k].T @ force[k]
    return force[link][_SWAP]


@pytest.mark.parametrize("seed", range(2))
def test_a_tree_that_tumbles_in_a_current_gives_the_wrench_of_the_twin(scenario, seed):
    """At up to 2 m/s and 2 rad/s, before each link, with the accelerations of the last step."""
    tree = replace(random_tree(seed, 5), v_c_W=V_C)
    link = 1 + seed
    with Simulation(scenario(tree, link, CURRENT)) as sim:
        place_tree(sim.data, random_state(tree, seed))
        sim.step(3)
        R, q, q_dot = rotation(sim.signals.quat_WB), sim.signals.q, sim.signals.q_dot
        zeta, zeta_dot = np.r_[sim.signals.nu, q_dot], np.r_[sim.signals.nu_dot, sim.data.qacc[6:]]
        wrench = twin_wrench(tree, link, R, q, zeta, zeta_dot)
        assert np.abs(sim.signals.wrench_S - wrench).max() < 1e-9 * np.abs(wrench).max()
        assert np.array_equal(sim.signals.wrench_m_S, sim.signals.wrench_S)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_dry_arm_gives_what_mujocos_own_sensors_measure(scenario, seed):
    """In the frame of a turned site beside the link's origin."""
    none = np.zeros((6, 6))
    tree = replace(random_tree(seed, 4, chain=1.0), v_c_W=np.zeros(3))
    removed = {"M_A": none, "D_linear": none, "D_quadratic": none, "displaced_mass": 0.0}
    dry = of_bodies(tree, lambda body: replace(body, **removed) if body.parent >= 0 else body)
    site = '<site name="wrist" pos="0.05 -0.02 0.03" quat="0.8 0.2 -0.3 0.5"/>'
    text = tree_xml(dry).replace('<joint name="joint2"', f'{site}<joint name="joint2"')
    sensors = '<sensor><force site="wrist"/><torque site="wrist"/></sensor>'
    model = mujoco.MjModel.from_xml_string(text.replace("</mujoco>", f"{sensors}</mujoco>"))
    data, state = mujoco.MjData(model), random_state(dry, seed)
    place_tree(data, state)
    data.ctrl[:] = np.random.default_rng(seed).normal(size=model.nu) * 5.0
    mujoco.mj_forward(model, data)
    with Simulation(scenario(dry, 2)) as sim:
        felt, run = sim._stages.stages["felt"], sim._memory.run
        record, true, encoder = run["wrist"], felt.given, run["encoder"]
        local = model.site("wrist")
        record["sensor"]["p_LT"], record["sensor"]["R_LT"] = local.pos, rotation(local.quat)
        _, quat, q, zeta = state
        R = rotation(quat)
        true["R_WB"], true["nu"] = R, zeta[:6]
        true["nu_dot"] = np.r_[R.T @ data.qacc[:3] - np.cross(zeta[3:6], zeta[:3]), data.qacc[3:6]]
        encoder["q"], encoder["q_dot"], run["q_ddot"] = q, zeta[6:], data.qacc[6:]
        place_links(run["plant"]["frames"].view(np.recarray)[0], q, 0)
        places = (each.ctypes.data for each in (felt.settings, run, true, run, felt.out))
        assert call_code(felt.code.address, *places) == 0
        found = felt.out.copy()
    measured = data.sensordata[:6]
    assert np.abs(found - measured).max() < 1e-9 * np.abs(measured).max()


@pytest.mark.parametrize("attitude", [[30.0, -40.0, 60.0], [0.0, 80.0, -20.0]])
def test_an_arm_that_is_held_gives_the_static_balance(scenario, attitude):
    """Weights and buoyancies of the bodies behind the sensor, at their places in W; the model leaves no contact."""
    tree = replace(random_tree(7, 4, chain=1.0), v_c_W=np.zeros(3))
    q = np.random.default_rng(1).uniform(-1.0, 1.0, 4)
    own = {"initial.attitude_deg": attitude, "initial.joints": q.tolist()}
    with Simulation(scenario(tree, 2, own)) as sim:
        wrench, left = sim.signals.wrench_S.copy(), sim.signals.tau_contact_m_B.copy()
        R = rotation(sim.signals.quat_WB)
    up, force, moment = np.array([0.0, 0.0, 9.81]), np.zeros(3), np.zeros(3)
    placed = poses(tree, np.zeros(3), R, q)
    R_S, p_S = placed[2]
    for body, (R_L, p_L) in list(zip(tree.bodies, placed, strict=True))[2:]:
        for m, r in ((-body.displaced_mass, body.r_b), *((part.mass, part.r_g) for part in body.parts)):
            force += m * up
            moment += np.cross(p_L + R_L @ r - p_S, m * up)
    assert wrench == pytest.approx(np.r_[R_S.T @ force, R_S.T @ moment], abs=1e-9)
    assert np.abs(left).max() < 1e-6


def swing(tmp_path, timestep, compensation, **others):
    drag = " ".join("5" if k % 7 == 0 else "0" for k in range(36))
    water = f'<numeric name="arm.D_quadratic" data="{drag}"/>'
    (tmp_path / "rov.xml").write_text(two_joints(custom=water))
    motion = [{"time": 0.1, "joints": [0.0, 0.0]}, {"time": 0.6, "joints": [0.8, 0.05]}]
    own = {"joints.name": "position", "joints.motion": motion, "simulation.timestep": timestep, **others}
    own |= {"wrist.name": "sensor", "wrist.site": "arm", "wrist.compensation": compensation}
    overrides = STILL | own | {"vehicle.model": str(tmp_path / "rov.xml"), "simulation.duration": 1.0}
    return simulate(Scenario.load("push_wall", overrides))


@pytest.mark.slow
def test_the_derived_force_of_a_swing_without_contact(tmp_path):
    """Inertia and water are mistaken for a contact if the weight alone is compensated. With the whole model a
    first-order error of the differences is left."""
    weight, fine, coarse = (
        np.abs(swing(tmp_path, *case).f_contact_m_W[1:]).max()
        for case in ((1e-4, "weight"), (1e-4, "dynamic"), (2e-4, "dynamic"))
    )
    assert weight > 1.0
    assert fine < 2e-3 * weight
    assert coarse / fine == pytest.approx(2.0, abs=0.5)


def test_the_reading_has_the_errors_of_its_channels(tmp_path):
    errors = {"wrist.force_bias": [0.5, 0.0, -0.2], "wrist.moment_noise": 0.05, "wrist.force_limit": 30.0}
    trace = swing(tmp_path, 2e-4, "weight", **errors)
    exact = np.clip(trace.wrench_S[:, :3] + [0.5, 0.0, -0.2], -30.0, 30.0)
    assert np.abs(trace.wrench_S).max() > 30.0
    assert np.abs(trace.wrench_m_S[:, :3] - exact).max() < 1e-12
    assert (trace.wrench_m_S - trace.wrench_S)[:, 3:].std() == pytest.approx(0.05, rel=0.1)


def test_estimates_of_a_link_act_on_the_model(tmp_path):
    """With the weight taken as twice as large, the derived force at the start is the weight in water, 1.2 kg."""
    heavy = {"estimates.links": [{"name": "arm", "restoring": 2.0}]}
    trace = swing(tmp_path, 2e-4, "weight", **heavy)
    assert trace.f_contact_m_W[0] == pytest.approx([0.0, 0.0, 9.81 * 1.2], abs=1e-9)


@pytest.mark.parametrize(
    ("own", "message"),
    [
        ({"wrist.site": "hand"}, "wrist.site: 'hand' is neither a link nor a site on one; choose from link1, link2"),
        ({"wrist.name": "none"}, "none has no site"),
        ({"wrist.force_delay": 1.5e-4}, "wrist.force_delay: 0.00015 s is not a multiple"),
    ],
)
def test_wrong_settings_are_refused(scenario, own, message):
    with pytest.raises(InputError, match=message):
        Simulation(scenario(random_tree(0, 2), 1, own))


@pytest.mark.slow
def test_at_rest_the_derived_force_is_that_of_the_wall(tmp_path):
    """The arm is stretched until its tip presses a tilted wall with friction. A law that switches would not come to
    rest."""
    wall = {"shape": "plane", "position": [0.78, 0.0, 0.0], "attitude_deg": [0.0, 10.0, 20.0], "stiffness": 2e3}
    motion = [{"time": 0.2, "joints": [0.1, -0.9, 1.4, 0.2, 0.1]}, {"time": 2.0, "joints": [0.1, -0.4, 0.7, 0.2, 0.1]}]
    own = {
        "vehicle.model": str(arm_file(tmp_path)),
        "vehicle.contact_bodies": [{"position": [0.045, 0.0, 0.0], "radius": 0.02, "body": "hand"}],
        "wall.present": False,
        "walls": [wall | {"friction": 0.3, "damping": 50.0}],
        "initial.joints": motion[0]["joints"],
        "joints.name": "position",
        "joints.motion": motion,
        "wrist.name": "sensor",
        "wrist.site": "wrist",
        "controller.name": "pid",
        "simulation.duration": 15.0,
    }
    trace = simulate(Scenario.load("push_wall", STILL | own))
    assert np.linalg.norm(trace.f_contact_W[-1]) > 2.0
    assert np.abs(trace.f_contact_m_W[-1] - trace.f_contact_W[-1]).max() < 1e-6


@pytest.mark.slow
def test_a_run_with_a_wrist_sensor_has_no_closed_form_of_its_rest(tmp_path):
    own = {"vehicle.model": str(arm_file(tmp_path)), "wrist.name": "sensor", "wrist.site": "hand", "task.frame": "tool"}
    with Simulation(Scenario.load("push_wall", STILL | own)) as sim:
        assert "with a wrist sensor" in sim.scenario.controller.at_rest(sim.setup)
