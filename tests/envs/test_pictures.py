"""Pictures and infos of the environments: what is drawn and told is what the run has."""

import subprocess
import sys

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="needs the extra gym")

import uvms_mj.envs  # noqa: E402, F401  # registers the environment
from uvms_mj import InputError, Scenario, simulate  # noqa: E402
from uvms_mj.envs.pictures import Pictures  # noqa: E402

SIZE = (320, 180)
NEAR = {"simulation.timestep": 1e-3, "simulation.duration": 0.4, "initial.position": [0.6, 0.0, 0.0]}
PUSH = "uvms_mj/PushWall-v0"


def make(**settings):
    return gymnasium.make(PUSH, **{"overrides": NEAR, "render_size": SIZE, "render_mode": "rgb_array"} | settings)


def changed(one, other):
    """Whether each pixel differs by more than the codec's losses."""
    return np.abs(one.astype(int) - other.astype(int)).sum(axis=2) > 60


def test_a_recorded_episode_shows_the_vehicle_where_it_is(driver, tmp_path):
    """Gymnasium's RecordVideo: a picture a step at the control rate, lit, and pixels change around the places of the
    vehicle by the camera's projection."""
    pytest.importorskip("moviepy", reason="RecordVideo needs moviepy")
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="needs the extra video")
    env = gymnasium.wrappers.RecordVideo(make(render_view="side"), str(tmp_path / "videos"), disable_logger=True)
    env.reset(seed=0)
    start, done = env.unwrapped.push.simulation.signals.p_WB.copy(), False
    while not done:
        _, _, ended, truncated, _ = env.step(np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
        done = ended or truncated
    end = env.unwrapped.push.simulation.signals.p_WB.copy()
    renderer = env.unwrapped._pictures._kept[0][1]._frames._renderer
    places = np.array([renderer.place(p) for p in (start, end)])
    env.close()
    (file,) = (tmp_path / "videos").glob("*.mp4")
    reader = imageio_ffmpeg.read_frames(str(file))
    meta = next(reader)
    frames = [np.frombuffer(each, np.uint8).reshape(SIZE[1], SIZE[0], 3) for each in reader]
    assert meta["fps"] == 50.0
    assert len(frames) == 21  # the reset's and one a step
    assert np.array(frames).mean(axis=(1, 2, 3)).min() > 40.0
    assert end[0] - start[0] > 0.01
    moved = changed(frames[0], frames[-1])
    moved[:60, :120] = False  # the text with the time
    rows, columns = np.nonzero(moved)
    assert len(rows) > 100
    assert np.abs(np.array([np.median(columns), np.median(rows)]) - places.mean(axis=0)).max() < 25.0


def test_a_picture_is_of_its_episode_and_its_instant(driver):
    env = make()
    env.reset(seed=0, options={"wall.position": 1.0})
    first = env.render()
    assert (first.shape, first.dtype) == ((SIZE[1], SIZE[0], 3), np.uint8)
    assert np.array_equal(first, env.render())  # looking changes nothing
    for _ in range(10):
        env.step(np.array([0.0, 1.0, 0.0, 0.0, 0.0, 1.0]))
    assert changed(first, env.render()).any()
    env.reset(seed=0, options={"wall.position": 1.0})
    assert np.array_equal(first, env.render())
    env.reset(seed=0, options={"wall.position": 1.4})
    assert changed(first, env.render()).mean() > 0.05  # another wall
    env.close()


def test_a_look_changes_no_number(driver):
    def velocities(look):
        env = make()
        env.reset(seed=3)
        found = []
        for _ in range(5):
            found.append(env.step(np.full(6, 0.3))[0]["nu"])
            if look:
                env.render()
        env.close()
        return found

    assert np.array_equal(velocities(True), velocities(False))


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_a_vector_has_the_pictures_of_its_environments(driver, engine):
    settings = {"randomise": {"wall.position": (0.7, 1.0)}, "engine": engine}
    given = {"overrides": NEAR, "render_size": SIZE, "render_mode": "rgb_array"} | settings
    envs = gymnasium.make_vec(PUSH, 2, **given)
    envs.reset(seed=5)
    envs.step(np.full((2, 6), 0.5))
    many = envs.render()
    for i, picture in enumerate(many):
        env = make(**settings)
        env.reset(seed=5 + i)
        env.step(np.full(6, 0.5))
        assert np.array_equal(picture, env.render())
        env.close()
    assert changed(*many).any()
    assert envs.metadata["render_fps"] == 50.0
    envs.close()


def test_a_program_that_closes_nothing_ends_in_silence(driver):
    code = (
        "import gymnasium, uvms_mj.envs\n"
        f"env = gymnasium.make({PUSH!r}, render_mode='rgb_array', render_size={SIZE})\n"
        "env.reset()\nprint(env.render().mean() > 40)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (found.stdout, found.stderr) == ("True\n", "")


def test_without_a_mode_nothing_is_drawn():
    env = gymnasium.make(PUSH, overrides=NEAR, control_rate=100.0)
    env.reset()
    assert env.render() is None
    assert env.metadata == {"render_modes": ["rgb_array"], "render_fps": 100.0}
    vector = gymnasium.make_vec(PUSH, 2, overrides=NEAR)
    vector.reset()
    assert vector.render() is None


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"render_mode": "human"}, "render_mode: 'human': must be 'rgb_array' or None; gymnasium.make opens a window"),
        ({"render_mode": "depth_array"}, "render_mode: 'depth_array': must be 'rgb_array' or None"),
        ({"render_size": 640}, "render_size: 640: must be a width and a height"),
        ({"render_view": "abve"}, "view 'abve'"),
        ({"render_view": 3}, "render_view: 3: must be the name"),
    ],
)
def test_what_can_not_be_drawn_is_refused(settings, message):
    from uvms_mj.envs.gym import PushWall, PushWallVec

    for kind in (PushWall, PushWallVec):
        with pytest.raises(InputError, match=message):
            kind(overrides=NEAR, **settings)


def test_a_size_that_is_not_possible_is_refused_at_the_first_picture(driver):
    env = make(render_size=(101, 100))
    env.reset()
    with pytest.raises(InputError, match="even numbers of pixels"):
        env.render()


def test_closed_pictures_are_drawn_anew(driver):
    env = make()
    env.reset(seed=0)
    pictures: Pictures = env.unwrapped._pictures
    first = env.render()
    pictures.close()
    assert np.array_equal(first, env.render())
    env.close()


SOFT = {
    "simulation.timestep": 1e-3,
    "simulation.duration": 6.0,
    "initial.position": [0.99, 0.0, 0.0],
    "wall.stiffness": 2e3,
    "reference.step_time": 0.0,
}


@pytest.mark.parametrize("success", [(0.1, 1.0), (0.02, 0.5)])
def test_the_info_is_the_runs(success):
    """The law's own gains as the action: force, contact and success are what the trace of the same run gives by its
    push (trapezoidal rule), and the measured force is the trace's."""
    env = gymnasium.make(PUSH, action="gains", overrides=SOFT, engine="free_body", success=success)
    _, first = env.reset(seed=0)
    assert (first["t"], first["force"], first["contact"], first["is_success"]) == (0.0, 0.0, False, False)
    infos, over = [], False
    while not over:
        *_, over, info = env.step(np.zeros(2))
        infos.append(info)
    trace = simulate(Scenario.load("push_wall", SOFT), engine="free_body", log_rate=1000.0)
    each = 20  # time steps of a control step; the force of a step is known in the next one
    pairs = 0.5e-3 * (trace.push[1:] + trace.push[:-1])
    impulse = np.concatenate([[0.0], np.cumsum(pairs)])[each - 1 :: each]
    force = np.diff(impulse, prepend=0.0) / 0.02
    assert [info["t"] for info in infos] == pytest.approx(0.02 * np.arange(1, 301))
    assert [info["force"] for info in infos] == pytest.approx(force, abs=1e-9)
    assert [info["force_d"] for info in infos] == pytest.approx(np.full(300, 1.5 / (1.0 + 150.0 / 2e3)))
    measured = np.array([info["f_contact_m_W"] for info in infos])
    assert np.array_equal(measured, trace.f_contact_m_W[each::each])
    touched = np.array([trace.push[max(0, k - each - 1) : k].any() for k in range(each, 6001, each)])
    assert [info["contact"] for info in infos] == touched.tolist()
    within = np.abs(force / infos[0]["force_d"] - 1.0) <= success[0]
    held = round(success[1] / 0.02)
    expected = [k >= held and within[k - held : k].all() for k in range(1, 301)]
    assert [info["is_success"] for info in infos] == expected
    assert set(expected) == {False, True}
    env.close()


def test_success_is_lost_and_begins_anew():
    """With the wall, pushing forward by the demanded force and the current's drag succeeds; letting go ends it."""
    env = gymnasium.make(PUSH, overrides=SOFT | {"current.speed": 0.0}, success=(0.5, 0.1), force_d=10.0)
    env.reset(seed=0)
    push, rest = np.array([0.25, 0.0, 0.0, 0.0, 0.0, 0.0]), np.zeros(6)
    while not (info := env.step(push)[4])["is_success"]:
        assert info["t"] < 5.0
    assert info["contact"]
    assert not env.reset(seed=0)[1]["is_success"]
    while not env.step(push)[4]["is_success"]:
        pass
    for _ in range(50):
        info = env.step(rest)[4]
    assert not info["is_success"]
    env.reset(seed=0)
    assert not env.step(push)[4]["is_success"]
    env.close()


@pytest.mark.parametrize("wrong", [0.1, (0.1, 0.0), (-0.1, 1.0), "soon"])
def test_a_wrong_criterion_is_named(wrong):
    with pytest.raises(InputError, match=r"success: .*must be a share of the desired force and a time"):
        gymnasium.make(PUSH, success=wrong)
