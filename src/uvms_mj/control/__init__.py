"""Control: the wrench. :mod:`uvms_mj.control.base` has the contract of a law, and each law is a module."""

from .base import Controller, gain
from .external import External
from .fosm import Fosm
from .gsta import Gsta
from .ideal import Ideal
from .impedance import Impedance
from .sta import Sta
from .task import ImpedanceTask

BUILT_IN: dict[str, type[Controller]] = {cls.name: cls for cls in (Impedance, Fosm, Gsta, Sta, Ideal)}
"""The laws that compute tau_cmd."""
SHIPPED: dict[str, type[Controller]] = {**BUILT_IN, External.name: External}

__all__ = [
    "BUILT_IN",
    "SHIPPED",
    "Controller",
    "External",
    "Fosm",
    "Gsta",
    "Ideal",
    "Impedance",
    "ImpedanceTask",
    "Sta",
    "gain",
]
