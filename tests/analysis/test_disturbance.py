"""The lumped disturbance of eq. (11): from the water and from eq. (10), and the plant's response to it."""

import numpy as np
import pytest

from certified import certificate_of
from uvms_mj import Gsta, Scenario, simulate
from uvms_mj.analysis.residual import Experienced, experienced, lumped_disturbance
from uvms_mj.control.theory.certificate import gains_for
from uvms_mj.physics.fossen import coriolis_added_mass, coriolis_rigid_body, damping, restoring
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.setup.base import set_up
from vehicles import random_parameters, vehicle_xml

FREE = {"wall.position": 50.0, "reference.target": [0.0, 0.0, 0.0], "current.speed": 0.0}


OTHER_WORLD = {
    "simulation.duration": 2.0,
    "current.speed": 0.6,
    "current.direction_deg": 40.0,
    "reference.target": [0.3, 0.2, -0.1],
    "reference.step_time": 0.0,
    "reference.attitude_deg": [10.0, -20.0, 30.0],
    "wall.position": 0.1,
    "initial.velocity": [0.1, -0.1, 0.05, 0.1, 0.2, -0.1],
    "disturbance.bias": [1.0, 0.0, 0.0, 0.0, 0.0, 0.02],
    "disturbance.amplitude": [3.0, 0.0, 2.0, 0.0, 0.01, 0.0],
    "disturbance.frequency_hz": [0.3, 0.0, 1.0, 0.0, 2.0, 0.0],
    "estimates.coriolis": 0.5,
    "estimates.damping": 1.3,
    "estimates.restoring": 0.7,
}


def residual_of_eq_10(trace, rows):
    """tau_bar_dist from eq. (10) in some rows: the part of M_hat nu_dot that the estimates, tau and tau_c leave
    unexplained."""
    setup = set_up(trace.scenario, trace.header.mjcf)
    vehicle, factors = setup.nominal, trace.scenario.estimates
    gravity_W, term = setup.gravity_W, np.empty(6)
    out = trace.nu_dot[rows] @ setup.design.M_hat.T - trace.tau[rows]
    for k, (nu, quat, f_W) in enumerate(zip(trace.nu[rows], trace.quat_WB[rows], trace.f_contact_W[rows], strict=True)):
        R_WB = rotation_matrix(quat)
        out[k, :3] -= R_WB.T @ f_W  # without friction the wall exerts no moment
        coriolis_rigid_body(vehicle.M_RB, nu, term)
        out[k] += factors.coriolis * term
        coriolis_added_mass(vehicle.M_A, nu, term)
        out[k] += factors.coriolis * term
        damping(vehicle.D_linear, vehicle.D_quadratic, nu, term)
        out[k] += factors.damping * term
        restoring(vehicle.mass, vehicle.displaced_mass, vehicle.r_g, vehicle.r_b, gravity_W, R_WB, term)
        out[k] += factors.restoring * term
    return out


LIMITED = Mjcf(
    "limited.xml",
    {"limited.xml": vehicle_xml(random_parameters(3)).replace("<motor", '<motor ctrlrange="-9 9" ').encode()},
)
"""A different vehicle, with all degrees of freedom coupled and with weak thrusters."""
DAMPED = {
    "vehicle.linear_damping": 1.5,
    "vehicle.quadratic_damping": 0.6,
    "vehicle.displaced_mass": 0.97,
    "vehicle.thruster_offset": [[0.02, 0.01, -0.01], [0.0, 0.02, 0.01], [-0.02, 0.0, 0.02], *[[0.0, 0.0, 0.0]] * 3],
}
UNSTEADY = {
    "current.amplitude": [0.2, 0.1, 0.1],
    "current.frequency_hz": [0.3, 0.5, 0.7],
    "current.deviation": [0.1, 0.1, 0.1],
    "current.shear": [[-1.0, 1.3], [1.0, 0.5]],
    "sea.height": 0.3,
    "sea.direction_deg": 25.0,
    "sea.depth": 6.0,
    "tether.length": 10.0,
    "tether.position": [-0.2, 0.1, 0.0],
}
ANOTHER = DAMPED | {"vehicle.mass": 1.2, "vehicle.added_mass": 0.7}


@pytest.mark.slow
@pytest.mark.parametrize("mjcf", [None, LIMITED], ids=["bluerov1", "any vehicle"])
@pytest.mark.parametrize(
    "overrides",
    [{}, {"estimates.inertia": 0.9}, ANOTHER, ANOTHER | UNSTEADY],
    ids=["M_hat = M", "M_hat = 0.9 M", "another true vehicle", "unsteady water"],
)
def test_eq_11_from_the_water_is_what_eq_10_leaves_unexplained(overrides, mjcf):
    world = OTHER_WORLD | ({"simulation.duration": 0.2} if mjcf is LIMITED else {})
    trace = simulate(Scenario.load("push_wall", world | overrides), mjcf=mjcf)
    tau_bar = lumped_disturbance(trace, set_up(trace.scenario, mjcf))
    assert (np.abs(tau_bar).max(axis=0) > 1e-3).all()
    assert (trace.touches[-1] > 0) == (mjcf is None)
    rows = slice(None, None, 7)
    assert np.allclose(tau_bar[rows], residual_of_eq_10(trace, rows), atol=1e-9)


def test_eq_11_in_the_papers_scenario(paper_run):
    trace = paper_run("gsta")
    tau_bar = lumped_disturbance(trace, set_up(trace.scenario))
    assert tau_bar[0] == pytest.approx([-2.144, 6.754, 0.0, 0.0, 0.0, tau_bar[0, 5]], abs=1e-3)
    rows = slice(None, None, 20)
    assert np.allclose(tau_bar[rows], residual_of_eq_10(trace, rows), atol=1e-9)


CASES = {
    "gsta": (None, {"wall.position": 0.02}),
    "gsta alone": (None, {"wall.position": 0.02, "controller.nominal": False}),
    "another true vehicle": (None, {"wall.position": 0.02, **DAMPED}),
    "weak thrusters": (LIMITED, {"simulation.duration": 0.2}),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_what_is_experienced_is_what_moves_s(case):
    """s_dot = -k_1 phi_1 + z + varphi of eq. (28), plus A s for GSTA alone, holds up to the inertia of the wall."""
    mjcf, overrides = CASES[case]
    world = OTHER_WORLD | {"simulation.duration": 1.0, "simulation.timestep": 2e-5, "task.F_1": 1.5}
    trace = simulate(Scenario.load("push_wall", world | overrides), log_rate="full", mjcf=mjcf)
    law, found = trace.scenario.controller, experienced(trace)
    assert (np.abs(trace.tau - trace.tau_cmd).max() > 1.0) == (case in ("weak thrusters", "another true vehicle"))
    s, h = trace.s, trace.scenario.simulation.timestep
    s_dot = -law.k_1 * (np.sqrt(np.abs(s)) * np.sign(s) + law.beta * s) + trace.z + found.varphi
    if not law.nominal:
        s_dot += np.array(trace.scenario.task.A) * s
    apart = np.abs(np.diff(s, axis=0) / h - s_dot[:-1])
    free = (trace.f_contact_W[:-1, 0] == 0.0) & (trace.f_contact_m_W[:-1, 0] == 0.0)
    assert free.all() == (mjcf is LIMITED)
    assert apart[free].max() < 1e-3 < 0.005 * np.abs(found.varphi).max(axis=0).min()
    assert (apart.max(axis=0) < found.contact_lag + 1e-3).all()
    assert found.contact_lag.max() < 1e-3  # the law runs at every step


def test_the_time_beyond_counts_with_s_where_it_is_least():
    """Between two rows s may pass zero, where the allowed rate is smallest."""
    certificate = certificate_of(Gsta())
    s = np.zeros((4, 6))
    s[:, 0], s[:, 1] = [1.0, 1.0, 0.0, 0.0], [1.0, -1.0, -1.0, 2.0]
    rate = np.full((3, 6), 6.0)  # the allowed rate is 5 at s = 0 and 330 at s = 1
    rate[:, 2] = [5.01, 4.99, -5.01]
    found = Experienced(np.array([0.0, 0.1, 0.3, 0.7]), np.zeros((4, 6)), rate, np.ones(6), np.zeros(6))
    assert found.time_beyond(certificate, s) == pytest.approx([0.6, 0.5, 0.5, 0.7, 0.7, 0.7])
    assert found.largest_rate(0.1)[2] == 5.01
    assert found.largest_rate(0.05, 0.3)[2] == 4.99


@pytest.mark.parametrize("key", ["estimates.inertia", "vehicle.mass", "vehicle.added_mass"])
def test_why_there_is_no_disturbance(key):
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.01, key: 0.9}))
    found = experienced(trace)
    assert isinstance(found, str)
    assert "M_hat is not M" in found


def sinusoid(factor, timestep=1e-4, frequency=0.5):
    """A run in still water without contact, with a surge force whose varphi_dot has the amplitude factor * k_2/2."""
    amplitude = factor * 5.0 / (2.0 * np.pi * frequency) * 12.81
    world = FREE | {
        "simulation.duration": 4.0,
        "simulation.timestep": timestep,
        "disturbance.amplitude": [amplitude, 0, 0, 0, 0, 0],
        "disturbance.frequency_hz": [frequency, 0, 0, 0, 0, 0],
    }
    return simulate(Scenario.load("push_wall", world))


def test_the_plant_rejects_a_sinusoid_just_below_the_bound_and_not_one_above():
    certificate = certificate_of(Gsta())
    below, fine, above, higher = sinusoid(0.95), sinusoid(0.95, 2.5e-5), sinusoid(1.15), sinusoid(1.4)
    rates = [experienced(trace).largest_rate()[0] for trace in (below, above, higher)]
    assert rates == pytest.approx([4.75, 5.75, 7.0], rel=0.02)
    residuals = [np.abs(trace.s[2000:, 0]).max() for trace in (below, fine, above, higher)]
    assert residuals[0] / residuals[1] == pytest.approx(16.0, rel=0.5)  # the band caused by sampling
    assert residuals[0] < 1e-6
    assert residuals[2] > 1e-5
    assert residuals[3] > 2.0 * residuals[2]
    assert not experienced(below).time_beyond(certificate, below.s).any()
    assert experienced(above).time_beyond(certificate, above.s)[0] > 0.1
    assert not experienced(above).time_beyond(certificate, above.s)[1:].any()


def test_the_papers_gains_are_not_certified_in_yaw_and_gains_for_its_rate_are(paper_run):
    """In yaw varphi is the current's Munk moment (Y_vdot - X_udot) u_r v_r over I_z.

    It changes with the speed, fastest at the first impact, which reverses the vehicle's motion.
    """
    trace = paper_run("gsta")
    found = experienced(trace)
    setup = set_up(trace.scenario, trace.header.mjcf)
    M_A, I_z = np.diag(setup.vehicle.M_A), setup.design.M[5, 5]
    yaw = 2.0 * np.arctan2(trace.quat_WB[:, 3], trace.quat_WB[:, 0])
    heading = np.deg2rad(trace.scenario.current.direction_deg) - yaw
    u, v = trace.nu[:, 0], trace.nu[:, 1]
    u_r, v_r = u - trace.scenario.current.speed * np.cos(heading), v - trace.scenario.current.speed * np.sin(heading)
    munk = (M_A[1] - M_A[0]) * (u * v - u_r * v_r) / I_z
    assert np.allclose(found.rate[:, 5], np.diff(munk) / np.diff(trace.t), rtol=0, atol=1e-6)
    rate = found.largest_rate()
    assert found.t[np.abs(found.rate[:, 5]).argmax()] == pytest.approx(trace.first_contact[-1], abs=0.03)
    assert (rate[:5] < 1.0).all()
    beyond = found.time_beyond(certificate_of(Gsta()), trace.s)
    assert not beyond[:5].any()
    assert beyond[5] > 0.1
    k_1, k_2 = gains_for(rate.max())
    again = paper_run("gsta", k_1=k_1, k_2=k_2)
    law = again.scenario.controller
    assert not experienced(again).time_beyond(certificate_of(law), again.s).any()
    assert np.abs(again.s[1000:, 5]).max() < 0.1 * np.abs(trace.s[1000:, 5]).max()
