"""Ideal allocation: the pseudoinverse within the thrusters' limits."""

from __future__ import annotations

from dataclasses import dataclass

from ..physics.kernels import kernel
from .base import Actuation


@kernel
def pseudo_inverse(given, u):
    """Set u = B^+ tau_cmd (eq. 25) within the thrusters' limits. A stage that calls it first changes only the rest."""
    B_pinv, u_min, u_max = given.B_pinv, given.u_min, given.u_max
    a, b, c = given.tau_cmd[0], given.tau_cmd[1], given.tau_cmd[2]
    d, e, f = given.tau_cmd[3], given.tau_cmd[4], given.tau_cmd[5]
    for k in range(u.shape[0]):
        total = (B_pinv[k, 0] * a + B_pinv[k, 1] * b) + (B_pinv[k, 2] * c + B_pinv[k, 3] * d)
        total += B_pinv[k, 4] * e + B_pinv[k, 5] * f
        u[k] = min(u_max[k], max(u_min[k], total))


@dataclass(frozen=True)
class PseudoInverse(Actuation):
    """Ideal thrusters: they produce the thrust of the pseudoinverse at once, within their limits."""

    name = "pseudo_inverse"

    @staticmethod
    def step(settings, state, given, state_dot, u):
        pseudo_inverse(given, u)
