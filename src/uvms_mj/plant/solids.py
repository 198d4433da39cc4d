"""A vehicle's shapes as triangles with normals, in one mesh for each colour to keep the scene small."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ..physics.frames import rotation_matrix
from .geometry import Geometry
from .shapes import Mesh, Shape

_AROUND, _ALONG = 28, 12
"""Faces around and along round shapes."""


@dataclass(frozen=True, eq=False)
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
