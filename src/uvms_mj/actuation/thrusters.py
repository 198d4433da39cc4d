"""The contract of a thruster model, a stage between the allocation and the vehicle, and ideal thrusters."""

from __future__ import annotations  # so that help(Thrusters) shows short type names

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..errors import Fault, InputError
from ..quantities import Step
from ..stages.base import Room, Stage, shared
from ..stages.signals import CLOCK, TRUE, Signal, thruster_signal, thrusters_given


@dataclasses.dataclass(frozen=True)
class StaticThrust:
    """The thrust of thrusters under a constant command.

    Attributes:
        thrust: thrust (n,) for commanded thrusts (n,) [N].
        gain: (n,) thrust over command, or None if they are not proportional.
        start: thrust next to zero in reverse and forwards, where it jumps [N].
        error: the error of the thrust that only a law that integrates compensates, as a text; empty if there is none.
    """

    thrust: Callable[[np.ndarray], np.ndarray]
    gain: np.ndarray | None
    start: tuple[float, float] = (0.0, 0.0)
    error: str = ""


@dataclasses.dataclass(frozen=True)
class Thrusters(Stage):
    """Base class of all thruster models. ``given`` has the signals of :func:`uvms_mj.stages.signals.thrusters_given`,
    and u (n,) is the thrust of each thruster [N]. The limits of the vehicle's file act on u afterwards."""

    period: Step | None = shared(None, "s", "period, a multiple of the time step; default: every step")

    every_step: ClassVar[bool] = True
    room: ClassVar[Room] = Room(
        name="actuation",
        table="thrusters",
        given=thrusters_given,
        out=(thruster_signal(0),),
        noun="thruster model",
        arguments=("settings", "state", "given", "state_dot", "u"),
    )

    @staticmethod
    def step(settings, state, given, state_dot, u):
        """Set u (n,) and state_dot from settings, state and given."""
        raise NotImplementedError

    def command_limits(self, setup: Any) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest thrust (n,) that the allocation may command [N]."""
        return setup.vehicle.u_min, setup.vehicle.u_max

    def at_rest(self, setup: Any) -> StaticThrust | str:
        """The thrust for a constant command, or the reason why it is not known."""
        return "closed forms are known for the shipped thruster models only"

    def mean_delay(self) -> float:
        """Delay of slow changes of the thrust behind the command [s]."""
        return 0.0

    def lag_model(self, period: float) -> Mapping[str, np.ndarray] | None:
        """The lag of a small change of the thrust behind the command over a period [s], as
        :func:`uvms_mj.actuation.lag.discrete` gives it; None for no other one than :meth:`mean_delay`."""
        return None


@dataclasses.dataclass(frozen=True)
class IdealThrusters(Thrusters):
    """Ideal thrusters: they produce the commanded thrust at once."""

    name = "ideal"
    runs: ClassVar[bool] = False

    def check_settings(self) -> None:
        super().check_settings()
        if self.period is not None:
            raise InputError([Fault("thrusters.period", "ideal thrusters have no period; choose thrusters.name")])

    def at_rest(self, setup: Any) -> StaticThrust:
        return StaticThrust(lambda u_cmd: u_cmd, np.ones(len(setup.vehicle.thrusters)))


@dataclass(frozen=True)
class Inflow(Stage):
    """The speed of advance of each thruster, a_k^T (v_r + omega x r_k) = B_k^T nu_r, for its axis a_k and its column
    B_k = [a_k; r_k x a_k] of B. It is zero for a pair that produces a pure moment."""

    name = "inflow"
    room: ClassVar[Room] = Room(
        "actuation", "inflow", lambda thrusters: CLOCK + TRUE, (Signal("inflow", (0,), "m/s", "-", "speed of advance"),)
    )

    def constants(self, setup: Any) -> Mapping[str, Any]:
        B = setup.vehicle.B
        return {"columns": (B * B[:3].any(axis=0)).T}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        R, nu, v_c, columns = given.R_WB, given.nu, given.v_c_W, settings.columns
        u = nu[0] - (R[0, 0] * v_c[0] + R[1, 0] * v_c[1] + R[2, 0] * v_c[2])
        v = nu[1] - (R[0, 1] * v_c[0] + R[1, 1] * v_c[1] + R[2, 1] * v_c[2])
        w = nu[2] - (R[0, 2] * v_c[0] + R[1, 2] * v_c[1] + R[2, 2] * v_c[2])
        p, q, r = nu[3], nu[4], nu[5]
        for k in range(out.shape[0]):
            linear = columns[k, 0] * u + columns[k, 1] * v + columns[k, 2] * w
            out[k] = linear + (columns[k, 3] * p + columns[k, 4] * q + columns[k, 5] * r)
