"""Real viewers of Rerun: plots and views, a run that outlives its viewer, no connection to other machines."""

import base64
import contextlib
import http.client
import io
import os
import re
import shutil
import signal as signals
import subprocess
import sys
import time
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import psutil
import pytest
from PIL import Image
from rerun.experimental import ViewerClient

from chromium import Chromium, needs_chromium
from uvms_mj import InputError, Scenario, Status, simulate
from uvms_mj.views import rerun as rerun_view
from uvms_mj.views.rerun import process, viewer
from uvms_mj.views.rerun.process import environment, free_port, start, stop
from uvms_mj.views.rerun.run import CONTACT, GREEN, ORANGE, SKY

VULKAN = any(Path("/usr/share/vulkan/icd.d").glob("*.json"))
ENOUGH = 20
"""Least number of pixels of a colour that shows that a line is drawn."""
needs_vulkan = pytest.mark.skipif(not VULKAN, reason="mesa-vulkan-drivers and libvulkan1 are not installed")


def shown(png: bytes) -> dict[str, int]:
    """Number of pixels with the colour of each series in the right half of a picture, where the plots are."""
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=int)
    pixels = pixels[:, round(0.56 * pixels.shape[1]) :]
    series = {"contact": CONTACT, "x": ORANGE, "y": SKY, "z": GREEN}
    return {name: int((np.abs(pixels - colour).max(axis=2) <= 12).sum()) for name, colour in series.items()}


def plots_in(png: bytes) -> bool:
    return all(n > ENOUGH for n in shown(png).values())


def family(process: psutil.Process) -> list[psutil.Process]:
    """A process and its children."""
    return [process, *process.children(recursive=True)]


def listening(process: psutil.Process) -> list[tuple[str, int]]:
    """Addresses on which a process and its children listen."""
    found = [connection for one in family(process) for connection in one.net_connections("inet")]
    return [(c.laddr.ip, c.laddr.port) for c in found if c.status == psutil.CONN_LISTEN]


def picture(port: int) -> bytes:
    """Screenshot of the headless viewer's window after its plots have appeared."""
    client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
    deadline = time.monotonic() + 60.0
    while not plots_in(png := client.take_screenshot()) and time.monotonic() < deadline:
        time.sleep(0.5)
    return png


@needs_vulkan
def test_the_viewer_shows_the_plots_and_every_view_is_in_order(trace, other, recording, tmp_path):
    port = free_port()
    process = start(["--headless", "--port", str(port), "--window-size", "1280x800"], port)
    try:
        client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        rerun_view.save({"a": trace, "b c/d": other}, tmp_path / "two.rrd")
        client.open(str(tmp_path / "two.rrd"))
        two = client.get_state().views
        assert {view.name for view in two} >= {"Contact force [N]", "Position p_WB: x [m]", "tau: yaw [N m]"}
        client.close("all")
        client.open(str(recording))
        png = picture(port)
        one = client.get_state().views
    finally:
        stop(process)
    assert plots_in(png), shown(png)
    reports = [(view.name, report.summary, report.details) for view in (*one, *two) for report in view.reports]
    assert not reports
    left = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=int)[:, :700]
    assert (left.max(axis=2) < 45).sum() > 1000, "the vehicle's black parts"


@pytest.fixture
def headless(monkeypatch):
    """Opens viewers without a window. The value lists the process and the port of each."""
    opened: list[tuple[subprocess.Popen, int]] = []

    def started(options, port, lives_s):
        opened.append((start(["--headless", "--window-size", "320x240", *options], port, lives_s), port))
        return opened[-1][0]

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(viewer, "start", started)
    yield opened
    for one, _ in opened:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(one.pid, signals.SIGKILL)  # a stopped process ignores other signals
        one.wait(10.0)


def views_at(port: int, least_ns: int) -> tuple[set[str], int]:
    """Names of a viewer's views and the end of its timeline, after it has reached ``least_ns``."""
    client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
    deadline, end_ns = time.monotonic() + 60.0, -1
    while end_ns < least_ns and time.monotonic() < deadline:
        state = client.get_state()
        end_ns = max((timeline.end for one in state.recordings for timeline in one.timelines), default=-1)
        time.sleep(0.2)
    return {view.name for view in state.views}, end_ns


@needs_vulkan
def test_a_run_streams_to_the_viewer(headless, monkeypatch):
    monkeypatch.setattr(viewer, "_EVERY_S", 0.0)
    halfway: list[int] = []

    def progress(done: int, steps: int) -> None:
        if done >= steps / 2 and not halfway:
            halfway.append(views_at(headless[0][1], 900_000_000)[1])

    scenario = Scenario.load("push_wall", {"simulation.duration": 2.0})
    run = simulate(scenario, sinks=[rerun_view.LiveView()], progress=progress)
    assert run.status is Status.completed
    assert 900_000_000 <= halfway[0] <= 1_100_000_000
    process, port = headless[0]
    assert listening(psutil.Process(process.pid)) == [("127.0.0.1", port)]
    names, end_ns = views_at(port, 2_000_000_000)
    assert end_ns == 2_000_000_000
    assert names >= {"Vehicle and wall (arrows: 0.05 m/N)", "Contact force [N]"}


@needs_vulkan
@pytest.mark.parametrize(
    ("end", "when"), [(signals.SIGKILL, 0.5), (signals.SIGSTOP, 0.0)], ids=["closed half way", "hung at the beginning"]
)
def test_a_run_outlives_its_viewer(headless, monkeypatch, end, when):
    """Rerun's client would wait forever for a viewer that accepts no data; a run waits only once, at its end."""
    monkeypatch.setattr(viewer, "_PATIENCE_S", 2.0)
    took: list[float] = []
    monkeypatch.setattr(viewer, "_LIVE_HZ", 1e4)

    def hit() -> None:
        if (process := headless[0][0]).poll() is None:
            os.killpg(process.pid, end)

    class Live(rerun_view.LiveView):
        def begin(self, header):
            super().begin(header)
            if when == 0.0:
                hit()

        def write(self, rows):
            start = time.monotonic()
            super().write(rows)
            took.append(time.monotonic() - start)

    scenario = Scenario.load("push_wall", {"simulation.duration": 4.0})
    start = time.monotonic()
    run = simulate(
        scenario, log_rate="full", sinks=[Live()], progress=lambda done, steps: when and done >= when * steps and hit()
    )
    assert run.status is Status.completed
    assert len(run) == scenario.steps + 1
    assert time.monotonic() - start < 40.0
    assert max(took) < 2.0
    here = [each for each in psutil.Process().children(recursive=True) if each.status() != psutil.STATUS_ZOMBIE]
    ours = family(psutil.Process(headless[0][0].pid)) if end == signals.SIGSTOP else []
    assert {each.pid for each in here if "rerun" in " ".join(each.cmdline())} <= {each.pid for each in ours}


@needs_vulkan
def test_replay_says_that_the_viewer_was_closed(headless, trace, monkeypatch):
    monkeypatch.setattr(viewer, "_PATIENCE_S", 1.0)
    opened = viewer.start
    for end, message in ((signals.SIGKILL, "it was closed"), (signals.SIGSTOP, "accepted no data for 1 s")):

        def ended(options, port, lives_s, end=end):
            process = opened(options, port, lives_s)
            os.killpg(process.pid, end)
            return process

        monkeypatch.setattr(viewer, "start", ended)
        with pytest.raises(InputError, match=f"did not receive the runs: .*{message}.*--web"):
            rerun_view.show({"run": trace})


def test_without_a_display_the_error_says_what_to_do_instead(trace, monkeypatch):
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    with pytest.raises(InputError, match=r"no display.*--web"):
        rerun_view.show({"run": trace})
    monkeypatch.setenv("DISPLAY", ":4711")
    with pytest.raises(InputError, match=r"did not start.*--web"):
        rerun_view.show({"run": trace})


class Server:
    """``serve`` in a separate process."""

    def __init__(self, log: Path, home: Path) -> None:
        code = "import sys; from uvms_mj import Trace; from uvms_mj.views.rerun import serve\n"
        code += "serve({'run': Trace.load(sys.argv[1])})"
        command = [sys.executable, "-c", code, log]
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "HOME": str(home)},
            preexec_fn=lambda: signals.signal(signals.SIGINT, signals.SIG_DFL),  # also as a job in the background
        )
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().strip()
        assert self.address, f"serve ended with {self.process.wait(10.0)}"
        self.port = urlsplit(self.address).port

    def get(self, path: str, host: str = "") -> tuple[int, dict[str, str], bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=10.0)
        connection.request("GET", path, headers={"Host": host} if host else {})
        response = connection.getresponse()
        return response.status, dict(response.headers), response.read()


@pytest.fixture(scope="module")
def server(trace, tmp_path_factory):
    folder = tmp_path_factory.mktemp("served")
    trace.save(folder / "run.mcap")
    server = Server(folder / "run.mcap", tmp_path_factory.mktemp("home"))
    yield server
    server.process.send_signal(signals.SIGINT)
    assert server.process.wait(10.0) == 0


def test_only_this_machine_is_served(server):
    assert listening(psutil.Process(server.process.pid)) == [("127.0.0.1", server.port)]
    assert server.address.startswith(f"http://127.0.0.1:{server.port}/?url=http%3A%2F%2F127.0.0.1%3A")
    status, headers, page = server.get("/")
    assert status == 200
    assert "connect-src 'self' data: blob:" in headers["Content-Security-Policy"]
    assert not re.search(rb"<link[^>]*https?://", page)
    assert server.get("/run.rrd")[2][:4] == b"RRF2"
    assert server.get("/", host="example.org")[0] == 403
    assert server.get("/../../etc/passwd")[0] == server.get("/etc/passwd")[0] == 404


def test_a_taken_port_is_named(server, recording):
    from uvms_mj.views.rerun.process import web_viewer

    with pytest.raises(InputError, match=f"port {server.port}"), web_viewer(recording, server.port):
        pass


@needs_chromium
def test_a_browser_shows_the_plots_and_talks_to_nobody_else(server, tmp_path):
    browser = Chromium(tmp_path, webgl=True)
    try:
        for domain in ("Page", "Network"):
            browser(f"{domain}.enable")
        browser("Emulation.setDeviceMetricsOverride", width=560, height=400, deviceScaleFactor=1, mobile=False)
        browser("Page.navigate", url=server.address)
        deadline, series = time.monotonic() + 120.0, {}
        while time.monotonic() < deadline:
            data = browser("Page.captureScreenshot", format="png").get("data")  # missing while a page loads
            series = shown(base64.b64decode(data)) if data else {}
            if series and all(n > ENOUGH for n in series.values()):
                break
            time.sleep(0.3)
        time.sleep(1.0)
        browser("Page.captureScreenshot", format="png")  # also collects the events up to now
    finally:
        browser.close()
    assert series, "no picture"
    assert all(n > ENOUGH for n in series.values()), series
    events = [(event["method"], event["params"]) for event in browser.events]
    asked = {e["requestId"]: e["request"]["url"] for name, e in events if name == "Network.requestWillBeSent"}
    refused = {
        e["requestId"] for name, e in events if name == "Network.loadingFailed" and e.get("blockedReason") == "csp"
    }
    here = f"http://127.0.0.1:{server.port}/"
    assert any(url.startswith(here) for url in asked.values())
    assert [
        url for request, url in asked.items() if request not in refused and not url.startswith((here, "data:", "blob:"))
    ] == []


def test_analytics_are_off_and_a_users_settings_untouched(tmp_path, monkeypatch):
    def left_behind(environment: dict[str, str]) -> set[str]:
        port, home = free_port(), Path(environment["HOME"])
        home.mkdir()
        options = ["--serve-grpc", "--port", str(port)]
        monkeypatch.setattr(process, "environment", lambda: environment)
        stop(start(options, port, lives_s=1.0))
        return {str(path.relative_to(home)) for path in home.rglob("*") if path.is_file()}

    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    monkeypatch.delenv("CI", raising=False)
    for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.delenv(name, raising=False)
    ours = environment()
    assert "FORCE_RERUN_ANALYTICS" not in ours
    assert left_behind({**ours, "HOME": str(tmp_path / "ours")}) == set()
    theirs = left_behind({**os.environ, "HOME": str(tmp_path / "theirs")})
    assert any("analytics" in path for path in theirs), "the test would not see analytics if they were on"


@needs_vulkan
@pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not installed")
def test_the_viewer_connects_to_nobody(recording, tmp_path):
    port, calls = free_port(), tmp_path / "calls"
    exe = Path(sys.modules["rerun"].__file__).parents[1] / "rerun_cli" / "rerun"
    command = ["strace", "-f", "-e", "trace=connect", "-o", calls, exe, "--headless", "--bind", "127.0.0.1"]
    process = subprocess.Popen(
        [*command, "--port", str(port), recording],
        env={**environment(), "HOME": str(tmp_path)},
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        deadline = time.monotonic() + 40.0
        while time.monotonic() < deadline and ":9)" not in _ports(calls):
            time.sleep(0.5)
    finally:
        stop(process)
    internet = [line for line in calls.read_text().splitlines() if "AF_INET" in line]
    assert [line for line in internet if 'inet_addr("127.0.0.1")' not in line] == []
    assert ":9)" in _ports(calls), "it checked for new versions at the proxy address, where nothing listens"


def _ports(calls: Path) -> str:
    text = calls.read_text() if calls.exists() else ""
    return " ".join(f":{port})" for port in re.findall(r"sin_port=htons\((\d+)\)", text))
