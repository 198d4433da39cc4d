"""A vehicle that starts pressed against the wall."""

from typing import Any

import numpy as np

from uvms_mj.physics.contacts import PAIR
from uvms_mj.physics.surfaces import SURFACE

M = np.array([7.31 + 5.5, 7.31 + 12.7, 7.31 + 14.57])
"""Inertia of the BlueROV1 along x, y and z, added mass included [kg]."""
PUSH, K_C = 7.5, 1e5


def pressed(k_t: float, b_t: float, mu: float, radius: float = 0.0, face: float = 0.0) -> tuple[Any, Any]:
    """PAIR and SURFACE records of a sphere about B's origin in front of a plane of normal -x."""
    pair, surface = (np.zeros(1, kind).view(np.recarray)[0] for kind in (PAIR, SURFACE))
    contact = pair.contact
    contact.stiffness, contact.friction = K_C, mu
    contact.tangential_stiffness, contact.tangential_damping = k_t, b_t
    pair.radius, pair.layer_depth, surface.R_WS[:], surface.p_WS[0] = radius, np.inf, np.eye(3), face
    return pair, surface
