"""Actuation: the thrusts. :mod:`uvms_mj.actuation.base` has the contract of a stage."""

from .base import Actuation
from .external import External
from .pseudo_inverse import PseudoInverse, pseudo_inverse

SHIPPED: dict[str, type[Actuation]] = {cls.name: cls for cls in (PseudoInverse, External)}

__all__ = ["SHIPPED", "Actuation", "External", "PseudoInverse", "pseudo_inverse"]
