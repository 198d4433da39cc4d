"""Starts the ``rerun`` executable so that it listens on this machine only and sends no data elsewhere.

Rerun's viewer collects usage data unless the user opts out. With ``CI`` set it collects none, regardless of its
settings; it also shows no welcome message and writes no settings. Only ``FORCE_RERUN_ANALYTICS`` overrides ``CI``. The
viewer also checks the web for new versions, which no setting prevents. It respects a proxy, however, so it is given a
proxy address where nothing listens.

The page of ``rerun --serve-web`` loads fonts from the web, checks for new versions and may send usage data. This module
therefore reads the page from it once and serves it with a content security policy, with which the browser connects to
no other server.
"""

import contextlib
import http.client
import math
import os
import queue
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import IO
from urllib.parse import quote, urlsplit

from ...errors import InputError

LOOPBACK = "127.0.0.1"
_NOWHERE = f"http://{LOOPBACK}:9"
_STARTS_WITHIN_S, _ENDS_WITHIN_S = 60.0, 5.0
_LOOKS_EVERY_S = 0.05
_PIECE_BYTES = 65_536


def environment() -> dict[str, str]:
    """Environment variables with which Rerun sends no data elsewhere."""
    quiet = {"CI": "true", "TELEMETRY_ENABLED": "false", "RUST_LOG": "error"}
    for name in ("http_proxy", "https_proxy", "all_proxy"):
        quiet |= {name: _NOWHERE, name.upper(): _NOWHERE}
    quiet |= {"no_proxy": LOOPBACK, "NO_PROXY": LOOPBACK}
    return {name: value for name, value in os.environ.items() if name != "FORCE_RERUN_ANALYTICS"} | quiet


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return probe.getsockname()[1]


def start(options: Sequence[str], port: int, lives_s: float = 0.0) -> subprocess.Popen:
    """Start ``rerun`` with command-line options in a new session, and wait until it listens on a port.

    It must then keep running for ``lives_s`` [s], because the viewer listens before it opens its window. Raises
    InputError if the process ended, or does not listen.
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
    """End a process started by :func:`start`, and its children."""
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
    """The viewer was closed, or accepts no data."""


class Sender:
    """Sends a recording to a viewer, with a limited wait for a viewer that ended or hangs.

    Rerun's client waits forever once its buffers are full (rerun-io/rerun#12620). It therefore runs in a separate
    process, ``rerun -``, which reads a recording's bytes from a pipe and forwards them to the port of a viewer that
    :func:`start` started. ``patience_s`` is the longest time for which the viewer may accept no data [s].
    """

    def __init__(self, viewer: subprocess.Popen, port: int, patience_s: float) -> None:
        self._viewer, self._patience_s = viewer, patience_s
        self._process = _rerun(["--port", str(port), "-"], stdin=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self._queue: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._taken_at = time.monotonic()
        threading.Thread(target=self._pass_on, name="uvms-mj viewer", daemon=True).start()

    def send(self, data: bytes) -> None:
        """Queue the next bytes of the recording. Raises ViewerClosed, after which nothing more can be sent."""
        self._look()
        self._queue.put(data)

    def wait(self) -> None:
        """Wait until the queue is empty. Raises ViewerClosed."""
        self._taken_at = time.monotonic()
        while not self._queue.empty():
            self._look(self._patience_s)
            time.sleep(_LOOKS_EVERY_S)

    def end(self) -> None:
        """Wait until the viewer has received all data. Raises ViewerClosed."""
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
            why = f"it accepted no data for {patience_s:g} s"
        if why:
            self._queue.put(None)
            stop(self._process)
            raise ViewerClosed(why)


def _rerun(options: Sequence[str], stdin: int, stderr: int | IO[bytes]) -> subprocess.Popen:
    command = [sys.executable, "-P", "-m", "rerun_cli", "--bind", LOOPBACK, *options]
    return subprocess.Popen(
        command, env=environment(), stdin=stdin, stdout=subprocess.DEVNULL, stderr=stderr, start_new_session=True
    )


_FILES = ("index.html", "re_viewer.js", "re_viewer_bg.wasm", "favicon.ico")
_RECORDING = "/run.rrd"
_POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' 'unsafe-eval' blob:; "
    "worker-src 'self' blob:; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "font-src 'self' data:; connect-src 'self' data: blob:"
)
"""Permitted sources and connections of the page. Rerun's code creates functions at run time, hence unsafe-eval."""


@contextmanager
def web_viewer(recording: Path, port: int = 0) -> Iterator[str]:
    """A context in which an .rrd file is served on a port, 0 for any free one. Its value is the viewer's address.
    Raises InputError if the port is in use, or Rerun's page can't be obtained."""
    files = _page()
    try:
        server = _Server(port, files, recording)
    except OSError as error:
        raise InputError(f"can't serve on port {port} of {LOOPBACK}: {error.strerror}") from None
    address = f"http://{LOOPBACK}:{server.server_port}"
    threading.Thread(target=server.serve_forever, name="uvms-mj web viewer", daemon=True).start()
    try:
        yield f"{address}/?url={quote(address + _RECORDING, safe='')}&hide_welcome_screen&persist=0"
    finally:
        server.shutdown()
        server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, port: int, files: dict[str, tuple[str, bytes]], recording: Path) -> None:
        super().__init__((LOOPBACK, port), _Handler)
        self.files, self.recording = files, recording
        self.hosts = {f"{host}:{self.server_port}" for host in (LOOPBACK, "localhost")}


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        path = urlsplit(self.path).path
        if self.headers.get("Host") not in self.server.hosts:  # a foreign name that resolves to this machine
            self.send_error(403)
        elif path == _RECORDING:
            with self.server.recording.open("rb") as file:
                self._head("application/octet-stream", self.server.recording.stat().st_size)
                shutil.copyfileobj(file, self.wfile)
        elif path in self.server.files:
            kind, data = self.server.files[path]
            self._head(kind, len(data))
            self.wfile.write(data)
        else:
            self.send_error(404)

    def _head(self, kind: str, size: int) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(size))
        self.send_header("Content-Security-Policy", _POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:
        pass


def _page() -> dict[str, tuple[str, bytes]]:
    """Content type and bytes of the web viewer's files, by path."""
    port = free_port()
    # with the address of a recording it serves only its page
    process = start(["--serve-web", "--web-viewer-port", str(port), f"http://{LOOPBACK}{_RECORDING}"], port)
    files = {}
    try:
        for name in _FILES:
            connection = http.client.HTTPConnection(LOOPBACK, port, timeout=60.0)
            connection.request("GET", f"/{name}")
            response = connection.getresponse()
            data = response.read()
            connection.close()
            if response.status != 200:
                raise InputError(f"this version of Rerun has no {name} for its web viewer; use --save instead")
            files[f"/{name}"] = (response.headers.get_content_type(), data)
    finally:
        stop(process)
    html = files["/index.html"][1].decode()
    # a content security policy does not prevent preconnect links
    html = re.sub(r'<link\b[^>]*href="https?://[^>]*>', "", html)
    files["/"] = files["/index.html"] = ("text/html; charset=utf-8", html.encode())
    return files
