"""The scene of a run: vehicles, walls, the current and the forces, with their sizes and colours.

MCAP's markers, Rerun and the rendered pictures draw this scene and no shapes of their own, apart from decoration.
Arrows longer than the scene are cut. Rerun's label of a cut arrow is marked.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ..physics.frames import rotation_matrix
from ..physics.surfaces import SHAPES
from ..plant.contacts import surfaces_of
from ..plant.geometry import Geometry, Shape
from ..plant.looks import WALL_SIZE, drawn_vehicle, drawn_wall, wall_in_its_frame
from ..stages.signals import wall_signals
from .header import Header

Colour = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""
ORANGE, SKY, GREEN = (230, 159, 0), (86, 180, 233), (0, 158, 115)
YELLOW, BLUE, VERMILLION, PURPLE = (240, 228, 66), (0, 114, 178), (213, 94, 0), (204, 121, 167)
"""The palette of Okabe and Ito, which colour-blind readers can distinguish."""
FORCE_SCALE = 0.05
"""Default length of force arrows [m/N]."""
CURRENT_SCALE = 0.5
"""Length of the current's arrow per speed [s]."""
Values = Mapping[str, np.ndarray]
"""Signals (n, size) by name."""


@dataclass(frozen=True, eq=False)
class Arrow:
    """A constant arrow in W from start (3,) to tip (3,) [m], with the radius of its shaft [m] and a label beside it."""

    name: str
    label: str
    colour: Colour
    radius: float
    start: np.ndarray
    tip: np.ndarray


@dataclass(frozen=True)
class Force:
    """A force that changes with time, drawn as an arrow.

    Attributes:
        radius: radius of the shaft [m].
        text_above: height of the arrow's text above its tip [m].
        acts: points (n, 3) and forces (n, 3) in W, from a header and values.
        ends_there: whether the arrow ends at the point; otherwise it begins there. An arrow from the contact point
            would be inside the vehicle.
    """

    name: str
    colour: Colour
    radius: float
    text_above: float
    acts: Callable[[Header, Values], tuple[np.ndarray, np.ndarray]]
    ends_there: bool

    def ends(self, header: Header, values: Values, scale: float) -> tuple[np.ndarray, np.ndarray]:
        """Starts and tips (n, 3) of the arrows in W [m] at the scale [m/N]."""
        points, forces = self.acts(header, values)
        vectors = arrows(forces, scale, span(header))
        return (points - vectors, points) if self.ends_there else (points, points + vectors)


@dataclass(frozen=True)
class MovingWall:
    """``walls[k]``, whose pose is recorded: its shape in its frame S."""

    k: int
    shape: Shape

    @property
    def frame(self) -> str:
        """The name of S in a log."""
        return f"walls/{self.k}"

    def poses(self, values: Values) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n, 3) in W [m] and attitudes (n, 4) of S, from values."""
        p, quat = wall_signals(self.k)
        return values[p.name], values[quat.name]


@dataclass(frozen=True, eq=False)
class Scene:
    """The shapes of a scene: of each vehicle in its body frame B, with its contact bodies; of walls that stand in W,
    where a plane is a box with the face at -x; of walls that move in their frames; constant arrows in W."""

    vehicles: tuple[Geometry, ...]
    walls: tuple[Shape, ...]
    moving: tuple[MovingWall, ...]
    arrows: tuple[Arrow, ...]


def scene_of(header: Header) -> Scene:
    """The scene of a run."""
    flow_W, face = header.scenario.mean_flow_W, wall_face(header)
    start = np.array([0.4 * face, 0.0, 0.5])
    tip = start + CURRENT_SCALE * flow_W
    speed = math.hypot(*flow_W)
    text = f"{'current' if header.scenario.constant_flow else 'constant part of the current'} {speed:g} m/s"
    arrow = Arrow("current", text, SKY, 0.014, start, tip)
    vehicle = drawn_vehicle(header.geometry, header.scenario, header.mjcf.vehicle.arm)
    return Scene((vehicle,), *walls_of_scene(header), (arrow,) if speed else ())


def walls_of_scene(header: Header) -> tuple[tuple[Shape, ...], tuple[MovingWall, ...]]:
    """The walls that stand, and the walls that move. A log without the pose of a wall shows it at its place without
    motion."""
    walls = surfaces_of(header.scenario, header.probe_radius)
    first = len(walls) - len(header.scenario.walls)  # 1 with [wall]
    moves = [wall.moves and wall_signals(i - first)[0].name in header.by_name for i, wall in enumerate(walls)]
    standing = tuple(drawn_wall(wall) for wall, moving in zip(walls, moves, strict=True) if not moving)
    return standing, tuple(MovingWall(i - first, wall_in_its_frame(wall)) for i, wall in enumerate(walls) if moves[i])


def wall_face(header: Header) -> float:
    """Position of the wall's face along x of W [m]: the contact point's position when the origin of the frame of the
    task is at x_c. Without ``[wall]``, of the first of ``[[walls]]``: the position of a plane, or the place that is
    nearest to the start."""
    if not header.scenario.wall.present and header.scenario.walls:
        first = header.scenario.walls[0]
        if SHAPES[first.shape].size is None:
            return first.position[0]
        return float(first.nearest(header.scenario.initial.position)[1][0])
    return header.scenario.wall.position + header.probe_radius


def _contact(header: Header, values: Values) -> tuple[np.ndarray, np.ndarray]:
    reach, forces, origin = header.probe_radius, values["f_contact_W"], values[header.task_frame[0]]
    if "f_contacts_W" not in values:
        return origin + np.array([reach, 0.0, 0.0]), forces
    sizes = np.maximum(magnitudes(forces)[:, None], 1e-300)
    along = forces / sizes
    points = origin - reach * along  # the vehicle's reach against the total force, and from there to its line of action
    f_B, moment_B = np.split(values["tau_contacts_B"], 2, axis=1)
    R_WB = rotation_matrix(values["quat_WB"])
    line = values["p_WB"] + np.einsum("nij,nj->ni", R_WB, np.cross(f_B / sizes, moment_B / sizes))
    away = line - points
    return points + away - along * (along * away).sum(axis=1)[:, None], forces


def _thrust(_: Header, values: Values) -> tuple[np.ndarray, np.ndarray]:
    return values["p_WB"], np.einsum("nij,nj->ni", rotation_matrix(values["quat_WB"]), values["tau"][:, :3])


FORCES = (
    Force("contact force", VERMILLION, 0.018, 0.25, _contact, ends_there=True),
    Force("thrust", ORANGE, 0.018, -0.1, _thrust, ends_there=False),
)
"""The forces that are drawn."""


def span(header: Header) -> float:
    """Size of the scene: the distance from the start to the wall's face, at least the width of the wall [m]."""
    start, face = np.array(header.scenario.initial.position), wall_face(header)
    return max(WALL_SIZE, abs(face - float(start[0])) + header.geometry.reach)


def force_scale(header: Header, largest: float = 0.0) -> float:
    """Length of force arrows [m/N]: FORCE_SCALE, or, if the arrow of the largest force of a finished run [N] would
    leave the scene, the largest of 1, 2 and 5 times a power of ten at which it fits."""
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
