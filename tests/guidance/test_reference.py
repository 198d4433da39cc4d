"""The reference is the third-order filter's step response."""

from types import SimpleNamespace

import numpy as np
from scipy.integrate import solve_ivp

from uvms_mj.guidance import FilteredSteps


def evaluate(t, start, times, positions, bandwidth):
    arrays = {"start": np.asarray(start, float), "times": np.asarray(times), "positions": np.asarray(positions, float)}
    settings = SimpleNamespace(**arrays, bandwidth=bandwidth, quat_d=np.zeros(4))
    out = SimpleNamespace(p_d=np.zeros(3), p_d_dot=np.zeros(3), p_d_ddot=np.zeros(3), quat_d=np.zeros(4))
    FilteredSteps.step(settings, None, SimpleNamespace(t=t), None, out)
    return np.array([out.p_d, out.p_d_dot, out.p_d_ddot])


def test_it_solves_the_filters_differential_equation_through_all_waypoints():
    """The filter (p + w)^3 p_d = w^3 r(t) is integrated numerically from waypoint to waypoint."""
    times, positions, w, start = [0.5, 1.7], [[1.0, -2.0, 0.5], [0.2, 0.0, 3.0]], 2.5, [0.3, 0.1, -0.2]
    x = np.array([start, [0.0] * 3, [0.0] * 3]).ravel()
    t0 = 0.0
    for t1, command in zip([*times, 4.0], [start, *positions], strict=True):

        def rhs(_, x, command=command):
            p, v, a = x.reshape(3, 3)
            return np.concatenate([v, a, w**3 * (np.array(command) - p) - 3 * w**2 * v - 3 * w * a])

        x = solve_ivp(rhs, (t0, t1), x, rtol=1e-11, atol=1e-13).y[:, -1]
        t0 = t1
        assert np.allclose(evaluate(t1, start, times, positions, w), x.reshape(3, 3), atol=1e-9)


def test_it_rests_at_the_start_before_the_first_step_and_at_the_last_waypoint_long_after():
    args = ([1.0, 2.0, 3.0], [1.0, 2.0], [[0.0] * 3, [4.0, 5.0, 6.0]], 2.0)
    assert np.array_equal(evaluate(1.0, *args), [[1.0, 2.0, 3.0], [0.0] * 3, [0.0] * 3])
    assert np.array_equal(evaluate(500.0, *args), [[4.0, 5.0, 6.0], [0.0] * 3, [0.0] * 3])
