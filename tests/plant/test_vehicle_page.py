"""Numbers from elsewhere: the page's function and its table of angles."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "how_to" / "vehicle_numbers.md").read_text()


def test_the_matrix_about_the_origin_has_the_energy_of_the_matrix_about_the_point():
    (block,) = [each for each in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if "def about_origin" in each]
    page: dict = {}
    exec(block.rpartition("print(")[0], page)
    rng = np.random.default_rng(1)
    M, r, nu = rng.normal(size=(6, 6)), rng.normal(size=3), rng.normal(size=6)
    M = M @ M.T
    at_point = np.concatenate([nu[:3] + np.cross(nu[3:], r), nu[3:]])
    assert nu @ page["about_origin"](M, r) @ nu == pytest.approx(at_point @ M @ at_point, rel=1e-12)


@pytest.mark.parametrize("sequence", ["xyz", "XYZ"])
def test_the_pages_directions_are_those_of_the_two_conventions(sequence):
    """MuJoCo's, and the rotation about the fixed axes x, y, z, which is written out here."""
    row = next(line for line in PAGE.splitlines() if line.startswith("|") and f'eulerseq="{sequence}"' in line)
    said = [float(x) for x in row.split("|")[2].split(",")]
    compiler = f'<compiler angle="degree" eulerseq="{sequence}"/>'
    site = '<worldbody><site euler="0 -74.53 -53.21"/></worldbody>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{compiler}{site}</mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    assert np.allclose(data.site_xmat[0].reshape(3, 3)[:, 0], said, rtol=0.0, atol=5.1e-4)
    pitch, yaw = np.radians([-74.53, -53.21])
    fixed = [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)]
    assert np.allclose(fixed, said, rtol=0.0, atol=5.1e-4) is (sequence == "XYZ")
