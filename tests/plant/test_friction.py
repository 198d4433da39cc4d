"""Friction at the wall: Coulomb's law in slip, a spring in stick, no gain of energy."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pressed import K_C, PUSH, M, pressed
from twin import TwinParameters, matrix_acceleration, rotation
from uvms_mj import Controller, Scenario, Trace, gain, simulate
from uvms_mj.physics.contacts import pair_force
from uvms_mj.setup.checks import SamplingWarning


@dataclass(frozen=True)
class Push(Controller):
    """A law with a constant push on the wall, a constant force along its face, and attitude control."""

    push: float = gain(PUSH, "N", "along x")
    along: tuple[float, float] = gain((0.0, 0.0), "N", "along y and z")
    damping: float = gain(0.0, "N s/m", "along x")

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[0] = gains.push - gains.damping * signals.nu[0]
        tau_cmd[1], tau_cmd[2] = gains.along[0], gains.along[1]
        for i in range(3, 6):
            tau_cmd[i] = -signals.tau_contact_m_B[i] - 2000.0 * signals.eta_e[i] - 40.0 * signals.nu[i]


def at_the_wall(vehicle: Path, law: Controller, overrides: dict) -> Trace:
    """Trace at the full rate of a run in still water that starts pressed against the wall."""
    world = {
        "vehicle.model": str(vehicle),
        "current.speed": 0.0,
        "wall.position": 0.0,
        "initial.position": [PUSH / K_C, 0.0, 0.0],
        "reference.target": [0.0, 0.0, 0.0],
    }
    return simulate(Scenario.load("push_wall", world | overrides), law, log_rate="full")


@pytest.mark.parametrize("timestep", [2e-4, 1e-4])
@pytest.mark.parametrize(("axis", "mu"), [(1, 0.2), (2, 0.5)])
def test_a_sliding_vehicle_is_slowed_by_mu_times_the_normal_force_and_stops(slippery, timestep, axis, mu):
    """The vehicle slides with v_dot = -mu F_n / M, added mass included, then rests, in contact at every step."""
    velocity, deceleration = np.zeros(6), mu * PUSH / M[axis]
    velocity[axis] = 0.15
    stop = velocity[axis] / deceleration
    overrides = {
        "wall.friction": mu,
        "initial.velocity": velocity.tolist(),
        "simulation.timestep": timestep,
        "simulation.duration": stop + 2.0,
    }
    trace = at_the_wall(slippery, Push(), overrides)
    t, v, f = trace.t, trace.nu[:, axis], trace.f_contact_W
    slides = (t > 0.1 * stop) & (t < 0.9 * stop)
    first, last = np.flatnonzero(slides)[[0, -1]]
    assert (v[first] - v[last]) / (t[last] - t[first]) == pytest.approx(deceleration, rel=1e-6)
    assert np.allclose(f[slides, axis], -mu * trace.push[slides], rtol=1e-6)
    assert np.abs(v[t > stop + 1.5]).max() < 1e-6
    assert (trace.push > 0.0).all()
    assert trace.push.max() == pytest.approx(PUSH, rel=1e-4)


def test_a_sticking_contact_gives_way_by_the_springs_stretch_and_does_not_creep(slippery):
    """The load is 0.65 of the Coulomb limit along y and z together; tangential and normal stiffness differ."""
    k_t, mu = 4e4, 0.4
    along = 0.65 * mu * PUSH * np.array([0.6, -0.8])
    overrides = {"wall.friction": mu, "wall.tangential_stiffness": k_t, "simulation.duration": 8.0}
    trace = at_the_wall(slippery, Push(along=tuple(along), damping=50.0), overrides)
    assert trace.p_WB[-1, 1:] == pytest.approx(along / k_t, rel=1e-3)
    assert trace.stretch_W[-1, 1:] == pytest.approx(along / k_t, rel=1e-6)
    rest = trace.t > 7.0
    creep = np.abs(trace.p_WB[rest][-1] - trace.p_WB[rest][0]) / 1.0
    assert creep.max() < 1e-9
    assert np.abs(trace.nu[rest, 1:3]).max() < 1e-9


def test_friction_acts_at_the_contact_point_with_its_moment_about_b():
    """The first acceleration agrees with the matrix equation under a force at the front of the probe."""
    attitude, velocity, mu = [0.0, 0.0, 25.0], [0.0, 0.05, -0.08, 0.0, 0.0, 0.0], 0.3
    overrides = {
        "wall.friction": mu,
        "wall.position": 0.0,
        "initial.position": [PUSH / K_C, 0.0, 0.0],
        "initial.attitude_deg": attitude,
        "reference.attitude_deg": attitude,
        "initial.velocity": velocity,
        "simulation.duration": 1e-3,
    }
    trace = simulate(Scenario.load("push_wall", overrides), log_rate="full")
    f, quat, nu = trace.f_contact_W[0], trace.quat_WB[0], trace.nu[0]
    R = rotation(quat)
    slip = (R @ nu[:3])[1:]
    normal = -f[0]
    assert f[1:] == pytest.approx(-mu * normal * slip / np.linalg.norm(slip), rel=1e-3)
    arm = np.array([trace.header.geometry.reach - 0.5 * PUSH / K_C, 0.0, 0.0])
    wrench = np.concatenate([R.T @ f, R.T @ np.cross(arm, f)])
    assert np.abs(wrench[3:]).max() > 0.1
    expected = matrix_acceleration(TwinParameters(), trace.p_WB[0], quat, nu, trace.tau[0] + wrench, 0.0)
    assert np.allclose(trace.nu_dot[0], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_a_reversal_of_the_slip_gives_the_textbooks_loop():
    """Force over displacement is a parallelogram of slope k_t between +-mu F_n (Jenkins element).

    Its area is 4 mu F_n (a - mu F_n / k_t) for an amplitude a.
    """
    k_t, mu, depth, amplitude, n = 2e4, 0.3, 1e-4, 2e-3, 1000
    limit = mu * K_C * depth
    (pair, surface), p = pressed(k_t, 0.0, mu), np.array([depth, 0.0, 0.0])
    y = amplitude * np.sin(2.0 * np.pi * np.arange(3 * n + 1) / n)
    force = np.zeros_like(y)
    for k in range(len(y)):
        nu = np.array([0.0, y[k] - y[max(k - 1, 0)], 0.0, 0.0, 0.0, 0.0])  # per time step of 1 s
        pair_force(pair, surface, p, np.eye(3), nu, 1.0)
        force[k] = pair.contact.f_W[1]
    # the play operator is the element's closed form for any motion
    expected, offset = np.zeros_like(y), 0.0
    for k in range(len(y)):
        offset = min(max(offset, y[k] - limit / k_t), y[k] + limit / k_t)
        expected[k] = -k_t * (y[k] - offset)
    assert np.allclose(force, expected, atol=1e-9 * limit)
    cycle = slice(2 * n, 3 * n + 1)
    area = -np.trapezoid(force[cycle], y[cycle])
    assert area == pytest.approx(4.0 * limit * (amplitude - limit / k_t), rel=1e-5)


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1))
def test_the_contact_never_gives_back_more_energy_than_its_spring_holds(seed):
    """Spring, damper and slider are passive under any motion along the face and any normal force."""
    rng = np.random.default_rng(seed)
    k_t, b_t, mu = 10.0 ** rng.uniform(2, 6), 10.0 ** rng.uniform(-1, 5), rng.uniform(0.01, 2.0)
    pair, surface = pressed(k_t, b_t if rng.random() < 0.8 else 0.0, mu)
    contact = pair.contact
    h, dissipated, stored, velocity = 1e-4, 0.0, 0.0, np.zeros(3)
    for k in range(120):
        velocity[1:] = 0.9 * velocity[1:] + rng.normal(size=2) * 10.0 ** rng.uniform(-4, 0)
        depth = 0.0 if rng.random() < 0.02 else 1e-4 * rng.uniform(0.1, 2.0)
        pair_force(pair, surface, np.array([depth, 0.0, 0.0]), np.eye(3), np.r_[velocity, np.zeros(3)], h)
        work = -h * contact.f_tangential_W @ velocity
        now = 0.5 * k_t * contact.stretch_W @ contact.stretch_W
        if k:  # at the first touch the spring is not stretched yet
            dissipated += work - (now - stored)
            assert work - (now - stored) >= -1e-12 * (abs(work) + now + stored)
        stored = now
        assert np.linalg.norm(contact.f_tangential_W) <= mu * K_C * depth * (1.0 + 1e-12)
        assert contact.f_tangential_W[0] == 0.0
    assert dissipated > 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("mu", "speed"), [(0.05, 0.4), (0.5, 0.05), (0.5, 0.4)])
@pytest.mark.parametrize("engine", ["mujoco", "free_body"])
def test_gsta_slides_along_the_wall_without_spikes(mu, speed, engine):
    """The vehicle pushes with 7.5 N and slides: it stays in contact, F_t/F_n = mu, the impact has the peak force."""
    ramp = [{"time": 8.0 + 0.1 * i, "position": [1.05, speed * 0.1 * (i + 1), 0.0]} for i in range(40)]
    overrides = {
        "reference.waypoints": [{"time": 1.0, "position": [1.05, 0.0, 0.0]}, *ramp],
        "wall.friction": mu,
        "simulation.duration": 12.0,
    }
    trace = simulate(Scenario.load("push_wall", overrides), engine=engine)
    settled, slides = trace.t > 7.5, (trace.t > 10.0) & (trace.t < 11.5)
    f = trace.f_contact_W
    assert np.abs(trace.nu[slides, 1]).min() > 0.75 * speed
    assert np.hypot(f[slides, 1], f[slides, 2]) == pytest.approx(mu * trace.push[slides], rel=1e-4)
    assert trace.push[settled].min() > 0.99 * 7.4888
    assert trace.push[settled].max() < 7.63
    assert trace.force_peak[-1] == trace.force_peak[trace.t > 7.5][0]


def test_badly_resolved_friction_is_noted():
    base = Scenario.load("push_wall", {"wall.friction": 0.2, "simulation.duration": 0.01})
    with pytest.warns(SamplingWarning, match="sticking friction is badly resolved"):
        simulate(base.updated({"wall.tangential_stiffness": 6e7, "wall.tangential_damping": 0.0}))


def test_settings_of_friction_without_friction_are_noted():
    scenario = Scenario.load("push_wall", {"wall.tangential_stiffness": 1e4, "simulation.duration": 1e-3})
    with pytest.warns(SamplingWarning, match=r"no effect: wall\.friction is 0"):
        simulate(scenario)
