"""Files that are there only once they are whole."""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from .faults import InputError


@contextlib.contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A place to write a file in, which then stands at ``path`` at once, or not at all; what stood there is replaced.

    It is in a folder of its own beside ``path``, so that it meets no file of the user's and leaves none behind.

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
