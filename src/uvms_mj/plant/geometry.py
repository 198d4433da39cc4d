"""Geometry of a vehicle as plain data, for drawing: the shapes of its body and of its links, and their triangles."""

import base64
import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, get_args

import mujoco
import numpy as np
from pydantic import Field, PlainSerializer, PlainValidator, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from ..errors import InputError, faults_of
from ..physics.frames import quat_product, rotation_matrix
from ..quantities import STRICT, NonNegative, Positive, Real, Vector3, of_length
from .arm import Link

Kind = Literal["sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh"]


def _rows_of(kind: str) -> PlainValidator:
    """Validator of rows of three numbers, given as an array or as base64 of little-endian numbers."""

    def read(value: Any) -> np.ndarray:
        if not isinstance(value, np.ndarray | str):
            raise ValueError("is not base64")
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
    position: Annotated[
        tuple[Real, ...], of_length(3)
    ]  # what is drawn at the greatest coordinate of an input may lie beyond it
    quat: tuple[Real, Real, Real, Real]
    rgba: tuple[NonNegative, NonNegative, NonNegative, NonNegative]
    mesh: str | None = None


@dataclass(frozen=True, config=STRICT)
class LinkGeometry:
    """A link with its joint, and the shapes of its body and of the bodies fixed to it, in the link's frame.

    Attributes:
        name, joint: names of the link's body and of its joint.
        parent: index of the parent among the links, which precedes the link; -1 is the base.
        slide: whether the joint slides; otherwise it is a hinge.
        position, quat: of the link's frame in its parent's frame at q = 0 [m], w x y z.
        axis, anchor: of the joint in the link's frame: unit vector, and a point on it [m].
        range: limits of the joint's position [rad, or m if it slides]; None without limits.
        effort: greatest torque of the motor [N m, or N if it slides]; 0 without a motor, None without a limit.
    """

    name: str
    joint: str
    parent: Annotated[int, Field(ge=-1)]
    slide: bool
    position: Vector3
    quat: tuple[Real, Real, Real, Real]
    axis: Vector3
    anchor: Vector3
    range: tuple[Real, Real] | None
    effort: NonNegative | None
    shapes: tuple[Shape, ...]

    def pose(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n, 3) [m] and attitudes (n, 4) of the link's frame in its parent's frame, at joint positions q
        (n,) [rad or m].

        A hinge turns the frame about the axis through the anchor, a slide moves it along the axis.
        """
        axis, anchor, quat_0 = (np.array(each) for each in (self.axis, self.anchor, self.quat))
        R_0 = rotation_matrix(quat_0)
        if self.slide:
            return self.position + q[:, None] * (R_0 @ axis), np.tile(quat_0, (len(q), 1))
        turn = np.concatenate([np.cos(0.5 * q)[:, None], np.sin(0.5 * q)[:, None] * axis], axis=1)
        return self.position + (anchor - rotation_matrix(turn) @ anchor) @ R_0.T, quat_product(quat_0, turn)


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
        """Geometry of a compiled model's body and its links. It has the shapes that MuJoCo's viewer shows; reach counts
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


_AROUND, _ALONG = 28, 12
"""Faces around and along round shapes."""


@dataclasses.dataclass(frozen=True, eq=False)
class Solid:
    """Triangles of one colour: vertices (n, 3) in B [m] with outward unit normals (n, 3), triangles (m, 3) as indices
    of vertices, and rgba from 0 to 1."""

    vertices: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    rgba: tuple[float, float, float, float]


_Triangles = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Vertices (n, 3), normals (n, 3), triangles (m, 3)."""


def solids(geometry: Geometry) -> Iterator[Solid]:
    """One solid for each colour of a geometry, in order of appearance."""
    smooth = {name: _smooth(mesh) for name, mesh in geometry.meshes.items()}
    for rgba in dict.fromkeys(shape.rgba for shape in geometry.shapes):
        vertices, normals, triangles, count = [], [], [], 0
        for shape in geometry.shapes:
            if shape.rgba == rgba:
                v, n, t = _in_body(shape, smooth)
                vertices.append(v)
                normals.append(n)
                triangles.append(t + count)
                count += len(v)
        yield Solid(
            np.concatenate(vertices).astype("f4"),
            np.concatenate(normals).astype("f4"),
            np.concatenate(triangles).astype("u4"),
            rgba,
        )


def _in_body(shape: Shape, smooth: Mapping[str, _Triangles]) -> _Triangles:
    a, b, c = shape.size
    if shape.kind == "mesh":
        vertices, normals, triangles = smooth[str(shape.mesh)]
    elif shape.kind == "box":
        vertices, normals, triangles = _box(a, b, c)
    elif shape.kind == "cylinder":
        # each rim twice, because the normal is discontinuous there
        vertices, normals, triangles = _revolved(
            radius=np.array([0, a, a, a, a, 0]),
            height=np.array([-b, -b, -b, b, b, b]),
            outwards=np.array([0, 0, 1, 1, 0, 0]),
            up=np.array([-1, -1, 0, 0, 1, 1]),
        )
    else:
        angle = np.linspace(-np.pi / 2, np.pi / 2, 2 * _ALONG)
        stretch = np.where(angle > 0, b, -b) if shape.kind == "capsule" else 0.0
        vertices, normals, triangles = _revolved(
            np.cos(angle), np.sin(angle) + stretch / max(a, 1e-12), np.cos(angle), np.sin(angle)
        )
        axes = np.array((a, b, c) if shape.kind == "ellipsoid" else (a, a, a))
        vertices = vertices * axes
        normals = normals / np.maximum(axes, 1e-12)
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    R = rotation_matrix(np.array(shape.quat))
    return vertices @ R.T + shape.position, normals @ R.T, triangles


def _revolved(radius: np.ndarray, height: np.ndarray, outwards: np.ndarray, up: np.ndarray) -> _Triangles:
    """Surface of revolution of a profile (k,) about z, with the components of its normals."""
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn), np.ones(_AROUND)], axis=1)
    vertices = ring * np.stack([radius, radius, height], axis=1)[:, None]
    normals = ring * np.stack([outwards, outwards, up], axis=1)[:, None]
    low, i = np.arange(len(radius) - 1)[:, None] * _AROUND, np.arange(_AROUND)
    a, b = low + i, low + (i + 1) % _AROUND
    triangles = np.stack([a, b, b + _AROUND, a, b + _AROUND, a + _AROUND], axis=-1)
    return vertices.reshape(-1, 3), normals.reshape(-1, 3), triangles.reshape(-1, 3)


def _box(a: float, b: float, c: float) -> _Triangles:
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    vertices, normals = np.zeros((6, 4, 3)), np.zeros((6, 4, 3))
    for face in range(6):
        axis, side = face // 2, 2 * (face % 2) - 1
        vertices[face, :, axis] = normals[face, :, axis] = side
        vertices[face][:, [(axis + 1) % 3, (axis + 2) % 3]] = corners[::side]
    triangles = 4 * np.arange(6)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    return vertices.reshape(-1, 3) * (a, b, c), normals.reshape(-1, 3), triangles.reshape(-1, 3)


def _smooth(mesh: Mesh) -> _Triangles:
    """A mesh with vertex normals: the area-weighted means of the normals of adjacent triangles."""
    vertices, triangles = mesh.vertices.astype(float), mesh.triangles
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    area = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(normals, triangles[:, i], area)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return vertices, normals / np.maximum(length, 1e-30), triangles
