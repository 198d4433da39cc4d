r"""Motion as polynomial segments: position and attitude of a reference, each with its first two time derivatives.

**Piece.** A piece has seven polynomials of degree five in the time since its beginning: the position p in W [m], and
four numbers Q along the attitude, q = Q / \|Q\|. With :math:`\dot Q \bar Q` as a product of quaternions, the angular
velocity in W and its derivative follow exactly from the polynomials:

.. math::

    \omega = \frac{2}{|Q|^2} \mathrm{vec}(\dot Q \bar Q), \qquad
    \dot\omega = \frac{2}{|Q|^2} (\mathrm{vec}(\ddot Q \bar Q) - (Q \cdot \dot Q) \omega).

**Timed poses** are a smooth motion in six degrees of freedom that is at each pose at its time.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import AfterValidator
from pydantic.dataclasses import dataclass as table

from ..errors import Fault, InputError
from ..physics.frames import quat_from_euler_deg, turning
from ..physics.kernels import kernel
from ..quantities import STRICT, Angles, Position, Time
from ..stages.base import setting
from ..stages.setup import ScenarioLike, SetupLike
from .base import Guidance, start_notes

if TYPE_CHECKING:
    from scipy.interpolate import PPoly


MOST_SEGMENTS = 511
"""Segments that fit into the constants of a stage. The search below finds one of 512, the last of which is the end."""
_SEARCH = 9  # steps of a binary search among 512
LARGEST_TURN_DEG = 120.0
"""Largest rotation from a pose to the next. With a larger one Q would come near zero, and the rotation would be
uneven."""


class Followed(Guidance):
    """Base class of the stages whose reference is a motion of :func:`pack`, which their constants are."""

    ending: ClassVar = ("begins", "coefficients")

    def notes(self, setup: SetupLike) -> Iterable[str]:
        return start_notes(self, setup)

    @staticmethod
    def step(settings, state, given, state_dot, out):
        follow(settings.begins, settings.coefficients, given.t, out)


def pose_numbers(positions: Sequence[Any], attitudes_deg: Sequence[Any], keys: Sequence[str]) -> np.ndarray:
    """(n, 7) positions and quaternions of n poses. Successive quaternions have the sign of the shorter rotation. Raises
    InputError if one of them is too large; ``keys`` name the poses after the first."""
    quats = [quat_from_euler_deg(*attitude) for attitude in attitudes_deg]
    for i in range(1, len(quats)):
        quats[i] = -quats[i] if quats[i] @ quats[i - 1] < 0.0 else quats[i]
    Q = np.array(quats)
    turns = np.degrees(2.0 * np.arccos(np.minimum(1.0, np.sum(Q[1:] * Q[:-1], axis=1))))
    faults = [
        Fault(
            keys[i],
            f"the attitude {list(attitudes_deg[i + 1])} deg is {turn:.4g} deg from the attitude before it; "
            f"at most {LARGEST_TURN_DEG:g} deg are allowed: give a pose between them",
        )
        for i, turn in enumerate(turns)
        if turn > LARGEST_TURN_DEG + 1e-6
    ]
    if faults:
        raise InputError(faults, "scenario")
    return np.hstack([np.array(positions, float), Q])


def quintic_spline(times: np.ndarray, poses: np.ndarray) -> PPoly:
    """The quintic spline through poses (n, 7) that begins and ends at rest, without acceleration."""
    from scipy.interpolate import make_interp_spline

    rest = [(1, np.zeros(7)), (2, np.zeros(7))]
    spline = make_interp_spline(times, poses, k=5, bc_type=(rest, rest))
    return hermite(times, spline(times), spline(times, 1), spline(times, 2))


def hermite(times: np.ndarray, value: np.ndarray, rate: np.ndarray, growth: np.ndarray) -> PPoly:
    """The segments with these values, first and second derivatives (n, 7) at the times (n,)."""
    from scipy.interpolate import BPoly, PPoly

    return PPoly.from_bernstein_basis(BPoly.from_derivatives(times, np.stack([value, rate, growth], axis=1)))


def pack(parts: Sequence[PPoly]) -> dict[str, np.ndarray]:
    """The constants of :func:`follow` for parts of a motion in the order of time, with a rest wherever one ends before
    the next begins, and at the end. Read-only."""
    breaks, segments = [0.0], [_rest(parts[0](parts[0].x[0]))]
    for part in parts:
        breaks += part.x.tolist()
        segments += [*np.moveaxis(part.c, 1, 0), _rest(part(part.x[-1]))]
    kept = [i for i in range(len(breaks)) if i + 1 == len(breaks) or breaks[i + 1] > breaks[i]]
    begins, coefficients = np.full(MOST_SEGMENTS + 1, np.inf), np.zeros((MOST_SEGMENTS + 1, 6, 7))
    begins[: len(kept)], coefficients[: len(kept)] = np.array(breaks)[kept], np.array(segments)[kept]
    for array in (begins, coefficients):
        array.setflags(write=False)
    return {"begins": begins, "coefficients": coefficients}


def _rest(pose: np.ndarray) -> np.ndarray:
    """(6, 7) coefficients of a piece at rest."""
    piece = np.zeros((6, 7))
    piece[5] = pose
    return piece


@kernel
def follow(begins, coefficients, t, out):
    """Set the reference ``out`` to the motion of :func:`pack` at the time t."""
    n, size = 0, begins.shape[0]
    for _ in range(_SEARCH):
        size = size >> 1
        if begins[n + size] <= t:
            n += size
    x, value, rate, half = t - begins[n], np.zeros(7), np.zeros(7), np.zeros(7)
    for k in range(6):  # of the seven polynomials, with the first derivative and half the second
        half[:] = half * x + rate
        rate[:] = rate * x + value
        value[:] = value * x + coefficients[n, k]
    Q, Q_dot, Q_ddot = value[3:], rate[3:], 2.0 * half[3:]
    square = Q @ Q
    out.p_d[:], out.p_d_dot[:], out.p_d_ddot[:] = value[:3], rate[:3], 2.0 * half[:3]
    out.quat_d[:] = Q / math.sqrt(square)
    out.omega_d[:] = turning(Q_dot, Q) * (2.0 / square)
    out.omega_d_dot[:] = 2.0 / square * (turning(Q_ddot, Q) - (Q @ Q_dot) * out.omega_d)


MOST_POSES = 250


@table(frozen=True, config=STRICT)
class TimedPose:
    time: Time
    position: Position
    attitude_deg: Angles | None = None
    dwell: Time = 0.0


def _in_time(poses: tuple[TimedPose, ...]) -> tuple[TimedPose, ...]:
    if not 1 <= len(poses) <= MOST_POSES:
        raise ValueError(f"has {len(poses)} poses; 1 to {MOST_POSES} are allowed")
    if poses[0].time <= 0.0:
        raise ValueError(f"begins at time {poses[0].time:g}: the first pose must be later than 0, where start is")
    for before, pose in itertools.pairwise(poses):
        leaves = before.time + before.dwell
        if pose.time <= leaves:
            raise ValueError(f"has a pose at {pose.time:g} s, but the pose before it is left at {leaves:g} s")
    return poses


@functools.lru_cache(maxsize=8)
def _motion(poses: tuple[TimedPose, ...], start: Any, attitudes: tuple[Any, ...]) -> dict[str, np.ndarray]:
    numbers = pose_numbers(
        [start, *(pose.position for pose in poses)], attitudes, [f"reference.poses[{i}]" for i in range(len(poses))]
    )
    stops = [0, *(i for i, pose in enumerate(poses, 1) if pose.dwell > 0.0 or i == len(poses))]
    arrives = np.array([0.0, *(pose.time for pose in poses)])
    leaves = arrives + np.array([0.0, *(pose.dwell for pose in poses)])
    parts = []
    for first, last in itertools.pairwise(stops):
        times = np.array([leaves[first], *arrives[first + 1 : last + 1]])
        parts.append(quintic_spline(times, numbers[first : last + 1]))
    return pack(parts)


@dataclass(frozen=True)
class Spline(Followed):
    """Timed poses: quintic splines through positions and attitudes, with feed-forward to the acceleration."""

    poses: Annotated[tuple[TimedPose, ...], AfterValidator(_in_time)] = setting(
        (TimedPose(time=5.0, position=(1.01, 0.0, 0.0)),),
        "s, m, deg",
        "[{time = 5.0, position = [1.01, 0.0, 0.0], attitude_deg = [0.0, 0.0, 30.0], dwell = 2.0}, ...]; attitude_deg "
        "and dwell may be left out; at most 250",
    )
    start: Position | None = setting(
        None, "m", "position at t = 0, with initial.attitude_deg; default: initial.position"
    )

    name = "spline"
    _inner_keys: ClassVar = {"reference.poses": ("time", "position", "attitude_deg", "dwell")}

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """The constants of :func:`.spline.follow`."""
        initial = setup.initial
        attitudes = (initial.attitude_deg, *(pose.attitude_deg or self.attitude_deg for pose in self.poses))
        return _motion(self.poses, self.start or initial.position, attitudes)

    def rests_at(self) -> tuple[float, ...]:
        return self.poses[-1].position

    def rest_pose(self, scenario: ScenarioLike) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return self.poses[-1].position, self.poses[-1].attitude_deg or self.attitude_deg
