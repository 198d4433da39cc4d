"""Presets of the sensors, each with its source and how far to trust it. Every number can be replaced in a scenario.

Periods are multiples of 1 ms, so that they fit the usual time steps: 15 Hz is a period of 67 ms.
"""

from __future__ import annotations

import dataclasses
import inspect
from typing import Any

from .sensors import Sensors


def preset(name: str, doc: str, **defaults: Any) -> type[Sensors]:
    """Sensors with other defaults, under a name of their own."""
    fields = {field.name: field for field in dataclasses.fields(Sensors)}
    changed = [
        (key, field.type, dataclasses.field(default=value, metadata=field.metadata))
        for key, value in defaults.items()
        for field in [fields[key]]
    ]
    namespace = {"name": name, "__doc__": inspect.cleandoc(doc), "__module__": __name__}
    class_name = "".join(word.capitalize() for word in name.split("_"))
    return dataclasses.make_dataclass(class_name, changed, bases=(Sensors,), namespace=namespace, frozen=True)


DvlA50 = preset(
    "dvl_a50",
    """Velocity of a DVL A50 near the bottom: 15 Hz, 1 % of the speed.

    Source: the maker's data sheet; trust high for rate and scale. Above 15 m the rate falls to 2 to 4 Hz. The maker
    gives no noise of a sample: set velocity_noise, for example that of dvl_girona.
    """,
    velocity_period=0.067,
    velocity_scale=0.01,
)
DvlHoloocean = preset(
    "dvl_holoocean",
    """Velocity of a DVL in the simulator HoloOcean: 20 Hz, 0.026 m/s.

    Source: the simulator's preset; trust medium, its authors do not say where it is from.
    """,
    velocity_period=0.05,
    velocity_noise=(0.026,) * 3,
)
DvlGirona = preset(
    "dvl_girona",
    """Velocity of the DVL of the vehicle Girona in the simulator Stonefish: 5 Hz, 0.0015 m/s.

    Source: the simulator's example; trust medium.
    """,
    velocity_period=0.2,
    velocity_noise=(0.0015,) * 3,
)
ForceTorque = preset(
    "force_torque",
    """Contact force and moment: 100 Hz, 0.5 N and 0.05 N m. An ASSUMPTION.

    Source: an example of the simulator Stonefish; trust low: no maker's noise figure could be read.
    """,
    force_period=0.01,
    force_noise=(0.5,) * 3,
    moment_period=0.01,
    moment_noise=(0.05,) * 3,
)
Rov = preset(
    "rov",
    """A whole set for a small ROV in a pool: DVL, gyro, attitude, pressure, position and force/torque.

    velocity: DVL A50 (15 Hz, 1 %) with the noise of dvl_girona; trust medium. angular_velocity: 200 Hz, 0.0013 rad/s,
    measured on a BlueROV2 (Kolano); trust high. z: pressure at 5 Hz, 5 Pa or 0.5 mm (Stonefish's Girona); trust
    medium. x and y at 5 Hz with 1 cm, attitude at 100 Hz with 0.005 rad, and force_torque: ASSUMPTIONS.
    """,
    position_period=0.2,
    position_noise=(0.01, 0.01, 0.0005),
    attitude_period=0.01,
    attitude_noise=(0.005,) * 3,
    velocity_period=0.067,
    velocity_scale=0.01,
    velocity_noise=(0.0015,) * 3,
    angular_velocity_period=0.005,
    angular_velocity_noise=(0.0013,) * 3,
    force_period=0.01,
    force_noise=(0.5,) * 3,
    moment_period=0.01,
    moment_noise=(0.05,) * 3,
)
PRESETS = (DvlA50, DvlHoloocean, DvlGirona, ForceTorque, Rov)
"""All presets."""
