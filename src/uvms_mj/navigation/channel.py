r"""One channel of a sensor: a vector of three numbers, or an attitude, that is measured with errors and arrives late.

A sample is taken at the instants :math:`t_j = j T` of the channel's period T,

.. math::

    y_j = Q(L((1 + \epsilon) x(t_j) + b + w_j + \sigma n_j)), \qquad w_j = w_{j-1} + \rho \sqrt{T} n'_j, \quad w_0 = 0,

with the truth x, the scale error :math:`\epsilon`, the bias b, the random walk w, standard normal numbers n and n', the
limits L, which saturate each component, and the quantisation Q to multiples of the quantum. Of an attitude, the error
b + w + sigma n is a small rotation vector in B, and L and Q are applied to twice the vector part of the quaternion, the
rotation vector of a small angle. The noise sigma is the standard deviation of one sample. A sensor with
the one-sided spectral density N [unit/sqrt(Hz)] that is white up to half its rate has sigma = N / sqrt(2 T).

A sample is lost with the probability ``dropout``. Otherwise it arrives after the delay and a jitter, which is uniform
from zero to ``jitter``, but never before the sample that was taken before it. The measurement is the last sample that
has arrived. The sample of the first instant arrives at once, so that there is always one.

To use a channel in a stage::

    constants:  channel.pack(step)            # (SETTINGS,), from the time from one instant of the stage to the next
    memory:     {"depth_channel": MEMORY}
    step:       measure(settings.depth, state.depth_channel, truth, 0, given.instant, given.key, 0, measured)

The time unit of the kernels is the instant of the stage, which counts from 0.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..physics.frames import multiply
from ..physics.kernels import kernel
from ..physics.random import random_bits, standard_normal

IN_FLIGHT = 1000
"""Largest number of samples that have been taken and have not arrived."""

PERIOD, DELAY, JITTER, DROPOUT, SCALE, QUANTUM, LIMIT, NOISE, BIAS, WALK = 0, 1, 2, 3, 4, 5, 6, 7, 10, 13
SETTINGS = 16
"""Size of the packed settings; the names above are their places. A period of 0 stands for a perfect channel."""
TAKEN, ARRIVED, LATEST, WALKED, ERROR, SAMPLE, QUEUE = 0, 1, 2, 3, 6, 9, 13
SLOT = 5
"""Numbers of a sample in the queue: the instant at which it arrives, and its components."""
MEMORY = QUEUE + SLOT * IN_FLIGHT
"""Size of the memory: the samples taken and arrived since the queue was empty, the latest arrival, the random walk, the
error and the components of the sample in hand, and the queue."""
STREAMS = 8
"""Random numbers of a sample: noise and walk of three components, jitter and dropout."""
_UNIT, _NO_LIMIT = 2.0**-53, math.inf


@dataclass(frozen=True)
class Channel:
    """Settings of a channel, valid numbers in SI units; ``period`` None is every instant of the stage."""

    period: float | None = None
    delay: float = 0.0
    jitter: float = 0.0
    noise: tuple[float, ...] = (0.0, 0.0, 0.0)
    bias: tuple[float, ...] = (0.0, 0.0, 0.0)
    walk: tuple[float, ...] = (0.0, 0.0, 0.0)
    quantum: float = 0.0
    limit: float | None = None
    dropout: float = 0.0
    scale: float = 0.0

    @functools.cached_property
    def perfect(self) -> bool:
        """Whether the measurement is the truth of the same instant."""
        return self == Channel()

    @property
    def settled(self) -> Channel:
        """The channel of a constant truth that is clear of the limit, without the settings that do not change the
        mean."""
        return dataclasses.replace(self, limit=None, period=None, delay=0.0, jitter=0.0, noise=(0.0,) * 3, dropout=0.0)

    def mean(self, x: np.ndarray) -> np.ndarray:
        """Mean measurement (3,) of a constant x (3,), without a random walk, a quantum and a limit."""
        return (1.0 + self.scale) * x + self.bias

    def mean_attitude(self, quat: np.ndarray) -> np.ndarray:
        """Mean measurement (4,) of a constant attitude (4,), under the same conditions."""
        measured, memory = np.empty(4), np.zeros(MEMORY)
        measure_attitude(self.settled.pack(1.0), memory, quat, 0, 0, 0, measured)
        return measured

    @functools.lru_cache(maxsize=64)  # noqa: B019  # of a few small channels
    def pack(self, step: float) -> np.ndarray:
        """(SETTINGS,) for the kernels; ``step`` is the time from one instant of the stage to the next [s]."""
        settings = np.zeros(SETTINGS)
        if not self.perfect:
            T = self.period or step
            settings[[PERIOD, DELAY, JITTER]] = [round(time / step) for time in (T, self.delay, self.jitter)]
            settings[[DROPOUT, SCALE, QUANTUM]] = self.dropout, self.scale, self.quantum
            settings[LIMIT] = math.inf if self.limit is None else self.limit
            settings[NOISE:BIAS], settings[BIAS:WALK] = self.noise, self.bias
            settings[WALK:] = math.sqrt(T) * np.array(self.walk)
        settings.setflags(write=False)
        return settings

    @functools.lru_cache(maxsize=64)  # noqa: B019
    def faults(self, step: float) -> tuple[tuple[str, str], ...]:
        """Errors that depend on the time between two instants of the stage [s]: a setting and a sentence."""
        return tuple(self._faults(step))

    def _faults(self, step: float) -> Iterator[tuple[str, str]]:
        for name in ("period", "delay", "jitter"):
            time = getattr(self, name) or 0.0
            n = int(time / step + 1e-6)
            if abs(time / step - round(time / step)) > 1e-6 or (time and not round(time / step)):
                nearest = f"the nearest are {n * step:g} and {(n + 1) * step:g} s"
                yield name, f"{time:g} s is not a multiple of the sensors' period {step:g} s; {nearest}"
        latest, T = self.delay + self.jitter, self.period or step
        if round(latest / T) > IN_FLIGHT - 2:
            most = f"at most {IN_FLIGHT - 2} samples may be on their way"
            yield "delay", f"{latest:g} s with the jitter is too long for a sample every {T:g} s; {most}"


@kernel
def measure(channel, memory, truth, first, instant, key, index, measured):
    """Measure three numbers.

    Args:
        channel: (SETTINGS,) of :meth:`Channel.pack`.
        memory: (MEMORY,) kept by the stage, zero at the start.
        truth: (n,) with the three true numbers from the place ``first`` on.
        instant: number of the stage's instant, ``given.instant``.
        key: ``given.key``.
        index: number of the channel within the stage, which separates its random numbers.
        measured: (n,) output, from the place ``first`` on. It keeps its values until a sample arrives.
    """
    if channel[PERIOD] == 0.0:
        for i in range(3):
            measured[first + i] = truth[first + i]
        return
    if instant % int(channel[PERIOD]) == 0:
        draw_error(channel, memory, instant, key, index)
        for i in range(3):
            y = (1.0 + channel[SCALE]) * truth[first + i] + memory[ERROR + i]
            memory[SAMPLE + i] = resolved(channel, y)
        send(channel, memory, 3, instant, key, index)
    receive(memory, 3, instant, first, measured)


@kernel
def measure_attitude(channel, memory, quat, instant, key, index, measured):
    """Measure a unit quaternion (4,); the other arguments are as in :func:`measure`."""
    if channel[PERIOD] == 0.0:
        measured[:] = quat
        return
    if instant % int(channel[PERIOD]) == 0:
        draw_error(channel, memory, instant, key, index)
        error = memory[ERROR : ERROR + 3]
        angle = math.sqrt(error @ error)
        x, y, z = error * (math.sin(0.5 * angle) / angle if angle > 0.0 else 0.5)
        multiply(quat, np.array([math.cos(0.5 * angle), x, y, z]), memory[SAMPLE : SAMPLE + 4])
        if channel[QUANTUM] > 0.0 or channel[LIMIT] < _NO_LIMIT:
            resolve_attitude(channel, memory)
        send(channel, memory, 4, instant, key, index)
    receive(memory, 4, instant, 0, measured)


@kernel
def resolve_attitude(channel, memory):
    """Limit and quantise twice the vector part of the sample's quaternion with w >= 0."""
    sign = 1.0 if memory[SAMPLE] >= 0.0 else -1.0
    square = 0.0
    for i in range(1, 4):
        x = 0.5 * resolved(channel, 2.0 * sign * memory[SAMPLE + i])
        memory[SAMPLE + i] = x
        square += x * x
    memory[SAMPLE] = math.sqrt(max(0.0, 1.0 - square))
    if square > 1.0:
        for i in range(1, 4):
            memory[SAMPLE + i] /= math.sqrt(square)


@kernel
def draw_error(channel, memory, instant, key, index):
    """Set the error b + w + sigma n (3,) of the sample in hand, and advance the random walk."""
    for i in range(3):
        stream = STREAMS * index + i
        if channel[WALK + i] > 0.0 and instant > 0:
            memory[WALKED + i] += channel[WALK + i] * standard_normal(key, instant, stream + 3)
        memory[ERROR + i] = channel[BIAS + i] + memory[WALKED + i]
        if channel[NOISE + i] > 0.0:
            memory[ERROR + i] += channel[NOISE + i] * standard_normal(key, instant, stream)


@kernel
def resolved(channel, x) -> float:
    """A component within its limits, as a multiple of the quantum."""
    y = min(channel[LIMIT], max(-channel[LIMIT], x))
    if channel[QUANTUM] > 0.0:
        y = channel[QUANTUM] * math.floor(y / channel[QUANTUM] + 0.5)
    return y


@kernel
def send(channel, memory, n, instant, key, index):
    """Put the sample's n components into the queue with the instant at which they arrive, unless they are lost."""
    stream = STREAMS * index + 6
    arrival = 0.0 + instant
    if instant > 0:
        if channel[DROPOUT] > 0.0 and random_bits(key, instant, stream + 1, 0) * _UNIT < channel[DROPOUT]:
            return
        arrival += channel[DELAY]
        if channel[JITTER] > 0.0:
            arrival += math.floor((channel[JITTER] + 1.0) * (random_bits(key, instant, stream, 0) * _UNIT))
        arrival = max(arrival, memory[LATEST])
    memory[LATEST] = arrival
    slot = memory[QUEUE:].reshape(IN_FLIGHT, SLOT)[int(memory[TAKEN]) % IN_FLIGHT]
    slot[0] = arrival
    for i in range(n):
        slot[1 + i] = memory[SAMPLE + i]
    memory[TAKEN] += 1.0


@kernel
def receive(memory, n, instant, first, measured):
    """Set the measurement to the last sample that has arrived, if there is a new one."""
    queue = memory[QUEUE:].reshape(IN_FLIGHT, SLOT)
    for j in range(int(memory[ARRIVED]), int(memory[TAKEN])):
        slot = queue[j % IN_FLIGHT]
        if slot[0] > instant:
            return
        for i in range(n):
            measured[first + i] = slot[1 + i]
        memory[ARRIVED] += 1.0
    memory[TAKEN], memory[ARRIVED] = 0.0, 0.0  # the queue is empty: it begins again where the cache has it
