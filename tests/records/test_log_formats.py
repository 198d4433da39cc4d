"""Logs of older formats are read, and others are refused with the version that reads them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from recorded import decoded, rewritten, same
from uvms_mj import InputError, Status, Trace, simulate
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.plant import looks
from uvms_mj.records.mcap import attachments, read_files, topics

OLD = Path(__file__).parents[1] / "data" / "format_1.mcap"


def xyz(v):
    return [v.x, v.y, v.z]


def test_a_log_of_format_1_is_read_to_the_last_bit():
    """The numbers are those of an independent decoder, and satisfy the equations of the run."""
    trace, messages = Trace.load(OLD), decoded(OLD)
    assert json.loads(read_files(OLD)[1]["run.json"])["format"] == 1
    assert trace.status is Status.completed
    assert np.array_equal(trace.t, np.arange(21) * 10 * 1e-4)
    for name in ("tau", "tau_nom", "tau_cmd", "tau_dist"):
        read = [xyz(m.wrench.force) + xyz(m.wrench.torque) for _, m in messages[f"/{name}"]]
        assert np.array_equal(read, trace[name]), name
    for topic, name in (("/s", "s"), ("/zeta", "zeta"), ("/law/z", "z"), ("/thrusters", "u"), ("/error/pose", "eta_e")):
        assert np.array_equal([m.data for _, m in messages[topic]], trace[name]), name
    odometry = [m for _, m in messages["/odom"]]
    assert np.array_equal([xyz(m.pose.pose.position) for m in odometry], trace.p_WB)
    assert np.array_equal([m.pose.pose.orientation.w for m in odometry], trace.quat_WB[:, 0])
    assert np.array_equal([xyz(m.twist.twist.linear) for m in odometry], trace.nu[:, :3])
    task, wall = trace.scenario.task, trace.scenario.wall
    s = trace.nu_e + np.array(task.F_1) * trace.eta_e + np.array(task.F_2) * trace.zeta  # paper eq. (14)
    np.testing.assert_allclose(trace.s, s, rtol=0, atol=1e-15)
    v_W = np.einsum("nij,nj->ni", rotation_matrix(trace.quat_WB), trace.nu[:, :3])
    push = wall.stiffness * (trace.p_WB[:, 0] - wall.position) + wall.damping * v_W[:, 0]
    np.testing.assert_allclose(trace.push, push, rtol=1e-3)  # the contact point is not B's origin
    assert trace.force_peak[-1] == trace.push.max() > 19.0


def test_a_run_of_format_1_repeats_from_its_log():
    trace = Trace.load(OLD)
    again = simulate(trace.scenario, mjcf=trace.header.mjcf)
    for name in trace:
        np.testing.assert_allclose(again[name], trace[name], rtol=1e-9, atol=1e-9, err_msg=name)


def test_an_older_format_is_upgraded_and_another_is_refused_with_the_version_that_reads_it(
    logged, tmp_path, monkeypatch
):
    trace, path = logged
    old = path.read_bytes()
    now = attachments.FORMAT

    def forged(number):
        (tmp_path / "x.mcap").write_bytes(
            rewritten(path, lambda n, d: (n, re.sub(rb'("format": )\d+', rb"\g<1>%d" % number, d)))
        )
        return tmp_path / "x.mcap"

    for number in (0, -3):
        with pytest.raises(
            InputError, match=rf"has log format {number}, which uvms-mj [\d.]+ reads; this version reads"
        ):
            Trace.load(forged(number))
    with pytest.raises(InputError, match=rf"has log format {now + 1}, which uvms-mj [\d.]+ or later reads"):
        Trace.load(forged(now + 1))

    def renamed(run):
        return {("ship" if name == "vehicle" else name): value for name, value in run.items()}

    def named_back(run):
        return {("vehicle" if name == "ship" else name): value for name, value in run.items()}

    # the log of today, if today's format came after one with another name for a key
    older = attachments._UPGRADES | {now: named_back}
    monkeypatch.setattr(attachments, "FORMAT", now + 1)
    monkeypatch.setattr(attachments, "_UPGRADES", older)

    def change(name, data):
        return name, json.dumps(renamed(json.loads(data))).encode() if name == "run.json" else data

    (tmp_path / "older.mcap").write_bytes(rewritten(path, change))
    same(trace, Trace.load(tmp_path / "older.mcap"))
    assert path.read_bytes() == old


def test_a_log_is_read_whatever_the_order_of_its_topics_and_the_looks_of_its_markers(logged, tmp_path, monkeypatch):
    """They may change from version to version."""
    trace, _ = logged
    sampled = topics.sampled
    monkeypatch.setattr(topics, "sampled", lambda header: sampled(header)[::-1])
    monkeypatch.setattr(looks, "WALL_RGBA", (1.0, 0.0, 0.0, 1.0))
    trace.save(tmp_path / "run.mcap")
    monkeypatch.undo()
    same(trace, Trace.load(tmp_path / "run.mcap"))
