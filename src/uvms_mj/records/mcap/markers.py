"""The scene of a run as ROS 2 markers."""

import dataclasses
from collections.abc import Iterator

import numpy as np

from ...physics.frames import rotation_matrix
from ...plant.geometry import Shape
from ..header import Header
from ..scene import FORCE_SCALE, FORCES, Arrow, Force, Scene
from . import ros2
from .joints import frame_of
from .ros2 import Message

_NO_POINTS = np.zeros((0, 3))


def forces() -> Message:
    """The forces as arrows; :func:`force_columns` gives the values for the holes."""
    message = Message().put("u4", len(FORCES))
    for force in FORCES:
        _arrow(message, force, 0, (f"{force.name}.start", f"{force.name}.tip"))
    return message


def force_columns(header: Header, rows: np.ndarray) -> dict[str, np.ndarray]:
    """The values (n, 3) for the holes of :func:`forces`, from rows (n, width)."""
    values = {name: rows[:, place] for name, place in header.places.items()}
    found = {}
    for force in FORCES:
        found[f"{force.name}.start"], found[f"{force.name}.tip"] = force.ends(header, values, FORCE_SCALE)
    return found


def vehicles(scene: Scene) -> Message:
    """The geoms of the vehicles, each in the frame of the body or link that carries it."""
    parts = [
        (vehicle, frame, part)
        for vehicle in scene.vehicles
        for frame, shapes in (("base_link", vehicle.shapes), *((frame_of(link), link.shapes) for link in vehicle.links))
        for shape in shapes
        for part in _parts(shape)
    ]
    message = Message().put("u4", len(parts))
    for i, (vehicle, frame, shape) in enumerate(parts):
        points = vehicle.meshes[str(shape.mesh)].corners() if shape.kind == "mesh" else _NO_POINTS
        _solid(message, frame, "vehicle", i, shape, points)
    return message


def surroundings(scene: Scene) -> Message:
    """The walls and the constant arrows."""
    message = Message().put("u4", len(scene.walls) + len(scene.arrows))
    for i, wall in enumerate(scene.walls):
        _solid(message, "map", "wall", i, wall)
    for i, arrow in enumerate(scene.arrows):
        _arrow(message, arrow, i, np.array([arrow.start, arrow.tip]))
    return message


def _arrow(message: Message, arrow: Force | Arrow, number: int, points: np.ndarray | tuple[str, str]) -> None:
    """Append an arrow in map, from the first of two points to the second."""
    r, g, b = (c / 255 for c in arrow.colour)
    diameters = (2.0 * arrow.radius, 4.0 * arrow.radius, 0.0)  # of shaft and head; the head has its default length
    ros2.marker(message, "map", arrow.name, number, ros2.ARROW, diameters, (r, g, b, 1.0), points=points)


def _parts(shape: Shape) -> Iterator[Shape]:
    """The shapes that ROS 2 has markers for: a capsule is a cylinder and two spheres."""
    if shape.kind != "capsule":
        yield shape
        return
    radius, half, _ = shape.size
    yield dataclasses.replace(shape, kind="cylinder")
    along = half * rotation_matrix(np.array([shape.quat]))[0, :, 2]
    for end in (shape.position - along, shape.position + along):
        yield dataclasses.replace(shape, kind="sphere", position=tuple(end.tolist()), size=(radius, 0.0, 0.0))


def _solid(message: Message, frame: str, name: str, number: int, shape: Shape, points: np.ndarray = _NO_POINTS) -> None:
    """Append a shape, with the corners of its triangles if it is a mesh."""
    a, b, c = shape.size
    kind, size = {
        "box": (ros2.CUBE, (2 * a, 2 * b, 2 * c)),
        "sphere": (ros2.SPHERE, (2 * a, 2 * a, 2 * a)),
        "ellipsoid": (ros2.SPHERE, (2 * a, 2 * b, 2 * c)),
        "cylinder": (ros2.CYLINDER, (2 * a, 2 * a, 2 * b)),
        "mesh": (ros2.TRIANGLES, (1.0, 1.0, 1.0)),
    }[shape.kind]
    w, x, y, z = shape.quat
    pose = {"position": shape.position, "quat_xyzw": (x, y, z, w)}
    ros2.marker(message, frame, name, number, kind, size, shape.rgba, **pose, points=points, locked=frame != "map")
