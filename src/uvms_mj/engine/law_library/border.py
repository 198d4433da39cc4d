"""The exchange between a law's library and its caller: the fields of its structs, with their units, frames and places
in the record of the chain."""

import dataclasses
import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...quantities import unit_of
from ...scenario import Scenario
from ...stages.foreign import is_c_name
from ...stages.signals import (
    APPLIED,
    MEASURED,
    REFERENCE,
    SCHEDULED,
    WRENCH_COMMAND,
    WRIST_READING,
    Signal,
    commanded_signal,
    encoder_signals,
    joint_command_signal,
    pulse_signal,
)
from ..native.chain import Chain, Link

POSE, VELOCITY, FORCE, JOINTS, WRIST = "pose", "velocity", "force", "joints", "wrist"
GAIN, ESTIMATE = "gain", "estimate"
START, INERTIAL, AIDS = "start", "inertial", ("dvl", "depth", "heading", "position")
PRESENT = (POSE, VELOCITY, FORCE, JOINTS, WRIST, START, INERTIAL, *AIDS)
"""Groups of measurements, each with a bit of ``present``."""
OF_FILTER: Mapping[str, tuple[tuple[Signal, str], ...]] = {
    START: (
        (Signal("p_WB", (3,), "m", "W", "first estimate: position of B's origin"), "p"),
        (Signal("quat_WB", (4,), "1", "W", "first estimate: attitude, unit quaternion w x y z"), "quat"),
        (Signal("v_WB", (3,), "m/s", "W", "first estimate: velocity of B's origin"), "v"),
        (Signal("omega", (3,), "rad/s", "B", "angular velocity, as the gyro has it"), "omega"),
    ),
    INERTIAL: (
        (Signal("interval", (), "s", "-", "time since the last sample of the inertial unit that was taken"), ""),
        (
            Signal("turn", (3,), "rad", "B", "rotation vector over the interval: the integral of the angular rate"),
            "turn",
        ),
        (
            Signal("push", (3,), "m/s", "B at the last sample", "integral of the specific force over the interval"),
            "push",
        ),
    ),
    "dvl": ((Signal("v_dvl", (3,), "m/s", "B", "velocity of B's origin over ground"), "dvl"),),
    "depth": ((Signal("z_WB", (), "m", "W", "height of B's origin, which is minus the depth"), "depth"),),
    "heading": ((Signal("heading", (), "rad", "W", "angle of B's x in the plane of x and y, from x to y"), "heading"),),
    "position": ((Signal("p_fix", (3,), "m", "W", "position of B's origin"), "fix"),),
}
"""The inputs of the Kalman filter by groups: each signal with the place of its number in the filter's record."""
LONGEST_GAP = 10


@dataclass(frozen=True)
class Entry:
    """A field of a struct: doubles, with the place of the first one in the record of the chain."""

    name: str
    shape: tuple[int, ...]
    unit: str
    meaning: str
    place: int
    group: str = ""

    @property
    def word(self) -> str:
        """Its name in C, with a line below it where C has the word or a setting that every library has is called so."""
        word = re.sub("[^ -~]", lambda found: f"u{ord(found[0]):x}", self.name)
        taken = self.group == GAIN and word in [each.name for each in SCHEDULED]
        return word if is_c_name(word) and not taken else f"{word}_"

    @property
    def n(self) -> int:
        return int(np.prod(self.shape)) if self.shape else 1


@dataclass(frozen=True)
class Border:
    """The structs of a library: measurements, reference if the caller sets it, settings and command."""

    chain: Chain
    measured: tuple[Entry, ...]
    reference: tuple[Entry, ...]
    settings: tuple[Entry, ...]
    command: tuple[Entry, ...]
    neutral: float | None

    @classmethod
    def of(cls, chain: Chain, scenario: Scenario, guided: bool) -> "Border":
        outputs = list(_commands(chain))
        reference = tuple(_entry(chain, each, "signals") for each in REFERENCE) if not guided else ()
        assumed = scenario.thrusters.curves()[1]
        neutral = assumed.neutral if chain.pulses and assumed is not None else None
        return cls(
            chain, tuple(_measurements(chain)), reference, tuple(_settings(chain, scenario)), tuple(outputs), neutral
        )

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups of measurements that the library takes."""
        return tuple(each for each in PRESENT if any(entry.group == each for entry in self.measured))

    @property
    def needed(self) -> tuple[str, ...]:
        """The groups that each call needs. The filter's come when they come."""
        return tuple(each for each in self.groups if each not in OF_FILTER)

    @property
    def flags(self) -> dict[str, int]:
        """The places at which the filter reads which of its groups are new."""
        if self.chain.filter is None:
            return {}
        present = self.chain.place_of("sensors", "present")
        aids = {group: present + k for k, group in enumerate(AIDS) if group in self.groups}
        return {group: self.chain.place_of("sensors", group) for group in (START, INERTIAL)} | aids

    @property
    def layout(self) -> int:
        """A number that decides structs and record; a program compiled with another header is refused by it."""
        text = [repr(self.chain.kind), repr(self.chain.period), repr(self.groups)]
        for part in (self.measured, self.reference, self.settings, self.command):
            text += [f"{each.name} {each.shape} {each.place}" for each in part]
        return int.from_bytes(hashlib.sha256("\n".join(text).encode()).digest()[:8], "little") >> 1

    @property
    def mark(self) -> int:
        """A number that an instance has when its record was begun."""
        text = f"{self.layout}".encode() + self.chain.image.tobytes() + self.chain.constants
        return int.from_bytes(hashlib.sha256(text).digest()[:8], "little") | 1


def _entry(chain: Chain, signal: Any, *record: str, group: str = "", name: str = "") -> Entry:
    meaning = signal.meaning if signal.frame == "-" else f"{signal.meaning}, in {signal.frame}"
    place = chain.place_of(*record, name or signal.name)
    return Entry(signal.name, signal.shape, signal.unit, meaning, place, group)


def _measurements(chain: Chain) -> Iterator[Entry]:
    p_WB, quat_WB, _, nu, force, moment = MEASURED
    if chain.filter is not None:
        yield from _samples(chain, chain.filter)
    else:
        yield _entry(chain, p_WB, "measured", group=POSE)
        yield _entry(chain, quat_WB, "measured", group=POSE)
        yield _entry(chain, nu, "measured", group=VELOCITY)
    if chain.has("derived"):
        yield _entry(chain, WRIST_READING, "wrist", group=WRIST, name="reading")
    elif not chain.has("observer"):
        if chain.filter is None:
            force = dataclasses.replace(force, meaning="measured force of the wall on the vehicle")
            yield _entry(chain, force, "measured", group=FORCE)
        else:  # the filter turns the force to W
            moment = dataclasses.replace(moment, meaning="measured wrench of the wall on the vehicle at B's origin")
        yield _entry(chain, moment, "measured", group=FORCE)
    if n := chain.joints:
        for each in encoder_signals(n):
            yield _entry(chain, each, "joints", group=JOINTS)


def _samples(chain: Chain, link: Link) -> Iterator[Entry]:
    """The measurements of the filter's sensors, as far as the scenario has them."""
    for group, signals in OF_FILTER.items():
        if group in AIDS and link.compiled.settings[f"{group}_samples"][0] == 0.0:
            continue
        for signal, name in signals:
            place = ("filter", name) if name else ("sensors", signal.name)
            yield dataclasses.replace(_entry(chain, signal, *place[:1], name=place[1]), group=group)


def _commands(chain: Chain) -> Iterator[Entry]:
    m = chain.thrusters
    yield _entry(chain, dataclasses.replace(WRENCH_COMMAND, frame="T" if chain.stages.at_tool else "B"), chain.law)
    yield _entry(chain, commanded_signal(m), "commands")
    if chain.pulses is not None:
        pwm = pulse_signal(m)
        if not chain.stages.scenario.thrusters.takes_pulses:
            pwm = dataclasses.replace(pwm, name="thruster_cmd", unit="us or N", meaning="command of each thruster")
        yield Entry(pwm.name, (m,), pwm.unit, pwm.meaning, chain.place_of("outputs"))
    if n := chain.joints:
        torque = joint_command_signal(n)
        yield Entry("tau_q", (n,), torque.unit, "torque demanded of each joint", chain.place_of("tau_q_demand"))
    hat = dataclasses.replace(APPLIED[0], meaning="wrench that these thrusts are believed to give")
    yield _entry(chain, hat, "signals")
    if chain.filter is not None:
        for each in (*MEASURED[:2], MEASURED[3]):
            said = dataclasses.replace(each, meaning=f"estimate: {each.meaning}")
            yield _entry(chain, said, "measured", group=ESTIMATE)


def _settings(chain: Chain, scenario: Scenario) -> Iterator[Entry]:
    law, link = scenario.controller, next(each for each in chain.links if each.name == "controller")
    kind: Any = link.kinds[0].fields
    first = chain.settings_place(link)
    given = {field.name: field for field in law.setting_fields()}
    for name, field in given.items():
        if name not in kind or kind[name][0].base != np.float64:
            continue
        part, offset = kind[name][:2]
        meaning = str(field.metadata.get("meaning", ""))
        yield Entry(name, part.shape, unit_of(field), meaning, first + offset // 8, GAIN)
    if not chain.has("schedule"):
        for signal in SCHEDULED:
            yield _entry(chain, signal, "signals")
