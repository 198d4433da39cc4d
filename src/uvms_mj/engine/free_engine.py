"""The engine ``free_body``: the closed loop around one free rigid vehicle, with a step of its own, without MuJoCo.

It computes what MuJoCo computes for such a vehicle, from the same state and with the same kernels; its step is
MuJoCo's semi-implicit Euler, and its contact is as soft as MuJoCo's (:mod:`uvms_mj.physics.free_body`).
"""

import dataclasses
from typing import Any

import numpy as np

from ..errors import Fault, InputError
from ..physics.frames import BODY
from ..scenario import STAGES
from ..setup.base import Setup
from .base import Engine
from .native.free_body import free_steps
from .native.record import Image
from .native.water import Water

_KNOWN = {
    "simulation": ("timestep", "duration", "integrator", "seed"),
    "initial": ("position", "attitude_deg", "velocity"),
    "wall": ("present", "position", "stiffness", "damping", "friction", "tangential_stiffness", "tangential_damping"),
    "bumper": ("stiffness", "damping"),
}
"""The keys of the plant and of the stepping that free_body computes."""
_SHARED = ("vehicle", "current", "disturbance", "tether", "impedance", "estimates", "task", *STAGES)
"""The tables that both engines read from the same records."""


def refusals(setup: Setup) -> list[str]:
    """The reasons why the engine free_body can't run a scenario, one sentence for each key; empty if it can.

    It takes one rigid vehicle among walls, and steps it as MuJoCo's integrator euler. A table or key that it
    does not know is refused unless it has its default.
    """
    scenario, unknown = setup.scenario, list[str]()
    if setup.vehicle.arm.links:
        return [f"vehicle.model = {scenario.vehicle.model!r} has joints, which the engine free_body does not compute"]
    if scenario.task.frame != BODY:
        unknown.append(f"task.frame = {scenario.task.frame!r}")
    if scenario.vehicle.payloads:
        unknown.append("vehicle.payloads")
    if scenario.simulation.integrator != "euler":
        unknown.append(f"simulation.integrator = {scenario.simulation.integrator!r}")
    for table in dataclasses.fields(scenario):
        value = getattr(scenario, table.name)
        if table.name not in _SHARED and dataclasses.is_dataclass(value):
            fields = [field for field in dataclasses.fields(value) if getattr(value, field.name) != field.default]
            known = _KNOWN.get(table.name, ())
            unknown += [f"{table.name}.{field.name}" for field in fields if field.name not in known]
    return [f"{key} is not computed by the engine free_body; use the engine mujoco" for key in unknown]


class FreeEngine(Engine):
    """A vehicle in the record of its run."""

    name = "free_body"
    code = staticmethod(free_steps)
    chunk_steps = 10_000

    def __init__(self, setup: Setup) -> None:
        """Raises InputError for a scenario that it can't run."""
        if reasons := refusals(setup):
            raise InputError([Fault("engine", reason) for reason in reasons], "scenario")
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
