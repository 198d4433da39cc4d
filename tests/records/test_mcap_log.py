"""Logs: an independent decoder and Trace read the recorded numbers, and the structure is that of ROS 2."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Statistics

from recorded import decoded, same
from uvms_mj import McapLog, Scenario, Status, Trace, simulate
from uvms_mj.physics.surfaces import SHAPES
from uvms_mj.records.mcap.layout import Format
from uvms_mj.records.scene import span
from uvms_mj.stages.signals import RUNNING, thruster_saturation_signal

ROOT = Path(__file__).parents[2]


def xyz(v):
    return [v.x, v.y, v.z]


def test_an_independent_decoder_reads_the_same_numbers(logged):
    trace, path = logged
    topics = decoded(path)
    n = len(trace)
    once = {"/tf_static", "/current", "/markers/vehicle", "/markers/surroundings"}
    assert {name for name, each in topics.items() if len(each) == 1} == once
    times = np.rint(trace.t * 1e9).astype(int)
    for name, each in topics.items():
        if name not in once and name != "/markers/forces":
            assert [t for t, _ in each] == times.tolist(), name

    def values(topic, of):
        return np.array([of(message) for _, message in topics[topic]])

    def wrench(m):
        return xyz(m.wrench.force) + xyz(m.wrench.torque)

    def twist(m):
        return xyz(m.twist.linear) + xyz(m.twist.angular)

    def array(m):
        assert len(m.layout.dim) == 1
        assert m.layout.dim[0].size == len(m.data)
        return list(m.data)

    def pose(m):
        return [*xyz(m.position), m.orientation.w, *xyz(m.orientation)]

    zeros = np.zeros((n, 3))
    assert np.array_equal(values("/odom", lambda m: pose(m.pose.pose)), np.hstack([trace.p_WB, trace.quat_WB]))
    assert np.array_equal(values("/odom", lambda m: twist(m.twist)), trace.nu)
    tf = values("/tf", lambda m: [*xyz(m.transforms[0].transform.translation), m.transforms[0].transform.rotation.w])
    assert np.array_equal(tf, np.hstack([trace.p_WB, trace.quat_WB[:, :1]]))
    assert np.array_equal(values("/tf", lambda m: xyz(m.transforms[1].transform.translation)), trace.p_d)
    assert [t.child_frame_id for t in topics["/tf"][0][1].transforms] == ["base_link", "reference"]
    assert np.array_equal(values("/reference/pose", lambda m: pose(m.pose))[:, :3], trace.p_d)
    assert np.array_equal(values("/reference/twist", twist), np.hstack([trace.p_d_dot, zeros]))
    assert np.array_equal(values("/error/twist", twist), trace.nu_e)
    accelerations = values("/reference/accel", lambda m: xyz(m.accel.linear) + xyz(m.accel.angular))
    assert np.array_equal(accelerations, np.hstack([trace.p_d_ddot, zeros]))
    assert np.array_equal(values("/accel", lambda m: xyz(m.accel.linear) + xyz(m.accel.angular)), trace.nu_dot)
    for topic in ("tau_nom", "tau_cmd", "tau", "tau_dist"):
        assert np.array_equal(values(f"/{topic}", wrench), trace[topic]), topic
    assert np.array_equal(values("/contact/map", wrench), np.hstack([trace.f_contact_W, zeros]))
    assert np.array_equal(values("/contact/measured", wrench), np.hstack([trace.f_contact_m_W, zeros]))
    for topic, name in (("/error/pose", "eta_e"), ("/s", "s"), ("/zeta", "zeta"), ("/law/z", "z"), ("/thrusters", "u")):
        assert np.array_equal(values(topic, array), trace[name]), topic
    running = [name for name in topics if name.startswith("/running/")]
    own = {signal.name for signal in (*RUNNING, thruster_saturation_signal(0))}
    assert {name.removeprefix("/running/") for name in running} == own
    for topic in running:
        signal = trace[topic.removeprefix("/running/")]
        assert np.array_equal(values(topic, array if signal.ndim > 1 else lambda m: m.data), signal), topic
    stamps = values("/tau", lambda m: [m.header.stamp.sec, m.header.stamp.nanosec])
    assert np.array_equal(stamps[:, 0] * 10**9 + stamps[:, 1], times)
    assert {m.header.frame_id for _, m in topics["/tau"]} == {"base_link"}
    assert {m.header.frame_id for _, m in topics["/contact/map"]} == {"map"}


def test_the_contact_wrench_in_base_link_is_the_force_at_the_vehicles_front(logged):
    """The force is rotated with SciPy; the arm of its moment is the vehicle's reach."""
    from scipy.spatial.transform import Rotation

    trace, path = logged
    R = Rotation.from_quat(trace.quat_WB, scalar_first=True)
    ros = np.array([xyz(m.wrench.force) + xyz(m.wrench.torque) for _, m in decoded(path)["/contact/base_link"]])
    assert np.abs(ros[:, :3] - R.inv().apply(trace.f_contact_W.copy())).max() < 1e-12
    arm = np.zeros((len(trace), 3))
    arm[:, 0] = trace.header.geometry.reach
    moment = R.inv().apply(np.cross(arm, trace.f_contact_W))
    assert np.abs(moment).max() > 0.01  # friction
    depth = np.maximum(0, trace.p_WB[:, 0] - trace.scenario.wall.position).max()
    assert np.abs(ros[:, 3:] - moment).max() <= depth * np.abs(trace.f_contact_W).max()


def test_the_files_structure_is_what_rosbag2_and_others_need(logged):
    trace, path = logged
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        header, summary = reader.get_header(), reader.get_summary()
        messages = list(reader.iter_messages())
        attachments = {a.name: a.data for a in reader.iter_attachments()}
        (metadata,) = reader.iter_metadata()
    assert header.profile == "ros2"
    statistics: Statistics = summary.statistics
    assert statistics.message_count == len(messages) == sum(statistics.channel_message_counts.values())
    assert statistics.chunk_count == len(summary.chunk_indexes)
    assert statistics.attachment_count == len(attachments)
    assert {c.message_encoding for c in summary.channels.values()} == {"cdr"}
    assert {s.encoding for s in summary.schemas.values()} == {"ros2msg"}
    assert all("/msg/" in s.name for s in summary.schemas.values())
    assert {c.schema_id for c in summary.channels.values()} == set(summary.schemas)
    assert all(c.metadata["unit"] for c in summary.channels.values())
    assert (statistics.message_start_time, statistics.message_end_time) == (0, round(trace.t[-1] * 1e9))
    assert set(attachments) == {"run.json", "scenario.toml", "geometry.json", "model/bluerov1.xml", "outcome.json"}
    assert attachments["model/bluerov1.xml"] == (ROOT / "models" / "bluerov1.xml").read_bytes()
    assert metadata.metadata["controller"] == "gsta"
    assert metadata.metadata["version mujoco"]
    # messages are in time order without sorting
    with open(path, "rb") as file:
        times = [m.log_time for _, _, m in NonSeekingReader(file).iter_messages(log_time_order=False)]
    assert times == sorted(times)
    done = subprocess.run(
        [Path(sys.executable).with_name("rerun"), "mcap", "check", "--full", path],
        capture_output=True,
        text=True,
        env=os.environ | {"DO_NOT_TRACK": "1", "HOME": str(path.parent)},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    rows = [line for line in done.stdout.splitlines() if " /" in line]
    assert len(rows) == len(summary.channels)
    assert all(line.startswith("ok") for line in rows), done.stdout


def test_markers_draw_every_geom_and_arrows_point_where_the_force_does(logged):
    trace, path = logged
    topics = decoded(path)
    vehicle = topics["/markers/vehicle"][0][1].markers
    assert len(vehicle) == len(trace.header.geometry.shapes) == 107
    assert {m.header.frame_id for m in vehicle} == {"base_link"}
    assert all(m.frame_locked and m.color.a > 0 and m.scale.x > 0 for m in vehicle)
    triangles = [m for m in vehicle if m.type == 11]
    assert all(len(m.points) % 3 == 0 and len(m.points) > 0 for m in triangles)
    wall = topics["/markers/surroundings"][0][1].markers[0]
    face = trace.scenario.wall.position + trace.header.geometry.reach
    assert wall.pose.position.x - wall.scale.x / 2 == pytest.approx(face)
    arrows = topics["/markers/forces"]
    assert [t for t, _ in arrows] == [round(k * 0.05e9) for k in range(9)]
    for t, message in arrows:
        k = int(np.argmin(np.abs(trace.t * 1e9 - t)))
        tail, tip = (np.array(xyz(p)) for p in message.markers[0].points)
        arrow = 0.05 * trace.f_contact_W[k]
        arrow *= min(1.0, span(trace.header) / max(np.linalg.norm(arrow), 1e-300))  # it stays in the scene
        assert np.allclose(tip - tail, arrow, atol=1e-12)


def test_a_log_gives_the_trace_back_exactly(logged, tmp_path):
    trace, path = logged
    loaded = Trace.load(path)
    same(trace, loaded)
    assert loaded.scenario == trace.scenario
    assert loaded.signals == trace.signals
    assert loaded.outcome == trace.outcome
    assert loaded.header.geometry.shapes == trace.header.geometry.shapes
    assert type(loaded.analytic) is type(trace.analytic)
    with pytest.raises(ValueError, match="read-only"):
        loaded.s[0, 0] = 1.0
    loaded.save(tmp_path / "again.mcap")
    same(trace, Trace.load(tmp_path / "again.mcap"))
    with pytest.raises(FileExistsError):
        loaded.save(tmp_path / "again.mcap")
    frame = loaded.to_dataframe()
    assert len(frame) == len(trace)
    assert np.array_equal(frame[["p_WB.x", "p_WB.y", "p_WB.z"]], trace.p_WB)
    assert (frame.attrs["units"]["tau.x"], frame.attrs["units"]["tau.yaw"]) == ("N", "N m")
    assert frame.attrs["frames"]["f_contact_W.x"] == "W"


def test_a_log_is_read_without_a_closed_form_and_without_markers(logged, monkeypatch):
    """They take longer than the rows of a short run, and may differ between versions."""
    trace, path = logged

    def asked(header):
        raise AssertionError("topics of constant values")

    monkeypatch.setattr("uvms_mj.records.mcap.topics.once", asked)
    same(trace, Trace.load(path))


@pytest.mark.parametrize("rate", ["full", "1000", "250", "2"])
@pytest.mark.parametrize("duration", [0.2, 0.12345])
def test_any_rate_and_duration_round_trips(tmp_path, rate, duration):
    """Chunks end at any row, and the last row is off the grid of the log rate."""
    scenario = Scenario.load("push_wall", {"simulation.duration": duration})
    trace = simulate(scenario, log_rate=rate, sinks=[McapLog(tmp_path / "run.mcap")])
    loaded = Trace.load(tmp_path / "run.mcap")
    same(trace, loaded)
    assert loaded.status is Status.completed
    assert loaded.t[-1] == round(duration / 1e-4) * 1e-4


@pytest.mark.parametrize(
    "states", [{"tau_contact_B": 6}, {"stamp": 2, "stampede": 2}, {"when": 20}, {"tip": 3, "p": 2}]
)
def test_a_state_of_any_name_is_logged_as_it_is(tmp_path, states):
    filled = "\n".join(f"        state_dot.{name}[:] = {i + 1}.0" for i, name in enumerate(states))
    (tmp_path / "odd.py").write_text(
        "from dataclasses import dataclass\nfrom uvms_mj import Controller\n\n"
        f"@dataclass(frozen=True)\nclass Odd(Controller):\n    states = {states}\n"
        f"    @staticmethod\n    def law(gains, state, signals, state_dot, tau_cmd):\n{filled}\n"
        "        tau_cmd[:] = 0.0\n"
    )
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.05}, f"{tmp_path}/odd.py:Odd")
    trace = simulate(scenario, sinks=[McapLog(tmp_path / "run.mcap")])
    loaded = Trace.load(tmp_path / "run.mcap")
    same(trace, loaded)
    for i, name in enumerate(states):
        np.testing.assert_allclose(loaded[name][-1], 0.05 * (i + 1))


SIZES = {"radius": 0.2, "length": 0.5, "edges": [0.4, 0.5, 0.6]}


@pytest.mark.parametrize("name", SHAPES)
def test_a_wall_of_each_shape_is_in_the_log(tmp_path, name):
    """With the length across the x of its attitude; a capsule is a cylinder and two spheres about its ends."""
    size = {key: SIZES[key] for key in SHAPES[name].keys}
    wall = {"shape": name, "position": [1.5, 0.2, 0.0], "attitude_deg": [0.0, 0.0, 30.0]} | size
    bodies = [{"position": [0.1, 0.0, 0.0], "radius": 0.05}]
    own = {"wall.present": False, "walls": [wall], "vehicle.contact_bodies": bodies, "simulation.duration": 0.01}
    simulate(Scenario.load("push_wall", own)).save(tmp_path / "run.mcap")
    ((_, message),) = decoded(tmp_path / "run.mcap", "/markers/surroundings")["/markers/surroundings"]
    walls = [marker for marker in message.markers if marker.ns == "wall"]
    assert len({marker.id for marker in walls}) == len(walls) == (3 if name == "capsule" else 1)
    middle = np.mean([xyz(marker.pose.position) for marker in walls], axis=0)
    if name != "plane":  # whose plate lies behind its face
        assert np.allclose(middle, wall["position"], atol=1e-12)
        widths = [marker.scale.x for marker in walls]
        assert np.allclose(widths, size["edges"][0] if name == "box" else 2.0 * size["radius"])


# Shipped files


def test_the_foxglove_layout_shows_topics_that_exist(logged):
    trace, _ = logged
    layout = json.loads((ROOT / "examples" / "foxglove_layout.json").read_text())
    text = json.dumps(layout)
    named = set(re.findall(r'"(/[a-z_/]+)[".]', text))
    assert named
    assert named <= {t.name for t in Format(trace.header).topics} | {
        "/law/z",
        "/analytic/contact",
        "/analytic/position",
    }
    assert {panel.partition("!")[0] for panel in layout["configById"]} == {"3D", "Parameters", "Plot"}
    shown, tree = [], [layout["layout"]]
    while tree:
        node = tree.pop()
        if isinstance(node, str):
            shown.append(node)
        else:
            tree += [node["first"], node["second"]]
    assert sorted(shown) == sorted(layout["configById"])
