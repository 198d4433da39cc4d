r"""The motion to a rest as machine code: the equations of :mod:`.approach` and :mod:`.balance`.

Kernels take the steps of :func:`.approach.approach` with the terms of :class:`.approach.TaskMotion` and
:class:`.terms.Balance`, and call the plant's own kernels for contacts and water. A law gives its residual as a kernel,
with a record of its gains. What the kernels do not have, an effect of a user's own, a current that is sheared and a
residual in Python, is followed in Python; tests compare both ways.

A function is given the MOTION record and a world: the gains of the law, the vehicle in the water, its effects, the
pairs, the surfaces, and the residual, which sets out (6,) from motion, world and a pose.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...physics.contacts import pair_force
from ...physics.fossen import coriolis_added_mass, coriolis_rigid_body, damping, restoring, water_at_rest
from ...physics.frames import multiply, quat_error, rotation, to_body, to_world
from ...physics.kernels import kernel, machine_code
from ...physics.linear_algebra import solved
from ..task import MOST_ENTRIES, Schedule
from . import approach as python
from .approach import LAST, TaskMotion, Track, Way
from .terms import Balance, Memory, Pose, ThrustMap

_FIRST, _SHORTEST, _LONGEST, _STEPS = python._FIRST, python._SHORTEST, python._LONGEST, python._STEPS
_ITERATIONS, _ROUGH, _HALVES, _ROUNDED = python._ITERATIONS, python._ROUGH, python._HALVES, python._AT_REST
_SMALL, _WRONG, _ROUNDING, _TURNED = python._SMALL, python._WRONG, python._ROUNDING, python._TURNED
_WINDS_UP, _KEEPS, _SAMPLES = python._WINDS_UP, python._KEEPS, python._MOST_SAMPLES + 1
_THRUSTERS = 16
"""Most thrusters."""
STATES = 18
"""Most states of a law in its residual."""

POSE = np.dtype(
    [("position", "f8", (3,)), ("quat", "f8", (4,)), ("R_WB", "f8", (3, 3)), ("tau_c", "f8", (6,))], align=True
)
"""A :class:`.terms.Pose`."""

_MATRICES = ("K_d", "D_d", "M_d", "M", "M_hat", "M_hat_inv", "M_d_inv", "M_d_by_M", "M_RB", "undelivered")
_NOMINAL = np.dtype(
    [
        *((name, "f8", (6, 6)) for name in ("M_A", "M_RB", "D_linear", "D_quadratic")),
        *((name, "f8") for name in ("mass", "displaced_mass", "inertia", "damping", "coriolis", "restoring")),
        *((name, "f8", (3,)) for name in ("r_g", "r_b", "gravity_W")),
    ],
    align=True,
)
"""The vehicle of the control system, with the factors of its estimates."""
_ERRORS = {"position_scale": 3, "position_bias": 3, "turn": 4, "nu": 6, "scale": 6, "bias": 6, "drift": 3, "z_0": 1}
_SENSED = np.dtype(
    [*((name, "f8", (n,) if n > 1 else ()) for name, n in _ERRORS.items()), ("perfect", "i8"), ("observed", "i8")],
    align=True,
)
"""The constant errors of the measurements: :class:`uvms_mj.navigation.base.ConstantErrors`."""
_SEEN = np.dtype([("position", "f8", (3,)), ("quat", "f8", (4,)), ("nu", "f8", (6,)), ("tau_c", "f8", (6,))])
_ROW = np.dtype(
    [
        *(("t", "f8"), ("pose", POSE), ("lacked", "f8", (6,)), ("unmodelled", "f8", (6,)), ("saturates", "i8")),
    ],
    align=True,
)
"""One step of a motion."""
WAY = np.dtype([("t", "f8"), ("position", "f8", (3,)), ("quat", "f8", (4,))], align=True)
"""A sample of a reference."""
MOTION = np.dtype(
    [
        *(
            (name, "f8", (6, 6))
            for name in (*_MATRICES, "wrench", "by_pose", "by_wrench", "stiffness", "by_water", "J")
        ),
        *((name, "f8", (6,)) for name in ("K_f", "F_d", "F_1", "factor_inverse", "tau_dist", "left")),
        *((name, "f8", (6,)) for name in ("nu_d", "nu_d_before", "led", "lead", "nu_at_rest", "velocity")),
        *((name, "f8", (6,)) for name in ("free", "force", "before", "change", "seen_error")),
        *((name, "f8", (3,)) for name in ("p_d", "p_end", "v_c_W", "beside")),
        *((name, "f8", (4,)) for name in ("quat_d", "quat_end")),
        *((name, "f8") for name in ("t", "step", "ends", "largest", "sharp", "h", "limited_s", "first")),
        *((name, "i8") for name in ("uses_truth", "integrates", "follows", "scheduled", "led_on", "limits", "memory")),
        *((name, "i8") for name in ("pairs", "samples", "steps", "rows", "thrusters", "delivered")),
        *((name, "i8") for name in ("known", "known_before", "known_water")),
        *((name, "f8", (STATES,)) for name in ("value", "next")),
        *(("B", "f8", (6, _THRUSTERS)), ("shares", "f8", (_THRUSTERS, 6))),
        *((name, "f8", (_THRUSTERS,)) for name in ("least", "most")),
        *(("times", "f8", (MOST_ENTRIES,)), ("ramps", "f8", (MOST_ENTRIES,)), ("values", "f8", (MOST_ENTRIES + 1, 12))),
        *((name, POSE) for name in ("y", "at", "origin", "there", "turned", "asked")),
        *(("nominal", _NOMINAL), ("sensed", _SENSED), ("seen", _SEEN)),
    ],
    align=True,
)
"""Settings and state of a motion, in the names of :class:`.approach.TaskMotion` and :class:`.terms.Balance`."""

FOLLOW, RESIDUAL, DERIVATIVES = range(3)
_LOST, _ENDLESS, _NO_ROOT, _SINGULAR = 1, 2, 3, 4
_REGULAR = 1e-9
"""Pivots of a Jacobian, over the largest one, below which its root has to be found by least squares, in Python."""
_REASONS = {
    _LOST: "the motion from the start can't be followed",
    _ENDLESS: "the motion from the start comes to no rest",
    _NO_ROOT: "the static balance has no solution where the motion ends",
}
_scheduled = Schedule.step


@kernel
def copied(a, b):
    """Set the pose b to a."""
    b.position[:], b.quat[:], b.R_WB[:], b.tau_c[:] = a.position, a.quat, a.R_WB, a.tau_c


@kernel
def turned(quat, x, y, z, out):
    """Set out (4,) to an attitude after a rotation vector in B."""
    angle = math.sqrt(x * x + y * y + z * z)
    half = 0.5 * angle
    scale = 0.5 * math.sin(half) / half if half > 0.0 else 0.5
    multiply(quat[0], quat[1], quat[2], quat[3], math.cos(half), scale * x, scale * y, scale * z, 0, out)


@kernel
def displaced(a, change, out):
    """Set the position and the attitude of the pose ``out`` to the pose ``a`` after a change (6,)."""
    moved = np.zeros(3)
    to_world(a.R_WB, change, moved)
    out.position[:] = a.position + moved
    turned(a.quat, change[3], change[4], change[5], out.quat)
    rotation(out.quat, out.R_WB)


@kernel
def between(a, b, out):
    """Set out (6,) to the displacement and the rotation vector from a pose to another one."""
    quat_e = np.zeros(4)
    quat_error(a.quat, b.quat, quat_e)
    to_body(a.R_WB, b.position - a.position, out)
    out[3:] = 2.0 * quat_e[1:]


@kernel
def press(motion, world, x):
    """Set the contact wrench at a pose."""
    pairs, surfaces, still = world[3], world[4], np.zeros(6)
    x.tau_c[:] = 0.0
    for k in range(motion.pairs):
        pair = pairs[k]
        pair_force(pair, surfaces[pair.surface], x.position, x.R_WB, still, np.inf)
        if pair.contact.touching != 0:
            x.tau_c[:] += pair.contact.tau_B


@kernel
def in_water(motion, world, x, nu):
    """Set d and g of the vehicle in the water at a pose with a velocity nu (6,)."""
    body = world[1]
    to_body(x.R_WB, motion.v_c_W, body.nu_r)
    body.nu_r[:3] = nu[:3] - body.nu_r[:3]
    body.nu_r[3:] = nu[3:]
    body.R_WB[:], body.d[:] = x.R_WB, motion.tau_dist
    water_at_rest(body, world[2])


@kernel
def thrust(motion, world, x, nu):
    """tau (6,) that holds the vehicle at a pose with a constant velocity nu (6,)."""
    in_water(motion, world, x, nu)
    return world[1].g - world[1].d - x.tau_c


@kernel
def sense(motion, world, x):
    """Set what the law measures at a pose, and its pose error."""
    sensed, seen = motion.sensed, motion.seen
    seen.position[:], seen.quat[:], seen.nu[:], seen.tau_c[:] = x.position, x.quat, 0.0, x.tau_c
    if sensed.perfect == 0:
        seen.position[:] = sensed.position_scale * x.position + sensed.position_bias
        q, turn = x.quat, sensed.turn
        multiply(q[0], q[1], q[2], q[3], turn[0], turn[1], turn[2], turn[3], 0, seen.quat)
        seen.nu[:] = sensed.nu
        seen.tau_c[:3] -= sensed.drift * (x.position[2] - sensed.z_0)
        seen.tau_c[:] = sensed.scale * seen.tau_c + sensed.bias
    if sensed.observed != 0:
        seen.tau_c[:] = x.tau_c
        seen.tau_c[:] = x.tau_c + motion.M_hat @ unmodelled(motion, world, x)
    R, quat_e = np.zeros((3, 3)), np.zeros(4)
    rotation(seen.quat, R)
    quat_error(motion.quat_d, seen.quat, quat_e)
    to_body(R, seen.position - motion.p_d, motion.seen_error)
    motion.seen_error[3:] = quat_e[1:]


@kernel
def demanded(motion):
    """K_d eta_e + D_d nu_e - K_f (tau_c - F_d) as :func:`sense` has it, less what the law leaves."""
    return (
        motion.K_d @ motion.seen_error
        + motion.D_d @ motion.seen.nu
        - motion.K_f * (motion.seen.tau_c - motion.F_d)
        - motion.left
    )


@kernel
def resistance(motion, nu):
    """C_hat nu + D_hat nu (6,)."""
    own, total, term = motion.nominal, np.zeros(6), np.zeros(6)
    damping(own.D_linear, own.D_quadratic, nu, term)
    total += own.damping * term
    coriolis_added_mass(own.M_A, nu, term)
    total += own.coriolis * term
    coriolis_rigid_body(own.M_RB, nu, term)
    total += own.coriolis * term
    return total


@kernel
def unmodelled(motion, world, x):
    """The acceleration (6,) that a law without an integral term must balance, with the measurements of
    :func:`sense`."""
    own, body, seen = motion.nominal, world[1], motion.seen
    R, g_hat = np.zeros((3, 3)), np.zeros(6)
    in_water(motion, world, x, np.zeros(6))
    rotation(seen.quat, R)
    restoring(own.mass, own.displaced_mass, own.r_g, own.r_b, own.gravity_W, R, g_hat)
    total = body.d + (own.restoring * g_hat - body.g) + (x.tau_c - seen.tau_c) + resistance(motion, seen.nu)
    if motion.delivered == 0:
        total += motion.undelivered @ (body.g - body.d - x.tau_c)
    return motion.M_hat_inv @ total


@kernel
def unmodelled_on_the_way(motion, world, x, nu):
    """The acceleration (6,) of eq. (11) that current, disturbance and wrong estimates give the vehicle."""
    own, body = motion.nominal, world[1]
    g_hat, term = np.zeros(6), np.zeros(6)
    in_water(motion, world, x, nu)
    coriolis_rigid_body(motion.M_RB, nu, term)
    restoring(own.mass, own.displaced_mass, own.r_g, own.r_b, own.gravity_W, x.R_WB, g_hat)
    return motion.M_hat_inv @ (body.d - body.g - term + resistance(motion, nu) + own.restoring * g_hat)


@kernel
def control_wrench(motion, world, x):
    """tau_cmd - C_hat nu - D_hat nu - g_hat (6,) that holds the vehicle at rest."""
    return -motion.seen.tau_c - motion.M_hat @ unmodelled(motion, world, x)


@kernel
def velocity_at(motion, x, out):
    """Set out (6,) to nu of the step that ends at a pose, at rest what a derivative gives it."""
    if motion.step <= LAST:
        between(motion.origin, x, out)
        out /= motion.step
    else:
        out[:] = motion.nu_at_rest


@kernel
def within_limit(motion, needed, rate, limit):
    """What is left of the value (n,) of a limited integral that holds the vehicle, for its rate: :class:`.Integral`."""
    if math.isinf(motion.h):
        return needed - np.minimum(limit, np.maximum(-limit, needed + rate))
    motion.next[:6] = np.minimum(limit, np.maximum(-limit, motion.value[:6] + motion.h * rate))
    return needed - motion.next[:6]


@kernel
def desired(motion, world, x, out):
    """The residual of a law that keeps eq. (7)."""
    out[:] = demanded(motion)


@kernel
def balanced(motion, world, x, out):
    """The residual of the nominal control: :class:`.terms.Balance`."""
    if motion.uses_truth != 0:
        left = x.tau_c - motion.seen.tau_c
        if motion.delivered == 0:
            left += motion.undelivered @ thrust(motion, world, x, np.zeros(6))
        out[:] = demanded(motion) - motion.M_d_by_M @ left
        return
    seen, quat_e, drift = motion.seen, np.zeros(4), np.zeros(6)
    quat_error(motion.quat_d, seen.quat, quat_e)
    drift[:3] = seen.nu[:3]
    drift[3:] = 0.5 * (quat_e[0] * seen.nu[3:] + np.cross(quat_e[1:], seen.nu[3:]))
    left = (1.0 - motion.factor_inverse) * motion.F_1 * drift
    if motion.integrates == 0:
        left += motion.factor_inverse * unmodelled(motion, world, x)
    out[:] = demanded(motion) - motion.M_d @ left


@kernel
def free_force(motion, world, x, out):
    """Set out (6,) to the force of the law without limits at a pose."""
    sense(motion, world, x)
    world[5](motion, world, x, out)
    out[:] = -out


@kernel
def commanded(motion, world, x, force, nu):
    """The wrench (6,) that a law with a force commands."""
    net = motion.wrench @ (force - motion.D_d @ (nu - motion.nu_d)) + motion.M @ motion.led
    return thrust(motion, world, x, nu) + net


@kernel
def missing(motion, tau):
    """What the thrusters at their limits add to tau (6,)."""
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
            motion.force[:] += solved(motion.wrench, lack)[0]


@kernel
def derivatives(motion, world, x, force):
    """Set the derivatives of the force without limits (6,) at a pose, by the pose and by the contact wrench."""
    change, moved = np.zeros(6), np.zeros(6)
    for k in range(12):
        small = _SMALL if k < 6 else 1e-3
        change[:] = 0.0
        if k < 6:
            change[k] = small
        displaced(x, change, motion.turned)
        motion.turned.tau_c[:] = x.tau_c
        if k >= 6:
            motion.turned.tau_c[k - 6] += small
        free_force(motion, world, motion.turned, moved)
        for i in range(6):
            slope = (moved[i] - force[i]) / small
            if k < 6:
                motion.by_pose[i, k] = slope
            else:
                motion.by_wrench[i, k - 6] = slope


@kernel
def stiffness_at(motion, world, x):
    """Set the derivative of the contact wrench by the coordinates from a pose."""
    motion.stiffness[:] = 0.0
    if not np.any(x.tau_c != 0.0):
        return
    change, first = np.zeros(6), np.zeros(6)
    for k in range(12):
        change[:] = 0.0
        change[k // 2] = _SMALL if k % 2 == 0 else -_SMALL
        displaced(x, change, motion.turned)
        press(motion, world, motion.turned)
        if k % 2 == 0:
            first[:] = motion.turned.tau_c
        else:
            for i in range(6):
                motion.stiffness[i, k // 2] = (first[i] - motion.turned.tau_c[i]) / (2.0 * _SMALL)


@kernel
def water_by_pose(motion, world, x, nu, rate):
    """Set the derivative of the wrench that the vehicle needs in the water."""
    at, change = thrust(motion, world, x, nu), np.zeros(6)
    for k in range(6):
        change[:] = 0.0
        change[k] = _SMALL
        displaced(x, change, motion.turned)
        motion.turned.tau_c[:] = x.tau_c
        slope = (thrust(motion, world, motion.turned, nu + rate * change) - at) / _SMALL
        for i in range(6):
            motion.by_water[i, k] = slope[i]


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
        if np.max(np.abs(wrong)) > _WRONG * np.max(np.abs(changed)) + _ROUNDING:
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
    limited = np.zeros(_THRUSTERS)
    for k in range(motion.thrusters):
        if not (motion.least[k] <= u[k] and u[k] <= motion.most[k]):
            limited[k] = 1.0
    if np.max(limited) == 0.0:
        return
    rate = 1.0 / motion.step if motion.step <= LAST else 0.0
    if motion.known_water == 0:
        water_by_pose(motion, world, x, nu, rate)
        motion.known_water = 1
    by_pose = motion.by_water - motion.stiffness + motion.wrench @ motion.J - rate * (motion.wrench @ motion.D_d)
    lost = (motion.B * limited) @ (motion.shares @ by_pose)
    for k in range(6):
        motion.J[:, k] -= solved(motion.wrench, lost[:, k])[0]


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
    turned(mean, _TURNED * beside[0], _TURNED * beside[1], _TURNED * beside[2], quat)


@kernel
def lead(motion, way, t, step):
    """Begin a step: set the reference to that at its end, and the change of the reference in it."""
    if motion.memory != 0:
        motion.h = step if step <= LAST else math.inf
        if motion.limits != 0:
            motion.h = min(step, _WINDS_UP) if step <= LAST else _KEEPS
    if step > LAST:
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
    both = motion.M_d / (step * step) + motion.D_d / step
    carried = motion.M_d @ motion.velocity / step
    copied(motion.y, motion.at)
    force_at(motion, world, motion.at)
    left[:] = both @ (change - motion.lead) - carried - motion.force
    for _ in range(_ITERATIONS):
        jacobian(motion, world, motion.at)
        less = solved(both - motion.J, left)[0]
        size, farthest, part, nearer = np.max(np.abs(left)), np.max(np.abs(less)), 1.0, 0
        moved = np.zeros(6)
        for _ in range(_HALVES):
            moved[:] = change - part * less
            if not np.all(np.abs(moved) <= motion.largest):
                return 0
            if farthest <= max(motion.sharp, _ROUGH * np.max(np.abs(moved))):
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
            return _SINGULAR
        change = -less
        change *= min(1.0, 1.0 / max(np.max(np.abs(change)) / motion.largest, 1e-300))
        size, part = np.max(np.abs(motion.force)), 1.0
        for _ in range(_HALVES):
            displaced(motion.y, part * change, motion.at)
            press(motion, world, motion.at)
            force_at(motion, world, motion.at)
            if np.max(np.abs(motion.force)) < size:
                break
            part *= 0.5
        copied(motion.at, motion.y)
        left = np.max(np.abs(motion.force))
        if np.max(np.abs(change)) < 1e-14 or (size < _ROUNDED and left > 0.5 * size):
            break
    return 0 if np.max(np.abs(motion.force)) < _ROUNDED else _NO_ROOT


@kernel
def followed(motion, world, way, track):
    """The steps of :func:`.approach.approach` from y. Returns 0 if they end in a root."""
    t, step, shortened = 0.0, motion.first, 0
    for _ in range(motion.steps):
        lead(motion, way, t, step)
        if implicit(motion, world, step) == 0:
            step, shortened = step / 4.0, 1
            if step < _SHORTEST:
                return _LOST
            continue
        displaced(motion.origin, motion.change, motion.y)
        press(motion, world, motion.y)
        motion.velocity[:] = (motion.change - motion.lead) / step
        t += step
        passed(motion, world, track, t)
        if t >= motion.ends and step > LAST:
            return polished(motion, world)
        most = 1.0 if shortened != 0 else 10.0 if t >= motion.ends else 2.0
        step *= min(most, max(1.0, 0.5 / max(np.max(np.abs(motion.change)) / motion.largest, 1e-9)))
        shortened = 0
        if t < motion.ends:
            step = min(step, _LONGEST)
    return _ENDLESS


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


@dataclass(frozen=True)
class Compiled:
    """The residual of a law as machine code.

    Attributes:
        entry: :func:`asked` with the residual in its world, a function of all arrays and of what is asked.
        gains: (1,) record of the law's settings in the residual.
    """

    entry: Callable[..., int]
    gains: np.ndarray


_NONE = np.zeros(1, np.dtype([("none", "f8")]))


@kernel
def _keeping(motion, gains, body, effects, pairs, surfaces, way, track, what):
    return asked(motion, (gains, body, effects, pairs, surfaces, desired), way, track, what)


@kernel
def _nominal(motion, gains, body, effects, pairs, surfaces, way, track, what):
    return asked(motion, (gains, body, effects, pairs, surfaces, balanced), way, track, what)


KEEPING, NOMINAL = Compiled(_keeping, _NONE), Compiled(_nominal, _NONE)
"""Of :meth:`.terms.Balance.demanded` and of :class:`.terms.Balance`."""


class RigidMotion(TaskMotion):
    """A :class:`.approach.TaskMotion` that machine code follows.

    Args:
        compiled: the residual of the law.
        balance, memory, thrust_map, wrench: those of :class:`.approach.TaskMotion`.
    """

    def __init__(
        self,
        compiled: Compiled,
        balance: Balance,
        memory: Memory | None = None,
        thrust_map: ThrustMap | None = None,
        wrench: np.ndarray | None = None,
    ) -> None:
        super().__init__(balance, lambda _, pose: -self._asked(RESIDUAL, pose), memory, thrust_map, wrench)
        self._record = np.zeros(1, MOTION)
        self._way_rows, self._track_rows = np.zeros(_SAMPLES, WAY), np.zeros(_STEPS + 1, _ROW)
        springs = balance.springs
        arrays = (self._record, compiled.gains, balance._body, balance._effects, springs._pairs, springs._surfaces)
        self._code = machine_code(compiled.entry, *arrays, self._way_rows, self._track_rows)
        if self.known:
            self._set()

    @property
    def known(self) -> bool:
        """Whether there is machine code, and it has all terms of the balance."""
        few = self.thrust_map is None or len(self.thrust_map.inverse) <= _THRUSTERS
        plain = self.balance.own_effects is None and self.balance.setup.scenario.constant_flow
        return few and plain and self._code is not None

    def _set(self) -> None:
        """Write the settings to the record."""
        record, balance, setup = self._record[0], self.balance, self.balance.setup
        design, vehicle, nominal, scenario = setup.design, setup.vehicle, setup.nominal, setup.scenario
        for name in ("K_d", "D_d", "M_d", "M", "M_hat", "M_d_inv"):
            record[name] = getattr(design, name)
        record["M_hat_inv"], record["undelivered"] = balance.M_hat_inv, balance.undelivered
        record["delivered"], record["M_d_by_M"] = not balance.undelivered.any(), design.M_d @ np.linalg.inv(design.M)
        record["wrench"], record["M_RB"] = self.wrench, vehicle.M_RB
        record["factor_inverse"], record["F_1"] = balance.factor_inverse, setup.task.F_1
        record["tau_dist"], record["v_c_W"] = balance.tau_dist, scenario.mean_flow_W
        record["uses_truth"], record["integrates"] = balance.uses_truth, np.isinf(balance.K)
        record["largest"], record["sharp"] = self.largest, self.sharp
        record["p_end"], record["quat_end"] = self._end
        record["memory"], record["pairs"] = self.memory is not None, len(balance.springs)
        own = record["nominal"]
        for name in ("M_A", "M_RB", "D_linear", "D_quadratic", "mass", "displaced_mass", "r_g", "r_b"):
            own[name] = getattr(nominal, name)
        for name in ("inertia", "damping", "coriolis", "restoring"):
            own[name] = getattr(scenario.estimates, name)
        own["gravity_W"] = setup.gravity_W
        self._sense()
        if self.thrust_map is not None:
            n = record["thrusters"] = len(self.thrust_map.inverse)
            _, record["least"][:n], record["most"][:n] = self.thrust_map.thrusts(np.zeros(6))
            record["B"][:, :n], record["shares"][:n] = vehicle.B, self.thrust_map.shares

    def _sense(self) -> None:
        """Write the errors of the measurements."""
        sensed, errors = self._record[0]["sensed"], self.balance.errors
        sensed["observed"] = self.balance.setup.scenario.observer.runs
        sensed["perfect"] = not dataclasses.is_dataclass(errors)  # shipped navigation has constant errors, or none
        for name in () if sensed["perfect"] else _ERRORS:
            sensed[name] = getattr(errors, name)

    def _asked(self, what: int, pose: Pose) -> np.ndarray:
        """The force (6,) at a pose, and for DERIVATIVES those in the record."""
        record, balance = self._record[0], self.balance
        asked = record["asked"]
        asked["position"], asked["quat"], asked["R_WB"], asked["tau_c"] = (
            pose.position,
            pose.quat,
            pose.R_WB,
            pose.tau_c,
        )
        record["p_d"], record["quat_d"], record["K_f"], record["F_d"] = (
            balance.p_d,
            balance.quat_d,
            balance.K_f,
            balance.F_d,
        )
        record["nu_at_rest"], record["h"] = self._at_rest, math.inf if self.memory is None else self.memory.step
        assert self._code is not None
        self._code(what)
        return np.array(record["free"])

    def _derivatives(self, pose: Pose, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self._asked(DERIVATIVES, pose)
        return np.array(self._record[0]["by_pose"]), np.array(self._record[0]["by_wrench"])

    def follow(self, way: Way) -> None:
        super().follow(way)
        times, positions, quats = way
        n, record, rows = len(times), self._record[0], self._way_rows
        rows["t"][:n], rows["position"][:n], rows["quat"][:n] = times, positions, quats
        record["follows"], record["samples"], record["scheduled"] = 1, n, self._schedule is not None
        if self._schedule is not None:
            for name in ("times", "ramps", "values"):
                record[name] = getattr(self._schedule, name)

    def rest_from(self, pose: Pose, velocity: np.ndarray, step: float = _FIRST, steps: int = _STEPS) -> Pose | str:
        record, balance = self._record[0], self.balance
        for name in ("nu_d", "nu_d_before", "led", "nu_at_rest", "value", "next", "rows", "limited_s", "known"):
            record[name] = 0
        y = record["y"]
        y["position"], y["quat"], y["R_WB"], y["tau_c"] = pose.position, pose.quat, pose.R_WB, pose.tau_c
        record["velocity"], record["first"], record["steps"] = velocity, step, steps
        record["beside"], record["led_on"], record["limits"] = self.beside, self.led, self.limits
        record["ends"], record["h"] = self.ends, math.inf
        record["K_f"], record["F_d"] = balance.K_f, balance.F_d
        assert self._code is not None
        status = self._code(FOLLOW)
        rows = self._track_rows[: record["rows"]].copy()
        poses = [_pose(each) for each in rows["pose"]]
        self.track, self._lacked = Track(rows["t"].tolist(), poses), list(rows["lacked"])
        self.limited_s, self._seen = float(record["limited_s"]), rows
        balance.p_d, balance.quat_d, balance.K_f, balance.F_d = (
            np.array(record[name]) for name in ("p_d", "quat_d", "K_f", "F_d")
        )
        self._from, self._step = _pose(record["origin"]), float(record["step"])
        self._nu_d = np.array(record["nu_d_before"]), np.array(record["nu_d"])
        self._led, self._latest, self._law, self._by_water = np.array(record["led"]), (None, None), None, None
        self._before = None
        if self.memory is not None:
            self.memory.step = float(record["h"])
        if status in _REASONS:
            return _REASONS[status]
        found = _pose(record["y"])
        if status == _SINGULAR:
            return python.polished(self, found)
        return self.leaves(found) or found

    @property
    def saturates(self) -> bool:
        return self.thrust_map is not None and bool(self._seen["saturates"].any())

    def unmodelled(self) -> tuple[np.ndarray, np.ndarray]:
        return self._seen["t"][1:], self._seen["unmodelled"][1:]


def _pose(record: Any) -> Pose:
    return Pose(*(np.array(record[name]) for name in ("position", "quat", "R_WB", "tau_c")))
