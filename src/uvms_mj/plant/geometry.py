"""Geometry of a vehicle as plain data, for drawing: the shapes of its body and of its links."""

import math
from typing import get_args

import mujoco
import numpy as np
from pydantic import Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from ..errors import InputError, faults_of
from ..quantities import STRICT, Positive
from .arm import Link
from .link_geometry import LinkGeometry
from .shapes import Kind, Mesh, Shape

LAST_VISIBLE_GROUP = 2
"""Geoms of higher groups are for collisions by MuJoCo's convention, and its viewer hides them."""
_MOST_REACH = 1e4
"""Largest reach of a vehicle [m]."""
PROBE_REACH = 0.1
"""Reach of a vehicle without geoms [m]."""


@dataclass(frozen=True, eq=False, config=STRICT)
class Geometry:
    """Shapes of a vehicle's body and of the bodies fixed to it, in the order of the MJCF, and all meshes by name.
    ``reach`` is the distance of the vehicle's front from B's origin along x [m]; the wall's face is at x_c + reach.
    ``links`` are the links of the arm in the order of q, each with its shapes."""

    shapes: tuple[Shape, ...]
    meshes: dict[str, Mesh]
    reach: Positive = Field(default=PROBE_REACH)
    links: tuple[LinkGeometry, ...] = ()

    def __post_init__(self) -> None:
        drawn = [*self.shapes, *(shape for link in self.links for shape in link.shapes)]
        lost = {shape.mesh for shape in drawn if shape.kind == "mesh"} - set(self.meshes)
        if lost:
            raise ValueError(f"missing mesh {', '.join(map(repr, lost))}")
        for i, link in enumerate(self.links):
            if link.parent >= i:
                raise ValueError(f"link {link.name!r} must come after its parent")

    @classmethod
    def of(cls, model: mujoco.MjModel, body_id: int, links: tuple[Link, ...] = ()) -> "Geometry":
        """Geometry of a compiled model's body and its links. Shapes are those that MuJoCo's viewer shows; reach counts
        all geoms of the body. Raises InputError if a geom's size, position or colour is out of range."""
        meshes: dict[str, Mesh] = {}
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        every, visible = _shapes(model, data, body_id, meshes)
        drawn = tuple(_link(link, _shapes(model, data, link.body_id, meshes)[1]) for link in links)
        reach = _forward_reach(every, meshes)
        if not reach <= _MOST_REACH:
            raise InputError(
                f"vehicle.model: its geoms reach {reach:.4g} m to the front of {model.body(body_id).name}; at most "
                f"{_MOST_REACH:g} m is allowed"
            )
        return cls(visible, meshes, reach, drawn)

    def to_json(self) -> bytes:
        return _ADAPTER.dump_json(self, exclude=None if self.links else {"links"})

    @classmethod
    def from_json(cls, data: bytes) -> "Geometry":
        """Geometry from JSON. Raises InputError if the data are not a geometry."""
        try:
            return _ADAPTER.validate_json(data)
        except ValidationError as error:
            raise InputError(faults_of(error), "geometry") from None


def _shapes(
    model: mujoco.MjModel, data: mujoco.MjData, body_id: int, meshes: dict[str, Mesh]
) -> tuple[list[Shape], tuple[Shape, ...]]:
    """All shapes of a body in its frame, and the visible ones, or all if none is visible. Adds their meshes."""
    shapes, seen = [], []
    for geom in range(model.ngeom):
        kind = mujoco.mjtGeom(model.geom_type[geom]).name.removeprefix("mjGEOM_").lower()
        rgba = _rgba(model, geom)
        if model.body_weldid[model.geom_bodyid[geom]] != body_id or kind not in get_args(Kind) or rgba[3] == 0.0:
            continue
        position, quat = _pose(model, data, geom, body_id)
        name = None
        size = (0.0,) * 3 if kind == "mesh" else tuple(model.geom_size[geom].tolist())
        try:
            if kind == "mesh":
                name = model.mesh(model.geom_dataid[geom]).name
                meshes[name] = _mesh(model, model.geom_dataid[geom])
            pose = {"position": tuple(position.tolist()), "quat": tuple(quat.tolist())}
            shapes.append(Shape(kind=kind, size=size, **pose, rgba=rgba, mesh=name))
        except ValidationError as error:
            called = model.geom(geom).name or geom
            raise InputError(faults_of(error), f"vehicle.model: geom {called!r} in the body frame") from None
        seen.append(model.geom_group[geom] <= LAST_VISIBLE_GROUP)
    visible = [shape for shape, shown in zip(shapes, seen, strict=True) if shown] or shapes
    return shapes, tuple(visible)


def _pose(model: mujoco.MjModel, data: mujoco.MjData, geom: int, body_id: int) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) and attitude (4,) of a geom in the frame of the body that carries it."""
    # a geom of the body itself is compiled in its frame; the pose of a fixed body's geom comes from the kinematics
    position, quat = model.geom_pos[geom].copy(), model.geom_quat[geom].copy()
    if model.geom_bodyid[geom] != body_id:
        to_body = np.zeros(4)
        mujoco.mju_negQuat(to_body, data.xquat[body_id])
        mujoco.mju_rotVecQuat(position, data.geom_xpos[geom] - data.xpos[body_id], to_body)
        mujoco.mju_mat2Quat(quat, data.geom_xmat[geom])
        mujoco.mju_mulQuat(quat, to_body, quat.copy())
    return position, quat


def _link(link: Link, shapes: tuple[Shape, ...]) -> LinkGeometry:
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(link.R_0).reshape(9))
    w, x, y, z = quat.tolist()
    return LinkGeometry(
        name=link.name,
        joint=link.joint,
        parent=link.parent,
        slide=link.slide,
        position=tuple(link.p_0.tolist()),
        quat=(w, x, y, z),
        axis=tuple(link.axis.tolist()),
        anchor=tuple(link.anchor.tolist()),
        range=link.range if all(map(math.isfinite, link.range)) else None,
        effort=link.effort if math.isfinite(link.effort) else None,
        shapes=shapes,
    )


def _rgba(model: mujoco.MjModel, geom: int) -> tuple[float, float, float, float]:
    material = model.geom_matid[geom]
    r, g, b, a = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    return round(float(r), 6), round(float(g), 6), round(float(b), 6), round(float(a), 6)


def _mesh(model: mujoco.MjModel, mesh: int) -> Mesh:
    vertex, n_vertices = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    face, n_faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return Mesh(model.mesh_vert[vertex : vertex + n_vertices], model.mesh_face[face : face + n_faces])


def _forward_reach(shapes: list[Shape], meshes: dict[str, Mesh]) -> float:
    """Greatest x in B of all shapes [m], or PROBE_REACH if no shape is in front of B's origin."""
    reach = 0.0
    for shape in shapes:
        R = np.zeros(9)
        mujoco.mju_quat2Mat(R, np.array(shape.quat))
        x, y, z = R[:3]  # x components in B of the shape's axes
        a, b, c = shape.size
        extent = {
            "sphere": a,
            "capsule": a + b * abs(z),
            "cylinder": a * float(np.hypot(x, y)) + b * abs(z),
            "ellipsoid": float(np.sqrt((a * x) ** 2 + (b * y) ** 2 + (c * z) ** 2)),
            "box": a * abs(x) + b * abs(y) + c * abs(z),
            "mesh": float((meshes[shape.mesh].vertices @ R[:3]).max(initial=0.0)) if shape.mesh else 0.0,
        }[shape.kind]
        reach = max(reach, shape.position[0] + extent)
    return reach or PROBE_REACH


_ADAPTER = TypeAdapter(Geometry)
