"""The commands `study report` and `run --from DIR --row N`."""

import json
import re

import numpy as np
import pandas as pd
import pytest
import tomli_w

from pages import complete_by_itself
from short_study import HERE
from uvms_mj.studies.study import Study

LAW = """
from dataclasses import dataclass

from uvms_mj import Fosm


@dataclass(frozen=True)
class Mine(Fosm):
    pass
"""
TABLES = {
    "name": "short",
    "laws": ["gsta", "law.py:Mine", {"name": "fosm", "label": "coarse", "controller.period": 0.05}],
    "base": {
        "scenario": "push_wall",
        "simulation.duration": 0.3,
        "wall.position": 0.02,
        "reference.step_time": 0.0,
    },
    "design": {"kind": "latin_hypercube", "runs": 3, "seed": 7},
    "vary": [
        {"key": "wall.stiffness", "distribution": "loguniform", "low": 2e4, "high": 2e5},
        {"key": "current.speed", "distribution": "uniform", "low": 0.0, "high": 0.3},
    ],
    "run": {"engine": "mujoco"},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the study out, and the file of a law."""
    folder = tmp_path_factory.mktemp("study")
    (folder / "law.py").write_text(LAW)
    (folder / "study.toml").write_text(tomli_w.dumps(TABLES))
    Study.load(folder / "study.toml").run(folder / "out", executor=HERE)
    return folder


@pytest.fixture
def there(folder, here, monkeypatch):
    monkeypatch.chdir(folder)
    return here


def places(tree, prefix=""):
    """The numbers of a JSON report by the names of columns."""
    flat = {}
    for name, value in tree.items():
        if isinstance(value, dict):
            flat |= places(value, f"{prefix}{name}.")
        elif isinstance(value, list):
            flat |= {f"{prefix}{name}.{axis}": each for axis, each in zip("xyz", value, strict=False)}
        else:
            flat[f"{prefix}{name}"] = value
    return flat


@pytest.mark.usefixtures("undrawn")
def test_a_report_is_one_page_beside_the_rows(there, folder):
    done = there("study", "report", "out")
    assert done.exit_code == 0, done.output
    assert done.stdout.strip() == "out/report.html"
    text = (folder / "out" / "report.html").read_text(encoding="utf-8")
    flat = " ".join(" ".join(complete_by_itself(text).text).split())
    assert "9 runs: 3 laws × 3 draws" in flat
    assert "--from out --row" in flat
    assert "coarse" in flat
    assert "version of sources" in flat
    assert str(folder) not in text
    assert there("study", "report", "out").exit_code == 0  # the page is replaced
    assert there("study", "report", "out", "--out", "other.html").exit_code == 0
    assert "exists" in there("study", "report", "out", "--out", "other.html").stderr


def test_a_report_of_something_else_is_refused(there, folder):
    (folder / "empty").mkdir(exist_ok=True)
    for arguments, words in (
        (("empty",), "not the folder of a study"),
        (("none",), "is not a folder"),
        (("out", "-o", "page.pdf"), "must end in .html"),
    ):
        done = there("study", "report", *arguments)
        assert done.exit_code == 2
        assert words in done.stderr


@pytest.mark.parametrize("row", [0, 4, 8])
def test_a_row_runs_again_bit_for_bit(folder, here, row):
    done = here("run", "--from", folder / "out", "--row", row, "--json", "--out", "again")
    expected = Study.load(folder / "out").frame.set_index("index").loc[row]
    assert done.exit_code == (3 if expected["status"] == "unstable" else 0), done.stderr
    found = places(json.loads(done.stdout))
    assert found["status"] == expected["status"]
    assert found["steps"] == expected["steps"]
    columns = list(expected.index[list(expected.index).index("engine") + 1 :])
    assert len(columns) > 10
    for name in columns:
        if pd.isna(expected[name]):
            assert found.get(name) is None, name
        else:
            assert found[name] == expected[name], name


def test_the_engine_is_that_of_the_row(there, folder):
    out = folder / "free"
    done = there("study", "study.toml", "--engine", "free_body", "--out", out, "--quiet", "design.runs=1")
    assert done.exit_code == 0, done.stderr
    frame = Study.load(out).frame
    assert frame["engine"][0] == "free_body"
    peaks = {}
    for name, engine in (("own", ()), ("mujoco", ("--engine", "mujoco"))):
        done = there("run", "--from", out, "--row", 0, "--json", "-o", name, *engine)
        peaks[name] = json.loads(done.stdout)["contact"]["peak_N"]
    assert peaks["own"] == frame["contact.peak_N"][0]
    assert peaks["mujoco"] != peaks["own"]
    assert np.isclose(peaks["mujoco"], peaks["own"], rtol=1e-3)


def test_a_setting_changes_the_run_of_a_row(folder, here):
    arguments = ("--from", folder / "out", "--row", 0, "--json", "--out", "changed")
    done = here("run", *arguments, "--set", "simulation.duration=0.01")
    assert json.loads(done.stdout)["steps"] == 100


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--row", "1"), "name the folder of its study with --from DIR"),
        (("--from", "law.py", "--row", "1"), "must be the study's folder"),
        (("--from", "out", "--row", "9"), "has the rows 0 to 8"),
        (("push_wall", "--from", "out", "--row", "1"), "one scenario at a time"),
    ],
)
def test_a_row_that_does_not_exist_is_refused(there, arguments, words):
    done = there("run", *arguments)
    assert done.exit_code == 2
    assert words in done.stderr


@pytest.fixture
def other_law(folder):
    (folder / "law.py").write_text(LAW + "\n# changed\n")
    yield
    (folder / "law.py").write_text(LAW)


def test_a_row_of_a_law_that_changed_is_refused_unless_the_law_is_named(there, folder, other_law):
    short = ("simulation.duration=0.001", "-q")
    done = there("run", "--from", "out", "--row", 1, *short, "-o", "refused")
    assert done.exit_code == 2
    assert "error: row 1 of out: since the study began, law.py changed; restore what it was" in done.stderr
    assert done.stderr.count("error:") == 1
    assert not (folder / "refused").exists()
    done = there("run", "--from", "out", "--row", 1, *short, "-c", "law.py:Mine", "-o", "named")
    assert done.exit_code == 0, done.stderr
    assert "the run may differ from the row: law.py changed" in done.stderr
    done = there("run", "--from", "out", "--row", 0, *short, "-o", "another law")
    assert done.exit_code == 0, done.stderr
    assert "law.py" not in done.stderr


def test_a_report_needs_no_file_of_a_law_a_metric_or_a_base(there, folder):
    """The base has the law, too, and a gain of it varies."""
    own = LAW.replace("pass", "own: float = gain(2.0, '1/s', 'gain')").replace("import Fosm", "import Fosm, gain")
    (folder / "own.py").write_text(own)
    (folder / "metric.py").write_text("def zero(trace):\n    return 0.0\n")
    tables = TABLES | {
        "laws": ["gsta", "own.py:Mine", {"name": "own.py:Mine", "label": "other", "controller.own": 4.0}],
        "base": {
            **TABLES["base"],
            "controller.name": "own.py:Mine",
            "controller.own": 3.0,
            "simulation.duration": 0.01,
        },
        "vary": [{"key": "controller.own", "values": [1.0, 2.0], "laws": ["Mine"]}],
        "design": {},
        "keep": {"metrics": ["contact.peak_N", "metric.py:zero"]},
    }
    (folder / "gone.toml").write_text(tomli_w.dumps(tables))
    done = there("study", "gone.toml", "--out", "gone", "--quiet")
    assert done.exit_code == 0, done.stderr
    pages = []
    for i in range(2):
        done = there("study", "report", "gone", "-o", f"{i}.html")
        assert done.exit_code == 0, done.stderr
        pages.append((folder / f"{i}.html").read_text())
        for name in ("own.py", "metric.py"):
            (folder / name).unlink(missing_ok=True)
    assert "controller.own = 4.0" in pages[0]
    known, gone = pages
    assert "1, 2 1/s; Mine only" in known
    assert gone == known


def test_a_row_of_a_law_that_moved_is_refused(there, folder):
    (folder / "law.py").rename(folder / "moved.py")
    done = there("run", "--from", "out", "--row", "1", "-q", "-o", "moved")
    (folder / "moved.py").rename(folder / "law.py")
    assert done.exit_code == 2
    assert done.stderr.count("error:") == 1
    assert re.search(r"laws\[\d\]\.name: no file '.*law\.py'", done.stderr)
