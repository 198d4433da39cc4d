"""A headless Chromium for tests of pages."""

import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")


class Chromium:
    """A headless Chromium, controlled by the DevTools protocol over a pipe. A page with 3D needs ``webgl``, whose
    renderer in software takes most of the browser's time."""

    def __init__(self, folder: Path, webgl: bool = False) -> None:
        to_browser, from_browser = os.pipe(), os.pipe()
        read, write = (fcntl.fcntl(fd, fcntl.F_DUPFD, 10) for fd in (to_browser[0], from_browser[1]))
        run = f"import os, sys; os.dup2({read}, 3); os.dup2({write}, 4); os.execvp(sys.argv[1], sys.argv[1:])"
        graphics = "--use-angle=swiftshader --enable-unsafe-swiftshader" if webgl else "--disable-gpu"
        flags = (
            "--headless --no-sandbox --remote-debugging-pipe --no-first-run --disable-quic --disable-sync "
            f"--disable-background-networking --disable-component-update {graphics} "
            f"--window-size=1280,900 --user-data-dir={folder} about:blank"
        )
        self.process = subprocess.Popen(
            [sys.executable, "-c", run, str(CHROMIUM), *flags.split()],
            pass_fds=(read, write),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for fd in (to_browser[0], from_browser[1], read, write):
            os.close(fd)
        self.to, self.back = to_browser[1], from_browser[0]
        self.events: list[dict] = []
        self._calls, self._buffer, self._session = 0, b"", {}
        page = next(t for t in self("Target.getTargets")["targetInfos"] if t["type"] == "page")
        attached = self("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = {"sessionId": attached["sessionId"]}

    def __call__(self, method: str, **params) -> dict:
        self._calls += 1
        message = {"id": self._calls, "method": method, "params": params, **self._session}
        os.write(self.to, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self._buffer:
                assert select.select([self.back], [], [], 120.0)[0], f"no answer to {method}"
                data = os.read(self.back, 2**20)
                assert data, "chromium ended"
                self._buffer += data
            one, _, self._buffer = self._buffer.partition(b"\0")
            answer = json.loads(one)
            if answer.get("id") == self._calls:
                return answer.get("result", {})
            self.events.append(answer)

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression in the page, or of its promise."""
        answer = self("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def picture(self) -> bytes:
        """A picture of the window, as PNG."""
        return base64.b64decode(self("Page.captureScreenshot", format="png")["data"])

    def close(self) -> None:
        os.close(self.to)
        try:
            self.process.wait(10.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait(10.0)
        os.close(self.back)
