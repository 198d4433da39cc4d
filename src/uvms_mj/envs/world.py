"""The task of :mod:`.push` for several vehicles of a world, in the parallel interface of PettingZoo."""

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Self

import numpy as np

from ..engine.coupling import WorldSimulation
from ..engine.simulation import Diverged
from ..errors import Fault, InputError, needs_extra, suggestion
from ..quantities import overrides_of
from ..scenario import Scenario
from ..setup.world import VEHICLES, World, vehicles_of
from .domain import generator, names
from .gym import space, within
from .push import REPLACED, Action, Observation, Push, fitting_engine

with needs_extra("gym"):
    from gymnasium.error import ResetNeeded
    from gymnasium.spaces import Box, Space

_REFUSED = {
    "randomise": "the vehicles of a world draw nothing; reset(options=...) takes the values of an episode",
    "simulations": "the environment makes the runs of its world",
}


class PushWorld:
    """Several vehicles of a world push, each with a desired force of its own; :mod:`uvms_mj.envs.push` describes the
    actions, observations, rewards and infos of each. They are by the vehicle's name::

        env = PushWorld("press_together", action="wrench")
        observations, infos = env.reset(seed=0)
        while env.agents:
            actions = {name: env.action_space(name).sample() for name in env.agents}
            observations, rewards, terminations, truncations, infos = env.step(actions)

    It has the interface of ``pettingzoo.ParallelEnv`` and does not need PettingZoo. All agents begin and end together:
    an episode is truncated at the world's duration. If any vehicle diverges, an agent or not, all are terminated, each
    with ``reward_diverged``, and ``diverged`` of each info names the vehicle.

    Args:
        scenario: the world, its name or the path of its file.
        vehicles: names of the agents; default: all vehicles whose law is not ``none``. The other vehicles run their
            own laws.
        overrides: dotted keys and values that replace the world's, as of :meth:`uvms_mj.World.load`.
        action: "wrench", "thrusts" or "gains", of all agents.
        engine: "mujoco", "free_body", or "auto" for free_body where it can step all vehicles.
        seed: seed of the first episodes, until :meth:`reset` is given one.
        settings: the keyword arguments of :class:`uvms_mj.envs.push.Push` but ``randomise``, of all agents.

    Attributes:
        possible_agents: the names of all agents.
        agents: the names of the agents of the episode; empty before the first one and after its end.
        simulation: the :class:`uvms_mj.WorldSimulation`, with the Simulation of each vehicle.
        pushes: the :class:`uvms_mj.envs.push.Push` of each agent by its name.

    Raises:
        InputError: an argument is wrong.
    """

    render_mode = None

    def __init__(
        self,
        scenario: World | str | os.PathLike,
        vehicles: Sequence[str] | None = None,
        *,
        overrides: Mapping[str, Any] | None = None,
        action: Action = "wrench",
        engine: str = "auto",
        seed: int | None = None,
        **settings: Any,
    ) -> None:
        faults = [Fault(name, said) for name, said in _REFUSED.items() if settings.get(name) is not None]
        if faults:
            raise InputError(faults, "push")
        world = _world(scenario, overrides_of(overrides))
        self.possible_agents, self.agents = _agents(vehicles, world), list[str]()
        self._rng = generator(seed)
        of_caller = REPLACED.get(action, {}).items()
        world = world.updated({f"{VEHICLES}[{i}].{key}": x for i in self.possible_agents for key, x in of_caller})
        self.simulation = WorldSimulation(world, engine=fitting_engine(engine, world.scenarios.values()))
        try:
            self.pushes = {name: self._push(name, action, settings) for name in self.possible_agents}
            self.observation_spaces = {name: space(push.shapes) for name, push in self.pushes.items()}
        except BaseException:
            self.close()
            raise
        self.action_spaces = {name: Box(-1.0, 1.0, (push.size,), np.float64) for name, push in self.pushes.items()}
        self._steps_each = self.pushes[self.possible_agents[0]].steps_each
        rate = self.pushes[self.possible_agents[0]].control_rate
        self.metadata = {"name": "uvms_mj/PushWorld", "render_modes": [], "render_fps": rate}

    def _push(self, name: str, action: Action, settings: Mapping[str, Any]) -> Push:
        sim = self.simulation.vehicles[name]
        if not sim.setup.vehicle.thrusters:
            raise InputError([Fault(VEHICLES, f"{name} has no thrusters, and no action moves it")], "push")
        with _of_agent(name):
            return Push(sim.scenario, action=action, engine=sim.engine, simulations=[sim], **settings)

    def observation_space(self, agent: str) -> Space:
        """The space of the observations of an agent."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space:
        """The space of the actions of an agent."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begin an episode of all agents.

        Args:
            seed: seed of this and all later episodes; default: go on with the present numbers.
            options: dotted keys and values for this episode, as of :meth:`uvms_mj.World.load`.

        Raises:
            InputError: no episode can begin with these values. The one before is over.
        """
        rng = self._rng if seed is None else generator(seed)
        self.agents = []
        self.simulation.reset(options, seed=int(rng.integers(2**31)))
        self._rng = rng
        for push in self.pushes.values():
            push.started()
        self.agents = list(self.possible_agents)
        return self._observations(), self._infos()

    def step(
        self, actions: Mapping[str, np.ndarray]
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Do a control step with the action of each agent.

        Raises:
            InputError: an agent has no action or a wrong one, or there is no such agent.
            ResetNeeded: no episode has begun, or it is over.
        """
        if not self.agents:
            raise ResetNeeded("no episode is under way; call reset before the next step")
        _check_names(actions, self.agents)
        for name in self.agents:
            with _of_agent(name):
                self.pushes[name].apply(actions[name])
        ended = ""
        try:
            self.simulation.step(self._steps_each)
        except Diverged as divergence:
            ended = str(divergence)
        rewards = {name: push.account(self._steps_each, bool(ended)) for name, push in self.pushes.items()}
        truncated = {name: push.over and not ended for name, push in self.pushes.items()}
        seen, infos = self._observations(), self._infos()
        if ended:
            seen = {name: within(each) for name, each in seen.items()}
            infos = {name: info | {"diverged": ended} for name, info in infos.items()}
        if ended or all(truncated.values()):
            self.agents = []
        return seen, rewards, dict.fromkeys(self.pushes, bool(ended)), truncated, infos

    def _observations(self) -> dict[str, Observation]:
        return {name: push.observation() for name, push in self.pushes.items()}

    def _infos(self) -> dict[str, dict[str, Any]]:
        return {name: push.info() for name, push in self.pushes.items()}

    @property
    def num_agents(self) -> int:
        """Number of agents of the episode."""
        return len(self.agents)

    @property
    def max_num_agents(self) -> int:
        """Number of all agents."""
        return len(self.possible_agents)

    @property
    def unwrapped(self) -> Self:
        """The environment, which is no wrapper."""
        return self

    def render(self) -> None:
        """Nothing: a world has no pictures during an episode."""

    def close(self) -> None:
        """Close all Simulations. Calling it again has no effect."""
        self.simulation.close()


@contextlib.contextmanager
def _of_agent(name: str) -> Iterator[None]:
    """Name the agent in an InputError."""
    try:
        yield
    except InputError as error:
        raise InputError(error.faults, f"agent {name}") from None


def _world(given: Any, overrides: Mapping[str, Any]) -> World:
    """The world that is given. Raises InputError for a scenario of one vehicle."""
    if isinstance(given, World):
        return given.updated(overrides)
    if isinstance(given, Scenario) or not vehicles_of(given):
        raise InputError([Fault("scenario", "is of one vehicle; uvms_mj/PushWall-v0 takes it")], "push")
    return World.load(given, overrides)


def _agents(given: Any, world: World) -> list[str]:
    """The names of the agents. Raises InputError if they are not vehicles of the world."""
    if given is None:
        found = [name for name, scenario in world.scenarios.items() if scenario.controller.label() != "none"]
    else:
        found = list(names(VEHICLES, given))
    wrong = [name for name in found if name not in world.scenarios]
    faults = [Fault(VEHICLES, f"no vehicle {name!r}; {suggestion(name, world.scenarios)}") for name in wrong]
    if not found or len(set(found)) < len(found):
        faults.append(Fault(VEHICLES, f"{found!r}: must be names of vehicles, each once; choose from {world.label}"))
    if faults:
        raise InputError(faults, "push")
    return found


def _check_names(actions: Any, agents: Sequence[str]) -> None:
    """Raise InputError unless there is one action an agent."""
    if not isinstance(actions, Mapping):
        raise InputError([Fault("actions", f"{actions!r}: must be a mapping from {', '.join(agents)} to actions")])
    faults = [
        Fault("actions", f"no agent {name!r}; {suggestion(str(name), agents)}")
        for name in actions
        if name not in agents
    ]
    faults += [Fault("actions", f"lack the action of {name}") for name in agents if name not in actions]
    if faults:
        raise InputError(faults, "step")
