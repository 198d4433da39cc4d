"""Navigation: the measurements. :mod:`uvms_mj.navigation.base` has the contract of a stage."""

from .base import Navigation, Perfect
from .base import perfect as perfect
from .presets import PRESETS
from .sensors import Sensors

SHIPPED: dict[str, type[Navigation]] = {cls.name: cls for cls in (Perfect, Sensors, *PRESETS)}
