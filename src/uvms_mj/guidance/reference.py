r"""Reference model: position steps smoothed by a third-order filter, at a constant attitude.

Each step of height Delta at time t_i passes through (omega_n / (p + omega_n))^3 (paper sec. 5). Its step response has
the closed form

.. math::

    g(x) = 1 - e^{-x}(1 + x + x^2/2), \quad x = \omega_n (t - t_i),

so the reference has no state and no discretisation error.
"""

import math

from ..physics.kernels import kernel

_SETTLED = 60.0  # for larger x, 1 - g(x) is below the rounding error of 1


@kernel
def filtered_steps(t, start, times, positions, bandwidth, p_d, p_d_dot, p_d_ddot):
    """Set p_d, p_d_dot, p_d_ddot (3,) [m, m/s, m/s^2, W] at time t [s].

    Args:
        t: time [s].
        start: (3,) position before the first step [m].
        times: (n,) increasing times of the steps [s].
        positions: (n, 3) positions after the steps [m].
        bandwidth: omega_n [rad/s].
        p_d, p_d_dot, p_d_ddot: (3,) outputs.
    """
    for i in range(3):
        p_d[i] = start[i]
        p_d_dot[i] = 0.0
        p_d_ddot[i] = 0.0
    for n in range(times.shape[0]):
        x = bandwidth * (t - times[n])
        if x <= 0.0:
            break
        g, g_dot, g_ddot = 1.0, 0.0, 0.0
        if x < _SETTLED:
            decay = math.exp(-x)
            g = 1.0 - decay * (1.0 + x + 0.5 * x * x)
            g_dot = bandwidth * decay * 0.5 * x * x
            g_ddot = bandwidth * bandwidth * decay * (x - 0.5 * x * x)
        for i in range(3):
            height = positions[n, i] - (start[i] if n == 0 else positions[n - 1, i])
            p_d[i] += height * g
            p_d_dot[i] += height * g_dot
            p_d_ddot[i] += height * g_ddot
