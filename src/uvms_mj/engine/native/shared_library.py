"""Libraries of others as stages: C that is compiled or loaded, and FMUs."""

import builtins
import contextlib
import ctypes
import functools
import importlib.machinery
import importlib.util
import os
import platform
import re
import secrets
import shlex
import shutil
import subprocess
import sys
import tempfile
import threading
import weakref
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ...errors import Fault, InputError, needs_extra
from ...stages.base import Stage
from ...stages.fmu import Wiring, printable, unpack
from ...stages.foreign import C_FILE, HEADER, SHARED, Records, header
from .compilation import cache_folder, fingerprint
from .elf import own_copies
from .guard import no_exit
from .memory import settle_modes

_OPTIONS = (
    *("-std=gnu11", "-O3", "-fPIC", "-shared"),
    "-fno-math-errno",  # a square root is one instruction
    "-ffp-contract=off",  # a product and a sum are rounded twice, as in Python
    *("-Werror=implicit-function-declaration", "-Werror=incompatible-pointer-types", "-Werror=return-type"),
)
_MOST_LINES = 6


def compiler() -> list[str]:
    """The command of the C compiler: $CC, cc, gcc, clang, or that of the package ziglang. Raises InputError if there is
    none."""
    try:
        if given := shlex.split(os.environ.get("CC", "")):
            return given
    except ValueError as error:
        raise InputError(f"$CC {os.environ['CC']!r}: {error}") from None
    for name in ("cc", "gcc", "clang"):
        if found := shutil.which(name):
            return [found]
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc"]
    raise InputError("no C compiler: install one that is called cc, or the extra c, with pip install 'uvms-mj[c]'")


def compiled(path: Path, kind: type[Stage], records: Records) -> bytes:
    """The library of a C file for these records, compiled unless it is kept. It is compiled from one text, what the
    compiler makes of the file and all that it includes, and kept by this text, so that nothing else is in it. A file
    whose assembler reads others is compiled anew. Raises InputError with the compiler's first lines."""
    text, command, above = header(kind, records), compiler(), cache_folder()
    with tempfile.TemporaryDirectory(prefix="new-", dir=above) as new:
        own, whole, part = Path(new, HEADER), Path(new, "whole.c"), Path(new, "stage.so")
        own.write_text(text, encoding="utf-8")
        # this header in place of an older one beside the file: both have the same guard
        _run([*command, *_OPTIONS, "-include", str(own), "-I", new, "-E", str(path), "-o", str(whole)], path)
        read = whole.read_bytes()
        about = [*command, _age(command[0]), platform.machine(), *_OPTIONS]
        lines = _MARKER.sub(b"", read)
        name = f"c-{fingerprint([*(each.encode() for each in about), lines])}"
        data = None if _reads_more(read) else _kept(above, name)
        if data is None:
            _run([*command, *_OPTIONS, str(whole), "-o", str(part), "-lm"], path)
            data = part.read_bytes()
            for suffix, content in ((".so", data), (".sha256", _digest(name, data))):
                each = Path(new, f"{name}{suffix}")
                each.write_bytes(content)
                with contextlib.suppress(OSError):  # e.g. on a full disk: the next start compiles it again
                    os.replace(each, above / each.name)
    return data


_MARKER = re.compile(rb'^# \d+ "[^\n]*\n', re.MULTILINE)
"""A line of preprocessed text that says where the following ones come from."""
_SYSTEM = re.compile(rb'^# \d+ "(?:[^"\\\n]|\\.)*"([ \d]*)\n', re.MULTILINE)
_ASSEMBLER = re.compile(rb"\b(asm|__asm|__asm__)\b")


def _reads_more(text: bytes) -> bool:
    """Whether the assembler may read further files: the user's part of a preprocessed text has assembler in it, and in
    that a directive that reads one, or a letter that is written by its number."""
    starts = [(0, 0, False), *((each.start(), each.end(), b"3" in each[1].split()) for each in _SYSTEM.finditer(text))]
    ends = [start for start, _, _ in starts[1:]] + [len(text)]
    own = b"".join(text[begin:end] for (_, begin, system), end in zip(starts, ends, strict=True) if not system)
    if not _ASSEMBLER.search(own):
        return False
    own = re.sub(rb'"\s*"', b"", own).lower()
    return any(word in own for word in (b"incbin", b".include", b"macro", b"\\x", b"\\u")) or bool(
        re.search(rb"\\[0-7]", own)
    )


def _kept(folder: Path, name: str) -> bytes | None:
    """The library that is kept under a name; None if there is none, or it is damaged."""
    try:
        data = (folder / f"{name}.so").read_bytes()
        return data if (folder / f"{name}.sha256").read_bytes() == _digest(name, data) else None
    except OSError:
        return None


def _digest(name: str, data: bytes) -> bytes:
    return fingerprint([name.encode(), data]).encode()


def _age(program: str) -> str:
    """When a program was installed."""
    whose = Path(shutil.which(program) or program).resolve()
    return str(whose.stat().st_mtime_ns) if whose.is_file() else ""


def _run(command: Sequence[str], path: Path) -> None:
    """Run the compiler in the folder of a file. Raises InputError with its first lines."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", cwd=path.parent)
    except OSError as error:
        raise InputError(f"the C compiler {command[0]}: {error.strerror}") from None
    if done.returncode or not Path(command[command.index("-o") + 1]).is_file():
        lines = [line.replace(f"{path.parent}/", "") for line in done.stderr.splitlines() if line.strip()]
        said = "\n".join(lines[:_MOST_LINES]) or f"status {done.returncode}"
        raise InputError(f"{path.name} does not compile with {Path(command[0]).name}:\n{said}")


LIBRARY = np.dtype([("code_at", "i8"), ("returned", "i8")])
"""The record of a library in a stage's own memory: the address of its function, and what that returned."""


class Library:
    """A copy of a library of its own for one run, with static data of its own, and the stage's function in it.

    Attributes:
        address: that of the function.
        kind: the dtype of its record in a stage's own memory.
    """

    kind = LIBRARY

    def __init__(self, stage: Stage, kinds: Sequence[np.dtype]) -> None:
        """``kinds`` are the dtypes of settings, states, what the stage is given and its output. Raises InputError: the
        file does not compile, is not a library of this machine, lacks the function, or was compiled with other
        records."""
        kind, self._records = type(stage), Records(*kinds)
        self._path, self._name = Path(stage.source().rpartition(":")[0]), kind.__name__
        self._key, self._file = f"{stage.room.table}.name", self._path.name
        in_c = self._path.suffix == C_FILE
        try:
            self._data = compiled(self._path, kind, self._records) if in_c else self._path.read_bytes()
        except InputError as error:
            raise InputError([Fault(self._key, str(error))]) from None
        except OSError as error:
            raise self._wrong(f"can't be read: {error.strerror}") from None
        self._load()

    def _load(self) -> None:
        """Load a copy."""
        # a library finds what lies beside it, by $ORIGIN, if its copy lies there
        beside = self._path.suffix != C_FILE and os.access(self._path.parent, os.W_OK)
        try:
            with tempfile.TemporaryDirectory(prefix="new-", dir=cache_folder()) as new:
                folder = self._path.parent if beside else Path(new)
                with no_exit(f"the library {self._file}"):
                    self._library = ctypes.CDLL(self._file, handle=_opened(self._path, self._data, folder))
        except OSError as error:
            raise self._wrong(f"is not a library that this machine loads: {error}") from None
        self._finalizer = weakref.finalize(self, _close, self._library._handle)
        self._check(self._records)
        function = getattr(self._library, self._name, None)
        if function is None:
            raise self._wrong(f"has no function {self._name}")
        self.address = int(ctypes.cast(function, ctypes.c_void_p).value or 0)
        function.argtypes, function.restype = [ctypes.c_void_p] * 5, ctypes.c_int
        self._function = function
        begin_c()

    def _check(self, records: Records) -> None:
        """Refuse a library that was compiled with other records."""
        try:
            found = [int(each) for each in (ctypes.c_uint64 * 4).in_dll(self._library, f"{self._name}_records")]
        except ValueError:
            raise self._wrong(
                f'has no {self._name}_records: include "{HEADER}" where {self._name} is defined'
            ) from None
        layout, *sizes = found
        names = ("its settings", "its state", "its output")
        differ = [
            f"{what} have {there} bytes there, {here} here"
            for what, there, here in zip(names, sizes, records.sizes, strict=True)
            if there != here
        ]
        if layout != records.layout or differ:
            why = f": {'; '.join(differ)}" if differ else ""
            again = f"compile it again with the {HEADER} of `uvms-mj new header {self._name}.toml`"
            raise self._wrong(f"was compiled with other records{why}; {again}")

    def start(self, stage: Stage) -> None:
        """Begin another run, with a new copy: what the former one has kept is not in it."""
        self._finalizer()
        self._load()

    def check_unchanged(self, stage: Stage) -> None:
        """Settings may change during a run."""

    def fill(self, record: np.ndarray) -> None:
        """Set the record (1,) in a stage's own memory."""
        record["code_at"] = self.address

    def said(self, record: np.ndarray) -> str:
        """What the function returned in place of 0, as a predicate; empty if it returned 0."""
        number = int(record["returned"][0])
        return f"returned {number}" if number else ""

    def _wrong(self, said: str) -> InputError:
        return InputError([Fault(self._key, f"{self._file} {said}")])

    def __call__(self, *records: Any) -> int:
        """Call the function from Python, with arrays or records; what it returns."""
        places = [np.frombuffer(each, np.uint8).ctypes.data if each.nbytes else 0 for each in records]
        return int(self._function(*places))


def _opened(library: Path, data: bytes, folder: Path) -> int:
    """The handle of a copy of a library with this content, for which a folder has files for an instant. Raises
    OSError."""
    name = f".uvms-mj-{secrets.token_hex(8)}{library.suffix if library.suffix in SHARED else '.so'}"
    written = list[Path]()
    try:
        for called, content in own_copies(library, data, name).items():
            with open(folder / called, "xb") as file:
                written.append(folder / called)
                file.write(content)
        return int(ctypes.CDLL(str(folder / name))._handle)
    except OSError as error:
        said = str(error).replace(f"{folder / name}: ", "").replace(str(folder / name), library.name)
        raise OSError(said) from None
    finally:
        for each in written:
            each.unlink(missing_ok=True)
        settle_modes()


def begin_c() -> None:
    """Begin the random numbers of the C library, which has one state for the whole process, as a process does."""
    process = ctypes.CDLL(None)
    process.srand(1)
    if hasattr(process, "seed48"):
        process.seed48((ctypes.c_ushort * 3)())


def _close(handle: int) -> None:
    import _ctypes

    _ctypes.dlclose(handle)


STATUSES = ("ok", "warning", "discard", "error", "fatal", "pending")
CALLS = ("fmi2SetReal", "fmi2DoStep", "fmi2GetReal")
"""The functions that the loop calls."""


def dtype_of(wiring: Wiring) -> np.dtype:
    """The record of an FMU in a stage's own memory: addresses of the instance and of the functions, what the last call
    that failed returned and which it was, or which variable was out of its range, and what is exchanged."""
    n, m = len(wiring.inputs), len(wiring.outputs)
    whole = [(name, "i8") for name in ("instance", *CALLS, "returned", "call")]
    inputs = [("refs_in", "u4", (n + n % 2,)), ("places_in", "i8", (n,)), ("values_in", "f8", (n,))]
    outputs = [("refs_out", "u4", (m + m % 2,)), ("places_out", "i8", (m,)), ("values_out", "f8", (m,))]
    ranges = [("range_in", "f8", (n, 2)), ("range_out", "f8", (m, 2))]
    return np.dtype([*whole, *inputs, *outputs, *ranges], align=True)


class UnitInstance:
    """An instance of an FMU, with a copy of its library and so with static data of its own.

    Attributes:
        wiring: what is exchanged.
        kind: the dtype of its record in a stage's own memory.
        messages: what the FMU has logged.
    """

    def __init__(self, stage: Any, kinds: Sequence[np.dtype]) -> None:
        """``kinds`` as of :class:`.shared_library.Library`. Raises InputError: the FMU has no library for this
        machine, or can't be instantiated."""
        with needs_extra("fmi"):
            import fmpy
            from fmpy.fmi2 import FMU2Slave

        self._stage, self._key = stage, f"{stage.room.table}.name"
        unit, faults = stage.unit, list[Fault]()
        self.wiring = stage.wiring(Records(*kinds), faults)
        if faults:
            raise InputError(faults)
        self.kind = dtype_of(self.wiring)
        name, extension = unit.description.coSimulation.modelIdentifier, fmpy.sharedLibraryExtension
        folder = Path(tempfile.mkdtemp(prefix="new-fmu-", dir=cache_folder()))
        self._finalizer = weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        try:
            there = unpack(unit.file, folder, fmpy.platform)
        except InputError as error:
            raise InputError([Fault(self._key, str(error))]) from None
        place = folder / "binaries" / fmpy.platform
        library = place / f"{name}{extension}"
        if not library.is_file():
            has = f"it has {', '.join(there)}" if there else "it has none"
            raise self._wrong(f"has no library {name}{extension} for {fmpy.platform}; {has}")
        self._python = modules_of(folder / "resources")
        path = place / f"{secrets.token_hex(8)}-{library.name}"
        try:
            for called, content in own_copies(library, library.read_bytes(), path.name).items():
                (place / called).write_bytes(content)
            with contextlib.chdir(os.getcwd()), no_exit(unit.file.name):  # FMPy stays where it looked if it can't load
                self._fmu = FMU2Slave(
                    guid=unit.description.guid, unzipDirectory=os.fspath(folder), modelIdentifier=name,
                    instanceName=unit.file.stem, libraryPath=os.fspath(path),
                )  # fmt: skip
        except Exception as error:  # FMPy raises plain ones
            said = str(error).replace(str(path), library.name).replace(path.name, library.name)
            raise self._wrong(f"is not a library that this machine loads: {said}") from None
        finally:
            settle_modes()
        self.messages: list[str] = []
        self._instantiate()
        self._finalizer = weakref.finalize(self, _free, self._fmu, folder)
        self.start(stage)

    def _instantiate(self) -> None:
        from fmpy.fmi2 import defaultCallbacks, fmi2CallbackFunctions

        callbacks = fmi2CallbackFunctions()
        callbacks.logger, callbacks.componentEnvironment = _logger(), id(self)
        _LOGGING[id(self)] = self
        with contextlib.suppress(ImportError, OSError):  # where FMPy has none, the numbers of a message are missing
            from fmpy.logging import addLoggerProxy

            addLoggerProxy(ctypes.byref(callbacks))  # it puts the numbers into a message, which C alone can
        callbacks.allocateMemory, callbacks.freeMemory = defaultCallbacks.allocateMemory, defaultCallbacks.freeMemory
        try:
            brought = BroughtModules(Path(self._fmu.unzipDirectory), self._python)
            with no_exit(self._stage.unit.file.name), brought.present():
                self._fmu.instantiate(callbacks=callbacks)
        except Exception as error:
            raise self._wrong(f"can't be instantiated: {self._last(error)}") from None
        finally:
            settle_modes()

    def start(self, stage: Any) -> None:
        """Begin a run with the parameters of a stage. Raises InputError."""
        try:
            if self._begun and self._python and self._fmu.component is not None:  # its modules remember, too
                self._fmu.fmi2FreeInstance(self._fmu.component)
                self._fmu.component = None
            if self._fmu.component is None:
                self._instantiate()
            elif self._begun:
                self._fmu.reset()
            self._begun = True
            begin_c()
            self._fmu.setupExperiment(startTime=0.0)
            for name, variables in stage.unit.parameters.items():
                value = getattr(stage, name)
                for variable, number in zip(variables, value if isinstance(value, tuple) else (value,), strict=True):
                    if variable.type == "Boolean":
                        self._fmu.setBoolean([variable.valueReference], [number])
                    elif variable.type == "Integer":
                        self._fmu.setInteger([variable.valueReference], [int(number)])
                    else:
                        self._fmu.setReal([variable.valueReference], [number])
            self._fmu.enterInitializationMode()
            self._fmu.exitInitializationMode()
        except InputError:
            raise
        except Exception as error:
            raise self._wrong(f"can't be initialized: {self._last(error)}") from None
        finally:
            settle_modes()
        self._stage = stage

    _begun = False

    def check_unchanged(self, stage: Any) -> None:
        """Raise InputError if a stage has other parameters: they are set before a run."""
        table = stage.room.table
        faults = [
            Fault(f"{table}.{name}", "a parameter of an FMU can't change during a run; give it to reset")
            for name in stage.unit.parameters
            if getattr(stage, name) != getattr(self._stage, name)
        ]
        if faults:
            raise InputError(faults, "set")

    def fill(self, record: np.ndarray) -> None:
        """Set the record (1,) of :func:`dtype_of`."""
        record["instance"] = ctypes.cast(self._fmu.component, ctypes.c_void_p).value
        for name in CALLS:
            record[name] = ctypes.cast(getattr(self._fmu.dll, name), ctypes.c_void_p).value
        n, m = len(self.wiring.inputs), len(self.wiring.outputs)
        record["refs_in"][0, :n], record["places_in"] = self.wiring.inputs, self.wiring.given
        record["refs_out"][0, :m], record["places_out"] = self.wiring.outputs, self.wiring.out
        record["range_in"], record["range_out"] = self.wiring.range_in, self.wiring.range_out

    def said(self, record: np.ndarray) -> str:
        """What a call that failed returned, as a predicate; empty if none did."""
        returned = int(record["returned"][0])
        if not returned:
            return ""
        if (which := int(record["call"][0]) - len(CALLS)) >= 0:
            values = np.concatenate([record["values_in"][0], record["values_out"][0]])
            return f"is out of range: {self.wiring.out_of_range(which, values[which])}"
        status = STATUSES[returned] if 0 <= returned < len(STATUSES) else "an unknown status"
        log = f": {self.messages[-1]}" if self.messages else ""
        return f"returned {returned} ({status}) from {CALLS[int(record['call'][0])]}{log}"

    def __call__(self, *records: Any) -> int:
        """Call the FMU from Python at an instant: what a call that failed returned."""
        from fmpy.fmi1 import FMICallException

        _, _, given, _, out = records
        values = np.frombuffer(given, np.float64)[self.wiring.given]
        self._check_ranges(values, self.wiring.range_in, 0)
        inputs, outputs = self.wiring.inputs.tolist(), self.wiring.outputs.tolist()
        try:
            if inputs:
                self._fmu.setReal(inputs, values.tolist())
            before = self._fmu.getReal(outputs) if self._stage.get_before_step else None
            self._fmu.doStep(float(given["t"]), float(given["period"]))
            found = before if before is not None else self._fmu.getReal(outputs)
        except FMICallException as error:
            return int(error.status)
        self._check_ranges(np.array(found), self.wiring.range_out, len(inputs))
        np.frombuffer(out, np.float64)[self.wiring.out] = found
        return 0

    def _check_ranges(self, values: np.ndarray, ranges: np.ndarray, first: int) -> None:
        """Raise ValueError for a value out of the range of its variable."""
        for i in np.flatnonzero((values < ranges[:, 0]) | (values > ranges[:, 1])).tolist():
            raise ValueError(self.wiring.out_of_range(first + i, values[i]))

    def _last(self, error: Exception) -> str:
        return self.messages[-1] if self.messages else str(error)

    def _wrong(self, said: str) -> InputError:
        return InputError([Fault(self._key, f"{self._stage.unit.file.name} {said}")])


_LOGGING: weakref.WeakValueDictionary[int, UnitInstance] = weakref.WeakValueDictionary()
"""The instances by the numbers that they give their FMUs. FMPy's proxy keeps one logger for all."""


@functools.cache
def _logger() -> Any:
    """The function that takes messages of all FMUs."""
    from fmpy.fmi2 import fmi2CallbackLoggerTYPE

    def log(environment: int | None, _: Any, __: int, ___: Any, message: bytes | None) -> None:
        instance = _LOGGING.get(environment or 0)
        if instance is not None and len(instance.messages) < 100:
            instance.messages.append(printable((message or b"").decode(errors="replace")))

    return fmi2CallbackLoggerTYPE(log)


def _free(fmu: Any, folder: Path) -> None:
    with contextlib.suppress(Exception):
        fmu.terminate()
    with contextlib.suppress(Exception):
        fmu.freeInstance()
    shutil.rmtree(folder, ignore_errors=True)


def modules_of(resources: Path) -> frozenset[str]:
    """The names of the modules in Python that an FMU brings, as PythonFMU makes them; not those with machine code,
    which a process loads once."""
    found = {each.stem for each in resources.glob("*.py")}
    for each in resources.iterdir() if found else ():
        if each.is_dir() and next(each.rglob("*.py"), None) and not next(each.rglob("*.so"), None):
            found.add(each.name)
    return frozenset(found - sys.stdlib_module_names)


class BroughtModules:
    """The modules in Python that an FMU brings, for one instance: it finds them whenever it imports one, and no other
    one finds them.

    Args:
        folder: where the FMU is unpacked.
        names: of its modules, those without dots.
    """

    _lock: ClassVar = threading.RLock()

    def __init__(self, folder: Path, names: frozenset[str]) -> None:
        self._folder, self._names, self._depth = folder, names, 0
        self._loaded: dict[str, Any] = {}
        self._builtins = {**vars(builtins), "__import__": self._import}

    @contextlib.contextmanager
    def present(self) -> Iterator[None]:
        """A context in which ``sys.modules`` has these modules under their names, and afterwards what it had before."""
        if not self._names:
            yield
            return
        with self._lock:
            self._depth += 1
            if self._depth == 1:
                aside = self._taken()
                sys.modules.update(self._loaded)
                sys.meta_path.insert(0, self)
            try:
                yield
            finally:
                self._depth -= 1
                if not self._depth:
                    sys.meta_path.remove(self)
                    self._loaded = self._taken()
                    sys.modules.update(aside)
                    sys.path[:] = [each for each in sys.path if not Path(each).is_relative_to(self._folder)]

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        """Where a module is, for Python's import."""
        if name.partition(".")[0] not in self._names:
            return None
        kinds: Any = (partial(_Brought, self._builtins), importlib.machinery.SOURCE_SUFFIXES)
        places = [str(self._folder / "resources")] if path is None else path
        found = (importlib.machinery.FileFinder(each, kinds).find_spec(name) for each in places)
        return next((spec for spec in found if spec is not None and spec.loader is not None), None)

    def _taken(self) -> dict[str, Any]:
        """Take the modules of these names out of ``sys.modules``."""
        found = {name: module for name, module in sys.modules.items() if name.partition(".")[0] in self._names}
        for name in found:
            del sys.modules[name]
        return found

    def _import(self, name: str, globals: Any = None, locals: Any = None, fromlist: Any = (), level: int = 0) -> Any:
        """What ``import`` calls in these modules, also during a run."""
        if level == 0 and name.partition(".")[0] not in self._names:
            return builtins.__import__(name, globals, locals, fromlist, level)
        known = self._loaded.get(name) if level == 0 else None
        if known is not None and all(hasattr(known, each) for each in fromlist or ()):  # as in each step
            return known if fromlist else self._loaded[name.partition(".")[0]]
        with self.present():
            return builtins.__import__(name, globals, locals, fromlist, level)


class _Brought(importlib.machinery.SourceFileLoader):
    def __init__(self, own: dict[str, Any], name: str, path: str) -> None:
        super().__init__(name, path)
        self._own = own

    def exec_module(self, module: Any) -> None:
        vars(module)["__builtins__"] = self._own  # which its functions keep
        super().exec_module(module)
