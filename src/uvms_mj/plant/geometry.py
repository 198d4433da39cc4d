"""Shapes of a vehicle as plain data, for drawing."""

import base64
from typing import Annotated, Any, Literal, get_args

import mujoco
import numpy as np
from pydantic import Field, PlainSerializer, PlainValidator, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from ..errors import InputError, faults_of
from ..quantities import STRICT, NonNegative, Positive, Real, Vector3

Kind = Literal["sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh"]
LAST_VISIBLE_GROUP = 2
"""Geoms of higher groups are for collisions by MuJoCo's convention, and its viewer hides them."""
PROBE_REACH = 0.1
"""Reach of a vehicle without geoms [m]."""


def _rows_of(kind: str) -> PlainValidator:
    """Validator of rows of three numbers, given as an array or as base64 of little-endian numbers."""

    def read(value: Any) -> np.ndarray:
        array = value if isinstance(value, np.ndarray) else np.frombuffer(base64.b64decode(value, validate=True), kind)
        array = np.array(array, kind).reshape(-1, 3)
        array.setflags(write=False)
        return array

    return PlainValidator(read)


_BASE64 = PlainSerializer(lambda array: base64.b64encode(array.tobytes()).decode(), when_used="json")


@dataclass(frozen=True, eq=False, config=STRICT)
class Mesh:
    """A triangle mesh: vertices (n, 3) [m], and triangles (m, 3) as indices of vertices, counter-clockwise seen from
    outside."""

    vertices: Annotated[np.ndarray, _rows_of("<f4"), _BASE64]
    triangles: Annotated[np.ndarray, _rows_of("<u4"), _BASE64]

    def __post_init__(self) -> None:
        if not np.isfinite(self.vertices).all() or self.triangles.max(initial=0) >= max(1, len(self.vertices)):
            raise ValueError("vertices must be finite, and triangles must refer to existing vertices")

    def corners(self) -> np.ndarray:
        """Corners (3 m, 3) of the triangles, one triangle after the other [m]."""
        return self.vertices[self.triangles.reshape(-1)]


@dataclass(frozen=True, config=STRICT)
class Shape:
    """One geom, in the body frame B.

    Attributes:
        kind: type of the geom.
        size: as in MJCF [m]: radius (sphere); radius, half length along z (capsule, cylinder); half axes (ellipsoid);
            half edges (box).
        position, quat: of its centre in B [m], w x y z.
        rgba: colour and opacity, 0 to 1.
        mesh: name of the mesh, if the geom is one.
    """

    kind: Kind
    size: tuple[NonNegative, NonNegative, NonNegative]
    position: Vector3
    quat: tuple[Real, Real, Real, Real]
    rgba: tuple[NonNegative, NonNegative, NonNegative, NonNegative]
    mesh: str | None = None


@dataclass(frozen=True, eq=False, config=STRICT)
class Geometry:
    """Shapes of a vehicle's body and of the bodies fixed to it, in the order of the MJCF, and their meshes by name.
    ``reach`` is the distance of the vehicle's front from B's origin along x [m]; the wall's face is at x_c + reach."""

    shapes: tuple[Shape, ...]
    meshes: dict[str, Mesh]
    reach: Positive = Field(default=PROBE_REACH)

    def __post_init__(self) -> None:
        lost = {shape.mesh for shape in self.shapes if shape.kind == "mesh"} - set(self.meshes)
        if lost:
            raise ValueError(f"missing mesh {', '.join(map(repr, lost))}")

    @classmethod
    def of(cls, model: mujoco.MjModel, body_id: int) -> "Geometry":
        """Geometry of a compiled model's body. Shapes are those that MuJoCo's viewer shows; reach counts all geoms.
        Raises InputError if a geom's size, position or colour is out of range."""
        shapes, meshes, seen = [], {}, []
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        origin, attitude = data.xpos[body_id], data.xquat[body_id]
        to_B = np.zeros(4)
        mujoco.mju_negQuat(to_B, attitude)
        for geom in range(model.ngeom):
            kind = mujoco.mjtGeom(model.geom_type[geom]).name.removeprefix("mjGEOM_").lower()
            rgba = _rgba(model, geom)
            if model.body_weldid[model.geom_bodyid[geom]] != body_id or kind not in get_args(Kind) or rgba[3] == 0.0:
                continue
            # a geom of the body itself is compiled in B; the pose of a fixed body's geom comes from the kinematics
            position, quat = model.geom_pos[geom].copy(), model.geom_quat[geom].copy()
            if model.geom_bodyid[geom] != body_id:
                mujoco.mju_rotVecQuat(position, data.geom_xpos[geom] - origin, to_B)
                mujoco.mju_mat2Quat(quat, data.geom_xmat[geom])
                mujoco.mju_mulQuat(quat, to_B, quat.copy())
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
        return cls(tuple(visible), meshes, _forward_reach(shapes, meshes))

    def to_json(self) -> bytes:
        return _ADAPTER.dump_json(self)

    @classmethod
    def from_json(cls, data: bytes) -> "Geometry":
        """Geometry from JSON. Raises InputError if the data are not a geometry."""
        try:
            return _ADAPTER.validate_json(data)
        except ValidationError as error:
            raise InputError(faults_of(error), "geometry") from None


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
