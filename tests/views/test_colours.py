"""Colours of runs and of lines."""

import itertools

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from uvms_mj.views import colours
from uvms_mj.views.figures.panels import JOINTS
from uvms_mj.views.figures.style import COLOURS

SEEN = {
    "normal": np.eye(3),
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
}
"""How linear red, green and blue are seen (Machado, Oliveira and Fernandes, IEEE TVCG 15(6), 2009, severity 1)."""
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def lab(colour, eyes):
    """CIE L*, a*, b* of a colour as some eyes see it; a distance of 2 can just be seen."""
    c = np.array(to_rgb(colour))
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    seen = XYZ @ np.clip(SEEN[eyes] @ linear, 0.0, 1.0) / XYZ.sum(axis=1)
    x, y, z = np.where(seen > 0.008856, np.cbrt(seen), 7.787 * seen + 16.0 / 116.0)
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


def test_colours_of_runs_are_different_and_a_law_keeps_its_own():
    alone = {law: colours.of_runs([law])[0] for law in colours.LAWS}
    assert len(set(alone.values())) == len(alone)
    assert dict(zip(alone, colours.of_runs(list(alone)), strict=True)) == alone
    sweep = colours.of_runs(["gsta"] * 20 + ["a.py:A", "b.py:B"] + ["fosm"])
    assert len(set(sweep)) == 23
    assert sweep[-1] == alone["fosm"]


@pytest.mark.parametrize("eyes", SEEN)
def test_colours_of_joints_differ_from_each_other_and_from_those_of_components(eyes):
    for one, two in [*itertools.combinations(JOINTS, 2), *itertools.product(JOINTS, COLOURS.values())]:
        assert np.linalg.norm(lab(one, eyes) - lab(two, eyes)) > 12.0, (one, two)


def test_neighbouring_joints_differ_in_grey():
    lightness = [lab(colour, "normal")[0] for colour in JOINTS]
    assert np.abs(np.diff(lightness)).min() > 15.0


@pytest.mark.parametrize("colour", [*colours.LAWS.values(), (0, 0, 0), (255, 255, 255), (235, 235, 235)])
def test_text_is_read_on_a_light_and_on_a_dark_ground(colour):
    """WCAG 2.1 asks for a contrast of 3 of large text."""
    found = colours.luminance(colours.legible(colour))
    assert 1.05 / (found + 0.05) > 4.0
    assert (found + 0.05) / 0.05 > 4.0
