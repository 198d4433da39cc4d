"""The plant as an FMU: the engine free_body as machine code in a shell of C, without Python where it runs.

Which numbers of the record of a run a key of the scenario sets is found by comparing the records of native runs. Each
number must be a factor of the key's value plus an offset, exactly; a key that does anything else is no parameter.
"""

import dataclasses
import os
import tempfile
import uuid
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from ..compiler.targets import X86_64
from ..errors import Fault, InputError
from ..files import atomic_write
from ..physics.effects import EFFECTS
from ..physics.random import key_of, owned
from ..plant.water import EFFECT_TABLES
from ..quantities import unit_of
from ..scenario import Scenario
from ..setup.checks import directions
from ..stages.signals import MEASURED
from .native.callback import advance
from .native.net import FIRST
from .native.other_targets import loop_for
from .native.record import STOP_COMMAND, STOP_STATE, STOP_THRUST
from .native.tools import compiler, tool
from .simulation import Simulation

ADVANCE = "uvms_mj_advance"
SEED = "simulation.seed"
RANGES = {
    "wall.position": (-1e6, 1e6),
    "wall.stiffness": (1e-3, 1e12),
    "wall.damping": (0.0, 1e9),
    "wall.friction": (0.0, 100.0),
    **{f"{name}.{key}": ends for name, table in EFFECT_TABLES.items() for key, ends in table.parameters.items()},
    "initial.position": (-1e6, 1e6),
    "initial.velocity": (-100.0, 100.0),
    SEED: (0.0, 2.0**53),
}
"""Keys of a scenario that may become parameters, with the least and the greatest value of a number of the key. A double
has each seed up to 2^53."""
_STOPPED = {
    STOP_STATE: "the state left its bounds",
    STOP_COMMAND: "the commanded wrench is too large, or not finite",
    STOP_THRUST: "a thrust is too large, or not finite",
}
"""Why a run stopped, by its number."""
_PROBES = (0.125, 0.3, 0.77, 1.9, 3.0)
"""Multiples of a key's unit at which the records are compared."""


@dataclasses.dataclass(frozen=True)
class Set:
    """A number of the record that a parameter sets: factor times its value plus an offset."""

    place: int
    factor: float
    offset: float


def write_fmu(scenario: Scenario, path: Path, with_law: bool = False) -> list[str]:
    """Write the plant of a scenario as an FMU: its inputs are tau_cmd, or the thrusts with ``actuation.name`` external,
    or nothing with the law inside. Returns the names of its parameters.

    Raises:
        InputError: the engine free_body can't run the scenario, a stage is not compiled or differs from Python in its
            first instants, or there is no C compiler.
    """
    if not with_law and not (scenario.controller.external or scenario.actuation.external):
        scenario = scenario.updated({"controller.name": "external"})
    with Simulation(scenario, engine="free_body", looks=False) as sim:
        if sim.compares:  # an FMU has no net: a stage that is not as Python is known here, and refused below
            sim.step(FIRST)
    with Simulation(scenario, engine="free_body", looks=False) as sim:
        stages = sim._stages
        for stage in stages.running:
            if stage.library is not None or stage.code is None:
                why = f" ({stage.not_compiled})" if stage.not_compiled else ""
                wrong = f"{stage.stage.label()} can't be in an FMU, which takes compiled Python only{why}"
                raise InputError([Fault(f"{stage.stage.room.table}.name", wrong)])
        parts = _Parts(sim, scenario)
        guid = str(uuid.uuid5(uuid.NAMESPACE_OID, repr(scenario.to_dict())))
        name = "".join(c if c.isalnum() else "_" for c in path.stem)
        loop = loop_for(X86_64, sim._memory.shape, list(stages.running), {ADVANCE: advance})
        library = _linked(loop, parts.header(guid), parts.image)
        description = parts.description(name, guid)
    with atomic_write(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", description)
        archive.writestr(f"binaries/linux64/{name}.so", library)
        archive.writestr("resources/scenario.toml", scenario.to_toml())
    return [_counted(key) for key in parts.parameters]


def _counted(key: str) -> str:
    """A key as FMI has it, with an index from 1."""
    base, _, index = key.partition("[")
    return f"{base}[{int(index[:-1]) + 1}]" if index else key


def _linked(loop: bytes, header: str, image: bytes) -> bytes:
    """The library of the loop and its shell."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "loop.o").write_bytes(loop)
        (place / "plant.h").write_text(header)
        numbers = ",".join(map(str, image))
        (place / "image.c").write_text(f"const unsigned char uvms_mj_image[] = {{{numbers}}};\n")
        source = Path(__file__).with_suffix(".c")
        names = ["loop.o", "image.c", os.fspath(source)]
        options = ["-O2", "-fPIC", "-shared", "-w", "-ffp-contract=off", "-I", folder, *names, "-o", "plant.so", "-lm"]
        command = compiler()
        try:
            done = tool([*command, *options], folder)
        except OSError as error:
            raise InputError(f"the C compiler {command[0]}: {error.strerror}") from None
        if done.returncode or not (place / "plant.so").is_file():
            said = (done.stderr.strip().splitlines() or [f"status {done.returncode}"])[-1]
            raise InputError(f"the shell of the FMU does not compile with {command[0]}: {said}")
        return (place / "plant.so").read_bytes()


class _Parts:
    """The facts of a run for the shell of C and the model description."""

    def __init__(self, sim: Simulation, scenario: Scenario) -> None:
        self.sim, self.scenario, memory = sim, scenario, sim._memory
        self.memory = memory
        words = memory.image.fixed.view("<i8").copy()
        rows = sim._stages.rows["code_at"]
        for k in range(len(sim._stages.running)):
            words[memory.image.place(rows[k : k + 1])] = k + 1
        words[memory.image.place(memory.run["address"])] = 0
        self.image = words.tobytes()
        last, _ = memory.image.room("rows")
        behind = memory.image.numbers[:last].copy()  # the tables of water and walls are in rooms behind the records
        behind[: len(words)] = 0.0
        self.tables = {int(place): float(behind[place]) for place in np.flatnonzero(behind)}
        self.units = {key: unit for name in RANGES if name != SEED for key, unit in self._entries(name)}
        self.parameters = {key: found for key in self.units if (found := self._sets(key)) is not None}
        taken: dict[int, str] = {}
        for key, found in list(self.parameters.items()):
            if any(each.place in taken for each in found):
                del self.parameters[key]
            taken |= {each.place: key for each in found}
        self.inputs = self._inputs()
        self.outputs = list(self._outputs())

    def _fixed(self, overrides: dict[str, Any]) -> np.ndarray:
        """The numbers of the records at the start, after a reset."""
        self.sim.reset(overrides)
        self.memory.restart(self.sim.setup)
        return self.memory.image.fixed.view("<i8").copy()

    def _entries(self, name: str) -> Iterator[tuple[str, str]]:
        """The numbers of a key, each with its unit. An index counts from 0, of FMI from 1."""
        table, word = name.split(".")
        given = getattr(self.scenario, table)
        units = unit_of(given.__dataclass_fields__[word]).replace(" ", ".").split(",.")
        size = np.size(getattr(given, word))
        for i in range(size):
            yield (f"{name}[{i}]" if size > 1 else name), units[i * len(units) // size]

    def _value(self, key: str) -> float:
        name, _, index = key.partition("[")
        table, word = name.split(".")
        value = getattr(getattr(self.scenario, table), word)
        return float(value[int(index[:-1])] if index else value)

    @staticmethod
    def _range(key: str) -> tuple[float, float]:
        return RANGES[key.partition("[")[0]]

    def _meaning(self, key: str) -> str:
        table, word = key.partition("[")[0].split(".")
        return next(
            str(f.metadata["meaning"]) for f in dataclasses.fields(getattr(self.scenario, table)) if f.name == word
        )

    def _override(self, key: str, value: float) -> dict[str, Any]:
        name, _, index = key.partition("[")
        if not index:
            return {name: value}
        table, word = name.split(".")
        values = list(getattr(getattr(self.scenario, table), word))
        values[int(index[:-1])] = value
        return {name: values}

    def _sets(self, key: str) -> list[Set] | None:
        """The numbers that a key sets; None if it is no parameter."""
        if key == "wall.position" and self.scenario.tether.advances:
            return None  # the cable begins outside of the wall
        default = self._value(key)
        unit = abs(default) if default else 1.0
        values = [default, *(p * unit for p in _PROBES)]
        try:
            images = [self._fixed(self._override(key, value)) for value in values]
        except InputError:
            return None
        changed = sorted({int(p) for image in images[1:] for p in np.flatnonzero(image != images[0])})
        found = []
        for place in changed:
            numbers = np.array([image[place] for image in images]).view("f8")
            factor = self._factor(values, numbers)
            if factor is None:
                return None
            found.append(Set(place, *factor))
        return found or None

    def _walls(self) -> Iterator[str]:
        """The directions of ``[wall]``, whose numbers must keep the time step stable as in a run: the parameters of
        stiffness, damping and friction, -1 without one, with the number that takes its place, and the mass."""
        names, wall = list(self.parameters), self.scenario.wall
        for each in directions(self.sim.setup):
            if each.table != "wall":
                continue
            own = each.prefix == "" or getattr(wall, f"{each.prefix}stiffness") is None
            keys = (
                "wall.stiffness" if own else "",
                "" if each.prefix else "wall.damping",
                "wall.friction" if each.prefix else "",
            )
            places = ", ".join(str(names.index(key) if key in names else -1) for key in keys)
            yield f"{{{{{places}}}, {{{each.k!r}, {each.b!r}, 1.0}}, {each.m!r}}}"

    @staticmethod
    def _factor(values: Sequence[float], numbers: np.ndarray) -> tuple[float, float] | None:
        """Factor and offset with which the numbers follow from the values, exactly."""
        slopes = np.diff(numbers[1:]) / np.diff(values[1:])
        guesses = {1.0, -1.0, float(numbers[-1] / values[-1]), *map(float, slopes)}
        for factor in guesses:
            for offset in {0.0, *(float(n - factor * v) for v, n in zip(values, numbers, strict=True))}:
                if all(factor * v + offset == n for v, n in zip(values, numbers, strict=True)):
                    return factor, offset
        return None

    def _inputs(self) -> list[tuple[str, int, str]]:
        sim, place = self.sim, self.memory.image.place
        if self.scenario.actuation.external:
            return [(f"u_cmd[{i + 1}]", place(sim._stages.u_cmd[i : i + 1]), "N") for i in range(len(sim.u))]
        if self.scenario.controller.external:
            units = ("N", "N", "N", "N.m", "N.m", "N.m")
            command = sim._stages.tau_cmd
            return [(f"tau_cmd[{i + 1}]", place(command[i : i + 1]), unit) for i, unit in enumerate(units)]
        return []

    def _outputs(self) -> Iterator[tuple[str, int, str, str]]:
        """The signals of a run, entry by entry: name, place, unit and meaning."""
        known = {name for name, *_ in self.inputs}
        given = type(self.scenario.controller).given(len(self.sim.u))
        signals = {signal.name: signal for signal in (*given, *MEASURED, *self.sim.recorded)}
        for name, view in self.memory.views().items():
            if view.dtype != np.float64 or name in ("t", "period"):
                continue
            signal = signals[name]
            units = signal.units if len(signal.shape) < 2 or "," not in signal.unit else ("",) * signal.size
            meaning = signal.meaning + (f", in {signal.frame}" if signal.frame != "-" else "")
            for flat, index in enumerate(np.ndindex(view.shape)):
                entry = f"{name}[{','.join(str(i + 1) for i in index)}]" if index else name
                if entry not in known:
                    place = self.memory.image.place(view.reshape(-1)[flat : flat + 1])
                    yield entry, place, units[flat].replace(" ", "."), meaning

    def _keys(self) -> Iterator[tuple[int, str]]:
        """The places of the keys of random numbers, with their names."""
        if self.scenario.sea.follows_seed:
            wrong = "the waves follow simulation.seed, which is a parameter of an FMU, and are drawn before the run"
            raise InputError(f"sea.seed: {wrong}; set it")
        seeds = (self.scenario.simulation.seed, 12345)
        images = [self._fixed({"simulation.seed": seed}) for seed in seeds]
        names = [
            *self.memory.stages.stages,
            *EFFECTS,
            *(s.stage.room.table for s in self.memory.stages.running),
        ]
        names += [owned(name, self.scenario.vehicle.name) for name in names]
        for place in np.flatnonzero(images[0] != images[1]):
            found = [
                n for n in names if all(image[place] == key_of(s, n) for s, image in zip(seeds, images, strict=True))
            ]
            assert found, f"the number at {place} follows from the seed in an unknown way"
            yield int(place), found[0]

    def header(self, guid: str) -> str:
        """The constants of the shell."""
        run, place, image = self.memory.run, self.memory.image.place, self.memory.image
        last, room = image.room("rows")
        del room
        sets = [(list(self.parameters).index(key), s) for key, found in self.parameters.items() for s in found]
        keys = list(self._keys())
        starts = [*(self._value(key) for key in self.parameters), float(self.scenario.simulation.seed)]
        self.sim.reset()
        ranges, walls = [self._range(key) for key in (*self.parameters, SEED)], list(self._walls())

        def rows(values: Sequence[str], kind: str, name: str) -> str:
            return f"static const {kind} {name}[] = {{{', '.join(values) or '0'}}};"

        return "\n".join(
            [
                f'#define GUID "{{{guid}}}"',
                f"#define NUMBERS {last}",
                f"#define IMAGE_BYTES {len(self.image)}",
                f"#define PARAMETERS {len(starts)}",
                f"#define SEED {len(starts) - 1}",
                f"#define INPUTS {len(self.inputs)}",
                f"#define OUTPUTS {len(self.outputs)}",
                f"#define SETS {len(sets)}",
                f"#define KEYS {len(keys)}",
                f"#define ADDRESS {place(run['address'])}",
                f"#define STOP {place(run['stop'])}",
                f"#define CONTROL {self.sim._stages.control}",
                f"#define TIMESTEP {self.scenario.simulation.timestep!r}",
                f"#define TABLES {len(self.tables)}",
                "struct number { int64_t place; double value; };",
                rows([f"{{{p}, {v!r}}}" for p, v in self.tables.items()] or ["{0}"], "struct number", "tables"),
                rows([repr(low) for low, _ in ranges], "double", "least"),
                rows([repr(high) for _, high in ranges], "double", "greatest"),
                f"#define WALLS {len(walls)}",
                "struct wall { int parameter[3]; double number[3], mass; };",
                rows(walls or ["{{0}}"], "struct wall", "walls"),
                "struct set { int parameter; int64_t place; double factor, offset; };",
                "struct key { int64_t place; const char *name; };",
                rows(
                    [f"{{{i}, {s.place}, {s.factor!r}, {s.offset!r}}}" for i, s in sets] or ["{0}"],
                    "struct set",
                    "sets",
                ),
                rows([f'{{{p}, "{name}"}}' for p, name in keys] or ["{0}"], "struct key", "keys"),
                rows(list(map(repr, starts)), "double", "starts"),
                rows([str(p) for _, p, _ in self.inputs], "int64_t", "inputs_at"),
                rows([str(p) for _, p, *_ in self.outputs], "int64_t", "outputs_at"),
                rows([f'"{_counted(key)}"' for key in (*self.parameters, SEED)], "char *const", "named"),
                "static const char *stopped(int64_t stop)",
                "{",
                *(f'    if (stop == {stop}) return "{said}";' for stop, said in _STOPPED.items()),
                '    return "the run has ended";',
                "}",
                "",
            ]
        )

    def description(self, name: str, guid: str) -> str:
        """modelDescription.xml."""
        lines, units = list[str](), set[str]()

        def variable(called: str, rest: str, real: str, unit: str, meaning: str) -> None:
            units.add(unit)
            has_unit = f"unit={quoteattr(unit)} " if unit not in ("", "1", "-") else ""
            lines.append(
                f'<ScalarVariable name={quoteattr(called)} valueReference="{len(lines)}" '
                f"description={quoteattr(meaning)} {rest}><Real {has_unit}{real}/></ScalarVariable>"
            )

        fixed = 'causality="parameter" variability="fixed" initial="exact"'
        for key in self.parameters:
            called = _counted(key)
            low, high = self._range(key)
            limits = f'min="{low!r}" max="{high!r}"'
            start = f'{limits} start="{self._value(key)!r}"'
            variable(called, fixed, start, self.units[key], self._meaning(key))
        seed = float(self.scenario.simulation.seed)
        variable(SEED, fixed, f'min="0.0" max="{RANGES[SEED][1]!r}" start="{seed!r}"', "1", self._meaning(SEED))
        for called, _, unit in self.inputs:
            what = "commanded wrench at the origin of B, in B" if called.startswith("tau") else "commanded thrust"
            variable(called, 'causality="input" variability="continuous"', 'start="0.0"', unit, what)
        first = len(lines) + 1
        for called, _, unit, meaning in self.outputs:
            variable(called, 'causality="output" variability="continuous" initial="calculated"', "", unit, meaning)
        defined = "".join(f"<Unit name={quoteattr(unit)}/>" for unit in sorted(units - {"", "1", "-"}))
        unknowns = "".join(f'<Unknown index="{first + i}"/>' for i in range(len(self.outputs)))
        h, duration = self.scenario.simulation.timestep, self.scenario.simulation.duration
        about = f"uvms-mj: {self.scenario.name}, {self.scenario.vehicle.model}, engine free_body, SI units"
        return (
            '<?xml version="1.0" encoding="UTF-8"?>\n'
            f'<fmiModelDescription fmiVersion="2.0" modelName={quoteattr(name)} guid="{{{guid}}}" '
            f'description={quoteattr(about)} generationTool="uvms-mj" variableNamingConvention="structured" '
            'numberOfEventIndicators="0">\n'
            f'<CoSimulation modelIdentifier={quoteattr(name)} canHandleVariableCommunicationStepSize="true" '
            'canGetAndSetFMUstate="true" canSerializeFMUstate="true" canNotUseMemoryManagementFunctions="true"/>\n'
            f"<UnitDefinitions>{defined}</UnitDefinitions>\n"
            f'<DefaultExperiment startTime="0.0" stopTime="{duration!r}" stepSize="{h!r}"/>\n'
            f"<ModelVariables>\n{chr(10).join(lines)}\n</ModelVariables>\n"
            f"<ModelStructure><Outputs>{unknowns}</Outputs><InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure>\n"
            "</fmiModelDescription>\n"
        )
