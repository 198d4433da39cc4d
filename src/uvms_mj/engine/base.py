"""The contract of an engine: the body that a Simulation moves, its contact with the wall, and its step."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np

from ..errors import InputError
from ..plant.build import put_at
from ..setup.base import Setup
from .native.record import Image
from .native.water import Water


class Engine(ABC):
    """Base class of all engines.

    Attributes:
        code: the kernel of its step, from the record of a run and two integers.
        chunk_steps: largest number of steps from one reading of the clock to the next: a few milliseconds of wall time.
        water: the motion of the water in the record of the run.
        qpos, qvel: (7,) and (6,) the vehicle's pose and velocity, those of its free joint.
        closed: whether the engine can't step any more.
    """

    name: ClassVar[str]
    code: ClassVar[Any]
    chunk_steps: ClassVar[int]
    water: Water
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

    @abstractmethod
    def enter(self, image: Image, run: np.ndarray, setup: Setup, code: dict[str, Any]) -> None:
        """Take the record of a run (1,), which is in an image, and its entry points."""

    def clear(self) -> None:  # noqa: B027  # free_body has nothing beside the record
        """Forget everything of the run but its initial state."""

    def write_time(self, setup: Setup) -> None:  # noqa: B027  # free_body reads that of the record
        """Set the time step."""

    def write_wall(self, setup: Setup) -> None:  # noqa: B027  # free_body reads that of the record
        """Set the wall's position, and the spring and damper that the engine applies."""

    def write_initial(self, setup: Setup) -> None:
        """Put the vehicle at the initial state."""
        put_at(setup.scenario.initial, self.qpos, self.qvel)

    def sense(self) -> None:  # noqa: B027  # free_body has nothing to show
        """Set the poses that somebody may look at between two steps."""

    def check(self, t: float, timestep: float) -> None:  # noqa: B027  # nobody else can step free_body
        """Raise RuntimeError if somebody else has stepped the engine."""

    @abstractmethod
    def step(self, n: int) -> None:
        """Take n time steps."""

    @abstractmethod
    def evaluate(self) -> None:
        """Evaluate the instant in hand without a step."""
