"""The observer of the contact force: its closed forms, its place in the loop, and its refusals."""

import numpy as np
import pytest
from scipy.signal import lfilter

from twin import C_A, D, TwinParameters, rotation
from uvms_mj import LawError, Scenario, Simulation, Trace, simulate
from uvms_mj.navigation import MomentumObserver
from uvms_mj.stages.signals import MEASURED, OBSERVER_GIVEN, record_dtype

STILL = {"current.speed": 0.0, "wall.position": 5.0, "reference.target": [0.0, 0.0, 0.0]}
SOFT = {
    "observer.name": "momentum_observer",
    "observer.time_constant": 0.01,
    "wall.stiffness": 2e3,
    "reference.target": [1.05, 0.0, 0.0],
}
SPRING = 150.0 * 0.05 / (1.0 + 150.0 / 2e3)
"""Force at rest of the desired stiffness and the wall of SOFT in a row [N]."""


def record(signals):
    return np.zeros(1, record_dtype(signals)).view(np.recarray)[0]


def test_the_residual_is_a_first_order_lag_of_the_unexplained_wrench():
    """Independently: a digital filter of w = M_hat nu_dot - tau_hat + C_hat nu + D_hat nu + g_hat."""
    h, T, n, rng = 0.01, 0.05, 300, np.random.default_rng(1)
    M = np.diag([20.0, 30.0, 40.0, 1.0, 2.0, 3.0]) + rng.normal(size=(6, 6))
    nu, tau, C, D_nu, g = rng.normal(size=(5, n, 6))
    stage = MomentumObserver(time_constant=T, threshold=0.0)
    settings, state = (each.view(np.recarray)[0] for each in (stage.record(), stage.state_record()))
    given, out = record(OBSERVER_GIVEN), record(MEASURED[4:])
    given.period, given.M_hat[:], given.R_WB[:] = h, M, [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    found = []
    for k in range(n):
        given.instant, given.t = k, k * h
        for name, values in (("nu", nu), ("tau_hat", tau), ("C_hat_nu", C), ("D_hat_nu", D_nu), ("g_hat", g)):
            given[name][:] = values[k]
        MomentumObserver.step(settings, state, given, None, out)
        found.append(state.residual.copy())
        assert np.array_equal(out.tau_contact_m_B, state.residual)
        assert np.allclose(out.f_contact_m_W, [-found[-1][1], found[-1][0], found[-1][2]], rtol=1e-14)
    explained = C + D_nu + g
    w = np.diff(nu, axis=0) @ M.T / h - tau[1:] + 0.5 * (explained[1:] + explained[:-1])
    a = np.exp(-h / T)
    assert found[0] == pytest.approx(np.zeros(6))
    assert np.allclose(found[1:], lfilter([1.0 - a], [1.0, -a], w, axis=0), rtol=1e-12, atol=1e-10)


@pytest.mark.filterwarnings("ignore:gsta vibrates")
@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_a_constant_disturbance_appears_as_one_minus_the_exponential(engine):
    """The difference is that of the time stepping: it halves with the step."""
    T, d = 0.02, np.array([3.0, -2.0, 1.0, 0.1, -0.2, 0.3])
    errors = []
    for h in (1e-4, 5e-5):
        settings = {"observer.name": "momentum_observer", "observer.time_constant": T, "observer.threshold": 0.0}
        settings |= {"simulation.timestep": h, "simulation.duration": 0.1, "disturbance.bias": d.tolist()}
        trace = simulate(Scenario.load("push_wall", STILL | settings), engine=engine, log_rate="full")
        errors.append(abs(trace["residual"] - np.outer(1.0 - np.exp(-trace.t / T), d)).max())
    assert errors[0] < 2e-4
    assert errors[1] == pytest.approx(0.5 * errors[0], rel=0.1)


def test_at_rest_the_residual_is_the_contact_and_the_current_exactly():
    """tau_c + d, with d = -C_A(nu_r) nu_r - D(nu_r) nu_r of the twin, and nu_r = -nu_c."""
    trace = simulate(Scenario.load("push_wall", SOFT | {"observer.threshold": 0.0}), engine="free_body")
    R = rotation(trace.quat_WB[-1])
    parameters = TwinParameters()
    nu_r = np.r_[-R.T @ parameters.v_c_W, np.zeros(3)]
    unknown = -(C_A(parameters, nu_r) + D(parameters, nu_r)) @ nu_r
    unknown[:3] += R.T @ trace.f_contact_W[-1]
    assert np.abs(trace.nu[-1]).max() < 1e-5
    assert trace["residual"][-1] == pytest.approx(unknown, abs=2e-4)
    assert np.linalg.norm(unknown[:3]) > 5.0


@pytest.mark.slow
@pytest.mark.parametrize("law", ["gsta", "fosm", "sta", "impedance"])
@pytest.mark.parametrize("thrusters", [{}, {"thrusters.name": "general", "thrusters.efficiency": 0.8}])
def test_without_a_calibration_the_law_rests_at_the_static_balance(law, thrusters):
    """The observer gives the impedance all that the model does not explain: errors of the estimates, and the thrust
    that is missing."""
    more = {"observer.threshold": 0.0, "estimates.restoring": 1.1, "disturbance.bias": [0.5, -0.4, 0.3, 0.1, 0.1, 0.1]}
    settings = (
        SOFT
        | more
        | thrusters
        | {
            "wall.damping": 100.0,
            "simulation.duration": 40.0,
            "simulation.timestep": 1e-4 if law in ("fosm", "sta") else 2e-4,
        }
    )
    trace = simulate(Scenario.load("push_wall", settings, law), engine="free_body")
    rest = trace.analytic
    assert rest.force > 1.0
    assert trace.push[-1] == pytest.approx(rest.force, rel=1e-5)
    assert trace.p_WB[-1] == pytest.approx(rest.position, abs=1e-7)
    assert abs(rest.force - SPRING) > 0.1


def test_the_reasons_why_there_is_no_closed_form():
    for settings, reason in (
        ({"observer.calibrate_until": 1.0}, "depends on the motion in the time of its average"),
        ({"observer.threshold": 100.0}, "below observer.threshold"),
    ):
        scenario = Scenario.load("push_wall", SOFT | settings | {"simulation.duration": 0.01})
        assert reason in simulate(scenario, engine="free_body").analytic.reason


def test_a_bias_learned_before_the_contact_leaves_the_contact_force():
    """GSTA without a force sensor then rests where it rests with one, but for what the bias has of the transient."""
    learned = {"observer.calibrate_from": 6.0, "observer.calibrate_until": 7.0, "reference.step_time": 7.0}
    trace = simulate(Scenario.load("push_wall", SOFT | learned), engine="free_body")
    assert trace["in_contact"][-1] == 1.0
    assert not trace["in_contact"][trace.t < 7.0].any()
    assert not trace.f_contact_m_W[trace.t < 7.0].any()
    assert trace.f_contact_m_W[-1] == pytest.approx(trace.f_contact_W[-1], abs=1e-4)
    assert trace.push[-1] == pytest.approx(SPRING, rel=2e-5)


def test_the_threshold_has_a_hysteresis():
    """No contact below the threshold; a contact ends below half of it."""
    stage = MomentumObserver(time_constant=1e-6, threshold=2.0)
    settings, state = (each.view(np.recarray)[0] for each in (stage.record(), stage.state_record()))
    given, out = record(OBSERVER_GIVEN), record(MEASURED[4:])
    given.period, given.R_WB[:], given.instant = 1.0, np.eye(3), 1
    seen = []
    for force in (1.5, -2.5, 1.5, 0.9, 1.5, 3.0):
        given.tau_hat[0] = -force
        MomentumObserver.step(settings, state, given, None, out)
        seen.append(out.f_contact_m_W[0])
    assert seen == [0.0, -2.5, 1.5, 0.0, 0.0, 3.0]


def test_the_force_sensor_is_replaced_not_mixed_in(tmp_path):
    """A sensor that is wrong by 100 N changes nothing, at any of the periods."""
    sensor = tmp_path / "wrong.py"
    sensor.write_text(
        """
from dataclasses import dataclass
from uvms_mj import Navigation
from uvms_mj.navigation import perfect

@dataclass(frozen=True)
class Wrong(Navigation):
    @staticmethod
    def step(settings, state, given, state_dot, out):
        perfect(given, out)
        out.f_contact_m_W[0] += 100.0
        out.tau_contact_m_B[0] += 100.0
"""
    )
    for periods in ({}, {"controller.period": 2e-3, "navigation.period": 1e-3, "observer.period": 4e-3}):
        settings = SOFT | periods | {"simulation.duration": 2.0, "wall.position": 0.01}
        right = simulate(Scenario.load("push_wall", settings), engine="free_body")
        wrong = simulate(
            Scenario.load("push_wall", settings | {"navigation.name": f"{sensor}:Wrong"}), engine="free_body"
        )
        assert right["touches"][-1] > 0
        for name in ("f_contact_m_W", "nu", "tau", "residual"):
            assert np.array_equal(right[name], wrong[name]), name


def test_the_believed_thrust_is_that_of_the_command_and_of_the_files_thrusters():
    """The true thrusters may stand elsewhere, or lag behind: the difference is part of the residual."""
    offset = {"vehicle.thruster_offset": [[0.02, 0.0, 0.01]] + [[0.0, 0.0, 0.0]] * 5}
    lag = {"thrusters.name": "general", "thrusters.lag": "first_order", "thrusters.time_constant": 0.05}
    for settings, u in (({}, "u"), (offset, "u"), (lag, "u_cmd")):
        with Simulation(Scenario.load("push_wall", settings), engine="free_body") as sim:
            sim.step(300)
            tau_hat, tau, B = sim.signals.tau_hat, sim.signals.tau, sim.setup.nominal.B
            assert tau_hat == pytest.approx(B @ sim.signals[u], rel=1e-13, abs=1e-13)
            assert np.abs(tau_hat).max() > 1.0
            assert np.array_equal(tau_hat, tau) is not bool(settings)


USERS = """
from dataclasses import dataclass
from uvms_mj import setting
from uvms_mj.navigation import Observer

@dataclass(frozen=True)
class Own(Observer):
    until: float = setting(1.0, "s", "time at which it divides by zero")
    states = {"seen": 6}
    units = {"seen": "N, N m"}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        for i in range(6):
            state.seen[i] = given.tau_hat[i]
            out.tau_contact_m_B[i] = 0.01 * given.tau_hat[i] / (given.t - settings.until)
        for i in range(3):
            out.f_contact_m_W[i] = out.tau_contact_m_B[i]
"""


def test_a_users_observer_runs_is_recorded_and_is_named_if_it_fails(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(USERS)
    scenario = Scenario.load("push_wall", {"observer.name": f"{path}:Own", "simulation.duration": 0.02})
    trace = simulate(scenario, engine="free_body", log_rate="full")
    assert trace["seen"][1:] == pytest.approx(trace.tau[:-1], rel=1e-12, abs=1e-12)
    assert trace.f_contact_m_W == pytest.approx(0.01 * trace["seen"][:, :3] / (trace.t - 1.0)[:, None], rel=1e-12)
    assert trace.f_contact_m_W.any()
    assert "shipped observers only" in trace.analytic.reason
    trace.save(tmp_path / "run.mcap")
    assert np.array_equal(Trace.load(tmp_path / "run.mcap")["seen"], trace["seen"])
    with pytest.raises(LawError, match=r"t = 0.01 s: your observer Own \(own.py\) .*in own.py, line 16"):
        simulate(scenario.updated({"observer.until": 0.01}), engine="free_body")


def test_a_force_that_is_too_old_for_the_wall_is_said_before_the_run():
    """D_d/(K_f k_c) is 0.88 ms at 1e5 N/m: the loop vibrates with an estimate that is 10 ms old."""
    with pytest.warns(UserWarning, match=r"limit-cycles against the wall with the observer's lag of 0\.01 s"):
        trace = simulate(Scenario.load("push_wall", SOFT | {"wall.stiffness": 1e5}), engine="free_body")
    assert trace["touches"][-1] > 3
    assert "limit-cycles" in trace.analytic.reason
