"""Metrics against closed forms, on synthetic traces and on runs, and at different log rates."""

import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from uvms_mj import Gsta, InputError, Scenario, Trace, simulate
from uvms_mj.analysis import metrics, residual
from uvms_mj.analysis.summary import summary
from uvms_mj.control.design import demanded_force
from uvms_mj.records.header import Outcome, Status

H = 1e-3
CONTACT = {"simulation.duration": 0.4, "wall.position": 0.002, "reference.step_time": 0.0}


@pytest.fixture(scope="module")
def header():
    return simulate(Scenario.load("push_wall", {"simulation.duration": 1e-3}), log_rate="full").header


@pytest.fixture
def synthetic(header):
    """A function that makes a trace of every step from a duration and functions of time; other signals are zero."""

    def make(duration: float, **signals) -> Trace:
        scenario = header.scenario.updated({"simulation.timestep": H, "simulation.duration": duration})
        steps = scenario.steps
        t = np.arange(steps + 1) * H
        arrays = {s.name: np.zeros((len(t), *s.shape)) for s in header.signals} | {"t": t}
        arrays["quat_WB"][:, 0] = 1.0
        for name, values in signals.items():
            arrays[name] = np.array(values(t))
        return Trace(
            dataclasses.replace(header, scenario=scenario, row_steps=1),
            arrays,
            Outcome(Status.completed, "", steps, 1.0),
        )

    return make


def axis(values: np.ndarray, i: int, size: int = 6) -> np.ndarray:
    columns = np.zeros((len(values), size))
    columns[:, i] = values
    return columns


def running(increments: np.ndarray) -> np.ndarray:
    return np.concatenate([np.zeros((1, *increments.shape[1:])), np.cumsum(increments, axis=0)])


def decimated(trace: Trace, n: int) -> Trace:
    header = dataclasses.replace(trace.header, row_steps=n * trace.header.row_steps)
    return Trace(header, {name: trace[name][::n] for name in trace}, trace.outcome)


def far(t):
    """3 m away from the reference, which is at 0."""
    return axis(np.full(len(t), 3.0), 1, 3)


def test_a_vehicle_that_leaves_its_reference_is_astray(synthetic):
    moving, still = (lambda t, v=v: axis(np.full(len(t), v), 2) for v in (0.1, 0.0))
    assert metrics.astray(synthetic(2.0, p_WB=far, nu_e=moving)) == 3.0
    assert metrics.astray(synthetic(2.0, p_WB=far, nu_e=still)) is None
    assert metrics.astray(synthetic(2.0, p_WB=far, p_d=far, nu_e=moving)) is None
    ahead = synthetic(2.0, p_WB=lambda t: axis(np.full(len(t), -3.0), 0, 3), nu_e=moving, final_high=np.ones_like)
    assert metrics.astray(ahead) is None


def _plane(normal, **keys):
    """A plane against which a probe at the origin, of the radius of the bluerov1, is pressed by 1 mm."""
    yaw = math.degrees(math.atan2(-normal[1], -normal[0]))
    place = {"position": [-0.24 * each for each in normal], "attitude_deg": [0.0, 0.0, yaw]}
    return {"shape": "plane", "stiffness": 2e3} | place | keys


_N, _T = np.array([-0.6, -0.8, 0.0]), np.array([0.8, -0.6, 0.0])
_PILE = {"shape": "cylinder", "radius": 0.4, "position": [*(-0.64 * _N[:2]), 0.0], "stiffness": 2e3}
_PRESSED = {
    "current.speed": 0.0,
    "reference.step_time": 0.0,
    "simulation.duration": 3.0,
    "simulation.timestep": 1e-3,
    "impedance.K_d": [400.0, 400.0, 400.0, 50.0, 50.0, 50.0],
}


@pytest.mark.parametrize(
    ("walls", "known", "normals"),
    [
        ([_plane((0.0, -1.0, 0.0))], True, [(0.0, -1.0, 0.0)]),
        ([_plane(_N, friction=0.4)], True, [_N]),
        ([_PILE], True, [_N]),
        ([_plane(_N), _plane(_T)], True, [_N, _T]),
        ([_plane(_N), _plane(-_T, position=[9.0, 9.0, 0.0])], True, [_N]),
        ([_PILE | {"friction": 0.4}], False, []),
    ],
    ids=["faces -y", "with friction", "pile", "corner", "another wall far away", "pile with friction"],
)
def test_a_distance_along_the_normal_of_a_touched_wall_does_not_count_whatever_it_faces(walls, known, normals):
    """It was left out along x, so that a target behind a wall that faces y was told as an unstable loop, and a vehicle
    that was carried off along that wall was not."""
    target = (-0.02 * np.sum(normals or [_N], axis=0)).tolist()
    keys = {"wall.present": False, "walls": walls, "reference.target": target}
    trace = simulate(Scenario.load("push_wall", _PRESSED | keys, controller="impedance"), log_rate=100)
    assert trace.push[-1] > 0.0

    def with_error(error):
        shifted = {"p_d": trace.p_WB - error, "nu_e": np.full_like(trace.nu_e, 0.1)}
        return metrics.astray(Trace(trace.header, {name: trace[name] for name in trace} | shifted, trace.outcome))

    for normal in normals:
        assert with_error(3.0 * np.asarray(normal)) is None
    free = np.linalg.svd(np.array(normals or [_N]))[2][len(normals or [_N]) :]
    for across in free:
        assert with_error(3.0 * across) == (pytest.approx(3.0, rel=1e-4) if known else None)


def test_in_a_corner_of_the_first_wall_and_another_one_both_normals_do_not_count():
    """The force of the first wall is the total without the forces of the others."""
    first = {"wall.position": 0.0, "wall.stiffness": 2e3, "reference.target": [0.02, 0.02, 0.0]}
    keys = {"walls": [_plane((0.0, -1.0, 0.0))]}
    trace = simulate(Scenario.load("push_wall", _PRESSED | first | keys, controller="impedance"), log_rate=100)
    for error, found in (([3.0, 0.0, 0.0], None), ([0.0, 3.0, 0.0], None), ([2.0, 2.0, 3.0], 3.0)):
        shifted = {"p_d": trace.p_WB - error, "nu_e": np.full_like(trace.nu_e, 0.1)}
        told = metrics.astray(Trace(trace.header, {name: trace[name] for name in trace} | shifted, trace.outcome))
        assert told == (None if found is None else pytest.approx(found, rel=1e-9))


def test_an_unstable_loop_that_stays_within_the_bounds_is_told():
    lag = Path(__file__).parents[2] / "examples" / "lagging_thrusters.py"
    slow = {"actuation.name": f"{lag}:LaggingThrusters", "actuation.time_constant": 0.2, "simulation.duration": 10.0}
    trace = simulate(Scenario.load("push_wall", slow))
    (warning,) = summary(trace, {})["warnings"]
    assert trace.status is Status.completed
    assert "from its reference: the loop may be unstable" in warning


def test_settling_time_of_an_exponential(synthetic):
    t = np.linspace(0.0, 10.0, 10_001)
    assert metrics.settling_time(t, 1.0 - np.exp(-t), 1.0, 0.02) == pytest.approx(math.log(50.0), abs=1e-3)
    assert metrics.settling_time(t, np.ones_like(t), 1.0, 0.02) == 0.0
    assert metrics.settling_time(np.arange(5.0), np.array([5.0, 5.0, 0.1, 0.0, 0.0]), 0.0, 0.2) == 2.0
    assert metrics.settling_time(t, t, 20.0, 0.02) is None
    assert metrics.settling_time(t, np.where(t < 4.0, np.nan, 1.0), 1.0, 0.02) == pytest.approx(4.0, abs=2e-3)
    trace = synthetic(20.0, p_WB=lambda t: axis(1.0 - np.exp(-t), 0, 3))
    assert metrics.position_settling_time(trace, 0.05) == pytest.approx(math.log(20.0), abs=2e-3)


def test_force_settles_when_its_last_touch_is_within_the_band(synthetic):
    def force(t):
        return axis(-np.where(t < 1.0, 0.0, 1.5 + 3.0 * np.exp(-2.0 * (t - 1.0))), 0, 3)

    trace = synthetic(12.0, f_contact_W=force, final_impulse=lambda t: np.full_like(t, 0.75))
    assert metrics.force_settling_time(trace, 0.02) == pytest.approx(1.0 + 0.5 * math.log(100.0), abs=2e-3)
    assert metrics.force_settling_time(synthetic(1.0)) is None


@pytest.mark.parametrize("zeta", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("direction", [1.0, -2.0])
def test_overshoot_of_a_second_order_step(synthetic, zeta, direction):
    w = math.sqrt(1.0 - zeta**2)

    def x(t):
        return axis(direction * (1.0 - np.exp(-zeta * t) * (np.cos(w * t) + zeta / w * np.sin(w * t))), 0, 3)

    expected = math.exp(-math.pi * zeta / w)
    assert metrics.overshoot(synthetic(60.0, p_WB=x)) == pytest.approx(expected, rel=1e-3)


def test_no_overshoot_without_one(synthetic):
    assert metrics.overshoot(synthetic(20.0, p_WB=lambda t: axis(1.0 - np.exp(-t), 0, 3))) < 1e-8
    assert metrics.overshoot(synthetic(1.0)) == 0.0


def test_impulse_of_the_first_touch_alone(synthetic):
    def push(t):  # two touches, half a sine of 10 N and 0.1 s each: 20/pi * 0.1 N s
        return np.where(
            (t % 0.5 > 0.3) & (t % 0.5 < 0.4) & (t < 1.0), 10.0 * np.sin(np.pi * (t % 0.5 - 0.3) / 0.1), 0.0
        )

    trace = synthetic(
        2.0,
        f_contact_W=lambda t: axis(-push(t), 0, 3),
        impulse=lambda t: running(0.5 * H * (push(t)[1:] + push(t)[:-1])),
    )
    expected = 2.0 / math.pi * 10.0 * 0.1
    assert metrics.impact_impulse(trace) == pytest.approx(expected, rel=1e-3)
    assert metrics.impact_impulse(decimated(trace, 10)) == metrics.impact_impulse(trace)
    assert metrics.impact_impulse(synthetic(0.1)) is None


def test_chattering_counts_what_leads_nowhere_and_not_what_is_smooth(synthetic):
    def square(t):
        return axis(np.where(np.arange(len(t)) % 2, 0.5, -0.5), 0)

    def smooth(t):
        return axis(10.0 * np.sin(2.0 * np.pi * 0.5 * t), 0)

    def trace_of(tau):
        return synthetic(
            4.0,
            tau=tau,
            tau_variation=lambda t: running(np.abs(np.diff(tau(t), axis=0))),
            tau_step_max=lambda t: np.maximum.accumulate(np.abs(np.diff(tau(t), axis=0, prepend=tau(t)[:1])), axis=0),
        )

    fast, slow = trace_of(square), trace_of(smooth)
    both = trace_of(lambda t: square(t) + smooth(t))
    assert metrics.chattering(fast)[0] == pytest.approx(1.0 / H)
    assert metrics.mean_change(fast)[0] == pytest.approx(1.0)
    assert metrics.largest_change(fast)[0] == 1.0
    assert metrics.total_variation(fast, 1.0, 3.0)[0] == pytest.approx(2.0 / H)
    assert metrics.reversals(fast, 0.9)[0] == 4.0 / H - 1
    assert metrics.reversals(fast, 1.1)[0] == 0
    assert metrics.reversals(slow, 0.0)[0] == 4
    assert metrics.total_variation(slow)[0] == pytest.approx(80.0, rel=1e-4)
    assert metrics.chattering(slow)[0] < 0.01 * 20.0
    assert metrics.chattering(both)[0] == pytest.approx(1.0 / H, rel=0.05)
    assert not metrics.chattering(both)[1:].any()


def test_time_inside_is_a_part_of_the_window(synthetic):
    trace = synthetic(2.0, boundary_layer_time=lambda t: np.maximum(t - 1.0, 0.0)[:, None] * np.ones(6))
    assert metrics.boundary_layer_share(trace) == pytest.approx(np.full(6, 0.5))
    assert metrics.boundary_layer_share(trace, 1.0) == pytest.approx(np.ones(6))


def test_energy_drawn_from_a_wall_is_what_its_work_fell_below_zero(synthetic):
    assert metrics.energy_from_wall(synthetic(2.0, wall_work=lambda t: np.sin(np.pi * t))) == pytest.approx(1.0)
    assert metrics.energy_from_wall(synthetic(2.0, wall_work=lambda t: t * (2.0 - t))) == 0.0


def test_impedance_error_of_a_motion_that_obeys_eq_12_up_to_a_known_force(synthetic, header):
    design = residual.design_of(synthetic(0.01))
    w, a, off = 3.0, 0.05, 0.25

    def f_x(t):
        e, v, acc = a * np.sin(w * t), a * w * np.cos(w * t), -a * w**2 * np.sin(w * t)
        return design.M_d[0, 0] * acc + design.D_d[0, 0] * v + design.K_d[0, 0] * e + off

    trace = synthetic(
        4.0,
        p_WB=lambda t: axis(a * np.sin(w * t), 0, 3),
        eta_e=lambda t: axis(a * np.sin(w * t), 0),
        nu_e=lambda t: axis(a * w * np.cos(w * t), 0),
        f_contact_W=lambda t: axis(f_x(t), 0, 3),
        impulse=lambda t: running(-0.5 * H * (f_x(t)[1:] + f_x(t)[:-1])),
    )
    # first order in H: a force of the simulation is constant over a step, the synthetic force is not
    assert residual.impedance_error(trace)[0] == pytest.approx(off, abs=0.02)
    assert residual.impedance_error(decimated(trace, 10))[0] == pytest.approx(
        residual.impedance_error(trace)[0], abs=2e-3
    )


def test_impedance_error_is_refused_beside_other_walls_than_the_wall_that_faces_the_start():
    """On a pile in front of two bumpers the force has other directions and other arms."""
    trace = simulate(Scenario.load("press_pile", {"simulation.duration": 0.01}), engine="free_body")
    with pytest.raises(InputError, match=r"known for the probe in front of \[wall\] alone"):
        residual.impedance_error(trace)


def test_impedance_error_does_not_take_a_switching_velocity_for_a_motion(synthetic):
    """The vehicle oscillates from step to step; every tenth row has the same position and velocity."""
    trace = synthetic(
        0.5,
        p_WB=lambda t: axis(np.arange(len(t)) % 2 * H * 1e-3, 0, 3),
        nu_e=lambda t: axis(np.where(np.arange(len(t)) % 2, 1e-3, -1e-3), 0),
    )
    D = residual.design_of(trace).D_d[0, 0]
    assert D * 1e-3 > 0.05
    for each in (trace, decimated(trace, 2), decimated(trace, 10)):
        assert residual.impedance_error(each)[0] < 1e-9


def test_impedance_error_of_a_steady_turn_is_what_damps_it(synthetic):
    rate = 0.7
    trace = synthetic(
        1.0,
        quat_WB=lambda t: np.stack([np.cos(rate * t / 2), 0 * t, 0 * t, np.sin(rate * t / 2)], axis=1),
        nu_e=lambda t: axis(np.full(len(t), rate), 5),
    )
    D_d = residual.design_of(trace).D_d
    for each in (trace, decimated(trace, 100)):
        assert residual.impedance_error(each) == pytest.approx(np.abs(D_d[:, 5]) * rate, rel=1e-9, abs=1e-12)


def test_impedance_error_is_not_given_where_friction_between_rows_is_unknown():
    """Friction may change its sign at every step, which rows can't resolve."""
    rough = {
        "wall.friction": 0.5,
        "wall.position": 0.02,
        "reference.target": [0.05, 0.02, 0.0],
        "reference.step_time": 0.0,
        "simulation.duration": 3.0,
    }
    every, some = (simulate(Scenario.load("push_wall", rough), log_rate=rate) for rate in ("full", 1000))
    assert np.isfinite(residual.impedance_error(every)).all()
    assert np.array_equal(np.isfinite(residual.impedance_error(some)), [True] + [False] * 5)
    assert residual.impedance_error(some)[0] == pytest.approx(residual.impedance_error(every)[0], rel=0.2)
    assert np.isfinite(residual.impedance_error(some, 0.0, 0.5 * float(some.first_contact[-1]))).all()


@pytest.mark.parametrize("start", [1.23, 1.6, 2.9])
def test_impedance_error_is_the_mean_of_eq_12_at_every_step_also_while_the_reference_moves(start):
    scenario = Scenario.load("push_wall", {"simulation.duration": 3.0, "reference.bandwidth": 3.0})
    trace = simulate(scenario, Gsta(), log_rate="full")
    h = scenario.simulation.timestep
    design, first = residual.design_of(trace), round(start / h)
    window = slice(first, first + 100)
    nu_e_dot = np.diff(trace.nu_e, axis=0)[window] / h
    left = nu_e_dot @ design.M_d.T + trace.nu_e[window] @ design.D_d.T + trace.eta_e[window] @ design.K_d.T
    expected = np.abs(left.mean(axis=0))
    assert np.abs(left).max() > 1e-3
    for each in (trace, decimated(trace, 10)):
        error = residual.impedance_error(each, trace.t[first], trace.t[first + 100])
        assert error[:3] == pytest.approx(expected[:3], abs=2e-5)


def test_at_rest_super_twisting_leaves_nothing_of_eq_12_over_at_any_log_rate(paper_run):
    trace = paper_run("gsta")
    for each in (trace, decimated(trace, 10), decimated(trace, 100)):
        assert residual.impedance_error(each, 19.0).max() < 1e-7


def test_impedance_error_is_exact_where_eq_12_is_stepped_as_the_plant_steps(synthetic):
    """For a mass under a growing force, stepped by explicit Euler, the residual is zero at any log rate."""
    mass = synthetic(0.01)
    settings = {"impedance.K_d": [0.0] * 6, "impedance.D_d": [0.0] * 6, "impedance.M_d": [2.0] * 6}
    scenario = mass.scenario.updated(settings | {"simulation.duration": 1.0})

    def f_x(t):
        return -1000.0 * t

    trace = synthetic(
        1.0,
        nu_e=lambda t: axis(running(H * f_x(t)[:-1] / 2.0), 0),
        f_contact_W=lambda t: axis(f_x(t), 0, 3),
        impulse=lambda t: running(-0.5 * H * (f_x(t)[1:] + f_x(t)[:-1])),
    )
    trace = dataclasses.replace(trace, header=dataclasses.replace(trace.header, scenario=scenario))
    for each in (trace, decimated(trace, 5)):
        assert residual.impedance_error(each).max() < 1e-9


def test_impedance_error_at_rest_is_that_of_eq_20(paper_run):
    """The first-order law comes to rest inside its boundary layer, where the residual of eq. (12) is -M_d A s."""
    trace = paper_run("fosm")
    expected = np.abs(residual.design_of(trace).M_d @ (100.0 * trace.s[-1]))
    assert residual.impedance_error(trace, 19.0)[[0, 1, 5]] == pytest.approx(expected[[0, 1, 5]], rel=1e-3)


def test_the_force_that_is_demanded_is_where_gsta_rests(paper_run):
    trace = paper_run("gsta")
    assert demanded_force(trace.scenario) == pytest.approx(trace.analytic.force, rel=1e-9)
    assert abs(metrics.steady_force_error(trace)) < 1e-6
    fosm = paper_run("fosm")
    assert metrics.steady_force_error(fosm) == pytest.approx(1.486551 - 1.497753, abs=1e-6)


@pytest.mark.parametrize("attitude", [[0.0, 0.0, 30.0], [10.0, -20.0, 40.0]])
def test_the_force_that_is_demanded_does_not_need_a_straight_attitude(attitude):
    settings = {"simulation.duration": 1e-3, "reference.attitude_deg": attitude}
    trace = simulate(Scenario.load("push_wall", settings), Gsta())
    assert demanded_force(trace.scenario) == pytest.approx(trace.analytic.force, rel=1e-6)


def test_generalised_impedance_is_what_is_demanded_and_judged():
    """Eq. (7) with a force reference against the force at rest of GSTA, which is computed independently."""
    settings = {"impedance.K_f": [0.5, 1.0, 1.0, 1.0, 1.0, 1.0], "impedance.F_d": [-2.0, 0.0, 0.0, 0.0, 0.0, 0.0]}
    trace = simulate(Scenario.load("push_wall", settings | {"simulation.duration": 10.0}), Gsta())
    assert demanded_force(trace.scenario) == pytest.approx(trace.analytic.force, rel=1e-9)
    assert demanded_force(trace.scenario) > 3.0
    assert abs(metrics.steady_force_error(trace)) < 1e-3  # it still settles
    assert residual.impedance_error(trace, 9.0).max() < 1e-4


def test_without_stiffness_the_force_reference_alone_is_demanded():
    stiffness = {"impedance.K_d": [0.0, 1500.0, 1500.0, 50.0, 50.0, 50.0], "impedance.D_d": [90.0] * 3 + [5.0] * 3}
    settings = stiffness | {"impedance.F_d": [-2.0, 0.0, 0.0, 0.0, 0.0, 0.0], "wall.stiffness": 1e4}
    trace = simulate(Scenario.load("push_wall", settings | {"simulation.duration": 1e-3}), Gsta())
    assert trace.analytic.force == pytest.approx(2.0)
    assert demanded_force(trace.scenario) == pytest.approx(2.0)


def test_no_force_is_demanded_of_a_reference_in_the_water_or_without_stiffness(synthetic):
    for settings in ({"reference.target": [0.9, 0.0, 0.0]}, {"impedance.K_d": [0.0, 1.0, 1.0, 1.0, 1.0, 1.0]}):
        trace = synthetic(0.01)
        header = dataclasses.replace(trace.header, scenario=trace.scenario.updated(settings))
        assert demanded_force(dataclasses.replace(trace, header=header).scenario) == 0.0


def test_metrics_do_not_depend_on_the_log_rate():
    """A run in contact that chatters: every step, 1 kHz and 100 Hz."""
    scenario = Scenario.load("push_wall", CONTACT)
    full, *others = (simulate(scenario, Gsta(), log_rate=rate) for rate in ("full", 1000.0, 100.0))
    exact = (
        metrics.control_effort,
        metrics.total_variation,
        metrics.largest_change,
        metrics.mean_change,
        metrics.boundary_layer_share,
        lambda trace: metrics.chattering(trace, 0.1),
        lambda trace: metrics.total_variation(trace, 0.1, 0.3),
        lambda trace: metrics.final_force(trace)[0],
    )
    assert full.touches[-1] > 0
    for trace in others:
        for metric in exact:
            assert metric(trace) == pytest.approx(metric(full), rel=1e-12)
    error = residual.impedance_error(full)
    # nu_e and eta_e are known at rows only, so that the accuracy of their mean over 10 ms depends on the log rate
    assert residual.impedance_error(others[0]) == pytest.approx(error, rel=5e-3, abs=2e-5)


def test_what_a_window_has_is_the_difference_of_two_runs_ends():
    scenario = Scenario.load("push_wall", CONTACT)
    long = simulate(scenario)
    short = simulate(scenario.updated({"simulation.duration": 0.2}))
    for metric in (metrics.control_effort, metrics.total_variation, metrics.largest_change):
        assert np.array_equal(metric(long, end=0.2), metric(short))


def held(steps: int, values) -> np.ndarray:
    """Values (n,), each held for a number of steps."""
    return np.repeat(values, steps)


@pytest.mark.parametrize("period", [1e-3, 2e-3, 1e-2, 5e-2])
def test_chattering_of_a_held_command_counts_control_periods(synthetic, period):
    """A command that alternates by 3 N from one control instant to the next, on a slow sine: 3 N/T_c."""
    n, duration = round(period / H), 10.0
    instants = round(duration / period) + 1

    def commanded(t):
        at = t[::n][:instants]
        slow = held(n, 10.0 * np.sin(2.0 * np.pi * 0.1 * at))[: len(t)]
        return axis(held(n, np.where(np.arange(instants) % 2, 1.5, -1.5))[: len(t)], 0) + axis(slow, 1)

    trace = synthetic(
        duration,
        tau=commanded,
        tau_variation=lambda t: running(np.abs(np.diff(commanded(t), axis=0))),
    )
    scenario = trace.scenario.updated({"controller.period": period})
    trace = dataclasses.replace(trace, header=dataclasses.replace(trace.header, scenario=scenario))
    assert metrics.chattering(trace)[0] == pytest.approx(3.0 / period, rel=1e-6)
    assert metrics.chattering(trace)[1] < 0.1 * metrics.total_variation(trace)[1] / duration
    assert metrics.mean_change(trace)[0] == pytest.approx(3.0, rel=1e-6)
    assert metrics.reversals(trace, 2.9)[0] == instants - 2
    assert metrics.reversals(trace, 3.1)[0] == 0


@pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning")
@pytest.mark.parametrize("period", [1e-3, 1e-2, 5e-2])
def test_the_first_order_law_chatters_at_every_control_period_that_is_too_long(period):
    """s changes its sign at every control instant, and tau changes by all of K_s M: the variation cancels."""
    settings = {"controller.period": period, "simulation.duration": 3.0}
    trace = simulate(Scenario.load("push_wall", settings, "fosm"))
    variation = metrics.total_variation(trace) / trace.duration_s
    assert variation[0] > 1e4
    assert (metrics.chattering(trace)[:3] > 0.9 * variation[:3]).all()


@pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning")
def test_chattering_of_less_than_ten_control_periods_is_not_a_number():
    settings = {"controller.period": 0.01, "simulation.duration": 0.3}
    trace = simulate(Scenario.load("push_wall", settings))
    assert np.isnan(metrics.chattering(trace, 0.0, 0.09)).all()
    assert np.isfinite(metrics.chattering(trace, 0.0, 0.11)).all()


@pytest.fixture
def pushing(synthetic):
    """A function that makes a trace of 20 s from a force in contact as a function of time."""

    def make(force):
        def impulse(t):
            return metrics.cumulative(t, force(t)[:, None])[:, 0]

        def late(t):
            return force(t[t >= 19.5 - 1e-9])

        return synthetic(
            20.0,
            f_contact_W=lambda t: axis(-force(t), 0, 3),
            impulse=impulse,
            final_impulse=lambda t: impulse(t) - np.interp(19.5, t, impulse(t)),
            final_low=lambda t: np.full_like(t, late(t).min()),
            final_high=lambda t: np.full_like(t, late(t).max()),
        )

    return make


@pytest.mark.parametrize("rate", [0.3, 0.003, 0.0015, 1e-4, -1e-4])
def test_a_force_that_ramps_has_not_settled(pushing, rate):
    """Slow ramps count too: 0.15 % per second is below the limit in the last 0.5 s and takes 13 s for 2 %."""
    trace = pushing(lambda t: 1.5 * (1.0 + rate * t))
    final, settled = metrics.final_force(trace)
    assert not settled
    assert metrics.trend(trace).rate == pytest.approx(1.5 * rate, rel=1e-6)
    assert metrics.settling_time(trace.t, trace.push, final, 0.02 * final) is not None
    assert metrics.force_settling_time(trace) is None
    assert metrics.force_settling_time(pushing(lambda t: 1.5 * (1.0 + rate * np.exp(-t)))) is not None


@pytest.mark.parametrize("seconds", [2.0, 5.0, 20.0, 60.0])
@pytest.mark.parametrize(("ripple", "little", "much"), [(0.0, 8.5e-4, 1.1e-3), (1e-4, 3e-4, 5e-3)])
def test_a_force_has_settled_if_less_than_a_thousandth_is_still_to_come(pushing, seconds, ripple, little, much):
    """An exponential with its time constant, and a vibration below it; ``little`` and ``much`` are still to come."""
    for share, sign in itertools.product((little, much), (-1.0, 1.0)):
        trace = pushing(
            lambda t, share=share, sign=sign: (
                40.0 * (1.0 + sign * share * np.exp((20.0 - t) / seconds) + ripple * np.sin(2.0 * np.pi * 7.0 * t))
            )
        )
        assert metrics.final_force(trace)[1] == (share == little), (share, sign)
        found = metrics.trend(trace)
        if not ripple:
            centre = np.exp(0.25 / seconds)  # of the last 0.5 s
            assert found.to_come == pytest.approx(
                40.0 * share * centre * np.sinh(0.25 / seconds) / (0.25 / seconds), rel=1e-5
            )
        if found is not None:
            assert np.sign(found.rate) == -sign
        stopped = dataclasses.replace(trace, outcome=Outcome(Status.interrupted, "", trace.steps, 1.0))
        assert metrics.final_force(stopped)[1] == (share == little)
        assert metrics.final_force(decimated(stopped, 100))[1] == (share == little)


@pytest.mark.parametrize("phase", np.linspace(0.0, 2.0 * np.pi, 12))
def test_a_slow_oscillation_that_dies_away_is_at_rest(pushing, phase):
    """Twice in a row its mean moves the same way, by more than it varies in 0.5 s; but it is small."""
    trace = pushing(lambda t: 1.5 * (1.0 + 5e-4 * np.exp(-t / 4.0) * np.cos(2.0 * t + phase)))
    assert metrics.final_force(trace)[1]


def test_an_impact_does_not_hide_that_the_force_creeps(pushing):
    """The vehicle has touched 1.5 s before the end. The force before it is no trend."""
    creeps = pushing(lambda t: np.where(t < 18.4, 0.0, 40.0 * (1.0 - 2e-3 * np.exp((20.0 - t) / 3.0))))
    rests = pushing(lambda t: np.where(t < 18.4, 0.0, 40.0))
    assert not metrics.final_force(creeps)[1]
    assert metrics.final_force(rests)[1]


CREEPS = {
    "wall.present": False,
    "walls": [{"shape": "plane", "stiffness": 2e4, "position": [1.2, 0.0, 0.0], "attitude_deg": [0.0, 0.0, 20.0]}],
    "reference.target": [1.3, 0.0, 0.0],
    "impedance.K_d": [400.0, 5.0, 400.0, 50.0, 50.0, 50.0],
    "impedance.damping_ratio": 30.0,
    "current.speed": 0.0,
    "simulation.timestep": 1e-3,
}
"""The vehicle slides along a wall with a time constant of 20 s."""


def test_a_vehicle_that_creeps_along_a_wall_has_settled_when_the_closed_form_is_near():
    for duration, settled in ((100.0, False), (150.0, False), (170.0, True)):
        scenario = Scenario.load("push_wall", CREEPS | {"simulation.duration": duration})
        trace = simulate(scenario, engine="free_body", keep_s=metrics.AROUND_THE_END_S)
        contact, error = summary(trace, {})["contact"], abs(trace.push[-1] / trace.analytic.force - 1.0)
        assert contact["settled"] is settled
        assert (error < metrics.SETTLED) == settled
        assert (contact["relative_error"] is not None) is settled
        assert -contact["trend_N_per_s"] * 20.2 == pytest.approx(error * trace.analytic.force, rel=0.05)


def test_a_position_that_drifts_has_not_settled(synthetic):
    drifting = synthetic(20.0, p_WB=lambda t: axis(0.1 * t, 0, 3))
    assert metrics.position_settling_time(drifting) is None
    assert metrics.overshoot(drifting) is None
    swinging = synthetic(20.0, p_WB=lambda t: axis(np.minimum(t, 1.0) + 0.005 * np.sin(2.0 * np.pi * 4.0 * t), 0, 3))
    assert metrics.position_settling_time(swinging) == pytest.approx(0.98, abs=0.02)  # swings within the band


@pytest.fixture(scope="module")
def push():
    """Runs of a given duration. The vehicle touches the wall between 5 and 6 s and has settled at 9 s."""
    return lambda duration: simulate(
        Scenario.load("push_wall", {"simulation.duration": duration}), engine="free_body", log_rate=1000
    )


@pytest.mark.parametrize(("stopped_s", "settled"), [(0.3, False), (0.6, False), (6.0, False), (10.0, True)])
def test_a_run_that_was_stopped_settled_as_the_shorter_run_did(push, stopped_s, settled):
    """Up to an interrupt, a run is the one whose duration ends there. The window of the latter is of every step."""
    whole, short = push(20.0), push(stopped_s)
    kept = whole.t <= stopped_s + 1e-9
    outcome = Outcome(Status.interrupted, "", short.steps, 1.0)
    stopped = Trace(whole.header, {name: whole[name][kept] for name in whole}, outcome)
    assert metrics.final_force(stopped) == (pytest.approx(metrics.final_force(short)[0], rel=1e-9), settled)
    assert metrics.final_force(short)[1] is settled
    assert summary(stopped, {})["contact"]["relative_error"] is None  # the closed form is of the end
    diverged = dataclasses.replace(stopped, outcome=Outcome(Status.unstable, "", short.steps, 1.0))
    assert metrics.final_force(diverged)[1] is False


def test_an_interrupt_between_slow_rows_hides_no_vibration(synthetic):
    """Every row has the same force, but its mean over every step is another one."""
    held = synthetic(2.0, f_contact_W=lambda t: axis(np.full(len(t), -1.5), 0, 3), impulse=lambda t: 1.5 * t)
    vibrates = synthetic(2.0, f_contact_W=lambda t: axis(np.full(len(t), -1.5), 0, 3), impulse=lambda t: 1.6 * t)
    for trace, settled in ((held, True), (vibrates, False)):
        stopped = dataclasses.replace(trace, outcome=Outcome(Status.interrupted, "", 2000, 1.0))
        assert metrics.final_force(decimated(stopped, 100))[1] is settled


def test_a_run_that_is_pushed_ever_harder_has_not_settled():
    """The reference keeps moving into the wall, so that the force grows until the end."""
    settings = {
        "wall.position": 0.01,
        "reference.step_time": 0.0,
        "reference.target": [1.0, 0.0, 0.0],
        "reference.bandwidth": 0.5,
        "simulation.duration": 12.0,
    }
    trace = simulate(Scenario.load("push_wall", settings))
    force, settled = metrics.final_force(trace)
    assert force > 1.0
    assert not settled
    assert metrics.settling_time(trace.t, trace.push, force, 0.02 * force) is not None
    assert metrics.force_settling_time(trace) is None
