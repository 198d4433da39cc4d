"""The force at rest that the desired impedance demands."""

import math

import numpy as np

from ..control.design import wall_normal
from ..physics.frames import quat_from_euler_deg
from ..scenario import Scenario


def demanded_force(scenario: Scenario, k_c: float | None = None) -> float:
    r"""The pushing force on a wall at rest that the desired impedance demands, for any disturbance [N].

    With eq. (7) at rest, K_d eta_e = K_f (tau_c - F_d), and the wall's spring (34) along its normal n in B,

    .. math:: F = \max\left(0, \frac{x_d - x_c - n^\top K_d^{-1} K_f F_d}{n^\top K_d^{-1} K_f n + 1/k_c}\right)

    For the paper's K_f = I, F_d = 0 this is K_x (x_d - x_c) / (1 + K_x / k_c), and K_x (x_d - x_c) for a rigid wall. If
    K_d is zero along n, it is the force demanded by F_d. F_d must be without moments. A bumper is in series with the
    wall, 1/k_c + 1/k_b. The result is infinite for a rigid wall and K_f = 0, and NaN for a reference that does not come
    to rest, or if the probe and ``[wall]`` are not the only contact.

    Args:
        scenario: with reference, wall and impedance.
        k_c: stiffness of the wall [N/m], infinite for a rigid one; default: the scenario's.
    """
    impedance, wall = scenario.impedance, scenario.wall
    if not wall.present or scenario.walls or scenario.vehicle.contact_bodies:
        return math.nan
    target, attitude_deg = scenario.reference.rest_pose(scenario)
    normal = wall_normal(quat_from_euler_deg(*attitude_deg))
    K_f, K_d, F_d = (np.array(values) for values in (impedance.at_end[0], impedance.K_d, impedance.at_end[1]))
    pushed = np.abs(normal) > 1e-12
    n, K_d, K_f, F_d = normal[pushed], K_d[pushed], K_f[pushed], F_d[pushed]
    limp = K_d == 0.0
    if limp.any():  # without a spring, eq. (7) is K_f (F n + F_d) = 0
        forces = -F_d[limp] / n[limp]
        return max(0.0, float(forces[0])) if K_f[limp].all() and np.ptp(forces) < 1e-9 else 0.0
    give = K_f / K_d
    if target is None:
        return math.nan
    distance = target[0] - wall.position - float(n @ (give * F_d))
    yielding = float(n @ (give * n)) + 1.0 / (wall.stiffness if k_c is None else k_c)
    yielding += 1.0 / (scenario.bumper.stiffness or math.inf)
    return max(0.0, distance / yielding) if yielding > 0.0 else math.inf if distance > 0.0 else 0.0
