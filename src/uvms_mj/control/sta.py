"""The standard super-twisting algorithm."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from . import super_twisting
from .base import Controller, NonNegative, gain


@dataclass(frozen=True)
class Sta(Controller):
    """Standard super-twisting impedance control: (22)-(24) with beta = 0, without the linear terms of the GSTA."""

    k_1: NonNegative = gain(5.0, "m^(1/2)/s^(3/2)", "gain of phi_1 = |s|^(1/2) sgn(s)")
    k_2: NonNegative = gain(10.0, "m/s^3", "gain of phi_2 = sgn(s)/2")

    name = "sta"
    states: ClassVar = {"z": 6}
    units: ClassVar = {"z": "m/s^2, rad/s^2"}
    at_rest = super_twisting.at_rest
    notes = super_twisting.notes
    certificate = super_twisting.certificate

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            tau_cmd[i] = signals.tau_nom[i]
        for j in range(6):
            s = signals.s[j]
            a = -gains.k_1 * math.sqrt(abs(s)) * np.sign(s) + state.z[j] - signals.A[j] * s  # eqs. (22), (24a)
            state_dot.z[j] = -0.5 * gains.k_2 * np.sign(s)  # eq. (24b)
            for i in range(6):
                tau_cmd[i] += signals.M_hat[i, j] * a
