"""The natural inertia: Ott's damping in machine code, force feedback that cancels, energy that falls."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armed import armed_xml
from uvms_mj import Scenario, Simulation, simulate
from uvms_mj.analysis.residual import impedance_error
from uvms_mj.control.design import ott_damping
from uvms_mj.control.task import natural_damping
from uvms_mj.engine.native.compilation import native_function
from uvms_mj.errors import InputError
from uvms_mj.setup.base import set_up

NATURAL = {"impedance.M_d": "natural"}
_matrix, _six = np.dtype(("f8", (6, 6))), np.dtype(("f8", (6,)))
RATIO = np.dtype([("damping_ratio", "f8")], align=True)


def _damping(M, K_d, settings, D_d):
    natural_damping(M, K_d, settings.damping_ratio, D_d)


_native = native_function(_damping, [_matrix, _six, RATIO, _matrix]).ctypes


def damping(M, K_d, ratio):
    """D_d (6, 6) by machine code."""
    D_d, settings = np.full((6, 6), np.nan), np.array([ratio], RATIO)
    arrays = M, K_d, settings, D_d
    _native(*(each.ctypes.data for each in arrays))
    return D_d


def inertia(rng):
    """A random inertia with the scales of a vehicle: kg and kg m^2."""
    A = rng.normal(size=(6, 6)) * np.sqrt([[20.0]] * 3 + [[0.3]] * 3)
    return A @ A.T + np.diag([5.0] * 3 + [0.05] * 3)


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.95), st.integers(0, 3))
def test_every_mode_has_the_damping_ratio(seed, ratio, free):
    """Eigenvalues of M x'' + D x' + K x = 0; a direction without stiffness has no damping."""
    rng = np.random.default_rng(seed)
    M, K_d = inertia(rng), 10.0 ** rng.uniform(0.0, 4.0, size=6)
    K_d[:free] = 0.0
    D = damping(M, K_d, ratio)
    assert np.allclose(D, D.T, rtol=0.0, atol=1e-12 * np.abs(D).max())
    assert np.allclose(D, ott_damping(M, np.diag(K_d), ratio), rtol=0.0, atol=1e-10 * np.abs(D).max())
    I, O = np.eye(6), np.zeros((6, 6))  # noqa: E741
    poles = np.linalg.eigvals(np.block([[O, I], [-np.linalg.solve(M, np.diag(K_d)), -np.linalg.solve(M, D)]]))
    moving = poles[np.argsort(np.abs(poles))][2 * free :]
    assert np.allclose(-moving.real / np.abs(moving), ratio, rtol=0.0, atol=1e-6)


@given(st.integers(0, 2**32 - 1))
def test_the_damping_is_twice_the_geometric_mean_of_inertia_and_stiffness(seed):
    """Without eigenvalues: D M^-1 D = 4 zeta^2 K, Riccati's equation of the mean."""
    rng = np.random.default_rng(seed)
    M, K_d = inertia(rng), 10.0 ** rng.uniform(0.0, 4.0, size=6)
    D = damping(M, K_d, 0.7)
    assert np.allclose(D @ np.linalg.solve(M, D), 4.0 * 0.49 * np.diag(K_d), rtol=0.0, atol=1e-9 * K_d.max())


NEAR = {"wall.position": 0.2, "reference.target": [0.3, 0.05, 0.0], "simulation.duration": 3.0}
WRONG = NEAR | {"estimates.inertia": 1.3, "estimates.damping": 0.7, "current.speed": 0.1}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("law", ["impedance", "pid", "dob_impedance", "parallel", "ideal", "aismc"])
def test_for_a_rigid_vehicle_it_is_a_constant_inertia(law):
    base = Scenario.load("push_wall", WRONG, law)
    constant = simulate(base.updated({"impedance.M_d": set_up(base).design.M_hat.tolist()}))
    natural = simulate(base.updated(NATURAL))
    assert constant.touches[-1] > 0.0
    for name in ("p_WB", "nu", "tau_cmd", "f_contact_W"):
        assert np.allclose(natural[name], constant[name], rtol=0.0, atol=1e-9 * np.abs(constant[name]).max()), name


@pytest.mark.parametrize("law", ["impedance", "gsta"])
def test_both_engines_and_the_closed_form_agree(law):
    still = {"current.speed": 0.0} if law == "impedance" else {}
    settings = NEAR | NATURAL | still | {"simulation.duration": 8.0, "estimates.inertia": 1.2}
    scenario = Scenario.load("push_wall", settings, law)
    slow, fast = simulate(scenario, log_rate=10.0), simulate(scenario, log_rate=10.0, engine="free_body")
    assert slow.push[-1] == pytest.approx(slow.analytic.force, rel=1e-4)
    assert fast.push[-1] == pytest.approx(slow.analytic.force, rel=1e-4)


def test_the_law_needs_no_force():
    """A sensor that is wrong by 3 N changes nothing; with another inertia it does."""
    wrong = {"navigation.name": "sensors", "navigation.force_bias": [3.0, -2.0, 1.0]}
    for M_d, same in (("natural", True), (None, False)):
        base = Scenario.load("push_wall", WRONG | ({"impedance.M_d": M_d} if M_d else {}), "impedance")
        blind, told = simulate(base.updated(wrong)), simulate(base)
        difference = np.abs(blind.tau_cmd - told.tau_cmd).max()
        assert (difference < 1e-9) == same


def test_energy_falls_in_free_motion():
    """V = nu^T M nu/2 + k |p - p_d|^2/2 + 2 kappa (1 - q_w): V_dot = -nu^T D_d nu with exact estimates."""
    free = {
        "current.speed": 0.0,
        "wall.present": False,
        "reference.target": [0.0, 0.0, 0.0],
        "simulation.duration": 6.0,
    }
    k, kappa = 80.0, 12.0
    start = {"initial.velocity": [0.4, -0.3, 0.2, 0.5, -0.7, 0.6], "initial.attitude_deg": [30.0, -20.0, 50.0]}
    settings = free | start | NATURAL | {"impedance.K_d": [k] * 3 + [kappa] * 3, "impedance.damping_ratio": 0.2}
    scenario = Scenario.load("push_wall", settings, "impedance")
    trace = simulate(scenario, log_rate=100.0)
    design, nu = set_up(scenario).design, trace.nu
    half_angle = np.linalg.norm(trace.eta_e[:, 3:], axis=1)
    potential = 0.5 * k * (trace.eta_e[:, :3] ** 2).sum(axis=1) + 2.0 * kappa * (1.0 - np.sqrt(1.0 - half_angle**2))
    V = 0.5 * np.einsum("ki,ij,kj->k", nu, design.M, nu) + potential
    assert (np.diff(V)[V[:-1] > 1e-6] < 0.0).all()
    lost = np.einsum("ki,ij,kj->k", nu, design.D_d, nu)
    assert V[0] - V[-1] == pytest.approx(np.trapezoid(lost, trace.t), rel=2e-3)
    assert V[-1] < 0.1 * V[0]


def test_a_reset_does_not_change_between_a_natural_and_a_constant_inertia():
    with (
        Simulation(Scenario.load("push_wall", NATURAL, "impedance")) as sim,
        pytest.raises(InputError, match=r"impedance.M_d: reset can't change between a natural and a constant"),
    ):
        sim.reset(overrides={"impedance.M_d": [10.0] * 6})


def test_damping_that_is_given_stays():
    given_damping = [30.0, 40.0, 50.0, 3.0, 4.0, 5.0]
    with Simulation(Scenario.load("push_wall", NATURAL | {"impedance.D_d": given_damping}, "impedance")) as sim:
        sim.step(20)
        assert np.array_equal(sim.signals.D_d, np.diag(given_damping))
        assert np.array_equal(sim.signals.M_d, sim.signals.M_hat)


@pytest.fixture(scope="module")
def at_tool(tmp_path_factory):
    """An arm of four joints that swings below a tool, without water's drag in the energy."""
    path = tmp_path_factory.mktemp("armed") / "armed.xml"
    path.write_text(armed_xml(4))
    settings = {"vehicle.model": str(path), "task.frame": "tool", "wall.present": False, "current.speed": 0.0}
    settings |= NATURAL | {"initial.joints": [0.3, -0.8, 0.5, 0.4], "reference.step_time": 0.0}
    settings |= {"posture.joints": [-0.6, 0.5, -0.4, 0.2], "posture.order": ["joints"], "simulation.timestep": 5e-4}
    settings |= {"posture.period": 1e-6}  # every control instant: the projection is that of the instant
    initial = set_up(Scenario.load("push_wall", settings)).initial
    return settings | {"reference.target": initial.position, "reference.attitude_deg": initial.attitude_deg}


@pytest.mark.slow
def test_at_a_tool_inertia_and_damping_follow_the_arm(at_tool):
    """M_d is Lambda of each instant; D_d is Ott's for it every damping_period, and is held between."""
    scenario = Scenario.load("push_wall", at_tool | {"impedance.damping_period": 2e-3}, "impedance")
    with Simulation(scenario) as sim:
        K_d, first = sim.setup.design.K_d, np.array(sim.signals.M_hat)
        for _ in range(120):
            D_d = ott_damping(np.array(sim.signals.M_hat), K_d, 1.0)
            assert np.allclose(sim.signals.D_d, D_d, rtol=0.0, atol=1e-9 * D_d.max())
            held = np.array(sim.signals.D_d)
            for _ in range(3):
                sim.step()
                assert np.array_equal(sim.signals.M_d, sim.signals.M_hat)
                assert np.array_equal(sim.signals.D_d, held)
            sim.step()
        assert np.abs(sim.signals.M_hat - first).max() > 0.05 * np.abs(first).max()


@pytest.mark.slow
def test_at_a_tool_the_law_needs_no_force(at_tool):
    settings = at_tool | {"estimates.inertia": 1.2, "simulation.duration": 0.5}
    wrong = settings | {"navigation.name": "sensors", "navigation.force_bias": [3.0, -2.0, 1.0]}
    told, blind = (simulate(Scenario.load("push_wall", each, "impedance")) for each in (settings, wrong))
    with pytest.raises(InputError, match=r"impedance\.M_d: 'natural' changes with the posture of the arm"):
        impedance_error(told)
    assert np.abs(blind.f_contact_m_W - told.f_contact_m_W).max() > 1.0
    assert np.allclose(blind.tau_cmd, told.tau_cmd, rtol=0.0, atol=1e-8)


def test_at_a_tool_the_energy_falls_by_the_damping_less_half_the_change_of_inertia(at_tool):
    """V_dot = -nu_e^T (D_d - Lambda_dot/2) nu_e with exact estimates, to first order of the time step."""
    k, kappa, errors = 60.0, 8.0, []
    for h in (4e-4, 2e-4):
        settings = at_tool | {"initial.velocity": [0.3, -0.2, 0.2, 0.4, 0.3, -0.5], "simulation.timestep": h}
        settings |= {"impedance.K_d": [k] * 3 + [kappa] * 3, "impedance.damping_ratio": 0.3, "task.inertia_period": h}
        V, lost, before = [], 0.0, None
        with Simulation(Scenario.load("push_wall", settings, "impedance")) as sim:
            for step in range(round(1.2 / h)):
                nu, Lambda, eta_e = (np.array(sim.signals[name]) for name in ("nu_e", "M_hat", "eta_e"))
                if step % round(0.04 / h) == 0:
                    q_w = np.sqrt(1.0 - eta_e[3:] @ eta_e[3:])
                    V.append(0.5 * nu @ Lambda @ nu + 0.5 * k * eta_e[:3] @ eta_e[:3] + 2.0 * kappa * (1.0 - q_w))
                    found = lost
                lost += h * nu @ np.array(sim.signals.D_d) @ nu
                lost -= 0.0 if before is None else 0.5 * nu @ (Lambda - before) @ nu
                before = Lambda
                sim.step()
        assert (np.diff(V) < 0.0).all()
        errors.append(abs(V[0] - V[-1] - found) / V[0])
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.2)
    assert errors[1] < 5e-3
