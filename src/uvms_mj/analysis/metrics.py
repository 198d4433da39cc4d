"""Metrics of a trace. All are pure functions."""

import functools
import itertools

import mujoco
import numpy as np

from ..control.design import Design
from ..physics.frames import rotation_matrices
from ..records.header import Header, Status
from ..records.trace import Trace
from ..stages.signals import FINAL_WINDOW_S
from . import rest, setup
from .sampling import control_period

SETTLED = 1e-3
"""Relative change over the final window below which a force counts as settled [1]."""
AT_REST = 1e-4
"""Speed below which a vehicle without contact counts as settled [m/s, rad/s]."""
AROUND_THE_END_S = 2.0 * FINAL_WINDOW_S
"""Length of the end of a run that :func:`final_force` needs [s]. The running signals cover the rest."""
FAST_S = 0.01
"""Variation of tau that cancels within this time counts as chattering, not as control [s]."""
FAST_PERIODS = 10
"""Least length of the interval for chattering, in control periods: a held command does not vary within a period."""


def final_force(trace: Trace) -> tuple[float | None, bool]:
    """Mean pushing force over the last 0.5 s [N], and whether it has settled in this window.

    Both are computed from every step, at any log rate. For a run that stopped early, the mean is taken over the last
    0.5 s of its rows, and the force has not settled.
    """
    if len(trace) == 0:
        return None, False
    t, impulse = trace.t, trace.impulse
    if trace.status is Status.completed and trace.duration_s >= FINAL_WINDOW_S:
        mean = float(trace.final_impulse[-1]) / FINAL_WINDOW_S
        spread = float(trace.final_high[-1] - trace.final_low[-1])
        still = mean > 0.0 or bool(np.abs(trace.nu[-1]).max() < AT_REST)
        return mean, bool(still and spread <= SETTLED * mean)
    start = max(0, int(np.searchsorted(t, t[-1] - FINAL_WINDOW_S + 1e-9, side="right")) - 1)
    window = float(t[-1] - t[start])
    return float(impulse[-1] - impulse[start]) / window if window > 0.0 else float(trace.push[-1]), False


# Metrics of a whole run or a part of it. A part extends from the first row at or after `start` to the last row at or
# before `end` [s]. Vectors (6,) are [N, N m] unless another unit is given. Quantities that accumulate at every step are
# differences of a running signal between two rows, so that they do not depend on the log rate.


def settling_time(t: np.ndarray, y: np.ndarray, final: float, tolerance: float) -> float | None:
    r"""Time from which |y - final| <= tolerance until the end of t [s]; None if the last sample is outside.

    .. math:: t_s = \min \{ t_k : |y_j - y_\infty| \le \delta \;\forall j \ge k \}
    """
    outside = np.flatnonzero(~(np.abs(y - final) <= tolerance))
    if not len(outside):
        return float(t[0])
    return float(t[outside[-1] + 1]) if outside[-1] + 1 < len(t) else None


def position_settling_time(trace: Trace, band: float = 0.02) -> float | None:
    """Time from which x of W stays near its final mean, within ``band`` times its whole change [s].

    None if x :func:`drifts` at the end of the run, because it has not settled at its final mean.
    """
    x = trace.p_WB[:, 0]
    final = _final_mean(trace, x)
    since = settling_time(trace.t, x, final, band * abs(final - x[0]))
    return None if since is None or drifts(trace.t, x, since, band * abs(final - x[0])) else since


def force_settling_time(trace: Trace, band: float = 0.02) -> float | None:
    """Time from which the pushing force stays within the relative ``band`` about :func:`final_force` [s].

    None without contact, if the force has not settled according to :func:`final_force`, or if it :func:`drifts` at the
    end of the run. The time comes from rows. The force may leave the band unnoticed between two rows, so the log needs
    several rows per rebound.
    """
    final, settled = final_force(trace)
    if not final or not settled:
        return None
    since = settling_time(trace.t, trace.push, final, band * final)
    return None if since is None or drifts(trace.t, trace.push, since, band * final) else since


def drifts(t: np.ndarray, y: np.ndarray, since: float, tolerance: float) -> bool:
    r"""Whether y (n,) only passes through the band of ``tolerance`` that it entered at ``since``.

    .. math:: |\bar y_4 - \bar y_3| > \delta / 8

    with the means over the third and the last quarter of the time in the band. The left side is :math:`\delta / 4` for
    a steady ramp, at most 0.12 :math:`\delta` for an exponential, and almost zero for a steady oscillation.
    """
    third, last = (y[(t >= a) & (t <= b)] for a, b in itertools.pairwise(since + (t[-1] - since) * _QUARTERS))
    return not (len(third) and len(last) and abs(last.mean() - third.mean()) <= tolerance / 8.0)


_QUARTERS = np.array([0.5, 0.75, 1.0])


def overshoot(trace: Trace) -> float | None:
    r"""Overshoot of x of W beyond its final mean, relative to its whole change [1]; None if x has not settled.

    .. math:: \max(0, \max_k \sigma (x_k - x_\infty)) / |x_\infty - x_0|, \qquad \sigma = \mathrm{sgn}(x_\infty - x_0)
    """
    x, settled = trace.p_WB[:, 0], position_settling_time(trace)
    if settled is None or settled > trace.t[-1] - FINAL_WINDOW_S:
        return None
    change = _final_mean(trace, x) - x[0]
    beyond = float((np.sign(change) * (x - x[0])).max() / abs(change)) - 1.0 if change else 0.0
    return max(0.0, beyond)


def impact_impulse(trace: Trace) -> float | None:
    """Impulse of the first touch, from first contact to the first loss of contact [N s]; None without contact.

    The integral includes every step. The end of the touch is detected in the rows.
    """
    begun = np.flatnonzero(trace.impulse > 0.0)
    if not len(begun):
        return None
    free = np.flatnonzero(trace.push[begun[0] :] == 0.0)
    return float(trace.impulse[begun[0] + free[0]] if len(free) else trace.impulse[-1])


def demanded_force(trace: Trace) -> float:
    """Pushing force at rest that the desired impedance demands, by :func:`.rest.demanded_force` [N]."""
    return rest.demanded_force(trace.scenario, trace.scenario.wall.stiffness)


def steady_force_error(trace: Trace) -> float | None:
    """:func:`final_force` minus :func:`demanded_force` [N]."""
    final, _ = final_force(trace)
    return None if final is None else final - demanded_force(trace)


def impedance_error(trace: Trace, start: float = 0.0, end: float = np.inf) -> np.ndarray:
    r"""Rms (6,) of the residual of eq. (12), or of eq. (7) with K_f and F_d, after averaging over 10 ms intervals.

    .. math:: r_j = \frac{1}{T} \int_{t_j}^{t_j + T} (M_d \dot{\tilde\nu} + D_d \tilde\nu + K_d \tilde\eta
              - K_f (\tau_c - F_d)) \, dt, \qquad \sqrt{\tfrac{1}{n} \sum_j r_j^2}

    Accelerations, and steps between rows, are not sampled. Their integrals come from differences between rows: that of
    nu_dot is the change of nu_e, that of the normal force the running impulse, that of nu_e the displacement. These
    three are exact even if s changes its sign at every step. The sum over steps contains nu at the beginning of each
    step, while the vehicle moves with nu at its end (correction h nu) and the reference with the mean of both
    (correction h/2 nu_d). eta_e and the rotation of B are integrated over rows by the trapezoidal rule: at rest any log
    rate is sufficient, an impact needs 1 kHz or more. Friction is integrated over rows as well, but may change its sign
    at every step. With wall friction, a log without every step therefore gives nan in the components with friction.
    """
    design, h = design_of(trace), trace.scenario.simulation.timestep
    rows = _grid(trace, start, end, FAST_S)
    first, last = rows[:-1], rows[1:]
    T = (trace.t[last] - trace.t[first])[:, None]
    # A force acts from t_k on for one step, a left sum. The running impulse uses the trapezoidal rule.
    f = np.array(trace.f_contact_W)
    integral = _cumulative(trace.t, f)
    integral[:, 0] = -trace.impulse
    force_W = (integral[last] - integral[first] + 0.5 * h * (f[first] - f[last])) / T
    arm_W = np.array([trace.header.geometry.reach, 0.0, 0.0])
    R_WB = rotation_matrices(trace.quat_WB[rows])
    R_BW = 0.5 * np.swapaxes(R_WB[:-1] + R_WB[1:], 1, 2)
    tau_c = np.hstack([_turned(R_BW, force_W), _turned(R_BW, np.cross(arm_W, force_W))])
    v_W = _turned(R_WB, trace.nu[rows, :3])
    ahead_W = h * np.diff(v_W, axis=0) - 0.5 * h * np.diff(trace.p_d_dot[rows], axis=0)
    way_W = np.diff((trace.p_WB - trace.p_d)[rows], axis=0) - ahead_W
    change = np.diff(trace.nu_e[rows], axis=0)
    turn = np.array([_turn(trace.quat_WB[a], trace.quat_WB[b]) for a, b in zip(first, last, strict=True)])
    nu_e = np.hstack([_turned(R_BW, way_W), turn.reshape(-1, 3) - h * change[:, 3:]]) / T
    sums = np.diff(_cumulative(trace.t, trace.eta_e)[rows], axis=0) - 0.5 * h * np.diff(trace.eta_e[rows], axis=0)
    eta_e = sums / T
    wanted = change / T @ design.M_d.T + nu_e @ design.D_d.T + eta_e @ design.K_d.T
    impedance = trace.scenario.impedance
    residual = wanted - np.array(impedance.K_f) * (tau_c - np.array(impedance.F_d))
    if not len(residual):
        return np.full(6, np.nan)
    error = np.sqrt((residual**2).mean(axis=0))
    rubbed = trace.scenario.wall.friction > 0.0 and bool(trace.touches[last[-1]] > 0.0)
    if rubbed and trace.header.row_steps > 1:
        error[np.abs(design.normal) < 1.0 - 1e-9] = np.nan
    return error


def _turned(R: np.ndarray, a: np.ndarray) -> np.ndarray:
    """(n, 3) vectors rotated by matrices (n, 3, 3)."""
    return np.einsum("nij,nj->ni", R, a)


def _turn(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) in B from one attitude to the next, both unit quaternions [rad]."""
    turn, inverse, difference = np.zeros(3), first * [1.0, -1.0, -1.0, -1.0], np.zeros(4)
    mujoco.mju_mulQuat(difference, inverse, last)
    mujoco.mju_quat2Vel(turn, difference, 1.0)
    return turn


def control_effort(trace: Trace, start: float = 0.0, end: float = np.inf) -> np.ndarray:
    r"""Integral (6,) of tau_i^2 over every step [N^2 s, N^2 m^2 s]."""
    return _gain(trace, "effort", start, end)[0]


def total_variation(trace: Trace, start: float = 0.0, end: float = np.inf) -> np.ndarray:
    r"""Sum (6,) of |tau_k - tau_(k-1)| over every step."""
    return _gain(trace, "tau_variation", start, end)[0]


def chattering(trace: Trace, start: float = 0.0, end: float = np.inf) -> np.ndarray:
    r"""Chattering index (6,): variation of tau per second that cancels within T [N/s, N m/s].

    .. math:: \frac{1}{t_b - t_a} \left( \sum_k |\tau_k - \tau_{k-1}| - \sum_j |\tau(t_j + T) - \tau(t_j)| \right),
              \qquad T = \max(10 \text{ ms}, 10 \, T_c)

    with the first sum over every step, the second over intervals of length T, and T_c the control period. The index of
    a smooth input is small, because it reverses only a few times. The index of an input that alternates at every
    control instant is its total variation per second. The result is nan if the part of the run is shorter than T.
    """
    rows = _grid(trace, start, end, max(FAST_S, FAST_PERIODS * control_period(trace.scenario)))
    if len(rows) < 2:
        return np.full(6, np.nan)
    variation = trace.tau_variation[rows[-1]] - trace.tau_variation[rows[0]]
    slow = np.abs(np.diff(trace.tau[rows], axis=0)).sum(axis=0)
    return np.maximum(0.0, variation - slow) / (trace.t[rows[-1]] - trace.t[rows[0]])


def mean_change(trace: Trace, start: float = 0.0, end: float = np.inf) -> np.ndarray:
    r"""Mean change (6,) of tau from one control instant to the next, over every step.

    .. math:: \frac{T_c}{t_b - t_a} \sum_k |\tau_k - \tau_{k-1}|
    """
    variation, duration = _gain(trace, "tau_variation", start, end)
    return variation * control_period(trace.scenario) / max(duration, 1e-300)


def largest_change(trace: Trace, end: float = np.inf) -> np.ndarray:
    """Largest change (6,) of tau from one control instant to the next until ``end``, over every step."""
    return trace.tau_step_max[_window(trace, 0.0, end)[1]]


def reversals(trace: Trace, threshold: float, start: float = 0.0, end: float = np.inf) -> np.ndarray:
    """Number (6,) of reversals of tau [1].

    A reversal is a pair of successive changes in opposite directions, each larger than ``threshold`` from one control
    instant to the next. The count uses rows, so the log should contain every step.
    """
    first, last = _window(trace, start, end)
    steps = np.rint(trace.t[first : last + 1] / trace.scenario.simulation.timestep)
    period_steps = round(control_period(trace.scenario) / trace.scenario.simulation.timestep)
    at_control = steps % period_steps == 0
    change = np.diff(trace.tau[first : last + 1][at_control], axis=0)
    change[np.abs(change) <= threshold] = 0.0
    return (change[1:] * change[:-1] < 0.0).sum(axis=0)


def energy_from_wall(trace: Trace) -> float:
    r"""Largest net energy that the vehicle has drawn from the wall at any row [J]; zero for a passive wall.

    .. math:: \max\left(0, -\min_t \int_0^t -f_W^\top \dot p_{WB} \, dt\right)

    The integral is the signal ``wall_work``. Its value at the end of a run is the net energy absorbed by the wall.
    """
    return max(0.0, -float(trace.wall_work.min()))


def boundary_layer_share(trace: Trace, start: float = 0.0, end: float = np.inf) -> np.ndarray:
    """Fraction (6,) of the time with |s_i| < epsilon, over every step [1]; epsilon = 1e-3 for laws without epsilon."""
    inside, duration = _gain(trace, "boundary_layer_time", start, end)
    return inside / max(duration, 1e-300)


def _window(trace: Trace, start: float, end: float) -> tuple[int, int]:
    """First and last row of a part of a run."""
    first = int(np.searchsorted(trace.t, start - 1e-9))
    last = int(np.searchsorted(trace.t, end + 1e-9, side="right")) - 1
    first = min(first, len(trace) - 1)
    return first, max(first, last)


def _gain(trace: Trace, name: str, start: float, end: float) -> tuple[np.ndarray, float]:
    """Increase of a running signal over a part of a run, and the duration of that part [s]."""
    first, last = _window(trace, start, end)
    return trace[name][last] - trace[name][first], float(trace.t[last] - trace.t[first])


def _grid(trace: Trace, start: float, end: float, apart: float) -> np.ndarray:
    """Indices of rows at intervals of ``apart`` [s]; of all rows if the log is slower than that."""
    first, last = _window(trace, start, end)
    instants = np.arange(trace.t[first], trace.t[last] + 1e-9, apart)
    rows = np.searchsorted(trace.t, instants - 1e-9)
    return np.unique(np.minimum(rows, last))


def _cumulative(t: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Running integral (n, m) of y (n, m) over t by the trapezoidal rule."""
    steps = 0.5 * np.diff(t)[:, None] * (y[1:] + y[:-1])
    return np.concatenate([np.zeros((1, y.shape[1])), np.cumsum(steps, axis=0)])


def _final_mean(trace: Trace, y: np.ndarray) -> float:
    return float(y[trace.t >= trace.t[-1] - FINAL_WINDOW_S].mean())


def design_of(trace: Trace) -> Design:
    """Design of a run's controller, from the header of its log."""
    return _design(trace.header)


@functools.lru_cache(maxsize=32)
def _design(header: Header) -> Design:
    return setup.design_of(header.scenario, header.mjcf.vehicle)
