"""A vehicle with an arm for tests: MJCF of a base with one motor per axis, links with full matrices, and a tool."""

import numpy as np

from vehicles import dissipative

_AXES = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.2), (0.3, 0.0, 1.0))


def _numbers(values) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(values))


def armed_xml(joints: int = 4, seed: int = 0, motors: bool = True, water: bool = True) -> str:
    """A vehicle of 12 kg and a chain of ``joints`` links of 0.25 m along x, the second one on a slide if there are
    five. The site ``tool`` is at the end of the last link, ``origin`` at B. Without ``water`` there is neither weight
    nor drag nor added mass on the links."""
    rng = np.random.default_rng(seed)
    numerics = {"M_A": np.diag([6.0, 9.0, 12.0, 0.3, 0.4, 0.35]), "center_of_buoyancy": [0.0, 0.0, 0.02]}
    numerics |= {"D_linear": dissipative(rng, 8.0), "D_quadratic": dissipative(rng, 20.0), "displaced_mass": 12.05}
    inside = '<site name="tool" pos="0.13 0.01 -0.02" euler="10 -20 30" size="0.02"/>'
    for k in range(joints, 0, -1):
        a = rng.normal(size=(6, 6))
        numerics[f"link{k}.M_A"] = (a @ a.T + 0.5 * np.eye(6)) * np.outer(*[[0.3] * 3 + [0.04] * 3] * 2)
        scale = np.diag([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
        numerics[f"link{k}.D_linear"] = scale @ dissipative(rng, 1.0) @ scale
        numerics[f"link{k}.D_quadratic"] = scale @ dissipative(rng, 3.0) @ scale
        numerics[f"link{k}.displaced_mass"], numerics[f"link{k}.center_of_buoyancy"] = 0.5, [0.01, 0.0, 0.005]
        kind = "slide" if joints >= 5 and k == 2 else "hinge"
        limits = 'range="-20 20"' if kind == "slide" else 'range="-170 170"'
        place = "0.2 0.05 -0.1" if k == 1 else "0.25 0 0"
        inside = f"""<body name="link{k}" pos="{place}" euler="0 {5 * k} {-7 * k}">
            <joint name="joint{k}" type="{kind}" axis="{_numbers(_AXES[(k - 1) % 5])}" pos="-0.12 0 0.01"
             {limits} damping="0.02" armature="0.003"/>
            <inertial pos="0.01 0.02 -0.01" mass="0.7" diaginertia="0.002 0.004 0.0045"/>{inside}</body>"""
    if not water:
        numerics = {name: np.zeros_like(value) for name, value in numerics.items() if name.startswith("link")} | {
            "M_A": np.diag([6.0, 9.0, 12.0, 0.3, 0.4, 0.35]),
            "D_linear": np.zeros((6, 6)),
            "D_quadratic": np.zeros((6, 6)),
            "displaced_mass": 0.0,
        }
    custom = "".join(f'<numeric name="{k}" size="{np.size(v)}" data="{_numbers(v)}"/>' for k, v in numerics.items())
    thrusters = "".join(f'<motor name="m{i}" site="origin" gear="{_numbers(np.eye(6)[i])}"/>' for i in range(6))
    driven = "".join(f'<motor joint="joint{k}" gear="1" ctrlrange="-50 50"/>' for k in range(1, joints + 1))
    return f"""<mujoco><compiler angle="degree"/><option gravity="0 0 {-9.81 if water else 0.0!r}"/>
    <custom>{custom}</custom>
    <worldbody><body name="rov"><freejoint/><site name="origin"/>
    <inertial pos="0.01 0 -0.02" mass="12" diaginertia="0.2 0.3 0.25"/>{inside}</body></worldbody>
    <actuator>{thrusters}{driven if motors else ""}</actuator></mujoco>"""
