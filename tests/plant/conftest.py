"""A vehicle without damping, for tests of contact."""

import re
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def slippery(tmp_path_factory) -> Path:
    """A BlueROV1 without hydrodynamic damping, so that only friction slows it down."""
    xml = (Path(__file__).parents[2] / "models" / "bluerov1.xml").read_text()
    for derivative in ("X_u", "Y_v", "Z_w", "K_p", "M_q", "N_r"):
        for name in (derivative, derivative + derivative[-1]):
            xml, n = re.subn(rf'(<numeric name="{name}" data=)"[^"]*"', r'\1"0"', xml)
            assert n == 1
    path = tmp_path_factory.mktemp("vehicle") / "slippery.xml"
    path.write_text(xml)
    return path
