"""Guidance: the reference. :mod:`uvms_mj.guidance.base` has the contract of a stage."""

from .base import Guidance
from .base import hold as hold
from .filtered_steps import FilteredSteps

SHIPPED: dict[str, type[Guidance]] = {cls.name: cls for cls in (FilteredSteps,)}
