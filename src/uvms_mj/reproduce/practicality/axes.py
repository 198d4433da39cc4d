"""The axes from ideal to real, the laws that are compared along them, and the steps from ideal to a pool."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

BASE: Mapping[str, Any] = {
    "vehicle.model": "bluerov2_heavy",
    "initial.position": [0.95, 0.0, 0.0],
    "reference.target": [1.01, 0.0, 0.0],
    "reference.step_time": 1.5,
    "simulation.duration": 8.0,
    "navigation.name": "sensors",
    "thrusters.name": "general",
}
"""The ideal scenario: push_wall with the BlueROV2 Heavy, which starts 5 cm before the wall in the paper's current, at a
control rate of 10 kHz. Sensors and thrusters are ideal, by stages whose settings the axes change."""

BUMPER: Mapping[str, Any] = {"bumper.stiffness": 2e3}
"""A bumper of 2e3 N/m in front of the vehicle."""
SMOOTHER: Mapping[str, Any] = {
    "controller.k_1": 1.0,
    "controller.k_2": 1.0,
    "controller.beta": 2.0,
    "task.A": [-20.0] * 6,
}
"""GSTA's gains for a control rate of 100 Hz."""
RETUNED = "gsta retuned"
LAWS: Sequence[Mapping[str, Any]] = (
    {"name": "impedance"},
    {"name": "fosm"},
    {"name": "gsta"},
    {"name": "gsta", "label": RETUNED, **SMOOTHER},
)
"""The paper's laws with the paper's gains, and GSTA with the retuned ones."""


@dataclass(frozen=True)
class Axis:
    """One way from ideal to real.

    Attributes:
        name: of its study.
        title: for figures and tables.
        key: the scenario's key that varies; a rate is named by its period.
        unit: unit of the key.
        values: from ideal to worse than real.
        real: a value as in a pool.
        source: of the real value, and how far to trust it.
        base: further keys of the axis.
    """

    name: str
    title: str
    key: str
    unit: str
    values: tuple[float, ...]
    real: float
    source: str
    base: Mapping[str, Any] = field(default_factory=dict)

    @property
    def logarithmic(self) -> bool:
        """Whether the values are drawn on a logarithmic scale."""
        positive = [value for value in self.values if value > 0.0]
        return max(positive) / min(positive) > 30.0

    def text(self, value: float) -> str:
        """A value with its unit."""
        return f"{value:g}" if self.unit == "1" else f"{value:g} {self.unit}"

    @property
    def table(self) -> dict[str, Any]:
        """The axis as an entry of ``[[vary]]``."""
        return {"key": self.key, "values": list(self.values)}


def _steps(low: float, high: float, number: int, digits: float = 1e-4) -> tuple[float, ...]:
    """Multiples of the time step, or of ``digits``, evenly spaced in their logarithm, without repetition."""
    return tuple(sorted({round(round(x / digits) * digits, 10) for x in np.geomspace(low, high, number).tolist()}))


_CURVE = {"thrusters.name": "t200", "thrusters.lag": "none", "thrusters.quantum": 0.0}
"""The T200's static curve alone."""
AXES: Sequence[Axis] = (
    Axis(
        "control_period",
        "control period",
        "controller.period",
        "s",
        _steps(1e-4, 0.05, 18),
        0.01,
        "100 Hz, a loop over an autopilot's telemetry; trust medium",
    ),
    Axis(
        "force_delay",
        "delay of the force sensor",
        "navigation.force_delay",
        "s",
        (0.0, *_steps(1e-4, 0.05, 17)),
        0.01,
        "one sample at 100 Hz; an assumption",
    ),
    Axis(
        "force_noise",
        "noise of the force sensor",
        "navigation.force_noise",
        "N",
        (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 2.0, 5.0, 10.0),
        0.5,
        "an example of the simulator Stonefish; an assumption",
        {"navigation.force_period": 5e-4},
    ),
    Axis(
        "velocity_noise",
        "noise of the velocity",
        "navigation.velocity_noise",
        "m/s",
        (0.0, 1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02),
        0.0015,
        "a DVL (Stonefish's Girona); trust medium",
    ),
    Axis(
        "thruster_lag",
        "time constant of the thrusters",
        "thrusters.time_constant",
        "s",
        _steps(1e-3, 0.5, 16),
        0.03,
        "10 to 80 ms in public sources, which disagree; trust medium",
        {"thrusters.lag": "first_order"},
    ),
    Axis(
        "dead_band",
        "dead band of the thrusters",
        "thrusters.dead_band",
        "N",
        (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0),
        0.5,
        "the T200's curve at 16 V (maker, 2019), not compensated; trust high",
    ),
    Axis(
        "voltage",
        "voltage of the battery, assumed 16 V",
        "thrusters.voltage",
        "V",
        (16.0, 15.5, 15.0, 14.5, 14.0, 13.5, 13.0, 12.5, 12.0, 11.0, 10.0),
        14.0,
        "a battery of four cells at the end of a dive; trust high",
        {**_CURVE, "thrusters.assumed_voltage": 16.0},
    ),
    Axis(
        "friction",
        "friction of the wall",
        "wall.friction",
        "1",
        (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0),
        0.3,
        "wet plastic on concrete; an assumption",
    ),
    Axis(
        "wall_stiffness",
        "stiffness of the wall",
        "wall.stiffness",
        "N/m",
        tuple(round(x, -2) for x in np.geomspace(1e3, 1e6, 16).tolist()),
        1e5,
        "the paper's wall",
    ),
    Axis(
        "added_mass",
        "true added mass over the model's",
        "vehicle.added_mass",
        "1",
        (1.0, 1.1, 1.2, 1.3, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0),
        1.5,
        "published sets of one vehicle differ as much; trust high",
    ),
)

_PERIODS = _steps(3e-4, 0.03, 13)
_STIFFNESSES = tuple(round(x) for x in np.geomspace(1e3, 3e5, 13).tolist())
MAPS: Sequence[tuple[str, Axis, Axis]] = tuple(
    (
        f"{name}_and_stiffness",
        Axis(name, title, key, "s", _PERIODS, 0.01, ""),
        Axis("stiffness", "stiffness of the wall", "wall.stiffness", "N/m", _STIFFNESSES, 1e5, ""),
    )
    for name, title, key in (
        ("control_period", "control period", "controller.period"),
        ("force_delay", "delay of the force sensor", "navigation.force_delay"),
    )
)
"""Maps over two axes: name of the study, and the axes."""

STEPS: Sequence[tuple[str, Mapping[str, Any]]] = (
    ("ideal", {}),
    ("100 Hz control", {"controller.period": 0.01}),
    (
        "force sensor: 100 Hz, 0.5 N",
        {"navigation.force_period": 0.01, "navigation.force_noise": 0.5, "navigation.moment_period": 0.01},
    ),
    ("T200 thrusters with their lag, 14 V for 16 V", {"thrusters.name": "t200", "thrusters.voltage": 14.0}),
    ("computation delay 5 ms", {"controller.delay": 0.005}),
    ("added mass 1.5 times the model's, friction 0.3", {"vehicle.added_mass": 1.5, "wall.friction": 0.3}),
    ("DVL, gyro, pressure and attitude of a small ROV", {"navigation.name": "rov"}),
)
"""The steps from ideal to a pool; each adds its keys to those before it. With the T200, 16 V are assumed."""


def step_label(law: str, bumper: bool, number: int) -> str:
    """Label of GSTA with the gains ``law`` after a number of steps."""
    return f"{law}{' with bumper' if bumper else ''} {number}"


def laws_of_steps() -> list[dict[str, Any]]:
    """GSTA with both sets of gains after each step, with and without the bumper, as ``[[laws]]`` of a study."""
    laws, keys = [], dict[str, Any]()
    for number, (_, more) in enumerate(STEPS):
        if more.get("navigation.name"):
            keys = {key: value for key, value in keys.items() if not key.startswith("navigation.")}
        keys |= more
        if keys.get("thrusters.name"):
            keys["thrusters.assumed_voltage"] = 16.0
        for (law, gains), bumper in itertools.product((("gsta", {}), (RETUNED, SMOOTHER)), (False, True)):
            own = {**keys, **gains, **(BUMPER if bumper else {})}
            laws.append({"name": "gsta", "label": step_label(law, bumper, number), **own})
    return laws
