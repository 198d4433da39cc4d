"""MuJoCo's constraints of a joint: Coulomb friction of the gear with stick, and the stops of the range.

Both are rows of MuJoCo's constraint solver, which is implicit: they need no smaller time step, whatever the inertia.
With the inverse inertia w of the joint (``dof_invweight0``), the time step h, the impedance d and the time constant T
of solref:

- Friction: a joint that slips is given exactly the friction torque. A joint that sticks under the load tau creeps with
  the velocity ``(1 - d) T / 2 w tau``, because MuJoCo's friction is a stiff damper below its limit. T = 2 h is the
  least that MuJoCo allows, and d = 0.9999 the greatest. A joint that stops does so in one step. Added mass changes
  neither. Rotors of unknown inertia are often left out, and the inertia about a forearm's own axis is then so small
  that w tau is large. The constraints are therefore computed with a hundredth of w, and the velocity is
  1e-6 h w tau. With a ten-thousandth MuJoCo's solver does not always converge.
- Stops: a stop is a critically damped spring of the stiffness ``1 / (T^2 (1 - d) 0.01 w)``, whose time constant is T.
"""

import math

import mujoco
import numpy as np

from ..physics.frames import rotation_matrix
from .vehicle import Vehicle

FRICTION_IMPEDANCE = 0.9999
"""MuJoCo's greatest impedance, mjMAXIMP."""
STOP_IMPEDANCE = 0.99
STOP_TIME = 2e-3
"""Time constant of the stops [s], or two time steps, which is MuJoCo's least, if they are longer."""


HARDER = 0.01
"""Inverse inertia of a joint for its constraints, over that of its inertia."""


def set_constraints(model: mujoco.MjModel) -> None:
    """Set the solver's constants of friction and stops for all joints of a compiled model. Call it once."""
    h = model.opt.timestep
    model.dof_invweight0[:] *= HARDER
    model.dof_solref[:] = 2.0 * h, 1.0
    model.dof_solimp[:, :2] = FRICTION_IMPEDANCE
    model.jnt_solref[:] = max(STOP_TIME, 2.0 * h), 1.0
    model.jnt_solimp[:, :2] = STOP_IMPEDANCE


def creep(model: mujoco.MjModel, load: np.ndarray) -> np.ndarray:
    """Velocities (n,) with which joints creep that stick under loads (n,), for the last n degrees of freedom of a model
    with :func:`set_constraints` [rad/s or m/s]."""
    return (1.0 - FRICTION_IMPEDANCE) * model.opt.timestep * model.dof_invweight0[-len(load) :] * load


def inertia(vehicle: Vehicle, q: np.ndarray) -> np.ndarray:
    """The inertia M(q) (6 + n, 6 + n) of a vehicle with its joints at q (n,), added mass and rotors included, for
    zeta_q = [nu; q_dot]: the sum of J_k^T (M_RB + M_A) J_k over the links."""
    size = 6 + len(q)
    J_base = np.eye(6, size)
    M = J_base.T @ vehicle.M @ J_base
    columns: list[np.ndarray] = []
    for k, link in enumerate(vehicle.arm.links):
        R, p = link.R_0, link.p_0 + link.R_0 @ link.axis * q[k]
        if not link.slide:
            half = 0.5 * q[k]
            R = link.R_0 @ rotation_matrix(np.array([math.cos(half), *(math.sin(half) * link.axis)]))
            p = link.p_0 + (link.R_0 - R) @ link.anchor
        v, omega = np.vsplit(columns[link.parent] if link.parent >= 0 else J_base, 2)
        J = np.vstack([R.T @ (v + np.cross(omega, p, axisa=0).T), R.T @ omega])
        J[:, 6 + k] += link.S
        columns.append(J)
        M += J.T @ (link.M_RB + link.M_A) @ J
        M[6 + k, 6 + k] += link.armature
    return M


def felt_inertia(vehicle: Vehicle, q: np.ndarray) -> np.ndarray:
    """The inertia (n,) that each motor feels while the vehicle and all other joints are free: the inverses of the
    diagonal of M(q)^-1 [kg m^2 or kg]."""
    return 1.0 / np.diag(np.linalg.inv(inertia(vehicle, q)))[6:]
