"""Vehicle files: supported elements are used, all others are refused by name."""

import re
from collections.abc import Callable, Iterator
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from edited_vehicles import BLUEROV, CUBE, INERTIAL, SHIPPED, edited, mjcf, plant, with_end
from twin import TwinParameters
from uvms_mj import InputError, McapLog, Scenario, simulate
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.plant.vehicle import Vehicle
from uvms_mj.plant.vehicle_files import ACCEPTED, MOST_ELEMENTS, check_specs, check_xml, known_attributes
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
    "fluid": (
        edited(OPTION, '<option density="1000" integrator="Euler"'),
        '<option density="1000">: density is not supported; hydrodynamic forces come from the coef',
    ),
    "wind": (edited(OPTION, '<option wind="0 1 0" integrator="Euler"'), '<option wind="0 1 0">: wind is not supported'),
    "misspelt option": (with_end('<option gravty="0 0 -9.8"/>'), "did you mean 'gravity'"),
    "flag": (with_end('<option><flag contact="disable"/></option>'), "<flag>"),
    "time step": (
        edited('timestep="0.0001"', 'timestep="0.01"'),
        '<option timestep="0.01">: would be ignored: a run has simulation.timestep; leave it out',
    ),
    "integrator": (edited('integrator="Euler"', 'integrator="RK4"'), "a run has simulation.integrator; leave it out"),
    "place": (edited(BODY, BODY + ' pos="0 0 1"'), "body 'bluerov1': is placed at 0 0 1 with the attitude 1 0 0 0"),
    "attitude": (edited(BODY, BODY + ' euler="0 90 0"'), "a run starts at initial.position and initial.attitude_deg"),
    "place of a frame": (
        edited(BODY, '<frame pos="0 0 1">' + BODY).replace("</worldbody>", "</frame></worldbody>"),
        "leave out its pos and euler, and the frames around it",
    ),
    "unknown class": (
        edited(MOTOR, MOTOR + ' class="blurov1"'),
        'name="surge_left" class="blurov1">: is no <default> class of the model; did you mean \'bluerov1\'?',
    ),
    "class as a format": (edited(MOTOR, MOTOR + ' class="%n"'), 'class="%n">: has a %'),
    "name as a format": (edited('<site name="lateral"', '<site name="%s"'), '<site name="%s">: has a %'),
    "file as a format": (with_end('<include file="%n.xml"/>'), "refers to missing files: %n.xml"),
    "impossible inertia": (
        re.sub('diaginertia="[^"]*"', 'diaginertia="0.6 30 35"', BLUEROV),
        "none of its principal moments is greater than the sum of the other two",
    ),
    "strip theory of the base": (
        edited("<custom>", '<custom><numeric name="strip_theory" data="1 1.1"/>'),
        "strip_theory: fills in the water of a link that is a slender body, and not of the base; give",
    ),
    "strip theory by the base's name": (
        edited("<custom>", '<custom><numeric name="bluerov1.strip_theory" data="1 1.1"/>'),
        "bluerov1.strip_theory: fills in the water of a link that is a slender body, and not of the base; give",
    ),
    "slash": (BLUEROV.replace('name="bluerov1"', 'name="rov/base_link"'), "Name the body 'rov_base_link'"),
    "size": (with_end('<size memory="1K"/>'), "<size>"),
    "mean inertia": (with_end('<statistic meaninertia="1e9"/>'), '<statistic meaninertia="1e9">'),
    "bounded mass": (with_end('<compiler boundmass="20"/>'), '<compiler boundmass="20">'),
    "inertial overridden": (with_end('<compiler inertiafromgeom="true"/>'), '<compiler inertiafromgeom="true">'),
    "total mass": (with_end('<compiler settotalmass="20"/>'), '<compiler settotalmass="20">'),
    "balanced inertia": (with_end('<compiler balanceinertia="true"/>'), '<compiler balanceinertia="true">'),
    "turned frame": (
        with_end('<compiler alignfree="true"/>'),
        '<compiler alignfree="true">: alignfree is not supported; leave it out',
    ),
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
    "gravcomp": (edited(BODY, BODY + ' gravcomp="1"'), 'gravcomp="1">: gravcomp is not supported; buoyancy is'),
    "gravcomp nan": (edited(BODY, BODY + ' gravcomp="nan"'), 'gravcomp="nan">: must be finite'),
    "mocap": (edited(BODY, '<body name="m" mocap="true"/>' + BODY), '<body name="m" mocap="true">'),
    "sleep": (edited(BODY, BODY + ' sleep="init"'), 'sleep="init">'),
    "joint damping": (
        edited('<freejoint name="bluerov1"', '<joint type="free" damping="1"'),
        '<joint damping="1">: damping is not supported; on a free joint, hydrodynamic forces come from',
    ),
    "joint spring": (edited('<freejoint name="bluerov1"', '<joint type="free" stiffness="1"'), 'stiffness="1">'),
    "joint class": (
        edited("<default>", '<default><joint frictionloss="1"/>').replace("<freejoint", '<joint type="free"'),
        '<joint frictionloss="1">: frictionloss is not supported; on a free joint',
    ),
    "geom friction": (edited("<default>", '<default><geom friction="0 0 0"/>'), '<geom friction="0 0 0">'),
    "geom margin": (edited("<default>", '<default><geom margin=".1"/>'), '<geom margin=".1">'),
    "moving surface": (edited("<default>", '<default><geom surfacevel="1 0 0 0 0 0"/>'), "<geom surfacevel="),
    "fluid shape": (edited("<default>", '<default><geom fluidshape="ellipsoid"/>'), '<geom fluidshape="ellipsoid">'),
    "delay": (edited(MOTOR, MOTOR + ' delay=".01" nsample="20"'), 'name="surge_left" delay=".01"'),
    "limits": (edited(MOTOR, MOTOR + ' ctrlrange="5 -5"'), 'ctrlrange="5 -5">: must be two numbers, the lower'),
    "force limits": (edited(MOTOR, MOTOR + ' forcerange="1 1"'), 'forcerange="1 1">: must be two numbers, the lower'),
    "class limits": (edited("<default>", '<default><motor ctrlrange="5 -5"/>'), '<motor ctrlrange="5 -5">'),
    "limits of zero": (
        edited(MOTOR, MOTOR + ' ctrlrange="0 0"'),
        'ctrlrange="0 0">: would be no limit for MuJoCo; write ctrllimited="false" if',
    ),
    "degrees as radians": (
        edited('<site name="surge_left"', '<site name="surge_left" euler="0 0 -45"').replace(
            'angle="degree"', 'angle="radian"'
        ),
        'euler="0 0 -45">: is more than a turn in radians; write <compiler angle="degree"/>',
    ),
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
    "mass huge": (
        edited(INERTIAL, '<inertial mass="1e300"'),
        '<inertial mass="1e300">: must be numbers within +-1e+10',
    ),
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
    "floor": (
        edited(BODY, f'<body pos="0 0 -3"><geom name="floor" type="plane" size="9 9 1"/></body>{BODY}'),
        "geom 'floor': is fixed to the world and would not be touched: a vehicle touches only the scenario's walls",
    ),
    "many copies": (
        edited(INERTIAL, '<replicate count="200"><replicate count="200"><site/></replicate></replicate>' + INERTIAL),
        f"elements, counting each copy by <replicate> and <attach>; at most {MOST_ELEMENTS} are allowed",
    ),
    "many more copies": (edited('<replicate count="6"', '<replicate count="1e9"'), '<replicate count="1e9">'),
    "attached to itself": (edited(BODY, '<attach body="bluerov1" prefix="x"/>' + BODY), "<attach>: has no model"),
    "part without a file": (edited("<asset>", '<asset><model name="p"/>'), '<model name="p">: has no file'),
    "other transmission": (edited(MOTOR, MOTOR + ' jointinparent="arm"'), 'jointinparent="arm">: jointinparent is not'),
    "lamp nan": (edited(INERTIAL, f'<light pos="0 0 nan"/>{INERTIAL}'), '<light pos="0 0 nan">: must be finite'),
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


@pytest.mark.parametrize("root", ["<sdf version='1.6'><plugin filename='gz-sim-thruster-system'/></sdf>", "<robot/>"])
def test_a_file_of_another_format_is_named_before_its_references_are_followed(tmp_path, root):
    path = tmp_path / "rov.sdf"
    path.write_text(root)
    with pytest.raises(
        InputError, match=r"not <mujoco>. It is (SDF of Gazebo|URDF). `uvms-mj new vehicle NAME --from rov.sdf`"
    ):
        Mjcf.find(str(path))


def test_an_inertia_that_is_corrected_as_the_message_says_is_taken():
    said = re.sub('diaginertia="[^"]*"', 'diaginertia="0.6 30 30.6"', BLUEROV)
    assert plant(said).vehicle.M_RB[5, 5] == pytest.approx(30.6)


def test_every_fault_is_named_once_with_its_file():
    """Elements first; what they have is known when MuJoCo has read them."""
    parts = b'<mujoco><option tolerance="1"/></mujoco>'
    text = with_end('<include file="parts.xml"/>').replace("<site ", '<site user="1" ')
    with pytest.raises(InputError) as error:
        plant(text.replace("</mujoco>", "<sensor/><sensor/><equality/></mujoco>"), parts=parts)
    assert [fault.key for fault in error.value.faults] == ["<sensor>", "<equality>"]
    assert "<sensor>: is not supported in a vehicle's file; leave it out (2 times)" in str(error.value)
    with pytest.raises(InputError) as error:
        plant(text, parts=parts)
    assert len(error.value.faults) == 2
    assert '<option tolerance="1"> in parts.xml: tolerance is not supported' in str(error.value)
    assert '<site user="1">: user is not supported' in str(error.value)


UNSEEN = {
    "in a frame": ("<frame {}><site/></frame>", 'user="1"', "user is not supported"),
    "in a replicate": ('<replicate count="2"><site {}/></replicate>', 'poss="1 0 0"', "did you mean 'pos'?"),
    "elsewhere": ("<site {}/>", 'poss="1 0 0"', "did you mean 'pos'?"),
}


@pytest.mark.parametrize("case", UNSEEN)
def test_an_attribute_that_mujoco_does_not_know_is_named_wherever_it_stands(case):
    """MuJoCo ignores it in some places, without a word."""
    element, attribute, expected = UNSEEN[case]
    with pytest.raises(InputError, match=re.escape(expected)):
        plant(edited(INERTIAL, element.format(attribute) + INERTIAL))
    plant(edited(INERTIAL, element.format("") + INERTIAL))


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
        attributes = [*element.attrib, *sorted(known_attributes()[element.tag]), "unknown"]
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
BESIDE = {"frame", "replicate", "include", "worldbody"}
"""Elements that MuJoCo reads and its table lacks."""


def tree(path: tuple[str, ...], **attributes: str) -> ElementTree.Element:
    element = ElementTree.Element(path[-1], attributes)
    for tag in reversed(path[:-1]):
        outer = ElementTree.Element(tag)
        outer.append(element)
        element = outer
    return element


def test_every_element_of_mujoco_is_accepted_or_refused_by_name():
    known = {path[-1] for path, _ in SCHEMA}
    said = {tag: refusal(check_xml, {"v.xml": tree(("mujoco", tag), model="m")}) for tag in known - {"mujoco"}}
    accepted = {tag for tag, text in said.items() if f"<{tag}>: is not supported" not in text}
    assert len(SCHEMA) > 150
    assert {"body", "geom", "motor", "mesh"} < accepted
    assert not accepted & {
        "sensor",
        "equality",
        "tendon",
        "contact",
        "keyframe",
        "flag",
        "plugin",
        "hfield",
        "position",
    }


def refusal(check: Callable[..., None], *checked: object) -> str:
    """The message of a check, or an empty text."""
    try:
        check(*checked, "v.xml")
    except InputError as error:
        return str(error)
    return ""


def test_the_attributes_of_each_element_are_mujocos():
    known: dict[str, set[str]] = {}
    for path, attributes in SCHEMA:
        known.setdefault(path[-1], set()).update(attributes)
    assert {tag: words for tag, words in known_attributes().items() if tag not in BESIDE} == known


def test_each_list_of_a_spec_is_compared_is_for_the_eye_or_stays_empty():
    """The elements that would fill the last are refused by name."""
    spec = mujoco.MjSpec()
    names = [name for name in dir(spec) if name[0] != "_" and name != "copy_during_attach"]
    lists = {name for name in names if isinstance(getattr(spec, name), list)}
    compared = {"bodies", "frames", "geoms", "joints", "sites", "actuators", "meshes", "numerics"}
    for_the_eye = {"textures", "materials", "lights", "cameras", "texts"}
    empty = {"equalities", "excludes", "flexes", "hfields", "keys", "pairs", "plugins", "sensors", "skins", "tendons"}
    assert lists == compared | for_the_eye | empty | {"tuples"}


OF_KINDS = {
    "option": lambda spec: spec.option,
    "compiler": lambda spec: spec.compiler,
    "statistic": lambda spec: spec.stat,
    "body": lambda spec: spec.bodies[1],
    "frame": lambda spec: spec.frames[0],
    "geom": lambda spec: spec.geoms[0],
    "joint": lambda spec: spec.joints[1],
    "freejoint": lambda spec: spec.joints[0],
    "site": lambda spec: spec.sites[0],
    "motor": lambda spec: spec.actuators[0],
    "mesh": lambda spec: spec.meshes[0],
}
STRUCTURE = {"id", "info", "signature", "name", "parent", "frame", "compiler", "classname", "childclass", "plugin"}


def one_of_each() -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body()
    body.add_freejoint()
    for add in (body.add_frame, body.add_geom, body.add_joint, body.add_site, spec.add_actuator, spec.add_mesh):
        add()
    return spec


def changed(value):
    """Another value of the same type, or None for what is no number, text, array or list of numbers."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1 if value == value else 1.0
    if isinstance(value, str):
        return value + "x"
    if isinstance(value, np.ndarray):
        return np.where(np.isnan(value), 0.5, value + 1).astype(value.dtype) if value.dtype.kind == "f" else value + 1
    if type(value).__name__.startswith("mjt"):
        others = [each for each in type(value).__members__.values() if each != value]
        return others[0]
    if type(value).__name__ in ("MjDoubleVec", "MjFloatVec", "MjIntVec"):
        return [1]
    return None


@pytest.mark.parametrize("kind", OF_KINDS)
def test_an_attribute_that_a_run_does_not_take_over_must_have_its_default(kind):
    """MjSpec's own attributes, each changed alone in a model where everything else has its default."""
    others = []
    for name in dir(OF_KINDS[kind](one_of_each())):
        if name[0] == "_" or name in STRUCTURE:
            continue
        spec = one_of_each()
        each = OF_KINDS[kind](spec)
        if (value := changed(getattr(each, name))) is None:
            continue
        setattr(each, name, value)
        said = refusal(check_specs, [spec], {})
        if name not in ACCEPTED[kind].split() and not name.startswith("user"):
            assert said.startswith(f"vehicle.model v.xml: <{kind}>: "), name
            others.append(name)
    assert others or kind == "site"
    assert not refusal(check_specs, [one_of_each()], {})


LOOKS = {
    "as it ships": SHIPPED,
    "visual": with_end('<visual><map stiffness="9" znear=".1"/><quality shadowsize="64"/></visual>'),
    "statistic": with_end('<statistic center="1 0 0" extent="3" meansize=".1"/>'),
    "other settings": with_end(
        '<option timestep="1e-4" integrator="Euler" cone="pyramidal" density="0" wind="0 0 0"/>'
    ),
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
    "class of the top": edited(INERTIAL, f'<geom class="main" size=".01" mass="0"/>{INERTIAL}'),
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
