"""Recordings of a vehicle with joints: links where their poses are, joints by their names, the tool's frame."""

from pathlib import Path

import numpy as np
import pytest
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from tree_run import JOINTS, tool_run
from uvms_mj.views import rerun as rerun_view
from uvms_mj.views.rerun import run, viewer
from uvms_mj.views.rerun.layout import layout
from uvms_mj.views.rerun.run import POSE_HZ

PATHS = {"boom": "boom", "rod": "boom/rod", "flap": "flap"}
"""Path of each link below the vehicle."""


@pytest.fixture(scope="module")
def armed(tmp_path_factory):
    trace = tool_run()
    rerun_view.save({"run": trace}, path := tmp_path_factory.mktemp("rrd") / "run.rrd")
    return trace, columns(path)


def columns(path: Path) -> dict[str, dict[str, list]]:
    """Components of each entity of a recording, in the order of time."""
    found: dict[str, dict[str, list]] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        entity = found.setdefault(str(chunk.entity_path), {})
        for name in batch.schema.names:
            entity.setdefault(name, []).extend(batch.column(name).to_pylist())
    return found


def test_links_have_their_poses_in_the_entities_of_their_parents(armed):
    """A test of the plant compares these poses with MuJoCo."""
    trace, found = armed
    every = round(1.0 / (POSE_HZ * (trace.t[1] - trace.t[0])))
    for i, link in enumerate(trace.header.geometry.links):
        entity = found[f"/world/vehicle/{PATHS[link.name]}"]
        p, quat = link.pose(trace.q[::every, i])
        np.testing.assert_array_equal(np.array(entity["Transform3D:translation"])[:, 0], p.astype("f4"))
        shown = np.array(entity["Transform3D:quaternion"])[:, 0]
        np.testing.assert_array_equal(shown, quat[:, [1, 2, 3, 0]].astype("f4"))
        meshes = [path for path in found if path.startswith(f"/world/vehicle/{PATHS[link.name]}/part")]
        assert len(meshes) == len({shape.rgba for shape in link.shapes}) > 0
    assert run.paths(trace.header.geometry) == [("boom",), ("boom", "rod"), ("flap",)]


def test_the_tool_and_its_reference_are_triads_in_their_frames(armed):
    trace, found = armed
    every = round(1.0 / (POSE_HZ * (trace.t[1] - trace.t[0])))
    tool, reference = found["/world/tool"], found["/world/reference"]
    shown = np.array(tool["Transform3D:translation"])[:, 0]
    np.testing.assert_array_equal(shown, trace.p_WT[::every].astype("f4"))
    for entity in (tool, reference):
        axes = np.array(entity["Arrows3D:vectors"][0])
        np.testing.assert_allclose(axes, run.TRIAD_M * np.eye(3), rtol=1e-6)
    assert "Boxes3D:half_sizes" not in reference, "the box is that of a vehicle's reference"
    way = [row[0] for row in found["/world/trajectory"]["LineStrips3D:strips"] if row]
    np.testing.assert_array_equal(way[-1][1], trace.p_WT[::every][-1].astype("f4"))


def test_joints_are_plotted_by_their_names(armed):
    trace, found = armed
    for i, joint in enumerate(JOINTS):
        for name in ("q", "q_dot", "tau_q"):
            entity = found[f"/signals/{name}/{joint}"]
            assert np.array_equal(np.array(entity["Scalars:scalars"])[:, 0], trace[name][:, i])
    assert found["/signals/q/extension"]["SeriesLines:names"][0] == ["q.extension [m]"]
    assert found["/signals/tau_q/shoulder"]["SeriesLines:names"][0] == ["tau_q.shoulder [N m]"]
    for traces in ({"a": trace}, {"a": trace, "b": trace}):
        blueprint = layout(viewer._runs(traces))
        groups = blueprint.root_container.contents[1].contents
        names = [
            view.name for group in groups for view in (group.contents if isinstance(group, rrb.Container) else [group])
        ]
        assert any(name.startswith("Position p_WT") for name in names)
        assert any(name.startswith("Joints q: shoulder") for name in names)
        assert any(name.startswith("Manipulability") for name in names)
