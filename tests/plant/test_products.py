"""Products of velocities in a vehicle's file: what is read, what is refused, and whether they can feed energy in."""

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin import TwinParameters
from uvms_mj import InputError, Scenario, attach, simulate
from uvms_mj.physics.effects import PRODUCT
from uvms_mj.plant.description import described, rows
from uvms_mj.plant.dissipation import damping_notes, quadratic_gain
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.plant.own_vehicle import copied
from uvms_mj.plant.vehicle import Vehicle
from vehicles import random_parameters, text_of, vehicle_xml, workless

ARM = (Path(__file__).parents[2] / "models" / "bluerov2_alpha5.xml").read_text()
STILL = TwinParameters(v_c_W=(0.0, 0.0, 0.0))


def read(data: str, parameters: TwinParameters = STILL) -> Vehicle:
    return Vehicle.from_model(mujoco.MjModel.from_xml_string(vehicle_xml(parameters, products=data)))


def faults_of(data: str, **others) -> str:
    with pytest.raises(InputError) as caught:
        read(data, **others)
    return str(caught.value)


def test_names_are_an_axis_and_two_velocities_of_which_one_may_have_bars():
    read_in = [each.record for each in read("Yuv -28.6\n Yr|r| 0.632 Nu|v| 2 K|p|q -3e-1 Xuu 1").products]
    assert read_in == [
        (1, 0, 1, 0, -28.6),
        (1, 5, 5, 1, 0.632),
        (5, 0, 1, 1, 2.0),
        (3, 4, 3, 1, -0.3),
        (0, 0, 0, 0, 1.0),
    ]
    assert read("").products == ()


def test_what_is_no_product_is_refused_by_name_with_every_fault_at_once():
    said = faults_of("Yus 1 Auv 1 Y_uv 1 Yu|v 1 Y|u||v| 1 Yu 1 Yuvw 1 Nuv x Nur nan Mup inf Xvr 1e99")
    for name in ("Yus", "Auv", "Y_uv", "Yu|v", "Y|u||v|", "Yu", "Yuvw"):
        assert f"products {name}: is no product of velocities" in said
    for name, number in (("Nuv", "x"), ("Nur", "nan"), ("Mup", "inf"), ("Xvr", "1e99")):
        assert f"products {name}: {number}: must be a finite number" in said
    assert "products: has 3 words: a name and a number by turns" in faults_of("Yuv 1 Nuv")


def test_a_product_that_is_given_twice_is_refused():
    said = faults_of("Yuv 1 Yvu 2 Nr|r| 1 N|r|r 1 Yu|v| 1 Y|u|v 1")
    assert "Yvu: is given twice, before as Yuv" in said
    assert "N|r|r: is given twice, before as Nr|r|" in said
    assert "Y|u|v" not in said.replace("Y|u|v|", "")  # abs(u) v is another one than u abs(v)
    D = np.diag([0.0, 2.0, 0.0, 0.0, 0.0, 0.0])
    assert "Yv|v|: is given twice, as Y_vv of D_quadratic too" in faults_of(
        "Yv|v| -1 Xu|u| -1", parameters=replace(STILL, D_quadratic=D)
    )


def file_of(xml: str) -> Mjcf:
    return Mjcf("rov.xml", {"rov.xml": xml.encode()})


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        (
            '<text name="upperarm.products" data="Yuv 1"/>',
            "upperarm.products: products of velocities are known for the base",
        ),
        ('<text name="Products" data="Yuv 1"/>', "Products: is not a coefficient; did you mean 'products'"),
        ('<numeric name="Y_uv" data="1"/>', 'Y_uv: is a product of velocities: write <text name="products" data="Yuv'),
    ],
)
def test_an_entry_of_a_link_and_one_of_another_name_are_refused(entry, said):
    with pytest.raises(InputError, match=re.escape(said)):
        file_of(ARM.replace("</custom>", f"{entry}</custom>", 1)).vehicle  # noqa: B018


def test_they_are_in_a_copy_of_the_file_in_its_description_and_in_a_log(tmp_path):
    path = tmp_path / "rov.xml"
    path.write_text(vehicle_xml(STILL, products="Yuv -28.6 Yr|r| 0.632"))
    (tmp_path / "copy.xml").write_bytes(copied("rov", path, "copy", [], "")["copy.xml"])
    products = Mjcf.find(str(path)).vehicle.products
    assert [each.name for each in products] == ["Yuv", "Yr|r|"]
    assert Mjcf.find(str(tmp_path / "copy.xml")).vehicle.products == products
    about = described(Mjcf.find(str(path)))
    assert about["products"] == {"Yuv": -28.6, "Yr|r|": 0.632}
    assert ("products", "Yuv -28.6, Yr|r| 0.632") in [*rows(about)]
    scenario = Scenario.load("push_wall", {"vehicle.model": str(path), "simulation.duration": 0.01})
    assert simulate(scenario).header.mjcf.vehicle.products == products


def records(products) -> np.ndarray:
    return np.array([tuple(each) for each in products], PRODUCT)


def power(D: np.ndarray, products: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """nu^T D (abs(nu) nu) - nu^T f of velocities (6,) or (6, n)."""
    total = (nu * (D @ (np.abs(nu) * nu))).sum(axis=0)
    for axis, first, second, bars, c in products.tolist():
        total = total - c * nu[axis] * nu[first] * (np.abs(nu[second]) if bars else nu[second])
    return total


def random_products(rng: np.random.Generator, n: int, size: float) -> np.ndarray:
    return records([(*rng.integers(0, 6, 3), rng.integers(0, 2), size * rng.normal()) for _ in range(n)])


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 3.0))
def test_a_velocity_at_which_products_feed_energy_in_is_found_where_there_is_one(seed, size):
    """A velocity that is found gains energy; if none is found, none of 2,000 velocities does, in any units."""
    rng = np.random.default_rng(seed)
    products, unit = random_products(rng, 5, size), np.exp(rng.normal(size=6))
    scaled = products.copy()
    scaled["coefficient"] *= unit[products["axis"]] * unit[products["first"]] * unit[products["second"]]
    found = quadratic_gain(np.diag(unit**3), scaled)
    if found is not None:
        assert power(np.diag(unit**3), scaled, found) < 0.0
    else:
        nu = rng.normal(size=(2_000, 6)) * rng.choice([0.1, 1.0], (2_000, 6)) / unit
        assert power(np.diag(unit**3), scaled, nu.T).min() >= 0.0


@pytest.mark.parametrize("seed", range(5))
def test_products_that_do_no_work_are_not_noted_and_others_with_a_velocity_and_its_power(seed):
    rng = np.random.default_rng(seed)
    parameters = random_parameters(seed)
    model = mujoco.MjModel.from_xml_string(vehicle_xml(parameters, products=text_of(workless(rng, 12))))
    products = records(each.record for each in Vehicle.from_model(model).products)
    assert damping_notes("rov", parameters.D_linear, parameters.D_quadratic, products) == []
    feeding = np.concatenate([products, records([(0, 0, 5, 0, 500.0)])])
    (note,) = damping_notes("rov", parameters.D_linear, parameters.D_quadratic, feeding)
    numbers = re.search(r"nu = \[(.*)\] m/s.* adds (\S+) W; check the signs of .* of the products of velocities", note)
    nu = np.array(numbers[1].split(), float)
    fed = -nu @ parameters.D_linear @ nu - power(parameters.D_quadratic, feeding, nu)
    assert fed > 0.0
    assert fed == pytest.approx(float(numbers[2]), rel=2e-2)


def test_attach_and_a_run_warn_of_products_that_feed_energy_in(tmp_path):
    path = tmp_path / "rov.xml"
    path.write_text(vehicle_xml(STILL, products="Xuu 300"))
    model = mujoco.MjModel.from_xml_path(str(path))
    with pytest.warns(UserWarning, match="of the products of velocities"), attach(model, mujoco.MjData(model)):
        pass
    with pytest.warns(UserWarning, match="of the products of velocities"):
        simulate(Scenario.load("push_wall", {"vehicle.model": str(path), "simulation.duration": 0.01}))
