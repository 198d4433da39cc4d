"""Shapes of a source for drawing, and the volume that they displace.

The volume of a mesh is the polyhedron's, by the divergence theorem: V = sum x_1 . (x_2 x x_3)/6, with the first moment
(x_1 + x_2 + x_3)/4 of each term. The mesh must be closed: each edge has two triangles, with opposite directions. MuJoCo
reads STL and OBJ.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from ..geometry import Kind, Shape
from .moving import Pose

_RGBA = (0.55, 0.6, 0.65, 1.0)
READ = (".stl", ".obj")
"""Suffixes of the meshes that are read."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A shape in the frame of its link.

    Attributes:
        kind: of the geom; None for a mesh that is not read.
        size: as in MJCF; of a mesh the half edges of its bounding box.
        pose: of its centre.
        volume: [m^3]; None if it is not known, with the reason.
        centroid: (3,) of the volume [m], in the frame of the link.
    """

    kind: Kind | None
    size: tuple[float, float, float]
    pose: Pose
    volume: float | None
    centroid: np.ndarray
    reason: str = ""
    name: str = ""

    def shape(self, frame: Pose) -> Shape | None:
        """The shape to draw, where its link has a pose in the body's frame."""
        if self.kind is None:
            return None
        pose = frame @ self.pose
        position = tuple(float(x) for x in pose.p)
        w, x, y, z = pose.quat.tolist()
        return Shape(self.kind, self.size, position, (w, x, y, z), _RGBA)


def primitive(kind: Kind, lengths: list[float], pose: Pose, name: str) -> Solid:
    """A box (three edges), a sphere (radius), a cylinder or capsule (radius, length), or an ellipsoid (three radii)."""
    if kind == "box":
        size, volume = tuple(x / 2.0 for x in lengths), math.prod(lengths)
    elif kind == "sphere":
        size, volume = (lengths[0], 0.0, 0.0), 4.0 / 3.0 * math.pi * lengths[0] ** 3
    elif kind == "ellipsoid":
        size, volume = tuple(lengths), 4.0 / 3.0 * math.pi * math.prod(lengths)
    else:
        radius, length = lengths
        size, volume = (radius, length / 2.0, 0.0), math.pi * radius**2 * length
        volume += 4.0 / 3.0 * math.pi * radius**3 if kind == "capsule" else 0.0
    a, b, c = size
    return Solid(kind, (a, b, c), pose, volume, pose.p, name=name)


def mesh(path: Path, scale: list[float], pose: Pose, name: str) -> Solid:
    """A mesh, drawn as its bounding box. Its volume is None with the reason if it is not read, or not closed."""
    unknown = Solid(
        None, (0.0, 0.0, 0.0), pose, None, pose.p, f"its mesh {path.name} is not read: only STL and OBJ are", name
    )
    if path.suffix.lower() not in READ:
        return unknown
    try:
        corners = _triangles(path, scale)
    except ValueError as error:
        reason = f"its mesh {path.name} can't be read: {' '.join(str(error).split())}"
        return Solid(None, unknown.size, pose, None, pose.p, reason, name)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    a, b, c = ((high - low) / 2.0).tolist()
    box = Pose(pose.R, pose.point((low + high) / 2.0))
    volume, centroid, reason = volume_of(corners)
    if volume is None:
        return Solid("box", (a, b, c), box, None, pose.p, f"its mesh {path.name} {reason}", name)
    return Solid("box", (a, b, c), box, volume, pose.point(centroid), name=name)


def volume_of(corners: np.ndarray) -> tuple[float | None, np.ndarray, str]:
    """Volume [m^3] and centroid (3,) [m] of the triangles (n, 3, 3), or None and why there is none."""
    _, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3)
    edges = {}
    for a, b in np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).tolist():
        edges[a, b] = edges.get((a, b), 0) + 1
    if any(count != edges.get((b, a)) for (a, b), count in edges.items()):
        return None, np.zeros(3), "is not closed: its volume is not defined"
    centre = corners.mean(axis=(0, 1))
    local = corners - centre
    sixth = np.einsum("ni,ni->n", local[:, 0], np.cross(local[:, 1], local[:, 2])) / 6.0
    volume = float(sixth.sum())
    if abs(volume) < 1e-12:
        return None, np.zeros(3), "encloses no volume"
    return abs(volume), centre + sixth @ local.sum(axis=1) / 4.0 / volume, ""


def _triangles(path: Path, scale: list[float]) -> np.ndarray:
    """The triangles (n, 3, 3) of a file [m]. Raises ValueError if MuJoCo can't read it."""
    spec = mujoco.MjSpec()
    added = spec.add_mesh(name="mesh", file=path.name, scale=scale)
    added.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh")
    spec.assets = {path.name: path.read_bytes()}
    mujoco.mj_clearCache(mujoco.mj_getCache())
    model = spec.compile()
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, model.mesh_quat[0])  # MuJoCo turns a mesh to its principal axes
    vertices = model.mesh_vert.astype(float) @ R.reshape(3, 3).T + model.mesh_pos[0]
    return vertices[model.mesh_face]
