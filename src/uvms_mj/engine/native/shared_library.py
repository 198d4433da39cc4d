"""Libraries of others as stages: C that is compiled or loaded, and FMUs."""

import contextlib
import ctypes
import functools
import importlib.util
import os
import platform
import shlex
import shutil
import struct
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import Fault, InputError, needs_extra
from ...stages.base import Stage
from ...stages.fmu import Wiring, printable, unpacked
from ...stages.foreign import C_FILE, HEADER, Records, header
from .compilation import cache_folder, fingerprint

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


def compiled(path: Path, kind: type[Stage], records: Records) -> Path:
    """The library of a C file for these records, compiled unless it is kept. It is kept by all that the compiler reads:
    what it makes of the file before it compiles. Raises InputError with the compiler's first lines."""
    text, command, above = header(kind, records), compiler(), cache_folder()
    with tempfile.TemporaryDirectory(prefix="new-", dir=above) as new:
        own, whole, part = Path(new, HEADER), Path(new, "whole.i"), Path(new, "stage.so")
        own.write_text(text, encoding="utf-8")
        # this header in place of an older one beside the file: both have the same guard
        options = [*_OPTIONS, "-include", str(own), "-I", new]
        _run([*command, *options, "-E", "-P", str(path), "-o", str(whole)], path)
        about = [*command, _age(command[0]), platform.machine(), *_OPTIONS]
        kept = above / f"c-{fingerprint([*(each.encode() for each in about), whole.read_bytes()])}.so"
        if not kept.is_file():
            _run([*command, *options, str(path), "-o", str(part), "-lm"], path)
            os.replace(part, kept)
    return kept


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


def check_whole(path: Path) -> None:
    """Raise OSError for a library of ELF whose file lacks its end: the loader would end the process."""
    data = path.read_bytes()
    if data[:5] != b"\x7fELF\x02" or len(data) < 64:  # another kind of file, of which the loader says so itself
        return
    (first,), (size, count) = struct.unpack_from("<Q", data, 32), struct.unpack_from("<HH", data, 54)
    segments = [data[first + k * size :][:size] for k in range(count)]
    if any(len(each) < 40 or sum(struct.unpack_from("<Q16xQ", each, 8)) > len(data) for each in segments):
        raise OSError("the end of its file is missing")


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
        kind, records = type(stage), Records(*kinds)
        path, name = Path(stage.source().rpartition(":")[0]), kind.__name__
        self._key, self._file, self._name = f"{stage.room.table}.name", path.name, name
        try:
            given = compiled(path, kind, records) if path.suffix == C_FILE else path
        except InputError as error:
            raise InputError([Fault(self._key, str(error))]) from None
        # a library finds others beside it, by $ORIGIN, if its copy lies there
        beside = path.suffix != C_FILE and os.access(path.parent, os.W_OK)
        with tempfile.TemporaryDirectory(prefix=".uvms-mj-", dir=None if beside else cache_folder()) as new:
            copy = path.with_name(f".{Path(new).name}{path.suffix}") if beside else Path(new, given.name)
            try:
                check_whole(given)
                shutil.copyfile(given, copy)
                self._library = ctypes.CDLL(str(copy))
            except OSError as error:
                said = str(error).replace(f"{copy}: ", "").replace(str(copy), path.name)
                raise self._wrong(f"is not a library that this machine loads: {said}") from None
            finally:
                copy.unlink(missing_ok=True)
        self._finalizer = weakref.finalize(self, _close, self._library._handle)
        self._check(records)
        function = getattr(self._library, name, None)
        if function is None:
            raise self._wrong(f"has no function {name}")
        self.address = int(ctypes.cast(function, ctypes.c_void_p).value or 0)
        function.argtypes, function.restype = [ctypes.c_void_p] * 5, ctypes.c_int
        self._function = function

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
        """Begin a run. What the library keeps is as it was."""

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
        return int(
            self._function(*(np.frombuffer(each, np.uint8).ctypes.data if each.nbytes else 0 for each in records))
        )


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
        folder = unpacked(unit.file, cache_folder())
        name = unit.description.coSimulation.modelIdentifier
        place = folder / "binaries" / fmpy.platform
        library = place / f"{name}{fmpy.sharedLibraryExtension}"
        if not library.is_file():
            there = sorted(each.name for each in (folder / "binaries").glob("*") if each.is_dir())
            has = f"it has {', '.join(there)}" if there else "it has none"
            raise self._wrong(f"has no library {name}{fmpy.sharedLibraryExtension} for {fmpy.platform}; {has}")
        # a library finds others beside it, by $ORIGIN, if its copy lies there
        number, path = tempfile.mkstemp(prefix=f"{name}-", suffix=library.suffix, dir=place)
        os.close(number)
        try:
            check_whole(library)
            shutil.copyfile(library, path)
            with contextlib.chdir(os.getcwd()):  # FMPy stays where it looked if it can't load
                self._fmu = FMU2Slave(
                    guid=unit.description.guid, unzipDirectory=os.fspath(folder), modelIdentifier=name,
                    instanceName=unit.file.stem, libraryPath=path,
                )  # fmt: skip
        except Exception as error:  # FMPy raises plain ones
            said = str(error).replace(path, library.name).replace(Path(path).name, library.name)
            raise self._wrong(f"is not a library that this machine loads: {said}") from None
        finally:
            Path(path).unlink(missing_ok=True)
        self.messages: list[str] = []
        self._instantiate()
        self._finalizer = weakref.finalize(self, _free, self._fmu)
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
            self._fmu.instantiate(callbacks=callbacks)
        except Exception as error:
            raise self._wrong(f"can't be instantiated: {self._last(error)}") from None

    def start(self, stage: Any) -> None:
        """Begin a run with the parameters of a stage. Raises InputError."""
        try:
            if self._fmu.component is None:
                self._instantiate()
            elif self._begun:
                self._fmu.reset()
            self._begun = True
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


def _free(fmu: Any) -> None:
    with contextlib.suppress(Exception):
        fmu.terminate()
    with contextlib.suppress(Exception):
        fmu.freeInstance()
