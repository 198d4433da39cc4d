"""Stages in C, which is compiled, and in libraries, which are loaded."""

import contextlib
import ctypes
import os
import platform
import re
import secrets
import shutil
import sys
import tempfile
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import Fault, InputError
from ...stages.base import Stage
from ...stages.foreign import C_FILE, HEADER, SHARED, Records, header
from . import libm_in_c
from .elf import own_copies
from .guard import no_exit
from .memory import settle_modes
from .objects import cache_folder, fingerprint
from .tools import compiler, tool

_OPTIONS = (
    *("-std=gnu11", "-O3", "-fPIC", "-shared"),
    "-fno-math-errno",  # a square root is one instruction
    "-ffp-contract=off",  # a product and a sum are rounded twice, as in Python
    *("-Werror=implicit-function-declaration", "-Werror=incompatible-pointer-types", "-Werror=return-type"),
)
_LINK = (*(("-Wl,-Bsymbolic",) if sys.platform == "linux" else ()), "-lm")
"""Its functions are its own, also where this process or the C library has others of their names, as gamma."""
_MOST_LINES = 6


def compiled(path: Path, kind: type[Stage], records: Records) -> tuple[bytes, bytes]:
    """The library of a C file for these records, compiled unless it is kept, and the user's part of its text. It is
    compiled from one text, what the compiler makes of the file and all that it includes, and kept by this text, so that
    nothing else is in it. A file whose assembler reads others is compiled anew. Raises InputError with the compiler's
    first lines."""
    text, command, above = header(kind, records), compiler(), cache_folder()
    of_math, libm = libm_in_c.for_this_machine()
    with tempfile.TemporaryDirectory(prefix="new-", dir=above) as new:
        own, whole, part = Path(new, HEADER), Path(new, "whole.c"), Path(new, "stage.so")
        own.write_text(text, encoding="utf-8")
        math, functions = Path(new, libm_in_c.HEADER), Path(new, "libm.o")
        math.write_text(of_math, encoding="utf-8")
        # this header in place of an older one beside the file: both have the same guard
        first = ["-include", str(own), "-include", str(math), "-I", new]
        _run([*command, *_OPTIONS, *first, "-E", str(path), "-o", str(whole)], path)
        read = whole.read_bytes()
        about = [*command, _age(command[0]), platform.machine(), *_OPTIONS, *_LINK]
        lines = _MARKER.sub(b"", read)
        name = f"c-{fingerprint([*(each.encode() for each in about), libm, lines])}"
        users = _users_part(read)
        data = None if _reads_more(users) else _kept(above, name)
        if data is None:
            functions.write_bytes(libm)
            _run([*command, *_OPTIONS, str(whole), str(functions), "-o", str(part), *_LINK], path)
            data = part.read_bytes()
            for suffix, content in ((".so", data), (".sha256", _digest(name, data))):
                each = Path(new, f"{name}{suffix}")
                each.write_bytes(content)
                with contextlib.suppress(OSError):  # e.g. on a full disk: the next start compiles it again
                    os.replace(each, above / each.name)
    return data, users


_MARKER = re.compile(rb'^# \d+ "[^\n]*\n', re.MULTILINE)
"""A line of preprocessed text that says where the following ones come from."""
_SYSTEM = re.compile(rb'^# \d+ "(?:[^"\\\n]|\\.)*"([ \d]*)\n', re.MULTILINE)
_ASSEMBLER = re.compile(rb"\b(asm|__asm|__asm__)\b")


def _users_part(text: bytes) -> bytes:
    """The part of a preprocessed text that is from no header of the system."""
    starts = [(0, 0, False), *((each.start(), each.end(), b"3" in each[1].split()) for each in _SYSTEM.finditer(text))]
    ends = [start for start, _, _ in starts[1:]] + [len(text)]
    return b"".join(text[begin:end] for (_, begin, system), end in zip(starts, ends, strict=True) if not system)


def _reads_more(users: bytes) -> bool:
    """Whether the assembler may read further files: the user's part of a preprocessed text has assembler in it, and in
    that a directive that reads one, or a letter that is written by its number."""
    if not _ASSEMBLER.search(users):
        return False
    own = re.sub(rb'"\s*"', b"", users).lower()
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
        done = tool(command, path.parent)
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
        address: of the function.
        text: of a file in C, with the files that it includes, besides headers of the system.
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
            read = compiled(self._path, kind, self._records) if in_c else (self._path.read_bytes(), b"")
            self._data, self.text = read
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
        """Begin another run, with a new copy, without the values that the former one has kept."""
        self._finalizer()
        self._load()

    def check_unchanged(self, stage: Stage) -> None:
        """Settings may change during a run."""

    def fill(self, record: np.ndarray) -> None:
        """Set the record (1,) in a stage's own memory."""
        record["code_at"] = self.address

    def said(self, record: np.ndarray) -> str:
        """The function's status as a predicate; empty if it returned 0."""
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
