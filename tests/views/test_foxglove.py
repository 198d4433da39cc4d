"""A run that Foxglove shows while it goes on, with a client of the public WebSocket protocol, foxglove.sdk.v1."""

import contextlib
import json
import os
import re
import signal
import struct
import threading
import time
from collections import Counter, defaultdict

import numpy as np
import psutil
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from forked import started
from uvms_mj import InputError, McapLog, Scenario, Status, Trace, simulate
from uvms_mj.analysis.metrics import steady_force_error
from uvms_mj.analysis.residual import impedance_error
from uvms_mj.analysis.summary import NUMBERS, ending
from uvms_mj.cli import main
from uvms_mj.engine.vehicle_run import Again
from uvms_mj.records.mcap.layout import Format
from uvms_mj.views.foxglove import Foxglove, numbers_of

SHORT = Scenario.load("push_wall", {"simulation.duration": 2.0})
SHORTER = SHORT.updated({"simulation.duration": 0.5})
DATA, TIME = 1, 2


class Viewer(threading.Thread):
    """A client that subscribes to all topics, or to some, and keeps its messages until the server stops."""

    def __init__(self, address: str, topics=None) -> None:
        super().__init__(daemon=True)
        self._topics = topics
        self._open = contextlib.ExitStack()
        opened = connect(address, subprotocols=["foxglove.sdk.v1"], max_size=None, open_timeout=20)
        self._socket = self._open.enter_context(opened)
        self.server, self.channels = {}, {}
        self.messages, self.clock, self.status = [], [], []
        self.answers: dict[str, dict] = {}
        self.came = threading.Condition()
        self.start()

    def run(self) -> None:
        try:
            for message in self._socket:
                with self.came:
                    (self._text if isinstance(message, str) else self._binary)(message)
                    self.came.notify_all()
        except ConnectionClosed:
            pass

    def _text(self, message: str) -> None:
        said = json.loads(message)
        if said["op"] == "serverInfo":
            self.server = said
        elif said["op"] == "advertise":
            self.channels |= {each["id"]: each for each in said["channels"]}
            chosen = [c["id"] for c in said["channels"] if self._topics is None or c["topic"] in self._topics]
            wanted = [{"id": each, "channelId": each} for each in chosen]
            self._send({"op": "subscribe", "subscriptions": wanted})
        elif said["op"] == "parameterValues":
            self.answers[said.get("id", "")] = {each["name"]: each["value"] for each in said["parameters"]}
        elif said["op"] == "status":
            self.status.append(said["message"])

    def _binary(self, message: bytes) -> None:
        if message[0] == DATA:
            number, when = struct.unpack_from("<IQ", message, 1)
            self.messages.append((self.channels[number]["topic"], when, message[13:]))
        elif message[0] == TIME:
            self.clock.append(struct.unpack_from("<Q", message, 1)[0])

    def _send(self, said: dict) -> None:
        self._socket.send(json.dumps(said))

    def wait(self, condition) -> None:
        with self.came:
            assert self.came.wait_for(condition, 30.0)

    def get(self, *names: str) -> dict:
        key = f"get {len(self.answers)} {names}"
        self._send({"op": "getParameters", "parameterNames": names, "id": key})
        self.wait(lambda: key in self.answers)
        return self.answers[key]

    def set(self, **values) -> dict:
        key = f"set {len(self.answers)}"
        values = {name.replace("__", "."): value for name, value in values.items()}
        given = [{"name": name, "value": value} for name, value in values.items()]
        self._send({"op": "setParameters", "parameters": given, "id": key})
        self.wait(lambda: key in self.answers)
        return self.answers[key]

    def leave(self) -> None:
        self._open.close()
        self.join(30.0)


class Watched:
    """A run in a thread, with its viewer."""

    def __init__(self, scenario: Scenario, log=None, before=lambda viewer: None, topics=None, **asked) -> None:
        self.live = Foxglove(port=0, **asked)
        sinks = [self.live] if log is None else [McapLog(log), self.live]
        self._thread = threading.Thread(target=self._run, args=(scenario, sinks), daemon=True)
        self._thread.start()
        self.trace: Trace | None = None
        until = time.monotonic() + 30.0
        while not self.live.address:
            assert time.monotonic() < until
            time.sleep(0.01)
        before(self)
        self.viewer = Viewer(self.live.address, topics)

    def _run(self, scenario: Scenario, sinks) -> None:
        self.trace = simulate(scenario, sinks=sinks, guides=[self.live], engine="free_body")

    def ended(self) -> Trace:
        self._thread.join(60.0)
        assert self.trace is not None
        return self.trace


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run as fast as it goes, its log, and what the viewer received."""
    log = tmp_path_factory.mktemp("live") / "run.mcap"
    run = Watched(SHORTER, log, speed=np.inf)
    trace = run.ended()
    with open(log, "rb") as file:
        logged = [(c.topic, m.log_time, m.data) for _, c, m in make_reader(file).iter_messages()]
    run.viewer.wait(lambda: len(run.viewer.messages) >= len(logged))
    run.viewer.leave()
    run.live.wait()
    run.live.close()
    return trace, log, logged, run.viewer


def test_a_viewer_receives_all_messages_of_the_log(whole):
    """Every topic, every time, every byte: the values of one are the values of the other."""
    trace, _, logged, viewer = whole
    assert len({topic for topic, *_ in logged}) == len(viewer.channels) == len(Format(trace.header).topics) > 30
    assert len(logged) > 500 * 30
    assert Counter(viewer.messages) == Counter(logged)


def test_messages_of_a_topic_come_in_their_order_and_the_clock_is_the_run_s(whole):
    trace, _, _, viewer = whole
    of_topic = defaultdict(list)
    for topic, when, _ in viewer.messages:
        of_topic[topic].append(when)
    assert all(times == sorted(times) for times in of_topic.values())
    assert viewer.clock == sorted(viewer.clock)
    assert viewer.clock[-1] == round(1e9 * trace.t[-1]) == 500_000_000
    assert set(viewer.clock) <= set(of_topic["/odom"])


def test_the_viewer_is_told_types_units_and_frames_as_the_log_has_them(whole):
    _, log, _, viewer = whole
    with open(log, "rb") as file:
        summary = make_reader(file).get_summary()
    for each in summary.channels.values():
        (told,) = (c for c in viewer.channels.values() if c["topic"] == each.topic)
        schema = summary.schemas[each.schema_id]
        assert (told["encoding"], told["schemaName"], told["schemaEncoding"]) == ("cdr", schema.name, "ros2msg")
        assert told["schema"].encode() == schema.data
        assert {name: text for name, text in each.metadata.items() if text}.items() <= told["metadata"].items()


def test_a_run_that_is_watched_is_the_same_run(whole):
    trace, *_ = whole
    alone = simulate(SHORTER, engine="free_body")
    assert np.array_equal(alone.rows(), trace.rows())
    assert trace.changed == trace.outcome.changes == ()


def test_a_number_is_read_and_set_and_the_trace_shows_it(tmp_path):
    """The push at rest is the closed form of the numbers that were set; the log repeats the run bit for bit."""
    scenario = Scenario.load("push_wall", {"simulation.duration": 14.0})
    new = {"impedance.F_d": [2.0, 0, 0, 0, 0, 0], "controller.k_1": 8}
    run = Watched(scenario, tmp_path / "run.mcap", topics=("/odom",), speed=4.0)
    viewer = run.viewer
    read = viewer.get()
    assert read == dict(numbers_of(scenario))
    assert viewer.get("wall.stiffness", "no.such") == {"wall.stiffness": 1e5}
    viewer.wait(lambda: viewer.clock and viewer.clock[-1] > 2e8)
    assert viewer.set(impedance__F_d=[2.0, 0, 0, 0, 0, 0], controller__k_1=8) == new
    assert viewer.get(*new) == new
    assert not viewer.status
    trace = run.ended()
    viewer.leave()
    run.live.close()
    ((step, values),) = trace.outcome.changes
    assert values == new
    assert 2000 < step < 20_000
    then = simulate(scenario.updated(new), engine="free_body").analytic.force
    push = trace.between(13.5, 14.0).push.mean()
    assert abs(then - trace.header.analytic.force) > 0.5
    assert push == pytest.approx(then, rel=1e-6)
    assert trace.changed == tuple(new)
    assert "impedance.F_d" in trace.analytic.reason
    assert NUMBERS["force_error_N"].of(trace) is steady_force_error(trace) is None
    assert any("impedance.F_d, controller.k_1 changed in the run" in note for note in ending(trace))
    with pytest.raises(InputError, match="changed in the run"):
        impedance_error(trace)
    plain = simulate(scenario, engine="free_body")
    differs = np.flatnonzero((plain.rows() != trace.rows()).any(axis=1))
    assert differs[0] == -(-step // trace.header.row_steps)

    logged = Trace.load(tmp_path / "run.mcap")
    assert logged.outcome == trace.outcome
    again = simulate(logged.scenario, guides=[Again(logged.outcome.changes)], engine="free_body")
    assert np.array_equal(again.rows(), trace.rows())


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"vehicle__mass": 1.1}, "vehicle.mass: set can't change the vehicle"),
        ({"simulation__timestep": 1e-3}, "simulation.timestep: can't change during a run"),
        ({"initial__position": [1.0, 0.0, 0.0]}, "initial.position: can't change during a run"),
        ({"controller__name": "mine.py:Mine"}, "controller.name: the scenario has no such number"),
        ({"no__such": 1.0}, "no.such: the scenario has no such number"),
        ({"controller__k_1": "mine.py:Mine"}, "controller.k_1: only numbers change in a run"),
        ({"wall__stiffness": -1.0}, "wall.stiffness: -1.0 must be from"),
        ({"controller__k_1": 6.0, "wall__stiffness": -1.0}, "wall.stiffness: -1.0 must be from"),
    ],
    ids=lambda each: each if isinstance(each, str) else " ".join(each),
)
def test_what_can_not_be_set_is_refused_by_name(waiting, values, why):
    """Nothing of the request is set."""
    run, scenario = waiting
    told = len(run.viewer.status)
    answer = run.viewer.set(**values)
    before = dict(numbers_of(scenario))
    names = [name.replace("__", ".") for name in values]
    assert answer == {name: before[name] for name in names if name in before}
    run.viewer.wait(lambda: len(run.viewer.status) > told)
    assert why in run.viewer.status[-1]


@pytest.fixture(scope="module")
def waiting():
    """A slow run."""
    scenario = Scenario.load("push_wall", {"simulation.duration": 1.0})
    run = Watched(scenario, speed=0.02)
    yield run, scenario
    run.live.close()


def test_a_paced_run_takes_real_time():
    run = Watched(SHORT, speed=2.0)
    run.viewer.wait(lambda: run.viewer.clock)
    since = time.monotonic()
    run.ended()
    run.live.close()
    assert 0.8 < time.monotonic() - since < 3.0  # 1 s; another program may hold it up


def test_nothing_listens_beyond_loopback(waiting):
    run, _ = waiting
    port = int(run.live.address.rpartition(":")[2])
    mine = psutil.Process().net_connections("inet")
    assert [each.laddr.ip for each in mine if each.status == psutil.CONN_LISTEN and each.laddr.port == port]
    assert {address.ip for each in mine for address in (each.laddr, each.raddr) if address} == {"127.0.0.1"}


def test_it_listens_where_the_user_says():
    live = Foxglove(host="127.0.0.2", port=0)
    trace = simulate(SHORT.updated({"simulation.duration": 0.01}), engine="free_body")
    live.begin(trace.header)
    port = int(live.address.rpartition(":")[2])
    assert live.address == f"ws://127.0.0.2:{port}"
    found = {e.laddr.ip for e in psutil.Process().net_connections("inet") if e.laddr.port == port}
    assert found == {"127.0.0.2"}
    live.close()
    until = time.monotonic() + 20.0  # the server stops on a thread of its own
    while [e for e in psutil.Process().net_connections("inet") if e.laddr.port == port and e.status == "LISTEN"]:
        assert time.monotonic() < until
        time.sleep(0.01)


def test_a_port_in_use_is_one_sentence(waiting, tmp_path):
    run, _ = waiting
    port = run.live.address.rpartition(":")[2]
    said = CliRunner().invoke(main, ["run", "--live", "foxglove", "--port", port, "-o", str(tmp_path / "a")])
    assert said.exit_code == 2
    assert f"port {port} of 127.0.0.1: another program has it; choose another with --port" in said.output
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--speed", "2"], "--speed: only with --live foxglove"),
        (["--live", "rerun", "--port", "1"], "--port: only with --live foxglove"),
        (["--live", "foxglove", "--viewer"], "one viewer at a time"),
        (["--live", "foxglove", "--speed", "fast"], "--speed 'fast': is not a finite number"),
        (["--live", "foxglove", "--speed", "0"], "--speed 0: must be from 0.01 to 100 times real time"),
        (["--live", "foxglove", "--host", "no.such.host.invalid"], "of no.such.host.invalid: "),
    ],
    ids=" ".join,
)
def test_options_that_make_no_sense_are_refused(tmp_path, words, said):
    result = CliRunner().invoke(main, ["run", *words, "-o", str(tmp_path / "a")])
    assert result.exit_code == 2
    assert said in result.output


def test_a_host_that_others_reach_is_said(tmp_path):
    """An address for documentation: nothing listens there."""
    given = ["run", "--live", "foxglove", "--host", "192.0.2.1", "--port", "0", "-o", str(tmp_path / "a")]
    said = CliRunner().invoke(main, given).output
    assert "warning: --host 192.0.2.1: machines that reach this address can read the run and change" in said
    assert "error: port 0 of 192.0.2.1: " in said


def _streams(folder) -> list[str]:
    return [str(folder / "out"), str(folder / "err")]


def _address(folder) -> str:
    until = time.monotonic() + 60.0
    while not (found := re.search(r"ws://\S+\d", (folder / "err").read_text() if (folder / "err").exists() else "")):
        assert time.monotonic() < until
        time.sleep(0.05)
    return found[0].rstrip(";")


@pytest.mark.parametrize("at", ["waiting", "running", "over"])
def test_ctrl_c_ends_it_and_the_log_is_whole(tmp_path, at):
    duration = 0.2 if at == "over" else 30.0
    words = ["--live", "foxglove", "--port", "0", "-q", "-o", "a", f"simulation.duration={duration}"]
    process = started("run", *words, cwd=tmp_path, streams=_streams(tmp_path))
    viewer = None
    try:
        address = _address(tmp_path)
        if at != "waiting":
            viewer = Viewer(address)
            viewer.wait(lambda: viewer.clock)
        if at == "over":
            viewer.wait(lambda: viewer.clock[-1] == 200_000_000)
            time.sleep(0.5)
            assert process.is_alive()
        os.kill(process.pid, signal.SIGINT)
        process.join(30.0)
    finally:
        process.kill()
    assert process.exitcode == (0 if at == "over" else 130)
    trace = Trace.load(tmp_path / "a" / "run.mcap")
    assert trace.status is (Status.completed if at == "over" else Status.interrupted)
    assert (len(trace) > 0) == (at != "waiting")
    if viewer is not None:
        viewer.join(10.0)
        assert not viewer.is_alive()


def test_a_run_ends_when_its_viewers_have_left(tmp_path):
    process = started("run", "--live", "foxglove", "--port", "0", "-q", "-o", "a", "simulation.duration=0.2",
                      cwd=tmp_path, streams=_streams(tmp_path))  # fmt: skip
    viewer = Viewer(_address(tmp_path))
    viewer.wait(lambda: viewer.clock and viewer.clock[-1] == 200_000_000)
    viewer.leave()
    process.join(30.0)
    assert process.exitcode == 0


def test_a_log_that_was_cut_off_is_not_repeated_without_its_changes(whole, tmp_path):
    _, log, *_ = whole
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    said = CliRunner().invoke(main, ["run", "--from", str(cut), "-o", str(tmp_path / "a")])
    assert said.exit_code == 2
    assert "lacks the numbers that were changed" in said.output


def test_a_missing_extra_is_one_sentence(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "foxglove", None)
    monkeypatch.delitem(__import__("sys").modules, "uvms_mj.views.foxglove")
    with pytest.raises(
        InputError, match=r"no module 'foxglove': install foxglove-sdk, with pip install 'uvms-mj\[live\]'"
    ):
        import uvms_mj.views.foxglove  # noqa: F401  # the import fails
