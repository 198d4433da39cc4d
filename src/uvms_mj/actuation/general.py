"""A thruster with every setting spelt out."""

from __future__ import annotations  # so that help(General) shows short type names

import dataclasses
from typing import Annotated

from annotated_types import MaxLen

from ..errors import Fault, InputError
from ..quantities import Moderate
from ..stages.base import setting
from .curve import Curve, wrong_points
from .propeller import Propeller

_Points = Annotated[tuple[Moderate, ...], MaxLen(2000)]


@dataclasses.dataclass(frozen=True)
class General(Propeller):
    """Thrusters with all settings spelt out; ideal by default. Without a curve, thrust and command are the same."""

    curve_command: _Points = setting((), "us or N", "commands of the points of the static curve; empty: no curve")
    curve_thrust: _Points = setting((), "N", "thrusts of the points of the static curve")
    inverted: bool = setting(
        True, "-", "whether the control system inverts the curve; otherwise its command is u_cmd in N"
    )

    name = "general"

    def check_settings(self) -> None:
        super().check_settings()
        wrong = wrong_points(self.curve_command, self.curve_thrust, self.inverted)
        faults = [Fault(f"thrusters.{key}", reason) for key, reason in wrong]
        if faults:
            raise InputError(faults, f"the settings of {self.label()}")

    def curves(self) -> tuple[Curve | None, Curve | None]:
        if not self.curve_command:
            return None, None
        curve = Curve.of(self.curve_command, self.curve_thrust)
        return curve, curve if self.inverted else None
