r"""Parallel force/position control: the integral of the force error dominates the position error at rest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...physics.kernels import kernel
from ...quantities import NonNegative
from ...stages.setup import SetupLike
from ..base import Controller, SteadyState, gain
from .terms import within

_LEFT = 1e-6
"""Force error from which the integral is at its limit at rest [N]."""


@kernel
def add_force_integral(gains, state, signals, state_dot, tau_cmd):
    """Add n xi to tau_cmd (6,) [N, N m], with xi within its limit, and set its rate."""
    F_d, tau_c = signals.F_d, signals.tau_contact_m_B
    size = math.sqrt(F_d[:3] @ F_d[:3])
    state.xi[:] = within(state.xi, gains.limit)
    state_dot.xi[:] = 0.0
    if size > 0.0:
        n = F_d[:3] / size
        state_dot.xi[0] = (gains.k_i * n * (tau_c[:3] - F_d[:3])).sum()
        tau_cmd[:3] += n * state.xi[0]


@dataclass(frozen=True)
class Parallel(Controller):
    r"""Parallel force/position control: PD control of the pose and PI control of the force along F_d.

    .. math::

        \tau = \tau_{nom} + n \xi, \qquad \dot\xi = k_i n^\top (\tau_c - F_d), \quad |\xi| \le limit, \qquad
        n = F_d / |F_d|, \text{ forces only}

    tau_nom is eq. (23) with the generalised impedance (7): its K_d and D_d are the PD part, its K_f is the proportional
    part of the PI part. The integral makes the force dominate: at rest n^T tau_c = n^T F_d. Along the other axes, and
    for F_d = 0, the law is impedance control. After Chiaverini and Sciavicco (1993, The parallel approach to
    force/position control of robotic manipulators).
    """

    k_i: NonNegative = gain(1.0, "1/s", "rate of the integral of the force error")
    limit: NonNegative = gain(4.0, "N", "limit of the integral term xi")

    name = "parallel"
    states: ClassVar = {"xi": 1}
    units: ClassVar = {"xi": "N"}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.tau_nom
        add_force_integral(gains, state, signals, state_dot, tau_cmd)

    def at_rest(self, setup: SetupLike) -> SteadyState | str:
        """n^T tau_c = n^T F_d, unless the integral is at its limit; the static balance along the other directions."""
        from ..theory import residuals
        from ..theory.balance import static_balance
        from ..theory.stability import Stability
        from ..theory.terms import Integral

        F_d = np.array([*setup.scenario.impedance.at_end[1][:3], 0.0, 0.0, 0.0])
        size = float(np.linalg.norm(F_d))
        n = F_d / size if size else F_d
        M_hat, M_d, wrench = setup.design.M_hat, setup.design.M_d, setup.design.M_hat @ setup.design.M_d_inv

        integral = Integral(self.limit if self.k_i else 0.0)

        def residual(balance: Any, x: Any) -> np.ndarray:
            missing = M_hat @ (balance.desired_acceleration(x) - balance.unmodelled(x))  # tau_cmd - tau_nom
            xi = n @ missing
            left = missing - n * xi + n * integral.left(xi, self.k_i * (n @ (balance.measurement(x).tau_c - F_d)))
            return M_d @ np.linalg.solve(M_hat, left)

        def held(state: SteadyState) -> Any:  # at a limit the integral does not answer to small motions
            left = float(n @ (state.contacts.tau_c - F_d))
            return (("xi", (2.0 * np.sign(left) * self.limit if abs(left) > _LEFT else 0.0,)),)

        compiled = residuals.parallel(self.k_i, integral.limit, n, F_d)
        rest = static_balance(setup, 0.0, residual, integral, wrench=wrench, compiled=compiled)
        return Stability(setup, held=held).checked(rest)

    def notes(self, setup: SetupLike) -> Iterator[str]:
        """Warnings if no force is asked for along the wall's normal, or the sampled law oscillates."""
        from ..theory.stability import Stability

        asked = -float(setup.design.normal[:3] @ setup.scenario.impedance.at_end[1][:3])
        if asked <= 0.0 and self.k_i > 0.0:
            yield (
                f"{self.label()} asks for no push on the wall: impedance.F_d has {-asked:g} N along the wall's normal; "
                "a push of 1.5 N on a wall in front is impedance.F_d = [-1.5, 0, 0, 0, 0, 0]"
            )
        yield from Stability(setup).notes(self.label())
