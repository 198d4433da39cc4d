r"""Allocation by a weighted pseudoinverse: less thrust from a thruster that is costly or weak.

Of all thrusts with :math:`B u = \tau_{cmd}` it takes those with the least :math:`u^\top W u`, a generalised inverse
(Fossen 2021, sec. 11.2):

.. math:: u = W^{-1} B^\top (B W^{-1} B^\top)^{-1} \tau_{cmd}
"""

from __future__ import annotations  # so that help(Weighted) shows short type names

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import numpy as np

from ..errors import Fault, InputError
from ..physics.kernels import kernel
from ..quantities import Number, within
from ..stages.base import setting
from .base import Actuation

_Weight = Annotated[Number, within(1e-3, 1e3, "")]


@kernel
def allocate(inverse, tau_cmd, u_min, u_max, u) -> bool:
    """Set u to inverse tau_cmd within the thrusters' limits, and return whether a limit binds."""
    binds = False
    for k in range(u.shape[0]):
        total = 0.0
        for i in range(6):
            total += inverse[k, i] * tau_cmd[i]
        u[k] = min(u_max[k], max(u_min[k], total))
        if u[k] != total:
            binds = True
    return binds


@dataclasses.dataclass(frozen=True)
class Weighted(Actuation):
    """The weighted pseudoinverse within the thrusters' limits."""

    weights: tuple[_Weight, ...] = setting((), "1", "weight of each thruster, its cost; default: 1 each")

    name = "weighted"
    records_loss: ClassVar[bool] = True

    def inverse(self, B: np.ndarray) -> np.ndarray:
        if self.weights and len(self.weights) != B.shape[1]:
            wrong = f"has {len(self.weights)} values; the vehicle has {B.shape[1]} thrusters"
            raise InputError([Fault("actuation.weights", wrong)], "scenario")
        root = np.sqrt(np.array(self.weights or (1.0,) * B.shape[1]))
        return np.linalg.pinv(B / root) / root[:, None]

    def constants(self, setup: Any) -> Mapping[str, Any]:
        return {"inverse": self.inverse(setup.nominal.B)}

    @staticmethod
    def step(settings, state, given, state_dot, u):
        allocate(settings.inverse, given.tau_cmd, given.u_min, given.u_max, u)
