r"""The sampled loop of a law, linear about rest: which of its motions grow, and how fast? And latency: the age of the
contact force in tau, and the age at which it takes all of the damping against the wall.

The vehicle is free, or presses on a contact along its normal n:

.. math:: M \dot\nu = \tau - D_{linear} \nu + n f, \qquad \dot x = \nu, \qquad f = -n^\top (k_c x + b_c \nu),

with x (6,) = (R^T (p - p_d), rotation vector). Symplectic Euler takes it over the time steps. The law is its own
function by differences, behind the impedance task if it uses that. Its slope over s is the slope of the secant to an
amplitude S, as in a describing function: super-twisting is infinitely steep at S = 0, and a linear law has one slope.

Measurements and commands pass through the stages as in a run: each stage has its period and its delay, and takes the
latest sample that has come to it. After N steps, the least common multiple of all periods, everything repeats. The
eigenvalues of the matrix of these N steps decide: a motion grows with :math:`\ln |\lambda| / (N h)`. The model leaves
out the loss of contact and limits. About a rest among shapes all that the water does is in it by its slopes over pose
and velocity there. Elsewhere the model leaves out quadratic damping, the restoring wrench and the attitude's effect on
the directions, and effects of the water on a rigid vehicle, shipped ones and a user's, are in it by such slopes.
"""

import functools
import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from ...physics.frames import skew
from ...stages.setup import SetupLike
from .approach import SLOWEST
from .contacts_about_rest import ContactsAtRest
from .own_effects import OwnEffects

_MOST_INSTANTS = 100_000
"""Longest common period over which ages are averaged [steps]; of a longer one, its beginning."""
_MEASURED = ("force sensor's delay", "observer's lag", "navigation period", "control period")
_COMMAND = ("computation delay", "actuation period", "thruster period", "thrusters' lag")


@dataclass(frozen=True)
class ForceLatency:
    """The chain from the contact force to the thrust.

    Attributes:
        timestep: h [s].
        periods: periods of the stages from the measurement to the thrust in their order, by name [s].
        delays: delays on the way, by name [s].
    """

    timestep: float
    periods: Mapping[str, float]
    delays: Mapping[str, float]

    @classmethod
    def of(cls, setup: SetupLike, period: float | None = None) -> "ForceLatency":
        """The chain of a run, from its :class:`uvms_mj.setup.base.Setup`; default of the control period [s]: its
        own."""
        scenario = setup.scenario
        h, control = scenario.simulation.timestep, period or scenario.control_period
        observed = scenario.observer.runs
        sensor = scenario.observer if observed else scenario.navigation
        rate, late = sensor.force_timing
        periods = {
            "navigation": rate or sensor.period or (h if sensor.every_step else control),
            "control": control,
            "actuation": scenario.actuation.period or h,
            "thruster": scenario.thrusters.period or h,
        }
        delays = {
            "observer's lag" if observed else "force sensor's delay": late,
            "computation delay": scenario.controller.delay or 0.0,
            "thrusters' lag": scenario.thrusters.mean_delay(),
        }
        return cls(h, periods, delays)

    @functools.cached_property
    def ages(self) -> dict[str, float]:
        """Mean age that each period and each delay adds, by its name [s]: the stages are asked backwards, from all
        steps of a common period."""
        h, ages = self.timestep, dict(self.delays)
        steps = {name: round(period / h) for name, period in self.periods.items()}
        k = np.arange(min(math.lcm(*steps.values()), _MOST_INSTANTS))
        for name in reversed(steps):
            if name == "control":
                k = k - round(self.delays["computation delay"] / h)
            ages[f"{name} period"] = h * float((k % steps[name]).mean())
            k = k - k % steps[name]
        return ages

    @property
    def mean(self) -> float:
        """Mean age of the contact force in tau [s]."""
        return math.fsum(self.ages.values())

    @property
    def measured(self) -> float:
        """The part of it up to the command [s]: explicit Euler holds the measurements in zeta for the control period,
        too."""
        return math.fsum(self.ages.get(name, 0.0) for name in _MEASURED)

    @property
    def command_latency(self) -> float:
        """Mean age of the command that acts, the hold of the control period included [s]."""
        return math.fsum(self.ages[name] for name in (*_COMMAND, "control period"))

    @property
    def longest(self) -> str:
        """Name of the longest period; of equal ones, the law's."""
        return max(("control", "navigation", "actuation", "thruster"), key=self.periods.__getitem__)

    def parts(self, names: tuple[str, ...] = ()) -> str:
        """The parts of the age, the largest first, as text; only the parts ``names`` if they are given."""
        parts = sorted(self.ages.items(), key=lambda part: -part[1])
        return ", ".join(f"{n} {1e3 * age:.3g} ms" for n, age in parts if age > 1e-9 and (n in names or not names))

    def command_parts(self) -> str:
        """The parts behind the command, with the control period, as text."""
        return self.parts((*_COMMAND, "control period"))


@dataclass(frozen=True)
class ForceAge:
    """The effect of an old contact force on the damping against the wall, in closed form, along v = G K_f n.

    Against a spring k_c, feedback of the contact force with unit gain and age T acts as a negative damping k_c T. The
    sliding mode laws impose M_d and D_d on any vehicle: G, the matrix before D_d v in v_dot, is M_d^-1. The laws
    impedance and ideal answer to the contact force with their own M as well: G is M^-1 M_hat M_d^-1, and they feed back
    only M M_d^-1 K_f - I, which is inertia shaping, eq. (4).

    Attributes:
        chain: what holds or delays the contact force on its way to tau.
        contact: one of ``setup.contacts_at_rest``; None without any.
        age: mean age of the force that acts as negative damping [s]. For a law that answers through its own inertia it
            is the age of the force in tau. A sliding mode law takes s to zero in its own loop, in which the force and
            the velocity are of the same instant: only the age of the measurements counts. A law that runs at every step
            on measurements of every step feeds back the force that acts.
        limit: the age that takes all of the damping [s]. For a sliding mode law and a wall with the damping b_c it is
            (D_d/K_f + b_c)/k_c. For M_d < M, inertia shaping takes (M/M_d - 1) k_c T from a damping of
            M/M_d (D_d + b_c).
    """

    chain: ForceLatency
    contact: Any
    age: float
    limit: float

    @classmethod
    def of(cls, setup: SetupLike, M_hat: np.ndarray | None = None) -> "ForceAge":
        """The age under a law that imposes M_d, or that answers through its own inertia with M_hat (6, 6), at the
        contact that allows the least."""
        chain = ForceLatency.of(setup)
        limits = [(_limit(setup, contact, M_hat), contact) for contact in setup.contacts_at_rest]
        limit, contact = min(limits, key=lambda each: each[0], default=(math.inf, None))
        return cls(chain, contact, chain.measured if M_hat is None else chain.mean, limit)

    @property
    def share(self) -> float:
        """Part of the damping that is lost [1]."""
        return self.age / self.limit if self.limit > 0.0 else math.inf

    def comparison(self) -> str:
        """Age and limit as a sentence without its stop."""
        return (
            f"the fed back contact force is {1e3 * self.age:.3g} ms old on average, and all of the damping is lost at "
            f"(D_d/K_f + b_c)/k_c = {1e3 * self.limit:.3g} ms"
        )


def _limit(setup: SetupLike, contact: Any, M_hat: np.ndarray | None) -> float:
    design, n = setup.design, contact.normal
    G = design.M_d_inv if M_hat is None else np.linalg.solve(design.M, M_hat @ design.M_d_inv)
    v = G @ (np.array(setup.scenario.impedance.at_end[0]) * n)
    compliant = float(n @ v)
    fed_back = compliant - (0.0 if M_hat is None else 1.0 / design.along_normal(design.M, n))
    if compliant <= 0.0 or fed_back <= 1e-9 * compliant:
        return math.inf
    damping = float(n @ G @ design.D_d @ v) / compliant
    return (damping + compliant * contact.damping) / (fed_back * contact.stiffness)


About = tuple[tuple[str, tuple[float, ...]], ...]
"""States of a law at rest that are not zero, by name."""
_EPS = 1e-6
_ON_THE_WAY = 8
"""Most samples on their way through a delay. A longer delay is a shorter one with a hold of the same mean age."""
_MOST_STEPS = 5_000
"""Longest common period [steps]. Otherwise all stages that are slower than the law count as slow as the slowest."""
_MOST_MODELLED = 200_000
"""Longest common period of a loop, with the holds that stand for long delays [steps]: some 60 MB. A loop with a longer
one is not known."""
_LARGE = 2.0**300
"""Matrices are scaled where they have larger entries: over many periods a fast motion grows beyond any double."""


class Line:
    """The samples that one stage takes from another, with N steps as their common period.

    Attributes:
        taken: (N,) whether a sample that is used is taken at a step.
        newer: (reads,) number of samples that are newer than the sample that a read gets.
        kept: number of samples that are on their way from one interval to the next.
    """

    def __init__(self, N: int, reads: np.ndarray, sources: np.ndarray, intervals: np.ndarray) -> None:
        """Steps of the reads, of the samples that they get, and of the starts of the intervals that they are in."""
        self.taken = np.zeros(N, bool)
        self.taken[sources % N] = True
        times = np.flatnonzero(self.taken)
        used = np.concatenate([times + i * N for i in range(int(sources.min()) // N, 1)])

        def until(steps: np.ndarray, side: Any) -> np.ndarray:
            return np.searchsorted(used, steps, side)

        self.newer = until(reads, "right") - until(sources, "right")
        self.kept = max(0, int((until(intervals, "left") - until(sources, "left")).max()))


@dataclass(frozen=True)
class Timing:
    """The instants of a loop, in steps.

    Attributes:
        control: control period.
        common: period after which everything repeats.
        measured: period and delay of pose, velocity and force.
        holds: periods that hold a command, the last one first.
        late: delay of a command.
    """

    control: int
    common: int
    measured: tuple[tuple[int, int], ...]
    holds: tuple[int, ...]
    late: int

    @classmethod
    def of(cls, setup: SetupLike, period: float | None = None) -> "Timing":
        """The instants of a run's loop; default of the control period [s]: its own."""
        sensor, thrusters, h = setup.scenario.navigation, setup.scenario.thrusters, setup.scenario.simulation.timestep
        chain = ForceLatency.of(setup, period)
        force, c, actuation, last = (round(each / h) for each in chain.periods.values())
        old, late, lag = (round(each / h) for each in chain.delays.values())
        every, velocity_late = sensor.velocity_timing
        own = round(sensor.period / h) if sensor.period else 1 if sensor.every_step else c
        velocity = round(every / h) if every else own
        measured = [(own, 0), (velocity, round(velocity_late / h)), (force, old)]
        late += 0 if thrusters.lag_model(h) else lag
        periods = [c, actuation, last, *(every for every, _ in measured)]
        if math.lcm(*periods) > _MOST_STEPS:
            slowest = c * round(max(periods) / c)
            _, actuation, last, *own_periods = (slowest if every > c else c for every in periods)
            measured = [(every, delay) for every, (_, delay) in zip(own_periods, measured, strict=True)]
        measured = [_shortened(every, delay, c) for every, delay in measured]
        both, late = _shortened(math.lcm(actuation, last), late, c)
        longer = both if both > math.lcm(actuation, last) else 1
        common = math.lcm(c, both, *(every for every, _ in measured))
        return cls(c, common, tuple(measured), (last, actuation, longer), late)

    @property
    def too_long(self) -> str:
        """The reason why there is no model of a loop with these instants; empty if there is."""
        if self.common <= _MOST_MODELLED:
            return ""
        return "with delays of so many samples the sampled loop is not known"


class Loop:
    """The loop of a run's law without contact, or at one of ``setup.contacts_at_rest``.

    Its state has x and nu, the states of the thrusters' lag and of the law, and samples that are on their way.

    Args:
        setup: the run's :class:`uvms_mj.setup.base.Setup`.
        contact: the contact.
        about: states of the law at rest.
        amplitudes: B amplitudes of s [m/s]; none for a law without s. With them, the motion along the contact's normal
            counts alone.
        period: control period [s]; default: the run's. Its :class:`Timing` must not be too long.
        rest: what acts on the vehicle about a rest, in place of one contact.
        springs: which of its sets of contacts.
        push: the normal force of the contact [N], for the effects that depend on it; default: the desired one.
    """

    def __init__(
        self,
        setup: SetupLike,
        contact: Any = None,
        about: About = (),
        amplitudes: tuple[float, ...] = (),
        period: float | None = None,
        rest: "ContactsAtRest | None" = None,
        springs: int = 0,
        push: float | None = None,
    ) -> None:
        self.setup, self.h, self.contact = setup, setup.scenario.simulation.timestep, contact
        M_inv, normal = np.linalg.inv(setup.design.M), np.zeros(6) if contact is None else contact.normal
        left, right = np.eye(6), np.eye(6)
        if contact is not None and amplitudes:
            left, right = normal[None], (M_inv @ normal / (normal @ M_inv @ normal))[:, None]
        self.m, pushed = len(left), normal[:, None] if rest is None else np.eye(6)
        self.force = np.zeros((1, 2 * self.m))
        if contact is not None:
            self.force = -np.kron([contact.stiffness, contact.damping], normal @ right)[None]
        if rest is not None:
            self.force = -np.hstack(rest.springs[springs])
        self.widths = self.m, self.m, len(self.force), self.m
        self.law = self._law(about, amplitudes, left, right, pushed, M_inv, rest)
        tau_c = np.zeros(6) if rest is None else rest.tau_c
        if contact is not None:
            tau_c = normal * (max(0.0, float(normal @ setup.scenario.impedance.at_end[1])) if push is None else push)
        slopes, by_contact = self._of_water(tau_c, rest)
        drawn = np.hstack([left @ M_inv @ part @ right for part in np.hsplit(slopes, 2)])
        self.step = self._step(drawn, left @ M_inv @ (pushed + by_contact @ pushed))
        self._lines(period)

    def _law(
        self, about: About, amplitudes: Any, left: Any, right: Any, pushed: Any, M_inv: np.ndarray, rest: Any
    ) -> np.ndarray:
        """Acceleration by the command, states, their rates, and s (B, 2 m + 2 n, 2 m + 1 + n), from x, nu, the contact
        force and the states."""
        law = _Law(self.setup, about, bool(amplitudes), rest)
        acts = np.eye(6) if rest is None or rest.acts is None else rest.acts
        axes, states = divmod(law.n, 6) if self.m == 1 else (0, law.n)
        inner, outer = (np.kron(np.eye(axes), each) if axes else np.eye(states) for each in (left, right))
        self.n = len(inner)
        out = _diagonal(left @ M_inv @ acts, inner, inner, left)
        found: np.ndarray = out @ law.by(_EPS * _diagonal(right, right, pushed, outer)) / _EPS
        if not amplitudes:
            return found[None]
        by_s = law.by_s(np.array([S * right for S in amplitudes]))
        return found + np.array([out @ each / S for each, S in zip(by_s, amplitudes, strict=True)]) @ found[-self.m :]

    def _of_water(self, tau_c: np.ndarray, rest: "ContactsAtRest | None") -> tuple[np.ndarray, np.ndarray]:
        """The slopes (6, 12) of the water's wrench by x and nu, and (6, 6) by a contact's wrench, under the normal
        forces tau_c (6,). About a rest all of the water is in them; elsewhere linear damping and the effects on a rigid
        vehicle, shipped ones and a user's."""
        effects, slopes, by_contact = self.setup.scenario.effects, np.zeros((6, 12)), np.zeros((6, 6))
        slopes[:, 6:] = -self.setup.vehicle.D_linear
        if not self.setup.not_rigid:
            slopes += self.setup.effect_slopes
            if effects:
                own = OwnEffects(effects, self.setup).slopes(self.setup, tau_c)
                slopes, by_contact = slopes + own[:, :12], own[:, 12:]
        return slopes if rest is None else -rest.needs, by_contact

    def _step(self, drawn: np.ndarray, pushed: np.ndarray) -> np.ndarray:
        """A time step of x, nu and the states of the lag, which the acceleration by the command follows. The water's
        acceleration by x and nu is ``drawn``."""
        m, one, lag = self.m, np.eye(self.m), self.setup.scenario.thrusters.lag_model(self.h)
        size = 2 * m + (m * len(lag["C"]) if lag else 0)
        acceleration, step = np.zeros((m, size + m)), np.eye(size + m)
        acceleration[:, : 2 * m] = drawn + pushed @ self.force
        acceleration[:, 2 * m :] = np.hstack([np.kron(lag["C"], one), 0.0 * one]) if lag else one
        if lag:
            step[2 * m : size, 2 * m :] = np.kron(np.column_stack([lag["Phi"], lag["Gamma"]]), one)
        step[m : 2 * m] += self.h * acceleration
        step[:m] += self.h * step[m : 2 * m]
        return step

    def _lines(self, period: float | None) -> None:
        """The control period and the common one, and the lines of pose, velocity, force and command."""
        timing = Timing.of(self.setup, period)
        assert not timing.too_long, timing.too_long
        c, self.control, self.period = timing.control, timing.control, timing.common
        at, k = np.arange(0, self.period, c), np.arange(self.period)
        self.measured = [Line(self.period, at, (at - delay) // every * every, at) for every, delay in timing.measured]
        read = functools.reduce(lambda step, held: step // held * held, timing.holds, k)
        self.commands = Line(self.period, k, (read - timing.late) // c * c, k // c * c)

    @property
    def _all(self) -> list[Line]:
        return [*self.measured, self.commands]

    @functools.cached_property
    def _places(self) -> list[slice]:
        """The plant with the lag, the states of the law, and the samples of each line."""
        samples = [width * line.kept for width, line in zip(self.widths, self._all, strict=True)]
        sizes = [len(self.step) - self.m, self.n, *samples]
        return [slice(end - size, end) for end, size in zip(np.cumsum(sizes), sizes, strict=True)]

    def _over(self, first: int, power: Callable[[int], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """The state after the control period that begins at a step, and s at its instant, by the state before it."""
        m, n, inside = self.m, self.n, slice(first, first + self.control)
        size = self._places[-1].stop
        plant, states, *samples = (
            np.broadcast_to(np.eye(size), (len(self.law), size, size))[:, p] for p in self._places
        )
        each = zip(samples, self.widths, strict=True)
        lines = [[old[:, i : i + w] for i in range(0, old.shape[1], w)] for old, w in each]
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
    def _whole(self) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
        """The matrix (B, size, size) of a common period over 2 to the power (B,), which is zero unless the matrix is
        large, and the matrices of each control period in it with its s."""
        power = functools.cache(functools.partial(np.linalg.matrix_power, self.step))
        events = [line.taken for line in self._all] + [self.commands.newer]
        happens = [each.reshape(-1, self.control) for each in events] + [line.newer[:, None] for line in self.measured]
        kinds = [row.tobytes() for row in np.hstack(happens)]
        first = {kind: i * self.control for i, kind in reversed(list(enumerate(kinds)))}
        found = {kind: self._over(step, power) for kind, step in first.items()}
        whole: Scaled = np.eye(self._places[-1].stop)[None], np.zeros(1, int)
        for kind, same in itertools.groupby(kinds):
            whole = _product(_power(found[kind][0], len(list(same))), whole)
        return *whole, [found[kind] for kind in kinds]

    @functools.cached_property
    def growths(self) -> np.ndarray:
        """Growth rate of the fastest growing motion (B,), or (1,) without amplitudes [1/s]."""
        whole, exponents, _ = self._whole
        radius = np.abs(np.linalg.eigvals(whole)).max(axis=-1)
        return (np.log(np.maximum(radius, 1e-300)) + exponents * math.log(2.0)) / (self.period * self.h)

    @property
    def swings(self) -> bool:
        """Whether an oscillation grows, or decays so slowly that it lasts for tens of minutes. A state that only keeps
        its value has a rate of zero, too."""
        whole, exponents, _ = self._whole
        values = np.linalg.eigvals(whole[0])
        values = values[np.abs(np.angle(values)) > SLOWEST * self.period * self.h]
        largest = np.log(np.abs(values).max(initial=1e-300)) + exponents[0] * math.log(2.0)
        return bool(largest > -SLOWEST * self.period * self.h)

    def force_per_s(self, which: int) -> float:
        """Force of the fastest growing motion over its s at an amplitude, by the largest of a common period [N s/m]."""
        whole, _, parts = self._whole
        values, vectors = np.linalg.eig(whole[which])
        mode, forces, sliding = vectors[:, np.abs(values).argmax()], [], []
        for over, s in parts:
            if (size := float(np.abs(mode).max())) > _LARGE:
                mode, forces, sliding = mode / size, [each / size for each in forces], [each / size for each in sliding]
            forces.append(self.contact.stiffness * np.abs(mode[0]))
            sliding.append(np.abs(s[which] @ mode)[0])
            mode = over[which] @ mode
        return float(max(forces) / max(sliding))


Scaled = tuple[np.ndarray, np.ndarray]
"""Matrices (B, size, size) and the powers (B,) of 2 by which they are to be multiplied."""


def _product(left: Scaled, right: Scaled) -> Scaled:
    product, exponents = left[0] @ right[0], left[1] + right[1]
    sizes = np.abs(product).max(axis=(1, 2))
    more = np.where(sizes > _LARGE, np.frexp(sizes)[1], 0)
    if more.any():  # a power of 2 changes no digit
        product = product * np.ldexp(1.0, -more)[:, None, None]
    return product, exponents + more


def _power(matrices: np.ndarray, n: int) -> Scaled:
    """The nth power of matrices (B, size, size)."""
    square: Scaled = matrices, np.zeros(len(matrices), int)
    result = None
    while n:
        n, odd = divmod(n, 2)
        if odd:
            result = square if result is None else _product(result, square)
        if n:
            square = _product(square, square)
    assert result is not None
    return result


def _shortened(every: int, delay: int, control: int) -> tuple[int, int]:
    """Period and delay of a stage before a law, or behind it, with at most :data:`_ON_THE_WAY` samples on their way.
    All in steps."""
    if delay <= _ON_THE_WAY * max(every, control):
        return every, delay
    both = math.lcm(every, control)
    held = both * (-(-delay // (_ON_THE_WAY * both)) // 2 * 2 + 1)  # odd, so that half of what is added is whole
    return held, control * round((delay + 0.5 * (every + control - math.gcd(every, control) - held)) / control)


class _Law:
    """The law of a run about rest: tau, its n states as it leaves them, their rates, and the s of the task, from x, nu,
    tau_c and the states. zeta is the last of the states of a law that slides."""

    def __init__(self, setup: SetupLike, about: About, slides: bool, rest: ContactsAtRest | None) -> None:
        law, task, design, impedance = setup.scenario.controller, setup.task, setup.design, setup.scenario.impedance
        kind = type(law)
        # records of NumPy, which the functions also take, are five times slower
        signals = _fields({signal.name: np.zeros(signal.shape) for signal in kind.given()})
        signals.M_hat, signals.M_d, signals.D_d, signals.M = design.M_hat, design.M_d, design.D_d, design.M
        signals.K_d, (signals.K_f, signals.F_d) = np.diag(design.K_d), map(np.array, impedance.at_end)
        p_e, epsilon = (np.zeros(3), np.zeros(3)) if rest is None else (rest.eta_e[:3], rest.eta_e[3:])
        signals.quat_e, signals.instant = np.array([math.sqrt(1.0 - epsilon @ epsilon), *epsilon]), 1
        signals.period = setup.scenario.control_period
        self.signals, self.kind, self.task = signals, kind, type(task)
        self.error = np.eye(6)  # eta_e by displacement and rotation vector, the attitude's as in eq. (17)
        self.error[:3, 3:] = skew(p_e)
        self.error[3:, 3:] = 0.5 * (signals.quat_e[0] * np.eye(3) + skew(epsilon))
        self.gains, self.task_gains = _fields(law.constants(setup)), _fields(task.constants(setup))
        self.state, self.rates = (_fields({name: np.zeros(size) for name, size in kind.states.items()}) for _ in "xd")
        own = {**type(task).states, **type(task).memory}
        self.zeta, self.zeta_dot = (_fields({name: np.zeros(size) for name, size in own.items()}) for _ in "xd")
        vars(self.state).update({name: np.array(value) for name, value in about})
        self.states = [*vars(self.state).values(), *([self.zeta.zeta] if slides else [])]
        self.rate = [*vars(self.rates).values(), *([self.zeta_dot.zeta] if slides else [])]
        sizes = [len(each) for each in self.states]
        self.places = [slice(end - size, end) for end, size in zip(np.cumsum(sizes), sizes, strict=True)]
        self.base = np.concatenate([*self.states, np.zeros(0)])
        self.n = len(self.base)
        self.D_hat = setup.scenario.estimates.damping * setup.nominal.D_linear
        self.true, self.g_hat = np.hstack([np.zeros((6, 6)), setup.vehicle.D_linear]), np.zeros((6, 6))
        if rest is not None:
            self.true, self.g_hat = rest.needs, rest.known

    def by(self, given: np.ndarray) -> np.ndarray:
        """The change (12 + 2 n, columns) under each column (18 + n,) while the law is given s = 0."""
        at_rest = self._given(np.zeros(18 + self.n))
        return np.array([self._given(y) - at_rest for y in given.T]).T

    def by_s(self, s: np.ndarray) -> np.ndarray:
        """The changes (B, 12 + 2 n, columns) under each column of s (B, 6, columns) in place of s = 0."""
        at_rest = self._given(np.zeros(18 + self.n))

        def change(s: np.ndarray) -> np.ndarray:
            self._set(self.base)
            return self._command(s) - at_rest

        return np.array([[change(column) for column in one.T] for one in s]).transpose(0, 2, 1)

    def _set(self, states: np.ndarray) -> None:
        for state, place in zip(self.states, self.places, strict=True):
            state[:] = states[place]

    def _given(self, y: np.ndarray) -> np.ndarray:
        signals = self.signals
        signals.eta_e, signals.nu, signals.tau_contact_m_B = self.error @ y[:6], y[6:12], y[12:18]
        signals.nu_e, signals.D_hat_nu, signals.D_nu_r = signals.nu, self.D_hat @ signals.nu, self.true @ y[:12]
        signals.g_hat = self.g_hat @ y[:6]
        signals.s = np.zeros(6)
        self._set(self.base + y[18:])
        if self.kind.uses_task:
            self.task.step(self.task_gains, self.zeta, signals, self.zeta_dot, signals)
        self.s = signals.s
        return self._command(np.zeros(6))

    def _command(self, s: np.ndarray) -> np.ndarray:
        tau_cmd, self.signals.s = np.zeros(6), s
        self.kind.law(self.gains, self.state, self.signals, self.rates, tau_cmd)
        return np.concatenate([tau_cmd, *self.states, *self.rate, self.s])


def _diagonal(*blocks: np.ndarray) -> np.ndarray:
    """A matrix of blocks on its diagonal."""
    rows, columns = (np.cumsum([0, *(block.shape[axis] for block in blocks)]) for axis in (0, 1))
    whole = np.zeros((rows[-1], columns[-1]))
    for i, block in enumerate(blocks):
        whole[rows[i] : rows[i + 1], columns[i] : columns[i + 1]] = block
    return whole


def _fields(values: Mapping[str, Any]) -> SimpleNamespace:
    """Values by attribute, tuples as arrays."""
    return SimpleNamespace(**{name: np.array(x) if isinstance(x, tuple) else x for name, x in values.items()})
