"""The command `paper`."""

import csv
import json
from pathlib import Path

import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

from pages import complete_by_itself
from uvms_mj.cli.experiments import paper
from uvms_mj.reproduce.paper.claims import CLAIMS

SHORT = ("simulation.duration=0.25", "wall.position=0.002", "reference.step_time=0")


@pytest.fixture
def command(tmp_path, monkeypatch):
    """A function that runs a command with arguments in this process, in a separate folder."""
    monkeypatch.chdir(tmp_path)
    return lambda which, *arguments: CliRunner().invoke(which, [str(a) for a in arguments])


def unplaced(patch):
    """Figures without a layout and without insets: tests/views lays them out. Of all figures the overview alone, which
    has the panels of the others, is drawn; the others are written as empty pictures."""
    draw = Figure.draw
    patch.setattr(Figure, "draw", lambda figure, renderer: draw(figure, renderer) if len(figure.axes) > 1 else None)
    patch.setattr("matplotlib.layout_engine.ConstrainedLayoutEngine.execute", lambda *_: None)
    patch.setattr("uvms_mj.views.figures.compose.place", lambda *_: None)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Output of ``uvms-mj paper`` with runs too short for any event of the paper, in a folder with earlier files."""
    folder = tmp_path_factory.mktemp("paper") / "results"
    (folder / "logs").mkdir(parents=True)
    (folder / "logs" / "gsta.mcap").write_text("old")
    (folder / "report.html").write_text("old")
    (folder / "notes.txt").write_text("mine")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("uvms_mj.studies.pool.executors.Workers._call", lambda workers, call, *given: call(*given))
        unplaced(patch)
        return folder, CliRunner().invoke(paper, ["--out", str(folder), *SHORT])


def test_paper_writes_what_it_says(results):
    folder, done = results
    assert done.exit_code == 1, done.output  # claims about rest cannot hold after a quarter of a second
    assert done.stdout.splitlines()[-1] == str(folder / "report.html")
    assert "fails" in done.stdout
    drawn = [*(f"fig{n:02d}" for n in range(1, 13)), "overview"]
    names = {f"{name}.{kind}" for name in drawn for kind in ("png", "svg")}
    new = {"claims.csv", "claims.json", "report.html", "logs"}
    assert names | new | {"earlier-1", "notes.txt"} == {path.name for path in folder.iterdir()}
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


def test_paper_redraws_the_same_from_logs(results, command, tmp_path, monkeypatch):
    folder, _ = results
    unplaced(monkeypatch)
    done = command(paper, "--from", folder, "--out", "again", "--json")
    assert done.exit_code == 1, done.output
    answer = json.loads(done.stdout)
    assert answer["failed"] == [row["id"] for row in answer["claims"] if row["verdict"] == "fails"]
    assert Path(answer["files"]["report"]).is_file()
    assert not (tmp_path / "again" / "logs").exists()
    for name in ("report.html", "claims.json", "claims.csv", "overview.png", "overview.svg"):
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes(), name


def test_paper_moves_aside_what_is_there(results):
    folder, done = results
    assert f"was moved to {folder}/earlier-1" in " ".join(done.stderr.split())
    assert (folder / "earlier-1" / "logs" / "gsta.mcap").read_text() == "old"
    assert (folder / "earlier-1" / "report.html").read_text() == "old"
    assert (folder / "notes.txt").read_text() == "mine"
    assert {path.name for path in (folder / "earlier-1").iterdir()} == {"logs", "report.html"}


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
