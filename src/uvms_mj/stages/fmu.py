"""Stages that are FMUs for co-simulation: their class, from the model description of an FMI 2.0 unit.

A parameter is a setting. An input is an entry of a signal that the stage is given, and an output an entry of what it
sets, by its name, ``nu[1]`` and ``R_WB[1,3]`` as FMI counts, or by the setting ``variables``.
"""

import dataclasses
import difflib
import hashlib
import keyword
import os
import re
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from ..errors import Fault, InputError, needs_extra, shortened, suggestion
from ..quantities import Number, of_length
from .base import ForeignCode, Stage, setting
from .c_header import Records
from .signals import OWN_UNIT, Signal

_MOST_BYTES, _MOST_FILES = 1 << 29, 10_000
"""Limits of an FMU that is unpacked."""
Whole = Annotated[int, Field(strict=True, ge=-(2**31), le=2**31 - 1)]
"""An integer of FMI."""
_ELEMENT = re.compile(r"(\w+)(?:\[(\d+(?:,\d+)*)\])?")


@dataclasses.dataclass(frozen=True)
class Unit:
    """An FMU: its file, the description that FMPy reads, and the names of its parameters by the setting's name. A
    setting that is a list has the parameters of its entries."""

    file: Path
    description: Any
    parameters: Mapping[str, tuple[Any, ...]]

    def variables(self, causality: str) -> list[Any]:
        return [each for each in self.description.modelVariables if each.causality == causality]


def read(path: Path, base: type[Stage]) -> Unit:
    """Read an FMU for the stages of a base class. Raises InputError: it is no FMU, has no co-simulation of FMI 2.0, or
    its description is wrong."""
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


def unpacked(path: Path, folder: Path) -> Path:
    """The folder of an unpacked FMU below ``folder``, by the digest of its file."""
    check_archive(path)
    target = folder / f"fmu-{hashlib.sha256(path.read_bytes()).hexdigest()[:32]}"
    if not target.is_dir():
        with tempfile.TemporaryDirectory(prefix="new-", dir=folder) as new:
            part = Path(new, target.name)
            with zipfile.ZipFile(path) as archive:
                for each in archive.infolist():
                    _unpack(archive, each, part)
            try:
                os.rename(part, target)
            except OSError:  # another process was first
                if not target.is_dir():
                    raise
    return target


def _unpack(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, folder: Path) -> None:
    """Unpack an entry, and not more of it than the archive's list says."""
    target = folder / entry.filename
    if entry.is_dir():
        target.mkdir(parents=True, exist_ok=True)
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    with archive.open(entry) as source, target.open("wb") as out:
        shutil.copyfileobj(source, out)  # zipfile ends at the size of the list


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
        given = {signal.name: signal for signal in type(self).given(1)}
        out = {signal.name: signal for signal in room.out}
        named = dict(self.variables or {})
        known = {each.name for each in self.unit.description.modelVariables}
        unknown = (
            f"the FMU has no variable {name!r}; {suggestion(name, known)}" for name in named if name not in known
        )
        faults += [Fault(f"{table}.variables", wrong) for wrong in unknown]
        exchanged = {each.name for causality in ("input", "output") for each in self.unit.variables(causality)}
        idle = sorted(named.keys() & known - exchanged)
        faults += [Fault(f"{table}.variables", f"{name} is neither an input nor an output of the FMU") for name in idle]
        inputs, outputs = (
            self._side(causality, signals, dtype, named, faults)
            for causality, signals, dtype in (("input", given, records.given), ("output", out, records.out))
        )
        places_out = [place for _, place in outputs]
        for place in sorted({place for place in places_out if places_out.count(place) > 1}):
            name = _element_at(out, records.out, place)
            faults.append(Fault(f"{table}.variables", f"two outputs of the FMU are {name}"))
        missing = sorted(set(range(records.out.itemsize // 8)) - {place for _, place in outputs})
        for place in missing if not faults else ():
            name = _element_at(out, records.out, place)
            faults.append(Fault(f"{table}.name", f"no output of the FMU is {name}; name it in {table}.variables"))
        refs = [np.array([ref for ref, _ in side], np.uint32) for side in (inputs, outputs)]
        places = [np.array([place for _, place in side], np.int64) for side in (inputs, outputs)]
        return Wiring(refs[0], places[0], refs[1], places[1])

    def _side(
        self: Any,
        causality: str,
        signals: Mapping[str, Signal],
        dtype: np.dtype,
        named: Mapping[str, str],
        faults: list[Fault],
    ) -> list[tuple[int, int]]:
        """Value reference and place of each input, or of each output that is a signal."""
        table, found = self.room.table, list[tuple[int, int]]()

        def wrong(said: str) -> None:
            faults.append(Fault(f"{table}.name", f"the {causality} {said}"))

        for each in self.unit.variables(causality):
            element = named.get(each.name, each.name)
            parts = _ELEMENT.fullmatch(element)
            if parts is None or parts[1] not in signals:
                if causality == "input" or each.name in named:
                    close = difflib.get_close_matches(parts[1] if parts else element, signals, n=1)
                    hint = f"did you mean {close[0]!r}?" if close else f"`uvms-mj signals {self.room.noun}` lists them"
                    wrong(f"{each.name} is no signal: {hint}; name it in {table}.variables")
                continue
            place = _place(signals[parts[1]], dtype, parts[2])
            if place is None:
                shape = dtype[parts[1]].shape if dtype.names else dtype.shape
                sizes = ",".join(str(n) for n in shape) if shape else "a single number"
                wrong(f"{each.name} is no entry of {parts[1]}, which is {f'[{sizes}]' if shape else sizes}")
            elif signals[parts[1]].kind != "f8":
                wrong(f"{each.name}: {parts[1]} is a whole number, and FMI's type Real alone is exchanged")
            elif each.type != "Real":
                wrong(f"{each.name} is {each.type}: FMI's type Real alone is exchanged")
            else:
                found.append((int(each.valueReference), place))
        return found


def _place(signal: Signal, dtype: np.dtype, indices: str | None) -> int | None:
    """Place of an entry of a signal among the numbers of a record or of an array; None if it has no such entry."""
    kind, start = (dtype.fields[signal.name][:2]) if dtype.fields else (dtype, 0)
    counts = [int(n) - 1 for n in indices.split(",")] if indices else []
    if len(counts) != len(kind.shape) or any(not 0 <= i < n for i, n in zip(counts, kind.shape, strict=True)):
        return None
    return start // 8 + (int(np.ravel_multi_index(counts, kind.shape)) if counts else 0)


def _element_at(signals: Mapping[str, Signal], dtype: np.dtype, place: int) -> str:
    """Name of the entry at a place of an output."""
    fields: Any = dtype.fields or {next(iter(signals)): (dtype, 0)}
    for name, (kind, start, *_) in fields.items():
        if 0 <= (at := place - start // 8) < kind.itemsize // 8:
            counts = np.unravel_index(at, kind.shape) if kind.shape else ()
            return f"{name}[{','.join(str(int(i) + 1) for i in counts)}]" if counts else name
    raise AssertionError(place)


def stage_class(unit: Unit, base: type[Stage], module: str) -> type[Stage]:
    """The class of an FMU as a stage of a room."""
    fields: list[Any] = []
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
