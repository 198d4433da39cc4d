"""Compilers and linkers: where they are, and how they are called. It imports little, so that they work while others
import."""

import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence

from ...errors import InputError


def compiler() -> list[str]:
    """The command of the C compiler: $CC, cc, gcc, clang, or the package ziglang's. Raises InputError if there is
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
        return [sys.executable, "-P", "-m", "ziglang", "cc"]
    raise InputError("no C compiler: install one that is called cc, or the extra c, with pip install 'uvms-mj[c]'")


def tool(command: Sequence[str], folder: str | os.PathLike) -> subprocess.CompletedProcess[str]:
    """Call a compiler or a linker in a folder. It is called once more where a signal ended it: zig reads beyond its
    stack, at whose end its arguments lie, in one of some thousand starts, by the place that the system gave it."""
    for _ in range(2):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace")
        if done.returncode >= 0:
            break
    return done
