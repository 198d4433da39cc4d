"""One run: the vehicle floats freely, its thrusters off, and the arm is driven along a motion.

The water is that of every run. A joint follows its motion by a torque K (q_dot_d + (q_d - q) / T - q_dot). The last
term is the joint's damping, which MuJoCo's Euler step treats implicitly, so that K may be large: the joint then has the
velocity q_dot_d + (q_d - q) / T within the load over K, and the error of its angle is the load T / K, below 1e-4 rad
here. The torque acts between two links, and the vehicle floats freely under it.
"""

import mujoco
import numpy as np

from ...engine.native.attachment import immerse
from ...physics.frames import quat_from_euler_deg
from .data import Attitude, Motion
from .vehicle import SERVO, STATIC, TIMESTEP, TRACKING, Variant, at_rest, model, righting, vehicle

_EVERY = 10
"""Steps from one row of the response to the next."""
_STILL = 0.1
"""Time from one balance of weight and buoyancy to the next [s]. Joints follow smoothed angles, over 0.6 s."""


def floating(motion: Motion, variant: Variant) -> Attitude:
    """The attitude of the vehicle over the time of a motion, from rest in the motion's first posture. Yaw is that since
    the beginning."""
    if variant.links == STATIC:
        return balanced(motion, variant)
    t, states = driven(motion, variant)
    return Attitude.of(t[::_EVERY], states[::_EVERY, 3:7])


def balanced(motion: Motion, variant: Variant) -> Attitude:
    """The attitude in which weight and buoyancy balance, at each posture of a motion. Yaw is zero."""
    t = np.append(np.arange(motion.begin, motion.end, _STILL), motion.end)
    given, data = vehicle(variant, motion.q(motion.begin)), mujoco.MjData(model())
    return Attitude(t, np.array([(*at_rest(righting(given, q, data)), 0.0) for q in motion.q(t)]))


def driven(motion: Motion, variant: Variant) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) and qpos (n, 11) of every step: position, quaternion and joint angles."""
    rigid, first = model(), motion.q(motion.begin)
    data = mujoco.MjData(rigid)
    given = vehicle(variant, first)
    roll, pitch = np.degrees(at_rest(righting(given, first)))
    data.qpos[:] = 0.0, 0.0, 0.0, *quat_from_euler_deg(roll, pitch, 0.0), *first
    t = motion.begin + TIMESTEP * np.arange(int((motion.end - motion.begin) / TIMESTEP) + 1)
    torque = SERVO * (motion.q(t, 1) + motion.q(t) / TRACKING)  # the part that does not depend on the state
    states = np.empty((len(t), rigid.nq))
    q, applied = data.qpos[7:], data.qfrc_applied[6:]
    with immerse(rigid, data, given):
        for k in range(len(t)):
            states[k] = data.qpos
            applied[:] = torque[k] - SERVO / TRACKING * q
            mujoco.mj_step(rigid, data)
    return t, states
