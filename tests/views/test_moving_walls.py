"""Walls that move and turn: their pose is recorded, and logs and videos show it. test_rerun.py has the viewer."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from recorded import decoded
from uvms_mj import McapLog, Scenario, Simulation, Trace, simulate
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.records import scene
from uvms_mj.views.video import underwater

PIVOT, PLACE, EULER = np.array([1.5, 0.3, 0.2]), np.array([2.0, 0.1, -0.2]), [10.0, 20.0, 30.0]
TURNING = {
    "shape": "plane",
    "position": PLACE.tolist(),
    "attitude_deg": EULER,
    "amplitude": [0.1, 0.2, 0.3],
    "frequency_hz": 0.5,
    "phase_deg": 30.0,
    "turn_amplitude_deg": [5.0, 6.0, 20.0],
    "turn_frequency_hz": 0.3,
    "turn_phase_deg": 50.0,
    "pivot": PIVOT.tolist(),
}
HULL = {"shape": "cylinder", "position": [4.0, 0.0, 0.0], "radius": 0.5, "heave": [[0.1, 0.7, 20.0], [50.0, 0.7, 20.0]]}
SCENARIO = Scenario.load(
    "push_wall",
    {
        "walls": [{"shape": "box", "position": [6.0, 0.0, 0.0], "edges": [1.0, 1.0, 1.0]}, TURNING, HULL],
        "sea.height": 0.2,
        "sea.period": 5.0,
        "wall.position": 5.0,
        "simulation.duration": 2.0,
        "simulation.timestep": 1e-3,
    },
)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("walls") / "run.mcap"


@pytest.fixture(scope="module")
def trace(path) -> Trace:
    return simulate(SCENARIO, sinks=[McapLog(path)])


@pytest.mark.parametrize("engine", ["mujoco", "free_body"])
def test_the_recorded_pose_is_the_motion_of_the_scenario(trace, engine):
    found = trace if engine == "mujoco" else simulate(SCENARIO, engine=engine)
    t = found.t[:, None]
    u = np.array(TURNING["amplitude"]) * np.sin(2 * np.pi * 0.5 * t + np.radians(30.0))
    Q = Rotation.from_rotvec(np.radians(TURNING["turn_amplitude_deg"]) * np.sin(2 * np.pi * 0.3 * t + np.radians(50.0)))
    np.testing.assert_allclose(found.p_WS1, PIVOT + Q.apply(PLACE - PIVOT) + u, atol=1e-14)
    R = (Q * Rotation.from_euler("ZYX", EULER[::-1], degrees=True)).as_matrix()
    np.testing.assert_allclose(rotation_matrix(found.quat_WS1), R, atol=1e-14)
    assert np.abs(np.diff(found.quat_WS1, axis=0)).max() < 1e-3, "no jump between q and -q"
    k = (2 * np.pi / 5.0) ** 2 / 9.81
    crest = 2 * np.pi * t[:, 0] / 5.0 - k * 4.0  # a crest is at W's origin at the start
    np.testing.assert_allclose(found.p_WS2[:, 2], 0.1 * 0.7 * np.cos(crest + np.radians(20.0)), atol=2e-5)
    np.testing.assert_array_equal(found.quat_WS2, np.broadcast_to([1.0, 0.0, 0.0, 0.0], found.quat_WS2.shape))
    assert not {"p_WS0", "quat_WS0"} & {signal.name for signal in found.signals}, "walls[0] stands"


def test_a_log_has_a_frame_of_each_wall_that_moves_and_its_shape_is_in_it(trace, path):
    back = Trace.load(path)
    for name in ("p_WS1", "quat_WS1", "p_WS2", "quat_WS2"):
        np.testing.assert_array_equal(back[name], trace[name])
    topics = decoded(path, "/tf", "/markers/surroundings")
    poses = {"walls/1": [], "walls/2": []}
    for _, message in topics["/tf"]:
        for each in message.transforms:
            if each.child_frame_id in poses:
                p, q = each.transform.translation, each.transform.rotation
                poses[each.child_frame_id].append([p.x, p.y, p.z, q.w, q.x, q.y, q.z])
    for k in (1, 2):
        recorded = np.hstack([trace[f"p_WS{k}"], trace[f"quat_WS{k}"]])
        np.testing.assert_array_equal(np.array(poses[f"walls/{k}"]), recorded)
    ((_, around),) = topics["/markers/surroundings"]
    plate = next(m for m in around.markers if m.header.frame_id == "walls/1")
    assert plate.pose.position.x == pytest.approx(0.5 * plate.scale.x), "the face of the plate is at x = 0 of S"
    assert plate.frame_locked
    frames = [marker.header.frame_id for marker in around.markers if marker.ns == "wall"]
    assert sorted(frames) == ["map", "map", "walls/1", "walls/2"]


def test_a_video_has_the_wall_where_the_run_has_it(trace):
    model = underwater.model_of(trace.header, [0.0, 0.0, 0.0], samples=2)
    data, put = mujoco.MjData(model), underwater.wall_setter(model, trace.header)
    _, moving = scene.walls_of_scene(trace.header)
    for row in (0, len(trace) // 3, len(trace) - 1):
        put(data, {name: trace[name][row : row + 1] for name in trace})
        mujoco.mj_forward(model, data)
        for wall in moving:
            body = model.body(underwater._body_of(wall))
            geom = int(body.geomadr[0])
            p, R = trace[f"p_WS{wall.k}"][row], rotation_matrix(trace[f"quat_WS{wall.k}"][row])
            np.testing.assert_allclose(data.xpos[body.id], p, atol=1e-14)
            np.testing.assert_allclose(data.geom_xpos[geom], p + R @ np.array(wall.shape.position), atol=1e-14)
            np.testing.assert_allclose(data.xmat[body.id].reshape(3, 3), R, atol=1e-12)


def test_a_run_without_the_pose_of_a_wall_shows_it_without_motion():
    """A Simulation has the signals of its first scenario; a wall that moves after a reset has none."""
    plane = {"shape": "plane", "position": PLACE.tolist()}
    still = Scenario.load("push_wall", {"walls": [plane], "wall.position": 5.0})
    with Simulation(still) as sim:
        sim.reset({"walls[0].amplitude": [0.1, 0.0, 0.0], "walls[0].frequency_hz": 1.0})
        assert not any(signal.name == "p_WS0" for signal in sim.recorded)
    standing, moving = scene.walls_of_scene(simulate(still.updated({"simulation.duration": 1e-3})).header)
    assert (len(standing), moving) == (2, ())
