"""Geometry common to the two 3-D views, MCAP's markers and Rerun: scales of arrows, the wall, and the scene's size.

Arrows longer than the scene are cut. Rerun's label of a cut arrow is marked.
"""

import math

import numpy as np

from ..records.header import Header

FORCE_SCALE = 0.05
"""Default length of force arrows [m/N]."""
CURRENT_SCALE = 0.5
"""Length of the current's arrow per speed [s]."""
WALL_SIZE, WALL_THICKNESS = 1.5, 0.05
"""Size of the drawn part of the wall [m]."""
WALL_RGBA = (0.62, 0.64, 0.66, 1.0)


def span(header: Header) -> float:
    """Size of the scene: the distance from the start to the wall's face, at least the width of the wall [m]."""
    start, face = np.array(header.scenario.initial.position), wall_face(header)
    return max(WALL_SIZE, abs(face - float(start[0])) + header.geometry.reach)


def wall_face(header: Header) -> float:
    """Position of the wall's face along x of W [m]: the contact point's position when B's origin is at x_c."""
    return header.scenario.wall.position + header.geometry.reach


def current_arrow(header: Header) -> tuple[np.ndarray, np.ndarray]:
    """Start and tip (3,) of the current's arrow in W [m]."""
    start = np.array([0.4 * wall_face(header), 0.0, 0.5])
    return start, start + CURRENT_SCALE * np.array(header.scenario.current.velocity_W)


def force_scale(header: Header, largest: float = 0.0) -> float:
    """Length of force arrows [m/N].

    Args:
        header: header of the run.
        largest: the largest force of a finished run [N]; 0 while the run is in progress.

    Returns:
        FORCE_SCALE, or, if the arrow of the largest force would leave the scene, the largest of 1, 2 and 5 times a
        power of ten at which it fits.
    """
    scale = FORCE_SCALE
    if largest * scale > span(header):
        room = span(header) / largest
        power = 10.0 ** math.floor(math.log10(room))
        scale = next(digit * power for digit in (5.0, 2.0, 1.0) if digit * power <= room)
    return scale


def magnitudes(forces: np.ndarray) -> np.ndarray:
    """Magnitudes (...,) of forces (..., 3) [N], without the overflow of a sum of squares in a run that diverges."""
    return np.hypot(np.hypot(forces[..., 0], forces[..., 1]), forces[..., 2])


def arrows(forces: np.ndarray, scale: float, longest: float) -> np.ndarray:
    """Arrows (..., 3) of forces (..., 3), cut to the length ``longest`` [m]."""
    lengths = scale * magnitudes(forces)[..., None]
    return scale * forces * np.minimum(1.0, longest / np.maximum(lengths, 1e-300))
