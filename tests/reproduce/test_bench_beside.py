"""A result of the benchmark with the rows of another one below its own: in the table, on the page, in the figure."""

import copy
import functools
import itertools
import json
import re
from pathlib import Path

import pytest
from matplotlib.text import Text

from uvms_mj import InputError
from uvms_mj.analysis.summary import NUMBERS
from uvms_mj.reproduce.bench import results
from uvms_mj.reproduce.bench.figures import order
from uvms_mj.reproduce.bench.latex import comparison, latex_table
from uvms_mj.reproduce.bench.page import table
from uvms_mj.reproduce.bench.results import drawn
from uvms_mj.reproduce.bench.task import tasks
from uvms_mj.views.figures.style import typeset


@pytest.fixture(scope="module", autouse=True)
def _read_once():
    """The result of the package is large; no test changes it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(results, "shipped", functools.cache(results.shipped))
        yield


def own(label: str = "mine", law: str = "gsta", some: int = 3) -> dict:
    """A result of a law of one's own, with a shipped law's numbers on some tasks."""
    whole = results.shipped()
    names = list(whole["tasks"])[:some]
    (mine,) = (each for each in whole["laws"] if each["label"] == law)
    mine = mine | {"label": label, "digest": "0" * 16, "tasks": {name: mine["tasks"][name] for name in names}}
    few = copy.deepcopy(whole | {"laws": [mine], "tasks": {name: whole["tasks"][name] for name in names}})
    return few | {"digest": results.digest(few)}


def test_the_table_has_own_and_shipped_rows_of_the_own_tasks():
    both = results.beside(own(), "shipped")
    table = latex_table(both).text
    heads, mine, *others = re.findall(r"^([\w\\. ()]+) & .*\\\\$", table, re.M)[:3]
    assert (heads, mine) == ("law", "mine")
    shipped = [law["label"] for law in results.shipped()["laws"]]
    assert [law["label"] for law in both["laws"]] == ["mine", *shipped]
    assert table.index("mine &") < table.rindex("\\midrule") < table.index("impedance &")
    assert table.count("\\midrule") == 2
    for line in table.splitlines():
        if line.endswith("\\\\") and not line.startswith("\\"):
            assert line.count("&") == 3, line
    assert f"result {results.shipped()['digest']}; {drawn(results.shipped())}" in table
    assert others


def test_the_figure_has_a_bar_for_each_law_that_runs():
    both = results.beside(own(some=2), "shipped")
    figure = order(both, {law["label"]: "#336699" for law in both["laws"]})
    for ax, name in zip(figure.axes, both["tasks"], strict=True):
        assert len(ax.patches) == sum(law["tasks"][name]["runs"] for law in both["laws"])
        assert "mine" in [text.get_text() for text in ax.texts]


def test_a_label_of_both_is_told_apart_and_a_law_of_both_is_there_once():
    labels = [law["label"] for law in results.beside(own("gsta"), "shipped")["laws"]]
    assert labels[0] == "gsta"
    assert "gsta (shipped)" in labels
    assert len(set(labels)) == len(labels)
    same = results.shipped()
    one = same | {"laws": [law for law in same["laws"] if law["label"] == "fosm"]}
    labels = [law["label"] for law in results.beside(one, "shipped")["laws"]]
    assert labels.count("fosm") == 1
    assert [law["label"] for law in results.beside(one, "shipped:gsta")["laws"]] == ["fosm", "gsta"]
    with pytest.raises(InputError, match="no other law"):
        results.beside(same, "shipped")


def test_another_result_without_the_tasks_is_refused_before_a_run(here, tmp_path):
    few = own(some=2)
    Path("few.json").write_text(results.text(few))
    missing = [name for name in tasks() if name not in few["tasks"]]
    done = here("bench", "gsta", "--with", "few.json", "--out", "out", "--at-most", "1")
    assert done.exit_code == 2
    assert all(name in done.stderr for name in missing)
    assert not (tmp_path / "out").exists()
    done = here("bench", "gsta", "--with", "shipped-version-1", "--out", "out")
    assert "is of version 1" in done.stderr
    assert "no such file" in here("bench", "gsta", "--with", "nowhere.json", "--out", "out").stderr


def test_the_command_writes_both_and_the_result_has_the_own_laws_alone(here):
    task = next(iter(tasks()))
    how = ("--tasks", task, "--at-most", "1", "--json")
    done = here("bench", "gsta", "controller.k_1=7", *how, "--out", "out", "--with", "shipped:fosm")
    assert done.exit_code == 0, done.stderr
    assert list(json.loads(done.stdout)["levels"]) == ["gsta"]
    assert [law["label"] for law in json.loads(Path("out/bench.json").read_text())["laws"]] == ["gsta"]
    assert "fosm & " in Path("out/table.tex").read_text()
    assert "Rows of another result" in Path("out/report.html").read_text()


def test_the_table_of_a_task_says_over_which_time_its_numbers_are():
    caption = table(results.shipped(), next(iter(tasks().values()))).caption
    named = {"hold.error_N": "last 5 s", "hold.bias_N": "last 5 s", "chattering_N_per_s": "last second"}
    for name, words in named.items():
        assert NUMBERS[name].meaning in caption
        assert words in NUMBERS[name].meaning


def test_a_comparison_is_a_table_for_a_paper(here):
    done = here("bench", "compare", "shipped:gsta", "shipped:dob_impedance", "--out", "pairs.tex")
    assert done.exit_code == 0, done.stderr
    text = Path("pairs.tex").read_text()
    rows = [line for line in text.splitlines() if line.endswith("\\\\")]
    found = results.compared("shipped:gsta", "shipped:dob_impedance")
    (pairs,) = comparison(found)
    assert "dob\\_impedance" in rows[0]
    assert all(row.count("&") - row.count("\\&") == 4 for row in rows)
    assert pairs.width <= 516.0
    assert ("put it in table*" in done.stderr) == (pairs.width > 252.0)
    for name, task in found["pairs"][0]["tasks"].items():
        (at,) = (i for i, row in enumerate(rows) if row.startswith(name.replace("_", "\\_")))
        value, low, high = (round(100.0 * each) for each in (task["difference"], *task["interval"]))
        assert rows[at].endswith(f"& {f'{value:+d}' if value >= 0 else f'$-${-value}'} \\\\")
        assert "-" not in rows[at + 1].replace("$-$", "")
        assert all(str(abs(each)) in rows[at + 1] for each in (low, high))
    assert "at least 50~\\%" in text, "ten intervals of 95 %"
    assert "all 10 at once with at least 50 %" in " ".join(done.stdout.split())
    assert here("bench", "compare", "shipped:gsta", "shipped:sta", "--out", "pairs.tex").exit_code == 2
    assert "must end in .tex" in here("bench", "compare", "shipped:gsta", "shipped:sta", "--out", "p.csv").stderr


def test_the_order_of_the_laws_is_a_figure_in_the_width_of_a_paper_with_a_legible_text(here):
    how = ("shipped:gsta", "--with", "shipped:sta", "--fonts", "serif")
    for width, inches in (("ieee-column", 252 / 72.27), ("page", 516 / 72.27)):
        done = here("bench", "plot", *how, "--width", width, "--out", "order.pdf", "--force")
        assert done.exit_code == 0, done.stderr
        (box,) = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ", Path("order.pdf").read_bytes())
        assert float(box) == pytest.approx(72.0 * inches, abs=0.01)
    for width in (252 / 72.27, 516 / 72.27):
        with typeset("serif", width):
            figure = order(results.shipped(), {law["label"]: "#336699" for law in results.shipped()["laws"]})
        assert min(text.get_fontsize() for text in figure.findobj(Text) if text.get_text()) >= 6.0
        ends = {ax.get_position().x0: ax for ax in figure.axes}.values()  # the last panel of each column
        assert all(ax.xaxis.get_tick_params()["labelbottom"] for ax in ends)


def test_a_table_is_made_from_a_result_and_nothing_runs(here, tmp_path):
    Path("mine.json").write_text(results.text(own()))
    done = here("bench", "table", "mine.json", "--with", "shipped:sta", "--out", "table.tex")
    assert done.exit_code == 0, done.stderr
    assert Path("table.tex").read_text() == latex_table(results.beside(own(), "shipped:sta")).text
    assert here("bench", "table", "mine.json").stdout == latex_table(own()).text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.json", "table.tex"]
    assert here("bench", "table", "mine.json", "--out", "table.tex").exit_code == 2
    assert "must end in .tex" in here("bench", "table", "mine.json", "--out", "table.csv").stderr
    assert "lacks these tasks" in here("bench", "table", "shipped:gsta", "--with", "mine.json").stderr
    assert "version 1" in here("bench", "table", "shipped-version-1").stderr


def test_the_note_of_the_table_names_its_tasks_and_draws():
    """The heads are numbers, so that a paper needs their names."""
    mine = own()
    table = latex_table(results.beside(mine, "shipped:sta"))
    for name, task in mine["tasks"].items():
        assert f"{task['number']}: {name.replace('_', ' ')}" in table.note
    assert drawn(mine).capitalize() in table.note
    assert table.names == ["mine", "sta"]
    for column, (name, task) in zip(table.columns, mine["tasks"].items(), strict=True):
        assert column.head == str(task["number"])
        assert column.cells[0].value == str(mine["laws"][0]["tasks"][name]["level"])


def test_of_one_result_every_two_laws_are_compared(here):
    """Each pair is as two results of one law each give it."""
    names = [law["label"] for law in results.shipped()["laws"]]
    found = results.compared("shipped")
    assert [(pair["first"], pair["second"]) for pair in found["pairs"]] == [*itertools.combinations(names, 2)]
    (pair,) = results.compared("shipped:gsta", "shipped:sta")["pairs"]
    assert pair in found["pairs"]
    assert "name a second result" in here("bench", "compare", "shipped:gsta").stderr


def test_words_of_a_paper_stand_in_place_of_laws_and_tasks(here):
    names = list(own()["tasks"])
    words = {"mine": "ours", "sta": "STA", names[0]: "other words"}
    both = results.beside(own(), "shipped:sta")
    found = results.renamed(both, words)
    assert latex_table(found).names == ["ours", "STA"]
    assert "From STA on" in latex_table(found).note or drawn(both) == drawn(both["beside"])
    assert list(found["tasks"]) == ["other words", *names[1:]]
    assert [law["tasks"]["other words"] for law in found["laws"]] == [law["tasks"][names[0]] for law in both["laws"]]
    Path("mine.json").write_text(results.text(own()))
    given = ("mine.json:mine", "shipped:sta")
    done = here(
        "bench", "compare", *given, "--label", f"{names[0]}=other words", "--label", "sta=STA", "--out", "p.tex"
    )
    assert done.exit_code == 0, done.stderr
    assert "STA" in done.stdout
    assert "other words" in Path("p.tex").read_text()
    assert "did you mean" in here("bench", "compare", *given, "--label", "stb=STA").stderr
    done = here("bench", "plot", "mine.json", "--label", "mine=ours", "--height", "50mm", "--out", "order.pdf")
    assert done.exit_code == 0, done.stderr
    (box,) = re.findall(rb"/MediaBox \[ 0 0 [\d.]+ ([\d.]+) ", Path("order.pdf").read_bytes())
    assert float(box) == pytest.approx(50.0 / 25.4 * 72.0, abs=0.01)


def test_results_of_other_draws_are_not_compared(here):
    other = own()
    for ladder in other["laws"][0]["tasks"].values():
        for row in (row for level in ladder["levels"].values() for row in level["rows"]):
            row["seed"] += 1
    other["draws"] |= {"seed": 7}
    Path("other.json").write_text(results.text(other | {"digest": results.digest(other)}))
    done = here("bench", "compare", "other.json:mine", "shipped:gsta")
    assert done.exit_code == 2
    assert "no draw is in both" in done.stderr
    assert "the seed 7" in done.stderr
