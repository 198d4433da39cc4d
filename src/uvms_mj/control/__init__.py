"""Control: the wrench. :mod:`uvms_mj.control.base` has the contract of a law."""

from .base import Controller, External, NoLaw, Udp
from .base import gain as gain
from .laws.admittance import Admittance
from .laws.aismc import Aismc
from .laws.dob_impedance import DobImpedance
from .laws.fosm import Fosm
from .laws.impedance import Ideal, Impedance
from .laws.parallel import Parallel
from .laws.pid import Pid
from .laws.super_twisting import Gsta, Sta
from .laws.yardsticks import IdealAdmittance, IdealParallel
from .task import ImpedanceTask as ImpedanceTask

BUILT_IN: dict[str, type[Controller]] = {
    cls.name: cls for cls in (Impedance, Fosm, Gsta, Sta, Ideal, Pid, Admittance, Parallel, DobImpedance, Aismc)
}
"""The laws that compute tau_cmd."""
SHIPPED: dict[str, type[Controller]] = BUILT_IN | {
    cls.name: cls for cls in (IdealAdmittance, IdealParallel, External, Udp, NoLaw)
}
