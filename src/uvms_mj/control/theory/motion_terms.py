r"""The terms of the static balance as machine code: poses, contacts, water, the law's measurements and its errors.

The kernels have the equations of :class:`.terms.Balance`, and call the plant's own kernels for contacts and water.
"""

import math

import numpy as np

from ...physics.contacts import pair_force
from ...physics.fossen import coriolis_added_mass, coriolis_rigid_body, damping, restoring, water_at_rest
from ...physics.frames import cross, multiply, quat_error, rotation, to_body, to_world
from ...physics.kernels import kernel
from .approach import LAST_STEP
from .motion_record import BODY, EFFECTS, PAIRS, SURFACES


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
    multiply(quat, np.array([math.cos(half), scale * x, scale * y, scale * z]), out)


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
    pairs, surfaces, still = world[PAIRS], world[SURFACES], np.zeros(6)
    x.tau_c[:] = 0.0
    for k in range(motion.pairs):
        pair = pairs[k]
        pair_force(pair, surfaces[pair.surface], x.position, x.R_WB, still, np.inf)
        if pair.contact.touching != 0:
            x.tau_c[:] += pair.contact.tau_B


@kernel
def in_water(motion, world, x, nu):
    """Set d and g of the vehicle in the water at a pose with a velocity nu (6,)."""
    body = world[BODY]
    to_body(x.R_WB, motion.v_c_W, body.nu_r)
    body.nu_r[:3] = nu[:3] - body.nu_r[:3]
    body.nu_r[3:] = nu[3:]
    body.R_WB[:], body.d[:] = x.R_WB, motion.tau_dist
    water_at_rest(body, world[EFFECTS])


@kernel
def thrust(motion, world, x, nu):
    """tau (6,) that holds the vehicle at a pose with a constant velocity nu (6,)."""
    in_water(motion, world, x, nu)
    return world[BODY].g - world[BODY].d - x.tau_c


@kernel
def sense(motion, world, x):
    """Set what the law measures at a pose, and its pose error."""
    sensed, seen = motion.sensed, motion.seen
    seen.position[:], seen.quat[:], seen.nu[:], seen.tau_c[:] = x.position, x.quat, 0.0, x.tau_c
    if sensed.perfect == 0:
        seen.position[:] = sensed.position_scale * x.position + sensed.position_bias
        multiply(x.quat, sensed.turn, seen.quat)
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
    own, body, seen = motion.nominal, world[BODY], motion.seen
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
    own, body = motion.nominal, world[BODY]
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
    if motion.step <= LAST_STEP:
        between(motion.origin, x, out)
        out /= motion.step
    else:
        out[:] = motion.nu_at_rest


@kernel
def not_fed_forward(motion, world, x):
    """The wrench (6,) of drag and of the reference's acceleration in a step of a motion, which a law lacks that feeds
    neither forward."""
    nu, still = np.zeros(6), np.zeros(6)
    velocity_at(motion, x, nu)
    return thrust(motion, world, x, nu) - thrust(motion, world, x, still) + motion.M @ motion.led


@kernel
def within_limit(motion, needed, rate, limit):
    """The rest of the value (n,) of a limited integral that holds the vehicle, for its rate: :class:`.Integral`."""
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
    drift[3:] = 0.5 * (quat_e[0] * seen.nu[3:] + cross(quat_e[1:], seen.nu[3:]))
    left = (1.0 - motion.factor_inverse) * motion.F_1 * drift
    if motion.integrates == 0:
        left += motion.factor_inverse * unmodelled(motion, world, x)
    out[:] = demanded(motion) - motion.M_d @ left
