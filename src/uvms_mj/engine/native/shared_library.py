"""A stage's machine code from a shared library: a C file that is compiled, or a library of the user's."""

import ctypes
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

from ...errors import Fault, InputError
from ...stages.base import Stage
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
