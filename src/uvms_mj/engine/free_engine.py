"""The engine ``free_body``: the closed loop around one free rigid vehicle, with a step of its own, without MuJoCo.

It computes what MuJoCo computes for such a vehicle, from the same state and with the same kernels; its step is
MuJoCo's semi-implicit Euler, and its contact is as soft as MuJoCo's (:mod:`uvms_mj.physics.free_body`).
"""

from typing import Any

import numpy as np

from ..setup.base import Setup
from .base import Engine
from .native.free_body import free_steps
from .native.image import Image
from .native.water import Water


class FreeEngine(Engine):
    """A vehicle in the record of its run."""

    name = "free_body"
    code = staticmethod(free_steps)
    chunk_steps = 10_000

    def __init__(self, setup: Setup) -> None:
        self._closed = False

    def enter(self, image: Image, run: np.ndarray, setup: Setup, code: dict[str, Any]) -> None:
        vehicle, plant, self._body = setup.vehicle, run["plant"], run["body"]
        self.water = Water(image, plant, vehicle, setup.gravity_W)
        constants = {
            "M_RB": vehicle.M_RB,
            "M_inv": np.linalg.inv(vehicle.M),
            "mass": vehicle.mass,
            "r_g": vehicle.r_g,
            "gravity_W": setup.gravity_W,
            "softness": setup.plant.softness,
        }
        for name, value in constants.items():
            self._body[name] = value
        self.qpos, self.qvel = plant["qpos"][0], plant["qvel"][0]
        self._step, self._address = code["free_steps"].ctypes, image.address

    @property
    def closed(self) -> bool:
        return self._closed

    def step(self, n: int) -> None:
        self._step(self._address, n, 1)

    def evaluate(self) -> None:
        self._step(self._address, 1, 0)

    def close(self) -> None:
        self._closed = True
