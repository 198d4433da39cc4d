"""A law in another process: the messages of the law ``udp``.

A request is 8 bytes ``uvms-mj1``, the number of the instant (uint64), and the record of signals that a law is given, as
``struct signals`` of ``uvms_stage.h`` has it. The answer is the number of the instant and tau_cmd, six doubles. The
program of an exported law, its ``loop.c``, has more behind them: the status of its library (int64), the number of the
export (uint64), :data:`LAYOUT` as it knows it (uint64), and the thrust of each thruster that it has allocated. All
numbers are little endian. A request that is not answered is sent again: a law answers it with the same numbers.

Both sides use loopback, unless the user names another host. The socket of a run is connected to the law's port, so that
the operating system delivers what that port sends, and nothing else.
"""

import contextlib
import hashlib
import math
import socket
import struct
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from ..errors import Fault, InputError, warn_of_host
from ..stages.signals import GIVEN, record_dtype

LOOPBACK = "127.0.0.1"
MAGIC = b"uvms-mj1"
SIGNALS = record_dtype(GIVEN)
"""The record in a request."""
LAYOUT = int.from_bytes(hashlib.sha256(repr([(s.name, s.shape) for s in GIVEN]).encode()).digest()[:8], "little") >> 1
"""A number of this record's fields."""
STATUSES = {
    "OK": (0, "it is the law's command"),
    "LATE": (1, "it is the law's command, but the time since the last one is not a period within half of it"),
    "LEFT_OUT": (2, "it is the law's command; a measurement that is not finite was left out, as if it were not there"),
    "NULL": (-1, "a pointer is null"),
    "OTHER_HEADER": (-2, "the program was compiled with the header of another library"),
    "NOT_BEGUN": (-3, "init was not called, or refused"),
    "NOT_FINITE": (-4, "a number that was given is not finite"),
    "MISSING": (-5, "a measurement is missing that the law needs"),
    "NO_ATTITUDE": (-6, "the quaternion has not the length 1"),
    "TIME_BACK": (-7, "the time is not after the last call's; reset begins anew"),
    "GAP": (-8, "the last call was too long ago; the next one goes on"),
    "FAULT": (-9, "a stage ended early, or a command was out of bounds; only reset goes on"),
    "OTHER_ARITHMETIC": (-10, "the processor does not round to the nearest, or flushes small numbers to zero"),
    "DAMAGED": (-11, "the bytes are no whole frame; only the program loop.c returns it"),
}
"""Results of the functions of a law's library, by the words of its header: below zero the command is neutral."""
_REQUEST, _ANSWER, _OF_EXPORT = struct.Struct("<8sQ"), struct.Struct("<Q6d"), struct.Struct("<qQQ")
_AGAIN_S = 0.2
"""Wall time after which a request is sent again [s]."""


class UdpLaw:
    """A peer of a run: a law that listens on a port.

    Args:
        port: its port.
        timeout: longest wall time without an answer [s].
        period_steps: time steps of a control period.
        export: number of the export that answers; 0: any law.
        host: name or IPv4 address of its machine.

    Raises:
        InputError: there is no such host.
    """

    def __init__(self, port: int, timeout: float, period_steps: int, export: int = 0, host: str = LOOPBACK) -> None:
        warn_of_host("controller.host", host, "the run is sent over the network, and the law's answers are believed")
        self._place, self._timeout, self._steps, self._instant = (host, port), timeout, period_steps, 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.connect(self._place)
        except OSError as error:
            self._socket.close()
            raise InputError([Fault("controller.host", f"{host}: {error.strerror}")]) from None
        self._socket.settimeout(_AGAIN_S)
        self._odd, self._export, self._thrusts = "", export, np.zeros(0)

    @classmethod
    def of(cls, scenario: Any) -> "UdpLaw":
        """The peer of a scenario with the law ``udp``."""
        law = scenario.controller
        steps = round(scenario.control_period / scenario.simulation.timestep)
        return cls(law.port, law.timeout, steps, law.export, law.host)

    def close(self) -> None:
        self._socket.close()

    def command(self, sim: Any, idle: Callable[[], None] = lambda: None) -> int:
        """Ask the law for the command of the instant in hand. ``idle`` is called while the run waits."""
        sim.signals  # noqa: B018  # computed now, if they are not
        request = _REQUEST.pack(MAGIC, self._instant) + sim.given.tobytes()
        until = time.monotonic() + self._timeout
        while True:
            try:
                self._socket.send(request)
                answer = self._receive(min(until, time.monotonic() + _AGAIN_S))
            except (TimeoutError, ConnectionRefusedError):
                if time.monotonic() > until:
                    at = f" at t = {sim.t:.6g} s" if self._instant else ""
                    raise self._wrong(f"no law answers{{}} within {self._timeout:g} s{at}{self._odd}") from None
                idle()
                time.sleep(0.01)
                continue
            tau_cmd, more = answer
            self._judge(sim, more)
            for i, value in enumerate(tau_cmd):
                if not math.isfinite(value):
                    raise self._wrong(f"the law{{}} answers {value} for tau_cmd[{i}] at t = {sim.t:.6g} s")
            sim.tau_cmd[:] = tau_cmd
            self._instant += 1
            return self._steps

    def _judge(self, sim: Any, more: bytes) -> None:
        """Raise InputError if an export says that it refuses this instant, or is another export."""
        if not more:
            if self._export:
                raise self._wrong(f"the law{{}} is no export, and {self._export} is asked for", "export")
            return
        status, export, layout = _OF_EXPORT.unpack_from(more)
        if self._export not in (0, export):
            raise self._wrong(f"the law{{}} is export {export}, and {self._export} is asked for", "export")
        thrusts, in_run = np.frombuffer(more, "<f8", offset=_OF_EXPORT.size), sim.u
        if layout != LAYOUT or thrusts.size != in_run.size:
            raise self._wrong("the law{} expects other signals or thrusters than this run has; export it anew")
        if status:
            said = next((words for number, words in STATUSES.values() if number == status), "an unknown status")
            said += "; controller.period must be the export's" if status == STATUSES["LATE"][0] else ""
            raise self._wrong(f"the law{{}} has status {status} at t = {sim.t:.6g} s: {said}")
        differ = np.flatnonzero(self._thrusts.view("u8") != in_run.view("u8")) if self._instant else ()
        for k in differ:
            asked = f"{self._thrusts[k]:.9g} N of thruster {k}, and this run {in_run[k]:.9g} N"
            said = f"the law{{}} asked for {asked}, in the period before t = {sim.t:.6g} s"
            raise self._wrong(f"{said}: the run must have the scenario of the export")
        self._thrusts = thrusts

    def _wrong(self, said: str, key: str = "port") -> InputError:
        host, port = self._place
        return InputError([Fault(f"controller.{key}", said.format(f" on UDP {host}:{port}"))])

    def _receive(self, until: float) -> tuple[tuple[float, ...], bytes]:
        """tau_cmd of the answer to the request of this instant, and what an export has behind it; others are late
        copies. Raises TimeoutError."""
        while True:
            if time.monotonic() > until:
                raise TimeoutError
            data = self._socket.recv(4096)
            more = data[_ANSWER.size :]
            if len(data) < _ANSWER.size or (more and (len(more) <= _OF_EXPORT.size or len(more) % 8)):
                self._odd = f"; {len(data)} bytes came, and an answer has {_ANSWER.size}"
                continue
            instant, *tau_cmd = _ANSWER.unpack_from(data)
            if instant == self._instant:
                return tuple(tau_cmd), more
            if instant > self._instant:
                self._odd = f"; an answer of instant {instant} came, and {self._instant} was asked for"

    def measure(self, sim: Any) -> None:
        """The next request has the measurements."""

    def finish(self, sim: Any) -> None:
        self.command(sim)


def serve(law: Any, port: int, requests: int | None = None, host: str = LOOPBACK) -> None:
    """Answer requests on a port with ``law(signals)``, six numbers, from a record of :data:`SIGNALS`; for so many
    instants, or until an interrupt. A repeated request gets the same answer. One run is answered at a time, the one
    that began last: a law that remembers must not meet the instants of two runs in turn. ``host`` is the address to
    listen on; a run on another machine needs one that it reaches.

    Raises:
        InputError: another program has the port, or the law does not give six numbers.
    """
    warn_of_host("host", host, "machines that reach this address are answered")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer, contextlib.suppress(KeyboardInterrupt):
        try:
            peer.bind((host, port))
        except OSError as error:
            raise InputError(f"UDP port {port} of {host}: {error.strerror}; choose another") from None
        last, answer, asked = -1, b"", None
        while requests is None or last + 1 < requests:
            data, address = peer.recvfrom(65536)
            if len(data) != _REQUEST.size + SIGNALS.itemsize or data[:8] != MAGIC:
                continue
            instant = _REQUEST.unpack_from(data)[1]
            if asked is not None and address != asked and instant:
                continue  # of a run that a later one has replaced
            if (instant, address) != (last, asked):
                signals = np.frombuffer(data, SIGNALS, 1, _REQUEST.size).view(np.recarray)[0]
                command = np.asarray(law(signals), float)
                if command.shape != (6,):
                    raise InputError(f"the law must give six numbers, and gave an array of shape {command.shape}")
                answer, last, asked = _ANSWER.pack(instant, *command), instant, address
            peer.sendto(answer, address)
