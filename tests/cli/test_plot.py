"""The command `plot`."""

import re
import shutil
import subprocess
import zlib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.lines import Line2D

from uvms_mj import McapLog, Scenario, Trace, simulate
from uvms_mj.cli.plot import FORMATS, WHATS, plot
from uvms_mj.views import figures
from uvms_mj.views.figures import style


@pytest.mark.usefixtures("undrawn")
def test_plot_replaces_with_force_only(here):
    here("run", "-q", "simulation.duration=0.05", "-o", "r")
    for command in (("plot", "--what", "force", "--out", "x.svg"), ("export", "--out", "x.npz")):
        arguments = (command[0], "r/run.mcap", *command[1:])
        assert here(*arguments).exit_code == 0
        again = here(*arguments)
        assert again.exit_code == 2
        assert "--force" in again.stderr
        Path(command[-1]).write_text("")
        assert here(*arguments, "--force").exit_code == 0
        assert Path(command[-1]).stat().st_size


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / "run.mcap"
    simulate(Scenario.load("push_wall", {"simulation.duration": 1.0}), sinks=[McapLog(path)])
    return path


def command(*arguments):
    return CliRunner().invoke(plot, [str(each) for each in arguments])


def test_the_command_draws_beside_the_log_and_never_over_a_file(log, tmp_path):
    assert WHATS == figures.WHATS
    assert FORMATS == figures.FORMATS
    done = command(log)
    assert done.exit_code == 0, done.output
    assert done.stdout == f"{log.parent / 'summary.png'}\n"
    picture = (log.parent / "summary.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    done = command(log)
    assert done.exit_code == 2
    assert "exists; choose another name" in done.stderr
    assert (log.parent / "summary.png").read_bytes() == picture
    done = command(log, log, "--what", "tau", "--out", tmp_path / "x.svg")
    assert done.exit_code == 0, done.output
    assert (tmp_path / "x.svg").read_text().count(">gsta 2<") == 1


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["LOG", "--out", "x.gif"], "the name must end in one of .png, .svg, .pdf, .pgf"),
        (["LOG", "--out", "nowhere/x.png"], "can't write it"),
        (["nowhere.mcap"], "No such file"),
        (
            ["LOG", "--what", "colour"],
            "colour: is neither a quantity to draw nor a recorded signal; choose from position",
        ),
        (["LOG", "--what", "velocty"], "did you mean 'velocity'?"),
        (["LOG", "--what", "tau.w"], "tau has no component 'w'; choose from pitch, roll, x, y, yaw, z"),
        (["LOG", "--what", "tau,"], "--what tau,: a name is empty"),
        (
            ["LOG", "--out", "y.png", "--from", "0,5"],
            "--from '0,5': is not a finite number; a number has a decimal point and no comma: 0.5",
        ),
        (
            ["LOG", "--out", "y.png", "--to", "500ms"],
            "--to '500ms': is not a finite number; write the number alone, 0.5, in s",
        ),
        (["LOG", "--out", "y.png", "--from", "2"], "gsta: has 0 samples from 2 to 1 s; its samples are from 0 to 1 s"),
        (["LOG", "--out", "y.png", "--width", "12"], "width '12': choose from column"),
        (["LOG", "--out", "y.png", "--width", "20mm"], "width '20mm': must be from 1 to 40 inches"),
        (["LOG", "--out", "y.png", "--width", "3 feet"], "in, cm, mm or pt (72.27 pt are an inch): 88mm"),
        (["LOG", "--out", "y.png", "--width", "-252pt"], "width '-252pt': choose from column"),
        (["LOG", "--out", "y.png", "--width", "ieee_column"], "did you mean 'ieee-column'?"),
        (["LOG", "--format", "tiff"], "--format tiff: choose from png, svg, pdf, pgf"),
        (["LOG", "--format", "pdf", "--out", "y.png"], "does not fit --format pdf; the name must end in .pdf"),
        (["LOG", "--fonts", "times", "--out", "y.png"], "fonts 'times'"),
        ([], "Missing argument"),
    ],
)
def test_bad_input_gives_one_message_and_status_2(log, tmp_path, monkeypatch, arguments, expected):
    monkeypatch.chdir(tmp_path)
    done = command(*(log if each == "LOG" else each for each in arguments))
    assert done.exit_code == 2
    assert expected in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_log_that_was_cut_off_is_drawn_with_a_warning(log, tmp_path):
    data = log.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 9 // 10])
    done = command(tmp_path / "cut.mcap", "--what", "force", "--out", tmp_path / "cut.svg")
    assert done.exit_code == 0, done.output
    assert "cut off" in done.stderr
    assert "(truncated)" in (tmp_path / "cut.svg").read_text()


def names_in(path):
    """Names of the lines in an SVG, without the number behind each."""
    return {re.sub(r"-\d+$", "", name) for name in re.findall(r'<g id="([^"]+)">', Path(path).read_text())}


def test_signals_and_components_are_drawn_by_their_names(log, tmp_path):
    whats = ("tau.x", "u.3", "nu", "quat_WB", "touches")
    assert command(log, "--what", ",".join(whats[:2]), "--what", whats[2], "--out", tmp_path / "a.svg").exit_code == 0
    names = names_in(tmp_path / "a.svg")
    assert {"tau.x", "u.3", "nu.x", "nu.yaw"} <= names
    assert not {"tau.y", "u.1"} & names
    trace = Trace.load(log)
    lines = {line.get_gid(): line.get_ydata() for line in figures.plot({"a": trace}, whats).findobj(Line2D)}
    columns = {column.name: column.values for column in trace.columns()}
    drawn = {name: values for gid, values in lines.items() if (name := re.sub(r"-\d+$", "", gid or "")) in columns}
    assert drawn.keys() == {name for name in columns if name in whats or name.split(".")[0] in whats[2:]}
    for name, values in drawn.items():
        assert (values.min(), values.max()) == (columns[name].min(), columns[name].max())
        assert np.isin(values, columns[name]).all()


@pytest.mark.usefixtures("undrawn")
def test_a_window_of_time_is_drawn_from_its_first_to_its_last_sample(log, tmp_path, monkeypatch):
    seen = {}

    def spy(traces, whats, width, fonts, height):
        seen.update(traces=traces, whats=whats, width=width, height=height)
        return real(traces, whats, width, fonts, height)

    real = figures.plot
    monkeypatch.setattr(figures, "plot", spy)
    size = ("--width", "12.7 cm", "--height", "300mm", "--label", "gsta=ours", "--out", tmp_path / "w.png")
    assert command(log, "--from", "0.25", "--to", "0.5", "--what", "summary,push", *size).exit_code == 0
    ((name, trace),) = seen["traces"].items()
    assert (name, seen["height"]) == ("ours", "300mm")
    assert (trace.t[0], trace.t[-1], len(trace)) == (pytest.approx(0.25), pytest.approx(0.5), 251)
    assert np.array_equal(trace.tau, Trace.load(log).tau[250:501])
    assert style.width_of(seen["width"], 0.0) == pytest.approx(5.0)


@pytest.mark.parametrize("what", ["attitude", "velocity", "thrusters"])
def test_every_quantity_is_drawn_of_one_and_of_several_runs(log, tmp_path, what):
    for logs in ((log,), (log, log)):
        done = command(*logs, "--what", what, "--out", tmp_path / f"{len(logs)}.svg")
        assert done.exit_code == 0, done.output
        names = names_in(tmp_path / f"{len(logs)}.svg")
        wanted = {"attitude": "quat_WB.yaw", "velocity": "nu.roll", "thrusters": "u.6"}[what]
        assert {wanted} <= names


def test_a_pgf_has_the_texts_for_latex_or_one_message_without_it(log, tmp_path, monkeypatch):
    if shutil.which("pdflatex"):
        assert command(log, "--what", "tau", "--out", tmp_path / "x.pgf").exit_code == 0
        text = (tmp_path / "x.pgf").read_text()
        assert r"actuation force $\tau$" in text
        assert text.isascii()
    monkeypatch.setenv("PATH", str(tmp_path))
    done = command(log, "--what", "tau", "--out", tmp_path / "y.pgf")
    assert done.exit_code == 2
    assert "a .pgf need pdflatex, xelatex or lualatex" in done.stderr
    assert "apt install texlive" in done.stderr
    assert not (tmp_path / "y.pgf").exists()
    done = command(log, "--what", "tau", "--fonts", "latex", "--out", tmp_path / "y.pdf")
    assert done.exit_code == 2
    assert "need pdflatex" in done.stderr
    assert not list(tmp_path.glob("y.*"))


def test_formats_widths_and_fonts_for_a_paper(log, tmp_path):
    """The width of a PDF is in its page, its fonts by their names in it."""
    out = tmp_path / "force.pdf"
    for width, inches in (
        ("page", 516 / 72.27),
        ("88mm", 88 / 25.4),
        ("5in", 5.0),
        ("252pt", 252 / 72.27),
        ("12 cm", 12 / 2.54),
    ):
        done = command(log, "--what", "touches", "--format", "pdf", "--width", width, "--out", out, "--force")
        assert done.exit_code == 0, done.output
        (box,) = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ", out.read_bytes())
        assert float(box) == pytest.approx(72.0 * inches, abs=0.01)
    for fonts, name in (("sans", b"DejaVuSans"), ("serif", b"STIX"), ("cm", b"Cmr10")):
        done = command(log, "--what", "nu.x", "--fonts", fonts, "--format", "pdf,svg", "--out", out, "--force")
        assert done.stdout.split() == [str(out), str(out.with_suffix(".svg"))]
        assert name in out.read_bytes()
    done = command(log, "--what", "nu", "--format", "png,pgf", "--fonts", "latex", "--out", tmp_path / "x.png")
    assert done.exit_code == 2
    assert "a .png can't have the fonts 'latex'" in done.stderr


@pytest.mark.skipif(not shutil.which("pdflatex"), reason="needs pdflatex")
def test_latex_sets_a_pdf_and_a_pgf_goes_into_a_document(log, tmp_path):
    for out, fonts in (("x.pdf", "latex"), ("x.pgf", "cm")):
        done = command(log, "--what", "nu", "--fonts", fonts, "--width", "column", "--out", tmp_path / out)
        assert done.exit_code == 0, done.output
    data = (tmp_path / "x.pdf").read_bytes()
    parts = b"".join(zlib.decompressobj().decompress(part) for part in data.split(b"stream\n")[1::2])
    assert re.search(rb"/FontName */\w+\+(CMR|SFRM|LMRoman)", parts)  # Computer Modern, by LaTeX
    (tmp_path / "paper.tex").write_text(
        r"\documentclass{article}\usepackage{pgf}\begin{document}\input{x.pgf}\end{document}"
    )
    tex = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"]
    done = subprocess.run(tex, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-1000:]
