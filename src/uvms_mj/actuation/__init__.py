"""Actuation: the thrusts and the joints' torques. :mod:`uvms_mj.actuation.base` has the contract of an allocation,
:mod:`uvms_mj.actuation.thrusters` the contract of a thruster model, and :mod:`uvms_mj.actuation.joints` the contract of
a joint interface."""

from .allocation import Constrained, Scaled, Weighted
from .base import Actuation, Autopilot, External, PseudoInverse, Pwm
from .base import pseudo_inverse as pseudo_inverse
from .joints import Auto, Joints, Position, Torque, Velocity
from .joints import commanded as commanded
from .propeller import T200, General
from .thrusters import IdealThrusters, Thrusters

_ALLOCATIONS = (PseudoInverse, Weighted, Scaled, Constrained, External, Pwm, Autopilot)
SHIPPED: dict[str, type[Actuation]] = {cls.name: cls for cls in _ALLOCATIONS}
THRUSTERS: dict[str, type[Thrusters]] = {cls.name: cls for cls in (IdealThrusters, General, T200)}
JOINTS: dict[str, type[Joints]] = {cls.name: cls for cls in (Auto, Torque, Velocity, Position)}
