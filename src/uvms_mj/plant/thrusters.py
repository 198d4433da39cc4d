"""Thrusters of a vehicle, read from the motors of the compiled model."""

import mujoco
import numpy as np

from ..errors import Fault
from ..physics.frames import rotation_matrix


def turning_thrusters(model, data, body_id, thrusters, B) -> list[Fault]:
    """Errors for thrusters whose wrench in B depends on the pose, such as a motor on the free joint."""
    elsewhere = mujoco.MjData(model)
    elsewhere.qpos[:] = data.qpos
    mujoco.mj_integratePos(model, elsewhere.qpos, np.linspace(0.3, 0.9, model.nv), 1.0)
    mujoco.mj_forward(model, elsewhere)
    _, _, _, there, _, _ = read_thrusters(model, elsewhere, body_id, [])
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
        Names, indices in ctrl, thrust (n,) per unit of ctrl [N], B = T^-T moment^T (6, n) per newton of thrust, and
        least and greatest thrust (n,) [N].
    """
    moment = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(moment, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
    dof = model.body_dofadr[body_id]
    T_inverse = np.eye(6)
    T_inverse[:3, :3] = rotation_matrix(data.xquat[body_id])
    names, ids, thrusts, columns, limits = [], [], [], [], []
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
    u_min, u_max = np.array(limits).reshape(-1, 2).T.copy()
    B = np.array(columns).reshape(-1, 6).T.copy()
    return tuple(names), tuple(ids), np.array(thrusts), B, u_min, u_max


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
