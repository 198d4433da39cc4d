"""The closed loop at a tool as a plain NumPy ``mjcb_control``, with MuJoCo's Jacobians: the law, the posture and the
periods of the native loop. For the benchmark; tests/engine/test_numpy_arm_loop.py shows that both are the same."""

import mujoco
import numpy as np

from numpy_loop import NumpyLoop, cross, skew
from uvms_mj import Scenario
from uvms_mj.control import Gsta
from uvms_mj.guidance import FilteredSteps
from uvms_mj.physics.frames import quat_from_euler_deg, rotation_matrix
from uvms_mj.physics.operational import FREEDOM
from uvms_mj.setup.base import set_up


class NumpyArmLoop(NumpyLoop):
    """GSTA at the tool of the scenario's plant, and below it the posture's levels ``attitude``, without yaw, and
    ``joints``. Velocities zeta = [nu; q_dot] and forces have N = 6 + n rows, and qvel is T zeta. There are a constant
    current, a wall without damping and friction, and perfect sensors and estimates."""

    def __init__(self, scenario: Scenario, warm_up_steps: int) -> None:
        setup = set_up(scenario)
        self.plant, self.vehicle, self.design, self.levels = setup.plant, setup.vehicle, setup.design, scenario.posture
        self.model, self.data = self.plant.model, self.plant.initial_data(scenario.initial)
        self.touching = int(self.model.pair_geom1[0]), int(self.model.pair_geom2[0])
        reference, law = scenario.reference, scenario.controller
        assert isinstance(reference, FilteredSteps)
        assert isinstance(law, Gsta)
        self.gains, self.instant = law, 0
        self.h, self.A, self.k_c = scenario.simulation.timestep, np.array(scenario.task.A), scenario.wall.stiffness
        self.v_c_W, self.gravity_W = np.array(scenario.current.velocity_W), self.model.opt.gravity
        links = self.vehicle.arm.links
        bodies = (self.vehicle, *links)
        names = ("M_RB", "M_A", "D_linear", "D_quadratic", "displaced_mass", "r_b", "mass", "r_g")
        values = (np.array([getattr(body, name) for body in bodies]) for name in names)
        self.M_RB, self.M_A, self.D_linear, self.D_quadratic, displaced, r_b, mass, r_g = values
        self.buoyancy = -displaced, -displaced[:, None] * r_b
        self.weight = mass - displaced, mass[:, None] * r_g - displaced[:, None] * r_b
        self.B_pinv, self.gear = np.linalg.pinv(self.vehicle.B), np.array([link.damping for link in links])
        self.thrusters, self.motors = list(self.vehicle.actuator_ids), [link.actuator_id for link in links]
        self.ids = [self.plant.body_id, *(link.body_id for link in links)]
        self.site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, scenario.task.frame)
        self.carriers = [*self.ids, self.model.site_bodyid[self.site]]
        nv = self.model.nv
        self.M_rows, self.M_columns = np.repeat(np.arange(nv), self.model.M_rownnz), self.model.M_colind
        self.M_full, self.T = np.zeros((nv, nv)), np.eye(nv)
        self.jac, self.jac_dot = np.zeros((2, len(self.carriers), 2, 3, nv))
        self.start, self.omega_n = np.array(setup.initial.position), reference.bandwidth
        self.target = np.array(reference.target) - self.start
        self.inertia_steps = max(1, round(scenario.task.inertia_period / self.h))
        self.posture_steps = max(1, round(self.levels.period / self.h))
        self.q_d = self.plant.initial_joints(scenario.initial)
        self.up_d = rotation_matrix(quat_from_euler_deg(*scenario.initial.attitude_deg))[2]
        self.zeta, self.z = np.zeros(6), np.zeros(6)
        self.chunk(warm_up_steps)

    def frames(self, data):
        """R, J, nu and J_dot qvel of the bodies and, last, of the tool, in their axes; and zeta."""
        R = np.concatenate([data.xmat[self.ids], data.site_xmat[self.site, None]]).reshape(-1, 3, 3)
        p = np.concatenate([data.xpos[self.ids], data.site_xpos[self.site, None]])
        for k, body in enumerate(self.carriers):
            mujoco.mj_jac(self.model, data, *self.jac[k], p[k], body)
            mujoco.mj_jacDot(self.model, data, *self.jac_dot[k], p[k], body)
        self.T[:3, :3] = R[0]
        zeta = self.T.T @ data.qvel
        R_T = R.transpose(0, 2, 1)[:, None]
        J = (R_T @ self.jac @ self.T).reshape(len(R), 6, -1)
        nu = J @ zeta
        a = (R_T @ (self.jac_dot @ data.qvel)[..., None]).reshape(len(R), 6)
        a[:, :3] -= cross(nu[:, 3:].T, nu[:, :3].T).T
        return R, J, nu, a, zeta

    def callback(self, model, data):
        R, J, nu, a, zeta = self.frames(data)
        added = (J[:-1].transpose(0, 2, 1) @ self.M_A @ J[:-1]).sum(axis=0)
        data.M[:] += (self.T @ added @ self.T.T)[self.M_rows, self.M_columns]
        mujoco.mj_factorM(model, data)
        J_dot_zeta = a + J[..., :3] @ cross(zeta[3:6], zeta[:3])  # qvel turns with the base at a constant zeta
        tau = self.control(data, R, J, nu, J_dot_zeta, zeta)
        data.ctrl[self.thrusters] = self.B_pinv @ tau[:6]
        data.ctrl[self.motors] = tau[6:]
        v_c, nu_r, a_r = self.v_c_W @ R[:-1], nu[:-1].copy(), a[:-1].copy()
        nu_r[:, :3] -= v_c
        a_r[:, :3] += cross(nu_r[:, 3:].T, v_c.T).T
        water = inertial(self.M_A, nu_r, a_r) + self.drag(nu_r) + restoring(*self.buoyancy, R[:-1], self.gravity_W)
        data.qfrc_passive[:] -= self.T @ summed(J, water)

    def control(self, data, R, J, nu, J_dot_zeta, zeta):
        """tau (N,) of the law at the tool and of the posture."""
        C = summed(J, inertial(self.M_RB + self.M_A, nu[:-1], J_dot_zeta[:-1]))
        D = summed(J, self.drag(nu[:-1]))
        D[6:] += self.gear * zeta[6:]
        g = summed(J, restoring(*self.weight, R[:-1], self.gravity_W))
        J, nu, J_dot_zeta = J[-1], nu[-1], J_dot_zeta[-1]
        if self.instant % self.inertia_steps == 0:
            mujoco.mj_fullM(self.model, data, self.M_full)
            self.M = self.T.T @ self.M_full @ self.T
            self.MJ_T = np.linalg.solve(self.M, J.T)
            self.Lambda = np.linalg.inv(J @ self.MJ_T)
            self.manipulability = np.sqrt(np.linalg.det(self.M[:6, :6]) / np.linalg.det(self.Lambda))
        if self.instant % self.posture_steps == 0:
            self.tau_posture = self.posture(R[0], data.qpos[7:], zeta, C + D + g, J_dot_zeta)
        J_bar_T = self.Lambda @ self.MJ_T.T
        C_nu, D_nu, g_eta = J_bar_T @ C - self.Lambda @ J_dot_zeta, J_bar_T @ D, J_bar_T @ g
        self.F = self.law(data, R[-1], nu, self.Lambda, C_nu + D_nu + g_eta)
        self.instant += 1
        return J.T @ self.F + self.tau_posture

    def posture(self, R, q, zeta, h, J_dot_zeta):
        """The torques (N,) of the posture, in the motion that the task leaves free (:func:`.operational.posture`)."""
        M_inv, wanted = np.linalg.inv(self.M), self.levels
        P = M_inv - self.MJ_T @ self.Lambda @ self.MJ_T.T
        P_qq, a = P[6:, 6:], -self.MJ_T @ (self.Lambda @ J_dot_zeta)
        free = P @ h - a  # the law gives a
        for level in wanted.order:
            omega = getattr(wanted, f"{level}_frequency")
            damping = 2.0 * wanted.damping_ratio * omega
            if level == "joints":
                b = omega**2 * (self.q_d - q) - damping * zeta[6:]
                return self.M @ (free + a + P[:, 6:] @ np.linalg.solve(P_qq, b - a[6:]))
            assert (level, wanted.yaw) == ("attitude", False)
            up, T = R[2], R[:2]  # the rows of T are normal to the up direction in B
            e = cross(up, self.up_d) / np.sqrt(0.5 + 0.5 * up @ self.up_d)
            b = T @ (-(omega**2) * e - damping * zeta[3:6])
            L = np.linalg.cholesky(T @ M_inv[3:6, 3:6] @ T.T)
            J, b = np.linalg.solve(L, T), np.linalg.solve(L, b - T @ a[3:6])
            sigma, V = np.linalg.eigh(J @ P[3:6, 3:6] @ J.T)
            f = np.where(sigma >= FREEDOM, 1.0 / sigma, (3.0 - 2.0 * sigma / FREEDOM) * sigma / FREEDOM**2)
            X = V.T @ J @ P[3:6]
            a, P = a + X.T @ (f * (V.T @ b)), P - X.T @ (f[:, None] * X)
        return self.M @ (free + a - wanted.free_damping * (P @ (self.M @ zeta)))

    def drag(self, nu):
        return products(self.D_linear, nu) + products(self.D_quadratic, np.abs(nu) * nu)

    def law(self, data, R, nu, M_hat, bias):
        """The wrench at the tool, in its frame; the states advance."""
        d, g, A = self.design, self.gains, self.A
        x = self.omega_n * data.time
        e = np.exp(-x)
        p_d = self.start + self.target * (1 - e * (1 + x + x * x / 2))
        v_d = R.T @ (self.target * self.omega_n * e * x * x / 2)
        a_d = R.T @ (self.target * self.omega_n**2 * e * (x - x * x / 2)) - cross(nu[3:], v_d)
        quat, conjugate, quat_e = np.zeros(4), np.zeros(4), np.zeros(4)
        mujoco.mju_mat2Quat(quat, R.ravel())
        mujoco.mju_negQuat(conjugate, d.quat_d)
        mujoco.mju_mulQuat(quat_e, conjugate, quat)
        quat_e *= np.sign(quat_e[0])
        eta_e = np.concatenate([R.T @ (data.site_xpos[self.site] - p_d), quat_e[1:]])
        nu_e = nu - np.concatenate([v_d, np.zeros(3)])
        depth = max(0.0, -mujoco.mj_geomDistance(self.model, data, *self.touching, 1.0, None))
        tau_c = np.concatenate([R.T @ [-self.k_c * depth, 0.0, 0.0], np.zeros(3)])
        w = d.M_d_inv @ (d.K_d @ eta_e + d.D_d @ nu_e - tau_c)
        U = 0.5 * (quat_e[0] * np.eye(3) + skew(quat_e[1:]))
        eta_e_dot = np.concatenate([nu_e[:3], U @ nu_e[3:]])
        s = nu_e + eta_e + self.zeta
        zeta_dot = A * self.zeta + w + A * eta_e + A * nu_e - eta_e_dot
        root = np.sqrt(np.abs(s)) * np.sign(s)
        tau_gsta = -g.k_1 * (root + g.beta * s) + self.z
        tau_nom = M_hat @ (np.concatenate([a_d, np.zeros(3)]) - w) + bias - tau_c
        self.zeta = self.zeta + self.h * zeta_dot
        self.z = self.z - self.h * g.k_2 * (0.5 * np.sign(s) + 1.5 * g.beta * root + g.beta**2 * s)
        return tau_nom + M_hat @ (tau_gsta - A * s)


def inertial(M, nu, a):
    """The wrenches M a + C(nu) nu (m, 6) of bodies with the inertias M (m, 6, 6)."""
    f, (v, omega), (p, moment) = products(M, a), halves(nu), halves(products(M, nu))
    f[:, :3] += cross(omega, p).T
    f[:, 3:] += (cross(v, p) + cross(omega, moment)).T
    return f


def products(A, x):
    """The products A x (m, 6) of matrices (m, 6, 6) and vectors (m, 6)."""
    return np.einsum("kij,kj->ki", A, x)


def halves(x):
    """The linear and the angular parts (3, m) of spatial vectors (m, 6)."""
    return x[:, :3].T, x[:, 3:].T


def restoring(mass, moment, R, gravity_W):
    """Minus the weights (m, 6) of masses (m,) with the first moments (m, 3), at attitudes R (m, 3, 3)."""
    g = gravity_W @ R
    return -np.hstack([mass[:, None] * g, cross(moment.T, g.T).T])


def summed(J, wrenches):
    """The generalised force (N,) of wrenches (m, 6) on the bodies."""
    return J[:-1].reshape(-1, J.shape[-1]).T @ wrenches.ravel()
