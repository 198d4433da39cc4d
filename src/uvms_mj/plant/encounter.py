"""Whether two vehicles are in each other's way: the boxes around their bodies and links, at their poses.

A box is around the shapes of one body in the body's frame. Two boxes are apart if the projections of both on one of
fifteen directions are apart: the normals of their faces, and the products of their edges (the separating axis theorem;
Gottschalk, Lin and Manocha 1996).
"""

import functools
from typing import NamedTuple

import numpy as np

from ..physics.frames import quat_product, rotation_matrix
from .geometry import Geometry, solids

_SMALL = 1e-9
"""Length of a product of two edges below which they are parallel [1]."""


class Boxes(NamedTuple):
    """m boxes at n instants: centres (n, m, 3) in W [m], axes (n, m, 3, 3) as columns, half edges (m, 3) [m]."""

    centres: np.ndarray
    axes: np.ndarray
    halves: np.ndarray


def boxes(geometry: Geometry, p_WB: np.ndarray, quat_WB: np.ndarray, q: np.ndarray) -> Boxes:
    """The boxes of a vehicle at positions (n, 3), attitudes (n, 4) and joint positions (n, joints). A vehicle without
    shapes has none."""
    places = [(p_WB, quat_WB)]
    for i, link in enumerate(geometry.links):
        p, quat = places[link.parent + 1]
        p_link, quat_link = link.pose(q[:, i])
        places.append((p + np.einsum("nij,nj->ni", rotation_matrix(quat), p_link), quat_product(quat, quat_link)))
    carriers, middles, halves = _extents(geometry)
    R = [rotation_matrix(quat) for _, quat in places]
    centres = [places[k][0] + R[k] @ middle for k, middle in zip(carriers, middles, strict=True)]
    if not centres:
        return Boxes(np.zeros((len(p_WB), 0, 3)), np.zeros((len(p_WB), 0, 3, 3)), halves)
    return Boxes(np.stack(centres, axis=1), np.stack([R[k] for k in carriers], axis=1), halves)


@functools.lru_cache(maxsize=64)
def _extents(geometry: Geometry) -> tuple[list[int], np.ndarray, np.ndarray]:
    """The bodies with shapes, 0 for the base and then the links; the middles (m, 3) of their boxes in their frames, and
    half the edges (m, 3) [m]."""
    carriers, ends = list[int](), list[np.ndarray]()
    for k, shapes in enumerate((geometry.shapes, *(link.shapes for link in geometry.links))):
        if shapes:
            corners = np.concatenate([solid.vertices for solid in solids(Geometry(shapes, geometry.meshes))])
            carriers.append(k)
            ends.append(np.stack([corners.min(axis=0), corners.max(axis=0)]).astype(float))
    found = np.array(ends).reshape(-1, 2, 3)
    return carriers, found.mean(axis=1), 0.5 * (found[:, 1] - found[:, 0])


def overlap(one: Boxes, other: Boxes) -> np.ndarray:
    """Whether a box of one vehicle and a box of the other overlap at each instant (n,). Where the spheres around all
    boxes are apart at all instants, no box is looked at."""
    radii = np.linalg.norm(one.halves, axis=1)[:, None] + np.linalg.norm(other.halves, axis=1)
    between = np.linalg.norm(one.centres[:, :, None] - other.centres[:, None], axis=-1)
    return gap(one, other) < 0.0 if (between < radii).any() else np.zeros(len(between), bool)


def gap(one: Boxes, other: Boxes) -> np.ndarray:
    """The largest gap (n,) between the projections of two boxes, of the two vehicles' pair that is nearest [m]; it is
    negative where boxes overlap, and never more than their distance."""
    nearest = np.full(len(one.centres), np.inf)
    for i, half in enumerate(one.halves):
        for k, half_k in enumerate(other.halves):
            between = other.centres[:, k] - one.centres[:, i]
            A, B = one.axes[:, i], other.axes[:, k]
            products = np.cross(A[:, :, :, None], B[:, :, None, :], axis=1).reshape(len(A), 3, 9)
            directions = np.concatenate([A, B, products], axis=2)
            length = np.linalg.norm(directions, axis=1, keepdims=True)
            directions = directions / np.maximum(length, _SMALL)
            reach = np.einsum("nkl,l->nk", np.abs(directions.swapaxes(1, 2) @ A), half)
            reach += np.einsum("nkl,l->nk", np.abs(directions.swapaxes(1, 2) @ B), half_k)
            apart = np.abs(np.einsum("ni,nik->nk", between, directions)) - reach
            apart = np.where(length[:, 0] > _SMALL, apart, -np.inf)
            nearest = np.minimum(nearest, apart.max(axis=1))
    return nearest
