"""Vehicle files with joints: what a link and its joint may have, and what is refused by name."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from edited_vehicles import BLUEROV, INERTIAL, mjcf, plant
from uvms_mj import InputError
from uvms_mj.plant.coefficients import Part, strip_theory
from uvms_mj.plant.dissipation import quadratic_gain
from uvms_mj.plant.vehicle import Vehicle
from uvms_mj.plant.vehicle_files import known_attributes

WATER = '<numeric name="arm.strip_theory" data="1 1.1"/>'
GEOM = '<geom type="capsule" size=".03" fromto="-.2 0 0 .2 0 0" mass=".5" contype="0" conaffinity="0"/>'
JOINT = '<joint name="elbow" axis="0 1 0" pos="-.2 0 0"/>'
MOTOR = '<motor name="m" joint="elbow" ctrlrange="-9 9"/>'


def file(joint: str = JOINT, water: str = WATER, geom: str = GEOM, motor: str = MOTOR, inside: str = "") -> str:
    """The BlueROV1 with one link, a rod of 0.4 m."""
    text = BLUEROV.replace(INERTIAL, f'<body name="arm" pos=".5 0 0">{joint}{geom}{inside}</body>{INERTIAL}')
    return text.replace("</custom>", f"{water}</custom>").replace("</actuator>", f"{motor}</actuator>")


def vehicle(**parts: str) -> Vehicle:
    return mjcf(file(**parts)).vehicle


def numeric(name: str, *values: float) -> str:
    return f'<numeric name="{name}" data="{" ".join(repr(float(x)) for x in values)}"/>'


ROD = strip_theory([Part(0.03, 0.2, np.zeros(3), np.array([1.0, 0, 0]), True)], 1.0, 1.1)


def test_strip_theory_fills_in_all_that_the_file_leaves_out():
    (link,) = vehicle().arm.links
    assert link.filled_in == ("displaced_mass", "center_of_buoyancy", "M_A", "D_quadratic")
    assert link.displaced_mass == pytest.approx(ROD.displaced_mass, rel=1e-12)
    for name in ("M_A", "D_quadratic"):
        np.testing.assert_allclose(getattr(link, name), getattr(ROD, name), rtol=1e-12, atol=1e-12)
    assert not link.D_linear.any()


def test_what_the_file_gives_is_not_filled_in():
    water = WATER + numeric("arm.displaced_mass", 0.7) + numeric("arm.D_linear", *np.eye(6).ravel())
    (link,) = vehicle(water=water).arm.links
    assert link.filled_in == ("center_of_buoyancy", "M_A", "D_quadratic")
    assert link.displaced_mass == 0.7
    assert np.array_equal(link.D_linear, np.eye(6))
    np.testing.assert_allclose(link.M_A, ROD.M_A, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("kind", ["hinge", "slide"])
def test_a_joint_has_the_numbers_of_its_attributes(kind):
    joint = (
        f'<joint name="elbow" type="{kind}" axis="0 1 0" pos="-.2 0 0" range="-1 2" damping="1.5" frictionloss=".3" '
        'armature=".01"/>'
    )
    (link,) = vehicle(joint=joint, water=WATER + numeric("elbow.speed_limit", 0.5)).arm.links
    assert (link.name, link.joint, link.slide) == ("arm", "elbow", kind == "slide")
    unit = np.pi / 180 if kind == "hinge" else 1.0
    assert link.range == pytest.approx((-unit, 2 * unit))
    assert (link.damping, link.friction, link.armature) == (1.5, 0.3, 0.01)
    assert (link.effort, link.speed_limit) == (9.0, 0.5)


def test_a_joint_without_a_motor_is_passive_and_without_a_name_it_has_that_of_its_link():
    water = WATER + numeric("arm.speed_limit", 0.5)
    (link,) = vehicle(joint='<joint axis="0 1 0"/>', motor="", water=water).arm.links
    assert (link.joint, link.actuator_id, link.effort, link.speed_limit) == ("arm", -1, 0.0, 0.5)
    assert link.range == (-np.inf, np.inf)


def test_a_body_without_a_joint_is_part_of_the_link_that_carries_it():
    hand = '<body name="hand" pos=".2 0 0"><geom size=".02" mass=".1" contype="0" conaffinity="0"/></body>'
    (link,) = vehicle(inside=hand).arm.links
    assert link.mass == pytest.approx(0.6)
    assert link.r_g[0] == pytest.approx(0.2 * 0.1 / 0.6)


SOLID = GEOM.replace('"0"', '"1"').replace("<geom", '<geom name="rod"')
HAND = '<body name="hand"><joint/>' + GEOM.replace('"0"', '"1"') + "</body>"
FIST = WATER.replace("arm", "hand")
REFUSED = {
    "dry": (
        {"water": ""},
        "body 'arm': moves on a joint and has no coefficient, so that it would be dry",
    ),
    "only drag": ({"water": numeric("arm.D_linear", *np.eye(6).ravel())}, "arm.displaced_mass: no such <numeric>"),
    "nothing to strip": (
        {"geom": '<geom size=".1" mass="1" contype="0" conaffinity="0"/>'},
        "'arm' has no capsule",
    ),
    "one number": ({"water": numeric("arm.strip_theory", 1.0)}, "arm.strip_theory: has 1 values; 2 are needed"),
    "negative": ({"water": numeric("arm.strip_theory", 1.0, -1.0)}, "1 -1: C_A and C_D must not be negative"),
    "misspelt body": ({"water": WATER + numeric("amr.displaced_mass", 1.0)}, "'amr' is not a link of the vehicle; did"),
    "no such body": (
        {"water": WATER + numeric("leg.displaced_mass", 1.0)},
        "'leg' is not a link of the vehicle; choose",
    ),
    "misspelt word": ({"water": WATER + numeric("arm.displacd_mass", 1.0)}, "did you mean 'displaced_mass'?"),
    "unknown word": (
        {"water": WATER + numeric("arm.colour", 1.0)},
        "arm.colour: is not a coefficient and",
    ),
    "of the base": (
        {"water": WATER + numeric("bluerov1.displaced_mass", 1.0)},
        "bluerov1.displaced_mass: body 'bluerov1' is the base: its coefficients have no name in front",
    ),
    "of a welded body": (
        {"water": WATER + numeric("hand.displaced_mass", 1.0), "inside": '<body name="hand"/>'},
        "hand.displaced_mass: body 'hand' has no joint: its water is part of the water of 'arm', which carries it",
    ),
    "speed of a link": (
        {"water": WATER + numeric("arm.speed_limit", 1.0)},
        "'arm' is not a joint of the vehicle",
    ),
    "speed zero": ({"water": WATER + numeric("elbow.speed_limit", 0.0)}, "elbow.speed_limit: 0: must be positive"),
    "ball": ({"joint": '<joint type="ball"/>'}, "<joint type=\"ball\">: must be 'hinge' or 'slide'"),
    "two joints": ({"joint": JOINT + '<joint axis="1 0 0"/>'}, "body 'arm': a link has one joint"),
    "spring": (
        {"joint": '<joint name="elbow" stiffness="3"/>'},
        '<joint name="elbow" stiffness="3">: stiffness is not supported; springs are not computed',
    ),
    "ref": ({"joint": '<joint name="elbow" ref="30"/>'}, 'ref="30">: ref is not supported'),
    "negative friction": (
        {"joint": '<joint name="elbow" frictionloss="-1"/>'},
        'frictionloss="-1">: must not be negative',
    ),
    "negative damping": ({"joint": '<joint name="elbow" damping="-1"/>'}, "must be one number that is not neg"),
    "range": ({"joint": '<joint name="elbow" range="2 -1"/>'}, "must be two numbers, the lower limit first"),
    "force range": ({"joint": '<joint name="elbow" actuatorfrcrange="-1 1"/>'}, "actuatorfrcrange is not supported"),
    "free joint below": ({"joint": "<freejoint/>", "motor": ""}, "free joint can only be used on top level"),
    "two motors": ({"motor": MOTOR + '<motor joint="elbow"/>'}, "joint 'elbow': has 2 motors; give it one"),
    "lopsided motor": ({"motor": MOTOR.replace("-9 9", "-5 9")}, "m: ctrlrange -5 9: must be symmetric"),
    "no gear": ({"motor": MOTOR.replace("ctrl", 'gear="0" ctrl')}, "m: gear 0 0 0 0 0 0: a joint's motor"),
    "two gears": ({"motor": MOTOR.replace("ctrl", 'gear="1 2" ctrl')}, "a joint's motor has one gear"),
    "servo": (
        {"motor": '<position joint="elbow"/>'},
        "<position>: is not supported in a vehicle's file",
    ),
    "no such joint": ({"motor": '<motor joint="elbo"/>'}, "unknown transmission target 'elbo'"),
    "thruster on a link": (
        {"inside": '<site name="fin"/>', "motor": '<motor name="f" site="fin"/>'},
        "f: its wrench in B depends on the pose; put the motor on a site of the vehicle's body",
    ),
    "colliding links": (
        {
            "geom": GEOM.replace('"0"', '"1"').replace("<geom", '<geom name="rod"'),
            "inside": HAND,
            "water": WATER + FIST,
        },
        "geom 'rod': of body 'arm' would collide with geoms of body 'hand'; write contype=\"0\"",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_computed_is_refused_by_name(case):
    parts, expected = REFUSED[case]
    with pytest.raises(InputError, match=re.escape(expected)):
        plant(file(**parts))


def test_a_joint_of_another_body_is_refused():
    door = '<body name="door"><joint/><geom size=".1" mass="1" contype="0" conaffinity="0"/></body>'
    text = BLUEROV.replace('<body name="bluerov1"', f'{door}<body name="bluerov1"')
    with pytest.raises(InputError, match="body 'door': moves on a joint and is not carried by body 'bluerov1'"):
        plant(text)


def test_every_error_of_a_link_is_named_at_once():
    water = numeric("arm.strip_theory", -1.0, 1.0) + numeric("elbow.speed_limit", -2.0)
    with pytest.raises(InputError) as error:
        plant(file(water=water, motor=MOTOR.replace("-9 9", "-5 9")))
    assert len(error.value.faults) == 3


def test_more_than_thirty_joints_are_refused():
    link = '<body name="l{0}"><joint/><geom type="capsule" size=".01 .1" mass=".1" contype="0" conaffinity="0"/>'
    chain = "".join(link.format(i) for i in range(31)) + "</body>" * 31
    water = "".join(numeric(f"l{i}.strip_theory", 1.0, 1.0) for i in range(31))
    text = BLUEROV.replace(INERTIAL, chain + INERTIAL).replace("</custom>", f"{water}</custom>")
    with pytest.raises(InputError, match="has 31 joints; at most 30"):
        plant(text)


def test_drag_by_strip_theory_dissipates_about_the_middle_of_a_rod():
    assert quadratic_gain(ROD.D_quadratic) is None


def test_an_attached_arm_has_its_prefix():
    main = """<mujoco><asset><model name="rov" file="rov.xml"/></asset><worldbody>
        <attach model="rov" body="bluerov1" prefix="left/"/></worldbody></mujoco>"""
    (link,) = mjcf(main, rov=file().encode()).vehicle.arm.links
    assert (link.name, link.joint) == ("arm", "elbow")
    assert link.displaced_mass == pytest.approx(ROD.displaced_mass, rel=1e-12)


@pytest.mark.parametrize("prefix", ["my_", "my/"])
def test_an_arm_from_a_file_of_its_own_is_attached_to_a_vehicle(prefix):
    arm = f'<mujoco><custom>{WATER}</custom><worldbody><body name="arm">{JOINT}{GEOM}</body></worldbody></mujoco>'
    text = BLUEROV.replace("<asset>", '<asset><model name="arm" file="arm.xml"/>')
    text = text.replace(INERTIAL, f'<attach model="arm" body="arm" prefix="{prefix}"/>{INERTIAL}')
    (link,) = mjcf(text, arm=arm.encode()).vehicle.arm.links
    assert (link.name, link.joint) == (f"{prefix}arm", f"{prefix}elbow")
    assert link.displaced_mass == pytest.approx(ROD.displaced_mass, rel=1e-12)


VALUES = ("0", "-1", "1e9", "1e-300", "nan", "0 0 0", "1 0 0", "", "abc", "hinge", "free", "2 -1", "arm", "elbow")


@pytest.mark.parametrize("seed", range(60))
def test_any_value_of_an_arm_gives_a_plant_or_one_clear_error(seed):
    rng = np.random.default_rng(seed)
    root = ElementTree.fromstring(file(water=WATER + numeric("elbow.speed_limit", 1.0)))
    arm = next(body for body in root.iter("body") if body.get("name") == "arm")
    elements = [*arm.iter(), *(each for each in root.iter("numeric") if "." in each.get("name", ""))]
    elements += [each for each in root.iter("motor") if "joint" in each.attrib]
    for _ in range(rng.integers(1, 3)):
        element = elements[rng.integers(len(elements))]
        attributes = [*element.attrib, *sorted(known_attributes()[element.tag]), "unknown"]
        element.set(attributes[rng.integers(len(attributes))], VALUES[rng.integers(len(VALUES))])
    try:
        built = plant(ElementTree.tostring(root).decode())
        assert built.model.nv >= 6
    except InputError:
        return
    for link in built.vehicle.arm.links:
        for matrix in (link.M_RB, link.M_A, link.D_linear, link.D_quadratic):
            assert np.isfinite(matrix).all()
