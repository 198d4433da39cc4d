"""The T200 thruster of Blue Robotics at a battery's voltage.

The table has the maker's measurements (September 2019) at 10, 12, 14, 16, 18 and 20 V: thrust over the pulse width of
the speed controller's command, on a test stand. The points in between are left out; the thrust at them differs from
their line by at most 0.83 N. Between two voltages the thrust is interpolated linearly at equal pulse width.
"""

from __future__ import annotations  # so that help(T200) shows short type names

import bisect
import dataclasses
import functools
from typing import Annotated, ClassVar

import numpy as np

from ..quantities import Number, within
from ..stages.base import setting
from .curve import Curve
from .propeller import Lag, Propeller

NEUTRAL_US = 1500.0
STANDARD_GRAVITY = 9.80665
VOLTAGES = (10.0, 12.0, 14.0, 16.0, 18.0, 20.0)
PULSE_WIDTHS_US = (
    *range(1100, 1441, 20),
    *(1460, 1464, 1468, 1472, 1476, 1480, 1524, 1528, 1532, 1536, 1540),
    *range(1560, 1901, 20),
)
# fmt: off
THRUST_GF_10 = (  # of 10 gram-force, a row for each voltage
    (-231, -218, -204, -184, -168, -154, -136, -122, -108, -93, -80, -67, -55, -44, -34, -24, -15, -7,
     0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
     9, 18, 29, 41, 55, 70, 85, 97, 118, 136, 155, 173, 191, 212, 236, 258, 277, 293),
    (-290, -276, -256, -234, -214, -195, -173, -153, -137, -119, -102, -87, -72, -57, -44, -32, -20, -11,
     -4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 4,
     13, 25, 39, 55, 71, 89, 108, 128, 148, 171, 192, 218, 246, 271, 301, 326, 350, 371),
    (-352, -336, -310, -285, -259, -235, -212, -189, -163, -144, -124, -105, -88, -70, -55, -40, -26, -15,
     -5, -3, 0, 0, 0, 0, 0, 0, 0, 5, 6,
     18, 33, 50, 69, 89, 109, 132, 155, 181, 209, 234, 266, 299, 332, 362, 398, 430, 452),
    (-407, -387, -366, -331, -299, -271, -245, -220, -194, -167, -144, -120, -102, -82, -65, -48, -32, -18,
     -7, -5, -4, 0, 0, 0, 0, 0, 4, 5, 8,
     22, 40, 60, 82, 103, 128, 154, 182, 212, 243, 276, 311, 342, 382, 425, 465, 501, 525),
    (-459, -435, -404, -371, -336, -296, -266, -236, -211, -181, -156, -133, -108, -89, -70, -53, -37, -21,
     -8, -6, -5, 0, 0, 0, 0, 0, 5, 7, 9,
     25, 43, 63, 84, 108, 132, 160, 192, 222, 259, 293, 327, 372, 421, 469, 521, 567, 602),
    (-504, -474, -435, -396, -356, -313, -274, -244, -214, -186, -158, -132, -107, -88, -69, -53, -39, -24,
     -9, -7, -5, -4, 0, 0, 0, 0, 6, 9, 11,
     29, 47, 64, 82, 102, 128, 158, 192, 225, 266, 306, 344, 396, 455, 514, 571, 626, 672),
)
# fmt: on
_THRUST_N, _PULSE_WIDTHS_US = 0.01 * STANDARD_GRAVITY * np.array(THRUST_GF_10), np.array(PULSE_WIDTHS_US, float)
_Voltage = Annotated[Number, within(VOLTAGES[0], VOLTAGES[-1], "V")]


@functools.lru_cache(maxsize=8)
def thrust_curve(voltage: float) -> Curve:
    """The static curve at a voltage from 10 to 20 V, on the test stand."""
    k = min(bisect.bisect_right(VOLTAGES, voltage), len(VOLTAGES) - 1)  # of the row above
    low, high = _THRUST_N[k - 1], _THRUST_N[k]
    thrust = low + (high - low) / (VOLTAGES[k] - VOLTAGES[k - 1]) * (voltage - VOLTAGES[k - 1])
    return Curve(_PULSE_WIDTHS_US, thrust, NEUTRAL_US)


@dataclasses.dataclass(frozen=True)
class T200(Propeller):
    """T200 thrusters with the maker's curve, a pulse width in whole microseconds and the identified lag."""

    voltage: _Voltage = setting(16.0, "V", "voltage of the battery")
    assumed_voltage: _Voltage | None = setting(None, "V", "voltage that the control system assumes; default: voltage")
    quantum: Annotated[Number, within(0.0, 1e3, "us")] = setting(1.0, "us", "step of the pulse width; 0: none")
    dead_band: Annotated[Number, within(0.0, 1e3, "us")] = setting(
        0.0, "us", "pulse widths as near to 1500 us as this give no thrust, besides the curve"
    )
    lag: Lag = setting("third_order", "-", "none, first_order with time_constant, or third_order, as identified")

    name = "t200"
    takes_pulses: ClassVar[bool] = True

    def curves(self) -> tuple[Curve | None, Curve | None]:
        voltage = self.voltage if self.assumed_voltage is None else self.assumed_voltage
        return thrust_curve(self.voltage), thrust_curve(voltage)
