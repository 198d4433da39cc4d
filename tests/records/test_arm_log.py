"""Logs of a vehicle with joints: the frames and markers are where MuJoCo has the bodies, and the numbers are exact."""

import dataclasses
import json

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from recorded import decoded, rewritten, same
from tree_run import JOINTS, TREE, tool_run
from uvms_mj import InputError, Trace
from uvms_mj.analysis.summary import summary
from uvms_mj.stages.signals import BAND, JOINT_SIGNALS, OF_JOINTS


@pytest.fixture(scope="module")
def armed(tmp_path_factory):
    """A run of the tree with the signals of a tool: its trace and its log."""
    trace = tool_run()
    trace.save(path := tmp_path_factory.mktemp("log") / "run.mcap")
    return trace, path


def placed(message) -> dict[str, tuple[np.ndarray, Rotation]]:
    """Position and attitude in map of each frame of a message of /tf, composed along the tree of frames."""
    poses = {"map": (np.zeros(3), Rotation.identity())}
    for each in message.transforms:
        p, q = each.transform.translation, each.transform.rotation
        p_WP, R_WP = poses[each.header.frame_id]
        R = Rotation.from_quat([q.x, q.y, q.z, q.w])
        poses[each.child_frame_id] = p_WP + R_WP.apply([p.x, p.y, p.z]), R_WP * R
    return poses


def test_frames_and_markers_are_where_mujoco_has_the_bodies(armed):
    trace, path = armed
    topics, model = decoded(path), mujoco.MjModel.from_xml_path(str(TREE))
    data = mujoco.MjData(model)
    ((_, vehicle),) = topics["/markers/vehicle"]
    solids = [m for m in vehicle.markers if m.type != 2 or m.header.frame_id == "link/rod"]  # not a capsule's ends
    assert all(marker.frame_locked for marker in vehicle.markers)
    for k in range(0, len(trace), 50):
        poses = placed(topics["/tf"][k][1])
        assert poses.keys() - {"map", "base_link", "reference", "tool"} == {"link/boom", "link/rod", "link/flap"}
        data.qpos[:] = *trace.p_WB[k], *trace.quat_WB[k], *trace.q[k]
        mujoco.mj_kinematics(model, data)
        for body, frame in (("hull", "base_link"), *((name, f"link/{name}") for name in ("boom", "rod", "flap"))):
            p, R = poses[frame]
            np.testing.assert_allclose(p, data.body(body).xpos, atol=1e-12)
            np.testing.assert_allclose(R.as_matrix(), data.body(body).xmat.reshape(3, 3), atol=1e-12)
        np.testing.assert_allclose(poses["tool"][0], trace.p_WT[k], atol=1e-15)
        for geom, marker in enumerate(solids):
            p, R = poses[marker.header.frame_id]
            at = marker.pose.position
            np.testing.assert_allclose(p + R.apply([at.x, at.y, at.z]), data.geom_xpos[geom], atol=1e-12)
    assert np.ptp(trace.q, axis=0).min() > 0.005, "all joints move"


def test_joint_states_are_the_signals_and_a_log_gives_the_trace_back(armed):
    trace, path = armed
    topics = decoded(path)
    states = [message for _, message in topics["/joint_states"]]
    assert {tuple(message.name) for message in states} == {JOINTS}
    for part, name in (("position", "q"), ("velocity", "q_dot"), ("effort", "tau_q")):
        assert np.array_equal([getattr(message, part) for message in states], trace[name]), name
    assert {signal.name for signal in JOINT_SIGNALS if signal.shape == (0,)} == {*OF_JOINTS} - {*BAND["tau_q"]}
    assert "/signals/q" not in topics
    limited = [message.data for _, message in topics["/running/joint_saturation_time"]]
    assert np.array_equal(limited, trace.joint_saturation_time)
    twists = [m.twist for _, m in topics["/tool/twist"]]
    assert np.array_equal([[t.linear.x, t.angular.z] for t in twists], trace.nu_T[:, [0, 5]])
    assert {m.header.frame_id for _, m in topics["/tool/twist"]} == {"tool"}
    assert {m.header.frame_id for _, m in topics["/tau_cmd"]} == {"tool"}
    assert {m.header.frame_id for _, m in topics["/tau"]} == {"base_link"}
    frames = {signal.name: signal.frame for signal in trace.signals}
    assert (frames["s"], frames["nu_e"], frames["nu_T"], frames["nu"], frames["tau"]) == ("T", "T", "T", "B", "B")
    measured = [message for _, message in topics["/measured/joint_states"]]
    assert np.array_equal([message.position for message in measured], trace.q_m)
    loaded = Trace.load(path)
    same(trace, loaded)
    assert loaded.header.geometry.links == trace.header.geometry.links
    names = [column.name for column in loaded.columns()]
    assert [f"q.{joint}" for joint in JOINTS] == [name for name in names if name.startswith("q.")]
    units = {column.name: column.unit for column in loaded.columns()}
    assert (units["q.shoulder"], units["q.extension"], units["tau_q.extension"]) == ("rad", "m", "N")


def test_a_log_whose_joints_and_signals_differ_is_refused(armed, tmp_path):
    _, path = armed

    def fewer(name, data):
        if name != "geometry.json":
            return name, data
        geometry = json.loads(data)
        geometry["links"].pop()
        return name, json.dumps(geometry).encode()

    (tmp_path / "fewer.mcap").write_bytes(rewritten(path, fewer))
    with pytest.raises(InputError, match=r"run.json: q, q_dot, tau_q, .* must have 2 numbers, one a joint"):
        Trace.load(tmp_path / "fewer.mcap")


def test_a_log_from_before_the_time_at_the_motors_limits_is_read(armed, tmp_path):
    trace, _ = armed
    header, name = trace.header, "joint_saturation_time"
    rows = np.delete(trace.rows(), header.places[name], axis=1)
    signals = tuple(signal for signal in header.signals if signal.name != name)
    Trace.of(dataclasses.replace(header, signals=signals), rows, trace.outcome).save(tmp_path / "run.mcap")
    loaded = Trace.load(tmp_path / "run.mcap")
    assert name not in loaded.arrays
    assert np.array_equal(loaded.tau_q, trace.tau_q)
    assert summary(loaded, {})["saturated_joints_s"] is None
