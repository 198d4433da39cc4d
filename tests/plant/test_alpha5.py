"""The BlueROV2 with a Reach Alpha 5: the numbers of its sources, typed here once more, and what follows from them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from twin import skew
from uvms_mj.files import shipped
from uvms_mj.plant.mjcf import Mjcf

ALPHA5 = Mjcf.find("bluerov2_alpha5")
TUHH = Mjcf.find("bluerov2_heavy_tuhh").vehicle
MOUNT = ([0.203, 0, -0.1317], [np.pi, 0, 0])
"""Position and roll, pitch, yaw of the arm in the vehicle."""
JOINTS = {
    "shoulder": ("axis_e", [0, 0, 0], [0, 0, 0], (-175, 175), 9, 30, 2.5, 4.0),
    "upper_arm": ("axis_d", [0.02, 0, 0.046], [np.pi / 2, 1.3, 0], (0, 200), 9, 30, 2.6, 1.9),
    "forearm": ("axis_c", [0.15, 0, 0], [np.pi, 0, 1.3], (0, 200), 9, 30, 1.7, 1.3),
    "wrist": ("axis_b", [0.02, 0, 0], [-np.pi / 2, 0, 0], (-165, 165), 5, 50, 0.2, 1.0),
}
"""Joint, origin and rpy in the parent, range [deg], effort, speed [deg/s], viscous and Coulomb friction."""
LINKS = {
    "shoulder": (0.194, 0.018, [0.26, 0.26, 0.3], [0.005, -0.001, 0.016], [-0.001, -0.003, 0.032], [139, 158, 62]),
    "upper_arm": (0.429, 0.203, [0.3, 1.6, 1.6], [0.073, 0, 0], [0.073, 0, -0.002], [87, 868, 891]),
    "forearm": (0.115, 0.025, [0.26, 0.3, 0.26], [0.017, -0.026, -0.002], [0.003, 0.001, -0.017], [42, 28, 45]),
    "wrist": (0.333, 0.155, [1.8, 1.8, 0.3], [0, 0, -0.098], [0, 0, -0.098], [508, 536, 76]),
}
"""Mass, volume [l], drag, centre of mass, centre of buoyancy, principal inertias [1e-6]."""
JAW = (0.05, 0.02, 0.05, np.array([0, 0, -0.092]))
"""Mass, volume, drag and place in the frame of the wrist."""
LINK = {link.name: link for link in ALPHA5.vehicle.arm.links}


def pose(origin, rpy) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_euler("xyz", rpy).as_matrix(), origin
    return T


def frames_of_the_source(q) -> dict[str, np.ndarray]:
    """Pose (4, 4) of each link's frame, as the source has it at the joint, in B."""
    T, found = pose(*MOUNT), {}
    for (name, (_, origin, rpy, *_)), angle in zip(JOINTS.items(), q, strict=True):
        found[name] = T = T @ pose(origin, rpy) @ pose([0, 0, 0], [0, 0, angle])
    return found


def frames_of_the_file(q) -> dict[str, np.ndarray]:
    """The same from the links that were read: a turn about the anchor, with the frame at the centre of buoyancy."""
    found: dict[int, np.ndarray] = {-1: np.eye(4)}
    for k, (link, angle) in enumerate(zip(ALPHA5.vehicle.arm.links, q, strict=True)):
        turn, rest = np.eye(4), np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec(angle * link.axis).as_matrix()
        turn[:3, 3] = link.anchor - turn[:3, :3] @ link.anchor
        rest[:3, :3], rest[:3, 3] = link.R_0, link.p_0
        found[k] = found[link.parent] @ rest @ turn
    return {link.name: found[k] for k, link in enumerate(ALPHA5.vehicle.arm.links)}


@pytest.mark.parametrize("seed", range(3))
def test_the_frames_are_those_of_the_source_moved_to_the_centres_of_buoyancy(seed):
    q = np.random.default_rng(seed).uniform(-1, 2, 4)
    expected, found = frames_of_the_source(q), frames_of_the_file(q)
    assert list(found) == list(LINKS)
    for name, (*_, r_b, _) in LINKS.items():
        np.testing.assert_allclose(found[name], expected[name] @ pose(r_b, [0, 0, 0]), atol=1e-12)


@pytest.mark.parametrize("name", LINKS)
def test_a_link_has_the_numbers_of_the_source(name):
    mass, volume, drag, r_g, r_b, inertia = LINKS[name]
    joint, _, _, limits, effort, speed, viscous, coulomb = JOINTS[name]
    link, jaw = LINK[name], JAW if name == "wrist" else (0, 0, 0, np.zeros(3))
    bodies = [(mass, np.subtract(r_g, r_b), np.array(inertia)), (jaw[0], jaw[3], np.full(3, 10.0))]
    M = np.zeros((6, 6))
    for m, r, I_g in bodies[: 2 if name == "wrist" else 1]:
        S = skew(r)
        M += np.block([[m * np.eye(3), -m * S], [m * S, np.diag(I_g) * 1e-6 - m * S @ S]])
    np.testing.assert_allclose(link.M_RB, M, atol=1e-12)
    assert link.displaced_mass == pytest.approx(volume + jaw[1], rel=1e-12)
    assert link.displaced_mass * link.r_b == pytest.approx(jaw[1] * jaw[3], abs=1e-7)
    assert np.diag(link.D_quadratic)[:3] == pytest.approx(np.add(drag, jaw[2]), rel=1e-12)
    assert np.array_equal(link.D_quadratic, np.diag(np.diag(link.D_quadratic)))
    assert not link.D_linear.any()
    assert (link.joint, link.effort, link.damping, link.friction) == (joint, effort, viscous, coulomb)
    assert np.degrees(link.range) == pytest.approx(limits, abs=1e-9)
    assert np.degrees(link.speed_limit) == pytest.approx(speed, rel=1e-6)


@pytest.mark.parametrize("name", LINKS)
def test_added_mass_is_that_of_a_tube_with_the_published_volume(name):
    """Strip theory with C_A = 1 across the axis that the drag shows: the one of another coefficient."""
    _, volume, drag, *_ = LINKS[name]
    (axis,) = (i for i in range(3) if drag.count(drag[i]) == 1)
    across = np.eye(3)
    across[axis, axis] = 0.0
    length = volume * 1e-3 / (np.pi * 0.02**2)
    M_A = np.zeros((6, 6))
    M_A[:3, :3], M_A[3:, 3:] = volume * across, volume * length**2 / 12 * across
    D = max(drag) * length**3 / 32 * np.diag(across)
    if name == "wrist":
        H = np.hstack([np.eye(3), -skew(JAW[3])])
        M_A += JAW[1] * H.T @ across @ H
    np.testing.assert_allclose(LINK[name].M_A, M_A, rtol=2e-3, atol=1e-9)
    if name in ("upper_arm", "wrist"):
        np.testing.assert_allclose(np.diag(LINK[name].D_quadratic)[3:], D, rtol=2e-3, atol=1e-9)


def test_the_base_is_that_of_tuhh_with_the_arms_tube_and_without_the_trim_that_is_taken_off():
    base = ALPHA5.vehicle
    for name in ("M_A", "D_linear", "D_quadratic", "B", "u_min", "u_max"):
        assert np.array_equal(getattr(base, name), getattr(TUHH, name))
    tube = (pose(*MOUNT) @ [-0.075, -0.006, -0.003, 1])[:3]
    S = skew(tube)
    I_g = np.diag([84e-6, 999e-6, 1004e-6])  # half a turn about x changes nothing
    M = TUHH.M_RB + np.block([[0.341 * np.eye(3), -0.341 * S], [0.341 * S, I_g - 0.341 * S @ S]])
    np.testing.assert_allclose(base.M_RB, M, atol=1e-12)
    displaced = [(14.45, TUHH.r_b), (0.899, np.array([0.086, 0, -0.109])), (0.202, tube)]
    total = sum(m for m, _ in displaced)
    assert base.displaced_mass == pytest.approx(total, rel=1e-12)
    assert base.r_b == pytest.approx(sum(m * r for m, r in displaced) / total, abs=1e-7)


def test_vehicle_and_arm_are_neutral_together_and_nothing_is_counted_twice():
    base, links = ALPHA5.vehicle, ALPHA5.vehicle.arm.links
    mass = base.mass + sum(link.mass for link in links)
    assert mass == pytest.approx(14.5 + 0.341 + 0.194 + 0.429 + 0.115 + 0.333 + 0.05, rel=1e-12)
    displaced = base.displaced_mass + sum(link.displaced_mass for link in links)
    assert displaced == pytest.approx(14.45 + 0.899 + 0.202 + 0.018 + 0.203 + 0.025 + 0.155 + 0.02, rel=1e-12)
    assert displaced - mass == pytest.approx(0.01, abs=1e-3)


def test_the_tool_is_between_the_tips_of_the_jaw_and_points_forward_when_the_arm_is_stretched():
    tool, wrist = ALPHA5.vehicle.arm.sites["tool"], frames_of_the_file([0, 1.3, 1.3 + np.pi / 2, 0])["wrist"]
    assert (tool.link, tool.radius) == (3, 0.01)
    np.testing.assert_allclose(wrist[:3, :3] @ tool.R, np.eye(3), atol=1e-12)
    at_joint = frames_of_the_source([0, 1.3, 1.3 + np.pi / 2, 0])["wrist"][:3, 3]
    p_BT = wrist[:3, 3] + wrist[:3, :3] @ tool.p
    assert p_BT - at_joint == pytest.approx([0.225, 0, 0], abs=1e-12)
    assert p_BT[0] > ALPHA5.geometry.reach + 0.3


def test_the_hull_is_that_of_the_frame():
    frame, with_arm = (shipped("models")[name].read_text() for name in ("bluerov2_heavy_tuhh", "bluerov2_alpha5"))
    hull = frame.split("<!-- Hull:")[1].split("    </body>")[0]
    assert hull.count("<geom") > 30
    assert hull in with_arm
