"""Actuation: the thrusts. :mod:`uvms_mj.actuation.base` has the contract of a stage."""

from .base import Actuation, External, PseudoInverse
from .base import pseudo_inverse as pseudo_inverse

SHIPPED: dict[str, type[Actuation]] = {cls.name: cls for cls in (PseudoInverse, External)}
