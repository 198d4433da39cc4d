"""The files of a law's library, its tests and its README, of a run and the tools."""

import hashlib
import importlib.metadata
import re
import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tomli_w

from ...errors import Fault, InputError
from ...files import atomic_write
from ...scenario import Scenario
from ..engines import refusals
from ..native import libm_in_c
from ..native.chain import Chain, refuse
from ..native.compilation import short_run
from ..native.net import FIRST
from ..native.plain_stage import StageFault
from ..native.run_memory import RunMemory
from ..simulation import Simulation
from . import as_law, elf_object, linking, texts
from .as_law import AsLaw
from .border import Border
from .linking import MACHINES, Machine, Work
from .vectors import Vectors, recorded

_HEADER_WORDS = 5  # mark, last, begun, fault and first before the record
_ROWS = "rows"  # the file of the recorded rows, for the test here
_STEPS = re.compile(rb"(\d+) of (\d+) steps equal; a step used (\d+) bytes of stack")


@dataclass(frozen=True)
class Made:
    """A library of one target.

    Attributes:
        target: its name.
        files: the libraries by their names below the folder, each with its SHA-256.
        code, constants: bytes of code, and of constants with the record as it begins.
        undefined: the symbols that it takes from the program.
        adapter: bytes of the object by which a run takes it as a law, which no program links: in none of the above.
        equal, stack: recorded steps that were equal where the test ran, and its stack [bytes]; None where it did not.
        said: the words of the test on the first step that differs.
    """

    target: str
    files: dict[str, str]
    code: int
    constants: int
    undefined: tuple[str, ...]
    adapter: int
    equal: int | None = None
    stack: int | None = None
    said: str = ""

    @property
    def foreign(self) -> list[str]:
        """The functions that it takes from a C library of the target, with which its bits may differ."""
        return sorted(set(self.undefined) - linking.HELPERS)


@dataclass(frozen=True)
class Library:
    """The result of :func:`write_library`: its name, its record [bytes], its period [s], the number of recorded
    steps, the stages of the scenario that it leaves behind, the library of each target, and notes: the warnings of the
    scenario, the stages left behind, and the promises that a vehicle with joints has not."""

    name: str
    record: int
    period: float
    steps: int
    left: list[str]
    targets: list[Made]
    notes: tuple[str, ...] = ()


def write_library(
    scenario: Scenario,
    folder: Path,
    targets: Sequence[str],
    name: str = "",
    guided: bool = True,
    test: bool = True,
    work: Work | None = None,
) -> Library:
    """Write the control system of a scenario into a folder as libraries for the targets, keys of :data:`.MACHINES`.

    Args:
        name: of the library and of its functions; default: the law's name.
        guided: whether the scenario's guidance is in the library; otherwise each call is given the reference.
        test: whether the test runs where this machine, or an emulator on it, can run it.
        work: of the targets and ``test``, that has begun.

    Raises:
        InputError: a stage can't leave this machine, ziglang is not installed, or a test shows that a library does not
            compute what the run computes.
    """
    name = name or name_of(scenario)
    if not texts.is_free(name):
        raise InputError(
            f"--name {name!r}: must be the name of a function in C, and no word of the library's own sources"
        )
    with Work(targets, test) if work is None else nullcontext(work) as work, ExitStack() as stack:
        pool, apart, place = work.pool, work.apart, work.folder
        new = place / "new"
        new.mkdir()

        def begin(
            memory: RunMemory,
        ) -> tuple[_Parts, Future[None], dict[str, Future[Made]]]:
            """LLVM and ziglang work for the targets while the run's machine code is made, and the run is recorded."""
            chain = Chain(memory, guided)
            border = Border.of(chain, scenario, guided)
            header = _header(border, scenario, name)
            ours = {f"{name}.h": header, "vectors.h": texts.vectors_apart(border, _ROWS), "test.c": texts.test(name)}
            for file, content in ours.items():
                (place / file).write_text(content, encoding="utf-8")
            program = pool.submit(work.prepare, targets, place / "test.c")
            text = chain.module(f"{name}_chain", apart)
            own = linking.with_own_names(text, name, [link.symbol for link in chain.links if link.in_c])
            stages = pool.submit(linking.emitted, own, [MACHINES[target] for target in targets], apart)
            parts = _Parts.of(border, header, text, scenario, name)
            objects = {target: pool.submit(compiled, target, parts) for target in targets}
            return parts, program, {target: pool.submit(make, target, stages, objects[target]) for target in targets}

        def compiled(target: str, parts: _Parts) -> list[str]:
            own = place / target
            for file, content in parts.sources.items():
                (own / file).write_text(content, encoding="utf-8")
            return _compiled(MACHINES[target], parts.border.chain, own, name)

        def make(target: str, stages: Future[list[bytes]], objects: Future[list[str]]) -> Made:
            work.begun.result()
            own, in_c = place / target, objects.result()
            (own / "stages.o").write_bytes(stages.result()[targets.index(target)])
            if functions := linking.libm_calls(((own / each).read_bytes() for each in in_c), name):
                text = libm_in_c.text_of(functions, linking.libm_of(name))
                (own / "libm.o").write_bytes(*linking.emitted(text, [MACHINES[target]], apart))
                in_c = [*in_c, "libm.o"]
            return _made(MACHINES[target], target, in_c, name, own, new)

        def tried(target: str) -> Made:
            program.result()
            made = libraries[target].result()
            return _tried(MACHINES[target], made, new / target / f"lib{name}.a", place / target) if test else made

        sim = _Run(scenario, begin)
        stack.enter_context(sim)
        parts, program, libraries = sim.begun
        border, law, export = parts.border, parts.law, parts.export
        chain, not_asked, no_law = border.chain, parts.not_asked, parts.no_law
        try:
            if sim.compares:  # the library has no net: a stage that is not as Python is known here, and refused
                sim.step(FIRST)
                refuse(sim.memory.stages)
                sim.reset()
            steps = recorded(sim, border, parts.text, f"{name}_chain")
        except StageFault as fault:
            raise InputError(f"export law: the run for its test ends: {fault}") from fault
        refuse(sim.memory.stages)  # a stage may have turned out not to be as Python during the run
        for target in targets:
            (place / target / _ROWS).write_bytes(texts.told(steps))
        slowest_first = sorted(targets, key=lambda target: MACHINES[target].shared)
        trying = {target: pool.submit(tried, target) for target in slowest_first}
        files = {
            f"{name}.h": parts.sources[f"{name}.h"],
            "vectors.h": texts.vectors_text(border, steps, name),
            "test.c": texts.test(name),
            "LICENSE": _license(),
        }
        if shared := any(MACHINES[target].shared for target in targets):
            files["loop.c"] = texts.loop(border, name, not not_asked)
        for file, content in files.items():
            _write(new / file, content)
        notes = sim.notes
        made = [trying[target].result() for target in targets]
        missing = [*_apart(border, steps), *([f"a run can't take the library as its law: {no_law}"] if no_law else [])]
        notes += (*texts.left_behind(border), *_few(steps), *filter(None, ["; ".join(missing)]))
        record = 8 * _HEADER_WORDS + chain.kind.itemsize
        library = Library(name, record, chain.period, steps.steps, chain.left, made, notes)
        for each in made:
            if each.equal is not None and each.equal != steps.steps:
                wrong = f"{each.equal} of {steps.steps} recorded steps are equal on {each.target}; {each.said}"
                raise InputError(f"export law: the library does not compute what the run computes: {wrong}")
            if MACHINES[each.target].shared:
                toml = (
                    law.toml() if law is not None else {"stage": "controller", "refused": f"no law of a run: {no_law}"}
                )
                _write(new / each.target / f"{name}{as_law.SUFFIX}.toml", tomli_w.dumps(toml))
        _write(new / f"{name}.toml", tomli_w.dumps(_about(scenario, border, library, export)))
        _write(new / "scenario.toml", scenario.to_toml())
        asked = export if shared and not not_asked else 0
        _write(new / "README.md", _readme(border, library, _title(scenario), steps, law is not None, asked))
        for earlier in MACHINES:  # a library that was made before has other gains
            for file in (f"lib{name}.a", f"lib{name}.so", f"{name}{as_law.SUFFIX}.toml"):
                (folder / earlier / file).unlink(missing_ok=True)
        shutil.copytree(new, folder, dirs_exist_ok=True)
    return library


class _Run(Simulation):
    """A run in the faster engine that takes the scenario.

    Attributes:
        begun: what ``begin`` returns of the memory of the run, while its machine code is made.
    """

    def __init__(self, scenario: Scenario, begin: Callable[[RunMemory], Any]) -> None:
        from ...setup.base import set_up

        self._begin = begin
        super().__init__(scenario, engine="mujoco" if refusals(set_up(scenario)) else "free_body", looks=False)

    def _remembered(self) -> RunMemory:
        before = short_run.set(True)
        try:
            return RunMemory(self.setup, self._engine, self._meanwhile)
        finally:
            short_run.reset(before)

    def _meanwhile(self, memory: RunMemory) -> None:
        self.begun: Any = self._begin(memory)


@dataclass(frozen=True)
class _Parts:
    """The parts of a library.

    Attributes:
        text: the stages, as LLVM has them.
        sources: the files of C by their names.
        export: the number of the export.
        law: the library as a law of a run; None if it can't be one.
        not_asked, no_law: why a run can't ask the program loop.c, and can't take the library as its law; or empty.
    """

    border: Border
    text: str
    sources: Mapping[str, str]
    export: int
    law: AsLaw | None
    not_asked: str
    no_law: str

    @classmethod
    def of(cls, border: Border, header: str, text: str, scenario: Scenario, name: str) -> "_Parts":
        not_asked = as_law.not_asked(border, scenario)
        no_law = not_asked or as_law.no_room(border, _HEADER_WORDS)
        law = AsLaw(border, scenario, name, _HEADER_WORDS) if not no_law else None
        export = _number(border, text)
        sources = {
            f"{name}.h": header,
            "image.h": texts.image(border, name, export),
            "shell.c": texts.shell(name),
            **(texts.as_law(border, law) if law is not None else {}),
        }
        return cls(border, text, sources, export, law, not_asked, no_law)


def _header(border: Border, scenario: Scenario, name: str) -> str:
    title = _title(scenario)
    return texts.header(border, name, f"{title[0].upper()}{title[1:]}, from measurements to thrusts.")


def _title(scenario: Scenario) -> str:
    return f"the law {scenario.controller.label()} of the scenario {scenario.name}"


def name_of(scenario: Scenario) -> str:
    """The name of a scenario's law as a name in C that a library may have."""
    label = scenario.controller.label()
    word = re.sub(r"\W+", "_", re.split(r"[:/]", label)[-1].removesuffix(".c"), flags=re.ASCII).strip("_").lower()
    names = (word, f"{word}_controller", f"controller_{word}")
    return next(name for name in names if texts.is_free(name))


def _compiled(machine: Machine, chain: Chain, place: Path, name: str) -> list[str]:
    """Compile what is C of a library, in the folder ``place``; the names of the objects."""
    objects = [linking.own_c(machine, place / "shell.c", place)]
    objects += [_of_c(machine, link, place, name) for link in chain.links if link.in_c]
    return objects + [linking.own_c(machine, each, place) for each in place.glob("as_law.c") if machine.shared]


def _made(machine: Machine, target: str, in_c: Sequence[str], name: str, place: Path, folder: Path) -> Made:
    """The library of one target, made of the objects in the folder ``place``."""
    adapter = [each for each in in_c if each == "as_law.o"]  # no program links it
    objects = ["stages.o", *(each for each in in_c if each not in adapter)]
    libraries = linking.linked(machine, name, [*objects, *adapter], place, folder / target)
    files = {each.relative_to(folder).as_posix(): _digest(each.read_bytes()) for each in libraries}
    codes = [(place / each).read_bytes() for each in objects]
    defined = {each for code in codes for each in elf_object.defined(code)}
    undefined = sorted({each for code in codes for each in elf_object.undefined(code)} - defined)
    code, constants, _ = (sum(each) for each in zip(*map(elf_object.sizes, codes), strict=True))
    more = sum(sum(elf_object.sizes((place / each).read_bytes())) for each in adapter)
    return Made(target, files, code, constants, tuple(undefined), more)


def _tried(machine: Machine, made: Made, archive: Path, place: Path) -> Made:
    """A library with what its test says of the recorded steps in the folder ``place``, where it can run."""
    emulator = linking.emulator(machine)
    if emulator is None or made.foreign:
        return made
    program = linking.program(machine, archive, place.parent / "test.c", place, _ROWS)
    done = subprocess.run([*emulator, str(program)], capture_output=True)
    said = _STEPS.search(done.stdout)
    if said is None:
        ends = f"the test ends with status {done.returncode} on {made.target}"
        raise InputError(f"export law: {ends}: {done.stdout[-200:]!r}")
    first = next((line for line in done.stdout.decode(errors="replace").splitlines() if ", step " in line), "")
    return replace(made, equal=int(said[1]), stack=int(said[3]), said=first)


def _of_c(machine: Machine, link: Any, place: Path, name: str) -> str:
    """Compile a stage in C for the library ``name``, whose own functions of libm it calls; the name of its object."""
    from ...stages.foreign import HEADER, Records, header

    stage = link.compiled.stage
    path = Path(stage.source().rpartition(":")[0])
    own = place / link.name
    own.mkdir(exist_ok=True)
    (own / HEADER).write_text(header(type(stage), Records(*link.kinds)), encoding="utf-8")
    out = f"{link.name}.o"
    math = own / libm_in_c.HEADER
    math.write_text(libm_in_c.header(linking.libm_of(name)), encoding="utf-8")
    options = ["-std=gnu11", "-fno-math-errno", "-include", str(own / HEADER), "-include", str(math)]
    options += ["-I", str(own), "-fhosted"]
    options += [] if machine.shared else linking.headers(machine)  # zig cc has them of a system
    symbols, shown = {link.symbol, f"{link.symbol}_records"}, set[str]()
    while symbols - shown:  # and then what else its file shows
        shown |= symbols
        renamed = [f"-D{each}={linking.own_name(name, each)}" for each in sorted(shown)]
        try:
            linking.compiled_c(machine, str(path.resolve()), place, [*renamed, *options], out)
        except InputError as error:
            raise InputError([Fault(f"{stage.room.table}.name", str(error))], "export law") from None
        code = (place / out).read_bytes()
        symbols = {each for each in elf_object.shown(code) if not each.startswith(linking.own_name(name, ""))}
    kept = [each.removeprefix(linking.own_name(name, "")) for each in elf_object.kept_apart(code)]
    alien = [each for each in linking.alien(code) if not each.startswith(linking.libm_of(name))]
    wrong = [
        *([f"it keeps {', '.join(kept)} beside an instance; put numbers that last into its state"] if kept else []),
        *([f"it calls {', '.join(alien)}; a library takes functions of math.h and string.h alone"] if alien else []),
    ]
    if wrong:
        raise InputError([Fault(f"{stage.room.table}.name", f"{path.name}: {each}") for each in wrong], "export law")
    return out


def _write(path: Path, content: str) -> None:
    with atomic_write(path) as part:
        part.write_text(content, encoding="utf-8")


def _license() -> str:
    """The licence of this package and of its libraries."""
    beside = Path(__file__).parents[4] / "LICENSE"
    found = importlib.metadata.distribution("uvms-mj").read_text("licenses/LICENSE")
    return found or beside.read_text(encoding="utf-8")


def _number(border: Border, text: str) -> int:
    """A number of an export, from its record, its machine code and its sources in C. A scenario may have it, so it is
    one that a double has."""
    found = hashlib.sha256(f"{border.mark} {text}".encode())
    for link in border.chain.links:
        if link.in_c:
            found.update(link.compiled.library.text)
    return int.from_bytes(found.digest()[:6], "little") | 1


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _about(scenario: Scenario, border: Border, library: Library, export: int) -> dict[str, Any]:
    """The tables of NAME.toml."""
    chain = border.chain
    return {
        "library": {
            "name": library.name,
            "uvms_mj": importlib.metadata.version("uvms-mj"),
            "law": scenario.controller.label(),
            "stages": [link.name for link in chain.links],
            "period_s": library.period,
            "record_bytes": library.record,
            "layout": f"{border.layout:#x}",
            "export": export,
            "record_sha256": _digest(chain.image.tobytes()),
            "recorded_steps": library.steps,
            "left_behind": library.left,
        },
        "sources": {
            link.name: {"source": Path(file).name, "sha256": _digest(Path(file).read_bytes())}
            for link in chain.links
            if link.compiled.users and Path(file := link.compiled.stage.source().rpartition(":")[0]).is_file()
        },
        "targets": {
            each.target: {
                "processor": MACHINES[each.target].target.processor,
                "code_bytes": each.code,
                "constants_bytes": each.constants,
                "undefined": list(each.undefined),
                "sha256": each.files,
            }
            for each in library.targets
        },
        "scenario": scenario.to_dict(),
    }


_FEW = 1000
"""Recorded steps below which a note says so."""


def _few(steps: Vectors) -> list[str]:
    if steps.steps >= _FEW:
        return []
    names = " and ".join(each.name for each in steps.segments)
    return [f"its test has {steps.steps} recorded steps, of {names}: a longer simulation.duration gives more"]


def _apart(border: Border, steps: Vectors) -> list[str]:
    """How far the commands are from the run's, with joints."""
    if not border.chain.joints and steps.apart == 0.0:
        return []
    return [
        "with joints the library has the same bits on every processor that keeps IEEE arithmetic, but not the run's: "
        f"its commands differ by up to {steps.apart:.1g} of the largest one, since the run rounds some products and "
        "sums once"
    ]


def _readme(border: Border, library: Library, title: str, steps: Vectors, law: bool, asked: int) -> str:
    rows = [
        (
            each.target,
            f"{each.code} bytes",
            f"{each.constants} bytes",
            f"{library.record} bytes",
            "`test.c` prints it" if each.stack is None else f"{each.stack} bytes",
            ", ".join(f"`{name}`" for name in each.undefined) or "nothing",
        )
        for each in library.targets
    ]
    where = [each.target for each in library.targets if each.equal is not None]
    ran = (
        f"When the library was made, it ran for {', '.join(where)}: all steps were equal."
        if where
        else ("It has not run yet: neither this machine nor an emulator on it was asked.")
    )
    made = [str(library.steps), f"{steps.about}: {', '.join(each.name for each in steps.segments)}", ran]
    bits = "It computes the numbers of the run, bit for bit, on every processor that keeps IEEE arithmetic."
    foreign = sorted({word for each in library.targets for word in each.foreign})
    if foreign:
        bits += f" Its C takes {', '.join(foreign)} from the program's C library, whose last digits may be others."
    for sentence in _apart(border, steps):
        bits = f"{sentence[0].upper()}{sentence[1:]}."
    again = [each.target for each in library.targets if law and MACHINES[each.target].shared]
    adapter = max(each.adapter for each in library.targets)
    return texts.readme(border, library.name, title, rows, made, bits, again, asked, adapter)
