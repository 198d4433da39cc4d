"""Static curves of thrusters: thrust over command, and the inverse that a control system uses."""

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..physics.kernels import kernel


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
    def of(cls, command: Sequence[float], thrust: Sequence[float]) -> "Curve":
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

    def same_as(self, other: "Curve") -> bool:
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
    """The value at x in the interval i, and that of the interval's nearer end if x is outside."""
    at = min(points[i + 1], max(points[i], x))
    return values[i] + (at - points[i]) * ((values[i + 1] - values[i]) / (points[i + 1] - points[i]))
