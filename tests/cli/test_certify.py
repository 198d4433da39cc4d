"""The command `certify`."""

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import strategies as st

from certified import certificate_of
from uvms_mj import Gsta, InputError, McapLog, Scenario, simulate
from uvms_mj.analysis.residual import experienced
from uvms_mj.cli.certify import certify
from uvms_mj.control.theory.certificate import gains_for, rate_bound
from vehicles import random_parameters, vehicle_xml

gains = st.tuples(st.floats(0.1, 30.0), st.floats(0.1, 100.0))


@pytest.fixture
def command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(certify, [str(a) for a in arguments])


SHORT = ("simulation.duration=0.2", "wall.position=50")


def test_the_command_says_what_is_certified_and_what_was_there(command):
    done = command(*SHORT, "--json")
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    assert report["certified"] == {"rate": 5.0, "state": 250.0, "limit": 5.0}
    assert report["is_certified"] is True
    found = report["experienced"]
    assert np.allclose(np.add(found["rate"], found["margin"]), 5.0)
    assert all(len(values) == 6 for values in found.values())
    table = command(*SHORT)
    for text in ("k_1 = 5, k_2 = 10, beta = 5", "5 + 250 |s|", "verdict", "certified: the disturbance", "yaw"):
        assert text in table.stdout
    assert command(*SHORT, "--quiet").stdout == ""


LAWS = """
from dataclasses import dataclass

from uvms_mj import Gsta


@dataclass(frozen=True)
class Same(Gsta):
    k_1: float = 6.0


@dataclass(frozen=True)
class Other(Gsta):
    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.tau_nom
"""


def test_the_certificate_is_for_gstas_law_and_not_for_any_with_its_gains(command, tmp_path):
    (tmp_path / "laws.py").write_text(LAWS)
    same = command("-c", "laws.py:Same", *SHORT, "--json")
    assert json.loads(same.stdout)["gains"]["k_1"] == 6.0
    for law in ("fosm", "laws.py:Same"):
        scenario = Scenario.load("push_wall", {"simulation.duration": 1e-3}, law)
        simulate(scenario, sinks=[McapLog(tmp_path / f"{scenario.controller.label()}.mcap")])
    fosm, recorded = (command("--from", f"{name}.mcap") for name in ("fosm", "Same"))
    assert fosm.exit_code == recorded.exit_code == 2
    assert fosm.stderr.endswith("fosm defines no certificate\n")
    assert "omit --from, give scenario and --controller" in recorded.stderr
    other = command("-c", "laws.py:Other", *SHORT)
    assert other.exit_code == 2
    assert "Other defines no certificate" in other.stderr


def test_what_saturated_thrusters_leave_over_is_no_gains_fault(command, tmp_path):
    weak = vehicle_xml(random_parameters(3)).replace("<motor", '<motor ctrllimited="true" ctrlrange="-1 1" ')
    (tmp_path / "weak.xml").write_text(weak)
    report = json.loads(command(*SHORT, "vehicle.model=weak.xml", "--json").stdout)
    assert report["saturated_s"] == pytest.approx(0.2, abs=0.01)
    assert not report["is_certified"]
    assert "at their limits for 0.2 s" in report["verdict"]
    assert "k_1" not in report["verdict"]


def test_not_certified_is_said_plainly_with_gains_that_would_be_and_is_no_failure(command):
    done = command(*SHORT, "controller.k_2=1e-3", "--json")
    report = json.loads(done.stdout)
    assert (done.exit_code, report["is_certified"]) == (0, False)
    assert report["verdict"].startswith("not certified: in ")
    assert min(report["experienced"]["margin"]) < 0.0
    assert "not certified" in command(*SHORT, "controller.k_1=0").stdout
    assert "no verdict" in command(*SHORT, "estimates.inertia=1.1").stdout


def test_a_logs_own_disturbance(command, tmp_path):
    world = dict(item.split("=") for item in SHORT)
    simulate(
        Scenario.load("push_wall", {name: float(value) for name, value in world.items()}),
        sinks=[McapLog(tmp_path / "run.mcap")],
    )
    from_log, from_run = (json.loads(command(*a, "--json").stdout) for a in (("--from", "run.mcap"), SHORT))
    assert from_log == from_run
    refused = command("--from", "run.mcap", "controller.k_1=3")
    assert refused.exit_code == 2
    assert "uses a log unchanged" in refused.output


@pytest.mark.parametrize(
    "gains", [{"k_1": 1e160}, {"beta": 1e200}, {"k_2": 1e160, "k_1": 1e90, "nominal": False}, {"beta": 1e-200}]
)
def test_gains_that_no_computer_squares_are_refused(command, gains):
    with pytest.raises(InputError, match="must be"):
        certificate_of(Gsta(**gains))
    with pytest.raises(InputError, match="k_1 nan"):
        rate_bound(math.nan, 1.0)


def test_a_log_that_may_have_missed_the_fastest_change_gives_no_verdict(command, tmp_path):
    """The largest rate of a coarse log is too small, so that a verdict from it would be too favourable."""
    touching = {"simulation.duration": 1.2, "wall.position": 0.02, "reference.step_time": 0.0}
    rates = {}
    for log_rate in ("full", 1000, 100, 2):
        trace = simulate(Scenario.load("push_wall", touching), log_rate=log_rate)
        found = experienced(trace)
        if isinstance(found, str):
            assert "--log-rate" in found
        else:
            rates[log_rate] = found.largest_rate()[5]
    assert set(rates) == {"full", 1000}
    assert rates[1000] == pytest.approx(rates["full"], rel=0.01)
    stiff = touching | {"wall.stiffness": 3e7, "simulation.timestep": 2e-5, "controller.period": 1e-4}
    with pytest.warns(UserWarning, match="limit-cycles"):
        every, some = (experienced(simulate(Scenario.load("push_wall", stiff), log_rate=r)) for r in ("full", 1000))
    assert every.doubt == pytest.approx(np.ones(6))
    assert some.largest_rate()[5] < 0.9 * every.largest_rate()[5] < some.largest_rate()[5] * some.doubt[5]
    trace = simulate(Scenario.load("push_wall", touching), log_rate=10, sinks=[McapLog(tmp_path / "coarse.mcap")])
    report = json.loads(command("--from", "coarse.mcap", "--json").stdout)
    assert report["is_certified"] is None
    assert report["verdict"].startswith("no verdict")


def test_gains_for_a_rate_with_a_part_that_grows_with_s(command):
    report = json.loads(command("--rate", "4", "--state", "3000", "controller.beta=5", "--json").stdout)
    assert (report["gains"]["k_1"], report["gains"]["k_2"]) == gains_for(4.0, 3000.0, 5.0)
    assert report["certified_state"] == pytest.approx(1.25 * 3000.0)
    assert report["certified_rate"] > 4.0
    assert command("--state", "30", "-c", "sta").exit_code == 2
    assert "3750" in command("--rate", "4", "--state", "3000").stdout


def test_gains_for_a_rate(command):
    report = json.loads(command("--rate", "4", "--json").stdout)
    assert (report["gains"]["k_1"], report["gains"]["k_2"]) == gains_for(4.0)
    assert report["certified_rate"] == pytest.approx(5.0)
    assert "k_2" in command("--rate", "4").stdout


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("-c", "fosm"), "fosm defines no certificate"),
        (("-c", "impedance"), "choose a law that has one, as --controller gsta"),
        (("--rate", "-1"), "rate -1"),
        (("--rate", "nan"), "rate nan"),
        (("--rate", "1", "controller.nominal=false"), "with nominal control"),
        (("a", "b"), "one scenario at a time"),
        (("--from", "missing.mcap"), "can't read it"),
    ],
)
def test_bad_input_is_one_message(command, arguments, text):
    done = command(*arguments)
    assert done.exit_code == 2
    assert text in done.output
    assert "Traceback" not in done.output
