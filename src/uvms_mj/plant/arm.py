"""The arm of a vehicle: its links, joints and sites, read from the MJCF, and the coefficients that a link and the base
have in common.

**Links.** A body below the vehicle's base that has a joint, a hinge or a slide, is a *link*. A body without a joint is
part of the body that carries it. Each link has coefficients of its own, ``<numeric>`` entries whose names begin with
the name of the link's body and a dot, for example ``upper_arm.displaced_mass``. They are described in
:mod:`.coefficients`, about the origin of the link's body frame and in its axes.

**Friction and stops.** A joint has Coulomb friction of its gear, with stick, and the stops of its range. Both are rows
of MuJoCo's constraint solver, which is implicit: they need no smaller time step, whatever the inertia. With the inverse
inertia w of the joint (``dof_invweight0``), the time step h, the impedance d and the time constant T of solref:

- Friction: a joint that slips is given exactly the friction torque. A joint that sticks under the load tau creeps with
  the velocity ``(1 - d) T / 2 w tau``, because MuJoCo's friction is a stiff damper below its limit. T = 2 h is the
  least that MuJoCo allows, and d = 0.9999 the greatest. A joint that stops does so in one step. Added mass changes
  neither. Rotors of unknown inertia are often left out, and the inertia about a forearm's own axis is then so small
  that w tau is large. The constraints are therefore computed with a hundredth of w, and the velocity is
  1e-6 h w tau. With a ten-thousandth MuJoCo's solver does not always converge.
- Stops: a stop is a critically damped spring of the stiffness ``1 / (T^2 (1 - d) 0.01 w)``, whose time constant is T.
"""

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from ..errors import Fault
from ..physics.tree import FRAME, MOST_JOINTS
from .coefficients import numeric, water_of


@dataclass(frozen=True, eq=False)
class Body:
    """Coefficients of a body about the origin of its frame, in its axes, as read-only arrays."""

    M_RB: np.ndarray
    """(6, 6) rigid-body inertia [kg, kg m, kg m^2]."""
    M_A: np.ndarray
    """(6, 6) added mass [kg, kg m, kg m^2]."""
    D_linear: np.ndarray
    """(6, 6) linear damping; D(nu) nu = D_linear nu + D_quadratic (abs(nu) nu) [N s/m, N s, N m s]."""
    D_quadratic: np.ndarray
    """(6, 6) quadratic damping: D_quadratic[i, j] multiplies abs(nu_j) nu_j [N s^2/m^2, N s^2/m, N s^2, N m s^2]."""
    displaced_mass: float
    """[kg]"""
    r_b: np.ndarray
    """(3,) centre of buoyancy [m]."""

    @functools.cached_property
    def M(self) -> np.ndarray:
        """(6, 6) M = M_RB + M_A."""
        M = self.M_RB + self.M_A
        M.setflags(write=False)
        return M

    @property
    def mass(self) -> float:
        """Rigid mass [kg]."""
        return float(self.M_RB[0, 0])

    @property
    def r_g(self) -> np.ndarray:
        """(3,) centre of gravity [m]: M_RB[3:, :3] = m S(r_g)."""
        return np.array([self.M_RB[5, 1], self.M_RB[3, 2], self.M_RB[4, 0]]) / (self.mass or 1.0)


def skew(a: np.ndarray) -> np.ndarray:
    """S(a) (3, 3): S(a) b = a x b."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE


@dataclass(frozen=True, eq=False)
class Link(Body):
    """One link and the joint that carries it. Arrays are in the link's frame unless said otherwise.

    Attributes:
        name, joint: of the link's body and of its joint, without the prefix of an attached model.
        body_id: index of the body in the compiled model.
        parent: index of the link that carries it, -1 for the base.
        slide: whether the joint is a slide.
        p_0, R_0: (3,), (3, 3) pose in the parent's frame at q = 0 [m].
        axis: (3,) of the joint.
        anchor: (3,) a point of the hinge's axis [m].
        filled_in: names of the coefficients that strip theory gave, and not the file.
        range: least and greatest q [rad or m], infinite without limits.
        effort: greatest torque of the motor [N m or N], 0 without a motor.
        speed_limit: of the motor [rad/s or m/s], infinite if it is not given.
        damping: viscous friction of the gear [N m s or N s/m].
        friction: Coulomb friction of the gear [N m or N].
        armature: inertia of the rotor, as the joint sees it [kg m^2 or kg].
        actuator_id: index of the motor in mjData.ctrl, -1 without one.
        torque_of_ctrl: torque per unit of mjData.ctrl [N m or N].
    """

    name: str
    joint: str
    body_id: int
    parent: int
    slide: bool
    p_0: np.ndarray
    R_0: np.ndarray
    axis: np.ndarray
    anchor: np.ndarray
    filled_in: tuple[str, ...]
    range: tuple[float, float]
    effort: float
    speed_limit: float
    damping: float
    friction: float
    armature: float
    actuator_id: int
    torque_of_ctrl: float

    @functools.cached_property
    def S(self) -> np.ndarray:
        """(6,) velocity of the link's origin per unit of q_dot, in the link's axes, linear first."""
        if self.slide:
            return np.concatenate([self.axis, np.zeros(3)])
        return np.concatenate([np.cross(self.anchor, self.axis), self.axis])

    @property
    def unit(self) -> str:
        """Unit of q."""
        return "m" if self.slide else "rad"

    def out_of_range(self, q: float, slack: float = 0.0) -> str:
        """Why the joint can't be given the position q; empty if it is in the range, or at most ``slack`` beyond it."""
        low, high = self.range
        if low - slack <= q <= high + slack:
            return ""
        said, turned = f"{q:g} is outside the range of {self.joint}, {low:g} to {high:g} {self.unit}", math.radians(q)
        if self.slide or not low <= turned <= high:
            return said
        return f"{said} (in degrees? {q:g} deg are {turned:.3g} rad)"


@dataclass(frozen=True, eq=False)
class Site:
    """A named site: the link that carries it (-1: the base), its pose p (3,) [m], R (3, 3) in that link's frame, and
    the radius of the sphere at it [m]."""

    link: int
    p: np.ndarray
    R: np.ndarray
    radius: float


@dataclass(frozen=True, eq=False)
class Arm:
    """The links of a vehicle, each behind the link that carries it, as MuJoCo orders its joints, and the sites of the
    whole vehicle by name. A rigid vehicle has no links."""

    links: tuple[Link, ...] = ()
    sites: Mapping[str, Site] = field(default_factory=dict)

    def start(self, joints: tuple[float, ...] | None) -> np.ndarray:
        """(n,) initial positions of the joints, by default zero or the end of the range next to it [rad or m]."""
        if joints is not None:
            return np.array(joints, float)
        return np.array([min(max(0.0, link.range[0]), link.range[1]) for link in self.links])

    @functools.cached_property
    def frames(self) -> np.ndarray:
        """FRAME records (1 + n,) of the base and the links."""
        frames = np.zeros(1 + len(self.links), FRAME)
        frames["R_BL"][0] = np.eye(3)
        for record, link in zip(frames[1:], self.links, strict=True):
            record["parent"], record["depth"] = link.parent + 1, frames["depth"][link.parent + 1] + 1
            record["axis"], record["p_0"], record["R_still"] = link.S, link.p_0, link.R_0
            if link.slide:
                record["slope"] = link.R_0 @ link.axis
            else:  # Rodrigues' formula
                along = link.R_0 @ np.outer(link.axis, link.axis)
                record["R_still"], record["R_cos"] = along, link.R_0 - along
                record["R_sin"] = link.R_0 @ np.cross(link.axis, np.eye(3)).T
                record["anchor"], record["p_0"] = link.anchor, link.p_0 + link.R_0 @ link.anchor
        frames.setflags(write=False)
        return frames

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the links in their order."""
        return tuple(link.name for link in self.links)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints in their order."""
        return tuple(link.joint for link in self.links)


def moving_bodies(model: mujoco.MjModel, base: int) -> list[int]:
    """The bodies below the base that have a joint, in their order."""
    return [int(i) for i in np.flatnonzero((model.body_rootid == base) & (model.body_dofnum > 0)) if i != base]


def read_arm(model: mujoco.MjModel, base: int, prefix: str, faults: list[Fault]) -> Arm:
    """Read the links and the sites of a vehicle whose free joint is on the body ``base``. Errors are appended to
    ``faults``; ``prefix`` stands before the names of an attached model."""
    data = mujoco.MjData(model)
    data.qpos[model.jnt_qposadr[model.body_jntadr[base]] + 3] = 1.0
    bodies = moving_bodies(model, base)
    for body in bodies:
        data.qpos[model.jnt_qposadr[model.body_jntadr[body]]] = 0.0
    mujoco.mj_kinematics(model, data)
    numbers = {base: -1} | {body: k for k, body in enumerate(bodies)}
    if len(bodies) > MOST_JOINTS:
        faults.append(Fault("<joint>", f"the vehicle has {len(bodies)} joints; at most {MOST_JOINTS} are computed"))
    links = [_link(model, data, body, numbers, prefix, faults) for body in bodies]
    sites = {}
    for i in range(model.nsite):
        carrier = int(model.body_weldid[model.site_bodyid[i]])
        name = model.site(i).name
        if carrier in numbers and name.startswith(prefix):
            R_WL = data.xmat[carrier].reshape(3, 3)
            p = R_WL.T @ (data.site_xpos[i] - data.xpos[carrier])
            R = R_WL.T @ data.site_xmat[i].reshape(3, 3)
            sites[name.removeprefix(prefix)] = Site(numbers[carrier], p, R, float(model.site_size[i, 0]))
    return Arm(tuple(links), sites)


@np.errstate(invalid="ignore")  # mass and inertia that are not finite are refused with the result
def rigid_inertia(model: mujoco.MjModel, data: mujoco.MjData, carrier: int) -> np.ndarray:
    """M_RB (6, 6) about the origin of a body's frame, in its axes, of the body and of all bodies welded to it."""
    M_RB, R_WL = np.zeros((6, 6)), data.xmat[carrier].reshape(3, 3)
    for body in np.flatnonzero(model.body_weldid == carrier):
        m = float(model.body_mass[body])
        R = R_WL.T @ data.ximat[body].reshape(3, 3)
        S = skew(R_WL.T @ (data.xipos[body] - data.xpos[carrier]))
        M_RB[:3, :3] += m * np.eye(3)
        M_RB[:3, 3:] -= m * S
        M_RB[3:, :3] += m * S
        M_RB[3:, 3:] += R @ np.diag(model.body_inertia[body]) @ R.T - m * S @ S
    return 0.5 * (M_RB + M_RB.T)


def _link(
    model: mujoco.MjModel, data: mujoco.MjData, body: int, numbers: Mapping[int, int], prefix: str, faults: list[Fault]
) -> Link:
    joint, dof = int(model.body_jntadr[body]), int(model.body_dofadr[body])
    name, kind = model.body(body).name, int(model.jnt_type[joint])
    called = f"body {name or body!r}"
    if not name:
        faults.append(Fault(called, "has a joint and no name: name it, its coefficients are named after it"))
    if model.body_dofnum[body] != 1 or kind not in (_HINGE, _SLIDE):
        faults.append(Fault(called, "a link has one joint, a hinge or a slide; put a further joint on a body between"))
    if model.qpos0[model.jnt_qposadr[joint]] != 0.0:
        faults.append(Fault(called, "its joint's ref must be 0"))
    carrier = int(model.body_weldid[model.body_parentid[body]])
    R_WP, R_WL = data.xmat[carrier].reshape(3, 3), data.xmat[body].reshape(3, 3)
    limits = tuple(model.jnt_range[joint].tolist()) if model.jnt_limited[joint] else (-np.inf, np.inf)
    water = water_of(model, data, body, faults)
    actuator, torque, effort = _motor(model, joint, faults)
    joint_name = model.joint(joint).name or name
    speed = numeric(model, f"{joint_name}.speed_limit", 1, faults, np.array([np.inf]))[0]
    if speed <= 0.0:
        faults.append(Fault(f"{joint_name}.speed_limit", f"{speed:g}: must be positive"))
    arrays: dict[str, Any] = {
        "p_0": R_WP.T @ (data.xpos[body] - data.xpos[carrier]),
        "R_0": R_WP.T @ R_WL,
        "axis": model.jnt_axis[joint].copy(),
        "anchor": model.jnt_pos[joint].copy(),
        "M_RB": rigid_inertia(model, data, body),
        **water,
    }
    if not np.isfinite(arrays["M_RB"]).all():
        faults.append(Fault(called, "its mass or inertia is not finite"))
    for array in arrays.values():
        if isinstance(array, np.ndarray):
            array.setflags(write=False)
    return Link(
        name=name.removeprefix(prefix),
        joint=joint_name.removeprefix(prefix),
        body_id=body,
        parent=numbers[carrier],
        slide=kind == _SLIDE,
        range=limits,
        effort=effort,
        speed_limit=float(speed),
        damping=float(model.dof_damping[dof]),
        friction=float(model.dof_frictionloss[dof]),
        armature=float(model.dof_armature[dof]),
        actuator_id=actuator,
        torque_of_ctrl=torque,
        **arrays,
    )


def _motor(model: mujoco.MjModel, joint: int, faults: list[Fault]) -> tuple[int, float, float]:
    """Index in ctrl, torque per unit of ctrl and greatest torque of a joint's motor; -1, 1 and 0 without one."""
    acts = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & (model.actuator_trnid[:, 0] == joint)
    found = np.flatnonzero(acts)
    if not len(found):
        return -1, 1.0, 0.0
    if len(found) > 1:
        faults.append(Fault(f"joint {model.joint(joint).name!r}", f"has {len(found)} motors; give it one"))
    i = int(found[0])
    name, gear = model.actuator(i).name or f"actuator {i}", model.actuator_gear[i]
    torque = float(model.actuator_gainprm[i, 0] * gear[0])
    if torque == 0.0 or gear[1:].any():
        found_gear = " ".join(f"{x:g}" for x in gear)
        faults.append(Fault(name, f"gear {found_gear}: a joint's motor has one gear, which is not zero"))
        return -1, 1.0, 0.0
    effort = np.inf
    for kind, limited, limits, unit in (
        ("ctrlrange", model.actuator_ctrllimited[i], model.actuator_ctrlrange[i], abs(torque)),
        ("forcerange", model.actuator_forcelimited[i], model.actuator_forcerange[i], abs(float(gear[0]))),
    ):
        if limited and limits[0] != -limits[1]:
            faults.append(Fault(name, f"{kind} {limits[0]:g} {limits[1]:g}: must be symmetric on a joint's motor"))
        elif limited:
            effort = min(effort, unit * float(limits[1]))
    return i, torque, effort


FRICTION_IMPEDANCE = 0.9999
"""MuJoCo's greatest impedance, mjMAXIMP."""
STOP_IMPEDANCE = 0.99
STOP_TIME = 2e-3
"""Time constant of the stops [s], or two time steps, which is MuJoCo's least, if they are longer."""


HARDER = 0.01
"""Inverse inertia of a joint in its constraints, over the true inverse."""


def set_constraints(model: mujoco.MjModel) -> None:
    """Set the solver's constants of friction and stops for all joints of a compiled model. Call it once."""
    h = model.opt.timestep
    model.dof_invweight0[:] *= HARDER
    model.dof_solref[:] = 2.0 * h, 1.0
    model.dof_solimp[:, :2] = FRICTION_IMPEDANCE
    model.jnt_solref[:] = max(STOP_TIME, 2.0 * h), 1.0
    model.jnt_solimp[:, :2] = STOP_IMPEDANCE
