"""The contract of a thruster model, a stage between the allocation and the vehicle; ideal thrusters, static curves
and lags.
"""

from __future__ import annotations  # so that help(Thrusters) shows short type names

import dataclasses
import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..errors import Fault, InputError
from ..physics.kernels import kernel
from ..quantities import Step
from ..stages.base import Room, Stage, shared
from ..stages.setup import ScenarioLike, SetupLike
from ..stages.signals import CLOCK, TRUE, Signal, thruster_signal, thrusters_given


@dataclass(frozen=True, eq=False)
class Curve:
    """Points of a thrust that does not fall with the command, linear between them and constant beyond its ends.

    Attributes:
        command: (m,) in us of a pulse width, or in N.
        thrust: (m,) [N]; it passes through zero.
        neutral: command without thrust.
    """

    command: np.ndarray
    thrust: np.ndarray
    neutral: float

    @classmethod
    def of(cls, command: Sequence[float], thrust: Sequence[float]) -> Curve:
        """The curve through points. Neutral is the middle of the dead band, or the command of thrust zero."""
        x, f = np.array(command, float), np.array(thrust, float)
        dead = x[f == 0.0]
        return cls(x, f, float(0.5 * (dead[0] + dead[-1])) if len(dead) else float(np.interp(0.0, f, x)))

    @functools.lru_cache(maxsize=8)  # noqa: B019  # keeps at most eight curves alive
    def inverse(self) -> tuple[np.ndarray, np.ndarray]:
        """Thrust and command (m,) of the points of the inverse. It jumps over a dead band, where thrust zero is
        repeated. Of a curve without reverse thrust, a negative thrust has the command of zero, and likewise forwards.
        """
        thrust, command = self.thrust.copy(), self.command.copy()
        dead = np.flatnonzero(thrust == 0.0)
        if len(dead) and dead[0] == 0:
            thrust[dead[:-1]], command[dead[:-1]] = np.arange(1.0 - len(dead), 0.0), command[dead[-1]]
        elif len(dead) and dead[-1] == len(thrust) - 1:
            thrust[dead[1:]], command[dead[1:]] = np.arange(1.0, len(dead)), command[dead[0]]
        thrust.setflags(write=False)
        command.setflags(write=False)
        return thrust, command

    def same_as(self, other: Curve) -> bool:
        """Whether both have the same points."""
        return np.array_equal(self.command, other.command) and np.array_equal(self.thrust, other.thrust)

    def at(self, command: np.ndarray) -> np.ndarray:
        """Thrust (n,) for commands (n,)."""
        return np.interp(command, self.command, self.thrust)

    def command_for(self, thrust: np.ndarray) -> np.ndarray:
        """Command (n,) for thrusts (n,), neutral for zero."""
        return np.where(thrust == 0.0, self.neutral, np.interp(thrust, *self.inverse()))


def wrong_points(command: Sequence[float], thrust: Sequence[float], inverted: bool) -> Iterator[tuple[str, str]]:
    """The settings of a curve that are wrong, each with the reason."""
    if len(command) != len(thrust):
        yield (
            "curve_thrust",
            f"has {len(thrust)} values, and curve_command has {len(command)}; they are points of a curve",
        )
        return
    if len(command) == 1:
        yield "curve_command", "has one point; a curve has at least two"
        return
    for i, (x, x_next, f, f_next) in enumerate(zip(command, command[1:], thrust, thrust[1:], strict=False)):
        if not x < x_next:
            yield f"curve_command[{i + 1}]", f"{x_next:g} follows {x:g}: the commands must increase"
        if f > f_next:
            yield f"curve_thrust[{i + 1}]", f"{f_next:g} N follows {f:g} N: the thrust must not fall"
        elif inverted and f == f_next != 0.0:
            yield f"curve_thrust[{i + 1}]", f"{f:g} N twice: a curve with an inverse is flat at zero only"
    if thrust and not (thrust[0] <= 0.0 <= thrust[-1] and thrust[0] < thrust[-1]):
        yield "curve_thrust", f"is from {thrust[0]:g} to {thrust[-1]:g} N: it must pass through zero"


@kernel
def interval(points, x, near) -> int:
    """Index i of the interval with points[i] <= x < points[i + 1], searched from ``near``; beyond the ends, the first
    or the last one. Commands change little from instant to instant, so the search is short."""
    i, last = near, points.shape[0] - 2
    for _ in range(last):
        if i < last and x >= points[i + 1]:
            i += 1
        else:
            break
    for _ in range(last):
        if i > 0 and x < points[i]:
            i -= 1
        else:
            break
    return i


@kernel
def interpolated(points, values, i, x) -> float:
    """The value at x in the interval i; outside, the value of the interval's nearer end."""
    at = min(points[i + 1], max(points[i], x))
    return values[i] + (at - points[i]) * ((values[i + 1] - values[i]) / (points[i + 1] - points[i]))


THIRD_ORDER = ((6136.0, 108700.0), (1.0, 89.0, 9258.0, 108700.0))
"""Numerator and denominator, from the highest power of s, of the lag that von Benzon et al. (2022) identified on a
T200: it reaches 63 % of a step after 20 ms and 95 % after 32 ms."""
ORDER = 3


def transfer_function(lag: str, time_constant: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Numerator and denominator of a lag by its name, with the time constant of a first-order lag [s]."""
    return THIRD_ORDER if lag == "third_order" else ((1.0,), (time_constant, 1.0))


@functools.lru_cache(maxsize=8)
def discrete(lag: str, time_constant: float, period: float) -> dict[str, np.ndarray]:
    """The matrices of x' = Phi x + Gamma f, y = C x for a command f that is held over ``period`` [s].

    The states have the controllable form. The result is exact: Phi and Gamma are blocks of a matrix
    exponential. Lags of a lower order than three have zeros in their last rows and columns.
    """
    from scipy.linalg import expm  # imported where it is used, because it takes long

    numerator, denominator = (np.array(each) for each in transfer_function(lag, time_constant))
    n = len(denominator) - 1
    A, C = np.eye(n, k=-1), np.zeros(ORDER)
    A[0] = -denominator[1:] / denominator[0]
    C[n - len(numerator) : n] = numerator / denominator[-1]
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[0, n] = A, denominator[-1] / denominator[0]
    step = expm(block * period)
    Phi, Gamma = np.zeros((ORDER, ORDER)), np.zeros(ORDER)
    Phi[:n, :n], Gamma[:n] = step[:n, :n], step[:n, n]
    for matrix in (Phi, Gamma, C):
        matrix.setflags(write=False)
    return {"Phi": Phi, "Gamma": Gamma, "C": C}


def mean_delay(lag: str, time_constant: float) -> float:
    """Delay of slow changes [s]: minus the derivative at s = 0 of a transfer function whose gain is 1 there."""
    numerator, denominator = transfer_function(lag, time_constant)
    return denominator[-2] / denominator[-1] - (numerator[-2] / numerator[-1] if len(numerator) > 1 else 0.0)


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

    def command_limits(self, setup: SetupLike) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest thrust (n,) that the allocation may command [N]."""
        return setup.vehicle.u_min, setup.vehicle.u_max

    def curves(self) -> tuple[Curve | None, Curve | None]:
        """The true static curve and the curve that the control system inverts, or None without one."""
        return None, None

    @property
    def takes_pulses(self) -> bool:
        """Whether the memory ``command`` is a pulse width [us], which a run then records as pwm."""
        return False

    def at_rest(self, setup: SetupLike) -> StaticThrust | str:
        """The thrust for a constant command, or the reason why it is not known."""
        return "closed forms are known for the shipped thruster models only"

    def mean_delay(self) -> float:
        """Delay of slow changes of the thrust behind the command [s]."""
        return 0.0

    def lag_model(self, period: float) -> Mapping[str, np.ndarray] | None:
        """The lag of a small change of the thrust behind the command over a period [s], as
        :func:`uvms_mj.actuation.thrusters.discrete` gives it; None for no other one than :meth:`mean_delay`."""
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

    def at_rest(self, setup: SetupLike) -> StaticThrust:
        return StaticThrust(lambda u_cmd: u_cmd, np.ones(len(setup.vehicle.thrusters)))


@dataclass(frozen=True)
class Inflow(Stage):
    """The speed of advance of each thruster, a_k^T (v_r + omega x r_k) = B_k^T nu_r, for its axis a_k and its column
    B_k = [a_k; r_k x a_k] of B. It is zero for a pair that produces a pure moment."""

    name = "inflow"
    room: ClassVar[Room] = Room(
        "actuation", "inflow", lambda thrusters: CLOCK + TRUE, (Signal("inflow", (0,), "m/s", "-", "speed of advance"),)
    )

    def period_in(self, scenario: ScenarioLike) -> float:
        """The period of the thrusters [s]."""
        return scenario.thrusters.period_in(scenario)

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        B = setup.vehicle.B
        return {"columns": (B * B[:3].any(axis=0)).T}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        columns, v_r, omega = settings.columns, given.nu[:3] - given.R_WB.T @ given.v_c_W, given.nu[3:]
        out[:] = columns[:, :3] @ v_r + columns[:, 3:] @ omega
