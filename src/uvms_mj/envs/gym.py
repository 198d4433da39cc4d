"""The task for Gymnasium: ``gymnasium.make("uvms_mj/PushWall-v0")``."""

from typing import Any

import numpy as np

from ..engine.simulation import Diverged
from ..errors import needs_extra
from .push import Observation, Push

with needs_extra("gym"):
    import gymnasium
    from gymnasium.spaces import Box, Dict


class PushWall(gymnasium.Env):
    """Push on the wall with a desired force; :mod:`uvms_mj.envs.push` describes actions, observations and reward.

    An episode is truncated at the scenario's duration and terminated if the run diverges. ``reset(options={...})``
    takes dotted keys of the scenario with values for this episode. The settings are the keyword arguments of
    :class:`uvms_mj.envs.push.Push`.
    """

    metadata = {"render_modes": []}  # noqa: RUF012  # Gymnasium's own attribute

    def __init__(self, **settings: Any) -> None:
        self.push = Push(**settings)
        self.action_space = Box(-1.0, 1.0, (self.push.size,), np.float64)
        shapes = {name: values.shape for name, values in self.push.observation().items()}
        self.observation_space = Dict({name: Box(-np.inf, np.inf, shape, np.float64) for name, shape in shapes.items()})

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        super().reset(seed=seed)
        return self.push.reset(seed, options), {}

    def step(self, action: np.ndarray) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        push = self.push
        push.apply(action)
        try:
            reward = push.advance(push.steps_each)
        except Diverged as divergence:
            return push.observation(), -1.0, True, False, {"diverged": str(divergence)}
        return push.observation(), reward, False, push.over, {}

    def close(self) -> None:
        self.push.simulation.close()
