"""Runs of the tree of links in tests/data: of its joints, and with the task at its tool."""

from pathlib import Path

from uvms_mj import Scenario, Trace, simulate

TREE = Path(__file__).parents[1] / "data" / "tree.xml"
JOINTS = ("shoulder", "extension", "hinge")
MOVING = {
    "vehicle.model": str(TREE),
    "initial.joints": [0.5, 0.05, 0.3],
    "initial.attitude_deg": [5.0, -4.0, 8.0],
    "reference.step_time": 0.0,
    "reference.bandwidth": 10.0,
}
OF_JOINTS = {
    "joints.name": "position",
    "joints.target": [0.9, -0.05, 0.3],
    "wall.position": 0.002,
    "reference.target": [0.05, 0.02, 0.0],
}
AT_TOOL = {
    "task.frame": "tool",
    "encoder.name": "encoder",
    "posture.joints": [1.2, -0.1, 0.3],
    "posture.order": ["joints"],
    "posture.joints_frequency": 5.0,
    "wall.position": 0.669,
    "reference.target": [0.75, 0.15, -0.35],
    "reference.attitude_deg": [5.484, 24.53, 10.63],
}


def tree_run(duration: float = 0.4, **overrides) -> Trace:
    """A run of the tree, which touches the wall with its hull while its joints move to a target."""
    return _run(OF_JOINTS, duration, overrides)


def tool_run(duration: float = 0.4, **overrides) -> Trace:
    """A run of the tree, which touches the wall with its tool."""
    return _run(AT_TOOL, duration, overrides)


def _run(given: dict, duration: float, overrides: dict) -> Trace:
    keys = MOVING | given | {"simulation.duration": duration} | overrides
    return simulate(Scenario.load("push_wall", keys, "impedance"))
