r"""Joint interfaces, stages that set the torques of the joints' motors: their contract, torque, velocity and position.

The contract of a joint interface, a stage that sets the torques of the joints' motors, and the torque interface.

Whatever torque the stage sets, the motor gives at most what :func:`uvms_mj.physics.tree.deliverable` says.

Velocity and position interfaces: the servo loops of a joint's drive, which follow a given motion.

The velocity loop is a PI controller with the bandwidth :math:`\omega_v`, for the inertia I that the motor feels while
all other joints and the vehicle are free, at the start:

.. math::

    \tau_q = K_v (v - \dot q_m) + z + \tau_g, \qquad
    \dot z = \frac{\omega_v}{4} (K_v (v - \dot q_m) + \tau_{lim} - \tau_q), \qquad K_v = \omega_v I

with the torque :math:`\tau_{lim}` that the motor gives instead of tau_q where it is at its limit, so that z does not
wind up. The friction of the gear is fed forward, a share :math:`\sigma` of the vehicle's file: the viscous friction
b and the Coulomb friction :math:`\tau_c`, below the speed :math:`v_s` in proportion to the commanded velocity,

.. math:: \tau_g = \sigma (b v + \tau_c \max(-1, \min(1, v / v_s)))

The position loop around it is proportional, with feed-forward of the given velocity,

.. math:: v = \dot q_d + \omega_p (q_d - q_m), \qquad |v| \le \dot q_{max}

The loops know no weight, buoyancy or water: z carries them.
"""

from __future__ import annotations  # so that help(Joints) shows short type names

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from ..errors import Fault, InputError
from ..physics.kernels import kernel
from ..physics.tree import deliverable
from ..quantities import Lowercase, Number, Positive, Step, Time, within
from ..stages.base import Room, Stage, setting, shared
from ..stages.signals import joint_torque_signal, joints_given
from .motion import Coordinates, Waypoints, rate_at, read_motion, segment_at, segments, value_at


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

    def resolved(self, setup: Any) -> Joints:
        """The interface that a run uses: itself."""
        return self

    def target_at(self, setup: Any, t: float) -> np.ndarray | None:
        """The value (n,) that the interface makes the signal :attr:`tracked_signal` have at the time t [s]; None if it
        follows nothing that is known before the run."""
        return None

    def faults(self, setup: Any) -> Iterator[Fault]:
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


def at_body(setup: Any) -> bool:
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

    def at_start(self, setup: Any) -> np.ndarray:
        """The value (n,) where no target and no motion is given."""
        raise NotImplementedError

    def given_motion(self, setup: Any) -> tuple[np.ndarray, np.ndarray]:
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

    def target_at(self, setup: Any, t: float) -> np.ndarray:
        motion = segments(*self.given_motion(setup), self.interpolation)
        begins, c = motion["begins"], motion["coefficients"]
        n = segment_at(begins, t)
        return np.array([value_at(begins, c, n, j, t) for j in range(c.shape[2])])

    def faults(self, setup: Any) -> Iterator[Fault]:
        yield from super().faults(setup)
        joints = setup.vehicle.arm.joints
        if not joints:
            return
        if not at_body(setup):
            instead = "follows a given motion, and the law at a tool commands torques; choose torque"
            yield Fault("joints.name", f"{self.label()!r} {instead}")
        period = self.period or setup.scenario.control_period
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

    def out_of_range(self, setup: Any, values: np.ndarray) -> Iterator[Fault]:
        """Errors for values (m, n) of the given motion that no joint can reach."""
        return iter(())

    def constants(self, setup: Any) -> Mapping[str, Any]:
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

    def at_start(self, setup: Any) -> np.ndarray:
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
    """Position interface: each joint follows a given position, by default that of the start."""

    position_bandwidth: Positive = setting(40.0, "rad/s", "bandwidth omega_p of the position loop")

    name = "position"

    def at_start(self, setup: Any) -> np.ndarray:
        return setup.initial_joints

    def out_of_range(self, setup: Any, values: np.ndarray) -> Iterator[Fault]:
        key = next((f"joints.{name}" for name in _SOURCES if getattr(self, name) not in (None, ())), "initial.joints")
        for link, low, high in zip(setup.vehicle.arm.links, values.min(axis=0), values.max(axis=0), strict=False):
            if wrong := link.out_of_range(low if low < link.range[0] else high, _SLACK):
                yield Fault(key, wrong)

    def constants(self, setup: Any) -> Mapping[str, Any]:
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

    def resolved(self, setup: Any) -> Joints:
        return Position(period=self.period) if at_body(setup) else Torque(period=self.period)

    def constants(self, setup: Any) -> Mapping[str, Any]:
        return self.resolved(setup).constants(setup)
