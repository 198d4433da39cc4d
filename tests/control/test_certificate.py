"""The gain certificate: closed form against an LMI, and the error system against many disturbances."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from certified import certificate_of, lyapunov_matrix
from uvms_mj import Gsta, InputError
from uvms_mj.control.theory.certificate import Certificate, gains_for, rate_bound

PAPER = (5.0, 10.0)
GAINS = [(5.0, 10.0), (2.0, 10.0), (0.7, 3.0), (12.0, 40.0), (1.5, 2.0)]
gains = st.tuples(st.floats(0.1, 30.0), st.floats(0.1, 100.0))


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


GAINS = [(5.0, 10.0, 0.0), (5.0, 10.0, 5.0), (2.0, 10.0, 0.0), (2.0, 10.0, 5.0)]
"""k_1, k_2 and beta. All are simulated at once, each in a row."""


def test_below_the_bound_every_disturbance_is_rejected_to_a_band_that_shrinks_with_the_step(rng):
    k_1, k_2, beta = np.array(GAINS).T[..., None]
    rate = np.array([[0.9 * rate_bound(*gains[:2])] for gains in GAINS])
    s, w = starts(rng)
    steps, end = np.array([1e-3, 5e-4, 2.5e-4]), 6.0
    varphi_dot = disturbances(rng, end)
    bands = np.array([run(k_1, k_2, beta, rate, varphi_dot, h, end, s, w)[:2] for h in steps])
    largest = bands.max(axis=-1) / k_2[:, 0]
    of_s, of_w = largest[:, 0] / steps[:, None] ** 2, largest[:, 1] / steps[:, None]
    assert ((of_s > 0.5) & (of_s < 15.0)).all()
    assert ((of_w > 1.0) & (of_w < 5.0)).all()
    # the band is 16 and 4 times smaller without a cycle of the sampled system, such as the worst rate excites
    smaller = np.median(bands[0] / bands[2], axis=-1)
    assert smaller[0] == pytest.approx(16.0, rel=0.25)
    assert smaller[1] == pytest.approx(4.0, rel=0.25)


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


@pytest.mark.slow
def test_the_lyapunov_function_falls_along_every_solution(rng):
    k_1, k_2, beta = np.array(GAINS).T[..., None]
    bounds = [rate_bound(*gains[:2]) for gains in GAINS]
    P = np.array([lyapunov_matrix(*gains[:2], 0.97 * bound) for gains, bound in zip(GAINS, bounds, strict=True)])
    values = []

    def seen(t, s, phi_1, w):
        values.append(P[:, 0, :1] * phi_1**2 + 2.0 * P[:, 0, 1:] * phi_1 * w + w**2)

    rate = 0.9 * np.array(bounds)[:, None]
    run(k_1, k_2, beta, rate, disturbances(rng, 2.0), 1e-4, 2.0, *starts(rng), seen)
    V = np.array(values[::20])
    outside = V[:-1] > 1e-3 * k_2  # outside the band caused by sampling
    assert (outside.sum(axis=(0, 2)) > 3000).all()
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


@pytest.mark.slow
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
