"""Where the camera of a video is."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from ...errors import InputError, suggestion
from ...records.scene import wall_face
from ...records.trace import Trace

_NEAR = 3.0
"""A wall further away than this from the way of the vehicle is not in the picture [m]."""
_FOVY = np.radians(45.0)
"""MuJoCo's angle of view over the height."""
_AROUND = 0.6
"""Room for the vehicle around the way of its origin [m]."""


@dataclass(frozen=True)
class View:
    """A camera.

    Attributes:
        azimuth, elevation: direction in which it looks [deg]; azimuth 90 looks along +y of W, so that the wall is on
            the right.
        distance: from the point that it looks at [m]; None for the least at which all of it is seen.
        lookat: "way" for the middle of the vehicle's way and the wall, "wall" for the place of contact, or "vehicle",
            which it follows.
    """

    azimuth: float
    elevation: float
    distance: float | None = None
    lookat: str = "way"


VIEWS = {
    "overview": View(74.0, -20.0),
    "side": View(90.0, -4.0),
    "top": View(90.0, -89.0),
    "behind": View(22.0, -20.0),
    "close": View(75.0, -28.0, 1.05, "wall"),
    "follow": View(68.0, -22.0, 1.4, "vehicle"),
}
"""The views by name."""


def view_of(chosen: "str | View") -> View:
    """A view by its name, or by "AZIMUTH,ELEVATION" or "AZIMUTH,ELEVATION,DISTANCE" [deg, m]. Raises InputError."""
    if isinstance(chosen, View):
        return chosen
    if chosen in VIEWS:
        return VIEWS[chosen]
    try:
        numbers = [float(each) for each in chosen.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not np.isfinite(numbers).all() or (len(numbers) == 3 and numbers[2] <= 0.0):
        known = suggestion(chosen, VIEWS)
        raise InputError(f"view {chosen!r}: {known}, or give azimuth, elevation and distance: 74,-20,2.5 [deg, deg, m]")
    return View(numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else None)


class Camera:
    """The camera of a run."""

    def __init__(self, trace: Trace, view: View, aspect: float) -> None:
        """``aspect`` is the picture's width over its height."""
        name = trace.header.task_frame[0]
        way = np.concatenate([trace.p_WB, trace[name]])
        low, high = way.min(axis=0), way.max(axis=0)
        face = np.array([wall_face(trace.header), *trace[name][-1, 1:]])
        if np.linalg.norm(np.clip(face, low, high) - face) < _NEAR:
            low, high = np.minimum(low, face), np.maximum(high, face)
        self.lowest = float(way[:, 2].min())
        before_wall = face + np.array([0.03 - trace.header.probe_radius, 0.0, 0.08])
        self.point = before_wall if view.lookat == "wall" else 0.5 * (low + high)
        azimuth = np.radians(view.azimuth)
        sides = high - low
        across = abs(sides[0] * np.sin(azimuth)) + abs(sides[1] * np.cos(azimuth)) + _AROUND
        upright = sides[2] + abs(sides[0] * np.cos(azimuth)) * 0.5 + _AROUND
        fitting = max(across / aspect, upright) / (2.0 * np.tan(0.5 * _FOVY)) + 0.25
        self.view = replace(view, distance=view.distance or float(fitting))

    def at(self, p_WB: np.ndarray) -> mujoco.MjvCamera:
        """MuJoCo's camera while the vehicle is at a position (3,)."""
        camera = mujoco.MjvCamera()
        camera.azimuth, camera.elevation = self.view.azimuth, self.view.elevation
        camera.distance = self.view.distance
        camera.lookat = p_WB if self.view.lookat == "vehicle" else self.point
        return camera
