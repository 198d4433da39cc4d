"""The water between a pad and a wall: published added masses, energy, and both engines."""

import dataclasses
import inspect
import math
import re

import mujoco
import numpy as np
import pytest

from twin import TwinParameters
from uvms_mj import InputError, NearWall, Pad, Scenario, attach, simulate
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
    add_sea,
    find_pulls,
)
from uvms_mj.physics.kernels import record_of
from uvms_mj.physics.near_wall import (
    FAR,
    HULL,
    add_hull_inertia,
    add_hull_wrench,
    add_pad_inertia,
    add_pad_wrench,
    disc_mass,
    sphere_mass,
)
from uvms_mj.physics.near_wall import PAD as PAD_RECORD
from uvms_mj.plant.settings import Situation
from vehicles import load

PORTS = (add_flows, add_sea, add_pushes, add_inertias, add_inertia_wrenches, add_effects, find_pulls, add_pulls)
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
    assert called[add_flows] | called[add_sea] == set(FLOWS)  # the links of an arm take the waves alone
    assert "add_sea(" in inspect.getsource(add_flows)
    assert called[add_inertias] == set(INERTIAS)
    assert called[add_inertia_wrenches] == set(INERTIAS) - {"buoyancy"}  # whose change has the velocity in the water
    assert called[add_pushes] == set(PUSHES)
    assert called[add_effects] == set(WRENCHES)
    of_others = {"nodes", "pulls", "touches"}  # of the cable, of the couplings
    assert called[add_pulls] == called[find_pulls] == set(PULLS) - of_others


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


SPHERE = {  # h/a: along the normal and along the wall; design numbers of the project, exact by multipoles
    1.01: (0.774866, 0.614376),
    1.05: (0.717706, 0.595880),
    1.1: (0.675597, 0.579920),
    1.2: (0.624824, 0.558751),
    1.586: (0.549109, 0.524068),
    2.0: (0.523891, 0.511838),
    3.0: (0.506980, 0.503481),
}
HULL_AT = NearWall(radius=0.15, position=(0.05, 0.02, -0.03), point=(0.4, 0.0, 0.0), least_gap=1e-3)


def test_added_masses_of_a_sphere_are_those_of_its_multipoles():
    for h, (normal, along) in SPHERE.items():
        np.testing.assert_allclose(sphere_mass(h - 1.0)[:2], (normal - 0.5, along - 0.5), rtol=0, atol=1e-6)
    low, high = sphere_mass(19.999), sphere_mass(20.001)
    np.testing.assert_allclose(low, high, rtol=1e-3)


@pytest.mark.parametrize("x", [0.0015, 0.01, 0.3, 4.0, 18.0, 40.0])
def test_the_slopes_of_a_sphere_are_the_derivatives(x):
    h = 1e-5 * x
    before, after = sphere_mass(x - h), sphere_mass(x + h)
    np.testing.assert_allclose(sphere_mass(x)[2:], np.subtract(after[:2], before[:2]) / (2.0 * h), rtol=1e-6)


FACE = {"point": (1.0, 0.0, 0.0), "least_gap": 1e-4}
BODIES = {
    "pad": Pad(radius=0.1, position=(0.0, 0.0, 0.0), viscosity=0.0, **FACE),
    "sphere": NearWall(radius=0.2, **FACE),
    "cylinder": NearWall(shape="cylinder", radius=0.2, length=0.9, axis=(0.0, 0.0, 1.0), **FACE),
}
RADII = {"pad": 0.0, "sphere": 0.2, "cylinder": 0.2}


def water(name, gap, nu, **changed):
    """Inertia (6, 6) and wrench (6,) of the water about one body at a gap, with the velocity nu (6,)."""
    M, tau, V = np.zeros((6, 6)), np.zeros(6), np.array(nu, float)
    p, table = np.array([1.0 - RADII[name] - gap, 0.0, 0.0]), dataclasses.replace(BODIES[name], **changed)
    record = record_of(np.array(table.records(Situation()), PAD_RECORD if name == "pad" else HULL))
    if name == "pad":
        add_pad_inertia(record, p, np.eye(3), M)
        add_pad_wrench(record, p, np.eye(3), V, tau)
        return M, tau
    A = np.concatenate([-np.cross(V[3:], V[:3]), np.zeros(3)])  # as the base has it
    add_hull_inertia(record, np.eye(3), np.zeros(3), p, np.eye(3), M)
    add_hull_wrench(record, np.eye(3), np.zeros(3), p, np.eye(3), V, A, tau)
    return M, tau


def decimals(number):
    return len(number.partition(".")[2])


def test_a_pad_is_braked_by_the_forces_of_the_formula_and_the_table():
    """R = 0.1 m at 0.1 m/s: -M' v^2/2 and 3 pi mu R^4 v/(2 g^3); design numbers of the project."""
    published = {0.02: ("0.52", "0.006"), 0.01: ("2.07", "0.047"), 0.005: ("8.16", "0.38"), 0.002: ("50", "5.9")}
    for gap, (inertial, viscous) in published.items():
        force = -water("pad", gap, [0.1, 0, 0, 0, 0, 0])[1][0]
        assert force == pytest.approx(0.5 * 1000.0 * 0.01 * SLOPES[round(gap / 0.1, 6)] * 0.01, rel=1e-3)
        assert f"{force:.{decimals(inertial)}f}" == inertial
        film = -water("pad", gap, [0.1, 0, 0, 0, 0, 0], viscosity=1e-3)[1][0] - force
        assert film == pytest.approx(1.5 * math.pi * 1e-3 * 0.1**4 * 0.1 / gap**3, rel=1e-9)
        assert f"{film:.{decimals(viscous)}f}" == viscous


@pytest.mark.parametrize("name", ["sphere", "cylinder"])
@pytest.mark.parametrize("gap", [0.002, 0.02, 0.1, 0.5])
def test_the_force_at_constant_speed_is_that_of_the_kinetic_energy(name, gap):
    """-m_n' v^2/2 along the normal, which drives a body to the wall that moves along it, and away if it comes."""
    for axis in (0, 1):
        nu, h = 0.4 * np.eye(6)[axis], 1e-6 * gap
        force = water(name, gap, nu)[1][0]
        slope = (water(name, gap + h, nu)[0] - water(name, gap - h, nu)[0])[axis, axis] / (2.0 * h)
        sign = 1.0 if axis == 0 else -1.0  # the gap is 1 - x - a
        assert force == pytest.approx(sign * 0.5 * slope * 0.16, rel=1e-3)
        assert (force < 0.0) == (axis == 0)


@pytest.mark.parametrize("name", BODIES)
def test_the_water_is_finite_at_the_touch_and_behind_it_and_does_not_jump(name):
    nu = [0.2, 0.1, -0.1, 0.3, -0.2, 0.4]
    at, inside, touch, behind = (water(name, gap, nu) for gap in (1e-4, 0.9999e-4, 0.0, -0.05))
    for M, tau in (at, inside, touch, behind):
        assert np.isfinite(M).all()
        assert np.isfinite(tau).all()
        np.testing.assert_allclose(M, at[0], rtol=1e-9)
    np.testing.assert_allclose(behind[1], inside[1], rtol=1e-9)


def test_the_water_about_a_hull_keeps_the_energy_of_a_tumbling_body():
    """Without the term of the gradient a body that comes to the wall would gain what the water has to give."""

    def energies(h, seconds=1.0):
        vehicle, model, data = body(h)
        data.qvel[:] = [0.25, 0.15, -0.1, 0.3, -0.3, 0.15]
        r = np.array(HULL_AT.position)

        def energy():
            R = data.xmat[1].reshape(3, 3)
            nu = np.concatenate([R.T @ data.qvel[:3], data.qvel[3:]])
            v = R @ (nu[:3] + np.cross(nu[3:], r))
            g = 0.4 - (data.qpos[:3] + R @ r)[0] - HULL_AT.radius
            normal, along = sphere_mass(g / HULL_AT.radius)[:2]
            scale = 4.0 / 3.0 * math.pi * HULL_AT.density * HULL_AT.radius**3
            S = np.array([[0, 0.02, 0], [-0.02, 0, -0.01], [0, 0.01, 0]])  # S(r_g)
            M_RB = np.block([[vehicle.mass * np.eye(3), -vehicle.mass * S], [vehicle.mass * S, vehicle.inertia]])
            water = scale * (normal * v[0] ** 2 + along * (v[1] ** 2 + v[2] ** 2))
            return 0.5 * nu @ (M_RB + vehicle.M_A) @ nu + 0.5 * water, g

        with attach(model, data, near_wall=HULL_AT):
            mujoco.mj_forward(model, data)
            before, _ = energy()
            least = math.inf
            for _ in range(round(seconds / h)):
                mujoco.mj_step(model, data)
                least = min(least, energy()[1])
            mujoco.mj_forward(model, data)
            return before, energy()[0], least

    errors = []
    for h in (4e-3, 2e-3, 1e-3):
        before, after, least = energies(h, 0.64)
        assert 0.005 < least < 0.1
        errors.append(abs(after / before - 1.0))
    assert errors[2] < 1e-8
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2]


def test_engines_agree_on_a_landing_with_a_hull_and_the_rest_is_that_without_it():
    over = {"near_wall": [{"radius": 0.2, "position": [0.02, 0.0, 0.01]}], "simulation.duration": 4.0}
    first, second = (simulate(Scenario.load("push_wall", over), engine=each) for each in ("free_body", "mujoco"))
    np.testing.assert_allclose(first.p_WB, second.p_WB, atol=2e-7)
    without = simulate(Scenario.load("push_wall", {"simulation.duration": 4.0}), engine="free_body")
    assert first.analytic.force == without.analytic.force
    assert np.abs(first.p_WB - without.p_WB).max() > 1e-8  # which the law takes
