r"""The motion of the frame of the task under a law, as :func:`.approach.approach` follows it to a rest: the desired
impedance, eq. (7), with the residual of the law's balance in place of its stiffness.

At its rest the motion stays if small motions about it decay, also motions that take a thruster across its limit.
"""

import bisect
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from ...physics.frames import quat_error, quat_turned, rotation_matrix, skew
from ...stages.setup import SetupLike
from ..task import Schedule
from .approach import FIRST_STEP, LAST_STEP, MOST_STEPS, SLOWEST, UNSTABLE, approach, decays
from .terms import DIFFERENCE, Balance, Memory, Pose, ThrustMap

_CIRCLES = "a thruster is next to its limit, and motions that take it across the limit do not decay"
_STILL = 1e-4
"""A reference that is nearer to its end is at its end [m, rad]."""
OUTDATED, ROUNDING = 0.02, 1e-6
"""Error of a predicted change of the force, relative to this change and absolute [N, N m], after which the law's
derivatives are computed again."""
_NEAR = 1e-3
"""A frame that is nearer to its end may go there in one step [m, rad]."""
TURN_BESIDE = 2.0
"""Rotation vector of a reference beside its way over its displacement [rad/m]."""
LONGEST_OF_STATES, STATES_AT_REST = 100.0, 2.0
"""Longest steps of a law's states with thrusters at their limits, and at the rest [s]: states that do not wind up have
come to rest by then, and a long step would amplify rounding."""
_DRIFT = 1e-6
"""Largest change of the force in this step, relative to the contact wrench, or to 1 N and 1 N m."""
_SAMPLES = 0.05
"""Time between two samples of the reference [s]."""
MOST_SAMPLES = 1200
BESIDE, _DECAYED = 0.01, 0.01
"""Displacements [m, rad] from which the motions about a rest begin that take thrusters across their limits and open or
close contacts, and the part of them that is left of motions that decay [1]."""
_LASTS, _INSTANT, _CHECKED = 100.0, 0.01, 10.0
"""Longest time of these motions, their longest step, and the time after which they are looked at [s]."""
_REACH, _ANY = 0.05, 0.5
"""Largest step of the motion, and in a convex room [m, rad]."""

Way = tuple[np.ndarray, np.ndarray, np.ndarray]
"""The way of a reference: times (n,) [s], positions (n, 3) [m] and attitudes (n, 4)."""


def comes_back(
    rates: np.ndarray, pushes: np.ndarray, shares: np.ndarray, u: np.ndarray, least: np.ndarray, most: np.ndarray
) -> bool:
    """Whether motions x (12,) that begin beside a rest decay where thrusters (n,) reach their limits or leave them:

    x' = rates x + pushes (clip(u + shares x) - clip(u) - the part of shares x that answers at rest).

    A rest may be stable and motions across the limit of a thruster circle it all the same."""
    from scipy.linalg import expm

    answers = ((least <= u) & (u <= most))[:, None]
    far = np.minimum(np.abs(u - least), np.abs(most - u)) > BESIDE * np.abs(shares[:, :6]).max(axis=1)
    if far.all():
        return True
    fastest = np.abs(np.linalg.eigvals(np.eye(12, k=6) + pushes @ shares)).max()  # motion that the thrusters give
    n, h = len(u), 0.2 / max(fastest, 0.2 / _INSTANT)
    both = expm(h * np.vstack([np.hstack([rates, pushes]), np.zeros((n, 12 + n))]))  # with a constant push for a step
    step, push = both[:12, :12], both[:12, 12:]
    u, least, most = (each[:, None] for each in (u, least, most))
    x, at_rest = BESIDE * np.hstack([np.eye(12, 6), -np.eye(12, 6)]), np.clip(u, least, most)
    for _ in range(round(_LASTS / _CHECKED)):
        for _ in range(round(_CHECKED / h)):
            changes = shares @ x
            x = step @ x + push @ (np.clip(u + changes, least, most) - at_rest - answers * changes)
        if np.abs(x[:6]).max() < _DECAYED * BESIDE:
            return True
    return False


def way_of(setup: SetupLike) -> Way | str:
    """The way of the reference of a run, or the reason why it is not known."""
    duration = setup.scenario.simulation.duration
    times = np.linspace(0.0, duration, 1 + min(MOST_SAMPLES, math.ceil(duration / _SAMPLES)))
    found = setup.scenario.reference.way(setup, times)
    return found if isinstance(found, str) else (times, *found)


@dataclass
class Track:
    """Poses of a motion at increasing times [s]."""

    times: list[float] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)

    @property
    def end(self) -> Pose:
        """The last pose."""
        return self.poses[-1]

    @property
    def ends(self) -> float:
        """When the motion is near its end [s]."""
        away = [
            t for t, pose in zip(self.times, self.poses, strict=True) if np.abs(between(pose, self.end)).max() > _NEAR
        ]
        return away[-1] if away else 0.0

    def at(self, t: float) -> Pose:
        """The pose at a time, without its contacts between two of them."""
        k = bisect.bisect_right(self.times, t)
        if not 0 < k < len(self.times):
            return self.poses[min(k, len(self.times) - 1)]
        a, b = self.poses[k - 1 : k + 1]
        part = (t - self.times[k - 1]) / (self.times[k] - self.times[k - 1])
        quat = quat_turned(a.quat, part * between(a, b)[3:])
        return Pose(a.position + part * (b.position - a.position), quat, rotation_matrix(quat), np.zeros(6))


class TaskMotion:
    """The motion of a frame with the damping D_d and with the inertia M_d of a law that keeps eq. (7), or with that
    which another law leaves; a :class:`.approach.Motion` of poses.

    Args:
        balance: the terms of the static balance.
        residual: of the law, from the balance and a pose (6,) [N, N m].
        memory: the law's states in the residual.
        thrust_map: of a rigid vehicle, with the limits of its thrusters.
        wrench: the net wrench (6, 6) that a residual of one takes from the vehicle, if its law has no other
            memory. Default: M M_d^-1, which a law that keeps eq. (7) has.
    """

    def __init__(
        self,
        balance: Balance,
        residual: Callable[[Balance, Pose], np.ndarray],
        memory: Memory | None = None,
        thrust_map: ThrustMap | None = None,
        wrench: np.ndarray | None = None,
    ) -> None:
        self.balance, self.residual, self.memory, self.thrust_map = balance, residual, memory, thrust_map
        design = balance.setup.design
        self.wrench = design.M @ design.M_d_inv if wrench is None else wrench
        self.inertia, self.damping = np.linalg.solve(self.wrench, design.M), design.D_d
        self.largest = _ANY if balance.springs.convex else min(_REACH, 0.25 * balance.springs.size)
        self.sharp, self.ends = 1e-7, 0.0
        self._end = balance.p_d, balance.quat_d
        self._law: tuple[Pose, np.ndarray, np.ndarray] | None = None
        self._way: Way | None = None
        self._schedule: SimpleNamespace | None = None
        self.begin()

    def __call__(self, pose: Pose, /) -> np.ndarray:
        force = self._free(pose)
        return force + self._missing(pose, force, self._nu(pose)) if self.limits else force

    def _free(self, pose: Pose) -> np.ndarray:
        """The force of the law without limits; at the latest pose it is known."""
        if pose is not self._latest[0]:
            self._latest = pose, -self.residual(self.balance, pose)
        return self._latest[1]

    def _nu(self, pose: Pose) -> np.ndarray:
        """nu (6,) of the step that ends at a pose, zero at rest."""
        return between(self._from, pose) / self._step if self._step <= LAST_STEP else self._at_rest

    def _not_fed_forward(self, pose: Pose) -> np.ndarray:
        """The wrench (6,) of drag and of the reference's acceleration in the step that ends at a pose."""
        thrust, M = self.balance.thrust, self.balance.setup.design.M
        lacking: np.ndarray = thrust(pose, self._nu(pose)) - thrust(pose, np.zeros(6)) + M @ self._led
        return lacking

    def _missing(self, pose: Pose, force: np.ndarray, nu: np.ndarray) -> np.ndarray:
        """The part that the thrusters at their limits add to the force of a law at a pose with a velocity nu (6,)."""
        assert self.thrust_map is not None
        missing = self.thrust_map.missing(self._commanded(pose, force, nu))
        return np.linalg.solve(self.wrench, missing) if missing.any() else missing

    def _commanded(self, pose: Pose, force: np.ndarray, nu: np.ndarray) -> np.ndarray:
        """The wrench (6,) that a law with a force commands, as in the motion without limits."""
        net = self.wrench @ (force - self.damping @ (nu - self._nu_d[1])) + self.balance.setup.design.M @ self._led
        commanded: np.ndarray = self.balance.thrust(pose, nu) + net
        return commanded

    def answering(self, pose: Pose) -> np.ndarray:
        """Which thrusters (n,) are not at their limits at a rest of a motion with limits."""
        assert self.thrust_map is not None
        u, least, most = self.thrust_map.thrusts(self._commanded(pose, self._free(pose), self._nu(pose)))
        return (least <= u) & (u <= most)

    def moved(self, pose: Pose, change: np.ndarray) -> Pose:
        return self.balance.moved(pose, change)

    def begin(self, beside: np.ndarray | None = None, led: bool = True, limits: bool = False) -> None:
        """Begin a motion: with the reference beside its way (3,) [m, W] and turned, back on it at its end; without the
        reference's velocity in the law; or with the limits of the thrusters."""
        self.beside, self.led, self.limits = np.zeros(3) if beside is None else beside, led, limits
        self.track, self._law, self.limited_s = Track(), None, 0.0
        self._lacked: list[np.ndarray] = []
        self._latest: Any = (None, None)
        self._at_rest = np.zeros(6)
        self._before: np.ndarray | None = None
        self._by_water: np.ndarray | None = None
        self._nu_d, self._led, self._step = (np.zeros(6), np.zeros(6)), np.zeros(6), math.inf
        if self.memory is not None:
            self.memory.begin()
            self.memory.not_fed_forward = self._not_fed_forward
            self.memory.nu_e = lambda pose: self._nu(pose) - self._nu_d[1]

    def rest_from(
        self, pose: Pose, velocity: np.ndarray, step: float = FIRST_STEP, steps: int = MOST_STEPS
    ) -> Pose | str:
        """The rest that the motion from a pose reaches, as :func:`approach` finds it."""
        found: Pose | str = approach(self, pose, velocity, step, steps)
        return found

    def passed(self, t: float, pose: Pose) -> str:
        if self.memory is not None:
            self._latest = None, None
            self(pose)
            self.memory.advance()
            self._latest = None, None
        self.track.times.append(t)
        self.track.poses.append(pose)
        self._lacked.append(self(pose) - self._free(pose) if self.limits else np.zeros(6))
        self.limited_s += bool(self._lacked[-1].any()) * self._step
        self._nu_d = self._nu_d[1], self._nu_d[1]
        return ""

    @property
    def saturates(self) -> bool:
        """Whether the thrusters would come to their limits on the track."""
        found = (self._thrust(k) for k in range(2, len(self.track.times)))
        return self.thrust_map is not None and any(self.thrust_map.missing(tau).any() for tau in found)

    def unmodelled(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (n,) [s] of the track, and the unknown acceleration (n, 6) of a rigid vehicle on it, with the
        acceleration of the thrust that its thrusters at their limits lack."""
        steps = range(1, len(self.track.times))
        found = [self.balance.unmodelled_on_the_way(self.track.poses[k], self._velocity(k)) for k in steps]
        lacked = np.array(self._lacked[1:]) @ self.balance.M_d_inv.T
        return np.array(self.track.times[1:]), np.array(found) + lacked

    def _velocity(self, k: int) -> np.ndarray:
        """nu (6,) in step k of the track."""
        times, poses = self.track.times, self.track.poses
        return between(poses[k - 1], poses[k]) / (times[k] - times[k - 1])

    def _thrust(self, k: int) -> np.ndarray:
        """tau (6,) of a rigid vehicle in step k of the track."""
        nu_before, nu = self._velocity(k - 1), self._velocity(k)
        acceleration: np.ndarray = (nu - nu_before) / (self.track.times[k] - self.track.times[k - 1])
        return self.balance.thrust(self.track.poses[k], nu) + self.balance.setup.design.M @ acceleration

    def leaves(self, pose: Pose) -> str:
        """The reason why the motion does not stay at a root, also while the law's states keep their values; empty if it
        does."""
        stays = decays(self.jacobian(pose), self.inertia + self.damping)
        if self.memory is not None:
            self.memory.step, self._law, self._latest = 0.0, None, (None, None)
            if self.limits and np.abs(self(pose)).max() > _DRIFT * max(1.0, np.abs(pose.tau_c).max()):
                return UNSTABLE
            stays = stays and decays(self.jacobian(pose), self.inertia + self.damping)
        if not stays:
            return UNSTABLE
        return self._leaves_at_limits(pose) if self.limits else ""

    def _leaves_at_limits(self, pose: Pose) -> str:
        """The reason why a small motion about a root does not decay; empty if all do. The thrusters at their limits do
        not answer, and the drag of the water takes the place of the law's damping."""
        assert self.thrust_map is not None
        self.jacobian(pose)
        assert self._law is not None
        force, stiffness, still = self._free(pose), self.stiffness(pose), np.zeros(6)
        by_nu, needs = np.empty((6, 6)), self.needs(pose)
        for k, self._at_rest in enumerate(DIFFERENCE * np.eye(6)):
            by_nu[:, k] = (-self.residual(self.balance, pose) - force) / DIFFERENCE
        self._at_rest = still
        law = self.wrench @ np.hstack([self._law[1] + self._law[2] @ stiffness, by_nu - self.damping])
        damped = np.hstack([np.zeros((6, 6)), self.wrench @ self._law[2] @ self.balance.contact_damping(pose)])
        needs[:, :6] -= stiffness
        M_inv, shares = np.linalg.inv(self.balance.setup.design.M), self.thrust_map.shares @ (needs + law)
        u, least, most = self.thrust_map.thrusts(self._commanded(pose, force, still))
        limited = (u < least) | (most < u)
        rates = np.vstack([np.eye(6, 12, 6), M_inv @ (law - self.thrust_map.lost(limited) @ (needs + law) - damped)])
        if np.linalg.eigvals(rates).real.max() >= -SLOWEST:
            return UNSTABLE
        pushes = np.vstack([np.zeros((6, len(u))), M_inv @ self.balance.setup.vehicle.B])
        return "" if comes_back(rates, pushes, shares, u, least, most) else _CIRCLES

    def jacobian(self, pose: Pose) -> np.ndarray:
        """The law's derivatives by the pose and by the contact wrench, with the wrench's derivatives. The law's are
        computed again where they do not predict the force any more."""
        force = self._free(pose)
        if self._law is not None:
            there, by_pose, by_wrench = self._law
            if self._before is None:
                self._before = -self.residual(self.balance, there)
            predicted = by_pose @ between(there, pose) + by_wrench @ (pose.tau_c - there.tau_c)
            changed = force - self._before
            if np.abs(changed - predicted).max() > OUTDATED * np.abs(changed).max() + ROUNDING:
                self._law = None
        if self._law is None:
            self._law, self._before = (pose, *self._derivatives(pose, force)), force
        stiffness = self.stiffness(pose)
        J: np.ndarray = self._law[1] + self._law[2] @ stiffness
        return self._at_limits(pose, force, J, stiffness) if self.limits else J

    def _at_limits(self, pose: Pose, force: np.ndarray, J: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
        """The derivatives J of a force without limits with the derivatives of what the thrusters at their limits add to
        it."""
        answering = self.answering(pose)
        if answering.all():
            return J
        assert self.thrust_map is not None
        nu, moves = self._nu(pose), self._step <= LAST_STEP
        by_command = -self.thrust_map.lost(~answering)
        if self._by_water is None:
            self._by_water = self._water(pose, nu, 1.0 / self._step if moves else 0.0)
        damping = self.wrench @ self.damping / self._step if moves else 0.0
        by_pose = self._by_water - stiffness + self.wrench @ J - damping
        return J + np.linalg.solve(self.wrench, by_command @ by_pose)

    def needs(self, pose: Pose) -> np.ndarray:
        """The derivative (6, 12) of the wrench that the vehicle needs in the water at rest at a pose, by the
        coordinates from the pose and by nu."""
        still, changes = np.zeros(6), DIFFERENCE * np.eye(6)
        at, M_A = self.balance.thrust(pose, still), self.balance.setup.vehicle.M_A
        drag = np.array([(self.balance.thrust(pose, nu) - at) / DIFFERENCE for nu in changes]).T
        drag[:, 3:] += M_A[:, :3] @ skew(self.balance.flow(pose)).T  # the current turns in B, nu_c_dot = -omega x nu_c
        return np.hstack([self._water(pose, still, 0.0), drag])

    def _water(self, pose: Pose, nu: np.ndarray, rate: float) -> np.ndarray:
        """The derivative (6, 6) of the wrench that the vehicle needs in the water at a pose with a velocity nu (6,),
        which changes with the pose by a rate [1/s]."""
        at, changes = self.balance.thrust(pose, nu), DIFFERENCE * np.eye(6)
        moved = [
            Pose(pose.position + pose.R_WB @ e[:3], quat, rotation_matrix(quat), pose.tau_c)
            for e, quat in ((e, quat_turned(pose.quat, e[3:])) for e in changes)
        ]
        return np.array(
            [(self.balance.thrust(x, nu + rate * e) - at) / DIFFERENCE for x, e in zip(moved, changes, strict=True)]
        ).T

    def _derivatives(self, pose: Pose, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        def at(y: np.ndarray) -> np.ndarray:
            quat = quat_turned(pose.quat, y[3:6])
            turned = Pose(pose.position + pose.R_WB @ y[:3], quat, rotation_matrix(quat), pose.tau_c + y[6:])
            return -self.residual(self.balance, turned)

        small = np.concatenate([np.full(6, DIFFERENCE), np.full(6, 1e-3)])
        J = np.array([(at(e) - force) / e.max() for e in np.diag(small)]).T
        return J[:, :6], J[:, 6:]

    def stiffness(self, pose: Pose) -> np.ndarray:
        """The derivative (6, 6) of the contact wrench by the coordinates from a pose."""
        if not pose.tau_c.any():
            return np.zeros((6, 6))
        found: np.ndarray = self.balance.springs.slopes(pose.position, pose.R_WB)[0].sum(axis=0)
        return found

    def follow(self, way: "Way") -> None:
        """Let the reference take its way, and K_f and F_d follow their schedule."""
        times, positions, quats = way
        left = np.abs(positions - self._end[0]).max(axis=1)
        turned = np.sqrt(np.maximum(0.0, 1.0 - (quats @ self._end[1]) ** 2))
        moving = np.flatnonzero(np.maximum(left, turned) > _STILL)
        self.ends = float(times[moving[-1]] + _SAMPLES) if len(moving) else 0.0
        self._way = way
        impedance = self.balance.setup.scenario.impedance
        if impedance.schedule:
            self._schedule = SimpleNamespace(**Schedule().constants(self.balance.setup))
            self.ends = max(self.ends, impedance.schedule[-1].time + impedance.schedule[-1].ramp)

    def velocity(self) -> np.ndarray:
        """The velocity (6,) at the start, relative to the reference."""
        setup = self.balance.setup
        return np.zeros(6) if setup.not_rigid else np.array(setup.scenario.initial.velocity)

    def lead(self, pose: Pose, t: float, step: float) -> np.ndarray:
        balance = self.balance
        if self.memory is not None:
            self.memory.step = step if step <= LAST_STEP else math.inf
            if self.limits:  # a law that winds up does not hold the vehicle
                self.memory.step = min(step, LONGEST_OF_STATES) if step <= LAST_STEP else STATES_AT_REST
        if step > LAST_STEP:  # the root needs the derivatives where it is
            self._law = None
        self._latest, self._before, self._by_water = (None, None), None, None
        p_d, quat_d = self.reference(t)
        balance.p_d, balance.quat_d = self.reference(t + step)
        if self._schedule is not None:
            Schedule.step(self._schedule, None, SimpleNamespace(t=t + step), None, balance)
        moved, quat_e = pose.R_WB.T @ (balance.p_d - p_d), np.empty(4)
        quat_error(quat_d, balance.quat_d, quat_e)
        turned = rotation_matrix(quat_d) @ (2.0 * quat_e[1:])
        lead = np.concatenate([moved, pose.R_WB.T @ turned]) if self.led else np.zeros(6)
        self._from, self._step, self._nu_d = pose, step, (self._nu_d[0], lead / step)
        self._led = (self._nu_d[1] - self._nu_d[0]) / step
        return lead

    def reference(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) and attitude (4,) of the reference."""
        if self._way is None or t >= self.ends:
            return self._end
        times, positions, quats = self._way
        k = min(int(np.searchsorted(times, t, side="right")), len(times) - 1)
        part = min(1.0, (t - times[k - 1]) / (times[k] - times[k - 1])) if k else 1.0
        quat = quats[k - 1] + part * (quats[k] * np.sign(quats[k] @ quats[k - 1]) - quats[k - 1])
        position = positions[k - 1] + part * (positions[k] - positions[k - 1])
        beside = (1.0 - (t / self.ends) ** 2) * self.beside
        return position + beside, quat_turned(quat / np.linalg.norm(quat), TURN_BESIDE * beside)


def between(a: Pose, b: Pose) -> np.ndarray:
    """Displacement (3,) and rotation vector (3,) from a pose to another one, in the axes of the first."""
    quat_e = np.empty(4)
    quat_error(a.quat, b.quat, quat_e)
    return np.concatenate([a.R_WB.T @ (b.position - a.position), 2.0 * quat_e[1:]])
