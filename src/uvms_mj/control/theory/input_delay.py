r"""A sliding mode law whose command acts late: a computation delay, a held thrust or the thrusters' lag.

The force and the velocity of one instant agree with each other, and so a late command does not make the contact force
older in s. It limits the law's own loop, which has to keep s small. With :math:`a = k_1 \phi_1/S` and
:math:`b = k_2 \phi_2/S` for an amplitude S of s, and :math:`\tau/M = g (-w - (A + a) s + z) + k_c x / M` acting a time
:math:`\delta` later, the vibration along the wall's normal is

.. math::

    \dot v = \tau(t - \delta)/M - k_c x / M, \quad \dot s = A s + \dot v + w, \quad \dot z = -b s, \quad
    w = k x + d v,

where k and d are those of the desired impedance with the contact's spring. The delay is a Pade approximation of fourth
order. Super-twisting is infinitely steep at s = 0: there always is a vibration, and it grows to the amplitude at which
this system is stable.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from .sampled import Vibration

_AMPLITUDES = np.geomspace(1e-8, 2e-2, 80)
"""Amplitudes of s [m/s]. The largest is that of an impact at a few decimetres per second."""
_ORDER = 4


def _pade() -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """The state-space model A (n, n), B (n,), C (n,), D of exp(-p), in controllable canonical form."""
    n = _ORDER
    p = [math.comb(n, k) * math.factorial(2 * n - k) for k in range(n + 1)]
    below = np.array(p[::-1]) / p[n]
    above = np.array([(-1) ** k * p[k] for k in range(n, -1, -1)]) / p[n]
    A = np.diag(np.ones(n - 1), -1)
    A[0] = -below[1:]
    return A, np.eye(n)[0], above[1:] - above[0] * below[1:], float(above[0])


_DELAY = _pade()
Slopes = Callable[[float], tuple[float, float]]


def vibration(found: Vibration, slopes: tuple[float, float]) -> tuple[float, float]:
    """Growth rate [1/s] of the fastest vibration under the late command, and its force per s [N s/m].

    Args:
        found: the vibration of the sampled law against the wall.
        slopes: a and b [1/s, 1/s^2].
    """
    setup, (a, b) = found.setup, slopes
    design, k_c, normal = setup.design, found.contact.stiffness, found.contact.normal
    M = design.along_normal(design.M, normal)
    g = design.along_normal(design.M_hat, normal) / M
    A = float(normal[:3] ** 2 @ np.array(setup.task.A[:3]))
    late, n = found.chain.command_latency, _ORDER
    P, Q, R, direct = _DELAY
    w = np.array([found.stiffness + found.compliant * k_c, found.damping, 0.0, 0.0])
    tau = g * (np.array([0.0, 0.0, -(A + a), 1.0]) - w) + np.array([k_c / M, 0.0, 0.0, 0.0])
    system = np.zeros((4 + n, 4 + n))
    system[0, 1] = 1.0
    system[1] = np.concatenate([direct * tau - np.array([k_c / M, 0.0, 0.0, 0.0]), R])
    system[2] = system[1]
    system[2, :4] += w + np.array([0.0, 0.0, A, 0.0])
    system[3, 2] = -b
    system[4:, :4], system[4:, 4:] = np.outer(Q, tau) / late, P / late
    values, vectors = np.linalg.eig(system)
    fastest = int(values.real.argmax())
    return float(values[fastest].real), float(k_c * abs(vectors[0, fastest] / vectors[2, fastest]))


def swing(found: Vibration, slopes: Slopes) -> tuple[float, bool]:
    """Peak-to-peak force [N] of the vibration at which the law ends, and whether a hard impact leads to one that grows
    on. ``slopes`` gives a and b for an amplitude of s. Without a late command, or against no wall, both are nothing."""
    if found.chain.late == 0.0 or found.compliant <= 0.0:
        return 0.0, False
    rates = np.array([vibration(found, slopes(S)) for S in _AMPLITUDES])
    ends = np.flatnonzero((rates[:-1, 0] > 0.0) & (rates[1:, 0] <= 0.0))
    if not len(ends):
        return (math.inf, True) if rates[-1, 0] > 0.0 else (0.0, False)
    i = ends[0]
    (above, force), (below, _) = rates[i : i + 2].tolist()
    S = _AMPLITUDES[i] * (_AMPLITUDES[i + 1] / _AMPLITUDES[i]) ** (above / (above - below))
    return float(2.0 * S * force), bool(rates[-1, 0] > 0.0)


def input_delay_notes(found: Vibration, label: str, slopes: Slopes) -> Sequence[str]:
    """Warnings if the law vibrates against the wall because its command acts late."""
    force, grows = swing(found, slopes)
    late = f"its command acts {1e3 * found.chain.command_latency:.3g} ms late ({found.chain.command_parts()})"
    if not math.isfinite(force):
        return [f"{label} oscillates against the wall without end: {late}; it takes less of that, or smaller gains"]
    if grows:
        return [f"{label} may oscillate against the wall after a hard impact: {late}"]
    what = f"vibrates against the wall by about {force:.2g} N, or until it leaves it"
    return [f"{label} {what}: {late}"] if force > _SEEN else []


_SEEN = 0.01
"""Least peak-to-peak force of a vibration that is worth a warning [N]."""
