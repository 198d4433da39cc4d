"""The command `converge`."""

import json

import pytest
from click.testing import CliRunner

from uvms_mj.analysis.summary import summary
from uvms_mj.cli import main
from uvms_mj.studies.convergence import CONVERGING, DEFAULT


def test_every_metric_is_a_number_of_the_runs_json(paper_run):
    report = summary(paper_run("gsta"), {})

    def places(node, name=""):
        if isinstance(node, dict):
            return {p for key, each in node.items() for p in places(each, f"{name}.{key}" if name else key)}
        if isinstance(node, list):
            return {p for i, each in enumerate(node) for p in places(each, f"{name}[{i}]")}
        return {name}

    assert set(CONVERGING) <= places(report)
    assert {p for p in places(report) if p.startswith("final.")} <= set(CONVERGING)


SHORT = ("--set", "simulation.duration=0.02", "--set", "wall.position=1e-4", "--set", "reference.step_time=0")


def test_the_command_prints_a_table_or_json():
    done = CliRunner().invoke(main, ["converge", *SHORT])
    assert done.exit_code == 0, done.output
    assert all(name.split("[")[0] in done.output for name in DEFAULT)
    assert "h = 2.5e-05 s" in done.output
    done = CliRunner().invoke(main, ["converge", "--json", "-m", "final.s", "-c", "fosm", *SHORT])
    report = json.loads(done.stdout)
    assert report["controller"] == "fosm"
    assert report["timesteps_s"] == [1e-4, 5e-5, 2.5e-5]
    assert [each["name"] for each in report["metrics"]] == [f"final.s[{i}]" for i in range(6)]
    assert all(len(each["values"]) == 3 for each in report["metrics"])


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (("-m", "contact.peak"), 2, "did you mean 'contact.peak_N'?"),
        (("push_wall", "other"), 2, "one scenario at a time"),
        (("wall.stifness=1",), 2, "did you mean 'stiffness'"),
        (("-m", "list"), 0, "contact.peak_N"),
        (("--from", "nowhere.mcap"), 2, "nowhere.mcap"),
    ],
)
def test_the_command_says_what_is_wrong(arguments, status, said):
    done = CliRunner().invoke(main, ["converge", *arguments])
    assert done.exit_code == status
    assert said in done.output
