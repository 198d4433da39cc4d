r"""The sampled loop of a law, linear about rest: which of its motions grow, and how fast?

The vehicle is free, or presses on a contact along its normal n:

.. math:: M \dot\nu = \tau - D_{linear} \nu + n f, \qquad \dot x = \nu, \qquad f = -n^\top (k_c x + b_c \nu),

with x (6,) = (R^T (p - p_d), rotation vector). Symplectic Euler takes it over the time steps. The law is its own
function by differences, behind the impedance task if it uses that. Its slope over s is that of the secant to an
amplitude S, as in a describing function: super-twisting is infinitely steep at S = 0, and a linear law has one slope.

Measurements and commands pass through the stages as in a run: each stage has its period and its delay, and takes the
latest sample that has come to it. After N steps, the least common multiple of all periods, everything repeats. The
eigenvalues of the matrix of these N steps decide: a motion grows with :math:`\ln |\lambda| / (N h)`. The model leaves
out the loss of contact, quadratic damping, the restoring wrench, the attitude's effect on the directions, and limits.
"""

import functools
import itertools
import math
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.linalg import block_diag

About = tuple[tuple[str, tuple[float, ...]], ...]
"""States of a law at rest that are not zero, by name."""
_EPS = 1e-6
_ON_THE_WAY = 12
"""Most samples on their way through a delay. A longer delay is a shorter one with a hold of the same mean age."""
_MOST_STEPS = 100_000
"""Longest common period [steps]. With a longer one, measurements are taken at instants of the law."""


class Line:
    """The samples that one stage takes from another, with N steps as their common period.

    Attributes:
        taken: (N,) whether a sample that is used is taken at a step.
        newer: (reads,) number of samples that are newer than the one that a read gets.
        kept: number of samples that are on their way from one interval to the next.
    """

    def __init__(self, N: int, reads: np.ndarray, sources: np.ndarray, intervals: np.ndarray) -> None:
        """Steps of the reads, of the samples that they get, and of the starts of the intervals that they are in."""
        times = np.unique(sources % N)
        used = np.concatenate([times + i * N for i in range(int(sources.min()) // N, 1)])
        self.taken = np.isin(np.arange(N), times)

        def until(steps: np.ndarray, side: Any) -> np.ndarray:
            return np.searchsorted(used, steps, side)

        self.newer = until(reads, "right") - until(sources, "right")
        self.kept = max(0, int((until(intervals, "left") - until(sources, "left")).max()))


class Loop:
    """The loop of a run's law without contact, or at one of ``setup.contacts_at_rest``.

    Its state has x and nu, the states of the thrusters' lag, those of the law, and samples that are on their way.

    Args:
        setup: the run's :class:`uvms_mj.setup.base.Setup`.
        contact: the contact.
        about: states of the law at rest.
        amplitudes: B amplitudes of s [m/s]; none for a law without s. With them, the motion along the contact's normal
            counts alone.
        period: control period [s]; default: that of the run.
    """

    def __init__(
        self,
        setup: Any,
        contact: Any = None,
        about: About = (),
        amplitudes: tuple[float, ...] = (),
        period: float | None = None,
    ) -> None:
        self.setup, self.h, self.contact = setup, setup.scenario.simulation.timestep, contact
        M_inv, normal = np.linalg.inv(setup.design.M), np.zeros(6) if contact is None else contact.normal
        left, right = np.eye(6), np.eye(6)
        if contact is not None and amplitudes:
            left, right = normal[None], (M_inv @ normal / (normal @ M_inv @ normal))[:, None]
        self.m = len(left)
        self.force = np.zeros((1, 2 * self.m))
        if contact is not None:
            self.force = -np.kron([contact.stiffness, contact.damping], normal @ right)[None]
        self.law = self._law(about, amplitudes, left, right, normal, M_inv)
        self.step = self._step(-left @ M_inv @ setup.vehicle.D_linear @ right, (left @ M_inv @ normal)[:, None])
        self._lines(setup.scenario.control_period if period is None else period)

    def _law(self, about: About, amplitudes: Any, left: Any, right: Any, normal: Any, M_inv: np.ndarray) -> np.ndarray:
        """Acceleration by the command, states, their rates, and s (B, 2 m + 2 n, 2 m + 1 + n), from x, nu, the contact
        force and the states."""
        by_measurement, by_s = linear_law(self.setup, about, amplitudes, tuple(map(tuple, right.T)))
        states = (len(by_measurement) - 12) // 2
        axes = states // 6 if self.m == 1 else 0
        inner, outer = (np.kron(np.eye(axes), each) if axes else np.eye(states) for each in (left, right))
        self.n = len(inner)
        out = block_diag(left @ M_inv, inner, inner, left)
        law: np.ndarray = out @ by_measurement @ block_diag(right, right, normal[:, None], outer)
        return law + out @ by_s @ law[-self.m :]

    def _step(self, drag: np.ndarray, pushed: np.ndarray) -> np.ndarray:
        """A time step of x, nu and the states of the lag, which the acceleration by the command follows."""
        m, one, lag = self.m, np.eye(self.m), self.setup.scenario.thrusters.lag_model(self.h)
        size = 2 * m + (m * len(lag["C"]) if lag else 0)
        acceleration, step = np.zeros((m, size + m)), np.eye(size + m)
        acceleration[:, : 2 * m] = np.hstack([0.0 * one, drag]) + pushed @ self.force
        acceleration[:, 2 * m :] = np.hstack([np.kron(lag["C"], one), 0.0 * one]) if lag else one
        if lag:
            step[2 * m : size, 2 * m :] = np.kron(np.column_stack([lag["Phi"], lag["Gamma"]]), one)
        step[m : 2 * m] += self.h * acceleration
        step[:m] += self.h * step[m : 2 * m]
        return step

    def _lines(self, period: float) -> None:
        """The control period and the common one, and the lines of pose, velocity, force and command."""
        scenario = self.setup.scenario

        def steps(seconds: float) -> int:
            return max(1, round(seconds / self.h))

        c = steps(period)
        sensor, observer, thrusters = scenario.navigation, scenario.observer, scenario.thrusters
        own = sensor.period or (self.h if sensor.every_step else period)
        observed = observer if observer.runs else sensor
        timings = [(None, 0.0), sensor.velocity_timing, observed.force_timing]
        measured = [(steps(every or own), round(late / self.h)) for every, late in timings]
        if observer.runs and observer.period:
            measured[2] = steps(observer.period), measured[2][1]
        actuation, last = steps(scenario.actuation.period or self.h), steps(thrusters.period or self.h)
        late = round((scenario.controller.delay or 0.0) / self.h)
        late += 0 if thrusters.lag_model(self.h) else round(thrusters.mean_delay() / self.h)
        if math.lcm(c, actuation, last, *(every for every, _ in measured)) > _MOST_STEPS:
            measured = [(c * max(1, round(every / c)), delay) for every, delay in measured]
        measured = [_shortened(every, delay, c) for every, delay in measured]
        both, late = _shortened(math.lcm(actuation, last), late, c)
        self.control, self.period = c, math.lcm(c, both, *(every for every, _ in measured))
        at, k = np.arange(0, self.period, c), np.arange(self.period)
        self.measured = [Line(self.period, at, (at - delay) // every * every, at) for every, delay in measured]
        longer = both if both > math.lcm(actuation, last) else 1
        read = functools.reduce(lambda step, held: step // held * held, (last, actuation, longer), k)
        self.commands = Line(self.period, k, (read - late) // c * c, k // c * c)

    @property
    def _all(self) -> list[Line]:
        return [*self.measured, self.commands]

    @functools.cached_property
    def _places(self) -> list[slice]:
        """The plant with the lag, the states of the law, and the samples of each line."""
        samples = [width * line.kept for width, line in zip((self.m, self.m, 1, self.m), self._all, strict=True)]
        sizes = [len(self.step) - self.m, self.n, *samples]
        return [slice(end - size, end) for end, size in zip(np.cumsum(sizes), sizes, strict=True)]

    def _over(self, first: int, power: Callable[[int], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """The state after the control period that begins at a step, and s at its instant, by the state before it."""
        m, n, inside = self.m, self.n, slice(first, first + self.control)
        size = self._places[-1].stop
        plant, states, *samples = (
            np.broadcast_to(np.eye(size), (len(self.law), size, size))[:, p] for p in self._places
        )
        widths = (m, m, 1, m)
        lines = [[old[:, i : i + w] for i in range(0, old.shape[1], w)] for old, w in zip(samples, widths, strict=True)]
        newer = self.commands.newer[inside]
        changes = np.any([line.taken[inside] for line in self._all], axis=0)
        changes |= np.diff(newer, prepend=-1) != 0
        sliding = plant[:, :0]
        for at, end in itertools.pairwise([*np.flatnonzero(changes).tolist(), self.control]):
            now = plant[:, :m], plant[:, m : 2 * m], self.force @ plant[:, : 2 * m]
            for line, old, value in zip(self.measured, lines, now, strict=False):
                if line.taken[first + at]:
                    old.insert(0, value)
            if at == 0:
                seen = [old[line.newer[first // self.control]] for line, old in zip(self.measured, lines, strict=False)]
                response = self.law @ np.concatenate([*seen, states], axis=1)
                states = response[:, m : m + n] + self.h * self.control * response[:, m + n : m + 2 * n]
                sliding = response[:, m + 2 * n :]
                if self.commands.taken[first]:
                    lines[3].insert(0, response[:, :m])
            plant = power(end - at)[: plant.shape[1]] @ np.concatenate([plant, lines[3][newer[at]]], axis=1)
        left = [value for line, old in zip(self._all, lines, strict=True) for value in old[: line.kept]]
        return np.concatenate([plant, states, *left], axis=1), sliding

    @functools.cached_property
    def _whole(self) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
        """The matrix (B, size, size) of a common period, and those of each control period in it with its s."""
        power = functools.cache(functools.partial(np.linalg.matrix_power, self.step))
        found: dict[Any, tuple[np.ndarray, np.ndarray]] = {}
        kinds = []
        for i, first in enumerate(range(0, self.period, self.control)):
            inside = slice(first, first + self.control)
            events = [line.taken[inside].tobytes() for line in self._all], [line.newer[i] for line in self.measured]
            kinds.append(repr((events, self.commands.newer[inside].tobytes())))
            if kinds[-1] not in found:
                found[kinds[-1]] = self._over(first, power)
        whole: np.ndarray = np.eye(self._places[-1].stop)[None]
        for kind, same in itertools.groupby(kinds):
            whole = np.linalg.matrix_power(found[kind][0], len(list(same))) @ whole
        return whole, [found[kind] for kind in kinds]

    @functools.cached_property
    def growths(self) -> np.ndarray:
        """Growth rate of the fastest growing motion (B,), or (1,) without amplitudes [1/s]."""
        radius = np.abs(np.linalg.eigvals(self._whole[0])).max(axis=-1)
        return np.log(np.maximum(radius, 1e-300)) / (self.period * self.h)

    def force_per_s(self, which: int) -> float:
        """Force of the fastest growing motion over its s at an amplitude, by the largest of a common period [N s/m]."""
        whole, parts = self._whole
        values, vectors = np.linalg.eig(whole[which])
        mode, forces, sliding = vectors[:, np.abs(values).argmax()], [], []
        for over, s in parts:
            forces.append(self.contact.stiffness * np.abs(mode[0]))
            sliding.append(np.abs(s[which] @ mode)[0])
            mode = over[which] @ mode
        return float(max(forces) / max(sliding))


def _shortened(every: int, delay: int, control: int) -> tuple[int, int]:
    """Period and delay of a stage before a law, or behind it, with at most :data:`_ON_THE_WAY` samples on their way.
    All in steps."""
    if delay <= _ON_THE_WAY * max(every, control):
        return every, delay
    both = math.lcm(every, control)
    held = both * -(-delay // (_ON_THE_WAY * both))
    return held, control * round((delay + 0.5 * (every + control - math.gcd(every, control) - held)) / control)


def linear_law(
    setup: Any, about: About, amplitudes: tuple[float, ...], directions: tuple[tuple[float, ...], ...]
) -> tuple[np.ndarray, np.ndarray]:
    """The response (12 + 2 n, 18 + n) of a law to x, nu, tau_c and its n states while s is held at zero, and that to s
    (B, 12 + 2 n, d) along d directions: tau, the states as the law leaves them, their rates, and the s of the task."""
    evaluate, at_rest, by_measurement = _by_measurement(setup, about, bool(amplitudes))
    still = np.zeros(by_measurement.shape[1])
    by_s = [[(evaluate(still, S * np.array(e)) - at_rest) / S for e in directions] for S in amplitudes]
    return by_measurement, np.swapaxes(by_s, 1, 2) if by_s else np.zeros((1, len(at_rest), len(directions)))


@functools.lru_cache(maxsize=8)  # the warnings and the rest of a run need the same one
def _by_measurement(setup: Any, about: About, slides: bool) -> tuple[Callable[..., np.ndarray], np.ndarray, np.ndarray]:
    """The law as a function of x, nu, tau_c, states and s; what it gives at rest; its derivatives but for s. zeta is
    the last of the states if the law slides."""
    law, task, design = setup.scenario.controller, setup.task, setup.design
    kind = type(law)
    # records of NumPy, which the functions also take, are five times slower
    signals = _fields({signal.name: np.zeros(signal.shape) for signal in kind.given()})
    signals.M_hat, signals.M_d, signals.D_d, signals.M = design.M_hat, design.M_d, design.D_d, design.M
    signals.K_d = np.diag(design.K_d)
    signals.K_f, signals.F_d = (np.array(each) for each in setup.scenario.impedance.at_end)
    signals.quat_e, signals.period, signals.instant = np.array([1.0, 0.0, 0.0, 0.0]), setup.scenario.control_period, 1
    gains, task_gains = _fields(law.constants(setup)), _fields(task.constants(setup))
    state, rates = (_fields({name: np.zeros(size) for name, size in kind.states.items()}) for _ in range(2))
    own = {**type(task).states, **type(task).memory}
    zeta, zeta_dot = (_fields({name: np.zeros(size) for name, size in own.items()}) for _ in range(2))
    vars(state).update({name: np.array(value) for name, value in about})
    states = [*vars(state).values(), *([zeta.zeta] if slides else [])]
    base, ends = np.concatenate([*states, np.zeros(0)]), np.cumsum([len(each) for each in states])
    D, half = setup.vehicle.D_linear, np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
    D_hat = setup.scenario.estimates.damping * setup.nominal.D_linear

    def evaluate(y: np.ndarray, s: np.ndarray) -> np.ndarray:
        signals.eta_e, signals.nu, signals.tau_contact_m_B = half * y[:6], y[6:12], y[12:18]
        signals.nu_e, signals.D_hat_nu, signals.D_nu_r = signals.nu, D_hat @ signals.nu, D @ signals.nu
        signals.s, tau_cmd = np.zeros(6), np.zeros(6)
        for each, value in zip(states, np.split(base + y[18:], ends), strict=False):
            each[:] = value
        if kind.uses_task:
            type(task).step(task_gains, zeta, signals, zeta_dot, signals)
        of_task, signals.s = signals.s, s
        kind.law(gains, state, signals, rates, tau_cmd)
        rate = [*vars(rates).values(), *([zeta_dot.zeta] if slides else [])]
        return np.concatenate([tau_cmd, *states, *rate, of_task])

    still = np.zeros(6)
    at_rest = evaluate(np.zeros(18 + len(base)), still)
    by_measurement = np.array([evaluate(e, still) - at_rest for e in _EPS * np.eye(18 + len(base))]).T / _EPS
    return evaluate, at_rest, by_measurement


def _fields(values: Mapping[str, Any]) -> SimpleNamespace:
    """Values by attribute, tuples as arrays."""
    return SimpleNamespace(**{name: np.array(x) if isinstance(x, tuple) else x for name, x in values.items()})
