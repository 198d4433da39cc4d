"""The residuals of laws that do not keep eq. (7), as machine code: :mod:`.rigid_motion`.

Each is the residual of the law's ``at_rest`` in Python, with a record of its gains. States are in ``motion.value``.
"""

import math
from typing import Any

import numpy as np

from ...physics.kernels import kernel
from .motion_record import GAINS
from .motion_steps import asked
from .motion_terms import control_wrench, demanded, not_fed_forward, resistance, unmodelled, velocity_at, within_limit
from .rigid_motion import Compiled

_PID = np.dtype([("k_i", "f8"), ("limit", "f8", (6,))], align=True)
_PARALLEL = np.dtype([("k_i", "f8"), ("limit", "f8"), ("n", "f8", (6,)), ("F_d", "f8", (6,))], align=True)
_ADMITTANCE = np.dtype([(name, "f8") for name in ("k_i", "k_p", "k_v")], align=True)


def _packed(dtype: np.dtype, **gains: Any) -> np.ndarray:
    record = np.zeros(1, dtype)
    for name, value in gains.items():
        record[name] = value
    return record


def pid(k_i: float, limit: np.ndarray) -> Compiled:
    """Of :class:`uvms_mj.control.laws.pid.Pid`, with the limit (6,) of its integral."""
    return Compiled(_pid_motion, _packed(_PID, k_i=k_i, limit=limit))


@kernel
def _pid(motion, world, x, out):
    nu, spring = motion.seen.nu, motion.K_d @ motion.seen_error
    measured = resistance(motion, nu) + motion.D_d @ nu
    measured += not_fed_forward(motion, world, x)
    xi = -(control_wrench(motion, world, x) + measured + motion.K_f * motion.F_d + spring)
    out[:] = -within_limit(motion, xi, world[GAINS].k_i * spring, world[GAINS].limit)


@kernel
def _pid_motion(motion, gains, body, effects, pairs, surfaces, way, track, what):
    return asked(motion, (gains, body, effects, pairs, surfaces, _pid), way, track, what)


def parallel(k_i: float, limit: float, n: np.ndarray, F_d: np.ndarray) -> Compiled:
    """Of :class:`uvms_mj.control.laws.parallel.Parallel`, with the force F_d (6,) along n (6,)."""
    return Compiled(_parallel_motion, _packed(_PARALLEL, k_i=k_i, limit=limit, n=n, F_d=F_d))


@kernel
def _parallel(motion, world, x, out):
    gains = world[GAINS]
    lacking = motion.M_hat @ (motion.M_d_inv @ demanded(motion) - unmodelled(motion, world, x))
    xi, rate = np.zeros(6), np.zeros(6)
    xi[0], rate[0] = gains.n @ lacking, gains.k_i * (gains.n @ (motion.seen.tau_c - gains.F_d))
    left = within_limit(motion, xi, rate, np.full(6, gains.limit))
    out[:] = motion.M_d @ (motion.M_hat_inv @ (lacking - gains.n * xi[0] + gains.n * left[0]))


@kernel
def _parallel_motion(motion, gains, body, effects, pairs, surfaces, way, track, what):
    return asked(motion, (gains, body, effects, pairs, surfaces, _parallel), way, track, what)


def admittance(k_i: float, k_p: float, k_v: float) -> Compiled:
    """Of :class:`uvms_mj.control.laws.admittance.Admittance`. Its states are eta_a, nu_a and xi_a (6,) each."""
    return Compiled(_admittance_motion, _packed(_ADMITTANCE, k_i=k_i, k_p=k_p, k_v=k_v))


@kernel
def _admittance(motion, world, x, out):
    gains, nu, eta_e, h = world[GAINS], motion.seen.nu, motion.seen_error, motion.h
    needed = motion.M_hat_inv @ control_wrench(motion, world, x)
    wanted = demanded(motion) - motion.D_d @ nu  # nu_a = 0
    if math.isinf(h):
        out[:] = wanted
        if gains.k_i == 0.0:
            out += motion.K_d @ (needed + gains.k_v * nu) / gains.k_p
        return
    nu_e, nu_a_dot, half = np.zeros(6), np.zeros(6), np.ones(6)
    velocity_at(motion, x, nu_e)
    nu_e -= motion.nu_d
    half[3:] = 0.5
    value, after = motion.value, motion.next
    after[:] = value
    if h != 0.0:
        pushed = motion.K_d @ eta_e - wanted - motion.K_d @ value[:6] + motion.M_d @ value[6:12] / h
        after[6:12] = np.linalg.solve(motion.M_d / h + motion.D_d + h * half * motion.K_d, pushed)
        after[:6] = value[:6] + h * half * after[6:12]
        nu_a_dot[:] = (after[6:12] - value[6:12]) / h
        after[12:] = value[12:] + h * gains.k_i * (eta_e - after[:6])
    a = nu_a_dot - gains.k_v * (nu_e + nu - after[6:12]) - gains.k_p * (eta_e - after[:6]) - after[12:] - needed
    out[:] = -(motion.M_d @ a) - motion.D_d @ nu_e  # the motion has the damping of eq. (7)


@kernel
def _admittance_motion(motion, gains, body, effects, pairs, surfaces, way, track, what):
    return asked(motion, (gains, body, effects, pairs, surfaces, _admittance), way, track, what)
