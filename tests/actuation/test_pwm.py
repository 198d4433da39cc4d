"""Pulse widths from the caller of a Simulation, and those that the T200's control system computes."""

import numpy as np
import pytest

from uvms_mj import InputError, Scenario, Simulation, simulate
from uvms_mj.actuation.propeller import PULSE_WIDTHS_US, thrust_curve

BY_HAND = {
    "controller.name": "external",
    "wall.present": False,
    "current.speed": 0.0,
    "simulation.timestep": 1e-3,
    "thrusters.name": "t200",
    "thrusters.lag": "none",
}
FREE = {"engine": "free_body"}


def scenario_with(actuation: str, **settings) -> Scenario:
    given = {key.replace("__", "."): value for key, value in settings.items()}
    return Scenario.load("push_wall", BY_HAND | {"actuation.name": actuation} | given)


@pytest.mark.parametrize("voltage", [10.0, 11.1, 12.0, 14.8, 16.0, 18.0, 20.0])
def test_every_pulse_width_gives_the_thrust_of_the_makers_curve_at_the_voltage(voltage):
    """All 801, six at a time. Outside the dead band the pulse width that the speed controller takes is the same one."""
    curve = thrust_curve(voltage)
    pulses = np.arange(1100.0, 1904.0).reshape(-1, 6)
    pulses[pulses > 1900.0] = 1900.0
    with Simulation(scenario_with("pwm", thrusters__voltage=voltage), **FREE) as sim:
        assert sim.pwm_cmd.tolist() == [1500.0] * 6
        for pulse in pulses:
            sim.pwm_cmd[:] = pulse
            sim.step()
            thrust = curve.at(pulse)
            assert sim.signals.u == pytest.approx(thrust, abs=1e-9)
            assert np.array_equal(sim.signals["pwm"], np.where(thrust == 0.0, 1500.0, pulse))
            assert sim.signals["u_cmd"] == pytest.approx(thrust, abs=1e-9)
        sim.reset()
        assert sim.pwm_cmd.tolist() == [1500.0] * 6


def test_the_makers_points_are_its_published_thrusts():
    """At 16 V, in kilogram-force: full reverse, neutral, and full forwards."""
    published = {1100: -4.07, 1500: 0.0, 1900: 5.25}
    with Simulation(scenario_with("pwm"), **FREE) as sim:
        for pulse, kilograms in published.items():
            sim.pwm_cmd[:] = pulse
            sim.step()
            assert sim.signals.u == pytest.approx(np.full(6, 9.80665 * kilograms), abs=1e-9), pulse


@pytest.mark.parametrize("voltage", [10.0, 14.8, 20.0])
def test_a_thrust_comes_back_to_half_a_microsecond(voltage):
    """Thrust to pulse width to thrust: the error is at most that of the rounding, with the curve's own slope there."""
    curve = thrust_curve(voltage)
    wanted = np.linspace(curve.thrust[0], curve.thrust[-1], 600).reshape(-1, 6)
    exact = np.interp(wanted, *curve.inverse())
    with Simulation(scenario_with("external", thrusters__voltage=voltage), **FREE) as sim:
        for thrusts, pulses in zip(wanted, exact, strict=True):
            sim.u[:] = thrusts
            sim.step()
            taken = sim.signals["pwm"]
            assert np.abs(taken - pulses).max() <= 0.5 + 1e-9
            assert np.array_equal(taken, np.rint(taken))
            assert sim.signals.u == pytest.approx(curve.at(taken), abs=1e-9)
            edges = [curve.at(np.clip(pulses + side, 1100.0, 1900.0)) for side in (-0.5, 0.5)]
            assert (edges[0] - 1e-9 <= sim.signals.u).all()
            assert (sim.signals.u <= edges[1] + 1e-9).all()


def test_a_pulse_width_is_a_force_on_the_vehicle():
    """Both surge thrusters of the BlueROV1 push it with twice their thrust; the efficiency is a factor of it."""
    with Simulation(scenario_with("pwm", thrusters__voltage=12.0, thrusters__efficiency=0.5), **FREE) as sim:
        sim.pwm_cmd[:2] = 1700.0
        sim.step()
        thrust = 0.5 * thrust_curve(12.0).at(np.array([1700.0]))[0]
        assert sim.signals.tau[0] == pytest.approx(2.0 * thrust, rel=1e-12)
        assert sim.signals.u[2:].tolist() == [0.0] * 4


def test_a_curve_of_ones_own_takes_pulse_widths_too():
    curve = {
        "thrusters.curve_command": [1200.0, 1450.0, 1550.0, 1800.0],
        "thrusters.curve_thrust": [-9.0, 0.0, 0.0, 9.0],
    }
    with Simulation(scenario_with("pwm", **curve, thrusters__name="general"), **FREE) as sim:
        sim.pwm_cmd[:] = [1200.0, 1325.0, 1500.0, 1550.0, 1675.0, 1900.0]
        sim.step()
        assert sim.signals.u == pytest.approx([-9.0, -4.5, 0.0, 0.0, 4.5, 9.0], abs=1e-12)


def test_pulse_widths_of_a_law_are_recorded():
    scenario = Scenario.load("push_wall", {"thrusters.name": "t200", "simulation.duration": 0.05})
    trace = simulate(scenario, **FREE)
    pulses = trace["pwm"]
    assert np.array_equal(pulses, np.rint(pulses))
    assert pulses.min() >= PULSE_WIDTHS_US[0]
    assert trace.header.by_name["pwm"].unit == "us"
    near = thrust_curve(16.0).command_for(trace["u_cmd"])
    assert np.abs(pulses - near).max() <= 0.5 + 1e-9


@pytest.mark.parametrize("pulse", [0.0, 1099.0, 1901.0, np.nan])
def test_a_pulse_width_that_no_speed_controller_takes_is_refused_by_name(pulse):
    with Simulation(scenario_with("pwm"), **FREE) as sim:
        sim.pwm_cmd[2] = pulse
        with pytest.raises(
            InputError, match=rf"^pwm_cmd\[2\] = {pulse:g} us: must be from 1100 to 1900 us; 1500 us is"
        ):
            sim.step()
        assert sim.steps == 0


def test_other_actuation_has_no_pulse_widths_to_set_and_a_run_alone_has_nobody_to_set_them():
    with (
        Simulation(scenario_with("external"), **FREE) as sim,
        pytest.raises(InputError, match=r"actuation.name: external: pwm_cmd needs pwm"),
    ):
        _ = sim.pwm_cmd
    given = {"actuation.name": "pwm", "thrusters.name": "t200"}
    with pytest.raises(InputError, match=r"actuation.name: pwm leaves pwm_cmd to the caller of a Simulation"):
        simulate(Scenario.load("push_wall", given), **FREE)
