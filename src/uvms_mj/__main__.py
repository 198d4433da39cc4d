"""Entry point of ``uvms-mj`` and ``python -m uvms_mj``.

The module imports little, so that its signal handlers are installed before the slow imports begin: a signal during
these imports also ends the command with one line.
"""

import atexit
import contextlib
import os
import signal
import sys


def _end_at_once(number: int, frame: object) -> None:
    """End the process during the imports: nothing is written yet, and an import could swallow an exception."""
    os.write(2, b"interrupted\n")
    os._exit(128 + number)


def _open_streams() -> None:
    """Open /dev/null for each closed standard stream, so that no file of a run gets its descriptor."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free descriptor, the stream's own
            setattr(sys, name, os.fdopen(number, "w" if number else "r", encoding="utf-8", closefd=False))


def _keep_status() -> None:
    """Exit with 128 + signal. Without this, a SIGINT during a callback from C would end Python by the signal itself."""
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

    atexit.register(_keep_status)  # registered first, so called last
    command()


if __name__ == "__main__":
    main()
