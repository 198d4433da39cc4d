"""Navigation: the measurements. :mod:`uvms_mj.navigation.base` has the contract of a stage."""

from .base import Navigation, Perfect
from .base import perfect as perfect
from .ekf import Ekf
from .encoder import ENCODERS as ENCODERS
from .encoder import Encoder as Encoder
from .encoder import PerfectEncoder as PerfectEncoder
from .observer import MomentumObserver, NoObserver, Observer
from .sensors import PRESETS, Sensors
from .wrist import WRISTS as WRISTS
from .wrist import NoWrist as NoWrist
from .wrist import Wrist as Wrist

_STAGES: tuple[type[Navigation], ...] = (Perfect, Sensors, *PRESETS, Ekf)
SHIPPED: dict[str, type[Navigation]] = {cls.name: cls for cls in _STAGES}
OBSERVERS: dict[str, type[Observer]] = {cls.name: cls for cls in (NoObserver, MomentumObserver)}
