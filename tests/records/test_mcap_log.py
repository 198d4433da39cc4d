"""Logs: read by independent code and by Trace; truncated, damaged and forged logs; killed runs."""

import contextlib
import copy
import dataclasses
import hashlib
import io
import json
import os
import pickle
import random
import re
import signal
import struct
import subprocess
import sys
import time
import zlib
from collections import defaultdict
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Statistics
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from uvms_mj.control.recorded import recorded_law

from uvms_mj import InputError, McapLog, Scenario, SinkError, Status, Trace, simulate
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.records.mcap.attachments import refuse_large, without_paths
from uvms_mj.records.mcap.layout import Format
from uvms_mj.records.scene import span
from uvms_mj.stages.signals import RUNNING

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, "-X", "faulthandler", "-m", "uvms_mj"]
TOUCHING = {
    "simulation.duration": 0.4,
    "wall.position": 0.002,
    "wall.friction": 0.3,
    "reference.step_time": 0.0,
    "reference.target": [0.05, 0.02, 0.0],
    "disturbance.amplitude": [1.0, 0.5, 0.2, 0.1, 0.1, 0.1],
    "disturbance.frequency_hz": [1.0, 2.0, 3.0, 1.0, 2.0, 3.0],
    "initial.attitude_deg": [5.0, -4.0, 8.0],
    "reference.bandwidth": 10.0,
}
LAW = '''
from dataclasses import dataclass
from uvms_mj import Controller, gain

@dataclass(frozen=True)
class Mine(Controller):
    """Integral action, and a state that does not have six components."""
    k: float = gain(2.0, "1/s", "integral gain")
    weights: tuple[float, ...] = gain((1.0, 2.0, 3.0), "1", "weights")
    flag: bool = gain(True, "1", "a flag")
    states = {"xi": 6, "odom": 2}
    name = "mine"

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        state_dot.xi[:] = signals.eta_e
        state_dot.odom[0] = 1.0
        tau_cmd[:] = signals.tau_nom - gains.k * state.xi
'''


@pytest.fixture(scope="module")
def logged(tmp_path_factory):
    """A short run with contact, friction, rotation and a disturbance: its trace from memory, and its log."""
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    trace = simulate(Scenario.load("push_wall", TOUCHING), sinks=[McapLog(path)])
    assert trace.touches[-1] > 0
    return trace, path


def same(a, b):
    assert list(a) == list(b)
    for name in a:
        assert np.array_equal(a[name], b[name]), name


def decoded(path):
    """Every message of a log by topic, decoded by mcap-ros2-support: (log time, message) in file order."""
    messages = defaultdict(list)
    with open(path, "rb") as file:
        for _, channel, message, ros in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            messages[channel.topic].append((message.log_time, ros))
    return messages


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
    assert np.array_equal(values("/accel", lambda m: xyz(m.accel.linear) + xyz(m.accel.angular)), trace.nu_dot)
    for topic in ("tau_nom", "tau_cmd", "tau", "tau_dist"):
        assert np.array_equal(values(f"/{topic}", wrench), trace[topic]), topic
    assert np.array_equal(values("/contact/map", wrench), np.hstack([trace.f_contact_W, zeros]))
    assert np.array_equal(values("/contact/measured", wrench), np.hstack([trace.f_contact_m_W, zeros]))
    for topic, name in (("/error/pose", "eta_e"), ("/s", "s"), ("/zeta", "zeta"), ("/law/z", "z"), ("/thrusters", "u")):
        assert np.array_equal(values(topic, array), trace[name]), topic
    running = [name for name in topics if name.startswith("/running/")]
    assert len(running) == len(RUNNING)
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


def test_a_long_run_keeps_its_end_alone_in_memory(tmp_path):
    scenario = Scenario.load("push_wall", {"simulation.duration": 3.0})
    kept = simulate(scenario, sinks=[McapLog(tmp_path / "run.mcap")], keep_s=0.5)
    whole = Trace.load(tmp_path / "run.mcap")
    assert len(whole) == 3001
    assert 500 <= len(kept) < 900
    for name in kept:
        assert np.array_equal(kept[name], whole[name][-len(kept) :]), name


def run(*arguments, cwd, **options):
    return subprocess.run(
        [*COMMAND, *map(str, arguments)], cwd=cwd, capture_output=True, text=True, timeout=240.0, **options
    )


def test_a_run_repeats_from_its_log_bit_for_bit(tmp_path):
    """The vehicle's file and its parts have been deleted before. Gains can be changed on the command line."""
    folder = tmp_path / "vehicle"
    (folder / "parts").mkdir(parents=True)
    cube = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    (folder / "parts" / "nose.obj").write_text(cube)
    (folder / "more.xml").write_text('<mujoco><asset><mesh name="nose" file="parts/nose.obj"/></asset></mujoco>')
    text = (ROOT / "models" / "bluerov1.xml").read_text().replace("</asset>", '</asset><include file="more.xml"/>')
    text = text.replace("<freejoint", '<geom type="mesh" mesh="nose" pos=".2 0 0" mass="0"/><freejoint', 1)
    (folder / "mine.xml").write_text(text)
    settings = ["simulation.duration=0.3", "wall.position=0.002", "reference.step_time=0"]
    first = run(
        "run", *settings, f"vehicle.model={folder / 'mine.xml'}", "-q", "-o", "a", "--log-rate", "500", cwd=tmp_path
    )
    assert first.returncode == 0, first.stderr
    original = Trace.load(tmp_path / "a" / "run.mcap")
    assert set(original.header.mjcf.files) == {"mine.xml", "more.xml", "nose.obj"}
    assert original.header.geometry.reach == pytest.approx(0.3, abs=0.01)
    for file in sorted(folder.rglob("*"), reverse=True):
        file.unlink() if file.is_file() else file.rmdir()
    again = run("run", "--from", "a/run.mcap", "-q", "-o", "b", cwd=tmp_path)
    assert (again.returncode, again.stderr) == (0, "")
    same(original, Trace.load(tmp_path / "b" / "run.mcap"))
    other = run("run", "--from", "b/run.mcap", "controller.k_1=6", "-q", "-o", "c", cwd=tmp_path)
    assert other.returncode == 0, other.stderr
    changed = Trace.load(tmp_path / "c" / "run.mcap")
    assert changed.scenario.controller.k_1 == 6.0
    assert not np.array_equal(changed.tau, original.tau)


def test_a_users_law_is_recorded_and_never_run_from_a_log(tmp_path):
    path = tmp_path / "secret_place" / "my_law.py"
    path.parent.mkdir()
    path.write_text(LAW + "\nprint('ran', __file__)\n")
    done = run("run", "-c", f"{path}:Mine", "controller.k=3", "simulation.duration=0.2", "-q", "-o", "a", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    log = tmp_path / "a" / "run.mcap"
    raw = log.read_bytes()
    assert b"secret_place" not in raw
    assert len(os.uname().nodename) < 6 or os.uname().nodename.encode() not in raw
    trace = Trace.load(log)
    assert trace.xi.shape[1:] == (6,)
    assert np.allclose(trace.odom[:, 0], trace.t)
    assert trace.scenario.controller.k == 3.0
    assert trace.scenario.controller.weights == (1.0, 2.0, 3.0)
    assert trace.scenario.controller.flag is True
    assert trace.header.law.source == "my_law.py:Mine"
    assert trace.header.law.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert trace.header.law.code == path.read_text()
    with pytest.raises(InputError, match="never run"):
        simulate(trace.scenario, mjcf=trace.header.mjcf)
    assert decoded(log)["/law/xi"]
    refused = run("run", "--from", log, "-q", "-o", "b", cwd=tmp_path)
    assert refused.returncode == 2
    assert "--controller" in refused.stderr
    assert "ran" not in refused.stdout
    shown = run("info", log, "--show", "law/my_law.py", cwd=tmp_path)
    assert shown.stdout == path.read_text()
    again = run("run", "--from", log, "-c", f"{path}:Mine", "-q", "-o", "c", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert "sha256" not in again.stderr
    same(trace, Trace.load(tmp_path / "c" / "run.mcap"))
    path.write_text(LAW.replace("- gains.k", "- 2.0 * gains.k"))
    edited = run("run", "--from", log, "-c", f"{path}:Mine", "-q", "-o", "d", cwd=tmp_path)
    assert edited.returncode == 0
    assert "differs from the recorded code" in edited.stderr


@pytest.mark.parametrize(
    "text", ["<mujoco", "\ufeff<mujoco", "<!-- hull -- and skids --><!-- <mesh file='/a/b.stl'/> --><mujoco"]
)
def test_no_path_of_a_users_is_in_a_model_and_the_log_is_enough_to_repeat(tmp_path, text):
    folder = tmp_path / "secret_place"
    folder.mkdir()
    (folder / "hull.obj").write_text("v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
    model = (ROOT / "models" / "bluerov1.xml").read_text().replace("<mujoco", text, 1)
    model = re.sub(r"<compiler ", f"<compiler meshdir='{folder}' ", model, count=1)
    with_mesh = model.replace("</asset>", '<mesh name="hull" file="hull.obj"/></asset>', 1)
    for name, text in (("plain", model), ("mesh", with_mesh)):
        (folder / f"{name}.xml").write_text(text, encoding="utf-8")
    for name in ("plain", "mesh"):
        scenario = Scenario.load(
            "push_wall", {"vehicle.model": str(folder / f"{name}.xml"), "simulation.duration": 0.1}
        )
        trace = simulate(scenario, sinks=[McapLog(tmp_path / f"{name}.mcap")])
        assert b"secret_place" not in (tmp_path / f"{name}.mcap").read_bytes()
    for file in folder.iterdir():
        file.unlink()
    for name in ("plain", "mesh"):
        loaded = Trace.load(tmp_path / f"{name}.mcap")
        same(trace, simulate(loaded.scenario, mjcf=loaded.header.mjcf))


@pytest.mark.parametrize(
    "said", ["open('/home/jo/my dir/a b.txt')", "file:///home/jo/x", "/home/jo/x: no", r"C:\\jo\\x", "~/jo/x"]
)
def test_what_a_law_raises_is_logged_without_folders(tmp_path, said):
    message = without_paths(f"RuntimeError: {said} in N/m and 'm/s', http://a.b/c")
    assert "jo" not in message
    assert "my dir" not in message
    assert message.endswith("in N/m and 'm/s', http://a.b/c")


def test_no_path_of_a_users_is_in_a_warning(tmp_path):
    path = tmp_path / "secret_place" / "slow.py"
    path.parent.mkdir()
    path.write_text(LAW.replace("state_dot.odom[0] = 1.0", "open(__file__).close(); state_dot.odom[0] = 1.0"))
    done = run("run", "-c", f"{path}:Mine", "simulation.duration=0.02", "-q", "-o", "a", cwd=tmp_path)
    assert "plain Python" in done.stderr
    assert b"secret_place" not in (tmp_path / "a" / "run.mcap").read_bytes()
    assert Trace.load(tmp_path / "a" / "run.mcap").notes


def test_a_law_that_becomes_slow_reaches_the_disk_every_second_too(tmp_path):
    """The loop knows the duration of a step only after the step."""

    class Log(McapLog):
        def write(self, rows):
            instants.append(time.monotonic())
            super().write(rows)

    (tmp_path / "slow.py").write_text(
        "import time\nfrom dataclasses import dataclass\nfrom uvms_mj import Controller\n\n"
        "@dataclass(frozen=True)\nclass Slow(Controller):\n"
        "    @staticmethod\n    def law(gains, state, signals, state_dot, tau_cmd):\n"
        "        tau_cmd[:] = 0.0\n        if signals.t > 0.25:\n            time.sleep(0.01)\n"
    )
    instants = []
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.27}, f"{tmp_path}/slow.py:Slow")
    with pytest.warns(UserWarning, match="plain Python"):
        simulate(scenario, log_rate="full", sinks=[Log(tmp_path / "run.mcap")])
    assert len(instants) > 5
    assert np.diff(instants).max() < 1.0


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


def test_sinks_and_trace_share_rows_that_nobody_can_change(tmp_path):
    class Vandal(McapLog):
        def write(self, rows):
            rows[:] = 0.0

    with pytest.raises(SinkError, match="read-only"):
        simulate(Scenario.load("push_wall", {"simulation.duration": 0.1}), sinks=[Vandal(tmp_path / "x.mcap")])


def test_a_trace_can_be_copied_and_sent_to_another_process():
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.1}))
    for copied in (copy.deepcopy(trace), pickle.loads(pickle.dumps(trace))):
        same(trace, copied)
        assert copied.scenario == trace.scenario
        assert copied.outcome == trace.outcome


def test_a_trace_without_its_beginning_is_not_saved_as_if_it_had_it(tmp_path):
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.5}), keep_s=0.1)
    assert trace.t[0] > 0.0
    with pytest.raises(InputError, match="begins at"):
        trace.save(tmp_path / "x.mcap")
    assert not (tmp_path / "x.mcap").exists()


def test_rows_that_do_not_fit_the_steps_are_no_complete_log(logged, tmp_path):
    trace, _ = logged
    for outcome in (
        dataclasses.replace(trace.outcome, steps=trace.steps - trace.header.row_steps),
        dataclasses.replace(trace.outcome, steps=trace.steps + trace.header.row_steps),
    ):
        path = tmp_path / f"{outcome.steps}.mcap"
        dataclasses.replace(trace, outcome=outcome).save(path)
        with pytest.raises(InputError, match="do not fit"):
            Trace.load(path)


def test_a_slow_law_still_reaches_the_disk_every_second(tmp_path):
    """A law in plain Python takes 20 ms. Rows are in the file long before 1000 steps are done."""
    (tmp_path / "slow.py").write_text(
        LAW.replace("state_dot.odom[0] = 1.0", "import time; time.sleep(0.02); state_dot.odom[0] = 1.0")
    )
    command = [*COMMAND, "run", "-c", "slow.py:Mine", "--log-rate", "full", "-q", "-o", "a"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL)
    log = tmp_path / "a" / "run.mcap"
    try:
        deadline = time.monotonic() + 60
        while not (log.exists() and log.stat().st_size) and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(3.0)
    finally:
        process.kill()
        process.wait(60.0)
    rows = len(Trace.load(log))
    assert 20 < rows < 200


def test_a_file_that_takes_nothing_ends_the_run(tmp_path, monkeypatch):
    class Full(io.FileIO):
        def write(self, data):
            return super().write(data) if self.tell() < 1_000_000 else 0

    monkeypatch.setattr("uvms_mj.records.mcap.sink.FileIO", Full)
    with pytest.raises(SinkError, match=r"can't write .*run\.mcap: Input/output error") as caught:
        simulate(Scenario.load("push_wall", {"simulation.duration": 2.0}), sinks=[McapLog(tmp_path / "run.mcap")])
    assert caught.value.trace.status is Status.failed
    assert 0 < len(Trace.load(tmp_path / "run.mcap")) < 1000


# Truncated logs


def tried(path):
    """A log's trace, or None and the error message."""
    try:
        return Trace.load(path), ""
    except InputError as error:
        return None, str(error)


def test_every_truncation_gives_a_beginning_or_one_clear_error(logged, tmp_path):
    trace, path = logged
    data = path.read_bytes()
    places = sorted({*range(0, 64), *random.Random(1).sample(range(len(data)), 120), *range(len(data) - 40, len(data))})
    cut = tmp_path / "cut.mcap"
    lengths = []
    for place in places:
        cut.write_bytes(data[:place])
        part, said = tried(cut)
        if part is None:
            assert "cut off before its first sample" in said or "not an MCAP" in said or not place
            continue
        assert part.status in (Status.truncated, trace.status)
        assert part.message
        lengths.append(len(part))
        for name in part:
            assert np.array_equal(part[name], trace[name][: len(part)]), (place, name)
        if part.status is not Status.truncated:
            assert len(part) == len(trace)
    assert lengths == sorted(lengths)
    assert lengths[-1] == len(trace)
    assert len(set(lengths)) > 3


def test_kill_9_at_twenty_random_moments_loses_no_chunk(tmp_path):
    """The beginning of the run can be read, in order, without duplicates, up to the last complete chunk of the file."""
    whole = simulate(Scenario.load("push_wall", {"simulation.duration": 20.0}))
    dice = random.Random(3)
    lengths = []
    for i in range(20):
        command = [*COMMAND, "run", "simulation.duration=2000", "-q", "-o", f"{i}"]
        process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL)
        log = tmp_path / f"{i}" / "run.mcap"
        deadline = time.monotonic() + 60.0
        while not (log.exists() and log.stat().st_size > 1_200_000):
            assert process.poll() is None
            if time.monotonic() > deadline:
                process.send_signal(signal.SIGABRT)  # prints where it hangs
                process.wait(10.0)
            time.sleep(0.002)
        time.sleep(dice.uniform(0.0, 0.3))
        process.send_signal(signal.SIGKILL)
        process.wait(60.0)
        trace = Trace.load(log)
        assert trace.status is Status.truncated
        n = min(len(trace), len(whole) - 1)
        assert np.array_equal(trace.t[:n], whole.t[:n])
        assert np.array_equal(trace.tau[:n], whole.tau[:n])
        assert np.all(np.diff(trace.t) > 0)
        others = 0  # counted by another reader
        with open(log, "rb") as file, contextlib.suppress(EndOfFile, struct.error):
            for _, channel, _ in NonSeekingReader(file).iter_messages(log_time_order=False):
                others += channel.topic == "/tau"
        assert others == len(trace)
        lengths.append(len(trace))
        log.unlink()
    assert len(set(lengths)) > 5


# Damaged logs


def test_500_damaged_logs_never_pass_for_what_they_are_not(tmp_path):
    """Bits are flipped and logs truncated anywhere, including metadata and attachments."""
    log = tmp_path / "run.mcap"
    scenario = {
        "simulation.duration": 0.1,
        "wall.position": 0.002,
        "reference.step_time": 0.0,
        "description": "x" * 200,
    }
    trace = simulate(Scenario.load("push_wall", scenario), sinks=[McapLog(log)])
    data = log.read_bytes()
    dice = random.Random(20261121)
    ends = [m.start() for m in re.finditer(rb"uvms_mj|run\.json|scenario\.toml|outcome\.json|geometry\.json", data)]
    damaged = tmp_path / "damaged.mcap"
    told = 0
    for i in range(500):
        copy = bytearray(data)
        anywhere, elsewhere = dice.randrange(len(data)), dice.choice(ends) + dice.randrange(-40, 400)
        place = min(len(data) - 1, elsewhere) if i % 2 else anywhere  # half of them near metadata, the smaller part
        copy[place] ^= 1 << dice.randrange(8)
        if i % 5 == 0:
            copy = copy[: dice.randrange(len(copy))]
        damaged.write_bytes(copy)
        intact = bytes(copy) == data[: len(copy)]
        start = time.monotonic()
        part, said = tried(damaged)
        if part is None:
            assert said.startswith(str(damaged))
            assert len(said) < 600
            told += 1
        else:
            assert intact or i % 5 == 0 or "the end of the file is missing" in part.message, place
            assert part.status is Status.truncated or len(part) == len(trace)
            for name in part:
                assert np.array_equal(part[name], trace[name][: len(part)]), (place, name)
            assert part.scenario == trace.scenario
            assert part.header.mjcf == trace.header.mjcf
            assert part.header.law == trace.header.law
            assert part.header.geometry.shapes == trace.header.geometry.shapes
        assert time.monotonic() - start < 5.0
    assert told > 390


def ends_of_chunks(data: bytes) -> list[int]:
    ends, at = [], 8
    while at < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, at)
        at += 9 + length
        ends += [at] if opcode == 6 else []
    return ends


@pytest.mark.parametrize("block", [512, 4096])
def test_a_tail_of_zeros_is_what_a_power_cut_left_unwritten(logged, tmp_path, block):
    trace, path = logged
    data, cut = path.read_bytes(), tmp_path / "cut.mcap"
    _, first, *_, last = ends_of_chunks(data)
    for part in (0.1, 0.5, 0.9):
        end = int(first + part * (last - first)) // block * block
        cut.write_bytes(data[:end])
        expected = Trace.load(cut)
        for zeros in (block, 100 * block, 5_000_003):
            cut.write_bytes(data[:end] + bytes(zeros))
            found = Trace.load(cut)
            assert found.status is Status.truncated
            assert len(found) == len(expected) > 0
            assert all(np.array_equal(found[name], expected[name]) for name in found)
    for byte in range(60):  # a block may also be written in part
        cut.write_bytes(data[: last - byte] + bytes(5000))
        found = Trace.load(cut)
        assert found.status is Status.truncated
        assert all(np.array_equal(found[name], trace[name][: len(found)]) for name in found)
    cut.write_bytes(data[:first] + bytes(100) + data[first + 100 :])  # a hole is not a truncation
    with pytest.raises(InputError, match="damaged"):
        Trace.load(cut)


def test_a_record_that_is_whole_is_kept_though_only_zeros_follow(logged, tmp_path):
    """The last record may end anywhere, also with a zero byte."""
    _, path = logged
    data, cut = path.read_bytes(), tmp_path / "cut.mcap"
    for end in ends_of_chunks(data)[1:]:
        cut.write_bytes(data[:end])
        expected = Trace.load(cut)
        cut.write_bytes(data[:end] + bytes(4096))
        assert len(Trace.load(cut)) == len(expected)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"not a log at all", "not an MCAP file"),
        (b"\x89MCAP0\r\n", "cut off"),
        (b"\x89MCAP0\r\n" + b"\xff" * 100, "cut off|damaged"),
        (b"\x89MCAP0\r\n\x0f" + struct.pack("<Q", 1 << 62) + b"x" * 50, "cut off|damaged"),
    ],
)
def test_what_is_no_log_gets_one_clear_error(tmp_path, content, message):
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(InputError, match=message):
        Trace.load(tmp_path / "x.mcap")
    for command in ("info", "replay"):
        done = run(command, "x.mcap", cwd=tmp_path)
        assert done.returncode == 2
        assert "Traceback" not in done.stderr
        assert done.stderr.startswith("error: x.mcap")


def test_a_pipe_is_no_log_and_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "run.mcap")
    with pytest.raises(InputError, match=r"run\.mcap: is not a regular file, but a pipe"):
        Trace.load(tmp_path / "run.mcap")


def test_an_mcap_file_of_somebody_elses_is_named_as_such(tmp_path):
    from mcap.writer import Writer

    buffer = io.BytesIO()
    writer = Writer(buffer)
    writer.start("ros2")
    writer.finish()
    (tmp_path / "x.mcap").write_bytes(buffer.getvalue())
    with pytest.raises(InputError, match="not a log that uvms-mj wrote"):
        Trace.load(tmp_path / "x.mcap")
    with pytest.raises(InputError, match="No such file"):
        Trace.load(tmp_path / "nowhere.mcap")
    with pytest.raises(InputError, match=r"directory$"):
        Trace.load(tmp_path)
    (tmp_path / "x.mcap").rename(tmp_path / "run.mcap")
    with pytest.raises(InputError, match=r"directory; did you mean .*run\.mcap\?"):
        Trace.load(tmp_path)


def rewritten(path, change):
    """A log with changed attachments and correct checksums."""
    from mcap.opcode import Opcode
    from mcap.records import Attachment, DataEnd

    from uvms_mj.records.mcap.sink import record_bytes

    out = bytearray(path.read_bytes()[:8])
    with open(path, "rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, DataEnd):
                break
            if isinstance(record, Attachment):
                record.name, record.data = change(record.name, record.data)
            out += record_bytes(record)
    assert out[8] == Opcode.HEADER
    return bytes(out)


@pytest.mark.parametrize(
    "change",
    [
        lambda name, data: (f"../../{name}", data),
        lambda name, data: (name, data.replace(b"format", b"fromat")),
        lambda name, data: (name, data.replace(b"stiffness = 100000.0", b"stiffness = -1.0")),
        lambda name, data: (name, data.replace(b'"row_steps": 10', b'"row_steps": 20')),
        lambda name, data: (name, data.replace(b'"gsta"', b'"/bin/sh.py:Law"')),
        lambda name, data: (name, data.replace(b'name = "gsta"', b'name = "os.py:Law"')),
        lambda name, data: (name, b"[" * 100_000 if name == "run.json" else data),
        lambda name, data: (name, b'{"a":' * 50_000 if name == "geometry.json" else data),
        lambda name, data: (name, b"a = " + b"[" * 50_000 if name == "scenario.toml" else data),
        lambda name, data: (name, b"a" + b".a" * 50_000 + b" = 1" if name == "scenario.toml" else data),
        lambda name, data: (name, data.replace(b'model = "bluerov1"', b'model = "/etc/passwd"')),
        lambda name, data: (name, data.replace(b"duration = 0.4", b"duration = " + b"9" * 5000)),
        lambda name, data: (name, data.replace(b'"name": "t"', b'"name": "T"')),
        lambda name, data: (name, data.replace(b'"name": "nu"', b'"name": "s"')),
        lambda name, data: (name, data.replace(b'"unit": "m"', b'"unit": "mm"')),
        lambda name, data: (name, data.replace(b'"z": 6', b'"z": 7')),
        lambda name, data: (name, re.sub(rb'("name": "p_WB",\s*"shape": \[\s*)3', rb"\g<1>4", data)),
        lambda name, data: (
            name,
            re.sub(rb'("name": "p_WB",\s*"shape": \[\s*)3', rb"\g<1>" + b"9, " * 50 + b"9", data),
        ),
    ],
)
def test_a_forged_log_is_refused_and_writes_nothing(logged, tmp_path, change):
    forged = tmp_path / "in" / "deep" / "forged.mcap"
    forged.parent.mkdir(parents=True)
    forged.write_bytes(rewritten(logged[1], change))
    start = time.monotonic()
    with pytest.raises(InputError):
        Trace.load(forged)
    assert time.monotonic() - start < 5.0
    assert list(tmp_path.rglob("*")) == [tmp_path / "in", forged.parent, forged]


def test_a_recorded_law_has_gains_with_names_that_python_can_tell_apart():
    for table in ({"ℯ": 1.0, "e": 1.0}, {"class": 1.0}, {"__init__": 1.0}, {"x": "text"}, {"1": 1.0}):
        with pytest.raises(InputError, match=r"a\.py:B"):
            recorded_law("a.py:B", table, {})


def test_opening_a_forged_log_imports_no_file_that_it_names(logged, tmp_path, monkeypatch):
    (tmp_path / "evil.py").write_text("from pathlib import Path\nPath('ran').touch()\n")
    monkeypatch.chdir(tmp_path)
    for law in ("evil.py:X", f"{tmp_path}/evil.py:X"):
        for names in ("scenario.toml", "run.json", "run.json scenario.toml"):

            def change(name, data, names=names, law=law):
                return name, data.replace(b'"gsta"', f'"{law}"'.encode()) if name in names else data

            Path("forged.mcap").write_bytes(rewritten(logged[1], change))
            with contextlib.suppress(InputError):  # a user's law named in both files is shown
                assert Trace.load("forged.mcap").scenario.controller.source() == law
            assert "Traceback" not in run("info", "forged.mcap", cwd=tmp_path).stderr
            assert run("run", "--from", "forged.mcap", "-q", cwd=tmp_path).returncode == 2
    assert not (tmp_path / "ran").exists()


MESH = "<asset><mesh name='canary' file='{}'/></asset>"


def _appended(model, text):
    return model.replace("</mujoco>", f"{text}</mujoco>")


EVASIONS = {
    "byte order mark": lambda model, name: "\ufeff" + _appended(model, MESH.format(name)),
    "dashes in a comment": lambda model, name: "<!-- a -- b -->" + _appended(model, MESH.format(name)),
    "an attribute twice": lambda model, name: _appended(model, "<size a='1' a='2'/>" + MESH.format(name)),
    "a final nul": lambda model, name: _appended(model, MESH.format(name)) + "\0",
    "a quote in a comment": lambda model, name: _appended(
        model, "<!-- file=' -->" + MESH.format(name).replace("'", '"') + "<!-- ' -->"
    ),
    "no semicolon": lambda model, name: _appended(model, MESH.format(name.replace("/", "&#47"))),
    "characters by number": lambda model, name: _appended(model, MESH.format(name.replace("/", "&#x2F;"))),
    "an entity": lambda model, name: f"<!DOCTYPE m [<!ENTITY e '{name}'>]>" + _appended(model, MESH.format("&e;")),
    "character data": lambda model, name: _appended(model, f"<![CDATA[ <x a=' ]]>{MESH.format(name)}"),
    "an include": lambda model, name: _appended(model, f"<include\tfile\n=\n'{name}'/>"),
    "another robot": lambda model, name: f"<robot><link><visual><mesh filename='{name}'/></visual></link></robot>",
    "a folder": lambda model, name: _appended(
        model.replace("<compiler ", f"<compiler meshdir='{Path(name).parent}' "), MESH.format(Path(name).name)
    ),
}
"""MuJoCo finds the file's name in each of these; a search for names in the text may miss it."""


@pytest.mark.parametrize("evasion", EVASIONS)
def test_a_model_in_a_log_reaches_no_file_however_it_is_written(logged, tmp_path, evasion):
    """MuJoCo reads XML that was written anew from the checked trees."""
    secret = tmp_path / "secret.obj"
    secret.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")

    def change(name, data):
        return name, EVASIONS[evasion](data.decode(), f"{secret}").encode() if name.startswith("model/") else data

    (tmp_path / "forged.mcap").write_bytes(rewritten(logged[1], change))
    done = run("run", "--from", "forged.mcap", "-q", "-o", "x", cwd=tmp_path)
    assert done.returncode == 2
    assert re.search("refers to missing files|not well-formed|is not MJCF", done.stderr)
    assert "Traceback" not in done.stderr
    header = Trace.load(tmp_path / "forged.mcap").header
    with pytest.raises(InputError):
        header.mjcf.compiled(header.mjcf.spec())


SUB = b"<mujoco><asset><model name='m' file='%s'/></asset></mujoco>"


@pytest.mark.parametrize(
    ("files", "text"),
    [
        ({}, "<include file='bluerov1.xml'/>"),
        ({"a.xml": b"<mujoco><include file='bluerov1.xml'/></mujoco>"}, "<include file='a.xml'/>"),
        ({"a.xml": SUB % b"a.xml"}, "<asset><model file='a.xml'/></asset>"),
        ({"a.xml": SUB % b"b.xml", "b.xml": SUB % b"a.xml"}, "<asset><model file='a.xml'/></asset>"),
        ({f"{i}.xml": SUB % b"%d.xml" % (i + 1) for i in range(300)}, "<asset><model file='0.xml'/></asset>"),
        ({}, f"<default>{'<default>' * 3000}{'</default>' * 3000}</default>"),
    ],
)
def test_a_model_that_includes_itself_or_has_no_bottom_is_refused(files, text):
    """MuJoCo would look for the file on disk, or overflow its stack."""
    model = (ROOT / "models" / "bluerov1.xml").read_text().replace("</mujoco>", f"{text}</mujoco>")
    with pytest.raises(InputError, match=r"includes itself|missing files|elements nested|sub-models"):
        Mjcf("bluerov1.xml", {"bluerov1.xml": model.encode()} | files).spec()


@pytest.mark.parametrize("name", ["/etc/passwd", "../x.obj", "a/b.obj", "a\\b.obj", "", "..", "x\0.obj", "x\n.obj"])
def test_a_log_whose_model_has_folders_is_refused(logged, tmp_path, name):
    def change(each, data):
        if each == "run.json":
            data = data.replace(b'"bluerov1.xml"', json.dumps(name).encode())
        return (f"model/{name}" if each.startswith("model/") else each), data

    (tmp_path / "forged.mcap").write_bytes(rewritten(logged[1], change))
    with pytest.raises(InputError, match="without folders"):
        Trace.load(tmp_path / "forged.mcap")


@pytest.mark.parametrize(
    ("main", "sub"),
    [
        ('<compiler meshdir="m"/><asset><mesh file="a.obj"/><model file="sub/s.xml"/></asset>', '<mesh file="a.obj"/>'),
        ('<asset><mesh file="m/a.obj"/><model file="sub/s.xml"/></asset>', '<mesh file="a.obj"/>'),
        ('<compiler meshdir="n"/><compiler meshdir="m"/><asset><mesh file="a.obj"/></asset>', ""),
        ('<compiler meshdir="n"/><compiler assetdir="m"/><asset><mesh file="a.obj"/></asset>', ""),
        ('<compiler strippath="true"/><asset><mesh file="m/a.obj"/></asset>', ""),
        ('<compiler texturedir="n"/><asset><mesh file="a.obj"/></asset>', ""),
    ],
)
def test_a_name_means_the_file_that_mujoco_takes(tmp_path, main, sub):
    """Several files have the same name. The last folder set by a model counts, and a sub-model has its own folder."""
    for i, folder in enumerate((".", "m", "n", "sub", "sub/m")):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / "a.obj").write_text(CUBE.format(0.1 + 0.1 * i))
    attach = '<frame><attach model="s" body="b" prefix="s_"/></frame>' if sub else ""
    geom = '<geom type="mesh" mesh="a"/>'
    body = f'<worldbody><body name="b">{geom if sub else ""}</body></worldbody>'
    (tmp_path / "sub" / "s.xml").write_text(f'<mujoco model="s"><asset>{sub}</asset>{body}</mujoco>')
    (tmp_path / "v.xml").write_text(
        f"<mujoco>{main}<worldbody><body><freejoint/>{geom}</body>{attach}</worldbody></mujoco>"
    )
    plain, mjcf = mujoco.MjModel.from_xml_path(str(tmp_path / "v.xml")), Mjcf.find(str(tmp_path / "v.xml"))
    for file in sorted(tmp_path.rglob("*.*")):
        file.unlink()
    ours = mjcf.compiled(mjcf.spec())
    assert np.array_equal(ours.mesh_vert, plain.mesh_vert)
    assert ours.names == plain.names


CUBE = "v 0 0 0\nv {0} 0 0\nv 0 {0} 0\nv 0 0 {0}\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


@pytest.mark.parametrize(
    ("files", "assets"),
    [
        ({"a.obj": 0.1, "two/a.obj": 0.2}, '<mesh name="p" file="a.obj"/><mesh name="q" file="two/a.obj"/>'),
        ({"a.obj": 0.1, "m/a.obj": 0.2}, '<mesh name="p" file="m/../a.obj"/><mesh name="q" file="m/a.obj"/>'),
        ({"m/a.obj": 0.1, "m/A.obj": 0.2}, '<mesh name="p" file="m/a.obj"/><mesh name="q" file="m/A.obj"/>'),
        ({"z/p.obj": 0.1, "n/p.obj": 0.2}, '<mesh file="z/p.obj"/><mesh name="q" file="n/p.obj"/>'),
        ({"a & 'b' ü.obj": 0.1, "q.obj": 0.2}, '<mesh name="p" file="a &amp; \'b\' ü.obj"/><mesh file="q.obj"/>'),
        ({"p.obj": 0.1, "q.obj": 0.2}, "<!-- file=' -- --><mesh file='p.obj'/><!-- don't --><mesh file='q.obj'/>"),
        ({"p.obj": 0.1, "q.obj": 0.2}, '<mesh file="p.obj"/><mesh file="q.obj"/><!-- <mesh file="/gone.obj"/> -->'),
    ],
)
def test_a_vehicle_of_many_files_is_the_one_that_mujoco_reads(tmp_path, files, assets):
    """With folders, repeated names and comments, the model in memory has the meshes of the model on disk."""
    geoms = "<geom type='mesh' mesh='p' mass='0'/><geom type='mesh' mesh='q' mass='0'/><freejoint"
    model = (ROOT / "models" / "bluerov1.xml").read_text().replace("</asset>", f"{assets}</asset>", 1)
    model = model.replace("<freejoint", geoms, 1)
    for name, size in files.items():
        (tmp_path / "sub" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "sub" / name).write_text(CUBE.format(size))
    (tmp_path / "sub" / "rov.xml").write_text(model)
    (tmp_path / "rov.xml").write_text('<mujoco><option gravity="0 0 -1.6"/><include file="sub/rov.xml"/></mujoco>')
    for path in (tmp_path / "sub" / "rov.xml", tmp_path / "rov.xml"):
        if path.parent == tmp_path:  # MuJoCo looks for the meshes of an included file next to the main one
            model = re.sub(r"<compiler ", "<compiler meshdir='sub' ", model, count=1)
            (tmp_path / "sub" / "rov.xml").write_text(model)
        plain, mjcf = mujoco.MjModel.from_xml_path(str(path)), Mjcf.find(str(path))
        ours = mjcf.compiled(mjcf.spec())
        assert ours.opt.gravity[2] == plain.opt.gravity[2]
        assert ours.nu == plain.nu
        assert np.array_equal(ours.mesh_vert, plain.mesh_vert)
        assert not any("sub" in name for name in mjcf.files)


def test_a_model_in_a_log_reaches_no_file_of_the_readers(logged, tmp_path):
    (tmp_path / "secret.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
    mesh = f'<mesh name="m" file="{tmp_path}/secret.obj"/></asset>'.encode()
    forged = tmp_path / "forged.mcap"
    forged.write_bytes(
        rewritten(logged[1], lambda n, d: (n, d.replace(b"</asset>", mesh) if n.startswith("model/") else d))
    )
    done = run("run", "--from", forged, "-q", "-o", "x", cwd=tmp_path)
    assert done.returncode == 2
    assert "refers to missing files" in done.stderr
    assert not (tmp_path / "x").exists()


def test_a_model_in_a_log_is_checked_as_any_vehicles_file(logged, tmp_path):
    """The checks are the same as for a file on disk."""
    changes = ((b"<option ", b'<option tolerance="1" '), (b"</mujoco>", b"<equality/></mujoco>"))
    for before, after in changes:
        forged = tmp_path / "forged.mcap"
        forged.write_bytes(
            rewritten(logged[1], lambda n, d, b=before, a=after: (n, d.replace(b, a) if n.startswith("model/") else d))
        )
        done = run("run", "--from", forged, "-q", "-o", "x", cwd=tmp_path)
        assert done.returncode == 2
        assert "is not supported" in done.stderr
        assert not (tmp_path / "x").exists()


# Shipped files


def test_the_docs_list_every_topic_with_its_type_unit_and_frame(logged):
    trace, _ = logged
    text = (ROOT / "docs" / "log.md").read_text()
    lines = [line.strip("|") for line in text.splitlines() if line[:2] == "| "]
    cells = [[cell.strip().strip("`").replace("\\|", "|") for cell in re.split(r"(?<!\\)\|", line)] for line in lines]
    listed = {row[0]: row[1:] for row in cells if row[0].startswith("/")}
    gsta = simulate(Scenario.load("push_wall", {"simulation.duration": 0.01}))
    topics = {t.name: t for header in (trace.header, gsta.header) for t in Format(header).topics}
    expected = {name: [t.type, t.frame, t.unit, t.meaning] for name, t in topics.items()}
    state = expected.pop("/law/z")
    assert listed.pop("/law/<state>")[:3] == state[:3]
    assert listed == expected


def test_the_foxglove_layout_shows_topics_that_exist(logged):
    trace, _ = logged
    layout = json.loads((ROOT / "docs" / "foxglove_layout.json").read_text())
    text = json.dumps(layout)
    named = set(re.findall(r'"(/[a-z_/]+)[".]', text))
    assert named
    assert named <= {t.name for t in Format(trace.header).topics} | {
        "/law/z",
        "/analytic/contact",
        "/analytic/position",
    }
    assert {panel.partition("!")[0] for panel in layout["configById"]} >= {"3D", "Plot"}


def sparse(path, head, tail=b"", size=50 * 2**30):
    path.write_bytes(head)
    os.truncate(path, size)
    with open(path, "ab") as file:
        file.write(tail)


@pytest.mark.parametrize("where", ["end", "half", "middle", "middle, ended", "record", "index"])
def test_a_sparse_file_of_50_gib_is_read_in_bounded_time_and_memory(logged, tmp_path, where):
    """A hole takes no space on a disk, so that such a file can come in any archive."""
    whole, path = logged[1].read_bytes(), tmp_path / "x.mcap"
    half, end = whole[: len(whole) // 2], whole.rindex(b"\x0f" + struct.pack("<Q", 4)) + 13
    contents = {
        "end": (whole,),
        "half": (half,),
        "middle": (half, b"x"),
        "middle, ended": (half, whole[-8:]),
        "record": (whole[:8] + b"\x09" + struct.pack("<Q", 49 * 2**30), whole[-8:]),
        "index": (whole[:end], whole[-37:]),
    }
    sparse(path, *contents[where])
    code = f"""if True:
        import resource
        from uvms_mj import InputError, Trace
        limit = 2 << 30
        used = 4096 * int(open("/proc/self/statm").read().split()[0]) if __import__("sys").platform == "linux" else 0
        resource.setrlimit(resource.RLIMIT_AS, (used + limit, -1) if used else (-1, -1))
        try:
            print(Trace.load({str(path)!r}).status.name)
        except InputError as error:
            print("refused:", error)
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(("refused:", "truncated")) or where == "end", done.stdout


def test_a_json_file_of_too_many_values_is_refused_before_it_is_read(logged, tmp_path):
    """80 MB of it took 5 GB of memory; a mesh, which is one text, may be as large."""
    many = b'{"shapes":[' + b"{}," * 10_000_000 + b"{}]}"
    forged = tmp_path / "x.mcap"
    forged.write_bytes(rewritten(logged[1], lambda name, data: (name, many if name == "geometry.json" else data)))
    with pytest.raises(InputError, match=r"geometry\.json: has more than 200000 values"):
        Trace.load(forged)
    with pytest.raises(InputError, match="at most 256 MB is allowed"):
        refuse_large({"a": bytes(200_000_000), "b": bytes(100_000_000)})
    refuse_large({"geometry.json": b'"' + bytes(100_000_000) + b'"'})


@pytest.mark.parametrize("keep", [0, 1, 100, 300])
def test_a_chunk_that_is_too_short_is_damage_whatever_its_checksum(logged, tmp_path, keep):
    import zstandard
    from mcap.records import Chunk, DataEnd

    from uvms_mj.records.mcap.sink import record_bytes

    out, number = bytearray(logged[1].read_bytes()[:8]), 0
    with open(logged[1], "rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, DataEnd):
                break
            if isinstance(record, Chunk):
                number += 1
                if number == 2:
                    data = zstandard.ZstdDecompressor().decompress(record.data)[:keep]
                    record.data, record.uncompressed_size = zstandard.ZstdCompressor().compress(data), keep
                    record.uncompressed_crc = zlib.crc32(data)
            out += record_bytes(record)
    (tmp_path / "x.mcap").write_bytes(out)
    with pytest.raises(InputError, match="damaged"):
        Trace.load(tmp_path / "x.mcap")
