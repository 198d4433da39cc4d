r"""Vectors that vary with time: each is the sum of a mean, sines, a table and a Gauss-Markov process, with its rate.

A Gauss-Markov process is Gaussian and stationary, with the standard deviation :math:`\sigma` and the autocorrelation
:math:`\sigma^2 e^{-|\tau|/T}` (Gelb, "Applied Optimal Estimation", 1974, sec. 3.8). On a grid of the spacing
:math:`\Delta`, at least T/64, its exact discretisation is

.. math::

    x_{k+1} = \varphi x_k + \sqrt{1 - \varphi^2}\, n_k, \quad \varphi = e^{-\Delta/T}, \quad n_k \sim N(0, 1).

Between these nodes it is Catmull and Rom's cubic: a process with this autocorrelation has no derivative, and the cubic
has a continuous one. At the nodes the variance is exact. In the middle between two it is least, lower by
:math:`0.23 (1 - \varphi)`: by 0.36 % for T/64. The rate of change has the standard deviation of
:func:`rate_deviation` there, and half of it at the nodes; it grows as the spacing falls.

The nodes are drawn in blocks of 2048. The recursion of a block starts one block earlier, from a normal number of its
own. By then :math:`e^{-32}` or less is left of the start, so that neighbouring blocks agree to 1e-14. A block
depends on the key and its number alone: the process has no end, needs a fixed memory, and may be evaluated at times in
any order.
"""

import math

import numpy as np

from .kernels import kernel
from .random import standard_normal

NODES = 2048
"""Nodes of a block."""
ROWS = NODES + 3
"""Nodes in memory: the block, the node before it and the two after it."""
FINEST = 64.0
"""Largest number of nodes in a correlation time."""


def rate_deviation(deviation: np.ndarray, correlation_time: float, spacing: float) -> np.ndarray:
    """Standard deviation (n,) of the rate of change of a Gauss-Markov process in the middle between two nodes, where it
    is largest; ``deviation`` (n,) is of its values. The rate there is (10 d_2 - d_1 - d_3)/8 of the steps d from node
    to node, over their spacing."""
    phi = math.exp(-spacing / correlation_time)
    neighbours, second = -((1.0 - phi) ** 2), -phi * (1.0 - phi) ** 2  # covariance of steps one and two apart
    variance = (102.0 * 2.0 * (1.0 - phi) - 40.0 * neighbours + 2.0 * second) / 64.0
    return deviation * (math.sqrt(variance) / spacing)


def varying(n: int, *more: tuple[str, str]) -> np.dtype:
    """Record of a vector of n components that varies with time, with more fields. ``table`` and ``nodes`` are places in
    the numbers of the record that it is a part of."""
    return np.dtype(
        [
            ("mean", "f8", (n,)),
            ("amplitude", "f8", (n,)),  # of amplitude sin(2 pi frequency t + phase)
            ("frequency", "f8", (n,)),  # [Hz]
            ("phase", "f8", (n,)),  # [rad]
            ("rows", "i8"),  # of the table
            ("table", "i8"),  # rows of [t, x_1 .. x_n]
            ("deviation", "f8", (n,)),  # of the Gauss-Markov process
            ("noisy", "i8"),  # whether one of them is not zero
            ("spacing", "f8"),  # of its nodes [s]
            ("kept", "f8"),  # phi
            ("kick", "f8"),  # (1 - phi^2)^(1/2)
            ("key", "i8"),  # of its random numbers
            ("block", "i8"),  # number of the block in memory, or -1
            ("nodes", "i8"),  # ROWS rows of n numbers of unit variance
            *more,
        ],
        align=True,
    )


@kernel
def add_sines(series, t, value):
    """Set value (n,) to the mean, and add the sines at time t [s]."""
    value[:] = series.mean
    for i in range(value.shape[0]):
        if series.amplitude[i] != 0.0:
            value[i] += series.amplitude[i] * np.sin(2.0 * np.pi * series.frequency[i] * t + series.phase[i])


@kernel
def sine_rates(series, t, rate):
    """Set rate (n,) to the time derivative of the sines."""
    rate[:] = 0.0
    for i in range(rate.shape[0]):
        if series.amplitude[i] != 0.0:
            omega = 2.0 * np.pi * series.frequency[i]
            rate[i] = omega * series.amplitude[i] * math.cos(omega * t + series.phase[i])


@kernel
def read(numbers, place, out):
    """Set out (n,) to the numbers from a place on."""
    for i in range(len(out)):
        out[i] = numbers[place + i]


@kernel
def add_interpolated(numbers, first, rows, x, value, rate):
    """Add the linear interpolation of a table at x to value (n,), and its derivative to rate (n,).

    The table is in ``numbers`` from the place ``first`` on: ``rows`` rows [x, y_1 .. y_n] with increasing x. Before the
    first row and after the last one the value is theirs.
    """
    width = value.shape[0] + 1
    low, high = 0, rows - 1
    if x >= numbers[first + high * width]:
        low = high
    for _ in range(63):
        if high - low <= 1:
            break
        middle = (low + high) // 2
        if numbers[first + middle * width] <= x:
            low = middle
        else:
            high = middle
    inside = high > low and x >= numbers[first]
    here, there = first + low * width, first + high * width
    y_0 = np.zeros_like(value)
    read(numbers, here + 1, y_0)
    value += y_0
    if inside:
        y_1, x_0, x_1 = np.zeros_like(value), numbers[here], numbers[there]
        read(numbers, there + 1, y_1)
        slope = (y_1 - y_0) / (x_1 - x_0)
        value += slope * (x - x_0)
        rate += slope


@kernel
def add_gauss_markov(series, numbers, t, value, rate):
    """Add the Gauss-Markov process at time t [s] to value (n,), and its derivative to rate (n,). ``numbers`` has the
    nodes of the block in memory, which is drawn here if it is another one."""
    n = value.shape[0]
    x = max(t, 0.0) / series.spacing
    k = int(x)
    if k // NODES != series.block:
        series.block = k // NODES
        draw_block(series, numbers, n)
    f, at, node = x - k, series.nodes + k % NODES * n, np.zeros(4)
    for i in range(n):
        for j in range(4):
            node[j] = numbers[at + j * n + i]
        before, here, there, after = node
        b = 0.5 * (there - before)  # here + b f + c f^2 + d f^3
        c = before - 2.5 * here + 2.0 * there - 0.5 * after
        d = 0.5 * (after - before) + 1.5 * (here - there)
        value[i] += series.deviation[i] * (here + f * (b + f * (c + f * d)))
        rate[i] += series.deviation[i] * (b + f * (2.0 * c + f * 3.0 * d)) / series.spacing


@kernel
def draw_block(series, numbers, n):
    """Draw the nodes of the block of the number ``series.block``: n independent processes of unit variance."""
    first = NODES * series.block
    for i in range(n):
        if series.deviation[i] != 0.0:
            x = standard_normal(series.key, first, i)  # NODES before the node before the block
            for j in range(1, NODES + ROWS):
                x = series.kept * x + series.kick * standard_normal(series.key, first + j, i)
                if j >= NODES:
                    numbers[series.nodes + (j - NODES) * n + i] = x


@kernel
def add_table_and_noise(series, numbers, t, value, rate):
    """Add the table and the Gauss-Markov process of a record of :func:`varying` to value (n,) and rate (n,)."""
    if series.rows > 0:
        add_interpolated(numbers, series.table, series.rows, t, value, rate)
    if series.noisy != 0:
        add_gauss_markov(series, numbers, t, value, rate)
