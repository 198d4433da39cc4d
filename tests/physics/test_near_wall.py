"""The water between a pad and a wall: published added masses, energy, and both engines."""

import dataclasses
import inspect
import math
import re

import mujoco
import numpy as np
import pytest

from twin import TwinParameters
from uvms_mj import InputError, Pad, Scenario, attach, simulate
from uvms_mj.engine.simulation import Simulation
from uvms_mj.physics.effects import (
    FLOWS,
    INERTIAS,
    PULLS,
    PUSHES,
    WRENCHES,
    add_effects,
    add_flows,
    add_inertia_wrenches,
    add_inertias,
    add_pulls,
    add_pushes,
    find_pulls,
)
from uvms_mj.physics.near_wall import FAR, disc_mass
from vehicles import load

PORTS = (add_flows, add_pushes, add_inertias, add_inertia_wrenches, add_effects, find_pulls, add_pulls)
TABLE = {0.01: 42.45261, 0.02: 22.53328, 0.05: 10.42952, 0.1: 6.31752, 0.2: 4.24077, 0.5: 3.05495, 1.0: 2.75895}
SLOPES = {0.02: 1001.2, 0.05: 163.26, 0.1: 41.47, 0.2: 10.326}
PAD = Pad(radius=0.1, position=(0.3, 0.02, -0.05), point=(0.5, 0.0, 0.0), least_gap=1e-3, viscosity=0.0)
SHIFT = np.array(PAD.position)


def test_added_masses_of_a_disc_are_those_of_loves_equation():
    for x, mass in TABLE.items():
        assert disc_mass(x)[0] == pytest.approx(mass, rel=1e-6)
    for x, slope in SLOPES.items():
        assert -disc_mass(x)[1] == pytest.approx(slope, rel=5e-5)
    assert disc_mass(19.9)[0] == pytest.approx(FAR, rel=1e-4)
    assert disc_mass(1e-4)[0] == pytest.approx(math.pi / 8e-4, rel=2e-3)  # the film alone


@pytest.mark.parametrize("x", [1e-3, 0.006, 0.04, 0.3, 2.0, 15.0])
def test_the_slope_is_the_derivative(x):
    h = 1e-6 * x
    assert disc_mass(x)[1] == pytest.approx((disc_mass(x + h)[0] - disc_mass(x - h)[0]) / (2.0 * h), rel=1e-5)


def body(h: float, integrator: str = "RK4"):
    """A vehicle with full added mass, without damping, in still water that carries it."""
    vehicle = TwinParameters(r_g=(0.01, 0.0, -0.02), r_b=(0.01, 0.0, -0.02), timestep=h)
    for name in ("D_linear", "D_quadratic"):
        object.__setattr__(vehicle, name, np.zeros((6, 6)))
    return vehicle, *load(vehicle, option=f'integrator="{integrator}"')


def thrown(h: float, pad: Pad, seconds: float = 0.6, turning: float = 0.3) -> tuple[float, float, float]:
    """Its energy before and after it is thrown at the wall, and the gap at the end."""
    vehicle, model, data = body(h)
    data.qvel[:] = [0.25, 0.05, -0.04, turning, -turning, 0.5 * turning]

    def energy():
        R = data.xmat[1].reshape(3, 3)
        nu = np.concatenate([R.T @ data.qvel[:3], data.qvel[3:]])
        n_B = np.array(pad.normal) @ R
        g = np.array(pad.normal) @ (data.qpos[:3] + R @ SHIFT - pad.point)
        J = np.concatenate([n_B, np.cross(SHIFT, n_B)])
        film = pad.density * pad.radius**3 * (disc_mass(max(g, pad.least_gap) / pad.radius)[0] - FAR)
        S = np.array([[0, 0.02, 0], [-0.02, 0, -0.01], [0, 0.01, 0]])  # S(r_g)
        M_RB = np.block([[vehicle.mass * np.eye(3), -vehicle.mass * S], [vehicle.mass * S, vehicle.inertia]])
        return 0.5 * nu @ (M_RB + vehicle.M_A) @ nu + 0.5 * film * (J @ nu) ** 2, g

    with attach(model, data, pads=pad):
        mujoco.mj_forward(model, data)
        before, _ = energy()
        for _ in range(round(seconds / h)):
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        after, g = energy()
    return before, after, g


def test_the_film_keeps_the_energy_of_a_tumbling_body():
    """It is thrown at the wall, and the water before the pad takes its speed without taking its energy."""
    errors = []
    for h in (4e-3, 2e-3, 1e-3):
        before, after, g = thrown(h, PAD)
        assert 0.02 < g < 0.1  # from 0.2 m
        errors.append(abs(after / before - 1.0))
    assert errors[2] < 2e-9
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2]  # at least of second order: RK4 turns by a mean velocity


def test_a_viscous_film_takes_energy_out():
    before, after, _ = thrown(1e-3, dataclasses.replace(PAD, viscosity=5.0))
    assert after < 0.9 * before


def test_engines_agree_on_a_landing_and_the_rest_is_that_without_a_pad():
    over = {"pads": [{"radius": 0.1, "position": [0.05, 0.0, 0.0]}], "simulation.duration": 4.0}
    first, second = (simulate(Scenario.load("push_wall", over), engine=each) for each in ("free_body", "mujoco"))
    np.testing.assert_allclose(first.p_WB, second.p_WB, atol=2e-7)
    without = simulate(Scenario.load("push_wall", {"simulation.duration": 4.0}), engine="free_body")
    assert first.analytic.force == without.analytic.force
    assert np.abs(first.p_WB - without.p_WB).max() > 1e-9


def test_each_effect_is_called_at_the_port_that_its_list_says():
    """An effect that moves the water, or has inertia, and is in no list would be left out in silence."""
    called = {port: set(re.findall(r"effects\.(\w+)\.shape", inspect.getsource(port))) for port in PORTS}
    assert called[add_flows] == set(FLOWS)
    assert called[add_inertias] == called[add_inertia_wrenches] == set(INERTIAS)
    assert called[add_pushes] == set(PUSHES)
    assert called[add_effects] == set(WRENCHES)
    assert called[add_pulls] == called[find_pulls] == set(PULLS) - {"nodes"}  # which belong to the cable


def test_a_pad_without_a_wall_is_refused_and_a_reset_adds_none():
    pad = [{"radius": 0.1, "position": [0.05, 0.0, 0.0]}]
    with pytest.raises(InputError, match=r"pads\[0\].point: there is no \[wall\]"):
        simulate(Scenario.load("push_wall", {"pads": pad, "wall.present": False}))
    _, model, data = body(1e-3)
    with pytest.raises(InputError, match=r"attach: pads.point: there is no \[wall\]"):
        attach(model, data, pads=Pad(radius=0.1, position=(0.0, 0.0, 0.0)))
    with pytest.raises(InputError, match=r"pads\[1\].*normal must not be zero"):
        Scenario.load("push_wall", {"pads": [*pad, pad[0] | {"normal": [0.0, 0.0, 0.0]}]})
    with Simulation(Scenario.load("push_wall"), engine="free_body") as sim, pytest.raises(InputError, match="pads"):
        sim.reset({"pads": pad})
