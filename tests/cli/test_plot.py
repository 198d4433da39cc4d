"""The command `plot`."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from uvms_mj import McapLog, Scenario, simulate
from uvms_mj.cli.plot import FORMATS, WHATS, plot
from uvms_mj.views import figures


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


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["LOG", "--out", "x.gif"], "the name must end in one of .png, .svg, .pdf"),
        (["LOG", "--out", "nowhere/x.png"], "can't write it"),
        (["nowhere.mcap"], "No such file"),
        (["LOG", "--what", "colour"], "'colour' is not one of"),
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
