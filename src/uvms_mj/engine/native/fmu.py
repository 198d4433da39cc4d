"""An FMU in the loop: an instance of its own for each run, which the loop calls by the addresses of its functions."""

import contextlib
import ctypes
import os
import shutil
import tempfile
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import Fault, InputError, needs_extra
from ...stages.fmu import Wiring, unpacked
from ...stages.foreign import Records
from .compilation import cache_folder
from .shared_library import check_whole

STATUSES = ("ok", "warning", "discard", "error", "fatal", "pending")
CALLS = ("fmi2SetReal", "fmi2DoStep", "fmi2GetReal")
"""The functions that the loop calls."""


def dtype_of(wiring: Wiring) -> np.dtype:
    """The record of an FMU in a stage's own memory: addresses of the instance and of the functions, what the last call
    that failed returned and which it was, and what is exchanged."""
    n, m = len(wiring.inputs), len(wiring.outputs)
    whole = [(name, "i8") for name in ("instance", *CALLS, "returned", "call")]
    inputs = [("refs_in", "u4", (n + n % 2,)), ("places_in", "i8", (n,)), ("values_in", "f8", (n,))]
    outputs = [("refs_out", "u4", (m + m % 2,)), ("places_out", "i8", (m,)), ("values_out", "f8", (m,))]
    return np.dtype([*whole, *inputs, *outputs], align=True)


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
        from fmpy.fmi2 import defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

        def log(_: Any, __: Any, status: int, ___: Any, message: bytes | None) -> None:
            self_ = me()
            if self_ is not None and len(self_.messages) < 100:
                self_.messages.append((message or b"").decode(errors="replace"))

        me = weakref.ref(self)
        callbacks = fmi2CallbackFunctions()
        callbacks.logger = fmi2CallbackLoggerTYPE(log)
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

    def said(self, record: np.ndarray) -> str:
        """What a call that failed returned, as a predicate; empty if none did."""
        returned = int(record["returned"][0])
        if not returned:
            return ""
        status = STATUSES[returned] if 0 <= returned < len(STATUSES) else "an unknown status"
        log = f": {self.messages[-1]}" if self.messages else ""
        return f"returned {returned} ({status}) from {CALLS[int(record['call'][0])]}{log}"

    def __call__(self, *records: Any) -> int:
        """Call the FMU from Python at an instant: what a call that failed returned."""
        from fmpy.fmi1 import FMICallException

        _, _, given, _, out = records
        values = np.frombuffer(given, np.float64)[self.wiring.given]
        inputs, outputs = self.wiring.inputs.tolist(), self.wiring.outputs.tolist()
        try:
            if inputs:
                self._fmu.setReal(inputs, values.tolist())
            before = self._fmu.getReal(outputs) if self._stage.get_before_step else None
            self._fmu.doStep(float(given["t"]), float(given["period"]))
            found = before if before is not None else self._fmu.getReal(outputs)
        except FMICallException as error:
            return int(error.status)
        np.frombuffer(out, np.float64)[self.wiring.out] = found
        return 0

    def _last(self, error: Exception) -> str:
        return self.messages[-1] if self.messages else str(error)

    def _wrong(self, said: str) -> InputError:
        return InputError([Fault(self._key, f"{self._stage.unit.file.name} {said}")])


def _free(fmu: Any) -> None:
    with contextlib.suppress(Exception):
        fmu.terminate()
    with contextlib.suppress(Exception):
        fmu.freeInstance()
