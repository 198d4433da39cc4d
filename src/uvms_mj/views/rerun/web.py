"""Serves Rerun's web viewer and a recording on this machine only.

The page of ``rerun --serve-web`` loads fonts from the web, checks for new versions and may send usage data. This module
therefore reads the page from it once and serves it with a content security policy, with which the browser connects to
no other server.
"""

import http.client
import re
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import quote, urlsplit

from ...errors import InputError
from .process import LOOPBACK, free_port, start, stop

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
