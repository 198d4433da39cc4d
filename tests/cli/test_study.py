"""``uvms-mj study``: what it prints, its exit status, its errors."""

import json
from pathlib import Path

import pandas as pd
import pytest

from short_study import study_text
from strict_json import no_constants
from uvms_mj import InputError, Study
from uvms_mj.files import locked
from uvms_mj.studies.rows import CHECK


@pytest.fixture
def study_file(here):
    Path("s.toml").write_text(study_text(runs=2))


def test_a_dry_run_says_what_would_run_and_writes_nothing(here, study_file):
    done = here("study", "s.toml", "--dry-run")
    assert done.exit_code == 0, done.output
    for words in ("4 runs", "1200 time steps", "wall.stiffness [N/m]: loguniform", "gsta, impedance", "time: about"):
        assert words in done.stdout
    assert "disk: " in done.stdout
    report = json.loads(here("study", "s.toml", "--dry-run", "--json").stdout, parse_constant=no_constants)
    assert (report["runs"], report["steps"], report["varied"]) == (4, 1200, ["wall.stiffness"])
    assert report["seconds"] > 0.0
    assert [path.name for path in Path().iterdir()] == ["s.toml"]


def test_a_dry_run_says_what_the_folder_has(here, study_file):
    assert here("study", "s.toml", "--out", "out", "--quiet").exit_code == 0
    assert "time: every run is done" in here("study", "s.toml", "--out", "out", "--dry-run").stdout
    other = here("study", "s.toml", "--out", "out", "--dry-run", "design.seed=9")
    assert (other.exit_code, other.stdout) == (2, "")
    assert "which differs in design.seed; choose another folder" in other.stderr


def test_a_table_says_how_many_runs_are_done(here, study_file):
    assert here("study", "s.toml", "--out", "out", "--quiet").exit_code == 0
    Path("out/rows/part-00001.parquet").unlink()
    assert "s: 3 of 4 runs" in here("study", "table", "out").stdout
    here("study", "table", "out", "--out", "t.tex")
    assert Path("t.tex").read_text().startswith("% study s: 3 of 4 runs\n")


def test_a_study_prints_its_head_and_a_table_or_one_object(here, study_file):
    done = here("study", "s.toml", "--out", "out", "design.runs=3", "-j", "1")
    assert done.exit_code == 0, done.output
    assert "6 runs" in done.stderr
    assert "gsta" in done.stdout
    assert len(pd.read_parquet("out/rows")) == 6
    done = here("study", "out", "--json")
    report = json.loads(done.stdout, parse_constant=no_constants)
    assert (report["status"], report["engine"]) == ({"completed": 6}, {"free_body": 6})
    assert report["check"] == {"within": True, "largest": []}
    assert done.stderr == ""
    assert here("study", "out", "-q").output == ""


def test_the_engines_are_compared_and_a_difference_fails_the_study(here, monkeypatch):
    Path("s.toml").write_text(study_text(runs=4, engine="auto"))
    done = here("study", "s.toml", "-o", "out", "-j", "2", "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)["check"]
    assert found["within"]
    largest = {each["number"]: each["difference"] for each in found["largest"]}
    assert largest["status"] == 0.0
    assert largest["contact.peak_N"] < 1e-4
    assert all(largest[f"final.position_m.{axis}"] < 1e-6 for axis in "xyz")
    table = Study.load("out").check
    assert table["index"].nunique() >= 5
    assert table["within"].all()
    done = here("study", "s.toml", "-o", "strict", "-j", "2", "-q", "run.tolerance=0")  # they round differently
    assert done.exit_code == 4
    assert "differs by" in done.stderr
    assert "which exceeds run.tolerance, 0" in done.stderr
    row = int(done.stderr.split("row ")[1].split(",")[0])
    assert row in set(check_of("strict").query("not within")["index"])


def check_of(folder):
    return pd.read_parquet(Path(folder, CHECK))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "name a study"),
        (("nothing",), "neither a file nor built in"),
        (("s.toml", "t.toml"), "one study at a time"),
        (("s.toml", "wall.stifness=1"), "did you mean 'stiffness'?"),
        (("s.toml", "--engine", "bullet"), "'bullet' is not one of"),
        (("s.toml", "--engine", "mujoco", "run.engine=free_body"), "is given twice"),
        (("s.toml", "--workers", "0"), "0 is not in the range"),
        (("s.toml", "--scheduler", "tcp://127.0.0.1:9", "-j", "2"), "--workers is for this machine"),
        (("s.toml", "-o", "/proc/nothing"), "can't write there"),
        ((".",), "not the folder of a study"),
    ],
)
def test_bad_arguments_are_one_message(here, study_file, arguments, said):
    done = here("study", *arguments, "-q")
    assert done.exit_code == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert [path.name for path in Path().iterdir()] == ["s.toml"]


def test_a_study_that_is_refused_for_want_of_a_gpu_leaves_nothing(here, study_file, monkeypatch):
    def no_gpu():
        raise InputError("no GPU here")

    monkeypatch.setattr("uvms_mj.studies.fleets.DEVICES", {"gpu": no_gpu})
    done = here("study", "s.toml", "--engine", "gpu", "--out", "new/folder", "-q")
    assert (done.exit_code, done.stderr) == (2, "error: no GPU here\n")
    assert [path.name for path in Path().iterdir()] == ["s.toml"]


@pytest.mark.parametrize("there", [(), ("new",), ("new", "new/folder")])
def test_a_folder_that_was_not_there_is_there_only_with_results(tmp_path, there):
    """Whatever ends the command: a folder that was there before stays, and so does one with a result in it."""
    folder = tmp_path / "new" / "folder"
    for name in there:
        (tmp_path / name).mkdir()
    before = sorted(tmp_path.rglob("*"))

    def filled(end, *results):
        with locked(folder):
            assert folder.is_dir()
            for name in results:
                (folder / name).touch()
            raise end("refused")

    for end in (InputError, KeyboardInterrupt):
        with pytest.raises(end):
            filled(end)
        assert sorted(tmp_path.rglob("*")) == before
    with pytest.raises(InputError):
        filled(InputError, "result")
    assert (folder / "result").is_file()
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="can't write there"), locked(tmp_path / "file" / "new"):
        raise AssertionError


def test_shipped_studies_are_listed(here):
    done = here("study", "list")
    assert done.exit_code == 0, done.output
    assert isinstance(json.loads(here("study", "list", "--json").stdout), dict)


def test_the_help_shows_a_study_file_that_is_one(here):
    text = here("study", "--help").stdout
    lines = [line.strip().partition("   ")[0] for line in text.splitlines()]
    start, end = lines.index("[base]"), lines.index("high = 2e5")
    Path("least.toml").write_text("\n".join(lines[start : end + 1]))
    assert Study.load("least.toml").plan.runs == 60
    assert "Exit status:" in text


def test_a_study_is_no_log_and_a_run_of_it_needs_its_row(here, study_file):
    Path("out").mkdir()
    Path("out/study.toml").write_text(Path("s.toml").read_text())
    done = here("run", "--from", "out")
    assert done.exit_code == 2
    assert "is the folder of a study; name one of its runs with --row N" in done.stderr
