"""The guides show the examples as they are, and agree with the program."""

import dataclasses
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from draw_rooms import BEFORE, BETWEEN, CHAIN, SUBJECTS, floors
from page_numbers import page
from uvms_mj.envs.push import ARGUMENTS, OBSERVED
from uvms_mj.stages import signals
from uvms_mj.studies.plan import Plan, study_file
from uvms_mj.studies.plan.metrics import MEANINGS, unit_of_column
from uvms_mj.studies.tune import Tuning
from uvms_mj.studies.tune import tables as tune_tables

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
EXTENDING = page("extending").read_text()
STUDIES = page("studies").read_text()
ENVIRONMENTS = page("environments").read_text()
GUIDES = EXTENDING + ENVIRONMENTS + (ROOT / "README.md").read_text()
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
GROUPS = ("CLOCK", "MEASURED", "TRUE", "REFERENCE", "ERRORS", "ESTIMATES", "APPLIED", "IMPEDANCE", "TASK")


@pytest.mark.parametrize("arguments", sorted(set(re.findall(r"^uvms-mj run (.*examples/.*)$", GUIDES, re.MULTILINE))))
def test_commands_run(arguments, tmp_path):
    short = ["--set", "simulation.duration=0.01", "-q", "--out", str(tmp_path / "out")]
    command = [sys.executable, "-m", "uvms_mj", "run", *shlex.split(arguments), *short]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=240.0)
    assert done.returncode == 0, done.stderr
    assert "plain Python" not in done.stderr, "an example must compile"


@pytest.mark.parametrize("name", sorted(set(re.findall(r"\((?:\.\./)*examples/(\w+\.py)\)", GUIDES))))
def test_examples_are_shown_as_they_are(name):
    """From the imports to the command line: the docstring of the file is text of the guide."""
    code = (EXAMPLES / name).read_text().split('"""\n\n', 1)[1].partition("\n\nif __name__")[0].strip()
    assert code in GUIDES


def test_every_example_is_in_a_guide():
    assert [path.name for path in EXAMPLES.iterdir() if path.is_file() and path.name not in GUIDES] == []


def test_the_arguments_of_an_environment_are_those_of_the_program():
    rows = re.findall(r"^\| `(\w+)` \|", ENVIRONMENTS, re.MULTILINE)
    assert rows == ARGUMENTS
    assert all(f"`{name}`" in ENVIRONMENTS for name in OBSERVED)


@pytest.mark.parametrize("group", GROUPS)
def test_signals_are_those_of_the_program(group):
    part = EXTENDING.split(f"**{group}**")[1].split("\n\n")[1]
    rows = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in part.splitlines()[2:]]
    expected = [
        [f"`{s.name}`", " x ".join(map(str, s.shape)) or "number", s.unit, s.frame, s.meaning.replace("|", "\\|")]
        for s in getattr(signals, group)
    ]
    assert rows == expected


def test_allocation_is_that_of_the_program():
    for signal in (*signals.actuation_given(99)[-4:], *signals.thrusters_given(99)[-2:]):
        shape = " x ".join(str(size).replace("99", "n") for size in signal.shape)
        assert f"| `{signal.name}` | {shape} | {signal.unit} | {signal.frame} | {signal.meaning} |" in EXTENDING


def test_the_drawing_has_the_rooms_of_the_import_contract():
    rooms = [room for floor in floors() for room in floor]
    assert sorted(rooms) == sorted(SUBJECTS)
    package = {path.stem for path in (ROOT / "src" / "uvms_mj").iterdir() if path.suffix in ("", ".py")}
    assert set(rooms) == package - {"__init__", "__main__", "scenarios", "__pycache__", "py.typed"}


@pytest.mark.parametrize("picture", sorted((ROOT / "docs").rglob("*.svg")), ids=lambda path: path.name)
def test_a_drawing_is_small(picture):
    assert picture.stat().st_size <= 100_000


def test_the_drawing_of_an_instant_has_the_stages_of_the_table_in_their_order():
    table = page("architecture").read_text().split("| stage | in a run |")[1].split("\n\n")[0]
    drawn = [BEFORE[0]]
    for stage, *_ in CHAIN:
        drawn += [stage, *(name for name, *_ in reversed(BETWEEN.get(stage, [])))]
    assert re.findall(r"^\| ([a-z, ]+) \|", table, re.MULTILINE) == drawn
    picture = page("architecture").with_name("instant.svg").read_text()
    assert all(f">{name}</text>" in picture for name in drawn)


def test_the_keys_of_a_study_and_of_a_tuning_are_those_of_the_program():
    tables = {name: part for name, part in study_file.TABLES.items() if name} | dict(tune_tables.TABLES)
    keys = {f"{table}.{field.name}" for table, part in tables.items() for field in dataclasses.fields(part)}
    rows = [
        cell for row in re.findall(r"^\| (`.*?) \|", STUDIES, re.MULTILINE) for cell in re.findall(r"`([\w.]+)`", row)
    ]
    assert {row for row in rows if row.partition(".")[0] in tables and "." in row} == keys
    assert {field.name for field in dataclasses.fields(study_file.StudyFile)} - {*tables} <= {*rows, "base"}


def test_the_study_and_the_tuning_of_the_guide_are_valid(tmp_path):
    study, tuning = re.findall(r"```toml\n(.*?)```", STUDIES, re.DOTALL)
    for name, text in (("mine.toml", study), ("tune.toml", tuning)):
        (tmp_path / name).write_text(text)
    assert Plan.load(tmp_path / "mine.toml").runs == 60
    found = Tuning.load(tmp_path / "tune.toml")
    assert (found.plan.runs, found.search.trials, len(found.gains)) == (20, 100, 2)


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_links_lead_somewhere(path):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", path.read_text()):
        assert (path.parent / target).exists(), target


def test_metrics_are_those_of_the_program():
    rows = re.findall(r"^\| `([\w.]+)` \| ([^|]*) \| ([^|]*) \|$", STUDIES, re.MULTILINE)
    found = {name: (unit, meaning.partition("; `.")[0]) for name, unit, meaning in rows}
    assert {name: found.get(name) for name in MEANINGS} == {
        name: (unit_of_column(name), meaning) for name, meaning in MEANINGS.items()
    }
