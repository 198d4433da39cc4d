"""The scene that both viewers draw, MCAP's markers and Rerun: scales of arrows, the wall, and the scene's size.

An arrow is never longer than the scene: beyond that it is cut, and its label in Rerun says so.
"""

import math

import numpy as np

from .recording import Header

FORCE_SCALE = 0.05
"""Length of a force's arrow [m/N]."""
CURRENT_SCALE = 0.5
"""Length of the current's arrow [s]."""
WALL_SIZE, WALL_THICKNESS = 1.5, 0.05
"""Of the part of the wall that is drawn [m]."""
WALL_RGBA = (0.62, 0.64, 0.66, 1.0)


def span(header: Header) -> float:
    """How far the scene reaches: from the start to the wall's face, and at least as wide as the wall [m]."""
    start, face = np.array(header.scenario.initial.position), wall_face(header)
    return max(WALL_SIZE, abs(face - float(start[0])) + header.geometry.reach)


def wall_face(header: Header) -> float:
    """Where the wall's face is along x of W [m]: as far as the vehicle reaches when B's origin is at x_c."""
    return header.scenario.wall.position + header.geometry.reach


def current_arrow(header: Header) -> tuple[np.ndarray, np.ndarray]:
    """Start and tip (3,) of the current's arrow in W [m]."""
    start = np.array([0.4 * wall_face(header), 0.0, 0.5])
    return start, start + CURRENT_SCALE * np.array(header.scenario.current.velocity_W)


def force_scale(header: Header, largest: float = 0.0) -> float:
    """Length of forces' arrows [m/N].

    Args:
        header: of the run.
        largest: the largest force of the run, if it is over [N]; the scale is less than :data:`FORCE_SCALE` where that
            force's arrow would leave the scene.

    Returns:
        FORCE_SCALE, or the first of 1, 2 and 5 times a power of ten below it at which the largest arrow fits.
    """
    scale = FORCE_SCALE
    if largest * scale > span(header):
        room = span(header) / largest
        power = 10.0 ** math.floor(math.log10(room))
        scale = next(digit * power for digit in (5.0, 2.0, 1.0) if digit * power <= room)
    return scale


def magnitudes(forces: np.ndarray) -> np.ndarray:
    """(...,) of forces (..., 3) [N], however large: a sum of squares would overflow in a run that diverges."""
    return np.hypot(np.hypot(forces[..., 0], forces[..., 1]), forces[..., 2])


def arrows(forces: np.ndarray, scale: float, longest: float) -> np.ndarray:
    """Arrows (..., 3) of forces (..., 3) [m]: cut where they would be longer than ``longest``."""
    lengths = scale * magnitudes(forces)[..., None]
    return scale * forces * np.minimum(1.0, longest / np.maximum(lengths, 1e-300))
