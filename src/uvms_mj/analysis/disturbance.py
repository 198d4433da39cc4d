"""The disturbance that the sliding mode of a run had to reject, eqs. (11) and (28), and its rate of change."""

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..control.model import accelerated_frame, coefficients, model_wrenches
from ..physics.frames import rotation_matrix, to_body
from ..records.header import Status
from ..records.trace import Trace
from ..setup.base import Setup, set_up

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
        doubt: (6,) ratio of the largest rate of all rows to that of every second row, at least 1; 1 for a log of every
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
    if trace.status is Status.unstable:
        return "the run diverged"
    if len(trace) < 4:
        return "fewer than four samples"
    if not trace.scenario.current.constant and "v_c_W" not in trace:
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


def lumped_disturbance(trace: Trace, setup: Setup) -> np.ndarray:
    """tau_bar_dist (n, 6) of the paper's eq. (11), estimates minus truth [N, N m]."""
    true, nominal, factors = setup.vehicle, setup.nominal, trace.scenario.estimates
    unsteady = not trace.scenario.current.constant
    v_c_W = trace.v_c_W if unsteady else np.array(trace.scenario.current.velocity_W)
    nu, nu_c = trace.nu, _in_body(trace, v_c_W)
    nu_c_dot = np.zeros_like(nu_c)
    nu_c_dot[:, :3] = -np.cross(nu[:, 3:], nu_c[:, :3])
    if unsteady:
        nu_c_dot += _in_body(trace, trace.v_c_dot_W)
    R_WB, out = np.moveaxis(rotation_matrix(trace.quat_WB), 0, 2), np.empty((2, 3, *nu.T.shape))
    known, real = (SimpleNamespace(**coefficients(each, setup.gravity_W)) for each in (nominal, true))
    model_wrenches(known, known.gravity_W, R_WB, nu.T, *out[0])
    model_wrenches(real, real.gravity_W, R_WB, (nu - nu_c).T, *out[1])
    if unsteady:
        water = SimpleNamespace(a_c_W=trace.a_c_W.T, v_c_dot_W=trace.v_c_dot_W.T)
        accelerated_frame(real, water, R_WB, np.empty((3, len(trace))), out[1, 2], np.empty(nu.T.shape))
    (C_hat, D_hat, g_hat), (C, D, g) = np.swapaxes(out, 2, 3)  # (n, 6) each
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
    a_B = np.zeros((6, len(trace)))
    to_body(np.moveaxis(rotation_matrix(trace.quat_WB), 0, 2), a_W.T, a_B)
    return a_B.T
