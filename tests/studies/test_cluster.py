"""Studies on a Dask cluster: a real scheduler and two worker processes on the loopback interface."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import psutil
import pytest
from pandas.testing import assert_frame_equal

from law_files import HEADER, one_liner
from page_numbers import page as page_of
from short_study import HERE
from uvms_mj import InputError, Study
from uvms_mj.studies.pool.executors import Cluster
from uvms_mj.studies.results import frame

pytest.importorskip("distributed", reason="needs the extra cluster")

PAGE = page_of("cluster").read_text()
MODELS = Path(__file__).parents[2] / "models"
FILES = {
    "law.py": f"from gains import SLOPE\n{HEADER}"
    + one_liner("Damps", "tau_cmd[:] = signals.tau_nom\ntau_cmd[0] -= SLOPE * signals.nu[0]"),
    "gains.py": "SLOPE = 20.0\n",
    "metric.py": "def peak(trace):\n    return trace.force_peak[-1]\n",
}


def options_of(what, without):
    """The options of a command of the page, for this machine."""
    return re.search(rf"^dask {what} (.*127\.0\.0\.1.*)$", PAGE, re.MULTILINE)[1].replace(without, "").split()


class Dask:
    """A scheduler and two workers, each a process with one thread."""

    def __init__(self, folder):
        self.folder, self.processes = folder, []
        said = self._start("scheduler", *options_of("scheduler", "--port 8786"), "--port", "0")
        self.address = re.search(r"tcp://127\.0\.0\.1:\d+", self._line(said, "Scheduler at")).group()
        self.workers = [self.worker() for _ in range(2)]

    def _start(self, what, *arguments):
        log = self.folder / f"{what}-{len(self.processes)}.log"
        command = [sys.executable, "-m", "distributed.cli.dask_" + what, *arguments]
        with log.open("w") as file:
            self.processes.append(subprocess.Popen(command, stderr=file, stdout=file, cwd=self.folder))
        return log

    def _line(self, log, words):
        end = time.monotonic() + 60.0
        while time.monotonic() < end:
            for line in log.read_text().splitlines():
                if words in line:
                    return line
            time.sleep(0.1)
        raise AssertionError(log.read_text())

    def worker(self):
        options = options_of("worker", "tcp://127.0.0.1:8786")
        self._line(self._start("worker", self.address, *options), "Registered to")
        return self.processes[-1]

    def end(self):
        for process in self.processes:
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def dask(tmp_path_factory):
    cluster = Dask(tmp_path_factory.mktemp("dask"))
    yield cluster
    cluster.end()


def test_files_travel_and_a_killed_worker_loses_nothing(dask, study_file, tmp_path):
    """The user's files are gone when the workers run, and one of two workers is killed in mid-study."""
    home = tmp_path / "home"
    home.mkdir()
    for name, text in FILES.items():
        (home / name).write_text(text)
    path = study_file("home/s.toml", runs=10, metrics=', "metric.py:peak"', more='[[laws]]\nname = "law.py:Damps"\n')
    vehicle = home / "mine.xml"
    vehicle.write_text((MODELS / "bluerov1.xml").read_text())
    study = Study.load(path, {"vehicle.model": str(vehicle)})
    study.run(tmp_path / "here", workers=2)
    killed = []

    def kill(what, done, failed, total):
        for name in (*FILES, "mine.xml"):
            (home / name).unlink(missing_ok=True)
        if done >= 6 and not killed:
            killed.append(os.kill(dask.workers[0].pid, signal.SIGKILL))

    executor = Cluster(dask.address)
    assert executor.size == 2
    study.run(tmp_path / "there", executor=executor, progress=kill)
    executor.shutdown()
    assert killed
    here, there = frame(tmp_path / "here"), frame(tmp_path / "there")
    assert_frame_equal(here, there, check_exact=True)
    assert set(there["law"]) == {"gsta", "impedance", "Damps"}
    assert (there["peak"] == there["contact.peak_N"]).all()


def listens(processes) -> set[str]:
    """The addresses on which processes listen."""
    found = [each for process in processes for each in process.net_connections("inet")]
    return {each.laddr.ip for each in found if each.status == psutil.CONN_LISTEN}


def test_the_commands_of_the_page_listen_on_this_machine_alone(dask):
    """Whoever reaches a port of theirs may run code in them."""
    alive = [each for each in dask.processes if each.poll() is None]  # one worker was killed
    assert len(alive) >= 2
    for each in alive:
        assert listens([psutil.Process(each.pid)]) == {"127.0.0.1"}


def test_the_command_on_a_cluster(dask, study_file, here):
    done = here("study", study_file(runs=2), "-o", "out", "--scheduler", dask.address, "--json")
    assert done.exit_code == 0, done.stderr
    assert '"completed": 4' in done.stdout


def test_a_benchmark_on_a_cluster_has_the_same_bytes(dask, here, tmp_path):
    arguments = ("bench", "impedance", "--tasks", "two_bumpers", "--at-most", "2", "-q")
    for options in (("-o", "there", "--scheduler", dask.address), ("-o", "same", "-j", "1")):
        done = here(*arguments, *options)
        assert done.exit_code == 0, done.output
    assert (tmp_path / "there" / "bench.json").read_bytes() == (tmp_path / "same" / "bench.json").read_bytes()


def test_a_worker_with_other_code_is_refused_in_one_line(dask, study_file, tmp_path, monkeypatch):
    from uvms_mj.studies import bundle

    ours = bundle.code() | {"sources": "000000000000"}
    monkeypatch.setattr(bundle, "code", lambda: ours)
    executor = Cluster(dask.address)
    with pytest.raises(InputError, match=r"a worker has other code than this machine: sources \w+ there, 0+ here"):
        Study.load(study_file(runs=2)).run(tmp_path / "out", executor=executor)
    executor.shutdown()


@pytest.mark.slow
def test_a_scheduler_that_ends_is_one_line_and_the_study_goes_on_elsewhere(dask, study_file, tmp_path, here):
    """The last test with the cluster."""
    path, folder, ended = study_file(runs=30), tmp_path / "out", threading.Event()

    def end():
        while not list(folder.glob("rows/part-*")):
            if ended.wait(0.05):  # the command has failed before its first rows
                return
        dask.end()

    ends = threading.Thread(target=end, daemon=True)
    ends.start()
    done = here("study", path, "-o", folder, "-q", "--scheduler", dask.address)
    ended.set()
    ends.join(60.0)
    assert not ends.is_alive()
    assert done.exit_code == 2
    assert done.stderr.startswith("error: the workers can't go on: ")
    assert "the same command goes on" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    Study.load(path).run(folder, executor=HERE)
    assert len(frame(folder)) == 60


def test_no_scheduler_is_one_line(monkeypatch):
    monkeypatch.setattr("uvms_mj.studies.pool.executors._PATIENCE_S", 1.0)
    with pytest.raises(InputError, match=r"tcp://127\.0\.0\.1:9: no scheduler answers: [^\n]*$"):
        Cluster("tcp://127.0.0.1:9")


def test_a_missing_extra_is_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'uvms-mj\[cluster\]'"):
        Cluster("tcp://127.0.0.1:9")


def test_the_batch_file_of_the_page_runs_a_study(study_file, tmp_path):
    """With a stand-in for srun that starts two tasks. It listens where the stand-in for hostname says."""
    script = PAGE.split("```bash\n")[1].split("```")[0]
    tools = {
        "srun": '"$@" & "$@" & wait',
        "hostname": "echo 127.0.0.1",
        "dask": f'exec {sys.executable} -m dask "$@"',
        "uvms-mj": f'exec {sys.executable} -m uvms_mj "$@"',
    }
    for name, line in tools.items():
        (tmp_path / name).write_text(f"#!/bin/bash\n{line}\n")
        (tmp_path / name).chmod(0o755)
    study_file("mine.toml", runs=4)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}", "SLURM_JOB_ID": str(os.getpid())}
    heard = set[str]()
    with subprocess.Popen(
        ["bash", "-c", script], cwd=tmp_path, env=environment, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL
    ) as job:
        while job.poll() is None:
            with contextlib.suppress(psutil.Error):  # of a process that has just ended
                heard |= listens(psutil.Process(job.pid).children(recursive=True))
            time.sleep(0.5)
        assert job.returncode == 0, job.stderr.read()
    assert heard == {"127.0.0.1"}
    assert len(frame(tmp_path / "results")) == 8
