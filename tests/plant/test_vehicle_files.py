"""Vehicle files: supported elements are used, all others are refused by name."""

import re
from collections.abc import Iterator
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from edited_vehicles import BLUEROV, CUBE, INERTIAL, SHIPPED, edited, mjcf, plant, with_end
from twin import TwinParameters
from uvms_mj import InputError, McapLog, Scenario, simulate
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.plant.mjcf_elements import ELEMENTS, MOST_ELEMENTS
from uvms_mj.plant.vehicle import Vehicle
from uvms_mj.plant.vehicle_files import check_elements
from vehicles import vehicle_xml

MOTOR = '<motor name="surge_left" site="surge_left" gear="1 0 0 0 0 0"'
BODY = '<body name="bluerov1" childclass="bluerov1" simple="false"'


# Refused files


OPTION = '<option integrator="Euler"'


REFUSED = {
    "solver tolerance": (edited(OPTION, '<option tolerance="1" integrator="Euler"'), '<option tolerance="1">'),
    "iterations": (edited(OPTION, '<option iterations="3" integrator="Euler"'), '<option iterations="3">'),
    "solver": (edited(OPTION, '<option solver="PGS" integrator="Euler"'), '<option solver="PGS">'),
    "contact override": (edited(OPTION, '<option o_margin="1" integrator="Euler"'), '<option o_margin="1">'),
    "fluid": (edited(OPTION, '<option density="1000" integrator="Euler"'), '<option density="1000">: must be 0'),
    "wind": (edited(OPTION, '<option wind="0 1 0" integrator="Euler"'), '<option wind="0 1 0">: must be 0'),
    "misspelt option": (with_end('<option gravty="0 0 -9.8"/>'), "did you mean 'gravity'"),
    "flag": (with_end('<option><flag contact="disable"/></option>'), "<flag>"),
    "size": (with_end('<size memory="1K"/>'), "<size>"),
    "mean inertia": (with_end('<statistic meaninertia="1e9"/>'), '<statistic meaninertia="1e9">'),
    "bounded mass": (with_end('<compiler boundmass="20"/>'), '<compiler boundmass="20">'),
    "inertial overridden": (with_end('<compiler inertiafromgeom="true"/>'), '<compiler inertiafromgeom="true">'),
    "total mass": (with_end('<compiler settotalmass="20"/>'), '<compiler settotalmass="20">'),
    "balanced inertia": (with_end('<compiler balanceinertia="true"/>'), '<compiler balanceinertia="true">'),
    "turned frame": (with_end('<compiler alignfree="true"/>'), '<compiler alignfree="true">: it would rotate the body'),
    "turned joint": (edited('<freejoint name="bluerov1"', '<freejoint align="true"'), '<freejoint align="true">'),
    "lost hull": (with_end('<compiler discardvisual="true"/>'), '<compiler discardvisual="true">'),
    "weld": (with_end('<equality><weld body1="bluerov1"/></equality>'), "<equality>"),
    "connect": (with_end('<equality><connect body1="bluerov1" anchor="0 0 0"/></equality>'), "<equality>"),
    "tendon": (with_end('<tendon><spatial stiffness="9"><site site="lateral"/></spatial></tendon>'), "<tendon>"),
    "pair": (with_end('<contact><pair geom1="a" geom2="b"/></contact>'), "<contact>"),
    "pair class": (edited("<default>", '<default><pair margin="1"/>'), "<pair>"),
    "sensor": (with_end('<sensor><gyro site="lateral"/></sensor>'), "<sensor>"),
    "keyframe": (with_end('<keyframe><key time="1"/></keyframe>'), "<keyframe>"),
    "plugin": (with_end('<extension><plugin plugin="mujoco.pid"/></extension>'), "<extension>"),
    "flex": (edited(BODY, '<flexcomp name="f" type="grid"/>' + BODY), '<flexcomp name="f">'),
    "composite": (edited(BODY, '<composite type="cable"/>' + BODY), "<composite>"),
    "height field": (edited("<asset>", '<asset><hfield name="h" nrow="2" ncol="2" size="1 1 1 1"/>'), "<hfield"),
    "gravcomp": (edited(BODY, BODY + ' gravcomp="1"'), 'gravcomp="1">: must be 0'),
    "gravcomp nan": (edited(BODY, BODY + ' gravcomp="nan"'), 'gravcomp="nan">: must be 0'),
    "mocap": (edited(BODY, '<body name="m" mocap="true"/>' + BODY), '<body name="m" mocap="true">'),
    "sleep": (edited(BODY, BODY + ' sleep="init"'), 'sleep="init">'),
    "joint damping": (
        edited('<freejoint name="bluerov1"', '<joint type="free" damping="1"'),
        "the free joint of body 'bluerov1'",
    ),
    "joint spring": (edited('<freejoint name="bluerov1"', '<joint type="free" stiffness="1"'), 'stiffness="1">'),
    "joint class": (
        edited("<default>", '<default><joint frictionloss="1"/>').replace("<freejoint", '<joint type="free"'),
        "the free joint of body 'bluerov1': has damping, armature or frictionloss",
    ),
    "geom friction": (edited("<default>", '<default><geom friction="0 0 0"/>'), '<geom friction="0 0 0">'),
    "geom margin": (edited("<default>", '<default><geom margin=".1"/>'), '<geom margin=".1">'),
    "moving surface": (edited("<default>", '<default><geom surfacevel="1 0 0 0 0 0"/>'), "<geom surfacevel="),
    "fluid shape": (edited("<default>", '<default><geom fluidshape="ellipsoid"/>'), '<geom fluidshape="ellipsoid">'),
    "delay": (edited(MOTOR, MOTOR + ' delay=".01" nsample="20"'), 'name="surge_left" delay=".01"'),
    "limits": (edited(MOTOR, MOTOR + ' ctrlrange="5 -5"'), 'ctrlrange="5 -5">: must be two numbers, the lower'),
    "force limits": (edited(MOTOR, MOTOR + ' forcerange="1 1"'), 'forcerange="1 1">: must be two numbers, the lower'),
    "class limits": (edited("<default>", '<default><motor ctrlrange="5 -5"/>'), '<motor ctrlrange="5 -5">'),
    "joint motor": (edited("<actuator>", '<actuator><motor joint="bluerov1"/>'), "actuator 0: drives the free joint"),
    "lag": (edited("<actuator>", '<actuator><general dyntype="filter"/>'), '<general dyntype="filter">'),
    "servo": (edited("<actuator>", '<actuator><position site="lateral"/>'), "<position>: is not supported"),
    "misspelt motor": (edited("<actuator>", '<actuator><motr site="lateral"/>'), "did you mean 'motor'"),
    "no gear": (edited(MOTOR, MOTOR.replace("1 0 0 0 0 0", "0 0 0")), "surge_left: its gear is zero"),
    "motor elsewhere": (
        edited(BODY, '<site name="w"/>' + BODY).replace(MOTOR, MOTOR.replace('site="surge_left"', 'site="w"')),
        "surge_left: its site 'w' is not on the vehicle",
    ),
    "motor on no site": (edited('site="lateral"', 'site="laterl"'), "transmission target 'laterl' not found"),
    "no thrusters": (re.sub("<actuator>.*</actuator>", "", BLUEROV, flags=re.DOTALL), "<actuator>: has no thruster"),
    "site nan": (edited('<site name="surge_left"/>', '<site name="surge_left" pos="0 nan 0"/>'), 'pos="0 nan 0">'),
    "mass inf": (edited(INERTIAL, '<inertial mass="inf"'), '<inertial mass="inf">: must be finite numbers'),
    "mass huge": (edited(INERTIAL, '<inertial mass="1e300"'), '<inertial mass="1e300">: must be finite numbers'),
    "mass hexadecimal": (edited(INERTIAL, '<inertial mass="0x7"'), '<inertial mass="0x7">: must be finite numbers'),
    "gravity nan": (with_end('<option gravity="0 0 nan"/>'), '<option gravity="0 0 nan">'),
    "misspelt numeric": (edited('name="center_of_', 'name="centre_of_'), "did you mean 'center_of_buoyancy'"),
    "unknown numeric": (
        edited("<custom>", '<custom><numeric name="colour" data="1"/>'),
        "colour: is not a coefficient",
    ),
    "padded numeric": (
        edited('<numeric name="center_of_buoyancy" data="0 0 0"/>', '<numeric name="M_A" size="36" data="9 0"/>'),
        '<numeric name="M_A" size="36">: has 2 numbers in data',
    ),
    "text": (edited(MOTOR, MOTOR + '>ctrlrange="-5 5"</motor><motor site="lateral"'), "has the text 'ctrlrange="),
    "text after an element": (edited("<actuator>", "<actuator><motor site='lateral'/>gear='2'"), 'has the text "gear'),
    "tuple": (edited("<custom>", '<custom><tuple name="t"/>'), '<tuple name="t">'),
    "second vehicle": (
        edited(BODY, '<body name="b"><freejoint/><geom size="1"/></body>' + BODY),
        "this file has body 'b' and body 'bluerov1'",
    ),
    "no vehicle": (
        edited('<freejoint name="bluerov1"/>', ""),
        "on a free joint; this file has none",
    ),
    "rock": (
        edited(BODY, '<geom name="rock" size="1"/>' + BODY).replace('contype="0"', ""),
        "geom 'rock': is fixed to the world",
    ),
    "many copies": (
        edited(INERTIAL, '<replicate count="200"><replicate count="200"><site/></replicate></replicate>' + INERTIAL),
        f"elements, counting each copy by <replicate> and <attach>; at most {MOST_ELEMENTS} are allowed",
    ),
    "many more copies": (edited('<replicate count="6"', '<replicate count="1e9"'), '<replicate count="1e9">'),
    "attached to itself": (edited(BODY, '<attach body="bluerov1" prefix="x"/>' + BODY), "<attach>: has no model"),
    "large texture": (
        edited("<asset>", '<asset><texture name="t" type="2d" builtin="flat" width="90000" height="90000"/>'),
        '<texture name="t" width="90000">: must be within 0 and 4096',
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_a_run_would_not_take_over_is_refused_by_name(case):
    text, expected = REFUSED[case]
    with pytest.raises(InputError, match=re.escape(expected)) as error:
        plant(text)
    assert str(error.value).startswith("vehicle.model mine.xml: ")


def test_every_fault_is_named_once_with_its_file():
    parts = b'<mujoco><option tolerance="1"/></mujoco>'
    text = with_end('<include file="parts.xml"/><sensor/><equality/>').replace("<site ", '<site user="1" ')
    with pytest.raises(InputError) as error:
        plant(text, parts=parts)
    assert len(error.value.faults) == 4
    assert '<option tolerance="1"> in parts.xml: tolerance is not supported' in str(error.value)
    assert '<site user="1">: user is not supported' in str(error.value)
    assert "(7 times)" in str(error.value)


def test_nothing_is_written_for_a_vehicle_that_is_refused(tmp_path):
    log = tmp_path / "run.mcap"
    with pytest.raises(InputError, match="has no thruster"):
        simulate(Scenario(), mjcf=mjcf(REFUSED["no thrusters"][0]), sinks=[McapLog(log)])
    assert not log.exists()


VALUES = (
    "0",
    "-1",
    "1e9",
    "1e-300",
    "1e308",
    "nan",
    "0 0 0",
    "1 0 0",
    "0 0 0 0 0 0",
    "",
    "abc",
    "true",
    "5 -5",
    "free",
)


@pytest.mark.parametrize("seed", range(60))
def test_any_value_of_any_attribute_gives_a_plant_or_one_clear_error(seed):
    rng = np.random.default_rng(seed)
    root = ElementTree.fromstring(BLUEROV)
    elements = list(root.iter())
    for _ in range(rng.integers(1, 4)):
        element = elements[rng.integers(len(elements))]
        attributes = [*element.attrib, *(ELEMENTS[element.tag] or ()), "unknown"]
        element.set(attributes[rng.integers(len(attributes))], VALUES[rng.integers(len(VALUES))])
    try:
        built = plant(ElementTree.tostring(root).decode())
    except InputError:
        return
    assert np.isfinite(built.vehicle.M).all()
    assert np.isfinite(built.vehicle.B).all()


# All of MuJoCo's format


def schema() -> Iterator[tuple[tuple[str, ...], list[str]]]:
    """Path and attributes of each element in MuJoCo's table of MJCF."""
    path: list[str] = []
    attributes: list[str] = []
    for line in mujoco.mj_printSchema(0, 0).splitlines():
        head = re.match(r"^((?:   )*)(\(world\))?(\w+) \(.\) +(.*)$", line)
        if head is None:
            attributes += line.split()
            continue
        if path:
            yield tuple(path), attributes
        path, attributes = [*path[: len(head[1]) // 3], head[3]], head[4].split()
    yield tuple(path), attributes


SCHEMA = list(schema())


def tree(path: tuple[str, ...], **attributes: str) -> ElementTree.Element:
    element = ElementTree.Element(path[-1], attributes)
    for tag in reversed(path[:-1]):
        outer = ElementTree.Element(tag)
        outer.append(element)
        element = outer
    return element


def test_every_element_and_attribute_of_mujoco_that_is_not_in_the_table_is_refused():
    refused = 0
    for path, attributes in SCHEMA:
        unknown = [tag for tag in path if tag not in ELEMENTS]
        rules = ELEMENTS.get(path[-1])
        for attribute in (
            ["", *attributes] if unknown else [a for a in attributes if rules is not None and a not in rules]
        ):
            with pytest.raises(InputError) as error:
                check_elements({"v.xml": tree(path, **({attribute: "0"} if attribute else {}))}, "v.xml")
            where = f"<{unknown[0]}" if unknown else f'<{path[-1]} {attribute}="0">: {attribute} is not supported'
            assert where in str(error.value), (path, attribute)
            refused += 1
    assert len(SCHEMA) > 150
    assert refused > 1500


def test_everything_in_the_table_is_mujocos():
    known: dict[str, set[str]] = {"include": {"file"}, "worldbody": set()}
    for path, attributes in SCHEMA:
        known.setdefault(path[-1], set()).update(attributes)
    later = {"frame", "replicate"}  # read by MuJoCo but not in its table
    for tag, rules in ELEMENTS.items():
        assert tag in known or tag in later, tag
        old = {"coordinate"} if tag == "compiler" else set()
        assert tag in later or set(rules or ()) - old <= known[tag], tag


LOOKS = {
    "as it ships": SHIPPED,
    "visual": with_end('<visual><map stiffness="9" znear=".1"/><quality shadowsize="64"/></visual>'),
    "statistic": with_end('<statistic center="1 0 0" extent="3" meansize=".1"/>'),
    "other settings": with_end('<option timestep=".01" integrator="RK4" cone="pyramidal" density="0" wind="0 0 0"/>'),
    "compiler": with_end('<compiler autolimits="true" coordinate="local" inertiafromgeom="auto" boundmass="0"/>'),
    "texture": edited(
        "<asset>",
        '<asset><texture name="t" type="cube" builtin="checker" width="8" height="8" rgb1="1 0 0"/>'
        '<material name="m" texture="t" texuniform="true" emission=".5"/>',
    ),
    "light and camera": edited(
        BODY, f'<light mode="targetbody" target="bluerov1"/><camera name="c" mode="fixed" fovy="60"/>{BODY}'
    ),
    "light on it": edited(INERTIAL, f'<light name="lamp" pos=".2 0 0"/><camera name="eye"/>{INERTIAL}'),
    "floor": edited(BODY, f'<geom type="plane" size="9 9 1" contype="0" conaffinity="0" pos="0 0 -3"/>{BODY}'),
    "floor that meets nothing": edited(BODY, f'<body pos="0 0 -3"><geom type="plane" size="9 9 1"/></body>{BODY}'),
    "include": with_end('<include file="parts.xml"/>').replace(
        INERTIAL, '<geom type="mesh" mesh="cube" mass="0"/>' + INERTIAL
    ),
    "massless part": edited(
        INERTIAL, f'<body name="p" pos="0 .1 0"><geom type="box" size=".01 .01 .01"/><site/></body>{INERTIAL}'
    ),
    "frame and copies": edited(
        INERTIAL, f'<frame euler="0 0 9"><replicate count="9" offset="0 .01 0"><site/></replicate></frame>{INERTIAL}'
    ),
    "remarks": edited("</custom>", '<text name="remark" data="of a thesis"/></custom>'),
    "plain joint": edited('<freejoint name="bluerov1"/>', '<joint type="free" damping="0" armature="0"/>'),
    "wide limits": edited(MOTOR, MOTOR + ' ctrllimited="true" ctrlrange="-1e3 1e3" forcerange="-1e3 1e3"'),
    "group": edited(MOTOR, MOTOR + ' group="2"'),
    "nothing turned": edited('<freejoint name="bluerov1"', '<freejoint align="false" group="1"'),
    "no gravcomp": edited(BODY, BODY + ' gravcomp="0" mocap="false"'),
}
PARTS = b'<mujoco><asset><mesh name="cube" file="cube.obj"/></asset></mujoco>'
DURATION = {"simulation.duration": 0.05, "wall.position": 0.0005, "reference.step_time": 0.0}


@pytest.fixture(scope="module")
def plain():
    return simulate(Scenario.load("push_wall", DURATION | {"initial.velocity": [0.1, 0, 0, 0, 0, 0]}))


@pytest.mark.slow
@pytest.mark.parametrize("case", LOOKS)
def test_what_is_for_the_eye_changes_nothing_that_moves(case, plain):
    """The motion is the same bit for bit, in contact with the wall."""
    assert (plain.f_contact_W[:, 0] < 0).any()
    model = Mjcf("mine.xml", {"mine.xml": LOOKS[case].encode(), "parts.xml": PARTS, "cube.obj": CUBE})
    trace = simulate(plain.scenario, mjcf=model)
    for name in ("p_WB", "quat_WB", "nu", "tau", "f_contact_W", "s"):
        assert np.array_equal(trace[name], plain[name]), name


BALL = '<geom name="ball" type="sphere" size=".1" mass="7.31"/>'
NO_INERTIAL = re.sub("<inertial[^>]*/>", BALL, BLUEROV)


@pytest.mark.parametrize(
    "text",
    [
        re.sub("<inertial[^>]*/>", BALL, vehicle_xml(TwinParameters())),
        NO_INERTIAL,
        NO_INERTIAL.replace('contype="0" conaffinity="0"', ""),
        NO_INERTIAL.replace("</mujoco>", '<compiler inertiafromgeom="auto" inertiagrouprange="1 2"/></mujoco>'),
        edited(INERTIAL, f'<body pos="0 .1 0">{BALL}<site/></body><inertial mass="1e-6"').replace(
            "<compiler ", '<compiler fusestatic="true" '
        ),
        edited("<default>", '<default><geom pos="1 2 3" euler="0 90 0" mass="5"/>'),
        edited("<default>", '<default><geom type="mesh" mesh="dome" fitscale="3"/>'),
        edited('<geom group="2"', '<geom group="2" pos="1 2 3" axisangle="0 0 1 40"'),
    ],
)
def test_the_plant_has_the_vehicles_inertia_and_the_wall_and_probe_their_place(text):
    """This holds for any default class of the file, and also if the mass comes from geoms."""
    built = plant(text, {"wall.position": 1.5})
    model = built.model
    vehicle = Vehicle.from_model(model)
    assert np.allclose(vehicle.M_RB, built.vehicle.M_RB, rtol=1e-12, atol=1e-12)
    assert vehicle.mass == pytest.approx(7.31, rel=1e-5)
    probe, wall = model.geom("uvms_mj/probe"), model.geom("uvms_mj/wall")
    assert np.array_equal(probe.pos, [0, 0, 0])
    assert probe.type == mujoco.mjtGeom.mjGEOM_SPHERE
    assert np.allclose(wall.pos, [1.5 + probe.size[0], 0, 0])
    normal = np.zeros(3)
    mujoco.mju_rotVecQuat(normal, np.array([0.0, 0, 1]), wall.quat)
    assert np.allclose(normal, [-1, 0, 0])
