"""Products of velocities in the plant: against SciPy, in both engines, exports and closed forms; energy. Of fleets:
test_fleet.py."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from twin import C_A, C_RB, M_RB, D, TwinParameters
from uvms_mj import Current, Scenario, Simulation, attach, simulate
from uvms_mj.control.base import SteadyState
from uvms_mj.engine.water_plugin import write_plugin
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.setup.base import set_up
from vehicles import force_of, load, place, random_parameters, state, text_of, vehicle_xml, workless

ROOT = Path(__file__).parents[2]
STILL = TwinParameters(v_c_W=(0.0, 0.0, 0.0))
SEVERAL = {"Xvr": 4.0, "Yuv": -28.6, "Yur": 5.2, "Yr|r|": 0.6, "Zuw": -28.6, "Kv|w|": 0.8, "M|u|q": -2.0, "Nuv": -24.0}


def random_products(rng: np.random.Generator) -> dict[str, float]:
    """Eight of two different velocities; those of one, with bars, would be a second time what D_quadratic has."""
    found = {}
    while len(found) < 8:  # one number of them is one code for all
        a, b = sorted(rng.choice(6, 2, replace=False).tolist())
        bars = "|" * int(rng.integers(0, 2))
        found[f"{'XYZKMN'[rng.integers(0, 6)]}{'uvwpqr'[a]}{bars}{'uvwpqr'[b]}{bars}"] = float(rng.normal())
    return found


@pytest.mark.filterwarnings("ignore:the damping of")
@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_their_wrench_is_that_of_their_names_at_the_velocity_in_the_water(seed):
    parameters, rng = random_parameters(seed), np.random.default_rng(seed)
    nu, wrenches, products = rng.normal(size=6), [], random_products(rng)
    for text in ("", text_of(products)):
        model, data = load(parameters, products=text)
        place(model, data, nu=nu)
        with attach(model, data, current=Current.of(parameters.v_c_W)) as attachment:
            mujoco.mj_forward(model, data)
            wrenches.append(attachment.wrench)
    nu_r = nu - np.r_[parameters.v_c_W, np.zeros(3)]
    assert np.allclose(wrenches[1] - wrenches[0], force_of(products, nu_r), rtol=1e-9, atol=1e-9)


A9 = {"Xuu": -8.0, "Yuv": -162.0, "Zuw": -108.0, "Kup": -13.0, "Muq": -20.0, "Nur": -32.0}
"""Damping u D nu, with a diagonal D, as files of torpedo shapes have it."""


@pytest.mark.filterwarnings("ignore:the damping of")
@pytest.mark.parametrize("products", [A9, SEVERAL], ids=["u D nu", "several"])
def test_attach_converges_to_scipys_solution(products):
    """A neutral vehicle with full inertias tumbles. MuJoCo's RK4 turns attitudes with the second order."""
    parameters = random_parameters(3)
    neutral = {"v_c_W": (0.0,) * 3, "r_b": parameters.r_g, "buoyancy": None}
    parameters = replace(parameters, **neutral, D_quadratic=np.diag(np.diag(parameters.D_quadratic)))
    M, nu_0 = M_RB(parameters) + np.asarray(parameters.M_A), np.array([1.0, 0.2, -0.1, 0.3, -0.2, 0.4])

    def rhs(t, nu):
        moving = C_RB(parameters, nu) + C_A(parameters, nu) + D(parameters, nu)
        return np.linalg.solve(M, force_of(products, nu) - moving @ nu)

    exact = solve_ivp(rhs, (0.0, 0.4), nu_0, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    without = solve_ivp(lambda t, nu: rhs(t, nu) - np.linalg.solve(M, force_of(products, nu)), (0.0, 0.4), nu_0).y[
        :, -1
    ]
    assert np.abs(exact - without).max() > 1e-2
    errors = []
    for n in (20, 40, 80):
        model, data = load(replace(parameters, timestep=0.4 / n), option='integrator="RK4"', products=text_of(products))
        place(model, data, nu=nu_0)
        with attach(model, data):
            mujoco.mj_step(model, data, n)
        errors.append(np.abs(state(model, data)[2] - exact).max())
    assert np.log2(np.array(errors[:-1]) / errors[1:]).min() > 1.9, errors
    assert errors[-1] < 1e-6


@pytest.mark.filterwarnings("error:the damping of")
@pytest.mark.parametrize("seed", range(3))
def test_products_that_do_no_work_keep_the_kinetic_energy_to_the_order_of_the_integrator(seed):
    parameters, rng = random_parameters(seed), np.random.default_rng(seed)
    still = {"D_linear": np.zeros((6, 6)), "D_quadratic": np.zeros((6, 6)), "r_b": parameters.r_g, "buoyancy": None}
    parameters, products, nu = replace(parameters, **still), text_of(workless(rng, 12)), rng.normal(size=6)
    M, changes = M_RB(parameters) + np.asarray(parameters.M_A), []
    for n in (200, 400):
        model, data = load(replace(parameters, timestep=1.0 / n), option='integrator="RK4"', products=products)
        place(model, data, nu=nu)
        with attach(model, data):
            mujoco.mj_step(model, data, n)
        after = state(model, data)[2]
        assert np.abs(after - nu).max() > 0.1
        changes.append(abs(after @ M @ after / (nu @ M @ nu) - 1.0))
    assert changes[0] < 1e-4  # of the second order, as in the test above
    assert changes[1] < changes[0] / 2.0**1.9


def file_of(folder: Path, products: str, parameters: TwinParameters | None = None) -> str:
    """A vehicle's file with products, by default that of BlueROV1."""
    path, entry = folder / "vehicle.xml", f'<text name="products" data="{products}"/></custom>'
    if parameters is None:
        path.write_text((ROOT / "models" / "bluerov1.xml").read_text().replace("</custom>", entry, 1))
    else:
        path.write_text(vehicle_xml(parameters, products=products))
    return str(path)


@pytest.mark.filterwarnings("ignore:the damping of")
@pytest.mark.parametrize("seed", range(3))
def test_a_step_of_free_body_is_mujocos(seed, tmp_path):
    rng = np.random.default_rng(seed)
    overrides = {
        "vehicle.model": file_of(tmp_path, text_of(random_products(rng)), random_parameters(seed)),
        "initial.velocity": rng.uniform(-1.0, 1.0, 6).tolist(),
        "current.speed": 0.7,
        "wall.position": 50.0,
        "wall.stiffness": 100.0,
        "simulation.timestep": 1e-3,
        "tether.length": 3.0,
    }
    scenario = Scenario.load("push_wall", overrides, "impedance")
    with Simulation(scenario) as theirs, Simulation(scenario, engine="free_body") as ours:
        for _ in range(20):
            ours.step()
            theirs.step()
            for name in ("nu_dot", "nu", "quat_WB", "tau_dist"):
                size = max(1.0, np.abs(theirs.signals[name]).max())
                assert np.abs(ours.signals[name] - theirs.signals[name]).max() < 1e-11 * size, name


@pytest.mark.filterwarnings("ignore:the damping of")
@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_a_vehicle_rests_where_the_static_balance_says(engine, tmp_path):
    """Under impedance control, in a current: products of the flow past the vehicle are in the closed form."""
    products = "Xuv -20 Yv|u| -15 Zuu 8 Nuv 4 Kvw 0.2 Mu|u| 3 Nv|w| -1 Zv|v| 2"
    own = {"vehicle.model": file_of(tmp_path, products), "simulation.duration": 25.0, "tether.length": 3.0}
    own |= {"reference.target": [1.01, 0.0, -0.5], "wall.damping": 500.0}
    trace = simulate(Scenario.load("push_wall", own, "impedance"), engine=engine)
    assert isinstance(trace.analytic, SteadyState)
    assert trace.push[-1] == pytest.approx(trace.analytic.force, rel=1e-6, abs=1e-9)
    assert np.allclose(trace.p_WB[-1], trace.analytic.position, rtol=0.0, atol=1e-6)
    assert np.abs(trace.tau_dist[-1]).max() > 0.1


def test_a_simple_formula_does_not_hold_with_them(tmp_path):
    setup = set_up(Scenario.load("push_wall", {"vehicle.model": file_of(tmp_path, "Xuv -2")}))
    assert "has products of velocities" in setup.no_simple_form


@pytest.mark.filterwarnings("ignore:the damping of")
def test_a_plugin_has_them(tmp_path, tmp_path_factory):
    """The accelerations of attach, whose code is made from the same kernels for the installed MuJoCo."""
    own = file_of(tmp_path, text_of(SEVERAL))
    library, path, *_ = write_plugin(own, tmp_path_factory.mktemp("plugin"))
    assert library.name == "libuvms_mj_water_0_8_products.so"
    mujoco.mj_loadPluginLibrary(str(library))
    model, mjcf, rng = mujoco.MjModel.from_xml_path(str(path)), Mjcf.find(own), np.random.default_rng(0)
    other = mjcf.compiled(mjcf.spec())
    data, attached = mujoco.MjData(model), mujoco.MjData(other)
    with attach(other, attached):
        for _ in range(20):
            data.qvel[:] = attached.qvel[:] = rng.normal(size=6)
            mujoco.mj_forward(model, data)
            mujoco.mj_forward(other, attached)
            np.testing.assert_allclose(data.qacc, attached.qacc, rtol=1e-12, atol=1e-12 * np.abs(data.qacc).max())


def test_from_a_frame_that_looks_right_and_down_the_sign_follows_the_letters():
    """A coefficient changes its sign with an odd number of the letters Y Z M N v w q r outside bars."""
    rng, turned = np.random.default_rng(1), np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
    for name, c in (random_products(rng) | SEVERAL).items():
        nu = rng.normal(size=6)
        letters = "".join(name.split("|")[::2])
        sign = (-1.0) ** sum(letter in "YZMNvwqr" for letter in letters)
        there = turned * force_of({name: c}, turned * nu)
        assert np.allclose(there, force_of({name: sign * c}, nu), atol=1e-15)
