"""Vehicles of other formats: the same vehicle from each, and the accelerations of the source's own equations."""

import re
import tomllib

import mujoco
import numpy as np
import pytest

from descriptions import (
    D_LINEAR,
    D_QUADRATIC,
    DENSITY,
    DISPLACED,
    EDGES,
    INERTIA,
    M_A,
    MASS,
    NED,
    PRODUCTS,
    R_B,
    R_G,
    THRUSTERS,
    inertia_elements,
    read,
    same,
    sdf,
    table,
    urdf,
    words,
)
from uvms_mj import attach
from uvms_mj.errors import InputError
from uvms_mj.physics.effects import RHO
from uvms_mj.physics.frames import body_acceleration, rotation_matrix
from uvms_mj.plant.coefficients import DERIVATIVES
from uvms_mj.plant.importing import imported
from uvms_mj.plant.importing.moving import Pose, moved
from uvms_mj.plant.importing.shapes import volume_of
from uvms_mj.plant.importing.table import drag_table
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.plant.record import mjcf_text
from uvms_mj.plant.water import Fin


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def rigid(mass, r_g, I_g):
    S = skew(r_g)
    return np.block([[mass * np.eye(3), -mass * S], [mass * S, I_g - mass * S @ S]])


@pytest.fixture
def by_hand(tmp_path):
    """The vehicle of the table in B, whose numbers the file has as they are."""
    return read(tmp_path, ".toml", table("flu", "matrices", PRODUCTS))[1]


def test_a_table_in_B_is_copied_as_it_is(by_hand):
    np.testing.assert_allclose(by_hand.M_RB, rigid(MASS, R_G, INERTIA), atol=1e-14)
    assert np.array_equal(by_hand.M_A, M_A)
    assert np.array_equal(by_hand.D_linear, D_LINEAR)
    assert np.array_equal(by_hand.D_quadratic, D_QUADRATIC)
    assert np.array_equal(by_hand.r_b, R_B)
    assert by_hand.displaced_mass == DISPLACED
    assert by_hand.thrusters == tuple(THRUSTERS)
    for column, (place, direction, limits), low, high in zip(
        by_hand.B.T, THRUSTERS.values(), by_hand.u_min, by_hand.u_max, strict=True
    ):
        np.testing.assert_allclose(column, [*direction, *np.cross(place, direction)], atol=1e-15)
        assert (low, high) == limits
    assert {each.name: each.coefficient for each in by_hand.products} == PRODUCTS


@pytest.mark.parametrize("signs", ["matrices", "derivatives"])
@pytest.mark.parametrize("frame", ["flu", "ned"])
@pytest.mark.parametrize("integral", [False, True])
def test_a_table_in_other_axes_and_signs_is_the_same_vehicle(by_hand, tmp_path, frame, signs, integral):
    same(read(tmp_path, ".toml", table(frame, signs, PRODUCTS, integral))[1], by_hand)


def test_sdf_of_gz_sim_is_the_same_vehicle(by_hand, tmp_path):
    same(read(tmp_path, ".sdf", sdf())[1], by_hand)


def test_urdf_of_the_uuv_simulator_is_the_same_vehicle(tmp_path):
    without = read(tmp_path, ".toml", table("flu", "matrices", {}))[1]
    same(read(tmp_path, ".urdf", urdf())[1], without)


def test_coefficients_about_the_centre_of_gravity_are_moved(tmp_path):
    """A table about the cg, whose origin is elsewhere, has M_A = H^T M H about the origin; with origin = "cg" nothing
    is moved but the places. Quadratic damping can't be moved, and is refused."""
    text = table("ned", "derivatives", {}).replace('about = "origin"', 'about = "cg"')
    linear = re.sub(r"\[quadratic_damping\]\nmatrix = .*\n", "", text)
    _, at_origin = read(tmp_path, ".toml", linear)
    H = np.eye(6)
    H[:3, 3:] = -skew(R_G)
    np.testing.assert_allclose(at_origin.M_A, H.T @ M_A @ H, atol=1e-13)
    np.testing.assert_allclose(at_origin.D_linear, H.T @ D_LINEAR @ H, atol=1e-13)
    with pytest.raises(Exception, match="quadratic damping can't be moved to another point"):
        read(tmp_path, ".toml", text)
    _, at_cg = read(tmp_path, ".toml", text.replace('about = "cg"', 'about = "cg"\norigin = "cg"'))
    np.testing.assert_allclose(at_cg.M_A, M_A, atol=1e-13)
    np.testing.assert_allclose(at_cg.D_quadratic, D_QUADRATIC, atol=1e-13)
    np.testing.assert_allclose(at_cg.r_g, 0.0, atol=1e-15)
    np.testing.assert_allclose(at_cg.r_b, R_B - R_G, atol=1e-15)
    np.testing.assert_allclose(at_cg.B, H.T @ at_origin.B * 0.0 + wrenches(R_G), atol=1e-13)


def wrenches(origin):
    return np.array([[*d, *np.cross(np.array(p) - origin, d)] for p, d, _ in THRUSTERS.values()]).T


def test_moving_keeps_the_energy():
    """nu^T M nu is the same at each point of a body and in any axes."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        M = (A := rng.normal(size=(6, 6))) @ A.T
        pose = Pose.of_rpy(rng.normal(size=3), rng.normal(size=3))
        v, w = rng.normal(size=3), rng.normal(size=3)
        there = np.concatenate([pose.R.T @ (v + np.cross(w, pose.p)), pose.R.T @ w])
        here = np.concatenate([v, w])
        assert here @ moved(M, pose) @ here == pytest.approx(there @ M @ there, rel=1e-12)


# accelerations by the source's own equations


def kirchhoff(M_rigid, M_added, load, mass, r_g, displaced, r_b, down, nu):
    """nu_dot (6,) in still water: d/dt (M nu) + the turning of both momenta = load + weight and buoyancy; ``down``
    is the direction of gravity, in the axes of all the others."""
    v, w = nu[:3], nu[3:]
    p = (M_rigid + M_added) @ nu
    turned = np.concatenate([np.cross(w, p[:3]), np.cross(w, p[3:]) + np.cross(v, p[:3])])
    weight = 9.81 * np.concatenate([(mass - displaced) * down, np.cross(mass * r_g - displaced * r_b, down)])
    return np.linalg.solve(M_rigid + M_added, load + weight - turned)


def states(n=50):
    rng = np.random.default_rng(5)
    for _ in range(n):
        quat = rng.normal(size=4)
        yield quat / np.linalg.norm(quat), rng.normal(size=6) * [1.5, 1.5, 1.5, 2.0, 2.0, 2.0]


def ours(xml, quat, nu, u):
    """nu_dot (6,) of a vehicle in MuJoCo with our water, under thrusts u."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qpos[3:7] = quat
    R = rotation_matrix(quat)
    data.qvel[:3], data.qvel[3:6] = R @ nu[:3], nu[3:]
    data.ctrl[:] = u
    with attach(model, data):
        mujoco.mj_forward(model, data)
    found = np.empty(6)
    body_acceleration(R, data.qacc, nu, found)
    return found


def test_accelerations_are_those_of_gz_sims_derivatives(tmp_path):
    record, _ = read(tmp_path, ".sdf", sdf())
    xml, u = mjcf_text(record), np.array([3.0, -2.0, 5.0, 1.5])
    for quat, nu in states():
        uu, vv, _, p, q, r = nu
        force = -D_LINEAR @ nu - np.diag(D_QUADRATIC) * np.abs(nu) * nu + wrenches(np.zeros(3)) @ u
        force += [0.0, -2.5 * uu * r, 0.25 * p * vv, 0.0, -0.5 * uu * abs(q), 1.75 * uu * vv]
        down = rotation_matrix(quat).T @ [0.0, 0.0, -1.0]
        expected = kirchhoff(rigid(MASS, R_G, INERTIA), M_A, force, MASS, R_G, DISPLACED, R_B, down, nu)
        np.testing.assert_allclose(ours(xml, quat, nu, u), expected, rtol=1e-9, atol=1e-9)


def test_accelerations_are_those_of_the_uuv_simulator_in_its_axes(tmp_path):
    """Everything is computed with x forward, y right, z down, as the source has it, and turned at the end."""
    forward = np.zeros((6, 6))
    forward[0, 0], forward[1, 1], forward[1, 5], forward[5, 1] = -8.0, -30.0, 20.0, -5.0
    hydro = f"<linear_damping_forward_speed>{words(forward)}</linear_damping_forward_speed>"
    record, _ = read(tmp_path, ".urdf", urdf(hydro=hydro))
    xml, u = mjcf_text(record), np.array([3.0, -2.0, 5.0, 1.5])
    added, D = (NED[:, None] * M * NED for M in (M_A, D_LINEAR))
    r_g, r_b, I_g = NED[:3] * R_G, NED[:3] * R_B, NED[:3, None] * INERTIA * NED[:3]
    for quat, nu in states():
        mu = NED * nu
        force = (
            -D @ mu + mu[0] * forward @ mu - np.diag(D_QUADRATIC) * np.abs(mu) * mu + NED * (wrenches(np.zeros(3)) @ u)
        )
        down = NED[:3] * (rotation_matrix(quat).T @ [0.0, 0.0, -1.0])
        expected = kirchhoff(rigid(MASS, r_g, I_g), added, force, MASS, r_g, DISPLACED, r_b, down, mu)
        np.testing.assert_allclose(NED * ours(xml, quat, nu, u), expected, rtol=1e-9, atol=1e-9)


# what a format has of its own


def test_added_mass_of_the_link_is_the_one_of_the_plugin(by_hand, tmp_path):
    """<fluid_added_mass> has 21 entries of M_A, positive."""
    names, added = "xyzpqr", ""
    for i in range(6):
        added += "".join(f"<{names[i]}{names[j]}>{M_A[i, j]}</{names[i]}{names[j]}>" for j in range(i, 6))
    text = re.sub(r"<([xyzkmn]Dot[UVWPQR])>.*?</\1>", "", sdf())
    text = text.replace("</inertial>", f"<fluid_added_mass>{added}</fluid_added_mass></inertial>", 1)
    record, vehicle = read(tmp_path, ".sdf", text)
    same(vehicle, by_hand)
    assert not any("C_A" in each for each in record.left_out)


def test_frames_of_sdf_are_resolved(by_hand, tmp_path):
    """Poses in named frames, in degrees and as quaternions, of a joint and of a model within the model."""
    text = sdf().replace(
        f"<pose>{words(THRUSTERS['vertical'][0])} 0 0.0 0.0</pose>",
        '<pose relative_to="shelf" degrees="true">0 0 0 0 0 90</pose>',
    )
    shelf = '<frame name="shelf" attached_to="hull"><pose rotation_format="quat_xyzw">0.1 0 0.05 0 0 0 1</pose></frame>'
    assert text != sdf()
    same(read(tmp_path, ".sdf", text.replace("<link", f"{shelf}<link", 1))[1], by_hand)


def test_included_models_are_read_from_their_folder_and_stand_where_the_include_says(by_hand, tmp_path):
    """A world includes a file with the model, or a model merges one with its links at another place."""
    folder = tmp_path / "fish_model"
    folder.mkdir()
    (folder / "model.sdf").write_text(sdf(world=False))
    density = f"""<plugin filename="gz-sim-buoyancy-system" name="gz::sim::systems::Buoyancy">
        <uniform_fluid_density>{DENSITY}</uniform_fluid_density></plugin>"""
    include = "<include><uri>model://fish_model</uri></include>"
    world = f'<sdf version="1.9"><world name="sea">{density}{include}<model name="floor"/></world></sdf>'
    same(read(tmp_path, ".sdf", world, packages={"fish_model": folder})[1], by_hand)
    camera = """<sdf version="1.9"><model name="camera"><link name="camera"><pose>0.1 0 0 0 0 0</pose><inertial>
        <mass>2</mass><inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia></inertial></link></model></sdf>"""
    folder = tmp_path / "camera"
    folder.mkdir()
    (folder / "model.sdf").write_text(camera)
    for merge, link in (("true", "camera"), ("false", "camera::camera")):
        body = f"""<include merge="{merge}"><uri>camera</uri><pose degrees="true">0.2 0 0 0 0 90</pose></include>
            <joint name="mount" type="fixed"><parent>hull</parent><child>{link}</child></joint>"""
        _, vehicle = read(tmp_path, ".sdf", sdf(body), packages={"camera": folder})
        expected = by_hand.M_RB + rigid(2.0, np.array([0.2, 0.1, 0.0]), 0.1 * np.eye(3))
        np.testing.assert_allclose(vehicle.M_RB, expected, atol=1e-12)


ARM = """
<link name="{p}upper"><pose>0.35 0 -0.05 0 0 0</pose><inertial><pose>0.1 0 0 0 0 0</pose><mass>1.2</mass>
  <inertia><ixx>0.002</ixx><iyy>0.006</iyy><izz>0.006</izz></inertia></inertial>
  <collision name="c"><pose>0.1 0 0 0 1.5707963267948966 0</pose><geometry><cylinder><radius>0.03</radius>
    <length>0.2</length></cylinder></geometry></collision></link>
<link name="{p}fore"><pose>0.55 0 -0.05 0 0 1.5707963267948966</pose><inertial><mass>0.6</mass>
  <inertia><ixx>0.001</ixx><iyy>0.001</iyy><izz>0.001</izz></inertia></inertial></link>
<link name="{p}jaw"><pose>0.55 0.1 -0.05 0 0 0</pose><inertial><mass>0.2</mass>
  <inertia><ixx>0.0001</ixx><iyy>0.0001</iyy><izz>0.0001</izz></inertia></inertial></link>
<joint name="shoulder" type="revolute"><parent>hull</parent><child>{p}upper</child><axis><xyz>0 1 0</xyz>
  <limit><lower>-1.5</lower><upper>0.75</upper><effort>9</effort><velocity>1.25</velocity></limit>
  <dynamics><damping>0.4</damping><friction>0.1</friction></dynamics></axis></joint>
<joint name="slider" type="prismatic"><parent>{p}upper</parent><child>{p}fore</child><pose>0.01 0 0 0 0 0</pose><axis>
  <xyz expressed_in="__model__">1 0 0</xyz></axis></joint>
<joint name="grip" type="fixed"><parent>{p}fore</parent><child>{p}jaw</child></joint>
"""
SERVO = """<plugin filename="gz-sim-joint-position-controller-system" name="gz::sim::systems::JointPositionController">
  <joint_name>slider</joint_name><cmd_min>-7</cmd_min><cmd_max>7</cmd_max></plugin>"""


def test_an_arm_in_sdf_is_links_with_joints(tmp_path):
    record, vehicle = read(tmp_path, ".sdf", sdf(ARM.format(p=""), SERVO))
    upper, fore = vehicle.arm.links
    assert (upper.joint, upper.slide, upper.parent, fore.joint, fore.slide, fore.parent) == (
        *("shoulder", False, -1),
        *("slider", True, 0),
    )
    np.testing.assert_allclose([upper.p_0, fore.p_0], [[0.35, 0, -0.05], [0.2, 0, 0]], atol=1e-12)
    np.testing.assert_allclose([upper.axis, fore.axis], [[0, 1, 0], [0, -1, 0]], atol=1e-12)
    np.testing.assert_allclose(fore.R_0, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    assert upper.range == (-1.5, 0.75)
    assert (upper.effort, upper.speed_limit, upper.damping, upper.friction) == (9.0, 1.25, 0.4, 0.1)
    assert fore.effort == 7.0
    assert upper.mass == pytest.approx(1.2)
    assert fore.mass == pytest.approx(0.8), "the jaw is welded to it"
    np.testing.assert_allclose(fore.r_g, [0.2 * 0.1 / 0.8, 0, 0], atol=1e-12)
    assert upper.displaced_mass == pytest.approx(1025.0 * np.pi * 0.03**2 * 0.2, rel=1e-12)
    np.testing.assert_allclose(upper.r_b, [0.1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(vehicle.arm.sites["jaw"].p, [0.1, 0, 0], atol=1e-12)
    assert vehicle.mass == pytest.approx(MASS)
    assert any("without added mass and drag" in each and "upper" in each for each in record.left_out)


def test_an_arm_in_urdf_has_its_own_water(tmp_path):
    """A link's coefficients are in its own axes, with y right and z down, about its frame."""
    more = """<link name="arm"><inertial><mass value="2"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0"
        iyz="0"/></inertial></link><joint name="elbow" type="revolute"><origin xyz="0.4 0 0" rpy="0 0 0.5"/>
        <axis xyz="0 0 2"/><parent link="fish/base_link"/><child link="arm"/>
        <limit lower="-1" upper="1" effort="5" velocity="2"/></joint>"""
    added = np.diag([1.0, 2.0, 3.0, 0.01, 0.02, 0.03])
    added[0, 4] = added[4, 0] = 0.05
    added[1, 3] = added[3, 1] = 0.04
    water = f"""<link name="arm"><volume>0.001</volume><hydrodynamic_model><type>fossen</type>
        <added_mass>{words(added)}</added_mass></hydrodynamic_model></link>"""
    _, vehicle = read(tmp_path, ".urdf", urdf(more, water=water))
    (arm,) = vehicle.arm.links
    np.testing.assert_allclose(arm.M_A, NED[:, None] * added * NED, atol=1e-15)
    assert arm.displaced_mass == pytest.approx(1.025)
    assert (arm.range, arm.effort, arm.speed_limit) == ((-1.0, 1.0), 5.0, 2.0)
    np.testing.assert_allclose(arm.axis, [0, 0, 1])
    np.testing.assert_allclose(arm.R_0[:2, 0], [np.cos(0.5), np.sin(0.5)])


@pytest.mark.parametrize("welded", ['type="fixed"', 'type="revolute"'])
def test_what_is_fixed_or_held_is_part_of_the_base(tmp_path, welded):
    """Mass, centre and inertia of both bodies together, about the common centre of gravity."""
    limit = "" if "fixed" in welded else '<axis xyz="1 0 0"/><limit lower="0" upper="0" effort="0" velocity="0"/>'
    more = f"""<link name="camera"><inertial><origin xyz="0.1 0 0" rpy="0 0 1.5707963267948966"/><mass value="3"/>
        <inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j" {welded}><origin xyz="0.2 0.1 0" rpy="0 0 0"/><parent link="fish/base_link"/>
        <child link="camera"/>{limit}</joint>"""
    _, vehicle = read(tmp_path, ".urdf", urdf(more))
    assert not vehicle.arm.links
    expected = rigid(MASS, R_G, INERTIA) + rigid(3.0, np.array([0.3, 0.1, 0.0]), np.diag([0.2, 0.1, 0.25]))
    np.testing.assert_allclose(vehicle.M_RB, expected, atol=1e-12)


@pytest.mark.parametrize("kind", ["sphere", "cylinder", "box"])
def test_bodies_of_the_uuv_simulator(tmp_path, kind):
    """Numbers by hand for radius 0.2 m, length 1 m along y, in water of 1025 kg/m^3."""
    r, length, rho = 0.2, 1.0, 1025.0
    model = {
        "sphere": "<radius>0.2</radius>",
        "cylinder": "<radius>0.2</radius><length>1</length><axis>j</axis>",
        "box": "<length>1</length><width>0.5</width><height>0.25</height><cd>1.2</cd>",
    }[kind]
    text = re.sub(
        r"<type>fossen</type>.*?</hydrodynamic_model>",
        f"<type>{kind}</type>{model}</hydrodynamic_model>",
        urdf(),
        flags=re.S,
    )
    _, vehicle = read(tmp_path, ".urdf", text)
    expected_A, expected_D = {
        "sphere": ([2 / 3 * rho * np.pi * r**3] * 3 + [0] * 3, [0.25 * rho * np.pi * r**2] * 3 + [0] * 3),
        "cylinder": (
            rho * np.pi * r**2 * np.array([length, 1.0, length, length**3 / 12, 0, length**3 / 12]),
            0.5 * rho * np.array([0.74 * r * length, 0.87 * np.pi * r**2, 0.74 * r * length, 0, 0, 0]),
        ),
        "box": ([0] * 6, 0.6 * rho * np.array([0.125, 0.25, 0.5, 0, 0, 0])),
    }[kind]
    np.testing.assert_allclose(np.diag(vehicle.M_A), expected_A, rtol=1e-12)
    np.testing.assert_allclose(np.diag(vehicle.D_quadratic), expected_D, rtol=1e-12)


FIN = """<link name="fish/fin"/><joint name="f" type="revolute"><origin xyz="-0.3 0.1 0.05" rpy="0.7 -0.1 0.2"/>
  <axis xyz="0 0 1"/><parent link="fish/base_link"/><child link="fish/fin"/>
  <limit lower="-1" upper="1" effort="0" velocity="0"/>
  </joint><gazebo><plugin name="fin" filename="libuuv_fin_ros_plugin.so"><link_name>fish/fin</link_name><liftdrag>{lift}
  </liftdrag></plugin></gazebo>"""
LIFTS = {
    "TwoLines": "<area>0.04</area><fluid_density>1025</fluid_density><a0>0</a0><alpha_stall>0.4</alpha_stall>"
    "<cla>3</cla><cla_stall>0</cla_stall><cda>0</cda><cda_stall>0</cda_stall>",
    "Quadratic": "<lift_constant>60</lift_constant><drag_constant>0</drag_constant>",
}


@pytest.mark.parametrize("kind", LIFTS)
def test_a_fin_is_said_as_a_table_with_its_lift(tmp_path, kind):
    """The slope of our fin's lift over the angle, at small angles and 1 m/s, is the source's: 1/2 rho A C_alpha, or its
    constant. Chord and span are x and z of the link."""
    record, vehicle = read(tmp_path, ".urdf", urdf(FIN.format(lift=f"<type>{kind}</type>{LIFTS[kind]}")))
    assert not vehicle.arm.links
    (said,) = (each for each in record.left_out if "fins = [" in each)
    (keys,) = tomllib.loads(re.search(r"fins = .*\]", said)[0])["fins"]
    fin = Fin(**{key: tuple(value) if isinstance(value, list) else value for key, value in keys.items()})
    slope = 0.5 * RHO * fin.area * fin.lift_slope
    assert slope == pytest.approx({"TwoLines": 0.5 * 1025 * 0.04 * 3, "Quadratic": 60.0}[kind], rel=1e-5)
    assert fin.position == (-0.3, 0.1, 0.05)
    turned = np.radians(fin.attitude_deg)
    np.testing.assert_allclose(turned, [0.7, -0.1, 0.2], atol=1e-6)


def test_liftdrag_of_gz_sim_has_chord_and_lift_where_it_says(tmp_path):
    fin = """<link name="fin"><pose>-0.3 0 0.1 0 0 0</pose></link><joint name="fj" type="revolute"><parent>hull</parent>
        <child>fin</child><axis><xyz>0 0 1</xyz></axis></joint>"""
    plugin = """<plugin filename="gz-sim-lift-drag-system" name="gz::sim::systems::LiftDrag"><link_name>fin</link_name>
        <area>0.02</area><cla>4</cla><air_density>1025</air_density><alpha_stall>0.3</alpha_stall>
        <forward>1 0 0</forward><upward>0 1 0</upward><cp>0.05 0 0</cp></plugin>"""
    record, vehicle = read(tmp_path, ".sdf", sdf(fin, plugin))
    (said,) = (each for each in record.left_out if "fins = [" in each)
    assert "position = [-0.25, 0, 0.1], attitude_deg = [0, 0, 0], lift_slope = 4.1, stall_deg = 17.1887" in said
    assert not vehicle.arm.links


def test_thrusters_by_angular_velocity_have_the_thrust_at_their_limits(tmp_path):
    text = sdf().replace(
        "<max_thrust_cmd>50.0</max_thrust_cmd>",
        "<max_thrust_cmd>50.0</max_thrust_cmd><use_angvel_cmd>true</use_angvel_cmd><fluid_density>1000</fluid_density>"
        "<propeller_diameter>0.1</propeller_diameter><thrust_coefficient>0.2</thrust_coefficient>",
    )
    _, vehicle = read(tmp_path, ".sdf", text)
    k = 1000 * 0.2 * 0.1**4
    assert vehicle.u_max[:2] == pytest.approx(k * 50**2)
    assert vehicle.u_min[:2] == pytest.approx(-k * 40**2)


# meshes


def cube_stl(edge, shift, hole=False):
    """A cube in ASCII STL, perhaps without its last triangle."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float) * edge + shift
    faces = [
        (0, 1, 3),
        (0, 3, 2),
        (4, 6, 7),
        (4, 7, 5),
        (0, 4, 5),
        (0, 5, 1),
        (2, 3, 7),
        (2, 7, 6),
        (0, 2, 6),
        (0, 6, 4),
        (1, 5, 7),
        (1, 7, 3),
    ]
    lines = ["solid cube"]
    for face in faces[: -1 if hole else None]:
        lines += [
            "facet normal 0 0 0",
            "outer loop",
            *(f"vertex {words(corners[i])}" for i in face),
            "endloop",
            "endfacet",
        ]
    return "\n".join([*lines, "endsolid cube"])


def binary_stl(text):
    vertices = np.array(
        [[float(x) for x in line.split()[1:]] for line in text.splitlines() if line.startswith("vertex")]
    )
    head, rows = b"\0" * 80 + np.uint32(len(vertices) // 3).tobytes(), b""
    for triangle in vertices.reshape(-1, 3, 3):
        rows += np.zeros(3, "<f4").tobytes() + triangle.astype("<f4").tobytes() + b"\0\0"
    return head + rows


def with_mesh(file, scale="1 1 1"):
    return re.sub(r"<box>.*?</box>", f"<mesh><uri>{file}</uri><scale>{scale}</scale></mesh>", sdf(), flags=re.S)


def test_the_volume_of_a_closed_mesh_is_the_polyhedrons(tmp_path):
    """A cube of 2 x 0.1 m, 3 x as long along y by its scale, at its place."""
    (tmp_path / "hull.stl").write_bytes(binary_stl(cube_stl(0.2, 0.1)))
    _, vehicle = read(tmp_path, ".sdf", with_mesh("hull.stl", "1 3 1"))
    assert vehicle.displaced_mass == pytest.approx(1025 * 0.2**3 * 3, rel=1e-6)
    np.testing.assert_allclose(vehicle.r_b, R_B + np.array([0.2, 0.6, 0.2]), atol=1e-6)


def urdf_of_gz_sim() -> str:
    """The vehicle as URDF whose <gazebo> blocks have the plugins of its SDF, and its volume as a collision shape."""
    head = re.sub(r"<gazebo>.*?</gazebo>", "", urdf(), flags=re.S).removesuffix("</robot>").replace("fish/", "")
    box = f'<collision><origin xyz="{words(R_B)}"/><geometry><box size="{words(EDGES)}"/></geometry></collision>'
    head = head.replace("</inertial></link>", f"</inertial>{box}</link>", 1)
    plugins = re.findall(r"<plugin .*?</plugin>", sdf(), flags=re.S)
    blocks = "".join(f"<gazebo>{each}</gazebo>" for each in plugins).replace(">hull<", ">base_link<")
    return f"{head}{blocks}</robot>"


def test_a_urdf_with_the_plugins_of_gz_sim_is_its_sdf(tmp_path):
    record, vehicle = read(tmp_path, ".urdf", urdf_of_gz_sim())
    other, by_sdf = read(tmp_path, ".sdf", sdf())
    same(vehicle, by_sdf)
    assert record.base.shapes == other.base.shapes
    assert not any("not read" in each for each in record.left_out)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("</robot>", '<gazebo><link name="float"/></gazebo></robot>', r"<gazebo> <link name='float'>: is SDF in URDF"),
        (">base_link</link_name>", ">hull</link_name>", r"<link_name>.*'hull'"),
        ("systems::Hydrodynamics", "systems::Waves", r"gz-sim-hydrodynamics-system|conventions"),
        (
            "</robot>",
            '<gazebo><plugin filename="gz-sim-lift-drag-system" name="gz::sim::systems::LiftDrag"/></gazebo></robot>',
            "is read from SDF",
        ),
    ],
)
def test_what_a_urdf_of_gz_sim_has_beside_is_refused_by_its_place(tmp_path, old, new, said):
    text = urdf_of_gz_sim()
    assert old in text
    if "Waves" in new:
        text = text.replace("gz-sim-hydrodynamics-system", "waves-hydrodynamics")
    with pytest.raises(InputError, match=said):
        read(tmp_path, ".urdf", text.replace(old, new, 1))


def test_a_hinge_of_urdf_that_turns_for_ever_may_be_revolute(tmp_path):
    """As propellers have it for gz-sim: a limit of a million radians is none, and one of 180 is in degrees."""
    text = urdf_of_gz_sim().replace(
        'type="continuous">', 'type="revolute"><limit lower="-1e6" upper="1e16" effort="9"/>'
    )
    same(read(tmp_path, ".urdf", text)[1], read(tmp_path, ".sdf", sdf())[1])
    with pytest.raises(InputError, match="-180 to 180 is more than two turns: URDF has radians, and a continuous"):
        read(tmp_path, ".urdf", text.replace('"-1e6" upper="1e16"', '"-180" upper="180"'))


BUMPER = '<collision name="bumper"><geometry><box><size>0.7 0.5 0.2</size></box></geometry></collision>'
MARK = 'xmlns:gz="http://gazebosim.org/schema" gz:buoyancy="true"'


@pytest.mark.parametrize(
    ("enable", "marks", "counts"),
    [
        ("", {}, "both"),
        ("<enable>fish</enable>", {}, "both"),
        ("<enable>other</enable><enable>fish::hull</enable>", {}, "both"),
        ("<enable>fish::hull::volume</enable>", {}, "volume"),
        ("", {"volume": MARK}, "volume"),
        ("<enable>fish</enable>", {"volume": MARK, "bumper": MARK.replace("true", "false")}, "volume"),
        ("<enable>other</enable>", {}, "none"),
    ],
)
def test_the_shapes_that_the_source_makes_buoyant_displace_water_and_no_others(tmp_path, enable, marks, counts):
    """gz-sim's Buoyancy enables scoped names, and others mark the shapes. The bumper alone is 0.07 m^3."""
    text = sdf().replace("</uniform_fluid_density>", f"</uniform_fluid_density>{enable}")
    text = text.replace('<collision name="volume">', f'{BUMPER}<collision name="volume">')
    for name, mark in marks.items():
        text = text.replace(f'<collision name="{name}">', f'<collision name="{name}" {mark}>')
    if counts == "none":
        with pytest.raises(InputError, match=r"displaces no water: .*its shape volume is not among what the Buoyancy"):
            read(tmp_path, ".sdf", text)
        return
    record, vehicle = read(tmp_path, ".sdf", text)
    expected = DISPLACED + (1025.0 * 0.07 if counts == "both" else 0.0)
    assert vehicle.displaced_mass == pytest.approx(expected, rel=1e-12)
    assert (counts == "volume") == any("its shape bumper is not" in each for each in record.left_out)


def test_an_inertia_of_sdf_in_attributes_is_read_and_said(tmp_path):
    elements = inertia_elements()
    attributes = re.sub(r"<(\w+)>(.*?)</\w+>", r'\1="\2" ', elements)
    text = sdf().replace(f"<inertia>{elements}</inertia>", f"<inertia {attributes}/>")
    assert text != sdf()
    record, vehicle = read(tmp_path, ".sdf", text)
    same(read(tmp_path, ".sdf", sdf())[1], vehicle)
    assert any("its inertia is in attributes" in each for each in record.left_out)


def test_a_collision_mesh_that_would_stand_for_an_unread_one_is_named_too(tmp_path):
    """The volume is a number in the UUV Simulator: the mesh would only be drawn."""
    (tmp_path / "hull.stl").write_bytes(b"")
    mesh = '<{0}><geometry><mesh filename="hull.{1}"/></geometry></{0}>'
    text = urdf()
    text = text.replace(
        "</inertial>", "</inertial>" + mesh.format("visual", "dae") + mesh.format("collision", "stl"), 1
    )
    record, _ = read(tmp_path, ".urdf", text)
    said = " ".join(record.left_out)
    assert "hull.dae is not read: only STL and OBJ are: it is not drawn" in said
    assert re.search(r"hull\.stl can't be read: .*it is not drawn", said)


def test_an_open_mesh_has_no_volume(tmp_path):
    (tmp_path / "hull.stl").write_bytes(binary_stl(cube_stl(0.2, 0.1, hole=True)))
    with pytest.raises(Exception, match="is not closed: its volume is not defined"):
        read(tmp_path, ".sdf", with_mesh("hull.stl"))


def test_the_volume_of_a_tetrahedron_is_a_sixth_of_the_parallelepiped():
    rng = np.random.default_rng(2)
    for _ in range(10):
        a, b, c, d = corners = rng.normal(size=(4, 3))
        triangles = corners[[(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]]
        volume, centroid, _ = volume_of(triangles)
        assert volume == pytest.approx(abs(np.dot(b - a, np.cross(c - a, d - a))) / 6, rel=1e-9)
        np.testing.assert_allclose(centroid, corners.mean(axis=0), atol=1e-9)


# decisions


def test_an_added_mass_that_is_almost_symmetric_is_the_mean_and_this_is_said(tmp_path):
    text = sdf().replace("<yDotR>-0.7</yDotR>", "<yDotR>-0.701</yDotR>")
    record, vehicle = read(tmp_path, ".sdf", text)
    assert vehicle.M_A[1, 5] == vehicle.M_A[5, 1] == pytest.approx(0.7005)
    assert any("not symmetric, row 2, column 6 has 0.701, row 6, column 2 0.7" in each for each in record.left_out)


def test_an_impossible_inertia_is_the_nearest_possible_one_and_this_is_said(tmp_path):
    text = re.sub(r"<inertia>.*?</inertia>", "<inertia><ixx>0.5</ixx><iyy>0.9</iyy><izz>2.0</izz></inertia>", sdf())
    record, vehicle = read(tmp_path, ".sdf", text)
    inertia = vehicle.M_RB[3:, 3:] + MASS * skew(R_G) @ skew(R_G)
    np.testing.assert_allclose(np.diag(inertia), [0.5, 0.9, 1.4], rtol=1e-9)
    assert any("principal moments 0.5, 0.9, 2 kg m^2" in each and "1.4" in each for each in record.left_out)


@pytest.mark.parametrize(("tag", "noun"), [("Dot", "added mass"), ("abs", "quadratic damping")])
def test_a_matrix_of_the_other_sign_is_turned_and_this_is_said(by_hand, tmp_path, tag, noun):
    pattern = r"<([xyzkmn]Dot[UVWPQR])>(.*?)</" if tag == "Dot" else r"<([xyzkmn]([UVWPQR])abs\2)>(.*?)</"
    text = re.sub(pattern, lambda f: f"<{f[1]}>{-float(f[f.lastindex])!r}</", sdf())
    record, vehicle = read(tmp_path, ".sdf", text)
    same(vehicle, by_hand)
    assert any(each.startswith(f"the {noun} has the other sign") for each in record.left_out)


def test_the_list_is_in_the_file_and_the_file_is_well_formed(tmp_path):
    record, _ = read(tmp_path, ".sdf", sdf(ARM.format(p=""), SERVO))
    text = (tmp_path / "fish.xml").read_text()
    for each in record.left_out:
        assert each in text
    assert record.left_out


def test_what_is_not_read_is_said(tmp_path):
    """Sensors, batteries, engines, currents, springs and gains: each has a sentence, and nothing else does."""
    more = """<link name="box"><sensor name="imu" type="imu"/></link><joint name="j" type="fixed"><parent>hull</parent>
        <child>box</child></joint>"""
    plugins = """<plugin filename="gz-sim-linear-battery-plugin-system" name="gz::sim::systems::LinearBatteryPlugin"/>
        <plugin filename="gz-sim-buoyancy-engine-system" name="BuoyancyEngine"><link_name>box</link_name>
        </plugin>"""
    text = sdf(more, plugins).replace(
        "<link_name>hull</link_name>",
        "<link_name>hull</link_name><default_current>0.3 0 0</default_current><xUU>-1</xUU>",
        1,
    )
    before, _ = read(tmp_path, ".sdf", sdf())
    record, vehicle = read(tmp_path, ".sdf", text)
    new = [each for each in record.left_out if each not in before.left_out]
    expected = ("imu: sensors", "LinearBatteryPlugin: plugins", "buoyancy engine", "current 0.3 0 0", "without abs")
    assert len(new) == len(expected)
    assert all(any(word in each for each in new) for word in expected)
    assert "Xuu" in {each.name for each in vehicle.products}


@pytest.mark.parametrize(
    ("relative", "axis"),
    [
        ('relative_to="__model__"', '<xyz expressed_in="__model__">1 0 0</xyz>'),
        ('relative_to="__model__"', "<use_parent_model_frame>1</use_parent_model_frame><xyz>1 0 0</xyz>"),
        ('relative_to="mark"', '<xyz expressed_in="mark">1 0 0</xyz>'),
    ],
)
def test_names_in_a_nested_model_are_those_of_that_model(tmp_path, relative, axis):
    """A nested model, turned by 90 degrees in yaw: x of its frame is y of the vehicle. The frame "mark", attached to
    it, is the same frame, and another "mark" of the vehicle is not meant."""
    edges, at, inside = (0.1, 0.2, 0.3), np.array([0.0, 0.3, 0.5]), np.array([0.2, 0.0, 0.0])
    pod = f"""<frame name="mark"><pose>3 0 0 1 0 0</pose></frame>
      <model name="pod"><pose>{words(at)} 0 0 {np.pi / 2!r}</pose><frame name="mark" attached_to="__model__"/>
        <link name="k"><pose>1 0 0 0.4 0 0</pose><inertial><mass>1</mass></inertial><collision name="c">
          <pose {relative}>{words(inside)} 0 0 0</pose><geometry><box><size>{words(edges)}</size></box></geometry>
        </collision></link><link name="screw"><pose>0 0 0 0.3 0.2 0.1</pose></link>
        <joint name="turn" type="revolute"><parent>k</parent><child>screw</child><axis>{axis}</axis></joint></model>
      <joint name="weld" type="fixed"><parent>hull</parent><child>pod::k</child></joint>"""
    plugin = """<plugin filename="gz-sim-thruster-system" name="gz::sim::systems::Thruster">
        <joint_name>pod::turn</joint_name><max_thrust_cmd>5</max_thrust_cmd><min_thrust_cmd>-5</min_thrust_cmd></plugin>"""
    _, vehicle = read(tmp_path, ".sdf", sdf(pod, plugin))
    V, more = np.prod(EDGES), np.prod(edges)
    centre = at + np.array([-inside[1], inside[0], inside[2]])
    np.testing.assert_allclose(vehicle.r_b, (V * R_B + more * centre) / (V + more), atol=1e-12)
    force = np.array([0.0, 1.0, 0.0])
    np.testing.assert_allclose(vehicle.B[:, -1], np.r_[force, np.cross(at, force)], atol=1e-12)


def test_elements_of_hydrodynamics_that_are_not_read_are_said(tmp_path):
    """A misspelt coefficient is not lost in silence, and what is known is not said."""
    said = "elements of the Hydrodynamics plugin that are not read"
    text = sdf().replace("<xDotU>", "<xUUU>-3</xUUU><disable_coriolis>true</disable_coriolis><xDotU>")
    record, _ = read(tmp_path, ".sdf", text)
    before, _ = read(tmp_path, ".sdf", sdf())
    assert [each for each in record.left_out if each not in before.left_out] == [f"<xUUU>, <disable_coriolis>: {said}"]


def test_a_mass_report_and_a_table_of_drag_stand_for_the_files(by_hand, tmp_path):
    """Grams and millimetres, y right and z down, integrals about the origin; drag by two points of a parabola."""
    I_o = INERTIA - MASS * skew(R_G) @ skew(R_G)
    f = NED[:3]
    I_ned = f[:, None] * I_o * f * 1e9
    six = [*np.diag(I_ned), -I_ned[0, 1], -I_ned[0, 2], -I_ned[1, 2]]
    report = tmp_path / "cad.toml"
    report.write_text(f"""frame = "ned"\nmass = {MASS * 1e3}\nmass_unit = "g"\nlength_unit = "mm"
cg = {(f * R_G * 1e3).tolist()}\ninertia = {[float(x) for x in six]}\ninertia_about = "origin"
products_of_inertia = "integral"\n""")
    drag = tmp_path / "towing.csv"
    drag.write_text("axis, speed_m_s, force_N\nsurge, 0.5, 17.5\nsurge, -1, -65\nsway, 0.2, 5.4\nsway, 0.4, 18\n")
    text = sdf().replace(f"<mass>{MASS}</mass>", "<mass>99</mass>").replace("<xU>-5.0</xU>", "<xU>-77.0</xU>")
    record, vehicle = read(tmp_path, ".sdf", text, inertia=report, drag=drag)
    same(vehicle, by_hand)
    assert any("cad.toml" in each for each in record.left_out)
    assert drag_table(drag)[0][:2] == pytest.approx((5.0, 60.0))


def test_csv_has_the_keys_of_toml(by_hand, tmp_path):
    """A CSV without matrices: derivatives by their names."""
    names = {"M_A": "added_mass", "D_linear": "linear_damping", "D_quadratic": "quadratic_damping"}
    lines = ["key,value", "frame,flu", "about,origin", "signs,derivatives", f"body.mass,{MASS}"]
    lines += [f"body.displaced_mass,{DISPLACED!r}", f"body.cg,{words(R_G)}", f"body.cb,{words(R_B)}"]
    six = words([INERTIA[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])
    lines += [f"body.inertia,{six}", "body.products_of_inertia,matrix"]
    for matrix, key in names.items():
        M = {"M_A": M_A, "D_linear": D_LINEAR, "D_quadratic": D_QUADRATIC}[matrix]
        lines += [
            f"{key}.{DERIVATIVES[matrix][i, j]},{-float(M[i, j])!r}"
            for i, j in np.argwhere((M != 0) | np.eye(6, dtype=bool))
        ]
    lines += [f"products.{name},{c}" for name, c in PRODUCTS.items()]
    for name, (place, direction, (low, high)) in THRUSTERS.items():
        lines += [f"thrusters.{name}.position,{words(place)}", f"thrusters.{name}.direction,{words(direction)}"]
        lines += [f"thrusters.{name}.min,{low}", f"thrusters.{name}.max,{high}"]
    same(read(tmp_path, ".csv", "\n".join(lines))[1], by_hand)


def test_the_imported_vehicle_keeps_its_name_and_source(tmp_path):
    path = tmp_path / "source.sdf"
    path.write_text(sdf())
    record = imported(path, "mine")
    (tmp_path / "mine.xml").write_text(mjcf_text(record))
    mjcf = Mjcf.find(str(tmp_path / "mine.xml"))
    assert mjcf.vehicle.body == "mine"
    assert "source.sdf" in mjcf.remarks["source"]
    assert "not known" in mjcf.remarks["licence"]
