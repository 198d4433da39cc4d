"""The scene: arrows stay in it, and solids are closed."""

import numpy as np
import pytest

from uvms_mj.files import shipped
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.records import scene
from uvms_mj.views.rerun.solids import solids


def test_arrows_of_a_strong_vehicle_stay_in_the_scene_and_both_viewers_have_one_scale(trace):
    header = trace.header
    span = scene.span(header)
    assert scene.force_scale(header) == scene.force_scale(header, 19.0) == scene.FORCE_SCALE
    for largest in (19.0, 30.1, 1e3, 4.7e5):
        scale = scene.force_scale(header, largest)
        assert scale * largest <= span
        assert scale == scene.FORCE_SCALE or 2.5 * scale * largest > span, "not smaller than necessary"
        assert float(f"{scale:.1g}") == pytest.approx(scale, rel=1e-12), "a round number"
    forces = np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 2.0], [3e5, 0.0, 4e5]])
    drawn = scene.arrows(forces, scene.FORCE_SCALE, span)
    np.testing.assert_allclose(drawn[:2], scene.FORCE_SCALE * forces[:2], rtol=1e-15)
    assert np.linalg.norm(drawn[2]) == pytest.approx(span)
    np.testing.assert_allclose(np.cross(drawn[2], forces[2]), 0.0, atol=1e-6)


@pytest.mark.parametrize("name", shipped("models"))
def test_solids_are_closed_and_have_their_volume(name):
    geometry = Mjcf.find(name).geometry
    for solid in solids(geometry):
        np.testing.assert_allclose(np.linalg.norm(solid.normals, axis=1), 1.0, atol=1e-5)
        a, b, c = (solid.vertices[solid.triangles[:, i]].astype(float) for i in range(3))
        area = np.cross(b - a, c - a)
        np.testing.assert_allclose(area.sum(axis=0), 0.0, atol=1e-6)  # closed
        outwards = np.einsum("ij,ij->i", area, solid.normals[solid.triangles[:, 0]])
        assert np.mean(outwards[np.linalg.norm(area, axis=1) > 1e-12] > 0.0) > 0.98
    reach = max(solid.vertices[:, 0].max() for solid in solids(geometry))
    assert reach == pytest.approx(geometry.reach, abs=1e-3)
