r"""A force and torque sensor between a link of an arm and its parent, and the contact force that is derived from it.

The sensor is rigid, and carries the link with all links behind it. It measures the wrench that the parent exerts on
them, which their inertia, the water and their weight need, less what a wall gives:

.. math::

    W = \sum_{behind} \big( M_{RB} a + C_{RB}(\nu) \nu + M_A a_r + C_A(\nu_r) \nu_r + D(\nu_r) \nu_r + g \big) - \tau_c

in the sensor's frame S, about its origin; :math:`a_r` and :math:`\nu_r` are relative to the water. The accelerations
are those of the last time step, because those of the present one depend on the torque that the measurement decides.

The contact wrench that a law is given is what a model of the links behind the sensor leaves of the reading, from the
measured state and the coefficients of ``[estimates]``:

.. math:: \tau_c \approx W_{model} - W_m

The model has no term (``none``), the weight in water (``weight``), or also inertia, Coriolis and drag in still water
(``dynamic``) with the differences of the measured velocities over one period as accelerations.
"""

from __future__ import annotations  # so that help(Wrist) shows short type names

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

from ..errors import Fault, InputError
from ..quantities import Lowercase
from ..stages.base import Room, Stage, setting
from ..stages.signals import WRIST_READING, wrist_given
from .channel import MEMORY, measure
from .sensors import channel_faults, channel_of, channel_settings

QUANTITIES = ("force", "moment")


@dataclasses.dataclass(frozen=True)
class Wrist(Stage):
    """Base class of all force and torque sensors in an arm. ``given`` has CLOCK and ``wrench_S`` (6,), the true wrench,
    and reading (6,) is what the sensor reads."""

    site: str = setting(
        "", "-", "link behind the sensor, or a site on that link whose frame is S; S is else the link's"
    )
    compensation: Annotated[Literal["none", "weight", "dynamic"], Lowercase] = setting(
        "weight", "-", "model of the links behind the sensor: none, weight or dynamic"
    )

    room: ClassVar[Room] = Room(
        name="navigation",
        table="wrist",
        given=wrist_given,
        out=(WRIST_READING,),
        noun="wrist sensor",
        arguments=("settings", "state", "given", "state_dot", "reading"),
        counts="joints",
    )

    def constants(self, setup: Any) -> Mapping[str, Any]:
        """The settings that are numbers."""
        return {name: value for name, value in super().constants(setup).items() if not isinstance(value, str)}

    def carried(self, setup: Any) -> tuple[int, Any]:
        """Index of the link behind the sensor, and the site that is S, or None. Raises InputError if there is none."""
        arm = setup.vehicle.arm
        names = [link.name for link in arm.links]
        if self.site in names:
            return names.index(self.site), None
        site = arm.sites.get(self.site)
        if site is not None and site.link >= 0:
            return site.link, site
        known = [*names, *(name for name, each in arm.sites.items() if each.link >= 0)]
        wanted = f"is neither a link nor a site on one; choose from {', '.join(known)}"
        raise InputError([Fault("wrist.site", f"{self.site!r} {wanted}")], "scenario")

    def faults(self, setup: Any) -> Iterator[Fault]:
        if not setup.vehicle.arm.links:
            yield Fault("wrist.name", f"{self.label()!r} is for a vehicle with joints; {setup.vehicle.body} has none")
            return
        if setup.scenario.observer.runs:
            yield Fault("observer.name", "an observer and a wrist sensor would both set the measured force; choose one")
        try:
            self.carried(setup)
        except InputError as error:
            yield from error.faults

    @staticmethod
    def step(settings, state, given, state_dot, reading):
        """Set reading (6,) and state_dot from settings, state and given."""
        raise NotImplementedError


@dataclasses.dataclass(frozen=True)
class NoWrist(Wrist):
    """No sensor in the arm: navigation sets the measured force."""

    name = "none"
    runs: ClassVar[bool] = False

    def check_settings(self) -> None:
        super().check_settings()
        if self.site or self.period is not None:
            raise InputError([Fault("wrist.name", "none has no site and no period; choose wrist.name = sensor")])


_SETTINGS = list(channel_settings(*QUANTITIES, frame="in S"))
_Channels: Any = dataclasses.make_dataclass("_Channels", _SETTINGS, bases=(Wrist,), frozen=True)


@dataclasses.dataclass(frozen=True)
class WristSensor(_Channels):
    """A sensor of six axes with range, resolution, noise, bias, drift, delay and lost samples; by default without
    errors."""

    name = "sensor"
    memory: ClassVar = dict.fromkeys(QUANTITIES, MEMORY)

    def constants(self, setup: Any) -> Mapping[str, Any]:
        """The packed channels by quantity."""
        step = self.period or setup.scenario.control_period
        return {quantity: channel_of(self, quantity).pack(step) for quantity in QUANTITIES}

    def faults(self, setup: Any) -> Iterator[Fault]:
        yield from super().faults(setup)
        yield from channel_faults(self, QUANTITIES, self.period or setup.scenario.control_period)

    @staticmethod
    def step(settings, state, given, state_dot, reading):
        measure(settings.force, state.force, given.wrench_S, 0, given.instant, given.key, 0, reading)
        measure(settings.moment, state.moment, given.wrench_S, 3, given.instant, given.key, 1, reading)


WRISTS: dict[str, type[Wrist]] = {cls.name: cls for cls in (NoWrist, WristSensor)}
