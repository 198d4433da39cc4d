"""A log on disk while its run goes on: slow laws, a full disk, a killed process."""

import contextlib
import io
import os
import random
import signal
import socket
import struct
import threading
import time

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader

from forked import started
from law_files import law_file, one_liner
from recorded import LAW
from uvms_mj import McapLog, Scenario, SinkError, Status, Trace, simulate
from uvms_mj.engine.udp import serve


def test_a_law_that_becomes_slow_reaches_the_disk_every_second_too(tmp_path):
    """The loop knows the duration of a step only after the step."""

    class Log(McapLog):
        def write(self, rows):
            instants.append(time.monotonic())
            super().write(rows)

    late = "tau_cmd[:] = 0.0\nif signals.t > 0.25:\n    time.sleep(0.01)"
    law_file(tmp_path, "import time\n" + one_liner("Slow", late), "slow.py")
    instants = []
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.27}, f"{tmp_path}/slow.py:Slow")
    with pytest.warns(UserWarning, match="plain Python"):
        simulate(scenario, log_rate="full", sinks=[Log(tmp_path / "run.mcap")])
    assert len(instants) > 5
    assert np.diff(instants).max() < 1.0


def test_a_slow_law_still_reaches_the_disk_every_second(tmp_path):
    """A law in plain Python takes 20 ms. Rows are in the file long before 1000 steps are done."""
    (tmp_path / "slow.py").write_text(
        LAW.replace("state_dot.odom[0] = 1.0", "import time; time.sleep(0.02); state_dot.odom[0] = 1.0")
    )
    process = started("run", "-c", "slow.py:Mine", "--log-rate", "full", "-q", "-o", "a", cwd=tmp_path)
    log = tmp_path / "a" / "run.mcap"
    try:
        deadline = time.monotonic() + 60
        while not (log.exists() and log.stat().st_size) and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(3.0)
    finally:
        process.kill()
        process.join(60.0)
    rows = len(Trace.load(log))
    assert 20 < rows < 200


def test_a_file_that_takes_nothing_ends_the_run(tmp_path, monkeypatch):
    class Full(io.FileIO):
        def write(self, data):
            return super().write(data) if self.tell() < 1_000_000 else 0

    monkeypatch.setattr("uvms_mj.records.mcap.sink.FileIO", Full)
    scenario, sink = Scenario.load("push_wall", {"simulation.duration": 2.0}), McapLog(tmp_path / "run.mcap")
    with pytest.raises(SinkError, match=r"can't write .*run\.mcap: Input/output error") as caught:
        simulate(scenario, sinks=[sink], engine="mujoco")
    assert caught.value.trace.status is Status.failed
    assert 0 < len(Trace.load(tmp_path / "run.mcap")) < 1000


def test_rows_reach_the_disk_while_a_run_waits_for_another_program(tmp_path):
    """A law over UDP answers slowly for half a second, and then no more: all rows up to then are in the file."""
    answered, last = threading.Event(), 100

    def law(signals):
        time.sleep(0.005)
        if signals.t > 1e-3 * (last - 0.5):
            answered.set()
            time.sleep(60.0)
        return np.zeros(6)

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    threading.Thread(target=serve, args=(law, port), daemon=True).start()
    keys = ("controller.period=1e-3", f"controller.port={port}", "controller.timeout=60")
    process = started("run", "-c", "udp", *keys, "-q", "-o", "a", cwd=tmp_path)
    try:
        assert answered.wait(60.0)
        time.sleep(1.0)
    finally:
        process.kill()
        process.join(60.0)
    trace = Trace.load(tmp_path / "a" / "run.mcap")
    assert trace.status is Status.truncated
    assert len(trace) == last


@pytest.mark.parametrize("engine", ["mujoco", "free_body"])
def test_a_command_that_holds_longer_than_a_chunk_loses_no_row(engine):
    class Constant:
        """A peer that commands once a second."""

        def command(self, sim, idle):
            sim.tau_cmd[:] = 1.0
            return 10_000

        def measure(self, sim):
            pass

        finish = measure

    keys = {"simulation.duration": 2.0, "controller.name": "external"}
    trace = simulate(Scenario.load("push_wall", keys), peer=Constant(), engine=engine, log_rate="full")
    np.testing.assert_allclose(np.diff(trace.t), 1e-4)
    assert len(trace) == 20_001


def test_kill_9_at_any_moment_loses_no_chunk(tmp_path):
    """The beginning of the run can be read, in order, without duplicates, up to the last complete chunk of the file.
    What kill -9 leaves is what the file has by then: one run is killed, and its file copied at moments before."""
    whole = simulate(Scenario.load("push_wall", {"simulation.duration": 100.0}), log_rate=10, engine="free_body")
    slowly = ("simulation.duration=2000", "--log-rate=10", "--engine=free_body")
    process, log = started("run", *slowly, "-q", "-o", "a", cwd=tmp_path), tmp_path / "a" / "run.mcap"
    dice, deadline = random.Random(3), time.monotonic() + 60.0
    while not (log.exists() and log.stat().st_size > 600_000):
        assert process.is_alive()
        if time.monotonic() > deadline:
            os.kill(process.pid, signal.SIGABRT)  # prints where it hangs
            process.join(10.0)
        time.sleep(0.002)
    copies = [tmp_path / f"{i}.mcap" for i in range(3)]
    for copy in copies:
        copy.write_bytes(log.read_bytes())
        time.sleep(dice.uniform(0.05, 0.2))
    process.kill()
    process.join(60.0)
    assert process.exitcode == -signal.SIGKILL
    lengths = []
    for each in (*copies, log):
        trace = Trace.load(each)
        assert trace.status is Status.truncated
        n = min(len(trace), len(whole) - 1)
        assert np.array_equal(trace.t[:n], whole.t[:n])
        assert np.array_equal(trace.tau[:n], whole.tau[:n])
        assert np.all(np.diff(trace.t) > 0)
        others = 0  # counted by another reader
        with open(each, "rb") as file, contextlib.suppress(EndOfFile, struct.error):
            for _, channel, _ in NonSeekingReader(file).iter_messages(log_time_order=False):
                others += channel.topic == "/tau"
        assert others == len(trace)
        lengths.append(len(trace))
    assert len(set(lengths)) > 2
