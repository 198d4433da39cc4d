"""The engine free_body computes what the engine mujoco computes, and obeys the same laws by itself."""

import dataclasses
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from compare_engines import differences, drawn
from uvms_mj import Diverged, InputError, Scenario, Simulation, simulate
from uvms_mj.engine.engines import refusals
from uvms_mj.physics.contacts import pair_force
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.physics.free_body import free_acceleration, symplectic_step
from uvms_mj.setup.base import set_up
from vehicles import random_parameters, vehicle_xml

FREE = {"engine": "free_body"}


def close(scenario: Scenario) -> dict:
    """The differences between both engines, of a law that does not chatter, within the stated bounds."""
    found = differences(scenario)
    assert found["status"] == "completed/completed"
    if not found["chatters"]:
        assert found["position_m"] < 1e-6
        assert found["peak"] < 1e-4 if "peak" in found else True
        assert found["rest"] < max(1e-9, found["unrest"]) if "rest" in found else True
    return found


@pytest.mark.parametrize("damping", [0.0, 300.0])
def test_the_wall_is_as_soft_as_mujocos(damping, tmp_path):
    """Peak and path of an impact are equal to rounding: a random vehicle whose centre of gravity is not the origin."""
    (tmp_path / "vehicle.xml").write_text(vehicle_xml(random_parameters(3)))
    overrides = {
        "vehicle.model": str(tmp_path / "vehicle.xml"),
        "vehicle.mass": 1.2,
        "initial.velocity": [0.3, 0.1, 0.0, 0.0, 0.1, 0.2],
        "wall.position": 1e-3,
        "wall.stiffness": 2e4,
        "wall.damping": damping,
        "simulation.duration": 0.5,
    }
    found = differences(Scenario.load("push_wall", overrides, "impedance"))
    assert found["status"] == "completed/completed"
    assert found["position_m"] < 1e-12
    assert found["peak"] < 1e-11


@pytest.mark.parametrize("i", range(4))
def test_a_random_scenario_is_that_of_mujoco(i):
    close(drawn(np.random.default_rng([5, i]), 1.5))


@pytest.mark.slow
def test_random_scenarios_are_those_of_mujoco():
    found = [close(drawn(np.random.default_rng([6, i]), 6.0)) for i in range(5)]
    assert sum("peak" in each for each in found) >= 3


@pytest.mark.slow
@pytest.mark.parametrize(("law", "own"), [("impedance", {}), ("fosm", {"controller.epsilon": 5e-2})])
def test_the_force_at_rest_is_that_of_mujoco(law, own):
    """Its mean over the last 0.5 s. The tolerance of MuJoCo's solver leaves a variation of the force of up to 1e-7."""
    overrides = {"wall.damping": 200.0, "reference.target": [1.1, 0.0, 0.0], "simulation.duration": 18.0}
    assert close(Scenario.load("push_wall", overrides | own, law))["rest"] < 1e-9


@pytest.mark.parametrize("seed", range(6))
def test_a_step_is_mujocos(seed, tmp_path):
    """Of a random vehicle with full matrices, tumbling in a current, under its thrust, far from the wall."""
    rng = np.random.default_rng(seed)
    (tmp_path / "vehicle.xml").write_text(vehicle_xml(random_parameters(seed)))
    overrides = {
        "vehicle.model": str(tmp_path / "vehicle.xml"),
        "initial.attitude_deg": rng.uniform(-90.0, 90.0, 3).tolist(),
        "initial.velocity": rng.uniform(-1.0, 1.0, 6).tolist(),
        "current.speed": 0.7,
        "disturbance.bias": rng.uniform(-5.0, 5.0, 6).tolist(),
        "wall.position": 50.0,
        "wall.stiffness": 100.0,
        "simulation.timestep": 1e-3,
    }
    scenario = Scenario.load("push_wall", overrides, "impedance")
    with Simulation(scenario) as theirs, Simulation(scenario, **FREE) as ours:
        for _ in range(20):
            ours.step()
            theirs.step()
            for name in ("nu_dot", "nu", "quat_WB", "p_WB", "tau"):
                size = max(1.0, np.abs(theirs.signals[name]).max())
                assert np.abs(ours.signals[name] - theirs.signals[name]).max() < 1e-11 * size, name


def test_the_attitude_turns_as_mujocos(rng):
    for scale in (0.0, 1e-12, 1e-3, 1.0, 300.0):
        quat, omega = rng.normal(size=4), scale * rng.normal(size=3)
        quat /= np.linalg.norm(quat)
        qpos, qvel, theirs = np.array([0.0, 0.0, 0.0, *quat]), np.array([0.0, 0.0, 0.0, *omega]), quat.copy()
        symplectic_step(qpos, qvel, np.zeros(6), 1e-2)
        mujoco.mju_quatIntegrate(theirs, omega, 1e-2)
        np.testing.assert_allclose(qpos[3:], theirs, rtol=0, atol=1e-15)


def test_the_depth_of_the_probe_in_the_wall_is_mujocos():
    scenario = Scenario.load("push_wall", {"initial.position": [1.002, 0.3, -0.2], "wall.position": 1.0})
    setup = set_up(scenario)
    model, data = setup.plant.model, setup.plant.initial_data(scenario.initial)
    mujoco.mj_kinematics(model, data)
    wall, probe = model.pair_geom1[0], model.pair_geom2[0]
    theirs = mujoco.mj_geomDistance(model, data, wall, probe, 1.0, None)
    surfaces, pairs = (each.view(np.recarray) for each in setup.contacts.records(lambda _: 1.0))
    pair_force(pairs[0], surfaces[0], np.array([1.002, 0.3, -0.2]), np.eye(3), np.zeros(6), 1e-4)
    assert pairs[0].depth == pytest.approx(-theirs, abs=1e-15)
    assert pairs[0].contact.normal_W.tolist() == [-1.0, 0.0, 0.0]


def tumble(timestep: float) -> tuple[float, float]:
    """Relative gain of energy, and error of the angular momentum's size, of a rigid body that tumbles for 1 s with
    added mass, without a force."""
    rng = np.random.default_rng(3)
    M_RB = np.diag([7.0, 7.0, 7.0, 0.1, 0.2, 0.3])
    body = SimpleNamespace(M_RB=M_RB, M_inv=np.linalg.inv(M_RB), mass=7.0, r_g=np.zeros(3), gravity_W=np.zeros(3))
    qpos, qvel = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), rng.normal(size=6)
    energy, momentum = qvel @ M_RB @ qvel, np.linalg.norm(M_RB[3:, 3:] @ qvel[3:])
    qacc = np.zeros(6)
    for _ in range(round(1.0 / timestep)):
        R_WB = rotation_matrix(qpos[3:])
        nu = np.concatenate([R_WB.T @ qvel[:3], qvel[3:]])
        free_acceleration(body, R_WB, nu, np.zeros(6), qacc)
        symplectic_step(qpos, qvel, qacc, timestep)
    return (
        abs(qvel @ M_RB @ qvel / energy - 1.0),
        abs(np.linalg.norm(M_RB[3:, 3:] @ qvel[3:]) / momentum - 1.0),
    )


def test_a_tumble_keeps_energy_and_momentum_up_to_the_integration_error():
    coarse, fine = np.array(tumble(2e-3)), np.array(tumble(1e-3))
    assert (fine < 5e-3).all()
    assert (np.abs(coarse / fine - 2.0) < 0.1).all()  # first order


def test_a_run_that_leaves_its_bounds_says_so():
    overrides = {"controller.K_s": 1e6, "simulation.duration": 0.5, "estimates.inertia": 50.0}
    scenario = Scenario.load("push_wall", overrides, "fosm")
    ours, theirs = simulate(scenario, **FREE), simulate(scenario)
    assert ours.status == theirs.status
    assert ours.status.name == "unstable"
    assert ours.message.split(" = ")[0] == theirs.message.split(" = ")[0]
    with Simulation(scenario, **FREE) as sim, pytest.raises(Diverged):
        sim.step(5000)


def test_it_has_no_mujoco_model_and_an_unknown_engine_is_refused():
    with Simulation(Scenario(), **FREE) as sim:
        assert sim.engine == "free_body"
        for name in ("model", "data"):
            with pytest.raises(InputError, match=r"the engine free_body has no .*engine='mujoco'"):
                getattr(sim, name)
    with pytest.raises(InputError, match="engine 'free': is not an engine; did you mean 'free_body'"):
        simulate(Scenario(), engine="free")


def test_a_key_that_it_does_not_know_is_refused_by_name():
    setup = set_up(Scenario())
    assert refusals(setup) == []
    with pytest.raises(InputError, match=r"simulation.integrator = 'implicitfast' is not computed by"):
        simulate(Scenario.load("push_wall", {"simulation.integrator": "implicitfast"}), **FREE)

    @dataclasses.dataclass(frozen=True)
    class Rope:
        stiffness: float = 0.0

    @dataclasses.dataclass(frozen=True)
    class Later(Scenario):
        rope: Rope = Rope(5.0)

    scenario = object.__new__(Later)
    scenario.__dict__.update(Scenario().__dict__ | {"rope": Rope(5.0)})
    assert refusals(dataclasses.replace(setup, scenario=scenario)) == [
        "rope.stiffness is not computed by the engine free_body; use the engine mujoco"
    ]
