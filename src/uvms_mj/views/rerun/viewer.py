"""Shows runs in the Rerun viewer: live, from their logs, as a recording, or in a web browser on this machine."""

import contextlib
import os
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import rerun as rr

from ...errors import InputError
from ...files import atomic_write
from ...plant.geometry import solids
from ...records.header import Header, Outcome
from ...records.scene import force_scale
from ...records.trace import Trace
from ...setup.world import one_world
from ..colours import of_runs
from .layout import application, layout
from .process import Sender, ViewerClosed, free_port, start, web_viewer
from .run import Extents, Place, Run, bounds

_ROWS = 65_536
"""Rows sent to Rerun in one block."""
_LIVE_HZ = 1000.0
"""Most samples streamed per simulated second [Hz]."""
_LIVE_SAMPLES = 50_000
"""Most samples streamed in a run of any length. The log contains all rows."""
_HINT = "use `uvms-mj replay run.mcap --web` or `--save run.rrd` instead"
_LANE = 1.8
"""Width of a lane, in widths of a vehicle, so that no run hides another."""
_EVERY_S = 0.1
"""Real time between two blocks of a live stream [s]."""
_PATIENCE_S = 20.0
"""Time for which a replay, or a run at its end, waits for a viewer that accepts no data [s]."""


class LiveView:
    """A sink that opens the viewer and streams a run to it, thinned to bound the cost.

    The run waits for the viewer only at its end. A viewer that is closed or hangs receives no more data.
    """

    def begin(self, header: Header) -> None:
        """Open the viewer. Raises InputError if it does not start."""
        row_s = header.row_steps * header.scenario.simulation.timestep
        rows = header.scenario.steps / header.row_steps
        thinned = max(1, round(1.0 / (_LIVE_HZ * row_s)), int(np.ceil(rows / _LIVE_SAMPLES)))
        self._run = Run(header, row_steps=thinned)
        self._sender: Sender | None = _viewer()
        self._recording = _Recording([self._run])
        self._waiting: list[np.ndarray] = []
        self._send()

    def write(self, rows: np.ndarray) -> None:
        """Collect rows and send them every :data:`_EVERY_S`, because each block has a fixed cost."""
        self._waiting.append(rows)
        if time.monotonic() - self._sent_at > _EVERY_S:
            self._send()

    def end(self, outcome: Outcome) -> None:
        """Send the remaining rows and wait until the viewer has received them."""
        self._send()
        if self._sender is not None:
            with contextlib.suppress(ViewerClosed):
                self._sender.end()

    def _send(self) -> None:
        if self._waiting and self._sender is not None:
            rows = np.concatenate(self._waiting)
            self._run.write({name: rows[:, place] for name, place in self._run.header.places.items()})
        self._waiting = []
        if self._sender is not None:
            try:
                self._sender.send(self._recording.read())
            except ViewerClosed:  # the run continues without a viewer
                self._sender = None
        self._sent_at = time.monotonic()


def show(traces: Mapping[str, Trace]) -> None:
    """Open the viewer with traces by label. The viewer remains open after the return. Raises InputError if the viewer
    does not start, or was closed before it received all data."""
    sender = _viewer()
    recording = _Recording(_runs(traces))
    try:
        for _ in recording.blocks(traces):
            sender.send(recording.read())
            sender.wait()
        sender.end()
    except ViewerClosed as error:
        raise InputError(f"the viewer did not receive the runs: {error}; {_HINT}") from None


def save(traces: Mapping[str, Trace], path: Path) -> None:
    """Write traces by label as a recording with its layout. The file is written atomically. Raises InputError if the
    file can't be written."""
    with atomic_write(path) as part:
        recording = _Recording(_runs(traces))
        for _ in recording.blocks(traces):
            pass
        part.write_bytes(recording.read())  # Rerun's file writer may wait forever on a full disk


def serve(traces: Mapping[str, Trace]) -> None:
    """Serve the web viewer with traces by label, on this machine only, until Ctrl-C. Prints the address. Raises
    InputError if Rerun's page can't be obtained."""
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "run.rrd"
        save(traces, recording)
        with web_viewer(recording) as address:
            print(address, flush=True)
            try:
                threading.Event().wait()
            except KeyboardInterrupt:
                return


class _Recording:
    """A recording of runs in memory, read in pieces while it is written."""

    def __init__(self, runs: list[Run]) -> None:
        stream = rr.RecordingStream(application(runs))
        self._bytes = rr.binary_stream(stream)
        self._runs = runs
        stream.send_blueprint(layout(runs))
        stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for run in runs:
            run.begin(stream)

    def read(self) -> bytes:
        """The bytes since the last call. They form a complete file only if this is the only call."""
        return self._bytes.read() or b""

    def blocks(self, traces: Mapping[str, Trace]) -> Iterator[None]:
        """Write the traces of all runs, one block per iteration."""
        for run, trace in zip(self._runs, traces.values(), strict=True):
            for first in range(0, max(1, len(trace)), _ROWS):
                run.write({s.name: trace[s.name][first : first + _ROWS].reshape(-1, s.size) for s in trace.signals})
                yield


def _viewer() -> Sender:
    """Open the viewer and return a sender to it. Raises InputError if the viewer does not start."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError(f"no display for the viewer; {_HINT}")
    port = free_port()
    try:
        process = start(["--port", str(port), "--hide-welcome-screen", "--expect-data-soon"], port, lives_s=1.5)
    except InputError as error:
        raise InputError(f"{error}; {_HINT}") from None
    return Sender(process, port, _PATIENCE_S)


def _runs(traces: Mapping[str, Trace]) -> list[Run]:
    """Traces as runs with a common scale of forces. Several runs each have a name, a colour of their law and a lane;
    the vehicles of one world are where they were."""
    extents = [Extents.of(trace) for trace in traces.values()]
    headers = [trace.header for trace in traces.values()]
    scale = min(force_scale(header, seen.force) for header, seen in zip(headers, extents, strict=True))
    if len(traces) == 1:
        return [Run(headers[0], place=Place(force_scale=scale), extents=extents[0])]
    colours = of_runs([header.law.source for header in headers])
    corners = [bounds(list(solids(header.geometry)), header.geometry.reach) for header in headers]
    width = _LANE * max(float(high[1] - low[1]) for low, high in corners)
    if one_world([header.scenario for header in headers]):
        lanes = [Place(force_scale=scale)] * len(traces)
    else:
        lanes = [Place((0.5 * (len(traces) - 1) - i) * width, width, scale) for i in range(len(traces))]
    return [
        Run(header, label, colour, place=lane, extents=seen)
        for header, label, colour, lane, seen in zip(headers, traces, colours, lanes, extents, strict=True)
    ]
