"""The files that a stage or a file of metrics lists: they travel to workers, into digests and into logs."""

import json

import numpy as np
import pytest
import tomli_w

from short_study import HERE
from uvms_mj import InputError, McapLog, Scenario, Study, Trace, simulate
from uvms_mj.records.mcap import read_files
from uvms_mj.studies.bundle import StudyBundle
from uvms_mj.studies.plan import Plan

STAGES = """
from dataclasses import dataclass
from pathlib import Path
import numpy as np
from uvms_mj import Fosm
from uvms_mj.navigation import Perfect

GAIN = float(np.load(Path(__file__).parent / "{file}")["gain"])


@dataclass(frozen=True)
class Mine(Fosm):
    {files}
    K_s: float = GAIN


@dataclass(frozen=True)
class Sensor(Perfect):
    {files}
"""
METRIC = """
from pathlib import Path

files = ["nets/one.txt"]
ONE = float((Path(__file__).parent / files[0]).read_text())


def one(trace):
    return ONE
"""
SHORT = {"simulation.duration": 0.002}


def stages_file(folder, files="files = ['nets/policy.npz']", file="nets/policy.npz"):
    (folder / "nets").mkdir(exist_ok=True)
    np.savez(folder / "nets" / "policy.npz", gain=12.5)
    (folder / "nets" / "one.txt").write_text("1.5")
    (folder / "own.py").write_text(STAGES.format(files=files, file=file))
    return folder / "own.py"


@pytest.fixture
def study(tmp_path):
    def make(**options):
        own = stages_file(tmp_path, **options)
        (tmp_path / "metric.py").write_text(METRIC)
        tables = {
            "base": {"scenario": "push_wall", "navigation.name": f"{own}:Sensor", **SHORT},
            "laws": [f"{own}:Mine"],
            "vary": [{"key": "wall.stiffness", "values": [1e4]}],
            "keep": {"metrics": ["metric.py:one"], "logs": {"kind": "listed", "indices": [0]}},
        }
        (tmp_path / "s.toml").write_text(tomli_w.dumps(tables))
        return tmp_path / "s.toml"

    return make


def test_files_travel_to_workers_and_are_in_the_digest_and_in_the_log(study, tmp_path):
    ran = Study.load(study()).run(tmp_path / "out", executor=HERE)
    assert ran.frame.iloc[0][["status", "one"]].tolist() == ["completed", 1.5]
    names = json.loads((tmp_path / "out" / "version.json").read_text())["files"]
    ends = sorted(name.partition("/")[2] for name in names)
    assert ends == ["metric.py", "nets/one.txt", "nets/policy.npz", "own.py"]
    before = StudyBundle.of(Plan.load(study())).digest
    (tmp_path / "nets" / "one.txt").write_text("2.5")
    assert StudyBundle.of(Plan.load(tmp_path / "s.toml")).digest != before
    log = tmp_path / "out" / "logs" / "row-00000.mcap"
    assert {"law/own.py", "law/nets/policy.npz", "navigation/nets/policy.npz"} <= set(read_files(log)[1])


def test_a_log_has_what_repeats_its_run_in_an_empty_folder(tmp_path):
    own = stages_file(tmp_path)
    trace = simulate(Scenario.load("push_wall", SHORT, f"{own}:Mine"), sinks=[McapLog(tmp_path / "run.mcap")])
    empty = tmp_path / "empty"
    header, files = read_files(tmp_path / "run.mcap")
    for name, data in files.items():
        if name.startswith("law/"):
            path = empty / name.removeprefix("law/")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
    assert header.law.files.keys() == {"nets/policy.npz"}
    again = simulate(header.scenario.updated({}, f"{empty}/own.py:Mine"))
    assert again.scenario.controller.K_s == (12.5,) * 6 or again.scenario.controller.K_s == 12.5
    for name in trace:
        np.testing.assert_array_equal(again[name], trace[name])
    assert Trace.load(tmp_path / "run.mcap").header.law.digests == trace.header.law.digests


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ("files = ['none.npz']", "files: no file 'none.npz' in"),
        ("files = ['../own.py']", "'../own.py' must be a path below the folder of the file that lists it"),
        ("files = ['/etc/hostname']", "must be a path below the folder"),
        ("files = ['nets']", "files: no file 'nets' in"),
        ("files = 'nets/policy.npz'", "files must be a list of names"),
        ("files = [5]", "files must be a list of names"),
    ],
)
def test_a_list_that_is_wrong_is_refused_by_name(tmp_path, files, said):
    with pytest.raises(InputError) as caught:
        Scenario.load("push_wall", SHORT, f"{stages_file(tmp_path, files=files)}:Mine")
    assert said in str(caught.value)


def test_files_that_are_too_large_are_refused(tmp_path):
    own = stages_file(tmp_path)
    with (tmp_path / "nets" / "policy.npz").open("ab") as file:
        file.truncate(17_000_000)
    own.write_text(own.read_text().replace("np.load(", "np.load if 0 else (lambda p: {'gain': 1.0})(", 1))
    with pytest.raises(InputError, match="files have 17 MB in all; at most 16 MB are allowed"):
        Scenario.load("push_wall", SHORT, f"{own}:Mine")


def test_a_file_that_is_not_listed_is_missed_before_the_first_run(study, tmp_path):
    with pytest.raises(InputError, match=r"(?s)travel to a worker: .*FileNotFoundError.*policy.npz.*; a class lists"):
        Study.load(study(files="pass")).run(tmp_path / "out", executor=HERE)
    assert not (tmp_path / "out" / "study.toml").exists()
