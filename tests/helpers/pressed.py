"""A vehicle that starts pressed against the wall."""

import numpy as np

from uvms_mj.physics.contact import CONTACT

M = np.array([7.31 + 5.5, 7.31 + 12.7, 7.31 + 14.57])
"""Inertia of the BlueROV1 along x, y and z, added mass included [kg]."""
PUSH, K_C = 7.5, 1e5


def pressed(k_t: float, b_t: float, mu: float, depth: float) -> tuple[np.recarray, np.ndarray]:
    """A contact point ``depth`` inside a wall of normal -x, and the nearest points of the sensors."""
    contact = np.zeros(1, CONTACT).view(np.recarray)[0]
    contact.stiffness, contact.friction = K_C, mu
    contact.tangential_stiffness, contact.tangential_damping = k_t, b_t
    return contact, np.array([0.0, 0.0, 0.0, depth, 0.0, 0.0])
