"""The command line, with valid and invalid arguments."""

import json
import os
import signal
import subprocess
import sys
import time
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from uvms_mj import Status, Trace
from uvms_mj.cli import main

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, "-m", "uvms_mj"]
SHORT = ("--set", "simulation.duration=0.05")


def run(*arguments, cwd, command=COMMAND, **options):
    return subprocess.run(
        [*command, *map(str, arguments)], cwd=cwd, capture_output=True, text=True, timeout=240.0, **options
    )


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A function that runs the command in this process and returns exit code, standard output and standard error."""
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(main, [str(a) for a in arguments])


def no_constants(name):
    raise ValueError(f"{name} is not JSON")


def test_a_run_writes_what_it_says_and_says_it_as_json(tmp_path):
    done = run("run", "--controller", "gsta", "--json", "--out", "here", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
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
    again = run("run", "here/scenario.toml", "--json", "--out", "again", cwd=tmp_path)
    repeated = Trace.load(tmp_path / "again" / "run.mcap")
    assert again.returncode == 0
    for name in trace:
        assert np.array_equal(trace[name], repeated[name]), name


def test_without_contact_what_does_not_exist_is_null(tmp_path):
    report = json.loads(run("run", "-c", "impedance", "--json", *SHORT, cwd=tmp_path).stdout)
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


def test_a_second_run_into_a_folder_keeps_the_first(tmp_path):
    run("run", *SHORT, "-q", "--out", "here", cwd=tmp_path)
    first = (tmp_path / "here" / "run.mcap").read_bytes()
    done = run("run", "--set", "simulation.duration=0.02", "-q", "--out", "here", cwd=tmp_path)
    assert "moved" in done.stderr
    assert (tmp_path / "here" / "earlier-1" / "run.mcap").read_bytes() == first


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["run", "push_wal"], "did you mean 'push_wall'?"),
        (["run", "nowhere.toml"], "no such file"),
        (["run", "--controller", "gtsa"], "did you mean 'gsta'?"),
        (["run", "--set", "wall.stifness=3"], "did you mean 'stiffness'?"),
        (["run", "--set", "wall.stiffness"], "key=value"),
        (["run", "--set", "wall.stiffness=soft"], "'soft' is not a finite number"),
        (["run", "--set", "simulation.timestep=0"], "must be from 1e-07 to 1 s"),
        (["run", "--set", "simulation.timestep=0.1"], "or a time step below 0.02264 s"),
        (["run", "--set", "impedance.M_d=[1,1,1,1,1,-1]"], "not positive definite"),
        (["run", "--set", "controller.period=1.5e-4"], "the nearest are 0.0001 and 0.0002 s"),
        (["run", "--set", "vehicle.model=submarine"], "models that ship|bluerov1"),
        (["run", "--log-rate", "3000"], "the nearest are 2500 and 3333.33333333 Hz"),
        (["run", "--log-rate", "often"], "must be a number"),
        (["run", "--out", "/proc/nothing"], "can't write"),
        (["run", "a", "b"], "one scenario at a time"),
        (["run", "--controler", "gsta"], "No such option"),
        (["controllers", "pid"], "no law 'pid'"),
        (["fly"], "No such command"),
    ],
)
def test_bad_input_gives_one_message_and_status_2(here, arguments, expected):
    done = here(*arguments, *(["--json"] if arguments[0] == "run" else []))
    assert done.exit_code == 2
    assert any(each in done.stderr for each in expected.split("|")), done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
    assert not list(Path().iterdir())


@pytest.mark.parametrize(
    ("numeric", "value", "expected"),
    [
        ("X_udot", "5.5", "must not be positive"),
        ("N_rr", "abc", "must be finite numbers"),
        ("displaced_mass", "-1", "negative"),
    ],
)
def test_an_unphysical_vehicle_is_refused(here, tmp_path, numeric, value, expected):
    lines = (ROOT / "models" / "bluerov1.xml").read_text().splitlines()
    lines = [f'<numeric name="{numeric}" data="{value}"/>' if f'name="{numeric}"' in line else line for line in lines]
    (tmp_path / "mine.xml").write_text("\n".join(lines))
    done = here("run", "--set", "vehicle.model=mine.xml")
    assert done.exit_code == 2
    assert expected in done.stderr
    assert numeric in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("option", "reason"),
    [
        ('solver="PGS"', "PGS"),
        ('noslip_iterations="5"', "noslip"),
        ('iterations="0"', "iterations"),
        ('><flag contact="disable"/></option><option', "<flag>"),
    ],
)
def test_a_vehicle_file_whose_settings_break_the_plant_is_refused(here, tmp_path, option, reason):
    text = (ROOT / "models" / "bluerov1.xml").read_text().replace("<option", f"<option {option}", 1)
    (tmp_path / "mine.xml").write_text(text)
    done = here("run", *SHORT, "--set", "vehicle.model=mine.xml")
    assert done.exit_code == 2
    assert reason in done.stderr


def test_a_full_disk_stops_the_run_and_keeps_what_was_written(tmp_path):
    limited = f"ulimit -f 3000; {sys.executable} -m uvms_mj run --json --out here"
    done = subprocess.run(["bash", "-c", limited], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert "can't write" in done.stderr
    assert "Traceback" not in done.stderr
    report = json.loads(done.stdout)
    assert report["status"] == "failed"
    assert report["steps"] < 200_000
    trace = Trace.load(tmp_path / report["files"]["mcap"])
    assert trace.status is Status.truncated
    assert 100 < len(trace) <= report["steps"] // 10 + 1


def test_a_negative_mass_is_refused(here, tmp_path):
    text = (ROOT / "models" / "bluerov1.xml").read_text().replace('mass="7.31"', 'mass="-7.31"')
    (tmp_path / "mine.xml").write_text(text)
    done = here("run", "--set", "vehicle.model=mine.xml")
    assert done.exit_code == 2
    assert "mass" in done.stderr


@pytest.mark.parametrize("compiled", [True, False])
def test_a_law_that_prints_leaves_json_alone(tmp_path, compiled):
    text = (
        "from dataclasses import dataclass\nfrom uvms_mj import Controller\nprint('loading')\n\n"
        "@dataclass(frozen=True)\nclass Loud(Controller):\n"
        "    @staticmethod\n    def law(gains, state, signals, state_dot, tau_cmd):\n"
        "        tau_cmd[:] = 0.0\n        print('stepping')\n"
        + ("" if compiled else "        {}.clear()\n        open(__file__).close()\n")
    )
    (tmp_path / "loud.py").write_text(text)
    done = run("run", "-c", "loud.py:Loud", "simulation.duration=0.0003", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["steps"] == 3
    assert "loading" in done.stderr
    assert "stepping" in done.stderr
    assert ("plain Python" in done.stderr) != compiled


def test_an_unstable_run_says_when_and_what_and_keeps_the_trace(tmp_path):
    done = run("run", "--set", "controller.period=0.1", "--json", "--out", "here", cwd=tmp_path)
    assert done.returncode == 3
    report = json.loads(done.stdout, parse_constant=no_constants)
    assert report["status"] == "unstable"
    assert "t = " in report["message"]
    assert "limit-cycles" in done.stderr
    trace = Trace.load(tmp_path / "here" / "run.mcap")
    assert len(trace) > 10
    assert (trace.status, trace.message) == (Status.unstable, report["message"])


def test_a_law_that_chatters_is_warned_of(tmp_path):
    done = run("run", "-c", "fosm", "--set", "controller.K_s=25", *SHORT, "--json", cwd=tmp_path)
    assert done.returncode == 0
    assert "chatters" in done.stderr
    assert json.loads(done.stdout)["contact"]["analytic_N"] is None
    assert len(json.loads(done.stdout)["warnings"]) == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_ends_soon_and_keeps_what_it_had(tmp_path, number):
    process = subprocess.Popen(
        [*COMMAND, "run", "--set", "simulation.duration=2000", "--json", "--out", "here"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    time.sleep(5.0)
    assert process.poll() is None
    process.send_signal(number)
    start = time.monotonic()
    out, _ = process.communicate(timeout=30)
    assert time.monotonic() - start < 2.0
    assert process.returncode == 128 + number
    report = json.loads(out, parse_constant=no_constants)
    assert report["status"] == "interrupted"
    if report["steps"]:
        t = Trace.load(tmp_path / "here" / "run.mcap").t
        assert np.allclose(np.diff(t), 1e-3)
        assert abs(t[-1] - report["duration_s"]) < 2e-3


def test_a_run_that_can_not_start_leaves_every_folder_as_it_was(here, tmp_path):
    (tmp_path / "mine").mkdir()
    for out in ("mine/new/run", "mine"):
        done = here("run", "simulation.timestep=0.1", "--set", "wall.stiffness=1e9", "-o", out)
        assert done.exit_code == 2
        assert list(tmp_path.rglob("*")) == [tmp_path / "mine"]


def test_what_hangs_at_its_end_can_be_stopped(tmp_path):
    """A second signal is ignored while the run is written. A signal that comes much later ends the program."""
    code = """if True:
        import signal, time
        from uvms_mj.cli.common import Stop
        Stop._PATIENCE_S = 1.5
        stop = Stop()
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            signal.raise_signal(signal.SIGTERM)
            time.sleep(2.5)
            print("still here", flush=True)
            signal.raise_signal(signal.SIGINT)
            time.sleep(30.0)
            print("not here")
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 128 + signal.SIGINT
    assert done.stdout == "still here\n"


ENDLESS = """
from dataclasses import dataclass

from uvms_mj import Controller


@dataclass(frozen=True)
class Endless(Controller):
    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = 0.0
        while signals.t > 0.02:
            tau_cmd[0] += 1.0
"""


def test_a_law_that_loops_for_ever_can_be_stopped(tmp_path):
    """The machine code never returns to Python. A second thread handles the second signal."""
    (tmp_path / "law.py").write_text(ENDLESS)
    code = """if True:
        import os, signal, sys, threading, time
        from uvms_mj.cli import main
        from uvms_mj.cli.common import Stop
        Stop._PATIENCE_S = 0.5

        def send():
            while not os.path.exists("here/run.mcap"):
                time.sleep(0.1)
            for _ in range(2):
                time.sleep(2.0)
                os.kill(os.getpid(), signal.SIGTERM)

        threading.Thread(target=send, daemon=True).start()
        main(["run", "-c", "law.py:Endless", "-o", "here"])
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, timeout=120)
    assert done.returncode == 128 + signal.SIGTERM, done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "-o", "LONG"),
        ("run", "--from", "LONG"),
        ("run", "LONG.toml"),
        ("run", "-c", "LONG.py:Law"),
        ("run", "vehicle.model=LONG.xml"),
        ("info", "LONG"),
        ("plot", "LONG", "--out", "LONG.png"),
        ("compare", "LONG", "--out", "LONG.html"),
        ("export", "LONG", "--to", "csv"),
        ("replay", "LONG", "--save", "LONG.rrd"),
        ("certify", "--from", "LONG"),
        ("paper", "--from", "LONG"),
        ("paper", "-o", "LONG"),
    ],
)
def test_a_place_that_cannot_be_looked_at_is_named_in_one_line(here, arguments):
    """An unreadable folder would do, but root can read all folders. So the name is too long for any file system."""
    done = here(*(argument.replace("LONG", 300 * "a") for argument in arguments))
    assert done.exit_code == 2, done.output
    assert "File name too long" in done.stderr
    assert "aaa" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    "arguments", [("run", "-o", ""), ("paper", "-o", ""), ("export", "x", "--out", ""), ("replay", "x", "--save", "")]
)
def test_an_empty_name_is_no_place(here, tmp_path, arguments):
    done = here(*arguments)
    assert done.exit_code == 2
    assert "must not be empty" in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("where", ["Simulation", "_Run._outcome"])
def test_a_run_that_never_began_reports_in_the_same_words_and_what_it_left(here, monkeypatch, where):
    def shape(report):
        return {key: shape(value) for key, value in report.items()} if isinstance(report, dict) else None

    ran = json.loads(here("run", *SHORT, "--json", "-o", "a").stdout)

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"uvms_mj.engine.run.{where}", interrupted)
    done = here("run", *SHORT, "--json", "-o", "b")
    assert done.exit_code == 130
    report = json.loads(done.stdout)
    assert shape(report | {"files": ran["files"]}) == shape(ran)
    assert sorted(report["files"].values()) == sorted(map(str, Path().glob("b/*")))
    assert Path("b").exists() == bool(report["files"])


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_an_output_that_takes_nothing_is_said_in_one_line(tmp_path):
    with open("/dev/full", "w") as full:
        done = subprocess.run([*COMMAND, "keys"], stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr == "error: No space left on device\n"


@pytest.mark.parametrize("command", ["info", "export", "plot", "compare", "replay"])
def test_an_interrupt_of_any_command_is_no_failure(here, monkeypatch, command):
    def interrupted(path):
        raise KeyboardInterrupt

    monkeypatch.setattr("uvms_mj.records.mcap.read", interrupted)
    monkeypatch.setattr(Trace, "load", interrupted)
    done = here(command, "run.mcap", *(("--to", "csv") if command == "export" else ()))
    assert done.exit_code == 130
    assert done.stderr.strip() in ("interrupted", "stopped")


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("fosm.K=2", "fosm.K: fosm has no such gain; choose from A, F_1, F_2, K_s"),
        ("gsta.name=sta", "gsta.name: gsta has no such gain"),
        ("fosm=3", "fosm: fosm has no such gain"),
        ("gsta.nominal=false", "gsta.nominal: cannot be set"),
    ],
)
def test_paper_names_the_gain_that_was_typed(here, setting, said):
    done = here("paper", "-o", "x", setting)
    assert done.exit_code == 2
    assert said in done.stderr
    assert not Path("x").exists()


def test_help_teaches_and_lists(here):
    assert "uvms-mj run --controller gsta" in here("--help").stdout
    text = here("run", "--help").stdout
    for option in ("--controller", "--set", "--out", "--log-rate", "--json", "--quiet"):
        assert option in text
    text = here("controllers").stdout
    for word in ("gsta", "fosm", "impedance", "k_1", "K_s", "epsilon", "period", "m/s^3", "nominal"):
        assert word in text
    assert "wall.stiffness" in here("keys").stdout


def test_cold_and_warm_machine_code_give_the_same_bits(tmp_path):
    """The first run compiles everything, the second loads it from the cache. A broken cache entry is recompiled."""
    environment = os.environ | {"UVMS_MJ_CACHE_DIR": str(tmp_path / "cache")}
    for name in ("cold", "warm"):
        done = run("run", "--set", "simulation.duration=0.5", "wall.position=0.001", "reference.step_time=0",
                   "-q", "--log-rate", "full", "--out", name, cwd=tmp_path, env=environment)  # fmt: skip
        assert done.returncode == 0, done.stderr
    cold, warm = (Trace.load(tmp_path / name / "run.mcap") for name in ("cold", "warm"))
    assert cold["touches"][-1] > 0
    for name in cold:
        assert np.array_equal(cold[name], warm[name]), name
    broken = next((tmp_path / "cache").glob("*.o"))
    broken.write_bytes(broken.read_bytes()[:100])
    assert run("run", *SHORT, "-q", cwd=tmp_path, env=environment).returncode == 0


def test_the_wheel_has_everything_and_runs_from_anywhere(tmp_path):
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q"]
    wheel = [*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", str(tmp_path / "dist"), str(ROOT)]
    subprocess.run(wheel, check=True, capture_output=True)
    (file,) = (tmp_path / "dist").glob("*.whl")
    with zipfile.ZipFile(file) as archive:
        names = archive.namelist()
    assert "uvms_mj/models/bluerov1.xml" in names
    assert "uvms_mj/scenarios/push_wall.toml" in names
    site = tmp_path / "site"
    subprocess.run([*pip, "install", "--no-deps", "--target", str(site), str(file)], check=True, capture_output=True)
    environment = os.environ | {"PYTHONPATH": str(site)}
    python = [sys.executable, "-c"]
    where = run("import uvms_mj; print(uvms_mj.__file__)", cwd=tmp_path, command=python, env=environment)
    assert where.stdout.startswith(str(site))
    done = run("run", *SHORT, "--json", cwd=tmp_path, env=environment)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["status"] == "completed"
