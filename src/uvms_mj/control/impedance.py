"""Impedance control: the nominal control alone."""

from dataclasses import dataclass

from .base import Controller


@dataclass(frozen=True)
class Impedance(Controller):
    """Impedance control (23): exact for a perfect model without current and disturbance."""

    name = "impedance"

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            tau_cmd[i] = signals.tau_nom[i]  # eq. (23)
