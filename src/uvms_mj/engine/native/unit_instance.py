"""Stages that are FMUs: one instance of a unit for one run."""

import contextlib
import ctypes
import functools
import os
import secrets
import shutil
import tempfile
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import Fault, InputError, needs_extra
from ...stages.fmu import Wiring, printable, unpack
from ...stages.foreign import Records
from .brought_modules import BroughtModules, modules_of
from .elf import own_copies
from .guard import no_exit
from .memory import settle_modes
from .objects import cache_folder
from .shared_library import begin_c

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
        """The status of a call that failed, as a predicate; empty if none did."""
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
