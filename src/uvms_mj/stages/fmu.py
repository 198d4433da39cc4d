"""Stages that are FMUs for co-simulation: their class, from the model description of an FMI 2.0 unit.

A parameter is a setting. An input is an entry of a signal that the stage is given, and an output an entry of what it
sets, by its name, ``nu[1]`` and ``R_WB[1,3]`` as FMI counts, or by the setting ``variables``.
"""

import dataclasses
import difflib
import keyword
import os
import re
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from ..errors import Fault, InputError, needs_extra, shortened, suggestion
from ..quantities import Number, of_length
from .base import ForeignCode, Stage, setting
from .foreign import Records
from .signals import OWN_UNIT, Signal

_MOST_BYTES, _MOST_FILES = 1 << 29, 10_000
"""Limits of an FMU that is unpacked."""
Whole = Annotated[int, Field(strict=True, ge=-(2**31), le=2**31 - 1)]
"""An integer of FMI."""


@dataclasses.dataclass(frozen=True)
class Unit:
    """An FMU: its file, the description that FMPy reads, and the names of its parameters by the setting's name. A
    setting that is a list has the parameters of its entries."""

    file: Path
    description: Any
    parameters: Mapping[str, tuple[Any, ...]]

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
        raise InputError(f"{path.name}: its modelDescription.xml is wrong: {'; '.join(error.problems)}") from None
    except Exception as error:  # of the XML parser, and plain ones of FMPy
        raise InputError(f"{path.name}: its modelDescription.xml can't be read: {error}") from None
    if not str(description.fmiVersion).startswith("2."):
        raise InputError(f"{path.name}: is an FMU of FMI {description.fmiVersion}; export it as FMI 2.0")
    if description.coSimulation is None:
        raise InputError(f"{path.name}: has no co-simulation, only model exchange; export it for co-simulation")
    return Unit(path, description, dict(_parameters(description, base)))


def check_archive(path: Path) -> None:
    """Raise InputError for a file that is no archive, or that is not safe to unpack."""
    try:
        with zipfile.ZipFile(path) as archive:
            found = archive.infolist()
    except (OSError, zipfile.BadZipFile, NotImplementedError) as error:
        raise InputError(f"{path.name}: is not an FMU, which is a zip archive: {error}") from None
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
    except (OSError, zipfile.BadZipFile, zlib.error, NotImplementedError, EOFError, RuntimeError) as error:
        raise InputError(f"{path.name}: can't be unpacked: {error}") from None
    return sorted(found)


def _parameters(description: Any, base: type[Stage]) -> Iterator[tuple[str, tuple[Any, ...]]]:
    """The settings with their parameters: of k[1], k[2], ... one list; a dot of a name becomes an underscore. A name
    that a stage has for something else gets one at its end."""
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
        whole = list(members) == [0] or sorted(members) == list(range(1, len(members) + 1))
        name = called.replace(".", "_")
        if name.isidentifier() and name.isascii() and whole and not name.startswith("_"):
            while name in taken or keyword.iskeyword(name):
                name += "_"
            taken.add(name)
            yield name, tuple(members[index] for index in sorted(members))


@dataclasses.dataclass(frozen=True)
class Wiring:
    """What is exchanged at an instant: value references of inputs and outputs (n,), and their places among the numbers
    that the stage is given, and among those that it sets."""

    inputs: np.ndarray
    given: np.ndarray
    outputs: np.ndarray
    out: np.ndarray


class OfUnit:
    """What all FMUs have as stages, beside the base class of their room."""

    unit: ClassVar[Unit]
    get_before_step: bool
    variables: Mapping[str, str] | None

    def constants(self, setup: Any) -> Mapping[str, Any]:
        return {"get_before_step": self.get_before_step}

    def faults(self: Any, setup: Any) -> Iterator[Fault]:
        """What lacks, or does not fit, between the FMU and the run."""
        room = self.room
        counted = len(setup.vehicle.arm.links) if room.counts == "joints" else len(setup.vehicle.thrusters)
        faults: list[Fault] = []
        self.wiring(Records.of(self, counted), faults)
        yield from faults
        experiment, simulation = self.unit.description.defaultExperiment, self.unit.description.coSimulation
        step = float(experiment.stepSize) if experiment is not None and experiment.stepSize else None
        scenario = setup.scenario
        period = self.period or (scenario.simulation.timestep if self.every_step else scenario.control_period)
        if step and not simulation.canHandleVariableCommunicationStepSize and abs(period - step) > 1e-9 * step:
            yield Fault(f"{room.table}.period", f"{period:g} s: the FMU takes steps of {step:g} s only")

    def wiring(self: Any, records: Records, faults: list[Fault]) -> Wiring:
        """The wiring of the FMU for these records, with what is wrong in ``faults``."""
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
        set_by = Counter(place for _, place in outputs)
        names = {place: name for name, place in _places(room.out, records.out).items()}
        twice = [names[place] for place in sorted(set_by) if set_by[place] > 1]
        faults += [Fault(f"{table}.variables", f"two outputs of the FMU are {name}") for name in twice]
        for place in sorted(names.keys() - set_by.keys()) if not faults else ():
            wanted = f"no output of the FMU is {names[place]}; name it in {table}.variables"
            faults.append(Fault(f"{table}.name", wanted))
        refs = [np.array([ref for ref, _ in side], np.uint32) for side in (inputs, outputs)]
        places = [np.array([place for _, place in side], np.int64) for side in (inputs, outputs)]
        return Wiring(refs[0], places[0], refs[1], places[1])

    def _side(
        self: Any,
        causality: str,
        signals: Sequence[Signal],
        dtype: np.dtype,
        named: Mapping[str, str],
        faults: list[Fault],
    ) -> list[tuple[int, int]]:
        """Value reference and place of each input, or of each output that is a signal."""
        table, places, found = self.room.table, _places(signals, dtype), list[tuple[int, int]]()
        kinds = {signal.name: signal.kind for signal in signals}
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
            else:
                found.append((int(each.valueReference), places[element]))
                continue
            faults.append(Fault(f"{table}.name", f"the {causality} {each.name} {said}"))
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
        starts = [_start(each) for each in members]
        of, meaning = members[0].unit or OWN_UNIT, members[0].description or f"parameter {members[0].name}"
        if members[0].name.endswith("]"):
            number: Any = Whole if members[0].type == "Integer" else Number
            fields.append(
                (name, Annotated[tuple[number, ...], of_length(len(starts))], setting(tuple(starts), of, meaning))
            )
        else:
            kinds = {"Boolean": Annotated[bool, Field(strict=True)], "Integer": Whole}
            fields.append((name, kinds.get(members[0].type, Number), setting(starts[0], of, meaning)))
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


def _start(variable: Any) -> float | bool:
    text = variable.start if variable.start is not None else "0"
    if variable.type == "Boolean":
        return text in ("true", "1", True)
    return int(text) if variable.type == "Integer" else float(text)
