"""Entry point of ``uvms-mj`` and ``python -m uvms_mj``.

The module imports little, so that its signal handlers are installed before the slow imports begin: a signal during
these imports also ends the command with one line.
"""

import atexit
import gc
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


def _leave(status: list[int]) -> None:
    """End the process with its status, 128 + signal after a signal. Python would take a tenth of a second to free what
    it has loaded, and after a SIGINT during a callback from C it would end by the signal itself."""
    from .cli.common import Stop

    try:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
    except OSError:
        if Stop.received is None:
            return  # Python reports it
    os._exit(status[0] if Stop.received is None else 128 + Stop.received)


def main() -> None:
    gc.set_threshold(100_000)  # imports make many objects and no garbage: collecting took a tenth of their time
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:  # nohup ignores it
            signal.signal(number, _end_at_once)
    _open_streams()
    from .cli import main as command

    status = [1]  # of an exception
    atexit.register(_leave, status)  # registered first, so called last
    try:
        command()
    except SystemExit as end:
        status[0] = end.code if isinstance(end.code, int) else int(end.code is not None)
        raise


if __name__ == "__main__":
    main()
