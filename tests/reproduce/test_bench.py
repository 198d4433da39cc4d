"""Contact-10: its tasks, what fails each criterion, the same bytes however it is run, its comparison, its page."""

import copy
import dataclasses
import functools
import hashlib
import json
import re
import time
from pathlib import Path

import matplotlib as mpl
import pandas as pd
import pytest
from click.testing import CliRunner
from matplotlib.ft2font import FT2Font

from forked import started
from law_files import HEADER, one_liner
from pages import complete_by_itself
from short_study import HERE
from strict_json import no_constants
from uvms_mj import InputError
from uvms_mj.cli import main
from uvms_mj.control import BUILT_IN
from uvms_mj.engine.vehicle_run import PlainPythonWarning
from uvms_mj.reproduce.bench import LATEX, PAGE, RESULT, bench
from uvms_mj.reproduce.bench.draws import KNOWN, Draws
from uvms_mj.reproduce.bench.execution import jobs, warn_of_slow_laws
from uvms_mj.reproduce.bench.latex import latex_table
from uvms_mj.reproduce.bench.results import (
    FIRST_VERSION,
    broken,
    cell,
    compared,
    digest,
    document,
    ladder,
    levels_of,
    parsed,
    sentences,
    shipped,
    text,
    version,
)
from uvms_mj.reproduce.bench.task import LEVELS, Entry, chosen, entries_of, identity, law_of, tasks
from uvms_mj.studies.plan.metrics import METRICS
from uvms_mj.studies.rows import one_row
from wrong_law import AT_TOOL, FAULTS, WRONG

ROOT = Path(__file__).parents[2]
TASKS = tasks()
CRITERIA = [(name, metric) for name, task in TASKS.items() for metric in task.criteria]
CHEAP = ("gusts_and_delay", "two_bumpers")
SHIPPED = shipped()
SEEN = Draws.parsed(f"seed:{SHIPPED['draws']['seed']}")
"""The draws of the shipped result."""
ALLOCATION = """
from dataclasses import dataclass

from uvms_mj.actuation.base import Actuation, pseudo_inverse


@dataclass(frozen=True)
class Half(Actuation):
    @staticmethod
    def step(settings, state, given, state_dot, u):
        pseudo_inverse(given, u)
        u[:] = u / GAIN
"""


@pytest.fixture(scope="module")
def wrong(tmp_path_factory):
    path = tmp_path_factory.mktemp("law") / "wrong.py"
    path.write_text(WRONG)
    return f"{path}:Wrong"


def invoked(*arguments):
    return CliRunner().invoke(main, ["bench", *map(str, arguments)])


def test_there_are_ten_tasks_with_reason_literature_levels_and_criteria():
    assert [task.number for task in TASKS.values()] == list(range(1, 11))
    for task in TASKS.values():
        assert len(task.reason) > 100
        assert task.literature
        assert all(re.search(r"(19|20)\d\d", source) for source in task.literature)
        assert task.criteria.keys() == task.why.keys() <= METRICS.keys()
        assert len(task.levels) == len(LEVELS) == 5
        assert len(set(task.levels)) == 5
        assert task.truth or not task.tables.get("yardstick")


@pytest.mark.parametrize("name", TASKS)
def test_each_level_is_another_study_whose_draws_its_seed_decides(name):
    entry = Entry("gsta", "gsta")
    plans = [entry.plan(TASKS[name], level, most=3) for level in LEVELS]
    assert len({repr((plan.base.to_dict(), plan.tables["vary"])) for plan in plans}) == 5
    other = entry.plan(TASKS[name], 3, Draws.parsed("seed:3"), 3)
    assert other.points != plans[2].points
    assert other.points == entry.plan(TASKS[name], 3, Draws.parsed("seed:3"), 60).points[:3], "a prefix of the draws"


def test_tasks_at_the_body_run_on_free_body():
    for task in TASKS.values():
        plan = Entry("gsta", "gsta").plan(task, 1, most=1)
        at_tool = plan.base.task.frame != "body"
        assert plan.engine == ("mujoco" if at_tool else "free_body")


def test_prose_changes_no_digest_and_a_bound_does():
    task = TASKS["arm"]
    other = copy.deepcopy(task.tables) | {"description": "another"}
    other["about"]["reason"] = "another"
    again = dataclasses.replace(task, tables=other)
    assert again.digest == task.digest
    other["success"]["hold.error_N"] = [0.0, 1.4]
    assert again.digest != task.digest


@pytest.mark.parametrize("name", TASKS)
def test_the_sound_law_meets_every_criterion(wrong, name):
    assert broken(TASKS[name], one_row(Entry("sound", wrong).plan(TASKS[name], 1, most=1), 0)) == []


@pytest.mark.parametrize(("name", "metric"), CRITERIA)
def test_a_criterion_fails_for_the_law_that_is_wrong_in_its_way(wrong, name, metric):
    task = TASKS[name]
    own = AT_TOOL if task.tables["run"]["engine"] == "mujoco" else {}
    fault = dict(own.get(metric, FAULTS[metric]))
    if metric.startswith("hold."):  # which are written for runs of 12 to 15 s
        later = max(0.0, task.tables["base"]["simulation"]["duration"] - 15.0)
        fault |= {f"controller.{each}": fault[f"controller.{each}"] + later for each in ("start", "stop")}
    if metric == "contact.peak_N":
        fault["controller.value"] = max(60.0, 1.5 * task.criteria[metric][1])
    row = one_row(Entry("wrong", wrong, fault).plan(task, 1, most=1), 0)
    assert metric in broken(task, row)


@pytest.mark.parametrize(("name", "metric"), CRITERIA)
def test_each_criterion_fails_alone_and_without_its_number(name, metric):
    task = TASKS[name]
    good = {"status": "completed", **{each: low for each, (low, _) in task.criteria.items()}}
    assert broken(task, good) == []
    low, high = task.criteria[metric]
    for value in (high + 1e-6, low - 1.0, None, float("nan")):
        assert broken(task, good | {metric: value}) == [metric]
    assert broken(task, good | {"status": "unstable"}) == ["completed"]


def rows_of(law, name, draws):
    """The rows of a law on the first draws of level 1 of a task."""
    plan = Entry(law.rpartition(":")[2], law).plan(TASKS[name], 1, most=draws)
    return pd.DataFrame([one_row(plan, i) for i in range(draws)])


def test_a_missing_number_is_the_worst(wrong):
    """A law that never settles must not have the better median for it."""
    rows = rows_of(wrong, CHEAP[0], 2)
    rows["contact.settling_s"] = [0.5, None]
    found = cell(TASKS[CHEAP[0]], rows, 2)["metrics"]["contact.settling_s"]
    assert found == {"median": None, "worst": None, "missing": 1}


def test_a_run_that_ends_early_has_no_number(wrong):
    """Its peak and its effort until then would improve the medians."""
    rows = rows_of(wrong, CHEAP[0], 2)
    rows.loc[1, ["status", "contact.peak_N", "effort_N2s"]] = ["unstable", 0.0, 0.0]
    found = cell(TASKS[CHEAP[0]], rows, 2)
    assert found["broke"]["completed"] == 1
    assert all(spread["missing"] >= 1 and spread["worst"] is None for spread in found["metrics"].values())
    assert all(used is None for used in found["used"].values())


def test_the_use_of_a_bound_is_what_nine_draws_of_ten_stay_within():
    task = TASKS["two_bumpers"]
    row = {"status": "completed", "message": "", "seed": 0, "hold.contacts": 2}
    rows = pd.DataFrame([row | {"draw": i, "hold.error_N": 0.1 * (i + 1)} for i in range(18)])
    found = cell(task, rows)
    assert found["used"]["hold.error_N"] == pytest.approx(0.1 * 17 / task.criteria["hold.error_N"][1])
    assert found["used"]["hold.contacts"] == 1.0


def test_a_ladder_ends_below_the_first_level_that_is_not_held():
    held, failed = {"held": True}, {"held": False}
    assert ladder({1: held, 2: held, 3: failed})["level"] == 2
    assert ladder({1: failed})["level"] == 0
    assert ladder(dict.fromkeys(LEVELS, held))["level"] == 5


@pytest.fixture(scope="module")
def ran(tmp_path_factory, wrong):
    """Two laws on two tasks, two draws, in this process."""
    folder = tmp_path_factory.mktemp("bench") / "out"
    found = bench(["impedance", wrong], folder, only=CHEAP, at_most=2, executor=HERE)
    return folder, found


@pytest.mark.usefixtures("undrawn")
def test_a_killed_benchmark_in_another_folder_goes_on_with_other_workers_to_the_same_bytes(ran, wrong, tmp_path):
    folder, found = ran
    moved = tmp_path / "wrong.py"
    moved.write_text(Path(wrong.partition(":")[0]).read_text())
    laws, how = ("impedance", f"{moved}:Wrong"), ("--tasks", ",".join(CHEAP), "--at-most", "2")
    process = started("bench", *laws, "-o", "out", *how, "-j", "1", "-q", cwd=tmp_path)
    end = time.monotonic() + 60.0
    while not list(tmp_path.glob("out/*/*/*/rows/part-*")) and time.monotonic() < end:
        time.sleep(0.01)
    process.kill()
    process.join()
    assert list(tmp_path.glob("out/*/*/*/rows/part-*"))
    assert not (tmp_path / "out" / RESULT).exists()
    bench(laws, tmp_path / "out", only=CHEAP, at_most=2, workers=2)
    data = (tmp_path / "out" / RESULT).read_bytes()
    assert data == (folder / RESULT).read_bytes()
    assert str(tmp_path).encode() not in data
    assert json.loads(data, parse_constant=no_constants) == json.loads(json.dumps(found))


def test_another_content_of_the_law_is_another_digest(ran, wrong, tmp_path):
    _, found = ran
    (tmp_path / "wrong.py").write_text(WRONG.replace("20.0 *", "21.0 *"))

    def digest_of(law, gains):
        entry = Entry("Wrong", law, gains)
        return law_of(entry, entry.plan(TASKS["two_bumpers"], 1, most=1))["digest"]

    (recorded,) = (law["digest"] for law in found["laws"] if law["name"] != "impedance")
    assert digest_of(wrong, {}) == recorded
    others = digest_of(f"{tmp_path / 'wrong.py'}:Wrong", {}), digest_of(wrong, {"controller.value": 1.0})
    assert len({recorded, *others}) == 3


def test_the_page_is_complete_and_repeats_a_failed_draw(ran):
    folder, found = ran
    page = complete_by_itself((folder / PAGE).read_text())
    said = " ".join(" ".join(page.text).split())
    law = found["laws"][0]
    assert law["label"] == "impedance"
    (level, last), *_ = reversed(law["tasks"]["gusts_and_delay"]["levels"].items())
    failed = [row for row in last["rows"] if not row["passed"]]
    assert failed, "the current keeps impedance control off the wall"
    command = re.search(r"uvms-mj (run --from \S*impedance/gusts_and_delay/level-\d+ --row \d+) --out again", said)
    assert f"level-{level} " in command[1]
    done = CliRunner().invoke(main, [*command[1].split(), "--json", "--out", str(folder / "again")])
    assert done.exit_code == 0, done.output
    row = max(failed, key=lambda row: row["hold.error_N"])
    assert json.loads(done.stdout)["contact"]["peak_N"] == pytest.approx(row["contact.peak_N"], rel=1e-5)


def test_the_latex_has_a_row_for_each_law_and_names_the_versions(ran):
    folder, found = ran
    table = (folder / LATEX).read_text()
    assert found["digest"] in table
    assert table.count("\\\\\n") == 1 + 2 * len(found["laws"])
    assert all(f"{name}, version {TASKS[name].version}" in table for name in CHEAP)


@functools.cache
def roman() -> FT2Font:
    return FT2Font(str(Path(mpl.get_data_path(), "fonts", "ttf", "cmr10.ttf")))


def width_pt(text: str) -> float:
    """The width of a cell of the LaTeX table in Computer Modern, of which Matplotlib has the roman at 10 pt."""
    if box := re.match(r"\\parbox\[t\]\{(\d+)pt\}", text):
        return float(box[1])
    small = text.startswith("{\\scriptsize ")
    plain = text.removeprefix("{\\scriptsize ").removesuffix("}").replace("--", "–").replace("\\", "")
    font = roman()
    font.set_size(7.0 if small else 10.0, 72.27)
    font.set_text(plain.replace("–", "0").replace("_", "0"))  # an en dash and a rule are as wide as a digit
    return font.get_width_height()[0] / 64.0


@pytest.mark.parametrize("label", ["gsta", "W" * 60, "w" * 14, "a_label-of.words, " * 3 + "end", "W" * 14, "l" * 26])
def test_the_latex_fits_the_width_of_a_page_of_two_columns(label):
    """Of all tasks, with each number as wide as it can be."""
    widest = {name: {"runs": True, "level": 4, "levels": {"5": {"passed": 49, "draws": 60}}} for name in TASKS}
    said = latex_table(SHIPPED | {"laws": [law | {"label": label, "tasks": widest} for law in SHIPPED["laws"]]})
    table = said.text
    (columns,) = re.findall(r"begin\{tabular\}\{(.*)\}\n", table)
    number, space = re.fullmatch(r"@\{\}l\*\{(\d+)\}\{@\{\\hspace\{(\d+)pt\}\}r\}@\{\}", columns).groups()
    assert int(number) == len(TASKS)
    space = float(space) * len(TASKS)
    rows = [line.removesuffix(" \\\\").split(" & ") for line in table.splitlines() if line.count(" & ") == len(TASKS)]
    widths = [max(map(width_pt, column)) for column in zip(*rows, strict=True)]
    assert max(space + sum(widths), said.width) <= 516.0  # letters here are as wide as whole points
    assert min(widths[1:]) > 15.0, "the cells were measured"


def test_a_law_that_cant_run_on_a_task_is_named_with_the_reason(tmp_path):
    entry = Entry("observed", "impedance", {"observer.name": "momentum_observer"})
    found = {job.task.name: job for job in jobs([entry], chosen(["gust_band", "arm"]), tmp_path, KNOWN, 1)}
    assert found["gust_band"].first is not None
    assert "observes a rigid vehicle at B only" in found["arm"].reason


def test_the_yardstick_of_the_arm_has_no_current():
    plan = Entry("ideal", "ideal").plan(TASKS["arm"], 2, most=2)
    assert plan.laws[0].source == "impedance"
    assert plan.scenario(1).current.speed == 0.0
    own = Entry("gsta", "gsta").plan(TASKS["arm"], 2, most=2)
    assert plan.scenario(1).walls == own.scenario(1).walls, "everything else is that of the draw"
    assert own.scenario(1).current.speed > 0.0


def test_the_yardstick_is_told_the_truth_as_late_as_a_law_is_told_its_velocity():
    for level in LEVELS:
        plan = Entry("ideal", "ideal").plan(TASKS["gusts_and_delay"], level, most=1)
        assert plan.base.controller.delay == plan.base.navigation.velocity_delay > 0.0
        assert Entry("gsta", "gsta").plan(TASKS["gusts_and_delay"], level, most=1).base.controller.delay is None


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["controller.k_1=8", "gsta"], "a setting follows its law"),
        (["gsta", "gsta"], "'gsta' is used twice; give each law a label: label=NAME"),
        (["gsta", "k_1=8"], "k_1: belongs to the task; a law has controller.*"),
        (["gsta", "wall.stiffness=1e3"], "wall.stiffness: belongs to the task"),
        (["gsta", "controller.period=1e-4"], "controller.period: the task sets the control rate"),
        (["gsta", "impedance.F_d=[-1,0,0,0,0,0]"], "impedance.F_d: the task sets the demanded push"),
        (["gsta", "controller.name=sta"], "controller.name: give the law itself"),
        (["gsta", "label=../x"], "label: '../x' must be a text of 1 to 60 characters without / and :"),
        (["gsta", "label=bench.json"], "label: 'bench.json' must be"),
        (["gsta", "label=8"], "label: 8 must be a text"),
        (["gsta", "controller.k_1=1", "controller.k_1=2"], "controller.k_1: is given twice for gsta"),
        (["no.toml"], "no.toml: no such file"),
        (["arm"], "arm: is a task, not a law: --tasks arm"),
        (["gsta", "simulation.law_seed=3"], "simulation.law_seed: belongs to the task"),
    ],
)
def test_a_wrong_law_is_one_error(words, said):
    with pytest.raises(InputError, match=re.escape(said)):
        entries_of(words, TASKS)


def test_a_file_of_laws_has_labels_and_settings(tmp_path):
    (tmp_path / "mine.py").write_text(HEADER + one_liner("Mine", "tau_cmd[:] = signals.tau_nom"))
    laws = tmp_path / "laws.toml"
    laws.write_text('[[laws]]\nname = "gsta"\nlabel = "stiff"\ncontroller.k_1 = 8.0\n[[laws]]\nname = "mine.py:Mine"\n')
    stiff, mine = entries_of([str(laws)], TASKS)
    assert stiff.settings == {"controller.k_1": 8.0}
    assert stiff.plan(TASKS["arm"], 1, most=1).scenario(0).controller.k_1 == 8.0
    assert (mine.label, mine.source) == ("Mine", f"{tmp_path / 'mine.py'}:Mine")


def test_a_law_that_runs_nowhere_is_an_error(tmp_path):
    with pytest.raises(InputError, match=r"gsta: can't run on any task: controller.k_7: gsta has no such gain"):
        bench(["gsta", "controller.k_7=1"], tmp_path / "out", only=CHEAP, at_most=1, executor=HERE)
    assert not (tmp_path / "out").exists()


def test_a_law_that_runs_as_plain_python_is_said(tmp_path):
    (tmp_path / "slow.py").write_text(HEADER + one_liner("Slow", "import json\ntau_cmd[:] = signals.tau_nom"))
    planned = jobs([Entry("slow", f"{tmp_path / 'slow.py'}:Slow")], chosen(["two_bumpers"]), tmp_path, KNOWN, 1)
    with pytest.warns(PlainPythonWarning, match="json"):
        warn_of_slow_laws(planned)


def test_a_folder_with_other_draws_is_refused(ran, wrong):
    folder, _ = ran
    with pytest.raises(InputError, match=r"differs in .*design.runs; choose another folder"):
        bench(["impedance", wrong], folder, only=CHEAP, at_most=1, executor=HERE)


def written(folder, name, found):
    found = found | {"digest": digest(found)}
    path = folder / name
    path.write_text(text(found))
    return str(path)


def test_results_are_compared_in_the_same_draws(ran, tmp_path):
    folder, found = ran
    one = written(tmp_path, "a.json", found)
    same = compared(one, str(folder))
    assert [(pair["first"], pair["second"]) for pair in same["pairs"]] == [("impedance",) * 2, ("Wrong",) * 2]
    assert all(task["same_numbers"] for pair in same["pairs"] for task in pair["tasks"].values())
    with pytest.raises(InputError, match=r"no draw is in both; .* has known draws, .* has blind draws of the seed"):
        compared(one, "shipped")
    (pair,) = compared(f"{one}:impedance", f"{one}:Wrong")["pairs"]
    task = pair["tasks"]["gusts_and_delay"]
    ladders = [law["tasks"]["gusts_and_delay"] for law in found["laws"]]
    assert task["levels"] == [each["level"] for each in ladders]
    common = ladders[0]["levels"].keys() & ladders[1]["levels"].keys()
    passed = [sum(each["levels"][level]["passed"] for level in common) for each in ladders]
    assert task["passed"] == passed
    assert task["only"] == [0, passed[1] - passed[0]]
    assert task["difference"] == (passed[1] - passed[0]) / task["draws"]


def test_results_of_two_versions_are_not_compared(ran):
    """The first version is read, named, and compared with its like."""
    folder, _ = ran
    first = shipped(FIRST_VERSION)
    assert (version(first), version(SHIPPED)) == (1, 2)
    assert all(
        list(levels_of(task)) == ["1"] for law in first["laws"] for task in law["tasks"].values() if task["runs"]
    )
    with pytest.raises(InputError, match=r"shipped-version-1 is of version 1 of Contact-10, .* of version 2"):
        compared("shipped-version-1", str(folder))
    (pair,) = compared("shipped-version-1:gsta", "shipped-version-1:impedance")["pairs"]
    assert pair["tasks"]["unknown_current"]["passed"] == [20, 6]
    assert pair["tasks"]["unknown_current"]["levels"] == [None, None]


def test_a_comparison_says_which_law_is_better_and_stays_within_what_a_share_can_be():
    gsta, impedance = compared("shipped:gsta", "shipped:impedance"), compared("shipped:impedance", "shipped:gsta")
    for name in TASKS:
        one, other = (each["pairs"][0]["tasks"][name] for each in (gsta, impedance))
        if "reason" in one:
            continue
        more = one["passed"][0] - one["passed"][1]
        assert one["better"] == ("first" if more > 0 else "second" if more < 0 else None)
        assert all(-1.0 <= x <= 1.0 for x in (*one["interval"], *other["interval"]))
        assert one["interval"] == [-x for x in reversed(other["interval"])]
        assert one["resolved"] == (not one["interval"][0] <= 0.0 <= one["interval"][1])
        rows = [sentences(name, task, labels) for task, labels in ((one, "gi"), (other, "ig"))]
        assert rows[0][5:] == rows[1][5:], "the same words in both orders"
        assert rows[0][5].partition(",")[0] == ("g" if more > 0 else "i" if more < 0 else rows[0][5])
        assert more == 0 or rows[0][6].startswith("+")


def test_a_comparison_says_whether_it_is_valid(ran, tmp_path):
    """By a law that both results have: the same code computes the same numbers, and so may other code."""
    _, found = ran
    a = written(tmp_path, "a.json", found)
    assert compared(a, a)["valid"] is True
    other = copy.deepcopy(found)
    other["code"]["sources"] = "0123456789ab"
    result = compared(a, written(tmp_path, "b.json", other))
    assert result["valid"] is True
    draws = re.search(
        r"and 0123456789ab\), and impedance, Wrong has the same numbers in (\d+) of \1 draws", result["why"]
    )
    row = other["laws"][0]["tasks"]["two_bumpers"]["levels"]["1"]["rows"][0]
    row["contact.peak_N"] = 1.0 + (row["contact.peak_N"] or 0.0)
    result = compared(a, written(tmp_path, "b.json", other))
    assert result["valid"] is False
    assert f"has other numbers in 1 of {draws[1]} draws" in result["why"]
    other["laws"] = other["laws"][1:]
    other["laws"][0]["digest"] = "another law"
    result = compared(f"{a}:Wrong", written(tmp_path, "b.json", other))
    assert result["valid"] is None
    assert "no law is in both; run impedance with both" in result["why"]
    said = invoked("compare", f"{a}:Wrong", tmp_path / "b.json").output
    assert "not known to be valid: the code or the machine differs (sources: " in said


@pytest.mark.parametrize("label", ["@0@", '"@1@"', "@12@ @0@", "\\", '"', "{", "é"])
def test_no_label_changes_the_bytes_of_a_result(label):
    first, *others = SHIPPED["laws"][:3]
    settings = {label: [label, {label: []}], "impedance.K_f": [[1.0, 2], []], "x": {}}
    found = SHIPPED | {"laws": [first | {"label": label, "settings": settings}, *others]}
    assert json.loads(text(found)) == found


def test_an_allocation_of_a_users_file_is_looked_for_beside_the_user(tmp_path, monkeypatch):
    """As a law is: in the current folder, or beside the file of laws; the result has no folder."""
    (tmp_path / "mine").mkdir()
    names = []
    for folder, gain in (("mine", "2.0"), (".", "2.0"), (".", "3.0")):
        (tmp_path / folder / "half.py").write_text(ALLOCATION.replace("GAIN", gain))
        monkeypatch.chdir(tmp_path / folder)
        (entry,) = entries_of(["gsta", "actuation.name=half.py:Half"], TASKS)
        assert entry.settings == {"actuation.name": str(tmp_path / folder / "half.py:Half")}
        names.append(identity(entry.plan(TASKS["gust_band"], 1, most=1)))
    assert names[0] == names[1]
    assert names[0]["settings"] == {"actuation.name": "half.py:Half"}
    assert names[1]["digest"] != names[2]["digest"]
    (tmp_path / "laws.toml").write_text('[[laws]]\nname = "gsta"\nactuation.name = "half.py:Half"\n')
    monkeypatch.chdir(tmp_path / "mine")
    (entry,) = entries_of(["../laws.toml"], TASKS)
    assert Path(entry.settings["actuation.name"]).resolve() == tmp_path / "half.py:Half"


def test_another_version_of_a_task_is_left_out_and_said(ran, tmp_path):
    _, found = ran
    other = copy.deepcopy(found)
    other["tasks"]["two_bumpers"]["version"] += 1
    other["code"]["sources"] = "0123456789ab"
    a, b = written(tmp_path, "a.json", found), written(tmp_path, "b.json", other)
    result = compared(a, b)
    assert list(result["pairs"][0]["tasks"]) == ["gusts_and_delay"]
    assert any("two_bumpers is left out: its versions are 2 (" in note for note in result["notes"])
    other["tasks"]["gusts_and_delay"]["digest"] = "0"
    with pytest.raises(InputError, match=r"nothing to compare: .*gusts_and_delay is left out"):
        compared(a, written(tmp_path, "b.json", other))


def test_a_result_that_was_changed_is_refused(ran, tmp_path):
    folder, _ = ran
    data = (folder / RESULT).read_bytes()
    assert parsed(data, "a")["benchmark"] == "Contact-10"
    with pytest.raises(InputError, match="was changed since it was written"):
        parsed(data.replace(b'"passed": false', b'"passed": true', 1), "a")
    for wrong, said in ((b"{", "is not JSON"), (b"{}", "is not a result"), (b"[]", "is not a result")):
        with pytest.raises(InputError, match=said):
            parsed(wrong, "a")


@pytest.mark.usefixtures("undrawn")
def test_the_command_prints_and_refuses(ran, wrong, tmp_path):
    folder, found = ran
    done = invoked("impedance", wrong, "--tasks", ",".join(CHEAP), "--at-most", "2", "-o", folder, "-j", "1", "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["levels"] == {
        law["label"]: {name: each["level"] for name, each in law["tasks"].items()} for law in found["laws"]
    }
    done = invoked("compare", f"{folder / RESULT}:impedance", f"{folder / RESULT}:Wrong")
    assert done.exit_code == 0, done.output
    assert "two_bumpers" in done.output
    listed = invoked("tasks").output
    assert f"1. gusts_and_delay, version {TASKS['gusts_and_delay'].version}" in listed
    assert "level 5: " in listed
    (tmp_path / "short").write_bytes(b"1234")
    for arguments, said in (
        (("gst",), "can't run on any task"),
        ((str(tmp_path / "short"),), "short: can't run on any task: no law"),
        (("gsta", "--tasks", "slid"), "no task 'slid'"),
        (("gsta", "trials=-1"), "trials: -1 must be a number of trials"),
        (("gsta", "trials=0.5"), "trials: 0.5 must be a number of trials"),
        (("gsta", "--at-most", "61"), "at_most: 61 must be from 1 to 60"),
        (("gsta", "--draws", "secret:no"), "draws: no: no such file; a secret is a file of 16 random bytes or more"),
        (("gsta", "--draws", f"secret:{tmp_path / 'short'}"), "has 4 bytes; a secret has at least 16"),
        (("gsta", "--draws", "5"), "give development, seed:NUMBER or secret:FILE"),
        (("gsta", "--draws", "seed:x"), "give development, seed:NUMBER or secret:FILE"),
        (("compare", "a.json", "b.json"), "a.json: no such file"),
        (("compare", f"{folder / RESULT}:gst", str(folder / RESULT)), "no law 'gst'"),
    ):
        done = invoked(*arguments, *(() if arguments[0] == "compare" else ("-o", tmp_path / "no")))
        assert done.exit_code == 2, done.output
        assert said in done.output
        assert not (tmp_path / "no").exists()


def test_blind_draws_differ_by_their_secret_and_the_result_has_its_digest_alone(tmp_path):
    secrets = []
    for i, name in enumerate(("one", "two")):
        (tmp_path / name).write_bytes(bytes([i]) * 32)
        drawn = Draws.parsed(f"secret:{tmp_path / name}")
        secrets.append(drawn)
        assert drawn.named() == {"kind": "secret", "digest": hashlib.sha256(bytes([i]) * 32).hexdigest()}
    seeds = {(each.kind, each.key): each.seed("arm", 1) for each in (KNOWN, Draws.parsed("seed:1"), *secrets)}
    assert len(set(seeds.values())) == 4
    assert secrets[0].seed("arm", 1) != secrets[0].seed("arm", 2) != secrets[0].seed("waves", 2)
    assert Draws.parsed("development") == KNOWN
    assert not KNOWN.blind
    assert secrets[0].blind


def test_a_document_has_no_place_time_or_host(ran):
    _, found = ran
    assert not re.search(r'"[^"]*(wall_time|host|date|folder)[^"]*"', text(found))
    laws = found["laws"]
    again = document([TASKS[name] for name in found["tasks"]], laws, found["code"], KNOWN, 2)
    assert again == found


def test_the_shipped_result_is_of_these_tasks_and_of_all_shipped_laws():
    assert {name: (task["version"], task["digest"]) for name, task in SHIPPED["tasks"].items()} == {
        name: (task.version, task.digest) for name, task in TASKS.items()
    }, "run uvms-mj bench --out FOLDER, then scripts/draw_docs.py contact10 --folder FOLDER"
    each = [[name] if BUILT_IN[name].uses_truth else [name, f"{name}, tuned"] for name in BUILT_IN]
    assert [law["label"] for law in SHIPPED["laws"]] == [label for labels in each for label in labels]
    assert SHIPPED["draws"] == {"kind": "seed", "seed": SHIPPED["draws"]["seed"], "most": 60}, "blind, and whole"


@pytest.mark.parametrize(("name", "metric"), CRITERIA)
def test_no_criterion_is_met_by_all_laws_in_all_draws_or_by_none(name, metric):
    cells = [each for law in SHIPPED["laws"] for each in levels_of(law["tasks"][name]).values()]
    broke = [row["broke"] for each in cells for row in each["rows"]]
    failed = sum(metric in each for each in broke)
    assert 0 < failed < len(broke)


@pytest.mark.parametrize(("name", "level"), [(name, level) for name in TASKS for level in LEVELS])
def test_each_level_is_held_by_a_law_and_not_by_another(name, level):
    reached = {law["label"]: law["tasks"][name] for law in SHIPPED["laws"] if law["tasks"][name]["runs"]}
    held = [label for label, ladder in reached.items() if ladder["level"] >= level]
    assert 0 < len(held) < len(reached)


@pytest.mark.parametrize("name", TASKS)
def test_a_force_control_holds_the_first_level_and_no_law_the_last_but_the_one_that_is_told_the_truth(name):
    laws = {law["label"]: law["tasks"][name] for law in SHIPPED["laws"] if not law["knows_the_truth"]}
    assert max(laws[label]["level"] for label in ("parallel", "parallel, tuned")) >= 1
    assert max(task["level"] for task in laws.values()) < 5


def test_the_shipped_result_is_of_the_laws_that_the_page_names():
    """By their digests: the command on the page runs them again."""
    entries = entries_of([str(ROOT / "docs/evidence/contact10_laws.toml")], TASKS)
    assert [entry.label for entry in entries] == [law["label"] for law in SHIPPED["laws"]]
    for entry, law in zip(entries, SHIPPED["laws"], strict=True):
        assert law_of(entry, entry.plan(TASKS["gusts_and_delay"], 1, most=1))["digest"] == law["digest"]


def test_the_yardstick_has_the_structure_of_its_task_and_is_told_the_truth():
    """On the draws of the laws but for the key that it is told, which is drawn for it anew, from the same range."""
    task = TASKS["everything_real"]
    law, told = (Entry(name, name).plan(task, 5, most=4) for name in ("parallel", "ideal"))
    assert told.laws[0].source == "ideal_parallel"
    assert all(Entry("ideal", "ideal").plan(each, 1, most=1) for each in TASKS.values())
    for i in range(4):
        one, other = (plan.scenario(i) for plan in (law, told))
        assert 12.0 <= other.thrusters.voltage == other.thrusters.assumed_voltage <= 16.0
        assert one.thrusters.assumed_voltage == 16.0 != one.thrusters.voltage
        assert one.vehicle == other.vehicle
        assert one.current == other.current
    assert Entry("x", "ideal_parallel").knows, "whoever names it is told the truth, and marked so"


def same(one, other):
    """Whether two draws are the same, their errors but for the last digits of another processor."""
    return one["broke"] == other["broke"] and one["hold.error_N"] == pytest.approx(other["hold.error_N"], rel=0.01)


FIRST = 1
"""Draws of the shipped result that are run again for each law."""


@pytest.mark.slow
@pytest.mark.parametrize("name", CHEAP)
def test_the_first_draws_of_the_shipped_result_are_what_the_laws_do(name):
    for law in SHIPPED["laws"]:
        if law["label"].endswith(", tuned"):
            continue  # the same code with other numbers
        gains = {} if law["knows_the_truth"] else {f"controller.{key}": value for key, value in law["gains"].items()}
        entry = Entry(law["label"], law["name"], {**gains, **law["settings"]})
        shown = levels_of(law["tasks"][name])["1"]["rows"][:FIRST]
        rows = pd.DataFrame([one_row(entry.plan(TASKS[name], 1, SEEN), i) for i in range(FIRST)])
        assert all(map(same, cell(TASKS[name], rows, FIRST)["rows"], shown)), law["label"]
