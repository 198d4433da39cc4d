"""Controllers, one module for each; :mod:`uvms_mj.control.base` has their contract."""

from .base import Controller, gain
from .fosm import Fosm
from .gsta import Gsta
from .ideal import Ideal
from .impedance import Impedance
from .loader import BUILT_IN, load_controller
from .sta import Sta

__all__ = ["BUILT_IN", "Controller", "Fosm", "Gsta", "Ideal", "Impedance", "Sta", "gain", "load_controller"]
