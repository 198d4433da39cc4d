"""The true vehicle: equal to a file with its numbers, unknown to the laws, and known to the theory."""

import dataclasses

import numpy as np
import pytest

from uvms_mj import InputError, Scenario, Simulation, simulate
from uvms_mj.control.theory.loop import Loop
from uvms_mj.plant.build import perturbed
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.plant.settings import VehicleChoice
from uvms_mj.setup.base import set_up
from vehicles import random_parameters, vehicle_xml

OFFSETS = [[0.02, 0.01, -0.01], [0.0, 0.02, 0.01], [-0.02, 0.0, 0.02], *[[0.0, 0.0, 0.0]] * 3]
"""Of a vehicle with three thrusters and three pure moments."""
SHIFTED = [[0.02, 0, 0], [0, 0.02, 0], [0, 0, 0.02], [-0.02, 0, 0], [0, -0.02, 0], [0.02, 0, 0]]
"""Of the six thrusters of a BlueROV1, by 2 cm each."""
ANOTHER = {
    "vehicle.mass": 1.2,
    "vehicle.added_mass": 0.7,
    "vehicle.linear_damping": 1.5,
    "vehicle.quadratic_damping": 1.5,
    "vehicle.displaced_mass": 1.02,
    "vehicle.thruster_offset": SHIFTED,
}
MOVING = {
    "simulation.duration": 0.5,
    "initial.velocity": [0.3, -0.1, 0.05, 0.1, 0.2, -0.1],
    "initial.attitude_deg": [5.0, -10.0, 20.0],
    "wall.position": 0.05,
    "wall.stiffness": 1e4,
    "wall.damping": 50.0,
    "wall.friction": 0.3,
}
ENGINES = ("mujoco", "free_body")
PARAMETERS = random_parameters(5)
NOMINAL = Mjcf("rov.xml", {"rov.xml": vehicle_xml(PARAMETERS).encode()})


def written(offsets=None, mass=1.0, added_mass=1.0, linear=1.0, quadratic=1.0, displaced=1.0) -> Mjcf:
    """The file of a vehicle with these factors, its thrusters moved by the moments of their forces."""
    true = dataclasses.replace(
        PARAMETERS,
        mass=mass * PARAMETERS.mass,
        inertia=mass * PARAMETERS.inertia,
        M_A=added_mass * PARAMETERS.M_A,
        D_linear=linear * PARAMETERS.D_linear,
        D_quadratic=quadratic * PARAMETERS.D_quadratic,
        buoyancy=displaced * PARAMETERS.buoyancy,
    )
    text = vehicle_xml(true)
    for axis, offset in zip(np.eye(3), offsets or (), strict=False):
        before = " ".join(repr(x) for x in (*axis.tolist(), 0.0, 0.0, 0.0))
        assert text.count(f'gear="{before}"') == 1
        moved = " ".join(repr(float(x)) for x in (*axis, *np.cross(offset, axis)))
        text = text.replace(f'gear="{before}"', f'gear="{moved}"')
    return Mjcf("true.xml", {"true.xml": text.encode()})


def driven(mjcf: Mjcf, overrides: dict, engine: str) -> tuple[np.ndarray, ...]:
    """Pose, velocity, contact force and delivered wrench under constant thrusts, after an impact with friction."""
    world = MOVING | {"controller.name": "external", "actuation.name": "external"} | overrides
    with Simulation(Scenario.load("push_wall", world), mjcf=mjcf, engine=engine) as sim:
        sim.u[:] = [40.0, 3.0, -2.0, 0.5, -0.5, 0.3]
        sim.step(2000)
        found = [sim.signals[name].copy() for name in ("p_WB", "quat_WB", "nu", "f_contact_W", "tau")]
        assert sim.signals.force_peak > 10.0
        return tuple(found)


@pytest.mark.parametrize("engine", ENGINES)
def test_it_moves_as_a_vehicle_whose_file_has_its_numbers(engine):
    factors = {"mass": 1.2, "added_mass": 0.7, "linear": 1.5, "quadratic": 0.6, "displaced": 1.02}
    keys = ("mass", "added_mass", "linear_damping", "quadratic_damping", "displaced_mass")
    overrides = {f"vehicle.{key}": value for key, value in zip(keys, factors.values(), strict=True)}
    true = driven(NOMINAL, overrides | {"vehicle.thruster_offset": OFFSETS}, engine)
    for ours, theirs in zip(true, driven(written(OFFSETS, **factors), {}, engine), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)
    for ours, theirs in zip(true, driven(NOMINAL, {}, engine), strict=True):
        assert np.abs(ours - theirs).max() > 1e-3


@pytest.mark.parametrize("key", ["mass", "added_mass", "linear_damping", "quadratic_damping", "displaced_mass"])
def test_each_factor_changes_the_motion_and_the_engines_agree(key):
    ours, theirs = (driven(NOMINAL, {f"vehicle.{key}": 1.3}, engine) for engine in ENGINES)
    as_filed = driven(NOMINAL, {}, "free_body")
    np.testing.assert_allclose(ours[0], theirs[0], atol=1e-5)
    assert np.abs(ours[0] - as_filed[0]).max() > 1e-4


def test_factors_of_one_are_the_vehicle_of_the_file_bit_for_bit():
    zero = VehicleChoice(thruster_offset=[[0.0] * 3] * 6)
    nominal = NOMINAL.vehicle
    assert perturbed(nominal, VehicleChoice("another name")) is nominal
    for name, value in vars(perturbed(nominal, zero)).items():
        assert name == "arm" or np.array_equal(value, getattr(nominal, name))
    plain, zeros = (
        set_up(Scenario.load("push_wall", over)) for over in ({}, {"vehicle.thruster_offset": [[0] * 3] * 6})
    )
    assert plain.vehicle is plain.nominal
    for name in ("body_mass", "body_inertia", "body_invweight0", "actuator_gear", "pair_solref"):
        assert np.array_equal(getattr(plain.plant.model, name), getattr(zeros.plant.model, name))
    both = [simulate(setup.scenario.updated({"simulation.duration": 0.1})) for setup in (plain, zeros)]
    assert all(np.array_equal(both[0][name], both[1][name]) for name in both[0].arrays)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_laws_are_given_the_vehicle_of_the_file(engine):
    """At one state every signal before the law's own is the same for any true vehicle."""
    given = ("M_hat", "C_hat_nu", "D_hat_nu", "g_hat", "M_d", "D_d", "K_d", "tau_nom", "s", "tau_cmd", "u_cmd")
    found = []
    for overrides in ({}, ANOTHER):
        world = {key: value for key, value in MOVING.items() if key.startswith("initial")} | {"wall.position": 2.0}
        with Simulation(Scenario.load("push_wall", world | overrides), engine=engine) as sim:
            found.append({name: np.copy(sim.signals[name]) for name in given if name in sim.signals})
            sim.step(1)
            found[-1]["u"] = sim.u.copy()
    assert len(found[0]) > 8
    assert all(np.array_equal(found[0][name], found[1][name]) for name in found[0])


CLOSED = MOVING | {
    "wall.friction": 0.0,
    "impedance.M_d": [20.0, 20.0, 20.0, 2.0, 2.0, 2.0],
    "reference.step_time": 0.0,
    "reference.target": [0.06, 0.02, -0.03],
}


def test_all_theory_is_that_of_a_file_with_the_true_numbers_and_scaled_estimates():
    """One run in two ways: another true vehicle, or its file with estimates of the vehicle that the laws believe in."""
    mass, damping = 1.25, 1.6
    factors = {"mass": mass, "added_mass": mass, "linear_damping": damping, "quadratic_damping": damping}
    here = CLOSED | {f"vehicle.{key}": value for key, value in (factors | {"displaced_mass": mass}).items()}
    there = CLOSED | {"estimates.inertia": 1 / mass, "estimates.coriolis": 1 / mass}
    there |= {"estimates.restoring": 1 / mass, "estimates.damping": 1 / damping}
    file = written(mass=mass, added_mass=mass, linear=damping, quadratic=damping, displaced=mass)
    for law in ("impedance", "fosm", "gsta", "ideal"):
        ours = set_up(Scenario.load("push_wall", here, law), NOMINAL)
        theirs = set_up(Scenario.load("push_wall", there, law), file)
        for name in ("M", "M_hat", "M_d", "D_d"):
            np.testing.assert_allclose(getattr(ours.design, name), getattr(theirs.design, name), rtol=1e-9)
        np.testing.assert_allclose(ours.mass_along_normal(), theirs.mass_along_normal(), rtol=1e-9)
        np.testing.assert_allclose(ours.mass_along_face(), theirs.mass_along_face(), rtol=1e-9)
        assert list(ours.scenario.controller.notes(ours)) == list(theirs.scenario.controller.notes(theirs))
        rest, same = (setup.scenario.controller.at_rest(setup) for setup in (ours, theirs))
        assert type(rest) is type(same)
        if not isinstance(rest, str):
            for name in ("force", "position", "quat", "s", "tau"):
                np.testing.assert_allclose(getattr(rest, name), getattr(same, name), rtol=1e-7, atol=1e-9)
        loops = [Loop(setup, setup.contacts_at_rest[0], amplitudes=(1e-4, 1e-2)) for setup in (ours, theirs)]
        np.testing.assert_allclose(loops[0].growths, loops[1].growths, rtol=1e-5)
    runs = [
        simulate(Scenario.load("push_wall", world, "impedance"), mjcf=mjcf)
        for world, mjcf in ((here, NOMINAL), (there, file))
    ]
    for name in ("p_WB", "nu", "tau", "f_contact_W"):
        np.testing.assert_allclose(runs[0][name], runs[1][name], rtol=1e-6, atol=1e-8)


RESTING = {
    "gsta": ("gsta", {}),
    "gsta alone": ("gsta", {"controller.nominal": False}),
    "super-twisting": ("sta", {}),
    "first-order": ("fosm", {"simulation.timestep": 5e-5, "controller.epsilon": 2e-3}),
    "impedance against the current": ("impedance", {"current.speed": 0.05}),
    "impedance in still water": ("impedance", {"current.speed": 0.0}),
    "ideal": ("ideal", {"vehicle.thruster_offset": [[0, 0, 0]] * 6}),
}


@pytest.mark.slow
@pytest.mark.parametrize(("engine", "case"), [("mujoco", "gsta"), *(("free_body", case) for case in RESTING)])
def test_the_closed_form_holds_for_another_true_vehicle(engine, case):
    law, overrides = RESTING[case]
    trace = simulate(Scenario.load("push_wall", ANOTHER | overrides, law), engine=engine, keep_s=0.5, log_rate="full")
    rest = trace.analytic
    assert rest.force > 1.0
    assert trace.push.mean() == pytest.approx(rest.force, rel=1e-4)
    np.testing.assert_allclose(trace.p_WB[-1], rest.position, atol=2e-6)
    np.testing.assert_allclose(trace.s.mean(axis=0), rest.s, atol=1e-6)
    np.testing.assert_allclose(trace.tau.mean(axis=0), rest.tau, atol=1e-3)


def test_the_ideal_law_has_no_closed_form_with_moved_thrusters():
    setup = set_up(Scenario.load("push_wall", ANOTHER, "ideal"))
    assert "does not know the offsets" in setup.scenario.controller.at_rest(setup)


def test_a_pure_moment_has_no_offset():
    moved = Scenario.load("push_wall", {"vehicle.thruster_offset": [[0.0] * 3] * 5 + [[0.1, 0.0, 0.0]]})
    with pytest.raises(InputError, match=r"thruster_offset\[5\]: m5 is a pure moment"):
        set_up(moved, NOMINAL)
