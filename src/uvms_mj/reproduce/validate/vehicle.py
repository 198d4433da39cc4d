"""The vehicle of the pool, and the models of it that are compared.

The arm is ``bluerov2_alpha5``'s as it ships; the vehicle that carries it is another one. Kolano and Davidson
(2023, UVMS-SysID-with-EAs, MIT) weighed it and fitted the trim weights' places to its attitude at rest; drag is Wu's
(2018), inertia and added mass are von Benzon et al.'s (2022) for the BlueROV2 Heavy. Trust: high for mass and
buoyancy, medium for the trim, whose places are the authors' guesses, medium for the rest.

In a run the vehicle floats freely, its thrusters off, and the arm is driven along a motion. The water acts as in every
run. A joint follows its motion by a torque K (q_dot_d + (q_d - q) / T - q_dot). The last term is the joint's damping,
which MuJoCo's Euler step treats implicitly, so that K may be large: the joint then has the velocity q_dot_d + (q_d - q)
/ T within the load over K, and the error of its angle is the load T / K, below 1e-4 rad here. The torque acts between
two links, and the vehicle floats freely under it.

**Fast swing.** One motion would tell the models apart: axis d swings, at its speed limit, about the arm stretched
forwards. The trials of the pool are slow: a joint turns once from one posture to another, within ten seconds, and the
vehicle passes through attitudes near the rest. Added mass and drag act on accelerations and speeds. They count when the
arm swings near the period in which the model swings freely in pitch, 2.8 s; the speed limit then leaves 13 degrees.
"""

import functools
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline

from ...engine.native.attachment import immerse
from ...files import shipped
from ...physics.frames import quat_from_euler_deg
from ...plant.arm import Link, skew
from ...plant.vehicle import Vehicle
from .data import Attitude, Motion

ARM_OF = "bluerov2_alpha5"
GRAVITY = 9.81
MASS, INERTIA = 13.17, (0.26, 0.23, 0.37)
DISPLACED, CENTRE_OF_BUOYANCY = 13.082, (0.0074, 0.0, 0.02)
HEIGHT = CENTRE_OF_BUOYANCY[2]
"""Height of the vehicle's centre of buoyancy above its centre of gravity, without trim and arm [m]."""
ADDED_MASS = (6.36, 7.12, 18.69, 0.186, 0.135, 0.222)
LINEAR, QUADRATIC = (4.03, 6.22, 5.18, 0.07, 0.07, 0.07), (18.18, 21.66, 36.99, 1.55, 1.55, 1.55)
MOUNT = (0.25, -0.10965, 0.005)
"""The arm's frame in B; its axes are B's."""
TUBE, TUBE_AT = 0.202, (-0.075, -0.006, -0.003)
"""Displaced mass of the tube that carries the arm [kg], and its centre in the arm's frame."""
WEIGHTS = (
    (3.24, (-0.20, 0.165, -0.075)),
    (1.62, (-0.0975, 0.1275, -0.1325)),
    (1.62, (-0.0975, -0.1275, -0.1325)),
    (0.69, (-0.1887, 0.0439, -0.0595)),
    (1.01, (-0.1542, 0.0439, -0.0795)),
)
"""Weight in water [N] and place in B of what trims the vehicle: three weights, the DVL and its bracket."""
FOAM = ((8.46, (0.0, 0.11, 0.027)), (8.86, (0.0, -0.11, 0.027)))
"""Force upwards [N] and place in B of the foam."""
TIMESTEP = 2e-3
"""Half of it changes the attitude by less than 1e-3 deg [s]."""
SERVO, TRACKING = 200.0, 0.02
"""Gain of the joints' servos [N m s/rad], and the time in which they follow [s]: see above."""
VARIANTS = ("as is", "no water on the links", "lumped")
STATIC = "hydrostatics alone"
"""A naive model beside them: at each instant the attitude in which weight and buoyancy balance, without any motion."""


@dataclass(frozen=True)
class Variant:
    """A model of the vehicle: its treatment of the added mass and the drag of its links, one of :data:`VARIANTS`, or
    :data:`STATIC`, and the height of the centre of buoyancy [m]."""

    links: str = "as is"
    height: float = HEIGHT


@functools.cache
def model() -> mujoco.MjModel:
    """The model of the rigid bodies. The servos give the joint damping; the gears have no friction."""
    spec = mujoco.MjSpec.from_file(str(shipped("models")[ARM_OF]))
    spec.option.timestep = TIMESTEP
    spec.compiler.discardvisual = True
    base = spec.body(ARM_OF)
    base.mass, base.ipos, base.inertia = MASS, np.zeros(3), INERTIA
    arm = spec.body("arm_base")
    arm.pos, arm.quat, arm.alt.type = MOUNT, (1.0, 0.0, 0.0, 0.0), mujoco.mjtOrientation.mjORIENTATION_QUAT
    for force, place in WEIGHTS:
        base.add_body(pos=place, mass=force / GRAVITY, ipos=[0, 0, 0], inertia=[1e-6] * 3, explicitinertial=True)
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            joint.damping[0], joint.frictionloss, joint.limited = SERVO, 0.0, mujoco.mjtLimited.mjLIMITED_FALSE
            joint.armature = 0.0  # guessed in the file, and the servo moves the joint whatever it is
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    return spec.compile()


def vehicle(variant: Variant, q: np.ndarray) -> Vehicle:
    """The vehicle's coefficients. The lumped model adds the added mass of all links, at joint angles q (4,), to the
    added mass of the base, and keeps the diagonal alone; the links keep their drag."""
    read = Vehicle.from_model(model())
    centre = np.array((*CENTRE_OF_BUOYANCY[:2], variant.height))
    parts = [(DISPLACED, centre), (TUBE, np.add(MOUNT, TUBE_AT))]
    parts += [(force / GRAVITY, np.array(place)) for force, place in FOAM]
    displaced = sum(mass for mass, _ in parts)
    r_b = np.sum([mass * place for mass, place in parts], axis=0) / displaced
    M_A, links = np.diag(ADDED_MASS), read.arm.links
    if variant.links == "lumped":
        M_A = np.diag(np.diag(M_A + _of_links(links, q)))
    if variant.links in ("no water on the links", "lumped"):
        keeps = 1.0 if variant.links == "lumped" else 0.0
        links = tuple(
            replace(link, M_A=np.zeros((6, 6)), D_quadratic=keeps * link.D_quadratic, D_linear=keeps * link.D_linear)
            for link in links
        )
    return replace(
        read,
        M_A=M_A,
        D_linear=np.diag(LINEAR),
        D_quadratic=np.diag(QUADRATIC),
        displaced_mass=displaced,
        r_b=r_b,
        arm=replace(read.arm, links=links),
    )


def _of_links(links: tuple[Link, ...], q: np.ndarray) -> np.ndarray:
    """(6, 6) added mass of the links at joint angles q as if they were rigidly on the base: sum of J^T M_A J."""
    total = np.zeros((6, 6))
    for link, (p, R) in zip(links, _poses(links, q), strict=True):
        J = np.zeros((6, 6))
        J[:3, :3] = J[3:, 3:] = R.T
        J[:3, 3:] = -R.T @ skew(p)
        total += J.T @ link.M_A @ J
    return total


def _poses(
    links: tuple[Link, ...], q: np.ndarray, data: mujoco.MjData | None = None
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Position (3,) and rotation (3, 3) of each link in B."""
    data = data or mujoco.MjData(model())
    data.qpos[:] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, *q
    mujoco.mj_kinematics(model(), data)
    return [(data.xpos[link.body_id].copy(), data.xmat[link.body_id].reshape(3, 3).copy()) for link in links]


def righting(given: Vehicle, q: np.ndarray, data: mujoco.MjData | None = None) -> np.ndarray:
    """(3,) moment of buoyancy and weight, in B [N m]: the sum of each upward force times its place. Where the forces
    balance, it points upwards at rest, and its length is the moment per unit of sin(heel). For many postures give the
    ``data`` to work in."""
    moment = given.displaced_mass * given.r_b - given.mass * given.r_g
    for link, (p, R) in zip(given.arm.links, _poses(given.arm.links, q, data), strict=True):
        moment = moment + link.displaced_mass * (p + R @ link.r_b) - link.mass * (p + R @ link.r_g)
    return GRAVITY * moment


def at_rest(moment: np.ndarray) -> tuple[float, float]:
    """Roll and pitch [rad] at rest, from the moment of :func:`righting`."""
    x, y, z = moment / np.linalg.norm(moment)
    return float(np.arctan2(y, z)), float(-np.arcsin(x))


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


STRETCHED = tuple(np.radians([0.0, 74.5, 164.5, 0.0]))
"""Joint angles, axes e to b, of the arm stretched forwards, .36 m long [rad]."""
FASTEST = np.radians(30.0)
"""Speed limit of the axes e, d and c of the Reach Alpha 5 [rad/s]."""
PERIOD, PERIODS = 2.8, 8
"""Of the swing [s], and how many of them."""
AMPLITUDE = FASTEST * PERIOD / (2.0 * np.pi)
"""Of axis d [rad], so that it reaches the limit in each half swing."""
_JOINT, _STEP = 1, 0.01


def swing() -> Motion:
    """The motion, which grows to its amplitude in the first period."""
    t = np.arange(0.0, PERIODS * PERIOD + 0.5 * _STEP, _STEP)
    share = np.clip(t / PERIOD, 0.0, 1.0)
    q = np.tile(STRETCHED, (len(t), 1))
    q[:, _JOINT] += AMPLITUDE * share**2 * (3.0 - 2.0 * share) * np.sin(2.0 * np.pi * t / PERIOD)
    return Motion(0.0, float(t[-1]), CubicSpline(t, q))
