"""A vehicle with an arm of five joints for tests: a small file, with a tool at the tip."""

import math
import re
from pathlib import Path

_LINKS = (  # name, axis, length [m], mass [kg], displaced mass [kg], radius [m]
    ("shoulder", "0 0 1", 0.08, 0.5, 0.3, 0.035),
    ("upper_arm", "0 1 0", 0.22, 0.8, 0.6, 0.03),
    ("forearm", "0 1 0", 0.20, 0.6, 0.45, 0.028),
    ("wrist", "0 1 0", 0.10, 0.35, 0.3, 0.025),
    ("hand", "1 0 0", 0.09, 0.25, 0.15, 0.02),
)
JOINTS = len(_LINKS)
_THRUSTERS = (  # x, y, z [m], angles of its frame [deg]
    (".156 -.111 -.085", "0 0 45"),
    (".156 .111 -.085", "0 0 -45"),
    ("-.156 -.111 -.085", "0 0 135"),
    ("-.156 .111 -.085", "0 0 -135"),
    (".12 -.218 0", "0 -90 0"),
    (".12 .218 0", "0 -90 0"),
    ("-.12 -.218 0", "0 -90 0"),
    ("-.12 .218 0", "0 -90 0"),
)


def arm_file(folder: Path, name: str = "armed", loose: bool = False) -> Path:
    """Write the file of a vehicle like a BlueROV2 Heavy with an arm. Each link's frame is at its middle, x along it.

    A ``loose`` one has no damping, and joints without motors.
    """
    numerics, arm, motors, at, before = [], "", [], "0.25 0 -0.06", 0.0
    for link, axis, length, mass, displaced, radius in _LINKS:
        half, volume = 0.5 * length, math.pi * radius**2 * length
        drag, twist, swing = 1100.0 * radius * length, 0.5 * mass * radius**2, mass * length**2 / 12.0
        turning = 1000.0 * volume * length**2 / 12.0
        of_link = {
            "displaced_mass": f"{displaced}",
            "center_of_buoyancy": "0.003 0 0.004",
            "M_A": _diagonal(0.1 * mass, 1e3 * volume, 1e3 * volume, 0.1 * twist, turning, turning),
            "D_linear": _diagonal(0.5, 0.5, 0.5, 0.02, 0.02, 0.02),
            "D_quadratic": _diagonal(0.3 * drag, drag, drag, 1e-3, 0.02 * drag, 0.02 * drag),
        }
        numerics += [f'<numeric name="{link}.{key}" data="{data}"/>' for key, data in of_link.items()]
        place = at if not before else f"{before + half} 0 0"
        arm += (
            f'<body name="{link}" pos="{place}"><joint name="{link}" axis="{axis}" pos="{-half} 0 0" damping="0.2"/>'
            f'<inertial mass="{mass}" pos="0.01 0 0" diaginertia="{twist} {swing} {swing}"/>'
            f'<geom type="capsule" fromto="{-half} 0 0 {half} 0 0" size="{radius}"/>'
        )
        motors.append(f'<motor name="{link}" joint="{link}" ctrlrange="-60 60"/>')
        before = half
    arm += f'<site name="tool" pos="{before} 0 0" size="0.02"/>' + "</body>" * JOINTS
    sites = [f'<site name="t{i}" pos="{pos}" euler="{euler}"/>' for i, (pos, euler) in enumerate(_THRUSTERS)]
    motors += [f'<motor name="t{i}" site="t{i}" gear="1 0 0 0 0 0" ctrlrange="-60 60"/>' for i in range(8)]
    path = folder / f"{name}.xml"
    text = (
        f'<mujoco model="{name}"><option cone="elliptic"/>{_DRAWN}'
        f"<custom>{_BASE}{''.join(numerics)}</custom><worldbody>"
        f'<body name="{name}"><freejoint/><inertial mass="13.5" pos="0 0 0" diaginertia="0.26 0.23 0.37"/>'
        f'<geom type="box" size="0.22 0.16 0.12"/>{"".join(sites)}{arm}</body></worldbody>'
        f"<actuator>{''.join(motors)}</actuator></mujoco>"
    )
    if loose:
        text = re.sub(r'(name="[a-z_.]*D_(linear|quadratic)" data=")[^"]*', rf"\g<1>{_diagonal(*[0.0] * 6)}", text)
        text = re.sub(r'<motor name="[a-z_]*" joint[^>]*>', "", text.replace('damping="0.2"', ""))
    path.write_text(text)
    return path


def _diagonal(*values: float) -> str:
    return " ".join(str(value if i == j else 0.0) for i, value in enumerate(values) for j in range(6))


_BASE = (
    f'<numeric name="M_A" data="{_diagonal(6.36, 7.12, 18.68, 0.189, 0.135, 0.222)}"/>'
    f'<numeric name="D_linear" data="{_diagonal(13.7, 8.0, 33.0, 0.3, 0.8, 0.3)}"/>'
    f'<numeric name="D_quadratic" data="{_diagonal(141.0, 217.0, 190.0, 1.19, 0.47, 1.5)}"/>'
    '<numeric name="displaced_mass" data="14.2"/><numeric name="center_of_buoyancy" data="0.02 0 0.02"/>'
)
"""Neutral together with the arm, and stable in roll and pitch."""
_DRAWN = '<default><geom mass="0" contype="0" conaffinity="0"/></default>'
"""All geoms are for drawing."""
