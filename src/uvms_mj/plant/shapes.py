"""Shapes and meshes as plain data, for drawing."""

import base64
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import PlainSerializer, PlainValidator
from pydantic.dataclasses import dataclass

from ..quantities import STRICT, NonNegative, Real, of_length

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
