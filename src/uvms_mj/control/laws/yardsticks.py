r"""Admittance and parallel control that are told the truth: yardsticks beside ``ideal``, eq. (13).

Each has the structure of a law, and in place of the law's estimates the true model, current and disturbance. It shows
whether the physics of a scenario or the law's ignorance sets the limit of the structure.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from ...physics.kernels import kernel
from ...stages.setup import SetupLike
from .admittance import Admittance, led_acceleration
from .parallel import Parallel, add_force_integral
from .terms import add_product


@kernel
def add_true_wrench(signals, a, tau_cmd):
    """Add M (a - dot nu_c) + C(nu_r) nu_r + D(nu_r) nu_r + g - tau_dist to tau_cmd (6,) [N, N m]: the wrench that gives
    the acceleration a (6,) to a vehicle that touches nothing."""
    tau_cmd += signals.C_nu_r + signals.D_nu_r + signals.g_eta - signals.tau_dist
    add_product(signals.M, a - signals.nu_c_dot, tau_cmd)


@dataclass(frozen=True)
class IdealAdmittance(Admittance):
    r"""Admittance control that is told the truth.

    .. math::

        \tau = M (\dot\nu_d + \dot\nu_a - k_v (\tilde\nu - \nu_a) - k_p (\tilde\eta - \eta_a) - \xi_a - \dot\nu_c)
            + C(\nu_r) \nu_r + D(\nu_r) \nu_r + g - \tau_{dist}

    with the offset eta_a, nu_a and the integral xi_a of :class:`.admittance.Admittance`.
    """

    name = "ideal_admittance"
    uses_truth: ClassVar[bool] = True

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = 0.0
        add_true_wrench(signals, led_acceleration(gains, state, signals, state_dot), tau_cmd)

    def at_rest(self, setup: SetupLike) -> str:
        return "no closed form is known for this yardstick"

    def notes(self, setup: SetupLike) -> Iterator[str]:
        """None: no theory of its loop is known."""
        return iter(())


@dataclass(frozen=True)
class IdealParallel(Parallel):
    r"""Parallel force/position control that is told the truth: eq. (13) with the integral of the force error.

    .. math::

        \tau = M (\dot\nu_d - w - \dot\nu_c) + C(\nu_r) \nu_r + D(\nu_r) \nu_r + g - \tau_{dist} - \tau_c + n \xi

    with n and xi of :class:`.parallel.Parallel`.
    """

    name = "ideal_parallel"
    uses_truth: ClassVar[bool] = True

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = -signals.tau_contact_m_B
        add_true_wrench(signals, signals.nu_d_dot - signals.w, tau_cmd)
        add_force_integral(gains, state, signals, state_dot, tau_cmd)

    def at_rest(self, setup: SetupLike) -> str:
        return "no closed form is known for this yardstick"

    def notes(self, setup: SetupLike) -> Iterator[str]:
        """None: no theory of its loop is known."""
        return iter(())
