"""A run in Foxglove while it goes on: the messages of its log over a WebSocket, and numbers that are set from there.

Only this module uses Foxglove's SDK.
"""

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Self

import numpy as np
from mcap.records import Channel, Schema

from ..errors import InputError, needs_extra, warn_of_host
from ..quantities import leaves
from ..records.header import Header, Outcome
from ..records.mcap.layout import CHUNK_BYTES, Format, messages_in
from ..records.mcap.sink import channel_records
from ..scenario import Scenario

with needs_extra("live"):
    import foxglove
    from foxglove.websocket import Capability, ServerListener

LOOPBACK = "127.0.0.1"
PORT = 8765
"""Port that Foxglove proposes."""
_STEP_S = 0.02
"""Wall time from one pause of a paced run to the next [s]."""
_LATE_S = 0.1
"""A run that is behind by more than this does not catch up [s]: it would go faster than its pace."""
_SETTLED_S = 0.3
"""Wall time without a new subscription after which the first viewer has all that it wants [s]."""
_LOOKS_EVERY_S = 0.01
_ANSWERS_WITHIN_S = 10.0
"""Longest wall time that a viewer waits for the step that takes its numbers [s]: a slow law holds the run up."""
_MOST_WAITING = 2**20
"""Messages that wait for a slow viewer at most. Then it loses the oldest, and the log has them."""


class Foxglove(ServerListener):
    """A sink and a guide of one run: serves its messages, keeps its pace, and sets what a viewer sets.

    The run begins when a viewer has subscribed, and waits at its steps for real time. Its messages and their times are
    the log's. Time is the run's, from zero. ::

        with Foxglove() as live:
            trace = simulate(scenario, sinks=[live], guides=[live])

    Args:
        host: address to listen on.
        port: port; 0: any that is free.
        speed: simulated time per wall time; inf: as fast as it runs.

    Attributes:
        address: what a viewer connects to, once the run has begun.
        said: receiver of a sentence for the user.
    """

    def __init__(
        self,
        host: str = LOOPBACK,
        port: int = PORT,
        speed: float = 1.0,
        said: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._host, self._port, self._speed, self.said, self.address = host, port, speed, said, ""
        self._lock, self._subscribed, self._subscribed_at = threading.Lock(), set[tuple[int, int]](), -np.inf
        self._asked: queue.SimpleQueue[_Asked] = queue.SimpleQueue()
        self._parameters: dict[str, Any] = {}
        self._channels: dict[int, foxglove.Channel] = {}
        self._server: Any = None
        self._sending = threading.Lock()
        self._over = self._waited = False
        self._from = (0.0, 0.0)  # wall time and simulated time from which the pace counts

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    # The sink

    def begin(self, header: Header) -> None:
        """Listen. Raises InputError if the port is not to be had."""
        self._format = Format(header)
        self._parameters = dict(numbers_of(header.scenario))
        self._context, self._rows = foxglove.Context(), 0  # a context that nobody keeps loses its channels
        records = channel_records(self._format)
        schemas = {each.id: each for each in records if isinstance(each, Schema)}
        for each in records:
            if isinstance(each, Channel):
                schema = schemas[each.schema_id]
                self._channels[each.id] = foxglove.Channel(
                    each.topic,
                    message_encoding=each.message_encoding,
                    schema=foxglove.Schema(name=schema.name, encoding=schema.encoding, data=schema.data),
                    metadata=each.metadata,
                    context=self._context,
                )
        self._once = {number: message for number, _, message in messages_in(self._format.once_block().data.tobytes())}
        warn_of_host("--host", self._host, "machines that reach this address can read the run and change its numbers")
        rows = -(-header.scenario.steps // header.row_steps) + 1
        try:
            self._server = foxglove.start_server(
                name=f"uvms-mj: {header.scenario.name}, {header.scenario.controller.label()}",
                host=self._host,
                port=self._port,
                capabilities=[Capability.Time, Capability.Parameters],
                server_listener=self,
                context=self._context,
                message_backlog_size=min(_MOST_WAITING, 1024 + rows * len(self._channels)),
            )
        except RuntimeError as error:
            wrong = str(error).rpartition(": ")[2].partition(" (os error")[0]
            hint = "another program has it; choose another with --port" if "in use" in wrong else wrong
            raise InputError(f"port {self._port} of {self._host}: {hint}") from None
        self.address = f"ws://{self._host}:{self._server.port}"

    def write(self, rows: np.ndarray) -> None:
        """Send the messages of rows (n, width) to all who have subscribed to their topics."""
        most = max(1, CHUNK_BYTES // self._format.row_records.size)
        for start in range(0, len(rows), most):
            part = rows[start : start + most]
            block, log_ns = self._format.block(part, self._rows)
            with self._sending:
                if self._server is None:
                    return
                for number, when, message in messages_in(block.data.tobytes()):
                    self._channels[number].log(message, log_time=when)
                self._server.broadcast_time(int(log_ns[-1]))
            self._rows += len(part)

    def end(self, outcome: Outcome) -> None:
        """Refuse further numbers. The server goes on until :meth:`close`, and sends messages that wait."""
        self._over = True
        self._refuse_waiting()

    @property
    def watched(self) -> bool:
        """Whether somebody has subscribed."""
        with self._lock:
            return bool(self._subscribed)

    def wait(self) -> None:
        """Wait until the last viewer has gone."""
        while self.watched:
            time.sleep(_LOOKS_EVERY_S)

    def close(self) -> None:
        """Stop the server. Calling it again has no effect."""
        self._over = True
        self._refuse_waiting()
        with self._sending:
            if self._server is not None:
                self._server.stop()
                for channel in self._channels.values():
                    channel.close()
            self._server = None

    # The guide

    def go_on(self, sim: Any, change: Callable[[Mapping[str, Any]], None]) -> int:
        """Set what viewers have asked for, and wait until real time has come to the run."""
        if not self._waited:
            self.said(f"waits for a viewer at {self.address}; Ctrl-C ends it")
            while not (self.watched and time.monotonic() - self._subscribed_at > _SETTLED_S) and not self._over:
                self._set_asked(sim, change)
                time.sleep(_LOOKS_EVERY_S)
            self._waited, self._from = True, (time.monotonic(), sim.t)
        while True:
            self._set_asked(sim, change)
            wall, simulated = self._from
            ahead = (sim.t - simulated) / self._speed - (time.monotonic() - wall)
            if ahead <= 0.0:
                break
            time.sleep(min(ahead, _LOOKS_EVERY_S))
        if ahead < -_LATE_S:
            self._from = (time.monotonic(), sim.t)
        if self._speed == np.inf:
            return int(sim.chunk_steps)
        return max(1, round(_STEP_S * self._speed / sim.scenario.simulation.timestep))

    def _set_asked(self, sim: Any, change: Callable[[Mapping[str, Any]], None]) -> None:
        with contextlib.suppress(queue.Empty):
            while True:
                asked = self._asked.get_nowait()
                try:
                    change(asked.values)
                    self._parameters = dict(numbers_of(sim.scenario))
                except InputError as error:
                    asked.refused = str(error)
                finally:
                    asked.done.set()

    def _refuse_waiting(self) -> None:
        with contextlib.suppress(queue.Empty):
            while True:
                asked = self._asked.get_nowait()
                asked.refused = "the run is over"
                asked.done.set()

    # What viewers ask for, on the server's threads

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Send what does not change, which was sent before."""
        with self._lock:
            self._subscribed.add((client.id, channel.id))
            self._subscribed_at = time.monotonic()
        number = self._format.number[channel.topic]
        if number in self._once:
            self._channels[number].log(self._once[number], log_time=0)

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Note that a viewer has left a topic."""
        with self._lock:
            self._subscribed.discard((client.id, channel.id))

    def on_get_parameters(self, client: Any, param_names: list[str], request_id: str | None = None) -> list[Any]:
        """The values of some numbers, or of all if none is named."""
        now = self._parameters
        return [foxglove.Parameter(name, value=now[name]) for name in param_names or now if name in now]

    def on_set_parameters(self, client: Any, parameters: list[Any], request_id: str | None = None) -> list[Any]:
        """Set numbers, all or none, before the next step, and answer with their values then."""
        asked = _Asked({each.name: each.get_value() for each in parameters})
        unknown = [name for name in asked.values if name not in self._parameters]
        if unknown:
            asked.refused = f"{', '.join(unknown)}: the scenario has no such number"
        elif self._over:
            asked.refused = "the run is over"
        else:
            self._asked.put(asked)
            if not asked.done.wait(_ANSWERS_WITHIN_S):
                asked.refused = "the run has not come to its next step"
        place = f"set {' '.join(sorted(asked.values))}"
        if (server := self._server) is not None:
            if asked.refused:
                server.publish_status(f"{place}: {asked.refused}", foxglove.StatusLevel.Error, place)
            else:
                server.remove_status([place])
        return self.on_get_parameters(client, list(asked.values))


class _Asked:
    """Numbers that a viewer wants to set, and the reason why they are refused."""

    def __init__(self, values: dict[str, Any]) -> None:
        self.values, self.refused, self.done = values, "", threading.Event()


def numbers_of(scenario: Scenario) -> Iterator[tuple[str, Any]]:
    """The numbers of a scenario, and its lists of numbers, by dotted key."""
    for key, value in leaves(scenario.to_dict(), lists=False):
        if isinstance(value, list) and value and all(isinstance(each, Mapping) for each in value):
            places = (leaves(each, f"{key}[{i}]", lists=False) for i, each in enumerate(value))
        else:
            places = iter([[(key, value)]])
        for found in places:
            yield from ((name, each) for name, each in found if _is_number(each))


def _is_number(value: Any) -> bool:
    flat = value if isinstance(value, list) and value else [value]
    return all(isinstance(each, bool | int | float) for each in flat)
