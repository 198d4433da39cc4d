"""The closed loop agrees with the independent twin, and with itself at other rates, steps and threads."""

import re
from dataclasses import replace

import numpy as np
import pytest

from twin import TwinParameters, simulate_fixed_step, simulate_smooth
from uvms_mj import InputError, Scenario, Status, simulate
from uvms_mj.analysis.metrics import final_force
from uvms_mj.physics.frames import quat_from_euler_deg
from vehicles import random_parameters, vehicle_xml

LAWS = {
    "impedance": ({}, {}),
    "fosm": ({}, {}),
    "gsta": ({}, {}),
    "gsta alone": ({"controller.nominal": False}, {"nominal": False}),
    "gsta in another world": (
        {
            "current.speed": 0.3,
            "current.direction_deg": -50.0,
            "disturbance.bias": [1.0, -2.0, 0.5, 0.05, -0.1, 0.2],
            "disturbance.amplitude": [2.0, 1.0, 1.0, 0.1, 0.1, 0.1],
            "disturbance.frequency_hz": [0.2, 0.1, 0.3, 0.1, 0.2, 0.1],
            "wall.position": 0.5,
            "wall.stiffness": 3e4,
            "wall.damping": 40.0,
            "reference.target": [0.52, 0.2, -0.1],
            "reference.step_time": 0.5,
            "reference.bandwidth": 3.0,
            "impedance.K_d": [300.0, 800.0, 900.0, 40.0, 30.0, 60.0],
            "impedance.damping_ratio": 0.7,
            "controller.k_1": 7.0,
            "controller.k_2": 15.0,
            "controller.beta": 3.0,
            "task.A": -80.0,
            "task.F_1": 2.0,
            "task.F_2": 0.5,
            "controller.period": 2e-4,
            "estimates.inertia": 0.9,
            "estimates.coriolis": 0.5,
            "estimates.damping": 0.7,
            "estimates.restoring": 1.1,
        },
        {
            "v_c_W": (0.3 * np.cos(np.deg2rad(-50)), 0.3 * np.sin(np.deg2rad(-50)), 0.0),
            "disturbance_bias": (1.0, -2.0, 0.5, 0.05, -0.1, 0.2),
            "disturbance_amplitude": (2.0, 1.0, 1.0, 0.1, 0.1, 0.1),
            "disturbance_frequency_hz": (0.2, 0.1, 0.3, 0.1, 0.2, 0.1),
            "x_c": 0.5,
            "k_c": 3e4,
            "b_c": 40.0,
            "waypoints": ((0.5, (0.52, 0.2, -0.1)),),
            "bandwidth": 3.0,
            "K_d": (300.0, 800.0, 900.0, 40.0, 30.0, 60.0),
            "damping_ratio": 0.7,
            "k_1": 7.0,
            "k_2": 15.0,
            "beta": 3.0,
            "A": -80.0,
            "F_1": 2.0,
            "F_2": 0.5,
            "period": 2e-4,
            "f_M": 0.9,
            "f_C": 0.5,
            "f_D": 0.7,
            "f_g": 1.1,
        },
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", LAWS)
def test_the_loop_is_the_twins(case):
    """From free motion to rest at the wall, in both engines: position within 1e-4 m at all times, of free_body within
    1e-6 m before the contact; the peak force within 2 %."""
    law, duration = case.split()[0], 3.2
    ours, theirs = LAWS[case]
    soon = {"x_c": 0.4, "waypoints": ((0.1, (0.51, 0.0, 0.0)),)}
    twin = simulate_fixed_step(TwinParameters(law=law, duration=duration, **(soon | theirs)))
    every, peak = slice(None, None, 10), twin["force"].max()
    assert peak > 1.0
    for engine in ("mujoco", "free_body"):
        overrides = {"simulation.duration": duration, "wall.position": 0.4, "reference.step_time": 0.1}
        overrides |= {"reference.target": [0.51, 0.0, 0.0]} | ours
        trace = simulate(Scenario.load("push_wall", overrides, law), engine=engine)
        assert np.allclose(trace.t, twin["t"][every], atol=1e-9)
        apart = np.abs(trace.p_WB - twin["p"][every]).max(axis=1)
        assert apart.max() < 1e-4
        if engine == "free_body":
            assert apart[trace.t < trace.first_contact[-1]].max() < 1e-6
        assert np.abs(trace.quat_WB - twin["quat"][every]).max() < 1e-3
        assert abs(trace.force_peak[-1] - peak) <= 0.02 * peak
        rest = trace.t > 0.3  # the first steps of a switching law depend on the time step
        assert np.sqrt(np.mean((trace.s - twin["s"][every])[rest] ** 2)) < 2e-3


CROSS = np.zeros((6, 6))
CROSS[1, 5], CROSS[2, 4], CROSS[4, 2], CROSS[5, 1] = 1.5, -1.5, 0.4, -0.4
"""As between sway and yaw, heave and pitch of a vehicle with fins, at BlueROV1's size."""


@pytest.mark.slow
def test_the_loop_is_the_twins_with_cross_damping(tmp_path):
    """In the plant and, wrong by a factor, in the law's estimate; without the cross terms it is another motion."""
    plain = TwinParameters(
        v_c_W=(0.5, 0.0, 0.0), quat_0=tuple(quat_from_euler_deg(10.0, -8.0, 15.0)), f_D=0.7, duration=1.5
    )
    cross = replace(plain, D_linear=plain.D_linear + CROSS, D_quadratic=plain.D_quadratic + 2.0 * CROSS)
    (tmp_path / "cross.xml").write_text(vehicle_xml(cross))
    overrides = {
        "vehicle.model": str(tmp_path / "cross.xml"),
        "current.direction_deg": 0.0,
        "simulation.duration": plain.duration,
        "initial.attitude_deg": [10.0, -8.0, 15.0],
        "estimates.damping": 0.7,
    }
    trace = simulate(Scenario.load("push_wall", overrides))
    apart = [np.abs(trace.nu - simulate_fixed_step(twin)["nu"][::10]).max(axis=0) for twin in (cross, plain)]
    assert apart[0].max() < 1e-6
    assert apart[1].max() > 1e-3


def test_the_difference_to_continuous_time_falls_in_proportion_to_the_step(smooth_overrides):
    """The smooth impedance law without contact, moving on all axes, converges to a tight integration with order 1."""
    overrides, errors = smooth_overrides(1.5), []
    twin = simulate_smooth(
        TwinParameters(
            law="impedance",
            x_c=50.0,
            waypoints=((0.0, (0.4, 0.3, -0.2)),),
            quat_0=tuple(quat_from_euler_deg(10.0, -8.0, 15.0)),
            nu_0=(0.1, -0.1, 0.05, 0.1, 0.2, -0.1),
            duration=1.5,
        ),
        np.array([0.5, 1.0, 1.5]),
    )
    for h in (2e-3, 1e-3, 5e-4, 2.5e-4):
        scenario = Scenario.load(
            "push_wall", {**overrides, "simulation.timestep": h, "wall.stiffness": 1e4}, "impedance"
        )
        trace = simulate(scenario, log_rate=2.0)
        errors.append(np.abs(trace.p_WB[1:] - twin["p"]).max() + np.abs(trace.nu[1:] - twin["nu"]).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 1.0) < 0.1), (errors, orders)


def test_implicitfast_converges_to_the_same_motion(smooth_overrides):
    runs = [
        simulate(Scenario.load("push_wall", {**smooth_overrides(1.0), "simulation.integrator": i}, "impedance"))
        for i in ("euler", "implicitfast")
    ]
    assert np.abs(runs[0].p_WB - runs[1].p_WB).max() < 1e-6


def test_a_row_has_the_state_and_its_own_contact_force():
    """f = -k_c (x - x_c) holds at the x of the same row, exactly for the law; nu_dot is the derivative of nu."""
    overrides = {"simulation.duration": 0.5, "reference.step_time": 0.0, "wall.position": 0.001, "wall.stiffness": 2e4}
    trace = simulate(Scenario.load("push_wall", overrides), log_rate="full")
    depth = np.maximum(0.0, trace.p_WB[:, 0] - 0.001)
    assert depth.max() > 1e-5
    # MuJoCo's smallest contact impedance, 1e-4, adds this share of the inertial force during motion
    assert np.allclose(trace.push, 2e4 * depth, rtol=0, atol=1e-4 * trace.push.max())
    assert np.allclose(-trace.f_contact_m_W[:, 0], 2e4 * depth, rtol=0, atol=1e-11)  # rounding of x times 2e4
    assert np.abs(trace.f_contact_m_W[:, 1:]).max() < 1e-7
    h = 1e-4
    nu_dot = np.diff(trace.nu, axis=0) / h
    # semi-implicit Euler adds h qacc to qvel: exact for omega, in W for v; in B it differs by h omega x v_dot
    assert np.allclose(nu_dot[:, 3:], trace.nu_dot[:-1, 3:], atol=1e-6)
    turned = np.abs(np.cross(trace.nu[:-1, 3:], trace.nu_dot[:-1, :3])).max()
    assert np.abs(nu_dot[:, :3] - trace.nu_dot[:-1, :3]).max() < 2.0 * h * turned + 1e-6
    assert np.array_equal(trace.t, np.arange(5001) * h)


def test_running_signals_are_what_the_full_rate_adds_up_to():
    overrides = {"simulation.duration": 0.6, "reference.step_time": 0.0, "wall.position": 0.001}
    scenario = Scenario.load("push_wall", overrides, "fosm")
    full, h = simulate(scenario, log_rate="full"), 1e-4
    some = simulate(scenario, log_rate=100)
    change = np.abs(np.diff(full.tau, axis=0))
    assert np.allclose(some.tau_variation[-1], change.sum(axis=0))
    assert np.allclose(some.tau_step_max[-1], change.max(axis=0))
    assert np.allclose(some.tau_max[-1], np.abs(full.tau).max(axis=0))
    assert np.allclose(some.effort[-1], h * (full.tau[:-1] ** 2).sum(axis=0))
    assert np.isclose(some.force_peak[-1], full.push.max())
    assert np.isclose(some.impulse[-1], np.trapezoid(full.push, dx=h))
    touching = full.push > 0
    assert some.touches[-1] == (touching[1:] & ~touching[:-1]).sum() + touching[0] > 0
    assert some.first_contact[-1] == full.t[touching][0]
    inside = (np.abs(full.s) < 1e-3)[:-1].sum(axis=0) * h
    assert np.allclose(some.boundary_layer_time[-1], inside)
    # an elastic wall returns all energy: the work is the energy stored in the spring
    depth = max(0.0, full.p_WB[-1, 0] - 0.001)
    assert np.isclose(full.wall_work[-1], 0.5 * 1e5 * depth**2, rtol=2e-4)


def test_final_values_do_not_depend_on_the_log_rate():
    """At 0.4 Hz the last half second has no row but the one at the end, which is always recorded."""
    overrides = {
        "simulation.duration": 4.0,
        "reference.step_time": 0.0,
        "reference.target": [0.3, 0.0, 0.0],
        "wall.position": 0.1,
        "disturbance.amplitude": [5.0, 0, 0, 0, 0, 0],
        "disturbance.frequency_hz": [1.0, 0, 0, 0, 0, 0],
    }
    scenario = Scenario.load("push_wall", overrides, "impedance")
    full, some = simulate(scenario, log_rate="full"), simulate(scenario, log_rate=0.4)
    assert some.t[-1] == full.t[-1] == 4.0
    assert final_force(some) == final_force(full)
    window = full.t >= 3.5 - 1e-9
    assert np.isclose(final_force(full)[0], np.trapezoid(full.push[window], dx=1e-4) / 0.5)
    assert final_force(full)[1] is False
    assert np.isclose(full.final_high[-1], full.push[window].max())


def test_a_run_that_has_not_arrived_has_not_settled():
    assert final_force(simulate(Scenario.load("push_wall", {"simulation.duration": 3.0}))) == (0.0, False)


def test_thrust_is_held_between_control_instants_and_states_advance_at_them():
    overrides = {"simulation.duration": 0.05, "controller.period": 1e-3}
    trace = simulate(Scenario.load("push_wall", overrides), log_rate="full")
    tau = trace.tau_cmd[:500].reshape(50, 10, 6)
    assert np.array_equal(tau, np.repeat(tau[:, :1], 10, axis=1))
    assert np.all(np.any(np.diff(tau[:, 0], axis=0) != 0.0, axis=1))
    s, z = trace.s[:500:10], trace.z[:500:10]
    phi_2 = 0.5 * np.sign(s) + 7.5 * np.sqrt(np.abs(s)) * np.sign(s) + 25.0 * s
    assert np.allclose(z[1:], z[:-1] - 1e-3 * 10.0 * phi_2[:-1], rtol=0, atol=1e-12)


def test_tau_is_what_the_thrusters_give():
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.2}))
    assert trace.u.shape == (201, 6)
    assert np.allclose(trace.tau, trace.tau_cmd, atol=1e-11)


def test_u_is_thrust_in_newtons_whatever_gear_gain_and_ctrl_are(tmp_path):
    """A motor with 8 N per unit of ctrl, from gear times gain, equals one of gear 1 with limits eight times as large.

    All factors are powers of two, so the runs agree bit for bit.
    """
    xml = vehicle_xml(random_parameters(3))
    traces = {}
    for name, motor in {
        "newtons": '<motor ctrlrange="-15.5 15.5" ctrllimited="true" ',
        "ctrl": '<general gainprm="4" biastype="none" ctrlrange="-1.9375 1.9375" ctrllimited="true" ',
    }.items():
        text = xml.replace("<motor ", motor)
        if name == "ctrl":
            text = re.sub(r'gear="([^"]*)"', lambda m: f'gear="{m[1].replace("1.0", "2.0")}"', text)
        (tmp_path / f"{name}.xml").write_text(text)
        overrides = {"vehicle.model": str(tmp_path / f"{name}.xml"), "simulation.duration": 0.1}
        traces[name] = simulate(Scenario.load("push_wall", overrides))
    u, t = traces["newtons"].u, traces["newtons"].t
    at_limit = (np.abs(u) == 15.5).any(axis=1)
    assert at_limit.any()
    assert not at_limit.all()
    assert traces["newtons"].saturation_time[-1] == pytest.approx(1e-3 * at_limit.sum(), abs=2e-3)
    assert traces["newtons"].saturation_time[-1] < t[-1]
    for name in traces["newtons"]:
        assert np.array_equal(traces["ctrl"][name], traces["newtons"][name]), name


def test_a_motor_whose_gain_gives_no_thrust_is_refused(tmp_path):
    text = vehicle_xml(random_parameters(3)).replace("<motor ", '<general gainprm="-1" biastype="none" ')
    (tmp_path / "odd.xml").write_text(text)
    with pytest.raises(InputError, match="m0: its gain is -1: must be positive"):
        simulate(Scenario.load("push_wall", {"vehicle.model": str(tmp_path / "odd.xml")}))


def test_an_unstable_run_stops_at_the_step_and_keeps_what_it_has():
    overrides = {"simulation.duration": 20.0, "controller.period": 0.1}
    trace = simulate(Scenario.load("push_wall", overrides))
    assert trace.status is Status.unstable
    assert 0.0 < trace.duration_s < 20.0
    assert "t = " in trace.message
    assert "beyond" in trace.message
    for name in trace:
        assert np.isfinite(trace[name]).all(), name
    assert len(trace) == trace.steps // 10 + (trace.steps % 10 > 0)
