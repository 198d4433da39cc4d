r"""Certified bound on the rate of change of the disturbances that GSTA rejects in finite time.

The error system of each axis (paper, eqs. (28)-(30)), with w = z + varphi and
:math:`\varphi = \hat M^{-1} \bar\tau_{dist}` of eq. (11):

.. math::

    \dot s = -k_1 \phi_1(s) + w + G_1(t) \phi_1(s), \qquad \dot w = -k_2 \phi_2(s) + \dot\varphi, \qquad
    |\dot\varphi| \le \delta_2 |\phi_2(s)|

Since :math:`|\phi_2| = 1/2 + \tfrac32 \beta |s|^{1/2} + \beta^2 |s|`, the last condition is met for every s by

.. math::

    |\dot\varphi| \le L + L_s |s| \iff L \le \delta_2 / 2 \text{ and } L_s \le \beta^2 \delta_2:

the two parts are independent, and a rate that depends only on time needs :math:`L \le \delta_2 / 2`.

**Reduction** (Moreno 2009; Moreno and Osorio 2012). With :math:`\xi = (\phi_1(s), w)`, :math:`\phi_2 = \phi_1' \phi_1`
and :math:`\dot\varphi = G_2(t) \phi_2`, :math:`|G_2| \le \delta_2`,

.. math::

    \dot\xi = \phi_1'(s) \begin{bmatrix} -a & 1 \\ -b & 0 \end{bmatrix} \xi, \qquad a = k_1 - G_1(t),\ b = k_2 - G_2(t).

Let :math:`V = \xi^\top P \xi` with :math:`P = \begin{bmatrix} D + p^2 & -p \\ -p & 1 \end{bmatrix}`, D > 0. Up to a
factor, every positive definite P has this form. Then

.. math::

    \dot V / \phi_1' = -2 (a (D + p^2) - p b) \xi_1^2 + 2 (D + p^2 + p a - b) \xi_1 \xi_2 - 2 p \xi_2^2

is negative definite iff p > 0 and :math:`4 b D > (p a - p^2 - b - D)^2`, that is, iff

.. math::

    |\sqrt b - \sqrt D| < \sqrt{p (a - p)} < \sqrt b + \sqrt D: \quad
    \text{the three roots form a triangle.}

**Theorem.** Let a range over [a_min, a_max] and b over :math:`[k_2 - \delta_2, k_2 + \delta_2]`, both positive, and
:math:`\Delta = \sqrt{k_2 + \delta_2} - \sqrt{k_2 - \delta_2}`. A common P exists iff

.. math::

    \Delta < a_{min} \quad\text{and}\quad
    \tfrac12 (a_{max} - a_{min}) \left(a_{min} - \sqrt{a_{min}^2 - \Delta^2}\right)
    < 2 \left(k_2 - \delta_2 + \sqrt{k_2^2 - \delta_2^2}\right).

*Proof.* With m the middle root, sqrt(D) must be above :math:`\max(\sqrt{b_{max}} - m_{min}, m_{max} - \sqrt{b_{min}})`
and below :math:`\sqrt{b_{min}} + m_{min}`. Such a D exists iff :math:`\Delta < 2 m_{min}` and :math:`m_{max} - m_{min}
< 2 \sqrt{b_{min}}`. The first condition is weakest at p = a_min / 2, where m_min = a_min / 2. The left side of the
second grows with p, so that the second is weakest at the smallest p that the first allows, :math:`2 p = a_{min} -
\sqrt{a_{min}^2 - \Delta^2}`. There :math:`m_{min} = \Delta / 2` and :math:`m_{max}^2 = \Delta^2 / 4 + p (a_{max} -
a_{min})`. ∎

Without a vanishing part (G_1 = 0) the second condition always holds and the first becomes

.. math::

    L < \frac{\delta_2}{2} = \begin{cases} k_2 / 2 & k_1^2 \ge 2 k_2 \\
                                         \tfrac12 k_1 \sqrt{k_2 - k_1^2 / 4} & \text{otherwise,} \end{cases}

which is the circle criterion, :math:`\delta_2 |G(j\omega)| < 1` with :math:`G(p) = 1 / (p^2 + k_1 p + k_2)` (Khalil,
Nonlinear Systems, 3rd ed., Theorem 7.1). It does not depend on beta. With G_1 and G_2 within their bounds along a
solution, :math:`\dot V \le -\phi_1' \epsilon |\xi|^2` for some :math:`\epsilon > 0`. Since :math:`\phi_1' = \tfrac12
|s|^{-1/2} + \beta` and :math:`|s|^{1/2} \le |\xi|`,

.. math::

    \dot V \le -\frac{\epsilon}{2 \sqrt{\lambda_{max}(P)}} \sqrt V - \frac{\beta \epsilon}{\lambda_{max}(P)} V:

so that (s, w) reaches zero in finite time. (The argument only requires that V is absolutely continuous along solutions:
Moreno and Osorio 2012. Theorem 1 of López-Caamal and Moreno 2019, which the paper cites, also has diagonal G_i.)

**Sharpness.** No gains reject L > k_2 / 2: z_dot can't follow a constant rate at s = 0, and s stays where
:math:`k_2 |\phi_2(s)| = L`. For k_1^2 >= 2 k_2 the certificate reaches this limit. For smaller k_1 a common quadratic V
is conservative: under the worst rate, L sgn(s_dot), the gains k_1 = 2, k_2 = 10 converge up to 1.46 times the bound.

**Sampling.** Sampled by explicit Euler with step h, s and w converge to a band. With beta = 0 the sampled system is the
same for every h in the coordinates s / h^2, w / h, and so is the set of admissible disturbances, whose increments are
at most L h. The band of s is therefore proportional to h^2 and the band of w to h (Levant 2005, Homogeneity approach to
high-order sliding mode design). With beta > 0, beta h takes the place of beta in these coordinates, so that the same
proportions hold in the limit of small h.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from ...errors import InputError

MARGIN = 0.25
"""Default relative margin of :func:`gains_for`."""
_MOST = 1e50


@dataclass(frozen=True)
class Certificate:
    """Bounds for finite-time convergence of GSTA: |varphi_dot| <= L + L_s |s| with any L < rate and L_s < state.

    Attributes:
        k_1, k_2, beta: the gains; beta in [(s/m)^(1/2)].
        nominal: whether the law contains the nominal control (23). If not, varphi contains the lack of it.
        rate: bound on L [m/s^3, rad/s^3].
        state: bound on L_s [1/s^2]; zero for beta = 0.
        limit: k_2/2, the upper limit of rate for any k_1 and beta [m/s^3, rad/s^3].
    """

    k_1: float
    k_2: float
    beta: float
    nominal: bool
    rate: float
    state: float
    limit: float

    @classmethod
    def of(cls, k_1: float, k_2: float, beta: float = 0.0, A: float | None = None) -> "Certificate":
        """The certificate of a law's gains k_1 [m^(1/2)/s^(3/2)], k_2 [m/s^3] and beta [(s/m)^(1/2)].

        For a law without nominal control, A is the pole of zeta of the worst axis [1/s]. Eq. (22) then does not cancel
        the term A s in s_dot, which is a vanishing part with G_1 in [A / beta, 0].

        Raises:
            InputError: a gain is too large or too small to compute with.
        """
        _in_range(k_1=k_1, k_2=k_2, beta=beta)
        least = 0.0
        if A is not None and A < 0.0:
            least = A / beta if beta > 0.0 else -math.inf
        rate = rate_bound(k_1, k_2, (least, 0.0))
        return cls(k_1, k_2, beta, A is None, rate, 2.0 * beta**2 * rate, k_2 / 2.0)

    def allowed(self, s: np.ndarray) -> np.ndarray:
        """Largest |varphi_dot| at s for which V decreases: delta_2 |phi_2(s)|."""
        size = np.abs(s)
        return 2.0 * self.rate * (0.5 + 1.5 * self.beta * np.sqrt(size) + self.beta**2 * size)


def rate_bound(k_1: float, k_2: float, G_1: tuple[float, float] = (0.0, 0.0)) -> float:
    """Least upper bound of the certified rates L: delta_2 / 2 of the theorem [m/s^3].

    Args:
        k_1: [m^(1/2)/s^(3/2)].
        k_2: [m/s^3].
        G_1: range of the vanishing part, rho_1 = G_1 phi_1(s), in the unit of k_1. A wide range reduces the bound.

    Raises:
        InputError: a gain is too large or too small to compute with.
    """
    _in_range(k_1=k_1, k_2=k_2)
    a_min, spread = k_1 - G_1[1], G_1[1] - G_1[0]
    if a_min <= 0.0 or k_2 <= 0.0 or not math.isfinite(spread):
        return 0.0
    delta = k_2 if a_min**2 >= 2.0 * k_2 else a_min * math.sqrt(k_2 - a_min**2 / 4.0)
    if spread > 0.0 and _second_condition(delta, a_min, spread, k_2) < 0.0:
        delta = brentq(_second_condition, 0.0, delta, (a_min, spread, k_2), xtol=1e-14 * k_2)
    return delta / 2.0


def _in_range(**values: float) -> None:
    """Raise InputError for negative and NaN values, and for values that overflow when squared or inverted."""
    for name, value in values.items():
        if not 0.0 <= value <= _MOST:
            raise InputError(f"{name} {value:g}: must be from 0 to {_MOST:g}")
        if name == "beta" and 0.0 < value < 1.0 / _MOST:
            raise InputError(f"beta {value:g}: must be 0, or at least {1.0 / _MOST:g}")


def _second_condition(delta: float, a_min: float, spread: float, k_2: float) -> float:
    """Right side minus left side of the theorem's second condition. It decreases with delta."""
    root = math.sqrt(k_2**2 - delta**2)
    two_p = a_min - math.sqrt(max(0.0, a_min**2 - 2.0 * (k_2 - root)))  # Delta^2 = 2 k_2 - 2 root
    return 2.0 * (k_2 - delta + root) - 0.5 * spread * two_p


def gains_for(rate: float, state: float = 0.0, beta: float = 0.0, margin: float = MARGIN) -> tuple[float, float]:
    """Gains (k_1, k_2) whose certified bound is |varphi_dot| <= (1 + margin) (rate + state |s|).

    k_2 is the smallest possible value, because z_dot can't follow a rate above k_2 / 2. It is also the size of the
    jumps of z_dot about s = 0. k_1 = (2 k_2)^(1/2) is the smallest value for which the certificate reaches k_2 / 2.

    Units: rate [m/s^3, rad/s^3], state [1/s^2], beta [(s/m)^(1/2)].

    Raises:
        InputError: a bound is negative, too large or too small to compute with, or no gains exist.
    """
    _in_range(rate=rate, state=state, beta=beta, margin=margin)
    if rate == 0.0 == state:
        raise InputError("rate 0: a constant disturbance sets no lower limit for the gains; give a positive rate")
    if state > 0.0 and beta == 0.0:
        raise InputError(f"state {state:g}: a rate that grows with s needs beta > 0")
    delta = 2.0 * rate if state == 0.0 else max(2.0 * rate, state / beta**2)
    k_2 = (1.0 + margin) * delta
    return math.sqrt(2.0 * k_2), k_2
