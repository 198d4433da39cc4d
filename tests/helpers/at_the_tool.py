"""Random pushes of an arm's tool on a wall, which begin near the rest, and the force at rest by hand."""

import math
from typing import Any

import numpy as np

from tool_arm import JOINTS
from uvms_mj import Scenario
from uvms_mj.physics.frames import quat_from_euler_deg, rotation_matrix
from uvms_mj.physics.statics import Statics
from uvms_mj.plant.contacts import Probe
from uvms_mj.setup.base import set_up

LINKS = ("shoulder", "upper_arm", "forearm", "wrist", "hand")


def euler_deg(R: np.ndarray) -> list[float]:
    """Roll, pitch, yaw of a rotation (3, 3) [deg]."""
    roll, yaw = math.atan2(R[2, 1], R[2, 2]), math.atan2(R[1, 0], R[0, 0])
    return np.degrees([roll, math.atan2(-R[2, 0], math.hypot(R[2, 1], R[2, 2])), yaw]).tolist()


def random_push(model: str, rng: np.random.Generator) -> tuple[dict[str, Any], float]:
    """Overrides of a random posture, wall, current, desired impedance, gains and wrong estimates, whose tool begins at
    x_c in the desired attitude; and the force at rest, (x_d - x_c)/(n^T K_d^-1 n + 1/k_c) [N]."""
    setup = set_up(Scenario.load("push_wall", {"vehicle.model": model, "task.frame": "tool"}))
    q, x_c = rng.uniform(-1.2, 1.2, JOINTS), float(rng.uniform(-2.0, 2.0))
    attitude = (*rng.uniform(-15.0, 15.0, 2), rng.uniform(-180.0, 180.0))
    R_WB = rotation_matrix(quat_from_euler_deg(*map(float, attitude)))
    p, R = Statics(setup.vehicle, q).pose(Probe.of("tool", setup.plant.mjcf).carrier)
    tool = np.array([x_c, *rng.uniform(-1.0, 1.0, 2)])
    K_d, k_c = [*rng.uniform(100.0, 1500.0, 3), *rng.uniform(20.0, 60.0, 3)], float(10.0 ** rng.uniform(3.0, 5.0))
    n = (R_WB @ R).T @ [1.0, 0.0, 0.0]
    depth = float(rng.uniform(0.004, 0.02))
    force = depth / (n @ (n / K_d[:3]) + 1.0 / k_c)
    factors = {key: rng.uniform(0.7, 1.4, JOINTS) for key in ("inertia", "coriolis", "restoring")}
    factors["damping"] = rng.uniform(0.4, 1.0, JOINTS)  # more than the true one would drive the free motion
    links = [{"name": name, **{key: float(each[k]) for key, each in factors.items()}} for k, name in enumerate(LINKS)]
    target = [float(tool[0]) + depth, *tool[1:].tolist()]
    return {
        "vehicle.model": model,
        "task.frame": "tool",
        "initial.joints": q.tolist(),
        "initial.position": (tool - R_WB @ p).tolist(),
        "initial.attitude_deg": list(map(float, attitude)),
        "reference.target": target,
        "reference.start": target,
        "reference.attitude_deg": euler_deg(R_WB @ R),
        "wall.position": x_c,
        "wall.stiffness": k_c,
        "wall.damping": float(rng.uniform(0.0, 100.0)),
        "current.speed": float(rng.uniform(0.0, 0.5)),
        "current.direction_deg": float(rng.uniform(-180.0, 180.0)),
        "impedance.K_d": K_d,
        "estimates.inertia": float(rng.uniform(0.8, 1.3)),
        "estimates.links": links,
        "controller.k_1": float(rng.uniform(4.0, 8.0)),
        "controller.k_2": float(rng.uniform(15.0, 30.0)),
        "controller.beta": float(rng.uniform(4.0, 7.0)),
    }, force
