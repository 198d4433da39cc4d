"""The ocean current: a vector that varies with time, and its shear with depth.

With the factor f(depth) and the velocity (u, w) at f = 1, u horizontal, the current is (f u, w).
"""

import numpy as np

from .kernels import kernel
from .varying import add_interpolated, add_sines, add_table_and_noise, sine_rates, varying

CURRENT = varying(
    3,  # velocity at the factor 1 in W [m/s]
    ("shear_rows", "i8"),
    ("shear", "i8"),  # place of the rows of [depth, factor]
    ("constant", "i8"),  # whether it is the mean at all times and places
)
"""The current."""


@kernel
def add_current(current, numbers, t, p_W, v, v_dot, gradient):
    """Add the current at the place p_W (3,) [m, W] and the time t [s]: its velocity to v (3,) [m/s, W], the time
    derivative there to v_dot (3,), and dv_i/dx_j to gradient (3, 3) [1/s]. ``numbers`` has the tables."""
    u, u_dot = np.zeros(3), np.zeros(3)
    add_sines(current, t, u)
    sine_rates(current, t, u_dot)
    add_table_and_noise(current, numbers, t, u, u_dot)
    if current.shear_rows > 0:
        factor, slope = np.zeros(1), np.zeros(1)
        add_interpolated(numbers, current.shear, current.shear_rows, -p_W[2], factor, slope)
        for i in range(2):
            gradient[i, 2] -= slope[0] * u[i]
            u[i] *= factor[0]
            u_dot[i] *= factor[0]
    v += u
    v_dot += u_dot
