"""The force of a law on the frame of its task as machine code, and its derivatives: as in
:class:`.task_motion.TaskMotion`, with and without the limits of the thrusters.
"""

import numpy as np

from ...physics.kernels import kernel
from .approach import LAST_STEP
from .motion_record import RESIDUAL
from .motion_terms import between, copied, displaced, press, sense, thrust, velocity_at
from .task_motion import OUTDATED, ROUNDING
from .terms import DIFFERENCE


@kernel
def free_force(motion, world, x, out):
    """Set out (6,) to the force of the law without limits at a pose."""
    sense(motion, world, x)
    world[RESIDUAL](motion, world, x, out)
    out[:] = -out


@kernel
def commanded(motion, world, x, force, nu):
    """The wrench (6,) that a law with a force commands."""
    net = motion.wrench @ (force - motion.D_d @ (nu - motion.nu_d)) + motion.M @ motion.led
    return thrust(motion, world, x, nu) + net


@kernel
def missing(motion, tau):
    """The part of tau (6,) that the thrusters at their limits add."""
    u = motion.shares @ tau
    return motion.B @ (np.minimum(motion.most, np.maximum(motion.least, u)) - u)


@kernel
def force_at(motion, world, x):
    """Set the forces without and with limits at a pose."""
    free_force(motion, world, x, motion.free)
    motion.force[:] = motion.free
    if motion.limits != 0:
        nu = np.zeros(6)
        velocity_at(motion, x, nu)
        lack = missing(motion, commanded(motion, world, x, motion.free, nu))
        if np.any(lack != 0.0):
            motion.force[:] += np.linalg.solve(motion.wrench, lack)


@kernel
def derivatives(motion, world, x, force):
    """Set the derivatives of the force without limits (6,) at a pose, by the pose and by the contact wrench."""
    change, moved = np.zeros(6), np.zeros(6)
    for k in range(12):
        small = DIFFERENCE if k < 6 else 1e-3
        change[:] = 0.0
        if k < 6:
            change[k] = small
        displaced(x, change, motion.turned)
        motion.turned.tau_c[:] = x.tau_c
        if k >= 6:
            motion.turned.tau_c[k - 6] += small
        free_force(motion, world, motion.turned, moved)
        slope = (moved - force) / small
        if k < 6:
            motion.by_pose[:, k] = slope
        else:
            motion.by_wrench[:, k - 6] = slope


@kernel
def stiffness_at(motion, world, x):
    """Set the derivative of the contact wrench by the coordinates from a pose."""
    motion.stiffness[:] = 0.0
    if not np.any(x.tau_c != 0.0):
        return
    change, first = np.zeros(6), np.zeros(6)
    for k in range(12):
        change[:] = 0.0
        change[k // 2] = DIFFERENCE if k % 2 == 0 else -DIFFERENCE
        displaced(x, change, motion.turned)
        press(motion, world, motion.turned)
        if k % 2 == 0:
            first[:] = motion.turned.tau_c
        else:
            motion.stiffness[:, k // 2] = (first - motion.turned.tau_c) / (2.0 * DIFFERENCE)


@kernel
def water_by_pose(motion, world, x, nu, rate):
    """Set the derivative of the wrench that the vehicle needs in the water."""
    at, change = thrust(motion, world, x, nu), np.zeros(6)
    for k in range(6):
        change[:] = 0.0
        change[k] = DIFFERENCE
        displaced(x, change, motion.turned)
        motion.turned.tau_c[:] = x.tau_c
        motion.by_water[:, k] = (thrust(motion, world, motion.turned, nu + rate * change) - at) / DIFFERENCE


@kernel
def jacobian(motion, world, x):
    """Set J (6, 6) at a pose, where :func:`force_at` has set the force."""
    changed, way = np.zeros(6), np.zeros(6)
    if motion.known != 0:
        if motion.known_before == 0:
            free_force(motion, world, motion.there, motion.before)
            motion.known_before = 1
        between(motion.there, x, way)
        changed[:] = motion.free - motion.before
        wrong = changed - (motion.by_pose @ way + motion.by_wrench @ (x.tau_c - motion.there.tau_c))
        if np.max(np.abs(wrong)) > OUTDATED * np.max(np.abs(changed)) + ROUNDING:
            motion.known = 0
    if motion.known == 0:
        derivatives(motion, world, x, motion.free)
        copied(x, motion.there)
        motion.before[:] = motion.free
        motion.known, motion.known_before = 1, 1
    stiffness_at(motion, world, x)
    motion.J[:] = motion.by_pose + motion.by_wrench @ motion.stiffness
    if motion.limits != 0:
        at_limits(motion, world, x)


@kernel
def at_limits(motion, world, x):
    """Add to J the derivatives of what the thrusters at their limits add to the force."""
    nu = np.zeros(6)
    velocity_at(motion, x, nu)
    u = motion.shares @ commanded(motion, world, x, motion.free, nu)
    limited = np.where((motion.least <= u) & (u <= motion.most), 0.0, 1.0)
    if np.max(limited) == 0.0:
        return
    rate = 1.0 / motion.step if motion.step <= LAST_STEP else 0.0
    if motion.known_water == 0:
        water_by_pose(motion, world, x, nu, rate)
        motion.known_water = 1
    by_pose = motion.by_water - motion.stiffness + motion.wrench @ motion.J - rate * (motion.wrench @ motion.D_d)
    lost = (motion.B * limited) @ (motion.shares @ by_pose)
    motion.J -= np.linalg.solve(motion.wrench, lost)
