"""Thruster models against their own analytic answers, in machine code: the caller of a Simulation commands thrusts."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import residue

from page_numbers import page as page_of
from uvms_mj import InputError, Scenario, Simulation, Trace, simulate
from uvms_mj.actuation import T200, General, IdealThrusters
from uvms_mj.actuation.propeller import STANDARD_GRAVITY, VOLTAGES, thrust_curve
from uvms_mj.actuation.thrusters import THIRD_ORDER

FREE = {"engine": "free_body"}
BY_HAND = {
    "controller.name": "external",
    "actuation.name": "external",
    "wall.position": 50.0,
    "current.speed": 0.0,
    "simulation.timestep": 1e-3,
}
"""Thrusts from the caller, in still water."""
CURVE = {"curve_command": [-2.0, -1.0, 1.0, 3.0], "curve_thrust": [-10.0, 0.0, 0.0, 20.0]}


def scenario_with(name: str, overrides=None, **settings) -> Scenario:
    tables = {"thrusters.name": name} | {f"thrusters.{key}": value for key, value in settings.items()}
    return Scenario.load("push_wall", BY_HAND | (overrides or {}) | tables)


def responses(scenario: Scenario, commands) -> np.ndarray:
    """The thrusts (m, n) of the steps in which the commands (m,) or (m, n) act."""
    with Simulation(scenario, **FREE) as sim:
        found = []
        for command in commands:
            sim.u[:] = command
            sim.step()
            found.append(sim.signals.u.copy())
    return np.array(found)


def step_response(numerator, denominator, t):
    """The step response of a transfer function by partial fractions."""
    residues, poles, _ = residue(numerator, [*denominator, 0.0])
    return np.real(sum(r * np.exp(p * t) for r, p in zip(residues, poles, strict=True)))


# the lags


@pytest.mark.parametrize("period", [1e-3, 4e-3, 25e-3])
@pytest.mark.parametrize(
    ("lag", "transfer"),
    [("first_order", ((1.0,), (0.02, 1.0))), ("third_order", THIRD_ORDER)],
)
def test_the_step_response_of_a_lag_is_its_analytic_answer(lag, transfer, period):
    """Of a step of 12 N, at any period of the thrusters."""
    scenario = scenario_with("general", lag=lag, time_constant=0.02, period=period)
    thrust = responses(scenario, [12.0] * 200)[:: round(period / 1e-3), 0]
    t = period * np.arange(len(thrust))
    assert np.abs(thrust / 12.0 - step_response(*transfer, t)).max() < 1e-11


def test_the_identified_lag_has_the_times_of_its_source():
    t = np.linspace(0.0, 0.1, 100_001)
    y = step_response(*THIRD_ORDER, t)
    assert t[np.argmax(y >= 0.63)] == pytest.approx(0.020, abs=1e-3)
    assert t[np.argmax(y >= 0.95)] == pytest.approx(0.032, abs=1e-3)


@pytest.mark.parametrize(("lag", "transfer"), [("first_order", ((1.0,), (0.02, 1.0))), ("third_order", THIRD_ORDER)])
def test_the_delay_of_slow_changes_is_the_area_above_the_step_response(lag, transfer):
    t = np.linspace(0.0, 3.0, 300_001)
    area = np.trapezoid(1.0 - step_response(*transfer, t), t)
    assert General(lag=lag, time_constant=0.02).mean_delay() == pytest.approx(area, rel=1e-5)


# the static curve


def test_without_any_setting_a_general_thruster_is_ideal_bit_for_bit():
    short = {"simulation.duration": 1.5, "reference.step_time": 0.0, "wall.position": 0.1}
    ideal, general = (
        simulate(Scenario.load("push_wall", short | own), **FREE) for own in ({}, {"thrusters.name": "general"})
    )
    for name in ideal:
        assert np.array_equal(ideal[name], general[name]), name
    assert np.array_equal(general.u, general.u_cmd)
    assert {*general} - {*ideal} == {"u_cmd", "tau_lost"}


def test_commands_in_the_dead_band_give_no_thrust():
    commands = [-2.0, -1.5001, -1.5, -0.3, 0.0, 1.5, 1.5001, 9.0]
    thrust = responses(scenario_with("general", dead_band=1.5), commands)[:, 2]
    assert thrust.tolist() == [-2.0, -1.5001, 0.0, 0.0, 0.0, 0.0, 1.5001, 9.0]


def test_a_curve_that_is_not_inverted_is_what_the_command_gives():
    """Its flat part is a dead band, and beyond its ends it is constant."""
    commands = [-5.0, -2.0, -1.5, -1.0, 0.7, 1.0, 1.5, 3.0, 8.0]
    thrust = responses(scenario_with("general", inverted=False, efficiency=0.8, **CURVE), commands)[:, 0]
    assert thrust == pytest.approx(0.8 * np.array([-10.0, -10.0, -5.0, 0.0, 0.0, 0.0, 5.0, 20.0, 20.0]), abs=1e-12)


def test_the_inverse_of_a_curve_takes_its_dead_band_away():
    commands = np.concatenate([np.linspace(-10.0, 20.0, 301), [-1e-9, 1e-9, 0.0]])
    thrust = responses(scenario_with("general", **CURVE), commands)
    assert np.abs(thrust - commands[:, None]).max() < 1e-12


def test_a_command_is_rounded_to_its_quantum():
    """The pulse width nearest to the wanted one gives the thrust."""
    commands = np.linspace(-20.0, 20.0, 161)
    thrust = responses(scenario_with("t200", lag="none"), commands)[:, 0]
    curve = thrust_curve(16.0)
    wanted = curve.command_for(commands)
    assert np.ptp(np.round(wanted) - wanted) > 0.5
    assert np.abs(thrust - curve.at(np.floor(wanted + 0.5))).max() < 1e-12
    finer = responses(scenario_with("t200", lag="none", quantum=0.0), commands)[:, 0]
    assert np.abs(finer - commands).max() < 1e-12


@pytest.mark.parametrize(
    ("voltage", "forward", "reverse", "dead_band"),
    [
        (12.0, 36.4, -28.4, (1464.0, 1536.0)),
        (14.0, 44.3, -34.5, (1468.0, 1532.0)),
        (16.0, 51.5, -39.9, (1472.0, 1528.0)),
        (20.0, 65.9, -49.4, (1476.0, 1528.0)),
    ],
)
def test_the_curve_of_the_t200_is_the_makers(voltage, forward, reverse, dead_band):
    curve = thrust_curve(voltage)
    assert curve.thrust[-1] == pytest.approx(forward, abs=0.06)
    assert curve.thrust[0] == pytest.approx(reverse, abs=0.06)
    still = curve.command[curve.thrust == 0.0]
    assert (still[0], still[-1]) == dead_band
    low, high = T200(voltage=voltage, efficiency=0.7).command_limits(_plain_setup())
    assert (low[0], high[0]) == (curve.thrust[0], curve.thrust[-1])


@pytest.mark.parametrize("voltage", [10.0, 11.0, 13.7, 15.2, 17.0, 19.9])
def test_the_curve_at_any_voltage_rises_and_has_an_inverse(voltage):
    curve = thrust_curve(voltage)
    thrust, command = curve.inverse()
    assert (np.diff(command) > 0.0).all()
    assert ((np.diff(thrust) > 0.0) | (thrust[1:] == 0.0)).all()
    below, above = (thrust_curve(v).at(np.array([1250.0, 1750.0])) for v in _around(voltage))
    share = (voltage - _around(voltage)[0]) / 2.0
    assert curve.at(np.array([1250.0, 1750.0])) == pytest.approx((1.0 - share) * below + share * above)


def _around(voltage: float) -> tuple[float, float]:
    low = max(v for v in VOLTAGES[:-1] if v <= voltage)
    return low, low + 2.0


def _plain_setup():
    from uvms_mj.setup.base import set_up

    return set_up(Scenario())


def test_another_voltage_than_the_assumed_one_is_another_thrust():
    """At 1700 us the maker measured 1.55 kgf at 14 V and 1.92 kgf at 18 V."""
    scenario = scenario_with("t200", voltage=14.0, assumed_voltage=18.0, lag="none", efficiency=0.75)
    thrust = responses(scenario, [1.92 * STANDARD_GRAVITY])
    assert thrust == pytest.approx(np.full((1, 6), 0.75 * 1.55 * STANDARD_GRAVITY), rel=1e-12)


def test_an_assumed_efficiency_that_is_true_has_no_effect():
    commands = np.linspace(-10.0, 10.0, 41)
    thrust = responses(scenario_with("t200", lag="none", quantum=0.0, efficiency=0.6, assumed_efficiency=0.6), commands)
    assert np.abs(thrust - commands[:, None]).max() < 1e-12


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_thruster_of_one_direction_gives_no_thrust_in_the_other(sign):
    points = sorted(zip(sign * np.array([0.0, 1.0, 2.0, 4.0]), sign * np.array([0.0, 0.0, 0.0, 20.0]), strict=True))
    curve = {"curve_command": [x for x, _ in points], "curve_thrust": [f for _, f in points]}
    thrust = responses(scenario_with("general", **curve), sign * np.array([-50.0, -0.1, 0.0, 1e-6, 5.0, 30.0]))[:, 0]
    assert thrust == pytest.approx(sign * np.array([0.0, 0.0, 0.0, 1e-6, 5.0, 20.0]), abs=1e-12)


# delay, rate, inflow, failure


def test_a_thruster_starts_and_turns_after_a_delay_that_is_exact_to_the_step():
    command = np.repeat([0.0, 5.0, 3.0, -4.0, 0.0, -4.0], 30)
    thrust = responses(scenario_with("general", start_delay=0.011), command)[:, 0]
    expected = command.copy()
    for turn in (30, 90, 150):
        expected[turn : turn + 11] = 0.0
    assert thrust.tolist() == expected.tolist()


def test_the_thrust_changes_by_at_most_the_rate_limit():
    command = np.repeat([10.0, -4.0], 50)
    thrust = responses(scenario_with("general", rate_limit=500.0), command)[:, 0]
    t = np.arange(1, 51)
    assert thrust == pytest.approx(np.concatenate([np.minimum(10.0, 0.5 * t), np.maximum(-4.0, 10.0 - 0.5 * t)]))


@pytest.mark.parametrize("command", [8.0, -3.0])
def test_inflow_costs_the_thrust_of_the_bilinear_propeller(command):
    """Surge thrusters at (0, +-0.115, 0) and a lateral one at (0, 0, 0.104), in a moving vehicle and a current."""
    v, omega = np.array([0.7, -0.2, 0.1]), np.array([0.2, -0.3, 0.5])
    water = {"initial.velocity": [*v, *omega], "current.speed": 0.4, "current.direction_deg": 90.0}
    thrust = responses(scenario_with("general", water, inflow_loss=1.3), [command])[0]
    v_r = v - np.array([0.0, 0.4, 0.0])
    places = {0: ([0.0, 0.115, 0.0], [1.0, 0.0, 0.0]), 1: ([0.0, -0.115, 0.0], [1.0, 0.0, 0.0])}
    places[5] = ([0.0, 0.0, 0.104], [0.0, 1.0, 0.0])
    for k, (place, axis) in places.items():
        advance = float(np.dot(axis, v_r + np.cross(omega, place)))
        assert thrust[k] == pytest.approx(command - 1.3 * math.sqrt(abs(command)) * advance, rel=1e-9)


@pytest.mark.parametrize(
    ("settings", "after"),
    [({}, 0.0), ({"failed_fraction": 0.25}, 2.0), ({"failed_stuck": True}, 5.0)],
)
def test_a_thruster_fails_at_its_time(settings, after):
    """The command is 5 N until then and 8 N from then on."""
    command = np.where(np.arange(40) < 20, 5.0, 8.0)
    thrust = responses(scenario_with("general", failed=3, failed_at=0.02, **settings), command)
    assert thrust[:20].tolist() == [[5.0] * 6] * 20
    assert np.delete(thrust, 2, axis=1)[20:].tolist() == [[8.0] * 5] * 20
    assert thrust[20:, 2].tolist() == [after] * 20


def test_a_thruster_that_is_stuck_from_the_start_gives_no_thrust():
    thrust = responses(scenario_with("t200", lag="none", failed=1, failed_stuck=True), [7.0] * 3)
    assert thrust[:, 0].tolist() == [0.0] * 3


# in a run


REAL = {
    "thrusters.name": "t200",
    "thrusters.voltage": 14.5,
    "thrusters.efficiency": 0.8,
    "thrusters.start_delay": 0.02,
    "thrusters.rate_limit": 400.0,
    "thrusters.inflow_loss": 1.0,
    "thrusters.dead_band": 30.0,
    "thrusters.failed": 2,
    "thrusters.failed_at": 0.5,
    "thrusters.failed_fraction": 0.5,
    "simulation.duration": 1.0,
    "reference.step_time": 0.0,
}
"""All elements at once."""


def test_both_engines_step_the_same_thrusters():
    mine, theirs = (simulate(Scenario.load("push_wall", REAL, "impedance"), engine=e) for e in ("free_body", "mujoco"))
    assert np.abs(mine.u).max() > 5.0
    assert np.abs(mine.u - mine.u_cmd).max() > 1.0
    for name in ("u", "u_cmd", "nu", "tau_lost"):
        assert np.abs(mine[name] - theirs[name]).max() < 1e-6, name


def test_a_log_has_the_command_and_the_thrusters(tmp_path):
    trace = simulate(Scenario.load("push_wall", REAL, "impedance"), **FREE)
    trace.save(tmp_path / "run.mcap")
    again = Trace.load(tmp_path / "run.mcap")
    assert again.scenario == trace.scenario
    assert np.array_equal(again.u_cmd, trace.u_cmd)
    B = _plain_setup().vehicle.B
    assert trace.tau_lost == pytest.approx(trace.tau_cmd - trace.u_cmd @ B.T, abs=1e-12)
    assert np.abs(trace.tau_lost).max() < 1e-12  # within the limits


@pytest.mark.slow
def test_saturation_is_of_the_command_and_its_loss_is_recorded():
    """T200s at 10 V with a target that is far away: the surge thrusters stay at 28.7 N, whatever their efficiency."""
    far = {"reference.target": [40.0, 0.0, 0.0], "reference.bandwidth": 20.0, "wall.position": 50.0}
    far |= {"thrusters.name": "t200", "thrusters.voltage": 10.0, "thrusters.efficiency": 0.9}
    far |= {"reference.step_time": 0.0, "simulation.duration": 1.5, "current.speed": 0.0}
    trace = simulate(Scenario.load("push_wall", far, "impedance"), **FREE)
    most = thrust_curve(10.0).thrust[-1]
    at_limit = np.isin(trace.u_cmd, thrust_curve(10.0).thrust[[0, -1]]).any(axis=1)
    assert trace.u_cmd.max() == most
    assert trace.u[-1, :2] == pytest.approx(np.full(2, 0.9 * most), rel=1e-2)
    assert trace.saturation_time[-1] == pytest.approx(np.count_nonzero(at_limit) * 1e-3, abs=5e-3)
    assert (np.abs(trace.tau_lost[at_limit]).max(axis=1) > 0.0).all()


def test_a_stages_state_is_not_hidden_by_the_command():
    """A user's actuation may have a state u_cmd, but not beside thrusters that record their command."""
    lagging = f"{Path(__file__).parents[2] / 'examples' / 'lagging_thrusters.py'}:LaggingThrusters"
    with Simulation(Scenario.load("push_wall", {"actuation.name": lagging}), **FREE):
        pass
    with pytest.raises(InputError, match=r"states\['u_cmd'\]: is the name of a recorded signal"):
        Simulation(Scenario.load("push_wall", {"actuation.name": lagging, "thrusters.name": "t200"}), **FREE)


OWN = """
import math
from dataclasses import dataclass
from uvms_mj import setting
from uvms_mj.actuation import Thrusters

@dataclass(frozen=True)
class Lossy(Thrusters):
    "Thrusters that lose thrust by inflow."
    c: float = setting(0.7, "N^0.5 s/m", "loss")
    states = {"lost": "thrusters"}

    @staticmethod
    def step(settings, state, given, state_dot, u):
        for k in range(u.shape[0]):
            state.lost[k] = settings.c * math.sqrt(abs(given.u_cmd[k])) * given.inflow[k]
            u[k] = given.u_cmd[k] - state.lost[k]
"""


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_a_users_thruster_takes_the_same_place(tmp_path, engine):
    (tmp_path / "lossy.py").write_text(OWN)
    moving = {
        "simulation.duration": 0.5,
        "reference.step_time": 0.0,
        "initial.velocity": [0.5, 0.1, 0.0, 0.1, 0.0, 0.3],
    }
    shipped = {"thrusters.name": "general", "thrusters.inflow_loss": 0.7}
    own = {"thrusters.name": f"{tmp_path / 'lossy.py'}:Lossy"}
    mine, theirs = (
        simulate(Scenario.load("push_wall", moving | each, "impedance"), engine=engine) for each in (own, shipped)
    )
    assert np.abs(mine.lost).max() > 0.1
    assert np.abs(mine.u - theirs.u).max() < 1e-9
    assert mine.u_cmd - mine.u == pytest.approx(mine.lost, abs=1e-12)
    assert "shipped thruster models only" in mine.analytic.reason


def test_the_lost_command_is_of_the_one_that_the_allocation_is_given():
    """With a computation delay, too."""
    late = REAL | {"controller.delay": 0.01, "thrusters.voltage": 10.0, "reference.target": [9.0, 5.0, 0.0]}
    trace = simulate(Scenario.load("push_wall", late | {"wall.position": 50.0}, "impedance"), **FREE)
    B = _plain_setup().vehicle.B
    assert np.abs(trace.tau_lost).max() > 1.0
    given = trace.tau_lost + trace.u_cmd @ B.T
    assert np.abs(given[10:] - trace.tau_cmd[:-10]).max() < 1e-9  # rows are 1 ms apart


def test_ideal_thrusters_are_the_default_and_no_stage():
    assert isinstance(Scenario().thrusters, IdealThrusters)
    with Simulation(Scenario(), **FREE) as sim:
        assert {"thrusters", "inflow"}.isdisjoint(sim._stages.stages)
        assert sim._memory.run["ideal"][0]


def test_the_page_has_the_settings_of_the_program():
    page = page_of("actuation").read_text()
    table = page.split("| `thrusters.` |")[1].split("\n\n")[0]
    rows = re.findall(r"^\| (`.*?) \|", table, re.MULTILINE)
    listed = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    assert listed == {"name"} | {field.name for kind in (General, T200) for field in kind.setting_fields()}


LAGGING = """
from dataclasses import dataclass
from uvms_mj import setting
from uvms_mj.actuation import Thrusters

@dataclass(frozen=True)
class Lag(Thrusters):
    lag: float = setting(0.02, "s", "time constant")
    states = {"thrust": "thrusters"}

    @staticmethod
    def step(settings, state, given, state_dot, u):
        for i in range(u.shape[0]):
            state_dot.thrust[i] = (given.u_cmd[i] - state.thrust[i]) / settings.lag
            u[i] = state.thrust[i]
"""


@pytest.mark.parametrize(("T", "also"), [(3e-5, True), (0.02, False)])
def test_thrust_of_a_users_thrusters_that_diverges_is_answered_with_their_time_constant(tmp_path, T, also):
    """Explicit Euler of a lag diverges for T < h/2; with a longer T the law with an absurd gain does."""
    (tmp_path / "own.py").write_text(LAGGING)
    table = {"thrusters.name": f"{tmp_path}/own.py:Lag", "thrusters.lag": T, "simulation.duration": 0.1}
    wild = {} if also else {"controller.k_1": 1e9}
    trace = simulate(Scenario.load("push_wall", table | wild), **FREE)
    assert trace.status.name == "unstable"
    assert ("u[" in trace.message[:30]) is also
    assert trace.message.endswith("smaller gains, or a longer time constant of the thrusters.") is also
    assert "smaller gains" in trace.message


# as deployed: outputs that freeze, a linear mixer


def frozen_by_hand(commands, since: int, held: int, again: int) -> np.ndarray:
    """The commands that reach the thrusters: in a freeze the last one before it."""
    found = []
    for i, each in enumerate(commands):
        freezes = i >= since and ((i - since) % again if again else i - since) < held
        found.append(found[-1] if freezes and found else 0.0 if freezes else each)
    return np.array(found)


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
@pytest.mark.parametrize(("at", "every"), [(0.02, None), (0.02, 0.03), (0.0, 0.05)])
def test_frozen_outputs_keep_the_last_command(at, every, engine):
    settings = {"freeze_time": 0.01, "freeze_at": at} | ({} if every is None else {"freeze_every": every})
    commands = np.sin(0.3 * np.arange(120))
    with Simulation(scenario_with("general", **settings), engine=engine) as sim:
        found = []
        for command in commands:
            sim.u[:] = command
            sim.step()
            found.append(sim.signals.u[0])
    expected = frozen_by_hand(commands, round(at / 1e-3), 10, 0 if every is None else round(every / 1e-3))
    assert found == expected.tolist()


def test_a_linear_mixer_moves_the_pulse_in_proportion_and_the_true_curve_answers():
    gain, full = 0.5, thrust_curve(16.0).thrust[-1]
    demands = np.linspace(-0.77, 1.0, 60)
    scenario = scenario_with("t200", lag="none", quantum=0.0, mixer="linear", pilot_gain=gain)
    thrust = responses(scenario, demands * full)[:, 0]
    assert np.abs(thrust - thrust_curve(16.0).at(1500.0 + 400.0 * gain * demands)).max() < 1e-12 * full


def test_mixer_gain_and_freeze_change_in_a_reset_and_give_the_run_of_a_new_simulation():
    new = {"thrusters.mixer": "linear", "thrusters.pilot_gain": 0.3, "thrusters.freeze_time": 0.02}
    new["thrusters.freeze_at"] = 0.03
    scenario = Scenario.load("push_wall", {"thrusters.name": "t200", "simulation.duration": 0.1})
    with Simulation(scenario, **FREE) as sim, Simulation(scenario.updated(new), **FREE) as fresh:
        sim.step(200)
        sim.reset(overrides=new)
        for each in (sim, fresh):
            each.step(900)
        assert sim.signals.u.tobytes() == fresh.signals.u.tobytes()
        assert np.ptp(sim.signals.u) > 0.0


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"pilot_gain": 0.5}, r"thrusters\.pilot_gain: 0\.5 has no effect on the inverse curve"),
        ({"freeze_time": 1.0, "freeze_every": 0.5}, r"thrusters\.freeze_every: 0\.5 s must be longer"),
        ({"mixer": "cubic"}, r"thrusters\.mixer"),
    ],
)
def test_wrong_settings_of_outputs_are_refused(settings, said):
    with pytest.raises(InputError, match=said):
        scenario_with("t200", **settings)


def test_pulse_widths_from_outside_pass_no_mixer():
    keys = {"actuation.name": "pwm", "thrusters.name": "t200", "thrusters.mixer": "linear"}
    with pytest.raises(InputError, match=r"thrusters\.mixer: .*nothing is mixed"):
        Simulation(Scenario.load("push_wall", BY_HAND | keys), **FREE)


@pytest.mark.parametrize(
    ("settings", "said"),
    [({"thrusters.freeze_time": 0.4}, "freeze"), ({"thrusters.mixer": "linear"}, "linear mixer")],
)
def test_what_a_closed_form_does_not_know_of_the_outputs_it_refuses(settings, said):
    made = Scenario.load("push_wall", {"thrusters.name": "t200", "simulation.duration": 1e-3} | settings)
    late = made.updated({"thrusters.freeze_at": 0.0005}) if "thrusters.freeze_time" in settings else made
    assert said in simulate(late, **FREE).analytic.reason
