"""Warnings for the motion that a task leaves free: a vehicle with joints that comes to no rest behind its tool."""

import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..control.design import demanded_force
from ..control.theory.free_motion import FreeMotion
from ..control.theory.task_motion import Track
from ..control.theory.terms import Pose, ThrustMap
from ..guidance.base import samples
from ..physics.frames import quat_from_euler_deg, rotation_matrix
from ..stages.base import is_shipped

_FAR = 0.1
"""Motion of a joint that no level of the posture holds, from which it is worth a warning [rad or m]."""
_NEAR = 0.7
"""Share of its speed limit from which a joint is near it: the estimate is that of small motions."""
_SAMPLES, _SAMPLED_S = 100, 0.1
"""Number of velocities of the reference for this estimate, and the time between them [s]."""


def free_motion_notes(setup: Any) -> Iterator[str]:
    """Warnings for a vehicle whose base and joints come to no rest while the law holds the frame of the task, or whose
    joints are too slow for it."""
    scenario, links = setup.scenario, setup.vehicle.arm.links
    if not links or not type(setup.interface).torque_controlled or isinstance(thrust_map := ThrustMap.of(setup), str):
        return
    position, attitude_deg = setup.rest_pose
    push = demanded_force(scenario) if setup.contacts.paper else 0.0
    tau_c = -setup.design.normal * (push if math.isfinite(push) else 0.0)
    motion = FreeMotion(setup, thrust_map, _still(position or setup.initial.position, attitude_deg, tau_c))
    yield from _restless(setup, motion)
    if any(math.isfinite(link.speed_limit) for link in links):
        yield from _slow_motors(setup, thrust_map)


def _still(position: Any, attitude_deg: Any, tau_c: np.ndarray) -> Track:
    """The track of a frame that stays at a pose (3,), (3,) [m, deg] with a contact wrench (6,) [N, N m]."""
    quat = quat_from_euler_deg(*attitude_deg)
    return Track([0.0], [Pose(np.array(position), quat, rotation_matrix(quat), tau_c)])


def _restless(setup: Any, motion: FreeMotion) -> Iterator[str]:
    """A warning if the slow motion from the initial posture comes to no rest, or to one that the motors or thrusters
    can't hold, or moves far where no level holds it."""
    scenario, q = setup.scenario, motion.rest()
    order, frame = scenario.posture.order, scenario.task.frame
    pushed = any(scenario.current.velocity_W) or scenario.disturbance.at_last.any()
    if isinstance(q, str):
        moves, weak = q, ""
    else:
        moves = _moves(setup, q) if pushed and "joints" not in order else ""
        weak = motion.infeasible(motion.push(q).tau)
    if moves and "joints" not in order:
        yield (
            f"nothing holds the motion that posture.order = {json.dumps(order)} leaves free while the law holds "
            f'{frame}: {moves}; add "joints" to it'
        )
    elif moves:
        yield (
            f"the posture gives way while the law holds {frame}: {moves}; choose other initial.joints, a larger "
            "posture.joints_frequency or a weaker current"
        )
    elif weak:
        yield f"the vehicle can't hold its rest behind {frame}: {weak}; choose other initial.joints or a weaker current"


def _moves(setup: Any, q: np.ndarray) -> str:
    """Which joint is farthest from its start at q (n,); empty if none is far."""
    start = setup.start.q
    k = int(np.abs(q - start).argmax())
    link = setup.vehicle.arm.links[k]
    if abs(q[k] - start[k]) < _FAR:
        return ""
    angles = (f"{x:.3g} m" if link.slide else f"{math.degrees(x):.3g} deg" for x in (start[k], q[k]))
    return f"{link.joint} moves from {' to '.join(angles)}"


def _slow_motors(setup: Any, thrust_map: ThrustMap) -> Iterator[str]:
    """A warning for joints that come near their speed limits, where a motor gives no torque."""
    scenario, initial = setup.scenario, setup.initial
    motion = FreeMotion(setup, thrust_map, _still(initial.position, initial.attitude_deg, np.zeros(6)))
    every = max(1, round(_SAMPLED_S / scenario.control_period))
    reference = scenario.reference
    velocities = np.zeros((_SAMPLES, 3))
    if not reference.states and not reference.memory and is_shipped(reference):
        velocities = samples(reference, setup, range(0, every * _SAMPLES, every))["p_d_dot"]
    speeds = motion.speeds(velocities, every * scenario.control_period)
    near = [
        f"{link.joint} about {speed:.2g} of {link.speed_limit:.3g} {'m/s' if link.slide else 'rad/s'}"
        for link, speed in zip(setup.vehicle.arm.links, speeds, strict=True)
        if speed > _NEAR * link.speed_limit
    ]
    if near:
        yield (
            "the joints come near their speed limits, at which a motor has no torque left and the law may lose "
            f"{scenario.task.frame}: {', '.join(near)}; choose a slower reference, a larger posture.joints_frequency "
            "or a weaker current"
        )
