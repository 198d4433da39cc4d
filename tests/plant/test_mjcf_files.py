"""A vehicle's files are those that MuJoCo reads; only regular files of bounded size are read."""

import os
import re
import struct
from pathlib import Path

import mujoco
import numpy as np
import pytest

from edited_vehicles import CUBE, INERTIAL, SHIPPED, edited, mjcf, plant, with_end
from uvms_mj import InputError
from uvms_mj.plant import mjcf as mjcf_module
from uvms_mj.plant.mjcf import Mjcf

ROOT = Path(__file__).parents[2]
SUB = b"<mujoco><asset><model name='m' file='%s'/></asset></mujoco>"


@pytest.mark.parametrize(
    ("files", "text"),
    [
        ({}, "<include file='bluerov1.xml'/>"),
        ({"a.xml": b"<mujoco><include file='bluerov1.xml'/></mujoco>"}, "<include file='a.xml'/>"),
        ({"a.xml": SUB % b"a.xml"}, "<asset><model file='a.xml'/></asset>"),
        ({"a.xml": SUB % b"b.xml", "b.xml": SUB % b"a.xml"}, "<asset><model file='a.xml'/></asset>"),
        ({f"{i}.xml": SUB % b"%d.xml" % (i + 1) for i in range(300)}, "<asset><model file='0.xml'/></asset>"),
        ({}, f"<default>{'<default>' * 3000}{'</default>' * 3000}</default>"),
    ],
)
def test_a_model_that_includes_itself_or_has_no_bottom_is_refused(files, text):
    """MuJoCo would look for the file on disk, or overflow its stack."""
    model = (ROOT / "models" / "bluerov1.xml").read_text().replace("</mujoco>", f"{text}</mujoco>")
    with pytest.raises(InputError, match=r"includes itself|missing files|elements nested|sub-models"):
        Mjcf("bluerov1.xml", {"bluerov1.xml": model.encode()} | files).spec()


@pytest.mark.parametrize(
    ("main", "sub"),
    [
        ('<compiler meshdir="m"/><asset><mesh file="a.obj"/><model file="sub/s.xml"/></asset>', '<mesh file="a.obj"/>'),
        ('<asset><mesh file="m/a.obj"/><model file="sub/s.xml"/></asset>', '<mesh file="a.obj"/>'),
        ('<compiler meshdir="n"/><compiler meshdir="m"/><asset><mesh file="a.obj"/></asset>', ""),
        ('<compiler meshdir="n"/><compiler assetdir="m"/><asset><mesh file="a.obj"/></asset>', ""),
        ('<compiler strippath="true"/><asset><mesh file="m/a.obj"/></asset>', ""),
        ('<compiler texturedir="n"/><asset><mesh file="a.obj"/></asset>', ""),
    ],
)
def test_a_name_means_the_file_that_mujoco_takes(tmp_path, main, sub):
    """Several files have the same name. The last folder set by a model counts, and a sub-model has its own folder."""
    for i, folder in enumerate((".", "m", "n", "sub", "sub/m")):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / "a.obj").write_text(TETRAHEDRON.format(0.1 + 0.1 * i))
    attach = '<frame><attach model="s" body="b" prefix="s_"/></frame>' if sub else ""
    geom = '<geom type="mesh" mesh="a"/>'
    body = f'<worldbody><body name="b">{geom if sub else ""}</body></worldbody>'
    (tmp_path / "sub" / "s.xml").write_text(f'<mujoco model="s"><asset>{sub}</asset>{body}</mujoco>')
    (tmp_path / "v.xml").write_text(
        f"<mujoco>{main}<worldbody><body><freejoint/>{geom}</body>{attach}</worldbody></mujoco>"
    )
    plain, mjcf = mujoco.MjModel.from_xml_path(str(tmp_path / "v.xml")), Mjcf.find(str(tmp_path / "v.xml"))
    for file in sorted(tmp_path.rglob("*.*")):
        file.unlink()
    ours = mjcf.compiled(mjcf.spec())
    assert np.array_equal(ours.mesh_vert, plain.mesh_vert)
    assert ours.names == plain.names


TETRAHEDRON = "v 0 0 0\nv {0} 0 0\nv 0 {0} 0\nv 0 0 {0}\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("files", "assets"),
    [
        ({"a.obj": 0.1, "two/a.obj": 0.2}, '<mesh name="p" file="a.obj"/><mesh name="q" file="two/a.obj"/>'),
        ({"a.obj": 0.1, "m/a.obj": 0.2}, '<mesh name="p" file="m/../a.obj"/><mesh name="q" file="m/a.obj"/>'),
        ({"m/a.obj": 0.1, "m/A.obj": 0.2}, '<mesh name="p" file="m/a.obj"/><mesh name="q" file="m/A.obj"/>'),
        ({"z/p.obj": 0.1, "n/p.obj": 0.2}, '<mesh file="z/p.obj"/><mesh name="q" file="n/p.obj"/>'),
        ({"a & 'b' ü.obj": 0.1, "q.obj": 0.2}, '<mesh name="p" file="a &amp; \'b\' ü.obj"/><mesh file="q.obj"/>'),
        ({"p.obj": 0.1, "q.obj": 0.2}, "<!-- file=' -- --><mesh file='p.obj'/><!-- don't --><mesh file='q.obj'/>"),
        ({"p.obj": 0.1, "q.obj": 0.2}, '<mesh file="p.obj"/><mesh file="q.obj"/><!-- <mesh file="/gone.obj"/> -->'),
    ],
)
def test_a_vehicle_of_many_files_is_the_one_that_mujoco_reads(tmp_path, files, assets):
    """With folders, repeated names and comments, the model in memory has the meshes of the model on disk."""
    geoms = "<geom type='mesh' mesh='p' mass='0'/><geom type='mesh' mesh='q' mass='0'/><freejoint"
    model = (ROOT / "models" / "bluerov1.xml").read_text().replace("</asset>", f"{assets}</asset>", 1)
    model = model.replace("<freejoint", geoms, 1)
    for name, size in files.items():
        (tmp_path / "sub" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "sub" / name).write_text(TETRAHEDRON.format(size))
    (tmp_path / "sub" / "rov.xml").write_text(model)
    (tmp_path / "rov.xml").write_text('<mujoco><option gravity="0 0 -1.6"/><include file="sub/rov.xml"/></mujoco>')
    for path in (tmp_path / "sub" / "rov.xml", tmp_path / "rov.xml"):
        if path.parent == tmp_path:  # MuJoCo looks for the meshes of an included file next to the main one
            model = re.sub(r"<compiler ", "<compiler meshdir='sub' ", model, count=1)
            (tmp_path / "sub" / "rov.xml").write_text(model)
        plain, mjcf = mujoco.MjModel.from_xml_path(str(path)), Mjcf.find(str(path))
        ours = mjcf.compiled(mjcf.spec())
        assert ours.opt.gravity[2] == plain.opt.gravity[2]
        assert ours.nu == plain.nu
        assert np.array_equal(ours.mesh_vert, plain.mesh_vert)
        assert not any("sub" in name for name in mjcf.files)


def test_a_mesh_is_that_of_its_own_vehicle_whatever_was_read_before():
    """Vehicles whose mesh files have the same name, one after the other: the longest edge is sqrt(2) times the leg."""
    text = edited("</asset>", '<mesh name="m" file="hull.obj"/></asset>')
    text = text.replace(INERTIAL, f'<geom type="mesh" mesh="m" mass="0"/>{INERTIAL}')
    for size in (0.1, 0.2, 0.3, 0.2):
        hull = TETRAHEDRON.format(size).encode()
        model = Mjcf("mine.xml", {"mine.xml": text.encode(), "hull.obj": hull})
        compiled = model.compiled(model.spec())
        mesh = compiled.mesh("m").id
        start, n = compiled.mesh_vertadr[mesh], compiled.mesh_vertnum[mesh]
        sizes = np.linalg.norm(np.diff(compiled.mesh_vert[start : start + n], axis=0), axis=1)
        assert sizes.max() == pytest.approx(np.sqrt(2) * size, rel=1e-6)


def test_a_part_from_another_file_is_checked_and_counted():
    part = '<mujoco model="p"><worldbody><body name="p"><geom size=".1" mass="1"/>{}</body></worldbody></mujoco>'
    text = edited("<asset>", '<asset><model name="p" file="p.xml"/>')
    text = text.replace(INERTIAL, '<attach model="p" body="p" prefix="a_"/>' + INERTIAL)
    assert plant(text, p=part.format("").encode()).vehicle.mass == pytest.approx(8.31)
    with pytest.raises(InputError, match=r'<joint stiffness="3"> in p\.xml'):
        plant(text, p=part.format('<joint stiffness="3"/>').encode())
    numeric = b'<mujoco><custom><numeric name="X_u" data="-1"/></custom>'
    with pytest.raises(InputError, match="a_X_u: is not a coefficient"):
        plant(
            text, p=part.format("").encode().replace(b'<mujoco model="p">', numeric.replace(b"jo>", b'jo model="p">'))
        )
    many = '<replicate count="90" sep="-"><attach model="p" body="p" prefix="b_"/></replicate>' + INERTIAL
    with pytest.raises(InputError, match="counting each copy by <replicate> and <attach>"):
        plant(text.replace(INERTIAL, many), p=part.format("<site/>" * 200).encode())
    with pytest.raises(InputError, match="must not have sub-models itself"):
        plant(text, p=b'<mujoco><asset><model file="q.xml"/></asset></mujoco>', q=b"<mujoco/>")


def reading(path: Path, text: str) -> Mjcf:
    (path / "mine.xml").write_text(text)
    return Mjcf.find(str(path / "mine.xml"))


@pytest.fixture
def odd(tmp_path):
    """A folder with files that are not regular, or are too large."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "pipe")
    (tmp_path / "zero").symlink_to("/dev/zero")
    (tmp_path / "folder").mkdir()
    with open(tmp_path / "sparse", "wb") as file:
        file.truncate(2**40)
    return tmp_path


@pytest.mark.parametrize("element", ['<include file="{}"/>', '<asset><mesh name="m" file="{}"/></asset>'])
@pytest.mark.parametrize("name", ["pipe", "link", "zero", "/dev/zero", "/dev/tty", "folder", "sparse", "gone"])
def test_only_regular_files_of_a_sane_size_are_read(odd, name, element):
    """Other files may be endless, or block for ever."""
    with pytest.raises(InputError, match=f"can't read .*{name}: (it is not a regular|it is larger|Is a dir|No such)"):
        reading(odd, with_end(element.format(name)))


def test_a_pipe_is_not_passed_over_for_a_file_of_its_name_elsewhere(odd):
    """MuJoCo would open the pipe and block."""
    (odd / "meshes").mkdir()
    os.mkfifo(odd / "meshes" / "a.obj")
    (odd / "a.obj").write_bytes(CUBE)
    text = edited("</asset>", '<mesh name="m" file="a.obj"/></asset>').replace(
        "<compiler ", '<compiler meshdir="meshes" '
    )
    with pytest.raises(InputError, match=r"a\.obj: it is not a regular file"):
        reading(odd, text)


@pytest.mark.parametrize("name", ["pipe", "link", "zero", "folder", "sparse"])
def test_a_vehicle_is_a_regular_file(odd, name):
    with pytest.raises(InputError, match=r"is not a regular file|it is larger than 64 MiB"):
        Mjcf.find(str(odd / name))


def test_all_files_together_have_a_sane_size(tmp_path, monkeypatch):
    meshes = "".join(f'<mesh name="m{i}" file="m{i}.obj"/>' for i in range(4))
    for i in range(4):
        (tmp_path / f"m{i}.obj").write_bytes(CUBE + b"#" * 30_000)
    text = edited("</asset>", f"{meshes}</asset>")
    assert len(reading(tmp_path, text).files) == 5
    monkeypatch.setattr(mjcf_module, "LARGEST_MODEL", 100_000)
    (tmp_path / "m0.obj").write_bytes(CUBE + b"#" * 30_001)  # otherwise nothing is read again
    with pytest.raises(InputError, match="are together larger"):
        reading(tmp_path, text)
    monkeypatch.setattr(mjcf_module, "LARGEST_XML", 10_000)
    with pytest.raises(InputError, match="too large for an XML file"):
        mjcf(SHIPPED).spec()


def test_a_picture_of_billions_of_pixels_is_not_unpacked():
    head = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + struct.pack(">II5B", 99_000, 99_000, 8, 2, 0, 0, 0)
    text = edited("<asset>", '<asset><texture name="t" type="2d" file="t.png"/>')
    with pytest.raises(InputError, match=r"t\.png: has 99000 x 99000 pixels"):
        Mjcf("mine.xml", {"mine.xml": text.encode(), "t.png": head}).spec()


@pytest.mark.parametrize(
    ("element", "expected"),
    [('<include file="{0}"/><include file="{0}"/>', "included twice"), ("<asset>{}</asset>", "not have sub-models")],
)
def test_files_that_name_each_other_again_and_again_are_refused_at_once(tmp_path, element, expected):
    """If 40 files each name the next one twice, following every reference would read 2^40 files."""
    if "asset" in element:
        element = element.format('<model name="a" file="{0}"/><model name="b" file="{0}"/>')
    for i in range(40):
        (tmp_path / f"{i}.xml").write_text(f"<mujoco>{element.format(f'{i + 1}.xml')}</mujoco>")
    (tmp_path / "40.xml").write_text("<mujoco/>")
    with pytest.raises(InputError, match=expected):
        reading(tmp_path, with_end(element.format("0.xml"))).spec()
