"""The closed loop at a tool as a plain NumPy ``mjcb_control``, with MuJoCo's Jacobians. For the benchmark only."""

import mujoco
import numpy as np

from numpy_loop import NumpyLoop, cross, skew
from uvms_mj import Gsta, Scenario
from uvms_mj.analysis.setup import set_up
from uvms_mj.guidance import FilteredSteps
from uvms_mj.plant.arm import Link
from uvms_mj.plant.vehicle import Vehicle


class NumpyArmLoop(NumpyLoop):
    """GSTA at the tool of the scenario's plant, and springs that hold the joints in the null space of the task."""

    def __init__(self, scenario: Scenario, warm_up_steps: int) -> None:
        setup = set_up(scenario)
        plant, vehicle = setup.plant, setup.vehicle
        self.plant, self.vehicle, self.design = plant, vehicle, setup.design
        self.model, self.data = plant.model, plant.initial_data(scenario.initial)
        self.h, self.gains, self.A = scenario.simulation.timestep, Gsta(), np.array(scenario.task.A)
        self.v_c_W, self.k_c = np.array(scenario.current.velocity_W), scenario.wall.stiffness
        self.M_d_inv, self.B_pinv = np.linalg.inv(setup.design.M_d), np.linalg.pinv(vehicle.B)
        self.bodies: list[tuple[int, Vehicle | Link]] = [(plant.body_id, vehicle)]
        self.bodies += [(link.body_id, link) for link in vehicle.arm.links]
        self.thrusters = list(vehicle.actuator_ids)
        self.motors = [link.actuator_id for link in vehicle.arm.links if link.actuator_id >= 0]
        self.driven = [6 + k for k, link in enumerate(vehicle.arm.links) if link.actuator_id >= 0]
        self.site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, scenario.task.frame)
        nv, rows = self.model.nv, self.model.M_rownnz
        self.M_rows, self.M_columns = np.repeat(np.arange(nv), rows), self.model.M_colind
        self.M, self.jacobians = np.zeros((nv, nv)), np.zeros((4, 3, nv))
        mujoco.mj_forward(self.model, self.data)
        self.start, self.q_0 = self.data.site_xpos[self.site].copy(), self.data.qpos[7:].copy()
        reference = scenario.reference
        assert isinstance(reference, FilteredSteps)
        self.omega_n, self.target = reference.bandwidth, np.array(reference.target) - self.start
        self.quat_d = np.array(setup.design.quat_d)
        self.zeta, self.z = np.zeros(6), np.zeros(6)
        self.chunk(warm_up_steps)

    def moving(self, data, R, p, body):
        """J and J_dot qvel of a frame that is fixed to a body, in the frame."""
        jac_p, jac_r, dot_p, dot_r = self.jacobians
        mujoco.mj_jac(self.model, data, jac_p, jac_r, p, body)
        mujoco.mj_jacDot(self.model, data, dot_p, dot_r, p, body)
        J = np.vstack([R.T @ jac_p, R.T @ jac_r])
        nu = J @ data.qvel
        turning = np.concatenate([cross(nu[3:], nu[:3]), np.zeros(3)])
        return J, nu, np.concatenate([R.T @ (dot_p @ data.qvel), R.T @ (dot_r @ data.qvel)]) - turning

    def water(self, data, frames, v_c_W):
        """Generalised force of the water on all bodies without the part in the inertia."""
        total = np.zeros(self.model.nv)
        for (_, body), (R, J, nu, a) in zip(self.bodies, frames, strict=True):
            v_c = R.T @ v_c_W
            nu_r = nu - np.concatenate([v_c, np.zeros(3)])
            a_r = a + np.concatenate([cross(nu[3:], v_c), np.zeros(3)])
            h = body.M_A @ nu_r
            C_A = np.zeros((6, 6))
            C_A[:3, 3:] = C_A[3:, :3] = -skew(h[:3])
            C_A[3:, 3:] = -skew(h[3:])
            f = -body.M_A @ a_r - C_A @ nu_r - body.D_linear @ nu_r - body.D_quadratic @ (np.abs(nu_r) * nu_r)
            buoyancy = -body.displaced_mass * (R.T @ self.model.opt.gravity)
            total += J.T @ (f + np.concatenate([buoyancy, cross(body.r_b, buoyancy)]))
        return total

    def callback(self, model, data):
        frames, added = [], np.zeros((model.nv, model.nv))
        for i, body in self.bodies:
            R = data.xmat[i].reshape(3, 3)
            frames.append((R, *self.moving(data, R, data.xpos[i], i)))
            added += frames[-1][1].T @ body.M_A @ frames[-1][1]
        data.M[:] += added[self.M_rows, self.M_columns]
        mujoco.mj_factorM(model, data)
        mujoco.mj_fullM(model, data, self.M)
        R_T = data.site_xmat[self.site].reshape(3, 3)
        J, nu, a = self.moving(data, R_T, data.site_xpos[self.site], model.site_bodyid[self.site])
        h = data.qfrc_bias + model.dof_damping * data.qvel - self.water(data, frames, np.zeros(3))
        MJ_T = np.linalg.solve(self.M, J.T)
        Lambda = np.linalg.inv(J @ MJ_T)
        bias = Lambda @ (MJ_T.T @ h - a)
        F = self.law(data, R_T, nu, Lambda, bias)
        hold = np.concatenate([np.zeros(6), 20.0 * (self.q_0 - data.qpos[7:]) - 5.0 * data.qvel[6:]])
        tau = J.T @ F + hold - J.T @ (Lambda @ (MJ_T.T @ hold))
        R = frames[0][0]
        data.ctrl[self.thrusters] = self.B_pinv @ np.concatenate([R.T @ tau[:3], tau[3:6]])
        data.ctrl[self.motors] = tau[self.driven]
        data.qfrc_passive[:] += self.water(data, frames, self.v_c_W)

    def law(self, data, R, nu, M_hat, bias):
        """The wrench at the tool, in its frame; the states advance."""
        d, g, A = self.design, self.gains, self.A
        x = self.omega_n * data.time
        e = np.exp(-x)
        p_d = self.start + self.target * (1 - e * (1 + x + x * x / 2))
        v_d = R.T @ (self.target * self.omega_n * e * x * x / 2)
        a_d = R.T @ (self.target * self.omega_n**2 * e * (x - x * x / 2)) - cross(nu[3:], v_d)
        quat, conjugate, quat_e = np.zeros(4), np.zeros(4), np.zeros(4)
        mujoco.mju_mat2Quat(quat, data.site_xmat[self.site])
        mujoco.mju_negQuat(conjugate, self.quat_d)
        mujoco.mju_mulQuat(quat_e, conjugate, quat)
        quat_e *= np.sign(quat_e[0])
        eta_e = np.concatenate([R.T @ (data.site_xpos[self.site] - p_d), quat_e[1:]])
        nu_e = nu - np.concatenate([v_d, np.zeros(3)])
        depth = max(0.0, -data.sensordata[self.plant.sensors["distance"]])
        tau_c = np.concatenate([R.T @ [-self.k_c * depth, 0.0, 0.0], np.zeros(3)])
        w = self.M_d_inv @ (d.K_d @ eta_e + d.D_d @ nu_e - tau_c)
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
