"""The frame of the task in a run: the place where it starts, and the combinations that are not computed."""

import math
from collections.abc import Iterator

import numpy as np

from ..control.task import ImpedanceTask
from ..errors import Fault
from ..physics.frames import BODY, quat_from_euler_deg, rotation_matrix
from ..physics.statics import Statics
from ..plant.settings import Initial
from ..plant.vehicle import Vehicle
from ..scenario import Scenario
from ..stages.setup import SetupLike


def task_start(scenario: Scenario, nominal: Vehicle) -> Initial:
    """The initial pose of the frame of the task, B or the tool, whose velocity is left out."""
    initial = scenario.initial
    if scenario.task.frame == BODY:
        return initial
    posture = Statics(nominal, nominal.arm.start(initial.joints))
    p_BT, R_BT = posture.pose(nominal.arm.sites[scenario.task.frame])
    R_WB = rotation_matrix(quat_from_euler_deg(*initial.attitude_deg))
    position = np.array(initial.position) + R_WB @ p_BT
    return Initial(tuple(position.tolist()), euler_deg(R_WB @ R_BT))


def euler_deg(R: np.ndarray) -> tuple[float, float, float]:
    """Roll, pitch and yaw of a rotation (3, 3) [deg]; roll is zero where only its sum with yaw counts."""
    level = math.hypot(R[2, 1], R[2, 2])
    pitch = math.atan2(-R[2, 0], level)
    roll, yaw = math.atan2(R[2, 1], R[2, 2]), math.atan2(R[1, 0], R[0, 0])
    if level < 1e-9:
        roll, yaw = 0.0, math.atan2(-R[0, 1], R[1, 1])
    return math.degrees(roll), math.degrees(pitch), math.degrees(yaw)


def task_faults(setup: SetupLike) -> Iterator[Fault]:
    """Errors for elements that are computed for a rigid vehicle with the frame of the task at B only, and for a setting
    without effect there."""
    reason, scenario = setup.not_rigid, setup.scenario
    if not reason and scenario.task.inertia_period != ImpedanceTask.inertia_period:
        yield Fault("task.inertia_period", "has no effect: M_hat of a rigid vehicle at B is constant")
    if reason and scenario.controller.uses_truth:
        label = scenario.controller.label()
        yield Fault("controller.name", f"{label} knows the truth of a rigid vehicle at B only, and {reason}")
    if reason and scenario.observer.runs:
        label = scenario.observer.label()
        yield Fault("observer.name", f"{label} observes a rigid vehicle at B only, and {reason}; use none")


def task_notes(setup: SetupLike) -> Iterator[str]:
    """Warnings for joints without a motor or with one that is too weak, and for a law at a tool: Coulomb friction of
    the gears, which no law compensates."""
    passive = [link.joint for link in setup.vehicle.arm.links if link.effort == 0.0]
    if passive:
        yield (
            f"no motor drives {', '.join(passive)}, which a law at a tool, a posture and the joint interfaces command: "
            "a joint without a motor moves freely"
        )
    yield from _weak_motors(setup)
    rubbing = [link for link in setup.vehicle.arm.links if link.friction > 0.0]
    if rubbing and setup.scenario.task.frame != BODY:
        most = max(rubbing, key=lambda link: link.friction)
        yield (
            f"the gears have Coulomb friction, up to {most.friction:g} N m or N at {most.joint}, which the law at "
            f"{setup.scenario.task.frame} does not know: the tool may stick, and lose a wall again and again; "
            "vehicle.coulomb_friction = 0 leaves it out"
        )


def _weak_motors(setup: SetupLike) -> Iterator[str]:
    """A warning for motors that cannot hold the true arm at its initial joints, even with the gears' friction."""
    R_WB = rotation_matrix(quat_from_euler_deg(*setup.scenario.initial.attitude_deg))
    needed = np.abs(setup.start.restoring(R_WB, setup.gravity_W)[6:])
    weak = [
        f"{link.joint} needs {tau:.3g} and has {link.effort:.3g} {'N' if link.slide else 'N m'}"
        for link, tau in zip(setup.vehicle.arm.links, needed, strict=True)
        if 0.0 < link.effort < tau - link.friction
    ]
    if weak:
        yield (
            "the motors are too weak to hold the arm against its weight and buoyancy at the initial joints: "
            f"{', '.join(weak)}"
        )
