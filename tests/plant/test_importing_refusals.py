"""Broken and hostile files of other formats: each is one message that names the place. Nothing is executed, and nothing
is read outside of the folders named."""

import re

import numpy as np
import pytest
from click.testing import CliRunner

from descriptions import PRODUCTS, THRUSTERS, read, sdf, table, urdf, words
from uvms_mj import InputError
from uvms_mj.cli import main
from uvms_mj.plant.importing import imported, xacro_files
from uvms_mj.plant.importing.xacro_files import computed

SDF, URDF, TOML = sdf(), urdf(), table("flu", "matrices", PRODUCTS)
HYDRO = re.search(r'<plugin filename="gz-sim-hydro.*?</plugin>', SDF, re.S)[0]
MODEL = re.search(r"<model .*</model>", SDF, re.S)[0]
BALL = """<link name="arm"><inertial><mass>1</mass></inertial></link><joint name="{n}" type="{kind}">
    <parent>{parent}</parent><child>arm</child><axis><xyz>0 1 0</xyz></axis></joint>"""
URDF_ARM = """<link name="arm"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
    </inertial></link><joint name="elbow" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
    <axis xyz="0 0 1"/><limit lower="{low}" upper="1" effort="1" velocity="1"/></joint>"""


def arm(kind="revolute", parent="fish/base_link", child="arm", low="-1"):
    return urdf(URDF_ARM.format(kind=kind, parent=parent, child=child, low=low))


NESTED = """<model name="pod" {0}><pose>0 0 1 0 0 0</pose><link name="k"><pose>1 0 0 0 0 0</pose></link></model>
    <joint name="weld" type="fixed"><parent>hull</parent><child>pod::k</child></joint>"""

BROKEN = {
    # suffix, text, place and reason
    "coefficient twice": (
        ".sdf",
        SDF.replace("<xDotU>", "<xDotU>-99</xDotU><xDotU>"),
        "<xDotU>",
        "is given twice",
    ),
    "a plugin of unknown conventions": (
        ".sdf",
        SDF.replace(HYDRO, re.sub(r"<plugin [^>]*>", '<plugin filename="MyHydrodynamics" name="my::Water">', HYDRO)),
        "<plugin name='my::Water'>",
        "whose conventions are not known",
    ),
    "mass twice": (
        ".sdf",
        SDF.replace("<mass>", "<mass>1</mass><mass>", 1),
        "<link name='hull'> <inertial> <mass>",
        "is given twice: keep one",
    ),
    "mass twice in URDF": (
        ".urdf",
        re.sub(r"(<mass [^>]*>)", r"\1<mass value='3'/>", URDF, count=1),
        "<inertial> <mass>",
        "is given twice: keep one",
    ),
    "two inertials": (
        ".sdf",
        re.sub(r"(<inertial>.*?</inertial>)", r"\1\1", SDF, count=1, flags=re.S),
        "<link name='hull'> <inertial>",
        "is given twice: keep one",
    ),
    "inertia in another frame": (
        ".sdf",
        SDF.replace("<inertial><pose>", '<inertial><pose relative_to="port">'),
        "<link name='hull'> <inertial> <pose>",
        "has relative_to",
    ),
    "model placed by a frame": (
        ".sdf",
        sdf(NESTED.format('placement_frame="k"')),
        "<model name='pod'>",
        "has a placement_frame",
    ),
    "no plugin": (".sdf", SDF.replace(HYDRO, ""), "<model name='fish'>", "no Hydrodynamics plugin"),
    "two models": (
        ".sdf",
        SDF.replace(MODEL, MODEL + MODEL.replace('"fish"', '"cod"')),
        "<sdf>",
        "2 models with hydrodynamics",
    ),
    "no model": (".sdf", "<sdf/>", "<sdf>", "it has no <model>"),
    "not closed": (".sdf", SDF[:-6], "source.sdf", "is not well-formed XML"),
    "entity": (".sdf", f'<!DOCTYPE sdf [<!ENTITY a "1">]>{SDF}', "source.sdf", "has a <!DOCTYPE>"),
    "external entity": (
        ".urdf",
        f'<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]>{URDF}',
        "source.urdf",
        "entities",
    ),
    "another root": (".sdf", "<html/>", "<html>", "is not the root of an SDF or URDF file"),
    "deep": (".sdf", "<sdf>" + "<a>" * 200 + "</a>" * 200 + "</sdf>", "source.sdf", "nested more than 100 deep"),
    "NaN": (
        ".sdf",
        SDF.replace("<mass>21.0</mass>", "<mass>nan</mass>"),
        "<inertial> <mass>",
        "must be a finite number",
    ),
    "infinite": (".sdf", SDF.replace("<xU>-5.0</xU>", "<xU>-1e400</xU>"), "<xU>", "must be a finite number"),
    "no number": (".sdf", SDF.replace("<xU>-5.0</xU>", "<xU>five</xU>"), "<xU>", "'five' is not a number"),
    "negative mass": (
        ".sdf",
        SDF.replace("<mass>21.0</mass>", "<mass>-2</mass>"),
        "<link name='hull'>",
        "must not be negative",
    ),
    "degrees": (".sdf", SDF.replace("<pose>0.01 0.005 0.02 0 0 0", "<pose>0 0 0 0 0 90"), "<pose>", "more than a turn"),
    "five numbers": (
        ".sdf",
        SDF.replace("<pose>0.01 0.005 0.02 0 0 0", "<pose>0 0 0 0 0"),
        "<pose>",
        "has 5 numbers; 6",
    ),
    "two links of one name": (".sdf", SDF.replace('name="port"', 'name="hull"'), "<link name='hull'>", "given twice"),
    "unknown link": (".sdf", SDF.replace("<link_name>hull", "<link_name>hul"), "<link_name>", "did you mean 'hull'?"),
    "unknown joint": (
        ".sdf",
        SDF.replace("<joint_name>port_joint", "<joint_name>prot_joint"),
        "<joint_name>",
        "did you mean",
    ),
    "no volume": (
        ".sdf",
        re.sub(r"<collision.*?</collision>", "", SDF, flags=re.S),
        "<link name='hull'>",
        "displaces no water",
    ),
    "unread mesh": (
        ".sdf",
        re.sub(r"<box>.*?</box>", "<mesh><uri>hull.dae</uri></mesh>", SDF, flags=re.S),
        "<link name='hull'>",
        "its mesh hull.dae is not read",
    ),
    "missing mesh": (
        ".sdf",
        re.sub(r"<box>.*?</box>", "<mesh><uri>hull.stl</uri></mesh>", SDF, flags=re.S),
        "<mesh>",
        "not there",
    ),
    "flat box": (".sdf", re.sub(r"<size>.*?</size>", "<size>1 0 1</size>", SDF), "<box>", "must be positive"),
    "loop": (
        ".sdf",
        SDF.replace("<joint ", BALL.format(n="a", kind="revolute", parent="hull") + "<joint ", 1).replace(
            "<joint ", '<joint name="b" type="revolute"><parent>port</parent><child>arm</child></joint><joint ', 1
        ),
        "<joint name='a'>",
        "loops of joints are not computed",
    ),
    "ball joint": (".sdf", sdf(BALL.format(n="a", kind="ball", parent="hull")), "<joint name='a'>", "is 'ball'"),
    "axis of no length": (
        ".sdf",
        sdf(BALL.format(n="a", kind="revolute", parent="hull").replace("0 1 0", "0 0 0")),
        "<xyz>",
        "has no length",
    ),
    "frames in a circle": (
        ".sdf",
        SDF.replace(
            "<link ",
            '<frame name="f"><pose relative_to="g">0 0 0 0 0 0</pose></frame>'
            '<frame name="g"><pose relative_to="f">0 0 0 0 0 0</pose></frame><link ',
            1,
        ).replace('<link name="port"><pose>', '<link name="port"><pose relative_to="f">'),
        "<frame name=",
        "leads back to",
    ),
    "asymmetric": (
        ".sdf",
        SDF.replace("<yDotR>-0.7</yDotR>", "<yDotR>-1.7</yDotR>"),
        "<link name='hull'>",
        "must be symmetric: row 2, column 6 has 1.7",
    ),
    "mixed signs": (".sdf", SDF.replace("<xU>-5.0</xU>", "<xU>5.0</xU>"), "Hydrodynamics", "wrong sign in X"),
    "added mass twice": (
        ".sdf",
        SDF.replace("</inertial>", "<fluid_added_mass><xx>1</xx></fluid_added_mass></inertial>", 1),
        "Hydrodynamics",
        "keep one",
    ),
    "network": (
        ".sdf",
        '<sdf><world name="w"><include><uri>https://a.b/m</uri><plugin name="Hydrodynamics"/></include></world></sdf>',
        "<include>",
        "a network is not read",
    ),
    "limits crossed": (
        ".sdf",
        SDF.replace("<min_thrust_cmd>-40.0", "<min_thrust_cmd>400"),
        "port_joint",
        "must be below",
    ),
    "negative inertia": (".sdf", SDF.replace("<ixx>0.5</ixx>", "<ixx>-0.5</ixx>"), "hull", "must be positive"),
    "urdf without hydrodynamics": (
        ".urdf",
        re.sub(r'<plugin name="uuv".*?</plugin>', "", URDF, flags=re.S),
        "<robot>",
        "no libuuv_underwater_object plugin",
    ),
    "urdf of cad": (
        ".urdf",
        '<robot name="frame"><link name="base"><inertial><mass value="13"/><inertia ixx="1" iyy="1" izz="1" ixy="0" '
        'ixz="0" iyz="0"/></inertial></link></robot>',
        "<robot>",
        "without coefficients of the water, as from CAD, it is no vehicle: give its numbers and theirs in a table",
    ),
    "35 numbers": (".urdf", re.sub(r"<added_mass>\S+", "<added_mass>", URDF), "<added_mass>", "has 35 numbers; 36"),
    "unknown type": (".urdf", URDF.replace("fossen", "spheroid"), "<type>", "'spheroid' is not read"),
    "no buoyancy": (
        ".urdf",
        re.sub(r"<volume>.*?</volume>", "", URDF),
        "<link name='fish/base_link'>",
        "has no <volume>",
    ),
    "negative volume": (".urdf", URDF.replace("<volume>", "<volume>-"), "<volume>", "must be positive"),
    "missing package": (
        ".urdf",
        URDF.replace(
            "</inertial>",
            '</inertial><collision><geometry><mesh filename="package://rov/a.stl"/></geometry></collision>',
            1,
        ),
        "<mesh>",
        "name its folder with --package rov=FOLDER",
    ),
    "circle of links": (
        ".urdf",
        arm(parent="arm", child="fish/base_link").replace('kind="x"', ""),
        "<joint name='elbow'>",
        "moves 'fish/base_link'",
    ),
    "itself": (".urdf", arm(parent="arm"), "<joint name='elbow'>", "with itself"),
    "unknown parent": (".urdf", arm(parent="nobody"), "<joint name='elbow'>", "'nobody', which is not in the file"),
    "floating": (".urdf", arm(kind="floating"), "<joint name='elbow'>", "is 'floating'"),
    "degrees in limits": (".urdf", arm(low="-90"), "<limit>", "URDF has radians"),
    "massless": (".urdf", arm().replace('<mass value="1"/>', '<mass value="0"/>'), "<link name='arm'>", "has no mass"),
    "surface vessel": (
        ".urdf",
        urdf().replace(
            "<hydrodynamic_model>",
            "<metacentric_width>1</metacentric_width>"
            "<metacentric_length>1</metacentric_length><submerged_height>1</submerged_height><hydrodynamic_model>",
        ),
        "<link name='fish/base_link'>",
        "surface vessel",
    ),
    "no thruster": (
        ".urdf",
        re.sub(r'<joint name="fish/(port|sta|ver|lat).*?</gazebo>', "", URDF, flags=re.DOTALL),
        "thrusters",
        "--thrusters",
    ),
    "table without a frame": (".toml", TOML.replace('frame = "flu"', ""), "frame", "lacks this key"),
    "table of another frame": (
        ".toml",
        TOML.replace('frame = "flu"', 'frame = "enu"'),
        "frame",
        "must be 'flu' or 'ned'",
    ),
    "unknown key": (".toml", TOML.replace("cb =", "cbb ="), "body.cbb", "did you mean 'cb'?"),
    "products of inertia": (".toml", re.sub("products_of_inertia.*", "", TOML), "body", "matrix"),
    "unknown derivative": (
        ".toml",
        re.sub(r"\[linear_damping\]\nmatrix = .*", "[linear_damping]\nX_uu = 1", TOML),
        "linear_damping.X_uu",
        "is no derivative",
    ),
    "unknown product": (".toml", TOML.replace('"Yur"', '"Yuuu"'), "products.Yuuu", "no product of velocities"),
    "not TOML": (".toml", TOML.replace("[body]", "[body"), "source.toml", "is not TOML"),
    "csv without a head": (".csv", "a,b\n1,2\n", "row 1", "the head must be key, value"),
    "csv twice": (".csv", "key,value\nframe,flu\nframe,ned\n", "row 3", "given twice"),
    "MATLAB": (".m", "M = eye(6);", "source.m", "lacks the mass"),
    "MATLAB's data": (".mat", "MATLAB 5.0", "source.mat", "nothing is executed or guessed"),
    "Python": (".py", "import os; os.abort()", "source.py", "lacks the mass"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_is_one_message_that_names_the_place(tmp_path, case):
    suffix, text, place, reason = BROKEN[case]
    path = tmp_path / f"source{suffix}"
    path.write_text(text)
    done = CliRunner().invoke(main, ["new", "vehicle", "mine", "--from", str(path), "--out", str(tmp_path)])
    assert done.exit_code == 2, done.output
    assert done.stderr.count("\n") == 1
    assert place in done.stderr
    assert reason in done.stderr
    assert not (tmp_path / "mine.xml").exists()


def test_a_whole_file_passes(tmp_path):
    """The tests above fail by what they change."""
    for suffix, text in ((".sdf", SDF), (".urdf", URDF), (".toml", TOML), (".urdf", arm())):
        read(tmp_path, suffix, text)


@pytest.mark.parametrize(("suffix", "text", "root"), [(".sdf", SDF, "<sdf"), (".urdf", URDF, "<robot")])
def test_a_namespace_without_a_prefix_changes_nothing(tmp_path, suffix, text, root):
    plain, _ = read(tmp_path, suffix, text)
    spaced, _ = read(tmp_path, suffix, text.replace(root, f"{root} xmlns='http://example.org/any'", 1))
    for each in ("mass", "displaced_mass", "M_A", "D_linear", "I_g"):
        np.testing.assert_array_equal(getattr(spaced.base, each), getattr(plain.base, each))


def test_squares_of_the_lrauv_are_damping_in_both_directions(tmp_path):
    """The plugin of the LRAUV writes xUU for X_u|u|, where gz-sim writes xUabsU."""
    squares = re.sub(r"([xyzkmn])([UVWPQR])abs\2", r"\1\2\2", HYDRO)
    assert squares != HYDRO
    own = re.sub(
        r"<plugin [^>]*>", '<plugin filename="HydrodynamicsPlugin" name="tethys::HydrodynamicsPlugin">', squares
    )
    wanted, found = (read(tmp_path, ".sdf", SDF.replace(HYDRO, each))[0] for each in (HYDRO, own))
    np.testing.assert_array_equal(found.base.D_quadratic, wanted.base.D_quadratic)
    assert np.diag(wanted.base.D_quadratic).all()
    assert any("on abs(u) u" in each for each in found.left_out)


@pytest.mark.parametrize("suffix", [".sdf", ".toml", ".urdf"])
def test_a_huge_file_is_not_read(tmp_path, suffix):
    path = tmp_path / f"huge{suffix}"
    with path.open("wb") as file:
        file.truncate(11 * 2**20)
    with pytest.raises(InputError, match="is larger than 10 MiB"):
        imported(path, "mine")


def test_a_file_that_is_not_text_or_not_there(tmp_path):
    (tmp_path / "a.sdf").write_bytes(b"\xff\xfe<\0s\0")
    with pytest.raises(InputError, match="is not text in UTF-8"):
        imported(tmp_path / "a.sdf", "mine")
    with pytest.raises(InputError, match="there is no such file"):
        imported(tmp_path / "b.sdf", "mine")


@pytest.mark.parametrize("uri", ["../secret.stl", "file:///etc/hull.stl", "model://fish/../../secret.stl"])
def test_a_mesh_outside_of_the_folders_is_not_read(tmp_path, uri):
    inside = tmp_path / "in"
    inside.mkdir()
    (tmp_path / "secret.stl").write_bytes(b"secret")
    text = re.sub(r"<box>.*?</box>", f"<mesh><uri>{uri}</uri></mesh>", SDF, flags=re.S)
    with pytest.raises(InputError, match="is in none of the folders named"):
        read(inside, ".sdf", text, packages={"fish": inside})


def test_a_name_that_cant_be_looked_up_is_refused(tmp_path):
    (tmp_path / "loop.stl").symlink_to("loop.stl")
    for name in ("a" * 5000 + ".stl", "loop.stl"):
        body = f"<collision name='m'><geometry><mesh><uri>{name}</uri></mesh></geometry></collision></link>"
        with pytest.raises(InputError, match=r"<mesh>: refers to .*, which "):
            read(tmp_path, ".sdf", SDF.replace("</link>", body, 1))


def test_a_link_that_leads_out_of_the_folder_is_not_followed(tmp_path):
    inside = tmp_path / "in"
    inside.mkdir()
    (tmp_path / "secret.stl").write_bytes(b"secret")
    (inside / "hull.stl").symlink_to(tmp_path / "secret.stl")
    text = re.sub(r"<box>.*?</box>", "<mesh><uri>hull.stl</uri></mesh>", SDF, flags=re.S)
    with pytest.raises(InputError, match="is in none of the folders named"):
        read(inside, ".sdf", text)


# xacro

ROBOT = '<robot name="fish" xmlns:xacro="http://www.ros.org/wiki/xacro">'


def as_xacro():
    """The URDF with a macro for its thrusters, properties, an argument, a condition and an included file."""
    text = URDF
    for place, _, _ in THRUSTERS.values():
        text = text.replace(
            f'xyz="{words(place)}"', f'xyz="${{{"+".join(map(str, (place[0], 0)))}}} {words(place[1:])}"', 1
        )
    head = f"""{ROBOT}<xacro:arg name="mass" default="20"/><xacro:property name="extra" value="${{2 - 1.0}}"/>
        <xacro:include filename="$(find parts)/empty.xacro"/>
        <xacro:if value="${{extra == 1}}"><xacro:empty n="${{sin(pi/2)}}"/></xacro:if>"""
    return text.replace('<robot name="fish">', head).replace(
        '<mass value="21.0"/>', '<mass value="${$(arg mass) + extra}"/>'
    )


@pytest.fixture
def parts(tmp_path):
    pytest.importorskip("xacro")
    folder = tmp_path / "parts"
    folder.mkdir()
    (folder / "empty.xacro").write_text(
        f'{ROBOT}<xacro:macro name="empty" params="n"><link name="l${{int(n)}}"/></xacro:macro></robot>'
    )
    return folder


def test_xacro_is_the_urdf_that_it_expands_to(tmp_path, parts):
    record, vehicle = read(tmp_path, ".xacro", as_xacro(), packages={"parts": parts})
    _, plain = read(tmp_path, ".urdf", URDF)
    np.testing.assert_allclose(vehicle.M_RB, plain.M_RB, atol=1e-12)
    np.testing.assert_allclose(vehicle.B, plain.B, atol=1e-12)
    assert any("hang on no joint" in each or "mass" in each for each in record.left_out)


HOSTILE = {
    "class": ("${().__class__.__bases__}", "is not computed"),
    "call": ("${python.vars()}", "is not computed"),
    "format": ("${'a'.upper()}", "is not computed"),
    "lambda": ("${(lambda: 1)()}", "is not computed"),
    "list": ("${[1 for i in range(9)]}", "is not computed"),
    "power": ("${9**9**9}", "an exponent of at most"),
    "long": ("${'a' * 1000000}", "arithmetic is with numbers"),
    "yaml": ("${load_yaml('/etc/passwd')}", "is not computed"),
    "namespace": ("${xacro.load_yaml('/etc/passwd')}", "is not computed"),
    "environment": ("$(env HOME)", "nothing of the environment is read"),
    "optional": ("$(optenv HOME x)", "nothing of the environment is read"),
    "eval": ("$(eval os.abort)", "is not computed"),
    "unknown": ("${nothing + 1}", "'nothing' is no property"),
    "argument": ("$(arg nobody)", "has no default"),
    "package": ("$(find nobody)", "--package nobody=FOLDER"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_nothing_of_xacro_is_executed(tmp_path, parts, case):
    expression, reason = HOSTILE[case]
    text = as_xacro().replace("${2 - 1.0}", expression).replace("extra == 1", "extra == extra")
    with pytest.raises(InputError, match=re.escape(reason)) as raised:
        read(tmp_path, ".xacro", text, packages={"parts": parts})
    assert str(raised.value).count("\n") == 0


@pytest.mark.parametrize("included", ["/etc/passwd", "../../outside.xacro", "$(find parts)/../../outside.xacro"])
def test_xacro_includes_no_file_outside_of_the_folders(tmp_path, parts, included):
    inside = tmp_path / "a" / "b"
    inside.mkdir(parents=True)
    (tmp_path / "outside.xacro").write_text(f"{ROBOT}</robot>")
    (tmp_path / "a" / "outside.xacro").write_text(f"{ROBOT}</robot>")
    (inside / "parts").mkdir()
    text = f'{ROBOT}<xacro:include filename="{included}"/></robot>'
    with pytest.raises(InputError, match="is in none of the folders named"):
        read(inside, ".xacro", text, packages={"parts": inside / "parts"})


def test_macros_that_never_end_are_refused(tmp_path, parts, monkeypatch):
    monkeypatch.setattr(xacro_files, "MOST_MACROS", 5_000)
    endless = '<xacro:macro name="a" params=""><xacro:a/></xacro:macro><xacro:a/>'
    doubling = "".join(
        f'<xacro:macro name="m{i}" params=""><xacro:m{i + 1}/><xacro:m{i + 1}/></xacro:macro>' for i in range(40)
    )
    for text in (endless, f'<xacro:macro name="m40" params=""/>{doubling}<xacro:m0/>'):
        with pytest.raises(InputError):
            read(tmp_path, ".xacro", f"{ROBOT}{text}</robot>", packages={"parts": parts})


def test_an_entity_in_an_included_file_is_refused(tmp_path, parts):
    (parts / "empty.xacro").write_text(f'<!DOCTYPE r [<!ENTITY a "1">]>{ROBOT}</robot>')
    with pytest.raises(InputError, match="entities are not read"):
        read(tmp_path, ".xacro", as_xacro(), packages={"parts": parts})


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("2*pi/4", np.pi / 2),
        ("-a**2 + 3", -1.0),
        ("1 if a > 1 else 5", 1),
        ("radians(180) == pi and not (a != 2)", True),
        ("max(a, 7) % 4", 3),
        ("'x' + str(1)", "x1"),
        ("math.sqrt(a*2)", 2.0),
    ],
)
def test_expressions_are_arithmetic(expression, value):
    assert computed(expression, {"a": 2}) == value


def test_packages_are_folders(tmp_path):
    (tmp_path / "a.sdf").write_text(SDF)
    for given in ("parts", "parts=nowhere"):
        done = CliRunner().invoke(main, ["new", "vehicle", "m", "--from", str(tmp_path / "a.sdf"), "--package", given])
        assert done.exit_code == 2
        assert "must be NAME=FOLDER" in done.stderr
    done = CliRunner().invoke(main, ["new", "vehicle", "m", "--from", "bluerov1", "--drag", "d.csv"])
    assert done.exit_code == 2
    assert "--drag: is for a vehicle from a file" in done.stderr


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("axis,speed_m_s,force_N\nsurge,1,2\n", "surge: has one speed in 1 rows"),
        ("axis,speed_m_s,force_N\nsurge,1,-2\nsurge,2,4\n", "row 2: speed 1 and force -2"),
        ("axis,speed,force_N\n", "row 1: the columns are"),
        ("axis,speed_m_s,force_N\nsruge,1,2\n", "did you mean 'surge'?"),
        ("axis,speed_m_s,force_N\nsurge,1\n", "row 2: has 2 values"),
        ("axis,speed_m_s,force_N\nsurge,one,2\n", "are not both numbers"),
        ("axis,speed_m_s,force_N\n", "has no row"),
    ],
)
def test_a_broken_table_of_drag_names_its_row(tmp_path, text, said):
    (tmp_path / "drag.csv").write_text(text)
    with pytest.raises(InputError, match=re.escape(said)):
        read(tmp_path, ".sdf", SDF, drag=tmp_path / "drag.csv")
