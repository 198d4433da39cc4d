"""The steps of a motion to its rest as machine code: :func:`.approach.approach` of a
:class:`.task_motion.TaskMotion`.
"""

import math

import numpy as np

from ...physics.frames import quat_error, rotation, to_body, to_world
from ...physics.kernels import kernel
from ...physics.linear_algebra import solved
from ..task import Schedule
from .approach import (
    FORCE_AT_REST,
    LAST_STEP,
    LONGEST_STEP,
    MOST_HALVES,
    MOST_ITERATIONS,
    ROUGH,
    SHORTEST_STEP,
)
from .motion_force import derivatives, force_at, free_force, jacobian, missing
from .motion_terms import between, copied, displaced, press, thrust, turned, unmodelled_on_the_way
from .task_motion import LONGEST_OF_STATES, STATES_AT_REST, TURN_BESIDE

FOLLOW, FORCE, DERIVATIVES = range(3)
"""The work of :func:`asked`."""
IS_LOST, IS_ENDLESS, HAS_NO_ROOT, IS_SINGULAR = 1, 2, 3, 4
"""The value of :func:`followed` where it reaches no rest."""
_REGULAR = 1e-9
"""Pivots of a Jacobian, over the largest one, below which its root has to be found by least squares, in Python."""
_scheduled = Schedule.step


@kernel
def reference(motion, way, t, p, quat):
    """Set position and attitude of the reference at a time."""
    if motion.follows == 0 or t >= motion.ends:
        p[:], quat[:] = motion.p_end, motion.quat_end
        return
    low, high = 0, motion.samples
    while low < high:
        middle = (low + high) // 2
        if way[middle].t <= t:
            low = middle + 1
        else:
            high = middle
    k = min(low, motion.samples - 1)
    a, b = way[k - 1], way[k]
    part = min(1.0, (t - a.t) / (b.t - a.t))
    sign = np.sign(b.quat @ a.quat)
    mean = a.quat + part * (b.quat * sign - a.quat)
    mean /= math.sqrt(mean @ mean)
    beside = (1.0 - (t / motion.ends) * (t / motion.ends)) * motion.beside
    p[:] = a.position + part * (b.position - a.position) + beside
    turned(mean, TURN_BESIDE * beside[0], TURN_BESIDE * beside[1], TURN_BESIDE * beside[2], quat)


@kernel
def lead(motion, way, t, step):
    """Begin a step: set the reference to that at its end, and the change of the reference in it."""
    if motion.memory != 0:
        motion.h = step if step <= LAST_STEP else math.inf
        if motion.limits != 0:
            motion.h = min(step, LONGEST_OF_STATES) if step <= LAST_STEP else STATES_AT_REST
    if step > LAST_STEP:
        motion.known = 0
    motion.known_before, motion.known_water = 0, 0
    p_d, quat_d, quat_e, R, turn = np.zeros(3), np.zeros(4), np.zeros(4), np.zeros((3, 3)), np.zeros(3)
    reference(motion, way, t, p_d, quat_d)
    reference(motion, way, t + step, motion.p_d, motion.quat_d)
    motion.t = t + step
    if motion.scheduled != 0:
        _scheduled(motion, None, motion, None, motion)
    motion.lead[:] = 0.0
    if motion.led_on != 0:
        to_body(motion.y.R_WB, motion.p_d - p_d, motion.lead)
        quat_error(quat_d, motion.quat_d, quat_e)
        rotation(quat_d, R)
        to_world(R, 2.0 * quat_e[1:], turn)
        to_body(motion.y.R_WB, turn, motion.lead[3:])
    copied(motion.y, motion.origin)
    motion.step = step
    motion.nu_d[:] = motion.lead / step
    motion.led[:] = (motion.nu_d - motion.nu_d_before) / step


@kernel
def implicit(motion, world, step):
    """Set the change in one step of implicit Euler. Returns 0 if the step is too long."""
    change, left = np.zeros(6), np.zeros(6)
    both = motion.inertia / (step * step) + motion.D_d / step
    carried = motion.inertia @ motion.velocity / step
    copied(motion.y, motion.at)
    force_at(motion, world, motion.at)
    left[:] = both @ (change - motion.lead) - carried - motion.force
    for _ in range(MOST_ITERATIONS):
        jacobian(motion, world, motion.at)
        less = np.linalg.solve(both - motion.J, left)
        size, farthest, part, nearer = np.max(np.abs(left)), np.max(np.abs(less)), 1.0, 0
        moved = np.zeros(6)
        for _ in range(MOST_HALVES):
            moved[:] = change - part * less
            if not np.all(np.abs(moved) <= motion.largest):
                return 0
            if farthest <= max(motion.sharp, ROUGH * np.max(np.abs(moved))):
                motion.change[:] = moved
                return 1
            displaced(motion.y, moved, motion.at)
            press(motion, world, motion.at)
            force_at(motion, world, motion.at)
            left[:] = both @ (moved - motion.lead) - carried - motion.force
            if np.max(np.abs(left)) < size:
                nearer = 1
                break
            part *= 0.5
        if nearer == 0:
            return 0
        change[:] = moved
    return 0


@kernel
def passed(motion, world, track, t):
    """Keep a step that ends at y."""
    row = track[motion.rows]
    if motion.memory != 0:
        free_force(motion, world, motion.y, motion.free)
        motion.value[:] = motion.next
    row.t = t
    copied(motion.y, row.pose)
    row.lacked[:] = 0.0
    if motion.limits != 0:
        force_at(motion, world, motion.y)
        row.lacked[:] = motion.force - motion.free
        if np.any(row.lacked != 0.0):
            motion.limited_s += motion.step
    motion.nu_d_before[:] = motion.nu_d
    motion.rows += 1


@kernel
def polished(motion, world):
    """Take y to the root by Newton's method. Returns 0 if there is one."""
    force_at(motion, world, motion.y)
    for _ in range(60):
        jacobian(motion, world, motion.y)
        less, pivots = solved(motion.J, motion.force)
        if not pivots > _REGULAR:
            return IS_SINGULAR
        change = -less
        change *= min(1.0, 1.0 / max(np.max(np.abs(change)) / motion.largest, 1e-300))
        size, part = np.max(np.abs(motion.force)), 1.0
        for _ in range(MOST_HALVES):
            displaced(motion.y, part * change, motion.at)
            press(motion, world, motion.at)
            force_at(motion, world, motion.at)
            if np.max(np.abs(motion.force)) < size:
                break
            part *= 0.5
        copied(motion.at, motion.y)
        left = np.max(np.abs(motion.force))
        if np.max(np.abs(change)) < 1e-14 or (size < FORCE_AT_REST and left > 0.5 * size):
            break
    return 0 if np.max(np.abs(motion.force)) < FORCE_AT_REST else HAS_NO_ROOT


@kernel
def followed(motion, world, way, track):
    """The steps of :func:`.approach.approach` from y. Returns 0 if they end in a root."""
    t, step, shortened = 0.0, motion.first, 0
    for _ in range(motion.steps):
        lead(motion, way, t, step)
        if implicit(motion, world, step) == 0:
            step, shortened = step / 4.0, 1
            if step < SHORTEST_STEP:
                return IS_LOST
            continue
        displaced(motion.origin, motion.change, motion.y)
        press(motion, world, motion.y)
        motion.velocity[:] = (motion.change - motion.lead) / step
        t += step
        passed(motion, world, track, t)
        if t >= motion.ends and step > LAST_STEP:
            return polished(motion, world)
        most = 1.0 if shortened != 0 else 10.0 if t >= motion.ends else 2.0
        step *= min(most, max(1.0, 0.5 / max(np.max(np.abs(motion.change)) / motion.largest, 1e-9)))
        shortened = 0
        if t < motion.ends:
            step = min(step, LONGEST_STEP)
    return IS_ENDLESS


@kernel
def looked_back(motion, world, track):
    """Set the unknown acceleration in each step of a track, and whether the thrusters would come to their limits."""
    before, nu = np.zeros(6), np.zeros(6)
    for k in range(1, motion.rows):
        row, last = track[k], track[k - 1]
        before[:] = nu
        between(last.pose, row.pose, nu)
        nu /= row.t - last.t
        row.unmodelled[:] = unmodelled_on_the_way(motion, world, row.pose, nu) + motion.M_d_inv @ row.lacked
        if k > 1:
            tau = thrust(motion, world, row.pose, nu) + motion.M @ ((nu - before) / (row.t - last.t))
            row.saturates = 1 if np.any(missing(motion, tau) != 0.0) else 0


@kernel
def asked(motion, world, way, track, what):
    """Follow a motion, or set the force or its derivatives at the pose ``asked``."""
    if what == FOLLOW:
        found = followed(motion, world, way, track)
        looked_back(motion, world, track)
        return found
    free_force(motion, world, motion.asked, motion.free)
    if what == DERIVATIVES:
        derivatives(motion, world, motion.asked, motion.free)
    return 0
