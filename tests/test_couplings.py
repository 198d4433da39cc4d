"""The physics of couplings between vehicles: against equations that are written down anew, loads, arms and surfaces."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from uvms_mj import World, simulate

ENGINES = ("free_body", "mujoco")

# two vehicles in the water, from Fossen's equations and the numbers of the file alone

MASS, R_G = 7.31, np.array([0.0, 0.0, -0.00019])
M_A = np.diag([5.5, 12.7, 14.57, 0.12, 0.12, 0.12])
D_LINEAR = np.array([4.03, 6.22, 5.18, 0.07, 0.07, 0.07])
D_QUADRATIC = np.array([18.18, 21.66, 36.99, 1.55, 1.55, 1.55])
GRAVITY = 9.81


def skew(a):
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


M_RB = np.block([[MASS * np.eye(3), -MASS * skew(R_G)], [MASS * skew(R_G), 0.16 * np.eye(3)]])


def accelerated(R, nu, f_W, arm_W):
    """nu_dot of one neutral BlueROV1 under a force, by Kirchhoff's equations of its momentum."""
    v, omega, momentum = nu[:3], nu[3:], (M_RB + M_A) @ nu
    up = R.T @ [0.0, 0.0, 1.0]
    tau = -D_LINEAR * nu - D_QUADRATIC * np.abs(nu) * nu
    tau[:3] += R.T @ f_W - np.cross(omega, momentum[:3])
    tau[3:] += R.T @ np.cross(arm_W, f_W) - np.cross(omega, momentum[3:]) - np.cross(v, momentum[:3])
    tau[3:] -= np.cross(MASS * GRAVITY * R_G, up)
    return np.linalg.solve(M_RB + M_A, tau)


def force_on_the_first(coupling, d, w):
    distance, k, b, L = np.linalg.norm(d), coupling["stiffness"], coupling["damping"], coupling.get("length", 0.0)
    if coupling["kind"] == "joint":
        return k * d + b * w
    T = k * (distance - L) + b * (d @ w) / distance
    if coupling["kind"] == "cable":
        T = max(T, 0.0) if distance > L else 0.0
    if coupling["kind"] == "contact":
        T = min(T, 0.0) if distance < L else 0.0
    return T * d / distance


def integrated(coupling, start, times):
    """States (n, 26) of two coupled vehicles at times (n,): position, quaternion and nu of each, by DOP853."""
    r = np.array(coupling["points"])

    def rate(_, y):
        states = y.reshape(2, 13)
        p, nu = states[:, :3], states[:, 7:]
        R = Rotation.from_quat(states[:, 3:7], scalar_first=True).as_matrix()
        x = p + np.einsum("nij,nj->ni", R, r)
        x_dot = np.einsum("nij,nj->ni", R, nu[:, :3] + np.cross(nu[:, 3:], r))
        f, middle, out = force_on_the_first(coupling, x[1] - x[0], x_dot[1] - x_dot[0]), x.mean(axis=0), []
        for i, sign in enumerate((1.0, -1.0)):
            q, omega = states[i, 3:7], nu[i, 3:]
            turning = np.concatenate([[-q[1:] @ omega], q[0] * omega + np.cross(q[1:], omega)])
            out += [R[i] @ nu[i, :3], 0.5 * turning, accelerated(R[i], nu[i], sign * f, middle - p[i])]
        return np.concatenate(out)

    return solve_ivp(rate, times[[0, -1]], start, "DOP853", times, rtol=1e-9, atol=1e-11, max_step=2e-3).y.T


@pytest.mark.parametrize(("kind", "seed"), [("joint", 1), ("spring", 2), ("cable", 3), ("contact", 4)])
def test_two_coupled_vehicles_follow_equations_that_are_written_anew(kind, seed):
    """Two BlueROV1 with added mass, drag and turning, coupled at random points: the difference from an integrator of
    order eight is of the order of the step, in both engines."""
    rng = np.random.default_rng(seed)
    points, degrees = rng.uniform(-0.3, 0.3, (2, 3)), rng.uniform(-30.0, 30.0, (2, 3))
    R = [Rotation.from_euler("ZYX", each[::-1], degrees=True).as_matrix() for each in degrees]
    way, length = np.array([0.9, 0.3, -0.3]) / np.linalg.norm([0.9, 0.3, -0.3]), 1.0
    gap = {"joint": 0.02, "spring": 0.95, "cable": 0.99, "contact": 1.01}[kind]
    towards = {"cable": -0.3, "contact": 0.3}.get(kind, 0.0)
    nu = rng.uniform(-0.2, 0.2, (2, 6))
    nu[0, :3] += towards * R[0].T @ way
    coupling = {"vehicles": ["a", "b"], "kind": kind, "points": points.tolist(), "stiffness": 700.0, "damping": 3.0}
    coupling |= {"length": length} if kind != "joint" else {}
    positions = np.zeros(3), R[0] @ points[0] + gap * way - R[1] @ points[1]
    world = World.from_dict(
        {
            "simulation": {"duration": 0.5},
            "wall": {"present": False},
            "current": {"speed": 0.0},
            "controller": {"name": "none"},
            "couplings": [coupling],
            "vehicles": [
                {
                    "name": name,
                    "initial": {"position": p.tolist(), "attitude_deg": a.tolist(), "velocity": v.tolist()},
                }
                for name, p, a, v in zip("ab", positions, degrees, nu, strict=True)
            ],
        }
    )
    expected = None
    for engine in ENGINES:
        errors = []
        for h in (4e-4, 2e-4):
            traces = [*simulate(world.updated({"simulation.timestep": h}), engine=engine, log_rate=100.0).values()]
            found = np.hstack([np.hstack([each.p_WB, each.quat_WB, each.nu]) for each in traces])
            if expected is None:
                expected = integrated(coupling, found[0], traces[0].t)
            errors.append(np.abs(found - expected).max())
        assert np.abs(traces[0].f_couplings_W).max() > 5.0
        assert errors[1] < 3e-3
        assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)
