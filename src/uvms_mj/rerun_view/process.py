"""The ``rerun`` executable: started so that it listens on this machine alone and tells nobody anything.

Rerun's viewer collects usage data unless its user has said no. It does not where ``CI`` is set, whatever its settings
say, and then neither greets a new user nor writes any settings; only ``FORCE_RERUN_ANALYTICS`` is stronger. It also
asks the web for newer versions of itself, and no setting stops that; but it obeys a proxy, and at the one that it is
given nobody is at home.
"""

import contextlib
import math
import os
import queue
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from typing import IO

from ..faults import InputError

LOOPBACK = "127.0.0.1"
_NOWHERE = f"http://{LOOPBACK}:9"
_STARTS_WITHIN_S, _ENDS_WITHIN_S = 60.0, 5.0
_LOOKS_EVERY_S = 0.05
_PIECE_BYTES = 65_536


def environment() -> dict[str, str]:
    """The environment in which Rerun tells nobody anything."""
    quiet = {"CI": "true", "TELEMETRY_ENABLED": "false", "RUST_LOG": "error"}
    for name in ("http_proxy", "https_proxy", "all_proxy"):
        quiet |= {name: _NOWHERE, name.upper(): _NOWHERE}
    quiet |= {"no_proxy": LOOPBACK, "NO_PROXY": LOOPBACK}
    return {name: value for name, value in os.environ.items() if name != "FORCE_RERUN_ANALYTICS"} | quiet


def free_port() -> int:
    """A port on which nothing listens."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return probe.getsockname()[1]


def start(options: Sequence[str], port: int, lives_s: float = 0.0) -> subprocess.Popen:
    """Start ``rerun`` with options, in a session of its own, and wait until it listens on a port.

    Args:
        options: of the command line.
        port: that it shall listen on.
        lives_s: how long it must go on after that: the viewer listens before it opens its window [s].

    Raises:
        InputError: it ended instead, or did not begin to listen.
    """
    with tempfile.TemporaryFile() as errors:
        process = _rerun(options, stdin=subprocess.DEVNULL, stderr=errors)
        deadline = time.monotonic() + _STARTS_WITHIN_S
        while process.poll() is None and time.monotonic() < deadline:
            with socket.socket() as probe:
                listens = probe.connect_ex((LOOPBACK, port)) == 0
            if listens:
                try:
                    process.wait(lives_s)
                except subprocess.TimeoutExpired:
                    return process
            time.sleep(0.05)
        stop(process)
        errors.seek(0)
        lines = [line for line in errors.read().decode(errors="replace").splitlines() if line.strip()]
    raise InputError(f"Rerun did not start{': ' + lines[-1] if lines else ''}")


def stop(process: subprocess.Popen) -> None:
    """End what :func:`start` started, with its children."""
    try:
        os.killpg(process.pid, signal.SIGTERM)
    except ProcessLookupError:
        return
    try:
        process.wait(_ENDS_WITHIN_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


class ViewerClosed(Exception):
    """The viewer was closed, or does not take what it is sent."""


class Sender:
    """Sends a recording to a viewer, and never waits long for one that ended or hangs.

    Rerun's own client would: once its buffers are full it waits without end (rerun-io/rerun#12620). So it runs in a
    process of its own, ``rerun -``, which takes a recording's bytes from a pipe and passes them on as they come.

    Args:
        viewer: that :func:`start` started.
        port: that it listens on.
        patience_s: how long the viewer may take nothing before it is given up [s].
    """

    def __init__(self, viewer: subprocess.Popen, port: int, patience_s: float) -> None:
        self._viewer, self._patience_s = viewer, patience_s
        self._process = _rerun(["--port", str(port), "-"], stdin=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self._queue: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._taken_at = time.monotonic()
        threading.Thread(target=self._pass_on, name="uvms-mj viewer", daemon=True).start()

    def send(self, data: bytes) -> None:
        """Send what follows in the recording, soon. Raises ViewerClosed; nothing more can be sent then."""
        self._look()
        self._queue.put(data)

    def wait(self) -> None:
        """Wait until what was sent is under way. Raises ViewerClosed."""
        self._taken_at = time.monotonic()
        while not self._queue.empty():
            self._look(self._patience_s)
            time.sleep(_LOOKS_EVERY_S)

    def end(self) -> None:
        """Wait until the viewer has everything. Raises ViewerClosed."""
        self._queue.put(None)
        self._taken_at = time.monotonic()
        while self._process.poll() is None:
            self._look(self._patience_s)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_LOOKS_EVERY_S)
        if self._process.returncode:
            raise ViewerClosed("it was closed")

    def _pass_on(self) -> None:
        pipe = self._process.stdin
        assert pipe is not None
        with contextlib.suppress(BrokenPipeError), pipe:
            while (data := self._queue.get()) is not None:
                for first in range(0, len(data), _PIECE_BYTES):
                    pipe.write(data[first : first + _PIECE_BYTES])
                    pipe.flush()
                    self._taken_at = time.monotonic()

    def _look(self, patience_s: float = math.inf) -> None:
        why = ""
        if self._viewer.poll() is not None or self._process.poll():
            why = "it was closed"
        elif time.monotonic() - self._taken_at > patience_s:
            why = f"it took nothing for {patience_s:g} s"
        if why:
            self._queue.put(None)
            stop(self._process)
            raise ViewerClosed(why)


def _rerun(options: Sequence[str], stdin: int, stderr: int | IO[bytes]) -> subprocess.Popen:
    command = [sys.executable, "-m", "rerun_cli", "--bind", LOOPBACK, *options]
    return subprocess.Popen(
        command, env=environment(), stdin=stdin, stdout=subprocess.DEVNULL, stderr=stderr, start_new_session=True
    )
