"""The engine ``mujoco``: MuJoCo's own step, with hydrodynamics and closed loop in its callback."""

import mujoco
import numpy as np

from ..plant.build import set_wall
from ..plant.contacts import face_of, surfaces_of
from ..plant.looks import aim, move_walls
from ..plant.vehicle import free_joint_addresses
from ..setup.base import Setup
from .base import Engine
from .native.attachment import immerse
from .native.timers import timers_stopped

CHUNK_STEPS = 1000
"""Largest number of steps from one reading of the clock to the next: a few milliseconds of wall time."""
_STEPPED = "somebody else has stepped sim.data or changed its time step: reset the Simulation, and use step only"


class MujocoEngine(Engine):
    """A compiled MuJoCo model with its data."""

    name = "mujoco"
    chunk_steps = CHUNK_STEPS

    def __init__(self, setup: Setup) -> None:
        self._plant = plant = setup.plant
        self._model, self._data = plant.model, plant.initial_data(setup.scenario.initial)
        self._drawn, start = plant.walls, setup.scenario.initial.position
        if plant.looks:
            aim(self._model, start, next((wall.position[0] for wall in plant.walls), start[0]), plant.geometry.reach)
        self._attachment = immerse(self._model, self._data, plant.vehicle)
        self.water = self._attachment.water
        self.context, self.state = self._attachment.context, (self._data.qpos, self._data.qvel)
        qpos, dof = free_joint_addresses(self._model, plant.body_id)
        self.qpos, self.qvel = self._data.qpos[qpos : qpos + 7], self._data.qvel[dof : dof + 6]
        self._q = self._data.qpos[qpos + 7 : qpos + 7 + len(plant.vehicle.arm.links)]
        sensors = {f"{name}_at": self._data.sensordata[address:] for name, address in plant.sensors.items()}
        self._place()
        self.memory = {"qacc_at": self._data.qacc[dof:], "ctrl_at": self._data.ctrl, **sensors}

    @property
    def model(self) -> mujoco.MjModel:
        return self._model

    @property
    def data(self) -> mujoco.MjData:
        return self._data

    def clear(self) -> None:
        mujoco.mj_resetData(self._model, self._data)

    def write_time(self, setup: Setup) -> None:
        self._model.opt.timestep = setup.scenario.simulation.timestep

    def write_wall(self, setup: Setup) -> None:
        probe = self._plant.probe
        set_wall(self._model, probe.body, setup.scenario.wall, face_of(setup.scenario, probe.radius))
        if self._plant.looks and (walls := surfaces_of(setup.scenario, probe.radius)) != self._drawn:
            move_walls(self._model, walls)
            self._drawn = walls

    def write_initial(self, setup: Setup) -> None:
        super().write_initial(setup)
        self._q[:] = self._plant.initial_joints(setup.scenario.initial)

    def sense(self) -> None:
        self._place()
        mujoco.mj_sensorPos(self._model, self._data)  # the wall's sensors get the values of the coming step

    def _place(self) -> None:
        """Compute the poses of bodies, and of camera and light for a picture between two steps."""
        mujoco.mj_kinematics(self._model, self._data)
        if self._plant.looks:
            mujoco.mj_camlight(self._model, self._data)

    def check(self, t: float, timestep: float) -> None:
        if abs(self._data.time - t) > 0.5 * timestep or self._model.opt.timestep != timestep:
            raise RuntimeError(_STEPPED)

    def step(self, loop: np.ndarray, n: int) -> None:
        loop["remaining"] = n
        with timers_stopped:
            mujoco.mj_step(self._model, self._data, n)
        if loop["remaining"][0]:
            loop["remaining"] = 0
            raise RuntimeError("mjcb_control was replaced during the run: hydrodynamics were no longer applied")

    def evaluate(self, loop: np.ndarray) -> None:
        loop["remaining"] = 1
        mujoco.mj_forward(self._model, self._data)

    @property
    def closed(self) -> bool:
        return self._attachment.detached

    def close(self) -> None:
        self._attachment.release()
