"""Poses of links from joint positions are those of MuJoCo, for random trees with hinges, slides and welded bodies."""

import mujoco
import numpy as np
import pytest

from uvms_mj import InputError
from uvms_mj.physics.frames import quat_product, rotation_matrix
from uvms_mj.plant.arm import read_arm
from uvms_mj.plant.geometry import Geometry


def place(rng) -> str:
    """A random place of a body or geom."""
    return f'pos="{_text(rng.normal(size=3) * 0.3)}" quat="{_text(rng.normal(size=4))}"'


def _text(values) -> str:
    return " ".join(map(repr, np.asarray(values, float).tolist()))


def random_tree(rng, n: int) -> mujoco.MjModel:
    """A free base with n links below it, each on a hinge or a slide with an anchor, some behind a welded body."""
    children: dict[int, list[int]] = {i: [] for i in range(-1, n)}
    for i in range(n):
        children[int(rng.integers(-1, i)) if i else -1].append(i)

    def body(i: int) -> str:
        kind = rng.choice(["hinge", "slide"])
        joint = f'<joint name="joint {i}" type="{kind}" axis="{_text(rng.normal(size=3))}"'
        joint += f' pos="{_text(rng.normal(size=3) * 0.2)}"/>'
        geom = f'<geom type="box" size="0.1 0.2 0.3" {place(rng)}/>'
        welded = f'<body {place(rng)}><geom type="capsule" size="0.1 0.2" {place(rng)}/>{below(i)}</body>'
        return f'<body name="link {i}" {place(rng)}>{joint}{geom}{welded}</body>'

    def below(i: int) -> str:
        return "".join(map(body, children[i]))

    xml = f'<mujoco><worldbody><body name="base"><freejoint/><geom size="0.2"/>{below(-1)}</body></worldbody></mujoco>'
    return mujoco.MjModel.from_xml_string(xml)


def links_of(model):
    faults = []
    links = read_arm(model, 1, "", faults).links
    assert all("no coefficient" in str(fault) for fault in faults), "the trees of this test are dry"
    return links


@pytest.mark.parametrize("seed", range(10))
def test_poses_are_mujocos(seed):
    rng = np.random.default_rng(seed)
    model = random_tree(rng, n := int(rng.integers(1, 9)))
    geometry = Geometry.of(model, 1, links_of(model))
    q = rng.uniform(-3.0, 3.0, (20, n))
    p_WB, quat_WB = rng.normal(size=(20, 3)), rng.normal(size=(20, 4))
    quat_WB /= np.linalg.norm(quat_WB, axis=1, keepdims=True)
    poses = [(p_WB, quat_WB)]
    for i, link in enumerate(geometry.links):
        p_WP, quat_WP = poses[link.parent + 1]
        p, quat = link.pose(q[:, i])
        poses.append((p_WP + np.einsum("nij,nj->ni", rotation_matrix(quat_WP), p), quat_product(quat_WP, quat)))
    data = mujoco.MjData(model)
    for k in range(20):
        data.qpos[:] = *p_WB[k], *quat_WB[k], *q[k]
        mujoco.mj_kinematics(model, data)
        for link, (p, quat) in zip(geometry.links, poses[1:], strict=True):
            body = data.body(link.name)
            np.testing.assert_allclose(p[k], body.xpos, atol=1e-13)
            np.testing.assert_allclose(rotation_matrix(quat[k]), body.xmat.reshape(3, 3), atol=1e-13)
            for shape, geom in zip(link.shapes, geoms_of(model, link.name), strict=True):
                R = rotation_matrix(quat[k])
                np.testing.assert_allclose(p[k] + R @ shape.position, data.geom_xpos[geom], atol=1e-13)
                R_shape = R @ rotation_matrix(np.array(shape.quat))
                np.testing.assert_allclose(R_shape, data.geom_xmat[geom].reshape(3, 3), atol=1e-13)


def geoms_of(model, link: str) -> list[int]:
    """Geoms of a link and of the bodies welded to it, in the order of the model."""
    return [g for g in range(model.ngeom) if model.body_weldid[model.geom_bodyid[g]] == model.body(link).id]


def test_a_geometry_with_links_is_read_back_and_a_wrong_one_is_refused():
    model = random_tree(np.random.default_rng(3), 4)
    geometry = Geometry.of(model, 1, links_of(model))
    read = Geometry.from_json(geometry.to_json())
    assert (read.links, read.shapes, read.reach) == (geometry.links, geometry.shapes, geometry.reach)
    assert (geometry.links[0].range, geometry.links[0].effort) == (None, 0.0)
    assert b"links" not in Geometry.of(model, 1).to_json()
    turned = geometry.to_json().replace(b'"parent":-1', b'"parent":3')
    with pytest.raises(InputError, match="link 'link 0' must come after its parent"):
        Geometry.from_json(turned)
