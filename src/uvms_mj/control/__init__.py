"""Control: the wrench. :mod:`uvms_mj.control.base` has the contract of a law."""

from .admittance import Admittance
from .aismc import Aismc
from .base import Controller, External
from .base import gain as gain
from .dob_impedance import DobImpedance
from .fosm import Fosm
from .ideal import Ideal
from .impedance import Impedance
from .parallel import Parallel
from .pid import Pid
from .super_twisting import Gsta, Sta
from .task import ImpedanceTask as ImpedanceTask

BUILT_IN: dict[str, type[Controller]] = {
    cls.name: cls for cls in (Impedance, Fosm, Gsta, Sta, Ideal, Pid, Admittance, Parallel, DobImpedance, Aismc)
}
"""The laws that compute tau_cmd."""
SHIPPED: dict[str, type[Controller]] = {**BUILT_IN, External.name: External}
