"""The engine ``mujoco``: MuJoCo's own step, with hydrodynamics and closed loop in its callback."""

from typing import Any

import mujoco
import numpy as np

from ..plant.build import set_wall
from ..plant.contacts import face_of, surfaces_of
from ..plant.looks import aim, move_walls
from ..plant.vehicle import free_joint_addresses
from ..scenario import Scenario
from ..setup.base import Setup
from .base import Engine
from .native.attachment import Attachment, immerse
from .native.callback import evaluate
from .native.record import Image
from .native.timers import stopped_clock, timers_stopped

CHUNK_STEPS = 1000
"""Largest number of steps from one reading of the clock to the next: a few milliseconds of wall time."""
_STEPPED = "somebody else has stepped sim.data or changed its time step: reset the Simulation, and use step only"


class MujocoEngine(Engine):
    """A compiled MuJoCo model with its data."""

    name = "mujoco"
    code = staticmethod(evaluate)
    chunk_steps = CHUNK_STEPS

    def __init__(self, setup: Setup) -> None:
        self._plant = plant = setup.plant
        self._model, self._data = plant.model, plant.initial_data(setup.scenario.initial)
        self._drawn, start = plant.walls, setup.scenario.initial.position
        self._walls_of: Scenario | None = None  # whose walls the model has
        if plant.looks:
            aim(self._model, start, next((wall.position[0] for wall in plant.walls), start[0]), plant.geometry.reach)
        self._attachment: Attachment | None = None
        self._place()

    def enter(self, image: Image, run: np.ndarray, setup: Setup, code: dict[str, Any]) -> None:
        plant, data = self._plant, self._data
        self._attachment = immerse(self._model, data, plant.vehicle, image, code["evaluate"].address)
        self.water, self._run = self._attachment.water, run
        qpos, dof = free_joint_addresses(self._model, plant.body_id)
        self.qpos, self.qvel = data.qpos[qpos : qpos + 7], data.qvel[dof : dof + 6]
        self._q = data.qpos[qpos + 7 : qpos + 7 + len(plant.vehicle.arm.links)]
        self._start = data.qpos.copy(), data.qvel.copy()
        stopped_clock()  # now, since an interrupt of a run must not meet the loading of machine code
        run["plant"]["mujoco"]["solved_at"] = data.sensordata[plant.contact_sensor :].ctypes.data

    @property
    def model(self) -> mujoco.MjModel:
        return self._model

    @property
    def data(self) -> mujoco.MjData:
        return self._data

    def clear(self) -> None:
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:], self._data.qvel[:] = self._start

    def write_time(self, setup: Setup) -> None:
        self._model.opt.timestep = setup.scenario.simulation.timestep

    def write_wall(self, setup: Setup) -> None:
        scenario, probe = setup.scenario, self._plant.probe
        if scenario is self._walls_of:
            return
        self._walls_of = scenario
        set_wall(self._model, probe.body, scenario.wall, face_of(scenario, probe.radius))
        if self._plant.looks and (walls := surfaces_of(scenario, probe.radius)) != self._drawn:
            move_walls(self._model, walls)
            self._drawn = walls

    def write_initial(self, setup: Setup) -> None:
        super().write_initial(setup)
        self._q[:] = self._plant.initial_joints(setup.scenario.initial)

    def sense(self) -> None:
        self._place()

    def _place(self) -> None:
        """Compute the poses of bodies, and of camera and light for a picture between two steps."""
        mujoco.mj_kinematics(self._model, self._data)
        if self._plant.looks:
            mujoco.mj_camlight(self._model, self._data)

    def check(self, t: float, timestep: float) -> None:
        if abs(self._data.time - t) > 0.5 * timestep or self._model.opt.timestep != timestep:
            raise RuntimeError(_STEPPED)

    def step(self, n: int) -> None:
        run = self._run
        run["remaining"] = n
        with timers_stopped:
            mujoco.mj_step(self._model, self._data, n)
        if run["remaining"][0]:
            run["remaining"] = 0
            raise RuntimeError("mjcb_control was replaced during the run: hydrodynamics were no longer applied")

    def evaluate(self) -> None:
        self._run["remaining"] = 1
        mujoco.mj_forward(self._model, self._data)

    @property
    def closed(self) -> bool:
        return self._attachment is None or self._attachment.detached

    def close(self) -> None:
        if self._attachment is not None:
            self._attachment.release()
