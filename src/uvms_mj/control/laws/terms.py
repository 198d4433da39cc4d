r"""Terms that several laws have: the limit of an integral, and the integral of the desired impedance's residual.

This integral is the sliding variable of two laws,

.. math::

    \sigma = \nu - \hat\nu, \qquad \dot{\hat\nu} = \dot\nu_d - w, \qquad \hat\nu(0) = \nu(0),

with w of :mod:`uvms_mj.control.task`. hat nu is the velocity that the vehicle would have if it had the desired
impedance, eq. (7).
:math:`M_d \sigma` is the integral of eq. (6), which starts at zero: there is no reaching phase (Utkin and Shi 1996,
Integral sliding mode in systems operating under uncertainty conditions). Under tau = tau_nom + M_hat a it obeys

.. math:: \dot\sigma = a + \varphi, \qquad \varphi = \hat M^{-1} \bar\tau_{dist} \text{ of eq. (11)}.

A constant sigma means that eq. (7) holds, whatever its value is: the acceleration that the
balance demands is zero at rest.
"""

import numpy as np

from ...physics.kernels import kernel


@kernel
def integral_residual(signals, nu_hat, nu_hat_dot, sigma):
    """Set sigma (6,) and nu_hat_dot (6,), and nu_hat (6,) at the first instant [m/s, rad/s]."""
    if signals.instant == 0:
        nu_hat[:] = signals.nu
    nu_hat_dot[:] = signals.nu_d_dot - signals.w
    sigma[:] = signals.nu - nu_hat


@kernel
def within(x, limit):
    """x (n,), or the nearest numbers from -limit to limit."""
    return np.minimum(limit, np.maximum(-limit, x))


@kernel
def add_product(A, x, y):
    """Add A x to y (6,), for A (6, 6) and x (6,), column by column."""
    for j in range(6):
        y += A[:, j] * x[j]
