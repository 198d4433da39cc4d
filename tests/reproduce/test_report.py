"""Reports about the paper and about any logs: self-contained and safe."""

import dataclasses
from pathlib import Path

import pytest

from pages import HOSTILE, Page, complete_by_itself
from uvms_mj import Scenario, simulate
from uvms_mj.reproduce.claims import Measured, Row, Verdict
from uvms_mj.reproduce.paper import report
from uvms_mj.reproduce.paper.claims import CLAIMS
from uvms_mj.studies.pages import number
from uvms_mj.views.figures.style import Figure

SHORT = ("simulation.duration=0.25", "wall.position=0.002", "reference.step_time=0")


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
    assert number(trace.force_peak[-1]) in text
    for name, version in trace.header.versions.items():
        assert f"{name} {version}" in text
    assert "wall.stiffness 100000" in text
    assert "Settings that differ" not in text


def test_a_run_that_has_not_settled_has_no_force_at_rest(trace):
    values = {name: found for name, _, (found,) in report.measured({"one": trace})}
    assert values["contact force at rest"] is None
    assert values["steady force error"] is None
    assert values["impact peak"] > 0.0


def test_a_run_whose_impedance_error_is_not_known_has_a_page_without_it(picture):
    """Two bumpers on a pile."""
    pile = simulate(Scenario.load("press_pile", {"simulation.duration": 0.2}), engine="free_body")
    values = {name: found for name, _, (found,) in report.measured({"one": pile})}
    assert values["impedance error, rms, whole run"] is None
    assert values["touches"] == 0
    complete_by_itself(report.page("A title", {"one": pile}, [picture]))


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
    assert report.names_of({"a": trace, "b": trace}) == "a, b"
    assert report.names_of({str(i): trace for i in range(20)}) == "20 runs (20 gsta)"


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
