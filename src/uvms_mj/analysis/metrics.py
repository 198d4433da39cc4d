"""Metrics of a trace. All are pure functions."""

import contextlib
import itertools
import math
from dataclasses import dataclass

import numpy as np

from ..control.design import demanded_force
from ..plant.contacts import Probe, contacts_of
from ..records.header import Status
from ..records.trace import Trace
from ..setup.base import set_up
from ..stages.signals import FINAL_WINDOW_S

OFF = 0.01
"""Error of a position or a velocity from which a joint is off its target [rad or m, and per second]."""
SAME_NORMAL = 1e-6
"""Size of the part of a normal across the others, relative to them all, below which it is the same one [1]."""
AT_STOP = 1e-4
"""Distance from an end of its range up to which a joint is at its stop [rad or m]."""
SETTLED = 1e-3
"""Relative change over the final window below which a force counts as settled [1]."""
AT_REST = 1e-4
"""Speed below which a vehicle without contact counts as settled [m/s, rad/s]."""
TRENDS_S = (0.5, 1.0, 2.0, 4.0)
"""Times over which :func:`trend` looks for a change of the force, twice each [s]."""
AROUND_THE_END_S = 2.0 * TRENDS_S[-1] + FINAL_WINDOW_S
"""Length of the end of a run that :func:`final_force` needs [s]. The running signals cover the rest."""
SLOWEST_S = 300.0
"""Longest time constant of a trend [s]. A force that does not slow down is taken for one of this time constant."""
ROUNDING = 1e-9
"""Relative change of a mean force, or part of a contact in all forces, that may be of rounding [1]."""
CHATTERING_S = 1.0
"""Length of the end of a run over which chattering is measured [s]."""
FAST_S = 0.01
"""Variation of tau that cancels within this time counts as chattering, not as control [s]."""
FAST_PERIODS = 10
"""Least length of the interval for chattering, in control periods: a held command does not vary within a period."""


def final_force(trace: Trace) -> tuple[float | None, bool]:
    """Mean pushing force over the last 0.5 s [N], and whether it has settled: in this window it varies by less than
    0.1 %, and by its :func:`trend` less than 0.1 % is still to come.

    Both are computed from every step, at any log rate. For a run that stopped early, the window is the last 0.5 s of
    its rows. The mean still counts every step; the force has settled if no row in the window, with its band,
    differs from it. A run that diverged, or that has no 0.5 s, has not settled.
    """
    mean, spread, lasted = _final_window(trace)
    if mean is None or not lasted:
        return mean, False
    still = mean > 0.0 or bool(np.abs(trace.nu[-1]).max() < AT_REST)
    change = trend(trace)
    to_come = 0.0 if change is None else change.to_come
    return mean, bool(still and max(spread, to_come) <= SETTLED * mean)


def _final_window(trace: Trace) -> tuple[float | None, float, bool]:
    """Mean force over the final window [N], largest minus least force in it [N], and whether the run has lasted so
    long and did not diverge."""
    if len(trace) == 0:
        return None, 0.0, False
    t, impulse = trace.t, trace.impulse
    if trace.status is Status.completed and trace.duration_s >= FINAL_WINDOW_S:
        mean = float(trace.final_impulse[-1]) / FINAL_WINDOW_S
        spread = float(trace.final_high[-1] - trace.final_low[-1])
        return mean, spread, True
    start = max(0, int(np.searchsorted(t, t[-1] - FINAL_WINDOW_S + 1e-9, side="right")) - 1)
    length = float(t[-1] - t[start])
    mean = float(impulse[-1] - impulse[start]) / length if length > 0.0 else float(trace.push[-1])
    whole = trace.status is not Status.unstable and length >= FINAL_WINDOW_S - 1e-9
    rows = slice(start, start + 1), slice(start + 1, None)  # the band of the first row is of the time before
    seen = [trace.push[rows[0]], *(edge[rows[1]] for edge in trace.band("push"))]
    return mean, float(np.ptp([mean, *np.concatenate(seen)])), whole


@dataclass(frozen=True)
class Trend:
    """A lasting change of the force at the end of a run: its rate [N/s], and how much of it is still to come [N]."""

    rate: float
    to_come: float


def trend(trace: Trace) -> Trend | None:
    r"""The lasting change of the pushing force at the end of a run; None if the force shows none.

    With the means :math:`m_0, m_1, m_2` over 0.5 s that end at the end of the run and d and 2 d before it, the force
    follows a trend if it has moved the same way twice, and by more than it varies within the last 0.5 s, R. An
    exponential with such means has the time constant T, and as much is still to come:

    .. math:: \dot f \, T, \qquad T = d / \ln \frac{m_1 - m_2}{m_0 - m_1}, \qquad
              |\dot f| = \min(|m_0 - m_1| / d, \; R / 0.5 \text{ s})

    T is at most :data:`SLOWEST_S`, as for a steady change. A change that becomes faster is no approach; it counts as if
    it went back. d is the shortest time of :data:`TRENDS_S` with a trend, because an impact may be between the means of
    a longer one. The means come from the impulse, hence from every step.
    """
    mean, spread, _ = _final_window(trace)
    if not mean or not np.isfinite(trace.impulse[-1]):
        return None
    apart = trace.header.row_steps * trace.scenario.simulation.timestep
    width, scale = max(FINAL_WINDOW_S, apart), max(1.0, apart / FINAL_WINDOW_S)
    for d in (scale * each for each in TRENDS_S):
        ends = trace.t[-1] - d * np.arange(3)
        if ends[-1] - width < trace.t[0] - 1e-9:
            return None
        upper, lower = (np.interp(edges, trace.t, trace.impulse) for edges in (ends, ends - width))
        now, before = -np.diff((upper - lower) / width)
        if now * before > 0.0 and abs(now) > max(spread, ROUNDING * mean):
            slower = abs(math.log(before / now))
            T = min(SLOWEST_S, d / slower) if slower > 0.0 else SLOWEST_S
            rate = min(abs(now) / d, spread / FINAL_WINDOW_S)
            return Trend(math.copysign(rate, now), rate * T)
    return None


def rest_force(trace: Trace) -> float | None:
    """:func:`final_force` if it has settled [N]; otherwise None."""
    force, settled = final_force(trace)
    return force if settled else None


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
    """Time from which x of W of the task's frame stays near its final mean, within ``band`` times its whole change [s].

    None if x :func:`drifts` at the end of the run, because it has not settled at its final mean.
    """
    x = _origin(trace)[:, 0]
    final = _final_mean(trace, x)
    tolerance = band * abs(final - x[0])
    since = settling_time(trace.t, x, final, tolerance)
    return None if since is None or drifts(trace.t, x, since, tolerance) else since


def force_settling_time(trace: Trace, band: float = 0.02) -> float | None:
    """Time from which the pushing force stays within the relative ``band`` about :func:`final_force` [s].

    None without contact, if the force has not settled according to :func:`final_force`, or if it :func:`drifts` at the
    end of the run. The time is the time of a row. A force that leaves the band between two rows has not settled.
    """
    final, settled = final_force(trace)
    if not final or not settled:
        return None
    away = np.maximum(*(np.abs(edge - final) for edge in trace.band("push")))
    since = settling_time(trace.t, away, 0.0, band * final)
    return None if since is None or drifts(trace.t, trace.push, since, band * final) else since


def drifts(t: np.ndarray, y: np.ndarray, since: float, tolerance: float) -> bool:
    r"""Whether y (n,) only passes through the band of ``tolerance`` that it entered at ``since``.

    .. math:: |\bar y_4 - \bar y_3| > \delta / 8

    with the means over the third and the last quarter of the time in the band. The left side is :math:`\delta / 4` for
    a steady ramp, at most 0.12 :math:`\delta` for an exponential, and almost zero for a steady oscillation.
    """
    quarters = since + (t[-1] - since) * np.array([0.5, 0.75, 1.0])
    third, last = (y[(t >= a) & (t <= b)] for a, b in itertools.pairwise(quarters))
    return not (len(third) and len(last) and abs(last.mean() - third.mean()) <= tolerance / 8.0)


def overshoot(trace: Trace) -> float | None:
    r"""Overshoot of x of W of the task's frame beyond its final mean, relative to its whole change [1]; None if x has
    not settled.

    .. math:: \max(0, \max_k \sigma (x_k - x_\infty)) / |x_\infty - x_0|, \qquad \sigma = \mathrm{sgn}(x_\infty - x_0)
    """
    x, settled = _origin(trace)[:, 0], position_settling_time(trace)
    if settled is None or settled > trace.t[-1] - FINAL_WINDOW_S:
        return None
    change = _final_mean(trace, x) - x[0]
    beyond = float((np.sign(change) * (x - x[0])).max() / abs(change)) - 1.0 if change else 0.0
    return max(0.0, beyond)


def impact_impulse(trace: Trace) -> float | None:
    """Impulse of the first touch, from first contact to the first loss of contact [N s]; None without contact.

    The integral includes every step, up to the row after the end of the touch.
    """
    begun = np.flatnonzero(trace.impulse > 0.0)
    if not len(begun):
        return None
    low = trace.band("push")[0][begun[0] :].copy()
    low[0] = trace.push[begun[0]]  # its band begins before the touch
    free = np.flatnonzero(low == 0.0)
    return float(trace.impulse[begun[0] + free[0]] if len(free) else trace.impulse[-1])


def astray(trace: Trace) -> float | None:
    """Largest distance from the reference over the last 0.5 s of a completed run [m], if it is beyond the vehicle's
    own reach and the vehicle still moves relative to the reference; otherwise None.

    The distance along the normals of the walls that the vehicle touches in this time does not count, because a target
    behind a wall is out of reach. The result is None where a normal is not known (:func:`_touched_normals`).
    """
    if len(trace) == 0 or trace.status is not Status.completed:
        return None
    late = trace.t >= trace.t[-1] - FINAL_WINDOW_S
    error = _origin(trace)[late] - trace.p_d[late]
    if trace.final_high[-1] > 0.0:
        normals = _touched_normals(trace, late)
        if normals is None:
            return None
        _, sizes, axes = np.linalg.svd(normals, full_matrices=False)
        axes = axes[sizes > SAME_NORMAL * sizes.max(initial=0.0)]
        error = error - error @ axes.T @ axes
    distance = float(np.linalg.norm(error, axis=1).max())
    moving = np.abs(trace.nu_e[late]).max() > AT_REST
    return distance if moving and distance > trace.header.geometry.reach else None


def _touched_normals(trace: Trace, rows: np.ndarray) -> np.ndarray | None:
    """Normals (n, 3) in W of the walls that the vehicle touches in some rows, or of all walls if no row has a contact.

    A plane that does not turn has one normal. Of other walls the normal is the direction of the contact's mean force;
    None if they have friction, which is in this force, or if no row has a contact.
    """
    header = trace.header
    probe = Probe.of(header.scenario.task.frame, header.mjcf)
    contacts = contacts_of(header.scenario, probe, header.mjcf.vehicle)
    total, forces = trace.f_contact_W[rows], np.zeros((rows.sum(), len(contacts.pairs), 3))
    if contacts.springs:
        forces[:, int(contacts.paper) :] = trace.f_contacts_W[rows]
    if contacts.paper:
        forces[:, 0] = total - forces.sum(axis=1)
    sizes = np.linalg.norm(forces, axis=2).max(axis=0)
    touched = sizes > ROUNDING * sizes.max(initial=0.0)
    if not touched.any():
        touched[:] = True
    forces = forces.mean(axis=0)
    found = []
    for pair, force in itertools.compress(zip(contacts.pairs, forces, strict=True), touched):
        if pair.wall.shape == "plane" and not pair.wall.turning:
            found.append(-pair.wall.R_WS[:, 0])
        elif force.any() and not pair.wall.friction:
            found.append(force / np.linalg.norm(force))
        else:
            return None
    return np.array(found).reshape(-1, 3)


def steady_force_error(trace: Trace) -> float | None:
    """:func:`rest_force` minus :func:`uvms_mj.control.design.demanded_force` [N]; None if the force has not settled,
    nothing is demanded, or numbers changed in the run."""
    final = None if trace.changed else rest_force(trace)
    error = math.nan if final is None else final - demanded_force(trace.scenario)
    return None if math.isnan(error) else error


def control_effort(trace: Trace, start: float = 0.0, end: float = np.inf) -> np.ndarray:
    r"""Integral (6,) of tau_i^2 over every step [N^2 s, N^2 m^2 s]."""
    return gain(trace, "effort", start, end)[0]


def total_variation(trace: Trace, start: float = 0.0, end: float = np.inf) -> np.ndarray:
    r"""Sum (6,) of |tau_k - tau_(k-1)| over every step."""
    return gain(trace, "tau_variation", start, end)[0]


def chattering(trace: Trace, start: float = 0.0, end: float = np.inf) -> np.ndarray:
    r"""Chattering index (6,): variation of tau per second that cancels within T [N/s, N m/s].

    .. math:: \frac{1}{t_b - t_a} \left( \sum_k |\tau_k - \tau_{k-1}| - \sum_j |\tau(t_j + T) - \tau(t_j)| \right),
              \qquad T = \max(10 \text{ ms}, 10 \, T_c)

    with the first sum over every step, the second over intervals of length T, and T_c the control period. The index of
    a smooth input is small, because it reverses only a few times. The index of an input that alternates at every
    control instant is its total variation per second. The result is nan if the part of the run is shorter than T.
    """
    rows = grid(trace, start, end, max(FAST_S, FAST_PERIODS * trace.scenario.control_period))
    if len(rows) < 2:
        return np.full(6, np.nan)
    variation = trace.tau_variation[rows[-1]] - trace.tau_variation[rows[0]]
    slow = np.abs(np.diff(trace.tau[rows], axis=0)).sum(axis=0)
    return np.maximum(0.0, variation - slow) / (trace.t[rows[-1]] - trace.t[rows[0]])


def mean_change(trace: Trace, start: float = 0.0, end: float = np.inf) -> np.ndarray:
    r"""Mean change (6,) of tau from one control instant to the next, over every step.

    .. math:: \frac{T_c}{t_b - t_a} \sum_k |\tau_k - \tau_{k-1}|
    """
    variation, duration = gain(trace, "tau_variation", start, end)
    return variation * trace.scenario.control_period / max(duration, 1e-300)


def largest_change(trace: Trace, end: float = np.inf) -> np.ndarray:
    """Largest change (6,) of tau from one control instant to the next until ``end``, over every step."""
    return trace.tau_step_max[window(trace, 0.0, end)[1]]


def reversals(trace: Trace, threshold: float, start: float = 0.0, end: float = np.inf) -> np.ndarray:
    """Number (6,) of reversals of tau [1].

    A reversal is a pair of successive changes in opposite directions, each larger than ``threshold`` from one control
    instant to the next. The count uses rows, so the log should contain every step.
    """
    first, last = window(trace, start, end)
    steps = np.rint(trace.t[first : last + 1] / trace.scenario.simulation.timestep)
    period_steps = round(trace.scenario.control_period / trace.scenario.simulation.timestep)
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
    inside, duration = gain(trace, "boundary_layer_time", start, end)
    return inside / max(duration, 1e-300)


def magnitude(trace: Trace, name: str) -> np.ndarray:
    """Largest |value| (n, ...) of each component of a signal since the row before, at every step."""
    return np.maximum(*(np.abs(edge) for edge in trace.band(name)))


def _origin(trace: Trace) -> np.ndarray:
    """(n, 3) position of the origin of the task's frame in W [m]."""
    return trace[trace.header.task_frame[0]]


def _final_mean(trace: Trace, y: np.ndarray) -> float:
    return float(y[trace.t >= trace.t[-1] - FINAL_WINDOW_S].mean())


def window(trace: Trace, start: float, end: float) -> tuple[int, int]:
    """First and last row of a part of a run."""
    first = int(np.searchsorted(trace.t, start - 1e-9))
    last = int(np.searchsorted(trace.t, end + 1e-9, side="right")) - 1
    first = min(first, len(trace) - 1)
    return first, max(first, last)


def gain(trace: Trace, name: str, start: float, end: float) -> tuple[np.ndarray, float]:
    """Increase of a running signal over a part of a run, and the duration of that part [s]."""
    first, last = window(trace, start, end)
    return trace[name][last] - trace[name][first], float(trace.t[last] - trace.t[first])


def grid(trace: Trace, start: float, end: float, apart: float) -> np.ndarray:
    """Indices of rows at intervals of ``apart`` [s]; of all rows if the log is slower than that."""
    first, last = window(trace, start, end)
    instants = np.arange(trace.t[first], trace.t[last] + 1e-9, apart)
    rows = np.searchsorted(trace.t, instants - 1e-9)
    return np.unique(np.minimum(rows, last))


def cumulative(t: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Running integral (n, m) of y (n, m) over t by the trapezoidal rule."""
    steps = 0.5 * np.diff(t)[:, None] * (y[1:] + y[:-1])
    return np.concatenate([np.zeros((1, y.shape[1])), np.cumsum(steps, axis=0)])


def off_target(trace: Trace) -> dict[str, float]:
    """Errors of the joints that are off the target of a servo at the end, by joint [rad or m, of the velocity interface
    per second]. Empty without a servo, or if a log lacks the file of its motion."""
    errors = np.zeros(0)
    with contextlib.suppress(ValueError):  # the file can't be read, or does not fit the vehicle
        setup = set_up(trace.scenario, trace.header.mjcf)
        targets = setup.interface.target_at(setup, float(trace.t[-1]))
        if targets is not None:
            errors = trace[setup.interface.tracked_signal][-1] - targets
    return {link.joint: float(e) for link, e in zip(trace.header.geometry.links, errors, strict=False) if abs(e) > OFF}


def at_stops(trace: Trace) -> dict[str, float]:
    """Positions of the joints that are at a stop at the end, by joint [rad or m]."""
    found = {}
    for link, q in zip(trace.header.geometry.links, trace.q[-1].tolist(), strict=True):
        low, high = link.range or (-np.inf, np.inf)
        if not low + AT_STOP < q < high - AT_STOP:
            found[link.joint] = q
    return found
