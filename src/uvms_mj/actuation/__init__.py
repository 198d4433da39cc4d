"""Actuation: the thrusts. :mod:`uvms_mj.actuation.base` has the contract of an allocation, and
:mod:`uvms_mj.actuation.thrusters` that of a thruster model."""

from .base import Actuation, External, PseudoInverse
from .base import pseudo_inverse as pseudo_inverse
from .constrained import Constrained
from .general import General
from .t200 import T200
from .thrusters import IdealThrusters, Thrusters
from .weighted import Weighted

SHIPPED: dict[str, type[Actuation]] = {cls.name: cls for cls in (PseudoInverse, Weighted, Constrained, External)}
THRUSTERS: dict[str, type[Thrusters]] = {cls.name: cls for cls in (IdealThrusters, General, T200)}
