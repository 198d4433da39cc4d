"""Effects of a user's own in the frame of a link or a site: they are what J^T makes of their wrench."""

import re

import mujoco
import numpy as np
import pytest

from uvms_mj import InputError, Scenario, Simulation, simulate
from uvms_mj.control.base import NoClosedForm, SteadyState
from uvms_mj.plant.mjcf import Mjcf

HEADER = """
from dataclasses import dataclass
import numpy as np
from uvms_mj import Effect, setting
"""
HOSE = """
@dataclass(frozen=True)
class Hose(Effect):
    k: float = setting(20.0, "N s/m", "drag")

    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        tau[:3] = -settings.k * given.nu_r[:3]
        tau[3:] = -0.1 * given.nu[3:]
        tau[0] += 2.0 + given.R_WB[0, 1]
        tau[1] += given.p_WB[2] + given.quat_WB[0]
"""
BY_HAND = """
from uvms_mj.physics.frames import attitude

p = np.array({p})
R = np.array({R})

@dataclass(frozen=True)
class ByHand(Effect):
    k: float = setting(20.0, "N s/m", "drag")

    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        v = (given.nu_r[:3] + np.cross(given.nu[3:], p)) @ R
        f = -settings.k * v
        turned = given.R_WB @ R
        quat = np.zeros(4)
        quat[0] = 1.0
        attitude(turned, quat)
        f[0] += 2.0 + turned[0, 1]
        f[1] += (given.p_WB + given.R_WB @ p)[2] + quat[0]
        f = R @ f
        tau[:3] = f
        tau[3:] = R @ (-0.1 * (given.nu[3:] @ R)) + np.cross(p, f)
"""
SITE = "horizontal_front_left"
RIGID = {"vehicle.model": "bluerov2_heavy", "initial.velocity": [0.5, 0.2, -0.1, 0.1, -0.2, 0.3]}


def own(folder, name, text, **settings) -> dict:
    path = folder / f"{name.lower()}.py"
    path.write_text(HEADER + text)
    return {"name": f"{path}:{name}", **settings}


def site_of(model: str, name: str):
    return Mjcf.find(model).vehicle.arm.sites[name]


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_at_a_site_of_the_base_it_is_the_same_wrench_taken_to_the_origin_by_hand(tmp_path, engine):
    site = site_of("bluerov2_heavy", SITE)
    assert np.linalg.norm(site.p) > 0.1
    assert abs(site.R - np.eye(3)).max() > 0.1
    by_hand = own(tmp_path, "ByHand", BY_HAND.format(p=site.p.tolist(), R=site.R.tolist()), k=35.0)
    hose, at_B = own(tmp_path, "Hose", HOSE, k=35.0, at=SITE), own(tmp_path, "Hose", HOSE, k=5.0)
    traces = [
        simulate(
            Scenario.load("push_wall", RIGID | {"simulation.duration": 0.2, "effects": [one, at_B]}), engine=engine
        )
        for one in (hose, by_hand)
    ]
    np.testing.assert_allclose(traces[0].p_WB, traces[1].p_WB, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(traces[0].nu, traces[1].nu, rtol=0.0, atol=1e-9)
    signal = next(each for each in traces[0].header.signals if each.name == "tau_Hose_0")
    assert f"at the origin of {SITE}, in its axes" in signal.meaning


@pytest.mark.parametrize("where", ["forearm", "tool"])
def test_on_a_link_its_joints_carry_their_part_by_the_jacobian(tmp_path, where):
    """Against MuJoCo's own Jacobian and velocity of the link and of the site, at the state of the first step."""
    changes = {
        "vehicle.model": "bluerov2_alpha5",
        "initial.velocity": [0.3, 0.1, -0.1, 0.2, -0.3, 0.1],
        "initial.joints": [0.3, 1.0, 2.0, 0.5],
        "initial.attitude_deg": [10.0, 20.0, 30.0],
        "wall.present": False,
        "simulation.duration": 0.1,
    }
    found = []
    for effects in ([], [own(tmp_path, "Hose", HOSE, at=where)]):
        with Simulation(Scenario.load("push_wall", changes | {"effects": effects})) as sim:
            model, before = sim.model, mujoco.MjData(sim.model)
            before.qpos[:], before.qvel[:] = sim.data.qpos, sim.data.qvel
            sim.step(1)
            found.append(sim.data.qfrc_passive.copy())
            tau, v_c_W = np.array(sim.signals.tau_Hose) if effects else None, sim.scenario.current.velocity_W
    mujoco.mj_forward(model, before)
    kind = mujoco.mjtObj.mjOBJ_SITE if where == "tool" else mujoco.mjtObj.mjOBJ_XBODY
    place = before.site(where) if where == "tool" else before.body(where)
    R, p, J, nu = place.xmat.reshape(3, 3), place.xpos, np.zeros((6, model.nv)), np.zeros(6)
    body = model.site(where).bodyid[0] if where == "tool" else model.body(where).id
    mujoco.mj_jac(model, before, J[:3], J[3:], p, body)
    mujoco.mj_objectVelocity(model, before, kind, place.id, nu, 1)
    omega, v = np.split(nu, 2)
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, place.xmat)
    expected = np.r_[-20.0 * (v - R.T @ v_c_W), -0.1 * omega]
    expected[:2] += 2.0 + R[0, 1], p[2] + abs(quat[0])
    np.testing.assert_allclose(tau, expected, rtol=0.0, atol=1e-9)
    force = np.r_[R @ tau[:3], R @ tau[3:]]
    np.testing.assert_allclose(found[1] - found[0], J.T @ force, rtol=0.0, atol=1e-9)
    assert abs((J.T @ force)[6:]).max() > 0.1


def test_a_vehicle_rests_where_the_closed_form_with_the_effect_at_a_site_says(tmp_path):
    rest = {"reference.target": [1.01, 0.0, -0.5], "simulation.duration": 25.0, "simulation.timestep": 1e-3}
    scenario = Scenario.load(
        "push_wall",
        {"vehicle.model": "bluerov2_heavy", "wall.damping": 500.0}
        | rest
        | {"effects": [own(tmp_path, "Hose", HOSE, at=SITE)]},
        "impedance",
    )
    trace = simulate(scenario, engine="free_body", log_rate=10.0)
    assert isinstance(trace.analytic, SteadyState)
    assert np.allclose(trace.p_WB[-1], trace.analytic.position, rtol=0.0, atol=1e-5)
    without = simulate(scenario.updated({"effects": []}), engine="free_body", log_rate=10.0).analytic
    assert abs(trace.analytic.position - without.position).max() > 1e-4


def test_a_frame_that_is_not_there_or_not_known_is_refused_by_name(tmp_path):
    hose = own(tmp_path, "Hose", HOSE)
    wrong = [hose, hose | {"at": "tol", "period": 1.5e-4}]
    with pytest.raises(InputError) as refusal:
        Simulation(Scenario.load("push_wall", {"vehicle.model": "bluerov2_alpha5", "effects": wrong}))
    assert re.search(r"effects\[1\]\.at: 'tol' is neither a link nor a site.*did you mean 'tool'", str(refusal.value))
    assert "effects[1].period: 0.00015 s is not a multiple" in str(refusal.value)
    arm = {"vehicle.model": "bluerov2_alpha5", "simulation.duration": 0.01, "effects": [hose | {"at": "forearm"}]}
    trace = simulate(Scenario.load("push_wall", arm))
    assert isinstance(trace.analytic, NoClosedForm)
    assert "the effect Hose acts on a link" in str(trace.analytic)
    with pytest.raises(
        InputError, match=r"effects\[0\]\.at: 'forearm' is on a link, and the wrist sensor knows no effect there"
    ):
        Simulation(Scenario.load("push_wall", arm | {"wrist.name": "sensor", "wrist.site": "wrist"}))
    scenario = Scenario.load("push_wall", {"vehicle.model": "bluerov2_heavy", "effects": [hose | {"at": SITE}]})
    with Simulation(scenario, engine="free_body") as sim:
        sim.step(100)
        first = sim.signals.p_WB.copy()
        sim.reset()
        sim.step(100)
        assert np.array_equal(first, sim.signals.p_WB)
        with pytest.raises(InputError, match=r"effects\[0\]\.at: .*can't change the frame of an effect"):
            sim.reset({"effects[0].at": "body"})
