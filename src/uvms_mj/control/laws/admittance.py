r"""Admittance control: the measured force moves the reference of a stiff pose controller."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...errors import Fault
from ...physics.kernels import kernel
from ...quantities import NonNegative, Positive
from ...stages.setup import SetupLike
from ..base import Controller, SteadyState, gain
from .terms import add_product


@kernel
def led_acceleration(gains, state, signals, state_dot):
    """The acceleration (6,) that the inner loop demands [m/s^2, rad/s^2]; sets state_dot, which moves the reference."""
    eta_a, nu_a, nu_a_dot = state.eta_a, state.nu_a, state_dot.nu_a
    force = signals.K_f * (signals.tau_contact_m_B - signals.F_d) - signals.K_d * eta_a
    add_product(-signals.D_d, nu_a, force)
    nu_a_dot[:] = 0.0
    add_product(gains.M_d_inv, force, nu_a_dot)
    error = signals.eta_e - eta_a
    state_dot.eta_a[:3], state_dot.eta_a[3:] = nu_a[:3], 0.5 * nu_a[3:]  # eq. (17) for small angles
    state_dot.xi_a[:] = gains.k_i * error
    return signals.nu_d_dot + nu_a_dot - gains.k_v * (signals.nu_e - nu_a) - gains.k_p * error - state.xi_a


@dataclass(frozen=True)
class Admittance(Controller):
    r"""Admittance control, or position-based impedance control: the force moves the reference of a pose controller.

    .. math::

        M_d \dot\nu_a + D_d \nu_a + K_d \eta_a &= K_f (\tau_c - F_d), \qquad
        \dot\eta_a = (v_a, \tfrac12 \omega_a)

        \tau &= \hat M (\dot\nu_d + \dot\nu_a - k_v (\tilde\nu - \nu_a) - k_p (\tilde\eta - \eta_a) - \xi_a)
            + \hat C \nu + \hat D \nu + \hat g, \qquad \dot\xi_a = k_i (\tilde\eta - \eta_a)

    eta_a and nu_a are the offset that the force causes, in B. The inner loop does not use the force, so the wall acts
    on both impedances, the desired one and the inner loop's, in series. After Siciliano, Sciavicco, Villani and
    Oriolo (2009, Robotics: Modelling, Planning and Control, ch. 9).
    """

    k_p: Positive = gain(300.0, "1/s^2", "stiffness of the inner loop over M_hat")
    k_v: NonNegative = gain(30.0, "1/s", "damping of the inner loop over M_hat")
    k_i: NonNegative = gain(1000.0, "1/s^3", "integral gain of the inner loop over M_hat; 0: PD")

    name = "admittance"
    uses_task: ClassVar[bool] = False
    states: ClassVar = {"eta_a": 6, "nu_a": 6, "xi_a": 6}
    units: ClassVar = {"eta_a": "m, 1", "nu_a": "m/s, rad/s", "xi_a": "m/s^2, rad/s^2"}

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        return {**super().constants(setup), "M_d_inv": setup.design.M_d_inv}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        a = led_acceleration(gains, state, signals, state_dot)
        tau_cmd[:] = signals.C_hat_nu + signals.D_hat_nu + signals.g_hat
        add_product(signals.M_hat, a, tau_cmd)

    def faults(self, setup: SetupLike) -> Iterator[Fault]:
        """Refuse an inertia that changes: the offset is a state of its own, with a constant M_d."""
        if setup.scenario.impedance.natural:
            why = "changes with the posture; the law admittance needs a constant inertia: six numbers or a 6x6 matrix"
            yield Fault("impedance.M_d", f"{setup.scenario.impedance.M_d!r} {why}")

    def at_rest(self, setup: SetupLike) -> SteadyState | str:
        """With an integral, K_d eta_e = K_f (tau_c - F_d). Without, the stiffness M_hat k_p in series with K_d:
        K_d eta_e - K_f (tau_c - F_d) + K_d (M_hat k_p)^-1 (tau_cmd - g_hat) = 0."""
        from ..theory import residuals
        from ..theory.balance import static_balance
        from ..theory.stability import Stability
        from ..theory.terms import Memory

        design = setup.design
        states = Memory((np.zeros(6), np.zeros(6), np.zeros(6)))
        M_hat_inv, half = np.linalg.inv(design.M_hat), np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])

        def residual(balance: Any, x: Any) -> np.ndarray:
            nu, needed = balance.measurement(x).nu, M_hat_inv @ balance.control_wrench(x)
            demanded = balance.demanded(x) - design.D_d @ nu  # nu_a = 0
            if np.isinf(states.step):
                return demanded if self.k_i else demanded + design.K_d @ (needed + self.k_v * nu) / self.k_p
            eta_e, nu_e = balance.error(x), states.nu_e(x)
            a = acceleration(eta_e, design.K_d @ eta_e - demanded, nu_e + nu) - needed
            return -design.M_d @ a - design.D_d @ nu_e  # the motion has the damping of eq. (7)

        def acceleration(eta_e: np.ndarray, force: np.ndarray, nu_e: np.ndarray) -> np.ndarray:
            (eta_a, nu_a, xi_a), nu_a_dot, h = states.value, np.zeros(6), states.step
            if h:
                before, stiff = nu_a, h * half * design.K_d
                pushed = force - design.K_d @ eta_a + design.M_d @ nu_a / h
                nu_a = np.linalg.solve(design.M_d / h + design.D_d + stiff, pushed)
                eta_a, nu_a_dot = eta_a + h * half * nu_a, (nu_a - before) / h
                xi_a = xi_a + h * self.k_i * (eta_e - eta_a)
            states.next = eta_a, nu_a, xi_a
            a: np.ndarray = nu_a_dot - self.k_v * (nu_e - nu_a) - self.k_p * (eta_e - eta_a) - xi_a
            return a

        wrench = design.M_hat @ design.M_d_inv
        compiled, slope = residuals.admittance(self.k_i, self.k_p, self.k_v), np.inf if self.k_i else 0.0
        rest = static_balance(setup, slope, residual, states, wrench=wrench, compiled=compiled)
        return Stability(setup).checked(rest)

    def notes(self, setup: SetupLike) -> Iterator[str]:
        """Warnings if the sampled law oscillates."""
        from ..theory.stability import Stability

        return Stability(setup).notes(self.label())
