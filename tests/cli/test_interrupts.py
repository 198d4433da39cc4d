"""Interrupts, signals, closed streams and the environment: commands end soon, in one line, and keep what they have."""

import contextlib
import json
import os
import pty
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from forked import done as forked
from forked import ended, started
from law_files import law_file, one_liner
from strict_json import no_constants
from uvms_mj import Status, Trace

SHORT = ("--set", "simulation.duration=0.05")


def test_an_interrupted_run_ends_soon_and_keeps_what_it_had(tmp_path):
    command = ("run", "--set", "simulation.duration=2000", "--json", "--out", "here")
    out = tmp_path / "out"
    process = started(*command, cwd=tmp_path, streams=[str(out)])
    log, end = tmp_path / "here" / "run.mcap", time.monotonic() + 60.0
    while not (log.exists() and log.stat().st_size > 1_000_000) and time.monotonic() < end:
        time.sleep(0.05)  # until rows are in the log
    os.kill(process.pid, signal.SIGINT)
    start = time.monotonic()
    assert ended(process) == 128 + signal.SIGINT
    assert time.monotonic() - start < 2.0
    report = json.loads(out.read_text(), parse_constant=no_constants)
    assert report["status"] == "interrupted"
    t = Trace.load(log).t
    assert len(t) > 100
    assert np.allclose(np.diff(t), 1e-3)
    assert abs(t[-1] - report["duration_s"]) < 2e-3


def test_a_closed_terminal_ends_a_run_whose_log_is_whole(tmp_path):
    pid, terminal = pty.fork()
    if not pid:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests themselves may run under nohup
        os.chdir(tmp_path)
        command = ("-m", "uvms_mj", "run", "simulation.duration=2000", "--engine", "free_body", "--log-rate", "10")
        os.execv(sys.executable, [sys.executable, *command, "--out", "here"])
    log, end, size = tmp_path / "here" / "run.mcap", time.monotonic() + 60.0, 0
    os.set_blocking(terminal, False)
    while time.monotonic() < end and size < 700_000:  # until rows are in the log
        with contextlib.suppress(BlockingIOError):
            os.read(terminal, 10_000)
        time.sleep(0.05)
        size = log.stat().st_size if log.exists() else 0
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 128 + signal.SIGHUP
    trace = Trace.load(log)
    assert trace.status is Status.interrupted
    assert len(trace) > 10
    assert trace.t[-1] == pytest.approx(1e-4 * trace.outcome.steps, abs=0.1)


def test_a_hangup_that_nohup_ignores_is_ignored(tmp_path):
    code = """if True:
        import signal, sys
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        from uvms_mj.cli import main
        from uvms_mj.cli.common import Stop
        stop = Stop()
        signal.raise_signal(signal.SIGHUP)
        print("goes on", stop.requested)
    """
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, "goes on False\n"), done.stderr


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
    done = forked(code=code, cwd=tmp_path)
    assert done.exit_code == 128 + signal.SIGINT
    assert done.stdout == "still here\n"


@pytest.mark.parametrize("t", ["signals.t", "getattr(signals, 't')"])
def test_a_law_that_loops_for_ever_can_be_stopped(tmp_path, t):
    """The machine code never returns to Python; the second law runs as plain Python. A second thread handles the second
    signal."""
    endless = f"tau_cmd[:] = 0.0\nwhile {t} > 0.02:\n    tau_cmd[0] += 1.0"
    law_file(tmp_path, one_liner("Endless", endless), "law.py")
    code = """if True:
        import os, signal, sys, threading, time
        from uvms_mj.cli import main
        from uvms_mj.cli.common import Stop
        Stop._PATIENCE_S = 0.5

        def send():
            while not os.path.exists("here/run.mcap"):
                time.sleep(0.1)
            for _ in range(2):
                time.sleep(1.0)
                os.kill(os.getpid(), signal.SIGTERM)

        threading.Thread(target=send, daemon=True).start()
        main(["run", "-c", "law.py:Endless", "-o", "here"])
    """
    done = forked(code=code, cwd=tmp_path)
    assert done.exit_code == 128 + signal.SIGTERM, done.stderr


@pytest.mark.parametrize("where", ["run.Simulation", "vehicle_run.Run._outcome"])
def test_a_run_that_never_began_reports_in_the_same_words_and_what_it_left(here, monkeypatch, where):
    def shape(report):
        return {key: shape(value) for key, value in report.items()} if isinstance(report, dict) else None

    ran = json.loads(here("run", *SHORT, "--json", "-o", "a").stdout)

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"uvms_mj.engine.{where}", interrupted)
    done = here("run", *SHORT, "--json", "-o", "b")
    assert done.exit_code == 130
    report = json.loads(done.stdout)
    of_each = {"saturated_thrusters_s": None}  # times by the names of thrusters: there is no vehicle yet
    assert shape(report | {"files": ran["files"]}) == shape(ran | of_each)
    assert sorted(report["files"].values()) == sorted(map(str, Path().glob("b/*")))
    assert Path("b").exists() == bool(report["files"])


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_an_output_that_takes_nothing_is_said_in_one_line(tmp_path):
    process = started("keys", cwd=tmp_path, streams=["/dev/full", str(tmp_path / "err")])
    assert ended(process) == 2
    assert (tmp_path / "err").read_text() == "error: No space left on device\n"


@pytest.mark.parametrize("command", ["info", "export", "plot", "compare", "replay"])
def test_an_interrupt_of_any_command_is_no_failure(here, monkeypatch, command):
    def interrupted(path):
        raise KeyboardInterrupt

    monkeypatch.setattr("uvms_mj.records.mcap.read", interrupted)
    monkeypatch.setattr(Trace, "load", interrupted)
    done = here(command, "run.mcap", *(("--to", "csv") if command == "export" else ()))
    assert done.exit_code == 130
    assert done.stderr.strip() in ("interrupted", "stopped")


def test_closed_streams_stop_nothing(tmp_path):
    """Closed standard streams do not stop a run, and no file of the run gets the descriptor of a stream."""
    command = f"{sys.executable} -m uvms_mj run simulation.duration=0.005 --out here <&- >&- 2>&-"
    assert subprocess.run(["bash", "-c", command], cwd=tmp_path, timeout=120).returncode == 0
    assert Trace.load(tmp_path / "here" / "run.mcap").status.name == "completed"
    keys_ = f"{sys.executable} -m uvms_mj keys >&-"
    assert subprocess.run(["bash", "-c", keys_], stdout=subprocess.DEVNULL, timeout=60).returncode == 0


def test_an_unknown_mujoco_gl_stops_no_command(tmp_path):
    run = [sys.executable, "-m", "uvms_mj", "run", "-q", "simulation.duration=0.002"]
    environment = os.environ | {"MUJOCO_GL": "xyz"}
    done = subprocess.run(run, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(("number", "place"), [(signal.SIGINT, "uvms_mj.cli"), (signal.SIGTERM, "llvmlite")])
def test_a_signal_during_an_import_ends_with_one_line(tmp_path, number, place):
    """The signal arrives exactly when the import of a module begins, as one of a user may in the first half second."""
    code = f"""if True:
        import os, sys
        class Sends:
            def find_spec(self, name, path=None, target=None):
                if name == {place!r}:
                    sys.meta_path.remove(self)
                    os.kill(os.getpid(), {int(number)})
        sys.argv = ["uvms-mj", "run", "-q", "--out", "here"]
        from uvms_mj.__main__ import main
        sys.meta_path.insert(0, Sends())
        main()
    """
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 128 + number, done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert "interrupted" in done.stderr
    assert not list(tmp_path.iterdir())


def test_an_exception_that_a_signal_became_is_still_the_signal(here, monkeypatch):
    """An import in C replaces KeyboardInterrupt by ImportError."""

    def interrupted(*_, **__):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ImportError("numpy._core failed to import") from None

    monkeypatch.setattr("uvms_mj.engine.simulation.checked", interrupted)
    done = here("run", "-q")
    assert done.exit_code == 130
    assert done.stderr == "interrupted before the first step\n"
