"""The task for dm_control: a physics with the water attached, and dm_env's interface."""

from typing import Any

import numpy as np
from dm_control.mujoco import Physics
from dm_control.mujoco.wrapper import MjData
from dm_control.rl import control
from dm_env import specs

from ..engine.simulation import Diverged
from ..errors import Fault, InputError
from .pictures import Pictures
from .push import Observation, Push


class WaterPhysics(Physics):
    """dm_control's view of a :class:`uvms_mj.Simulation`: the same MjModel and MjData, stepped by the simulation."""

    def __init__(self, push: Push) -> None:
        self.push = push
        self.divergence = ""
        self._pictures = dict[tuple[Any, ...], Pictures]()
        super().__init__(MjData(push.simulation.data))

    def step(self, nstep: int = 1) -> None:
        """Do time steps of the closed loop. A divergence ends the episode."""
        try:
            self.reward = self.push.advance(nstep)
        except Diverged as divergence:
            self.reward, self.divergence = self.push.reward_diverged, str(divergence)

    def reset(self, keyframe_id: int | None = None) -> None:
        """Begin an episode. Keyframes are not used."""
        before = self.push.simulation
        self.push.reset()
        if self.push.simulation is not before:  # of another vehicle
            self._reload_from_data(MjData(self.push.simulation.data))
        self.reward, self.divergence = 0.0, ""

    def render(  # type: ignore[override]
        self, height: int = 240, width: int = 320, camera_id: str = "overview", **settings: Any
    ) -> np.ndarray:
        """A picture (height, width, 3), uint8, of the instant after the last step. ``camera_id`` is a view of ``uvms-mj
        video``.

        Raises:
            InputError: a setting is not of these, and so depth, segmentation and overlays are refused; there is no such
                view; or no driver draws without a window.
        """
        if settings:
            raise InputError(
                [Fault(name, "can't be drawn; render takes height, width, camera_id") for name in settings]
            )
        chosen, push = (width, height, camera_id), self.push
        if chosen not in self._pictures:
            self._pictures[chosen] = Pictures((width, height), camera_id)
        return self._pictures[chosen].of(0, push.episodes, push.simulation, push.force_d)

    def free(self) -> None:
        """Free the simulation and the scenes of pictures."""
        for pictures in self._pictures.values():
            pictures.close()
        super().free()

    def after_reset(self) -> None:
        """Nothing: the simulation has evaluated the state, with the actuation that dm_control would disable."""


class PushTask(control.Task):
    """The task of :mod:`uvms_mj.envs.push`."""

    def __init__(self, push: Push) -> None:
        self.push = push

    def initialize_episode(self, physics: WaterPhysics) -> None:
        """Nothing: the physics' reset draws the episode."""

    def before_step(self, action: np.ndarray, physics: WaterPhysics) -> None:
        self.push.apply(np.asarray(action))

    def after_step(self, physics: WaterPhysics) -> None:
        """Nothing."""

    def action_spec(self, physics: WaterPhysics) -> specs.BoundedArray:
        return specs.BoundedArray((self.push.size,), np.float64, -1.0, 1.0, name=self.push.action)

    def get_observation(self, physics: WaterPhysics) -> Observation:
        return self.push.observation()

    def get_reward(self, physics: WaterPhysics) -> float:
        return physics.reward

    def get_termination(self, physics: WaterPhysics) -> float | None:
        """Discount at the end of an episode: 0 after a divergence, 1 at the scenario's duration."""
        if physics.divergence:
            return 0.0
        return 1.0 if self.push.over else None
