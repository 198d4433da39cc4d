"""The command `run`: files, table, JSON, and ends of a run."""

import json
import tomllib

import numpy as np
import pytest

from forked import done as forked
from law_files import law_file, one_liner
from strict_json import no_constants
from uvms_mj import Status, Trace

SHORT = ("--set", "simulation.duration=0.05")


def test_a_run_writes_what_it_says_and_says_it_as_json(here, tmp_path):
    done = here("run", "--controller", "gsta", "--json", "--out", "here")
    assert done.exit_code == 0, done.stderr
    report = json.loads(done.stdout, parse_constant=no_constants)
    assert (report["scenario"], report["controller"], report["status"]) == ("push_wall", "gsta", "completed")
    assert report["steps"] == 200_000
    assert report["duration_s"] == pytest.approx(20.0)
    assert report["real_time_factor"] == pytest.approx(20.0 / report["wall_time_s"])
    contact = report["contact"]
    assert contact["settled"] is True
    assert abs(contact["relative_error"]) < 1e-4
    assert contact["final_N"] == pytest.approx(1.497753, abs=1e-6)
    assert contact["first_s"] == pytest.approx(5.21, abs=0.01)
    assert 17.8 < contact["peak_N"] < 18.1
    sizes = {"position_m": 3, "attitude_wxyz": 4, "s": 6, "z": 6, "tau": 6}
    assert {name: len(value) for name, value in report["final"].items()} == sizes
    trace = Trace.load(tmp_path / report["files"]["mcap"])
    n = len(trace)
    shapes = {
        "p_WB": 3,
        "quat_WB": 4,
        "nu": 6,
        "nu_dot": 6,
        "p_d": 3,
        "tau_cmd": 6,
        "tau": 6,
        "s": 6,
        "z": 6,
        "zeta": 6,
    }
    for name, size in (shapes | {"u": 6, "f_contact_W": 3, "f_contact_m_W": 3}).items():
        assert trace[name].shape == (n, size), name
    assert np.allclose(np.diff(trace["t"]), 1e-3)
    assert np.array_equal(trace["p_WB"][-1], report["final"]["position_m"])
    written = tomllib.loads((tmp_path / "here" / "scenario.toml").read_text())
    assert written["controller"]["k_1"] == 5.0
    assert written["impedance"]["damping_ratio"] == 1.0
    again = here("run", "here/scenario.toml", "--json", "--out", "again")
    repeated = Trace.load(tmp_path / "again" / "run.mcap")
    assert again.exit_code == 0
    for name in trace:
        assert np.array_equal(trace[name], repeated[name]), name


def test_without_contact_what_does_not_exist_is_null(here, tmp_path):
    report = json.loads(here("run", "-c", "impedance", "--json", *SHORT).stdout)
    assert report["contact"]["first_s"] is None
    assert report["contact"]["analytic_N"] is None
    assert report["contact"]["relative_error"] is None
    assert report["contact"]["touches"] == 0
    assert report["final"]["z"] is None
    folders = list((tmp_path / "runs").iterdir())
    assert len(folders) == 1
    assert folders[0].name.endswith("-push_wall-impedance")


def test_the_table_has_what_a_user_looks_for(here):
    done = here("run", *SHORT, "wall.position=1e-4", "reference.step_time=0")
    for text in ("first contact", "peak force", "final force", "analytic force", "sliding variable"):
        assert text in done.stdout
    for text in ("largest tau", "real-time factor", "run.mcap"):
        assert text in done.stdout
    assert here("run", *SHORT, "--quiet").stdout == ""


def test_a_second_run_into_a_folder_keeps_the_first(here, tmp_path):
    here("run", *SHORT, "-q", "--out", "here")
    first = (tmp_path / "here" / "run.mcap").read_bytes()
    done = here("run", "--set", "simulation.duration=0.02", "-q", "--out", "here")
    assert "moved" in done.stderr
    assert (tmp_path / "here" / "earlier-1" / "run.mcap").read_bytes() == first


@pytest.mark.usefixtures("undrawn")
def test_what_was_made_from_an_earlier_log_is_moved_with_it_and_nothing_else(here, tmp_path):
    folder = tmp_path / "here"
    here("run", *SHORT, "-q", "--out", "here")
    assert here("plot", "here/run.mcap").exit_code == 0
    assert here("export", "here/run.mcap", "--to", "npz").exit_code == 0
    for name in ("notes.txt", "mine.png", "force.svg"):
        (folder / name).write_text("mine")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert {"summary.png", "run.npz"} < set(before)
    here("run", *SHORT, "-c", "fosm", "-q", "--out", "here")
    earlier = {path.name: path.read_bytes() for path in (folder / "earlier-1").iterdir()}
    assert set(before) - set(earlier) == {"notes.txt", "mine.png", "force.svg"}
    assert all(before[name] == content for name, content in earlier.items())
    assert {path.name for path in folder.iterdir()} == {
        *("earlier-1", "run.mcap", "scenario.toml"),
        *("notes.txt", "mine.png", "force.svg"),
    }
    assert here("plot", "here/run.mcap").exit_code == 0


def test_a_picture_without_a_log_is_not_an_earlier_run(here, tmp_path):
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "summary.png").write_text("mine")
    assert "moved" not in here("run", *SHORT, "-q", "--out", "here").stderr
    assert (tmp_path / "here" / "summary.png").read_text() == "mine"


def test_a_full_disk_stops_the_run_and_keeps_what_was_written(tmp_path):
    limited = """if True:
        import resource
        from uvms_mj.cli import main
        resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, 3_000_000))
        main(["run", "--json", "--out", "here"])
    """
    done = forked(code=limited, cwd=tmp_path)
    assert done.exit_code == 2
    assert "can't write" in done.stderr
    assert "Traceback" not in done.stderr
    report = json.loads(done.stdout)
    assert report["status"] == "failed"
    assert report["steps"] < 200_000
    trace = Trace.load(tmp_path / report["files"]["mcap"])
    assert trace.status is Status.truncated
    assert 100 < len(trace) <= report["steps"] // 10 + 1


def test_a_law_that_prints_leaves_json_alone(here, tmp_path):
    law_file(
        tmp_path, "print('loading')\n" + one_liner("Loud", "tau_cmd[:] = 0.0\nprint('stepping', eval('1'))"), "loud.py"
    )
    done = here("run", "-c", "loud.py:Loud", "simulation.duration=0.0003", "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["steps"] == 3
    assert "loading" in done.stderr
    assert "stepping" in done.stderr
    assert "plain Python" in done.stderr


def test_an_unstable_run_says_when_and_what_and_keeps_the_trace(here, tmp_path):
    done = here("run", "--set", "controller.period=0.1", "--json", "--out", "here")
    assert done.exit_code == 3
    report = json.loads(done.stdout, parse_constant=no_constants)
    assert report["status"] == "unstable"
    assert "t = " in report["message"]
    assert "limit-cycles" in done.stderr
    trace = Trace.load(tmp_path / "here" / "run.mcap")
    assert len(trace) > 10
    assert (trace.status, trace.message) == (Status.unstable, report["message"])


def test_a_law_that_chatters_is_warned_of(here):
    done = here("run", "-c", "fosm", "--set", "controller.K_s=25", *SHORT, "--json")
    assert done.exit_code == 0
    assert "chatters" in done.stderr
    assert json.loads(done.stdout)["contact"]["analytic_N"] is None
    assert len(json.loads(done.stdout)["warnings"]) == 1


def test_a_run_that_can_not_start_leaves_every_folder_as_it_was(here, tmp_path):
    (tmp_path / "mine").mkdir()
    for out in ("mine/new/run", "mine"):
        done = here("run", "simulation.timestep=0.1", "--set", "wall.stiffness=1e9", "-o", out)
        assert done.exit_code == 2
        assert list(tmp_path.rglob("*")) == [tmp_path / "mine"]


def test_settings_that_another_law_does_not_take_over_are_named_once(here):
    """Of a scenario and of a log alike; the period belongs to the loop and stays."""
    short = ("--set", "simulation.duration=0.02", "--quiet")
    first = here("run", "push_soft_wall_100hz", *short, "--out", "gsta")
    assert "left out" not in first.stderr
    named = "warning: controller.name: fosm takes the place of gsta, so controller.k_1, "
    for source in (("push_soft_wall_100hz",), ("--from", "gsta/run.mcap")):
        other = here("run", *source, *short, "--controller", "fosm", "--out", source[-1][:4])
        assert other.exit_code == 0, other.stderr
        assert other.stderr.count("left out") == other.stderr.count(named) == 1
        assert "controller.period" not in other.stderr
