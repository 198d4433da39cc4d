"""A formula along x is given for the scenarios in which it holds: the example Pd, over draws of keys."""

from pathlib import Path

import numpy as np
import pytest

from uvms_mj import Scenario, simulate
from uvms_mj.analysis.metrics import final_force
from uvms_mj.control.base import NoClosedForm
from uvms_mj.control.theory.predictions import steady_state
from uvms_mj.files import shipped
from uvms_mj.setup.base import set_up
from uvms_mj.setup.world import vehicles_of

EXAMPLES = Path(__file__).parents[2] / "examples"
PD = f"{EXAMPLES / 'pd.py'}:Pd"
STILL = {"current.speed": 0.0, "simulation.duration": 40.0, "simulation.timestep": 2e-4}
TURNED = [{"time": 5.0, "position": [1.01, 0.0, 0.0], "attitude_deg": [0.0, 0.0, 20.0]}]
SPLINE = [{"time": 6.0, "position": [1.02, 0.1, 0.0], "attitude_deg": [0.0, 0.0, 0.0]}]
BODY = {"radius": 0.1, "position": [0.3, 0.1, 0.0]}

FREE = [
    {"vehicle.added_mass": 1.3},
    {"vehicle.linear_damping": 1.5},
    {"vehicle.quadratic_damping": 0.7},
    {"vehicle.model": "bluerov2_heavy"},
    {"initial.position": [0.3, 0.1, -0.2], "initial.attitude_deg": [4.0, -3.0, 10.0]},
    {"wall.stiffness": 2e4},
    {"wall.position": 0.995},
    {"wall.damping": 100.0},
    {"disturbance.bias": [0.7, -0.4, 0.3, 0.0, 0.0, 0.0]},
    {"estimates.inertia": 0.8, "estimates.damping": 2.0, "estimates.coriolis": 0.0},
    {"reference.target": [1.03, 0.1, -0.1]},
    {"reference.target": [0.9, 0.0, 0.0]},
    {"reference.attitude_deg": [12.0, 0.0, 0.0]},
    {"reference.name": "spline", "reference.poses": SPLINE},
    {"controller.k_p": 260.0},
    {"navigation.period": 1e-3, "actuation.period": 1e-3},
    {"impedance.K_d": [300.0] * 6, "task.F_1": [2.0] * 6},
]
OTHER = [
    {"bumper.stiffness": 2e3, "bumper.damping": 100.0},
    {"thrusters.name": "general", "thrusters.efficiency": 0.7},
    {"thrusters.name": "t200", "vehicle.model": "bluerov2_heavy"},
    {"vehicle.contact_bodies": [BODY]},
    {"wall.present": False},
    {"walls": [{"shape": "plane", "position": [1.2, 0.0, 0.0], "stiffness": 1e4}]},
    {"vehicle.model": "lauv"},
    {"vehicle.mass": 1.1},
    {"vehicle.displaced_mass": 0.97},
    {"vehicle.payloads": [{"link": "bluerov1", "mass": 0.4, "position": [0.1, 0.0, 0.0]}]},
    {"vehicle.thruster_offset": [[0.05, 0.0, 0.02]] * 6},
    {"estimates.restoring": 0.9},
    {"wall.friction": 0.3},
    {"navigation.name": "sensors", "navigation.position_bias": [0.003, 0.0, 0.0]},
    {"navigation.name": "sensors", "navigation.attitude_bias": [0.0, 0.0, 0.1]},
    {"actuation.name": f"{EXAMPLES / 'lagging_thrusters.py'}:LaggingThrusters"},
    {"tether.length": 20.0},
    {"current.speed": 0.2},
    {"current.speed": 0.2, "current.amplitude": [0.1, 0.0, 0.0], "current.frequency_hz": [0.2, 0.0, 0.0]},
    {"disturbance.bias": [0.3, 0.0, 0.0, 0.0, 0.4, 0.0]},
    {"disturbance.table": [[0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [60.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]},
    {"reference.attitude_deg": [0.0, 0.0, 9.0]},
    {"reference.name": "spline", "reference.poses": TURNED},
    {"reference.name": "circle", "reference.radius": 0.05},
    {"vehicle.model": "bluerov2_heavy", "controller.k_p": 1e4, "reference.target": [1.05, 0.0, 0.0]},
]


def check(scenario: Scenario) -> bool:
    """Whether the law has a closed form, whose force must be that of the run."""
    rest = steady_state(set_up(scenario))
    if isinstance(rest, NoClosedForm):
        return False
    force, settled = final_force(simulate(scenario, engine="free_body", keep_s=0.5))
    assert settled
    assert force == pytest.approx(rest.force, rel=1e-6, abs=1e-9)
    return True


def known(changes: dict) -> bool:
    """The same for Pd in still water, with changes."""
    step = {} if "reference.name" in changes else {"reference.step_time": 0.5}
    return check(Scenario.load("push_wall", STILL | step | changes, PD))


@pytest.mark.parametrize("changes", FREE, ids=str)
def test_a_key_that_the_force_does_not_depend_on_or_that_is_in_the_formula_is_free(changes):
    assert known(changes)


@pytest.mark.parametrize("changes", OTHER, ids=str)
def test_a_key_that_the_formula_does_not_know_has_no_closed_form(changes):
    assert not known(changes)


@pytest.mark.parametrize("seed", range(12))
def test_draws_of_keys_have_the_force_of_the_run_or_a_reason(seed):
    rng = np.random.default_rng(seed)
    drawn = [FREE[i] for i in rng.choice(len(FREE), 3, replace=False)]
    names = [each["reference.name"] for each in drawn if "reference.name" in each]
    changes = {k: v for each in drawn for k, v in each.items() if not (names and k == "reference.target")}
    assert known(changes)
    if names:
        changes = {k: v for k, v in changes.items() if not k.startswith("reference.")}
    for other in (OTHER[i] for i in rng.choice(len(OTHER), 2, replace=False)):
        more = {k: v for k, v in changes.items() if not ("reference.name" in other and k.startswith("reference."))}
        assert not known(more | other)


@pytest.mark.parametrize("name", sorted(name for name in shipped("scenarios") if not vehicles_of(name)))
def test_no_key_of_a_shipped_scenario_passes_by(name):
    """Every shipped scenario has a reason or the force of its own run."""
    every_step = {"controller.period": None, "controller.delay": None}  # the loop's own stay when the law changes
    check(Scenario.load(name).updated({"current.speed": 0.0, "simulation.duration": 30.0} | every_step, PD))
