"""The posture of a vehicle with joints: levels for the motion that the task leaves free.

The kernel is :func:`uvms_mj.physics.operational.posture`. Gains are natural frequencies, so that the
torques scale with the inertia that a level has.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import BeforeValidator
from pydantic.dataclasses import dataclass as table

from ..errors import Fault
from ..physics.frames import BODY, quat_from_euler_deg, rotation_matrix
from ..physics.kernels import fused
from ..physics.linear_algebra import cholesky, inverse
from ..physics.operational import FREEDOM, free_of_base, posture
from ..physics.statics import Statics
from ..physics.tree import MOST_JOINTS
from ..quantities import STRICT, Angles, Number, Position, Step, Switch, doc, refusing, within
from ..stages.base import Room, Stage
from ..stages.setup import ScenarioLike, SetupLike
from ..stages.signals import CLOCK, MEASURED, Signal

LEVELS = ("attitude", "station", "joints")
"""The levels by the numbers of the kernel."""
_Frequency = Annotated[Number, within(0.0, 1e3, "rad/s")]
_Once = refusing(lambda order: len(set(order)) < len(order), "names a level twice")
_LEVELS = 'must be a list with any of "attitude", "station" and "joints", for example ["joints"]'
_List = refusing(lambda order: not isinstance(order, list | tuple), _LEVELS, BeforeValidator)


@table(frozen=True, config=STRICT)
class Posture:
    """Levels below the task, each with the motion that those before it leave."""

    of_world: ClassVar[bool] = False
    order: Annotated[tuple[Literal["attitude", "station", "joints"], ...], _List, _Once] = doc(
        'levels of the posture, the most important one first: any of "attitude", "station" and "joints"',
        ("attitude", "joints"),
    )
    attitude_deg: Angles | None = doc(
        "roll, pitch, yaw that the level attitude holds; default: initial.attitude_deg [deg]", None
    )
    yaw: Switch = doc("true: the level attitude holds yaw too, not roll and pitch alone", False)
    station: Position | None = doc(
        "position of B in W that the level station keeps; default: initial.position [m]", None
    )
    joints: tuple[Number, ...] | None = doc(
        "position of each joint that the level joints holds; default: initial.joints [rad or m]", None
    )
    attitude_frequency: _Frequency = doc("natural frequency of the level attitude [rad/s]", 2.0)
    station_frequency: _Frequency = doc("natural frequency of the level station [rad/s]", 0.5)
    joints_frequency: _Frequency = doc("natural frequency of the level joints [rad/s]", 2.0)
    damping_ratio: Annotated[Number, within(0.0, 1e3, "")] = doc("damping ratio of all levels [1]", 1.0)
    period: Step = doc(
        "time between its instants, rounded to control periods, at least one: its motion is slow [s]", 1e-3
    )
    free_damping: Annotated[Number, within(0.0, 1e3, "1/s")] = doc(
        "rate at which the motion that no level governs decays [1/s]", 1.0
    )


def posture_constants(setup: SetupLike) -> dict[str, Any]:
    """The settings of the kernel :func:`uvms_mj.physics.operational.posture`, from the run's Setup."""
    given, initial = setup.scenario.posture, setup.scenario.initial
    frequency = np.array([getattr(given, f"{level}_frequency") for level in LEVELS])
    levels = [LEVELS.index(level) for level in given.order]
    joints = setup.plant.initial_joints(initial) if given.joints is None else np.array(given.joints)
    quat_d = quat_from_euler_deg(*(initial.attitude_deg if given.attitude_deg is None else given.attitude_deg))
    return {
        "levels": np.array([*levels, *[-1] * (3 - len(levels))], dtype=float),
        "frequency": frequency,
        "damping": 2.0 * given.damping_ratio * frequency,
        "yaw": given.yaw,
        "quat_d": quat_d,
        "up_d": rotation_matrix(quat_d)[2],
        "p_d": np.array(initial.position if given.station is None else given.station),
        "joints": np.concatenate([joints, np.zeros(MOST_JOINTS - len(joints))]),
        "free_damping": given.free_damping,
    }


def posture_faults(setup: SetupLike) -> Iterator[Fault]:
    """Errors of ``[posture]`` that need the vehicle and the interface of its joints."""
    given, links = setup.scenario.posture, setup.nominal.arm.links
    if not links:
        if given != Posture():
            model = setup.scenario.vehicle.model
            yield Fault("posture", f"the vehicle {model!r} has no joints, so the task leaves nothing to a posture")
        return
    interface = setup.interface
    if not type(interface).torque_controlled and given != Posture():
        yield Fault(
            "posture", f"the joint interface {interface.label()} holds the joints itself; use joints.name=torque"
        )
    if given.joints is None:
        return
    if len(given.joints) != len(links):
        names = ", ".join(link.joint for link in links)
        yield Fault("posture.joints", f"has {len(given.joints)} values; {len(links)} are needed, for {names}")
        return
    for k, (q, link) in enumerate(zip(given.joints, links, strict=True)):
        if wrong := link.out_of_range(q):
            yield Fault(f"posture.joints[{k}]", wrong)


def posture_notes(setup: SetupLike) -> Iterator[str]:
    """Notes on levels that have no freedom left in the initial posture."""
    given, arm = setup.scenario.posture, setup.nominal.arm
    if not arm.links or not type(setup.interface).torque_controlled:
        return
    statics = Statics(setup.nominal, setup.plant.initial_joints(setup.scenario.initial))
    frame, one = setup.scenario.task.frame, np.eye(6 + len(arm.links))
    J, mobility = one[:6] if frame == BODY else statics.jacobian(arm.sites[frame]), np.linalg.inv(statics.inertia())
    free = mobility - mobility @ J.T @ np.linalg.solve(J @ mobility @ J.T, J @ mobility)
    up = rotation_matrix(quat_from_euler_deg(*setup.scenario.initial.attitude_deg))[2]
    tilt = np.linalg.svd(up[None])[2][1:] @ one[3:6]
    rows = {"attitude": one[3:6] if given.yaw else tilt, "station": one[:3], "joints": one[6:]}
    above = ["the task"]
    for level in given.order:
        J = np.linalg.solve(np.linalg.cholesky(rows[level] @ mobility @ rows[level].T), rows[level])
        shares, V = np.linalg.eigh(J @ free @ J.T)
        claimed = shares > (FREEDOM if level != "joints" else 1e-9)
        if not claimed.any() and given != Posture():
            yield f"posture.order: no freedom is left to the level {level} by {' and '.join(above)}"
        X = (V.T @ J @ free)[claimed]
        free = free - X.T @ (X / shares[claimed, None])
        above.append(level)


@dataclass(frozen=True)
class PostureBelowTool(Stage):
    """N^T tau_posture = M (a - a_0 + P h) below a task at a tool, which is the stage's signal. ``given`` has the
    measurements at B; ``state`` is the record of the run. The levels begin with a_0 = -J_bar J_dot zeta of the law,
    which keeps the tool's velocity."""

    name = "posture_below_tool"
    room: ClassVar[Room] = Room(
        "control",
        "posture",
        lambda thrusters: CLOCK + MEASURED,
        (Signal("tau_posture", (0,), "N, N m", "B", "wrench on the base and torques of the joints"),),
    )

    def period_in(self, scenario: ScenarioLike) -> float:
        """``posture.period`` in whole control periods [s]."""
        control = scenario.control_period
        return control * max(1, round(scenario.posture.period / control))

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        return posture_constants(setup)

    @staticmethod
    @fused
    def step(settings, state, given, state_dot, out):
        model, zeta, M_inv = state.model, np.zeros_like(out), np.zeros_like(state.model.M)
        zeta[:6], zeta[6:] = given.nu, state.joints.q_dot_m
        inverse(model.L, M_inv)
        P = M_inv - model.J_bar @ model.MJ_T.T  # M^-1 - J_bar J M^-1
        of_law = -(model.J_bar @ model.J_dot_zeta)
        compensated = P @ (model.C + model.D + model.g) - of_law
        a = of_law.copy()
        posture(settings, given, zeta, state.joints.q_m, model.M, M_inv, P, a)
        out[:] = model.M @ (a + compensated)


@dataclass(frozen=True)
class PostureBesideBase(PostureBelowTool):
    """tau_posture = M a + [0; h_q] of a task at B, whose law compensates the rows of h for the base."""

    name = "posture_beside_base"

    @staticmethod
    @fused
    def step(settings, state, given, state_dot, out):
        model, M = state.model, state.model.M
        zeta, a, M_inv, P = np.zeros_like(out), np.zeros_like(out), np.zeros_like(M), np.zeros_like(M)
        zeta[:6], zeta[6:] = given.nu, state.joints.q_dot_m
        cholesky(M, model.L)
        inverse(model.L, M_inv)
        free_of_base(M, P)
        posture(settings, given, zeta, state.joints.q_m, M, M_inv, P, a)
        out[:] = M @ a
        out[6:] += model.C[6:] + model.D[6:] + model.g[6:]
