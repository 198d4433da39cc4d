"""The engines, which move the body: their contract, one free rigid vehicle without MuJoCo, and MuJoCo.

The engine ``free_body`` takes the closed loop around one free rigid vehicle with a step of its own. It computes
such a vehicle as MuJoCo does, from the same state and with the same kernels; its step is
MuJoCo's semi-implicit Euler, and its contact is as soft as MuJoCo's (:mod:`uvms_mj.physics.free_body`).
"""

import dataclasses
import functools
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import mujoco
import numpy as np

from ..errors import Fault, InputError
from ..physics.frames import BODY
from ..plant.build import put_at, set_wall
from ..plant.contacts import Contacts, face_of
from ..plant.looks import aim, drawn_wall, move_walls
from ..plant.vehicle import free_joint_addresses
from ..plant.water import EFFECT_TABLES
from ..scenario import STAGE_LISTS, STAGES
from ..setup.base import Setup
from .native.attachment import Attachment, immerse
from .native.bodies import Water
from .native.callback import evaluate, stopped_clock, timers_stopped
from .native.loop import free_steps
from .native.record import Image


class Engine(ABC):
    """Base class of all engines.

    Attributes:
        code: the kernel of its step, from the record of a run and two integers.
        chunk_steps: largest number of steps from one reading of the clock to the next: a few milliseconds of wall time.
        water: the motion of the water in the record of the run.
        qpos, qvel: (7,) and (6,) the vehicle's pose and velocity, of its free joint.
        state: (7 + n,) and (6 + n,) the same with the positions and velocities of n joints behind them.
        closed: whether the engine can't step any more.
    """

    name: ClassVar[str]
    code: ClassVar[Any]
    chunk_steps: ClassVar[int]
    water: Water
    qpos: np.ndarray
    qvel: np.ndarray
    state: tuple[np.ndarray, np.ndarray]

    @property
    def model(self) -> Any:
        """MuJoCo's model. Raises InputError if the engine has none."""
        raise InputError(f"the engine {self.name} has no MuJoCo model; use Simulation(scenario, engine='mujoco')")

    @property
    def data(self) -> Any:
        """MuJoCo's data. Raises InputError if the engine has none."""
        raise InputError(f"the engine {self.name} has no mjData; use Simulation(scenario, engine='mujoco')")

    @property
    @abstractmethod
    def closed(self) -> bool: ...

    @abstractmethod
    def close(self) -> None: ...

    def refuse(self, setup: Setup) -> None:  # noqa: B027  # MuJoCo takes every scenario
        """Raise InputError for a scenario that the engine can't run."""

    @abstractmethod
    def enter(self, image: Image, run: np.ndarray, setup: Setup, code: Callable[[], dict[str, Any]]) -> None:
        """Take the record of a run (1,), which is in an image, and what gives its entry points."""

    def clear(self) -> None:  # noqa: B027  # free_body has nothing beside the record
        """Forget everything of the run but its initial state."""

    def write_time(self, setup: Setup) -> None:  # noqa: B027  # free_body reads it from the record
        """Set the time step."""

    def write_wall(self, setup: Setup) -> None:  # noqa: B027  # free_body reads it from the record
        """Set the wall's position, and the spring and damper that the engine applies."""

    def write_initial(self, setup: Setup) -> None:
        """Put the vehicle at the initial state."""
        put_at(setup.scenario.initial, self.qpos, self.qvel)

    def saved(self) -> Any:  # noqa: B027  # free_body has nothing beside the record
        """A copy of what a step changes beside the record; None in free_body."""

    def put_back(self, saved: Any) -> None:  # noqa: B027  # free_body has nothing beside the record
        """Put back what :meth:`saved` gave."""

    def sense(self) -> None:  # noqa: B027  # free_body has nothing to show
        """Set the poses that somebody may look at between two steps."""

    def go_back(self, t: float) -> None:  # noqa: B027  # free_body has not moved
        """After a stop within a step, stand at its beginning again."""

    def check(self, t: float, timestep: float) -> None:  # noqa: B027  # nobody else can step free_body
        """Raise RuntimeError if somebody else has stepped the engine."""

    @abstractmethod
    def step(self, n: int) -> None:
        """Take n time steps."""

    @abstractmethod
    def evaluate(self) -> None:
        """Evaluate the instant in hand without a step."""


_KNOWN = {
    "simulation": ("timestep", "duration", "integrator", "seed", "law_seed"),
    "initial": ("position", "attitude_deg", "velocity"),
    "wall": ("present", "position", "stiffness", "damping", "friction", "tangential_stiffness", "tangential_damping"),
    "bumper": ("stiffness", "damping"),
}
"""The keys of the plant and of the stepping that free_body computes."""
_SHARED = (
    *("name", "description", "vehicle", "walls", "impedance", "estimates", "task"),
    *(*EFFECT_TABLES, *STAGES, *STAGE_LISTS),
)
"""The tables that both engines read from the same records."""


def refusals(setup: Setup) -> list[str]:
    """The reasons why the engine free_body can't run a scenario, one sentence for each key; empty if it can.

    It takes one rigid vehicle among walls, and steps it as MuJoCo's integrator euler. A table or key that it
    does not know is refused unless it has its default.
    """
    scenario, unknown = setup.scenario, list[str]()
    if setup.vehicle.arm.links:
        joints = f"vehicle.model = {scenario.vehicle.model!r} has joints, which the engine free_body does not compute"
        return [f"{joints}; use the engine mujoco"]
    if scenario.task.frame != BODY:
        unknown.append(f"task.frame = {scenario.task.frame!r}")
    if scenario.vehicle.payloads:
        unknown.append("vehicle.payloads")
    if scenario.simulation.integrator != "euler":
        unknown.append(f"simulation.integrator = {scenario.simulation.integrator!r}")
    for table in dataclasses.fields(scenario):
        value: Any = getattr(scenario, table.name)
        if table.name in _SHARED:
            continue
        if not dataclasses.is_dataclass(value):  # a list of tables
            unknown += [table.name] if value != table.default else []
            continue
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
        self.refuse(setup)
        self._closed = False

    def refuse(self, setup: Setup) -> None:
        if reasons := refusals(setup):
            raise InputError([Fault("engine", reason) for reason in reasons], "scenario")

    def enter(self, image: Image, run: np.ndarray, setup: Setup, code: Callable[[], dict[str, Any]]) -> None:
        vehicle, plant, self._body = setup.vehicle, run["plant"], run["body"]
        self.water = Water(image, plant, vehicle, setup.gravity_W)
        constants = {
            "M_RB": vehicle.M_RB,
            "M_inv": (inverse := np.linalg.inv(vehicle.M)),
            "M_inv_open": inverse,
            "mass": vehicle.mass,
            "r_g": vehicle.r_g,
            "gravity_W": setup.gravity_W,
            "softness": setup.plant.softness,
        }
        for name, value in constants.items():
            self._body[name] = value
        self.qpos, self.qvel = self.state = plant["qpos"][0], plant["qvel"][0]
        self._code, self._address = code, image.address

    @functools.cached_property
    def _step(self) -> Callable[..., Any]:
        return self._code()["free_steps"].ctypes

    @property
    def closed(self) -> bool:
        return self._closed

    def step(self, n: int) -> None:
        self._step(self._address, n, 1)

    def evaluate(self) -> None:
        self._step(self._address, 1, 0)

    def close(self) -> None:
        self._closed = True


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
        start = setup.scenario.initial.position
        self._contacts: Contacts | None = None  # whose walls the model has
        if plant.looks:
            self._drawn = [drawn_wall(wall) for wall in plant.walls]
            aim(self._model, start, next((wall.position[0] for wall in plant.walls), start[0]), plant.geometry.reach)
        self._attachment: Attachment | None = None
        self._place()

    def enter(self, image: Image, run: np.ndarray, setup: Setup, code: Callable[[], dict[str, Any]]) -> None:
        plant, data = self._plant, self._data
        self._attachment = immerse(self._model, data, plant.vehicle, image, code()["evaluate"].address)
        self.water, self._run = self._attachment.water, run
        qpos, dof = free_joint_addresses(self._model, plant.body_id)
        self.qpos, self.qvel = data.qpos[qpos : qpos + 7], data.qvel[dof : dof + 6]
        n = len(plant.vehicle.arm.links)
        self.state = data.qpos[qpos : qpos + 7 + n], data.qvel[dof : dof + 6 + n]
        self._q, self._q_dot = (each[k:] for each, k in zip(self.state, (7, 6), strict=True))
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
        scenario, probe, contacts = setup.scenario, self._plant.probe, setup.contacts
        if contacts is self._contacts:
            return
        self._contacts = contacts
        set_wall(self._model, probe.body, scenario.wall, face_of(scenario, probe.radius))
        if self._plant.looks:
            self._drawn = move_walls(self._model, self._drawn, [wall for _, wall in contacts.walls])

    def write_initial(self, setup: Setup) -> None:
        super().write_initial(setup)
        self._q[:] = self._plant.initial_joints(setup.scenario.initial)

    def go_back(self, t: float) -> None:
        true, joints = self._run["true"][0], self._run["encoder"][0]
        self.qpos[:3], self.qpos[3:] = true["p_WB"], true["quat_WB"]
        self.qvel[:3], self.qvel[3:] = true["R_WB"].reshape(3, 3) @ true["nu"][:3], true["nu"][3:]
        self._q[:], self._q_dot[:] = joints["q"], joints["q_dot"]
        self._data.time = t

    def saved(self) -> mujoco.MjData:
        found = mujoco.MjData(self._model)
        mujoco.mj_copyData(found, self._model, self._data)
        return found

    def put_back(self, saved: mujoco.MjData) -> None:
        mujoco.mj_copyData(self._data, self._model, saved)

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
        if self._attachment is not None and (lost := self._attachment.lost()):
            raise RuntimeError(lost)

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
