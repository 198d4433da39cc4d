"""Control laws: one small file for each, and the contract in :mod:`uvms_mj.control.base`."""

from .base import Controller, gain
from .fosm import Fosm
from .gsta import Gsta
from .impedance import Impedance
from .loader import BUILT_IN, load_controller

__all__ = ["BUILT_IN", "Controller", "Fosm", "Gsta", "Impedance", "gain", "load_controller"]
