r"""Allocations that know costs, weights and limits of the thrusters.

Allocation by a weighted pseudoinverse: less thrust from a thruster that is costly or weak.

Of all thrusts with :math:`B u = \tau_{cmd}` it takes those with the least :math:`u^\top W u`, a generalised inverse
(Fossen 2021, sec. 11.2):

.. math:: u = W^{-1} B^\top (B W^{-1} B^\top)^{-1} \tau_{cmd}

Allocation to the nearest wrench that the thrusters reach within their limits.

.. math:: \min_u \; |W (B u - \tau_{cmd})|^2 + \epsilon |u|^2, \qquad u_{min} \le u \le u_{max}

W has the weights of the six axes. Where no limit binds, the result is that of the weighted least squares with the least
thrust, :math:`\epsilon = 0`. Where one binds, :math:`\epsilon` is 1e-6 of the largest eigenvalue of
:math:`B^\top W^2 B`, and an active-set method solves the problem: free thrusters are solved for, one that would leave
its limits is held at them, and one whose limit costs most is freed. The problem is strictly convex, so the method
ends at the solution.
"""

from __future__ import annotations  # so that help(Weighted) shows short type names

import dataclasses
import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import numpy as np

from ..errors import Fault, InputError
from ..physics.kernels import kernel
from ..physics.spanned_axes import pseudoinverse, spanning
from ..quantities import Number, of_length, within
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
        return pseudoinverse(B, columns=root)

    def constants(self, setup: Any) -> Mapping[str, Any]:
        return {"inverse": self.inverse(setup.nominal.B)}

    @staticmethod
    def step(settings, state, given, state_dot, u):
        allocate(settings.inverse, given.tau_cmd, given.u_min, given.u_max, u)


MOST_THRUSTERS = 16
"""The solver's memory is of this size."""
_SMALL = 1e-6
_ROUNDS = 10 * MOST_THRUSTERS
_Weights = Annotated[tuple[Annotated[Number, within(1e-3, 1e3, "")], ...], of_length(6)]


@dataclasses.dataclass(frozen=True)
class Constrained(Actuation):
    """The nearest wrench within the thrusters' limits, by an active-set method."""

    weights: _Weights = setting((1.0, 1.0, 1.0, 5.0, 5.0, 5.0), "1, 1/m", "weight of each axis of the wrench, W")

    name = "constrained"
    records_loss: ClassVar[bool] = True
    memory: ClassVar[Mapping[str, Any]] = {"L": MOST_THRUSTERS**2, "solved": 1, "solved_tau": 6} | dict.fromkeys(
        ("wanted", "trial", "fixed", "solution"), MOST_THRUSTERS
    )

    def inverse(self, B: np.ndarray) -> np.ndarray:
        return pseudoinverse(B, rows=np.array(self.weights))

    def constants(self, setup: Any) -> Mapping[str, Any]:
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
            nearest(settings.H, settings.linear, given.tau_cmd, given.u_min, given.u_max, state, u)
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
    u[:] = memory.solution[: len(u)]
    return True


@kernel
def keep(tau_cmd, memory, u):
    """Keep a command and its solution."""
    memory.solved[0] = 1.0
    memory.solved_tau[:], memory.solution[: len(u)] = tau_cmd, u


@kernel
def nearest(H, linear, tau_cmd, u_min, u_max, memory, u):
    """Improve u, which is within its limits, to the solution of the bounded quadratic problem."""
    n, wanted, fixed = u.shape[0], memory.wanted, memory.fixed
    for k in range(n):
        wanted[k] = 0.0
        for i in range(6):
            wanted[k] += linear[k, i] * tau_cmd[i]
        fixed[k] = 0.0
        if u[k] <= u_min[k]:
            fixed[k] = -1.0
        elif u[k] >= u_max[k]:
            fixed[k] = 1.0
    for _ in range(_ROUNDS):
        solve_free(H, wanted, fixed, memory.L, memory.trial, u)
        if move(memory.trial, u_min, u_max, fixed, u) and not release(H, wanted, u_min, u_max, fixed, u):
            break


@kernel
def solve_free(H, wanted, fixed, L, trial, u):
    """Set trial to the minimum over the free thrusters, with the others at u, by Cholesky's method."""
    n = u.shape[0]
    for i in range(n):
        total = u[i]
        if fixed[i] == 0.0:
            total = wanted[i]
            for j in range(n):
                if fixed[j] != 0.0:
                    total -= H[i, j] * u[j]
        for j in range(i + 1):
            entry = 1.0 if i == j else 0.0
            if fixed[i] == 0.0 and fixed[j] == 0.0:
                entry = H[i, j]
            for k in range(j):
                entry -= L[i * MOST_THRUSTERS + k] * L[j * MOST_THRUSTERS + k]
            L[i * MOST_THRUSTERS + j] = math.sqrt(entry) if i == j else entry / L[j * MOST_THRUSTERS + j]
        for j in range(i):
            total -= L[i * MOST_THRUSTERS + j] * trial[j]
        trial[i] = total / L[i * MOST_THRUSTERS + i]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            trial[i] -= L[j * MOST_THRUSTERS + i] * trial[j]
        trial[i] /= L[i * MOST_THRUSTERS + i]


@kernel
def move(trial, u_min, u_max, fixed, u) -> bool:
    """Move u towards trial up to the first limit, and hold that thruster there. Returns whether u arrives at trial."""
    part, first = 1.0, -1
    for k in range(u.shape[0]):
        if fixed[k] == 0.0:
            limit = u_max[k] if trial[k] > u[k] else u_min[k]
            if (trial[k] > limit and trial[k] > u[k]) or (trial[k] < limit and trial[k] < u[k]):
                allowed = (limit - u[k]) / (trial[k] - u[k])
                if allowed < part:
                    part = allowed
                    first = k
    for k in range(u.shape[0]):
        if fixed[k] == 0.0:
            u[k] = trial[k] if first < 0 else u[k] + part * (trial[k] - u[k])
    if first >= 0:
        up = trial[first] > u[first]
        u[first] = u_max[first] if up else u_min[first]
        fixed[first] = 1.0 if up else -1.0
    return first < 0


@kernel
def release(H, wanted, u_min, u_max, fixed, u) -> bool:
    """Free the thruster whose limit costs most. Returns whether there is one."""
    worst, most = -1, 1e-12
    for k in range(u.shape[0]):
        if fixed[k] != 0.0 and u_min[k] < u_max[k]:
            downhill = wanted[k]  # minus the gradient
            for j in range(u.shape[0]):
                downhill -= H[k, j] * u[j]
            gain = -fixed[k] * downhill
            if gain > most:
                most = gain
                worst = k
    if worst >= 0:
        fixed[worst] = 0.0
    return worst >= 0
