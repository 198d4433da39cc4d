"""The task for Gymnasium, as one environment and as many that are stepped together."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..engine.simulation import Diverged
from ..errors import Fault, InputError, needs_extra
from .pictures import MODES, SIZE, Pictures, checked_mode
from .push import Observation, Push, Pushes

with needs_extra("gym"):
    import gymnasium
    from gymnasium.spaces import Box, Dict, Space
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space

BOUND = 1e12
"""Bound of each number of an observation: a signal has none of its own."""


def space(shapes: Any) -> Space:
    """The space of arrays of a shape, or of arrays by name."""
    if isinstance(shapes, dict):
        return Dict({name: space(shape) for name, shape in shapes.items()})
    return Box(-BOUND, BOUND, shapes, np.float64)


def _row(rows: Observation, i: int) -> Observation:
    """The observation of one environment as a copy."""
    return {name: each[i].copy() for name, each in rows.items()} if isinstance(rows, dict) else rows[i].copy()


def within(seen: Observation) -> Observation:
    """Finite numbers within the space, also of a run that has diverged."""
    if isinstance(seen, dict):
        return {name: within(each) for name, each in seen.items()}
    return np.clip(np.nan_to_num(seen), -BOUND, BOUND)


class PushWall(gymnasium.Env):
    """Push on the wall with a desired force; :mod:`uvms_mj.envs.push` describes actions, observations and reward.

    An episode is truncated at the scenario's duration and terminated if the run diverges. ``reset(options={...})``
    takes dotted keys of the scenario with values for this episode.

    Args:
        render_mode: "rgb_array", where :meth:`render` gives a picture, or None, where it gives nothing.
        render_size: width and height of a picture in pixels, even numbers.
        render_view: a view of ``uvms-mj video``: "overview", "close", "follow", ...
        settings: the keyword arguments of :class:`uvms_mj.envs.push.Push`; the engine is "auto" unless it is given.

    Raises:
        InputError: an argument is wrong.
    """

    metadata = {"render_modes": [*MODES]}  # noqa: RUF012  # Gymnasium's own attribute

    def __init__(
        self,
        *,
        render_mode: str | None = None,
        render_size: Sequence[int] = SIZE,
        render_view: str = "overview",
        **settings: Any,
    ) -> None:
        self.render_mode = checked_mode(render_mode)
        self._pictures = Pictures(render_size, render_view)
        self.push = Push(**{"engine": "auto"} | settings)
        self.action_space = Box(-1.0, 1.0, (self.push.size,), np.float64)
        self.observation_space = space(self.push.shapes)
        self.metadata = self.metadata | {"render_fps": self.push.control_rate}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode, with the run that the seed draws. ``options`` are dotted keys of the scenario with values
        for this episode. Returns the observation and the info."""
        super().reset(seed=seed)
        return self.push.reset(seed, options), self.push.info()

    def step(self, action: np.ndarray) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Do a control step. A run that diverges terminates the episode, and its end truncates it."""
        push = self.push
        push.apply(action)
        try:
            reward = push.advance(push.steps_each)
        except Diverged as divergence:
            info = push.info() | {"diverged": str(divergence)}
            return within(push.observation()), push.reward_diverged, True, False, info
        return push.observation(), reward, False, push.over, push.info()

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """The picture (height, width, 3), uint8, of the instant after the last step. Raises InputError if no driver
        draws without a window."""
        push = self.push
        if self.render_mode is None:
            return None
        return self._pictures.of(0, push.episodes, push.simulation, push.force_d)

    def close(self) -> None:
        """Free the run and the pictures."""
        self._pictures.close()
        self.push.close()


class PushWallVec(VectorEnv):
    """Environments :class:`PushWall` that are stepped together, on all cores. Environment i is, bit for bit, the one
    that :class:`PushWall` is with the seed ``seed + i``.

    Args:
        num_envs: number of environments.
        autoreset_mode: a ``gymnasium.vector.AutoresetMode``, or its value: an environment whose episode has ended
            begins the next one in the next step (the default), in the same step, with the last observation in
            ``infos["final_obs"]``, or when the caller resets it with ``options={"reset_mask": ...}``.
        render_mode, render_size, render_view: as of :class:`PushWall`; :meth:`render` gives a tuple of pictures, and
            each environment has a scene of its own in memory.
        settings: the settings of :class:`PushWall`, and ``threads``, the number of threads; default: one a core.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        render_size: Sequence[int] = SIZE,
        render_view: str = "overview",
        **settings: Any,
    ) -> None:
        modes = [mode.value for mode in AutoresetMode]
        if not isinstance(autoreset_mode, AutoresetMode) and autoreset_mode not in modes:
            raise InputError([Fault("autoreset_mode", f"{autoreset_mode!r}: must be one of {', '.join(modes)}")])
        self.num_envs, self.autoreset_mode = num_envs, AutoresetMode(autoreset_mode)
        self.render_mode, self._pictures = checked_mode(render_mode), Pictures(render_size, render_view)
        chosen: dict[str, Any] = {"engine": "auto"} | settings
        self.pushes = Pushes(**chosen, n=num_envs)
        self.metadata = {
            "render_modes": [*MODES],
            "render_fps": self.pushes.control_rate,
            "autoreset_mode": self.autoreset_mode,
        }
        self.single_action_space = Box(-1.0, 1.0, (self.pushes.size,), np.float64)
        self.single_observation_space = space(self.pushes.shapes)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._all, self._over = np.arange(num_envs), np.zeros(num_envs, bool)
        self._begun = np.zeros(num_envs, bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode in all environments, or where ``options["reset_mask"]``, (n,) truth values, says so. The
        other options are dotted keys of the scenario with values for these episodes. Environment i has the seed ``seed
        + i``, or seed i of a list."""
        given = dict(options or {})
        mask = _mask(given.pop("reset_mask", None), self.num_envs)
        single = seed is None or isinstance(seed, int | np.integer)
        super().reset(seed=int(seed) if single and seed is not None else None)  # type: ignore[arg-type]
        seeds = _seeds(seed, self.num_envs)
        for i in self._all[mask].tolist():
            self.pushes.begin(i, seeds[i], given)
        self._over[mask], self._begun[mask] = False, True
        return self.pushes.observations(), self._infos(mask)

    def step(self, actions: np.ndarray) -> tuple[Observation, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Do a control step in all environments; after the end of an episode ``autoreset_mode`` decides.

        Raises:
            ResetNeeded: an environment has not been reset, or has to be reset by the caller.
        """
        pushes, mode = self.pushes, self.autoreset_mode
        if not self._begun.all() or (mode is AutoresetMode.DISABLED and self._over.any()):
            wrong = self._all[~self._begun | self._over].tolist()
            raise gymnasium.error.ResetNeeded(f"reset environments {wrong} before the next step")
        stepped = self._all[~self._over]
        pushes.apply(actions, stepped)
        for i in self._all[self._over].tolist():
            pushes.begin(i)
        rewards, diverged = pushes.advance(pushes.steps_each, stepped)
        ended = np.zeros(self.num_envs, bool)
        ended[list(diverged)] = True
        truncated = pushes.ended & ~ended
        self._over = ended | truncated
        seen = within(pushes.observations()) if diverged else pushes.observations()
        messages = {i: {"diverged": str(divergence)} for i, divergence in sorted(diverged.items())}
        if mode is AutoresetMode.SAME_STEP and self._over.any():
            last, finals = pushes.infos(), dict[str, Any]()
            for i in self._all[self._over].tolist():
                info = {name: rows[i] for name, rows in last.items()} | messages.get(i, {})
                finals = self._add_info(finals, {"final_obs": _row(seen, i), "final_info": info}, i)
                pushes.begin(i)
            self._over = np.zeros(self.num_envs, bool)
            return pushes.observations(), rewards, ended, truncated, self._infos() | finals
        infos = self._infos()
        for i, info in messages.items():
            infos = self._add_info(infos, info, i)
        return seen, rewards, ended, truncated, infos

    def _infos(self, mask: np.ndarray | None = None) -> dict[str, Any]:
        """The infos of all environments as Gymnasium has them: arrays by name, and who has one by _name; zeros outside
        of a mask."""
        infos: dict[str, Any] = {}
        for name, rows in self.pushes.infos().items():
            if mask is not None:
                rows[~mask] = 0
            infos[name] = rows
            infos[f"_{name}"] = np.ones(self.num_envs, bool) if mask is None else mask.copy()
        return infos

    def render(self) -> tuple[np.ndarray, ...] | None:  # type: ignore[override]
        """A picture (height, width, 3), uint8, of each environment. Raises InputError if no driver draws without a
        window."""
        if self.render_mode is None:
            return None
        pushes, forces = self.pushes, self.pushes.seen.force_d
        each = zip(pushes.episodes.tolist(), forces.tolist(), strict=True)
        return tuple(self._pictures.of(i, k, pushes.batch[i], force) for i, (k, force) in enumerate(each))

    def close_extras(self, **_: Any) -> None:
        """Free the runs and the pictures."""
        self._pictures.close()
        self.pushes.close()


def _mask(given: Any, n: int) -> np.ndarray:
    """The environments to reset; all without a mask."""
    if given is None:
        return np.ones(n, bool)
    if not isinstance(given, np.ndarray) or given.shape != (n,) or given.dtype != np.bool_ or not given.any():
        raise InputError([Fault("reset_mask", f"{given!r}: must be {n} truth values as an array, at least one true")])
    return given


def _seeds(seed: Any, n: int) -> list[Any]:
    """The seed of each environment."""
    if seed is None or isinstance(seed, int | np.integer):
        return [None if seed is None else int(seed) + i for i in range(n)]
    seeds = list(seed)
    if len(seeds) != n:
        raise InputError([Fault("seed", f"has {len(seeds)} seeds for {n} environments")])
    return seeds
