"""An arm in Rerun: an entity for each link below that of its parent, which therefore moves with it, and triads.

Rerun composes the transforms along a path, so that each link has its pose in its parent's frame.
"""

from collections.abc import Iterator, Mapping

import numpy as np
import rerun as rr

from ...plant.geometry import Geometry, Solid, solids
from ...records.header import Header
from ...records.scene import BLUE, GREEN, VERMILLION, Colour
from ..colours import mixed

TRIAD_M = 0.12
"""Length of the axes of a triad [m]."""
_AXES = (VERMILLION, GREEN, BLUE)


def paths(geometry: Geometry) -> list[tuple[str, ...]]:
    """Parts of each link's path below the vehicle."""
    found: list[tuple[str, ...]] = []
    for link in geometry.links:
        found.append((*(found[link.parent] if link.parent >= 0 else ()), link.name))
    return found


def link_solids(geometry: Geometry) -> Iterator[tuple[tuple[str, ...], Solid]]:
    """The solids of the links in their frames, with the parts of their paths."""
    for path, link in zip(paths(geometry), geometry.links, strict=True):
        for i, solid in enumerate(solids(Geometry(link.shapes, geometry.meshes))):
            yield (*path, f"part {i + 1}"), solid


def poses(header: Header, values: Mapping[str, np.ndarray]) -> Iterator[tuple[tuple[str, ...], np.ndarray, np.ndarray]]:
    """Path below ``world``, positions (n, 3) and attitudes (n, 4) of the links and of the tool, if recorded."""
    if "q" in values:
        for i, (path, link) in enumerate(zip(paths(header.geometry), header.geometry.links, strict=True)):
            yield ("vehicle", *path), *link.pose(values["q"][:, i])
    if "p_WT" in values:
        yield ("tool",), values["p_WT"], values["quat_WT"]


def triad(share: float = 0.0) -> rr.Arrows3D:
    """The axes of a frame in its own entity: x, y and z in the colours of their components, mixed with white."""
    colours: list[Colour] = [mixed(colour, share) for colour in _AXES]
    return rr.Arrows3D(
        origins=np.zeros((3, 3)), vectors=TRIAD_M * np.eye(3), colors=colours, radii=[0.05 * TRIAD_M] * 3
    )
