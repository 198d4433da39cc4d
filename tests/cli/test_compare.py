"""The command `compare`."""

import dataclasses
import re

import pytest
from click.testing import CliRunner

from pages import HOSTILE, complete_by_itself
from uvms_mj import McapLog, Scenario, Trace, simulate
from uvms_mj.cli.plot import compare

LAW = """
from dataclasses import dataclass

from uvms_mj import Fosm


@dataclass(frozen=True)
class Mine(Fosm):
    pass
"""


@pytest.fixture
def command(tmp_path, monkeypatch):
    """A function that runs a command with arguments in this process, in a separate folder."""
    monkeypatch.chdir(tmp_path)
    return lambda which, *arguments: CliRunner().invoke(which, [str(a) for a in arguments])


@pytest.mark.usefixtures("undrawn")
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


@pytest.mark.usefixtures("undrawn")
def test_compare_says_which_signals_are_equal(command, tmp_path):
    runs = {"one": {}, "again": {}, "slow": {"current.speed": 0.1}, "short": {"simulation.duration": 0.05}}
    for name, keys in runs.items():
        start = {"simulation.duration": 0.1}
        simulate(Scenario.load("push_wall", start | keys), sinks=[McapLog(tmp_path / f"{name}.mcap")])
    equal, slow, short = (
        command(compare, "one.mcap", f"{each}.mcap", "--out", f"{each}.html") for each in ("again", "slow", "short")
    )
    n = len([*Trace.load(tmp_path / "one.mcap")])
    assert equal.output.splitlines() == [f"again and one: all {n} signals equal, bit for bit", "again.html"]
    assert re.match(rf"slow and one: \d+ of {n} signals differ: ", slow.output)
    assert short.output.splitlines() == ["short.html"]
