"""The vehicle at rest against the wall and its law, linearised numerically about the rest."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..control.base import SteadyState
from ..control.model import coefficients, model_wrenches
from ..control.task import tracking_errors
from ..physics.fossen import coriolis_added_mass, coriolis_rigid_body, damping, restoring
from ..physics.frames import quat_turned, rotation_matrix, to_body
from ..physics.kernels import record_of
from ..stages.signals import record_dtype
from .base import Setup

SMALL = np.concatenate([np.full(12, 1e-6), np.full(6, 1e-4)])
"""Differences of the measurements (18,): position, attitude, velocity [SI]; force and moment [N, N m]."""


class RestingVehicle:
    """The vehicle about its rest. Its state (12,) is position in W, rotation vector from the attitude at rest in B, and
    nu in B."""

    def __init__(self, setup: Setup, rest: SteadyState) -> None:
        self.setup, self.rest = setup, rest
        self.position, self.quat, self.tau = (np.asarray(each) for each in (rest.position, rest.quat, rest.tau))
        self.R_WB = rotation_matrix(self.quat)
        zero = np.zeros(12)
        self.acceleration_by_state = jacobian(lambda x: self.acceleration(x, self.tau), zero, np.full(12, 1e-6))
        self.acceleration_by_thrust = np.linalg.inv(setup.vehicle.M)
        self.contact_by_state = jacobian(self.contact, zero, np.full(12, 1e-7))

    def pose(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) and R_WB (3, 3)."""
        return self.position + x[:3], rotation_matrix(quat_turned(self.quat, x[3:6]))

    def push(self, x: np.ndarray) -> float:
        """Pushing force on the wall [N], zero for a vehicle that rests away from it."""
        if not self.rest.force:
            return 0.0
        (position, R_WB), wall = self.pose(x), self.setup.scenario.wall
        return wall.stiffness * (position[0] - wall.position) + wall.damping * float(R_WB[0] @ x[6:9])

    def contact(self, x: np.ndarray) -> np.ndarray:
        """Contact wrench (6,) in B at its origin, eq. (34)."""
        return np.concatenate([-self.push(x) * self.pose(x)[1][0], np.zeros(3)])

    def acceleration(self, x: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """nu_dot (6,) by eq. (10), with a constant current in W."""
        vehicle, scenario, nu = self.setup.vehicle, self.setup.scenario, x[6:]
        _, R_WB = self.pose(x)
        nu_c, nu_c_dot, term = np.zeros(6), np.zeros(6), np.empty(6)
        to_body(R_WB, scenario.current.velocity_W, nu_c)
        nu_c_dot[:3] = -np.cross(nu[3:], nu_c[:3])
        nu_r = nu - nu_c
        force = tau + self.contact(x) + np.array(scenario.disturbance.bias)
        for coriolis, M in ((coriolis_rigid_body, vehicle.M_RB), (coriolis_added_mass, vehicle.M_A)):
            coriolis(M, nu_r, term)
            force -= term
        damping(vehicle.D_linear, vehicle.D_quadratic, nu_r, term)
        force -= term
        weights = vehicle.mass, vehicle.displaced_mass, vehicle.r_g, vehicle.r_b
        restoring(*weights, self.setup.gravity_W, R_WB, term)
        return np.linalg.solve(vehicle.M, force - term) + nu_c_dot


class RestingLaw:
    """The law about the rest, as plain Python.

    It gives tau_cmd (6,) and the rates of its states, from the states and from the measurements (18,): position in W,
    rotation vector in B, nu and tau_c, as differences from the rest.
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
        delivered = setup.vehicle.B @ np.linalg.pinv(setup.nominal.B)
        wanted = np.concatenate([np.linalg.solve(delivered, tau), np.zeros(len(states))])
        for _ in range(5):
            by_state = jacobian(lambda xs: self(np.zeros(18), xs), states, small)
            if not np.isfinite(by_state).all():
                return states, False
            states = states - np.linalg.lstsq(by_state, self(np.zeros(18), states) - wanted, rcond=None)[0]
        missing = np.abs(self(np.zeros(18), states) - wanted).max()
        return states, bool(missing <= 1e-6 * max(1.0, np.abs(wanted).max()))

    def __call__(self, y: np.ndarray, states: np.ndarray) -> np.ndarray:
        """tau_cmd and the rates of the states (6 + n,); NaN if the law sets a state itself."""
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
            out = self.tau_cmd if stage is self.controller else signals
            type(stage).function()(settings, record_of(state), signals, record_of(state_dot), out)
            own = state.view("f8")[:size] == states[first : first + size]
            rates.append(np.where(own, state_dot.view("f8")[:size], np.nan))
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

        found, wider = jacobian(response, start, small), jacobian(response, start, 100.0 * small)
        scale = np.abs(found).max(axis=1, keepdims=True)
        if not np.isfinite(found).all() or (np.abs(found - wider) > 1e-2 * np.maximum(scale, 1e-6 * scale.max())).any():
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
