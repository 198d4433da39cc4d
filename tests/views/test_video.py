"""Videos: what is drawn is where the run says, the plots grow, files are whole, and refusals name the way out."""

import importlib
import subprocess
import sys

import mujoco
import numpy as np
import pytest
from PIL import Image

from uvms_mj import InputError, Scenario, Trace, simulate, still, video
from uvms_mj.physics.waves import add_waves
from uvms_mj.views import video as views
from uvms_mj.views.video import underwater
from uvms_mj.views.video.encoding import CODERS
from uvms_mj.views.video.plots import Plots
from uvms_mj.views.video.underwater import VIEWS, Camera

SMALL = (320, 180)


@pytest.fixture(scope="module")
def push() -> Trace:
    """A push that begins at once."""
    settings = {"reference.step_time": 0.0, "wall.position": 0.3, "reference.target": [0.31, 0, 0]}
    return simulate(Scenario.load("push_wall", settings | {"simulation.duration": 5.0, "wall.stiffness": 2e3}))


def changed(picture: Image.Image, other: Image.Image) -> np.ndarray:
    """Whether each pixel differs."""
    one, two = (np.asarray(each).astype(int) for each in (picture, other))
    return np.abs(one - two).sum(axis=2) > 40


def test_the_vehicle_and_the_arrow_are_drawn_where_the_run_says(driver, push):
    """The pixels that change between start and end are around the places of the vehicle by the camera's projection, and
    those in the colour of the force are at the contact."""
    frames = views._Frames(push, "side", (), SMALL, samples=4)
    with frames:
        start, end = (Image.fromarray(frames.at(row, row)) for row in (0, len(push) - 1))
        places = [frames._renderer.place(push.p_WB[row]) for row in (0, -1)]
        contact = frames._renderer.place(push.p_WB[-1] + [push.header.geometry.reach, 0.0, 0.0])
    rows, columns = np.nonzero(changed(start, end)[60:, :])
    middle = 0.5 * (places[0] + places[1])
    assert abs(np.median(columns) - middle[0]) < 20
    assert abs(np.median(rows) + 60 - middle[1]) < 25
    orange = np.abs(np.asarray(end).astype(int) - views.FORCES[0].colour).sum(axis=2) < 40
    orange[:60, :120] = False  # the mark beside the text
    arrow = np.argwhere(orange)
    assert len(arrow) > 20
    assert abs(arrow[:, 1].min() - contact[0]) < 4
    assert abs(np.median(arrow[:, 0]) - contact[1]) < 4


def test_an_arm_is_drawn_in_its_pose(driver):
    """The tool of the drawn model is where the run has it."""
    import mujoco

    trace = simulate(Scenario.load("tool_push", {"simulation.duration": 0.2}))
    model = underwater.model_of(trace.header, [0.0, 0.0, 0.0], samples=2)
    data = mujoco.MjData(model)
    underwater.pose_setter(model, trace.header.mjcf)(data, trace.p_WB[-1], trace.quat_WB[-1], trace.q[-1])
    assert data.site("tool").xpos == pytest.approx(trace.p_WT[-1], abs=1e-9)


def test_plots_are_uncovered_up_to_the_time_and_whole_at_the_end(push):
    plots = Plots(push, ("force", "position"), 200, 220, 70.0)
    box = plots._boxes[0]
    half = round(0.5 * (box.x0 + box.x1))
    now = plots.at(0.5 * (push.t[0] + push.t[-1]))
    assert np.array_equal(now[:, : half - 1], plots.whole[:, : half - 1])
    assert np.array_equal(now[:, half + 2 :], plots.empty[:, half + 2 :])
    assert np.array_equal(plots.at(push.t[-1]), plots.whole)
    assert not np.array_equal(plots.whole, plots.empty)


def test_the_force_of_a_picture_is_the_largest_since_the_one_before(push):
    times = views._times(push, 0.25)
    assert [now for _, now in times[:-1]] == [since for since, _ in times[1:]]
    assert times[-1][1] == len(push) - 1
    assert len(times) == 21


def read_back(path) -> tuple[int, list[Image.Image]]:
    """The number of pictures of a file by ffmpeg itself, and the first and the last one."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    told = [ffmpeg, "-v", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    data = np.frombuffer(subprocess.run(told, capture_output=True, check=True).stdout, np.uint8)
    pictures = data.reshape(-1, SMALL[1], SMALL[0], 3)
    return len(pictures), [Image.fromarray(pictures[k]) for k in (0, -1)]


@pytest.fixture(scope="module")
def ends(driver, push) -> list[Image.Image]:
    """Pictures of the start and the end."""
    return [still(push, t, size=SMALL, plots=["force"]) for t in (0.0, 5.0)]


@pytest.mark.parametrize("kind", CODERS)
def test_a_video_has_its_pictures_and_replaces_the_file_when_it_is_whole(push, ends, tmp_path, kind):
    pytest.importorskip("imageio_ffmpeg")
    path, counts = tmp_path / f"push.{kind}", []
    path.write_bytes(b"old")
    video(push, path, speed=5.0, fps=4.0, size=SMALL, plots=["force"], progress=lambda *n: counts.append(n))
    number, (first, last) = read_back(path)
    assert counts == [(i, 5) for i in range(1, 6)]
    assert number == 5
    for picture, expected in zip((first, last), ends, strict=True):
        assert np.abs(np.asarray(picture).astype(int) - np.asarray(expected)).mean() < 9.0  # of the coding
    assert changed(first, last).mean() > 0.02
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_the_camera_follows_the_vehicle_or_stands_still(push):
    ends = push.p_WB[[0, -1]]
    for name, view in VIEWS.items():
        camera = Camera(push, view, 16.0 / 9.0)
        looked = [camera.at(p_WB).lookat.copy() for p_WB in ends]
        assert np.array_equal(*looked) == (name != "follow"), name
        assert name != "follow" or np.array_equal(looked, ends)


def test_a_video_that_is_stopped_leaves_no_file(driver, push, tmp_path):
    pytest.importorskip("imageio_ffmpeg", reason="needs the extra video")

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        video(push, tmp_path / "x.mp4", size=SMALL, plots=(), progress=stop)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"path": "x.avi"}, r"must end in one of .mp4, .gif"),
        ({"speed": 0.0}, "must be positive"),
        ({"size": (321, 180)}, "give even numbers of pixels"),
        ({"view": "sid"}, "did you mean 'side'"),
        ({"view": "1,2,-3"}, "give azimuth, elevation and distance"),
        ({"plots": ["velocty"]}, "did you mean 'velocity'"),
        ({"plots": ["force"] * 9}, "need more height"),
    ],
)
def test_refusals_come_before_the_first_picture(push, tmp_path, arguments, expected):
    given = {"path": "x.mp4", "size": SMALL, "plots": ()} | arguments
    path = tmp_path / given.pop("path")
    with pytest.raises(InputError, match=expected):
        video(push, path, **given)
    assert not list(tmp_path.iterdir())


def test_a_run_without_states_is_refused(push):
    short = Trace.of(push.header, push.rows()[:1], push.outcome)
    with pytest.raises(InputError, match="fewer than two samples"):
        still(short)


def test_a_missing_extra_and_a_missing_driver_are_named(push, tmp_path, monkeypatch):
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "imageio_ffmpeg", None)
        with pytest.raises(InputError, match=r"pip install 'uvms-mj\[video\]'"):
            video(push, tmp_path / "x.mp4", size=SMALL)
    for way in ("egl", "osmesa", "glfw", "cgl"):
        monkeypatch.setitem(sys.modules, f"mujoco.{way}", None)
    with pytest.raises(InputError, match="no driver draws without a window") as told:
        still(push, size=SMALL, plots=())
    assert sys.platform == "darwin" or "apt install libegl1 libgl1-mesa-dri" in str(told.value)


def test_the_command_draws_a_still_and_a_video_as_the_calls_do(driver, push, tmp_path, here):
    pytest.importorskip("imageio_ffmpeg")
    command = importlib.import_module("uvms_mj.cli.plot")
    assert (*CODERS, "png") == command.VIDEOS
    assert tuple(views.VIEWS) == command.VIEWS
    push.save(tmp_path / "run.mcap")
    size = ("--size", "320x180", "--plots", "force")
    assert here("video", "run.mcap", "--out", "a.png", "--at", "2", *size).exit_code == 0
    expected = np.asarray(still(push, 2.0, size=SMALL, plots=["force"]))
    assert np.array_equal(np.asarray(Image.open(tmp_path / "a.png")), expected)
    done = here("video", "run.mcap", "--out", "a.gif", "--from", "1", "--to", "2", "--fps", "5", *size)
    assert done.exit_code == 0, done.output
    assert read_back(tmp_path / "a.gif")[0] == 6
    for arguments, wrong in (
        (("--out", "a.png"), "exists"),
        (("--out", "a.bmp"), "must end in one of .mp4, .gif, .png"),
        (("--out", "b.mp4", "--at", "1"), "--at is for a .png"),
        (("--out", "b.png", "--size", "big"), "give width and height in pixels"),
        (("--out", "b.png", "--speed", "fast"), "--speed 'fast': is not a finite number"),
    ):
        refused = here("video", "run.mcap", *arguments)
        assert refused.exit_code == 2
        assert wrong in refused.stderr


SEA = {"sea.height": 0.4, "sea.period": 3.0, "sea.spectrum": "jonswap", "sea.depth": 5.0, "sea.surface": 1.2}


@pytest.fixture(scope="module")
def in_waves() -> Trace:
    return simulate(Scenario.load("push_wall", SEA | {"simulation.duration": 2.0}), engine="free_body", log_rate=50.0)


def test_the_surface_of_the_sea_has_the_head_of_its_pressure(in_waves):
    """At the still surface the head is the height of the wave."""
    surface, spec = underwater.SeaSurface(in_waves.header), mujoco.MjSpec()
    surface.add_to(spec, [0.5, 0.0, 0.0])
    model = spec.compile()
    waves = surface._records.view(np.recarray)
    half, high, n = model.hfield_size[0, 0], model.hfield_size[0, 2], model.hfield_nrow[0]
    for t in (0.0, 1.3):
        surface.put(model, t)
        drawn = model.geom_pos[0, 2] + high * model.hfield_data.reshape(n, n)
        for row, column in ((0, 0), (40, 100), (64, 64)):
            place = [0.5 + half * (2.0 * column / (n - 1) - 1.0), half * (2.0 * row / (n - 1) - 1.0), 1.2]
            head = add_waves(waves, t, np.array(place), np.zeros(3), np.zeros(3), np.zeros((3, 3)))
            assert drawn[row, column] == pytest.approx(1.2 + head, abs=1e-6)


def test_the_surface_moves_in_the_picture(driver, in_waves):
    one, other = (still(in_waves, t, view="surface", plots=[], size=SMALL) for t in (0.2, 1.7))
    assert changed(one, other)[:90].mean() > 0.01
