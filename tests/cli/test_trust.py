"""A folder of a study, and a log, made to harm: the commands that may run a file of theirs, and all others do not.

Every file of Python there leaves a trace when it is imported. docs/reference/study_folder.md has the same table.
"""

import shutil

import pytest
import tomli_w

from forked import done as forked
from uvms_mj import InputError, Study, Trace
from uvms_mj.studies.tune import Tuning

TRACE = "from pathlib import Path\nPath({trace!r}).touch()\n"
LAW = """
from dataclasses import dataclass
from uvms_mj import Fosm

@dataclass(frozen=True)
class Mine(Fosm):
    pass
"""
SENSOR = """
from dataclasses import dataclass
from uvms_mj.navigation import Perfect

@dataclass(frozen=True)
class Mine(Perfect):
    pass
"""
TABLES = {
    "name": "harm",
    "base": {"scenario": "push_wall", "simulation.duration": 0.01, "navigation.name": "sensor.py:Mine"},
    "laws": ["gsta", "law.py:Mine"],
    "vary": [{"key": "wall.stiffness", "values": [1e4, 1e5]}],
    "keep": {"metrics": ["contact.peak_N", "metric.py:one"], "logs": {"kind": "listed", "indices": [1]}},
    "run": {"engine": "free_body"},
}
TUNE = {
    "gain": [{"key": "controller.K_s", "low": 1.0, "high": 30.0}],
    "objective": {"metric": "metric.py:one"},
    "tune": {"trials": 1},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the study out, the tuning found, the log of row 1, and the trace that a file leaves."""
    folder = tmp_path_factory.mktemp("harm")
    texts = {"law.py": LAW, "sensor.py": SENSOR, "metric.py": "def one(trace):\n    return 1.0\n"}
    for name, text in texts.items():
        (folder / name).write_text(TRACE.format(trace=str(folder / "imported")) + text)
    (folder / "study.toml").write_text(tomli_w.dumps(TABLES))
    (folder / "tune.toml").write_text(tomli_w.dumps(TABLES | TUNE | {"laws": ["law.py:Mine"], "keep": {}}))
    code = """if True:
        from concurrent.futures import ThreadPoolExecutor
        from uvms_mj import Study
        from uvms_mj.studies.tune import Tuning
        Study.load("study.toml").run("out", executor=ThreadPoolExecutor(1))
        Tuning.load("tune.toml").run("found", executor=ThreadPoolExecutor(1))
    """
    done = forked(code=code, cwd=folder)  # this process must not have imported the files
    assert done.exit_code == 0, done.stderr
    (folder / "run.mcap").write_bytes((folder / "out" / "logs" / "row-00001.mcap").read_bytes())
    return folder


@pytest.fixture
def imported(folder, monkeypatch):
    """Whether a file was imported since the last call."""
    monkeypatch.chdir(folder)

    def found():
        there = (folder / "imported").exists()
        (folder / "imported").unlink(missing_ok=True)
        return there

    found()
    return found


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    "command",
    [
        "study report out -o page.html --force",
        "study list",
        "run --from out --row 99",
        "run --from out",
        "run --from run.mcap",
        "info run.mcap",
        "info run.mcap --show law/law.py",
        "plot run.mcap --force",
        "compare run.mcap -o logs.html --force",
        "export run.mcap --to csv --force",
        "replay run.mcap --save run.rrd --force",
        "study monte_carlo design.runs=2 -o out",
        "keys",
        "signals",
        "stages",
        "metrics",
    ],
)
def test_a_command_that_only_reads_imports_nothing(imported, here, folder, monkeypatch, command):
    monkeypatch.chdir(folder)
    done = here(*command.split())
    assert done.exit_code in (0, 2), done.output
    assert isinstance(done.exception, SystemExit | None), done.exception
    assert not imported()


@pytest.mark.parametrize(
    "command",
    [
        "study study.toml --dry-run",
        "study out --dry-run",
        "study out -q --workers 1",
        "tune tune.toml --dry-run",
        "tune found -q --workers 1",
        "run --from out --row 0 -q -o again",
        "run -c law.py:Mine simulation.duration=0.001 -q -o again",
        "stages law.py:Mine",
    ],
)
def test_a_command_that_runs_imports_what_it_runs(imported, here, folder, monkeypatch, command):
    monkeypatch.chdir(folder)
    done = here(*command.split())
    assert done.exit_code == 0, done.output
    assert imported()


def test_results_in_python_import_nothing(imported):
    study = Study.load("out")
    assert list(study.frame["law"]) == ["gsta", "Mine"] * 2
    assert study.dataset().sizes["law"] == 2
    assert study.check is None
    assert Trace.load("run.mcap").scenario.controller.label() == "Mine"
    assert not imported()
    assert study.plan.scenario(1).controller.label() == "Mine"
    assert imported()


@pytest.mark.parametrize("file", ["law.py", "sensor.py"])
def test_a_row_imports_no_file_that_changed(imported, here, folder, monkeypatch, file):
    monkeypatch.chdir(folder)
    text = (folder / file).read_text()
    (folder / file).write_text(text + "\n# changed\n")
    try:
        done = here("run", "--from", "out", "--row", "1", "-q", "-o", "refused")
    finally:
        (folder / file).write_text(text)
    assert done.exit_code == 2
    assert f"since the study began, {file} changed" in done.stderr
    assert not imported()


@pytest.mark.parametrize("command", ["study out -q --workers 1", "study out --dry-run", "tune found -q --workers 1"])
@pytest.mark.parametrize("file", ["law.py", "sensor.py", "metric.py"])
def test_a_folder_imports_no_file_that_changed(imported, here, folder, monkeypatch, command, file):
    monkeypatch.chdir(folder)
    text = (folder / file).read_text()
    (folder / file).write_text(text + "\n# changed\n")
    try:
        done = here(*command.split())
    finally:
        (folder / file).write_text(text)
    assert done.exit_code == 2
    assert f"began, {file} changed; choose another folder" in done.stderr
    assert not imported()


def test_a_row_with_its_law_in_another_folder_is_that_of_the_study(here, folder, monkeypatch):
    monkeypatch.chdir(folder)
    (folder / "elsewhere").mkdir()
    shutil.copy(folder / "law.py", folder / "elsewhere" / "law.py")
    command = ("run", "--from", "out", "--row", "1", "-c", "elsewhere/law.py:Mine", "-q", "-o")
    done = here(*command, "same")
    assert done.exit_code == 0, done.output
    assert "changed" not in done.stderr
    with (folder / "elsewhere" / "law.py").open("a") as file:
        file.write("# another one\n")
    assert "law.py changed" in here(*command, "other").stderr


def test_a_row_imports_the_files_of_that_row_alone(imported, here, folder, monkeypatch):
    monkeypatch.chdir(folder)
    shutil.copy(folder / "law.py", folder / "kept")
    (folder / "law.py").write_text("1 / 0")
    try:
        done = here("run", "--from", "out", "--row", "0", "-q", "-o", "first")  # of gsta
    finally:
        shutil.copy(folder / "kept", folder / "law.py")
    assert done.exit_code == 0, done.stderr


def test_a_folder_of_another_study_or_tuning_is_refused_without_an_import(imported, folder):
    (folder / "alien").mkdir(exist_ok=True)
    for name, kind in (("study.toml", Study), ("tune.toml", Tuning)):
        tables = {"name": "other", "base": {"scenario": "push_wall", "simulation.duration": 0.01}}
        tables |= {"vary": TABLES["vary"], "run": TABLES["run"]}
        if kind is Tuning:
            gain = [{"key": "controller.k_1", "low": 1.0, "high": 30.0}]
            tables |= {"gain": gain, "objective": {"metric": "contact.peak_N"}}
        (folder / "alien" / name).write_text(tomli_w.dumps(tables))
        with pytest.raises(InputError, match="choose another folder"):
            kind.load(folder / "alien" / name).run("out" if kind is Study else "found", workers=1)
    assert not imported()
