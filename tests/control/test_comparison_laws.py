"""The laws for comparison: independent NumPy equations, closed forms of rest, convergence, sampling, attacks."""

import dataclasses
import warnings
from types import SimpleNamespace

import numpy as np
import pytest

from uvms_mj import Scenario, simulate
from uvms_mj.analysis.metrics import final_force
from uvms_mj.control import BUILT_IN
from uvms_mj.control.base import SteadyState
from uvms_mj.control.theory.loop import ForceLatency
from uvms_mj.control.theory.predictions import stage_notes, steady_state
from uvms_mj.control.theory.stability import Stability
from uvms_mj.setup.base import set_up

NEW = ("pid", "admittance", "parallel", "dob_impedance", "aismc")
X = 7.31 + 5.5
"""Inertia in surge [kg]."""
AT_WALL = {
    "reference.target": [1.0, 0.0, 0.0],
    "reference.step_time": 0.0,
    "initial.position": [0.99, 0.0, 0.0],
    "impedance.F_d": [-1.5, 0.0, 0.0, 0.0, 0.0, 0.0],
    "simulation.duration": 15.0,
}


def run(law, overrides, engine="free_body", **more):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return simulate(Scenario.load("push_wall", overrides, law), engine=engine, **more)


# the equations once more, in NumPy


def pid(g, x, s):
    xi = np.clip(x.xi, -np.array(g.limit), g.limit)
    tau = s.g_hat - s.K_f * s.F_d - s.K_d * s.eta_e - s.D_d @ s.nu_e - xi
    return tau, {"xi": g.k_i * s.K_d * s.eta_e}


def admittance(g, x, s):
    nu_a_dot = np.linalg.solve(s.M_d, s.K_f * (s.tau_contact_m_B - s.F_d) - s.D_d @ x.nu_a - s.K_d * x.eta_a)
    e, e_dot = s.eta_e - x.eta_a, s.nu_e - x.nu_a
    acceleration = s.nu_d_dot + nu_a_dot - g.k_v * e_dot - g.k_p * e - x.xi_a
    tau = s.M_hat @ acceleration + s.C_hat_nu + s.D_hat_nu + s.g_hat
    return tau, {"nu_a": nu_a_dot, "eta_a": x.nu_a * [1, 1, 1, 0.5, 0.5, 0.5], "xi_a": g.k_i * e}


def parallel(g, x, s):
    force = s.F_d[:3]
    n = force / np.linalg.norm(force)
    tau = s.tau_nom.copy()
    tau[:3] += n * np.clip(x.xi, -g.limit, g.limit)
    return tau, {"xi": [g.k_i * n @ (s.tau_contact_m_B[:3] - force)]}


def dob_impedance(g, x, s):
    """The momentum observer as in its source, from p = M_hat nu and the wrench that the law commands."""
    r = s.M_hat @ (np.array(g.bandwidth) * (s.nu - x.nu_hat))
    tau = s.tau_nom - r
    p_hat_dot = tau + s.tau_contact_m_B - s.C_hat_nu - s.D_hat_nu - s.g_hat + r
    return tau, {"nu_hat": np.linalg.solve(s.M_hat, p_hat_dot)}


def aismc(g, x, s):
    sigma = s.nu - x.nu_hat
    K = np.minimum(g.K_max, np.maximum(g.K_0, x.K))
    tau = s.tau_nom - s.M_hat @ (K * np.clip(sigma / g.epsilon, -1.0, 1.0))
    return tau, {"nu_hat": s.nu_d_dot - s.w, "K": g.rate * (np.abs(sigma) - 0.5 * np.array(g.epsilon))}


@pytest.mark.parametrize("law", NEW)
def test_a_law_is_its_equations(law, rng):
    """The twin's observer takes the momentum, so tau_nom has to be eq. (23) of the other signals."""
    setup = set_up(Scenario.load("push_wall", {}, law))
    gains, kind = setup.scenario.controller, BUILT_IN[law]
    for _ in range(40):
        signals = SimpleNamespace(**{each.name: rng.normal(size=each.shape) for each in kind.given()})
        signals.instant = 3
        for name in ("M_hat", "M_d"):
            half = rng.normal(size=(6, 6))
            setattr(signals, name, half @ half.T + np.eye(6))
        if kind.uses_task:
            model = signals.C_hat_nu + signals.D_hat_nu + signals.g_hat - signals.tau_contact_m_B
            signals.tau_nom = signals.M_hat @ (signals.nu_d_dot - signals.w) + model
        values = {name: rng.normal(size=size) * rng.choice([0.01, 1.0, 20.0]) for name, size in kind.states.items()}
        state, state_dot = (SimpleNamespace(**{name: each.copy() for name, each in values.items()}) for _ in range(2))
        constants = {**gains.constants(setup), "M_d_inv": np.linalg.inv(signals.M_d)}
        tau_cmd = np.full(6, np.nan)
        settings = SimpleNamespace(**{name: np.asarray(value) for name, value in constants.items()})
        kind.law(settings, state, signals, state_dot, tau_cmd)
        expected, rates = globals()[law](gains, SimpleNamespace(**values), signals)
        np.testing.assert_allclose(tau_cmd, expected, rtol=1e-9, atol=1e-9)
        for name, rate in rates.items():
            np.testing.assert_allclose(getattr(state_dot, name), rate, rtol=1e-9, atol=1e-9)


# rest

RANDOM = {
    "pid": lambda rng: {"controller.k_i": rng.uniform(1.0, 3.0), "controller.limit": rng.uniform(15.0, 25.0)},
    "admittance": lambda rng: {"controller.k_i": rng.choice([0.0, 1000.0]), "controller.k_p": rng.uniform(200.0, 400)},
    "parallel": lambda rng: {"controller.k_i": rng.uniform(1.5, 2.5), "controller.limit": rng.choice([1.0, 15.0])},
    "dob_impedance": lambda rng: {"controller.bandwidth": rng.uniform(5.0, 30.0)},
    "aismc": lambda rng: {"controller.rate": rng.uniform(500.0, 2000.0)},
}


@pytest.mark.parametrize("draw", range(2))
@pytest.mark.parametrize("law", NEW)
def test_a_settled_run_rests_where_the_closed_form_says(law, draw):
    """In an unknown current, with wrong estimates, for random gains, targets, walls and forces."""
    rng = np.random.default_rng(draw)
    overrides = AT_WALL | {
        "current.speed": rng.uniform(0.1, 0.6),
        "current.direction_deg": rng.uniform(0.0, 360.0),
        "disturbance.bias": [*rng.uniform(-1.0, 1.0, 3), *rng.uniform(-0.1, 0.1, 3)],
        "wall.stiffness": 10.0 ** rng.uniform(3.5, 5.5),
        "reference.target": [1.0 + rng.uniform(0.01, 0.03), *rng.uniform(-0.05, 0.05, 2)],
        "impedance.F_d": [-rng.uniform(2.0, 5.0), *rng.uniform(-0.2, 0.2, 2), *rng.uniform(-0.05, 0.05, 3)],
        "impedance.K_f": [rng.uniform(0.7, 1.2), *[1.0] * 5],
        "impedance.K_d": [rng.uniform(100.0, 300.0), 1500.0, 1500.0, 50.0, 50.0, 50.0],
        "estimates.inertia": rng.uniform(0.8, 1.2),
        "estimates.damping": rng.uniform(0.5, 1.5),
        "estimates.restoring": rng.uniform(0.9, 1.1),
        "simulation.duration": 22.0,
        "simulation.timestep": 4e-4,
        **RANDOM[law](rng),
    }
    trace = run(law, overrides, "mujoco" if draw == 0 else "free_body")
    analytic, (force, settled) = trace.analytic, final_force(trace)
    assert isinstance(analytic, SteadyState), analytic
    assert settled
    assert force == pytest.approx(analytic.force, rel=1e-6)
    assert np.abs(trace.p_WB[-1] - analytic.position).max() < 1e-6
    assert np.abs(trace.tau[-1] - analytic.tau).max() < 1e-4


@pytest.mark.parametrize("law", NEW)
def test_biased_sensors_are_in_the_closed_form(law):
    """The law rests where its measurements ask for it, also with a biased velocity."""
    overrides = AT_WALL | {
        "navigation.name": "sensors",
        "navigation.position_bias": [0.002, -0.004, 0.003],
        "navigation.velocity_bias": [0.004, -0.002, 0.003],
        "navigation.force_bias": [0.3, -0.1, 0.05],
        "navigation.moment_bias": [0.01, -0.02, 0.03],
        "impedance.F_d": [-4.0, *[0.0] * 5],
        "wall.stiffness": 2e4,
        "simulation.timestep": 2e-4,
        "simulation.duration": 30.0,
    }
    trace = run(law, overrides | ({"controller.k_i": 0.0} if law == "admittance" else {}))
    assert isinstance(trace.analytic, SteadyState), trace.analytic
    force, settled = final_force(trace)
    assert settled
    assert force == pytest.approx(trace.analytic.force, rel=1e-6)
    assert np.abs(trace.p_WB[-1] - trace.analytic.position).max() < 1e-6
    if trace.analytic.s is not None:
        assert np.abs(trace.s[-1] - trace.analytic.s).max() < 1e-6


@pytest.mark.parametrize("d", [-2.0, 0.0, 3.0])
@pytest.mark.parametrize("K_f", [0.0, 0.6, 1.0])
def test_the_closed_forms_are_the_scalar_balances(d, K_f):
    """In still water with a force d along x, all six axes reduce to one: springs in series, disturbances, limits."""
    K, k_c, F_d, depth, limit, k_p = 200.0, 2e4, -1.5, 0.02, 4.0, 250.0
    overrides = {
        "current.speed": 0.0,
        "disturbance.bias": [d, 0.0, 0.0, 0.0, 0.0, 0.0],
        "wall.stiffness": k_c,
        "reference.target": [1.0 + depth, 0.0, 0.0],
        "impedance.K_d": [K, 1500.0, 1500.0, 50.0, 50.0, 50.0],
        "impedance.K_f": [K_f, *[1.0] * 5],
        "impedance.F_d": [F_d, *[0.0] * 5],
    }

    def force(law, **gains):
        scenario = Scenario.load("push_wall", overrides | {f"controller.{k}": v for k, v in gains.items()}, law)
        return steady_state(set_up(scenario)).force

    demanded = (depth - K_f * F_d / K) / (K_f / K + 1.0 / k_c)
    series = (depth - K_f * F_d / K + d / (X * k_p)) / (K_f / K + 1.0 / (X * k_p) + 1.0 / k_c)
    stopped = {xi: (K * depth - K_f * F_d + xi + d) / (K / k_c + K_f) for xi in (0.0, 0.5)}
    expected = [
        (force("pid", limit=limit), (K * depth - K_f * F_d + limit + d) / (1.0 + K / k_c)),
        (force("pid", k_i=0.0), (K * depth - K_f * F_d + d) / (1.0 + K / k_c)),
        (force("admittance", k_p=k_p, k_i=0.0), series),
        (force("admittance"), demanded),
        (force("dob_impedance"), demanded),
        (force("aismc"), demanded),
        (force("parallel", k_i=0.0), stopped[0.0]),
    ]
    if K_f > 0.0 and stopped[0.5] > -F_d:  # the integral would push less; K_f = 0 makes a rest of -1.5 N far away
        expected.append((force("parallel", limit=1e3), -F_d))
    for found, value in expected:
        assert found == pytest.approx(max(0.0, value), rel=2e-6)  # r_g couples surge and pitch


@pytest.mark.parametrize("d", [-2.0, 0.0, 1.0])
@pytest.mark.parametrize("K_f", [0.3, 1.0])
def test_parallel_control_rests_with_the_desired_force_whatever_pushes(d, K_f):
    overrides = AT_WALL | {
        "current.speed": 0.0,
        "disturbance.bias": [d, 0.0, 0.0, 0.0, 0.0, 0.0],
        "impedance.K_f": [K_f, *[1.0] * 5],
    }
    trace = run("parallel", overrides | {"controller.k_i": 1.5 * K_f})
    assert final_force(trace)[0] == pytest.approx(1.5, rel=1e-6)
    assert trace.analytic.force == pytest.approx(1.5, rel=1e-9)


def test_the_integral_of_pid_pushes_until_its_limit_and_rejects_a_disturbance_without_contact():
    overrides = AT_WALL | {"current.speed": 0.0, "disturbance.bias": [-2.0, 5.0, 0.0, 0.0, 0.0, 0.3]}
    forces = []
    for limit in (4.0, 8.0):
        pressed = {"reference.target": [1.01, 0.0, 0.0], "controller.limit": [limit, *[20.0] * 5]}
        trace = run("pid", overrides | pressed)
        forces.append(final_force(trace)[0])
        assert np.abs(trace.eta_e[-1, 1:]).max() < 1e-7
        assert np.abs(trace.xi[:, 0]).max() <= limit
    assert forces[0] == pytest.approx((1.5 + 4.0 + 1.5 - 2.0) / (1.0 + 150.0 / 1e5), rel=1e-3)  # moments tilt it
    assert forces[1] - forces[0] == pytest.approx(4.0 / (1.0 + 150.0 / 1e5), rel=1e-3)
    free = run("pid", overrides | {"wall.position": 3.0, "reference.target": [0.99, 0.0, 0.0]})
    assert np.abs(free.eta_e[-1]).max() < 1e-6


# convergence


def test_the_disturbance_observer_is_a_first_order_low_pass():
    """With the true model d_hat = (1 - exp(-Omega t)) d while everything moves, up to an error of first order in h."""
    d, omega = np.array([2.0, -1.0, 0.5, 0.1, -0.05, 0.2]), 8.0
    overrides = {
        "current.speed": 0.0,
        "disturbance.bias": d.tolist(),
        "wall.position": 5.0,
        "simulation.duration": 0.6,
        "controller.bandwidth": omega,
        "initial.velocity": [0.2, -0.1, 0.1, 0.1, 0.2, -0.3],
    }
    errors = []
    for h in (2e-4, 1e-4):
        trace = run("dob_impedance", overrides | {"simulation.timestep": h})
        expected = (1.0 - np.exp(-omega * trace.t))[:, None] * d
        errors.append(np.abs(trace.d_hat - expected).max(axis=0))
    assert (errors[1] < 1e-3 * np.abs(d).max()).all()
    assert errors[0] / errors[1] == pytest.approx([2.0] * 6, rel=0.05)


def test_the_observer_is_the_first_order_law_with_an_integral_sliding_variable():
    """K_s sat(s/epsilon) with K_s/epsilon = Omega, inside the boundary layer; the reference is at rest."""
    overrides = {
        "disturbance.bias": [2.0, -1.0, 0.5, 0.1, -0.05, 0.2],
        "wall.position": 0.005,
        "reference.target": [0.0, 0.0, 0.0],
        "impedance.F_d": [-3.0, *[0.0] * 5],
        "simulation.duration": 4.0,
        "current.direction_deg": 20.0,
    }
    observer = run("dob_impedance", overrides | {"controller.bandwidth": 20.0})
    sliding = run("fosm", overrides | {"controller.K_s": 2e3, "controller.epsilon": 1e2, "task.integral": True})
    assert observer.touches[-1] > 0
    assert np.abs(observer.p_WB - sliding.p_WB).max() < 1e-4 * np.ptp(observer.p_WB[:, 0])


def test_the_adaptive_gain_is_bounded_and_rests_at_twice_the_disturbance():
    d = np.array([4.0, -3.0, 0.5, 0.2, -0.01, 0.3])
    overrides = {
        "current.speed": 0.0,
        "disturbance.bias": d.tolist(),
        "wall.position": 5.0,
        "simulation.duration": 8.0,
    }
    trace = run("aismc", overrides)
    setup, law = set_up(trace.scenario), trace.scenario.controller
    phi = np.abs(np.linalg.solve(setup.design.M, d))
    share = np.where(2.0 * phi > law.K_0, 0.5, phi / law.K_0)
    np.testing.assert_allclose(np.maximum(trace.K[-1], law.K_0), np.maximum(law.K_0, 2.0 * phi), rtol=1e-3)
    np.testing.assert_allclose(np.abs(trace.sigma[-1]), share * law.epsilon, rtol=1e-3)
    assert (np.array(law.K_max) >= trace.K).all()
    assert np.abs(trace.eta_e[-1]).max() < 1e-6


def test_a_greatest_gain_below_the_disturbance_has_no_closed_form():
    weak = {"controller.K_max": 0.05, "controller.K_0": 0.01}
    reason = run("aismc", AT_WALL | weak | {"simulation.duration": 0.01}).analytic.reason
    assert "disturbance is larger" in reason


# sampling


SLOW = {
    "navigation.name": "sensors",
    "navigation.velocity_period": 0.003,
    "navigation.velocity_delay": 0.0041,
    "navigation.force_period": 0.005,
    "navigation.force_delay": 0.0017,
    "controller.period": 0.002,
    "controller.delay": 0.0051,
    "actuation.period": 0.0014,
}
"""Every stage at a rate of its own, and every delay: the loop repeats after 0.21 s."""
LAGGING = {"thrusters.name": "general", "thrusters.lag": "third_order", "controller.period": 0.002}


@pytest.mark.parametrize(
    ("law", "overrides"),
    [
        ("admittance", {"controller.k_i": 0.0, "controller.period": 0.01}),
        (
            "admittance",
            {"controller.k_i": 0.0, "controller.period": 0.008, "impedance.K_f": [2.0] * 6, "wall.stiffness": 5e4},
        ),
        ("parallel", {"controller.k_i": 12.0, "controller.period": 0.002}),
        ("dob_impedance", {"controller.period": 0.02, "estimates.inertia": 2.0}),
        ("dob_impedance", {"controller.period": 0.001, "estimates.inertia": 0.4}),
        ("admittance", SLOW),
        ("admittance", SLOW | {"impedance.M_d": [5.0, 7.0, 7.0, 0.1, 0.1, 0.1], "wall.stiffness": 3e4}),
        ("admittance", LAGGING),
    ],
)
def test_the_linear_model_predicts_the_growth_of_a_vibration(law, overrides):
    """A vehicle pressed to the wall starts at rest with 0.1 mN too little; the growth is measured while in contact."""
    overrides = AT_WALL | overrides | {"current.speed": 0.0, "impedance.F_d": [-30.0, *[0.0] * 5]}
    setup = set_up(Scenario.load("push_wall", overrides | {"simulation.duration": 10.0}, law))
    growth = Stability(setup).at_wall[2]
    assert growth > 0.1
    assert any("oscillates" in note for note in stage_notes(setup.scenario.controller, setup))
    assert "does not damp" in steady_state(setup).reason
    rest = 30.0 / setup.scenario.wall.stiffness
    start = {"initial.position": [1.0 + rest + 1e-9, 0.0, 0.0], "reference.target": [1.0 + rest, 0.0, 0.0]}
    if law == "admittance":  # the inner loop has no error if something else pushes
        start["disturbance.bias"] = [30.0, *[0.0] * 5]
    trace = run(law, overrides | start | {"simulation.duration": 14.0 / growth}, log_rate="full")
    blocks = np.array_split(np.arange(len(trace.t)), 80)
    t = np.array([trace.t[block].mean() for block in blocks])
    peak = np.array([np.abs(trace.push[block] - 30.0).max() for block in blocks])
    linear = (np.cumsum(peak > 3.0) == 0) & (peak > 10.0 * peak[0])
    assert linear.sum() > 10
    assert np.polyfit(t[linear], np.log(peak[linear]), 1)[0] == pytest.approx(growth, rel=0.05)


def test_an_old_force_shakes_aismc_with_its_gain_at_rest_though_not_with_the_greatest():
    """The run vibrates by newtons with a force that is 40 ms old; with one of 10 ms it rests at the closed form."""
    for delay, rests in ((0.01, True), (0.04, False)):
        old = {"wall.stiffness": 2e3, "navigation.name": "sensors", "navigation.force_delay": delay}
        trace = run("aismc", old | {"simulation.duration": 25.0}, log_rate=100)
        assert isinstance(trace.analytic, SteadyState) == rests
        assert (float(trace.final_high[-1] - trace.final_low[-1]) < 1e-3) == rests
        setup, law = set_up(trace.scenario), trace.scenario.controller
        about = ("K", law.K_max), ("nu_hat", tuple(-0.25 * each for each in law.epsilon))
        assert Stability(setup, about=about).at_wall[2] < 0.0


def test_thrusters_that_take_the_command_at_the_laws_instants_do_not_age_it():
    """Whatever holds its output next reads the command, the thrusters if the allocation runs at every step. Their lag
    and the computation delay age the force at the wall, too."""
    held = AT_WALL | {"controller.period": 0.01, "thrusters.name": "general", "thrusters.period": 0.01}
    ages = []
    for more in ({}, {"thrusters.lag": "first_order", "thrusters.time_constant": 0.003}, {"controller.delay": 0.01}):
        setup = set_up(Scenario.load("push_wall", held | more, "parallel"))
        ages.append(ForceLatency.of(setup).mean - 0.5 * (0.01 - 1e-4))
        assert np.isfinite(Stability(setup).at_wall[2])
    assert ages == pytest.approx([0.0, 0.003, 0.01], abs=1e-12)


# attacks


def test_parallel_control_without_a_desired_force_says_so():
    setup = set_up(Scenario.load("push_wall", {}, "parallel"))
    (note,) = stage_notes(setup.scenario.controller, setup)
    assert "asks for no push" in note
    assert dataclasses.asdict(setup.scenario.impedance)["F_d"] == (0.0,) * 6
