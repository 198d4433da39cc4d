"""A run with its log, for all tests of logs."""

import pytest

from recorded import TOUCHING
from uvms_mj import McapLog, Scenario, simulate


@pytest.fixture(scope="module")
def logged(tmp_path_factory):
    """A short run with contact, friction, rotation and a disturbance: its trace from memory, and its log."""
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    trace = simulate(Scenario.load("push_wall", TOUCHING), sinks=[McapLog(path)], engine="mujoco")
    assert trace.touches[-1] > 0
    return trace, path
