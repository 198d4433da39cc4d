"""A vehicle: its coefficients and thrusters, read from its MJCF and checked to be physical.

The coefficients are ``<custom><numeric>`` entries: M_A, D_linear and D_quadratic, described in :mod:`.coefficients`,
and

======================  ======================================================================================
``displaced_mass``      mass of the displaced water [kg]; buoyancy is displaced_mass times gravity
``center_of_buoyancy``  in B [m]; default: the origin
======================  ======================================================================================

and one ``<text>`` of products of velocities, described in :mod:`.products`.

The rigid body is given by MuJoCo's ``<inertial>``. The actuators are the thrusters.
"""

import functools
from dataclasses import dataclass, field

import mujoco
import numpy as np

from ..errors import Fault, InputError, suggestion
from ..physics.effects import PRODUCT
from ..physics.frames import rotation_matrix
from ..physics.tree import DAMPING, find_diagonals, link_records
from .arm import Arm, Body, read_arm, rigid_inertia
from .coefficients import KNOWN_NUMERICS, added_mass, damping_matrix, numeric, wrong_numerics
from .dissipation import damping_notes
from .products import Product, read_products


def turning_thrusters(model, data, body_id, thrusters, B) -> list[Fault]:
    """Errors for thrusters whose wrench in B depends on the pose, such as a motor on the free joint."""
    elsewhere = mujoco.MjData(model)
    elsewhere.qpos[:] = data.qpos
    mujoco.mj_integratePos(model, elsewhere.qpos, np.linspace(0.3, 0.9, model.nv), 1.0)
    mujoco.mj_forward(model, elsewhere)
    there = read_thrusters(model, elsewhere, body_id, [])[3]
    if there.shape != B.shape:
        return [Fault("thrusters", "their number depends on the pose")]
    return [
        Fault(name, "its wrench in B depends on the pose; put the motor on a site of the vehicle's body")
        for name, here, other in zip(thrusters, B.T, there.T, strict=True)
        if np.abs(here - other).max() > 1e-9 * max(1.0, np.abs(here).max())
    ]


def read_thrusters(model, data, body_id, faults):
    """Read the actuators that act on the body; errors are appended to ``faults``.

    Returns:
        Names, indices in ctrl, thrust (n,) per unit of ctrl [N], B = T^-T moment^T (6, n) per newton of thrust, least
        and greatest thrust (n,) [N], and places (n, 3) of their sites in B [m].
    """
    moment = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(moment, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
    dof = model.body_dofadr[body_id]
    T_inverse = np.eye(6)
    T_inverse[:3, :3] = rotation_matrix(data.xquat[body_id])
    names, ids, thrusts, columns, limits, places = [], [], [], [], [], []
    for i in range(model.nu):
        wrench = T_inverse.T @ moment[i, dof : dof + 6]  # per unit of actuator force, which is gain times ctrl
        if not wrench.any():
            continue
        name, gain = model.actuator(i).name or f"actuator {i}", model.actuator_gainprm[i, 0]
        plain = (
            model.actuator_dyntype[i] == mujoco.mjtDyn.mjDYN_NONE
            and model.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_FIXED
            and model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_NONE
            and not model.actuator_history[i].any()
        )
        if not plain:
            faults.append(Fault(name, "is not a plain <motor>: its thrust must be gain times ctrl, without delay"))
        elif gain <= 0.0:
            faults.append(Fault(name, f"its gain is {gain:g}: must be positive; reverse gear to turn the thrust"))
        gain = gain if gain > 0.0 else 1.0  # the error is recorded
        linear, angular = (float(np.linalg.norm(half)) for half in np.split(model.actuator_gear[i], 2))
        gear = linear or angular  # a pure moment counts as "thrust" [N m]
        low, high = _limits(model, i, gain, name, faults)
        names.append(model.actuator(i).name)
        ids.append(i)
        thrusts.append(gain * gear)
        columns.append(wrench / gear)
        limits.append((gear * low, gear * high))
        of_site = model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_SITE
        site = data.site_xpos[model.actuator_trnid[i, 0]] if of_site else data.xpos[body_id]
        places.append((site - data.xpos[body_id]) @ T_inverse[:3, :3])
    u_min, u_max = np.array(limits).reshape(-1, 2).T.copy()
    B = np.array(columns).reshape(-1, 6).T.copy()
    return tuple(names), tuple(ids), np.array(thrusts), B, u_min, u_max, np.array(places).reshape(-1, 3)


def _limits(model, i, gain, name, faults) -> tuple[float, float]:
    """Least and greatest force of an actuator, from its ctrlrange and its forcerange."""
    low, high = -np.inf, np.inf
    for kind, limited, (lower, upper), unit in (
        ("ctrlrange", model.actuator_ctrllimited[i], model.actuator_ctrlrange[i], gain),
        ("forcerange", model.actuator_forcelimited[i], model.actuator_forcerange[i], 1.0),
    ):
        if lower > upper:  # MuJoCo treats such a range as unlimited
            faults.append(Fault(name, f"{kind} {lower:g} {upper:g}: the lower limit must come first"))
        elif limited:
            low, high = max(low, unit * lower), min(high, unit * upper)
    if low > high:
        faults.append(Fault(name, "its ctrlrange and forcerange do not overlap"))
    return low, high


AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
"""Names of the components of nu and tau."""


@dataclass(frozen=True, eq=False)
class Vehicle(Body):
    """Coefficients of one vehicle: of its base, in its body frame B, its thrusters, and its arm."""

    body: str
    thrusters: tuple[str, ...]
    actuator_ids: tuple[int, ...]
    """Index of each thruster in mjData.ctrl."""
    thrust_of_ctrl: np.ndarray
    """(n,) thrust per unit of mjData.ctrl: gain of the motor times length of its gear [N]."""
    B: np.ndarray
    """(6, n) thruster allocation: tau = B u with the thrusts u [N], eq. (25)."""
    u_min: np.ndarray
    """(n,) least thrust [N]."""
    u_max: np.ndarray
    """(n,) greatest thrust [N]."""
    arm: Arm = Arm()
    """Its links."""
    products: tuple[Product, ...] = ()
    """Its products of velocities, which are forces beside D's."""
    places: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    """(n, 3) places of the thrusters in B [m]."""

    @functools.cached_property
    def links_in_water(self) -> np.ndarray:
        """LINK records (1 + n,) for the water: the inertia is the added mass, and only displaced water has weight."""
        links = link_records(self)
        for record, body in zip(links, (self, *self.arm.links), strict=True):
            record["M"] = body.M_A
            for name in (*DAMPING, "displaced_mass", "r_b"):
                record[name] = getattr(body, name)
        find_diagonals(links)
        links.setflags(write=False)
        return links

    @classmethod
    def from_model(cls, model: mujoco.MjModel, body: str | None = None, file: str = "") -> "Vehicle":
        """Read a vehicle from a compiled model.

        Args:
            model: any model with a body on a free joint.
            body: name of the body; by default the only free body. If MuJoCo's attachment added a prefix to the name
                (``"left/bluerov1"``), the numerics are read with the same prefix.
            file: name of the vehicle's file, for the errors. Without one, the model may have other numerics.

        Raises:
            InputError: coefficients are missing, misspelt, malformed or unphysical (all errors at once).
        """
        if body is None:
            free = _free(model)
            if len(free) != 1:
                raise InputError(f"name the vehicle's body; bodies with a free joint: {', '.join(free) or 'none'}")
            body = free[0]
        body_id = free_body_id(model, body)
        prefix = body[: body.rfind("/") + 1]
        refuse_slash(model, body, prefix, f"vehicle.model {file}" if file else "")
        faults = wrong_numerics(model, body_id, prefix, alone=bool(file))
        M_A = added_mass(model, prefix, faults)
        D_linear = damping_matrix(model, prefix, "D_linear", faults)
        D_quadratic = damping_matrix(model, prefix, "D_quadratic", faults)
        products = read_products(model, body_id, prefix, D_quadratic, faults, alone=bool(file))
        displaced_mass = float(numeric(model, prefix + "displaced_mass", 1, faults)[0])
        if displaced_mass < 0:
            faults.append(Fault("displaced_mass", f"{displaced_mass:g} kg: must not be negative"))
        r_b = numeric(model, prefix + "center_of_buoyancy", 3, faults, default=np.zeros(3))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        arm = read_arm(model, body_id, prefix, faults)
        M_RB = rigid_inertia(model, data, body_id)
        thrusters, ids, thrust_of_ctrl, B, u_min, u_max, places = read_thrusters(model, data, body_id, faults)
        if not np.isfinite(M_RB).all():
            faults.append(Fault("M_RB", "mass or inertia is not finite"))
        faults += [
            Fault(name, "its site, gear or gain is not finite")
            for name, column in zip(thrusters, B.T, strict=True)
            if not np.isfinite(column).all()
        ]
        faults += turning_thrusters(model, data, body_id, thrusters, B)
        if not faults and np.linalg.eigvalsh(M_RB + M_A)[0] <= 0.0:
            faults.append(Fault("M_RB + M_A", "is not positive definite"))
        if faults:
            raise InputError(faults, f"vehicle.model {file}" if file else f"vehicle {body!r}")
        arrays = (M_RB, M_A, D_linear, D_quadratic, r_b, thrust_of_ctrl, B, u_min, u_max, places)
        for array in arrays:
            array.setflags(write=False)
        water = M_A, D_linear, D_quadratic, displaced_mass, r_b
        own = thrusters, ids, thrust_of_ctrl, B, u_min, u_max
        return cls(M_RB, *water, body, *own, arm, products, places)


def refuse_slash(model: mujoco.MjModel, body: str, prefix: str, place: str) -> None:
    """Raise InputError for a body with a slash in its name and no coefficient with what is before it."""
    names = [model.numeric(i).name for i in range(model.nnumeric)]
    if prefix and not any(name.startswith(prefix) for name in names) and KNOWN_NUMERICS & {*names}:
        reason = f"has a slash, and MuJoCo's attachment names the bodies and coefficients of a part so: {prefix}X_udot"
        instead = f"Name the body {body.replace('/', '_')!r}"
        raise InputError([Fault(f"body {body!r}", f"its name {reason}. {instead}")], place)


@functools.lru_cache(maxsize=8)
def notes_on_damping(vehicle: Vehicle) -> tuple[str, ...]:
    """Warnings for the base and for each link whose damping, with the products of the base, can feed energy in."""
    products = np.array([each.record for each in vehicle.products], PRODUCT)
    notes = damping_notes(vehicle.body, vehicle.D_linear, vehicle.D_quadratic, products)
    for link in vehicle.arm.links:
        notes += damping_notes(link.name, link.D_linear, link.D_quadratic)
    return tuple(notes)


def free_body_id(model: mujoco.MjModel, body: str) -> int:
    """The id of a body with a free joint. Raises InputError, naming the choices, for other bodies."""
    if not body:
        raise InputError("the vehicle's body has no name; name it in its MJCF")
    body_id = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body)
    if body_id < 0:
        names = [model.body(i).name for i in range(1, model.nbody)]
        raise InputError(f"body {body!r}: not in the model; {suggestion(body, names)}")
    if body not in (free := _free(model)):
        raise InputError(f"body {body!r}: has no free joint; free bodies: {', '.join(free) or 'none'}")
    return body_id


def free_joint_addresses(model: mujoco.MjModel, body_id: int) -> tuple[int, int]:
    """Addresses of a free body's pose (7,) in qpos and of its velocity (6,) in qvel."""
    joint = model.body_jntadr[body_id]
    return int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])


def _free(model: mujoco.MjModel) -> list[str]:
    """Names of the bodies with a free joint."""
    return [model.body(i).name for i in model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]]
