r"""White noise of the sensors in the closed loop: standard deviations of push, pose and thrust in closed form.

About the rest, the sampled loop is linear if the law is smooth there. Its state z has the vehicle (12,), the states of
the law, the samples that the channels remember, and held commands. With the semi-implicit Euler step of the engines and
the noise n_k of the samples of step k,

.. math::

    z_{k+1} = A_k z_k + G_k n_k, \qquad P_{k+1} = A_k P_k A_k^\top + G_k G_k^\top,

where A_k and G_k repeat after N steps, the least common multiple of all periods. The covariance that repeats with them
solves the discrete Lyapunov equation :math:`P = \Phi P \Phi^\top + Q` with :math:`\Phi = A_{N-1} \cdots A_0` and the
noise of N steps, Q. Variances are means over the N steps. A sample that is d steps late is one that its channel
remembers. The noise is taken as Gaussian, and a channel as linear: nothing is lost, limited or quantised.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from ..control.base import SteadyState
from ..control.theory.loop import Line
from ..control.theory.predictions import steady_state
from ..navigation.channel import Channel
from ..physics.frames import rotation_matrix
from .base import Setup
from .linear_loop import LinearLaw, RestingLaw, RestingVehicle, jacobian

MOST_STEPS, MOST_STATES = 20_000, 600
"""Limits of a closed form: steps of the common period, and numbers of the state."""
_PLACES = ("position", "attitude", "velocity", "angular_velocity", "force", "moment")
_WIDTHS = (3, 3, 3, 3, 3, 3, 6)
"""Numbers of a sample of each channel, and of a command."""
_KNOWN_STAGES = ("navigation", "reference", "task", "controller", "actuation")
_REACH = 3.0
"""Standard deviations over which the law has to be linear and the thrusters must not saturate."""
_ROUNDING = 1e-10
"""Rounding of an eigenvalue of the loop."""
_CLEAR = 4.0
"""Standard deviations of the push from losing contact, or of the position from making it."""


@dataclass(frozen=True, eq=False)
class Deviations:
    """Standard deviations by white noise: push [N], position (3,) in W [m], attitude (3,) as a rotation vector in B
    [rad], nu (6,) and tau (6,) in B. ``slowest`` is the loop's longest time constant [s]."""

    push: float
    position: np.ndarray
    attitude: np.ndarray
    nu: np.ndarray
    tau: np.ndarray
    slowest: float


def deviations(setup: Setup) -> Deviations | str | None:
    """The standard deviations of a run at its rest, the reason why there is no closed form, or None without noise."""
    channels = setup.scenario.navigation.white_channels
    if not any(any(channel.noise) for channel in channels.values()):
        return None
    if setup.not_rigid:
        return f"the noise is known for a rigid vehicle at B, and {setup.not_rigid}"
    if reason := _unknown(setup, channels):
        return reason
    rest = steady_state(setup)
    if not isinstance(rest, SteadyState) or rest.tau is None:
        return getattr(rest, "reason", "the law's theory gives no whole state at rest")
    vehicle, known = RestingVehicle(setup, rest), setup.scenario.navigation.rest_errors(setup)
    assert not isinstance(known, str)  # the rest is known
    at_rest = known(vehicle.position, vehicle.quat, vehicle.contact(np.zeros(12)))
    law, label = LinearLaw.of(RestingLaw(setup, rest, at_rest)), setup.scenario.controller.label()
    if law is None:
        return f"{label} is not smooth at its rest"
    if not law.law.known_rest:
        return f"the states of {label} at rest are not known"
    loop = _Loop(setup, vehicle, law, channels)
    if loop.steps > MOST_STEPS or loop.size > MOST_STATES:
        return "the periods have too large a common multiple, or too many samples are on their way"
    return loop.solve()


def _unknown(setup: Setup, channels: Mapping[str, Channel]) -> str:
    """What of a scenario the closed form does not know; empty if nothing."""
    scenario = setup.scenario
    others = [stage.label() for stage in scenario.stages if stage.runs and stage.room.table not in _KNOWN_STAGES]
    if others:
        return f"the noise's way through {others[0]} is not known"
    if scenario.actuation.label() != "pseudo_inverse":
        return f"the noise's way through {scenario.actuation.label()} is not known"
    if scenario.controller.uses_truth:
        return "the law is told the truth"
    if setup.contacts.pairs:
        return "it is known for the probe and [wall] alone"
    if getattr(scenario.navigation, "mass_behind", 0.0):
        return "the force sensor sees an acceleration: navigation.mass_behind"
    for quantity, channel in channels.items():
        for name in ("walk", "jitter", "dropout", "quantum"):
            if np.any(getattr(channel, name)):
                return f"it is known for white noise with a constant delay only: navigation.{quantity}_{name}"
    return ""


class _Loop:
    """The linear sampled loop. The channels have their samples and the stages their periods as in a run.

    A vector that is linear in the loop's state z and in the noise n of the step is a matrix [by state, by noise] with
    ``size`` + 18 columns."""

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
        self.delivered = vehicle.acceleration_by_thrust @ setup.vehicle.B @ np.linalg.pinv(setup.nominal.B)
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
        z = np.eye(self.size, self.size + 18)
        x, states, *registers, u = (z[place] for place in self.places)
        now = self.sensed @ x
        now[:, self.size :] = self.sigmas
        waiting = [[old[i : i + w] for i in range(0, len(old), w)] for old, w in zip(registers, _WIDTHS, strict=True)]

        def arrived(which: int, fresh: np.ndarray) -> np.ndarray:
            """The sample that is read at step k, of those that wait and the one of step k."""
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
        moved = self.h * np.block([[self.vehicle.R_WB, np.zeros((3, 3))], [np.zeros((3, 3)), np.eye(3)]]) @ nu
        return np.vstack([x[:6] + moved, nu, states, *kept, u]), y, u

    def solve(self) -> Deviations | str:
        """The covariance that repeats, and the deviations from it."""
        found = [[np.hsplit(each, [self.size]) for each in self.at(k)] for k in range(self.steps)]
        phi, Q = np.eye(self.size), np.zeros((self.size, self.size))
        for (A, G), _, _ in found:
            phi = A @ phi
            Q = A @ Q @ A.T + G @ G.T
        largest = float(np.abs(np.linalg.eigvals(phi)).max())
        if largest > 1.0 + _ROUNDING:
            return "with these sensors the loop is unstable about its rest"
        if largest > 1.0 - _ROUNDING:
            return "a state of the law neither decays nor grows about the rest"
        P = solve_discrete_lyapunov(phi, Q)
        sums: dict[str, Any] = {"x": np.zeros((12, 12)), "y": 0.0, "u": 0.0, "states": 0.0}
        for (A, G), y, u in found:
            sums["x"] += P[:12, :12]
            sums["states"] += np.diag(P)[self.places[1]]
            for name, (by_state, by_noise) in (("y", y), ("u", u)):
                sums[name] += np.diag(by_state @ P @ by_state.T + by_noise @ by_noise.T)
            P = A @ P @ A.T + G @ G.T
        return self._checked({name: each / self.steps for name, each in sums.items()}, largest)

    def _checked(self, means: Mapping[str, Any], largest: float) -> Deviations | str:
        """The deviations, or the reason why the loop is not linear over them."""
        by_state = jacobian(lambda x: np.array([self.vehicle.push(x)]), np.zeros(12), np.full(12, 1e-7))[0]
        push, x = math.sqrt(max(0.0, by_state @ means["x"] @ by_state)), np.sqrt(np.maximum(np.diag(means["x"]), 0.0))
        y, states, tau = (np.sqrt(np.maximum(means[name], 0.0)) for name in ("y", "states", "u"))
        rest, label = self.vehicle.rest, self.setup.scenario.controller.label()
        if not self.law.is_linear_over(_REACH * y, _REACH * states):
            return f"{label} is not linear over {_REACH:g} standard deviations of its measurements"
        if rest.force and rest.force < _CLEAR * push:
            return f"the push of {rest.force:.4g} N would lose contact at times: its deviation would be {push:.3g} N"
        if not rest.force and self.vehicle.position[0] + _CLEAR * x[0] > self.setup.scenario.wall.position:
            return "the vehicle would touch the wall at times"
        allocate = np.linalg.pinv(self.setup.nominal.B)
        u, spread = allocate @ self.vehicle.tau, np.abs(allocate) @ (_REACH * tau)
        if (u - spread < self.setup.vehicle.u_min).any() or (u + spread > self.setup.vehicle.u_max).any():
            return "a thruster would saturate at times"
        slowest = -self.h * self.steps / math.log(largest) if largest > 0.0 else self.h * self.steps
        return Deviations(push, x[:3], x[3:6], x[6:], tau, slowest)
