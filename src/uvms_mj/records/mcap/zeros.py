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
    """Offset of the hole at the end of a sparse file, to within one stride; ``size`` if there is none. The hole is not
    read, because it may be of any size."""
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
    except (OSError, AttributeError):  # the file system or the operating system does not report holes
        return size
    return high
