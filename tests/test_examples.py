"""The examples run as the docs say, and each has the closed form that is known of it."""

import math
import re
import runpy
from pathlib import Path

import mujoco
import numpy as np
import pytest

from law_files import law_file, one_liner
from page_numbers import page
from uvms_mj import Current, Scenario, attach, simulate
from uvms_mj.analysis.metrics import final_force
from uvms_mj.files import shipped

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
WALL = Scenario.load("push_wall").wall


def spring(bias: float = 0.0) -> float:
    """The force [N] of the spring of the desired impedance against the wall's, with a sensor that adds a bias [N]."""
    K_x, x_d = Scenario().impedance.K_d[0], 1.01
    return (K_x * (x_d - WALL.position) + bias) / (1.0 + K_x / WALL.stiffness)


@pytest.mark.parametrize("bias", [2.0, -1.0])
def test_the_pd_laws_closed_form_counts_a_constant_force(bias):
    settings = {"current.speed": 0.0, "disturbance.bias": [bias, 0.3, 0.0, 0.0, 0.0, 0.0]}
    trace = simulate(Scenario.load("push_wall", settings, f"{EXAMPLES / 'pd.py'}:Pd"))
    assert final_force(trace)[0] == pytest.approx(trace.analytic.force, rel=1e-6)
    assert "s" not in trace


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"current.speed": 0.5}, "current"),
        ({"wall.friction": 0.2}, "friction"),
        ({"reference.attitude_deg": [0.0, 0.0, 9.0]}, "aligned"),
        ({"disturbance.bias": [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]}, "turns"),
        ({"disturbance.amplitude": [1.0] * 6, "disturbance.frequency_hz": [1.0] * 6}, "disturbance.amplitude"),
        ({"navigation.name": f"{EXAMPLES / 'biased_force.py'}:BiasedForce"}, "navigation.name"),
        ({"actuation.name": f"{EXAMPLES / 'lagging_thrusters.py'}:LaggingThrusters"}, "actuation.name"),
    ],
)
def test_the_pd_law_has_no_closed_form_where_it_does_not_know_it(settings, reason):
    short = {"current.speed": 0.0, "simulation.duration": 0.001}
    trace = simulate(Scenario.load("push_wall", short | settings, f"{EXAMPLES / 'pd.py'}:Pd"))
    assert reason in trace.analytic.reason


@pytest.mark.parametrize("bias", [0.5, -0.4])
def test_a_biased_sensor_shifts_the_force_by_the_balance_of_the_springs(bias):
    sensor = f"{EXAMPLES / 'biased_force.py'}:BiasedForce"
    trace = simulate(Scenario.load("push_wall", {"navigation.name": sensor, "navigation.bias": [bias, 0.0, 0.0]}))
    assert trace.push[-1] == pytest.approx(spring(bias), rel=1e-6)
    assert np.array_equal(trace.force_error, np.tile([bias, 0.0, 0.0], (len(trace), 1)))
    assert trace.f_contact_m_W[-1, 0] == pytest.approx(bias - trace.push[-1], rel=1e-6)


def test_noise_has_the_given_deviation_and_repeats_with_the_seed():
    settings = {
        "navigation.name": f"{EXAMPLES / 'biased_force.py'}:BiasedForce",
        "navigation.bias": [0.0, 0.0, 0.0],
        "navigation.noise": 0.2,
        "simulation.duration": 1.0,
    }
    first, again, other = (
        simulate(Scenario.load("push_wall", settings | {"simulation.seed": seed}), log_rate="full").force_error
        for seed in (1, 1, 2)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    n = first.size
    assert abs(first.mean()) < 4 * 0.2 / math.sqrt(n)
    assert first.std() == pytest.approx(0.2, rel=4 / math.sqrt(2 * n))


def test_a_thruster_answers_a_step_as_a_first_order_lag(tmp_path):
    """Thrust under a constant command: u_k = u (1 - (1 - h/T)^k) by explicit Euler."""
    law = law_file(tmp_path, one_liner("Constant", "tau_cmd[:] = 0.0\ntau_cmd[0] = 6.0"))
    T, h = 0.05, 1e-4
    settings = {
        "actuation.name": f"{EXAMPLES / 'lagging_thrusters.py'}:LaggingThrusters",
        "actuation.time_constant": T,
        "simulation.duration": 0.3,
    }
    trace = simulate(Scenario.load("push_wall", settings, f"{law}:Constant"), log_rate="full")
    k = np.arange(len(trace))
    assert trace.u[:, 0] == pytest.approx(3.0 * (1.0 - (1.0 - h / T) ** k), abs=1e-12)
    assert np.abs(trace.u[:, 0] - 3.0 * (1.0 - np.exp(-trace.t / T))).max() < 3.0 * h / T
    assert np.array_equal(trace.thrust, trace.u)
    assert trace.u_cmd[:, 0] == pytest.approx(3.0)
    assert trace.tau[:, 0] == pytest.approx(trace.u[:, 0] + trace.u[:, 1])


def test_the_recipe_of_the_guide_measures_the_lag(capsys, monkeypatch):
    """The thrust u (1 - (1 - h/T)^k) passes u (1 - 1/e) at the instant k = 500, which 501 steps compute."""
    blocks = re.findall(r"```python\n(.*?)```", page("thruster").read_text(), re.DOTALL)
    (recipe,) = (code for code in blocks if "tau_cmd[0]" in code)
    monkeypatch.chdir(EXAMPLES)
    exec(recipe, {})
    k = math.ceil(-1.0 / math.log1p(-1e-4 / 0.05))
    assert float(capsys.readouterr().out) == pytest.approx((k + 1) * 1e-4)


def test_the_reference_is_a_circle_and_the_vehicle_follows_it():
    settings = {
        "reference.name": f"{EXAMPLES / 'circle.py'}:Circle",
        "wall.position": 5.0,
        "initial.position": [0.1, 0.2, -0.3],
        "simulation.duration": 20.0,
    }
    trace = simulate(Scenario.load("push_wall", settings))
    t, angle = trace.t, 0.2 * (trace.t - 1.0 + np.exp(-trace.t))
    circle = np.stack([0.1 + 0.5 * np.sin(angle), 0.7 - 0.5 * np.cos(angle), np.full_like(t, -0.3)], axis=1)
    assert trace.p_d == pytest.approx(circle, abs=1e-12)
    slope = (trace.p_d[2:] - trace.p_d[:-2]) / (t[2:] - t[:-2])[:, None]
    assert trace.p_d_dot[1:-1] == pytest.approx(slope, abs=1e-7)
    slope = (trace.p_d_dot[2:] - trace.p_d_dot[:-2]) / (t[2:] - t[:-2])[:, None]
    assert trace.p_d_ddot[1:-1] == pytest.approx(slope, abs=1e-6)
    assert not trace.p_d_dot[0].any()
    assert np.abs(trace.eta_e[t > 10.0]).max() < 1e-4


def test_the_vehicle_pushes_with_the_closed_forms_force():
    trace = simulate(Scenario.load("push_wall", {"vehicle.model": str(EXAMPLES / "cube.xml")}))
    assert trace.header.geometry.reach == pytest.approx(0.2)
    assert trace.push[-1] == pytest.approx(spring(), rel=1e-6)
    assert trace.tau[-1, 0] < 40.0


def test_steps_by_hand_find_the_contact_that_a_run_finds():
    example = runpy.run_path(str(EXAMPLES / "step_by_hand.py"))
    with example["Simulation"](Scenario.load("push_wall")) as sim:
        for stiffness in (1e4, 1e5):
            first, peak = example["impact"](sim, stiffness)
            scenario = Scenario.load("push_wall", {"wall.stiffness": stiffness, "simulation.duration": 5.6})
            trace = simulate(scenario, engine=sim.engine)
            assert trace.first_contact[-1] <= first <= trace.first_contact[-1] + 1e-3
            assert peak == trace.force_peak[-1]


def test_a_policy_on_gymnasium_finds_the_force():
    pytest.importorskip("gymnasium", reason="needs the extra gym")
    rewards = runpy.run_path(str(EXAMPLES / "gym_push.py"))["main"]()
    assert len(rewards) == 2000
    assert 0.99 < sum(rewards[-100:]) / 100.0 <= 1.0


def test_gains_are_tried_on_dm_control():
    pytest.importorskip("dm_control", reason="needs the extra dm (Python up to 3.12)")
    rewards = runpy.run_path(str(EXAMPLES / "dm_push.py"))["main"](2)
    assert len(set(rewards)) == 2
    assert all(math.exp(-1.0) < reward < 1.0 for reward in rewards)


def test_control_from_outside_reaches_its_target():
    example = runpy.run_path(str(EXAMPLES / "external_control.py"))
    with example["Simulation"](Scenario.load("push_wall", example["SETTINGS"])) as sim:
        example["drive"](sim, 20.0)
        assert sim.signals.p_WB == pytest.approx([1.0, 0.5, 0.0], abs=1e-3)


def test_two_vehicles_in_one_model_drift_as_each_alone():
    """Both follow the current, and sink or rise at the speed at which damping balances weight and buoyancy."""
    both = runpy.run_path(str(EXAMPLES / "two_vehicles.py"))
    data = both["drift"](60.0)
    alone = mujoco.MjModel.from_xml_path(str(shipped("models")["bluerov2_heavy"]))
    alone.opt.timestep = data.model.opt.timestep
    one = mujoco.MjData(alone)
    one.qpos[1] = 0.5
    with attach(alone, one, current=Current.of(both["CURRENT_W"])):
        mujoco.mj_step(alone, one, round(60.0 / alone.opt.timestep))
    assert np.array_equal(data.qpos[:7], one.qpos)
    assert np.array_equal(data.qvel[:6], one.qvel)
    weight, D, D_quadratic = (13.5 - 13.4) * 9.81, 33.0, 190.0
    speed = (math.sqrt(D**2 + 4.0 * D_quadratic * weight) - D) / (2.0 * D_quadratic)
    # without linear damping in sway the drift dies out with 1/t only, and tilts the vehicle a little meanwhile
    assert data.qvel[2] == pytest.approx(-speed, rel=1e-4)
    assert data.qvel[8] > 0.0, "the LAUV rises"
    for dof in (0, 6):
        assert data.qvel[dof : dof + 2] == pytest.approx(both["CURRENT_W"][:2], abs=0.02)
