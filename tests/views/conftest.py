"""Traces and a recording, for all tests of views."""

from pathlib import Path

import pytest

from uvms_mj import Scenario, Trace, simulate
from uvms_mj.views import rerun as rerun_view


@pytest.fixture(scope="module")
def trace(tmp_path_factory) -> Trace:
    """A run that touches the wall, from its log."""
    log = tmp_path_factory.mktemp("log") / "run.mcap"
    soon = {"reference.step_time": 0.0, "reference.bandwidth": 5.0, "wall.position": 0.5}
    soon |= {"reference.target": [0.51, 0.0, 0.0], "simulation.duration": 3.0}
    simulate(Scenario.load("push_wall", soon)).save(log)
    return Trace.load(log)


@pytest.fixture(scope="module")
def other() -> Trace:
    return simulate(Scenario.load("push_wall", {"simulation.duration": 1.0}, "impedance"))


@pytest.fixture(scope="module")
def recording(trace, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("rrd") / "run.rrd"
    rerun_view.save({"run": trace}, path)
    return path
