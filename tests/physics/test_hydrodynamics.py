"""A vehicle in the water obeys the paper's eq. (10), at the integrator's order, and gains no energy."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from twin import TwinParameters, matrix_acceleration, rotation
from uvms_mj import Current, attach
from uvms_mj.physics.hydrodynamics import factor
from vehicles import load, place, random_parameters, state, water_of

STILL = TwinParameters(v_c_W=(0.0, 0.0, 0.0))
seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_acceleration_is_the_matrix_equations(seed):
    parameters = random_parameters(seed)
    rng = np.random.default_rng(seed + 1)
    model, data = load(parameters, crowded=True)
    quat = rng.normal(size=4)
    quat /= np.linalg.norm(quat)
    nu, tau, t = rng.normal(size=6) * 2, rng.normal(size=6) * 20, float(rng.uniform(0, 10))
    place(model, data, rng.normal(size=3), quat, nu)
    data.time, data.ctrl[:] = t, tau
    with attach(model, data, "rov", **water_of(parameters)):
        mujoco.mj_forward(model, data)
    a_W, omega_dot = data.qacc[6:9], data.qacc[9:12]
    nu_dot = np.concatenate([rotation(quat).T @ a_W - np.cross(nu[3:], nu[:3]), omega_dot])
    expected = matrix_acceleration(parameters, np.zeros(3), quat, nu, tau, t)
    assert np.linalg.norm(nu_dot - expected) <= 1e-9 * np.linalg.norm(expected)


@given(seeds)
def test_inertia_is_symmetric_positive_definite_and_counts_added_mass_once(seed):
    """This includes mj_forwardSkip, with which MuJoCo evaluates again without rebuilding the inertia."""
    parameters = random_parameters(seed)
    model, data = load(parameters, crowded=True)
    rng = np.random.default_rng(seed)
    quat = rng.normal(size=4)
    quat /= np.linalg.norm(quat)
    place(model, data, nu=rng.normal(size=6), quat=quat)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, full)
    T = np.eye(6)
    T[:3, :3] = rotation(quat).T
    expected = full[6:, 6:] + T.T @ parameters.M_A @ T
    with attach(model, data, "rov", **water_of(parameters)):
        for evaluate in (
            lambda: mujoco.mj_forward(model, data),
            lambda: mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_POS, 1),
            lambda: mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_VEL, 1),
        ):
            evaluate()
            mujoco.mj_fullM(model, data, full)
            assert np.allclose(full[6:, 6:], expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
            assert np.linalg.eigvalsh(full)[0] > 0.0


def flow(parameters, tau, t_end, position, quat, nu):
    """Exact motion under constant thrust, from a tight integration of the twin's matrix equation."""

    def rhs(t, y):
        q = y[3:7] / np.linalg.norm(y[3:7])
        w, x, yy, z = q
        omega = y[10:13]
        E = np.array([[-x, -yy, -z], [w, -z, yy], [z, w, -x], [-yy, x, w]])
        return np.concatenate(
            [rotation(q) @ y[7:10], 0.5 * E @ omega, matrix_acceleration(parameters, y[:3], q, y[7:], tau, t)]
        )

    y = solve_ivp(rhs, (0, t_end), np.r_[position, quat, nu], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return y[:3], y[3:7] / np.linalg.norm(y[3:7]), y[7:]


@pytest.mark.parametrize(
    ("integrator", "turning", "order"),
    [("Euler", True, 1), ("implicitfast", True, 1), ("RK4", True, 2), ("RK4", False, 4)],
)
def test_order_of_convergence(integrator, turning, order):
    """RK4 keeps order 4 in translation; with rotation MuJoCo 3 integrates quaternions to order 2."""
    seed = 7
    parameters = random_parameters(seed) if turning else replace(STILL, r_g=(0.0, 0.0, 0.0))
    tau = np.array([8.0, -5.0, 6.0, 1.0, -2.0, 1.5]) if turning else np.array([0.0, 0.0, 6.0, 0.0, 0.0, 0.0])
    start = (np.zeros(3), np.array([1.0, 0, 0, 0]), np.array([0.3, 0.2, -0.1, 0.2, -0.3, 0.4]) * (1 if turning else 0))
    exact = flow(parameters, tau, 0.8, *start)
    errors = []
    for n in (20, 40, 80):
        model, data = load(replace(parameters, timestep=0.8 / n), crowded=True, option=f'integrator="{integrator}"')
        place(model, data, start[0], start[1], start[2])
        data.ctrl[:] = tau
        with attach(model, data, "rov", **water_of(parameters)):
            mujoco.mj_step(model, data, n)
        reached = state(model, data)
        reached[1][:] *= np.sign(reached[1] @ exact[1])
        errors.append(np.linalg.norm(np.concatenate(reached) - np.concatenate(exact)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < errors[0]
    assert orders.min() > order - 0.25, (errors, orders)


def test_terminal_speed_under_constant_thrust():
    """Z = d w + q w^2 has one positive root w. In heave, the Munk moment does not turn the vehicle over."""
    model, data = load(replace(STILL, timestep=2e-3))
    data.ctrl[2] = 12.0
    with attach(model, data):
        mujoco.mj_step(model, data, 20_000)
    d, q = STILL.D_linear[2, 2], STILL.D_quadratic[2, 2]
    assert np.isclose(state(model, data)[2][2], (-d + np.sqrt(d * d + 4 * q * 12.0)) / (2 * q), rtol=1e-9)


def test_a_neutral_vehicle_drifts_with_the_current():
    v_c = np.array([0.3, -0.2, 0.1])
    model, data = load(replace(STILL, timestep=5e-3))
    with attach(model, data, current=Current.of(v_c)):
        mujoco.mj_step(model, data, 80_000)
    _, quat, nu = state(model, data)
    assert np.allclose(rotation(quat) @ nu[:3], v_c, atol=1e-6)
    assert np.allclose(nu[3:], 0.0, atol=1e-6)


def energy_gained(timestep: float) -> float:
    """Largest rate of rise of the energy (kinetic and potential) of a vehicle in still water without thrust [W]."""
    parameters = replace(random_parameters(3), v_c_W=(0, 0, 0), timestep=timestep)
    parameters = replace(parameters, disturbance_bias=(0,) * 6, disturbance_amplitude=(0,) * 6)
    model, data = load(parameters)
    place(model, data, nu=(0.5, -0.4, 0.3, 1.0, -1.5, 2.0))
    full, total, before = np.zeros((6, 6)), 0.0, None
    with attach(model, data):
        for _ in range(round(2.0 / timestep)):
            mujoco.mj_forward(model, data)
            mujoco.mj_fullM(model, data, full)
            R = rotation(data.qpos[3:7])
            weight, buoyancy = parameters.mass * parameters.gravity, parameters.buoyancy
            z = data.qpos[:3][2]
            potential = weight * (z + (R @ parameters.r_g)[2]) - buoyancy * (z + (R @ parameters.r_b)[2])
            energy = 0.5 * data.qvel @ full @ data.qvel + potential
            if before is not None:
                total = max(total, energy - before)
            before = energy
            mujoco.mj_step(model, data)
    return total / timestep


def test_still_water_gives_no_energy_beyond_the_integration_error():
    """The rate of any gain is proportional to the step."""
    coarse, fine = energy_gained(4e-3), energy_gained(1e-3)
    assert fine <= max(coarse / 3.0, 1e-9)


def test_the_factor_is_mujocos(rng):
    """L^T D L of a random matrix, multiplied out."""
    a = rng.normal(size=(6, 6))
    M, L, D_inverse = a @ a.T + np.eye(6), np.zeros(21), np.zeros(6)
    factor(M[np.tril_indices(6)], L, D_inverse)
    unit = np.zeros((6, 6))
    unit[np.tril_indices(6)] = L
    D = np.diag(np.diag(unit))
    np.fill_diagonal(unit, 1.0)
    assert np.allclose(unit.T @ D @ unit, M)
    assert np.allclose(D_inverse, 1.0 / np.diag(D))
