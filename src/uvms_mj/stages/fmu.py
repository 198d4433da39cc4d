"""Stages that are FMUs for co-simulation: their class, from the model description of an FMI 2.0 unit.

A parameter is a setting, in the unit and the range that the FMU declares. An input is an entry of a signal that the
stage is given, and an output an entry of what it sets, by its name, ``nu[1]`` and ``R_WB[1,3]`` as FMI counts, or by
the setting ``variables``. They are exchanged as they are: a variable that declares another unit than SI's is
refused, and a number out of the range that it declares ends the run.
"""

import dataclasses
import difflib
import keyword
import math
import os
import re
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import AfterValidator, Field

from ..errors import Fault, InputError, needs_extra, shortened, suggestion
from ..quantities import Number, of_length, within
from .base import ForeignCode, Stage, setting
from .foreign import Records
from .setup import SetupLike
from .signals import OWN_UNIT, Signal

_MOST_BYTES, _MOST_FILES = 1 << 29, 10_000
"""Limits of an FMU that is unpacked."""
Whole = Annotated[int, Field(strict=True, ge=-(2**31), le=2**31 - 1)]
"""An integer of FMI."""


@dataclasses.dataclass(frozen=True)
class Unit:
    """An FMU: its file, the description that FMPy reads, its parameters by the setting's name, and the settings that
    are lists, which have the parameters of their entries."""

    file: Path
    description: Any
    parameters: Mapping[str, tuple[Any, ...]]
    lists: frozenset[str]

    def variables(self, causality: str) -> list[Any]:
        return [each for each in self.description.modelVariables if each.causality == causality]


def _read(path: Path, base: type[Stage]) -> Unit:
    """Read an FMU for the stages of a base class."""
    with needs_extra("fmi"):
        import fmpy
        from fmpy.model_description import ValidationError

    check_archive(path)
    try:
        description = fmpy.read_model_description(os.fspath(path), validate=True)
    except ValidationError as error:
        raise InputError(
            f"{path.name}: its modelDescription.xml is wrong: {'; '.join(map(printable, error.problems))}"
        ) from None
    except Exception as error:  # of the XML parser, and plain ones of FMPy
        raise InputError(f"{path.name}: its modelDescription.xml can't be read: {printable(str(error))}") from None
    if not str(description.fmiVersion).startswith("2."):
        raise InputError(
            f"{path.name}: is an FMU of FMI {printable(str(description.fmiVersion))}; export it as FMI 2.0"
        )
    if description.coSimulation is None:
        raise InputError(f"{path.name}: has no co-simulation, only model exchange; export it for co-simulation")
    for each in (description, *description.modelVariables):  # texts that are shown
        each.description = printable(each.description or "")
    found = list(_parameters(description, base))
    lists = frozenset(name for name, _, is_list in found if is_list)
    return Unit(path, description, {name: members for name, members, _ in found}, lists)


def printable(text: str) -> str:
    """A text of an FMU in one line without control characters, which would control a terminal."""
    return "".join(c if c.isprintable() else " " if c.isspace() else repr(c)[1:-1] for c in text.strip())


def check_archive(path: Path) -> None:
    """Raise InputError for a file that is no archive, or that is not safe to unpack."""
    try:
        with zipfile.ZipFile(path) as archive:
            found = archive.infolist()
    except Exception as error:  # a damaged list raises many kinds
        raise InputError(f"{path.name}: is not an FMU, which is a zip archive: {printable(str(error))}") from None
    if "modelDescription.xml" not in {each.filename for each in found}:
        raise InputError(f"{path.name}: is not an FMU: it has no modelDescription.xml")
    size = sum(each.file_size for each in found)
    if size > _MOST_BYTES or len(found) > _MOST_FILES:
        limits = f"{_MOST_BYTES / 1e6:.0f} MB and {_MOST_FILES} files"
        raise InputError(f"{path.name}: unpacks to {size / 1e6:.4g} MB in {len(found)} files; at most {limits}")
    for each in found:
        place = PurePosixPath(each.filename.replace("\\", "/"))
        if place.is_absolute() or ".." in place.parts or each.external_attr >> 28 == 0o12:
            raise InputError(f"{path.name}: would unpack {shortened(each.filename)} outside of its folder")


def unpack(path: Path, folder: Path, platform: str) -> list[str]:
    """Unpack an FMU into a folder, as far as a machine of a platform needs it. Returns the platforms that it is for.
    Raises InputError for one that can't be unpacked."""
    check_archive(path)
    try:
        with zipfile.ZipFile(path) as archive:
            found = {each.split("/")[1] for each in archive.namelist() if re.fullmatch("binaries/[^/]+/.+", each)}
            unneeded = ("sources/", "documentation/", *(f"binaries/{each}/" for each in found if each != platform))
            members = [each for each in archive.namelist() if not each.startswith(unneeded)]
            archive.extractall(folder, members)  # of each file no more than the archive's list says
    except Exception as error:  # a checksum, a compression: each has exceptions of its own
        if isinstance(error, OSError) and error.errno:  # of the disk
            raise
        raise InputError(f"{path.name}: can't be unpacked: {printable(str(error))}") from None
    return sorted(found)


def _parameters(description: Any, base: type[Stage]) -> Iterator[tuple[str, tuple[Any, ...], bool]]:
    """The settings with their parameters, and whether they are lists.

    k[1], k[2], ... are one list, and any other entries, k[1,2] or k[3] alone, settings of their own, k_1_2 and k_3.
    What no name of Python has, such as a dot, becomes an underscore. A name that a stage has for something else gets
    one at its end."""
    groups: dict[str, dict[int, Any]] = {}
    for each in description.modelVariables:
        if each.causality != "parameter" or each.type not in ("Real", "Boolean", "Integer"):
            continue
        found = re.fullmatch(r"(.+)\[(\d+)\]", each.name)
        name, index = (found[1], int(found[2])) if found else (each.name, 0)
        groups.setdefault(name, {})[index] = each
    taken = {"unit", "get_before_step", "variables", *dir(OfUnit), *dir(base)}
    taken |= {field.name for field in dataclasses.fields(base)}
    for called, members in groups.items():
        is_list = sorted(members) == list(range(1, len(members) + 1))
        settings = [(each.name, (each,)) for each in members.values()]
        if is_list:
            settings = [(called, tuple(members[index] for index in sorted(members)))]
        for name, of in settings:
            word = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_")
            word = word if word and not word[0].isdigit() else f"parameter_{word}"
            while word in taken or keyword.iskeyword(word):
                word += "_"
            taken.add(word)
            yield word, of, is_list


_SYMBOLS = {
    "kg": (1, 0, 0), "m": (0, 1, 0), "s": (0, 0, 1), "sec": (0, 0, 1), "rad": (0, 0, 0), "1": (0, 0, 0),
    "N": (1, 1, -2), "Nm": (1, 2, -2),
}  # fmt: skip
"""Exponents of kg, m and s of coherent units of SI."""


def _dimension(unit: str) -> tuple[int, ...] | None:
    """Exponents of kg, m and s of a coherent unit of SI, as N.m, N m, m/s^2, m/s2 or kg.m2.s-2; None of any other."""
    found = [0, 0, 0]
    for i, part in enumerate(unit.replace("**", "^").split("/")):
        for word in re.split(r"[ .*·⋅]+", part.strip("() ")):
            parsed = re.fullmatch(r"([A-Za-z]+|1)(?:\^?\(?([+-]?\d+)\)?)?", word)
            if parsed is None or parsed[1] not in _SYMBOLS:
                return None
            power = int(parsed[2] or 1) * (-1 if i else 1)
            found = [old + power * new for old, new in zip(found, _SYMBOLS[parsed[1]], strict=True)]
    return tuple(found)


def _declared(variable: Any, name: str) -> Any:
    """An attribute of a variable, or of its declared type."""
    own = getattr(variable, name, None)
    return own if own is not None else getattr(variable.declaredType, name, None)


def _range(variable: Any) -> tuple[float, float]:
    """Least and greatest value that a variable declares."""
    low, high = _declared(variable, "min"), _declared(variable, "max")
    return -math.inf if low is None else float(low), math.inf if high is None else float(high)


@dataclasses.dataclass(frozen=True)
class Wiring:
    """The exchange at an instant: value references of inputs and outputs (n,), their places among the numbers that
    the stage is given, and among the signals that it sets, their ranges (n, 2), and the names of all."""

    inputs: np.ndarray
    given: np.ndarray
    range_in: np.ndarray
    outputs: np.ndarray
    out: np.ndarray
    range_out: np.ndarray
    names: tuple[str, ...]

    def out_of_range(self, which: int, value: float) -> str:
        """A sentence for a variable, counted from 0 over inputs and outputs, with a value out of its range."""
        low, high = (*self.range_in.tolist(), *self.range_out.tolist())[which]
        return f"{self.names[which]} is {value:g}, and the FMU declares the range {low:g} to {high:g}"


class OfUnit:
    """The common part of all FMUs as stages, beside the base class of their room."""

    unit: ClassVar[Unit]
    get_before_step: bool
    variables: Mapping[str, str] | None

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        return {"get_before_step": self.get_before_step}

    def faults(self: Any, setup: SetupLike) -> Iterator[Fault]:
        """The faults between the FMU and the run: missing variables, and variables that do not fit."""
        room = self.room
        counted = len(setup.vehicle.arm.links) if room.counts == "joints" else len(setup.vehicle.thrusters)
        faults: list[Fault] = []
        self.wiring(Records.of(self, counted), faults)
        yield from faults
        experiment, simulation = self.unit.description.defaultExperiment, self.unit.description.coSimulation
        step = float(experiment.stepSize) if experiment is not None and experiment.stepSize else None
        period = self.period_in(setup.scenario)
        if step and not simulation.canHandleVariableCommunicationStepSize and abs(period - step) > 1e-9 * step:
            yield Fault(f"{room.table}.period", f"{period:g} s: the FMU takes steps of {step:g} s only")

    def wiring(self: Any, records: Records, faults: list[Fault]) -> Wiring:
        """The wiring of the FMU for these records; errors are appended to ``faults``."""
        room, table = self.room, self.room.table
        named = dict(self.variables or {})
        known = {each.name for each in self.unit.description.modelVariables}
        exchanged = {each.name for causality in ("input", "output") for each in self.unit.variables(causality)}
        wrong = [f"the FMU has no variable {name!r}; {suggestion(name, known)}" for name in named if name not in known]
        idle = sorted(named.keys() & known - exchanged)
        wrong += [f"{name} is neither an input nor an output of the FMU" for name in idle]
        faults += [Fault(f"{table}.variables", each) for each in wrong]
        inputs = self._side("input", type(self).given(1), records.given, named, faults)
        outputs = self._side("output", room.out, records.out, named, faults)
        set_by = Counter(place for _, place, _ in outputs)
        names = {place: name for name, place in _places(room.out, records.out).items()}
        twice = [names[place] for place in sorted(set_by) if set_by[place] > 1]
        faults += [Fault(f"{table}.variables", f"two outputs of the FMU are {name}") for name in twice]
        for place in sorted(names.keys() - set_by.keys()) if not faults else ():
            wanted = f"no output of the FMU is {names[place]}; name it in {table}.variables"
            faults.append(Fault(f"{table}.name", wanted))
        sides = [
            (
                np.array([each.valueReference for *_, each in side], np.uint32),
                np.array([place for _, place, _ in side], np.int64),
                np.array([_range(each) for *_, each in side], float).reshape(-1, 2),
            )
            for side in (inputs, outputs)
        ]
        return Wiring(*sides[0], *sides[1], tuple(name for name, *_ in (*inputs, *outputs)))

    def _side(
        self: Any,
        causality: str,
        signals: Sequence[Signal],
        dtype: np.dtype,
        named: Mapping[str, str],
        faults: list[Fault],
    ) -> list[tuple[str, int, Any]]:
        """Its name, its place and the variable, for each input, or for each output that is a signal."""
        table, places, found = self.room.table, _places(signals, dtype), list[tuple[str, int, Any]]()
        kinds, units = {signal.name: signal.kind for signal in signals}, _units(signals, dtype)
        for each in self.unit.variables(causality):
            element = named.get(each.name, each.name)
            name = element.partition("[")[0]
            if name not in kinds:
                if causality == "input" or each.name in named:
                    close = difflib.get_close_matches(name, kinds, n=1)
                    hint = f"did you mean {close[0]!r}?" if close else f"`uvms-mj signals {self.room.noun}` lists them"
                    said = f"is no signal: {hint}; name it in {table}.variables"
                else:
                    continue
            elif element not in places:
                sizes = ",".join(map(str, dtype[name].shape if dtype.names else dtype.shape))
                said = f"is no entry of {name}, which is {f'[{sizes}]' if sizes else 'a single number'}"
            elif kinds[name] != "f8":
                said = "is a whole number: FMI's type Real alone is exchanged"
            elif each.type != "Real":
                said = f"is {each.type}: FMI's type Real alone is exchanged"
            elif wrong := self._wrong_unit(each, units[element]):
                said = f"{wrong}; the signal {element} is in {units[element]}, as SI has it: export the FMU in SI units"
            else:
                found.append((f"the {causality} {printable(each.name)}", places[element], each))
                continue
            faults.append(Fault(f"{table}.name", f"the {causality} {printable(each.name)} {said}"))
        return found

    def _wrong_unit(self: Any, variable: Any, unit: str) -> str:
        """The fault of the unit that a variable declares for an entry in ``unit``, as a predicate; empty if it is
        the SI unit, or none is declared."""
        name = _declared(variable, "unit")
        if name in (None, "", "1", "-"):
            return ""
        wanted, shown = _dimension(unit), printable(name)
        (base,) = [each.baseUnit for each in self.unit.description.unitDefinitions if each.name == name][:1] or [None]
        if base is None:
            given = _dimension(name)
            if given is None:
                return f"is in {shown!r}, which the FMU does not define by units of SI"
        else:
            factor, offset = float(base.factor or 1.0), float(base.offset or 0.0)
            if factor != 1.0 or offset != 0.0:
                return f"is in {shown}, {factor:g} of the unit of SI" + (f" from {offset:g} on" if offset else "")
            given = tuple(int(getattr(base, each) or 0) for each in ("kg", "m", "s"))
            others = any(int(getattr(base, each) or 0) for each in ("A", "K", "mol", "cd"))
            if others or "Hz" in name:  # a turn a second is no radian a second, though both are 1/s
                given = None
        return f"is in {shown}" if wanted is not None and given != wanted else ""


def _units(signals: Sequence[Signal], dtype: np.dtype) -> dict[str, str]:
    """The unit of each entry, by its name; of the entries of a matrix with several units, all of them."""
    found = {}
    fields: Any = dtype.fields or {signals[0].name: (dtype, 0)}
    for signal in signals:
        shape = fields[signal.name][0].shape
        whole = len(shape) > 1 or "," not in signal.unit
        for k, index in enumerate(np.ndindex(shape)):
            name = f"{signal.name}[{','.join(str(i + 1) for i in index)}]" if index else signal.name
            found[name] = signal.unit if whole else signal.units[k]
    return found


def _places(signals: Sequence[Signal], dtype: np.dtype) -> dict[str, int]:
    """The place of each entry among the numbers of a record, or of the array of the only signal, by its name."""
    fields: Any = dtype.fields or {signals[0].name: (dtype, 0)}
    return {
        f"{name}[{','.join(str(i + 1) for i in index)}]" if index else name: start // 8 + k
        for name, (kind, start, *_) in fields.items()
        for k, index in enumerate(np.ndindex(kind.shape))
    }


def stage_class(path: Path, base: type[Stage], module: str) -> type[Stage]:
    """The class of an FMU as a stage of a room, for a module of this name. Raises InputError: the file is no FMU, has
    no co-simulation of FMI 2.0, or its description is wrong."""
    unit, fields = _read(path, base), list[Any]()
    for name, members in unit.parameters.items():
        starts, first = [_start(each) for each in members], members[0]
        of, meaning = (
            printable(_declared(first, "unit") or OWN_UNIT),
            first.description or f"parameter {printable(first.name)}",
        )
        if name != first.name.partition("[")[0] and first.description:
            meaning += f" ({printable(first.name)})"
        kinds = {"Boolean": Annotated[bool, Field(strict=True)], "Integer": Whole}
        number: Any = kinds.get(first.type, Number)
        if name in unit.lists:
            number = Whole if first.type == "Integer" else Number
            numbers = Annotated[tuple[number, ...], of_length(len(starts)), _within_ranges(members)]
            fields.append((name, numbers, setting(tuple(starts), of, meaning)))
        elif first.type == "Boolean" or _range(first) == (-math.inf, math.inf):
            fields.append((name, number, setting(starts[0], of, meaning)))
        else:
            fields.append((name, Annotated[number, within(*_range(first), of)], setting(starts[0], of, meaning)))
    before = setting(False, "-", "whether the outputs are read before the step of an instant, not after it")
    named = setting(None, "-", "the signal of a variable of the FMU, where it has another name")
    fields += [("get_before_step", bool, before), ("variables", Mapping[str, str] | None, named)]

    def function(*arguments: Any) -> None:
        raise ForeignCode(f"{unit.file.name} is machine code, which Python does not call")

    namespace: dict[str, Any] = {
        "unit": unit,
        base.room.method: staticmethod(function),
        "__doc__": unit.description.description or f"{unit.description.modelName}, an FMU.",
    }
    kind: Any = dataclasses.make_dataclass(
        unit.file.stem, fields, bases=(OfUnit, base), namespace=namespace, frozen=True, kw_only=True
    )
    kind.__module__ = module
    return kind


def _within_ranges(members: Sequence[Any]) -> AfterValidator:
    """A validator for the ranges of a list of parameters."""
    ranges = [(-math.inf, math.inf) if each.type == "Boolean" else _range(each) for each in members]

    def check(values: tuple[Any, ...]) -> tuple[Any, ...]:
        for each, value, (low, high) in zip(members, values, ranges, strict=True):
            if not low <= value <= high:
                raise ValueError(f"has {value:g} for {printable(each.name)}, which must be from {low:g} to {high:g}")
        return values

    return AfterValidator(check)


def _start(variable: Any) -> float | bool:
    text = variable.start if variable.start is not None else "0"
    if variable.type == "Boolean":
        return text in ("true", "1", True)
    return int(text) if variable.type == "Integer" else float(text)
