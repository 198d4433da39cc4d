"""Strip theory: closed forms of a cylinder and a capsule, integrals over their volume, frames."""

from dataclasses import replace
from math import pi

import mujoco
import numpy as np
import pytest
from scipy.integrate import quad

from twin import skew
from uvms_mj.plant.coefficients import DENSITY, Part, parts_of, strip_theory

R, B = 0.03, 0.12
C_A, C_D = 0.9, 1.2
Z = np.array([0.0, 0, 1])


def rod(**others) -> Part:
    return replace(Part(R, B, np.zeros(3), Z, round_ends=False), **others)


def test_a_cylinder_about_its_middle_in_closed_form():
    found = strip_theory([rod()], C_A, C_D)
    V = pi * R**2 * 2 * B
    m = C_A * DENSITY * V
    assert found.displaced_mass == pytest.approx(DENSITY * V, rel=1e-13)
    assert found.center_of_buoyancy == pytest.approx(np.zeros(3), abs=1e-15)
    np.testing.assert_allclose(found.M_A, np.diag([m, m, 0, m * B**2 / 3, m * B**2 / 3, 0]), rtol=1e-12, atol=1e-14)
    force, moment = 0.5 * DENSITY * C_D * 2 * R * 2 * B, 0.5 * DENSITY * C_D * 2 * R * B**4 / 2
    assert found.D_quadratic == pytest.approx(np.diag([force, force, 0, moment, moment, 0]), rel=1e-12, abs=1e-12)


def test_a_capsule_about_its_middle_in_closed_form():
    found = strip_theory([rod(round_ends=True)], C_A, C_D)
    V = pi * R**2 * 2 * B + 4 / 3 * pi * R**3
    second = 2 * pi * (R**2 * B**3 / 3 + 2 / 3 * B**2 * R**3 + B * R**4 / 2 + 2 * R**5 / 15)  # int A s^2 ds
    m, turning = C_A * DENSITY * V, C_A * DENSITY * second
    assert found.displaced_mass == pytest.approx(DENSITY * V, rel=1e-13)
    np.testing.assert_allclose(found.M_A, np.diag([m, m, 0, turning, turning, 0]), rtol=1e-12, atol=1e-14)
    area = 4 * R * B + pi * R**2
    fourth = R * B**4 + 4 * (B**3 * pi * R**2 / 4 + B**2 * R**3 + 3 * B * pi * R**4 / 16 + 2 * R**5 / 15)
    D = 0.5 * DENSITY * C_D * np.array([area, area, 0, fourth, fourth, 0])
    assert found.D_quadratic == pytest.approx(np.diag(D), rel=1e-12, abs=1e-12)


def moved(M: np.ndarray, p: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """A 6x6 matrix of a body at p, turned, about the frame's origin."""
    H = np.block([[turn.T, -turn.T @ skew(p)], [np.zeros((3, 3)), turn.T]])
    return H.T @ M @ H


def test_added_mass_moves_with_the_frame():
    rng = np.random.default_rng(3)
    p, turn = rng.normal(size=3) * 0.2, np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    at_home = strip_theory([rod(round_ends=True)], C_A, C_D)
    away = strip_theory([rod(centre=p, axis=turn[:, 2], round_ends=True)], C_A, C_D)
    np.testing.assert_allclose(away.M_A, moved(at_home.M_A, p, turn), rtol=1e-12, atol=1e-13)
    assert away.center_of_buoyancy == pytest.approx(p, rel=1e-12)
    assert np.linalg.eigvalsh(away.M_A)[0] > -1e-12


@pytest.mark.parametrize("seed", range(4))
def test_drag_is_the_integral_along_the_axis_for_each_motion_alone(seed):
    """A cylinder anywhere, with adaptive quadrature of Morison's drag for each of the six motions."""
    rng = np.random.default_rng(seed)
    c, a = rng.normal(size=3) * 0.1, rng.normal(size=3)
    a /= np.linalg.norm(a)
    found = strip_theory([rod(centre=c, axis=a)], C_A, C_D)

    def wrench(s: float, nu: np.ndarray) -> np.ndarray:
        r = c + s * a
        v = nu[:3] + np.cross(nu[3:], r)
        v -= (v @ a) * a
        f = 0.5 * DENSITY * C_D * 2 * R * np.linalg.norm(v) * v
        return np.array([*f, *np.cross(r, f)])

    for j in range(6):
        expected = [quad(lambda s, i=i, j=j: wrench(s, np.eye(6)[j])[i], -B, B, epsabs=1e-12)[0] for i in range(6)]
        assert found.D_quadratic[:, j] == pytest.approx(expected, rel=1e-7, abs=1e-9)


def test_a_hinge_at_the_end_has_the_textbook_moment():
    """Drag of a rod of length L that turns about its end: 1/8 rho C_D d L^4 q abs(q)."""
    found = strip_theory([rod(centre=np.array([0.0, 0, B]))], C_A, C_D)
    assert found.D_quadratic[4, 4] == pytest.approx(DENSITY * C_D * 2 * R * (2 * B) ** 4 / 8, rel=1e-12)
    assert found.D_quadratic[0, 4] == pytest.approx(DENSITY * C_D * 2 * R * (2 * B) ** 3 / 6, rel=1e-12)
    assert found.M_A[4, 4] == pytest.approx(C_A * DENSITY * pi * R**2 * (2 * B) ** 3 / 3, rel=1e-12)


def test_two_parts_add_up():
    parts = [rod(centre=np.array([0.1, 0, 0])), rod(axis=np.array([1.0, 0, 0]), round_ends=True)]
    both, each = strip_theory(parts, C_A, C_D), [strip_theory([part], C_A, C_D) for part in parts]
    assert both.displaced_mass == pytest.approx(sum(one.displaced_mass for one in each), rel=1e-13)
    moment = sum(one.displaced_mass * one.center_of_buoyancy for one in each)
    assert both.center_of_buoyancy == pytest.approx(moment / both.displaced_mass, rel=1e-12)
    for name in ("M_A", "D_quadratic"):
        assert getattr(both, name) == pytest.approx(sum(getattr(one, name) for one in each), rel=1e-12, abs=1e-12)


def test_the_parts_are_those_of_the_body_and_of_bodies_welded_to_it_in_its_frame():
    """Whatever the pose of the body in the world; boxes and spheres are no parts, a jointed child is another link."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body pos="1 2 3" euler="30 40 50"><freejoint/>
      <geom type="sphere" size=".1"/>
      <body name="link" pos=".3 .1 0" euler="10 0 90"><joint/>
        <geom type="capsule" size=".03" fromto="0 0 -.12 0 0 .12" contype="0"/><geom type="box" size=".1 .1 .1"/>
        <body pos="0 .1 0" euler="0 90 0"><geom type="cylinder" size=".02 .05" pos="0 0 .3"/></body>
        <body><joint/><geom type="capsule" size=".01 .1"/></body></body></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.qpos[3:7] = [0.5, 0.5, -0.5, 0.5]
    mujoco.mj_kinematics(model, data)
    capsule, cylinder = parts_of(model, data, model.body("link").id)
    assert (capsule.radius, capsule.half_length, capsule.round_ends) == (0.03, pytest.approx(0.12), True)
    assert (cylinder.radius, cylinder.half_length, cylinder.round_ends) == (0.02, 0.05, False)
    assert abs(capsule.axis[2]) == pytest.approx(1.0)
    assert capsule.centre == pytest.approx(np.zeros(3), abs=1e-14)
    assert cylinder.centre == pytest.approx([0.3, 0.1, 0.0], abs=1e-14)
    assert abs(cylinder.axis[0]) == pytest.approx(1.0)
