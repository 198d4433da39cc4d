"""The ``rerun`` executable: started so that it listens on this machine alone and tells nobody anything.

Rerun's viewer collects usage data unless its user has said no. It does not where ``CI`` is set, whatever its settings
say, and then neither greets a new user nor writes any settings; only ``FORCE_RERUN_ANALYTICS`` is stronger. It also
asks the web for newer versions of itself, and no setting stops that; but it obeys a proxy, and at the one that it is
given nobody is at home.
"""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence

from ..faults import InputError

LOOPBACK = "127.0.0.1"
_NOWHERE = f"http://{LOOPBACK}:9"
_STARTS_WITHIN_S, _ENDS_WITHIN_S = 60.0, 5.0


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
    command = [sys.executable, "-m", "rerun_cli", "--bind", LOOPBACK, *options]
    with tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(
            command,
            env=environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            start_new_session=True,
        )
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
