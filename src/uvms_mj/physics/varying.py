r"""Vectors that vary with time: a mean, sines, a table and a Gauss-Markov process, each with its rate of change.

A Gauss-Markov process is Gaussian and stationary, with the standard deviation :math:`\sigma` and the autocorrelation
:math:`\sigma^2 e^{-|\tau|/T}` (Gelb, "Applied Optimal Estimation", 1974, sec. 3.8). On a grid of the spacing
:math:`\Delta = T/64` its exact discretisation is

.. math::

    x_{k+1} = \varphi x_k + \sqrt{1 - \varphi^2}\, n_k, \quad \varphi = e^{-\Delta/T}, \quad n_k \sim N(0, 1),

and it is linear between the nodes, because a process with this autocorrelation has no derivative. The rate of change
therefore has the standard deviation :math:`\sigma \sqrt{2 (1 - \varphi)}/\Delta \approx 11.3\, \sigma/T`. At the nodes
the variance is exact; between them it is lower, on average by :math:`(1 - \varphi)/3`, which is 0.5 %.

The nodes are drawn in blocks of 2048. The recursion of a block starts one block earlier, from a normal number of its
own. What it has forgotten by then is :math:`e^{-32}`, so that neighbouring blocks agree to 1e-14. A block depends on
the key and its number alone: the process has no end, needs a fixed memory, and may be evaluated at times in any order.
"""

import math

import numpy as np

from .kernels import kernel
from .random import standard_normal

NODES = 2048
"""Nodes of a block. The block has one more, the first of the next block."""
NODES_PER_CORRELATION_TIME = 64.0


def rate_deviation(deviation: np.ndarray, correlation_time: float) -> np.ndarray:
    """Standard deviation (n,) of the rate of change of a Gauss-Markov process with that of its values (n,)."""
    kept = math.exp(-1.0 / NODES_PER_CORRELATION_TIME)
    return deviation * math.sqrt(2.0 * (1.0 - kept)) * NODES_PER_CORRELATION_TIME / correlation_time


def varying(n: int) -> np.dtype:
    """Record of a vector of n components that varies with time. A field that ends in ``_at`` is an address."""
    return np.dtype(
        [
            ("mean", "f8", (n,)),
            ("amplitude", "f8", (n,)),  # of amplitude sin(2 pi frequency t)
            ("frequency", "f8", (n,)),  # [Hz]
            ("rows", "i8"),  # of the table
            ("table_at", "i8"),  # rows of [t, x_1 .. x_n]
            ("deviation", "f8", (n,)),  # of the Gauss-Markov process
            ("noisy", "i8"),  # whether one of them is not zero
            ("spacing", "f8"),  # of its nodes [s]
            ("kept", "f8"),  # phi
            ("kick", "f8"),  # (1 - phi^2)^(1/2)
            ("key", "i8"),  # of its random numbers
            ("block", "i8"),  # number of the block in memory, or -1
            ("nodes_at", "i8"),  # (NODES + 1) rows of n numbers of unit variance
        ],
        align=True,
    )


@kernel
def add_sines(series, t, value):
    """Set value (n,) to the mean, and add the sines at time t [s]."""
    for i in range(value.shape[0]):
        value[i] = series.mean[i]
        if series.amplitude[i] != 0.0:
            value[i] += series.amplitude[i] * np.sin(2.0 * np.pi * series.frequency[i] * t)


@kernel
def sine_rates(series, t, rate):
    """Set rate (n,) to the time derivative of the sines."""
    for i in range(rate.shape[0]):
        rate[i] = 0.0
        if series.amplitude[i] != 0.0:
            omega = 2.0 * np.pi * series.frequency[i]
            rate[i] = omega * series.amplitude[i] * math.cos(omega * t)


@kernel
def add_interpolated(table, x, value, rate):
    """Add the linear interpolation of a table at x to value (n,), and its derivative to rate (n,).

    ``table`` has the numbers of rows [x, y_1 .. y_n] with increasing x. Before the first row and after the last one the
    value is theirs.
    """
    width = value.shape[0] + 1
    low, high = 0, table.shape[0] // width - 1
    if x >= table[high * width]:
        low = high
    for _ in range(63):
        if high - low <= 1:
            break
        middle = (low + high) // 2
        if table[middle * width] <= x:
            low = middle
        else:
            high = middle
    inside = high > low and x >= table[0]
    here, there = low * width, high * width
    for i in range(value.shape[0]):
        value[i] += table[here + 1 + i]
        if inside:
            slope = (table[there + 1 + i] - table[here + 1 + i]) / (table[there] - table[here])
            value[i] += slope * (x - table[here])
            rate[i] += slope


@kernel
def add_gauss_markov(series, nodes, t, value, rate):
    """Add the Gauss-Markov process at time t [s] to value (n,), and its derivative to rate (n,). ``nodes`` has the
    ((NODES + 1) n,) numbers of the block in memory, which is drawn here if it is another one."""
    n = value.shape[0]
    x = max(t, 0.0) / series.spacing
    k = int(x)
    if k // NODES != series.block:
        series.block = k // NODES
        draw_block(series, nodes, n)
    part, first = x - k, k % NODES * n
    for i in range(n):
        slope = series.deviation[i] * (nodes[first + n + i] - nodes[first + i])
        value[i] += series.deviation[i] * nodes[first + i] + part * slope
        rate[i] += slope / series.spacing


@kernel
def draw_block(series, nodes, n):
    """Draw the nodes of the block of the number ``series.block``: n independent processes of unit variance."""
    first = NODES * series.block
    for i in range(n):
        if series.deviation[i] != 0.0:
            x = standard_normal(series.key, first, i)  # NODES before the block
            for j in range(1, 2 * NODES + 1):
                x = series.kept * x + series.kick * standard_normal(series.key, first + j, i)
                if j >= NODES:
                    nodes[(j - NODES) * n + i] = x
