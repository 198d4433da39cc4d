"""Forged logs run nothing, reach no file and use bounded time and memory."""

import contextlib
import json
import os
import re
import struct
import time
from pathlib import Path

import pytest

from forked import done as forked
from recorded import rewritten
from uvms_mj import Controller, InputError, Trace
from uvms_mj.records.mcap.attachments import refuse_large
from uvms_mj.stages.loader import placeholder_stage


@pytest.mark.parametrize(
    "change",
    [
        lambda name, data: (f"../../{name}", data),
        lambda name, data: (name, data.replace(b"format", b"fromat")),
        lambda name, data: (name, data.replace(b"stiffness = 100000.0", b"stiffness = -1.0")),
        lambda name, data: (name, data.replace(b'"row_steps": 10', b'"row_steps": 20')),
        lambda name, data: (name, data.replace(b'"gsta"', b'"/bin/sh.py:Law"')),
        lambda name, data: (name, data.replace(b'name = "gsta"', b'name = "os.py:Law"')),
        lambda name, data: (name, data.replace(b'"perfect"', b'"/bin/sh.py:Law"')),
        lambda name, data: (name, data.replace(b'name = "perfect"', b'name = "os.py:Law"')),
        lambda name, data: (name, data.replace(b'"navigation": {', b'"sensors": {')),
        lambda name, data: (name, b"[" * 100_000 if name == "run.json" else data),
        lambda name, data: (name, b'{"a":' * 50_000 if name == "geometry.json" else data),
        lambda name, data: (name, b"a = " + b"[" * 50_000 if name == "scenario.toml" else data),
        lambda name, data: (name, b"a" + b".a" * 50_000 + b" = 1" if name == "scenario.toml" else data),
        lambda name, data: (name, data.replace(b'model = "bluerov1"', b'model = "/etc/passwd"')),
        lambda name, data: (name, data.replace(b"duration = 0.4", b"duration = " + b"9" * 5000)),
        lambda name, data: (name, data.replace(b'"name": "t"', b'"name": "T"')),
        lambda name, data: (name, data.replace(b'"name": "nu"', b'"name": "s"')),
        lambda name, data: (name, data.replace(b'"unit": "m"', b'"unit": "mm"')),
        lambda name, data: (name, data.replace(b'"z": 6', b'"z": 7')),
        lambda name, data: (name, re.sub(rb'("name": "p_WB",\s*"shape": \[\s*)3', rb"\g<1>4", data)),
        lambda name, data: (
            name,
            re.sub(rb'("name": "p_WB",\s*"shape": \[\s*)3', rb"\g<1>" + b"9, " * 50 + b"9", data),
        ),
    ],
)
def test_a_forged_log_is_refused_and_writes_nothing(logged, tmp_path, change):
    forged = tmp_path / "in" / "deep" / "forged.mcap"
    forged.parent.mkdir(parents=True)
    forged.write_bytes(rewritten(logged[1], change))
    start = time.monotonic()
    with pytest.raises(InputError):
        Trace.load(forged)
    assert time.monotonic() - start < 5.0
    assert list(tmp_path.rglob("*")) == [tmp_path / "in", forged.parent, forged]


def test_a_recorded_law_has_gains_with_names_that_python_can_tell_apart():
    for table in ({"ℯ": 1.0, "e": 1.0}, {"class": 1.0}, {"__init__": 1.0}, {"x": "text"}, {"1": 1.0}):
        with pytest.raises(InputError, match=r"a\.py:B"):
            placeholder_stage(Controller, "a.py:B", table, {})


def test_opening_a_forged_log_imports_no_file_that_it_names(logged, tmp_path, here):
    (tmp_path / "evil.py").write_text("from pathlib import Path\nPath('ran').touch()\n")
    for law in ("evil.py:X", f"{tmp_path}/evil.py:X"):
        for names in ("scenario.toml", "run.json", "run.json scenario.toml"):

            def change(name, data, names=names, law=law):
                return name, data.replace(b'"gsta"', f'"{law}"'.encode()) if name in names else data

            Path("forged.mcap").write_bytes(rewritten(logged[1], change))
            with contextlib.suppress(InputError):  # a user's law named in both files is shown
                assert Trace.load("forged.mcap").scenario.controller.source() == law
            assert not escaped(here("info", "forged.mcap"))
            assert here("run", "--from", "forged.mcap", "-q").exit_code == 2
    assert not (tmp_path / "ran").exists()


def escaped(done):
    """Whether a command ended by an exception that is not its exit."""
    return not isinstance(done.exception, SystemExit | None)


MESH = "<asset><mesh name='canary' file='{}'/></asset>"


def _appended(model, text):
    return model.replace("</mujoco>", f"{text}</mujoco>")


EVASIONS = {
    "as it stands": lambda model, name: model.replace("</asset>", f'<mesh name="m" file="{name}"/></asset>'),
    "byte order mark": lambda model, name: "\ufeff" + _appended(model, MESH.format(name)),
    "dashes in a comment": lambda model, name: "<!-- a -- b -->" + _appended(model, MESH.format(name)),
    "an attribute twice": lambda model, name: _appended(model, "<size a='1' a='2'/>" + MESH.format(name)),
    "a final nul": lambda model, name: _appended(model, MESH.format(name)) + "\0",
    "a quote in a comment": lambda model, name: _appended(
        model, "<!-- file=' -->" + MESH.format(name).replace("'", '"') + "<!-- ' -->"
    ),
    "no semicolon": lambda model, name: _appended(model, MESH.format(name.replace("/", "&#47"))),
    "characters by number": lambda model, name: _appended(model, MESH.format(name.replace("/", "&#x2F;"))),
    "an entity": lambda model, name: f"<!DOCTYPE m [<!ENTITY e '{name}'>]>" + _appended(model, MESH.format("&e;")),
    "character data": lambda model, name: _appended(model, f"<![CDATA[ <x a=' ]]>{MESH.format(name)}"),
    "an include": lambda model, name: _appended(model, f"<include\tfile\n=\n'{name}'/>"),
    "another robot": lambda model, name: f"<robot><link><visual><mesh filename='{name}'/></visual></link></robot>",
    "a folder": lambda model, name: _appended(
        model.replace("<compiler ", f"<compiler meshdir='{Path(name).parent}' "), MESH.format(Path(name).name)
    ),
}
"""MuJoCo finds the file's name in each of these; a search for names in the text may miss it."""


@pytest.mark.parametrize("evasion", EVASIONS)
def test_a_model_in_a_log_reaches_no_file_however_it_is_written(logged, tmp_path, here, evasion):
    """MuJoCo reads XML that was written anew from the checked trees."""
    secret = tmp_path / "secret.obj"
    secret.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")

    def change(name, data):
        return name, EVASIONS[evasion](data.decode(), f"{secret}").encode() if name.startswith("model/") else data

    (tmp_path / "forged.mcap").write_bytes(rewritten(logged[1], change))
    done = here("run", "--from", "forged.mcap", "-q", "-o", "x")
    assert done.exit_code == 2
    assert re.search("refers to missing files|not well-formed|is not MJCF", done.stderr)
    assert not Path("x").exists()
    header = Trace.load(tmp_path / "forged.mcap").header
    with pytest.raises(InputError):
        header.mjcf.compiled(header.mjcf.spec())


@pytest.mark.parametrize("name", ["/etc/passwd", "../x.obj", "a/b.obj", "a\\b.obj", "", "..", "x\0.obj", "x\n.obj"])
def test_a_log_whose_model_has_folders_is_refused(logged, tmp_path, name):
    def change(each, data):
        if each == "run.json":
            data = data.replace(b'"bluerov1.xml"', json.dumps(name).encode())
        return (f"model/{name}" if each.startswith("model/") else each), data

    (tmp_path / "forged.mcap").write_bytes(rewritten(logged[1], change))
    with pytest.raises(InputError, match="without folders"):
        Trace.load(tmp_path / "forged.mcap")


def test_a_model_in_a_log_is_checked_as_any_vehicles_file(logged, tmp_path, here):
    """The checks are the same as for a file on disk."""
    changes = ((b"<option ", b'<option tolerance="1" '), (b"</mujoco>", b"<equality/></mujoco>"))
    for before, after in changes:
        forged = tmp_path / "forged.mcap"
        forged.write_bytes(
            rewritten(logged[1], lambda n, d, b=before, a=after: (n, d.replace(b, a) if n.startswith("model/") else d))
        )
        done = here("run", "--from", forged, "-q", "-o", "x")
        assert done.exit_code == 2
        assert "is not supported" in done.stderr
        assert not (tmp_path / "x").exists()


def sparse(path, head, tail=b"", size=50 * 2**30):
    path.write_bytes(head)
    os.truncate(path, size)
    with open(path, "ab") as file:
        file.write(tail)


def test_a_sparse_file_of_50_gib_is_read_in_bounded_time_and_memory(logged, tmp_path):
    """A hole takes no space on a disk, so that such a file can come in any archive."""
    whole = logged[1].read_bytes()
    half, end = whole[: len(whole) // 2], whole.rindex(b"\x0f" + struct.pack("<Q", 4)) + 13
    contents = {
        "end": (whole,),
        "half": (half,),
        "middle": (half, b"x"),
        "middle, ended": (half, whole[-8:]),
        "record": (whole[:8] + b"\x09" + struct.pack("<Q", 49 * 2**30), whole[-8:]),
        "index": (whole[:end], whole[-37:]),
    }
    for where, parts in contents.items():
        sparse(tmp_path / f"{where}.mcap", *parts)
    code = """if True:
        import pathlib, resource
        from uvms_mj import InputError, Trace
        limit = 2 << 30
        used = 4096 * int(open("/proc/self/statm").read().split()[0]) if __import__("sys").platform == "linux" else 0
        resource.setrlimit(resource.RLIMIT_AS, (used + limit, -1) if used else (-1, -1))
        for path in sorted(pathlib.Path().glob("*.mcap")):
            try:
                print(path.stem, Trace.load(path).status.name, sep=": ")
            except InputError as error:
                print(path.stem, "refused", error, sep=": ")
    """
    done = forked(code=code, cwd=tmp_path)
    assert done.exit_code == 0, done.stderr
    found = dict(line.split(": ")[:2] for line in done.stdout.splitlines())
    assert found.keys() == contents.keys()
    assert {said for where, said in found.items() if where != "end"} <= {"refused", "truncated"}


def test_a_json_file_of_too_many_values_is_refused_before_it_is_read(logged, tmp_path):
    """80 MB of it took 5 GB of memory; a mesh, which is one text, may be as large."""
    many = b'{"shapes":[' + b"{}," * 10_000_000 + b"{}]}"
    forged = tmp_path / "x.mcap"
    forged.write_bytes(rewritten(logged[1], lambda name, data: (name, many if name == "geometry.json" else data)))
    with pytest.raises(InputError, match=r"geometry\.json: has more than 200000 values"):
        Trace.load(forged)
    with pytest.raises(InputError, match="at most 256 MB is allowed"):
        refuse_large({"a": bytes(200_000_000), "b": bytes(100_000_000)})
    refuse_large({"geometry.json": b'"' + bytes(100_000_000) + b'"'})
