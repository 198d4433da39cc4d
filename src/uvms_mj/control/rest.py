"""The state of a vehicle at rest, as a law's theory predicts it."""

from dataclasses import dataclass, field
from typing import NoReturn

import numpy as np


@dataclass(frozen=True, eq=False)
class SteadyState:
    """A vehicle at rest. A theory that predicts the force alone leaves out the rest.

    Attributes:
        force: pushing force on the wall [N], zero if the vehicle rests short of it.
        position: (3,) position of B's origin in W [m].
        quat: (4,) attitude.
        s: (6,) sliding variable.
        tau: (6,) wrench of the thrusters in B [N, N m].
        reached: whether the motion from the start comes to this rest, and stays (:mod:`.balance`).
    """

    force: float
    position: np.ndarray | None = None
    quat: np.ndarray | None = None
    s: np.ndarray | None = None
    tau: np.ndarray | None = None
    reached: bool = field(default=False, kw_only=True)


@dataclass(frozen=True)
class NoClosedForm:
    """The reason why a scenario has no steady state in closed form."""

    reason: str

    @property
    def force(self) -> NoReturn:
        """Raises AttributeError, which gives the reason."""
        raise AttributeError(f"no closed form: {self.reason}")
