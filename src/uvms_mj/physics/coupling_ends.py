"""The ends of a coupling at a vehicle: where its frame C is, and how it moves (:mod:`.coupling`)."""

import math

import numpy as np

from .frames import compose_poses, rotation
from .kernels import kernel
from .tree import place_links


@kernel
def place_end(coupling, frames, qpos, qvel, pulled):
    """Set pose and velocity of an end of a coupling, from the frames (1 + n,) of the vehicle's links, the pose and the
    velocity of its free joint and the positions and velocities of the joints behind it, qpos (7 + n,) and
    qvel (6 + n,)."""
    R, p_BC, R_BC, V, link = pulled.R_WB, np.zeros(3), np.zeros((3, 3)), np.zeros(6), coupling.link
    pulled.p_WB[:] = qpos[:3]
    rotation(qpos[3:7] / math.sqrt(qpos[3:7] @ qpos[3:7]), R)
    if frames.shape[0] > 1:
        place_links(frames, qpos, 7)
    own = frames[link]
    compose_poses(own.R_BL, own.p_BL, coupling.R_LC, coupling.p_LC, R_BC, p_BC)
    V[3:] = qvel[3:6]
    if frames.shape[0] > 1:
        above = link
        for _ in range(own.depth):
            V += frames[above].S * qvel[5 + above]
            above = frames[above].parent
    pulled.p_WC[:] = qpos[:3] + R @ p_BC
    pulled.R_WC[:] = R @ R_BC
    pulled.v_W[:] = qvel[:3] + R @ (V[:3] + np.cross(V[3:], p_BC))
    pulled.omega_W[:] = R @ V[3:]
