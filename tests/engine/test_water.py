"""Water that moves and accelerates: the vehicle's equation, closed forms, both engines, seeds, resets, refusals."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from twin import C_A, C_RB, M_RB, D, TwinParameters, rotation
from uvms_mj import Current, Drag, Fin, InputError, Scenario, Simulation, Tether, attach, simulate
from uvms_mj.control.base import SteadyState
from uvms_mj.physics.effects import FIN, fin_coefficients
from uvms_mj.physics.kernels import record_of
from vehicles import load, place, random_parameters, state

STILL = TwinParameters(v_c_W=(0.0, 0.0, 0.0))
MOVING = Current(
    speed=0.4,
    direction_deg=30.0,
    vertical=-0.1,
    amplitude=(0.2, 0.1, 0.05),
    frequency_hz=(0.3, 0.2, 0.5),
    table=((0.0, 0.0, 0.0, 0.0), (4.0, 0.3, -0.2, 0.1), (20.0, -0.3, 0.5, 0.2)),
    deviation=(0.1, 0.05, 0.1),
    correlation_time=3.0,
    shear=((-5.0, 1.2), (2.0, 0.9), (8.0, 0.3)),
)
IN_A_SCENARIO = {
    "simulation.duration": 2.0,
    "current.vertical": -0.1,
    "current.amplitude": [0.2, 0.1, 0.05],
    "current.frequency_hz": [0.3, 0.2, 0.5],
    "current.table": [[0.0, 0.0, 0.0, 0.0], [1.0, 0.3, -0.2, 0.1]],
    "current.deviation": [0.1, 0.05, 0.1],
    "current.correlation_time": 3.0,
    "current.shear": [[-5.0, 1.2], [2.0, 0.9]],
    "disturbance.table": [[0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 2.0, -1.0, 0.1, 0.0, 0.1]],
    "disturbance.deviation": [1.0, 1.0, 1.0, 0.1, 0.1, 0.1],
    "disturbance.correlation_time": 0.5,
    "tether.length": 10.0,
    "tether.position": [-0.2, 0.0, 0.1],
    "fins": [{"area": 0.02, "position": [-0.3, 0.0, 0.0], "deflection_deg": 8.0}],
    "drag": [{"forward": [5.0, 20.0, 30.0], "backward": [9.0, 20.0, 10.0], "position": [0.1, 0.0, -0.1]}],
    "initial.attitude_deg": [10.0, -20.0, 30.0],
    "initial.velocity": [0.2, -0.1, 0.3, 0.1, 0.2, -0.3],
    "wall.position": 20.0,
}


def sampled(current: Current, seed: int, times: np.ndarray) -> np.ndarray:
    """(n, 3) velocity of the water at depth 0 at these times, from an attachment of its own."""
    model, data = load(STILL)
    found = []
    with attach(model, data, current=current, seed=seed) as attachment:
        for data.time in times:
            mujoco.mj_forward(model, data)
            found.append(attachment.plant["water"]["v_c_W"][0].copy())
    return np.array(found)


def water_at(t: float, z: float, gusts) -> np.ndarray:
    """v_c_W of MOVING, written anew; ``gusts`` is its Gauss-Markov part at time t."""
    heading = np.radians(MOVING.direction_deg)
    v = np.array([MOVING.speed * np.cos(heading), MOVING.speed * np.sin(heading), MOVING.vertical])
    v += np.array(MOVING.amplitude) * np.sin(2.0 * np.pi * np.array(MOVING.frequency_hz) * t)
    table = np.array(MOVING.table)
    v += [np.interp(t, table[:, 0], table[:, 1 + i]) for i in range(3)]
    v += gusts(t)
    v[:2] *= np.interp(-z, *np.array(MOVING.shear).T)
    return v


def gusts_of(seed: int):
    """The Gauss-Markov part of MOVING as a function of time."""
    alone = Current(speed=0.0, deviation=MOVING.deviation, correlation_time=MOVING.correlation_time)
    return lambda t: sampled(alone, seed, np.array([t]))[0]


def nu_dot_of(parameters, quat, nu, v_c_W, along_path, of_water, tau) -> np.ndarray:
    """M_RB nu_dot + C_RB(nu) nu + M_A nu_r_dot + C_A(nu_r) nu_r + D(nu_r) nu_r = tau + weight + buoyancy, with the
    buoyancy in water of the acceleration ``of_water``; Fossen (2021), eq. (6.42) with a current."""
    R, M_A = rotation(quat), np.asarray(parameters.M_A)
    nu_c = np.r_[R.T @ v_c_W, np.zeros(3)]
    nu_c_dot = np.r_[R.T @ along_path - np.cross(nu[3:], nu_c[:3]), np.zeros(3)]
    nu_r, up, displaced = nu - nu_c, np.array([0.0, 0.0, parameters.gravity]), parameters.buoyancy / parameters.gravity
    weight, buoyancy = -parameters.mass * R.T @ up, displaced * R.T @ (up + of_water)
    load = tau + np.r_[weight + buoyancy, np.cross(parameters.r_g, weight) + np.cross(parameters.r_b, buoyancy)]
    load -= C_RB(parameters, nu) @ nu + C_A(parameters, nu_r) @ nu_r + D(parameters, nu_r) @ nu_r
    return np.linalg.solve(M_RB(parameters) + M_A, load + M_A @ nu_c_dot)


@pytest.mark.slow
@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_the_acceleration_is_that_of_the_equation_with_finite_differences_of_the_current(seed):
    """A random vehicle in sines, a table, shear and gusts. The derivatives of the current are differences: along the
    vehicle's path, and along that of the water."""
    parameters = replace(random_parameters(seed), disturbance_bias=(0.0,) * 6, disturbance_amplitude=(0.0,) * 6)
    rng, gusts = np.random.default_rng(seed), gusts_of(seed)
    quat = rng.normal(size=4)
    quat /= np.linalg.norm(quat)
    nu, t, z = rng.normal(size=6), float(rng.uniform(0.1, 15.0)), float(rng.uniform(-6.0, 4.0))
    model, data = load(parameters, crowded=True)
    place(model, data, (0.3, -0.2, z), quat, nu)
    data.time = t
    with attach(model, data, "rov", current=MOVING, seed=seed):
        mujoco.mj_forward(model, data)
    v_c, h = water_at(t, z, gusts), 1e-6
    rates = [
        (water_at(t + h, z + h * w, gusts) - water_at(t - h, z - h * w, gusts)) / (2.0 * h)
        for w in ((rotation(quat) @ nu[:3])[2], v_c[2])
    ]
    expected = nu_dot_of(parameters, quat, nu, v_c, *rates, np.zeros(6))
    R = rotation(quat)
    found = np.r_[R.T @ data.qacc[6:9] - np.cross(nu[3:], nu[:3]), data.qacc[9:12]]
    assert np.linalg.norm(found - expected) < 1e-6 * np.linalg.norm(expected)


RAMP = Current(speed=0.2, vertical=0.1, table=((0.0, 0.0, 0.0, 0.0), (10.0, 2.0, -1.0, 0.5)))


def test_in_water_that_accelerates_a_neutral_vehicle_moves_as_in_still_water():
    """Seen from the water, with weight and buoyancy at one point. A constant acceleration is exact in every step."""
    parameters = random_parameters(4)
    parameters = replace(parameters, r_b=parameters.r_g, buoyancy=parameters.mass * parameters.gravity)
    relative = []
    for current in (Current(speed=0.0), RAMP):
        model, data = load(replace(parameters, timestep=1e-3))
        v_0 = np.array(current.velocity_W)
        place(model, data, nu=np.array([0.3, 0.2, -0.1, 0.2, -0.3, 0.4]) + np.r_[v_0, np.zeros(3)])
        with attach(model, data, current=current):
            mujoco.mj_step(model, data, 2000)
        v_c = v_0 + (np.array([2.0, -1.0, 0.5]) * data.time / 10.0 if current is RAMP else 0.0)
        relative.append(np.concatenate([data.qvel[:3] - v_c, data.qvel[3:], data.qpos[3:]]))
    assert np.allclose(relative[0], relative[1], rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("displaced_over_mass", [0.5, 1.0, 3.0])
def test_a_body_without_damping_takes_up_the_momentum_of_the_water(displaced_over_mass):
    """(m + A) v = (rho V + A) v_c, as of a bubble or a droplet: Newman (1977), sec. 4.17."""
    added, calm = 5.0, np.zeros((6, 6))
    parameters = replace(
        STILL,
        M_A=np.diag([added] * 3 + [0.1] * 3),
        D_linear=calm,
        D_quadratic=calm,
        r_g=(0.0,) * 3,
        buoyancy=displaced_over_mass * STILL.mass * STILL.gravity,
    )
    model, data = load(parameters)
    with attach(model, data, current=replace(RAMP, speed=0.0, vertical=0.0)):
        mujoco.mj_step(model, data, 1000)
    v_c = np.array([2.0, -1.0]) * data.time / 10.0
    m, displaced = STILL.mass, displaced_over_mass * STILL.mass
    assert np.allclose(data.qvel[:2], (displaced + added) / (m + added) * v_c, rtol=1e-9)


@pytest.mark.parametrize(("integrator", "order"), [("RK4", 4), ("Euler", 1)])
def test_attach_converges_to_scipys_solution(integrator, order):
    """Heave in a sinusoidal vertical current."""
    current = Current(speed=0.0, amplitude=(0.0, 0.0, 0.3), frequency_hz=(0.0, 0.0, 0.8))
    parameters = replace(STILL, r_g=(0.0,) * 3, buoyancy=1.1 * STILL.mass * STILL.gravity)
    m, A, displaced = STILL.mass, STILL.M_A[2, 2], 1.1 * STILL.mass
    d, q, omega = STILL.D_linear[2, 2], STILL.D_quadratic[2, 2], 2.0 * np.pi * 0.8

    def rhs(t, w):
        w_r, w_c_dot = w - 0.3 * np.sin(omega * t), 0.3 * omega * np.cos(omega * t)
        return ((displaced + A) * w_c_dot + (displaced - m) * STILL.gravity - (d + q * abs(w_r)) * w_r) / (m + A)

    exact = solve_ivp(rhs, (0.0, 0.8), [-0.2], "DOP853", rtol=1e-12, atol=1e-13).y[0, -1]
    errors = []
    for n in (20, 40, 80):
        model, data = load(replace(parameters, timestep=0.8 / n), option=f'integrator="{integrator}"')
        place(model, data, nu=(0.0, 0.0, -0.2, 0.0, 0.0, 0.0))
        with attach(model, data, current=current):
            mujoco.mj_step(model, data, n)
        errors.append(abs(state(model, data)[2][2] - exact))
    assert np.log2(np.array(errors[:-1]) / errors[1:]).min() > order - 0.25, errors


def signals(trace) -> dict:
    return {name: trace[name] for name in trace}


def test_both_engines_have_the_same_water():
    """Under a law without switching, which would amplify rounding."""
    scenario = Scenario.load("push_wall", IN_A_SCENARIO, "impedance")
    one, two = (simulate(scenario, log_rate=100, engine=engine) for engine in ("mujoco", "free_body"))
    for name in ("p_WB", "nu", "v_c_W", "v_c_dot_W", "a_c_W", "tau_dist"):
        scale = np.abs(one[name]).max()
        assert scale > 0.01
        assert np.allclose(one[name], two[name], rtol=0.0, atol=1e-8 * scale), name


def test_the_recorded_derivative_is_that_of_the_recorded_current():
    """v_c_dot_W is taken along the vehicle's path: v_c_W is its integral, by the trapezoidal rule."""
    smooth = {name: value for name, value in IN_A_SCENARIO.items() if "deviation" not in name}
    trace = simulate(Scenario.load("push_wall", smooth), log_rate="full", engine="free_body")
    h = trace.t[1]
    integral = np.cumsum(0.5 * h * (trace.v_c_dot_W[1:] + trace.v_c_dot_W[:-1]), axis=0)
    assert np.allclose(trace.v_c_W[1:] - trace.v_c_W[0], integral, rtol=0.0, atol=2.0 * h)
    assert np.abs(trace.v_c_dot_W - trace.a_c_W).max() > 1e-3  # the vehicle crosses the shear


@pytest.mark.parametrize("engine", ["mujoco", "free_body"])
def test_a_disturbance_that_is_set_during_a_run_acts_in_the_step_in_hand(engine):
    found = {}
    for force in (0.0, 3.0):
        with Simulation(Scenario.load("push_wall", {"wall.position": 20.0}), engine=engine) as sim:
            sim.step(10)
            sim.set({"disturbance.bias": [force, 0.0, 0.0, 0.0, 0.0, 0.0]})
            sim.step(1)
            assert np.array_equal(sim.signals.tau_dist, [force, 0.0, 0.0, 0.0, 0.0, 0.0])
            found[force], M = sim.signals.nu_dot.copy(), sim.setup.vehicle.M
    assert np.allclose(M @ (found[3.0] - found[0.0]), [3.0, 0.0, 0.0, 0.0, 0.0, 0.0], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("engine", ["mujoco", "free_body"])
def test_the_ideal_law_imposes_the_impedance_exactly_in_any_water(engine):
    """Eq. (13): nu_dot - nu_d_dot = -w, for a vehicle whose weight and buoyancy differ in size and place."""
    vehicle = {"vehicle.displaced_mass": 1.2, "vehicle.mass": 0.9, "vehicle.added_mass": 1.3}
    scenario = Scenario.load("push_wall", IN_A_SCENARIO | vehicle, "ideal")
    with Simulation(scenario, engine=engine) as sim:
        for _ in range(20):
            demanded = sim.signals.nu_d_dot - sim.signals.w
            sim.step(1)
            assert np.allclose(sim.signals.nu_dot, demanded, rtol=0.0, atol=1e-9 * np.abs(demanded).max())
            sim.step(499)


def test_times_may_come_in_any_order():
    """A state that is restored, or an evaluation beyond a block of nodes, has the current of its time."""
    current = Current(speed=0.0, deviation=(0.2, 0.1, 0.3), correlation_time=1.0)
    times = np.array([0.0, 3.3, 31.9, 32.1, 500.0, 32.1, 0.1, 3.3])
    together = sampled(current, 7, times)
    assert np.array_equal(together, np.concatenate([sampled(current, 7, times[i : i + 1]) for i in range(len(times))]))
    assert np.array_equal(together[1], together[-1])
    assert not np.array_equal(together, sampled(current, 8, times))


def test_a_tether_slows_a_vehicle_as_its_closed_form_says():
    """v = v_0 / (1 + k v_0 t/m) for a vehicle without damping of its own."""
    calm = np.zeros((6, 6))
    parameters = replace(STILL, M_A=np.diag([5.0] * 3 + [0.1] * 3), D_linear=calm, D_quadratic=calm, r_g=(0.0,) * 3)
    tether = Tether(length=20.0, diameter=0.01, drag_coefficient=1.1)
    model, data = load(replace(parameters, timestep=0.01), option='integrator="RK4"')
    place(model, data, nu=(0.8, 0.0, 0.6, 0.0, 0.0, 0.0))
    with attach(model, data, tether=tether):
        mujoco.mj_step(model, data, 500)
    k = 0.5 * 1000.0 * 1.1 * 0.01 * 20.0
    speed = 1.0 / (1.0 + k * 1.0 * data.time / (STILL.mass + 5.0))
    assert np.allclose(data.qvel[:3], speed * np.array([0.8, 0.0, 0.6]), rtol=1e-7)


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_the_wrench_of_a_tether_acts_at_its_attachment_against_its_velocity_in_the_water(seed):
    parameters = random_parameters(seed)
    rng = np.random.default_rng(seed)
    nu, r_t, wrenches = rng.normal(size=6), rng.normal(size=3), []
    for length in (0.0, 3.0):
        model, data = load(parameters)
        place(model, data, nu=nu)
        tether = Tether(length=length, position=tuple(r_t))
        with attach(model, data, current=Current.of(parameters.v_c_W), tether=tether) as attachment:
            mujoco.mj_forward(model, data)
            wrenches.append(attachment.wrench)
    w = np.asarray(parameters.v_c_W) - nu[:3] - np.cross(nu[3:], r_t)
    force = 0.5 * 1000.0 * 1.2 * 7.6e-3 * 3.0 * np.linalg.norm(w) * w
    assert np.allclose(wrenches[1] - wrenches[0], np.r_[force, np.cross(r_t, force)], rtol=1e-9, atol=1e-9)


def fin_force(fin, v_F):
    """(3,) force of the water on a fin in its frame, from its velocity there, by the coefficients of its docstring."""
    v, s = np.array([v_F[0], v_F[1], 0.0]), math.radians(fin.stall_deg)
    alpha = math.atan(v[1] / v[0])  # a plate has no front
    if abs(alpha) <= s:
        C_L, C_D = fin.lift_slope * alpha, fin.drag_coefficient + fin.induced_drag * (fin.lift_slope * alpha) ** 2
    else:
        C_s = fin.drag_coefficient + fin.induced_drag * (fin.lift_slope * s) ** 2
        C_L = fin.lift_slope * s * math.sin(2 * alpha) / math.sin(2 * s)
        C_D = C_s + (fin.drag_across - C_s) * (math.sin(alpha) ** 2 - math.sin(s) ** 2) / math.cos(s) ** 2
    speed = float(np.linalg.norm(v))
    across = np.cross([0.0, 0.0, 1.0], v / speed)
    return -500.0 * fin.area * speed**2 * (C_L * across + C_D * v / speed)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_the_wrench_of_fins_is_that_of_plates_and_takes_energy_out(seed):
    parameters, rng = random_parameters(seed), np.random.default_rng(seed)
    nu, wrenches = rng.normal(size=6), []
    fins = [
        Fin(
            area=float(rng.uniform(0.01, 0.1)),
            position=tuple(rng.normal(size=3).tolist()),
            attitude_deg=tuple(rng.uniform(-180.0, 180.0, 3).tolist()),
            deflection_deg=float(rng.uniform(-30.0, 30.0)),
            stall_deg=float(rng.uniform(5.0, 60.0)),
        )
        for _ in range(2)
    ]
    for each in ((), fins):
        model, data = load(parameters)
        place(model, data, nu=nu)
        with attach(model, data, current=Current.of(parameters.v_c_W), fins=each) as attachment:
            mujoco.mj_forward(model, data)
            wrenches.append(attachment.wrench)
    expected = np.zeros(6)
    for fin in fins:
        R = Rotation.from_euler("ZYX", fin.attitude_deg[::-1], degrees=True)
        R *= Rotation.from_euler("Z", fin.deflection_deg, degrees=True)
        v = nu[:3] - np.asarray(parameters.v_c_W) + np.cross(nu[3:], fin.position)
        force = R.apply(fin_force(fin, R.inv().apply(v)))
        assert force @ v <= 0.0
        expected += np.r_[force, np.cross(fin.position, force)]
    assert np.allclose(wrenches[1] - wrenches[0], expected, rtol=1e-9, atol=1e-9)


def test_the_coefficients_of_a_fin_have_no_jump_and_no_front():
    fin = np.zeros(1, FIN)
    numbers = {"lift_slope": 3.0, "stall": 0.3, "drag": 0.01, "induced": 0.1, "across": 1.2}
    for name, number in numbers.items():
        fin[name] = number
    record, near = record_of(fin), 1e-9
    for alpha in (0.3, -0.3, math.pi / 2, math.pi - 0.3):
        below, above = (np.array(fin_coefficients(record, alpha + d)) for d in (-near, near))
        assert np.allclose(below, above, rtol=0.0, atol=1e-7), alpha
    for alpha in np.linspace(-3.0, 0.1, 40):
        assert np.allclose(fin_coefficients(record, alpha), fin_coefficients(record, alpha + math.pi), atol=1e-12)


def free_vehicle(**others) -> TwinParameters:
    """A vehicle without damping and without moment of weight or buoyancy, whose added mass is the same along all
    axes."""
    still = {"D_linear": np.zeros((6, 6)), "D_quadratic": np.zeros((6, 6)), "r_g": (0.0,) * 3, "r_b": (0.0,) * 3}
    return replace(STILL, **{"M_A": np.diag([5.0] * 3 + [0.1] * 3), **still, **others})


@pytest.mark.parametrize(("net", "speed"), [(1962.0, 0.7203), (-1962.0, -0.8525)])
def test_a_cone_rises_and_sinks_at_the_terminal_speeds_of_its_two_drags(net, speed):
    """A cone of a wave energy converter: f = 3782 w^2 upwards, 2700 w^2 downwards; 200 kg too light or too heavy."""
    parameters = free_vehicle(mass=1000.0, buoyancy=1000.0 * STILL.gravity + net, timestep=0.01)
    model, data = load(parameters, option='integrator="RK4"')
    with attach(model, data, drag=Drag(forward=(1.0, 1.0, 3782.0), backward=(1.0, 1.0, 2700.0))):
        mujoco.mj_step(model, data, 2000)
    assert data.qvel[2] == pytest.approx(math.copysign(math.sqrt(1962.0 / (3782.0 if net > 0.0 else 2700.0)), net))
    assert data.qvel[2] == pytest.approx(speed, abs=1e-4)


@pytest.mark.parametrize("by", ["axes", "speed"])
def test_drag_slows_a_vehicle_that_moves_at_45_degrees_as_its_closed_form_says(by):
    """v_i = v_0i / (1 + c s_i t/m), with s_i = abs(v_0i) by axes, and s_i = abs(v_0), equal for all, by speed."""
    c, v_0, parameters = 40.0, np.array([0.5, -0.5, 0.0]) / math.sqrt(2.0), free_vehicle(timestep=0.01)
    model, data = load(replace(parameters, buoyancy=None), option='integrator="RK4"')
    place(model, data, nu=(*v_0, 0.0, 0.0, 0.0))
    with attach(model, data, drag=[Drag(forward=(c, c, c), by=by)]):
        mujoco.mj_step(model, data, 300)
    speeds = np.abs(v_0) if by == "axes" else np.full(3, np.linalg.norm(v_0))
    assert np.allclose(data.qvel[:3], v_0 / (1.0 + c * speeds * data.time / (STILL.mass + 5.0)), rtol=1e-8, atol=1e-12)


def random_drag(rng: np.random.Generator) -> Drag:
    forward, backward = (tuple(rng.uniform(0.0, 50.0, 3).tolist()) for _ in range(2))
    by = str(rng.choice(["axes", "speed"]))
    return Drag(forward=forward, backward=backward, position=tuple(rng.normal(size=3).tolist()), by=by)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_the_wrench_of_drag_acts_at_its_place_by_direction(seed):
    parameters, rng = random_parameters(seed), np.random.default_rng(seed)
    nu, wrenches, drag = rng.normal(size=6), [], [random_drag(rng) for _ in range(2)]
    for each in ((), drag):
        model, data = load(parameters)
        place(model, data, nu=nu)
        with attach(model, data, current=Current.of(parameters.v_c_W), drag=each) as attachment:
            mujoco.mj_forward(model, data)
            wrenches.append(attachment.wrench)
    expected = np.zeros(6)
    for each in drag:
        v = nu[:3] - np.asarray(parameters.v_c_W) + np.cross(nu[3:], each.position)
        c = np.where(v > 0.0, each.forward, each.backward)
        force = -c * v * (np.linalg.norm(v) if each.by == "speed" else np.abs(v))
        expected += np.r_[force, np.cross(each.position, force)]
    assert np.allclose(wrenches[1] - wrenches[0], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_drag_at_a_place_never_feeds_energy_in(seed):
    """A random neutral vehicle without other damping, in still water: its kinetic energy falls in every step."""
    rng, parameters = np.random.default_rng(seed), random_parameters(seed, timestep=2e-3)
    still = {"D_linear": np.zeros((6, 6)), "D_quadratic": np.zeros((6, 6)), "r_b": parameters.r_g, "buoyancy": None}
    parameters = replace(parameters, **still)
    M = M_RB(parameters) + np.asarray(parameters.M_A)
    model, data = load(parameters, option='integrator="RK4"')
    place(model, data, nu=rng.normal(size=6))
    energies = []
    with attach(model, data, drag=[random_drag(rng) for _ in range(3)]):
        for _ in range(500):
            nu = state(model, data)[2]
            energies.append(0.5 * nu @ M @ nu)
            mujoco.mj_step(model, data)
    assert (np.diff(energies) < 0.0).all()
    assert energies[-1] < 0.5 * energies[0]


def test_attach_names_an_effect_that_it_does_not_know_or_that_is_of_another_kind():
    model, data = load(STILL)
    with pytest.raises(InputError, match=r"(?s)tehter: is no effect.*did you mean 'tether'.*fins: .* is not a .*Fin"):
        attach(model, data, tehter=Tether(), fins=[Drag(forward=(1.0, 1.0, 1.0))])
    with pytest.raises(InputError, match=r"curent: is no effect.*did you mean 'current'"):
        attach(model, data, curent=Current())


def test_a_reset_changes_or_removes_an_effect_and_adds_none():
    fin = {"area": 0.05, "position": [-0.3, 0.0, 0.0], "deflection_deg": 10.0}
    moving = {"simulation.duration": 0.2, "fins": [fin], "initial.velocity": [1.0] + [0.0] * 5}
    scenario = Scenario.load("push_wall", moving)
    with Simulation(scenario, engine="free_body") as sim:
        for changes in ({"fins[0].area": 0.1}, {"fins": []}, {"fins[0].area": 0.05}):
            sim.reset(changes)
            sim.step(500)
            fresh = simulate(scenario.updated({"simulation.duration": 0.05} | changes), engine="free_body")
            assert np.array_equal(sim.signals.p_WB, fresh.p_WB[-1]), changes
        with pytest.raises(InputError, match="can't add an effect of the water"):
            sim.reset({"tether.length": 3.0})
        with pytest.raises(InputError, match="can't add an effect of the water"):
            sim.reset({"fins": [fin, fin]})


EFFECTS = {
    **{"tether.length": 4.0, "tether.position": [-0.2, 0.0, 0.0], "reference.target": [1.1, 0.0, -0.5]},
    "fins": [{"area": 0.02, "position": [-0.3, 0.0, 0.1], "attitude_deg": [0.0, 0.0, 20.0]}],
    "drag": [{"forward": [10.0, 15.0, 20.0], "backward": [5.0, 8.0, 22.0], "position": [-0.2, 0.1, 0.1]}],
}
"""Effects in which a vehicle at rest presses on the wall."""
AT_REST = {"reference.target": [1.01, 0.0, -0.5], "simulation.duration": 25.0, "wall.damping": 500.0}


@pytest.mark.parametrize(
    "water",
    [
        {"current.vertical": -0.2},
        {"current.shear": [[0.0, 1.0], [1.0, 0.4]]},
        EFFECTS,
        EFFECTS | {"drag": [{"forward": [12.0, 20.0, 12.0], "position": [-0.2, 0.1, 0.1], "by": "speed"}]},
        {"disturbance.table": [[0.0, 2.0, 1.0, -1.0, 0.0, 0.1, 0.0]], "disturbance.bias": [1.0] + [0.0] * 5},
    ],
    ids=["vertical", "shear", "tether, fins, drag", "tether, fins, drag of the speed", "one row"],
)
def test_a_vehicle_rests_where_the_static_balance_says(water):
    """Under impedance control, which does not reject the current: it depends on depth and on the effects."""
    rests_as_announced(water, "free_body")


def rests_as_announced(water, engine):
    scenario = Scenario.load("push_wall", AT_REST | water, "impedance")
    trace = simulate(scenario, engine=engine)
    assert isinstance(trace.analytic, SteadyState)
    assert trace.push[-1] == pytest.approx(trace.analytic.force, rel=1e-6, abs=1e-9)
    assert np.allclose(trace.p_WB[-1], trace.analytic.position, rtol=0.0, atol=1e-6)
    assert "fins" not in water or trace.push[-1] > 5.0


def test_a_vehicle_with_a_tether_fins_and_drag_by_direction_rests_there_in_mujoco_too():
    rests_as_announced(EFFECTS, "mujoco")


@pytest.mark.parametrize(
    ("water", "reason"),
    [
        ({"current.amplitude": [0.1, 0.0, 0.0], "current.frequency_hz": [0.1] * 3}, "current is not constant"),
        ({"current.deviation": [0.1, 0.0, 0.0]}, "current is not constant"),
        ({"current.table": [[0.0, 0.0, 0.0, 0.0], [1.0, 0.1, 0.0, 0.0]]}, "current is not constant"),
        ({"disturbance.deviation": [1.0] + [0.0] * 5}, "disturbance is not constant"),
        ({"disturbance.table": [[0.0] * 7, [1.0] * 7]}, "disturbance is not constant"),
    ],
)
def test_there_is_no_rest_in_water_that_changes(water, reason):
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.01} | water, "impedance"))
    assert reason in str(trace.analytic)


def test_bad_water_is_refused_with_every_fault_at_once():
    wrong = {
        "current.amplitude": [0.1, 0.2],
        "current.table": [[0.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]],
        "current.shear": [[0.0, 1.0, 2.0]],
        "current.correlation_time": 0.0,
        "current.deviation": [0.1, -0.1, 0.0],
        "disturbance.table": [],
        "tether.diameter": -1.0,
        "drag": [{"forward": [1.0, 2.0, -3.0], "by": "angle"}, {"forward": [1.0, 2.0]}, {}],
    }
    with pytest.raises(InputError) as caught:
        Scenario.load("push_wall", wrong)
    places = {fault.key for fault in caught.value.faults}
    assert places >= {"current.table", "current.correlation_time", "current.deviation[1]", "disturbance.table"}
    assert {"current.amplitude", "current.shear[0]", "tether.diameter"} <= places
    assert {"drag[0].forward[2]", "drag[0].by", "drag[1].forward", "drag[2].forward"} <= places
    assert "row 2 begins with 1 after 2" in str(caught.value)


def test_water_that_the_time_step_does_not_resolve_is_refused():
    wrong = {
        "current.amplitude": [0.1, 0.2, 0.0],
        "current.frequency_hz": [6000.0, 0.0, 0.0],
        "current.deviation": [0.1, 0.0, 0.0],
        "current.correlation_time": 1e-3,
        "current.shortest_gust": 2e-3,
        "disturbance.deviation": [1.0] + [0.0] * 5,
        "disturbance.correlation_time": 1e-3,
        "current.table": [[1.0, 0.0, 0.0, 0.0], [1.00001, 1.0, 0.0, 0.0]],
    }
    with pytest.raises(InputError) as caught:
        simulate(Scenario.load("push_wall", wrong))
    assert [fault.key for fault in caught.value.faults] == [
        "current.frequency_hz[0]",
        "current.shortest_gust",
        "current.amplitude[1]",
        "current.table[1]",
        "disturbance.correlation_time",
    ]
    model, data = load(STILL)
    with pytest.raises(InputError, match=r"current.frequency_hz\[2\]"):
        attach(model, data, current=Current(amplitude=(0.0, 0.0, 1.0), frequency_hz=(0.0, 0.0, 1e4)))
    with pytest.raises(InputError, match=r"(?s)current: \(1, 0, 0\) is not a uvms_mj.Current.*seed: -1 is not"):
        attach(model, data, current=(1, 0, 0), seed=-1)
    assert mujoco.get_mjcb_control() is None


def test_the_constant_part_of_a_current_can_be_set_at_any_time():
    model, data = load(STILL)
    with attach(model, data, current=replace(MOVING, speed=0.0, vertical=0.0)) as attachment:
        mujoco.mj_forward(model, data)
        before = attachment.plant["water"]["v_c_W"][0].copy()
        attachment.current_W = (0.3, -0.2, 0.1)
        mujoco.mj_forward(model, data)
        factor = np.interp(0.0, *np.array(MOVING.shear).T)
        change = attachment.plant["water"]["v_c_W"][0] - before
        assert np.allclose(change, [0.3 * factor, -0.2 * factor, 0.1], rtol=1e-12)
        assert np.array_equal(attachment.current_W, [0.3, -0.2, 0.1])
