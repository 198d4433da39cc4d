"""Zeros at the end of a file: a power cut leaves blocks that were never written, and they read as zeros."""

import errno
import os
from typing import BinaryIO

_STRIDE = 1 << 20
"""How much is read at a time [B]."""


def end_of_writing(file: BinaryIO, size: int) -> int:
    """Where the zeros begin that a file of a size [B] ends with."""
    while size:
        size = _end_of_data(file, size)
        start = max(0, size - 1) // _STRIDE * _STRIDE
        file.seek(start)
        if rest := file.read(size - start).rstrip(b"\0"):
            return start + len(rest)
        size = start
    return 0


def _end_of_data(file: BinaryIO, size: int) -> int:
    """Where the hole begins that a sparse file ends with, to a stride; else size. A hole is not read: it may be of any
    size."""
    low, high = 0, size  # no data from high on
    try:
        while high - low > _STRIDE:
            middle = (low + high) // 2
            try:
                if os.lseek(file.fileno(), middle, os.SEEK_DATA) < high:
                    low = middle + 1
                    continue
            except OSError as error:
                if error.errno != errno.ENXIO:
                    raise
            high = middle
    except (OSError, AttributeError):  # a file system, or a system, that does not know holes
        return size
    return high
