"""Zeros at the end of a file: blocks that were not written before a power cut are read as zeros."""

import errno
import os
from typing import BinaryIO

_STRIDE = 1 << 20
"""Bytes read at a time."""


def end_of_writing(file: BinaryIO, size: int) -> int:
    """Offset of the zeros at the end of a file of ``size`` bytes; ``size`` if there are none."""
    while size:
        size = _end_of_data(file, size)
        start = max(0, size - 1) // _STRIDE * _STRIDE
        file.seek(start)
        if rest := file.read(size - start).rstrip(b"\0"):
            return start + len(rest)
        size = start
    return 0


def _end_of_data(file: BinaryIO, size: int) -> int:
    """Offset of the hole at the end of the first ``size`` bytes of a sparse file; ``size`` if there is none. The hole
    is not read, because it may be of any size."""
    end = 0
    try:
        while end < size and (start := os.lseek(file.fileno(), end, os.SEEK_DATA)) < size:
            end = os.lseek(file.fileno(), start, os.SEEK_HOLE)
    except (OSError, AttributeError) as error:  # no data follows, or the file system or Python does not report holes
        return end if getattr(error, "errno", None) == errno.ENXIO else size
    return min(end, size)
