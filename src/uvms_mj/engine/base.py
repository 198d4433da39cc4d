"""The contract of an engine: the body that a Simulation moves, its contact with the wall, and its step."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np

from ..errors import InputError
from ..plant.build import put_at
from ..setup.base import Setup
from .native.water import Water


class Engine(ABC):
    """Base class of all engines.

    Attributes:
        chunk_steps: largest number of steps from one reading of the clock to the next: a few milliseconds of wall time.
        context: the CONTEXT record (1,).
        water: the motion of the water in it.
        memory: the engine's arrays whose addresses are in the LOOP record, by their fields.
        state: the arrays that a reset restores.
        qpos, qvel: (7,) and (6,) the vehicle's pose and velocity, those of its free joint.
        closed: whether the engine can't step any more.
    """

    name: ClassVar[str]
    chunk_steps: ClassVar[int]
    context: np.ndarray
    water: Water
    memory: dict[str, np.ndarray]
    state: tuple[np.ndarray, ...]
    qpos: np.ndarray
    qvel: np.ndarray

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

    def clear(self) -> None:  # noqa: B027  # free_body has nothing beside its state
        """Forget everything of the run but :attr:`state`."""

    def write_time(self, setup: Setup) -> None:  # noqa: B027  # free_body reads that of the LOOP record
        """Set the time step."""

    @abstractmethod
    def write_wall(self, setup: Setup) -> None:
        """Set the wall's position, and the spring and damper that the engine applies."""

    def write_initial(self, setup: Setup) -> None:
        """Put the vehicle at the initial state."""
        put_at(setup.scenario.initial, self.qpos, self.qvel)

    def sense(self) -> None:  # noqa: B027  # an engine may measure in its step
        """Measure the distance to the wall between two steps."""

    def check(self, t: float, timestep: float) -> None:  # noqa: B027  # nobody else can step free_body
        """Raise RuntimeError if somebody else has stepped the engine."""

    @abstractmethod
    def step(self, loop: np.ndarray, n: int) -> None:
        """Take n time steps of a LOOP record (1,)."""

    @abstractmethod
    def evaluate(self, loop: np.ndarray) -> None:
        """Evaluate the instant in hand without a step."""
