"""The command's entry point, ``uvms-mj`` and ``python -m uvms_mj``.

It is small: a signal that comes while Python still imports the rest ends the command with one line as well.
"""

import atexit
import contextlib
import os
import signal
import sys


def _end_at_once(number: int, frame: object) -> None:
    """Nothing has been computed or written yet, and an exception could get lost in an import."""
    os.write(2, b"interrupted\n")
    os._exit(128 + number)


def _open_streams() -> None:
    """Give each standard stream that the caller has closed a place, so that no file of a run takes its number."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free
            setattr(sys, name, os.fdopen(number, "w" if number else "r", encoding="utf-8", closefd=False))


def _keep_status() -> None:
    """Python ends by the signal itself, not with a status, if SIGINT came while a library's C code ran Python."""
    from .cli.common import Stop

    if Stop.received is not None:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError):
                stream.flush()
        os._exit(128 + Stop.received)


def main() -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _end_at_once)
    _open_streams()
    from .cli import main as command

    atexit.register(_keep_status)  # the last to be called, since it is the first that is registered
    command()


if __name__ == "__main__":
    main()
