"""Reports about the paper and about any logs: self-contained, safe, and made from logs only."""

import csv
import dataclasses
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

from uvms_mj import McapLog, Scenario, Trace, simulate
from uvms_mj.analysis.metrics import final_force
from uvms_mj.analysis.summary import summary
from uvms_mj.cli.compare import compare
from uvms_mj.cli.console import Console
from uvms_mj.cli.paper import paper
from uvms_mj.studies.paper import report
from uvms_mj.studies.paper.claims import CLAIMS, Measured, Row, Verdict

SHORT = ("simulation.duration=0.25", "wall.position=0.002", "reference.step_time=0")
LAW = """
from dataclasses import dataclass

from uvms_mj import Fosm


@dataclass(frozen=True)
class Mine(Fosm):
    pass
"""
HOSTILE = "<script>alert('x')</script>"


class Page(HTMLParser):
    """Tags with attributes, ids, and text; reports tags that don't match."""

    VOID = ("meta", "img", "br", "link", "input", "hr")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.text.append(data)

    def of(self, *names):
        return [attributes for tag, attributes in self.tags if tag in names]


def complete_by_itself(text: str) -> Page:
    """Parse a page and check that it has no script, no form, and no external resource."""
    page = Page(text)
    assert not page.of("script", "link", "iframe", "object", "embed", "base", "form")
    for tag, attributes in page.tags:
        assert not any(name.startswith("on") for name in attributes), (tag, attributes)
    assert all(image["src"].startswith("data:image/svg+xml;base64,") and image["alt"] for image in page.of("img"))
    assert all(link["href"].startswith("#") for link in page.of("a"))
    assert not re.search(r"https?:|url\(|@import|//[a-z]", re.sub(r"base64,[A-Za-z0-9+/=]+", "", text))
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert {link["href"][1:] for link in page.of("a")} <= set(ids)
    return page


@pytest.fixture
def command(tmp_path, monkeypatch):
    """A function that runs a command with arguments in this process, in a separate folder."""
    monkeypatch.chdir(tmp_path)
    return lambda which, *arguments: CliRunner().invoke(which, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def trace():
    overrides = dict(setting.split("=") for setting in SHORT)
    return simulate(Scenario.load("push_wall", {key: float(value) for key, value in overrides.items()}))


@pytest.fixture
def picture():
    figure = Figure(figsize=(3, 2))
    figure.subplots().plot([0, 1], [1, 0])
    return report.Picture("fig03", "A line.", figure)


def test_a_page_is_complete_by_itself_and_says_everything(trace, picture):
    rows = [Row(CLAIMS[0], Measured(1.5, "so"), Verdict.holds), Row(CLAIMS[1], Measured(None), Verdict.fails)]
    page = complete_by_itself(report.page("A title", {"one": trace, "two": trace}, [picture], rows))
    text = " ".join(" ".join(page.text).split())
    assert "A title" in text
    for row in rows:
        assert row.claim.text in text
        assert row.claim.where in text
        assert row.claim.because in text
    assert "Figure 3." in text
    force, _ = final_force(trace)
    assert report.number(force) in text
    for name, version in trace.header.versions.items():
        assert f"{name} {version}" in text
    assert "wall.stiffness 100000" in text
    assert "Settings that differ" not in text


def test_a_verdict_that_no_claim_has_is_not_coloured(trace, picture):
    for verdict in Verdict:
        row = Row(CLAIMS[0], Measured(1.5), verdict)
        page = Page(report.page("t", {"one": trace}, [picture], [row]))
        assert [each["class"] for each in page.of("li") if "class" in each] == [verdict.name]
        assert all(each.value in " ".join(page.text) for each in Verdict)


def test_what_does_not_hold_is_explained_on_the_page(trace, picture):
    claim = next(claim for claim in CLAIMS if claim.explanation)
    row = Row(claim, Measured(57.0), Verdict.explained)
    assert claim.explanation in " ".join(Page(report.page("t", {"one": trace}, [picture], [row])).text)


@pytest.mark.parametrize("place", ["title", "run", "name", "description", "caption", "claim", "detail", "note"])
def test_names_are_text_wherever_they_stand(trace, picture, place):
    def hostile(name, otherwise):
        return HOSTILE if place == name else otherwise

    scenario = dataclasses.replace(trace.scenario, name=hostile("name", "n"), description=hostile("description", "d"))
    notes = (hostile("note", "a note"),)
    odd = dataclasses.replace(trace, header=dataclasses.replace(trace.header, scenario=scenario, notes=notes))
    drawn = dataclasses.replace(picture, caption=hostile("caption", "c"))
    claim = dataclasses.replace(CLAIMS[0], text=hostile("claim", "t"))
    row = Row(claim, Measured(1.5, hostile("detail", "d")), Verdict.holds)
    text = report.page(hostile("title", "t"), {hostile("run", "r"): odd}, [drawn], [row])
    assert "<script" not in text
    assert HOSTILE in "".join(complete_by_itself(text).text)


def test_what_differs_is_told_from_what_is_shared(trace, picture):
    other = dataclasses.replace(trace.header, scenario=trace.scenario.updated({"wall.stiffness": 2e4}))
    text = report.page("t", {"a": trace, "b": dataclasses.replace(trace, header=other)}, [picture])
    flat = " ".join(" ".join(Page(text).text).split())
    differing, shared = flat.split("Settings that differ between the runs")[1].split("Settings common to all runs")
    assert "wall.stiffness 100000 20000" in differing
    assert "wall.stiffness" not in shared
    assert "wall.position 0.002" in shared


def test_no_table_is_wider_than_a_page_and_each_value_stands_where_it_belongs():
    lines = [(f"quantity {q}", [f"{q} of {i}" for i in range(20)]) for q in range(17)]
    for n in (1, 3, 6, 7, 20):
        runs = [f"run {i}" for i in range(n)]
        found = report.tables("quantity", runs, [(name, values[:n]) for name, values in lines])
        cells = {
            frozenset((head, name)): cell
            for table in found
            for name, row in table.rows
            for head, cell in zip(table.heads, row, strict=True)
        }
        assert all(len(table.heads) <= report.MOST_COLUMNS for table in found)
        assert cells == {frozenset((f"quantity {q}", f"run {i}")): f"{q} of {i}" for q in range(17) for i in range(n)}


def test_a_heading_counts_many_runs_and_names_few(trace):
    assert report.named({"a": trace, "b": trace}) == "a, b"
    assert report.named({str(i): trace for i in range(20)}) == "20 runs (20 gsta)"


def test_no_folder_of_the_user_stands_on_the_page(tmp_path, picture):
    model = tmp_path / "secret" / "mine.xml"
    model.parent.mkdir()
    model.write_bytes((Path(__file__).parents[2] / "models" / "bluerov1.xml").read_bytes())
    settings = {"vehicle.model": str(model), "simulation.duration": 0.01}
    text = report.page("t", {"a": simulate(Scenario.load("push_wall", settings))}, [picture])
    assert "mine.xml" in text
    assert "secret" not in text


def test_a_run_that_is_empty_or_broke_off_has_a_page(trace, picture):
    empty = dataclasses.replace(trace, arrays={name: trace[name][:0] for name in trace})
    one = dataclasses.replace(trace, arrays={name: trace[name][:1] for name in trace})
    page = complete_by_itself(report.page("t", {"empty": empty, "one row": one}, [picture]))
    assert "–" in page.text


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Output of ``uvms-mj paper`` with runs too short for any event of the paper."""
    folder = tmp_path_factory.mktemp("paper") / "results"
    return folder, CliRunner().invoke(paper, ["--out", str(folder), *SHORT])


def test_paper_writes_what_it_says(results):
    folder, done = results
    assert done.exit_code == 1, done.output  # claims about rest cannot hold after a quarter of a second
    assert done.stdout.splitlines()[-1] == str(folder / "report.html")
    assert "fails" in done.stdout
    drawn = [*(f"fig{n:02d}" for n in range(1, 13)), "overview"]
    names = {f"{name}.{kind}" for name in drawn for kind in ("png", "svg")}
    assert names | {"claims.csv", "claims.json", "report.html", "logs"} == {path.name for path in folder.iterdir()}
    runs = ("impedance", "fosm", "gsta", "gsta_alone")
    assert {f"{run}{suffix}.mcap" for run in runs for suffix in ("", "_fine")} <= {
        p.name for p in folder.glob("logs/*")
    }
    rows = json.loads((folder / "claims.json").read_text())
    assert [row["id"] for row in rows] == [claim.id for claim in CLAIMS]
    with (folder / "claims.csv").open(newline="") as file:
        assert [row["verdict"] for row in csv.DictReader(file)] == [row["verdict"] for row in rows]
    page = complete_by_itself((folder / "report.html").read_text(encoding="utf-8"))
    text = " ".join(page.text)
    assert all(claim.text in text for claim in CLAIMS)
    assert len(page.of("img")) == 13
    assert str(folder) not in (folder / "report.html").read_text(encoding="utf-8")


def test_paper_redraws_the_same_from_logs(results, command, tmp_path):
    folder, _ = results
    done = command(paper, "--from", folder, "--out", "again", "--json")
    assert done.exit_code == 1, done.output
    answer = json.loads(done.stdout)
    assert answer["failed"] == [row["id"] for row in answer["claims"] if row["verdict"] == "fails"]
    assert Path(answer["files"]["report"]).is_file()
    assert not (tmp_path / "again" / "logs").exists()
    for name in ("report.html", "claims.json", "claims.csv", "fig07.png", "fig07.svg"):
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes(), name


def test_paper_moves_aside_what_is_there(command, tmp_path):
    (tmp_path / "r" / "logs").mkdir(parents=True)
    (tmp_path / "r" / "logs" / "gsta.mcap").write_text("old")
    (tmp_path / "r" / "report.html").write_text("old")
    (tmp_path / "r" / "notes.txt").write_text("mine")
    done = command(paper, "--out", "r", "simulation.duration=0.02")
    assert done.exit_code == 1, done.output
    assert "was moved to r/earlier-1" in done.stderr
    assert (tmp_path / "r" / "earlier-1" / "logs" / "gsta.mcap").read_text() == "old"
    assert (tmp_path / "r" / "earlier-1" / "report.html").read_text() == "old"
    assert (tmp_path / "r" / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ((), "--out DIR is missing"),
        (("--from", "nowhere"), "impedance.mcap"),
        (("--from", "nowhere", "wall.stiffness=1e4"), "only redraws existing runs; omit wall.stiffness=1e4"),
        (("--out", "r", "a", "b"), "one scenario at a time"),
        (("--out", "r", "wall.stifness=1e4"), "did you mean 'stiffness'"),
        (("--out", "file/r"), "can't write there"),
    ],
)
def test_paper_refuses_in_one_sentence(command, tmp_path, arguments, complaint):
    (tmp_path / "file").write_text("")
    done = command(paper, *arguments)
    assert done.exit_code == 2
    assert complaint in done.stderr
    assert not (tmp_path / "r").exists()
    assert not (tmp_path / "nowhere").exists()


def test_compare_makes_a_page_of_any_logs(command, tmp_path):
    (tmp_path / "<script>.py").write_text(LAW)
    settings = {"simulation.duration": 0.05, "controller.epsilon": 2e-3}
    for i, controller in enumerate(("gsta", "<script>.py:Mine")):
        overrides = {key: value for key, value in settings.items() if i or not key.startswith("controller")}
        scenario = Scenario.load("push_wall", overrides, controller)
        simulate(dataclasses.replace(scenario, name=HOSTILE), sinks=[McapLog(tmp_path / f"{i}.mcap")])
    done = command(compare, "0.mcap", "1.mcap", "--out", "page.html")
    assert done.exit_code == 0, done.output
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    page = complete_by_itself(text)
    assert "<script" not in text
    assert {"gsta", "Mine", "<script>.py:Mine"} <= {data.strip() for data in page.text}
    assert len(page.of("img")) == 5  # the last picture is for the only law with a state
    assert str(tmp_path) not in text
    again = command(compare, "0.mcap", "--out", "page.html")
    assert again.exit_code == 2
    assert "exists; choose another name" in again.stderr


def table_of(trace, capsys) -> dict[str, str]:
    """Lines of the table that ``uvms-mj run`` prints, by name."""
    Console(as_json=False, quiet=False).report(trace, summary(trace, {"mcap": "run.mcap"}))
    lines = [line.split("│") for line in capsys.readouterr().out.splitlines() if line.startswith("│")]
    return {name.strip(): value.rstrip() for _, name, value, _ in lines}


def test_a_run_too_short_for_the_wall_has_no_relative_error(capsys):
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.6}))
    assert trace.analytic.force > 0.0
    assert summary(trace, {})["contact"]["relative_error"] is None
    table = table_of(trace, capsys)
    assert "relative error" not in table
    assert table["contact"].strip() == "none"


def test_a_run_in_contact_that_has_not_settled_has_no_relative_error(trace, capsys):
    assert trace.touches[-1] > 0
    assert not final_force(trace)[1]
    assert "relative error" not in table_of(trace, capsys)


def test_the_table_prints_the_digits_that_a_run_supports(paper_run, capsys):
    trace = paper_run("gsta")
    table = table_of(trace, capsys)
    peak, first = table["peak force"].split()[0], table["first contact"].split()[0]
    assert peak == f"{trace.force_peak[-1]:.4g}"
    assert first == f"{trace.first_contact[-1]:.4g}"
    assert table["final force"].split()[0] == table["analytic force"].split()[0] == "1.497753"
    assert table["relative error"].strip() == "below 1e-9"  # and not -3.7e-11
    assert "converge" in table["error bars"]
    early = Trace.of(trace.header, trace.rows(), trace.outcome)
    early.arrays["final_high"].setflags(write=True)
    early.arrays["final_high"][-1] = early.final_low[-1] + 2e-4
    assert table_of(early, capsys)["final force"].split()[0] == "1.498"


def test_a_vehicle_that_touched_and_left_rests_with_zero_force(capsys):
    settings = {"initial.velocity": [0.2, 0, 0, 0, 0, 0], "wall.position": 0.01, "reference.target": [-0.05, 0.0, 0.0]}
    settings |= {"current.speed": 0.0, "simulation.duration": 8.0, "reference.step_time": 0.0}
    trace = simulate(Scenario.load("push_wall", settings, "impedance"))
    assert trace.touches[-1] > 0
    assert final_force(trace) == (0.0, True)
    table = table_of(trace, capsys)
    assert table["final force"].strip() == "0 N (settled)"
    assert "relative error" not in table


def test_vectors_of_the_table_stand_under_each_other(paper_run, capsys):
    table = table_of(paper_run("gsta"), capsys)
    points = [[i for i, c in enumerate(table[name]) if c == "."] for name in ("final position", "analytic position")]
    assert points[0] == points[1]
    assert len({len(number.partition(".")[2]) for number in re.findall(r"\d+\.\d+", table["final position"])}) == 1
    assert "-0.00000" not in table["final position"]


def test_each_component_of_the_largest_tau_has_three_digits(paper_run, capsys):
    """Moments are a thousand times smaller than forces, and are not 0.00 for that."""
    trace = paper_run("gsta")
    shown = [float(number) for number in table_of(trace, capsys)["largest tau"].split("N")[0].split()]
    assert shown == pytest.approx(trace.tau_max[-1], rel=5e-3)
