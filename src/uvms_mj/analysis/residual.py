"""Impedance error of a trace: the residual of the desired impedance."""

import itertools

import mujoco
import numpy as np

from ..control.design import Design
from ..errors import Fault, InputError
from ..physics.frames import rotation_matrix
from ..plant.build import task_inertias
from ..records.trace import Trace
from .metrics import cumulative, grid

INTERVAL_S = 0.01
"""Length of the intervals over which the residual is averaged [s]."""


def impedance_error(trace: Trace, start: float = 0.0, end: float = np.inf) -> np.ndarray:
    r"""Rms (6,) of the residual of eq. (12), or of eq. (7) with K_f and F_d, after averaging over 10 ms intervals. At a
    tool, B stands for its frame.

    .. math:: r_j = \frac{1}{T} \int_{t_j}^{t_j + T} (M_d \dot{\tilde\nu} + D_d \tilde\nu + K_d \tilde\eta
              - K_f (\tau_c - F_d)) \, dt, \qquad \sqrt{\tfrac{1}{n} \sum_j r_j^2}

    Accelerations, and steps between rows, are not sampled. Their integrals come from differences between rows: that of
    nu_dot is the change of nu_e, that of the normal force the running impulse, that of nu_e the displacement. These
    three are exact even if s changes its sign at every step. The sum over steps contains nu at the beginning of each
    step, while the vehicle moves with nu at its end (correction h nu) and the reference with the mean of both
    (correction h/2 nu_d). eta_e and the rotation of B are integrated over rows by the trapezoidal rule: at rest any log
    rate is sufficient, an impact needs 1 kHz or more. Friction is integrated over rows as well, but may change its sign
    at every step. With wall friction, a log without every step therefore gives nan in the components with friction.

    Raises:
        InputError: M_d is the natural inertia of a vehicle with joints, which changes.
    """
    design, h = design_of(trace), trace.scenario.simulation.timestep
    if trace.scenario.impedance.natural and trace.header.mjcf.vehicle.arm.links:
        reason = "changes with the posture of the arm and is not recorded; the impedance error needs a constant inertia"
        raise InputError([Fault("impedance.M_d", f"'natural' {reason}")], "scenario")
    rows = grid(trace, start, end, INTERVAL_S)
    first, last = rows[:-1], rows[1:]
    T = (trace.t[last] - trace.t[first])[:, None]
    # A force acts from t_k on for one step, a left sum. The running impulse uses the trapezoidal rule.
    f = np.array(trace.f_contact_W)
    integral = cumulative(trace.t, f)
    integral[:, 0] = -trace.impulse
    force_W = (integral[last] - integral[first] + 0.5 * h * (f[first] - f[last])) / T
    arm_W = np.array([trace.header.probe_radius, 0.0, 0.0])
    position, attitude, velocity = (trace[name] for name in trace.header.task_frame)
    R_WB = rotation_matrix(attitude[rows])
    R_BW = 0.5 * np.swapaxes(R_WB[:-1] + R_WB[1:], 1, 2)
    tau_c = np.hstack([_turned(R_BW, force_W), _turned(R_BW, np.cross(arm_W, force_W))])
    v_W = _turned(R_WB, velocity[rows, :3])
    ahead_W = h * np.diff(v_W, axis=0) - 0.5 * h * np.diff(trace.p_d_dot[rows], axis=0)
    way_W = np.diff((position - trace.p_d)[rows], axis=0) - ahead_W
    change = np.diff(trace.nu_e[rows], axis=0)
    turn = np.array([_turn(attitude[a], attitude[b]) for a, b in zip(first, last, strict=True)])
    turn = turn.reshape(-1, 3) - h * change[:, 3:] - _wanted_turn(trace, rows, R_BW)
    nu_e = np.hstack([_turned(R_BW, way_W), turn]) / T
    sums = np.diff(cumulative(trace.t, trace.eta_e)[rows], axis=0) - 0.5 * h * np.diff(trace.eta_e[rows], axis=0)
    eta_e = sums / T
    wanted = change / T @ design.M_d.T + nu_e @ design.D_d.T + eta_e @ design.K_d.T
    impedance = trace.scenario.impedance
    K_f, F_d = np.array(impedance.K_f), np.array(impedance.F_d)
    if impedance.schedule:
        K_f, F_d = (np.diff(cumulative(trace.t, trace[name])[rows], axis=0) / T for name in ("K_f", "F_d"))
    residual = wanted - K_f * (tau_c - F_d)
    if not len(residual):
        return np.full(6, np.nan)
    error = np.sqrt((residual**2).mean(axis=0))
    rubbed = trace.scenario.wall.friction > 0.0 and bool(trace.touches[last[-1]] > 0.0)
    if rubbed and trace.header.row_steps > 1:
        error[np.abs(design.normal) < 1.0 - 1e-9] = np.nan
    return error


def _wanted_turn(trace: Trace, rows: np.ndarray, R_BW: np.ndarray) -> np.ndarray:
    """(n, 3) rotation vectors in B of the desired attitude from row to row, with the correction of the time step."""
    if "quat_d" not in trace.header.by_name or (trace.quat_d == trace.quat_d[0]).all():
        return np.zeros((len(rows) - 1, 3))
    quat_d, h = trace.quat_d[rows], trace.scenario.simulation.timestep
    turns = np.array([_turn(a, b) for a, b in itertools.pairwise(quat_d)]).reshape(-1, 3)
    omega_d = (trace[trace.header.task_frame[2]] - trace.nu_e)[rows, 3:]
    return _turned(R_BW, _turned(rotation_matrix(quat_d[:-1]), turns)) - 0.5 * h * np.diff(omega_d, axis=0)


def _turned(R: np.ndarray, a: np.ndarray) -> np.ndarray:
    """(n, 3) vectors rotated by matrices (n, 3, 3)."""
    return np.einsum("nij,nj->ni", R, a)


def _turn(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) in B from one attitude to the next, both unit quaternions [rad]."""
    turn, inverse, difference = np.zeros(3), first * [1.0, -1.0, -1.0, -1.0], np.zeros(4)
    mujoco.mju_mulQuat(difference, inverse, last)
    mujoco.mju_quat2Vel(turn, difference, 1.0)
    return turn


def design_of(trace: Trace) -> Design:
    """Design of a run's controller, from the header of its log."""
    return Design.of(trace.scenario, *task_inertias(trace.scenario, trace.header.mjcf.vehicle))
