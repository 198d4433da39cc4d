r"""Allocations that know costs, weights and limits of the thrusters.

**Weighted pseudoinverse.** A thruster that is costly or weak gets less thrust. Of all thrusts with :math:`B u =
\tau_{cmd}` the allocation takes the thrusts with the least :math:`u^\top W u`, a generalised inverse (Fossen 2021, sec.
11.2):

.. math:: u = W^{-1} B^\top (B W^{-1} B^\top)^{-1} \tau_{cmd}

**Scaled.** The pseudoinverse gives the thrusts. Where a limit binds, one factor scales all of them: the wrench is
shorter, and has the direction of the command. A thruster that is limited alone turns it.

**Constrained.** The thrusters are given the nearest wrench that they reach within their limits:

.. math:: \min_u \; |W (B u - \tau_{cmd})|^2 + \epsilon |u|^2, \qquad u_{min} \le u \le u_{max}

W has the weights of the six axes. Where no limit binds, the result is the weighted least squares with the least thrust,
:math:`\epsilon = 0`. Where one binds, :math:`\epsilon` is 1e-6 of the largest eigenvalue of
:math:`B^\top W^2 B`, and an active-set method solves the problem: free thrusters are solved for, one that would leave
its limits is held at them, and one whose limit costs most is freed. The problem is strictly convex, so the method
ends at the solution.
"""

from __future__ import annotations  # so that help(Weighted) shows short type names

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import numpy as np

from ..errors import Fault, InputError
from ..physics.kernels import kernel
from ..physics.linear_algebra import backward, cholesky, forward
from ..physics.spanned_axes import pseudoinverse, spanning
from ..quantities import Number, of_length, within
from ..stages.base import setting
from ..stages.setup import SetupLike
from .base import Actuation

_Weight = Annotated[Number, within(1e-3, 1e3, "")]


@kernel
def allocate(inverse, tau_cmd, u_min, u_max, u) -> bool:
    """Set u to inverse tau_cmd within the thrusters' limits, and return whether a limit binds."""
    free = inverse @ tau_cmd
    u[:] = np.clip(free, u_min, u_max)
    return bool(np.any(u != free))


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
        return pseudoinverse(B, columns=root)

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        return {"inverse": self.inverse(setup.nominal.B)}

    @staticmethod
    def step(settings, state, given, state_dot, u):
        allocate(settings.inverse, given.tau_cmd, given.u_min, given.u_max, u)


@dataclasses.dataclass(frozen=True)
class Scaled(Actuation):
    """The pseudoinverse, all thrusts scaled by one factor where a limit binds, so that the wrench keeps its
    direction."""

    name = "scaled"
    records_loss: ClassVar[bool] = True

    @staticmethod
    def step(settings, state, given, state_dot, u):
        free, u_min, u_max = given.B_pinv @ given.tau_cmd, given.u_min, given.u_max
        part = 1.0
        for k in range(len(u)):
            limit = u_max[k] if free[k] > 0.0 else u_min[k]
            if abs(free[k]) > abs(limit):
                part = min(part, limit / free[k])
        u[:] = np.clip(part * free, u_min, u_max)  # whose last digit may be beyond a limit


MOST_THRUSTERS = 16
"""The solver is for so many thrusters."""
_SMALL = 1e-6
_ROUNDS = 10 * MOST_THRUSTERS
_Weights = Annotated[tuple[Annotated[Number, within(1e-3, 1e3, "")], ...], of_length(6)]


@dataclasses.dataclass(frozen=True)
class Constrained(Actuation):
    """The nearest wrench within the thrusters' limits, by an active-set method."""

    weights: _Weights = setting((1.0, 1.0, 1.0, 5.0, 5.0, 5.0), "1, 1/m", "weight of each axis of the wrench, W")

    name = "constrained"
    records_loss: ClassVar[bool] = True
    memory: ClassVar[Mapping[str, Any]] = {"solved": 1, "solved_tau": 6, "solution": "thrusters"}

    def inverse(self, B: np.ndarray) -> np.ndarray:
        return pseudoinverse(B, rows=np.array(self.weights))

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        B, n = setup.nominal.B, setup.nominal.B.shape[1]
        if n > MOST_THRUSTERS:
            wrong = f"constrained is for at most {MOST_THRUSTERS} thrusters; the vehicle has {n}"
            raise InputError([Fault("actuation.name", wrong)], "scenario")
        H, linear = quadratic(B, np.array(self.weights))
        return {"inverse": self.inverse(B), "H": H, "linear": linear}

    @staticmethod
    def step(settings, state, given, state_dot, u):
        if solved_before(given.tau_cmd, state, u):
            return
        if allocate(settings.inverse, given.tau_cmd, given.u_min, given.u_max, u):
            nearest(settings.H, settings.linear, given.tau_cmd, given.u_min, given.u_max, u)
        keep(given.tau_cmd, state, u)


def quadratic(B: np.ndarray, W: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """H (n, n) and the matrix (n, 6) of the problem min u^T H u / 2 - u^T linear tau_cmd."""
    weighted = W[:, None] * spanning(B)
    H = weighted.T @ weighted
    return H + _SMALL * float(np.linalg.eigvalsh(H)[-1]) * np.eye(len(H)), weighted.T * W


@kernel
def solved_before(tau_cmd, memory, u) -> bool:
    """Whether the last solution is for the same command; u is set to it. Commands are held for a control period."""
    if memory.solved[0] == 0.0 or np.any(tau_cmd != memory.solved_tau):
        return False
    u[:] = memory.solution
    return True


@kernel
def keep(tau_cmd, memory, u):
    """Keep a command and its solution."""
    memory.solved[0] = 1.0
    memory.solved_tau[:], memory.solution[:] = tau_cmd, u


@kernel
def nearest(H, linear, tau_cmd, u_min, u_max, u):
    """Improve u, which is within its limits, to the solution of the bounded quadratic problem."""
    wanted = linear @ tau_cmd
    fixed = np.where(u <= u_min, -1.0, np.where(u >= u_max, 1.0, 0.0))  # at which limit a thruster is held
    trial = np.zeros_like(u)
    for _ in range(_ROUNDS):
        solve_free(H, wanted, fixed, u, trial)
        if move(trial, u_min, u_max, fixed, u) and not release(H, wanted, u_min, u_max, fixed, u):
            break


@kernel
def solve_free(H, wanted, fixed, u, trial):
    """Set trial to the minimum over the free thrusters, with the others at u: H trial = wanted in the rows of the free
    ones, trial = u in the others."""
    free = np.where(fixed == 0.0, 1.0, 0.0)
    L = free[:, None] * H * free + np.diag(1.0 - free)
    trial[:] = np.where(fixed == 0.0, wanted - H @ ((1.0 - free) * u), u)
    cholesky(L, L)
    forward(L, trial)
    backward(L, trial)


@kernel
def move(trial, u_min, u_max, fixed, u) -> bool:
    """Move u towards trial up to the first limit, and hold that thruster there. Returns whether u arrives at trial."""
    part, first = 1.0, -1
    for k in range(len(u)):
        if fixed[k] == 0.0 and not u_min[k] <= trial[k] <= u_max[k]:
            limit = u_max[k] if trial[k] > u[k] else u_min[k]
            allowed = (limit - u[k]) / (trial[k] - u[k])
            if allowed < part:
                part = allowed
                first = k
    if first < 0:
        u[:] = np.where(fixed == 0.0, trial, u)
        return True
    u[:] = np.where(fixed == 0.0, u + part * (trial - u), u)
    fixed[first] = 1.0 if trial[first] > u[first] else -1.0
    u[first] = u_max[first] if fixed[first] > 0.0 else u_min[first]
    return False


@kernel
def release(H, wanted, u_min, u_max, fixed, u) -> bool:
    """Free the thruster whose limit costs most. Returns whether there is one."""
    gain = np.where(u_min < u_max, -fixed * (wanted - H @ u), 0.0)  # downhill is minus the gradient
    worst = np.argmax(gain)
    if not gain[worst] > 1e-12:
        return False
    fixed[worst] = 0.0
    return True
