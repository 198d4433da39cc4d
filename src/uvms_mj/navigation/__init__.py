"""Navigation: the measurements. :mod:`uvms_mj.navigation.base` has the contract of a stage."""

from .base import Navigation
from .perfect import Perfect, perfect

SHIPPED: dict[str, type[Navigation]] = {cls.name: cls for cls in (Perfect,)}

__all__ = ["SHIPPED", "Navigation", "Perfect", "perfect"]
