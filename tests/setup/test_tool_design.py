"""The design of a run at a tool: the start of its frame, and the factors of its estimates."""

import numpy as np
import pytest

from armed import armed_xml
from uvms_mj import Scenario, Simulation
from uvms_mj.physics.frames import quat_from_euler_deg, rotation_matrix
from uvms_mj.setup.base import set_up
from uvms_mj.setup.task_frame import euler_deg


@pytest.mark.parametrize("attitude", [(10.0, -30.0, 170.0), (0.0, 90.0, 40.0), (25.0, -90.0, -60.0), (180.0, 5.0, 0.0)])
def test_the_angles_of_a_rotation_give_it_again(attitude):
    R = rotation_matrix(quat_from_euler_deg(*attitude))
    again = rotation_matrix(quat_from_euler_deg(*euler_deg(R)))
    np.testing.assert_allclose(again, R, rtol=0, atol=2e-8)  # the square root of rounding, at a pitch of 90 deg


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    path = tmp_path_factory.mktemp("armed") / "armed.xml"
    path.write_text(armed_xml(4))
    given = {"vehicle.model": str(path), "wall.present": False, "initial.joints": [0.3, -0.8, 0.5, 0.4]}
    return Scenario.load("push_wall", {**given, "initial.velocity": [0.2, 0.1, -0.3, 0.4, 0.2, -0.1]}, "external")


def of_model(scenario, frame):
    """M, C zeta, D zeta and g of the law's model at the start, and the M_hat that the law is given."""
    with Simulation(scenario.updated({"task.frame": frame})) as sim:
        given = sim.signals.M_hat.copy()
        model = sim._memory.run["model"]
        return {name: model[name][0].copy() for name in "MCDg"}, given, sim.setup.design


@pytest.mark.parametrize("frame", ["body", "tool"])
def test_factors_of_the_estimates_multiply_the_terms_of_the_whole_tree(scenario, frame):
    factors = {"inertia": 1.3, "coriolis": 0.8, "damping": 0.5, "restoring": 0.9}
    plain, _, _ = of_model(scenario, frame)
    wrong, M_hat, design = of_model(scenario.updated({f"estimates.{key}": f for key, f in factors.items()}), frame)
    for name, factor in zip("MCDg", factors.values(), strict=True):
        np.testing.assert_allclose(wrong[name], factor * plain[name], rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(design.M_hat, M_hat, rtol=0, atol=1e-11)


@pytest.mark.parametrize("frame", ["body", "tool"])
def test_factors_of_a_link_take_the_place_of_those_of_the_vehicle(scenario, frame):
    """The part of one link is linear in its factor, and its other factors stay those of ``[estimates]``."""
    common = {"estimates.inertia": 1.2, "estimates.restoring": 0.7}
    link = [{"name": "link2", "inertia": 2.0}]
    base, _, _ = of_model(scenario.updated(common), frame)
    same, _, _ = of_model(scenario.updated(common | {"estimates.links": [{"name": "link2", "inertia": 1.2}]}), frame)
    other, M_hat, design = of_model(scenario.updated(common | {"estimates.links": link}), frame)
    three, _, _ = of_model(scenario.updated(common | {"estimates.links": [{"name": "link2", "inertia": 2.8}]}), frame)
    np.testing.assert_array_equal(same["M"], base["M"])
    np.testing.assert_allclose(three["M"] - base["M"], 2.0 * (other["M"] - base["M"]), rtol=0, atol=1e-12)
    assert np.abs(other["M"] - base["M"]).max() > 0.1
    for name in "CDg":
        np.testing.assert_allclose(other[name], base[name], rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(design.M_hat, M_hat, rtol=0, atol=1e-11)


def test_closed_forms_know_where_the_tool_starts(scenario):
    setup = set_up(scenario.updated({"task.frame": "tool"}))
    with Simulation(scenario.updated({"task.frame": "tool"})) as sim:
        np.testing.assert_allclose(setup.initial.position, sim.signals.p_WT, rtol=0, atol=1e-13)
        R = rotation_matrix(quat_from_euler_deg(*setup.initial.attitude_deg))
        np.testing.assert_allclose(R, rotation_matrix(sim.signals.quat_WT), rtol=0, atol=1e-12)
