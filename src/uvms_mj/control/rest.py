"""The state of a vehicle at rest, as a law's theory predicts it."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class SteadyState:
    """A vehicle at rest.

    Attributes:
        position: (3,) position of B's origin in W [m].
        quat: (4,) attitude.
        force: pushing force on the wall [N], zero if the vehicle rests short of it.
        s: (6,) sliding variable.
        tau: (6,) wrench of the thrusters in B [N, N m].
    """

    position: np.ndarray
    quat: np.ndarray
    force: float
    s: np.ndarray
    tau: np.ndarray


@dataclass(frozen=True)
class NoClosedForm:
    """The reason why a scenario has no steady state in closed form."""

    reason: str
