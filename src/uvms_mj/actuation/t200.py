"""The T200 thruster of Blue Robotics at a battery's voltage.

``t200.toml`` has the maker's measurements (September 2019) at 10, 12, 14, 16, 18 and 20 V: thrust over the pulse width
of the speed controller's command, on a test stand. Between two voltages the thrust is interpolated linearly at equal
pulse width.
"""

from __future__ import annotations  # so that help(T200) shows short type names

import bisect
import dataclasses
import functools
import tomllib
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np

from ..quantities import Number, within
from ..stages.base import setting
from .curve import Curve
from .propeller import Lag, Propeller

_TABLE = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
NEUTRAL_US = 1500.0
STANDARD_GRAVITY = 9.80665
VOLTAGES: list[float] = _TABLE["voltages_V"]
PULSE_WIDTHS_US = np.array(_TABLE["pulse_widths_us"], float)
_THRUST_N = 0.01 * STANDARD_GRAVITY * np.array(_TABLE["thrust_10_gf"])
_Voltage = Annotated[Number, within(VOLTAGES[0], VOLTAGES[-1], "V")]


@functools.lru_cache(maxsize=8)
def thrust_curve(voltage: float) -> Curve:
    """The static curve at a voltage from 10 to 20 V, on the test stand."""
    k = min(bisect.bisect_right(VOLTAGES, voltage), len(VOLTAGES) - 1)  # of the row above
    low, high = _THRUST_N[k - 1], _THRUST_N[k]
    thrust = low + (high - low) / (VOLTAGES[k] - VOLTAGES[k - 1]) * (voltage - VOLTAGES[k - 1])
    return Curve(PULSE_WIDTHS_US, thrust, NEUTRAL_US)


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
