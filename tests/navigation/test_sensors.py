"""Sensors against what their settings say: statistics by chi-square, delays to the step, inertia and drift in closed
form."""

import numpy as np
import pytest
from scipy import signal, stats
from scipy.spatial.transform import Rotation

from uvms_mj import Scenario, Simulation, simulate
from uvms_mj.navigation import PRESETS, Sensors
from uvms_mj.physics.random import random_bits

H = 1e-3
IDLE = {  # the nominal control of a vehicle that may do as it likes: tau is zero but for rounding
    "controller.name": "impedance",
    "impedance.K_d": [0.0] * 6,
    "impedance.D_d": [0.0] * 6,
    "estimates.coriolis": 0.0,
    "estimates.damping": 0.0,
    "estimates.restoring": 0.0,
    "reference.target": [0.0] * 3,
    "reference.start": [0.0] * 3,
    "current.speed": 0.0,
}
STILL = IDLE | {
    "wall.position": 50.0,
    "wall.stiffness": 1e3,
    "simulation.timestep": H,
    "navigation.name": "sensors",
}
MOVING = STILL | {"initial.velocity": [0.3, -0.2, 0.1, 0.4, -0.3, 0.5], "simulation.duration": 1.0}


def trace_of(settings, engine="free_body"):
    return simulate(Scenario.load("push_wall", settings), engine=engine, log_rate="full")


def inside(statistic, degrees, level=1e-4):
    """Whether a statistic that is chi-square distributed lies in its central interval."""
    low, high = stats.chi2.ppf([level / 2, 1 - level / 2], degrees)
    return low < statistic < high


def errors(quantity, settings, samples, period):
    """Errors (samples, 3) of a quantity of a vehicle at rest, one for each sample."""
    given = {f"navigation.{quantity}_{name}": value for name, value in settings.items()}
    given |= {f"navigation.{quantity}_period": period, "simulation.duration": samples * period}
    trace = trace_of(STILL | given)
    if quantity == "attitude":
        turned = Rotation.from_quat(trace.quat_WB, scalar_first=True).inv() * Rotation.from_quat(
            trace.quat_WB_m, scalar_first=True
        )
        found = turned.as_rotvec()
    elif quantity == "force":
        found = trace.f_contact_m_W
    else:
        first = {"position": 0, "velocity": 0, "angular_velocity": 3}[quantity]
        name = "p_WB" if quantity == "position" else "nu"
        found = (trace[f"{name}_m"] - trace[name])[:, first : first + 3]
    return found[:: round(period / H)][:samples]


QUANTITIES = ["position", "attitude", "velocity", "angular_velocity", "force"]


@pytest.mark.slow
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_noise_has_its_variance_in_each_axis_and_is_white(quantity):
    sigma, n = np.array([0.01, 0.02, 0.03]), 20_000
    found = errors(quantity, {"noise": sigma.tolist()}, n, 2 * H) / sigma
    for i in range(3):
        assert inside((found[:, i] ** 2).sum(), n)
        assert abs(found[:, i].mean()) < 4.0 / np.sqrt(n)
        lags = [found[lag:, i] @ found[:-lag, i] / n for lag in range(1, 21)]
        assert n * np.square(lags).sum() < stats.chi2.ppf(0.9999, 20)  # Box and Pierce's statistic
    cross = found.T @ found / n
    assert np.abs(cross - np.diag(np.diag(cross))).max() < 4.0 / np.sqrt(n)


def test_a_density_gives_the_deviation_that_the_page_says():
    """sigma = N / sqrt(2 T): every line of the periodogram is N^2 times a chi-square variable over its two degrees."""
    density, T, n = 0.005, 2 * H, 2**14
    found = errors("velocity", {"noise": density / np.sqrt(2.0 * T)}, n, T)
    for i in range(3):
        _, power = signal.periodogram(found[:, i], fs=1.0 / T, detrend=False)
        lines = 2.0 * power[1:-1] / density**2
        assert inside(lines.sum(), 2 * len(lines))
        for band in np.array_split(lines, 8):
            assert inside(band.sum(), 2 * len(band))


@pytest.mark.parametrize("quantity", ["position", "attitude", "force"])
def test_a_random_walk_has_white_steps_whatever_the_period(quantity):
    walk, n, T = 0.002, 10_000, 4 * H
    found = errors(quantity, {"walk": walk}, n, T)
    assert not found[0].any()
    if quantity == "attitude":  # rotation vectors add up only while they are small
        found = found[:500]
    steps = np.diff(found, axis=0) / (walk * np.sqrt(T))
    for i in range(3):
        assert inside((steps[:, i] ** 2).sum(), len(steps))
        assert inside(steps[:, i].sum() ** 2 / len(steps), 1)


@pytest.mark.parametrize(("period", "delay"), [(H, 0.0), (H, H), (H, 37 * H), (5 * H, 2 * H), (7 * H, 20 * H)])
def test_a_delay_is_exact_to_the_step(period, delay):
    n, d = round(period / H), round(delay / H)
    names = ("position", "attitude", "velocity", "angular_velocity")
    given = {f"navigation.{name}_period": period for name in names}
    trace = trace_of(MOVING | given | {f"navigation.{name}_delay": delay for name in names})
    k = np.arange(len(trace))
    taken = np.maximum(0, (k - d) // n * n)
    assert np.array_equal(trace.p_WB_m, trace.p_WB[taken])
    assert np.array_equal(trace.quat_WB_m, trace.quat_WB[taken])
    assert np.array_equal(trace.nu_m, trace.nu[taken])


def test_a_delayed_force_is_that_of_the_earlier_instant():
    pushing = {"navigation.name": "sensors", "navigation.force_delay": 0.0005, "navigation.moment_delay": 0.0005}
    more = {"simulation.duration": 0.5, "initial.position": [0.995, 0.0, 0.0], "initial.velocity": [0.2] + [0.0] * 5}
    trace = trace_of(pushing | more)
    assert trace.push.max() > 1.0
    R = Rotation.from_quat(trace.quat_WB, scalar_first=True)
    spring = -1e5 * np.outer(np.maximum(0.0, trace.p_WB[:, 0] - 1.0), [1.0, 0.0, 0.0])
    expected = R[5:].apply(R[:-5].inv().apply(spring[:-5]))  # it is measured in B
    assert np.abs(trace.f_contact_m_W[5:] - expected).max() < 1e-8


def test_jitter_never_reorders_and_is_uniform():
    T, delay, jitter, n = 10 * H, 3 * H, 6 * H, 3000
    given = {"period": T, "delay": delay, "jitter": jitter}
    settings = {f"navigation.position_{name}": value for name, value in given.items()}
    trace = trace_of(STILL | settings | {"initial.velocity": [0.01] + [0.0] * 5, "simulation.duration": n * T})
    x, x_m = trace.p_WB[:, 0], trace.p_WB_m[:, 0]
    arrivals = np.flatnonzero(np.diff(x_m)) + 1
    taken = np.searchsorted(x, x_m[arrivals])
    assert np.array_equal(x[taken], x_m[arrivals])
    assert np.array_equal(taken, 10 * np.arange(1, len(taken) + 1))  # each sample, in order
    counts = np.bincount(arrivals - taken - 3, minlength=7)
    assert len(counts) == 7
    assert stats.chisquare(counts).pvalue > 1e-4


def test_jitter_longer_than_the_period_keeps_the_order():
    settings = {"navigation.position_period": 2 * H, "navigation.position_jitter": 15 * H}
    trace = trace_of(MOVING | settings)
    taken = np.array([np.abs(trace.p_WB - p).sum(axis=1).argmin() for p in trace.p_WB_m])
    assert (np.diff(taken) >= 0).all()
    assert (taken % 2 == 0).all()
    late = np.arange(len(trace)) - taken
    assert late.max() <= 16
    assert late[100:].mean() > 5.0


def test_a_lost_sample_is_held():
    n, p, T = 20_000, 0.3, 2 * H
    found = errors("velocity", {"noise": 0.01, "dropout": p}, n, T)
    lost = int((np.diff(found[:, 0]) == 0.0).sum())
    assert stats.binomtest(lost, n - 1, p).pvalue > 1e-4
    assert inside((found[np.r_[True, np.diff(found[:, 0]) != 0.0], 0] ** 2).sum() / 0.01**2, n - lost)


def test_bias_scale_limit_and_quantum():
    settings = {
        "navigation.velocity_bias": [0.1, 0.0, -0.1],
        "navigation.velocity_scale": 0.5,
        "navigation.velocity_limit": 0.4,
        "navigation.velocity_quantum": 0.05,
        "navigation.attitude_bias": [0.0, 0.1, 0.0],
        "navigation.position_quantum": 0.01,
    }
    trace = trace_of(MOVING | settings)
    expected = np.clip(1.5 * trace.nu[:, :3] + [0.1, 0.0, -0.1], -0.4, 0.4)
    assert np.abs(trace.nu_m[:, :3] - expected).max() <= 0.025 + 1e-12
    assert np.allclose(trace.nu_m[:, :3] / 0.05, np.round(trace.nu_m[:, :3] / 0.05), atol=1e-9)
    assert np.abs(trace.nu_m[:, :3]).max() <= 0.4 + 1e-12
    assert np.array_equal(trace.nu_m[:, 3:], trace.nu[:, 3:])
    assert np.allclose(trace.p_WB_m, 0.01 * np.round(trace.p_WB / 0.01), atol=1e-12)
    true, measured = (Rotation.from_quat(q, scalar_first=True) for q in (trace.quat_WB, trace.quat_WB_m))
    assert np.allclose((true.inv() * measured).as_rotvec(), [0.0, 0.1, 0.0], atol=1e-9)


def test_a_quantised_attitude_is_a_rotation_near_the_true_one():
    trace = trace_of(MOVING | {"navigation.attitude_quantum": 0.02})
    assert np.allclose(np.linalg.norm(trace.quat_WB_m, axis=1), 1.0, atol=1e-12)
    assert np.allclose(100.0 * trace.quat_WB_m[:, 1:], np.round(100.0 * trace.quat_WB_m[:, 1:]), atol=1e-9)
    true, measured = (Rotation.from_quat(q, scalar_first=True) for q in (trace.quat_WB, trace.quat_WB_m))
    assert 0.005 < (true.inv() * measured).magnitude().max() < 0.02


def test_the_force_sensor_sees_the_inertia_of_what_is_behind_it():
    """f_m = -m a with a from the motion of the tool's centre in W, by finite differences."""
    m, r = 2.5, np.array([0.3, -0.1, 0.2])
    h = 1e-4
    settings = MOVING | {"simulation.timestep": h, "simulation.duration": 0.2}
    settings |= {"navigation.mass_behind": m, "navigation.mass_behind_at": r.tolist()}
    trace = trace_of(settings)
    R = Rotation.from_quat(trace.quat_WB, scalar_first=True)
    centre = trace.p_WB + R.apply(r)
    a_W = np.diff(centre, 2, axis=0) / h**2  # at rows 1 to n - 2
    found = trace.f_contact_m_W[2:]  # with the acceleration of the step before
    assert np.abs(m * a_W).max() > 0.2
    assert np.abs(found + m * a_W).max() < 5e-3 * np.abs(m * a_W).max()


def test_a_vehicle_that_bounces_off_a_wall_measures_what_its_tool_leaves_of_the_force():
    """Without thrust M a = f, so that the sensor measures f (1 - m/M)."""
    m, M = 3.0, 7.31 + 5.5
    free = IDLE | {"navigation.name": "sensors"}
    start = {"initial.position": [0.99, 0.0, 0.0], "initial.velocity": [0.2, 0.0, 0.0, 0.0, 0.0, 0.0]}
    trace = trace_of(free | start | {"navigation.mass_behind": m, "simulation.duration": 0.09})
    peak = trace.push.argmax()
    assert trace.push[peak] > 100.0
    assert -trace.f_contact_m_W[peak, 0] == pytest.approx(trace.push[peak] * (1.0 - m / M), rel=1e-3)


def test_the_force_drifts_with_the_depth():
    settings = MOVING | {"initial.attitude_deg": [0.0, 0.0, 90.0], "navigation.depth_drift": [2.0, 0.0, 0.0]}
    trace = trace_of(settings)
    R = Rotation.from_quat(trace.quat_WB, scalar_first=True)
    drift = -2.0 * (trace.p_WB[:, 2] - trace.p_WB[0, 2])
    assert np.abs(drift).max() > 0.1
    assert np.allclose(trace.f_contact_m_W, R.apply(np.outer(drift, [1.0, 0.0, 0.0])), atol=1e-12)


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_sensors_without_errors_are_perfect_bit_for_bit(engine):
    settings = {"simulation.duration": 0.5, "initial.position": [0.995, 0.0, 0.0]}
    settings |= {"initial.velocity": [0.2, 0.1, 0.0, 0.1, -0.2, 0.3]}
    perfect = trace_of(settings, engine)
    sensors = trace_of(settings | {"navigation.name": "sensors"}, engine)
    assert perfect.push.max() > 1.0
    assert all(np.array_equal(perfect[name], sensors[name]) for name in perfect)


def test_bits_are_those_of_plain_python():
    """The measured noise of a channel is Box and Muller's transform of the counter's bits."""
    sigma = 0.5
    with Simulation(
        Scenario.load("push_wall", STILL | {"navigation.velocity_noise": sigma}), engine="free_body"
    ) as sim:
        key = int(sim._memory.stages.rows["key"][0])
        for k in range(5):
            x, y = ((random_bits(key, k, 8 * 2 + 1, block) + 1 - block) * 2.0**-53 for block in (0, 1))
            expected = sigma * np.sqrt(-2.0 * np.log(x)) * np.cos(2.0 * np.pi * y)
            assert sim.signals.nu_m[1] - sim.signals.nu[1] == pytest.approx(expected, rel=1e-12)
            sim.step()


@pytest.mark.parametrize("cls", PRESETS)
def test_presets_are_sensors_with_other_numbers(cls):
    stage = cls()
    assert stage.is_shipped
    assert isinstance(stage, Sensors)
    assert "trust" in cls.__doc__ or "ASSUMPTION" in cls.__doc__
    for h in (1e-3, 1e-4, 2e-4, 5e-4):
        assert not [fault for q in ("position", "velocity", "force") for fault in stage.channel(q).faults(h)]


def test_what_is_behind_the_force_sensor_pulls_where_it_is():
    """Without a contact the measured moment is r x f of the measured force."""
    r = [0.2, 0.1, -0.15]
    behind = MOVING | {"navigation.mass_behind": 2.0, "navigation.mass_behind_at": r}
    with Simulation(Scenario.load("push_wall", behind), engine="free_body") as sim:
        for _ in range(20):
            sim.step(5)
            wrench = sim.signals.tau_contact_m_B
            assert np.abs(wrench[:3]).min() > 1e-6
            assert wrench[3:] == pytest.approx(np.cross(r, wrench[:3]), rel=1e-9)
