"""The same closed loop as a plain NumPy ``mjcb_control``, the usual way in research code. For the benchmark only."""

import time

import mujoco
import numpy as np

from uvms_mj import Gsta, Scenario
from uvms_mj.guidance import FilteredSteps
from uvms_mj.setup.base import set_up


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


class NumpyLoop:
    """GSTA on the scenario's plant, with one Python call per step."""

    def __init__(self, scenario: Scenario, warm_up_steps: int) -> None:
        setup = set_up(scenario)
        plant = setup.plant
        self.plant, self.vehicle, self.design = plant, plant.vehicle, setup.design
        self.model, self.data = plant.model, plant.initial_data(scenario.initial)
        self.touching = int(self.model.pair_geom1[0]), int(self.model.pair_geom2[0])
        self.h, self.gains = scenario.simulation.timestep, Gsta()
        self.v_c_W = np.array(scenario.current.velocity_W)
        self.M_d_inv, self.B_pinv = np.linalg.inv(self.design.M_d), np.linalg.pinv(self.vehicle.B)
        self.k_c = scenario.wall.stiffness
        reference = FilteredSteps()
        self.start, self.omega_n = np.array(scenario.initial.position), reference.bandwidth
        self.target, self.A = np.array(reference.target) - self.start, np.array(scenario.task.A)
        self.buoyancy_W = -self.vehicle.displaced_mass * self.model.opt.gravity
        self.zeta, self.z = np.zeros(6), np.zeros(6)
        self.chunk(warm_up_steps)

    def C(self, nu):
        v = self.vehicle
        a, omega, r = v.M_A @ nu, skew(nu[3:]), skew(v.r_g)
        C_A, C_RB = np.zeros((6, 6)), np.empty((6, 6))
        C_A[:3, 3:] = C_A[3:, :3] = -skew(a[:3])
        C_A[3:, 3:] = -skew(a[3:])
        C_RB[:3, :3], C_RB[:3, 3:] = v.mass * omega, -v.mass * omega @ r
        C_RB[3:, :3], C_RB[3:, 3:] = v.mass * r @ omega, -skew(v.M_RB[3:, 3:] @ nu[3:])
        return C_A, C_RB

    def callback(self, model, data):
        v, d, g = self.vehicle, self.design, self.gains
        R = data.xmat[self.plant.body_id].reshape(3, 3)
        T = np.eye(6)
        T[:3, :3] = R.T
        data.M[:21] += (T.T @ v.M_A @ T)[np.tril_indices(6)]
        mujoco.mj_factorM(model, data)
        nu = np.concatenate([R.T @ data.qvel[:3], data.qvel[3:6]])
        x = self.omega_n * data.time
        e = np.exp(-x)
        p_d = self.start + self.target * (1 - e * (1 + x + x * x / 2))
        v_d = R.T @ (self.target * self.omega_n * e * x * x / 2)
        a_d = R.T @ (self.target * self.omega_n**2 * e * (x - x * x / 2)) - cross(nu[3:], v_d)
        quat = data.qpos[3:7]
        eta_e = np.concatenate([R.T @ (data.qpos[:3] - p_d), quat[1:]])
        nu_e = nu - np.concatenate([v_d, np.zeros(3)])
        depth = max(0.0, -mujoco.mj_geomDistance(model, data, *self.touching, 1.0, None))
        tau_c = np.concatenate([R.T @ [-self.k_c * depth, 0.0, 0.0], np.zeros(3)])
        w = self.M_d_inv @ (d.K_d @ eta_e + d.D_d @ nu_e - tau_c)
        U = 0.5 * (quat[0] * np.eye(3) + skew(quat[1:]))
        eta_e_dot = np.concatenate([nu_e[:3], U @ nu_e[3:]])
        s = nu_e + eta_e + self.zeta
        A = self.A
        zeta_dot = A * self.zeta + w + A * eta_e + A * nu_e - eta_e_dot
        C_A, C_RB = self.C(nu)
        g_eta = -np.concatenate([R.T @ (self.buoyancy_W + v.mass * model.opt.gravity), np.zeros(3)])
        g_eta[3:] -= cross(v.r_g, R.T @ (v.mass * model.opt.gravity))
        D_nu = v.D_linear @ nu + v.D_quadratic @ (np.abs(nu) * nu)
        tau_nom = d.M_hat @ (np.concatenate([a_d, np.zeros(3)]) - w) + (C_A + C_RB) @ nu + D_nu + g_eta - tau_c
        root = np.sqrt(np.abs(s)) * np.sign(s)
        tau_gsta = -g.k_1 * (root + g.beta * s) + self.z
        tau_cmd = tau_nom + d.M_hat @ (tau_gsta - A * s)
        self.zeta = self.zeta + self.h * zeta_dot
        self.z = self.z - self.h * g.k_2 * (0.5 * np.sign(s) + 1.5 * g.beta * root + g.beta**2 * s)
        data.ctrl[:] = self.B_pinv @ tau_cmd
        nu_r = nu - np.concatenate([R.T @ self.v_c_W, np.zeros(3)])
        C_A_r, _ = self.C(nu_r)
        f = -C_A_r @ nu_r - v.D_linear @ nu_r - v.D_quadratic @ (np.abs(nu_r) * nu_r)
        f += v.M_A @ np.concatenate([cross(nu_r[3:], nu_r[:3]), np.zeros(3)])
        f[:3] += R.T @ self.buoyancy_W
        data.qfrc_passive[:3] += R @ f[:3]
        data.qfrc_passive[3:6] += f[3:]

    def chunk(self, steps: int) -> float:
        """Time per step, averaged over ``steps`` [s]. The callback is installed during these steps only."""
        before = mujoco.get_mjcb_control()
        mujoco.set_mjcb_control(self.callback)
        start = time.perf_counter()
        mujoco.mj_step(self.model, self.data, steps)
        seconds = (time.perf_counter() - start) / steps
        mujoco.set_mjcb_control(before)
        return seconds
