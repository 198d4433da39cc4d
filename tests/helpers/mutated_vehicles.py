"""Vehicle files, mutated as text, by elements or by numbers."""

import contextlib
import copy
from pathlib import Path
from xml.etree import ElementTree

from mutated_values import Case, Random, mild, mutated_bytes, number

_NAMES = [
    "X_udot",
    "Y_vdot",
    "Z_wdot",
    "K_pdot",
    "M_qdot",
    "N_rdot",
    "X_u",
    "Y_v",
    "Z_w",
    "K_p",
    "M_q",
    "N_r",
    "X_uu",
    "Y_vv",
    "Z_ww",
    "K_pp",
    "M_qq",
    "N_rr",
]
_MOTORS = [f'<motor name="m{i}" site="t" gear="{i * "0 "}1{(5 - i) * " 0"}"/>' for i in range(6)]
_BOX = f"""<mujoco model="box"><compiler angle="degree"/><option gravity="0 0 -9.81"/>
<custom>{"".join(f'<numeric name="{name}" data="-{1 + i % 5}"/>' for i, name in enumerate(_NAMES))}
<numeric name="displaced_mass" data="7"/><numeric name="center_of_buoyancy" data="0 0 0"/></custom>
<asset><material name="m" rgba="1 0 0 1"/><mesh name="d" builtin="hemisphere" params="3" scale=".1 .1 .1"/></asset>
<worldbody><body name="box"><freejoint name="box"/><inertial mass="7" pos="0 0 0" diaginertia=".2 .2 .2"/>
<geom type="box" size=".2 .1 .1" mass="0" contype="0" conaffinity="0" material="m"/>
<geom type="mesh" mesh="d" mass="0" contype="0" conaffinity="0"/><site name="t" pos="0 0 0"/></body></worldbody>
<actuator>{"".join(_MOTORS)}</actuator></mujoco>"""
_ADDED = {
    "body": """
        <joint name="j" type="hinge"/>
        <joint type="ball"/>
        <freejoint/>
        <geom size=".1"/>
        <geom type="mesh" mesh="no"/>
        <body><geom size=".1"/></body>
        <body><joint/><geom size=".1"/></body>
        <body mocap="true"/>
        <site name="s"/>
        <camera/>
        <light/>
        <inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
        <frame/>
        <replicate count="3"/>
        <plugin plugin="x"/>
        <body gravcomp="nan"><geom size=".1"/></body>
        <composite/>
        <flexcomp name="f"/>
        <attach model="x" body="y"/>
    """,
    "worldbody": """
        <body><freejoint/><geom size=".1"/></body>
        <body mocap="true"/>
        <geom size="1 1 .1" type="plane"/>
        <body><joint/><geom size=".1"/></body>
        <site name="t"/>
        <light/>
        <camera/>
        <replicate count="3000"><site/></replicate>
    """,
    "mujoco": """
        <equality><weld body1="box"/></equality>
        <equality><connect body1="box" anchor="0 0 0"/></equality>
        <tendon><spatial stiffness="9"><site site="t"/><site site="t"/></spatial></tendon>
        <option timestep="9" tolerance="1"/>
        <option><flag gravity="disable"/></option>
        <sensor><gyro site="t"/></sensor>
        <keyframe><key/></keyframe>
        <asset><mesh name="m" file="no.stl"/></asset>
        <asset><hfield name="h" nrow="9" ncol="9" size="1 1 1 1"/></asset>
        <asset><hfield name="h" nrow="90000" ncol="90000" size="1 1 1 1"/></asset>
        <include file="mine.xml"/>
        <asset><texture type="2d" builtin="flat" width="90000" height="90000"/></asset>
        <include file="/dev/zero"/>
        <default><geom mass="1"/></default>
        <compiler autolimits="false"/>
        <contact><exclude body1="box" body2="world"/></contact>
        <size memory="1K"/>
        <size memory="900G"/>
        <extension/>
        <statistic extent="0"/>
        <deformable/>
        <option wind="1 0 0"/>
        <option density="1000" viscosity="1"/>
        <option impratio="nan"/>
        <size nuserdata="900000000"/>
        <option gravity="nan 0 0"/>
    """,
    "actuator": """
        <motor joint="box"/>
        <general site="t" dyntype="filter"/>
        <velocity site="t" kv="3"/>
        <motor site="t" delay="1"/>
        <motor site="t" gear="1"/>
        <position site="t"/>
        <motor site="t" ctrlrange="5 -5"/>
        <adhesion body="box" ctrlrange="0 1"/>
        <motor body="box"/>
        <motor site="t" gear="1e300"/>
        <plugin plugin="mujoco.pid"/>
        <cylinder site="t"/>
    """,
    "custom": """
        <numeric name="M_A" data="1 2 3"/>
        <numeric name="x" size="500000" data="1"/>
        <numeric name="x" data="1"/>
        <numeric name="N_v" data="3"/>
        <numeric name="D_linear" data="1"/>
        <text name="a" data="b"/>
        <numeric name="X_u" data="-1"/>
        <numeric name="centre_of_buoyancy" data="0 0 0"/>
        <tuple name="t"/>
    """,
}
_ATTRIBUTES = {
    "body": "pos quat euler gravcomp mocap childclass simple user",
    "geom": "pos quat size mass density type mesh material group contype rgba fromto margin solref",
    "inertial": "fullinertia quat mass",
    "motor": "gear ctrlrange ctrllimited forcerange delay nsample refsite joint group class",
    "option": "timestep gravity solver iterations tolerance integrator cone density wind impratio noslip_iterations",
    "compiler": "angle eulerseq autolimits inertiafromgeom boundmass balanceinertia meshdir settotalmass usethread",
    "freejoint": "group align",
    "mesh": "file scale params refpos vertex face builtin",
    "numeric": "data size name",
}


def _attribute(rng: Random) -> str:
    if rng.random() < 0.7:
        return " ".join(repr(number(rng)) for _ in range(rng.choice((1, 1, 2, 3, 3, 4, 6, 21, 36))))
    return rng.choice(("", "true", "box", "nan nan nan", "1e999", "x" * 300, "☃", "mesh", "t", "0 0", "/dev/zero", "-"))


def vehicle(rng: Random) -> Case:
    """A run with a vehicle file that is mutated as text or by elements."""
    root = Path(__file__).parents[2] / "models" / "bluerov1.xml"
    data = root.read_bytes() if rng.random() < 0.2 else _BOX.encode()
    if rng.random() < 0.3:
        data = mutated_bytes(
            rng, data, (b"<", b">", b"/>", b'"', b"&", b"<!--", b"-->", b"&a;", b"\x00", b"\xff", b"<a>" * 500)
        )
    else:
        tree = ElementTree.fromstring(data)
        for _ in range(rng.choice((1, 1, 2, 4))):
            _change_element(rng, tree)
        data = ElementTree.tostring(tree)
    arguments = ("run", "--json", "-o", "out", "vehicle.model=mine.xml", "simulation.duration=0.004")
    contact = ("wall.position=1e-6", "reference.step_time=0") if rng.random() < 0.5 else ()
    return Case("vehicle", (*arguments, *contact), {"mine.xml": data})


def _change_element(rng: Random, tree: ElementTree.Element) -> None:
    elements = list(tree.iter())
    one, other = rng.choice(elements), rng.choice(elements)
    action = rng.randrange(5)
    if action <= 1 and one.attrib:
        key = rng.choice(list(one.attrib))
        old = one.attrib[key].split()
        with contextlib.suppress(ValueError):
            old = [repr(mild(rng, float(each))) for each in old]
        one.attrib[key] = " ".join(old) if rng.random() < 0.6 else _attribute(rng)
    elif action == 2 and one.tag in _ATTRIBUTES:
        one.attrib[rng.choice(_ATTRIBUTES[one.tag].split())] = _attribute(rng)
    elif action == 3 and len(one):
        child = rng.choice(list(one))
        piece = copy.deepcopy(child)  # the target may be inside the child
        one.remove(child)
        if rng.random() < 0.5:
            for _ in range(rng.choice((1, 2, 50))):
                other.append(copy.deepcopy(piece))
    else:
        parent = rng.choice(list(_ADDED))
        place = next(tree.iter(parent), tree)
        place.append(ElementTree.fromstring(rng.choice(_ADDED[parent].strip().splitlines())))
