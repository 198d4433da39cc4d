"""docs/how_to/arm.md: the weight of its arm in water, and the force of its tool."""

import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from page_look import DOCS
from page_numbers import page
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.plant.mjcf import Mjcf

FILE = DOCS.parent / "examples" / "bluerov1_two_joints.xml"


def pressed() -> Trace:
    """The scenario of the page in which the tool pushes."""
    _, scenario = re.findall(r"```toml\n(.*?)```", page("arm").read_text(), re.DOTALL)
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, FILE.name).write_text(FILE.read_text())
        Path(folder, "tool.toml").write_text(scenario)
        return simulate(Scenario.load(f"{folder}/tool.toml", {"simulation.duration": 14.0}), log_rate=100)


def numbers() -> Iterator[tuple]:
    vehicle = Mjcf.find(str(FILE)).vehicle
    heavy = sum(each.mass - each.displaced_mass for each in (vehicle, *vehicle.arm.links))
    yield "is {} kg heavier than its water, {} N", heavy, 9.81 * heavy
    yield "The tool rests on the wall with {} N", pressed().push[-1]
    slide = simulate(Scenario.load("tool_slide"))
    sliding = np.linalg.norm(slide.f_contact_W[:, 1:], axis=1)[slide.t > 0.5 * slide.t[-1]].max()
    along = slide.f_contact_W[-1, 0]
    yield "on the tool is {} N along x and, while it slides, $\\mu$ 10 N = {} N", (along, 0.05), (sliding, 0.1)
