"""Actuation: the thrusts and the joints' torques. :mod:`uvms_mj.actuation.base` has the contract of an allocation,
:mod:`uvms_mj.actuation.thrusters` that of a thruster model, and :mod:`uvms_mj.actuation.joints` that of a joint
interface."""

from .autopilot import Autopilot
from .base import Actuation, External, PseudoInverse
from .base import pseudo_inverse as pseudo_inverse
from .constrained import Constrained
from .general import General
from .joints import Joints, Torque
from .joints import commanded as commanded
from .pwm import Pwm
from .servo import Auto, Position, Velocity
from .t200 import T200
from .thrusters import IdealThrusters, Thrusters
from .weighted import Weighted

_ALLOCATIONS = (PseudoInverse, Weighted, Constrained, External, Pwm, Autopilot)
SHIPPED: dict[str, type[Actuation]] = {cls.name: cls for cls in _ALLOCATIONS}
THRUSTERS: dict[str, type[Thrusters]] = {cls.name: cls for cls in (IdealThrusters, General, T200)}
JOINTS: dict[str, type[Joints]] = {cls.name: cls for cls in (Auto, Torque, Velocity, Position)}
