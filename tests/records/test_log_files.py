"""Names of logs: one run into a folder at a time, and an existing log is named."""

from pathlib import Path

import pytest

from uvms_mj import InputError, McapLog, Scenario, Trace, simulate
from uvms_mj.files import locked

SHORT = {"simulation.duration": 0.005}


def test_runs_into_one_folder_at_a_time(here):
    arguments = ("run", "-q", "simulation.duration=0.005", "--out", "here")
    Path("here").mkdir()
    with locked(Path("here")):
        done = here(*arguments)
        assert done.exit_code == 2
        assert "another run is writing there" in done.stderr
        assert not any(Path("here").rglob("*.mcap"))
    assert here(*arguments).exit_code == 0
    assert Trace.load("here/run.mcap").status.name == "completed"


def test_an_existing_log_is_named(tmp_path):
    path = tmp_path / "run.mcap"
    scenario = Scenario.load("push_wall", SHORT)
    simulate(scenario, sinks=[McapLog(path)])
    before = path.read_bytes()
    for kind in (InputError, FileExistsError):
        with pytest.raises(kind, match=r"run\.mcap: exists; give the log another name"):
            simulate(scenario, sinks=[McapLog(path)])
    assert path.read_bytes() == before
