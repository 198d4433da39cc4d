r"""Sensors of the vehicle: a channel for each measured quantity, and a force sensor with something behind it.

Position is measured in W, by default with z from the pressure, in which the waves have a part
(:mod:`uvms_mj.physics.waves`). Everything else is measured in B; velocity and the wrench of the contact are given at
B's origin. :mod:`.channel` has the errors of a channel.

The force sensor is between the vehicle and a tool of the mass m at r, the water that moves with it included. With the
acceleration a of the tool's centre, m a = f_c + f_s, where f_s is the force of the vehicle on the tool. The sensor
measures -f_s, the force of the tool on the vehicle, and drifts with the depth below the start:

.. math::

    f_m = f_c - m a - \kappa (z - z_0), \quad a = \dot v + \omega \times v + \dot\omega \times r
          + \omega \times (\omega \times r), \quad \tau_m = \tau_c - r \times m a.

The tool's weight in water is taken as zero. The acceleration is taken from the last time step, because the present
one depends on the thrust that the measurement decides.

Presets are classes with other defaults. They are read from ``presets.toml``, which has their sources.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import operator
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Lt

from ..errors import Fault
from ..physics.frames import rotation, to_world, velocity_at
from ..physics.kernels import kernel
from ..quantities import NonNegative, Number, Positive, Step, Vector3, refusing, repeated, within
from ..stages.base import setting, shared
from ..stages.setup import SetupLike
from .base import ConstantErrors, Measurement, Navigation, RestErrors, no_errors
from .channel import MEMORY, Channel, measure, measure_attitude

Axes = Annotated[Vector3, repeated(3)]
"""A number of each axis, or one number for all three."""
_Deviations = Annotated[Axes, refusing(lambda x: min(x) < 0.0, "must not be negative")]
_Latency = Annotated[Number, within(0.0, 100.0, "s")]
_Scale = Annotated[Number, within(-0.9, 10.0, "")]
_Probability = Annotated[NonNegative, Lt(1.0)]
_NONE = (0.0, 0.0, 0.0)
_CLEAR = 4.0
"""Standard deviations of the noise within a limit, beyond which the limit shifts the mean by less than 1e-5 of one."""

QUANTITIES: Mapping[str, tuple[str, str]] = {
    "position": ("m", "in W"),
    "attitude": ("rad", "a rotation vector in B"),
    "velocity": ("m/s", "in B"),
    "angular_velocity": ("rad/s", "in B"),
    "force": ("N", "in B"),
    "moment": ("N m", "about B's origin, in B"),
}
"""The measured quantities in the order of their random numbers, with the units and the frames of their errors."""


def channel_settings(*quantities: str, frame: str = "") -> Iterator[tuple[str, Any, Any]]:
    """The settings of channels: names, types and fields; ``frame`` replaces the frame of the quantities."""
    for quantity in quantities:
        unit, where = QUANTITIES[quantity]
        where = frame or where
        fields: dict[str, tuple[Any, Any]] = {
            "period": (Step | None, setting(None, "s", "time between two samples; default: every time step")),
            "delay": (_Latency, setting(0.0, "s", "delay of each sample")),
            "jitter": (_Latency, setting(0.0, "s", "largest further delay of a sample, uniform from zero")),
            "noise": (_Deviations, setting(_NONE, unit, f"standard deviation of each sample, {where}")),
            "bias": (Axes, setting(_NONE, unit, f"bias, {where}")),
            "walk": (_Deviations, setting(_NONE, f"{unit}/s^(1/2)", f"random walk: deviation after 1 s, {where}")),
            "scale": (_Scale, setting(0.0, "1", "relative error")),
            "quantum": (NonNegative, setting(0.0, unit, "resolution; 0: exact")),
            "limit": (Positive | None, setting(None, unit, "largest component; default: none")),
            "dropout": (_Probability, setting(0.0, "1", "probability that a sample is lost")),
        }
        if quantity == "attitude":
            del fields["scale"]
        yield from ((f"{quantity}_{name}", *field) for name, field in fields.items())


_NAMES = tuple(field.name for field in dataclasses.fields(Channel))
_remembered = functools.lru_cache(maxsize=64)(Channel)
"""A reset changes few channels, and what was computed of the others is in them."""


def channel_of(stage: Any, quantity: str) -> Channel:
    """The channel of a quantity, by the settings of a stage."""
    return _remembered(*_settings_of(type(stage), quantity)(stage))


@functools.lru_cache(maxsize=64)
def _settings_of(kind: Any, quantity: str) -> Callable[[Any], tuple[Any, ...]]:
    """A function for the settings of a channel in the order of :class:`Channel`. An attitude has no scale, which is the
    last one."""
    names = [f"{quantity}_{name}" for name in _NAMES]
    return operator.attrgetter(*(name for name in names if hasattr(kind, name)))


def channel_faults(stage: Any, quantities: Iterable[str], step: float) -> Iterator[Fault]:
    """Errors of channels for the time between two instants of the stage [s]."""
    for quantity in quantities:
        for name, wrong in channel_of(stage, quantity).faults(step):
            yield Fault(f"{stage.room.table}.{quantity}_{name}", wrong)


_SETTINGS = list(channel_settings(*QUANTITIES))
_Channels: Any = dataclasses.make_dataclass("_Channels", _SETTINGS, bases=(Navigation,), frozen=True)


@dataclasses.dataclass(frozen=True)
class Sensors(_Channels):
    """Sensors with rates, delays, noise, bias, drift, resolution, limits and lost samples; by default perfect."""

    mass_behind: Annotated[NonNegative, Lt(1e6)] = setting(
        0.0, "kg", "inertia of the parts behind the force sensor, the water that moves with them included"
    )
    mass_behind_at: Vector3 = setting(_NONE, "m", "centre of the parts behind the force sensor, in B")
    pressure_depth: bool = setting(
        True, "-", "whether z of the position is from the pressure, in which the pressure of the waves is"
    )
    depth_drift: Axes = setting(_NONE, "N/m", "drift of the force per metre of depth below the start, in B")

    period: Step | None = shared(
        None, "s", "period of all sensors, a multiple of the time step; default: the time step"
    )

    name = "sensors"
    every_step: ClassVar = True
    memory: ClassVar = {**dict.fromkeys(QUANTITIES, MEMORY), "wrench": 6, "start": 1}

    def channel(self, quantity: str) -> Channel:
        """The channel of a quantity."""
        return channel_of(self, quantity)

    @property
    def white_channels(self) -> Mapping[str, Channel]:
        return {quantity: self.channel(quantity) for quantity in QUANTITIES}

    @property
    def plain_wrench(self) -> bool:
        """Whether the measured force is the contact force as it is, in W too."""
        channels = (self.channel(quantity).perfect for quantity in ("attitude", "force", "moment"))
        return all(channels) and self.mass_behind == 0.0 and not any(self.depth_drift)

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """The packed channels (SETTINGS,) by quantity, plain_wrench, and what concerns the force sensor."""
        step = self.period or setup.scenario.simulation.timestep
        channels = {quantity: self.channel(quantity).pack(step) for quantity in QUANTITIES}
        kept = {
            name: getattr(self, name) for name in ("pressure_depth", "mass_behind", "mass_behind_at", "depth_drift")
        }
        return {**channels, **kept, "plain_wrench": self.plain_wrench}

    def faults(self, setup: SetupLike) -> Iterator[Fault]:
        return channel_faults(self, QUANTITIES, self.period or setup.scenario.simulation.timestep)

    @property
    def force_timing(self) -> tuple[float | None, float]:
        return self._timing("force")

    @property
    def velocity_timing(self) -> tuple[float | None, float]:
        found = [self._timing(quantity) for quantity in ("velocity", "angular_velocity")]
        return max((period for period, _ in found if period), default=None), max(late for _, late in found)

    def _timing(self, quantity: str) -> tuple[float | None, float]:
        channel = self.channel(quantity)
        return channel.period, channel.delay + 0.5 * channel.jitter

    def rest_errors(self, setup: SetupLike) -> RestErrors | str:
        """The mean of the measurements: scale, bias and the drift with the depth. White noise has none."""
        channels = self.white_channels
        for quantity, channel in channels.items():
            if any(channel.walk):
                return f"the {quantity.replace('_', ' ')} drifts: navigation.{quantity}_walk"
            if channel.quantum:
                return f"the rest is not unique with a resolution: navigation.{quantity}_quantum"
        if all(channel.settled == Channel() for channel in channels.values()) and not any(self.depth_drift):
            return no_errors
        sizes = {quantity: np.full(3, 1.0 + channel.scale) for quantity, channel in channels.items()}
        biases = {quantity: channel.mean(np.zeros(3)) for quantity, channel in channels.items()}
        return ConstantErrors(
            sizes["position"],
            biases["position"],
            channels["attitude"].mean_attitude(np.array([1.0, 0.0, 0.0, 0.0])),
            np.concatenate([biases["velocity"], biases["angular_velocity"]]),
            np.concatenate([sizes["force"], sizes["moment"]]),
            np.concatenate([biases["force"], biases["moment"]]),
            np.array(self.depth_drift),
            setup.scenario.initial.position[2],
        )

    def out_of_range(self, measured: Measurement) -> str:
        values = {"position": measured.position, "attitude": 2.0 * measured.quat[1:], "velocity": measured.nu[:3]}
        values |= {"angular_velocity": measured.nu[3:], "force": measured.tau_c[:3], "moment": measured.tau_c[3:]}
        for quantity, value in values.items():
            channel, name = self.channel(quantity), quantity.replace("_", " ")
            if channel.limit is None:
                continue
            if np.abs(value).max() > channel.limit:
                return f"the {name} is out of the sensor's range: navigation.{quantity}_limit"
            if (np.abs(value) + _CLEAR * np.array(channel.noise)).max() > channel.limit:
                return (
                    f"noise takes the {name} to the sensor's limit, which shifts its mean: navigation.{quantity}_limit"
                )
        return ""

    @staticmethod
    def step(settings, state, given, state_dot, out):
        k, key, nu, p_WB = given.instant, given.key, given.nu, given.p_WB.copy()
        if settings.pressure_depth:
            p_WB[2] -= given.wave_head
        measure(settings.position, state.position, p_WB, 0, k, key, 0, out.p_WB)
        measure_attitude(settings.attitude, state.attitude, given.quat_WB, k, key, 1, out.quat_WB)
        measure(settings.velocity, state.velocity, nu, 0, k, key, 2, out.nu)
        measure(settings.angular_velocity, state.angular_velocity, nu, 3, k, key, 3, out.nu)
        felt_wrench(settings, given, state.start, state.wrench)
        measure(settings.force, state.force, state.wrench, 0, k, key, 4, out.tau_contact_m_B)
        measure(settings.moment, state.moment, state.wrench, 3, k, key, 5, out.tau_contact_m_B)
        if settings.plain_wrench:
            out.f_contact_m_W[:], out.R_WB[:] = given.f_springs_W, given.R_WB
            return
        rotation(out.quat_WB, out.R_WB)
        to_world(out.R_WB, out.tau_contact_m_B, out.f_contact_m_W)


@kernel
def felt_wrench(settings, given, start, wrench):
    """Set the wrench (6,) in B at its origin that the force sensor is exposed to; ``start`` (1,) keeps z of the first
    instant."""
    wrench[:] = given.tau_springs_B
    if given.instant == 0:
        start[0] = given.p_WB[2]
    m = settings.mass_behind
    if m > 0.0:
        nu, nu_dot, r = given.nu, given.nu_dot, settings.mass_behind_at
        f = -m * (velocity_at(nu_dot, r) + np.cross(nu[3:], velocity_at(nu, r)))  # of the centre
        wrench[:3] += f
        wrench[3:] += np.cross(r, f)
    wrench[:3] -= settings.depth_drift * (given.p_WB[2] - start[0])


def preset(name: str, about: str, source: str, **defaults: Any) -> type[Sensors]:
    """Sensors with other defaults, under a name of their own."""
    fields = {field.name: field for field in dataclasses.fields(Sensors)}
    changed = []
    for key, value in defaults.items():
        default = tuple(value) if isinstance(value, list) else value
        changed.append((key, fields[key].type, dataclasses.field(default=default, metadata=fields[key].metadata)))
    doc = f"{about}\n\n{inspect.cleandoc(source)}"
    class_name = "".join(word.capitalize() for word in name.split("_"))
    namespace = {"name": name, "__doc__": doc, "__module__": __name__}
    return dataclasses.make_dataclass(class_name, changed, bases=(Sensors,), namespace=namespace, frozen=True)


_TABLES = tomllib.loads(Path(__file__).with_name("presets.toml").read_text(encoding="utf-8"))
PRESETS: tuple[type[Sensors], ...] = tuple(preset(name, **table) for name, table in _TABLES.items())
"""All presets."""
globals().update({cls.__name__: cls for cls in PRESETS})  # where pickle looks for them
