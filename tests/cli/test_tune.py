"""``uvms-mj tune``: what it prints, its exit status, its errors, its page."""

import json
import sys
from pathlib import Path

import pytest

from pages import HOSTILE, complete_by_itself
from short_tuning import tuning_text
from strict_json import no_constants
from uvms_mj.studies.tune import Tuning


@pytest.fixture
def tuning_file(here):
    Path("t.toml").write_text(tuning_text(trials=4, duration=0.5))


def test_a_dry_run_says_what_would_run_and_writes_nothing(here, tuning_file):
    done = here("tune", "t.toml", "--dry-run", "-n", "5")
    assert done.exit_code == 0, done.output
    for words in (
        "gain impedance.K_d[0] [N/m]: 50 to 400, logarithmic; 150 in the file",
        "objective: minimize mean contact.final_N",
        "5 trials of 2 runs",
        "time: about",
    ):
        assert words in done.stdout
    report = json.loads(here("tune", "t.toml", "--dry-run", "--json").stdout, parse_constant=no_constants)
    assert (report["trials"], report["runs"], report["gains"]) == (4, 8, ["impedance.K_d[0]"])
    assert [path.name for path in Path().iterdir()] == ["t.toml"]


def test_a_tuning_prints_one_object_and_writes_its_files(here):
    Path("t.toml").write_text(tuning_text(trials=4, duration=0.5, more=f"[keep]\nlogs = 'none'\n#{HOSTILE}"))
    done = here("tune", "t.toml", "--out", "out", "-j", "1", "--json")
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout, parse_constant=no_constants)
    assert (report["trials"], report["feasible"], report["baseline"]["trial"]) == (4, 4, 0)
    assert report["best"]["objective"] <= report["baseline"]["objective"]
    assert {path.name for path in Path("out").iterdir()} >= {"found.toml", "trials.parquet", "report.html", "tune.toml"}
    again = here("tune", "out", "-j", "1")
    assert again.exit_code == 0, again.output
    assert "uvms-mj run out/found.toml" in again.stdout
    text = complete_by_itself(Path("out/report.html").read_text()).text
    assert any("uvms-mj run out/found.toml" in each for each in text)
    assert here("run", "out/found.toml", "-q", "--out", "r", "simulation.duration=0.01").exit_code == 0


@pytest.mark.usefixtures("undrawn")
def test_no_feasible_trial_is_an_error_with_its_reason(here):
    limit = '[[constraint]]\nmetric = "contact.peak_N"\nat_most = 1e-3\n'
    Path("t.toml").write_text(tuning_text(trials=2, duration=0.05, constraint=limit))
    done = here("tune", "t.toml", "-o", "out", "-j", "1", "-q")
    assert done.exit_code == 1
    assert "no feasible trial among 2; the last one: mean contact.peak_N is" in done.stderr
    assert "No trial is feasible." in Path("out/report.html").read_text()
    assert not Path("out/found.toml").exists()


def test_a_missing_extra_is_one_line(here, tuning_file, monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "optuna"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "optuna", None)
    done = here("tune", "t.toml")
    assert done.exit_code == 2
    assert done.stderr.count("\n") == 1
    assert "pip install 'uvms-mj[tune]'" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "name a tuning"),
        (("nothing",), "no such file"),
        ((".",), "no such file"),
        (("t.toml", "tune.trial=3"), "did you mean 'trials'?"),
        (("t.toml", "gain.key=x"), "can't be set"),
        (("t.toml", "-n", "3", "tune.trials=4"), "tune.trials: is given twice, 4 and --trials 3"),
        (("t.toml", "-n", "0"), "0 is not in the range"),
    ],
)
def test_bad_arguments_are_one_message(here, tuning_file, arguments, said):
    done = here("tune", *arguments, "-q")
    assert done.exit_code == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert [path.name for path in Path().iterdir()] == ["t.toml"]


def test_the_help_shows_a_tuning_file_that_is_one(here):
    text = here("tune", "--help").stdout
    lines = [line.strip().partition("   ")[0] for line in text.splitlines()]
    start, end = lines.index("[base]"), lines.index("at_least = 1.0")
    Path("t.toml").write_text("\n".join(lines[start : end + 1]))
    tuning = Tuning.load("t.toml")
    assert (tuning.plan.runs, tuning.search.trials) == (3, 100)
    assert "Exit status:" in text
