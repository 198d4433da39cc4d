"""Small pictures of vehicles and scenes, drawn by matplotlib alone, so that they need no graphics driver."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from ...physics.frames import quat_from_euler_deg, quat_product, rotation_matrix
from ...plant import looks
from ...plant.contacts import Probe, surfaces_of
from ...plant.geometry import Geometry, solids
from ...plant.mjcf import Mjcf
from ...records.scene import BLUE
from ...scenario import Scenario
from .style import SMALL, Figure, styled

AZIMUTH, ELEVATION = 60.0, -22.0
"""Direction in which a picture of a vehicle looks [deg]."""
WATER = "#E8F1F5"
"""Ground of the pictures: with it they are legible on a dark page too."""
_LIGHT = np.array([-0.35, -0.55, 0.75]) / np.linalg.norm([0.35, 0.55, 0.75])
"""Direction to the light in W."""
_SECOND = 1.0
"""The current's arrow is its way in this time [s]."""
_NEAR = 6.0
"""A wall further away than this would make the vehicle a dot [m]."""

Triangles = tuple[np.ndarray, tuple[float, float, float, float]]
"""Corners (n, 3, 3) in W [m] of the triangles of one colour."""


def vehicle(mjcf: Mjcf) -> Figure:
    """The vehicle of a file from the front, its joints at their start."""
    geometry, q = mjcf.geometry, mjcf.vehicle.arm.start(None)
    return _picture([*_placed(geometry, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), q)], AZIMUTH + 90.0, ELEVATION)


def scene(scenario: Scenario) -> Figure:
    """The start of a scenario: the vehicle, the walls near it and the current.

    Raises InputError if the vehicle's file can't be read.
    """
    mjcf, initial = Mjcf.find(scenario.vehicle.model), scenario.initial
    quat = quat_from_euler_deg(*initial.attitude_deg)
    geometry = looks.drawn_vehicle(mjcf.geometry, scenario, mjcf.vehicle.arm)
    start = np.array(initial.position)
    parts = [*_placed(geometry, start, quat, mjcf.vehicle.arm.start(initial.joints))]
    walls = [looks.drawn_wall(wall) for wall in surfaces_of(scenario, Probe.of(scenario.task.frame, mjcf).radius)]
    for wall in (each for each in walls if np.linalg.norm(each.position - start) < _NEAR):
        parts += _placed(Geometry((wall,), {}), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(0))
    figure, view = _picture(parts, looks.AZIMUTH, looks.ELEVATION), _view(looks.AZIMUTH, looks.ELEVATION)
    speed = scenario.mean_flow_W
    if speed.any():
        (ax,) = figure.axes
        tail = start + np.array([0.0, 0.0, 0.45])
        (x, y), tip = view[:2] @ tail, tuple(view[:2] @ (tail + speed * _SECOND))
        look: dict[str, Any] = {"color": "#{:02x}{:02x}{:02x}".format(*BLUE), "arrowstyle": "-|>", "linewidth": 1.4}
        ax.annotate("", tip, (x, y), arrowprops=look | {"shrinkA": 0.0, "shrinkB": 0.0})
        ax.text(x, y + 0.16, f"current {np.linalg.norm(speed):.3g} m/s", ha="center", fontsize=SMALL)
        ax.update_datalim([(x, y + 0.3), tip])
        ax.autoscale_view()
    return figure


def _placed(geometry: Geometry, p: np.ndarray, quat: np.ndarray, q: np.ndarray) -> Iterator[Triangles]:
    """The triangles of a vehicle and its links at a pose and at joint positions."""
    frames = [(p, quat)]
    for i, link in enumerate(geometry.links):
        at, turn = link.pose(q[i : i + 1])
        p_P, quat_P = frames[link.parent + 1]
        frames.append((p_P + rotation_matrix(quat_P) @ at[0], quat_product(quat_P, turn[0])))
    for (p_C, quat_C), shapes in zip(frames, (geometry.shapes, *(link.shapes for link in geometry.links)), strict=True):
        for solid in solids(Geometry(shapes, geometry.meshes)):
            vertices = solid.vertices @ rotation_matrix(quat_C).T + p_C
            yield vertices[solid.triangles], solid.rgba


def _view(azimuth: float, elevation: float) -> np.ndarray:
    """Rows right, up and away of a camera that looks in a direction [deg]."""
    a, e = np.radians([azimuth, elevation])
    away = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([np.sin(a), -np.cos(a), 0.0])
    return np.stack([right, np.cross(right, away), away])


def _picture(parts: Sequence[Triangles], azimuth: float, elevation: float) -> Figure:
    """Triangles in parallel projection, drawn from back to front."""
    with styled():
        figure = Figure(figsize=(2.6, 1.9), facecolor=WATER)
        figure.set_layout_engine("none")
        ax = figure.add_axes((0.02, 0.02, 0.96, 0.96))
        _draw(ax, parts, _view(azimuth, elevation))
        ax.set_aspect("equal", adjustable="datalim")
        ax.set_axis_off()
    return figure


def _draw(ax: Axes, parts: Iterable[Triangles], view: np.ndarray) -> None:
    corners, colours = [], []
    for triangles, rgba in parts:
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        bright = 0.62 + 0.38 * np.abs(normals @ _LIGHT)
        corners.append(triangles @ view.T)
        colours.append(np.column_stack([np.outer(bright, rgba[:3]), np.full(len(bright), rgba[3])]))
    points, faces = np.concatenate(corners), np.clip(np.concatenate(colours), 0.0, 1.0)
    order = np.argsort(-points[..., 2].mean(axis=1))
    faces = faces[order]
    edges = faces * [1.0, 1.0, 1.0, 0.0] + np.outer(faces[:, 3] == 1.0, [0.0, 0.0, 0.0, 1.0])  # close the seams
    look = {"facecolors": faces, "edgecolors": edges, "linewidths": 0.15}
    ax.add_collection(PolyCollection(list(points[order][..., :2]), **look))
    ax.autoscale_view()
    ax.margins(0.06)
