"""The first sea trial of a vehicle: its formulas against motions, and the errors that it shows."""

import dataclasses
import itertools
import json
import math

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from uvms_mj import attach
from uvms_mj.files import shipped
from uvms_mj.physics.frames import body_acceleration, rotation_matrix
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.plant.sea_trial import GRAVITY, as_numbers, decay, terminal, trial

HEAVY = shipped("models")["bluerov2_heavy"].read_text()


def edited(tmp_path, *pairs):
    text = HEAVY
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "edited.xml").write_text(text)
    return Mjcf.find(str(tmp_path / "edited.xml")).vehicle


@pytest.mark.parametrize(("D", "Q"), [(2.0, 3.0), (0.0, 3.0), (2.0, 0.0)])
def test_decay_and_terminal_speed_are_those_of_the_motion(D, Q):
    """By SciPy's solver, M dv/dt = t - D v - Q v abs(v)."""
    M, thrust = 7.0, 40.0
    down = solve_ivp(
        lambda t, v: -(D * v + Q * v * abs(v)) / M, (0, decay(M, D, Q, 1.0, 0.5)), [1.0], rtol=1e-10, atol=1e-12
    )
    assert down.y[0, -1] == pytest.approx(0.5, rel=1e-7)
    v = terminal(D, Q, thrust)
    assert D * v + Q * v**2 == pytest.approx(thrust, rel=1e-12)


def test_without_damping_nothing_ends():
    assert decay(1.0, 0.0, 0.0, 1.0, 0.5) == math.inf
    assert terminal(0.0, 0.0, 1.0) == math.inf
    assert terminal(0.0, 0.0, 0.0) == terminal(1.0, 0.0, 0.0) == 0.0


def test_the_reach_is_the_best_corner_of_the_limits():
    """No thrust within the limits gives more in surge with nothing in the other axes: random thrusts in the null space
    of the others, scaled to the limits, reach at most it, and it is produced."""
    vehicle = Mjcf.find("bluerov2_heavy").vehicle
    rng = np.random.default_rng(1)
    for i, axis in enumerate(trial(vehicle).axes):
        others = np.delete(vehicle.B, i, axis=0)
        null = np.linalg.svd(others)[2][np.linalg.matrix_rank(others) :]
        best = 0.0
        for _ in range(300):
            u = rng.normal(size=len(null)) @ null
            u *= min(
                (vehicle.u_max[u > 0] / u[u > 0]).min(initial=np.inf),
                (vehicle.u_min[u < 0] / u[u < 0]).min(initial=np.inf),
            )
            best = max(best, float(vehicle.B[i] @ u))
        assert 0.8 * axis.thrust[1] < best <= axis.thrust[1] * (1.0 + 1e-9)


def test_an_axis_that_the_thrusters_do_not_have_is_not_there():
    axes = {axis.name: axis.thrust for axis in trial(Mjcf.find("lauv").vehicle).axes}
    assert axes["surge"] is not None
    assert [name for name, thrust in axes.items() if thrust is None] == ["sway", "heave", "roll", "pitch", "yaw"]


def test_a_thruster_that_is_turned_by_a_rounding_takes_no_force_away():
    """A BlueROV2 has no pitch. Turned by 1e-8 to 1e-4 rad, as by angles of a file, they give what they gave."""
    vehicle = Mjcf.find("bluerov2").vehicle
    exact = {axis.name: axis.thrust for axis in trial(vehicle).axes}
    assert [name for name, thrust in exact.items() if thrust is None] == ["pitch"]
    rng = np.random.default_rng(4)
    for angle in (1e-8, 1e-6, 1e-4):
        B = vehicle.B + angle * rng.uniform(-1.0, 1.0, vehicle.B.shape)
        for axis in trial(dataclasses.replace(vehicle, B=B)).axes:
            if axis.name == "pitch":
                assert axis.thrust is None
            else:
                np.testing.assert_allclose(axis.thrust, exact[axis.name], rtol=30.0 * angle)


def accelerations(name):
    """nu_dot of a shipped vehicle at quat and nu, in MuJoCo with our water."""
    model = mujoco.MjModel.from_xml_path(str(shipped("models")[name]))
    data = mujoco.MjData(model)

    def nu_dot(quat, nu):
        R = rotation_matrix(quat)
        data.qpos[3:7], data.qvel[:3], data.qvel[3:6] = quat, R @ nu[:3], nu[3:]
        mujoco.mj_forward(model, data)
        out = np.empty(6)
        body_acceleration(R, data.qacc, nu, out)
        return out

    return model, data, nu_dot


def turned(axis, angle):
    return np.array([math.cos(angle / 2), *(math.sin(angle / 2) * np.eye(3)[axis])])


@pytest.mark.parametrize("name", ["bluerov2_heavy", "lauv", "bluerov1"])
def test_the_growth_is_that_of_mujocos_accelerations(name):
    """Eigenvalues of finite differences of the accelerations about straight motion: v w p q r and small angles."""
    model, data, nu_dot = accelerations(name)
    found = trial(Mjcf.find(name).vehicle)
    h = 1e-5
    with attach(model, data):
        for speed, growth in found.growth.items():
            level, ahead = np.array([1.0, 0, 0, 0]), np.array([speed, 0, 0, 0, 0, 0])
            J = [(nu_dot(level, ahead + h * e) - nu_dot(level, ahead - h * e)) / (2 * h) for e in np.eye(6)]
            K = [(nu_dot(turned(i, h), ahead) - nu_dot(turned(i, -h), ahead)) / (2 * h) for i in range(3)]
            A = np.zeros((8, 8))
            A[:5, :5], A[:5, 5:] = np.array(J).T[1:, 1:], np.array(K).T[1:]
            A[5:, 2:5] = np.eye(3)
            expected = np.linalg.eigvals(A).real.max()
            assert growth == pytest.approx(expected, abs=2e-3 + 0.02 * abs(expected))


def test_the_periods_are_those_of_a_pendulum():
    """Without damping in roll, the BlueROV2 Heavy swings with sqrt(g |d| / M_44)."""
    vehicle = Mjcf.find("bluerov2_heavy").vehicle
    arm = 13.4 * 0.01  # m_d z_b, with the centre of gravity in the origin
    M = vehicle.M[3, 3] - vehicle.M[3, 1] ** 2 / vehicle.M[1, 1]
    expected = 2 * math.pi * math.sqrt(M / (GRAVITY * arm))
    assert min(abs(period - expected) for period, _ in trial(vehicle).periods) < 1e-6


def test_the_trim_is_where_nothing_turns_it(tmp_path):
    """Released at the attitude that is announced, the vehicle has no angular acceleration; elsewhere it has."""
    vehicle = edited(
        tmp_path, ('name="center_of_buoyancy" data="0 0 0.01"', 'name="center_of_buoyancy" data="0.004 -0.003 0.01"')
    )
    found = trial(vehicle)
    roll, pitch = np.radians([found.roll, found.pitch])
    R = np.array([[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0], [-math.sin(pitch), 0, math.cos(pitch)]])
    R = R @ [[1, 0, 0], [0, math.cos(roll), -math.sin(roll)], [0, math.sin(roll), math.cos(roll)]]
    up = R.T @ [0, 0, 1]
    d = vehicle.displaced_mass * vehicle.r_b - vehicle.mass * vehicle.r_g
    np.testing.assert_allclose(np.cross(d, up), 0.0, atol=1e-12)
    assert d @ up > 0.0
    assert abs(found.pitch) > 10.0


WRONG = {
    "z down": (('data="0 0 0.01"', 'data="0 0 -0.01"'), "upside down"),
    "grams": (('name="displaced_mass" data="13.4"', 'name="displaced_mass" data="13400"'), "rises with"),
    "pounds": (('name="displaced_mass" data="13.4"', 'name="displaced_mass" data="6.1"'), "sinks with"),
    "no drag": (('name="Y_vv" data="-217"', 'name="Y_vv" data="0"'), "nothing damps sway"),
    "no added mass": (('name="X_udot" data="-6.36"', 'name="X_udot" data="0"'), "no added mass in surge"),
    "moments of inertia": (('diaginertia="0.26 0.23 0.37"', 'diaginertia="260 230 370"'), "radius of gyration in roll"),
    "kg cm^2": (('name="N_rdot" data="-0.222"', 'name="N_rdot" data="-22.2"'), "added mass in yaw"),
    "km/h": (('name="X_uu" data="-141"', 'name="X_uu" data="-1827"'), "drag in surge"),
    "no limits": (('ctrlrange="-39.9 51.5"', 'ctrllimited="false"'), "have no limit"),
    "one point": (('data="0 0 0.01"', 'data="0 0 0"'), "no moment rights it"),
    "a sign of a cross term": (
        ('name="K_p" data="0"', 'name="K_p" data="0"/><numeric name="N_v" data="60"'),
        "feed energy in",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_sign_or_unit_is_worth_a_look(tmp_path, case):
    pair, said = WRONG[case]
    remarks = trial(edited(tmp_path, pair)).remarks
    assert any(said in each for each in remarks), remarks
    assert not any(said in each for each in trial(edited(tmp_path)).remarks)


@pytest.mark.parametrize("name", shipped("models"))
def test_shipped_vehicles_are_not_unusual_and_their_numbers_are_json(name):
    found = trial(Mjcf.find(name).vehicle)
    assert not any(each.unusual for each in found.compared)
    json.dumps(as_numbers(found), allow_nan=False)


def test_other_vehicles_are_scaled_to_the_size_by_dimensional_analysis():
    """A vehicle that is k times as long, with the same density, form and Froude number: the shipped vehicles beside it
    grow by the same powers of k as its own numbers, so that nothing becomes unusual."""
    k = 2.0
    small = Mjcf.find("bluerov2_heavy").vehicle
    H = np.array([1.0] * 3 + [k] * 3)
    large = dataclasses.replace(
        small,
        M_RB=k**3 * H[:, None] * small.M_RB * H,
        M_A=k**3 * H[:, None] * small.M_A * H,
        D_linear=k**2 * H[:, None] * small.D_linear * H,
        D_quadratic=k**2 * H[:, None] * small.D_quadratic * H**2,
        displaced_mass=k**3 * small.displaced_mass,
        r_b=k * small.r_b,
    )
    powers = {"kg": 3, "kg m^2": 5, "N": 2, "N m": 3, "m": 1, "1": 0}
    for here, there in zip(trial(small).compared, trial(large).compared, strict=True):
        grown = k ** powers[here.unit]
        assert there.unit == here.unit
        np.testing.assert_allclose(
            [there.value, there.low, there.high], grown * np.array([here.value, here.low, here.high]), rtol=1e-9
        )
        assert not there.unusual


def test_the_command_prints_tables_and_writes_a_page(here, tmp_path):
    done = here("vehicles", "bluerov2_heavy", "--check", "--out", "trial")
    assert done.exit_code == 0, done.stderr
    for word in ("righting arm", "straight ahead", "surge", "Worth a look", "Munk"):
        assert word in done.stdout
    html = (tmp_path / "trial" / "report.html").read_text()
    assert "<svg" in html or "data:image/svg" in html
    assert "Munk" in html
    numbers = json.loads(here("vehicles", "lauv", "bluerov1", "--check", "--json").stdout)
    assert [*numbers] == ["lauv", "bluerov1"]
    assert len(numbers["lauv"]["axes"]) == 6
    for words, said in (
        (("vehicles", "--check"), "name a vehicle"),
        (("vehicles", "lauv", "--out", "x"), "is for --check"),
        (("vehicles", "lauv", "--check", "--json", "--out", "x"), "of one vehicle"),
        (("vehicles", "lauv", "--check", "--out", "trial"), "exists"),
    ):
        refused = here(*words)
        assert refused.exit_code == 2
        assert said in refused.stderr


def test_links_count_where_they_are(tmp_path):
    """Mass and buoyancy of the whole, and the trim of the centres of all bodies at q = 0."""
    mjcf = Mjcf.find("planar_arm")
    vehicle, found = mjcf.vehicle, trial(mjcf.vehicle)
    bodies = [vehicle, *vehicle.arm.links]
    assert found.mass == pytest.approx(sum(each.mass for each in bodies))
    assert found.displaced_mass == pytest.approx(sum(each.displaced_mass for each in bodies))
    model = mjcf.compiled(mjcf.spec())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    d = np.zeros(3)
    for body, i in itertools.zip_longest(bodies, [1, *(link.body_id for link in vehicle.arm.links)]):
        R, p = data.xmat[i].reshape(3, 3), data.xpos[i]
        d += body.displaced_mass * (p + R @ body.r_b) - body.mass * (p + R @ body.r_g)
    assert abs(found.righting) == pytest.approx(np.linalg.norm(d) / found.mass, abs=1e-12)
