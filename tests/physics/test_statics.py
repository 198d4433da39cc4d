"""Poses, Jacobians, inertia and weights of a vehicle with an arm, against MuJoCo's own."""

import mujoco
import numpy as np
import pytest

from tool_arm import JOINTS, arm_file
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.physics.statics import Statics
from uvms_mj.plant.contacts import Probe
from uvms_mj.plant.mjcf import Mjcf


@pytest.fixture(scope="module")
def mjcf(tmp_path_factory) -> Mjcf:
    return Mjcf.find(str(arm_file(tmp_path_factory.mktemp("vehicle"))))


@pytest.mark.parametrize("seed", range(5))
def test_a_posture_is_that_of_mujoco(mjcf, seed):
    rng = np.random.default_rng(seed)
    model = mjcf.compiled(mjcf.spec())
    data = mujoco.MjData(model)
    data.qpos[3:7] = rng.normal(size=4)
    data.qpos[7:] = q = rng.uniform(-1.5, 1.5, JOINTS)
    mujoco.mj_forward(model, data)
    R_WB = rotation_matrix(data.qpos[3:7] / np.linalg.norm(data.qpos[3:7]))
    vehicle, site = mjcf.vehicle, model.site("tool").id
    statics, tool = Statics(vehicle, q), Probe.of("tool", mjcf).carrier
    p, R = statics.pose(tool)
    np.testing.assert_allclose(R_WB @ p, data.site_xpos[site], atol=1e-12)
    np.testing.assert_allclose(R_WB @ R, data.site_xmat[site].reshape(3, 3), atol=1e-12)
    T_inverse = np.eye(6 + JOINTS)  # of MuJoCo's velocities, whose linear part is in W
    T_inverse[:3, :3] = R_WB
    J, M = np.zeros((6, model.nv)), np.zeros((model.nv, model.nv))
    mujoco.mj_jacSite(model, data, J[:3], J[3:], site)
    J = np.vstack([(R_WB @ R).T @ J[:3], (R_WB @ R).T @ J[3:]]) @ T_inverse
    np.testing.assert_allclose(statics.jacobian(tool), J, atol=1e-12)
    mujoco.mj_fullM(model, data, M)
    water = sum(J.T @ body.M_A @ J for body, J in zip(statics.bodies, statics.jacobians, strict=True))
    np.testing.assert_allclose(statics.inertia() - water, T_inverse.T @ M @ T_inverse, atol=1e-12)
    buoyancy = np.zeros(6 + JOINTS)
    for body, R_BL, J_L in zip(statics.bodies, statics.R, statics.jacobians, strict=True):
        f = (R_WB @ R_BL).T @ (-body.displaced_mass * mjcf.gravity_W)
        buoyancy += J_L.T @ np.concatenate([f, np.cross(body.r_b, f)])
    weight = T_inverse.T @ data.qfrc_bias
    np.testing.assert_allclose(statics.restoring(R_WB, mjcf.gravity_W), weight - buoyancy, atol=1e-10)


def test_the_current_acts_on_every_link_where_it_is(mjcf):
    """Its power at any velocity is the sum of the powers of the wrenches on the links."""
    rng = np.random.default_rng(7)
    statics, v_c, R_WB = Statics(mjcf.vehicle, rng.uniform(-1, 1, JOINTS)), np.array([0.4, -0.2, 0.1]), np.eye(3)
    zeta, power = rng.normal(size=6 + JOINTS), 0.0
    for body, R, J in zip(statics.bodies, statics.R, statics.jacobians, strict=True):
        nu_r = np.concatenate([-R.T @ v_c, np.zeros(3)])
        h = body.M_A @ nu_r
        coriolis = np.concatenate([np.cross(nu_r[3:], h[:3]), np.cross(nu_r[:3], h[:3]) + np.cross(nu_r[3:], h[3:])])
        wrench = -coriolis - body.D_linear @ nu_r - body.D_quadratic @ (np.abs(nu_r) * nu_r)
        power += wrench @ J @ zeta
    assert statics.stream(R_WB, v_c) @ zeta == pytest.approx(power, rel=1e-12)
