r"""The task of all environments: push on the wall with a desired force, at a control rate.

**Action** (array, each entry from -1 to 1), one of

- ``wrench``: tau_cmd divided by ``wrench_scale``; allocation and thrusters follow as for a law;
- ``thrusts``: the thrust of each thruster divided by ``thrust_scale``;
- ``gains``: gains of the scenario's law: a multiplies a gain of the scenario by :math:`4^a`.

**Observation**: signals of the simulation by name: what navigation and guidance give the law (:data:`OBSERVED`), and
``force_d``, the desired pushing force [N]. A function of :class:`Seen` in their place gives an array (n, m), or arrays
by name.

**Reward** of a control step of length T, with the mean pushing force :math:`\bar F` and the mean square of tau, both
integrated at every time step,

.. math::

    r = {} &\exp\left(-\left(\frac{\bar F - F_d}{F_d}\right)^2\right) \\
        &- c\, \frac{1}{6} \sum_{i=1}^6 \frac{1}{T \tau_i^2} \int \tau_i(t)^2\, dt

where :math:`\tau_i` is ``wrench_scale`` and c ``effort_weight``. A vehicle that does not touch the wall gets
exp(-1) = 0.37 less its effort. A function of :class:`Seen` in its place gives the rewards (n,). A run that diverges
ends with ``reward_diverged``.

**Info** after a control step (:data:`INFO`): the time ``t`` [s], the mean pushing force ``force`` of the step and the
desired one ``force_d`` [N], the measured contact force ``f_contact_m_W`` (3,) [N] at its end, ``contact``, whether a
wall was touched in the step, and ``is_success``: for the last ``success[1]`` seconds, ``force`` of every control step
was within a share ``success[0]`` of ``force_d``. The force within a control step does not count. At a reset
``force`` is zero, ``contact`` and ``is_success`` are false.

**End**: an episode is truncated at the scenario's duration, where a value may be bootstrapped, and terminated if the
run diverges. Success ends nothing: the force has to be held.

**Randomisation**: ``randomise`` is the ``[[vary]]`` of a study (:mod:`.domain`).
"""

import functools
import inspect
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal, get_args

import numpy as np

from ..control.design import demanded_force
from ..engine.batch import Batch
from ..engine.engines import refusals
from ..engine.simulation import ENGINES, Diverged, Simulation
from ..errors import Fault, InputError, suggestion
from ..quantities import overrides_of
from ..scenario import Scenario
from ..setup.base import set_up
from ..setup.world import World, vehicles_of
from . import domain
from .domain import Domain, domain_of


class Seen:
    """All n environments at the end of a control step, for a reward or an observation of one's own. A single
    environment is n = 1, so that one function serves both.

    Attributes:
        force_d: (n,) desired pushing force [N].
        action: (n, m) action of the step, cut to -1 and 1; zero at a reset.
        force: (n,) mean pushing force of the step [N]; zero at a reset.
        effort_rate: (n, 6) mean square of tau during the step [N^2, N^2 m^2]; zero at a reset.

    A signal by its name is an array (n, ...): ``seen.nu``, ``seen["nu"]``. Functions of each number give the same bits
    for any n; products of matrices may differ by rounding.
    """

    def __init__(
        self, batch: Batch, force_d: np.ndarray, action: np.ndarray, force: np.ndarray, effort_rate: np.ndarray
    ) -> None:
        self._batch = batch
        self.force_d, self.action, self.force, self.effort_rate = force_d, action, force, effort_rate

    def __getitem__(self, name: str) -> np.ndarray:
        return self._batch.read((name,))[name]

    def __getattr__(self, name: str) -> np.ndarray:
        if name.startswith("_") or name not in self._batch.names:
            raise AttributeError(f"no signal {name!r}; {suggestion(name, self._batch.names)}")
        return self[name]


Observe = Callable[[Seen], np.ndarray | Mapping[str, np.ndarray]]
Reward = Callable[[Seen], np.ndarray]


OBSERVED = ("p_WB", "quat_WB", "nu", "f_contact_m_W", "p_d", "quat_d")
"""Signals of the observation, if none are given."""
INFO = ("t", "force", "force_d", "f_contact_m_W", "contact", "is_success")
"""The names of an info."""
SPAN = 4.0
"""Largest factor by which an action changes a gain."""
Action = Literal["wrench", "thrusts", "gains"]
REPLACED = {"wrench": {"controller.name": "external"}, "thrusts": {"actuation.name": "external"}, "gains": {}}
"""The stage that the caller replaces, by the action."""
Observation = Any
"""An array, or arrays by name."""


class Pushes:
    """Pushing on the wall as a sequence of control steps, in n runs that are stepped together.

    Args:
        scenario: the scenario, its name or the path of its file; default: the base of the study that ``randomise``
            names, otherwise push_wall. An episode lasts ``simulation.duration``.
        overrides: dotted keys and values that replace the scenario's.
        action: "wrench", "thrusts" or "gains".
        control_rate: control steps per second [Hz]; must divide the step rate.
        gains: names of the gains that an action changes, for "gains".
        force_d: desired pushing force [N]; default: the force that the impedance of each episode's scenario demands.
        observe: names of the observed signals, or a function of :class:`Seen` that gives an array (n, m), or arrays
            (n, ...) by name.
        reward: a function of :class:`Seen` that gives the rewards (n,); default: the one above.
        reward_diverged: reward of the step in which a run diverges.
        wrench_scale: (6,) wrench at action 1, and the unit of the effort [N, N m].
        thrust_scale: thrust at action 1 [N].
        effort_weight: weight c of the effort in the reward.
        success: the criterion of ``is_success``: a share of the desired force, and a time [s].
        randomise: what each episode draws: the name or the path of a study, for its ``[[vary]]``, or a list of such
            tables; or a lower and an upper bound by dotted key, for uniform draws, where a vector's bounds are vectors.
        engine: "mujoco", "free_body", or "auto" for free_body where it can, as in :class:`uvms_mj.Simulation`.
        seed: seed of the first episodes, until :meth:`reset` is given one; run i has ``seed + i``.
        n: number of runs.
        threads: number of threads that step them; default: one a core.
        simulations: the n runs of the scenario; default: new ones. Whoever steps them calls :meth:`account` after the
            steps, and :meth:`started` at the start.

    Raises:
        InputError: an argument is wrong; lists every error.
    """

    def __init__(
        self,
        scenario: Scenario | str | None = None,
        *,
        overrides: Mapping[str, Any] | None = None,
        action: Action = "wrench",
        control_rate: float = 50.0,
        gains: Sequence[str] = ("k_1", "k_2"),
        force_d: float | None = None,
        observe: Sequence[str] | Observe = OBSERVED,
        reward: Reward | None = None,
        reward_diverged: float = -1.0,
        wrench_scale: Sequence[float] = (40.0, 40.0, 40.0, 10.0, 10.0, 10.0),
        thrust_scale: float = 20.0,
        effort_weight: float = 0.1,
        success: tuple[float, float] = (0.1, 1.0),
        randomise: Mapping[str, tuple[Any, Any]] | Sequence[Mapping[str, Any]] | str | os.PathLike | None = None,
        engine: str = "mujoco",
        seed: int | None = None,
        n: int = 1,
        threads: int | None = None,
        simulations: Sequence[Simulation] | None = None,
        **unknown: Any,
    ) -> None:
        faults = [Fault(name, f"no such argument; {suggestion(name, ARGUMENTS)}") for name in unknown]
        checked = functools.partial(domain.checked, faults)
        base, variations = checked(domain_of, randomise) or (None, {})
        chosen = _scenario(scenario, base, overrides)
        self.action, self.scenario = action, chosen.updated(REPLACED.get(action, {}))
        if action not in get_args(Action):
            faults.append(Fault("action", f"{action!r}: must be 'wrench', 'thrusts' or 'gains'"))
        if engine not in (*ENGINES, "auto"):
            fleet = "; on a GPU, uvms_mj.Fleet steps many runs with a law from outside" if engine == "gpu" else ""
            faults.append(Fault("engine", f"{engine!r}: must be 'mujoco', 'free_body' or 'auto'{fleet}"))
        wanted = "a positive force [N]; without it, the scenario's impedance demands it"
        demanded = _demanded(self.scenario) if force_d is None else force_d
        number = checked(domain.positive, "force_d", demanded, ((), (1,)), wanted)
        self._force_d = None if force_d is None or number is None else number.item()
        self.wrench_scale = checked(
            domain.positive, "wrench_scale", wrench_scale, ((6,),), "six positive numbers [N, N m]"
        )
        self.thrust_scale = checked(domain.positive, "thrust_scale", thrust_scale, ((),), "a positive thrust [N]")
        weight = checked(domain.positive, "effort_weight", effort_weight, ((),), "zero or positive", zero=True)
        self.effort_weight = weight
        wanted = "a share of the desired force and a time [s], both positive"
        criterion = checked(domain.positive, "success", success, ((2,),), wanted)
        self.reward_diverged = checked(domain.finite, "reward_diverged", reward_diverged)
        self._base = checked(domain.base_gains, self.scenario, gains) if action == "gains" else {}
        self.steps_each = checked(domain.steps_each, self.scenario.simulation.timestep, control_rate)
        self.rngs = checked(domain.generators, seed, n)
        self._observed = observe if callable(observe) else tuple(checked(domain.names, "observe", observe) or ())
        self._reward = checked(domain.function, "reward", reward)
        if faults:
            raise InputError(faults, "push")
        self.domain = Domain(variations, self.scenario)
        self.domain.check(overrides_of(overrides), [*REPLACED[action], *self._base])
        self.engine = fitting_engine(engine, [self.scenario])
        self._looks = self.engine == "mujoco" and n == 1
        self.batch = Batch(simulations or [self._new() for _ in range(n)], threads)
        self._rebuilt = [False] * n
        absent = [] if callable(observe) else [name for name in observe if name not in self.batch.names]
        if absent:
            hints = ((name, suggestion(name, self.batch.names)) for name in absent)
            raise InputError([Fault("observe", f"no signal {name!r}; {hint}") for name, hint in hints], "push")
        thrusters = len(self.batch[0].setup.vehicle.thrusters)
        self.size = {"wrench": 6, "thrusts": thrusters, "gains": len(self._base)}[action]
        self.control_rate = float(control_rate)
        self._within, hold = criterion.tolist()
        self._hold = max(1, round(hold * self.control_rate))
        self.episodes, self._held = np.zeros(n, int), np.zeros(n, int)  # begun so far; control steps within
        self._steps, self._last = np.zeros(n, int), np.full(n, self.scenario.steps)
        self._demands = np.full(n, demanded, float)
        self._actions, self._force, self._effort = np.zeros((n, self.size)), np.zeros(n), np.zeros((n, 6))
        self._impulse, self._spent = np.zeros(n), np.zeros((n, 6))  # integrals at the end of the last step
        self._try_out()

    @property
    def n(self) -> int:
        """Number of runs."""
        return len(self.batch)

    @property
    def ended(self) -> np.ndarray:
        """(n,) whether an episode has reached the scenario's duration."""
        return self._steps >= self._last

    def begin(self, i: int, seed: int | None = None, overrides: Mapping[str, Any] | None = None) -> None:
        """Begin an episode of a run.

        Args:
            i: index of the run.
            seed: seed of this and all later episodes; default: go on with the present numbers.
            overrides: dotted keys and values for this episode, after the random ones.

        Raises:
            InputError: no run can begin with these values. The run is as it was.
        """
        rng = self.rngs[i] if seed is None else domain.generator(seed)
        drawn = self.domain.draw(rng)
        number = int(rng.integers(2**31))
        self._restart(i, {**self._base, **drawn, **overrides_of(overrides)}, number)
        self.rngs[i] = rng
        self.started(i)

    def started(self, i: int) -> None:
        """Begin the account of an episode of a run that is at its start."""
        scenario = self.batch[i].scenario
        self._steps[i], self._last[i] = 0, scenario.steps
        self._demands[i] = _demanded(scenario) if self._force_d is None else self._force_d
        self.episodes[i] += 1
        self._held[i] = 0
        for each in (self._actions, self._force, self._effort, self._impulse, self._spent):
            each[i] = 0.0

    def _restart(self, i: int, overrides: Mapping[str, Any], seed: int) -> None:
        """Return a run to the start with other numbers. Of another vehicle, a new Simulation is made: in milliseconds,
        since nothing is compiled."""
        needs_new = any(key.startswith("vehicle.") for key in overrides)
        if not needs_new:
            if self._rebuilt[i]:
                self.batch.replace(i, self._new())
                self._rebuilt[i] = False
            self.batch[i].reset(overrides, seed=seed)
            return
        self.batch.replace(i, self._new({**overrides, "simulation.seed": seed}))
        self._rebuilt[i] = True

    def _new(self, overrides: Mapping[str, Any] | None = None) -> Simulation:
        scenario = self.scenario.updated(overrides) if overrides else self.scenario
        return Simulation(scenario, engine=self.engine, looks=self._looks)

    def _try_out(self) -> None:
        """Check by a reset that an episode may begin with other values of what is drawn."""
        try:
            self._restart(0, {**self._base, **self.domain.at([0.5] * len(self.domain.variations))}, 0)
        except InputError as error:
            raise InputError([self.domain.named(fault) for fault in error.faults], "push") from None
        self._restart(0, self._base, self.scenario.simulation.seed)

    def apply(self, actions: np.ndarray, which: np.ndarray) -> None:
        """Set the commands of the next control step from actions (n, size), in the runs of some indices.

        Raises:
            InputError: the actions have another shape, or a number that is not finite.
        """
        numbers = domain.numbers(actions)
        if numbers.shape != (self.n, self.size) or not np.isfinite(numbers[which]).all():
            shape = f"{self.n} x {self.size}" if self.n > 1 else f"{self.size}"
            raise InputError([Fault("action", f"{actions!r}: must be {shape} finite numbers")])
        self._actions[which] = clipped = np.clip(numbers[which], -1.0, 1.0)
        if self.action == "wrench":
            self.batch.write("tau_cmd", self.wrench_scale * clipped, which)
        elif self.action == "thrusts":
            self.batch.write("u_cmd", self.thrust_scale * clipped, which)
        else:
            for i, factors in zip(which.tolist(), SPAN**clipped, strict=True):
                gains = zip(self._base.items(), factors.tolist(), strict=True)
                self.batch[i].set({key: value * factor for (key, value), factor in gains})

    def advance(self, steps: int, which: np.ndarray) -> tuple[np.ndarray, dict[int, Diverged]]:
        """Do time steps in the runs of some indices.

        Returns:
            The rewards (n,), zero for other runs, and the divergences by index.
        """
        diverged = self.batch.step(steps, which)
        return self.account(steps, which, list(diverged)), diverged

    def account(self, steps: int, which: np.ndarray, diverged: Sequence[int] = ()) -> np.ndarray:
        """Keep account of time steps that were done in the runs of some indices, of which some diverged. Returns the
        rewards (n,), zero for other runs."""
        impulse, effort = self.batch.read(("impulse", "effort")).values()
        T = steps * self.scenario.simulation.timestep
        self._steps[which] += steps
        self._force[which] = ((impulse - self._impulse) / T)[which]
        self._effort[which] = ((effort - self._spent) / T)[which]
        self._impulse, self._spent = impulse, effort
        within = np.abs(self._force - self._demands) <= self._within * self._demands
        self._held[which] = np.where(within, self._held + 1, 0)[which]
        rewards = np.zeros(self.n)
        rewards[which] = self._rewards()[which]
        rewards[[*diverged]] = self.reward_diverged
        if not np.isfinite(rewards).all():
            raise InputError([Fault("reward", f"{rewards!r}: must be finite numbers")])
        return rewards

    def _rewards(self) -> np.ndarray:
        if self._reward is None:
            off = (self._force - self._demands) / self._demands
            return np.exp(-off * off) - self.effort_weight * (self._effort / self.wrench_scale**2).mean(axis=1)
        given = np.asarray(self._reward(self.seen), float)
        if given.shape != (self.n,):
            raise InputError([Fault("reward", f"gives {given.shape}: must be ({self.n},), one an environment")])
        return given

    @property
    def seen(self) -> Seen:
        """The argument of the user's functions."""
        return Seen(self.batch, self._demands, self._actions, self._force, self._effort)

    def observations(self) -> Observation:
        """The observations, with one row a run."""
        if callable(self._observed):
            given = self._observed(self.seen)
            if isinstance(given, Mapping):
                return {name: self._rows(name, each) for name, each in given.items()}
            return self._rows("the array", given)
        found = self.batch.read(self._observed) | {"force_d": self._demands.copy()}
        return {
            name: (rows if rows.ndim > 1 else rows[:, None]).astype(float, copy=False) for name, rows in found.items()
        }

    def infos(self) -> dict[str, np.ndarray]:
        """The infos (n, ...) by name: :data:`INFO`."""
        found: dict[str, np.ndarray] = {
            "t": self._steps * self.scenario.simulation.timestep,
            "force": self._force.copy(),
            "force_d": self._demands.copy(),
            **self.batch.read(("f_contact_m_W",)),
            "contact": self._force > 0.0,
            "is_success": self._held >= self._hold,
        }
        return found

    @property
    def shapes(self) -> Any:
        """The shape of the observation of a run, or of its arrays by name."""
        rows = self.observations()
        return {name: each.shape[1:] for name, each in rows.items()} if isinstance(rows, dict) else rows.shape[1:]

    def _rows(self, name: str, given: Any) -> np.ndarray:
        """A copy of an observation, with at least one number a row."""
        rows = np.array(given, float)
        if rows.shape[:1] != (self.n,):
            raise InputError([Fault("observe", f"{name} is {rows.shape}: its first index must be the {self.n} runs")])
        return rows[:, None] if rows.ndim == 1 else rows

    def close(self) -> None:
        self.batch.close()


class Push:
    """One run of :class:`Pushes`, with its arguments but ``n`` and ``threads``: arrays lack the index of the run."""

    def __init__(self, scenario: Scenario | str | None = None, **settings: Any) -> None:
        faults = [Fault(name, "is of several runs; an environment has one") for name in _OF_SEVERAL if name in settings]
        if faults:
            raise InputError(faults, "push")
        self._runs = runs = Pushes(scenario, **settings)
        self.action, self.size, self.steps_each, self.scenario = runs.action, runs.size, runs.steps_each, runs.scenario
        self.wrench_scale, self.thrust_scale = runs.wrench_scale, runs.thrust_scale

    @property
    def simulation(self) -> Simulation:
        """The run. Where another vehicle is drawn, each episode has another one."""
        return self._runs.batch[0]

    @property
    def rng(self) -> np.random.Generator:
        """The random numbers of the episodes."""
        return self._runs.rngs[0]

    @property
    def over(self) -> bool:
        """Whether the episode has reached the scenario's duration."""
        return self.simulation.steps >= self.simulation.scenario.steps

    def reset(self, seed: int | None = None, overrides: Mapping[str, Any] | None = None) -> Observation:
        """Begin an episode, with the arguments of :meth:`Pushes.begin`."""
        self._runs.begin(0, seed, overrides)
        return self.observation()

    def apply(self, action: np.ndarray) -> None:
        """Set the command of the next control step from an action (size,).

        Raises:
            InputError: the action has another shape, or a number that is not finite.
        """
        numbers = domain.numbers(action)
        if numbers.shape != (self.size,) or not np.isfinite(numbers).all():
            raise InputError([Fault("action", f"{action!r}: must be {self.size} finite numbers")])
        self._runs.apply(numbers[None], _FIRST)

    def advance(self, steps: int) -> float:
        """Do time steps and return the reward. Raises Diverged if a bound is left."""
        rewards, diverged = self._runs.advance(steps, _FIRST)
        if diverged:
            raise diverged[0]
        return float(rewards[0])

    def started(self) -> None:
        """Begin the account of an episode of a run that somebody else returned to its start."""
        self._runs.started(0)

    def account(self, steps: int, diverged: bool = False) -> float:
        """Keep account of time steps that somebody else did, and return their reward."""
        return float(self._runs.account(steps, _FIRST, [0] if diverged else [])[0])

    def observation(self) -> Observation:
        """The observation as copies."""
        rows = self._runs.observations()
        return {name: each[0] for name, each in rows.items()} if isinstance(rows, dict) else rows[0]

    def info(self) -> dict[str, Any]:
        """The info: :data:`INFO`."""
        found = {name: each[0] for name, each in self._runs.infos().items()}
        return {name: each.item() if each.ndim == 0 else each for name, each in found.items()}

    @property
    def episodes(self) -> int:
        """Number of episodes begun."""
        return int(self._runs.episodes[0])

    @property
    def control_rate(self) -> float:
        """Control steps per second [Hz]."""
        return self._runs.control_rate

    @property
    def shapes(self) -> Any:
        """The shape of the observation, or of its arrays by name."""
        return self._runs.shapes

    @property
    def force_d(self) -> float:
        """The desired pushing force of the episode [N]."""
        return float(self._runs.seen.force_d[0])

    @property
    def reward_diverged(self) -> float:
        """Reward of a step in which the run diverges."""
        return self._runs.reward_diverged

    def close(self) -> None:
        self._runs.close()


_FIRST = np.zeros(1, int)
_OF_SEVERAL = ("n", "threads")
ARGUMENTS = [name for name in inspect.signature(Pushes).parameters if name != "unknown"]


def _scenario(given: Scenario | str | None, base: Scenario | None, overrides: Mapping[str, Any] | None) -> Scenario:
    """The scenario that is given; otherwise the base of a study, otherwise push_wall."""
    chosen = given if given is not None else base if base is not None else "push_wall"
    if isinstance(chosen, Scenario):
        return chosen.updated(overrides_of(overrides))
    if isinstance(chosen, World) or vehicles_of(chosen):
        raise InputError([Fault("scenario", "is a world of several vehicles; uvms_mj.envs.PushWorld takes it")], "push")
    return Scenario.load(chosen, overrides)


def fitting_engine(name: str, scenarios: Iterable[Scenario]) -> str:
    """The engine; of "auto", free_body where it can run all scenarios."""
    if name != "auto":
        return name
    return "mujoco" if any(refusals(set_up(scenario)) for scenario in scenarios) else "free_body"


def _demanded(scenario: Scenario) -> float:
    """The pushing force that the impedance of a scenario demands [N]."""
    return demanded_force(scenario, scenario.wall.stiffness)
