"""The task of the environments: actions, observations, reward, randomisation."""

import math

import numpy as np
import pytest
from scipy.stats import kstest, truncnorm

from law_files import law_file, one_liner
from uvms_mj import InputError, Scenario, simulate
from uvms_mj.control.design import demanded_force
from uvms_mj.envs.push import OBSERVED, Push
from uvms_mj.files import shipped

SHORT = {"simulation.duration": 0.3, "simulation.timestep": 5e-4, "initial.position": [0.9995, 0.0, 0.0]}
CONSTANT = one_liner("Constant", "tau_cmd[:] = 0.0\ntau_cmd[0] = 20.0\ntau_cmd[5] = 0.5")


def episode(push, action):
    """Observations and rewards of an episode with one action."""
    seen, rewards = [push.reset(seed=0)], []
    while not push.over:
        push.apply(np.asarray(action, dtype=float))
        rewards.append(push.advance(push.steps_each))
        seen.append(push.observation())
    return seen, rewards


def test_an_action_is_the_wrench_of_a_law_and_the_reward_is_its_formula(tmp_path):
    """Observations and rewards follow from the trace of a law with the same constant wrench."""
    law_file(tmp_path, CONSTANT, "constant.py")
    trace = simulate(Scenario.load("push_wall", SHORT, f"{tmp_path / 'constant.py'}:Constant"), log_rate="full")
    push = Push("push_wall", overrides=SHORT)
    seen, rewards = episode(push, [0.5, 0.0, 0.0, 0.0, 0.0, 0.05])
    every = push.steps_each
    assert every == 40
    assert trace.touches[-1] > 0
    assert len(rewards) == (len(trace) - 1) // every
    for name in OBSERVED:
        assert np.array_equal([each[name] for each in seen], trace[name][::every]), name
    T, force_d = (
        push.steps_each * push.scenario.simulation.timestep,
        demanded_force(push.scenario, push.scenario.wall.stiffness),
    )
    # between steps the impulse is that of the steps that are done; a row has the force of its own instant in addition
    mean_force = np.diff(trace.impulse[every - 1 :: every], prepend=0.0) / T
    effort = np.diff(trace.effort[::every], axis=0) / (T * np.array([40.0, 40, 40, 10, 10, 10]) ** 2)
    expected = np.exp(-(((mean_force - force_d) / force_d) ** 2)) - 0.1 * effort.mean(axis=1)
    assert rewards == pytest.approx(expected.tolist(), abs=1e-9)
    assert np.ptp(rewards) > 0.1


def test_thrusts_go_through_the_thrusters_own_matrix():
    push = Push("push_wall", overrides=SHORT, action="thrusts")
    push.reset(seed=0)
    action = np.linspace(-1.0, 1.0, push.size)
    push.apply(action)
    push.advance(1)
    B = push.simulation.setup.vehicle.B
    assert push.simulation.signals.tau == pytest.approx(B @ (20.0 * action), rel=1e-12)


def test_gains_at_action_zero_are_the_scenarios_and_at_one_four_times_those():
    overrides = SHORT | {"reference.step_time": 0.0}
    for action, factor in ((0.0, 1.0), (1.0, 4.0), (-1.0, 0.25)):
        push = Push("push_wall", overrides=overrides, action="gains", gains=("k_1", "beta"))
        seen, _ = episode(push, [action, action])
        gains = {"controller.k_1": 5.0 * factor, "controller.beta": 5.0 * factor}
        trace = simulate(Scenario.load("push_wall", overrides | gains), log_rate="full")
        assert np.array_equal([each["nu"] for each in seen], trace.nu[:: push.steps_each])


def test_actions_beyond_one_are_cut():
    one, ten = (Push("push_wall", overrides=SHORT) for _ in range(2))
    assert episode(one, np.ones(6))[1] == episode(ten, 10.0 * np.ones(6))[1]


def test_draws_are_uniform_within_their_bounds_and_repeat_with_the_seed():
    bounds = {"current.speed": (0.1, 0.4), "initial.position": ([-0.1, 0.0, 0.5], [0.1, 0.0, 0.6])}
    push = Push("push_wall", overrides=SHORT, randomise=bounds)

    def draws(seed, n):
        push.reset(seed=seed)
        found = []
        for _ in range(n):
            push.reset()
            scenario = push.simulation.scenario
            found.append([scenario.current.speed, *scenario.initial.position])
        return np.array(found)

    drawn = draws(3, 400)
    assert np.array_equal(drawn, draws(3, 400))
    assert not np.array_equal(drawn[0], draws(4, 1)[0])
    assert (drawn[:, 2] == 0.0).all()
    for column, low, high in ((0, 0.1, 0.4), (1, -0.1, 0.1), (3, 0.5, 0.6)):
        assert kstest(drawn[:, column], "uniform", (low, high - low)).pvalue > 1e-3
    assert np.array_equal(push.observation()["p_WB"], push.simulation.scenario.initial.position)


def test_an_episodes_own_keys_come_after_the_random_ones():
    push = Push("push_wall", overrides=SHORT, randomise={"current.speed": (0.1, 0.4)})
    push.reset(seed=0, overrides={"current.speed": 0.77})
    assert push.simulation.scenario.current.speed == 0.77
    push.reset()
    assert 0.1 <= push.simulation.scenario.current.speed <= 0.4


def test_the_desired_force_is_the_impedances_unless_given():
    assert Push("push_wall", overrides=SHORT).force_d == pytest.approx(1.5 / (1.0 + 150.0 / 1e5))
    assert Push("push_wall", overrides=SHORT, force_d=7.0).observation()["force_d"] == [7.0]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"action": "forces"}, "action: 'forces': must be 'wrench', 'thrusts' or 'gains'"),
        ({"control_rate": 30.0}, "control_rate: 30.0 Hz: must divide the step rate of 2000 Hz"),
        ({"control_rate": math.nan}, "control_rate"),
        ({"force_d": -1.0}, "force_d: -1.0: must be a positive force"),
        ({"wrench_scale": (1.0, 2.0)}, "six positive numbers"),
        ({"observe": ("nuu",)}, "no signal 'nuu'; did you mean 'nu'"),
        ({"action": "gains", "gains": ("k_3",)}, "k_3"),
        ({"action": "gains", "gains": ("nominal",)}, "that are numbers"),
        ({"randomise": {"current.sped": (0.0, 1.0)}}, "did you mean 'speed'"),
        ({"randomise": {"current.speed": (0.0, -1.0)}}, "must be a lower and an upper bound"),
        ({"randomise": {"current.speed": (0.0, 1e9)}}, "must be from 0 to 100 m/s"),
        (
            {"randomise": [{"key": "controller.delay", "values": [0.001, 0.002]}]},
            r"randomise\[0\]: controller.delay: reset can't add .* delay",
        ),
        ({"randomise": {"controller.delay": (0.0, 0.1)}}, "no draw can run with this environment: .*delay"),
        ({"randomise": {"simulation.timestep": (1e-4, 2e-4)}}, "all episodes have one time step"),
        ({"randomise": [{"key": "controller.name", "values": ["gsta"]}]}, "controller.name: is set by the action"),
        ({"randomise": [{"key": "vehicle.model", "values": ["lauv"]}]}, "the runs of a batch have the same signals"),
        ({"randomise": [{"key": "wall.stiffness"}]}, r"randomise\[0\]: give one of values, a grid"),
        ({"randomise": "nothing"}, "study 'nothing': neither a file nor built in"),
        ({"engine": "bullet"}, "engine: 'bullet': must be 'mujoco', 'free_body' or 'auto'"),
        ({"reward": 5}, "reward: 5: must be a function"),
        ({"reward_diverged": math.nan}, "reward_diverged: nan: must be a finite number"),
        ({"threads": 2}, "threads: is of several runs"),
        ({"randomise": {"current.speed": (0.0, 0.1), "wall.stiffness": (1.0, 1e30)}}, "wall.stiffness"),
        ({"overrides": {"wall.stifness": 1.0}}, "did you mean 'stiffness'"),
        ({"overrides": 5}, "overrides: 5 is not a mapping"),
        ({"scenario": 5}, "scenario 5: must be a name, or the path"),
        ({"control_rate": "fast"}, "control_rate: 'fast' Hz: must divide"),
        ({"force_d": "much"}, "force_d: 'much': must be a positive force"),
        ({"wrench_scale": "abc"}, "wrench_scale: 'abc': must be six positive"),
        ({"wrench_scale": [math.inf] * 6}, "must be six positive"),
        ({"thrust_scale": None}, "thrust_scale: None: must be a positive thrust"),
        ({"effort_weight": "x"}, "effort_weight: 'x': must be zero or positive"),
        ({"randomise": 5}, "randomise: 5 is not a mapping"),
        ({"observe": "nu"}, "observe: 'nu': must be a list of names"),
        ({"action": "gains", "gains": 5}, "gains: 5: must be a list of names"),
        ({"seed": -1}, "seed: -1: must be an integer, at least 0"),
    ],
)
def test_a_wrong_argument_is_named(wrong, message):
    with pytest.raises(InputError, match=message):
        Push(**({"overrides": SHORT} | wrong))


STUDY = """
[base]
scenario = "push_wall"
simulation.duration = 0.3
simulation.timestep = 5e-4
wall.damping = 5.0
[design]
runs = 4
[[vary]]
keys = ["vehicle.mass", "vehicle.displaced_mass"]
distribution = "truncated_normal"
mean = 1.0
deviation = 0.1
low = 0.8
high = 1.2
[[vary]]
key = "wall.stiffness"
distribution = "loguniform"
low = 1e3
high = 1e5
[[vary]]
key = "current.direction_deg"
values = [0.0, 90.0]
[[vary]]
key = "initial.position[1]"
low = -0.1
high = 0.1
number = 5
"""


def test_a_study_decides_the_scenario_and_what_each_episode_draws(tmp_path):
    """Of its [[vary]] the distributions are those of the study. Another vehicle is a new run with its inertia."""
    (tmp_path / "walls.toml").write_text(STUDY)
    push, drawn, inertias = Push(randomise=str(tmp_path / "walls.toml"), engine="free_body"), [], set()
    assert push.scenario.wall.damping == 5.0
    for k in range(150):
        push.reset(seed=k)
        scenario = push.simulation.scenario
        drawn.append((scenario.vehicle.mass, scenario.wall.stiffness, scenario.current.direction_deg))
        assert scenario.vehicle.displaced_mass == scenario.vehicle.mass
        assert np.abs(scenario.initial.position[1] - np.linspace(-0.1, 0.1, 5)).min() == 0.0
        assert push.force_d == demanded_force(scenario, scenario.wall.stiffness)
        inertias.add(push.simulation.setup.vehicle.M_RB[0, 0] / scenario.vehicle.mass)
    mass, stiffness, direction = np.array(drawn).T
    assert len(set(np.round(list(inertias), 9))) == 1
    assert kstest(mass, truncnorm(-2.0, 2.0, 1.0, 0.1).cdf).pvalue > 1e-3
    assert kstest(np.log10(stiffness), "uniform", (3.0, 2.0)).pvalue > 1e-3
    assert 45 < (direction == 90.0).sum() < 105


def test_a_draw_of_another_vehicle_leaves_nothing_to_the_next_episode():
    push = Push(overrides=SHORT, randomise=[{"key": "wall.damping", "values": [1.0]}])
    first, _ = episode(push, np.full(6, 0.1))
    push.reset(seed=0, overrides={"vehicle.mass": 1.1})
    assert push.simulation.scenario.vehicle.mass == 1.1
    again, _ = episode(push, np.full(6, 0.1))
    assert push.simulation.scenario.vehicle.mass == 1.0
    assert all(np.array_equal(a["nu"], b["nu"]) for a, b in zip(first, again, strict=True))


def test_a_reward_and_an_observation_of_ones_own():
    def reward(seen):
        return seen.force - seen.action[:, 0] - 1e-3 * seen.effort_rate[:, 0]

    def observe(seen):
        return np.column_stack([seen.nu, seen["t"], seen.force_d])

    settings = {"overrides": SHORT, "engine": "free_body"}
    own, default = Push(observe=observe, reward=reward, **settings), Push(observe=("nu", "t"), **settings)
    seen, before = own.reset(seed=0), default.reset(seed=0)
    assert np.array_equal(seen, np.concatenate([before["nu"], before["t"], before["force_d"]]))
    for _ in range(3):
        impulse, effort = (np.array(own.simulation.signals[name]) for name in ("impulse", "effort"))
        own.apply(np.full(6, 2.0))
        got = own.advance(40)
        after = own.simulation.signals
        expected = (after.impulse - impulse) / 0.02 - 1.0 - 1e-3 * (after.effort - effort)[0] / 0.02
        assert got == pytest.approx(float(expected), rel=1e-12)
    assert own.simulation.signals.touches > 0


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"reward": lambda seen: 1.0}, r"reward: gives \(\): must be \(1,\)"),
        ({"reward": lambda seen: np.array([math.nan])}, "reward: .*must be finite"),
        ({"observe": lambda seen: np.zeros(3)}, r"observe: the array is \(3,\): its first index"),
        ({"observe": lambda seen: seen.nuu}, "no signal 'nuu'; did you mean 'nu'"),
    ],
)
def test_a_function_that_gives_something_else_is_named(wrong, message):
    with pytest.raises((InputError, AttributeError), match=message):
        episode(Push(overrides=SHORT, **wrong), np.zeros(6))


def test_all_wrong_arguments_at_once():
    with pytest.raises(InputError) as caught:
        Push("push_wall", overrides=SHORT, force_d=0.0, thrust_scale=0.0, effort_weight=-1.0)
    assert len(caught.value.faults) == 3


@pytest.mark.parametrize("action", ["wrench", "thrusts", "gains"])
def test_an_action_of_another_shape_or_without_a_value_is_refused(action):
    """It is an error of the agent, and neither a divergence nor a number for all entries."""
    push = Push("push_wall", overrides=SHORT, action=action)
    n = push.size
    for wrong in (np.zeros(n + 1), np.zeros((1, n)), 0.5, None, "abc", np.full(n, math.nan), np.full(n, math.inf)):
        with pytest.raises(InputError, match=f"action: .*: must be {n} finite numbers"):
            push.apply(wrong)
    push.apply([0.0] * n)
    assert push.advance(1) == pytest.approx(math.exp(-1.0), abs=0.01)


def test_all_wrong_arguments_are_reported_together():
    with pytest.raises(InputError) as caught:
        Push(
            action="gains",
            gains=["k_9"],
            control_rate=3.0,
            rate=3,
            force_d=-1.0,
            seed=-1,
            randomise={"wall.stiffness": 1},
        )
    keys = [fault.key for fault in caught.value.faults]
    assert sorted(keys) == ["control_rate", "force_d", "gains", "randomise['wall.stiffness']", "rate", "seed"]
    assert "did you mean" in str(caught.value) or "choose from" in str(caught.value)


@pytest.mark.parametrize("name", shipped("models"))
def test_the_task_takes_every_vehicle(name):
    """An action of thrusts has one number a thruster, and moves the vehicle along its wrench."""
    push = Push("push_wall", overrides=SHORT | {"vehicle.model": name, "current.speed": 0.0}, action="thrusts")
    vehicle = push.simulation.setup.vehicle
    push.reset(seed=0)
    assert push.size == len(vehicle.thrusters)
    push.apply(np.full(push.size, 0.1))
    push.advance(1)
    assert push.simulation.signals.tau == pytest.approx(vehicle.B.sum(axis=1) * 0.1 * push.thrust_scale, abs=1e-12)
