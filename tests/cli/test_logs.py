"""The commands for logs: info, export and replay."""

import json

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from scipy.io import loadmat

from traces import TASK, without
from uvms_mj import McapLog, Scenario, Trace, simulate
from uvms_mj.cli import main
from uvms_mj.cli.logs import labels

SHORT = {"simulation.duration": 0.3, "wall.position": 0.002, "reference.step_time": 0.0}


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / "run.mcap"
    simulate(Scenario.load("push_wall", SHORT), sinks=[McapLog(path)])
    return path


@pytest.fixture
def command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(main, [str(a) for a in arguments])


def test_info_prints_the_runs_table_again_and_what_the_log_holds(command, log):
    done = command("info", log)
    assert done.exit_code == 0, done.output
    for text in ("first contact", "peak force", "completed", "/contact/map", "geometry_msgs/WrenchStamped", "mujoco"):
        assert text in done.stdout
    assert "301 at 1000 Hz, 0 to 0.3 s" in done.stdout
    report = json.loads(command("info", log, "--json").stdout)
    trace = Trace.load(log)
    assert report["contact"]["peak_N"] == trace.force_peak[-1]
    assert report["rows"] == 301
    assert report["signals"]["tau"] == {"shape": [6], "unit": "N, N m", "frame": "B"}
    assert "run.json" in report["attachments"]
    assert (shown := command("info", log, "--show", "scenario.toml").stdout) == trace.scenario.to_toml()
    assert json.loads(command("info", log, "--show", "scenario.toml", "--json").stdout) == {"scenario.toml": shown}
    assert "did you mean 'scenario.toml'" in command("info", log, "--show", "scenaro.toml").stderr


@pytest.mark.usefixtures("undrawn")
def test_info_and_compare_do_without_the_signals_of_the_impedance_task(command, log, tmp_path):
    without(Trace.load(log), *TASK).save(tmp_path / "less.mcap")
    shown = command("info", "less.mcap")
    assert shown.exit_code == 0, shown.output
    assert "largest tau" in shown.stdout
    assert "sliding" not in shown.stdout
    assert json.loads(command("info", "less.mcap", "--json").stdout)["final"]["s"] is None
    done = command("compare", "less.mcap", log, "--out", "both.html")
    assert done.exit_code == 0, done.output
    assert command("compare", "less.mcap", "less.mcap", "--out", "less.html").exit_code == 0
    assert "Sliding variable" not in (tmp_path / "less.html").read_text()


def test_csv_has_every_number_and_its_unit(command, log, tmp_path):
    assert command("export", log, "--to", "csv", "--out", "x.csv").exit_code == 0
    trace, frame = Trace.load(log), pd.read_csv(tmp_path / "x.csv")
    assert frame.shape == (301, sum(signal.size for signal in trace.signals))
    assert np.array_equal(frame["t [s]"], trace.t)
    assert np.array_equal(frame[["tau.x [N]", "tau.yaw [N m]"]], trace.tau[:, [0, 5]])
    assert np.array_equal(frame["quat_WB.w [1]"], trace.quat_WB[:, 0])


def test_parquet_has_every_number_and_its_unit(command, log, tmp_path):
    assert command("export", log, "--out", "x.parquet").exit_code == 0
    trace, table = Trace.load(log), pq.read_table(tmp_path / "x.parquet")
    frame = trace.to_dataframe()
    assert table.column_names == list(frame.columns)
    for i, name in enumerate(table.column_names):
        assert np.array_equal(table.column(i).to_numpy(), frame[name]), name
    about = table.schema.field("tau.yaw").metadata
    assert (about[b"unit"], about[b"frame"]) == (b"N m", b"B")
    assert about[b"meaning"]


def test_npz_and_mat_have_every_signal_with_unit_and_frame(command, log, tmp_path):
    trace = Trace.load(log)
    assert command("export", log, "--to", "npz", "--out", "x.npz").exit_code == 0
    arrays = np.load(tmp_path / "x.npz")
    assert command("export", log, "--to", "mat", "--out", "x.mat").exit_code == 0
    matlab = loadmat(tmp_path / "x.mat")
    about = json.loads(str(arrays["signals"]))
    for signal in trace.signals:
        assert np.array_equal(arrays[signal.name], trace[signal.name]), signal.name
        assert np.array_equal(matlab[signal.name].reshape(trace[signal.name].shape), trace[signal.name]), signal.name
        assert about[signal.name]["unit"] == signal.unit
        assert matlab["signals"][signal.name][0, 0]["frame"][0, 0][0] == signal.frame
    assert str(arrays["scenario"]) == trace.scenario.to_toml()


def test_chosen_signals_are_columns_of_the_whole_export(command, log, tmp_path):
    assert command("export", log, "--out", "all.csv").exit_code == 0
    chosen = ("--signals", "p_WB,tau.yaw", "--signals", "tau.x")
    for name in ("x.csv", "x.parquet"):
        assert command("export", log, "--out", name, *chosen).exit_code == 0
    every, frame = pd.read_csv(tmp_path / "all.csv"), pd.read_csv(tmp_path / "x.csv")
    wanted = ["t [s]", "p_WB.x [m]", "p_WB.y [m]", "p_WB.z [m]", "tau.x [N]", "tau.yaw [N m]"]  # in the log's order
    assert list(frame.columns) == wanted
    assert every[wanted].equals(frame)
    assert pq.read_table(tmp_path / "x.parquet").column_names == [name.split(" [")[0] for name in wanted]
    assert command("export", log, "--out", "x.npz", "--signals", "tau,s").exit_code == 0
    arrays = np.load(tmp_path / "x.npz")
    assert set(arrays) == {"t", "tau", "s", "signals", "scenario"}
    assert np.array_equal(arrays["s"], Trace.load(log).s)


@pytest.mark.parametrize("rate", [1000, 500, 125, 40])
def test_rows_at_a_lower_rate_are_every_so_many_th_of_the_log(command, log, tmp_path, rate):
    assert command("export", log, "--out", "x.csv", "--rate", rate, "--signals", "tau").exit_code == 0
    frame, trace = pd.read_csv(tmp_path / "x.csv"), Trace.load(log)
    assert frame["t [s]"].to_numpy() == pytest.approx(np.arange(len(frame)) / rate, abs=1e-12)
    assert len(frame) == 1 + int(0.3 * rate + 1e-9)
    assert np.array_equal(frame["tau.x [N]"], trace.tau[:: 1000 // rate, 0])


def test_export_never_writes_over_a_file(command, log, tmp_path):
    (tmp_path / "mine.csv").write_text("mine")
    done = command("export", log, "--out", "mine.csv")
    assert done.exit_code == 2
    assert "exists" in done.stderr
    assert (tmp_path / "mine.csv").read_text() == "mine"
    assert command("export", log, "--to", "csv", "--out", log).exit_code == 2
    assert len(Trace.load(log)) == 301
    (tmp_path / "link.csv").symlink_to("nowhere")
    (tmp_path / "new.csv.part").write_text("mine")
    assert command("export", log, "--out", "link.csv").exit_code == 2
    assert command("export", log, "--out", "new.csv").exit_code == 0
    assert (tmp_path / "new.csv.part").read_text() == "mine"
    assert {path.name for path in tmp_path.iterdir()} == {"mine.csv", "link.csv", "new.csv", "new.csv.part"}
    for kind in ("csv", "parquet", "npz", "mat"):
        done = command("export", log, "--out", f"nowhere/x.{kind}")
        assert done.exit_code == 2
        assert done.stderr == f"error: nowhere/x.{kind}: can't write it: No such file or directory\n"


@pytest.mark.parametrize("state", ["é", "x" * 70])
def test_a_state_that_matlab_can_not_name_is_refused_and_leaves_nothing(command, tmp_path, state):
    (tmp_path / "odd.py").write_text(
        "from dataclasses import dataclass\nfrom uvms_mj import Controller\n\n"
        f"@dataclass(frozen=True)\nclass Odd(Controller):\n    states = {{{state!r}: 2}}\n"
        "    @staticmethod\n    def law(gains, state, signals, state_dot, tau_cmd):\n        tau_cmd[:] = 0.0\n"
    )
    command("run", "-c", "odd.py:Odd", "simulation.duration=0.01", "-q", "-o", "r")
    done = command("export", "r/run.mcap", "--out", "x.mat")
    assert done.exit_code == 2
    assert state in done.stderr
    assert not list(tmp_path.glob("*x.mat*"))
    assert command("export", "r/run.mcap", "--out", "x.npz").exit_code == 0


def test_control_characters_in_a_name_do_not_reach_the_terminal(command, tmp_path):
    done = command("info", "\x1b[31m\x07x.mcap")
    assert done.exit_code == 2
    assert done.stderr.startswith("error: \\x1b[31m\\x07x.mcap: ")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["export", "LOG"], "--to: name a format"),
        (["export", "LOG", "--out", "x.xls"], "--to: name a format"),
        (["export", "LOG", "--to", "xls"], "'xls' is not one of"),
        (["export", "LOG", "--to", "csv", "--out", "nowhere/x.csv"], "can't write"),
        (["export", "nowhere.mcap", "--to", "csv"], "No such file"),
        (
            ["export", "LOG", "--to", "csv", "--out", "x.csv", "--signals", "taw"],
            "no signal 'taw'; did you mean 'tau'?",
        ),
        (["export", "LOG", "--out", "x.csv", "--signals", "force"], "no signal 'force'; did you mean 'f_contact_W'"),
        (["export", "LOG", "--out", "x.csv", "--signals", "tau.w"], "tau has no component 'w'; choose from pitch, "),
        (["export", "LOG", "--out", "x.npz", "--signals", "tau.x"], "this format has whole signals; name tau without"),
        (["export", "LOG", "--out", "x.csv", "--rate", "300"], "300 Hz does not divide the log's 1000 Hz; the nearest"),
        (["export", "LOG", "--out", "x.csv", "--rate", "2000"], "does not divide the log's 1000 Hz; the nearest: 1000"),
        (["export", "LOG", "--out", "x.csv", "--rate", "50Hz"], "write the number alone, 50, in Hz"),
        (["info", "nowhere.mcap"], "No such file"),
        (["replay"], "Missing argument"),
        (["replay", "LOG", "--save", "x.rrd", "--web"], "exclude each other"),
        (["run", "push_wall", "--from", "LOG"], "one scenario at a time"),
        (["run", "--from", "nowhere.mcap"], "No such file"),
        (["run", "--from", "LOG", "controller.k_9=1"], "no such gain"),
    ],
)
def test_bad_input_gives_one_message_and_status_2(command, log, tmp_path, arguments, expected):
    done = command(*(log if a == "LOG" else a for a in arguments))
    assert done.exit_code == 2
    assert expected in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_info_shows_every_file_in_a_log(command, log):
    done = command("info", log, "--json")
    names = json.loads(done.stdout)["attachments"]
    assert {"run.json", "scenario.toml", "geometry.json", "outcome.json", "model/bluerov1.xml"} <= set(names)
    for name, size in names.items():
        assert len(command("info", log, "--show", name).stdout_bytes) == size


def test_a_log_that_was_cut_off_is_shown_with_a_warning(command, log, tmp_path):
    data = log.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 3 // 4])
    done = command("info", "cut.mcap")
    assert done.exit_code == 0
    assert "truncated" in done.stdout
    assert "cut off" in done.stderr
    done = command("export", "cut.mcap", "--to", "npz")
    assert done.exit_code == 0
    assert "warning: cut.mcap" in done.stderr


def test_logs_are_told_apart_by_what_differs(log):
    gsta = Trace.load(log)
    fosm = simulate(Scenario.load("push_wall", {"simulation.duration": 0.01}, "fosm"))
    assert labels(("a/run.mcap", "b/run.mcap"), [gsta, fosm]) == ["gsta", "fosm"]
    assert labels(("a/run.mcap", "b/run.mcap"), [gsta, gsta]) == ["a", "b"]
    assert labels(("a/one.mcap", "a/two.mcap"), [gsta, gsta]) == ["one", "two"]
    assert len(set(labels(("a/run.mcap", "a/run.mcap"), [gsta, gsta]))) == 2
