"""docs/how_to/arm.md: its file is complete and runs. docs/physics/arms.md: its errors are those that come."""

import re
from pathlib import Path

import numpy as np
import pytest

from page_numbers import page
from uvms_mj import InputError, Scenario, simulate
from uvms_mj.files import shipped
from uvms_mj.plant.mjcf import Mjcf

ROOT = Path(__file__).parents[2]
PAGE = page("arm").read_text()
FILE = ROOT / "examples" / "bluerov1_two_joints.xml"
ROV = FILE.read_text()
LINKS, WATER, MOTORS = re.findall(r"```xml\n(.*?)```", PAGE, re.DOTALL)

MOVES, PUSHES = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)


def test_the_file_is_the_vehicle_with_the_three_parts_of_the_page():
    text = shipped("models")["bluerov1"].read_text()
    for part, end in ((LINKS, "    </body>\n  </worldbody>"), (WATER, "  </custom>"), (MOTORS, "  </actuator>")):
        assert text.count(end) == 1
        text = text.replace(end, part + end)
    assert text == ROV


def scenario(tmp_path, *parts: str) -> Scenario:
    (tmp_path / FILE.name).write_text(ROV)
    (tmp_path / "mine.toml").write_text("".join(parts))
    return Scenario.load(str(tmp_path / "mine.toml"), {"simulation.duration": 6.0})


@pytest.mark.slow
def test_the_joints_go_where_the_scenario_of_the_page_says(tmp_path):
    trace = simulate(scenario(tmp_path, MOVES))
    assert np.allclose(trace.q[0], [0.5, -1.0], atol=1e-12)
    assert np.abs(trace.q[-1] - [0.0, 0.6]).max() < 1e-3
    assert np.abs(trace.q_dot).max() < 1.01  # the speed limit
    assert 0.1 < np.abs(trace.tau_q).max() <= 5.0
    assert np.abs(trace.nu[:, 4]).max() > 1e-3  # the arm moves the vehicle


def test_the_tool_rests_with_the_force_of_the_page(tmp_path):
    trace = simulate(scenario(tmp_path, PUSHES).updated({"simulation.duration": 14.0}))
    expected = 150.0 * 0.02 / (1.0 + 150.0 / 1e5)
    assert trace.push[-1] == pytest.approx(expected, rel=1e-4)
    assert trace.touches[-1] <= 3


def test_gears_that_stick_keep_the_tool_from_resting(tmp_path):
    (tmp_path / "sticky.xml").write_text(ROV.replace('damping="0.5"', 'damping="0.5" frictionloss="0.1"'))
    sticky = scenario(tmp_path, PUSHES.replace(FILE.stem, "sticky"))
    assert simulate(sticky.updated({"simulation.duration": 10.0})).touches[-1] > 10


WHITE = '<geom type="capsule" size="0.025" fromto="-0.1 0 0 0.1 0 0" mass="0.5" rgba=".85 .87 .9 1"/>'
ERRORS = {
    "body 'forearm': moves on": ('<numeric name="forearm.strip_theory" data="1.0 1.1"/>', ""),
    "foream.strip_theory": ('"forearm.strip_theory"', '"foream.strip_theory"'),
    "jaw.M_A": ('<site name="tool"', '<body name="jaw"/><site name="tool"'),
    "forearm.strip_theory: body": (WHITE, '<geom type="box" size=".1 .02 .02" mass="0.5"/>'),
    "geom '108'": ('mass="0.5"', 'mass="0.5" contype="1" conaffinity="1"'),
    "<joint type": ('<joint name="elbow" axis="0 1 0" pos="-0.1 0 0" range="-120 120"', '<joint type="ball"'),
    "body 'forearm': a link has": (
        '<body name="forearm" pos="0.2 0 0">',
        '<body name="forearm" pos="0.2 0 0"><joint name="roll" axis="1 0 0"/>',
    ),
    "<joint name": ('name="elbow" axis', 'name="elbow" stiffness="3" axis'),
    "elbow: ctrlrange": ('joint="elbow" gear="1" ctrlrange="-5 5"', 'joint="elbow" gear="1" ctrlrange="-5 9"'),
    "shoulder: its wrench": ('<motor name="shoulder" joint="shoulder" gear="1"', '<motor name="shoulder" site="tool"'),
}
"""Beginning of each message of the page, and an edit of the file that gives it."""
MESSAGES = re.findall(r"^\| `(.*?)` \|", page("arms").read_text().partition("## Errors")[2], re.MULTILINE)


@pytest.mark.parametrize("message", [each for each in MESSAGES if "joints.target" not in each])
def test_an_error_of_the_page_comes(message, tmp_path):
    (edit,) = (edit for beginning, edit in ERRORS.items() if message.startswith(beginning))
    assert edit[0] in ROV
    text = ROV.replace(*edit)
    if message.startswith("jaw"):
        text = text.replace("</custom>", '<numeric name="jaw.M_A" data="1"/></custom>')
    if message.startswith("forearm.strip"):
        text = text.replace(
            'size="0.025" fromto="-0.1 0 0 0.1 0 0" mass="0.5" type="box"', 'size=".1 .1 .1" mass="0.5"'
        )
        text = text.replace('<geom type="capsule" size=".1', '<geom type="box" size=".1')
    with pytest.raises(InputError) as error:
        _ = Mjcf("mine.xml", {"mine.xml": text.encode()}).vehicle
    assert message.removesuffix(" ...").removesuffix(",") in str(error.value)


def test_every_message_of_the_page_is_tried(tmp_path):
    assert len(MESSAGES) == len(ERRORS) + 1
    joints = f'[vehicle]\nmodel = "{FILE.name}"\n[joints]\nname = "position"\ntarget = [0.0, 1.0, 2.0]\n'
    with pytest.raises(InputError, match="has 3 values; the vehicle has 2 joints: shoulder, elbow"):
        simulate(scenario(tmp_path, joints))
