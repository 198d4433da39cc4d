"""Runs of the tree of links in tests/data, with signals of a tool whose frame is that of the link ``rod``."""

import dataclasses
from pathlib import Path

import numpy as np

from uvms_mj import Scenario, Trace, simulate
from uvms_mj.physics.frames import quat_product, rotation_matrix
from uvms_mj.stages.signals import Signal

TREE = Path(__file__).parents[1] / "data" / "tree.xml"
JOINTS = ("shoulder", "extension", "hinge")
MOVING = {
    "vehicle.model": str(TREE),
    "initial.joints": [0.5, 0.05, 0.3],
    "joints.name": "position",
    "joints.target": [0.9, -0.05, 0.3],
    "initial.attitude_deg": [5.0, -4.0, 8.0],
    "wall.position": 0.002,
    "reference.step_time": 0.0,
    "reference.target": [0.05, 0.02, 0.0],
    "reference.bandwidth": 10.0,
}
TOOL = (
    Signal("p_WT", (3,), "m", "W", "position of the tool"),
    Signal("quat_WT", (4,), "1", "W", "attitude of the tool, w x y z"),
    Signal("nu_T", (6,), "m/s, rad/s", "T", "velocity of the tool"),
    Signal("manipulability", (), "1", "-", "manipulability"),
)


def tree_run(duration: float = 0.4, **overrides) -> Trace:
    """A run of the tree, which touches the wall while its joints move."""
    return simulate(Scenario.load("push_wall", MOVING | {"simulation.duration": duration} | overrides, "impedance"))


def link_poses(trace: Trace) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Position (n, 3) and attitude (n, 4) in W of each link by its name."""
    poses, links = [(trace.p_WB, trace.quat_WB)], trace.header.geometry.links
    for i, link in enumerate(links):
        p_WP, quat_WP = poses[link.parent + 1]
        p, quat = link.pose(trace.q[:, i])
        poses.append((p_WP + np.einsum("nij,nj->ni", rotation_matrix(quat_WP), p), quat_product(quat_WP, quat)))
    return {link.name: pose for link, pose in zip(links, poses[1:], strict=True)}


def with_tool(trace: Trace) -> Trace:
    """The same run with the signals of a tool."""
    p, quat = link_poses(trace)["rod"]
    nu_T = np.gradient(np.hstack([p, p]), trace.t, axis=0)
    volume = 1.0 + 0.5 * np.sin(20.0 * trace.t)[:, None]
    rows = np.hstack([trace.rows(), p, quat, nu_T, volume])
    return Trace.of(dataclasses.replace(trace.header, signals=(*trace.signals, *TOOL)), rows, trace.outcome)
