"""Replay in Rerun: recorded values, layout in real viewers, and no connection to other machines."""

import base64
import contextlib
import dataclasses
import fcntl
import http.client
import io
import itertools
import json
import os
import re
import select
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
import rerun as rr
from PIL import Image
from rerun.chunk import RrdReader
from rerun.experimental import ViewerClient

from uvms_mj import InputError, Scenario, Status, Trace, simulate
from uvms_mj.physics.frames import quat_from_euler_deg
from uvms_mj.records import scene
from uvms_mj.views import colours
from uvms_mj.views import rerun as rerun_view
from uvms_mj.views.rerun import process, viewer
from uvms_mj.views.rerun.extents import MOST_STEPS, Extents, readable
from uvms_mj.views.rerun.layout import layout
from uvms_mj.views.rerun.process import environment, free_port, start, stop
from uvms_mj.views.rerun.run import CONTACT, GREEN, ORANGE, POSE_HZ, SKY, Run, bounds
from uvms_mj.views.rerun.solids import solids

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
VULKAN = any(Path("/usr/share/vulkan/icd.d").glob("*.json"))
ENOUGH = 20
"""Least number of pixels of a colour that shows that a line is drawn."""
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
needs_vulkan = pytest.mark.skipif(not VULKAN, reason="mesa-vulkan-drivers and libvulkan1 are not installed")


@pytest.fixture(scope="module")
def trace(tmp_path_factory) -> Trace:
    """A run that touches the wall, from its log."""
    log = tmp_path_factory.mktemp("log") / "run.mcap"
    simulate(Scenario.load("push_wall", {"simulation.duration": 7.0})).save(log)
    return Trace.load(log)


@pytest.fixture(scope="module")
def other() -> Trace:
    return simulate(Scenario.load("push_wall", {"simulation.duration": 2.0}, "impedance"))


@pytest.fixture(scope="module")
def recording(trace, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("rrd") / "run.rrd"
    rerun_view.save({"run": trace}, path)
    return path


def columns(path: Path) -> dict[str, dict[str, list]]:
    """Contents of a recording: for each entity its components, in the order of time, and the times [ns]."""
    found: dict[str, dict[str, list]] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        entity = found.setdefault(str(chunk.entity_path), {})
        for name in batch.schema.names:
            if name == "sim_time":
                entity.setdefault(name, []).extend(batch.column(name).cast("int64").to_pylist())
            elif not name.startswith("rerun."):
                entity.setdefault(name, []).extend(batch.column(name).to_pylist())
    for entity in found.values():
        assert entity.get("sim_time", []) == sorted(entity.get("sim_time", []))
    return found


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


# Recorded values


def test_scalars_are_those_of_the_log_to_the_last_bit(trace, recording):
    found = columns(recording)
    for signal in trace.signals:
        if signal.name == "t":
            continue
        values = trace[signal.name].reshape(len(trace), -1)
        whole = found.get(f"/signals/{signal.name}")
        parts = [whole] if whole else [found[f"/signals/{signal.name}/{part}"] for part in signal.components]
        read = np.concatenate([np.array(part["Scalars:scalars"]) for part in parts], axis=1)
        np.testing.assert_array_equal(read, values, err_msg=signal.name)
        for part in parts:
            np.testing.assert_array_equal(part["sim_time"], np.rint(trace.t * 1e9).astype(int))
    np.testing.assert_array_equal(np.array(found["/push"]["Scalars:scalars"])[:, 0], trace.push)
    assert trace.push.max() > 10.0
    assert {v for row in found["/push/analytic"]["Scalars:scalars"] for v in row} == {trace.analytic.force}


def test_poses_are_those_of_the_log_in_float32(trace, recording):
    found = columns(recording)
    every = round(1.0 / (POSE_HZ * (trace.t[1] - trace.t[0])))
    vehicle, reference = found["/world/vehicle"], found["/world/reference"]
    np.testing.assert_array_equal(
        np.array(vehicle["Transform3D:translation"])[:, 0], trace.p_WB[::every].astype("f4"), strict=False
    )
    np.testing.assert_array_equal(
        np.array(vehicle["Transform3D:quaternion"])[:, 0], trace.quat_WB[::every][:, [1, 2, 3, 0]].astype("f4")
    )
    np.testing.assert_array_equal(np.array(reference["Transform3D:translation"])[:, 0], trace.p_d[::every].astype("f4"))
    quat_d = quat_from_euler_deg(*trace.scenario.reference.attitude_deg)[[1, 2, 3, 0]].astype("f4")
    assert all(np.array_equal(row[0], quat_d) for row in reference["Transform3D:quaternion"])
    way = [row[0] for row in found["/world/trajectory"]["LineStrips3D:strips"] if row]
    assert all(end == start for (_, end), (start, _) in itertools.pairwise(way)), "a piece is missing"
    np.testing.assert_array_equal(way[-1][1], trace.p_WB[::every][-1].astype("f4"))


def test_arrows_are_the_forces(trace, recording):
    found = columns(recording)
    every = round(1.0 / (POSE_HZ * (trace.t[1] - trace.t[0])))
    contact = found["/world/contact\\ force"]
    both = zip(contact["Arrows3D:origins"], contact["Arrows3D:vectors"], strict=True)
    arrows = [(start[0], vector[0]) for start, vector in both if start]
    push = trace.f_contact_W[::every]
    assert len(arrows) == np.count_nonzero(push.any(axis=1)) > 10
    (start, vector), force = arrows[-1], push[-1]
    tip = trace.p_WB[::every][-1] + [trace.header.geometry.reach, 0.0, 0.0]
    np.testing.assert_allclose(np.add(start, vector), tip, atol=1e-6)
    np.testing.assert_allclose(np.array(vector) / np.linalg.norm(vector), force / np.linalg.norm(force), atol=1e-6)
    texts = [row[0] for row in found["/world/contact\\ force/text"]["Points3D:labels"] if row]
    assert texts[-1] == f"contact force {np.linalg.norm(force):.2f} N"


def test_arrows_of_a_strong_vehicle_stay_in_the_scene_and_both_viewers_have_one_scale(trace):
    header = trace.header
    span = scene.span(header)
    assert scene.force_scale(header) == scene.force_scale(header, 19.0) == scene.FORCE_SCALE
    for largest in (19.0, 30.1, 1e3, 4.7e5):
        scale = scene.force_scale(header, largest)
        assert scale * largest <= span
        assert scale == scene.FORCE_SCALE or 2.5 * scale * largest > span, "not smaller than necessary"
        assert float(f"{scale:.1g}") == pytest.approx(scale, rel=1e-12), "a round number"
    forces = np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 2.0], [3e5, 0.0, 4e5]])
    drawn = scene.arrows(forces, scene.FORCE_SCALE, span)
    np.testing.assert_allclose(drawn[:2], scene.FORCE_SCALE * forces[:2], rtol=1e-15)
    assert np.linalg.norm(drawn[2]) == pytest.approx(span)
    np.testing.assert_allclose(np.cross(drawn[2], forces[2]), 0.0, atol=1e-6)


def strong(trace: Trace, times: float) -> Trace:
    """The same run with forces multiplied by ``times``."""
    arrays = {**trace.arrays, "tau": times * trace.tau, "f_contact_W": times * trace.f_contact_W}
    return dataclasses.replace(trace, arrays=arrays)


def test_no_arrow_leaves_the_scene(trace, tmp_path):
    rerun_view.save({"run": strong(trace, 100.0)}, tmp_path / "strong.rrd")
    found = columns(tmp_path / "strong.rrd")
    longest = 0.0
    for name in ("contact\\ force", "thrust"):
        vectors = [row[0] for row in found[f"/world/{name}"]["Arrows3D:vectors"] if row]
        longest = max(longest, np.linalg.norm(vectors, axis=1).max())
    assert 0.4 * scene.span(trace.header) < longest <= scene.span(trace.header)


def test_an_axis_holds_what_it_should_and_has_two_numbers_at_least(rng):
    """Rerun puts numbers only at multiples of a power of ten, and not at the end of an axis."""
    for exponent in rng.uniform(-6, 4, size=300):
        low, high = sorted(rng.normal(size=2) * 10.0**exponent + rng.choice([0.0, 50.0]))
        ends = readable([(low, high), (low, low)])
        assert ends[0] <= low <= high <= ends[1]
        length = ends[1] - ends[0]
        inside = [
            np.floor((ends[1] - 0.04 * length) / step) - np.ceil((ends[0] + 0.04 * length) / step) + 1
            for step in 10.0 ** np.arange(-9.0, 7.0)
        ]
        assert any(2 <= n <= MOST_STEPS + 1 for n in inside), (low, high, ends)
        assert high - low > 0.2 * length
    for point in (0.0, 2.0, -3e-4):
        low, high = readable([(point, point)])
        assert low < point < high


def test_the_force_plot_shows_where_each_run_comes_to_rest(trace):
    pushing = strong(trace, 8.0)
    for traces in ({"a": trace}, {"a": trace, "b": pushing}):
        runs = viewer._runs(traces)
        tabs = layout(runs).root_container.contents[1].contents[0]
        near, whole = tabs.contents
        assert tabs.active_tab == 0
        low, high = axis_of(near)
        for each in traces.values():
            assert low <= 0.0 < Extents.of(each).rest < 0.7 * high
            assert each.push.max() < axis_of(whole)[1]
        assert high < axis_of(whole)[1]
    live = layout([Run(trace.header)]).root_container.contents[1].contents[0]  # force at rest unknown
    assert "ScalarAxis" not in live.contents[live.active_tab].properties


def test_a_run_that_diverged_is_shown_with_others(trace, other, tmp_path):
    wild = {name: np.array(values) for name, values in trace.arrays.items()}
    growth = np.geomspace(1.0, 1e300, len(trace))
    for name in ("tau", "s", "f_contact_W"):
        wild[name] *= growth[:, None]
        wild[name][-3:] = np.nan
    traces = {"wild": dataclasses.replace(trace, arrays=wild), "tame": other}
    rerun_view.save(traces, tmp_path / "wild.rrd")
    assert viewer._runs(traces)[0].place.force_scale > 0.0


def test_a_vehicle_without_shapes_has_a_size():
    low, high = bounds([], 0.1)
    assert (low == -0.1).all()
    assert (high == 0.1).all()


def axis_of(view) -> tuple[float, float]:
    (limits,) = view.properties["ScalarAxis"].range.as_arrow_array().to_pylist()
    return tuple(limits)


def test_of_several_runs_none_hides_another(trace, other, tmp_path):
    """Each run has a lane wider than its vehicle, a name above it, and the colour of its law."""
    traces = {"a": trace, "b": other, "c": trace}
    rerun_view.save(traces, tmp_path / "three.rrd")
    found = columns(tmp_path / "three.rrd")
    corners = np.concatenate([solid.vertices for solid in solids(trace.header.geometry)])
    lanes = [found[f"/{label}/world"]["Transform3D:translation"][0][0] for label in traces]
    assert np.allclose(np.array(lanes)[:, [0, 2]], 0.0)
    y = np.array(lanes)[:, 1]
    assert (-np.diff(y)).min() > 1.5 * np.ptp(corners[:, 1])
    for label in traces:
        assert found[f"/{label}/world/vehicle/name"]["Points3D:labels"] == [[label]]
    runs = viewer._runs(traces)
    assert [run.colour for run in runs] == colours.of_runs(["gsta", "impedance", "gsta"])


def test_every_series_has_a_name_and_a_colour(trace, recording):
    found = columns(recording)
    scalars = {path: entity for path, entity in found.items() if "Scalars:scalars" in entity}
    names = []
    for path, entity in scalars.items():
        size = len(entity["Scalars:scalars"][0])
        (some,), (colours,) = entity["SeriesLines:names"], entity["SeriesLines:colors"]
        assert len(some) == len(colours) == size, path
        names += some
    assert len(set(names)) == len(names) == sum(s.size for s in trace.signals if s.name != "t") + 2
    assert "tau.x [N]" in names
    assert "s.yaw [rad/s]" in names


def test_blocks_and_thinning_change_nothing_but_the_number_of_samples(trace, tmp_path):
    def written(cuts: list[int], row_steps: int) -> dict[str, dict[str, list]]:
        stream = rr.RecordingStream("test", send_properties=False)
        stream.save(tmp_path / "blocks.rrd")
        run = Run(trace.header, row_steps=row_steps)
        run.begin(stream)
        for first, last in zip([0, *cuts], [*cuts, len(trace)], strict=True):
            run.write({s.name: trace[s.name][first:last].reshape(-1, s.size) for s in trace.signals})
        stream.flush()
        stream.disconnect()
        return columns(tmp_path / "blocks.rrd")

    whole, pieces = written([], 7), written([1, 2, 13, 997, 998, 4000], 7)
    assert whole.keys() == pieces.keys()
    for path in whole.keys() - {"/push/analytic"}:  # this entity has a sample at the ends of each block
        assert whole[path] == pieces[path], path
    np.testing.assert_array_equal(np.array(whole["/signals/nu"]["Scalars:scalars"]), trace.nu[::7])


def test_runs_stand_side_by_side_in_one_recording(trace, other, tmp_path):
    labels = ("gsta k=3.5/a b", "impedance")
    rerun_view.save(dict(zip(labels, (trace, other), strict=True)), tmp_path / "two.rrd")
    reader = RrdReader(tmp_path / "two.rrd")
    assert len(reader.recordings()) == len(reader.blueprints()) == 1
    found = columns(tmp_path / "two.rrd")
    colours = set()
    for label, run in zip(labels, (trace, other), strict=True):
        root = "/" + rr.new_entity_path([label]).removeprefix("/")
        force = found[f"{root}/push"]
        np.testing.assert_array_equal(np.array(force["Scalars:scalars"])[:, 0], run.push)
        assert force["SeriesLines:names"] == [[f"{label}: push [N]"]]
        colours.add(force["SeriesLines:colors"][0][0])
        assert any(path.startswith(f"{root}/world/vehicle/") for path in found)
    assert len(colours) == 2


def test_solids_are_closed_and_have_their_volume(trace):
    for solid in solids(trace.header.geometry):
        np.testing.assert_allclose(np.linalg.norm(solid.normals, axis=1), 1.0, atol=1e-5)
        a, b, c = (solid.vertices[solid.triangles[:, i]].astype(float) for i in range(3))
        area = np.cross(b - a, c - a)
        np.testing.assert_allclose(area.sum(axis=0), 0.0, atol=1e-6)  # closed
        outwards = np.einsum("ij,ij->i", area, solid.normals[solid.triangles[:, 0]])
        assert np.mean(outwards[np.linalg.norm(area, axis=1) > 1e-12] > 0.0) > 0.98
    reach = max(solid.vertices[:, 0].max() for solid in solids(trace.header.geometry))
    assert reach == pytest.approx(trace.header.geometry.reach, abs=1e-3)


def test_a_recording_is_written_whole_or_not_at_all(trace, tmp_path):
    code = """if True:
        import resource, sys
        from pathlib import Path
        from uvms_mj import InputError, simulate, Scenario
        from uvms_mj.views import rerun as rerun_view
        trace = simulate(Scenario.load("push_wall", {"simulation.duration": 3.0}))
        resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
        try:
            rerun_view.save({"a": trace}, Path(sys.argv[1]))
        except InputError as error:
            print(error)
    """
    target = tmp_path / "run.rrd"
    target.write_text("earlier content")
    done = subprocess.run([sys.executable, "-c", code, target], capture_output=True, text=True, check=True)
    assert done.stdout.startswith(f"{target}: can't write it: ")
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd"]
    assert target.read_text() == "earlier content"


# Viewers


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
        opened.append((start(["--headless", *options], port, lives_s), port))
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
@pytest.mark.parametrize("end", [signals.SIGKILL, signals.SIGSTOP], ids=["closed", "hung"])
@pytest.mark.parametrize("when", [0.0, 0.5])
def test_a_run_outlives_its_viewer(headless, monkeypatch, end, when):
    """Rerun's client would wait forever for a viewer that accepts no data; a run waits only once, at its end."""
    monkeypatch.setattr(viewer, "_PATIENCE_S", 4.0)
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
    assert max(took) < 4.0
    here = [each for each in psutil.Process().children(recursive=True) if each.status() != psutil.STATUS_ZOMBIE]
    ours = family(psutil.Process(headless[0][0].pid)) if end == signals.SIGSTOP else []
    assert {each.pid for each in here if "rerun" in " ".join(each.cmdline())} <= {each.pid for each in ours}


@needs_vulkan
def test_replay_says_that_the_viewer_was_closed(headless, trace, monkeypatch):
    monkeypatch.setattr(viewer, "_PATIENCE_S", 2.0)
    opened = viewer.start
    for end, message in ((signals.SIGKILL, "it was closed"), (signals.SIGSTOP, "accepted no data for 2 s")):

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
            command, stdout=subprocess.PIPE, text=True, env={**os.environ, "HOME": str(home)}
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
    from uvms_mj.views.rerun.web import web_viewer

    with pytest.raises(InputError, match=f"port {server.port}"), web_viewer(recording, server.port):
        pass


class Chromium:
    """A headless Chromium, controlled by the DevTools protocol over a pipe."""

    def __init__(self, folder: Path) -> None:
        to_browser, from_browser = os.pipe(), os.pipe()
        read, write = (fcntl.fcntl(fd, fcntl.F_DUPFD, 10) for fd in (to_browser[0], from_browser[1]))
        run = f"import os, sys; os.dup2({read}, 3); os.dup2({write}, 4); os.execvp(sys.argv[1], sys.argv[1:])"
        flags = (
            "--headless --no-sandbox --remote-debugging-pipe --no-first-run --disable-quic --disable-sync "
            "--disable-background-networking --disable-component-update --use-angle=swiftshader "
            f"--enable-unsafe-swiftshader --window-size=1280,900 --user-data-dir={folder} about:blank"
        )
        self.process = subprocess.Popen(
            [sys.executable, "-c", run, str(CHROMIUM), *flags.split()],
            pass_fds=(read, write),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for fd in (to_browser[0], from_browser[1], read, write):
            os.close(fd)
        self.to, self.back = to_browser[1], from_browser[0]
        self.events: list[dict] = []
        self._calls, self._buffer, self._session = 0, b"", {}
        page = next(t for t in self("Target.getTargets")["targetInfos"] if t["type"] == "page")
        attached = self("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = {"sessionId": attached["sessionId"]}

    def __call__(self, method: str, **params) -> dict:
        self._calls += 1
        message = {"id": self._calls, "method": method, "params": params, **self._session}
        os.write(self.to, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self._buffer:
                assert select.select([self.back], [], [], 120.0)[0], f"no answer to {method}"
                data = os.read(self.back, 2**20)
                assert data, "chromium ended"
                self._buffer += data
            one, _, self._buffer = self._buffer.partition(b"\0")
            answer = json.loads(one)
            if answer.get("id") == self._calls:
                return answer.get("result", {})
            self.events.append(answer)

    def close(self) -> None:
        os.close(self.to)
        try:
            self.process.wait(10.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait(10.0)
        os.close(self.back)


@needs_chromium
def test_a_browser_shows_the_plots_and_talks_to_nobody_else(server, tmp_path):
    browser = Chromium(tmp_path)
    try:
        for domain in ("Page", "Network"):
            browser(f"{domain}.enable")
        browser("Page.navigate", url=server.address)
        deadline, series = time.monotonic() + 120.0, {}
        while time.monotonic() < deadline:
            data = browser("Page.captureScreenshot", format="png").get("data")  # missing while a page loads
            series = shown(base64.b64decode(data)) if data else {}
            if series and all(n > ENOUGH for n in series.values()):
                break
            time.sleep(1.0)
        time.sleep(2.0)
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


# No data sent to other machines


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
