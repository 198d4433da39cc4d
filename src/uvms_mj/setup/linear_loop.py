r"""White noise of the sensors, and waves, in the closed loop at rest against the wall: standard deviations of push,
pose and thrust.

Vehicle and law are linearised numerically about the rest, where the sampled loop is linear if the law is smooth there.
Its state z has the vehicle (12,), the states of the law, the samples that the channels remember, and held commands.
With the semi-implicit Euler step of the engines and the noise n_k of the samples of step k,

.. math::

    z_{k+1} = A_k z_k + G_k n_k, \qquad P_{k+1} = A_k P_k A_k^\top + G_k G_k^\top,

where A_k and G_k repeat after N steps, the least common multiple of all periods. The covariance that repeats with them
solves the discrete Lyapunov equation :math:`P = \Phi P \Phi^\top + Q` with :math:`\Phi = A_{N-1} \cdots A_0` and the
noise of N steps, Q. Variances are means over the N steps. A sample that is d steps late is one that its channel
remembers. The noise is taken as Gaussian, and a channel as linear: nothing is lost, limited or quantised.

The sea adds a wrench, B tau_k, to the same loop: of the vehicle held at its rest (:mod:`..control.theory.waves`), with
the variance :math:`S(\omega)` at each frequency. A wrench :math:`e^{i \omega k h}` has the periodic answer
:math:`z_k = \zeta_k e^{i \omega k h}`, where :math:`\zeta` repeats after N steps,

.. math::

    (e^{i \omega N h} - \Phi)\, z_0 = \sum_{k < N} A_{N-1} \cdots A_{k+1} B e^{i \omega k h},

which is exact for the sampled loop, and :math:`z_k` adds the variance :math:`z_k S z_k^H`. The drag with \|u\| u is in
S, and so the answer is linear in what the loop does with the wrench alone. The pressure of the waves in a measured
depth is a seventh part of S, which enters where the depth is sampled.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from ..control.base import SteadyState
from ..control.model import coefficients, model_wrenches
from ..control.task import tracking_errors
from ..control.theory.loop import Line
from ..control.theory.own_effects import OwnEffects
from ..control.theory.predictions import steady_state
from ..control.theory.terms import ContactSprings
from ..control.theory.waves import sea_spectrum
from ..navigation import Perfect
from ..navigation.channel import Channel
from ..physics.effects import add_effects
from ..physics.fossen import coriolis_added_mass, coriolis_rigid_body, damping, restoring
from ..physics.frames import quat_turned, rotation_matrix, to_body
from ..physics.kernels import record_of
from ..physics.spanned_axes import pseudoinverse
from ..stages.signals import record_dtype
from .base import Setup, set_up

SMALL = np.concatenate([np.full(12, 1e-6), np.full(6, 1e-4)])
"""Differences of the measurements (18,): position, attitude, velocity [SI]; force and moment [N, N m]."""


class RestingVehicle:
    """The vehicle about its rest. Its state (12,) is position in W, rotation vector from the attitude at rest in B, and
    nu in B."""

    def __init__(self, setup: Setup, rest: SteadyState) -> None:
        self.setup, self.rest = setup, rest
        self.effects, self.water = record_of(setup.effects), setup.mean_water
        self.own_effects, self.springs = OwnEffects(setup.scenario.effects, setup), ContactSprings(setup)
        self.position, self.quat, self.tau = (np.asarray(each) for each in (rest.position, rest.quat, rest.tau))
        self.R_WB = rotation_matrix(self.quat)
        zero = np.zeros(12)
        _, self.pushes, depths = self.springs.wrenches(self.position[None], self.R_WB[None])  # (n,) at rest
        small = min(1e-6, 0.25 * depths[depths > 0.0].min(initial=math.inf))  # a contact stays one
        self.acceleration_by_state = jacobian(lambda x: self.acceleration(x, self.tau), zero, np.full(12, small))
        self.acceleration_by_thrust = np.linalg.inv(setup.vehicle.M)
        self.contact_by_state = jacobian(self.contact, zero, np.full(12, 0.1 * small))
        self.pushes_by_state = jacobian(lambda x: self.pressed(x)[1], zero, np.full(12, 0.1 * small))

    def pose(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) and R_WB (3, 3)."""
        return self.position + x[:3], rotation_matrix(quat_turned(self.quat, x[3:6]))

    def pressed(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Contact wrench (6,) in B at its origin, eq. (34), and the normal force (n,) of each contact [N]."""
        position, R_WB = self.pose(x)
        wrenches, push, _ = self.springs.wrenches(position[None], R_WB[None], x[6:])
        return wrenches.sum(axis=0), push

    def touches_within(self, reach: np.ndarray) -> bool:
        """Whether a contact without a force at rest has one at a corner of the box with the half edges ``reach`` (6,),
        of positions and rotation vectors."""
        corners = [
            self.pose(np.concatenate([sign * reach, np.zeros(6)])) for sign in itertools.product((-1, 1), repeat=6)
        ]
        p, R = (np.array(each)[:, None] for each in zip(*corners, strict=True))
        return bool(self.springs.wrenches(p, R)[1][:, self.pushes == 0.0].any())

    def contact(self, x: np.ndarray) -> np.ndarray:
        """Contact wrench (6,) in B at its origin."""
        return self.pressed(x)[0]

    def acceleration(self, x: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """nu_dot (6,) by eq. (10), with a constant current in W and the effects of the water."""
        vehicle, nu = self.setup.vehicle, x[6:]
        position, R_WB = self.pose(x)
        nu_c, nu_c_dot, term = np.zeros(6), np.zeros(6), np.empty(6)
        v_c_W = self.water.flow(position)
        to_body(R_WB, v_c_W, nu_c)
        nu_c_dot[:3] = -np.cross(nu[3:], nu_c[:3])
        nu_r = nu - nu_c
        force = tau + self.contact(x) + self.water.push + self.water.pull(position, R_WB)
        for coriolis, M in ((coriolis_rigid_body, vehicle.M_RB), (coriolis_added_mass, vehicle.M_A)):
            coriolis(M, nu_r, term)
            force -= term
        damping(vehicle.D_linear, vehicle.D_quadratic, nu_r, term)
        force -= term
        add_effects(self.effects, nu_r, force)
        quat = quat_turned(self.quat, x[3:6])
        force += self.own_effects.wrench(position, quat, R_WB, nu, nu_r, v_c_W, lambda: self.contact(x))
        weights = vehicle.mass, vehicle.displaced_mass, vehicle.r_g, vehicle.r_b
        restoring(*weights, self.setup.gravity_W, R_WB, term)
        return np.linalg.solve(vehicle.M, force - term) + nu_c_dot


class RestingLaw:
    """The law about the rest, as plain Python.

    It gives tau_cmd (6,) and the rates of its states, from the states and from the measurements (18,): position in W,
    rotation vector in B, nu and tau_c, as differences from the rest. Where the law sets a state itself, its rate is the
    mean one until the next instant.
    """

    def __init__(self, setup: Setup, rest: SteadyState, known: Any) -> None:
        scenario = setup.scenario
        self.known, self.controller, self.task = known, scenario.controller, scenario.task
        self.model = SimpleNamespace(**coefficients(setup.nominal, setup.gravity_W, scenario.estimates))
        self.signals = record_of(np.zeros(1, record_dtype(type(self.controller).given())))
        design, impedance = setup.design, scenario.impedance
        constants = {"M_hat": design.M_hat, "M_d": design.M_d, "D_d": design.D_d, "K_d": impedance.K_d}
        K_f, F_d = impedance.at_end
        constants |= {"K_f": K_f, "F_d": F_d, "quat_d": design.quat_d, "t": scenario.simulation.duration}
        constants |= {"p_d": setup.rest_pose[0]}
        constants |= {"period": scenario.control_period, "instant": 1}
        for name, value in constants.items():
            self.signals[name] = value
        self.stages = [self.task, self.controller] if type(self.controller).uses_task else [self.controller]
        self.settings = [record_of(stage.record(setup)) for stage in self.stages]
        self.sizes = [type(stage).state_size() for stage in self.stages]
        self.tau_cmd = np.zeros(6)
        self.at_rest, self.known_rest = self._settled(setup, np.asarray(rest.tau))

    def _settled(self, setup: Setup, tau: np.ndarray) -> tuple[np.ndarray, bool]:
        """The states (n,) with which the law holds the vehicle at rest, and whether they do."""
        states, small = np.zeros(sum(self.sizes)), np.full(sum(self.sizes), 1e-6)
        delivered = setup.vehicle.B @ pseudoinverse(setup.nominal.B)
        wanted = np.concatenate([np.linalg.solve(delivered, tau), np.zeros(len(states))])
        for _ in range(5):
            by_state = jacobian(lambda xs: self(np.zeros(18), xs), states, small)
            if not np.isfinite(by_state).all():
                return states, False
            states = states - np.linalg.lstsq(by_state, self(np.zeros(18), states) - wanted, rcond=None)[0]
        missing = np.abs(self(np.zeros(18), states) - wanted).max()
        return states, bool(missing <= 1e-6 * max(1.0, np.abs(wanted).max()))

    def __call__(self, y: np.ndarray, states: np.ndarray) -> np.ndarray:
        """tau_cmd and the rates of the states (6 + n,); NaN if the law keeps other numbers."""
        signals, known = self.signals, self.known
        signals["p_WB"], signals["quat_WB"] = known.position + y[:3], quat_turned(known.quat, y[3:6])
        signals["R_WB"], signals["nu"] = rotation_matrix(signals.quat_WB), known.nu + y[6:12]
        signals["tau_contact_m_B"] = known.tau_c + y[12:]
        signals["f_contact_m_W"] = signals.R_WB @ signals.tau_contact_m_B[:3]
        tracking_errors(signals, signals)
        model, R_WB = self.model, signals.R_WB
        model_wrenches(model, model.gravity_W, R_WB, signals.nu, signals.C_hat_nu, signals.D_hat_nu, signals.g_hat)
        rates, first = [], 0
        for stage, settings, size in zip(self.stages, self.settings, self.sizes, strict=True):
            state, state_dot = type(stage).state_record(), type(stage).state_record()
            state.view("f8")[:size] = states[first : first + size]
            out, others = self.tau_cmd if stage is self.controller else signals, state.tobytes()[8 * size :]
            type(stage).function()(settings, record_of(state), signals, record_of(state_dot), out)
            moved = (state.view("f8")[:size] - states[first : first + size]) / signals.period
            kept = state.tobytes()[8 * size :] == others
            rates.append(state_dot.view("f8")[:size] + moved if kept else np.full(size, np.nan))
            first += size
        return np.concatenate([self.tau_cmd, *rates])


@dataclass(frozen=True, eq=False)
class LinearLaw:
    """tau_cmd and the rates of the states (6 + n,) from the measurements (6 + n, 18) and the states (6 + n, n)."""

    law: RestingLaw
    by_measurement: np.ndarray
    by_state: np.ndarray

    @classmethod
    def of(cls, law: RestingLaw) -> "LinearLaw | None":
        """The law's derivatives at the rest; None if it is not smooth there."""
        n = len(law.at_rest)
        start, small = np.concatenate([np.zeros(18), law.at_rest]), np.concatenate([SMALL, np.full(n, 1e-6)])

        def response(x: np.ndarray) -> np.ndarray:
            return law(x[:18], x[18:])

        both = [(response(start + e), response(start - e), e.max()) for e in np.diag(small)]
        found = np.array([(more - less) / (2.0 * e) for more, less, e in both]).T
        wider, here = jacobian(response, start, 100.0 * small), response(start)
        kinks = np.array([(more + less - 2.0 * here) / e for more, less, e in both]).T
        scale = np.abs(found).max(axis=1, keepdims=True)
        most = 1e-2 * np.maximum(scale, 1e-6 * scale.max())
        if not np.isfinite(found).all() or (np.abs(found - wider) > most).any() or (np.abs(kinks) > most).any():
            return None
        return cls(law, found[:, :18], found[:, 18:])

    def is_linear_over(self, y: np.ndarray, states: np.ndarray) -> bool:
        """Whether tau_cmd and the rates change in proportion up to the differences y (18,) and states (n,)."""
        both, reach = np.hstack([self.by_measurement, self.by_state]), np.concatenate([y, states])
        start, n = np.concatenate([np.zeros(18), self.law.at_rest]), 18
        rounding = 1e-6 * np.abs(both * reach).max(initial=0.0)
        for i in np.flatnonzero(reach):
            step = np.zeros(len(reach))
            step[i] = reach[i]
            far = [self.law((start + sign * step)[:n], (start + sign * step)[n:]) for sign in (1.0, -1.0)]
            expected = both[:, i] * reach[i]
            if not np.abs(0.5 * (far[0] - far[1]) - expected).max() <= 0.03 * np.abs(expected).max() + rounding:
                return False
        return True


def jacobian(function: Any, x: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Derivatives (m, n) by central differences with the steps (n,)."""
    if not len(x):
        return np.zeros((len(function(x)), 0))
    return np.array([(function(x + e) - function(x - e)) / (2.0 * e.max()) for e in np.diag(steps)]).T


MOST_STEPS, MOST_STATES = 20_000, 600
"""Limits of a closed form: steps of the common period, and numbers of the state."""
_PLACES = ("position", "attitude", "velocity", "angular_velocity", "force", "moment")
_WIDTHS = (3, 3, 3, 3, 3, 3, 6)
"""Numbers of a sample of each channel, and of a command."""
_KNOWN_OF_CHANNELS = ("period", "delay", "noise", "bias", "scale")
_KNOWN_STAGES = ("navigation", "reference", "task", "controller", "actuation")
_REACH = 3.0
"""Standard deviations over which the law has to be linear and the thrusters must not saturate."""
_ROUNDING = 1e-10
"""Rounding of an eigenvalue of the loop."""
_CLEAR = 4.0
"""Standard deviations of the push from losing contact, or of the position from making it."""
_CLEAR_OF_SINES = 2.0
"""The same in a regular wave: its amplitude has 2^(1/2) of them, and the rest is for harmonics and drift."""


@dataclass(frozen=True, eq=False)
class Deviations:
    """Standard deviations by white noise and waves: push [N], position (3,) in W [m], attitude (3,) as a rotation
    vector in B [rad], nu (6,) and tau (6,) in B. ``slowest`` is the loop's longest time constant [s]."""

    push: float
    position: np.ndarray
    attitude: np.ndarray
    nu: np.ndarray
    tau: np.ndarray
    slowest: float


def deviations(setup: Setup) -> Deviations | str | None:
    """The standard deviations of a run at its rest, the reason why there is no closed form, or None without noise and
    waves."""
    scenario = setup.scenario
    perfect = type(scenario.navigation) is Perfect
    channels = dict.fromkeys(_PLACES, Channel()) if perfect else scenario.navigation.white_channels
    waves = scenario.sea.moves
    if not waves and not any(any(channel.noise) for channel in channels.values()):
        return None
    if setup.not_rigid:
        return f"the deviation is known for a rigid vehicle at B, and {setup.not_rigid}"
    calm = set_up(dataclasses.replace(scenario, sea=scenario.sea.at_rest), setup.plant.mjcf) if waves else setup
    if reason := _unknown(calm, channels) or OwnEffects(scenario.effects, setup).unknown():
        return reason
    if waves and scenario.effects:
        return f"the waves' way through the effect {scenario.effects[0].label()} is not known"
    rest = steady_state(calm)
    if not isinstance(rest, SteadyState) or rest.tau is None:
        return getattr(rest, "reason", "the law's theory gives no whole state at rest")
    vehicle, known = RestingVehicle(calm, rest), scenario.navigation.rest_errors(calm)
    assert not isinstance(known, str)  # the rest is known
    at_rest = known(vehicle.position, vehicle.quat, vehicle.contact(np.zeros(12)))
    law, label = LinearLaw.of(RestingLaw(calm, rest, at_rest)), scenario.controller.label()
    if law is None:
        return f"{label} is not smooth at its rest"
    if not law.law.known_rest:
        return f"the states of {label} at rest are not known"
    loop = _Loop(calm, vehicle, law, channels)
    if loop.steps > MOST_STEPS or loop.size > MOST_STATES:
        return "the periods have too large a common multiple, or too many samples are on their way"
    if not waves:
        return loop.solve(None)
    return loop.solve(
        sea_spectrum(setup, vehicle.position, vehicle.R_WB, calm.mean_water.flow), scenario.sea.spectrum == "regular"
    )


def _unknown(setup: Setup, channels: Mapping[str, Channel]) -> str:
    """The parts of a scenario that the closed form does not know; empty if none."""
    scenario = setup.scenario
    if not channels or not scenario.navigation.is_shipped:
        return f"the way through {scenario.navigation.label()} is not known"
    others = [stage.label() for stage in scenario.stages if stage.runs and stage.room.table not in _KNOWN_STAGES]
    if others:
        return f"the noise's way through {others[0]} is not known"
    if scenario.actuation.label() != "pseudo_inverse":
        return f"the noise's way through {scenario.actuation.label()} is not known"
    if scenario.controller.uses_truth:
        return "the law is told the truth"
    if names := scenario.with_inertia:
        return f"the inertia of {', '.join(names)} is not in it"
    for pair in setup.contacts.springs:
        if not setup.contacts.carriers[pair.carrier].is_B:
            return f"the noise is known for contacts in B's frame, and {pair.body_key} has a frame of its own"
        if pair.bumper[0] or pair.wall.layer_depth is not None or pair.wall.moves:
            return f"the noise is known for rigid bodies on walls of one layer that stand, not for {pair.wall_key}"
    if getattr(scenario.navigation, "mass_behind", 0.0):
        return "the force sensor sees an acceleration: navigation.mass_behind"
    for quantity, channel in channels.items():
        for each in dataclasses.fields(Channel):
            if each.name not in _KNOWN_OF_CHANNELS and getattr(channel, each.name) != each.default:
                return f"it is known for white noise with a constant delay only: navigation.{quantity}_{each.name}"
    return ""


class _Loop:
    """The linear sampled loop. The channels have their samples and the stages their periods as in a run.

    A vector that is linear in the loop's state z, in the noise n of the step and in a wrench on the vehicle is a matrix
    [by state, by noise, by wrench] with ``size`` + 18 + 6 columns."""

    def __init__(self, setup: Setup, vehicle: RestingVehicle, law: LinearLaw, channels: Mapping[str, Channel]) -> None:
        self.setup, self.vehicle, self.law, self.h = setup, vehicle, law, setup.scenario.simulation.timestep
        scenario, h = setup.scenario, self.h
        control = round(scenario.control_period / h)
        self.actuation = round((scenario.actuation.period or h) / h)
        step = scenario.navigation.period or h
        self.channels = [channels[name] for name in _PLACES]
        timings = [(round((each.period or step) / h), round(each.delay / h)) for each in self.channels]
        timings.append((control, round((scenario.controller.delay or 0.0) / h)))
        self.control, self.steps = control, math.lcm(self.actuation, *(period for period, _ in timings))
        k = np.arange(min(self.steps, MOST_STEPS))
        self.lines = [Line(len(k), k, (k - delay) // period * period, k) for period, delay in timings]
        samples = [width * line.kept for width, line in zip(_WIDTHS, self.lines, strict=True)]
        sizes = [12, len(law.law.at_rest), *samples, 6]
        ends = np.cumsum(sizes)
        self.places = [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)]
        self.size = int(ends[-1])
        # the thrusters of the file, and the true ones
        self.delivered = vehicle.acceleration_by_thrust @ setup.vehicle.B @ pseudoinverse(setup.nominal.B)
        self.sensed = self._sensed()
        self.sigmas = np.diag(np.concatenate([each.noise for each in self.channels]))

    def _sensed(self) -> np.ndarray:
        """Measurements (18, 12) of the vehicle's state, without noise."""
        found = np.zeros((18, 12))
        found[:12] = np.eye(12)
        found[3:6, 3:6] = rotation_matrix(self.law.law.known.quat).T @ self.vehicle.R_WB
        found[12:] = self.vehicle.contact_by_state
        found[12:15, 2] -= getattr(self.setup.scenario.navigation, "depth_drift", (0.0, 0.0, 0.0))
        return np.repeat([1.0 + each.scale for each in self.channels], 3)[:, None] * found

    def at(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The state after step k, the measurements (18,) and the thrust (6,) in it."""
        z = np.eye(self.size, self.size + 25)
        x, states, *registers, u = (z[place] for place in self.places)
        now = self.sensed @ x
        now[:, self.size : self.size + 18] = self.sigmas
        if getattr(self.setup.scenario.navigation, "pressure_depth", False):
            now[2, -1] = -(1.0 + self.channels[0].scale)
        waiting = [[old[i : i + w] for i in range(0, len(old), w)] for old, w in zip(registers, _WIDTHS, strict=True)]

        def arrived(which: int, fresh: np.ndarray) -> np.ndarray:
            """The sample that is read at step k, of the waiting samples and the sample of step k."""
            line, samples = self.lines[which], waiting[which]
            if line.taken[k]:
                samples.insert(0, fresh)
            return samples[line.newer[k]]

        y = np.vstack([arrived(i, now[3 * i : 3 * i + 3]) for i in range(6)])
        response = self.law.by_measurement @ y + self.law.by_state @ states
        commanded = arrived(6, response[:6])
        kept = [sample for line, samples in zip(self.lines, waiting, strict=True) for sample in samples[: line.kept]]
        if k % self.control == 0:
            states = states + self.h * self.control * response[6:]
        u = commanded if k % self.actuation == 0 else u
        nu = x[6:] + self.h * (self.vehicle.acceleration_by_state @ x + self.delivered @ u)
        nu[:, -7:-1] += self.h * self.vehicle.acceleration_by_thrust
        moved = self.h * np.block([[self.vehicle.R_WB, np.zeros((3, 3))], [np.zeros((3, 3)), np.eye(3)]]) @ nu
        return np.vstack([x[:6] + moved, nu, states, *kept, u]), y, u

    def solve(self, sea: tuple[np.ndarray, np.ndarray] | None, regular: bool = False) -> Deviations | str:
        """The covariance that repeats, and the deviations from it, with the spectrum of a wrench of the sea, which may
        be of a regular wave."""
        found = [[np.hsplit(each, [self.size, self.size + 18]) for each in self.at(k)] for k in range(self.steps)]
        phi, Q = np.eye(self.size), np.zeros((self.size, self.size))
        for (A, G, _), _, _ in found:
            phi = A @ phi
            Q = A @ Q @ A.T + G @ G.T
        largest = float(np.abs(np.linalg.eigvals(phi)).max())
        if largest > 1.0 + _ROUNDING:
            return "with these sensors the loop is unstable about its rest"
        if largest > 1.0 - _ROUNDING:
            return "a state of the law neither decays nor grows about the rest"
        noisy = bool(Q.any())
        P = solve_discrete_lyapunov(phi, Q) if noisy else Q
        sums: dict[str, Any] = {"x": np.zeros((12, 12)), "y": 0.0, "u": 0.0, "states": 0.0}

        def add(P: np.ndarray, outputs: Any) -> None:
            """Add the variances by the covariance P of the state."""
            sums["x"] += P[:12, :12]
            sums["states"] += np.diag(P)[self.places[1]]
            for name, (by_state, _, _) in zip("yu", outputs, strict=True):
                sums[name] += np.diag(by_state @ P @ by_state.T)

        for (A, G, _), *outputs in found:
            add(P, outputs)
            for name, (_, by_noise, _) in zip("yu", outputs, strict=True):
                sums[name] += np.diag(by_noise @ by_noise.T)
            P = A @ P @ A.T + G @ G.T
        if sea is not None:
            seen = np.eye(self.places[1].stop, self.size + 7)  # the vehicle and the states of the law
            rows = [np.vstack([seen, *(np.hstack([each[0], each[2]]) for each in outputs)]) for _, *outputs in found]
            for P in self._answers(*sea, found, phi, rows):
                _, states, y, u = np.split(np.diag(P), np.cumsum([12, len(self.law.law.at_rest), 18]))
                for name, part in (("x", P[:12, :12]), ("y", y), ("u", u), ("states", states)):
                    sums[name] += part
        return self._checked({name: each / self.steps for name, each in sums.items()}, largest, regular and not noisy)

    def _answers(
        self, omega: np.ndarray, spectrum: np.ndarray, found: Any, phi: np.ndarray, rows: Sequence[np.ndarray]
    ) -> Iterator[np.ndarray]:
        """The covariance (r, r) at each of the N steps of what the rows (r, n + 7) of the step make of the state before
        it and of the sea, by wrenches on the vehicle and heads at its sensor that have the variance (m, 7, 7) at the
        angular frequencies (m,)."""
        m, sea = len(omega), np.eye(7)[:, None]
        turned = np.exp(1j * self.h * np.arange(self.steps + 1)[:, None, None] * omega[:, None])  # (N + 1, m, 1)

        def times(A: np.ndarray, z: np.ndarray) -> np.ndarray:
            """A real matrix (r, n) times z (n, m, 7)."""
            return (A @ z.view(float).reshape(len(z), -1)).view(complex).reshape(len(A), m, 7)

        def after(k: int, z: np.ndarray) -> np.ndarray:
            (A, _, by_wrench), _, _ = found[k]
            return times(A, z) + by_wrench[:, None] * turned[k]

        z = np.zeros((self.size, m, 7), complex)
        for k in range(self.steps):
            z = after(k, z)
        z = np.linalg.solve(turned[-1, :, :, None] * np.eye(self.size) - phi, z.swapaxes(0, 1)).swapaxes(0, 1).copy()
        for k, of_step in enumerate(rows):
            w = times(of_step, np.concatenate([z, sea * turned[k]]))
            by_sea = np.ascontiguousarray((w.swapaxes(0, 1) @ spectrum).swapaxes(0, 1))
            # the real part of a product with a conjugate is the product of real and imaginary parts
            yield by_sea.view(float).reshape(len(w), -1) @ w.view(float).reshape(len(w), -1).T
            z = after(k, z)

    def _checked(self, means: Mapping[str, Any], largest: float, sines: bool) -> Deviations | str:
        """The deviations, or the reason why the loop is not linear over them. ``sines``: nothing but a regular wave
        causes them."""
        by_state, pushes = self.vehicle.pushes_by_state, self.vehicle.pushes
        both = by_state.sum(axis=0)
        push, x = math.sqrt(max(0.0, both @ means["x"] @ both)), np.sqrt(np.maximum(np.diag(means["x"]), 0.0))
        spreads = np.sqrt(np.maximum(np.diag(by_state @ means["x"] @ by_state.T), 0.0))  # of each contact
        y, states, tau = (np.sqrt(np.maximum(means[name], 0.0)) for name in ("y", "states", "u"))
        label, clear = self.setup.scenario.controller.label(), _CLEAR_OF_SINES if sines else _CLEAR
        if not self.law.is_linear_over(_REACH * y, _REACH * states):
            return f"{label} is not linear over {_REACH:g} standard deviations of its measurements"
        for force, spread in zip(pushes, spreads, strict=True):
            if 0.0 < force < clear * spread:
                return f"the push of {force:.4g} N would lose contact at times: its deviation would be {spread:.3g} N"
        if self.vehicle.touches_within(clear * x[:6]):
            return "the vehicle would touch the wall at times"
        allocate = pseudoinverse(self.setup.nominal.B)
        u, spread = allocate @ self.vehicle.tau, np.abs(allocate) @ (_REACH * tau)
        if (u - spread < self.setup.vehicle.u_min).any() or (u + spread > self.setup.vehicle.u_max).any():
            return "a thruster would saturate at times"
        slowest = -self.h * self.steps / math.log(largest) if largest > 0.0 else self.h * self.steps
        return Deviations(push, x[:3], x[3:6], x[6:], tau, slowest)
