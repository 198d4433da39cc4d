"""Guidance: the reference. :mod:`uvms_mj.guidance.base` has the contract of a stage."""

from .along_surface import AlongSurface
from .base import Guidance
from .base import station_keep as station_keep
from .filtered_steps import FilteredSteps
from .path import AlongWall, Circle, Path
from .spline import Spline

SHIPPED: dict[str, type[Guidance]] = {
    cls.name: cls for cls in (FilteredSteps, Spline, Path, Circle, AlongWall, AlongSurface)
}
