r"""Metrics of the hold, the last :data:`HOLD_S` of a run, in which the vehicle shall press with the demanded push.

The demanded push is the length of the force in F_d of eq. (7), which may follow a schedule. Without a schedule it is
the ``push`` of a reference that has one, ``along_wall`` or ``along_surface``. The deviation of a row is the largest one
at any step since the row before, from the push's least and greatest value:

.. math:: P(t) = |F_{d,1:3}(t)|, \qquad e_k = \max(|F_k^{low} - P(t_k)|, |F_k^{high} - P(t_k)|)

A law that alternates faster than rows can't hide in it. All functions return None if the run has no hold: if it ended
early, is shorter, or no push is demanded.
"""

import itertools

import numpy as np

from ..physics.frames import rotation_matrix
from ..records.header import Status
from ..records.trace import Trace
from .metrics import settling_time

HOLD_S = 5.0
"""Length of the hold [s]."""
SETTLED_WITHIN = 0.2
"""Deviation over the demanded push up to which the push counts as settled [1]."""


def demanded(trace: Trace) -> np.ndarray:
    """(n, 3) demanded force of the wall on the vehicle, in the frame of the task [N]."""
    if "F_d" in trace.arrays:
        return trace["F_d"][:, :3]
    own = trace.scenario.reference.force_at_rest()
    return np.tile(np.array(trace.scenario.impedance.F_d if own is None else own)[:3], (len(trace), 1))


def deviations(trace: Trace) -> np.ndarray:
    """(n,) largest deviation of the push from the demanded one since the row before, at every step [N]."""
    low, high = trace.band("push")
    push = np.linalg.norm(demanded(trace), axis=1)
    return np.maximum(np.abs(low - push), np.abs(high - push))


def held(trace: Trace) -> slice | None:
    """The rows of the hold."""
    if trace.status is not Status.completed or trace.duration_s < HOLD_S:
        return None
    rows = slice(int(np.searchsorted(trace.t, trace.t[-1] - HOLD_S + 1e-9)), len(trace))
    return rows if demanded(trace)[rows].any(axis=1).all() else None


def bias(trace: Trace) -> float | None:
    r"""Mean push minus mean demanded push [N], from the impulse, hence of every step.

    .. math:: \bar F - \bar P, \qquad \bar F = \frac{1}{T} \int_{t_e - T}^{t_e} F \, dt
    """
    rows = held(trace)
    if rows is None:
        return None
    begin = max(0, rows.start - 1)
    mean = (trace.impulse[-1] - trace.impulse[begin]) / (trace.t[-1] - trace.t[begin])
    return float(mean - np.linalg.norm(demanded(trace)[rows], axis=1).mean())


def error(trace: Trace) -> float | None:
    r"""Root mean square of the deviations [N]: :math:`\sqrt{\frac1n \sum_k e_k^2}`."""
    rows = held(trace)
    return None if rows is None else float(np.sqrt(np.mean(deviations(trace)[rows] ** 2)))


def worst(trace: Trace) -> float | None:
    r"""Largest deviation at any step [N]: :math:`\max_k e_k`."""
    rows = held(trace)
    return None if rows is None else float(deviations(trace)[rows].max())


def lost(trace: Trace) -> float | None:
    """Time of the rows since whose row before the push was zero at a step [s]: an upper bound of the time without
    contact."""
    rows = held(trace)
    if rows is None:
        return None
    apart = trace.header.row_steps * trace.scenario.simulation.timestep
    return float(f"{(trace.band('push')[0][rows] <= 0.0).sum() * apart:.12g}")


def contacts(trace: Trace) -> int | None:
    """Least number of contacts that press, of all rows [1]."""
    rows = held(trace)
    if rows is None:
        return None
    if "f_contacts_W" in trace.arrays:
        return int(trace["f_contacts_W"][rows].any(axis=2).sum(axis=1).min())
    return int((trace.push[rows] > 0.0).min())


def path_error(trace: Trace) -> float | None:
    r"""Largest distance of the frame of the task from its reference across the demanded force, of all rows [m].

    .. math:: \max_k |(I - n n^\top)(p - p_d)|, \qquad n = R F_d / |F_d|
    """
    rows = held(trace)
    if rows is None:
        return None
    place, attitude, _ = trace.header.task_frame
    away = trace[place][rows] - trace.p_d[rows]
    turned = np.ascontiguousarray(rotation_matrix(trace[attitude][rows]))
    force = np.einsum("kij,kj->ki", turned, demanded(trace)[rows])
    n = force / np.linalg.norm(force, axis=1)[:, None]
    return float(np.linalg.norm(away - n * (n * away).sum(axis=1)[:, None], axis=1).max())


def turn_error(trace: Trace) -> float | None:
    r"""Largest angle between the attitude of the frame of the task and the desired one, of all rows [deg].

    .. math:: \max_k 2 \arccos |q^\top q_d|
    """
    rows = held(trace)
    if rows is None:
        return None
    cosines = np.abs((trace[trace.header.task_frame[1]][rows] * trace.quat_d[rows]).sum(axis=1))
    return float(np.degrees(2.0 * np.arccos(np.clip(cosines, 0.0, 1.0)).max()))


def settling(trace: Trace) -> float | None:
    r"""Time from the first touch from which the push stays within a fifth of the demanded one until the end, at every
    step [s]; None if it does not, or without a touch. It needs the whole run.

    .. math:: \min \{ t_k : e_j \le 0.2 P(t_j) \; \forall j \ge k \} - t_{touch}
    """
    if held(trace) is None or trace.touches[-1] == 0:
        return None
    push = np.linalg.norm(demanded(trace), axis=1)
    since = settling_time(trace.t, np.maximum(0.0, deviations(trace) - SETTLED_WITHIN * push), 0.0, 0.0)
    return None if since is None else max(0.0, since - float(trace.first_contact[-1]))


def course(trace: Trace, parts: int) -> dict[str, np.ndarray]:
    """Mean, least and greatest push (parts,) in equal parts of the run's duration, at every step [N]; nan after the end
    of a run that ended early. They need the whole run."""
    edges = np.linspace(0.0, trace.scenario.simulation.duration, parts + 1)
    at = np.minimum(np.searchsorted(trace.t, edges - 1e-9), len(trace) - 1)
    found = {name: np.full(parts, np.nan) for name in ("mean", "least", "greatest")}
    low, high = trace.band("push")
    for i, (a, b) in enumerate(itertools.pairwise(at)):
        if b > a and trace.t[b] >= edges[i + 1] - 1e-6 * edges[-1]:
            found["mean"][i] = (trace.impulse[b] - trace.impulse[a]) / (trace.t[b] - trace.t[a])
            found["least"][i], found["greatest"][i] = low[a + 1 : b + 1].min(), high[a + 1 : b + 1].max()
    return found
