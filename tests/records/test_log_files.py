"""Names of logs: one run into a folder at a time, and an existing log is named."""

import subprocess
import sys

import pytest

from uvms_mj import InputError, McapLog, Scenario, Trace, simulate

COMMAND = [sys.executable, "-m", "uvms_mj"]
SHORT = {"simulation.duration": 0.005}


def test_runs_into_one_folder_at_a_time(tmp_path):
    command = [*COMMAND, "run", "-q", "simulation.duration=2", "--out", "here"]
    runs = [subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) for _ in range(4)]
    said = [run.communicate(timeout=240)[1] for run in runs]
    for run, text in zip(runs, said, strict=True):
        assert run.returncode in (0, 2), text
        assert run.returncode == 0 or "another run is writing there" in text
    assert any(run.returncode == 0 for run in runs)
    for folder in {path.parent for path in tmp_path.rglob("scenario.toml")}:
        assert Trace.load(folder / "run.mcap").status.name == "completed"


def test_an_existing_log_is_named(tmp_path):
    path = tmp_path / "run.mcap"
    scenario = Scenario.load("push_wall", SHORT)
    simulate(scenario, sinks=[McapLog(path)])
    before = path.read_bytes()
    for kind in (InputError, FileExistsError):
        with pytest.raises(kind, match=r"run\.mcap: exists; give the log another name"):
            simulate(scenario, sinks=[McapLog(path)])
    assert path.read_bytes() == before
