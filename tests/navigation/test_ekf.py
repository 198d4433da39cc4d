"""The error-state Kalman filter: consistency over 50 seeds, an independent twin, its increments, its refusals."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import ekf_twin as twin
from uvms_mj import InputError, Scenario, Simulation, simulate
from uvms_mj.navigation import Ekf
from uvms_mj.navigation.ekf import advance, estimate, normalised_square, sense
from uvms_mj.navigation.ekf import transition as blocks
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.physics.random import standard_normal
from uvms_mj.setup.base import set_up
from uvms_mj.stages.signals import CLOCK, MEASURED, TRUE, record_dtype

MOVING = {
    "navigation.name": "ekf",
    "wall.stiffness": 2e3,
    "reference.target": [1.05, 0.3, -0.3],
    "reference.step_time": 0.2,
    "initial.attitude_deg": [5.0, -5.0, 20.0],
}
SEEDS = 50
ALONE = dict.fromkeys((f"navigation.{aid}_period" for aid in ("dvl", "depth", "heading", "position")), 0.0)
QUIET = dict.fromkeys(
    (f"navigation.{name}" for name in Ekf.__dataclass_fields__ if name.endswith(("noise", "bias", "walk"))), 1e-12
)
QUIET |= {f"navigation.initial_{name}": 1e-12 for name in ("position", "velocity", "attitude")}
QUIET["navigation.assumed_noise"] = 1.0


def of_seeds(settings, times):
    """NEES and normalised innovations (SEEDS, times)."""
    found = np.zeros((2, SEEDS, len(times)))
    with Simulation(Scenario.load("push_wall", MOVING | settings), engine="free_body") as sim:
        for seed in range(SEEDS):
            sim.reset(seed=seed)
            for k, t in enumerate(times):
                sim.step(round(t / 1e-4) + 1 - sim.steps)
                found[:, seed, k] = sim.signals.nees[0], sim.signals.nis[0]
    return found


def band(degrees):
    """The 95 % band of the mean over the seeds of a chi-square variable."""
    return chi2.ppf([0.025, 0.975], degrees * SEEDS) / SEEDS


@pytest.mark.slow
def test_the_filter_is_consistent_over_50_seeds():
    """The mean NEES of 15 states, and the mean of the squares of the 8 innovations of an instant, in their 95 % bands:
    before the contact, at the impact and after it. The band is 10 % wide: a filter that takes its noise for 0.8 or
    1.25 times the true one leaves it."""
    times = (0.4, 1.2, 2.6, 4.0)
    nees, nis = of_seeds({}, times).mean(axis=1)
    low, high = band(15)
    assert ((low < nees) & (nees < high)).all(), nees
    low, high = band(8)
    assert ((low < 8.0 * nis) & (8.0 * nis < high)).sum() >= 3, nis
    assert low < 8.0 * nis.mean() < high
    for wrong in (0.8, 1.25):
        nees, nis = of_seeds({"navigation.assumed_noise": wrong}, times[:1]).mean(axis=1)
        assert nees[0] == pytest.approx(15.0 / wrong**2, rel=0.12)
        assert not band(15)[0] < nees[0] < band(15)[1]
        assert not low < 8.0 * nis[0] < high


def record(signals):
    return np.zeros(1, record_dtype(signals)).view(np.recarray)[0]


def truth(t):
    """A turning, swinging motion: position, velocity in W, attitude."""
    angle = np.array([0.3 * np.sin(t), 0.4 * np.cos(2.0 * t), 0.9 * t])
    p = np.array([np.sin(t), np.cos(1.3 * t), 0.2 * np.sin(2.0 * t)])
    v = np.array([np.cos(t), -1.3 * np.sin(1.3 * t), 0.4 * np.cos(2.0 * t)])
    return p, v, Rotation.from_euler("xyz", angle)


def test_the_twin_with_dense_matrices_agrees():
    """Sensors, prediction, corrections and NEES over 80 samples of a motion, computed twice."""
    h, key, g_W = 0.005, 12345, np.array([0.0, 0.0, -9.81])
    stage = Ekf(dvl_period=0.02, depth_period=0.03, heading_period=0.05, position_period=0.04)
    setup = set_up(Scenario.load("push_wall", {"simulation.timestep": h, "wall.stiffness": 10.0}))
    settings, state = (each.view(np.recarray)[0] for each in (stage.record(setup), stage.state_record()))
    given, out = record(CLOCK + TRUE), record(MEASURED)
    given.key, given.period = key, h
    deviations = (
        *(stage.initial_position, stage.initial_velocity, stage.initial_attitude),
        *(stage.gyro_bias, stage.accelerometer_bias),
    )
    cov, before = np.diag(np.repeat(np.square(deviations), 3)), truth(0.0)[1:]
    walk = np.repeat([stage.gyro_walk, stage.accelerometer_walk], 3)
    for n in range(80):

        def draw(first, size=3, n=n):
            return np.array([standard_normal(key, n, first + i) for i in range(size)])

        p, v, R = truth(n * h)
        given.instant, given.p_WB[:], given.R_WB[:] = n, p, R.as_matrix()
        given.quat_WB[:] = R.as_quat(scalar_first=True) * (-1.0 if n % 7 == 3 else 1.0)  # both are the same attitude
        given.nu[:3] = R.inv().apply(v)
        Ekf.step(settings, state, given, None, out)
        if n == 0:
            error = np.repeat(deviations, 3) * draw(20, 15)
            biases = error[9:]
            estimate = twin.Estimate(p, v, R).moved(np.r_[-error[:9], np.zeros(6)])
        else:
            turn = (before[1].inv() * R).as_rotvec() + h * (biases[:3] + stage.gyro_noise * draw(0))
            push = before[1].inv().apply(v - before[0] - h * g_W)
            push += h * (biases[3:] + stage.accelerometer_noise * draw(3))
            biases = biases + np.sqrt(h) * walk * draw(6, 6)
            F, G = twin.transition(estimate, turn, push, h)
            noise = np.repeat([h * stage.gyro_noise, h * stage.accelerometer_noise], 3)
            cov = F @ cov @ F.T + G @ np.diag(noise**2) @ G.T + np.diag(np.r_[np.zeros(9), h * walk**2])
            estimate = estimate.integrated(turn, push, h, g_W)
        before = v, R
        if n and n % 4 == 0:
            for i, measured in enumerate(R.inv().apply(v) + stage.dvl_noise * draw(12)):
                H, expected = twin.velocity_row(estimate, i)
                estimate, cov = twin.corrected(estimate, cov, H, measured - expected, stage.dvl_noise)
        if n and n % 6 == 0:
            innovation = p[2] + stage.depth_noise * draw(15, 1)[0] - estimate.p[2]
            estimate, cov = twin.corrected(estimate, cov, np.eye(15)[2], innovation, stage.depth_noise)
        if n and n % 10 == 0:
            innovation = np.sin(twin.heading(R) + stage.heading_noise * draw(16, 1)[0] - twin.heading(estimate.R))
            estimate, cov = twin.corrected(estimate, cov, twin.heading_row(estimate), innovation, stage.heading_noise)
        if n and n % 8 == 0:
            for i, measured in enumerate(p + stage.position_noise * draw(17)):
                innovation = measured - estimate.p[i]
                estimate, cov = twin.corrected(estimate, cov, np.eye(15)[i], innovation, stage.position_noise)
        assert out.p_WB == pytest.approx(estimate.p, abs=1e-10)
        assert out.nu[:3] == pytest.approx(estimate.R.inv().apply(estimate.v), abs=1e-10)
        assert np.allclose(out.R_WB, estimate.R.as_matrix(), rtol=0.0, atol=1e-10)
        assert np.r_[state.b_g, state.b_a] == pytest.approx(np.r_[estimate.b_g, estimate.b_a], abs=1e-10)
        assert np.r_[state.b_g_true, state.b_a_true] == pytest.approx(biases, abs=1e-14)
        assert np.allclose(state.P, cov, rtol=0.0, atol=1e-12)
        if n and n % 4 == 0:
            error = twin.Estimate(p, v, R, biases[:3], biases[3:]).minus(estimate)
            assert state.nees[0] == pytest.approx(error @ np.linalg.solve(cov, error), rel=1e-7)


def test_the_filter_needs_nothing_but_what_the_sensors_measure():
    """Given the samples alone, a second filter has the same estimate and covariance, bit for bit. So a vehicle's own
    sensors can stand in for the simulated ones."""
    h = 0.005
    stage = Ekf(dvl_period=0.02, depth_period=0.03, heading_period=0.05, position_period=0.04)
    setup = set_up(Scenario.load("push_wall", {"simulation.timestep": h, "wall.stiffness": 10.0}))
    settings, state, alone = (
        each.view(np.recarray)[0] for each in (stage.record(setup), stage.state_record(), stage.state_record())
    )
    given, out, its_out = record(CLOCK + TRUE), record(MEASURED), record(MEASURED)
    given.key, given.period = 12345, h
    seen = set()
    for n in range(80):
        p, v, R = truth(n * h)
        given.instant, given.p_WB[:], given.R_WB[:] = n, p, R.as_matrix()
        given.quat_WB[:], given.nu[:3] = R.as_quat(scalar_first=True), R.inv().apply(v)
        sense(settings, state, given, n)
        for name in ("turn", "push", "dvl", "depth", "heading", "fix", "present"):
            alone[name][:] = state[name]
        if n == 0:
            for name in ("p", "v", "quat", "omega"):
                alone[name][:] = state[name]
        seen.add(tuple(state.present))
        estimate(settings, state, n == 0, h, out)
        estimate(settings, alone, n == 0, h, its_out)
        assert out.tobytes() == its_out.tobytes()
        assert state.P.tobytes() == alone.P.tobytes()
        assert np.linalg.norm(out.p_WB - p) < 0.05
    assert alone.b_g_true.tolist() == [0.0] * 3 != state.b_g_true.tolist()
    assert len(seen) > 5


def test_the_jacobians_are_the_derivatives():
    """F against differences of the strapdown integration, and the rows of DVL and heading against the measurements."""
    rng, h, g_W = np.random.default_rng(3), 0.01, np.array([0.0, 0.0, -9.81])
    estimate = twin.Estimate(*rng.normal(size=(2, 3)), Rotation.random(random_state=5), *0.1 * rng.normal(size=(2, 3)))
    turn, push = 0.05 * rng.normal(size=3), 0.1 * rng.normal(size=3)
    A, E, F = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((15, 15))
    R = estimate.R.as_matrix()
    blocks(R, push - h * estimate.b_a, turn - h * estimate.b_g, A, E)
    advance(np.eye(15), R, A, E, h, F)
    end, step = estimate.integrated(turn, push, h, g_W), 1e-6
    wanted, rows = np.zeros((15, 15)), np.zeros((4, 15))
    for i, dx in enumerate(step * np.eye(15)):
        plus, minus = estimate.moved(dx), estimate.moved(-dx)
        after = [each.integrated(turn, push, h, g_W).minus(end) for each in (plus, minus)]
        wanted[:, i] = (after[0] - after[1]) / (2.0 * step)
        rows[:3, i] = (plus.R.inv().apply(plus.v) - minus.R.inv().apply(minus.v)) / (2.0 * step)
        rows[3, i] = (twin.heading(plus.R) - twin.heading(minus.R)) / (2.0 * step)
    bias_of_turn = np.s_[
        6:9, 9:12
    ]  # F has the right Jacobian of Exp as the identity: an error of h times half the turn
    assert F[bias_of_turn] == pytest.approx(wanted[bias_of_turn], abs=0.6 * h * np.linalg.norm(turn))
    wanted[bias_of_turn] = F[bias_of_turn]
    assert pytest.approx(wanted, abs=1e-8) == F
    for i in range(3):
        assert twin.velocity_row(estimate, i)[0] == pytest.approx(rows[i], abs=1e-8)
    assert twin.heading_row(estimate) == pytest.approx(rows[3], abs=1e-8)


def test_without_noise_and_aids_the_strapdown_follows_the_truth_with_second_order():
    """Velocity and attitude are exact. The position has the error of the trapezoidal rule, besides that of the
    simulator, whose position is a sum with the velocity at the end of each step."""
    errors = []
    settings = MOVING | QUIET | ALONE | {"simulation.duration": 1.0, "wall.position": 5.0}
    settings |= {"initial.velocity": [0.3, -0.2, 0.1, 0.5, -0.6, 0.7]}
    for period in (0.04, 0.02, 0.01):
        scenario = Scenario.load("push_wall", settings | {"navigation.imu_period": period}, "impedance")
        trace = simulate(scenario, engine="free_body", log_rate=25.0)
        assert trace.quat_WB_m == pytest.approx(trace.quat_WB, abs=1e-8)
        assert trace.nu_m[:, :3] == pytest.approx(trace.nu[:, :3], abs=1e-9)
        v_W = np.einsum("nij,nj->ni", rotation_matrix(trace.quat_WB), trace.nu[:, :3])
        errors.append(abs(trace.p_WB_m - trace.p_WB + 0.5e-4 * (v_W - v_W[0])).max())
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.02)


def test_without_a_position_fix_the_horizontal_position_drifts_within_its_bound():
    settings = {"navigation.position_period": 0.0, "simulation.duration": 20.0}
    trace = simulate(Scenario.load("push_wall", MOVING | settings), engine="free_body", log_rate=5.0)
    sigma, error = trace["sigma_p"], trace.p_WB_m - trace.p_WB
    late = trace.t > 5.0
    assert (np.diff(sigma[late][:, :2], axis=0) > 0.0).all()
    assert sigma[-1, 2] < 5e-4
    assert (abs(error) < 4.0 * sigma).all()


def test_the_covariance_stays_symmetric_and_positive_definite():
    """After a simulated minute with sensors that are far more exact than the first estimate."""
    settings = {"navigation.depth_noise": 1e-6, "navigation.dvl_noise": 1e-6, "navigation.initial_attitude": 0.1}
    with Simulation(Scenario.load("push_wall", MOVING | settings), engine="free_body") as sim:
        sim.step(600_000)
        P = sim._stages.stages["navigation"].state["P"][0].reshape(15, 15).copy()
        assert np.isfinite(sim.signals.nees[0])
    assert pytest.approx(P.T, rel=1e-12) == P
    assert np.linalg.eigvalsh(P).min() > 0.0


def test_the_cholesky_factor_gives_the_normalised_square_and_nan_if_there_is_none():
    rng = np.random.default_rng(7)
    for _ in range(5):
        root, error = rng.normal(size=(15, 20)), rng.normal(size=15)
        P = root @ root.T
        found = normalised_square(P, error, np.zeros((15, 15)))
        assert found == pytest.approx(error @ np.linalg.solve(P, error), rel=1e-9)


def test_pose_and_velocity_are_held_between_the_samples_of_the_inertial_unit_and_the_force_is_not():
    """The force is measured in B, and is in W with the estimated attitude."""
    pressing = MOVING | {"simulation.duration": 0.1, "wall.position": 0.0}
    trace = simulate(Scenario.load("push_wall", pressing), engine="free_body", log_rate="full")
    changed = np.flatnonzero(np.any(np.diff(trace.p_WB_m, axis=0), axis=1)) + 1
    assert np.array_equal(changed, np.arange(50, 1001, 50))
    assert np.abs(trace.f_contact_W).max() > 1.0
    R_m, R = rotation_matrix(trace.quat_WB_m), rotation_matrix(trace.quat_WB)
    force_B = np.einsum("nji,nj->ni", R, trace.f_contact_W)
    # the soft wall has an inerter, which the force of the same instant does not have
    assert trace.f_contact_m_W == pytest.approx(np.einsum("nij,nj->ni", R_m, force_B), abs=2e-3)


def test_the_force_sensor_has_the_errors_of_a_channel():
    """Noise at its own rate, independent of the filter's."""
    noisy = {"navigation.force_noise": 0.5, "navigation.force_period": 1e-3, "simulation.duration": 2.0}
    trace = simulate(
        Scenario.load("push_wall", MOVING | {"wall.position": 5.0} | noisy), engine="free_body", log_rate=1e3
    )
    samples = trace.f_contact_m_W.ravel()
    low, high = chi2.ppf([0.001, 0.999], samples.size) / samples.size
    assert low < (samples**2).mean() / 0.25 < high
    at_imu = trace.nu_m[5::5, 3:] - trace.nu[5::5, 3:]
    correlation = np.corrcoef(trace.f_contact_m_W[5::5].T, at_imu.T)[:3, 3:]
    assert abs(correlation).max() < 4.0 / np.sqrt(len(at_imu))


def test_a_reset_refuses_a_period_that_does_not_fit_and_takes_one_that_does():
    with Simulation(Scenario.load("push_wall", MOVING | {"controller.period": 0.002}), engine="free_body") as sim:
        with pytest.raises(InputError, match=r"navigation.imu_period: 0.00105 s is not"):
            sim.reset(overrides={"navigation.imu_period": 0.00105})
        sim.reset(overrides={"navigation.imu_period": 0.001})


def test_the_angular_velocity_has_the_bias_that_is_estimated_at_the_same_instant():
    """Of a vehicle that stands still, with a gyro without noise, it is what the estimate lacks of the true bias."""
    still = {"current.speed": 0.0, "wall.position": 50.0, "navigation.name": "ekf"}
    still |= {"navigation.gyro_noise": 1e-9, "navigation.gyro_walk": 1e-9}
    biases = []
    with Simulation(Scenario.load("push_wall", still, "external"), engine="free_body") as sim:
        for _ in range(200):
            signals = sim.signals
            assert signals.nu_m[3:] == pytest.approx(signals.b_g_true - signals.b_g, abs=1e-7)
            biases.append(signals.b_g.copy())
            sim.step(50)
    assert np.ptp(biases, axis=0).max() > 1e-5
