"""The gain certificate: closed form against an LMI, error system against many disturbances, plant against eq. (11)."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from uvms_mj import Gsta, InputError, McapLog, Scenario, simulate
from uvms_mj.analysis.disturbance import Experienced, NotGiven, experienced, lumped_disturbance
from uvms_mj.analysis.setup import set_up
from uvms_mj.cli.certify import certify
from uvms_mj.control.certificate import Certificate, gains_for, lyapunov_matrix, rate_bound
from uvms_mj.control.theory import certificate
from uvms_mj.physics.fossen import coriolis_added_mass, coriolis_rigid_body, damping, restoring
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.plant.mjcf import Mjcf
from vehicles import random_parameters, vehicle_xml

PAPER = (5.0, 10.0)
GAINS = [(5.0, 10.0), (2.0, 10.0), (0.7, 3.0), (12.0, 40.0), (1.5, 2.0)]
gains = st.tuples(st.floats(0.1, 30.0), st.floats(0.1, 100.0))


def certificate_of(law):
    return certificate(SimpleNamespace(scenario=Scenario(controller=law), task=law))


# The closed form


def vertices(k_1, k_2, rate, G_1=(0.0, 0.0)):
    """The system matrices at the corners of the sectors."""
    return [np.array([[-(k_1 - g_1), 1.0], [-(k_2 - g_2), 0.0]]) for g_1 in G_1 for g_2 in (-2.0 * rate, 2.0 * rate)]


def common_lyapunov_matrix(matrices):
    """P with A^T P + P A < 0 for all A, or None if the ellipsoid method proves that no such P exists.

    The largest eigenvalue over all A is convex in (P_11, P_12), with P_22 = 1.
    """
    x = np.zeros(2)
    reach = 10.0 * max(np.abs(A).max() for A in matrices) ** 2
    E = reach**2 * np.eye(2)
    basis = [np.array([[1.0, 0.0], [0.0, 0.0]]), np.array([[0.0, 1.0], [1.0, 0.0]])]
    for _ in range(2000):
        P = np.array([[x[0], x[1]], [x[1], 1.0]])
        pairs = [(*np.linalg.eigh(A.T @ P + P @ A), A) for A in matrices]
        values, vectors, A = max(pairs, key=lambda pair: pair[0][-1])
        if values[-1] < 0.0:
            return P
        v = vectors[:, -1]
        slope = np.array([v @ (A.T @ B + B @ A) @ v for B in basis])
        span = math.sqrt(slope @ E @ slope)
        if values[-1] - span > 0.0:
            return None
        x = x - E @ slope / span / 3.0
        E = 4.0 / 3.0 * (E - 2.0 / 3.0 * np.outer(E @ slope, E @ slope) / span**2)
    raise AssertionError("the ellipsoid method is undecided")


@pytest.mark.parametrize(("k_1", "k_2"), GAINS)
@pytest.mark.parametrize("G_1", [(0.0, 0.0), (-0.3, 0.3), (-20.0, 0.0), (0.2, 0.5), (-300.0, 0.0)])
def test_the_bound_is_where_the_lmi_loses_its_last_solution(k_1, k_2, G_1):
    bound = rate_bound(k_1, k_2, G_1)
    P = common_lyapunov_matrix(vertices(k_1, k_2, 0.999 * bound, G_1))
    assert P is not None
    assert np.linalg.eigvalsh(P)[0] > 0.0
    assert common_lyapunov_matrix(vertices(k_1, k_2, 1.001 * bound, G_1)) is None


@given(gains)
def test_without_a_vanishing_part_the_bound_is_the_circle_criterions(k):
    """The gain of 1 / (p^2 + k_1 p + k_2) is 1 / delta if the Hamiltonian's eigenvalues reach the imaginary axis."""
    k_1, k_2 = k
    A, B, C = np.array([[0.0, 1.0], [-k_2, -k_1]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])

    def gain_is_below(inverse_delta):
        hamiltonian = np.block([[A, B @ B.T / inverse_delta**2], [-C.T @ C, -A.T]])
        eigenvalues = np.linalg.eigvals(hamiltonian)
        return np.abs(eigenvalues.real).min() > 1e-7 * np.abs(eigenvalues).max()

    delta = 2.0 * rate_bound(k_1, k_2)
    assert gain_is_below(1.0 / (0.999 * delta))
    assert not gain_is_below(1.0 / (1.001 * delta))


@given(gains, st.floats(1.001, 3.0), st.floats(0.0, 1.0))
def test_the_bound_grows_with_the_gains_shrinks_with_a_vanishing_part_and_never_passes_the_limit(k, factor, part):
    k_1, k_2 = k
    bound = rate_bound(k_1, k_2)
    assert 0.0 < bound <= k_2 / 2.0
    assert rate_bound(factor * k_1, k_2) >= bound * (1 - 1e-12)
    assert rate_bound(k_1, factor * k_2) > bound
    G = part * k_1
    assert rate_bound(k_1, k_2, (-G, G)) <= bound
    assert rate_bound(k_1, k_2, (-factor * G, factor * G)) <= rate_bound(k_1, k_2, (-G, G))
    assert rate_bound(k_1, 1.01 * k_1**2 / 2.0) < 1.01 * k_1**2 / 4.0  # only k_1^2 >= 2 k_2 reaches the limit
    assert rate_bound(k_1, 0.99 * k_1**2 / 2.0) == 0.99 * k_1**2 / 2.0 / 2.0


@given(gains, st.floats(0.0, 0.999), st.floats(0.0, 0.9), st.floats(0.0, 50.0))
def test_the_lyapunov_matrix_is_one(k, share, part, below):
    k_1, k_2 = k
    G_1 = (-below * k_1, part * k_1)
    rate = share * rate_bound(k_1, k_2, G_1)
    P = lyapunov_matrix(k_1, k_2, rate, G_1)
    assert np.linalg.eigvalsh(P)[0] > 0.0
    for A in vertices(k_1, k_2, rate, G_1):
        assert np.linalg.eigvalsh(A.T @ P + P @ A)[-1] < 0.0
    with pytest.raises(ValueError, match="not below the certified"):
        lyapunov_matrix(k_1, k_2, rate_bound(k_1, k_2, G_1), G_1)


def test_the_papers_gains_reach_the_limit():
    certificate = certificate_of(Gsta())
    assert certificate == Certificate(*PAPER, beta=5.0, nominal=True, rate=5.0, state=250.0, limit=5.0)
    assert rate_bound(2.0, 10.0) == 3.0
    alone = certificate_of(Gsta(nominal=False))
    assert alone.rate == rate_bound(*PAPER, (-20.0, 0.0)) < 5.0
    assert certificate_of(Gsta(nominal=False, beta=0.0)).rate == 0.0
    assert certificate_of(Gsta(k_1=0.0)).rate == certificate_of(Gsta(k_2=0.0)).rate == 0.0


@given(st.floats(1e-3, 1e3), st.floats(0.0, 1e3), st.floats(0.1, 10.0), st.floats(0.0, 2.0))
def test_gains_for_a_bound_have_it_certified_with_the_margin_and_no_k_2_to_spare(rate, state, beta, margin):
    k_1, k_2 = gains_for(rate, state, beta, margin)
    certificate = certificate_of(Gsta(k_1=k_1, k_2=k_2, beta=beta))
    assert certificate.rate >= (1 + margin) * rate * (1 - 1e-12)
    assert certificate.state >= (1 + margin) * state * (1 - 1e-12)
    tight = (certificate.rate / rate, certificate.state / state if state else np.inf)
    assert min(tight) == pytest.approx(1 + margin)
    assert certificate.limit == pytest.approx(certificate.rate)
    assert rate_bound(0.99 * k_1, k_2) < certificate.rate * (1 - 1e-5)
    s = np.logspace(-9, 3, 50)
    assert (certificate.allowed(s) >= (1 + margin) * (rate + state * s) * (1 - 1e-9)).all()


@pytest.mark.parametrize(
    "bad",
    [
        {"rate": -1.0},
        {"rate": math.nan},
        {"rate": math.inf},
        {"rate": 1e308},
        {"rate": 0.0},
        {"rate": 1.0, "state": 1.0},
        {"rate": 1.0, "state": 1.0, "beta": 1e-200},
        {"rate": 1.0, "state": 1.0, "beta": 1e200},
    ],
)
def test_impossible_bounds_are_refused(bad):
    with pytest.raises(InputError, match=r"rate|state|beta"):
        gains_for(**bad)


# The error system, eqs. (28)-(29), by the explicit Euler steps of the closed loop

N = 60
"""Number of disturbances that are simulated at once."""


def worst(t, s, w, s_dot):
    """The worst disturbance: its rate has the sign of s_dot."""
    return np.sign(s_dot)


def disturbances(rng, end):
    """A function of t, s, w, s_dot that returns varphi_dot (N,) between -1 and 1.

    The disturbances are sinusoids, random steps, constants, and adversaries that depend on s and w.
    """
    frequency, phase = rng.uniform(0.05, 20.0, N) * 2.0 * np.pi, rng.uniform(0.0, 2.0 * np.pi, N)
    length = rng.uniform(0.02, 1.0, N)
    levels = rng.uniform(-1.0, 1.0, (N, int(end / 0.02) + 2))
    constant = rng.choice([-1.0, 1.0], N)
    kind = np.arange(N) % 6

    def varphi_dot(t, s, w, s_dot):
        sinusoid = np.sin(frequency * t + phase)
        step = levels[np.arange(N), (t / length).astype(int)]
        return np.choose(kind, [sinusoid, step, constant, worst(t, s, w, s_dot), np.sign(s), np.sign(w * s)])

    return varphi_dot


def run(k_1, k_2, beta, rate, varphi_dot, h, end, s, w, seen=None):
    """(max |s|, max |w|) for each disturbance over the last fifth of the time, and the final s."""
    band_s, band_w = np.zeros_like(s), np.zeros_like(w)
    steps = round(end / h)
    for k in range(steps):
        root = np.sqrt(np.abs(s)) * np.sign(s)
        phi_1 = root + beta * s
        phi_2 = 0.5 * np.sign(s) + 1.5 * beta * root + beta**2 * s
        if seen is not None:
            seen(k * h, s, phi_1, w)
        s_dot = -k_1 * phi_1 + w
        s, w = s + h * s_dot, w + h * (-k_2 * phi_2 + rate * varphi_dot(k * h, s, w, s_dot))
        if k > 0.8 * steps:
            band_s, band_w = np.maximum(band_s, np.abs(s)), np.maximum(band_w, np.abs(w))
    return band_s, band_w, s


def starts(rng):
    return rng.uniform(-0.3, 0.3, N), rng.uniform(-2.0, 2.0, N)


@pytest.mark.parametrize("beta", [0.0, 5.0])
@pytest.mark.parametrize(("k_1", "k_2"), [(5.0, 10.0), (2.0, 10.0)])
def test_below_the_bound_every_disturbance_is_rejected_to_a_band_that_shrinks_with_the_step(k_1, k_2, beta, rng):
    rate, end = 0.9 * rate_bound(k_1, k_2), 6.0
    s, w = starts(rng)
    varphi_dot = disturbances(rng, end)
    steps = (1e-3, 5e-4, 2.5e-4)
    bands = [run(k_1, k_2, beta, rate, varphi_dot, h, end, s, w) for h in steps]
    assert all(0.5 < band[0].max() / (k_2 * h**2) < 15.0 for band, h in zip(bands, steps, strict=True))
    assert all(1.0 < band[1].max() / (k_2 * h) < 5.0 for band, h in zip(bands, steps, strict=True))
    # the band is 16 and 4 times smaller without a cycle of the sampled system, such as the worst rate excites
    assert np.median(bands[0][0] / bands[2][0]) == pytest.approx(16.0, rel=0.25)
    assert np.median(bands[0][1] / bands[2][1]) == pytest.approx(4.0, rel=0.25)


def test_the_standard_super_twistings_band_is_exactly_proportional_to_the_square_of_the_step(rng):
    """The sampled system with beta = 0 is homogeneous. The results agree bit by bit, as all factors are powers of 2."""
    h, n = 2.0**-9, 4000
    s, w = starts(rng)
    band = [
        run(*PAPER, 0.0, 4.5, lambda t, *x, h=each: worst(t, *x), each, n * each, s * (each / h) ** 2, w * (each / h))
        for each in (h, h / 4.0)
    ]
    assert np.array_equal(band[0][0], 16.0 * band[1][0])
    assert np.array_equal(band[0][1], 4.0 * band[1][1])
    assert (band[0][0] > 0.0).all()


@pytest.mark.parametrize("beta", [0.0, 5.0])
@pytest.mark.parametrize(("k_1", "k_2"), [(5.0, 10.0), (2.0, 10.0)])
def test_the_lyapunov_function_falls_along_every_solution(k_1, k_2, beta, rng):
    rate, h = 0.9 * rate_bound(k_1, k_2), 1e-4
    P = lyapunov_matrix(k_1, k_2, 0.97 * rate_bound(k_1, k_2))
    values = []

    def seen(t, s, phi_1, w):
        values.append(P[0, 0] * phi_1**2 + 2.0 * P[0, 1] * phi_1 * w + w**2)

    run(k_1, k_2, beta, rate, disturbances(rng, 2.0), h, 2.0, *starts(rng), seen)
    V = np.array(values[::20])
    outside = V[:-1] > 1e-3 * k_2  # outside the band caused by sampling
    assert outside.sum() > 3000
    assert (np.diff(V, axis=0)[outside] < 0.0).all()


def test_the_state_dependent_part_is_certified_with_the_rate_and_not_beyond():
    """A rate of L + L_s |s| pushes outwards, starting far away, where the second term dominates."""
    certificate = certificate_of(Gsta())
    s = np.array([4.0, -6.0])
    w = 5.0 * (np.sqrt(np.abs(s)) * np.sign(s) + 5.0 * s)  # s_dot = 0

    def residual(factor):
        def outwards(t, s, w, s_dot):
            return np.sign(s) * (certificate.rate + certificate.state * np.abs(s))

        return np.abs(run(*PAPER, 5.0, factor, outwards, 1e-3, 10.0, s, w)[0]).max()

    assert residual(0.95) < 1e-4
    assert residual(1.3) > 10.0


@pytest.mark.parametrize("beta", [0.0, 5.0])
def test_beyond_half_of_k_2_a_constant_rate_keeps_a_residual_that_grows(beta):
    k_1, k_2 = PAPER
    factors = np.array([0.5, 0.95, 1.05, 1.2, 1.5, 2.0])
    rates = factors * k_2 / 2.0
    zero = np.zeros(len(factors))
    _, _, s = run(k_1, k_2, beta, rates, lambda *_: 1.0, 1e-3, 20.0, zero, zero)
    assert (np.abs(s[:2]) < 1e-4).all()
    assert (np.diff(s[2:]) > 0.0).all()
    if beta == 0.0:
        half = run(k_1, k_2, beta, rates, lambda *_: 1.0, 1e-3, 10.0, zero, zero)[2]
        assert (s[2:] > 2.0 * half[2:]).all()  # |s| keeps growing
    else:
        phi_2 = 0.5 + 1.5 * beta * np.sqrt(s) + beta**2 * s
        assert np.allclose(k_2 * phi_2[2:], rates[2:], rtol=1e-6)  # where z_dot can follow the rate again


def test_weak_k_1_loses_to_the_worst_rate_below_half_of_k_2():
    """Weak k_1 lowers the tolerable rate below k_2/2 = 5: 3 is certified, and the limit is 4.38, 1.46 times 3."""
    k_1, k_2 = 2.0, 10.0
    s, w = np.array([0.01]), np.array([0.2])

    def band(rate, end):
        return run(k_1, k_2, 0.0, rate, worst, 2e-4, end, s, w)[1].item()

    assert band(0.99 * rate_bound(k_1, k_2), 4.0) < 0.01
    assert band(4.2, 8.0) < 0.05  # above the bound: a common quadratic V is conservative
    assert band(4.5, 8.0) > 1.3 * band(4.5, 4.0) > 0.5
    assert rate_bound(k_1, k_2) == 3.0


# The plant's disturbance

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


def residual_of_eq_10(trace):
    """tau_bar_dist from eq. (10): the part of M_hat nu_dot that the estimates, tau and tau_c leave unexplained."""
    setup = set_up(trace.scenario, trace.header.mjcf)
    vehicle, factors = setup.vehicle, trace.scenario.estimates
    gravity_W, term = setup.gravity_W, np.empty(6)
    out = trace.nu_dot @ setup.design.M_hat.T - trace.tau
    for k, (nu, quat, f_W) in enumerate(zip(trace.nu, trace.quat_WB, trace.f_contact_W, strict=True)):
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


@pytest.mark.parametrize("mjcf", [None, LIMITED], ids=["bluerov1", "any vehicle"])
@pytest.mark.parametrize("overrides", [{}, {"estimates.inertia": 0.9}], ids=["M_hat = M", "M_hat = 0.9 M"])
def test_eq_11_from_the_water_is_what_eq_10_leaves_unexplained(overrides, mjcf):
    world = OTHER_WORLD | ({"simulation.duration": 0.2} if mjcf is LIMITED else {})
    trace = simulate(Scenario.load("push_wall", world | overrides), mjcf=mjcf)
    tau_bar = lumped_disturbance(trace, set_up(trace.scenario, mjcf))
    assert (np.abs(tau_bar).max(axis=0) > 1e-3).all()
    assert (trace.touches[-1] > 0) == (mjcf is None)
    assert np.allclose(tau_bar, residual_of_eq_10(trace), atol=1e-9)


def test_eq_11_in_the_papers_scenario(paper_run):
    trace = paper_run("gsta")
    tau_bar = lumped_disturbance(trace, set_up(trace.scenario))
    assert tau_bar[0] == pytest.approx([-2.144, 6.754, 0.0, 0.0, 0.0, tau_bar[0, 5]], abs=1e-3)
    assert np.allclose(tau_bar[::10], residual_of_eq_10(trace)[::10], atol=1e-9)


CASES = {
    "gsta": (None, {"wall.position": 0.02}),
    "gsta alone": (None, {"wall.position": 0.02, "controller.nominal": False}),
    "weak thrusters": (LIMITED, {"simulation.duration": 0.2}),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_experienced_is_what_moves_s(case):
    """s_dot = -k_1 phi_1 + z + varphi of eq. (28), plus A s for GSTA alone, holds up to the inertia of the wall."""
    mjcf, overrides = CASES[case]
    world = OTHER_WORLD | {"simulation.duration": 1.0, "simulation.timestep": 2e-5, "controller.F_1": 1.5}
    trace = simulate(Scenario.load("push_wall", world | overrides), log_rate="full", mjcf=mjcf)
    law, found = trace.scenario.controller, experienced(trace)
    assert (np.abs(trace.tau - trace.tau_cmd).max() > 1.0) == (mjcf is LIMITED)
    s, h = trace.s, trace.scenario.simulation.timestep
    s_dot = -law.k_1 * (np.sqrt(np.abs(s)) * np.sign(s) + law.beta * s) + trace.z + found.varphi
    if not law.nominal:
        s_dot += np.array(law.A) * s
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


def test_why_there_is_no_disturbance():
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.01, "estimates.inertia": 0.9}))
    found = experienced(trace)
    assert isinstance(found, NotGiven)
    assert "M_hat is not M" in found.reason


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


# The command


@pytest.fixture
def command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(certify, [str(a) for a in arguments])


SHORT = ("simulation.duration=0.2", "wall.position=50")


def test_the_command_says_what_is_certified_and_what_was_there(command):
    done = command(*SHORT, "--json")
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    assert report["certified"] == {"rate": 5.0, "state": 250.0, "limit": 5.0}
    assert report["is_certified"] is True
    found = report["experienced"]
    assert np.allclose(np.add(found["rate"], found["margin"]), 5.0)
    assert all(len(values) == 6 for values in found.values())
    table = command(*SHORT)
    for text in ("k_1 = 5, k_2 = 10, beta = 5", "5 + 250 |s|", "verdict", "certified: the disturbance", "yaw"):
        assert text in table.stdout
    assert command(*SHORT, "--quiet").stdout == ""


LAWS = """
from dataclasses import dataclass

from uvms_mj import Gsta


@dataclass(frozen=True)
class Same(Gsta):
    k_1: float = 6.0


@dataclass(frozen=True)
class Other(Gsta):
    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.tau_nom
"""


def test_the_certificate_is_for_gstas_law_and_not_for_any_with_its_gains(command, tmp_path):
    (tmp_path / "laws.py").write_text(LAWS)
    same = command("-c", "laws.py:Same", *SHORT, "--json")
    assert json.loads(same.stdout)["gains"]["k_1"] == 6.0
    for law in ("fosm", "laws.py:Same"):
        scenario = Scenario.load("push_wall", {"simulation.duration": 1e-3}, law)
        simulate(scenario, sinks=[McapLog(tmp_path / f"{scenario.controller.label()}.mcap")])
    fosm, recorded = (command("--from", f"{name}.mcap") for name in ("fosm", "Same"))
    assert fosm.exit_code == recorded.exit_code == 2
    assert fosm.stderr.endswith("the laws gsta and sta\n")
    assert "omit --from, give scenario and --controller" in recorded.stderr
    other = command("-c", "laws.py:Other", *SHORT)
    assert other.exit_code == 2
    assert "Other: the certificate covers only the laws gsta and sta" in other.stderr


def test_what_saturated_thrusters_leave_over_is_no_gains_fault(command, tmp_path):
    weak = vehicle_xml(random_parameters(3)).replace("<motor", '<motor ctrllimited="true" ctrlrange="-1 1" ')
    (tmp_path / "weak.xml").write_text(weak)
    report = json.loads(command(*SHORT, "vehicle.model=weak.xml", "--json").stdout)
    assert report["saturated_s"] == pytest.approx(0.2, abs=0.01)
    assert not report["is_certified"]
    assert "at their limits for 0.2 s" in report["verdict"]
    assert "k_1" not in report["verdict"]


def test_not_certified_is_said_plainly_with_gains_that_would_be_and_is_no_failure(command):
    done = command(*SHORT, "controller.k_2=1e-3", "--json")
    report = json.loads(done.stdout)
    assert (done.exit_code, report["is_certified"]) == (0, False)
    assert report["verdict"].startswith("not certified: in ")
    assert min(report["experienced"]["margin"]) < 0.0
    assert "not certified" in command(*SHORT, "controller.k_1=0").stdout
    assert "no verdict" in command(*SHORT, "estimates.inertia=1.1").stdout


def test_a_logs_own_disturbance(command, tmp_path):
    world = dict(item.split("=") for item in SHORT)
    simulate(
        Scenario.load("push_wall", {name: float(value) for name, value in world.items()}),
        sinks=[McapLog(tmp_path / "run.mcap")],
    )
    from_log, from_run = (json.loads(command(*a, "--json").stdout) for a in (("--from", "run.mcap"), SHORT))
    assert from_log == from_run
    refused = command("--from", "run.mcap", "controller.k_1=3")
    assert refused.exit_code == 2
    assert "uses a log unchanged" in refused.output


@pytest.mark.parametrize(
    "gains", [{"k_1": 1e160}, {"beta": 1e200}, {"k_2": 1e160, "k_1": 1e90, "nominal": False}, {"beta": 1e-200}]
)
def test_gains_that_no_computer_squares_are_refused(command, gains):
    with pytest.raises(InputError, match="must be"):
        certificate_of(Gsta(**gains))
    with pytest.raises(InputError, match="k_1 nan"):
        rate_bound(math.nan, 1.0)


def test_a_log_that_may_have_missed_the_fastest_change_gives_no_verdict(command, tmp_path):
    """The largest rate of a coarse log is too small, so that a verdict from it would be too favourable."""
    touching = {"simulation.duration": 1.2, "wall.position": 0.02, "reference.step_time": 0.0}
    rates = {}
    for log_rate in ("full", 1000, 100, 2):
        trace = simulate(Scenario.load("push_wall", touching), log_rate=log_rate)
        found = experienced(trace)
        if isinstance(found, NotGiven):
            assert "--log-rate" in found.reason
        else:
            rates[log_rate] = found.largest_rate()[5]
    assert set(rates) == {"full", 1000}
    assert rates[1000] == pytest.approx(rates["full"], rel=0.01)
    stiff = touching | {"wall.stiffness": 3e7, "simulation.timestep": 2e-5, "controller.period": 1e-4}
    with pytest.warns(UserWarning, match="limit-cycles"):
        every, some = (experienced(simulate(Scenario.load("push_wall", stiff), log_rate=r)) for r in ("full", 1000))
    assert every.doubt == pytest.approx(np.ones(6))
    assert some.largest_rate()[5] < 0.9 * every.largest_rate()[5] < some.largest_rate()[5] * some.doubt[5]
    trace = simulate(Scenario.load("push_wall", touching), log_rate=10, sinks=[McapLog(tmp_path / "coarse.mcap")])
    report = json.loads(command("--from", "coarse.mcap", "--json").stdout)
    assert report["is_certified"] is None
    assert report["verdict"].startswith("no verdict")


def test_gains_for_a_rate_with_a_part_that_grows_with_s(command):
    report = json.loads(command("--rate", "4", "--state", "3000", "controller.beta=5", "--json").stdout)
    assert (report["gains"]["k_1"], report["gains"]["k_2"]) == gains_for(4.0, 3000.0, 5.0)
    assert report["certified_state"] == pytest.approx(1.25 * 3000.0)
    assert report["certified_rate"] > 4.0
    assert command("--state", "30", "-c", "sta").exit_code == 2
    assert "3750" in command("--rate", "4", "--state", "3000").stdout


def test_gains_for_a_rate(command):
    report = json.loads(command("--rate", "4", "--json").stdout)
    assert (report["gains"]["k_1"], report["gains"]["k_2"]) == gains_for(4.0)
    assert report["certified_rate"] == pytest.approx(5.0)
    assert "k_2" in command("--rate", "4").stdout


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("-c", "fosm"), "fosm: the certificate covers only the laws gsta and sta"),
        (("-c", "impedance"), "choose one with --controller gsta"),
        (("--rate", "-1"), "rate -1"),
        (("--rate", "nan"), "rate nan"),
        (("--rate", "1", "controller.nominal=false"), "with nominal control"),
        (("a", "b"), "one scenario at a time"),
        (("--from", "missing.mcap"), "can't read it"),
    ],
)
def test_bad_input_is_one_message(command, arguments, text):
    done = command(*arguments)
    assert done.exit_code == 2
    assert text in done.output
    assert "Traceback" not in done.output
