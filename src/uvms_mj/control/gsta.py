"""The generalised super-twisting algorithm."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from . import super_twisting
from .base import Controller, NonNegative, gain


@dataclass(frozen=True)
class Gsta(Controller):
    """Super-twisting impedance control (22)-(24): a continuous input that rejects disturbances of bounded rate."""

    k_1: NonNegative = gain(5.0, "m^(1/2)/s^(3/2)", "gain of phi_1, eq. (24a)")
    k_2: NonNegative = gain(10.0, "m/s^3", "gain of phi_2, eq. (24b)")
    beta: NonNegative = gain(5.0, "(s/m)^(1/2)", "linear part of phi_1 and phi_2; 0 gives the standard super-twisting")
    nominal: bool = gain(True, "-", "false: only the GSTA term, without the nominal control (23) and F_2 A F_2^-1 s")

    name = "gsta"
    states: ClassVar = {"z": 6}
    units: ClassVar = {"z": "m/s^2, rad/s^2"}
    at_rest = super_twisting.at_rest
    notes = super_twisting.notes
    certificate = super_twisting.certificate

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            tau_cmd[i] = signals.tau_nom[i] if gains.nominal else 0.0
        for j in range(6):
            s = signals.s[j]
            sgn = np.sign(s)
            root = math.sqrt(abs(s)) * sgn
            phi_1 = root + gains.beta * s
            phi_2 = 0.5 * sgn + 1.5 * gains.beta * root + gains.beta * gains.beta * s
            a = -gains.k_1 * phi_1 + state.z[j]  # eq. (24a)
            state_dot.z[j] = -gains.k_2 * phi_2  # eq. (24b)
            if gains.nominal:
                a -= signals.A[j] * s  # eq. (22); F_2 A F_2^-1 = A for diagonal matrices
            for i in range(6):
                tau_cmd[i] += signals.M_hat[i, j] * a
