r"""A law as deployed: what the pulses of the speed controllers leave of a demanded push, in closed form.

A push F along the wall's normal n asks for the thrusts u = B^+ [n; 0] F. Thruster k, whose thrust pushes with the part
c_k = n^T a_k, has the pulse width p_k at which its true curve gives u_k. One step q of all pulses changes the push by

.. math:: \Delta F = q \sum_k |c_k| f'(p_k),

with the slope of the curve's piece in which p_k is. The smallest push that can be held belongs to the first step
beyond the dead band, of every thruster that takes part.
"""

import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..actuation.propeller import Propeller
from ..actuation.thrusters import Curve
from ..control.design import demanded_force
from ..quantities import leaves
from .base import Setup

AS_DEPLOYED: Mapping[str, Any] = dict(
    leaves(tomllib.loads(Path(__file__).with_name("deployed.toml").read_text(encoding="utf-8")), lists=False)
)
"""The keys of a run as deployed, by dotted name."""
_PART = 1e-9
"""Least part in the push with which a thruster counts, relative to the greatest one."""


def as_deployed(overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Overrides of a scenario in front of which the keys of :data:`AS_DEPLOYED` act. Its keys of the thrusters are
    left out where the overrides name another model."""
    other = overrides.get("thrusters.name", AS_DEPLOYED["thrusters.name"]) != AS_DEPLOYED["thrusters.name"]
    keys = {key: value for key, value in AS_DEPLOYED.items() if not (other and key.startswith("thrusters."))}
    return keys | dict(overrides)


@dataclass(frozen=True, eq=False)
class Resolution:
    """The push that the thrusters leave.

    Attributes:
        push: the demanded push [N].
        thrusts: (n,) true thrusts that give it [N].
        commands: (n,) commands of the speed controllers that give these, pulse widths [us], not rounded.
        step: change of the push for one step of all commands; 0 if they have no steps [N].
        smallest: least push above zero that can be held [N].
        given: push of a law that commands ``push`` and does not correct it [N].
    """

    push: float
    thrusts: np.ndarray
    commands: np.ndarray
    step: float
    smallest: float
    given: float

    def text(self, quantum: float) -> str:
        """A sentence, with the step of the commands [us]."""
        held = f"the smallest push that can be held is {self.smallest:.3g} N" if self.smallest else "any push is held"
        if math.isnan(self.push):
            return held
        pulses = sorted({round(float(each), 1) for each, u in zip(self.commands, self.thrusts, strict=True) if u})
        near = f"near {self.push:.4g} N the pulses are {' and '.join(f'{each:g}' for each in pulses)} us"
        one = f"a step of {quantum:g} us of all of them is {self.step:.3g} N, {self.step / self.push:.2g} of the push"
        without = f"a law that does not correct the push gives {self.given:.4g} N"
        return f"{held}; {near}, and {one}; {without}"


def pushed(
    thrusters: Propeller, true: Curve, assumed: Curve, parts: np.ndarray, shares: np.ndarray, push: float
) -> Resolution:
    """The resolution of a push [N] that thrusters (n,) with their ``parts`` in it [1] share: ``shares`` (n,) are their
    thrusts per newton."""
    efficiency, q = thrusters.efficiency, thrusters.quantum
    working = np.abs(parts * shares) > _PART * np.abs(parts * shares).max()
    shares = np.where(working, shares, 0.0)
    signs = np.sign(shares)
    first = np.array([_first(thrusters, true, sign) for sign in signs])
    smallest = efficiency * float((np.abs(parts) * np.abs(first)).sum())
    u = shares * (0.0 if math.isnan(push) else push)
    commands = true.command_for(u / efficiency)
    slopes = np.array([_slope(true, p, sign) for p, sign in zip(commands, signs, strict=True)])
    step = q * efficiency * float((np.abs(parts) * slopes).sum())
    asked = assumed.command_for(u / thrusters.assumed_efficiency)
    rounded = asked if q == 0.0 else assumed.neutral + q * np.floor((asked - assumed.neutral) / q + 0.5)
    dead = np.abs(rounded - assumed.neutral) <= thrusters.dead_band
    thrusts = np.where((thrusters.dead_band > 0.0) & dead, 0.0, true.at(rounded))
    return Resolution(push, u, commands, step, smallest, efficiency * float(parts @ thrusts))


def _first(thrusters: Propeller, true: Curve, sign: float) -> float:
    """The thrust of the curve at the first step of the command beyond the dead band in a direction [N]."""
    if sign == 0.0:
        return 0.0
    dead, q = true.command[true.thrust == 0.0], thrusters.quantum
    edge = abs((dead[-1] if sign > 0.0 else dead[0]) - true.neutral) if len(dead) else 0.0
    edge = max(edge, thrusters.dead_band)
    reach = abs(true.command[-1 if sign > 0.0 else 0] - true.neutral)
    steps = (math.floor(edge / q) + 1) * q if q else np.nextafter(edge, np.inf)
    return float(true.at(np.array([true.neutral + sign * min(steps, reach)]))[0])


def _slope(true: Curve, command: float, sign: float) -> float:
    """The slope of the piece of the curve in which a command is, away from neutral at a point; 0 without a part."""
    if sign == 0.0:
        return 0.0
    side = "right" if sign > 0.0 else "left"
    i = min(max(int(np.searchsorted(true.command, command, side)) - 1, 0), len(true.command) - 2)
    return float((true.thrust[i + 1] - true.thrust[i]) / (true.command[i + 1] - true.command[i]))


def resolution(setup: Setup, push: float | None = None) -> Resolution | str:
    """The resolution of a push on ``[wall]`` [N], by default the demanded one, or the reason why it is not known."""
    thrusters = setup.scenario.thrusters
    if not setup.nominal.B.size:
        return "the vehicle has no thrusters"
    if not setup.scenario.wall.present:
        return "there is no [wall], along whose normal it would be"
    if setup.not_rigid:
        return setup.not_rigid
    true, assumed = thrusters.curves()
    if true is None or assumed is None:
        return f"thrusters.name is {thrusters.label()} without a curve that is inverted"
    assert isinstance(thrusters, Propeller)  # no other one has curves
    if thrusters.failed:
        return f"thruster {thrusters.failed} fails"
    push = demanded_force(setup.scenario) if push is None else push
    B, normal = setup.vehicle.B, setup.design.normal
    shares = setup.scenario.actuation.inverse(setup.nominal.B) @ normal
    if not np.abs(shares).max() > 0.0:
        return "the thrusters give no push along the wall's normal"
    parts = normal[:3] @ B[:3]
    return pushed(thrusters, true, assumed, parts, shares, push if 0.0 < push < math.inf else math.nan)


def deployment_notes(setup: Setup) -> Iterator[str]:
    """A warning if the demanded push is below the smallest one that the thrusters can hold."""
    found = resolution(setup)
    if not isinstance(found, str) and 0.0 < found.push < found.smallest:
        yield (
            f"the demanded push, {found.push:.3g} N, can't be held: the smallest that the steps of the thrusters' "
            f"commands give is {found.smallest:.3g} N"
        )
