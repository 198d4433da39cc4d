"""The impedance error of a trace, and the disturbance that its sliding mode had to reject."""

import itertools
import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ..control.design import Design
from ..control.model import OF_ROW, ROW, coefficients, row_wrenches
from ..errors import Fault, InputError
from ..physics.frames import rotation_matrix
from ..physics.kernels import called_on
from ..plant.build import task_inertias
from ..records.header import Status
from ..records.trace import Trace
from ..setup.base import Setup, set_up
from .metrics import cumulative, grid

INTERVAL_S = 0.01
"""Length of the intervals over which the residual is averaged [s]."""


def impedance_error(trace: Trace, start: float = 0.0, end: float = np.inf) -> np.ndarray:
    r"""Rms (6,) of the residual of eq. (12), or of eq. (7) with K_f and F_d, after averaging over 10 ms intervals. At a
    tool, B stands for its frame.

    .. math:: r_j = \frac{1}{T} \int_{t_j}^{t_j + T} (M_d \dot{\tilde\nu} + D_d \tilde\nu + K_d \tilde\eta
              - K_f (\tau_c - F_d)) \, dt, \qquad \sqrt{\tfrac{1}{n} \sum_j r_j^2}

    Accelerations, and steps between rows, are not sampled. Their integrals come from differences between rows: of
    nu_dot it is the change of nu_e, of the normal force the running impulse, of nu_e the displacement. These
    three are exact even if s changes its sign at every step. The sum over steps contains nu at the beginning of each
    step, while the vehicle moves with nu at its end (correction h nu) and the reference with the mean of both
    (correction h/2 nu_d). eta_e and the rotation of B are integrated over rows by the trapezoidal rule: at rest any log
    rate is sufficient, an impact needs 1 kHz or more. Friction is integrated over rows as well, but may change its sign
    at every step. With wall friction, a log without every step therefore gives nan in the components with friction.

    Raises:
        InputError: there are contacts besides the probe's with ``[wall]``; M_d is the natural inertia of a vehicle with
            joints, which changes; or numbers changed in the run.
    """
    if "f_normal" in trace.header.by_name:
        raise InputError(
            "the impedance error is known for the probe in front of [wall] alone, without bumpers, contact "
            "bodies and [[walls]]"
        )
    if trace.changed:
        raise InputError(f"{', '.join(trace.changed)} changed in the run; the impedance error needs constant numbers")
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


ROWS_S = 1.5e-3
"""Rows further apart than this may miss the largest rate of a disturbance, unless the log has every step [s]."""


@dataclass(frozen=True, eq=False)
class Experienced:
    """The disturbance varphi of eq. (28) during a run.

    Attributes:
        t: (n,) [s].
        varphi: (n, 6) [m/s^2, rad/s^2].
        rate: (n - 1, 6) difference quotients from one row to the next [m/s^3, rad/s^3]. They are means between rows, so
            that faster changes need a log with more rows. varphi is continuous at an impact, because it depends on nu
            and not on the contact force. Its rate is largest there, like nu_dot.
        doubt: (6,) ratio of the largest rate of all rows to the largest rate of every second row, at least 1; 1 for a
        log of every
            step. It estimates by how much the true rate may be larger. Verdicts use the rate times this factor.
        contact_lag: (6,) largest M_hat^-1 (tau_c - tau_c_given) [m/s^2, rad/s^2]. A law that holds its command for
            longer than a time step also holds the contact force. The difference is a disturbance, but it jumps at each
            touch and has no rate. It widens the band in proportion to the period and is not part of varphi.
    """

    t: np.ndarray
    varphi: np.ndarray
    rate: np.ndarray
    doubt: np.ndarray
    contact_lag: np.ndarray

    def largest_rate(self, start: float = -math.inf, end: float = math.inf) -> np.ndarray:
        """Largest |rate| (6,) of the rows from start to end [s]; zero without rows."""
        inside = (self.t[:-1] >= start) & (self.t[1:] <= end)
        return np.abs(self.rate[inside]).max(axis=0, initial=0.0)

    def time_beyond(self, certificate: Any, s: np.ndarray) -> np.ndarray:
        """Time (6,) for which the rate was not below the bound of a
        :class:`uvms_mj.control.theory.certificate.Certificate` at s (n, 6), so that V may have grown [s]."""
        crossed = s[:-1] * s[1:] <= 0.0
        nearest = np.where(crossed, 0.0, np.minimum(np.abs(s[:-1]), np.abs(s[1:])))
        return np.diff(self.t) @ (np.abs(self.rate) * self.doubt >= certificate.allowed(nearest))


def experienced(trace: Trace) -> Experienced | str:
    """Disturbance that the sliding mode of a run had to reject, from its samples and the true coefficients, or the
    reason why it cannot be computed.

    It contains tau_bar_dist of eq. (11); the wrench that saturated thrusters did not deliver, which eq. (10) omits;
    F_1 (omega x p_e), which eq. (18) omits and which arises because p_e is in B; and, for GSTA alone, the missing
    nominal control (23).
    """
    true = trace.scenario.vehicle
    if (trace.scenario.estimates.inertia, true.mass, true.added_mass) != (1.0, 1.0, 1.0):
        return "M_hat is not M: varphi contains (M_hat - M) nu_dot and therefore the switching of the law"
    if names := trace.scenario.with_inertia:
        return f"the inertia of {', '.join(names)} changes, which varphi does not know"
    if trace.status is Status.unstable:
        return "the run diverged"
    if len(trace) < 4:
        return "fewer than four samples"
    if not trace.scenario.constant_flow and "v_c_W" not in trace.arrays:
        return "the motion of the water was not recorded: run the scenario itself, not a reset of another one"
    apart = float(np.diff(trace.t).max())
    if trace.header.row_steps > 1 and apart > ROWS_S:
        return f"rows {apart:g} s apart may miss the fastest change: run with --log-rate 1000, or full"
    setup = set_up(trace.scenario, trace.header.mjcf)
    if setup.not_rigid:
        return f"the lumped disturbance is computed for a rigid vehicle at B, and {setup.not_rigid}"
    wrench = lumped_disturbance(trace, setup) + trace.tau - trace.tau_cmd
    bound = setup.certificate
    if bound is not None and not bound.nominal:
        wrench -= trace.tau_nom
    M_hat_inv = np.linalg.inv(setup.design.M_hat)
    varphi = wrench @ M_hat_inv.T
    varphi[:, :3] -= np.array(setup.task.F_1[:3]) * np.cross(trace.nu[:, 3:], trace.eta_e[:, :3])
    late = _in_body(trace, trace.f_contact_W - trace.f_contact_m_W)
    rate, coarser = _rate(trace.t, varphi), _rate(trace.t[::2], varphi[::2])
    largest, seen = (np.abs(each).max(axis=0, initial=1e-300) for each in (rate, coarser))
    doubt = np.maximum(1.0, largest / seen) if trace.header.row_steps > 1 else np.ones(6)
    return Experienced(trace.t, varphi, rate, doubt, np.abs(late @ M_hat_inv.T).max(axis=0))


def _rate(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.diff(values, axis=0) / np.diff(t)[:, None]


_AT_ONCE = 256


def _record(values: dict[str, Any]) -> np.ndarray:
    """A record (1,) of numbers and arrays."""
    record = np.zeros(1, np.dtype([(name, "f8", np.shape(value)) for name, value in values.items()], align=True))
    for name, value in values.items():
        record[name] = value
    return record


def lumped_disturbance(trace: Trace, setup: Setup) -> np.ndarray:
    """tau_bar_dist (n, 6) of the paper's eq. (11), estimates minus truth [N, N m]."""
    true, nominal, factors = setup.vehicle, setup.nominal, trace.scenario.estimates
    unsteady = not trace.scenario.constant_flow
    v_c_W = trace.v_c_W if unsteady else trace.scenario.mean_flow_W
    nu, nu_c = trace.nu, _in_body(trace, v_c_W)
    nu_c_dot = np.zeros_like(nu_c)
    nu_c_dot[:, :3] = -np.cross(nu[:, 3:], nu_c[:, :3])
    if unsteady:
        nu_c_dot += _in_body(trace, trace.v_c_dot_W)
    rows, at_once = np.zeros(len(trace), ROW), np.zeros(_AT_ONCE, ROW)
    rows["nu"], rows["nu_r"], rows["R_WB"] = nu, nu - nu_c, rotation_matrix(trace.quat_WB)
    if unsteady:
        rows["a_c_W"], rows["v_c_dot_W"] = trace.a_c_W, trace.v_c_dot_W
    vehicles = (_record(coefficients(each, setup.gravity_W)) for each in (nominal, true))
    set_wrenches = called_on(row_wrenches, *vehicles, at_once)
    for first in range(0, len(rows), _AT_ONCE):
        some = rows[first : first + _AT_ONCE]
        at_once[: len(some)] = some
        set_wrenches(len(some), int(unsteady))
        some[:] = at_once[: len(some)]
    C_hat, D_hat, g_hat, C, D, g = (rows[name] for name in OF_ROW)
    return (
        trace.tau_dist
        + nu_c_dot @ true.M.T
        + (factors.coriolis * C_hat - C)
        + (factors.damping * D_hat - D)
        + ((factors.inertia - 1.0) * (trace.nu_dot @ nominal.M.T) + trace.nu_dot @ (nominal.M - true.M).T)
        + ((factors.restoring - 1.0) * g_hat + (g_hat - g))
    )


def _in_body(trace: Trace, a_W: np.ndarray) -> np.ndarray:
    """(n, 6): a_W, (3,) or (n, 3), resolved in B and followed by three zeros."""
    R_BW = np.swapaxes(rotation_matrix(trace.quat_WB), 1, 2)
    return np.hstack([_turned(R_BW, np.broadcast_to(a_W, (len(trace), 3))), np.zeros((len(trace), 3))])
