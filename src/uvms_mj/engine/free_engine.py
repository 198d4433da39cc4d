"""The engine ``free_body``: the closed loop around one free rigid vehicle, with a step of its own, without MuJoCo.

It computes what MuJoCo computes for such a vehicle, from the same state and with the same kernels; its step is
MuJoCo's semi-implicit Euler, and its contact is as soft as MuJoCo's (:mod:`uvms_mj.physics.free_body`).
"""

import numpy as np

from ..plant.contacts import face_of
from ..setup.base import Setup
from .base import Engine
from .native.callback import entry_point
from .native.layouts import BODY, CONTEXT
from .native.water import Water


class FreeEngine(Engine):
    """A vehicle in NumPy's memory."""

    name = "free_body"
    chunk_steps = 10_000

    def __init__(self, setup: Setup) -> None:
        vehicle = setup.vehicle
        self.context, self._body = np.zeros(1, CONTEXT), np.zeros(1, BODY)
        self.water = Water(self.context, vehicle, setup.gravity_W)
        constants = {
            "M_RB": vehicle.M_RB,
            "M_inv": np.linalg.inv(vehicle.M),
            "mass": vehicle.mass,
            "r_g": vehicle.r_g,
            "gravity_W": setup.gravity_W,
            "reach": setup.plant.probe.radius,
            "softness": setup.plant.softness,
        }
        for name, value in constants.items():
            self._body[name] = value
        self.context["qpos_at"] = self._body["qpos"].ctypes.data
        self.context["qvel_at"] = self._body["qvel"].ctypes.data
        self.memory = {f"{name}_at": self._body[name] for name in ("qacc", "distance", "fromto", "contact")}
        self.state, self._closed = (self._body,), False
        self.qpos, self.qvel = self._body["qpos"][0], self._body["qvel"][0]
        self._addresses = self.context.ctypes.data, self._body.ctypes.data

    @property
    def closed(self) -> bool:
        return self._closed

    def write_wall(self, setup: Setup) -> None:
        self._body["face"] = face_of(setup.scenario, setup.plant.probe.radius)

    def sense(self) -> None:
        entry_point("free_steps")(*self._addresses, 0, 0)

    def step(self, loop: np.ndarray, n: int) -> None:
        entry_point("free_steps")(*self._addresses, n, 1)

    def evaluate(self, loop: np.ndarray) -> None:
        entry_point("free_steps")(*self._addresses, 1, 0)

    def close(self) -> None:
        self._closed = True
