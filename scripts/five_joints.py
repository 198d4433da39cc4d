"""A vehicle with five joints at the wall, for the benchmark: the Reach Alpha 5 whose jaw turns as well.

Its gears have no Coulomb friction and its motors are fast, so that it obeys the torques of a law.
"""

import re
import tempfile
from pathlib import Path

from uvms_mj import Scenario
from uvms_mj.files import shipped
from uvms_mj.setup.base import set_up

JAW = '<body name="jaw" pos="0 0 -.092">'
FIFTH_JOINT = '<joint name="axis_a" axis="1 0 0" damping=".2"/>'
MOTOR = '<motor name="axis_a" joint="axis_a" ctrlrange="-5 5"/>'
WATER = '<numeric name="jaw.displaced_mass" data=".02"/>' + "".join(
    f'<numeric name="jaw.{name}" data="{-value}"/>'
    for name, value in zip(
        ("X_udot", "Y_vdot", "Z_wdot", "K_pdot", "M_qdot", "N_rdot"), (0.02, 0.02, 0.0, 0.0, 0.0, 0.0), strict=True
    )
)
POSTURE = [0.3, 1.0, 1.2, 0.4, 0.2]
"""Positions of the joints at the start [rad], away from their limits."""


def five_joints() -> Path:
    """The file of the vehicle."""
    text = shipped("models")["bluerov2_alpha5"].read_text()
    assert JAW in text
    path = Path(tempfile.mkdtemp(), "alpha5_with_jaw.xml")
    text = re.sub(r' frictionloss="[^"]*"|<numeric name="[^"]*speed_limit"[^>]*/>', "", text)
    for place, added in ((JAW, FIFTH_JOINT), ("<custom>", WATER), ("<actuator>", MOTOR)):
        text = text.replace(place, place + added)
    path.write_text(text)
    return path


def tool_at_wall(contact: bool) -> Scenario:
    """GSTA at the tool, 10 mm behind the wall's face or far away from it."""
    keys = {"vehicle.model": str(five_joints()), "initial.joints": POSTURE, "task.frame": "tool"}
    scenario = Scenario.load("push_wall", keys | {"reference.step_time": 0.0})
    start = set_up(scenario).initial
    x, y, z = start.position
    target = {"reference.target": [x + 0.01, y, z], "reference.attitude_deg": list(start.attitude_deg)}
    return scenario.updated(target | {"wall.position": x if contact else x + 5.0})
