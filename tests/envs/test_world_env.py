"""The environment of several agents, the vehicles of a world."""

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="needs the extra gym")

from uvms_mj import InputError, World, WorldSimulation  # noqa: E402  # after the skip
from uvms_mj.envs import PushWorld  # noqa: E402
from uvms_mj.envs.gym import PushWall  # noqa: E402

ENGINES = ("mujoco", "free_body")
STILL = {"simulation.timestep": 1e-3}
SHORT = STILL | {"simulation.duration": 0.2}
GUSTS = {"current.deviation": [0.1, 0.1, 0.0], "current.correlation_time": 0.5}
NEAR = {f"vehicles[{name}].initial.position": [0.9, y, 0.0] for name, y in (("left", 0.4), ("right", -0.4))}
BAR = {"force_d": 20.0, "observe": ("p_WB", "nu", "f_couplings_W")}
NOTHING = {"left": np.zeros(6), "right": np.zeros(6)}


def same(one, other):
    """Whether two observations or infos are the same, bit for bit."""
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name]) for name in one)


def seen_of(env, seed, policy):
    """The observations, rewards and infos of an episode."""
    found, numbers = [env.reset(seed=seed)], np.random.default_rng(1)
    while env.agents:
        found.append(env.step({name: policy(name, numbers.uniform(-1.0, 1.0, 6)) for name in env.agents}))
    return found


@pytest.mark.parametrize("settings", [{"engine": "mujoco"}, {"engine": "auto"}, {"action": "thrusts"}])
def test_vehicles_that_nothing_couples_are_the_environments_of_each_alone(settings):
    """Observation, reward and info, of two episodes of which the second has an override and no seed."""
    world = World.load("press_together", STILL | GUSTS | NEAR)
    env = PushWorld(world, **settings)
    alone = {name: PushWall(scenario=world.scenarios[name], **settings) for name in env.possible_agents}
    actions, touched = np.random.default_rng(0), set()
    for seed, options in ((5, None), (None, {"initial.velocity": [0.3, 0.0, 0.0, 0.0, 0.0, 0.0]})):
        observations, infos = env.reset(seed=seed, options=options)
        for name, each in alone.items():
            observation, info = each.reset(seed=seed, options=options)
            assert same(observations[name], observation)
            assert same(infos[name], info)
        for _ in range(50):
            given = {name: actions.uniform(0.0, 1.0, each.action_space.shape) for name, each in alone.items()}
            observations, rewards, ended, truncated, infos = env.step(given)
            for name, each in alone.items():
                observation, *rest, info = each.step(given[name])
                assert same(observations[name], observation)
                assert rest == [rewards[name], ended[name], truncated[name]]
                assert same(infos[name], info)
                touched |= {name} if info["contact"] else set()
    assert touched == {"left", "right"}


@pytest.mark.parametrize("engine", ENGINES)
def test_a_coupled_episode_follows_from_its_seed_and_the_actions_of_all(engine):
    env = PushWorld("press_bar", overrides=SHORT | GUSTS, engine=engine, **BAR)
    assert env.possible_agents == ["left", "right"]  # the bar has no law
    free = seen_of(env, 3, lambda name, drawn: 0.0 * drawn)
    first = seen_of(env, 3, lambda name, drawn: drawn)
    again = seen_of(env, 3, lambda name, drawn: drawn)
    right = seen_of(env, 3, lambda name, drawn: drawn * (name == "right"))
    other = seen_of(env, 4, lambda name, drawn: drawn)
    assert len(first) == 11
    for one, two in zip(first, again, strict=True):
        assert all(same(one[0][name], two[0][name]) and same(one[-1][name], two[-1][name]) for name in NOTHING)
    assert [each[1] for each in first[1:]] == [each[1] for each in again[1:]]
    ends = {id(found): found[-1][0]["left"] for found in (free, first, right, other)}
    moved = {tuple(seen["nu"]) for seen in ends.values()}
    assert len(moved) == 4  # by its own action, through the bar by the other's, and by the gusts of another seed
    env.reset(seed=3)
    env.step(NOTHING | {"left": np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])})
    commanded = {name: env.simulation.vehicles[name].signals.tau_cmd[0] for name in env.agents}
    assert commanded == {"left": 20.0, "right": 0.0}


def rubbing():
    """Two vehicles thrown at a bar in front of them, whose surface has friction, and so a state."""
    laws = {"controller.name": "gsta", "vehicles[bar].controller.name": "none"}
    tables = World.load("press_bar", SHORT | laws | {"simulation.timestep": 2.5e-4}).to_dict()
    surface = {"shape": "box", "position": [0.0, 0.0, 0.0], "edges": [0.1, 1.2, 0.2], "stiffness": 5e3}
    surface |= {"damping": 20.0, "friction": 0.5}
    body = {"position": [0.3, 0.0, 0.0], "radius": 0.05}
    contact = {"kind": "contact", "body": body, "surface": surface}
    tables["couplings"] = [{"vehicles": [name, "bar"]} | contact for name in ("left", "right")]
    thrown = {f"vehicles[{name}].initial.velocity": [0.5, 0.2, 0.0, 0.0, 0.0, 0.0] for name in ("left", "right")}
    return World.from_dict(tables, thrown | {"vehicles[bar].initial.position": [0.81, 0.0, 0.0]})


@pytest.mark.parametrize(("world", "engine"), [("press_bar", "mujoco"), ("rubbing", "free_body")])
def test_gains_at_their_own_values_are_the_world_with_its_laws(world, engine):
    """An action writes numbers of the run at every control step, and may touch no state of a coupling."""
    if world == "rubbing":
        world = rubbing()
    else:
        world = World.load(world, SHORT | {"controller.name": "gsta", "vehicles[bar].controller.name": "none"})
        world = world.updated({"vehicles[bar].initial.velocity": [0.3, 0.0, 0.0, 0.0, 0.0, 0.1]})
    env = PushWorld(world, action="gains", engine=engine, **BAR)
    env.reset(seed=3)
    most = 0.0
    with WorldSimulation(env.simulation.world, engine=engine) as sim:
        while env.agents:
            observations = env.step({name: np.zeros(2) for name in env.agents})[0]
            sim.step(round(0.02 / world.simulation.timestep))
            for name, seen in observations.items():
                assert all(np.array_equal(seen[key], sim.vehicles[name].signals[key]) for key in BAR["observe"])
                most = max(most, np.abs(seen["f_couplings_W"]).max())
    assert most > 1.0


def test_all_agents_end_together():
    env = PushWorld("press_together", overrides=SHORT)
    assert [env.max_num_agents, env.num_agents, env.agents] == [2, 0, []]
    env.reset(seed=0)
    for i in range(10):
        assert env.agents == ["left", "right"]
        *_, ended, truncated, _ = env.step(NOTHING)
        assert ended == {"left": False, "right": False}
        assert truncated == {"left": i == 9, "right": i == 9}
    assert env.agents == []


@pytest.mark.parametrize(("scenario", "engine"), [("press_together", "mujoco"), ("press_bar", "free_body")])
def test_a_divergence_terminates_all_agents_and_names_the_vehicle(scenario, engine):
    env = PushWorld(scenario, overrides=SHORT, engine=engine, wrench_scale=(1e6,) * 6, force_d=20.0)
    env.reset(seed=0)
    while env.agents:
        observations, rewards, ended, truncated, infos = env.step(NOTHING | {"right": np.ones(6)})
    assert rewards == {"left": -1.0, "right": -1.0}
    assert ended == {"left": True, "right": True}
    assert truncated == {"left": False, "right": False}
    assert all(env.observation_space(name).contains(seen) for name, seen in observations.items())
    assert infos["left"]["diverged"] == infos["right"]["diverged"]
    assert infos["left"]["diverged"].startswith("right: t = ")
    first, _ = env.reset(seed=0)
    assert env.step(NOTHING)[2] == {"left": False, "right": False}
    assert all(same(first[name], env.reset(seed=0)[0][name]) for name in first)


def test_agents_are_the_vehicles_that_are_named():
    """The other one follows its own law."""
    world = World.load("press_together", SHORT)
    env = PushWorld(world, ["right"])
    observations, _ = env.reset(seed=0)
    assert [*observations] == env.agents == ["right"]
    assert env.simulation.world.scenarios["left"].controller.label() == world.scenarios["left"].controller.label()
    with WorldSimulation(env.simulation.world, engine="free_body") as sim:
        while env.agents:
            env.step({"right": np.zeros(6)})
        sim.step(200)
        assert np.array_equal(sim.vehicles["left"].signals.nu, env.simulation.vehicles["left"].signals.nu)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"vehicles": ["lef"]}, "push: vehicles: no vehicle 'lef'; did you mean 'left'"),
        ({"vehicles": ["left", "left"]}, "must be names of vehicles, each once; choose from left, right, bar"),
        ({"vehicles": []}, "must be names of vehicles, each once"),
        ({"vehicles": ["bar"]}, "push: vehicles: bar has no thrusters, and no action moves it"),
        ({"randomise": {"current.speed": (0.0, 0.5)}}, "push: randomise: the vehicles of a world draw nothing"),
        ({"simulations": []}, "push: simulations: the environment makes the runs of its world"),
        ({"n": 2}, "agent left: n: is of several runs; an environment has one"),
        ({"force": 20.0}, "agent left: force: no such argument; did you mean 'force_d'"),
        ({"force_d": None}, "agent left: force_d: nan: must be a positive force"),
        ({"action": "pushes"}, "agent left: action: 'pushes': must be 'wrench', 'thrusts' or 'gains'"),
        ({"engine": "free"}, "engine 'free': is not an engine; did you mean 'free_body'"),
        ({"scenario": "push_wall"}, "push: scenario: is of one vehicle; uvms_mj/PushWall-v0 takes it"),
    ],
)
def test_wrong_arguments(settings, message):
    with pytest.raises(InputError) as caught:
        PushWorld(**{"scenario": "press_bar", "force_d": 20.0} | settings)
    assert message in str(caught.value)


def test_wrong_actions_and_options():
    env = PushWorld("press_together", overrides=SHORT)
    with pytest.raises(gymnasium.error.ResetNeeded, match="no episode is under way; call reset before the next step"):
        env.step(NOTHING)
    env.reset(seed=0)
    for given, message in (
        ({"left": np.zeros(6)}, "step: actions: lack the action of right"),
        (NOTHING | {"up": np.zeros(6)}, "step: actions: no agent 'up'"),
        (NOTHING | {"right": np.zeros(5)}, "agent right: action: .*: must be 6 finite numbers"),
        (NOTHING | {"right": np.full(6, np.nan)}, "agent right: action: .*: must be 6 finite numbers"),
        (np.zeros(12), "must be a mapping from left, right to actions"),
    ):
        with pytest.raises(InputError, match=message):
            env.step(given)
    assert env.simulation.steps == 0
    with pytest.raises(InputError, match="reset: vehicles"):
        env.reset(options={"vehicles[up].initial.position": [0.0, 0.0, 0.0]})
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(NOTHING)


def test_environments_of_one_vehicle_name_the_one_of_a_world():
    with pytest.raises(InputError, match=r"scenario: is a world of several vehicles; uvms_mj.envs.PushWorld takes it"):
        PushWall(scenario=World.load("press_together"))
    with pytest.raises(InputError, match=r"uvms_mj.envs.PushWorld takes it"):
        gymnasium.make("uvms_mj/PushWall-v0", scenario="press_bar")


@pytest.mark.parametrize("settings", [{}, {"wrench_scale": (1e6,) * 6}])
def test_pettingzoos_own_check(settings):
    """Of episodes that are truncated, and of some that end early."""
    check = pytest.importorskip("pettingzoo.test", reason="needs PettingZoo, which is no dependency")

    class Lenient(PushWorld):
        """Takes the option that the check gives, which is no key of a scenario."""

        def reset(self, seed=None, options=None):
            return super().reset(seed, None if options == {"options": 1} else options)

    check.parallel_api_test(Lenient("press_together", overrides=SHORT, **settings), num_cycles=20)
