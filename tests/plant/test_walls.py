"""Further walls, contact bodies and bumpers in a run: rest and motion against closed forms, in both engines."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pressed import PUSH, M
from uvms_mj import Controller, InputError, McapLog, Scenario, Simulation, Trace, gain, simulate
from uvms_mj.analysis.summary import NUMBERS
from uvms_mj.control.base import NoClosedForm
from uvms_mj.control.design import demanded_force
from uvms_mj.envs import push
from uvms_mj.physics.frames import quat_from_euler_deg, rotation_matrix
from uvms_mj.physics.surfaces import SHAPES, signed_distance
from uvms_mj.setup.base import set_up
from uvms_mj.setup.checks import SamplingWarning, warnings_of
from uvms_mj.views.figures.panels import expected_forces

FREE = {"engine": "free_body"}
K_C, K_X = 1e5, 150.0
REACH = set_up(Scenario()).plant.geometry.reach
ISOTROPIC = {"impedance.K_d": [K_X] * 3 + [50.0] * 3}
STILL = {"current.speed": 0.0}
NO_WALL = {"wall.present": False}
THREE = [
    {"position": [0.25, 0.15, 0.1], "radius": 0.05},
    {"position": [0.25, -0.15, 0.1], "radius": 0.05},
    {"position": [0.25, 0.0, -0.12], "radius": 0.05},
]


@dataclasses.dataclass(frozen=True)
class Push(Controller):
    """A law with a constant push along x, damping, and attitude control."""

    push: float = gain(PUSH, "N", "along x")
    damping: float = gain(100.0, "N s/m", "along x")

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = 0.0
        tau_cmd[0] = gains.push - gains.damping * signals.nu[0]
        for i in range(3, 6):
            tau_cmd[i] = -2000.0 * signals.eta_e[i] - 40.0 * signals.nu[i]


def run(overrides: dict, law: object = None, **settings) -> Trace:
    return simulate(Scenario.load("push_wall", overrides), law, **{**FREE, **settings})


def mean_push(trace: Trace) -> float:
    """Over the last 0.5 s: the sampled super-twisting alternates about its rest."""
    return float(trace.final_impulse[-1] / 0.5)


@pytest.mark.parametrize("shape", [{"shape": "plane"}, {"shape": "sphere", "radius": 0.3}])
def test_a_contact_at_rest_is_the_gradient_of_its_distance(shape):
    """By the motion of the vehicle, in its axes: the virtual work of a force without friction."""
    wall = shape | {"position": [1.5, 0.2, -0.1]}
    body = {"position": [0.2, 0.1, -0.05], "radius": 0.05}
    contacts = set_up(
        Scenario.load("push_wall", NO_WALL | {"walls": [wall], "vehicle.contact_bodies": [body]})
    ).contacts
    surface = contacts.records(lambda _: 1.0)[0].view(np.recarray)[0]

    def distance(p, R):
        return signed_distance(surface, p + R @ np.array(body["position"]), np.zeros(3))

    p, R, h = np.array([0.3, 0.1, 0.2]), rotation_matrix(quat_from_euler_deg(10.0, -20.0, 30.0)), 1e-6

    def moved(e):
        return distance(p + R @ e[:3], R @ Rotation.from_rotvec(e[3:]).as_matrix())

    gradient = [(moved(e) - moved(-e)) / (2.0 * h) for e in h * np.eye(6)]
    (contact,) = contacts.at_rest(p, R)
    np.testing.assert_allclose(contact.normal, gradient, rtol=0, atol=1e-8)


def test_a_plane_is_the_papers_wall():
    """With friction and damping, at an attitude, in both engines, but for the inerter of MuJoCo's pair."""
    short = {
        "simulation.duration": 3.0,
        "initial.position": [0.9, 0.0, 0.0],
        "reference.target": [1.02, 0.1, 0.0],
        "wall.position": 0.95,
        "initial.attitude_deg": [4.0, -3.0, 5.0],
    }
    same = {"stiffness": 2e4, "damping": 30.0, "friction": 0.3, "tangential_damping": 200.0}
    plane = {"shape": "plane", "position": [0.95 + REACH, 7.0, -3.0], **same}
    papers = run(short | {f"wall.{key}": value for key, value in same.items()})
    for engine in ("free_body", "mujoco"):
        listed = run(short | NO_WALL | {"walls": [plane]}, engine=engine)
        assert papers.push.max() > 1.0
        assert np.abs(listed.p_WB - papers.p_WB).max() < 1e-6
        assert listed.force_peak[-1] == pytest.approx(papers.force_peak[-1], rel=2e-4)
        assert listed.wall_work[-1] == pytest.approx(papers.wall_work[-1], rel=2e-4)
        assert listed.touches[-1] == papers.touches[-1]
        np.testing.assert_allclose(listed.f_contacts_W.sum(axis=1), listed.f_contact_W, atol=1e-12)


def test_a_tilted_plane_is_an_upright_one_in_a_turned_world():
    """Wall, vehicle, current and reference turned about the vertical: flight, impact and rest turn with them."""
    yaw = 35.0
    R = rotation_matrix(quat_from_euler_deg(0.0, 0.0, yaw))
    base = {"simulation.duration": 4.0, "current.direction_deg": 120.0, "initial.position": [0.9, 0.0, 0.0]}
    turned = {
        "current.direction_deg": 120.0 + yaw,
        "initial.position": (R @ [0.9, 0.0, 0.0]).tolist(),
        "initial.attitude_deg": [0.0, 0.0, yaw],
        "reference.attitude_deg": [0.0, 0.0, yaw],
        "reference.target": (R @ [1.01, 0.0, 0.0]).tolist(),
        "reference.start": (R @ [0.9, 0.0, 0.0]).tolist(),
        "walls": [{"shape": "plane", "position": (R @ [1.0 + REACH, 0.0, 0.0]).tolist(), "attitude_deg": [0, 0, yaw]}],
    }
    plane = {"shape": "plane", "position": [1.0 + REACH, 0.0, 0.0]}
    upright = run(base | NO_WALL | {"reference.start": [0.9, 0.0, 0.0], "walls": [plane]})
    found = run(base | NO_WALL | turned)
    assert upright.push[-1] > 1.0
    np.testing.assert_allclose(found.p_WB, upright.p_WB @ R.T, atol=1e-9)
    np.testing.assert_allclose(found.push, upright.push, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("engine", "wall", "depth"),
    [
        ("free_body", {"shape": "plane", "position": [1.25, 0.1, 0.0], "attitude_deg": [0.0, 15.0, 20.0]}, None),
        ("free_body", {"shape": "cylinder", "position": [1.5, 0.2, 0.0], "radius": 0.3}, 0.3),
        ("free_body", {"shape": "sphere", "position": [1.5, 0.2, -0.1], "radius": 0.35}, 0.35),
        ("free_body", {"shape": "box", "position": [1.75, 0.0, 0.0], "edges": [1.0, 2.0, 2.0]}, None),
        ("free_body", {"shape": "capsule", "position": [1.5, 0.2, -0.3], "radius": 0.35, "length": 0.4}, 0.35),
        ("mujoco", {"shape": "sphere", "position": [1.5, 0.2, -0.1], "radius": 0.35}, 0.35),
    ],
)
def test_the_rest_at_a_wall_is_that_of_two_springs(engine, wall, depth):
    """With K_d = K I, the vehicle rests on the normal through the target: F = K d/(1 + K/k_c), d the target's depth."""
    target = np.array([1.06, 0.0, 0.0])
    overrides = {"walls": [wall | {"damping": 300.0}], "reference.target": target.tolist(), "simulation.duration": 16.0}
    trace = run(NO_WALL | ISOTROPIC | overrides, engine=engine)
    if wall["shape"] == "plane":
        n = -rotation_matrix(quat_from_euler_deg(0.0, 15.0, 20.0))[:, 0]
        depth = REACH - n @ (target - wall["position"])
    elif wall["shape"] == "box":
        n, depth = np.array([-1.0, 0.0, 0.0]), target[0] + REACH - 1.25
    else:
        out = (target - wall["position"]) * ([1.0, 1.0, 0.0] if wall["shape"] == "cylinder" else 1.0)
        out -= [0.0, 0.0, 0.5 * wall.get("length", 0.0)]  # the upper end of a capsule is the nearest
        n, depth = out / np.linalg.norm(out), depth + REACH - np.linalg.norm(out)
    force = K_X * depth / (1.0 + K_X / K_C)
    assert mean_push(trace) == pytest.approx(force, rel=1e-8)
    assert trace.analytic.force == pytest.approx(force, rel=1e-9)
    assert trace.f_contact_W[-1] == pytest.approx(force * n, abs=5e-6 * force)
    assert trace.p_WB[-1] == pytest.approx(target + force / K_X * n, abs=1e-8)


def test_an_impact_along_the_normal_is_the_same_on_a_plane_a_cylinder_and_a_sphere():
    """In still water the vehicle moves on the normal alone, and the closed-form distance is the same."""
    base = STILL | NO_WALL | {"simulation.duration": 4.0, "initial.position": [0.9, 0.0, 0.0]}
    face = 1.0 + REACH
    walls = [
        {"shape": "plane", "position": [face, 0.0, 0.0]},
        {"shape": "cylinder", "position": [face + 0.2, 0.0, 0.0], "radius": 0.2},
        {"shape": "sphere", "position": [face + 0.2, 0.0, 0.0], "radius": 0.2},
        {"shape": "box", "position": [face + 0.2, 0.0, 0.0], "edges": [0.4, 1.0, 1.0]},
    ]
    plane, *others = (run(base | {"walls": [wall]}) for wall in walls)
    assert plane.push.max() > 1.0
    for other in others:
        np.testing.assert_allclose(other.p_WB[:, 0], plane.p_WB[:, 0], atol=1e-10)
        assert other.force_peak[-1] == pytest.approx(plane.force_peak[-1], rel=1e-8)


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_a_wall_that_shakes_moves_the_vehicle_by_the_closed_form(slippery, engine):
    """M x'' = P - d x' - k (x - w) - b (x' - w'), w = a sin(2 pi f t): its response, exact for symplectic Euler."""
    k, b, d, a, f, h = 2e4, 150.0, 100.0, 1e-3, 0.8, 1e-4
    start = PUSH / k
    overrides = {
        "vehicle.model": str(slippery),
        "wall.present": False,
        "initial.position": [start, 0.0, 0.0],
        "simulation.duration": 6.0,
        "walls": [
            {
                "shape": "plane",
                "position": [REACH, 0.0, 0.0],
                "stiffness": k,
                "damping": b,
                "amplitude": [a, 0.0, 0.0],
                "frequency_hz": f,
            }
        ],
    }
    trace = run(STILL | overrides, Push(damping=d), log_rate="full", engine=engine)
    s = 2j * np.pi * f
    z = np.exp(s * h)
    # (z - 1) V = h/M (-d V - k (X - a) - b (V - s a)), (z - 1) X = h z V
    mobility = z * h / (z - 1.0)  # X / V
    V = (k * a + b * s * a) / (M[0] * (z - 1.0) / h + d + b + k * mobility)
    X = mobility * V
    late = trace.t > 4.0
    wave = np.exp(s * trace.t[late])
    assert np.abs(trace.p_WB[late, 0] - start - (X * wave).imag).max() < 1e-6 * abs(X)
    force = PUSH + ((k * (X - a) + b * (V - s * a)) * wave).imag
    assert np.abs(trace.push[late] - force).max() < 1e-5 * np.ptp(force)
    continuous = (k + b * s) * a / (M[0] * s * s + (d + b) * s + k)
    assert abs(X - continuous) < 1e-3 * abs(continuous)


def test_a_wall_that_retreats_takes_the_vehicle_along(slippery):
    """At a constant speed v: F = P - d v."""
    v, d = 0.02, 100.0
    wall = {"shape": "plane", "position": [REACH, 0.0, 0.0], "damping": 500.0}
    motion = [[1.0, 0.0, 0.0, 0.0], [9.0, 8.0 * v, 0.0, 0.0], [10.0, 8.0 * v, 0.0, 0.0]]
    overrides = {
        "vehicle.model": str(slippery),
        "initial.position": [PUSH / K_C, 0.0, 0.0],
        "simulation.duration": 8.9,
        "walls": [wall | {"motion": motion}],
    }
    trace = run(STILL | NO_WALL | overrides, Push(damping=d))
    assert trace.push[-1] == pytest.approx(PUSH - d * v, rel=1e-6)
    assert trace.nu[-1, 0] == pytest.approx(v, rel=1e-6)
    assert isinstance(trace.analytic, NoClosedForm)


def test_a_layered_wall_at_rest():
    """K_x (x_d - x) = k w_1 + k_1 (x - x_c - w_1)."""
    k, w_1, k_1 = 2e2, 5e-3, 1e4
    wall = {"shape": "plane", "position": [1.0 + REACH, 0, 0], "stiffness": k, "layer_depth": w_1}
    overrides = {"reference.target": [1.05, 0, 0], "walls": [wall | {"layer_stiffness": k_1, "damping": 100.0}]}
    trace = run(NO_WALL | overrides | {"simulation.duration": 16.0})
    depth = (K_X * 0.05 - k * w_1 + k_1 * w_1) / (K_X + k_1)
    assert depth > w_1
    force = k * w_1 + k_1 * (depth - w_1)
    assert trace.contact_depths[-1, 0] == pytest.approx(depth, rel=1e-6)
    assert trace.push[-1] == pytest.approx(force, rel=1e-6)
    assert trace.analytic.force == pytest.approx(force, rel=1e-9)


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
@pytest.mark.parametrize("damping", [0.0, 100.0])
def test_a_bumper_is_in_series_with_the_papers_wall(engine, damping):
    overrides = {"bumper.stiffness": 2e3, "bumper.damping": damping, "reference.target": [1.05, 0.0, 0.0]}
    trace = run(overrides | {"simulation.duration": 16.0}, engine=engine)
    force = K_X * 0.05 / (1.0 + K_X * (1.0 / 2e3 + 1.0 / K_C))
    assert mean_push(trace) == pytest.approx(force, rel=1e-8)
    assert trace.analytic.force == pytest.approx(force, rel=1e-9)
    assert demanded_force(trace.scenario) == pytest.approx(force, rel=1e-12)


def test_a_bumper_in_front_of_a_stiff_wall_lets_a_slow_law_hold():
    """100 Hz, ideal thrusters and sensors, retuned: 1.39536 N at 2e3 N/m, with a bumper as with so soft a wall."""
    gains = {"controller.k_1": 1.0, "controller.k_2": 1.0, "controller.beta": 2.0, "task.A": -20.0}
    base = gains | {"controller.period": 0.01, "simulation.duration": 30.0}
    soft = run(base | {"wall.stiffness": 2e3})
    bumper = run(base | {"bumper.stiffness": 1.0 / (1.0 / 2e3 - 1.0 / K_C)})
    for trace in (soft, bumper):
        assert mean_push(trace) == pytest.approx(1.5 / (1.0 + K_X / 2e3), rel=1e-5)
        assert trace.analytic.force == pytest.approx(1.5 / (1.0 + K_X / 2e3), rel=1e-9)
    with pytest.warns(SamplingWarning, match="limit-cycles against the wall"):
        run(base | {"simulation.duration": 0.01})


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_three_contact_points_rest_at_the_static_balance(engine):
    """Forces and moments on a tilted plane: the springs of depths measured by hand hold K_d eta_e, eq. (7)."""
    position, attitude, k = np.array([1.29, 0.0, 0.0]), (0.0, 0.4, 0.6), 2e3
    wall = {"shape": "plane", "position": position.tolist(), "attitude_deg": attitude, "stiffness": k, "damping": 200.0}
    overrides = {"walls": [wall], "vehicle.contact_bodies": THREE, "reference.target": [1.05, 0.0, 0.0]}
    overrides |= {"controller.name": "ideal"}
    trace = run(NO_WALL | overrides | {"simulation.duration": 18.0}, engine=engine)
    n, p, R = -rotation_matrix(quat_from_euler_deg(*attitude))[:, 0], trace.p_WB[-1], rotation_matrix(trace.quat_WB[-1])
    wrench, forces = np.zeros(6), []
    for body in THREE:
        centre = p + R @ body["position"]
        depth = body["radius"] - n @ (centre - position)
        f = k * depth * n
        arm = centre - (body["radius"] - 0.5 * depth) * n - p
        wrench += np.r_[R.T @ f, R.T @ np.cross(arm, f)]
        forces.append(f)
    forces = np.array(forces)
    assert (np.linalg.norm(forces, axis=1) > 0.5).all(), "all three touch"
    size = np.linalg.norm(wrench[:3])
    assert trace.f_contacts_W[-1] == pytest.approx(forces, abs=1e-6 * size)
    assert trace.tau_contacts_B[-1] == pytest.approx(wrench, abs=1e-6 * size)
    assert np.abs(wrench[3:]).max() > 0.05
    K_d = np.array(trace.scenario.impedance.K_d)
    assert K_d * trace.eta_e[-1] == pytest.approx(wrench, abs=1e-6 * size)
    assert trace.analytic.force == pytest.approx(trace.push[-1], rel=1e-6)
    assert trace.analytic.position == pytest.approx(p, abs=1e-7)
    assert trace.analytic.quat == pytest.approx(trace.quat_WB[-1], abs=1e-7)


def test_a_capsule_rests_like_the_two_spheres_at_its_ends():
    capsule = {"position": [0.3, 0.2, 0.0], "end": [0.3, -0.2, 0.0], "radius": 0.03, "stiffness": 2e4, "damping": 50.0}
    spheres = [capsule | {"position": capsule[key]} for key in ("position", "end")]
    for sphere in spheres:
        del sphere["end"]
    plane = {"shape": "plane", "position": [1.35, 0, 0], "attitude_deg": [0, 0, 4.0]}
    base = NO_WALL | {"walls": [plane], "reference.target": [1.05, 0, 0]}
    base |= {"simulation.duration": 3.0, "initial.position": [1.0, 0.0, 0.0]}
    one, two = (run(base | {"vehicle.contact_bodies": bodies}) for bodies in ([capsule], spheres))
    assert one.push[-1] > 1.0
    np.testing.assert_array_equal(one.p_WB, two.p_WB)


@pytest.mark.parametrize("bumper", [{}, {"bumper.stiffness": 5e3}])
def test_the_papers_wall_is_the_first_of_one_list(bumper):
    """Its contact is the engine's unless a bumper is in front of it; the probe touches every other wall by springs."""
    walls = [{"shape": "sphere", "position": [1.5, 0.2, -0.1], "radius": 0.3}]
    contacts = set_up(Scenario.load("push_wall", bumper | {"walls": walls, "wall.position": 1.1})).contacts
    assert [key for key, _ in contacts.walls] == ["wall", "walls[0]"]
    assert [pair.wall_key for pair in contacts.pairs] == ["wall", "walls[0]"]
    assert [pair.solved for pair in contacts.pairs] == [not bumper, False]
    assert [pair.wall_key for pair in contacts.springs] == (["wall"] if bumper else []) + ["walls[0]"]
    surfaces, pairs = (each.view(np.recarray) for each in contacts.records(lambda _: 1.0))
    assert pairs.surface.tolist() == [0, 1]
    assert pairs.solved.tolist() == [not bumper, 0]
    assert surfaces.p_WS[:, 0] == pytest.approx([1.1 + REACH, 1.5])


def test_reset_moves_walls_and_changes_bumpers_but_neither_number_nor_shape_of_contacts():
    base = {"walls": [{"shape": "plane", "position": [1.1 + REACH, 0, 0]}], "wall.present": False}
    start = {"initial.position": [1.1001, 0.0, 0.0], "reference.target": [1.2, 0, 0], "reference.step_time": 0.0}

    def fresh(overrides: dict) -> np.ndarray:
        with Simulation(Scenario.load("push_wall", base | start | overrides), **FREE) as sim:
            sim.step(3000)
            return sim.signals.p_WB.copy()

    changed = {
        "walls": [
            base["walls"][0] | {"stiffness": 1e3, "amplitude": [0.01, 0, 0], "frequency_hz": 3.0, "friction": 0.2}
        ]
    }
    with Simulation(Scenario.load("push_wall", base | start), **FREE) as sim:
        for overrides in ({}, changed, {"bumper.stiffness": 500.0, "bumper.damping": 20.0}, {}, changed):
            sim.reset(overrides=overrides)
            sim.step(3000)
            assert sim.signals.force_peak > 0.0
            np.testing.assert_array_equal(sim.signals.p_WB, fresh(overrides))
        sphere = {"shape": "sphere", "position": [1.5, 0, 0], "radius": 0.1}
        for key, value in (("walls", []), ("walls", [sphere]), ("wall.present", True)):
            with pytest.raises(InputError, match=rf"^reset: {key}: reset can't change which contacts there are"):
                sim.reset({key: value})
        sim.set({"walls": changed["walls"]})
        sim.step(10)


def test_a_start_inside_a_wall_is_noted_and_a_wall_can_be_changed_by_key():
    wall = {"shape": "sphere", "position": [0.3 + REACH, 0, 0], "radius": 0.35, "stiffness": 1.0}
    scenario = Scenario.load("push_wall", {"walls": [wall], "simulation.duration": 1e-3})
    with pytest.warns(SamplingWarning, match=r"the probe starts 0.05 m inside walls\[0\], which .* 500 N"):
        simulate(scenario.updated({"walls[0].stiffness": 1e4}), **FREE)


def test_a_key_of_a_wall_that_is_not_there_does_not_pass_in_silence():
    """As an override it is an error; in a file, or beside an override that takes the wall away, it is noted."""
    named = r"wall\.stiffness: has no effect: wall\.present is false"
    no_wall = Scenario.load("press_pile")
    assert not any("wall.present" in note for note in warnings_of(set_up(no_wall)))
    for refused in (no_wall.updated, lambda overrides: Scenario.load("press_pile", overrides)):
        with pytest.raises(InputError, match=named):
            refused({"wall.stiffness": 2e4})
    with Simulation(no_wall, **FREE) as sim:
        for change in (sim.set, lambda overrides: sim.reset(overrides=overrides)):
            with pytest.raises(InputError, match=named):
                change({"wall.stiffness": 2e4})
    for scenario in (
        Scenario.from_dict({"wall": {"present": False, "stiffness": 2e4, "friction": 0.1}}),
        Scenario.load("push_wall", {"wall.present": False, "wall.stiffness": 2e4, "wall.friction": 0.1}),
    ):
        notes = [note for note in warnings_of(set_up(scenario)) if "wall." in note]
        assert notes == ["wall.stiffness, wall.friction have no effect: wall.present is false"]


def test_a_key_of_a_bumper_without_any_wall_does_not_pass_in_silence():
    """As those of a wall that is not there. With one of [[walls]] the bumper acts."""
    named = r"bumper\.stiffness: has no effect: there is no wall; set wall\.present to true, or give walls"
    open_water = Scenario.from_dict({"wall": {"present": False}})
    with pytest.raises(InputError, match=named):
        open_water.updated({"bumper.stiffness": 2e3})
    with Simulation(open_water, **FREE) as sim:
        for change in (sim.set, sim.reset):
            with pytest.raises(InputError, match=named):
                change({"bumper.stiffness": 2e3})
    both = {"bumper.stiffness": 2e3, "bumper.damping": 1.0}
    beside = [open_water.updated(both | taken) for taken in ({"wall.present": False}, {"walls": []})]
    for scenario in (*beside, Scenario.from_dict({"wall": {"present": False}, "bumper": {"stiffness": 2e3}})):
        (note,) = [note for note in warnings_of(set_up(scenario)) if "bumper" in note]
        keys = "bumper.stiffness, bumper.damping have" if scenario.bumper.damping else "bumper.stiffness has"
        assert note == f"{keys} no effect: there is no wall"
    walls = {"walls": [{"shape": "plane", "position": [2.0, 0.0, 0.0]}]}
    for scenario in (open_water.updated(walls), open_water.updated({"wall.present": True})):
        assert not any("bumper" in note for note in warnings_of(set_up(scenario.updated(both))))


def test_no_force_is_demanded_along_several_normals():
    wall = {"shape": "plane", "position": [1.5, 0.0, 0.0]}
    body = {"position": [0.0, 0.0, 0.0], "radius": 0.05}
    for other in ({"walls": [wall]}, {"vehicle.contact_bodies": [body]}):
        trace = run({"simulation.duration": 0.01, **other})
        assert np.isnan(demanded_force(trace.scenario))
        assert NUMBERS["force_error_N"].of(trace) is None
        assert "expected" not in dict(expected_forces(trace))
        with pytest.raises(InputError, match=r"^push: force_d: .* without it, the scenario"):
            push.Push(trace.scenario)
        push.Push(trace.scenario, force_d=1.5)
    assert "expected" in dict(expected_forces(run({"simulation.duration": 0.01})))


@pytest.mark.parametrize("shape", SHAPES)
def test_a_log_has_walls_of_every_shape(shape, tmp_path):
    size = {key: [0.4, 0.4, 0.4] if key == "edges" else 0.3 for key in SHAPES[shape].keys}
    over = {"walls": [{"shape": shape, "position": [2.0, 0.0, 0.0]} | size], "simulation.duration": 0.01}
    trace = simulate(Scenario.load("push_wall", over), engine="free_body", sinks=[McapLog(tmp_path / "run.mcap")])
    loaded = Trace.load(tmp_path / "run.mcap")
    assert loaded.header.scenario.walls == trace.header.scenario.walls
    assert np.array_equal(loaded.p_WB, trace.p_WB)
