"""A stage of each room, as a user writes it."""

import math
from dataclasses import dataclass
from typing import ClassVar

from uvms_mj import Controller, gain
from uvms_mj.actuation import Actuation, pseudo_inverse
from uvms_mj.guidance import Guidance, station_keep
from uvms_mj.navigation import Navigation, perfect
from uvms_mj.physics.random import standard_normal
from uvms_mj.stages.base import setting


@dataclass(frozen=True)
class Noisy(Navigation):
    sigma: float = setting(1e-3, "m", "noise")
    states: ClassVar = {"drift": 3}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        perfect(given, out)
        for i in range(3):
            out.p_WB[i] += state.drift[i] + settings.sigma * standard_normal(given.key, given.instant, i)
            state_dot.drift[i] = 0.01 * standard_normal(given.key, given.instant, 3 + i)


@dataclass(frozen=True)
class Circle(Guidance):
    radius: float = setting(0.2, "m", "radius")
    omega: float = setting(0.5, "rad/s", "rate")
    states: ClassVar = {"phase": 1}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        station_keep(settings, given, out)
        state_dot.phase[0] = settings.omega
        out.p_d[0] = settings.radius * math.sin(state.phase[0])
        out.p_d[1] = settings.radius * (1.0 - math.cos(state.phase[0]))


@dataclass(frozen=True)
class Lag(Actuation):
    tau: float = setting(0.02, "s", "time constant")
    flag: bool = setting(True, "-", "flag")
    states: ClassVar = {"thrust": "thrusters", "u_wanted": "thrusters"}

    @staticmethod
    def step(settings, state, given, state_dot, u):
        pseudo_inverse(given, u)
        for k in range(u.shape[0]):
            state.u_wanted[k] = u[k]
            state_dot.thrust[k] = (u[k] - state.thrust[k]) / settings.tau
            u[k] = state.thrust[k]


@dataclass(frozen=True)
class Pid(Controller):
    k: float = gain(200.0, "-", "k")
    uses_task: ClassVar = False
    states: ClassVar = {"xi": 6}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            state_dot.xi[i] = signals.eta_e[i]
            tau_cmd[i] = (
                signals.g_hat[i] - gains.k * signals.eta_e[i] - 0.5 * gains.k * signals.nu_e[i] - 20.0 * state.xi[i]
            )
