"""The equations of the static balance, whose terms :mod:`.balance` explains."""

import dataclasses
from typing import Any

import numpy as np

from ..physics.fossen import coriolis_added_mass, coriolis_rigid_body, damping, restoring
from ..physics.frames import quat_error, rotation_matrix
from ..physics.tether import add_tether
from .delivery import Delivery
from .springs import Springs


class Balance:
    """Residual (6,) of the balance and its terms, functions of x (6,): position minus reference in W, and the rotation
    vector from the desired attitude."""

    def __init__(self, setup: Any, K: float, in_contact: bool, delivery: Delivery, own: bool = False) -> None:
        scenario, design = setup.scenario, setup.design
        self.setup, self.K, self.in_contact, self.springs = setup, K, in_contact, Springs(setup)
        self.target = np.array(setup.rest_pose[0])
        self.tau_dist = scenario.disturbance.at_last
        self.A = np.array(setup.task.A)
        self.M_d_inv = design.M_d_inv
        self.M_hat_inv = np.linalg.inv(design.M_hat)
        self.undelivered = np.eye(6) - np.linalg.inv(delivery.T)
        self.K_f, self.F_d = (np.array(each) for each in scenario.impedance.at_end)
        self.factor_inverse = self.A / (self.A - K)
        self.told, self.own = scenario.controller.uses_truth, own
        self.errors = scenario.navigation.rest_errors(setup)
        self._at: tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]] | None = None

    def pose(self, x: np.ndarray):
        """Position, attitude and R_WB, computed once for an array, which must not change."""
        if self._at is None or self._at[0] is not x:
            self._at = x, self._pose(x)
        return self._at[1]

    def _pose(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        angle = float(np.linalg.norm(x[3:]))
        axis = x[3:] / angle if angle > 0.0 else np.zeros(3)
        turn = np.concatenate([[np.cos(angle / 2.0)], np.sin(angle / 2.0) * axis])
        quat = _product(self.setup.design.quat_d, turn)
        return self.target + x[:3], quat, rotation_matrix(quat)

    def contact(self, x: np.ndarray) -> np.ndarray:
        """tau_c (6,) in B, eq. (34)."""
        position, _, R_WB = self.pose(x)
        wall, tau_c = self.setup.scenario.wall, np.zeros(6)
        if self.in_contact:
            tau_c[:3] = -wall.stiffness * (position[0] - wall.position) * R_WB[0]
        return tau_c + self.springs.wrench(position, R_WB)[0] if len(self.springs) else tau_c

    def error(self, x: np.ndarray) -> np.ndarray:
        """eta_e (6,) as the law measures it."""
        known, quat_e = self.known(x), np.empty(4)
        quat_error(self.setup.design.quat_d, known.quat, quat_e)
        return np.concatenate([rotation_matrix(known.quat).T @ (known.position - self.target), quat_e[1:]])

    def asked(self, x: np.ndarray) -> np.ndarray:
        """w = M_d^-1 (K_d eta_e + D_d nu_e - K_f (tau_c - F_d)) as the law measures them, zero where the desired
        impedance, eq. (7), holds at rest."""
        known, design = self.known(x), self.setup.design
        forces = self.K_f * (known.tau_c - self.F_d)
        return self.M_d_inv @ (design.K_d @ self.error(x) + design.D_d @ known.nu - forces)

    def known(self, x: np.ndarray) -> Any:
        """The measurements, :class:`uvms_mj.navigation.base.Known`."""
        position, quat, _ = self.pose(x)
        tau_c = self.contact(x)
        known = self.errors(position, quat, tau_c)
        if not self.setup.scenario.observer.runs:
            return known
        explained = dataclasses.replace(known, tau_c=tau_c)
        return dataclasses.replace(known, tau_c=tau_c + self.setup.design.M_hat @ self.unknown(x, explained))

    def moving(self, x: np.ndarray) -> np.ndarray:
        """F_1 times the rate (6,) of the pose error that the law derives from a biased velocity, eq. (18)."""
        known, quat_e = self.known(x), np.empty(4)
        quat_error(self.setup.design.quat_d, known.quat, quat_e)
        v, omega = known.nu[:3], known.nu[3:]
        turning = 0.5 * (quat_e[0] * omega + np.cross(quat_e[1:], omega))
        return np.array(self.setup.task.F_1) * np.concatenate([v, turning])

    def sliding(self, x: np.ndarray) -> np.ndarray | None:
        """s (6,) at rest: A s = F_1 eta_e_dot - w. None if zeta integrates what the law does not answer to, or there is
        no task."""
        if not self.setup.scenario.controller.uses_task:
            return None
        if not (self.told or self.own):
            return (self.unknown(x) - self.moving(x)) / (self.K - self.A) + 0.0  # zero has no sign
        left = self.moving(x) - self.asked(x)
        if np.abs(left).max() < 1e-12:
            return np.zeros(6)
        return None if 0.0 in self.A else left / self.A

    def thrust(self, x: np.ndarray) -> np.ndarray:
        """tau (6,) that holds the vehicle at rest, eq. (10)."""
        d, g_eta = self.environment(x)
        return g_eta - d - self.contact(x)

    def effort(self, x: np.ndarray) -> np.ndarray:
        """tau_cmd - C_hat nu - D_hat nu - g_hat (6,) that holds the vehicle at rest."""
        return -self.known(x).tau_c - self.setup.design.M_hat @ self.unknown(x)

    def unknown(self, x: np.ndarray, known: Any = None) -> np.ndarray:
        """The acceleration (6,) that a law without an integral term must balance through s, with the measurements
        ``known``; default: those at x."""
        d, g_eta = self.environment(x)
        known = self.known(x) if known is None else known
        estimates = self.setup.scenario.estimates
        vehicle = self.setup.nominal
        nominal = self.restoring(vehicle, rotation_matrix(known.quat))
        unknown = (estimates.restoring - 1.0) * nominal + (nominal - g_eta) + (self.contact(x) - known.tau_c)
        return self.M_hat_inv @ (d + unknown + self.resistance(known.nu) + self.undelivered @ self.thrust(x))

    def resistance(self, nu: np.ndarray) -> np.ndarray:
        """C_hat nu + D_hat nu (6,) of a measured velocity."""
        vehicle, estimates = self.setup.nominal, self.setup.scenario.estimates
        total, term = np.zeros(6), np.empty(6)
        if nu.any():
            damping(vehicle.D_linear, vehicle.D_quadratic, nu, term)
            total += estimates.damping * term
            for coriolis, M in ((coriolis_added_mass, vehicle.M_A), (coriolis_rigid_body, vehicle.M_RB)):
                coriolis(M, nu, term)
                total += estimates.coriolis * term
        return total

    def __call__(self, x: np.ndarray) -> np.ndarray:
        if self.told:
            unknown = self.contact(x) - self.known(x).tau_c + self.undelivered @ self.thrust(x)
            return self.asked(x) - np.linalg.solve(self.setup.design.M, unknown)
        return self.asked(x) - (1.0 - self.factor_inverse) * self.moving(x) - self.factor_inverse * self.unknown(x)

    def environment(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """d and g(eta), (6,) each, in B."""
        vehicle, scenario = self.setup.vehicle, self.setup.scenario
        position, _, R_WB = self.pose(x)
        nu_r, term = np.zeros(6), np.empty(6)
        nu_r[:3] = -R_WB.T @ scenario.current.steady_at(-position[2])
        d = self.tau_dist.copy()
        if scenario.tether.factor:
            add_tether(scenario.tether.factor, scenario.tether.position, nu_r, d)
        coriolis_added_mass(vehicle.M_A, nu_r, term)
        d -= term
        damping(vehicle.D_linear, vehicle.D_quadratic, nu_r, term)
        d -= term
        return d, self.restoring(vehicle, R_WB)

    def restoring(self, vehicle: Any, R_WB: np.ndarray) -> np.ndarray:
        """g(eta) (6,) of a vehicle, the true one or that of the file."""
        g_eta = np.empty(6)
        restoring(vehicle.mass, vehicle.displaced_mass, vehicle.r_g, vehicle.r_b, self.setup.gravity_W, R_WB, g_eta)
        return g_eta


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Quaternion product a b."""
    (_, x, y, z), (_, i, j, k) = a.tolist(), b.tolist()
    cross = np.array([y * k - z * j, z * i - x * k, x * j - y * i])  # np.cross takes ten times as long
    w, v = a[0] * b[0] - a[1:] @ b[1:], a[0] * b[1:] + b[0] * a[1:] + cross
    return np.concatenate([[w], v])
