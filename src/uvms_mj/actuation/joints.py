r"""Joint interfaces, stages that set the torques of the joints' motors: their contract, torque, velocity and position;
and the motions that they follow.

**Motion.** A motion is a table over time, in a scenario or in a CSV file. It is made of segments, polynomials of third
order that are held before the first and after the last time. Linear interpolation has straight segments. Cubic
interpolation is the cubic spline with zero velocity at both ends, so that velocity and acceleration are continuous in
between.

Whatever torque the stage sets, the motor gives at most what :func:`uvms_mj.physics.tree.deliverable` says.

**Velocity.** The velocity loop is a PI controller with the bandwidth :math:`\omega_v`, for the inertia I that the motor
feels while all other joints and the vehicle are free, at the start:

.. math::

    \tau_q = K_v (v - \dot q_m) + z + \tau_g, \qquad
    \dot z = \frac{\omega_v}{4} (K_v (v - \dot q_m) + \tau_{lim} - \tau_q), \qquad K_v = \omega_v I

with the torque :math:`\tau_{lim}` that the motor gives instead of tau_q where it is at its limit, so that z does not
wind up. The friction of the gear is fed forward, a share :math:`\sigma` of the vehicle's file: the viscous friction
b and the Coulomb friction :math:`\tau_c`, below the speed :math:`v_s` in proportion to the commanded velocity,

.. math:: \tau_g = \sigma (b v + \tau_c \max(-1, \min(1, v / v_s)))

**Position.** The position loop around it is proportional, with feed-forward of the given velocity,

.. math:: v = \dot q_d + \omega_p (q_d - q_m), \qquad |v| \le \dot q_{max}

The loops know no weight, buoyancy or water: z carries them.
"""

from __future__ import annotations

import csv
import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator
from pydantic.dataclasses import dataclass as table

from ..errors import Fault, InputError
from ..physics.kernels import kernel
from ..physics.tree import deliverable
from ..quantities import STRICT, Lowercase, Number, Positive, Step, Time, within
from ..stages.base import Room, Stage, setting, shared
from ..stages.setup import SetupLike
from ..stages.signals import joint_torque_signal, joints_given

MOST_TIMES = 100_000
_SEARCH = 20
"""Halvings of a search among at most 2^20 segments."""

Coordinates = Annotated[tuple[Number, ...], "a number for each joint"]


@table(frozen=True, config=STRICT)
class Waypoint:
    time: Time
    joints: Coordinates


def in_time(waypoints: tuple[Waypoint, ...]) -> tuple[Waypoint, ...]:
    for before, after in itertools.pairwise(waypoints):
        if after.time <= before.time:
            raise ValueError(f"has the time {after.time:g} s after {before.time:g} s; the times must increase")
    return waypoints


Waypoints = Annotated[tuple[Waypoint, ...], AfterValidator(in_time)]


def read_motion(path: str, joints: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Times (m,) [s] and values (m, n) of a CSV file with the columns ``time`` and one for each joint, by its name.
    Other columns are ignored.

    Raises:
        InputError: the file can't be read, lacks a column, has an entry that is no finite number, or times that do not
            increase; names the line.
    """
    key = "joints.motion_file"
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.reader(file))
    except (OSError, ValueError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError([Fault(key, f"can't read {Path(path).absolute()}: {reason}")]) from None
    header = [word.strip() for word in rows[0]] if rows else []
    wanted = ["time", *joints]
    missing = [name for name in wanted if name not in header]
    if missing:
        there = f"its columns are {', '.join(header[:30])}" if header else "it is empty"
        raise InputError([Fault(key, f"{path}: has no column {', '.join(missing)}; {there}")])
    places = [header.index(name) for name in wanted]
    numbers: list[list[float]] = []
    for line, row in enumerate(rows[1:], 2):
        if not any(word.strip() for word in row):
            continue
        try:
            values = [float(row[i]) for i in places]
        except (ValueError, IndexError):
            values = [math.nan]
        if not all(map(math.isfinite, values)):
            raise InputError([Fault(key, f"{path}, line {line}: has no number in a column of {', '.join(wanted)}")])
        if numbers and values[0] <= numbers[-1][0]:
            after = f"the time {values[0]:g} s does not increase after {numbers[-1][0]:g} s"
            raise InputError([Fault(key, f"{path}, line {line}: {after}")])
        numbers.append(values)
    if not 1 <= len(numbers) <= MOST_TIMES:
        raise InputError([Fault(key, f"{path}: has {len(numbers)} times; 1 to {MOST_TIMES} are allowed")])
    found = np.array(numbers)
    return found[:, 0], found[:, 1:]


def segments(times: np.ndarray, values: np.ndarray, interpolation: str) -> dict[str, np.ndarray]:
    """The constants of :func:`segment_at` and :func:`value_at` for values (m, n) at times (m,), "linear" or "cubic".

    Their number is a power of two, so that few lengths of a motion have machine code of their own.
    """
    from scipy.interpolate import CubicSpline  # imported where it is used, because it takes long

    m, n = values.shape
    rest = np.zeros((1, 4, n))
    first, last = rest.copy(), rest.copy()
    first[0, 3], last[0, 3] = values[0], values[-1]
    between = np.zeros((m - 1, 4, n))
    if m > 1 and interpolation == "cubic":
        between = np.moveaxis(CubicSpline(times, values, bc_type="clamped").c, 1, 0)
    elif m > 1:
        between[:, 2], between[:, 3] = np.diff(values, axis=0) / np.diff(times)[:, None], values[:-1]
    size = 1 << m.bit_length()  # m + 1 segments at most
    begins, coefficients = np.full(size, np.inf), np.zeros((size, 4, n))
    begins[0], begins[1 : m + 1] = -np.inf, times
    coefficients[: m + 1] = np.concatenate([first, between, last])
    return {"begins": begins, "coefficients": coefficients}


@kernel
def segment_at(begins, t) -> int:
    """Index of the piece of the time t."""
    n, size = 0, begins.shape[0]
    for _ in range(_SEARCH):
        size = size >> 1
        if begins[n + size] <= t:
            n += size
    return n


@kernel
def value_at(begins, c, n, j, t) -> float:
    """The value of joint j in piece n at the time t."""
    x = t - begins[n] if n > 0 else 0.0
    return ((c[n, 0, j] * x + c[n, 1, j]) * x + c[n, 2, j]) * x + c[n, 3, j]


@kernel
def rate_at(begins, c, n, j, t) -> float:
    """Its derivative by time."""
    x = t - begins[n] if n > 0 else 0.0
    return (3.0 * c[n, 0, j] * x + 2.0 * c[n, 1, j]) * x + c[n, 2, j]


@dataclasses.dataclass(frozen=True)
class Joints(Stage):
    """Base class of all joint interfaces. ``given`` has the signals of
    :func:`uvms_mj.stages.signals.joints_given`, and tau_q (n,) is the torque of each joint's motor [N m or N]."""

    period: Step | None = shared(None, "s", "period, a multiple of the time step; default: every step")

    every_step: ClassVar[bool] = True
    torque_controlled: ClassVar[bool] = True
    """Whether the torque follows the commanded one, which is then recorded."""
    tracked_signal: ClassVar[str] = "q"
    """The signal of :meth:`target_at`: "q" or "q_dot"."""
    room: ClassVar[Room] = Room(
        name="actuation",
        table="joints",
        given=joints_given,
        out=(joint_torque_signal(0),),
        noun="joint interface",
        arguments=("settings", "state", "given", "state_dot", "tau_q"),
        counts="joints",
    )

    def resolved(self, setup: SetupLike) -> Joints:
        """The interface that a run uses: itself."""
        return self

    def target_at(self, setup: SetupLike, t: float) -> np.ndarray | None:
        """The value (n,) that the interface makes the signal :attr:`tracked_signal` have at the time t [s]; None if it
        follows nothing that is known before the run."""
        return None

    def faults(self, setup: SetupLike) -> Iterator[Fault]:
        if not setup.vehicle.arm.links:
            yield Fault("joints.name", f"{self.label()!r} is for a vehicle with joints; {setup.vehicle.body} has none")

    @staticmethod
    def step(settings, state, given, state_dot, tau_q):
        """Set tau_q (n,) and state_dot from settings, state and given."""
        raise NotImplementedError


@kernel
def commanded(given, tau_q):
    """Set the torques to the commanded ones. A stage that calls it first changes only the rest."""
    tau_q[:] = given.tau_q_cmd


@dataclasses.dataclass(frozen=True)
class Torque(Joints):
    """Torque interface: the motors give the torques that the law at the tool commands, within their limits."""

    name = "torque"

    @staticmethod
    def step(settings, state, given, state_dot, tau_q):
        commanded(given, tau_q)


SLOW = 0.01
"""Speed v_s below which the Coulomb friction is fed forward in proportion to the commanded velocity [rad/s or m/s]."""
_SLACK = 0.01
"""How far a given position may be beyond the range, for the errors of a measured motion [rad or m]."""
FASTEST = 2.0
"""Bandwidth of the velocity loop times its period: above, a sampled gain on the velocity diverges."""
_SOURCES = ("target", "motion", "motion_file")


def at_body(setup: SetupLike) -> bool:
    """Whether the law commands a wrench on the body, and no joint torques."""
    return setup.scenario.task.frame == "body"


@dataclasses.dataclass(frozen=True)
class Servo(Joints):
    """Base class of the velocity and the position interface."""

    target: Coordinates | None = setting(None, "rad or m (/s)", "constant target of each joint")
    motion: Waypoints = setting((), "s, rad or m (/s)", "[{time = 2.0, joints = [0.5, 1.2]}, ...] in place of a target")
    motion_file: str | None = setting(
        None, "-", "CSV file in place of a target, with the column time [s] and one for each joint by its name"
    )
    motion_start: Time = setting(0.0, "s", "time of the run at which the time of the motion is zero")
    interpolation: Annotated[Literal["linear", "cubic"], Lowercase] = setting(
        "cubic", "-", "of the motion between its times: linear or cubic"
    )
    friction_compensation: Annotated[Number, within(0.0, 1.0, "")] = setting(
        1.0, "1", "share sigma of the gear's friction that is fed forward"
    )
    velocity_bandwidth: Positive = setting(200.0, "rad/s", "bandwidth omega_v of the velocity loop")

    torque_controlled: ClassVar = False
    memory: ClassVar = {"carried": "joints"}
    _inner_keys: ClassVar = {"joints.motion": ("time", "joints")}

    def check_settings(self) -> None:
        super().check_settings()
        given = [f"joints.{name}" for name in _SOURCES if getattr(self, name) not in (None, ())]
        if len(given) > 1:
            raise InputError([Fault(given[1], f"is given beside {given[0]}; give one of them")])

    def at_start(self, setup: SetupLike) -> np.ndarray:
        """The value (n,) where no target and no motion is given."""
        raise NotImplementedError

    def given_motion(self, setup: SetupLike) -> tuple[np.ndarray, np.ndarray]:
        """Times (m,) of the run [s] and values (m, n) of the given motion, one time and value if it is constant. Raises
        InputError if a file can't be read."""
        if self.motion_file is not None:
            times, values = read_motion(self.motion_file, setup.vehicle.arm.joints)
        elif self.motion:
            times = np.array([waypoint.time for waypoint in self.motion])
            values = np.array([waypoint.joints for waypoint in self.motion])
        else:
            times, values = np.zeros(1), np.array([self.at_start(setup) if self.target is None else self.target])
        return times + self.motion_start, values

    def target_at(self, setup: SetupLike, t: float) -> np.ndarray:
        motion = segments(*self.given_motion(setup), self.interpolation)
        begins, c = motion["begins"], motion["coefficients"]
        n = segment_at(begins, t)
        return np.array([value_at(begins, c, n, j, t) for j in range(c.shape[2])])

    def faults(self, setup: SetupLike) -> Iterator[Fault]:
        yield from super().faults(setup)
        joints = setup.vehicle.arm.joints
        if not joints:
            return
        if not at_body(setup):
            instead = "follows a given motion, and the law at a tool commands torques; choose torque"
            yield Fault("joints.name", f"{self.label()!r} {instead}")
        period = self.period_in(setup.scenario)
        if self.velocity_bandwidth * period > FASTEST:
            limit = f"unstable at a period of {period:g} s, which allows {FASTEST / period:g} rad/s"
            yield Fault("joints.velocity_bandwidth", f"{self.velocity_bandwidth:g} rad/s is {limit}")
        given = [("joints.target", self.target)] if self.target is not None else []
        given += [(f"joints.motion[{i}].joints", waypoint.joints) for i, waypoint in enumerate(self.motion)]
        for place, values in given:
            if len(values) != len(joints):
                has = f"has {len(values)} values; the vehicle has {len(joints)} joints: {', '.join(joints)}"
                yield Fault(place, has)
        try:
            _, reached = self.given_motion(setup)
        except InputError as error:
            yield from error.faults
        except ValueError:  # of the lengths above
            pass
        else:
            yield from self.out_of_range(setup, reached)

    def out_of_range(self, setup: SetupLike, values: np.ndarray) -> Iterator[Fault]:
        """Errors for values (m, n) of the given motion that no joint can reach."""
        return iter(())

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """The gains K_v (n,), and the motion as :func:`.motion.segments`."""
        links = setup.nominal.arm.links
        return {
            "K_v": self.velocity_bandwidth * setup.joint_inertia,
            "omega_i": 0.25 * self.velocity_bandwidth,
            "viscous": self.friction_compensation * np.array([link.damping for link in links]),
            "coulomb": self.friction_compensation * np.array([link.friction for link in links]),
            **segments(*self.given_motion(setup), self.interpolation),
        }


@kernel
def velocity_loop(settings, state, given, j, v) -> float:
    """The torque of joint j for the commanded velocity v [rad/s or m/s]."""
    error = settings.K_v[j] * (v - given.q_dot_m[j])
    friction = settings.viscous[j] * v + settings.coulomb[j] * min(1.0, max(-1.0, v / SLOW))
    tau = error + state.carried[j] + friction
    limited = deliverable(tau, given.q_dot_m[j], given.effort[j], given.speed_limit[j])
    state.carried[j] += given.period * settings.omega_i * (error + limited - tau)
    return limited


@dataclasses.dataclass(frozen=True)
class Velocity(Servo):
    """Velocity interface: each joint follows a given velocity, zero by default."""

    name = "velocity"
    tracked_signal: ClassVar = "q_dot"

    def at_start(self, setup: SetupLike) -> np.ndarray:
        return np.zeros(len(setup.vehicle.arm.links))

    @staticmethod
    def step(settings, state, given, state_dot, tau_q):
        begins, coefficients = settings.begins, settings.coefficients
        n = segment_at(begins, given.t)
        for j in range(tau_q.shape[0]):
            v = value_at(begins, coefficients, n, j, given.t)
            tau_q[j] = velocity_loop(settings, state, given, j, v)


@dataclasses.dataclass(frozen=True)
class Position(Servo):
    """Position interface: each joint follows a given position, by default its position at the start."""

    position_bandwidth: Positive = setting(40.0, "rad/s", "bandwidth omega_p of the position loop")

    name = "position"

    def at_start(self, setup: SetupLike) -> np.ndarray:
        return setup.initial_joints

    def out_of_range(self, setup: SetupLike, values: np.ndarray) -> Iterator[Fault]:
        key = next((f"joints.{name}" for name in _SOURCES if getattr(self, name) not in (None, ())), "initial.joints")
        for link, low, high in zip(setup.vehicle.arm.links, values.min(axis=0), values.max(axis=0), strict=False):
            if wrong := link.out_of_range(low if low < link.range[0] else high, _SLACK):
                yield Fault(key, wrong)

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        return {**super().constants(setup), "omega_p": self.position_bandwidth}

    @staticmethod
    def step(settings, state, given, state_dot, tau_q):
        begins, coefficients = settings.begins, settings.coefficients
        n = segment_at(begins, given.t)
        for j in range(tau_q.shape[0]):
            v = rate_at(begins, coefficients, n, j, given.t)
            v += settings.omega_p * (value_at(begins, coefficients, n, j, given.t) - given.q_m[j])
            limit = given.speed_limit[j]
            tau_q[j] = velocity_loop(settings, state, given, j, min(limit, max(-limit, v)))


@dataclasses.dataclass(frozen=True)
class Auto(Joints):
    """The interface that fits the task: torque with the task frame at a tool, otherwise position at the start."""

    name = "auto"
    runs: ClassVar[bool] = False

    def resolved(self, setup: SetupLike) -> Joints:
        return Position(period=self.period) if at_body(setup) else Torque(period=self.period)

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        return self.resolved(setup).constants(setup)
