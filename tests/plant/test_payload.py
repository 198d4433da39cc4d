"""Payloads: the true vehicle and MuJoCo's model have them, the laws do not."""

import numpy as np
import pytest

from armed import armed_xml
from uvms_mj import Scenario, Simulation
from uvms_mj.errors import InputError
from uvms_mj.plant.vehicle import Vehicle
from uvms_mj.setup.base import set_up

PAYLOADS = [
    {"link": "rov", "mass": 1.5, "position": [0.1, -0.05, 0.2], "displaced_mass": 0.4},
    {"link": "link3", "mass": 0.8, "position": [0.05, 0.02, 0.1], "displaced_mass": 0.2},
    {"link": "link3", "mass": 0.3, "position": [-0.1, 0.0, 0.0]},
]


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    path = tmp_path_factory.mktemp("armed") / "armed.xml"
    path.write_text(armed_xml(3))
    given = {"vehicle.model": str(path), "vehicle.payloads": PAYLOADS, "wall.present": False, "current.speed": 0.0}
    return Scenario.load("push_wall", given, "external")


@pytest.mark.parametrize("factor", [1.0, 1.7])
def test_mujoco_carries_the_payloads_of_the_true_vehicle(scenario, factor):
    setup = set_up(scenario.updated({"vehicle.mass": factor}))
    true, compiled = setup.vehicle, Vehicle.from_model(setup.plant.model)
    for ours, theirs in zip((true, *true.arm.links), (compiled, *compiled.arm.links), strict=True):
        np.testing.assert_allclose(theirs.M_RB, ours.M_RB, rtol=0, atol=1e-12)
    base, link = setup.nominal, setup.nominal.arm.links[2]
    assert true.mass == pytest.approx(factor * base.mass + 1.5, rel=1e-14)
    assert true.arm.links[2].mass == pytest.approx(factor * link.mass + 1.1, rel=1e-14)
    moment = factor * link.mass * link.r_g + 0.8 * np.array(PAYLOADS[1]["position"]) + [-0.03, 0.0, 0.0]
    np.testing.assert_allclose(true.arm.links[2].mass * true.arm.links[2].r_g, moment, rtol=0, atol=1e-15)


@pytest.mark.slow
def test_the_payload_acts_and_the_law_does_not_know_it(scenario):
    """At rest the true joint torques of weight and buoyancy are those of the file plus those of the payload."""
    with Simulation(scenario) as loaded, Simulation(scenario.updated({"vehicle.payloads": []})) as bare:
        np.testing.assert_array_equal(loaded.signals.g_hat, bare.signals.g_hat)
        np.testing.assert_array_equal(loaded.signals.M_hat, bare.signals.M_hat)
        for sim in (loaded, bare):
            sim.step()
        nets = [sim.setup.start.restoring(np.eye(3), sim.setup.gravity_W) for sim in (loaded, bare)]
        for sim, net in zip((loaded, bare), nets, strict=True):
            zeta_dot = np.r_[sim.signals.nu_dot, sim.data.qacc[6:]]
            np.testing.assert_allclose(sim.setup.start.inertia() @ zeta_dot, -net, rtol=0, atol=1e-9)
        assert nets[0][2] - nets[1][2] == pytest.approx(9.81 * (2.6 - 0.6), rel=1e-12)


def test_a_payload_on_an_unknown_link_is_named(scenario):
    wrong = [{"link": "link33", "mass": 1.0}]
    with pytest.raises(InputError, match=r"vehicle.payloads\[0\].link: 'link33' is not a link or the base; did you"):
        Simulation(scenario.updated({"vehicle.payloads": wrong}))
    with pytest.raises(InputError, match="mass"):
        scenario.updated({"vehicle.payloads": [{"link": "rov", "mass": -1.0}]})
