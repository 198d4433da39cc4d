"""The scenario tool_slide: a tool presses on a pile and slides along it with friction, by the laws of both."""

import numpy as np
import pytest

from uvms_mj import Scenario, simulate

SLIDES, ARRIVES = (14.0, 19.0), 24.0
"""Times between which the tool slides at a constant speed, and after which it rests."""


@pytest.fixture(scope="module")
def run():
    trace = simulate(Scenario.load("tool_slide"), log_rate=100.0)
    sliding = (trace.t >= SLIDES[0]) & (trace.t <= SLIDES[1])
    return trace, sliding


def of_the_springs(scenario) -> tuple[float, float, float]:
    """F_n, F_t and the pitch [rad] of the tool as it slides along z.

    K_d eta_e is the wrench of the pile in the axes of the tool. With the pitch p these are F_n = K_x d/(1 + K_x/k_c)
    + (1 - K_x/K_z) p F_t to first order in p, F_t = mu F_n, and K_q sin(p/2) = r F_t: the contact point is r in front
    of the site, the radius of its sphere less half the depth. The tool lags by F_t/K_z - p F_n (1/K_x - 1/K_z).
    """
    (pile,), K_d = scenario.walls, scenario.impedance.K_d
    x_c = pile.position[0] - pile.radius - 0.03
    d = scenario.reference.poses[0].position[0] - x_c
    F_n = F_0 = K_d[0] * d / (1.0 + K_d[0] / pile.stiffness)
    for _ in range(20):
        F_t = pile.friction * F_n
        pitch = 2.0 * np.arcsin((0.03 - 0.5 * F_n / pile.stiffness) * F_t / K_d[4])
        F_n = F_0 + (1.0 - K_d[0] / K_d[2]) * pitch * F_t
    return F_n, F_t, pitch


def test_the_push_is_that_of_the_springs_and_near_10_newtons(run):
    trace, sliding = run
    F_n, _, _ = of_the_springs(trace.scenario)
    assert abs(F_n - 10.0) < 0.02  # without friction it is 10 N
    assert trace.push[sliding].mean() == pytest.approx(F_n, abs=3e-3)
    assert np.abs(trace.push[sliding] - F_n).max() < 0.01
    assert trace.push[-1] == pytest.approx(F_n, abs=1e-3)


def test_the_friction_is_that_of_coulomb_while_the_tool_slides(run):
    trace, sliding = run
    along = trace.f_contact_W[sliding][:, 1:]
    assert np.linalg.norm(along, axis=1) == pytest.approx(0.2 * trace.push[sliding], rel=1e-4)
    assert (along[:, 1] < 0.0).all()  # the tool goes up
    assert trace.p_WT[sliding][-1, 2] - trace.p_WT[sliding][0, 2] == pytest.approx(0.05 * np.diff(SLIDES)[0], rel=2e-3)


def test_the_tool_touches_once_and_follows_the_path_as_far_as_friction_lets_it(run):
    trace, sliding = run
    assert trace.touches[-1] == 1
    assert trace.force_peak[-1] < 15.0
    F_n, F_t, pitch = of_the_springs(trace.scenario)
    lag = trace.p_d[sliding][:, 2] - trace.p_WT[sliding][:, 2]
    assert lag[-1] == pytest.approx(F_t / 400.0 - pitch * F_n * (1.0 / 100.0 - 1.0 / 400.0), abs=1e-6)
    assert np.abs(np.diff(lag)).max() < 1e-5
    assert np.abs(trace.p_WT[sliding][:, 1]).max() < 1e-3
    assert 2.0 * np.arcsin(trace.eta_e[sliding][-1, 4]) == pytest.approx(pitch, abs=1e-6)


@pytest.mark.parametrize("azimuth", [0.0, pytest.param(180.0, marks=pytest.mark.slow)])
def test_it_stands_a_faster_current_towards_the_pile_and_away(azimuth):
    """As the push at the end depends on no current, the force is that of the springs."""
    current = {"current.speed": 0.5, "current.direction_deg": azimuth}
    trace = simulate(Scenario.load("tool_slide", current), log_rate=100.0)
    assert trace.notes == ()
    assert trace.touches[-1] == 1
    assert trace.push[-1] == pytest.approx(of_the_springs(trace.scenario)[0], abs=1e-3)
