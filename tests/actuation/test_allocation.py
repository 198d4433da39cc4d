"""Allocations against their optimality conditions and against SciPy's solver."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from uvms_mj import Scenario, Simulation, simulate
from uvms_mj.actuation import Constrained, Scaled, Weighted
from uvms_mj.actuation.allocation import quadratic
from uvms_mj.physics.kernels import record_of
from uvms_mj.physics.spanned_axes import pseudoinverse, spanning

FREE = {"engine": "free_body"}
HEAVY = [  # place and direction of the thrusters of the BlueROV2 Heavy, x forward, y left, z up
    *((0.156, s * 0.111, -0.085, np.cos(np.pi / 4), s * np.sin(np.pi / 4), 0.0) for s in (1.0, -1.0)),
    *((-0.156, s * 0.111, -0.085, -np.cos(np.pi / 4), s * np.sin(np.pi / 4), 0.0) for s in (1.0, -1.0)),
    *((x, y, 0.0, 0.0, 0.0, 1.0) for x in (0.12, -0.12) for y in (0.218, -0.218)),
]
HEAVY_B = np.array([[*row[3:], *np.cross(row[:3], row[3:])] for row in HEAVY]).T


class Given:
    pass


def allocated(stage, B, tau_cmd, u_min, u_max):
    """The thrusts that a shipped allocation sets, as plain Python."""
    setup, given, settings, u = Given(), Given(), Given(), np.zeros(B.shape[1])
    setup.nominal = Given()
    setup.nominal.B = B
    vars(settings).update(stage.constants(setup))
    given.tau_cmd, given.u_min, given.u_max = tau_cmd, u_min, u_max
    stage.step(settings, record_of(stage.state_record(B.shape[1])), given, None, u)
    return u


def nearest(B, W, tau_cmd, u_min, u_max):
    """The solution of the same problem by SciPy, as bounded least squares."""
    H, _ = quadratic(B, W)
    small = np.sqrt(H[0, 0] - (W**2) @ B[:, 0] ** 2)
    rows, right = np.vstack([W[:, None] * B, small * np.eye(B.shape[1])]), np.zeros(6 + B.shape[1])
    right[:6] = W * tau_cmd
    return lsq_linear(rows, right, (u_min, u_max), method="bvls", tol=1e-15, max_iter=1000).x


@pytest.mark.parametrize("vehicle", ["heavy", "six", "five", "twelve"])
def test_the_constrained_allocation_is_that_of_scipy(vehicle, rng):
    """100 random commands, most of which the thrusters can't produce."""
    n = {"six": 6, "five": 5, "twelve": 12}.get(vehicle)
    stage, bound = Constrained(), 0
    W = np.array(stage.weights)
    for _ in range(100):
        B = HEAVY_B if n is None else np.concatenate([rng.normal(size=(3, n)), 0.2 * rng.normal(size=(3, n))])
        B = spanning(B / np.linalg.norm(B[:3], axis=0))  # some have an axis that does not count
        u_min, u_max = -rng.uniform(5.0, 40.0, B.shape[1]), rng.uniform(5.0, 50.0, B.shape[1])
        tau_cmd = B @ rng.uniform(-80.0, 80.0, B.shape[1]) + rng.normal(size=6)
        u = allocated(stage, B, tau_cmd, u_min, u_max)
        free = stage.inverse(B) @ tau_cmd
        if ((free >= u_min) & (free <= u_max)).all():
            assert np.abs(u - free).max() < 1e-12
            continue
        bound += 1
        assert np.abs(u - nearest(B, W, tau_cmd, u_min, u_max)).max() < 1e-9 * np.abs(u).max()
        H, linear = quadratic(B, W)
        gradient = H @ u - linear @ tau_cmd
        pulls_in = np.where(
            u <= u_min, np.minimum(gradient, 0.0), np.where(u >= u_max, np.maximum(gradient, 0.0), gradient)
        )
        assert np.abs(pulls_in).max() < 1e-10
    assert bound > 50


def test_the_constrained_allocation_gets_nearer_than_clipping(rng):
    stage, W = Constrained(), np.array(Constrained().weights)
    limits = np.full(8, -40.0), np.full(8, 50.0)
    gained = []
    for _ in range(100):
        tau_cmd = rng.uniform(-1.0, 1.0, 6) * np.array([150.0, 150.0, 200.0, 30.0, 20.0, 30.0])
        clipped = np.clip(np.linalg.pinv(HEAVY_B) @ tau_cmd, *limits)
        u = allocated(stage, HEAVY_B, tau_cmd, *limits)
        far = [np.linalg.norm(W * (HEAVY_B @ each - tau_cmd)) for each in (u, clipped)]
        gained.append(far[1] - far[0])
    assert min(gained) > -1e-3  # by the term of |u|^2
    assert max(gained) > 10.0


@pytest.mark.parametrize("B", [HEAVY_B, HEAVY_B[:, :5]], ids=["heavy", "five thrusters"])
def test_the_weighted_allocation_has_the_least_weighted_thrust(B, rng):
    """B u is the nearest wrench, and W u is orthogonal to the null space of B."""
    n, limit = B.shape[1], np.full(B.shape[1], 1e6)
    weights = rng.uniform(0.2, 5.0, n)
    tau_cmd = rng.normal(size=6) * 20.0
    u = allocated(Weighted(tuple(weights)), B, tau_cmd, -limit, limit)
    assert np.abs(B.T @ (B @ u - tau_cmd)).max() < 1e-9
    _, values, V = np.linalg.svd(B)
    null = V[np.count_nonzero(values > 1e-9) :]
    assert len(null) == {8: 2, 5: 1}[n]
    assert np.abs(null @ (weights * u)).max(initial=0.0) < 1e-9
    assert allocated(Weighted(), B, tau_cmd, -limit, limit) == pytest.approx(np.linalg.pinv(B) @ tau_cmd)


LIMITED = {
    "thrusters.name": "general",
    "thrusters.curve_command": [-9.0, 12.0],
    "thrusters.curve_thrust": [-9.0, 12.0],
    "simulation.duration": 1.0,
    "reference.step_time": 0.0,
    "reference.target": [3.0, 2.0, -1.0],
    "wall.position": 50.0,
}


@pytest.mark.parametrize("name", ["weighted", "constrained", "pseudo_inverse"])
def test_the_lost_part_of_the_command_is_recorded(name):
    """With limits that bind, machine code and plain Python agree, and tau_lost is tau_cmd - B u_cmd."""
    scenario = Scenario.load("push_wall", LIMITED | {"actuation.name": name}, "impedance")
    trace = simulate(scenario, **FREE)
    with Simulation(scenario, **FREE) as sim:
        B = sim.setup.vehicle.B
    assert np.abs(trace.tau_lost - (trace.tau_cmd - trace.u_cmd @ B.T)).max() < 1e-10
    assert np.abs(trace.tau_lost).max() > 1.0
    assert trace.saturation_time[-1] > 0.1
    if name != "pseudo_inverse":
        for i in range(0, len(trace.t), 50):
            u = allocated(scenario.actuation, B, trace.tau_cmd[i], np.full(6, -9.0), np.full(6, 12.0))
            assert u == pytest.approx(trace.u_cmd[i], abs=1e-9)


def test_the_loss_is_recorded_only_where_it_may_be_asked_for():
    for own, there in (({}, False), ({"actuation.name": "weighted"}, True), ({"thrusters.name": "t200"}, True)):
        with Simulation(Scenario.load("push_wall", own), **FREE) as sim:
            assert ("tau_lost" in [signal.name for signal in sim.recorded]) == there


def test_the_scaled_allocation_keeps_the_direction_of_the_wrench(rng):
    """500 commands for the BlueROV2 Heavy: where a limit binds, one thrust is at its limit and the wrench is a part of
    the command; where none binds, the thrusts are those of the pseudoinverse."""
    given, bound = Given(), 0
    given.B_pinv = pseudoinverse(HEAVY_B)
    for _ in range(500):
        given.u_min, given.u_max = -rng.uniform(5.0, 40.0, 8), rng.uniform(5.0, 50.0, 8)
        given.tau_cmd, u = HEAVY_B @ (rng.uniform(1.0, 60.0) * rng.uniform(-1.0, 1.0, 8)), np.zeros(8)
        Scaled.step(None, None, given, None, u)
        free = given.B_pinv @ given.tau_cmd
        assert ((u >= given.u_min) & (u <= given.u_max)).all()
        tau, wanted = HEAVY_B @ u, given.tau_cmd / np.linalg.norm(given.tau_cmd)
        assert np.linalg.norm(tau / np.linalg.norm(tau) - wanted) < 1e-9
        if ((free >= given.u_min) & (free <= given.u_max)).all():
            assert np.array_equal(u, free)
        else:
            bound += 1
            assert np.minimum(u - given.u_min, given.u_max - u).min() < 1e-12
    assert 100 < bound < 490


def test_a_run_with_the_scaled_allocation_records_what_it_lacks():
    """A push of 3 kN on a Heavy: the forces of the thrusters are those of the command, times a factor."""
    strong = {"vehicle.model": "bluerov2_heavy", "actuation.name": "scaled", "impedance.F_d": [-3000.0, 0, 0, 0, 0, 0]}
    trace = simulate(Scenario.load("push_wall", strong | {"simulation.duration": 0.2}, "impedance"), **FREE)
    tau, wanted = trace.tau[-1], trace.tau_cmd[-1]
    assert np.linalg.norm(wanted) > 1.5 * np.linalg.norm(tau) > 50.0
    assert tau @ wanted == pytest.approx(np.linalg.norm(tau) * np.linalg.norm(wanted), rel=1e-12)
    np.testing.assert_allclose(trace.tau_lost[-1], wanted - tau, atol=1e-9)
