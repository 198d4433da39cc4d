"""The file of an identification: which coefficients are free, and the experiments with their data.

An experiment is one of three kinds. ``motion`` is a free decay, a pendulum, or a log with inputs: it is simulated from
its first sample on. ``towing`` has rows of a steady velocity and the force that holds it. ``trim`` has rows of the
attitude at rest.
"""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from ...errors import Fault, InputError, faults_of, shortened
from ...plant.changed_coefficients import check_name, twin_of
from ...quantities import STRICT, Angles, Number, Position, Step, Twist, Vector3, doc, refusing, within

Scale = Annotated[Number, refusing(lambda x: x is not None and x <= 0.0, "must be greater than 0")]
LONGEST_DELAY = 10.0
"""Greatest delay from an input to its effect [s]."""
UNKNOWNS = ("current", "delay", "clock")
"""Unknowns of a motion that may be fitted beside its start."""


@dataclass(frozen=True, config=STRICT)
class Prior:
    """Earlier knowledge of a coefficient, as a normal distribution."""

    mean: Number
    sigma: Scale


@dataclass(frozen=True, config=STRICT)
class Free:
    """One table of ``[[free]]``: a coefficient that is fitted."""

    name: str
    start: Number | None = doc("where the fit begins; default: the value in the vehicle's file", None)
    bounds: tuple[Number, Number] | None = doc("least and greatest value", None)
    prior: Prior | None = None
    scale: Scale | None = doc("a change that matters; default: the value at the start", None)

    def __post_init__(self) -> None:
        if self.bounds is not None and not self.bounds[0] < self.bounds[1]:
            raise ValueError("bounds: the lower one must come first")


@dataclass(frozen=True, config=STRICT)
class Start:
    """Parts of the state at the first sample that are not measured."""

    position: Position = (0.0, 0.0, 0.0)
    attitude_deg: Angles = (0.0, 0.0, 0.0)
    velocity: Twist = (0.0,) * 6


@dataclass(frozen=True, config=STRICT)
class Experiment:
    """One table of ``[[experiment]]``."""

    data: str
    signals: dict[str, Any]
    kind: Literal["motion", "towing", "trim"] = "motion"
    name: str = ""
    time: dict[str, Any] | None = doc("column and unit of the time", None)
    inputs: dict[str, Any] | None = None
    hold: Literal["previous", "linear"] = doc("the input between its samples", "previous")
    sigma: dict[str, Any] | None = doc("standard deviation of the noise of a signal; default: estimated", None)
    fit: tuple[Literal[UNKNOWNS], ...] = doc("unknowns of this experiment: current, delay, clock", ())  # type: ignore[valid-type]
    current: Vector3 = doc("known current in W [m/s]", (0.0,) * 3)
    delay: Annotated[Number, within(0.0, LONGEST_DELAY, "s")] = doc("from the input in the data to its effect [s]", 0.0)
    start: Start = Start()
    fit_start: bool = doc("whether the measured parts of the start are fitted", True)
    between: tuple[Number, Number] | None = doc("the part of the data that is used [s]", None)
    held_out: bool = doc("whether the whole experiment is held out", False)
    held_out_from: Number | None = doc("time in the data from which on it is held out [s]", None)

    def __post_init__(self) -> None:
        wrong = []
        if self.kind != "motion":
            given = {"fit": self.fit, "current": any(self.current), "delay": self.delay, "between": self.between}
            given["held_out_from"] = self.held_out_from
            wrong += [f"{key}: is for a motion, not for {self.kind}" for key, value in given.items() if value]
        if self.held_out and self.held_out_from is not None:
            wrong.append("give held_out or held_out_from, not both")
        if self.between is not None and not self.between[0] < self.between[1]:
            wrong.append("between: the earlier time must come first")
        if "delay" in self.fit and not self.inputs:
            wrong.append("fit: a delay needs inputs")
        if wrong:
            raise ValueError("; ".join(wrong))


@dataclass(frozen=True, config=STRICT)
class File:
    """An identification."""

    name: str
    vehicle: str
    free: tuple[Free, ...]
    experiment: tuple[Experiment, ...]
    description: str = ""
    timestep: Step = doc("of the simulation [s]", 0.005)
    thrusters: dict[str, Any] | None = doc("the table [thrusters] of a scenario, for pulses", None)


_VALIDATOR = TypeAdapter(File)
_KEYS = {
    "": [field.name for field in dataclasses.fields(File)],
    "free": [field.name for field in dataclasses.fields(Free)],
    "experiment": [field.name for field in dataclasses.fields(Experiment)],
}


def read(tables: Mapping[str, Any], place: str) -> File:
    """The file of an identification from its tables. Raises InputError with all errors of its keys."""
    if not isinstance(tables, Mapping):
        raise InputError(f"{place}: {shortened(tables)} is not a mapping of tables")
    try:
        file = _VALIDATOR.validate_python(dict(tables))
    except ValidationError as error:
        raise InputError(faults_of(error, choices=_KEYS), place) from None
    faults = list[Fault]()
    if not file.free:
        faults.append(Fault("free", "is empty: name a coefficient, [[free]] with name"))
    if not file.experiment:
        faults.append(Fault("experiment", "is empty: name data, [[experiment]] with data and signals"))
    elif all(each.held_out for each in file.experiment):
        faults.append(Fault("experiment", "all are held out; one at least must be fitted"))
    taken = dict[str, str]()
    for i, each in enumerate(file.free):
        try:
            check_name(each.name, f"free[{i}].name")
        except InputError as error:
            faults += error.faults
            continue
        for name in {each.name, twin_of(each.name)}:
            if name in taken:
                faults.append(Fault(f"free[{i}].name", f"{each.name} is the same coefficient as {taken[name]}"))
            taken[name] = each.name
    names = [name_of(each) for each in file.experiment]
    for i, name in enumerate(names):
        if names.index(name) < i:
            faults.append(
                Fault(f"experiment[{i}].name", f"{name!r} is the name of another experiment; give each its own")
            )
    if not file.name.isidentifier():
        faults.append(Fault("name", f"{file.name!r} is the name of the new vehicle: letters, digits and _ only"))
    if faults:
        raise InputError(faults, place)
    return file


def name_of(experiment: Experiment) -> str:
    """The name of an experiment; by default the name of its data."""
    return experiment.name or Path(experiment.data).stem
