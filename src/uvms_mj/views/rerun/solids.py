"""Solids in Rerun, which has no cut-away cylinders, and whose solid primitives do not support opacity."""

import rerun as rr

from ...plant.solids import Solid


def mesh_of(solid: Solid, rgba: tuple[int, int, int, int]) -> rr.Mesh3D:
    return rr.Mesh3D(
        vertex_positions=solid.vertices,
        vertex_normals=solid.normals,
        triangle_indices=solid.triangles,
        albedo_factor=rgba,
    )


def rgba8(rgba: tuple[float, ...]) -> tuple[int, int, int, int]:
    r, g, b, a = (min(255, round(255 * c)) for c in rgba)
    return r, g, b, a
