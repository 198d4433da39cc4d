"""Atomic writing of files."""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from .faults import InputError


@contextlib.contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to, then move that file to ``path`` and replace an existing one.

    If writing fails, ``path`` is unchanged. The temporary file is in a new folder beside ``path``, so that it can't
    overwrite a file of the user's. The folder is removed at the end.

    Raises:
        InputError: the file can't be written.
    """
    try:
        with tempfile.TemporaryDirectory(prefix=".uvms-mj-", dir=path.parent) as folder:
            part = Path(folder, path.name)
            yield part
            os.replace(part, path)
    except OSError as error:
        raise InputError(f"{path}: can't write it: {error.strerror or error}") from None
