r"""The natural inertia as the desired one, ``impedance.M_d = "natural"``: classical impedance control without a force.

With M_d = M_hat the contact force cancels in the nominal control (23), as in the paper's eq. (4) with Lambda_des =
Lambda:

.. math:: \tau_{nom} = \hat M \dot\nu_d + \hat C \nu + \hat D \nu + \hat g - K_d \tilde\eta - D_d \tilde\nu
    + (K_f - I) \tau_c - K_f F_d.

M_hat of a tool, Lambda_hat, changes with the posture of the arm, so the damping has to change with it. Ott (2008), sec.
3.3: with M_d = L L^T and the eigenvectors V of :math:`L^{-1} K_d L^{-T} = V \operatorname{diag}(k) V^\top`,

.. math:: D_d = 2 \zeta\, (L V) \operatorname{diag}(\sqrt{k})\, (L V)^\top,

gives every mode of the frozen system the damping ratio zeta. It is 2 zeta times the geometric mean of M_d and K_d.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..physics.kernels import kernel
from ..physics.linear_algebra import cholesky, forward, symmetric_eigen
from ..stages.base import Room, Stage
from ..stages.signals import IMPEDANCE, TASK_GIVEN


@dataclass(frozen=True)
class NaturalInertia(Stage):
    """M_d = M_hat of every control instant, with D_d of Ott's design unless it is given."""

    name = "natural_inertia"
    room: ClassVar[Room] = Room("control", "natural", lambda thrusters: TASK_GIVEN, IMPEDANCE[:2])

    def constants(self, setup: Any) -> Mapping[str, Any]:
        """Damping ratio; number of control instants from one D_d to the next, or 0 if D_d is given."""
        scenario = setup.scenario
        impedance = scenario.impedance
        every = max(1, round(impedance.damping_period / scenario.control_period)) if impedance.D_d is None else 0
        return {"damping_ratio": impedance.damping_ratio, "every": every}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        every = int(settings.every)
        out.M_d[:] = given.M_hat
        if every > 0 and given.instant % every == 0:
            natural_damping(given.M_hat, given.K_d, settings.damping_ratio, out.D_d)


@kernel
def natural_damping(M, K_d, damping_ratio, D_d):
    """Set D_d (6, 6) to Ott's design for M (6, 6) and K_d (6,), as :func:`.design.ott_damping` does."""
    L, Y, A, V = M.flatten(), np.diag(np.sqrt(K_d)).flatten(), np.zeros(36), np.zeros(36)
    cholesky(L, 6, L)
    forward(L, 6, Y, 6)  # Y Y^T = L^-1 K_d L^-T
    for i in range(6):
        for j in range(i, 6):
            for k in range(i + 1):  # Y is a lower triangle
                A[6 * i + j] += Y[6 * i + k] * Y[6 * j + k]
    symmetric_eigen(A, 6, V)
    D_d[:] = 0.0
    for k in range(6):
        mode = np.zeros(6)  # L V
        for i in range(6):
            mode[i] = V[6 * k + i] / L[7 * i]  # L has the reciprocals of its diagonal
            for j in range(i):
                mode[i] += L[6 * i + j] * V[6 * k + j]
        D_d += np.outer(2.0 * damping_ratio * math.sqrt(max(A[7 * k], 0.0)) * mode, mode)
