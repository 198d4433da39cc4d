"""The vehicles that ship: numbers of their sources, thrusters, drift between variants, and free motion."""

import re

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from twin import TwinParameters, matrix_acceleration, rotation
from uvms_mj import Current, Scenario, attach, simulate
from uvms_mj.files import shipped
from uvms_mj.plant.dissipation import damping_notes
from uvms_mj.plant.mjcf import Mjcf

VEHICLES = sorted(shipped("models"))
G = 9.81


@pytest.mark.parametrize("name", VEHICLES)
def test_a_shipped_file_has_nothing_that_a_user_s_must_not_have(name):
    """A run by the vehicle's name does not check it again."""
    found = Mjcf.find(name)
    assert found.ships
    assert Mjcf(found.name, found.files).vehicle.mass == found.vehicle.mass


def matrix(diagonal, **entries: float) -> np.ndarray:
    """A matrix (6, 6) from its diagonal and entries such as ``_26``, counted from one."""
    full = np.diag(np.array(diagonal, float))
    for name, value in entries.items():
        full[int(name[1]) - 1, int(name[2]) - 1] = value
    return full


SOURCES = {
    "bluerov1": TwinParameters(),
    "bluerov2": TwinParameters(mass=11.5, buoyancy=114.8, r_g=(0, 0, -0.02)),  # the rest is Sandoy's, as in bluerov1
    "bluerov2_kth": TwinParameters(
        mass=11.4,
        buoyancy=1026 * 0.0115 * G,
        r_g=(0, 0, -0.02),
        inertia=np.diag([0.21 + 11.4 * 0.02**2, 0.245 + 11.4 * 0.02**2, 0.245]),
        M_A=matrix([2.6, 18.5, 13.3, 0.054, 0.0173, 0.28]),
        D_linear=matrix([0.09, 0.26, 0.19, 0.895, 0.287, 4.64]),
        D_quadratic=matrix([34.96, 103.25, 74.23, 0.084, 0.028, 0.43]),
    ),
    "bluerov2_heavy": TwinParameters(
        mass=13.5,
        buoyancy=13.4 * G,
        r_g=(0, 0, 0),
        r_b=(0, 0, 0.01),
        inertia=np.diag([0.26, 0.23, 0.37]),
        M_A=matrix([6.36, 7.12, 18.68, 0.189, 0.135, 0.222]),
        D_linear=matrix([13.7, 0, 33, 0, 0.8, 0]),
        D_quadratic=matrix([141, 217, 190, 1.19, 0.47, 1.5]),
    ),
    "bluerov2_heavy_tuhh": TwinParameters(
        mass=14.5,
        buoyancy=14.45 * G,
        r_g=(0, 0, 0),
        r_b=(0.006, 0, 0.031),
        inertia=np.diag([0.25, 0.25, 0.4]),
        M_A=matrix([10, 14, 18, 0.15, 0.15, 0.2]),
        D_linear=matrix([10, 12, 15, 0.5, 0.5, 0.5]),
        D_quadratic=matrix([40, 40, 80, 1, 1, 1.5]),
    ),
    "lauv": TwinParameters(
        mass=18,
        buoyancy=0.017551375 * 1028 * G,
        r_g=(0, 0, 0),
        r_b=(0, 0, 0.01),
        inertia=18 * np.diag([0.075**2 / 2, *[(3 * 0.075**2 + 1.08**2) / 12] * 2]),
        M_A=matrix([1, 16, 16, 0.005, 1.3, 1.3]),
        D_linear=matrix([2.4, 23, 23, 0.3, 9.7, 9.7], _26=-11.5, _35=11.5, _53=-3.1, _62=3.1),
        D_quadratic=matrix([2.4, 80, 80, 0.0006, 9.1, 9.1], _26=-0.3, _35=0.3, _53=-1.5, _62=1.5),
    ),
}
"""The numbers of the sources, typed here once more; z is up."""


WITH_JOINTS = [name for name in VEHICLES if Mjcf.find(name).vehicle.arm.links]


def test_every_rigid_vehicle_has_its_numbers_here():
    assert sorted([*SOURCES, *WITH_JOINTS]) == VEHICLES


@pytest.mark.parametrize("name", VEHICLES)
def test_a_file_says_where_its_numbers_come_from(name):
    remarks = Mjcf.find(name).remarks
    assert set(remarks) == {"description", "source", "licence", "trust"}
    assert all(remarks.values())
    assert re.match("high|medium|low", remarks["trust"])


@pytest.mark.parametrize("name", VEHICLES)
def test_added_mass_is_symmetric_and_damping_dissipates(name):
    vehicle = Mjcf.find(name).vehicle
    assert np.array_equal(vehicle.M_A, vehicle.M_A.T)
    assert np.linalg.eigvalsh(vehicle.M_A)[0] > 0.0
    assert np.allclose(vehicle.M_RB, vehicle.M_RB.T, atol=1e-15)
    assert damping_notes(name, vehicle.D_linear, vehicle.D_quadratic) == []


def model_of(name: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(shipped("models")[name]))


def state_after(
    model: mujoco.MjModel, start: np.ndarray, current: tuple[float, ...], duration: float, h: float
) -> np.ndarray:
    """p, quat and nu of a freely moving vehicle in MuJoCo."""
    model.opt.timestep, model.opt.integrator = h, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    R_WB = rotation(start[3:7])
    data.qpos[:], data.qvel[:3], data.qvel[3:] = start[:7], R_WB @ start[7:10], start[10:]
    with attach(model, data, current=Current.of(current)):
        mujoco.mj_step(model, data, round(duration / h))
    return np.concatenate([data.qpos, rotation(data.qpos[3:7]).T @ data.qvel[:3], data.qvel[3:]])


@pytest.mark.slow
@pytest.mark.parametrize("name", SOURCES)
def test_free_motion_is_that_of_fossens_equations(name):
    """Against SciPy on the numbers of the source, cross damping, weight, buoyancy and current included."""
    current, duration = (0.2, -0.3, 0.1), 2.0
    parameters = TwinParameters(**(vars(SOURCES[name]) | {"v_c_W": current}))
    quat = np.array([0.9, 0.2, -0.3, 0.1])
    start = np.array([0.1, 0.2, 0.3, *quat / np.linalg.norm(quat), 0.5, 0.3, -0.2, 0.2, 0.4, -0.6])

    def derivative(t, y):
        w, x, y_, z = y[3:7]
        p, q, r = y[10:]
        quat_dot = 0.5 * np.array(
            [-x * p - y_ * q - z * r, w * p + y_ * r - z * q, w * q + z * p - x * r, w * r + x * q - y_ * p]
        )
        nu_dot = matrix_acceleration(parameters, y[:3], y[3:7], y[7:], np.zeros(6), t)
        return np.concatenate([rotation(y[3:7]) @ y[7:10], quat_dot, nu_dot])

    expected = solve_ivp(derivative, (0.0, duration), start, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    coarse, fine = (state_after(model_of(name), start, current, duration, h) for h in (1e-3, 5e-4))
    assert np.abs(fine - expected).max() < 2e-5
    # MuJoCo's RK4 is of order 2 with rotation
    assert (4.0 * fine - coarse) / 3.0 == pytest.approx(expected, abs=2e-8)


def test_cross_damping_of_the_lauv_against_the_closed_form():
    """Slow sway and yaw are linear: M nu_dot = -D nu, so that nu(t) = exp(-M^-1 D t) nu(0)."""
    source, axes, duration = SOURCES["lauv"], [1, 5], 2.0
    slow = 1e-7 * np.array([2.0, -3.0])
    start = np.array([0, 0, 0, 1, 0, 0, 0, 0, slow[0], 0, 0, 0, slow[1]], float)
    model = model_of("lauv")
    model.numeric("displaced_mass").data[0] = 18.0  # so that it does not rise
    end = state_after(model, start, (0.0, 0.0, 0.0), duration, 1e-3)
    M = np.diag([18 + 16, source.inertia[2, 2] + 1.3])
    expected = expm(-np.linalg.solve(M, source.D_linear[np.ix_(axes, axes)]) * duration) @ slow
    assert end[[8, 12]] == pytest.approx(expected, rel=1e-5)
    uncoupled = np.exp(-np.diag(source.D_linear)[axes] / np.diag(M) * duration) * slow
    assert np.abs(uncoupled / expected - 1.0).min() > 0.1  # the cross terms matter


def test_the_thrusters_of_the_heavy_are_those_of_its_source():
    """The source has x forward, y right, z down; von Benzon et al. (2022)."""
    horizontal = [(0.156, 0.111, -45), (0.156, -0.111, 45), (-0.156, 0.111, 225), (-0.156, -0.111, 135)]
    arms = [(x, y, 0.085) for x, y, _ in horizontal]
    arms += [(0.12, 0.218, 0), (0.12, -0.218, 0), (-0.12, 0.218, 0), (-0.12, -0.218, 0)]
    angles = np.radians([angle for *_, angle in horizontal])
    directions = [(np.cos(a), np.sin(a), 0) for a in angles] + [(0, 0, -1), (0, 0, 1), (0, 0, 1), (0, 0, -1)]
    B_down = np.array([[*e, *np.cross(r, e)] for r, e in zip(arms, directions, strict=True)]).T
    turn = np.array([1, -1, -1])  # half a turn about x
    for name in ("bluerov2_heavy", "bluerov2_heavy_tuhh"):
        vehicle = Mjcf.find(name).vehicle
        assert np.allclose(vehicle.B, np.array([*turn, *turn])[:, None] * B_down, atol=1e-12)
        assert np.linalg.matrix_rank(vehicle.B) == 6
        assert set(vehicle.u_min) == {-39.9}
        assert set(vehicle.u_max) == {51.5}


@pytest.mark.parametrize(("name", "axes"), [("bluerov2", 5), ("bluerov2_kth", 5), ("lauv", 1), ("bluerov1", 6)])
def test_thrusters_span_the_axes_that_they_are_said_to(name, axes):
    vehicle = Mjcf.find(name).vehicle
    assert np.linalg.matrix_rank(vehicle.B) == axes
    if name.startswith("bluerov2"):
        assert np.abs(vehicle.B[4]).max() < 1e-15  # none pitches
        assert vehicle.B[:, 4:] == pytest.approx(np.array([[0, 0, 1, -0.109, 0, 0], [0, 0, 1, 0.109, 0, 0]]).T)


@pytest.mark.parametrize(("name", "variant"), [("bluerov2", "bluerov2_kth"), ("bluerov2_heavy", "bluerov2_heavy_tuhh")])
def test_variants_of_a_frame_have_its_geoms_and_thrusters(name, variant):
    frame, other = Mjcf.find(name), Mjcf.find(variant)
    assert frame.geometry.to_json() == other.geometry.to_json()
    assert frame.vehicle.thrusters == other.vehicle.thrusters
    for array in ("B", "u_min", "u_max", "thrust_of_ctrl"):
        assert np.array_equal(getattr(frame.vehicle, array), getattr(other.vehicle, array))


def test_both_frames_of_the_bluerov2_have_one_hull():
    """It is written twice, so that each file is complete by itself."""
    hulls = []
    for name, pose in (("bluerov2", "0 0 0"), ("bluerov2_heavy", "0 0 -.085")):
        text = shipped("models")[name].read_text()
        _, hull = text.split("<!-- Hull:")
        hull, _ = hull.split("<!-- fairings")
        assert f'<frame pos="{pose}">' in hull
        hulls.append(hull.replace(f'<frame pos="{pose}">', ""))
    assert hulls[0] == hulls[1]
    assert hulls[0].count("<geom") > 25


@pytest.mark.parametrize("name", VEHICLES)
def test_the_front_is_where_the_file_says(name):
    said = re.search(r"Foremost point: [^\d-]*?\(?(?:x = )?(0\.\d+)", shipped("models")[name].read_text())
    assert said is not None
    assert Mjcf.find(name).geometry.reach == pytest.approx(float(said[1]), abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "engine"),
    [("bluerov2_heavy", "free_body"), ("bluerov2_heavy", "mujoco"), ("bluerov2_heavy_tuhh", "free_body")],
)
def test_a_heavy_rests_on_the_wall_with_the_force_of_the_springs(name, engine):
    """K_x (x_d - x) = k_c (x - x_c), with the integral of GSTA against weight and buoyancy that are known."""
    trace = simulate(Scenario.load("push_wall", {"vehicle.model": name}), engine=engine)
    assert trace.push[-1] == pytest.approx(150.0 * 0.01 / (1.0 + 150.0 / 1e5), rel=1e-6)
    assert trace.p_WB[-1, 0] == pytest.approx(1.0 + trace.push[-1] / 1e5, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "spans"),
    [
        ("bluerov2", "the 6 thrusters of bluerov2 span 5 of 6 axes, none gives pitch: "),
        ("lauv", "the thruster of lauv spans 1 of 6 axes, none gives sway or heave or roll or pitch or yaw: "),
    ],
)
def test_a_run_says_which_wrenches_a_vehicle_cannot_produce(name, spans):
    overrides = {"vehicle.model": name, "simulation.duration": 0.01}
    with pytest.warns(UserWarning, match=spans):
        simulate(Scenario.load("push_wall", overrides), engine="free_body")
