"""Archives: what is in one is repeated elsewhere to the same bits, and a wrong zip is refused before anything of it is
written or run."""

import copy
import json
import re
import shlex
import shutil
import stat
import subprocess
import tomllib
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tomli_w
from click.testing import CliRunner

from fmus import build
from uvms_mj import Trace
from uvms_mj.cli import main
from uvms_mj.engine.native.tools import compiler
from uvms_mj.reproduce.archive import repeated
from uvms_mj.reproduce.archive.contents import RESULTS
from uvms_mj.reproduce.archive.repeated import UNPACKED, differences
from uvms_mj.reproduce.bench import results
from uvms_mj.reproduce.bench.task import RESULT

REPOSITORY = Path(__file__).parents[2]
LAW = """
import os
from dataclasses import dataclass
from pathlib import Path
import numpy as np
from uvms_mj import Controller, gain
from terms import push
from parts.numbers import HALF

if "WAS_EXECUTED" in os.environ:
    Path(os.environ["WAS_EXECUTED"]).touch()
TABLE = tuple(np.loadtxt(Path(__file__).parent / "tables" / "gains.csv", delimiter=","))


@dataclass(frozen=True)
class Mine(Controller):
    '''Proportional and damped.'''
    files = ["tables/gains.csv"]
    k_p: float = gain(TABLE[0], "N/m", "stiffness")
    k_d: float = gain(TABLE[1], "N s/m", "damping")

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            tau_cmd[i] = push(gains.k_p, signals.eta_e[i]) - 2.0 * HALF * gains.k_d * signals.nu_e[i]
"""
IN_C = """
#include "uvms_stage.h"
#include "own.h"
int pd(const struct settings *gains, struct state *state, const struct signals *signals, struct state *state_dot,
    double *tau_cmd)
{
    for (int i = 0; i < 6; i++)
        tau_cmd[i] = signals->g_hat[i] - STIFFNESS * signals->eta_e[i] - gains->k_d * signals->nu_e[i];
    return 0;
}
"""
SHORT = ("simulation.duration=0.3",)


def author(folder: Path) -> Path:
    """The folder of an author: a law with two helpers and a table, a vehicle with a mesh, a law in C."""
    for name in ("parts", "tables", "meshes", "c"):
        (folder / name).mkdir(parents=True)
    (folder / "law.py").write_text(LAW)
    (folder / "terms.py").write_text("def push(k, e):\n    return -k * e\n")
    (folder / "parts" / "numbers.py").write_text("HALF = 0.5\n")
    (folder / "tables" / "gains.csv").write_text("180.0,140.0\n")
    (folder / "c" / "pd.c").write_text(IN_C)
    (folder / "c" / "own.h").write_text("#define STIFFNESS 200.0\n")
    (folder / "c" / "pd.toml").write_text(
        'stage = "controller"\nuses_task = false\nsettings.k_d = {default = 150.0, at_least = 0.0}\n'
    )
    corners = np.array([(x, y, z) for x in (-0.2, 0.2) for y in (-0.2, 0.2) for z in (-0.2, 0.2)])
    (folder / "meshes" / "box.obj").write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners))
    cube = (REPOSITORY / "examples" / "cube.xml").read_text()
    box = '<geom type="box" size="0.2 0.2 0.2" mass="0"'
    assert box in cube
    cube = cube.replace(box, '<geom type="mesh" mesh="box" mass="0"')
    cube = cube.replace("<worldbody>", '<asset><mesh name="box" file="meshes/box.obj"/></asset>\n<worldbody>', 1)
    (folder / "own.xml").write_text(cube)
    return folder


@pytest.fixture
def there(tmp_path):
    return author(tmp_path / "author")


@pytest.fixture
def executed(tmp_path, monkeypatch):
    """Whether the author's law has been executed since the last call."""
    mark = tmp_path / "was_executed"

    def asked() -> bool:
        was = mark.exists()
        mark.unlink(missing_ok=True)
        return was

    monkeypatch.setenv("WAS_EXECUTED", str(mark))
    return asked


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """Take the author's folder away and go to another one, to which the archive has been copied."""

    def go() -> Path:
        shutil.rmtree(tmp_path / "author")
        reviewer = tmp_path / "reviewer"
        reviewer.mkdir()
        for each in (*tmp_path.glob("*.zip"),):
            each.rename(reviewer / each.name)
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        monkeypatch.chdir(reviewer)
        return reviewer

    return go


def ok(done):
    assert done.exit_code == 0, done.stderr
    return done


LAWS = {
    "python": lambda there: f"{there}/law.py:Mine",
    "c": lambda there: f"{there}/c/pd.c",
    "library": lambda there: library(there),
    "fmu": lambda there: str(build_fmu(there)),
}


def library(there: Path) -> str:
    from uvms_mj.cli.new import write_new

    write_new("header", str(there / "c" / "pd.toml"))
    file = there / "c" / "libpd.so"
    subprocess.run([*compiler(), "-shared", "-fPIC", "-o", str(file), str(there / "c" / "pd.c")], check=True)
    return f"{file}:pd"


def build_fmu(there: Path) -> Path:
    pytest.importorskip("fmpy", reason="needs the extra fmi")
    inputs = [f"{name}[{i + 1}]" for name in ("eta_e", "nu_e", "g_hat") for i in range(6)]
    body = "for (int i = 0; i < 6; i++) r[20 + i] = r[14 + i] - r[0] * r[2 + i] - r[1] * r[8 + i];"
    outputs = [f"tau_cmd[{i + 1}]" for i in range(6)]
    return build(there, "pd", body, {"k_p": 200.0, "k_d": 150.0}, inputs, outputs)


@pytest.mark.parametrize("kind", LAWS)
def test_a_run_is_repeated_elsewhere_to_the_same_bits(here, there, elsewhere, kind):
    law = LAWS[kind](there)
    ok(here("run", "-c", law, f"vehicle.model={there}/own.xml", *SHORT, "--out", "out", "-q"))
    before = Trace.load("out/run.mcap")
    ok(here("archive", "out", "--out", "run.zip"))
    reviewer = elsewhere()
    done = ok(here("run", "--from", "run.zip", "--out", "again", "-q"))
    assert "equal" not in done.stderr
    now = Trace.load(reviewer / "again" / "run.mcap")
    for name in before:
        assert before[name].tobytes() == now[name].tobytes(), name
    scenario = tomllib.loads((reviewer / "again" / "archive" / "scenario.toml").read_text())
    assert not any(
        Path(scenario[table][key]).is_absolute() for table, key in (("vehicle", "model"), ("controller", "name"))
    )
    assert (reviewer / "again" / "archive" / scenario["vehicle"]["model"]).is_file()
    by_hand = ok(here("run", "again/archive/scenario.toml", "--out", "by_hand", "-q"))
    assert by_hand.exit_code == 0
    assert Trace.load("by_hand/run.mcap")["tau"].tobytes() == before["tau"].tobytes()


def test_to_make_and_to_look_at_an_archive_executes_nothing(here, there, executed):
    ok(here("run", "-c", f"{there}/law.py:Mine", *SHORT, "--out", "out", "-q"))
    assert executed()
    ok(here("archive", "out", "--out", "run.zip"))
    told = ok(here("info", "run.zip")).stdout
    about = json.loads(ok(here("info", "run.zip", "--json")).stdout)
    assert "files/stages-0/parts/numbers.py" in about["members"]
    assert "every digest is right" in told
    assert ok(here("info", "run.zip", "--show", "files/stages-0/terms.py")).stdout.startswith("def push")
    assert not executed()


def test_one_record_gives_the_same_bytes_of_a_zip_without_paths(here, there, tmp_path):
    ok(here("run", "-c", f"{there}/law.py:Mine", f"vehicle.model={there}/own.xml", *SHORT, "--out", "out", "-q"))
    for name in ("a.zip", "b.zip"):
        ok(here("archive", "out", "--out", name))
    with zipfile.ZipFile("a.zip") as a, zipfile.ZipFile("b.zip") as b:
        for name in a.namelist():
            if name not in ("README.md", "archive.json"):  # which name the zip
                assert a.read(name) == b.read(name)
            assert str(tmp_path).encode() not in a.read(name)
    assert "a.zip: exists" in here("archive", "out", "--out", "a.zip").stderr
    before = Path("a.zip").read_bytes()
    ok(here("archive", "out", "--out", "a.zip", "--force"))
    assert Path("a.zip").read_bytes() == before


def test_of_a_law_that_changed_the_archive_has_what_ran_and_says_so(here, there, elsewhere):
    ok(here("run", "-c", f"{there}/law.py:Mine", *SHORT, "--out", "out", "-q"))
    files = ("law.py", "terms.py", "tables/gains.csv")
    for i, file in enumerate(files):
        text = (there / file).read_text()
        (there / file).write_text(text.replace("-k * e", "-0.9 * k * e").replace("180.0", "181.0") + "\n")
        done = ok(here("archive", "out", "--out", f"run-{i}.zip"))
        assert f"{file} changed since the run" in done.stderr
        (there / file).write_text(text)
    elsewhere()
    for i, file in enumerate(files):
        done = ok(here("run", "--from", f"run-{i}.zip", "--out", f"again-{i}", "-q"))
        assert "differs" not in done.stderr, file


def test_machine_code_that_changed_or_went_is_refused(here, there):
    file = library(there).rpartition(":")[0]
    ok(here("run", "-c", f"{file}:pd", *SHORT, "--out", "out", "-q"))
    shutil.copy("out/run.mcap", "alone.mcap")
    data = Path(file).read_bytes()
    Path(file).write_bytes(data + b"x")
    assert "libpd.so: changed since the run (sha256" in here("archive", "out", "--out", "run.zip").stderr
    Path(file).unlink()
    assert "the digest of libpd.so alone" in here("archive", "out", "--out", "run.zip").stderr
    Path(file).write_bytes(data)
    assert "scenario.toml beside the log" in here("archive", "alone.mcap", "--out", "run.zip").stderr
    assert not Path("run.zip").exists()


def test_a_run_by_a_motion_of_a_file_is_repeated_without_it(here, there, elsewhere):
    """The log has the numbers of the file, and no path: what the file is later does not matter."""
    motion = there / "swing.csv"
    motion.write_text("time,shoulder,elbow\n" + "".join(f"{0.05 * i},{0.3 / 7.0 * i},{-0.1 * i}\n" for i in range(5)))
    keys = ("vehicle.model=planar_arm", "joints.name=position", "current.speed=0", "wall.position=9", *SHORT)
    ok(here("run", "push_wall", *keys, f"joints.motion_file={motion}", "--out", "out", "-q"))
    before = Trace.load("out/run.mcap")
    motion.write_text("time,shoulder,elbow\n0,0,0\n")
    ok(here("archive", "out", "--out", "run.zip"))
    names = zipfile.ZipFile("run.zip").namelist()
    assert not [name for name in names if "swing" in name]
    assert b"swing.csv" not in zipfile.ZipFile("run.zip").read("scenario.toml")
    elsewhere()
    done = ok(here("run", "--from", "run.zip", "--out", "again", "-q"))
    assert "differs" not in done.stderr
    now = Trace.load("again/run.mcap")
    assert np.ptp(before.q[:, 0]) > 0.1
    for name in before:
        assert before[name].tobytes() == now[name].tobytes(), name


def test_a_run_by_another_program_and_a_folder_of_a_world_are_refused_with_what_can_be_done(here):
    ok(here("run", "press_together", *SHORT, "--engine", "free_body", "--out", "world", "-q"))
    said = here("archive", "world", "--out", "run.zip").stderr
    assert "world of several vehicles" in said
    assert "uvms-mj run world/scenario.toml" in said
    ok(here("archive", "world/left.mcap", "--out", "left.zip"))
    assert not Path("run.zip").exists()


def test_a_vehicle_that_is_coupled_to_others_is_refused(here):
    ok(here("run", "press_bar", *SHORT, "--engine", "free_body", "--out", "out", "-q"))
    assert "is coupled to other vehicles" in here("archive", "out/left.mcap", "--out", "run.zip").stderr
    assert not Path("run.zip").exists()


def study_of(there: Path, law: str) -> str:
    tables = {
        "base": {"scenario": "push_wall", "vehicle.model": "own.xml", "simulation.duration": 0.1},
        "laws": ["gsta", law],
        "vary": [{"key": "wall.stiffness", "values": [1e4, 2e4]}],
        "keep": {"logs": {"kind": "listed", "indices": [1]}},
    }
    (there / "s.toml").write_text(tomli_w.dumps(tables))
    return str(there / "s.toml")


def test_a_study_is_repeated_elsewhere_with_the_same_rows(here, there, elsewhere, executed):
    ok(here("study", study_of(there, "law.py:Mine"), "--out", "out", "-q"))
    assert executed()
    ok(here("archive", "out", "--out", "study.zip"))
    assert not executed()
    assert "is the archive of a study: uvms-mj study --from" in here("run", "--from", "study.zip").stderr
    elsewhere()
    done = ok(here("study", "--from", "study.zip", "--out", "again"))
    assert "equal to the archive" in done.stderr
    assert "leave out the study" in here("study", "--from", "study.zip", "design.seed=1").stderr
    ok(here("study", "--from", "study.zip", "--out", "again", "-q"))  # goes on, and has nothing to do


def test_names_with_spaces_and_other_letters_are_repeated(here, there, elsewhere):
    """Folders, a vehicle that varies and the zip: the rows have names, and the command is one for a shell."""
    place = there / "vêhicle of mine"
    place.mkdir()
    (place / "my cube.xml").write_text((REPOSITORY / "examples" / "cube.xml").read_text())
    tables = {
        "laws": ["impedance"],
        "base": {"scenario": "push_wall", "simulation": {"duration": 0.1}},
        "vary": [{"key": "vehicle.model", "values": ["bluerov1", str(place / "my cube.xml")]}],
    }
    Path("two.toml").write_text(tomli_w.dumps(tables))
    ok(here("study", "two.toml", "--out", "out", "-q"))
    said = ok(here("archive", "out", "--out", "twø études.zip")).stdout
    reviewer = elsewhere() / "with a space"
    reviewer.mkdir()
    command = shlex.split(said.splitlines()[-1])
    assert command[:4] == ["uvms-mj", "study", "--from", "twø études.zip"]
    done = ok(here(*command[1:-1], str(reviewer / "out")))
    assert "equal to the archive" in done.stderr


def test_a_study_whose_files_changed_or_went_is_refused(here, there):
    ok(here("study", study_of(there, "law.py:Mine"), "--out", "out", "-q"))
    for file in ("law.py", "parts/numbers.py", "tables/gains.csv", "own.xml"):
        text = (there / file).read_text()
        (there / file).write_text(text.replace('mass="20"', 'mass="21"') + "\n")
        assert f"{Path(file).name} changed" in here("archive", "out", "--out", "study.zip").stderr
        (there / file).unlink()
        assert Path(file).name in here("archive", "out", "--out", "study.zip").stderr
        assert not Path("study.zip").exists()
        (there / file).write_text(text)
    ok(here("archive", "out", "--out", "study.zip"))


@pytest.mark.usefixtures("undrawn")
def test_a_result_of_the_benchmark_is_repeated_to_the_same_bytes(here, there, elsewhere):
    Path("secret").write_bytes(b"0123456789abcdef")
    task = "two_bumpers"
    assert task in json.loads(ok(here("bench", "tasks", "--json")).stdout)
    how = ("--tasks", task, "--at-most", "2", "--draws", "secret:secret")
    law = (f"{there}/law.py:Mine", "controller.k_p=170", "label=mine")
    ok(here("bench", "gsta", *law, *how, "--out", "out", "-q"))
    before = Path("out/bench.json").read_bytes()
    assert "name it with --secret" in here("archive", "out", "--out", "b.zip").stderr
    Path("other").write_bytes(b"0123456789abcdeg")
    assert "is not the file of these draws" in here("archive", "out", "--out", "b.zip", "--secret", "other").stderr
    ok(here("archive", "out", "--out", "b.zip", "--secret", "secret"))
    reviewer = elsewhere()
    ok(here("bench", "--from", "b.zip", "--out", "again", "-q"))
    assert (reviewer / "again" / "bench.json").read_bytes() == before


def test_a_result_of_another_python_is_equal_if_its_numbers_are(tmp_path):
    """Versions and the digest over them are the repetition's own; a number, or another form of the same, is not."""
    there, here = tmp_path / UNPACKED / RESULTS / RESULT, tmp_path / RESULT
    there.parent.mkdir(parents=True)
    found = results.shipped()
    found["laws"] = [law for law in found["laws"] if law["label"] in ("gsta", "sta")]
    there.write_text(json.dumps(found | {"digest": results.digest(found)}))
    for code, changed, said in (
        ({"python": "3.99.0"}, 0.0, []),
        ({"python": "3.99.0"}, 1e-12, ["gsta on waves: the same level, other numbers in 1 of {} draws"]),
        ({}, 0.0, ["its bytes, though no number"]),
    ):
        other = copy.deepcopy(found)
        other["code"] |= code
        row = next(law for law in other["laws"] if law["label"] == "gsta")["tasks"]["waves"]["levels"]["1"]["rows"][0]
        row["hold.error_N"] += changed
        other["digest"] = results.digest(other)
        here.write_text(json.dumps(other, indent=2))
        ladder = next(law for law in found["laws"] if law["label"] == "gsta")["tasks"]["waves"]
        draws = sum(len(level["rows"]) for level in ladder["levels"].values())
        assert differences("bench", tmp_path) == [each.format(draws) for each in said]
    next(law for law in other["laws"] if law["label"] == "gsta")["tasks"]["waves"]["level"] = 0
    here.write_text(json.dumps(other | {"digest": results.digest(other)}))
    assert differences("bench", tmp_path) == [f"gsta on waves: level {ladder['level']} then, 0 now"]


# wrong zips


@pytest.fixture(scope="module")
def archived(tmp_path_factory):
    """A folder with a run by the author's law and its archive."""
    folder = tmp_path_factory.mktemp("archived")
    law = f"{author(folder / 'author')}/law.py:Mine"
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for words in (("run", "-c", law, *SHORT, "--out", "out", "-q"), ("archive", "out", "--out", "run.zip")):
            ok(CliRunner().invoke(main, words))
    return folder


@pytest.fixture
def sound(here, there, archived):
    shutil.copytree(archived / "out", "out")
    return Path(shutil.copy(archived / "run.zip", "run.zip"))


def rewritten(sound: Path, change) -> Path:
    """A zip with the members of another one, by name, changed."""
    with zipfile.ZipFile(sound) as file:
        members = [(info, file.read(info)) for info in file.infolist()]
    wrong = Path("wrong.zip")
    with zipfile.ZipFile(wrong, "w") as file, warnings.catch_warnings(action="ignore"):
        for info, data in change(members):
            file.writestr(info, data)
    return wrong


def added(name, data=b"x", mode=stat.S_IFREG | 0o644):
    info = zipfile.ZipInfo(name)
    info.external_attr = mode << 16
    return lambda members: [*members, (info, data)]


def listed(name, data=b"x", mode=stat.S_IFREG | 0o644):
    """A member that archive.json knows: a zip made by hand with right digests."""
    import hashlib

    def change(members):
        found = []
        for info, old in members:
            if info.filename == "archive.json":
                tables = json.loads(old)
                tables["members"][name] = {"sha256": hashlib.sha256(data).hexdigest(), "size": len(data)}
                old = json.dumps(tables).encode()
            found.append((info, old))
        return added(name, data, mode)(found)

    return change


def without(name):
    return lambda members: [each for each in members if each[0].filename != name]


def with_text(name, change):
    return lambda members: [(i, change(data) if i.filename == name else data) for i, data in members]


def kind_of(kind):
    def change(data):
        data = data.replace(b"uvms-mj run", f"uvms-mj {kind}".encode())
        return data.replace(b'"kind": "run"', f'"kind": "{kind}"'.encode())

    return with_text("archive.json", change)


def law_outside(members):
    """A sealed zip whose scenario names a law that is not in it."""
    import hashlib

    found = {info.filename: data for info, data in members}
    text = found["scenario.toml"].replace(b"files/stages-0/law.py:Mine", b"/tmp/law.py:Mine")
    assert text != found["scenario.toml"]
    tables = json.loads(found["archive.json"])
    tables["members"]["scenario.toml"] = {"sha256": hashlib.sha256(text).hexdigest(), "size": len(text)}
    found |= {"scenario.toml": text, "archive.json": json.dumps(tables).encode()}
    return [(info, found[info.filename]) for info, _ in members]


DEEP = 900 * b"[" + 900 * b"]"
WRONG = {
    "absolute": (listed("/tmp/evil.py"), "absolute path"),
    "above": (listed("files/../../evil.py"), "leaves the folder"),
    "backslash": (listed("files\\evil.py"), "absolute path, or one of another system"),
    "drive": (listed("C:evil.py"), "absolute path, or one of another system"),
    "link": (listed("files/link", b"/etc/passwd", stat.S_IFLNK | 0o777), "is a link"),
    "pipe": (listed("files/pipe", b"", stat.S_IFIFO | 0o644), "is not a regular file"),
    "folder": (listed("files/empty/", b"", stat.S_IFDIR | 0o755), "is not a regular file"),
    "dots": (listed("files/./evil.py"), "no plain path"),
    "control": (listed("files/a\nb"), "no plain path"),
    "unknown": (added("files/evil.py"), "does not know 'files/evil.py'"),
    "missing": (without("files/stages-0/terms.py"), "'files/stages-0/terms.py' is missing"),
    "changed": (with_text("files/stages-0/law.py", lambda data: data + b"\n"), "law.py was changed since"),
    "same length": (with_text("files/stages-0/law.py", lambda data: data[:-2] + b"#\n"), "law.py was changed since"),
    "twice": (lambda members: [*members, members[0]], "mean one place"),
    "case": (listed("files/stages-0/LAW.py"), "mean one place"),
    "file and folder": (listed("files/stages-0"), "mean one place"),
    "no manifest": (without("archive.json"), "not one that `uvms-mj archive` wrote"),
    "no table": (with_text("archive.json", lambda data: b"[]"), "archive.json"),
    "no JSON": (with_text("archive.json", lambda data: b"{"), "archive.json can't be read"),
    "deep": (
        with_text("archive.json", lambda data: data.replace(b'"names"', b'"x": ' + DEEP + b', "names"')),
        "archive.json can't be read",
    ),
    "format": (with_text("archive.json", lambda data: data.replace(b'"format": 1', b'"format": 2')), "format 2"),
    "kind": (kind_of("virus"), "the kind 'virus'"),
    "of a paper": (kind_of("paper"), "is the archive of a paper"),
    "command": (with_text("archive.json", lambda data: data.replace(b"--out repeated", b"; rm x")), "the command"),
    "escape": (with_text("archive.json", lambda data: data.replace(b'"push_wall"', b'"\\u001b[2J"')), "the name or"),
    "scenario outside": (law_outside, "is no file in it"),
    "no names": (with_text("archive.json", lambda data: data.replace(b'"names"', b'"name"')), "about"),
    "name outside": (
        with_text("archive.json", lambda data: data.replace(b'"files/stages-0/law.py:Mine"', b'"/tmp/law.py:Mine"')),
        "about",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_zip_is_refused_by_name_before_anything_is_written_or_run(here, sound, executed, case):
    change, said = WRONG[case]
    wrong = rewritten(sound, change)
    done = here("run", "--from", str(wrong), "--out", "again")
    assert done.exit_code == 2
    assert said in done.stderr
    assert "wrong.zip" in done.stderr
    assert not executed()
    assert not Path("again").exists()
    assert not Path("/tmp/evil.py").exists()
    if case not in ("of a paper", "no names", "name outside", "scenario outside"):
        assert here("info", str(wrong)).exit_code == 2


def forged(member, data):
    """Another content of a member, with the digest of it."""

    def change(members):
        return listed(member, data)([each for each in members if each[0].filename != member])

    return change


def about(**changed):
    def change(data):
        tables = json.loads(data)
        tables["about"] |= changed
        return json.dumps(tables).encode()

    return with_text("archive.json", change)


@pytest.mark.usefixtures("undrawn")
def test_results_that_can_not_be_compared_are_refused_before_anything_runs(here, there, executed):
    """With right digests: rows that are none, a result that is none, a number of draws without end."""
    ok(here("study", study_of(there, "law.py:Mine"), "--out", "out", "-q"))
    ok(here("archive", "out", "--out", "study.zip"))
    ok(here("bench", f"{there}/law.py:Mine", "--tasks", "two_bumpers", "--at-most", "1", "--out", "ten", "-q"))
    ok(here("archive", "ten", "--out", "bench.zip"))
    executed()
    for kind, change, said in (
        ("study", forged("results/rows.parquet", b"PAR1"), "results/rows.parquet can't be read"),
        ("bench", forged("results/bench.json", b"{}"), "results/bench.json: is not a result of uvms-mj bench"),
        ("bench", forged("results/bench.json", b"{"), "results/bench.json: is not JSON"),
        ("bench", about(draws="seed:" + 5000 * "9"), "the seed has 5000 digits; it may have 100"),
    ):
        wrong = rewritten(Path(f"{kind}.zip"), change)
        done = here(kind, "--from", str(wrong), "--out", "again")
        assert (done.exit_code, said in done.stderr) == (2, True), done.stderr
        assert "Traceback" not in done.stderr
        assert not executed()


def test_what_is_no_zip_is_refused(here, sound, tmp_path):
    Path("text.zip").write_text("no zip")
    Path("cut.zip").write_bytes(sound.read_bytes()[:-200])
    Path("empty.zip").write_bytes(b"")
    for name in ("text.zip", "cut.zip", "empty.zip", "gone.zip"):
        done = here("run", "--from", name, "--out", "again")
        assert (done.exit_code, name in done.stderr) == (2, True)
    damaged = bytearray(sound.read_bytes())
    damaged[len(damaged) // 2] ^= 0xFF
    Path("damaged.zip").write_bytes(damaged)
    assert here("info", "damaged.zip").exit_code == 2
    assert "must end in .zip" in here("archive", "out", "--out", "run.tar").stderr
    assert "has none of" in here("archive", str(tmp_path / "author"), "--out", "x.zip").stderr


def test_a_folder_with_another_archive_is_left_alone(here, sound):
    ok(here("run", "--from", "run.zip", "--out", "again", "-q"))
    law = Path("again/archive/files/stages-0/law.py")
    law.write_text(law.read_text() + "\n")
    done = here("run", "--from", "run.zip", "--out", "again", "-q")
    assert done.exit_code == 2
    assert "is not this archive, unpacked" in done.stderr


def test_a_repetition_that_differs_says_what_differs(here, sound, monkeypatch):
    """A log of another run in place of the archive's: digests are right, the samples are not."""
    import hashlib

    ok(here("run", *SHORT, "current.speed=0.1", "--out", "other", "-q"))
    other = Path("other/run.mcap").read_bytes()
    assert other
    ok(here("run", "--from", "run.zip", "--set", "wall.stiffness=2e4", "--out", "changed"))  # is not compared

    def change(members):
        found = []
        for info, data in members:
            if info.filename == "files/stages-0/terms.py":
                data = data.replace(b"-k * e", b"-0.5 * k * e")
                digest = {"sha256": hashlib.sha256(data).hexdigest(), "size": len(data)}
            found.append((info, data))
        for i, (info, data) in enumerate(found):
            if info.filename == "archive.json":
                tables = json.loads(data)
                tables["members"]["files/stages-0/terms.py"] = digest
                found[i] = info, json.dumps(tables).encode()
        return found

    wrong = rewritten(sound, change)
    done = here("run", "--from", str(wrong), "--out", "again")
    assert done.exit_code == 1
    assert "differs from the archive" in done.stderr
    assert re.search(r"^- \w+ by [\d.e+-]+ of its largest magnitude$", done.stderr, re.M)
    assert "terms.py differs from the recorded file" in done.stderr


def test_a_repetition_whose_linear_algebra_rounds_otherwise_says_so(here, sound, monkeypatch):
    """The pseudoinverse of the thrusters, larger by one unit in the last place, as another OpenBLAS computes it."""
    exactly = np.linalg.pinv
    monkeypatch.setattr(np.linalg, "pinv", lambda *given, **more: np.nextafter(exactly(*given, **more), np.inf))
    done = here("run", "--from", "run.zip", "--out", "again")
    assert done.exit_code == 1
    parts = [float(part) for part in re.findall(r" by ([\d.e+-]+) of its largest magnitude$", done.stderr, re.M)]
    assert parts
    assert max(parts) < 1e-9
    assert "NumPy is the same; for another kind of processor its OpenBLAS computes numbers of the set-up" in done.stderr

    from uvms_mj.records import header

    versions = header.versions()
    monkeypatch.setattr(header, "versions", lambda: {**versions, "numpy": "2.99.0"})
    done = here("run", "--from", "run.zip", "--out", "newer")
    assert done.exit_code == 1
    assert done.stderr.count(f"numpy {np.__version__} then, 2.99.0 now") == 1
    assert "The OpenBLAS of another NumPy computes numbers of the set-up" in done.stderr
    assert f"Install numpy {np.__version__} to repeat them" in done.stderr


def test_rows_that_differ_say_by_how_much():
    """One number of four by a thousandth of the largest; a missing one equals itself."""
    then = pd.DataFrame({"a": [1.0, np.nan, -8.0, 2.0], "b": [0.0, 1.0, 2.0, 3.0], "c": ["x", None, "y", "z"]})
    now = then.assign(a=[1.0, np.nan, -8.0, 2.008], c=["x", None, "y", "w"])
    assert repeated.of_rows(then, then.copy()) == []
    assert repeated.of_rows(then, now) == ["a by 0.001 of its largest magnitude", "c"]
    assert repeated.of_rows(then, now.assign(a=[1.0, 0.0, -8.0, 2.0], c=then["c"])) == ["a"]
