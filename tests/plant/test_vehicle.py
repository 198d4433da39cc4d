"""Vehicles that cannot be simulated are refused by name."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from twin import TwinParameters
from uvms_mj import InputError, attach
from vehicles import load, vehicle_xml

STILL = TwinParameters(v_c_W=(0.0, 0.0, 0.0))


def test_a_body_without_room_for_the_added_mass_is_refused():
    xml = vehicle_xml(replace(STILL, r_g=(0.0, 0.0, 0.0))).replace('simple="false"', "")
    model = mujoco.MjModel.from_xml_string(xml)
    with pytest.raises(InputError, match='simple="false"'):
        attach(model, mujoco.MjData(model))


@pytest.mark.parametrize(
    ("before", "after", "reason"),
    [
        ('name="X_u"', 'name="X_uu_"', "X_u: no such <numeric>"),
        (
            'name="X_uu" size="1" data="-18.18"',
            'name="X_uu" size="1" data="18.18"',
            "X_uu: 18.18 is not dissipative",
        ),
        ('size="36"', 'size="35"', "M_A"),
        ('name="displaced_mass" size="1" data="', 'name="displaced_mass" size="1" data="-', "displaced_mass"),
    ],
)
def test_unphysical_coefficients_are_named(before, after, reason):
    xml = vehicle_xml(STILL)
    assert before in xml
    if before == 'size="36"':
        xml = xml.replace('size="36" data="5.5 ', 'size="35" data="')
    model = mujoco.MjModel.from_xml_string(xml.replace(before, after))
    with pytest.raises(InputError, match=reason):
        attach(model, mujoco.MjData(model))


def test_a_thruster_that_does_not_turn_with_the_vehicle_is_refused():
    """A motor on the free joint pushes along W, which is right at the reference attitude only."""
    xml = vehicle_xml(STILL).replace('<motor name="m0" site="origin"', '<motor name="m0" joint="free"')
    xml = xml.replace('simple="false"><freejoint/>', 'simple="false"><freejoint name="free"/>')
    model = mujoco.MjModel.from_xml_string(xml)
    with pytest.raises(InputError, match="m0: its wrench in B depends on the pose"):
        attach(model, mujoco.MjData(model))


LINK = '<body name="link">{}<geom size="0.01" mass="1e-3"/></body>'


@pytest.mark.parametrize("joint", ["hinge", "slide"])
def test_a_link_without_coefficients_is_refused(joint):
    """The link would be dry. A body that is fixed to the vehicle is a part of its rigid body."""
    xml = vehicle_xml(STILL).replace('name="origin"/>', f'name="origin"/>{LINK}')
    model = mujoco.MjModel.from_xml_string(xml.format(f'<joint type="{joint}"/>'))
    with pytest.raises(InputError, match=r"body 'link': moves on a joint and has no coefficient"):
        attach(model, mujoco.MjData(model))
    fixed = mujoco.MjModel.from_xml_string(xml.format(""))
    with attach(fixed, mujoco.MjData(fixed)) as attachment:
        assert attachment.vehicle.mass == pytest.approx(STILL.mass + 1e-3)


def numerics(*names: str) -> mujoco.MjModel:
    xml = vehicle_xml(STILL).replace(
        "</custom>", "".join(f'<numeric name="{n}" data="1"/>' for n in names) + "</custom>"
    )
    return mujoco.MjModel.from_xml_string(xml)


@pytest.mark.parametrize(
    ("name", "meant"),
    [("centre_of_buoyancy", "center_of_buoyancy"), ("Displaced_Mass", "displaced_mass"), ("X_uuu", "X_uu")],
)
def test_a_misspelt_coefficient_is_refused(name, meant):
    """It would have no effect. A model may have numerics for other purposes, as another program's settings."""
    model = numerics("max_contact_points", "K_gain", "another/centre_of_buoyancy")
    attach(model, mujoco.MjData(model)).detach()
    model = numerics(name)
    with pytest.raises(InputError, match=f"{name}: is not a coefficient; did you mean '{meant}'"):
        attach(model, mujoco.MjData(model))


@pytest.mark.parametrize(
    ("motor", "reason"),
    [
        ('<motor delay="0.01" nsample="20" ', "m0: is not a plain <motor>"),
        ('<motor ctrlrange="5 -5" ', "m0: ctrlrange 5 -5: the lower limit must come first"),
        ('<motor ctrlrange="-5 -4" forcerange="1 2" ', "m0: its ctrlrange and forcerange do not overlap"),
        ('<motor forcerange="5 -5" ', "m0: forcerange 5 -5: the lower limit must come first"),
    ],
)
def test_a_thruster_that_is_not_gain_times_ctrl_within_its_limits_is_refused(motor, reason):
    model = mujoco.MjModel.from_xml_string(vehicle_xml(STILL).replace("<motor ", motor, 1))
    with pytest.raises(InputError, match=reason):
        attach(model, mujoco.MjData(model))


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda m: m.actuator_gear.__setitem__((3, 1), np.nan), "m3: its site, gear or gain is not finite"),
        (lambda m: m.body_mass.__setitem__(1, np.inf), "M_RB: mass or inertia is not finite"),
        (lambda m: m.body_gravcomp.__setitem__(1, np.nan), "gravcomp"),
    ],
)
def test_a_model_that_is_not_finite_is_refused(spoil, reason):
    model, _ = load(STILL)
    spoil(model)
    with pytest.raises(InputError, match=reason):
        attach(model, mujoco.MjData(model))
