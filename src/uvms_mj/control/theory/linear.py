r"""The loop of a law at the wall, linear about rest: does the sampled law damp it?

The law's own function is linearized by differences, with w and tau_nom of the impedance task if the law uses them; it
must not use s and zeta. Position and attitude enter as x (6,) = (R^T (p - p_d), rotation vector), the wall as the
spring and the damper

.. math:: \tau_c = -n n^\top (k_c x + b_c \nu)

along its normal n, which the law is given at its own instants. Between two instants the command is held, and symplectic
Euler takes the vehicle over the time steps:

.. math:: M \dot\nu = \tau + \tau_c - D_{linear} \nu, \qquad \dot x = \nu

The states of the law advance by one explicit Euler step a period. At the wall, what sensors, an observer, computation
and thrusters add to the age of the contact force delays the command; elsewhere, what computation and thrusters add. The
spectral radius of the whole, one matrix for a period, decides: above 1 a motion grows. The model leaves out the loss of
contact, quadratic damping, the restoring wrench, the attitude's effect on the directions, and limits.
"""

import functools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..base import SteadyState
from .latency import ForceLatency

GROWS = 1e-3
"""A growth rate above this is more than rounding [1/s]."""
_EPS = 1e-6
_MOST_COMMANDS = 20
"""Most commands that are on their way; of a longer delay, the law is taken at longer periods."""


@dataclass(frozen=True, eq=False)
class Linear:
    """A law linearized about rest; ``law`` (6 + 2 n, 18 + n) gives tau, its n states as the law leaves them, and their
    rates, from x, nu, tau_c and the states."""

    setup: Any
    law: np.ndarray

    @classmethod
    def of(cls, setup: Any, states: Mapping[str, np.ndarray] | None = None) -> "Linear":
        """The law of a run; ``states`` are those of the law at rest that are not zero."""
        about = tuple((name, tuple(value.tolist())) for name, value in (states or {}).items())
        return cls(setup, _jacobian(setup, about))

    @functools.cached_property
    def late(self) -> tuple[float, float]:
        """Delay of the command, and age of the contact force in tau besides the law's own period [s]."""
        scenario = self.setup.scenario
        age = ForceLatency.of(self.setup).mean - 0.5 * (scenario.control_period - scenario.simulation.timestep)
        return scenario.thrusters.mean_delay() + (scenario.controller.delay or 0.0), age

    def growth(self, period: float, contact: Any = None) -> float:
        """Growth rate of the fastest growing motion at one of ``setup.contacts_at_rest``, or without contact [1/s]."""
        h = self.setup.scenario.simulation.timestep
        late = round(self.late[0 if contact is None else 1] / h)
        steps = max(1, round(period / h), -(-late // _MOST_COMMANDS))
        whole, rest = divmod(late, steps)
        step, held, tau_c = self._step(contact)
        (free, old), (after, new) = _held(step, held, rest), _held(step, held, steps - rest)
        n = (len(self.law) - 6) // 2
        seen = np.zeros((18 + n, 12 + n))  # x, nu, tau_c and states, from x, nu and states
        seen[:12, :12], seen[12:18, :12], seen[18:, 12:] = np.eye(12), tau_c, np.eye(n)
        given = self.law @ seen
        # x and nu, the states, and the commands u_(k-1), u_(k-2), ...; two commands act in a period
        size = 12 + n + 6 * (whole + 1)
        commands = np.zeros((6 * (whole + 2), size))
        commands[:6, : 12 + n], commands[6:, 12 + n :] = given[:6], np.eye(6 * (whole + 1))
        acting, next_acting = commands[6 * whole : 6 * whole + 6], commands[6 * whole + 6 :]
        change = np.zeros((size, size))
        change[:12, :12] = after @ free
        change[:12] += new @ acting + after @ old @ next_acting
        change[12 : 12 + n, : 12 + n] = given[6 : 6 + n] + h * steps * given[6 + n :]
        change[12 + n :] = commands[:-6]
        radius = float(np.abs(np.linalg.eigvals(change)).max())
        return math.log(radius) / (h * steps) if radius > 0.0 else -math.inf

    def _step(self, contact: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """One time step of x and nu: by itself (12, 12), by tau (12, 6), and tau_c (6, 12) before it."""
        setup, h = self.setup, self.setup.scenario.simulation.timestep
        one, M_inv, tau_c = np.eye(6), np.linalg.inv(setup.design.M), np.zeros((6, 12))
        if contact is not None:
            n = contact.normal
            tau_c = -np.outer(n, n) @ np.hstack([contact.stiffness * one, contact.damping * one])
        force = M_inv @ (tau_c - np.hstack([0.0 * one, setup.vehicle.D_linear]))
        step, held = np.eye(12), np.vstack([h * h * M_inv, h * M_inv])
        step[:6] += h * (np.hstack([0.0 * one, one]) + h * force)
        step[6:] += h * force
        return step, held, tau_c

    @functools.cached_property
    def growths(self) -> tuple[float, float]:
        """Growth rates without a wall and at the worst one, at the control period [1/s]."""
        period = self.setup.scenario.control_period
        free = self.growth(period)
        return free, self.growth(period, self._worst) if self._worst else free

    @functools.cached_property
    def _worst(self) -> Any:
        period = self.setup.scenario.control_period
        return max(self.setup.contacts_at_rest, key=lambda contact: self.growth(period, contact), default=None)

    def checked(self, state: SteadyState | str) -> SteadyState | str:
        """The state at rest, or the reason why the sampled law does not come to rest there."""
        if isinstance(state, SteadyState):
            free, pressed = self.growths
            if free > GROWS:
                return "the sampled law is unstable without contact"
            if state.force > 0.0 and pressed > GROWS:
                return "the sampled law does not damp the vibration against this wall"
        return state

    def notes(self, label: str) -> Iterator[str]:
        """A warning if a motion grows, without a wall or against it."""
        scenario, (free, pressed) = self.setup.scenario, self.growths
        period, contact = scenario.control_period, self._worst
        if max(free, pressed) <= GROWS:
            return
        where = "without contact" if free > GROWS else f"against the wall, {contact.stiffness:g} N/m"
        contact = None if free > GROWS else contact
        h, shorter = scenario.simulation.timestep, round(period / scenario.simulation.timestep) // 2
        while shorter and self.growth(shorter * h, contact) > GROWS:
            shorter //= 2
        cure = f"a period of {shorter * h:.4g} s suffices" if shorter else "these gains and estimates need a change"
        rate = free if free > GROWS else pressed
        yield (
            f"{label} oscillates {where}: at a control period of {period:g} s a small motion grows with {rate:.3g} "
            f"1/s; {cure}"
        )


@functools.lru_cache(maxsize=8)  # the warnings and the rest of a run need the same one
def _jacobian(setup: Any, about: tuple[tuple[str, tuple[float, ...]], ...]) -> np.ndarray:
    """The matrix ``law`` of :class:`Linear`, by differences."""
    law, task, design = setup.scenario.controller, setup.task, setup.design
    kind = type(law)
    # records of NumPy, which the functions also take, are five times slower
    signals = _fields({signal.name: np.zeros(signal.shape) for signal in kind.given()})
    signals.M_hat, signals.M_d, signals.D_d = design.M_hat, design.M_d, design.D_d
    signals.K_d = np.diag(design.K_d)
    signals.K_f, signals.F_d = (np.array(each) for each in setup.scenario.impedance.at_end)
    signals.quat_e, signals.period, signals.instant = np.array([1.0, 0.0, 0.0, 0.0]), setup.scenario.control_period, 1
    gains, task_gains = _fields(law.constants(setup)), _fields(task.constants(setup))
    state, rates = (_fields({name: np.zeros(size) for name, size in kind.states.items()}) for _ in range(2))
    own = {**type(task).states, **type(task).memory}
    zeta, zeta_dot = (_fields({name: np.zeros(size) for name, size in own.items()}) for _ in range(2))
    vars(state).update({name: np.array(value) for name, value in about})
    states = list(vars(state).values())
    base, ends = np.concatenate([*states, np.zeros(0)]), np.cumsum([len(each) for each in states])
    D_hat, half = setup.scenario.estimates.damping * setup.nominal.D_linear, np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])

    def evaluate(y: np.ndarray) -> np.ndarray:
        signals.eta_e, signals.nu, signals.tau_contact_m_B = half * y[:6], y[6:12], y[12:18]
        signals.nu_e, signals.D_hat_nu, tau_cmd = signals.nu, D_hat @ signals.nu, np.zeros(6)
        for each, value in zip(states, np.split(base + y[18:], ends), strict=False):
            each[:] = value
        if kind.uses_task:
            type(task).step(task_gains, zeta, signals, zeta_dot, signals)
        kind.law(gains, state, signals, rates, tau_cmd)
        return np.concatenate([tau_cmd, *states, *vars(rates).values()])

    at_rest = evaluate(np.zeros(18 + len(base)))
    return np.array([evaluate(e) - at_rest for e in _EPS * np.eye(18 + len(base))]).T / _EPS


def _held(step: np.ndarray, held: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """step^steps and (1 + step + ... + step^(steps - 1)) held: a command held over some steps."""
    free, forced = np.eye(12), np.zeros((12, 6))
    for bit in f"{steps:b}":
        free, forced = free @ free, free @ forced + forced
        if bit == "1":
            free, forced = step @ free, step @ forced + held
    return free, forced


def _fields(values: Mapping[str, Any]) -> SimpleNamespace:
    """Values by attribute, tuples as arrays."""
    return SimpleNamespace(**{name: np.array(x) if isinstance(x, tuple) else x for name, x in values.items()})
