"""The scenarios that ship with guidance and sampled control do what their pages say."""

import numpy as np
import pytest

from uvms_mj import Scenario, simulate
from uvms_mj.analysis.metrics import final_force


def run(name):
    trace = simulate(Scenario.load(name), log_rate=100, engine="free_body")
    assert not trace.notes
    return trace


def test_follow_path_is_followed_within_a_tenth_of_a_millimetre():
    trace = run("follow_path")
    settled = trace.t > 2.0
    assert np.abs(trace.eta_e[settled]).max() < 1e-4
    assert np.allclose(trace.p_WB[-1], [0.0, 1.0, 0.0], atol=1e-5)


def test_wipe_wall_keeps_its_push_along_the_path():
    trace = run("wipe_wall")
    on_the_way = (trace.t > 22.0) & (trace.t < 28.0)
    assert np.linalg.norm(trace.p_d_dot[on_the_way], axis=1).max() > 0.05
    assert np.abs(trace.push[on_the_way] - 2.0).max() < 2e-3
    give = 1.0 / 150.0
    assert trace.analytic.force == pytest.approx(2.0 + 2.0 * give / (give + 1e-4), rel=1e-9)
    assert final_force(trace)[0] == pytest.approx(trace.analytic.force, rel=1e-6)


def test_push_soft_wall_100hz_rests_at_its_closed_form():
    force, settled = final_force(run("push_soft_wall_100hz"))
    assert settled
    assert force == pytest.approx(1.39535, abs=2e-5)
