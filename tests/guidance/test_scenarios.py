"""The scenarios that ship with guidance and sampled control do what their pages say."""

from dataclasses import replace

import numpy as np
import pytest

from uvms_mj import Scenario, simulate
from uvms_mj.analysis.metrics import final_force
from uvms_mj.physics.effects import add_effects
from uvms_mj.physics.kernels import record_of
from uvms_mj.plant.effects import effect_records
from uvms_mj.plant.settings import Situation
from uvms_mj.setup.base import set_up


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


def test_the_fins_of_the_lauv_are_the_derivatives_of_its_source_to_first_order():
    """da Silva et al. (2007): Y_uvf = -19.2, Y_urf = -0.4 Y_uvf, N_uvf = -0.4 Y_uvf, N_urf = -0.4 Y_urf, Y_uudr = 19.2
    and N_uudr = -0.4 Y_uudr; of the elevators the same with the axes turned."""
    fins, u = Scenario.load("steer_lauv").fins, 1.5

    def wrench(nu=(0.0,) * 6, rudder_deg=0.0):
        given = tuple(replace(fin, deflection_deg=rudder_deg if i < 2 else 0.0) for i, fin in enumerate(fins))
        tau = np.zeros(6)
        add_effects(record_of(effect_records({"fins": given}, Situation())), np.array([u, *nu[1:]]), tau)
        return tau

    small = 1e-4
    of_v, of_r = (wrench(small * np.eye(6)[axis]) / (u * small) for axis in (1, 5))
    assert of_v[[1, 5]] == pytest.approx([-19.2, 7.68], rel=1e-3)
    assert of_r[[1, 5]] == pytest.approx([7.68, -3.072], rel=1e-3)
    of_w, of_q = (wrench(small * np.eye(6)[axis]) / (u * small) for axis in (2, 4))
    assert of_w[[2, 4]] == pytest.approx([-19.2, -7.68], rel=1e-3)
    assert of_q[[2, 4]] == pytest.approx([-7.68, -3.072], rel=1e-3)
    of_delta = wrench(rudder_deg=np.degrees(small)) / (u**2 * small)
    assert of_delta[[1, 5]] == pytest.approx([19.2, -7.68], rel=1e-3)


@pytest.mark.filterwarnings("ignore:.*:uvms_mj.setup.checks.SamplingWarning")
def test_steer_lauv_has_the_heading_of_its_circle_and_the_moments_that_its_law_demands():
    trace = simulate(Scenario.load("steer_lauv"), log_rate=20, engine="free_body")
    late = trace.t > 10.0
    assert np.degrees(2.0 * np.abs(trace.eta_e[late, 5])).max() < 5.0
    assert np.abs(trace.fin_deflections).max() < np.radians(15.0)
    setup, found = set_up(trace.scenario), []
    for k in np.flatnonzero(late)[::50]:
        moved, fixed = np.zeros(6), np.zeros(6)
        effects = setup.effects.copy()
        add_effects(record_of(effects), trace.nu[k], fixed)
        effects["fins_state"][0] = trace.fin_deflections[k]
        add_effects(record_of(effects), trace.nu[k], moved)
        found.append((moved - fixed)[5] / trace.tau_cmd[k, 5] * (1.5 / trace.nu[k, 0]) ** 2)
    assert np.allclose(found, 1.0, atol=0.01)  # the mix is for 1.5 m/s
