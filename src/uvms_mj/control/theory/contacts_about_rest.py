"""The contacts about a rest: their springs, and the springs of the sets of contacts that small motions make of them.

A body that hardly presses lifts off in a small motion, and one next to a wall touches it. A rest with all of its
contacts may hold while the motion without one of them grows: the vehicle then circles the rest for ever. So a rest
counts if the motion decays with each set of contacts that is met beside it.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from ...physics.frames import quat_turned, rotation_matrix
from .task_motion import BESIDE, TaskMotion
from .terms import Balance, Pose

_MOST = 4
"""Most contacts that open or close beside a rest: of 16 sets each is looked at."""


@dataclass(frozen=True, eq=False)
class ContactsAtRest:
    """All contacts about a rest.

    Attributes:
        springs: stiffness and damping (6, 6) of the contacts at the rest, and of each other set of contacts that
            motions beside it meet: the wrench on the vehicle in B is minus these times displacement and rotation
            vector, and nu.
        eta_e: (6,) pose error as the law measures it. Its position turns with the vehicle.
        tau_c: (6,) contact wrench as the law measures it [N, N m].
        needs: (6, 12) change of the wrench that the vehicle needs in the water, without its contacts, by displacement
            and rotation vector, and nu.
        known: (6, 6) the part of it that the law's model of weight and buoyancy gives.
        acts: (6, 6) change of the wrench per change of the command, if thrusters are at their limits. Default: I.
    """

    springs: tuple[tuple[np.ndarray, np.ndarray], ...]
    eta_e: np.ndarray
    tau_c: np.ndarray
    needs: np.ndarray
    known: np.ndarray
    acts: np.ndarray | None = None


def contacts_about(motion: TaskMotion, pose: Pose, acts: np.ndarray | None) -> ContactsAtRest | str:
    """The contacts of a rigid vehicle about a rest, or the reason why they are not known."""
    balance = motion.balance
    others = _other_sets(balance, pose, -motion.stiffness(pose), balance.contact_damping(pose))
    if isinstance(others, str):
        return others
    eta_e, tau_c = balance.error(pose), balance.measurement(pose).tau_c
    return ContactsAtRest(others, eta_e, tau_c, motion.needs(pose), balance.known(pose), acts)


def _other_sets(
    balance: Balance, pose: Pose, K: np.ndarray, C: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray], ...] | str:
    """Stiffness K and damping C (6, 6) at the rest, then of the other sets of contacts beside it."""
    changes = BESIDE * np.vstack([np.zeros(6), np.eye(6), -np.eye(6)])
    quats = [quat_turned(pose.quat, change[3:]) for change in changes]
    R_WB = np.array([rotation_matrix(quat) for quat in quats])
    p_WB = pose.position + changes[:, :3] @ pose.R_WB.T
    forces = balance.springs.wrenches(p_WB[:, None], R_WB[:, None])[1]
    touches = forces > 0.0
    some = np.flatnonzero(touches.any(axis=0) & ~touches.all(axis=0))
    if len(some) > _MOST:
        return f"{len(some)} contacts open or close next to the rest"
    changed = []
    for k in some:
        at = 0 if touches[0, k] else int(forces[:, k].argmax())
        by_wrench, by_force, by_depth = (each[k] for each in balance.springs.slopes(p_WB[at], R_WB[at]))
        damping = balance.springs.dampings(forces[at])[k] * np.outer(by_depth, by_depth)
        # a contact that opens takes its part of K along; one that closes, not loaded at the rest, is a spring only
        changed.append((by_wrench, -damping) if touches[0, k] else (np.outer(by_force, by_depth), damping))
    kept, touch = bool(touches.all(axis=0).any()), touches[0, some]
    found = [(K, C)]
    for which in itertools.product((False, True), repeat=len(some)):
        if any(which) and (kept or (touch ^ np.array(which)).any()):  # without any contact the vehicle leaves the rest
            dK, dC = np.sum([changed[k] for k in np.flatnonzero(which)], axis=0)
            found.append((K + dK, C + dC))
    return tuple(found)
