"""The physics of an autopilot: ArduPilot's JSON interface over UDP, in lockstep.

The autopilot sends the pulse widths of a frame; the plant takes the steps of the frame and answers with what the
sensors measure and with its time, by which the autopilot's clock advances. A frame that is repeated gets the same
answer again, and no second step. Formats and their quirks are as in ArduPilot's SIM_JSON; its frames are north,
east, down (NED), and forward, right, down (FRD). Here W has x north, y west, z up, and B is forward, left, up.

One autopilot flies the vehicle. Packets of others are ignored, and said once. An autopilot that is started again has a
new address: it takes over when the first has been silent for :data:`SILENT_S`.
"""

import contextlib
import socket
import struct
import time
import warnings
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..actuation.base import GREATEST_US, LEAST_US, NEUTRAL_US
from ..errors import InputError, warn_of_host
from ..physics.frames import rotation_matrix, to_body, to_world

_16, _32 = struct.Struct("<HHI16H"), struct.Struct("<HHI32H")
_FORMATS = {18458: _16, 29569: _32}
"""Servo packets by their first number: rate [Hz], number of the frame, pulse widths [us]."""
PORT = 9002
LOOPBACK = "127.0.0.1"
_LOOKS_EVERY_S = 0.2
SILENT_S = 2.5
"""Wall time without a packet, while the plant waits for one, after which another autopilot may take over [s]. ArduPilot
sends a frame that has no answer again each second."""
_MOST_WAITING = 1000
"""Packets that are looked through before an answer, so that noise holds nothing up."""
_ABOVE = 1e-8
"""Share by which the time in an answer is ahead: ArduPilot cuts each difference of times to whole microseconds [1]."""
_FLIP = np.array([1.0, -1.0, -1.0])
"""From forward, left, up to forward, right, down, and back; likewise from W to NED."""

FRAMES = {
    "vectored": (
        (0, 0, 1, 0, -1, 1), (0, 0, -1, 0, -1, -1), (0, 0, -1, 0, 1, 1), (0, 0, 1, 0, 1, -1),
        (1, 0, 0, -1, 0, 0), (-1, 0, 0, -1, 0, 0),
    ),
    "vectored_6dof": (
        (0, 0, 1, 0, -1, 1), (0, 0, -1, 0, -1, -1), (0, 0, -1, 0, 1, 1), (0, 0, 1, 0, 1, -1),
        (1, -1, 0, -1, 0, 0), (-1, -1, 0, -1, 0, 0), (1, 1, 0, -1, 0, 0), (-1, 1, 0, -1, 0, 0),
    ),
}  # fmt: skip
"""ArduSub's frames: of each motor, from 1, the factors of roll, pitch, yaw, throttle, forward, lateral."""
_LATE = 100
"""A frame that is older than the last one by more than this is the first of an autopilot that was started again."""
_SLIGHT = 0.02
"""A part of a thruster in an axis below this share of its greatest one has no sign."""


@dataclass(frozen=True)
class Servo:
    """A servo packet: rate [Hz] and number of the frame, and the pulse widths of 16 or 32 channels [us]."""

    rate: int
    frame: int
    pwm: tuple[int, ...]

    @classmethod
    def of(cls, data: bytes) -> "Servo | None":
        """The packet in a datagram; None for noise."""
        if len(data) < 8:
            return None
        layout = _FORMATS.get(struct.unpack_from("<H", data)[0])
        if layout is None or len(data) != layout.size:
            return None
        _, rate, frame, *pwm = layout.unpack(data)
        return cls(rate, frame, tuple(pwm))


def reply(t: float, gyro: Any, acceleration: Any, position: Any, quaternion: Any, velocity: Any) -> bytes:
    """The answer: time [s], angular velocity [rad/s] and specific force [m/s^2] in FRD, position [m] and velocity [m/s]
    in NED, attitude from FRD to NED (w x y z). Without blanks, which one of ArduPilot's two parsers does not take, and
    with the fields of ``imu`` before others of the same letters, since it searches for the first match."""

    def numbers(values: Any) -> str:
        return f"[{','.join(map(repr, map(float, values)))}]"

    text = (
        f'{{"timestamp":{t!r},"imu":{{"gyro":{numbers(gyro)},"accel_body":{numbers(acceleration)}}},'
        f'"position":{numbers(position)},"quaternion":{numbers(quaternion)},"velocity":{numbers(velocity)}}}'
    )
    return f"\n{text}\n".encode()


def motors_of(B: np.ndarray) -> tuple[str, np.ndarray, np.ndarray]:
    """The frame of ArduSub with this allocation matrix (6, n) in B, and of each thruster its motor, from 0, and the
    sign of its command.

    A motor is found by the signs of its forces and moments. Raises InputError if no frame has these thrusters.
    """
    n = B.shape[1]
    # roll, pitch, yaw; throttle is up, against z of FRD; forward; lateral is right
    acts = np.vstack([B[3], -B[4], -B[5], B[2], B[0], -B[1]])
    acts = np.where(np.abs(acts) > _SLIGHT * np.abs(acts).max(axis=0), np.sign(acts), 0.0)
    for name, factors in FRAMES.items():
        motors, signs = np.full(n, -1), np.zeros(n)
        for motor, each in enumerate(np.array(factors, float)):
            used, vertical = each != 0.0, each[3] != 0.0
            for k in np.flatnonzero((acts[3] != 0.0) == vertical):
                for sign in (1.0, -1.0):
                    if (sign * acts[used, k] == each[used]).all():
                        motors[k], signs[k] = motor, sign
        if sorted(motors.tolist()) == list(range(len(factors))):
            return name, motors, signs
    known = ", ".join(f"{name} of {len(factors)}" for name, factors in FRAMES.items())
    raise InputError(f"none of ArduSub's frames, {known}, has the {n} thrusters; give --motors")


def given_motors(text: str, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Motors, from 0, and signs of n thrusters from a text, "1,-2,3". Raises InputError."""
    try:
        numbers = [int(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != n or 0 in numbers or len({abs(x) for x in numbers}) != n or max(map(abs, numbers)) > 16:
        raise InputError(f"--motors {text}: must be {n} motor numbers from 1 to 16, each once, with a sign, as 1,-2,3")
    return np.array([abs(x) - 1 for x in numbers]), np.sign(np.array(numbers, float))


@dataclass
class Counts:
    """Messages of the autopilot: frames that were stepped, repeated ones that were answered again, older ones that
    were left alone, numbers that were skipped, restarts of the autopilot, datagrams of others, and datagrams of the
    autopilot that were no packet."""

    frames: int = 0
    repeated: int = 0
    stale: int = 0
    skipped: int = 0
    restarts: int = 0
    strays: int = 0
    noise: int = 0

    def __str__(self) -> str:
        found = {name: value for name, value in vars(self).items() if value}
        return ", ".join(f"{value} {name}" for name, value in found.items()) or "no frames"


@dataclass
class ArduPilot:
    """A peer of a run: an ArduPilot that commands the vehicle's speed controllers.

    Attributes:
        motors, signs: of each thruster the channel of its pulse width, from 0, and 1 or -1.
        steps: time steps of a frame.
        depth: depth of the origin of W below the surface [m].
        port: UDP port on ``host``.
        waited_s: wall time that the plant has waited for frames [s].
    """

    motors: np.ndarray
    signs: np.ndarray
    steps: int
    depth: float = 5.0
    port: int = PORT
    host: str = LOOPBACK
    counts: Counts = field(default_factory=Counts)
    waited_s: float = 0.0

    def __post_init__(self) -> None:
        warn_of_host("--host", self.host, "machines that reach this address can command the vehicle")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((self.host, self.port))
        except OSError as error:
            self._socket.close()
            hint = "another program has it; choose another with --port" if error.errno == 98 else error.strerror
            raise InputError(f"port {self.port} of {self.host}: {hint}") from None
        self._socket.settimeout(_LOOKS_EVERY_S)
        self._address: Any = None
        self._heard = 0.0  # when the autopilot sent, or the plant began to wait for it
        self._last, self._sent = -1, b""
        self._waiting: deque[tuple[bytes, Any]] = deque()

    def close(self) -> None:
        self._socket.close()

    def command(self, sim: Any, idle: Callable[[], None] = lambda: None) -> int:
        """Wait for the next frame, and set its pulse widths; ``idle`` is called meanwhile. Returns the number of time
        steps to take."""
        since = time.perf_counter()
        servo = self._next(idle)
        self.waited_s += time.perf_counter() - since
        pulses = np.array(servo.pwm, float)[self.motors]
        pulses[pulses == 0.0] = NEUTRAL_US  # no signal
        sim.pwm_cmd[:] = np.clip(NEUTRAL_US + self.signs * (pulses - NEUTRAL_US), LEAST_US, GREATEST_US)
        sim.frame[:] = servo.frame
        return self.steps

    def measure(self, sim: Any) -> None:
        """Answer the frame, once for all of its copies that have come: a second answer would stay on the way, and leave
        the autopilot a frame behind for good."""
        self._sent = self.answer(sim)
        self._socket.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            for _ in range(_MOST_WAITING):
                data, address = self._socket.recvfrom(512)
                servo = Servo.of(data)
                if servo is not None and (servo.frame, address) == (self._last, self._address):
                    self.counts.repeated += 1
                else:
                    self._waiting.append((data, address))
        self._socket.settimeout(_LOOKS_EVERY_S)
        self._send(self._address)

    def finish(self, sim: Any) -> None:
        """The last pulse widths hold."""

    def answer(self, sim: Any) -> bytes:
        """The measurements of the sensors at the instant in hand, as the answer."""
        signals = sim.signals
        p, quat, nu = (signals[f"{name}_m" if f"{name}_m" in signals else name] for name in ("p_WB", "quat_WB", "nu"))
        velocity = np.zeros(3)
        to_world(rotation_matrix(quat), nu, velocity)
        # an accelerometer feels the true attitude and motion, whatever the other sensors say of them
        g_B, nu_B = np.zeros(3), signals.nu
        to_body(rotation_matrix(signals.quat_WB), sim.setup.gravity_W, g_B)
        force = signals.nu_dot[:3] + np.cross(nu_B[3:], nu_B[:3]) - g_B
        position = _FLIP * p + np.array([0.0, 0.0, self.depth])
        attitude = quat * np.array([1.0, *_FLIP])
        return reply(sim.t * (1.0 + _ABOVE), _FLIP * nu[3:], _FLIP * force, position, attitude, _FLIP * velocity)

    def _next(self, idle: Callable[[], None] = lambda: None) -> Servo:
        """The next frame to step."""
        self._heard = time.monotonic()
        while True:
            idle()
            try:
                data, address = self._waiting.popleft() if self._waiting else self._socket.recvfrom(512)
            except TimeoutError:
                continue
            servo = Servo.of(data)
            if not self._is_of_autopilot(servo, address):
                self._stray(address)
            elif servo is None:
                self.counts.noise += 1
            elif self._to_step(servo, address):
                return servo

    def _is_of_autopilot(self, servo: Servo | None, address: Any) -> bool:
        """Whether a datagram is of the autopilot that flies, or of one that may begin to."""
        now = time.monotonic()
        if address == self._address:
            self._heard = now
            return True
        return servo is not None and (self._address is None or now - self._heard > SILENT_S)

    def _stray(self, address: Any) -> None:
        """Count a datagram of others, and say so at the first one."""
        self.counts.strays += 1
        if self.counts.strays == 1:
            flies = "no autopilot has sent yet" if self._address is None else f"{_place(self._address)} flies"
            warnings.warn(f"ignored what {_place(address)} sends to UDP port {self.port}: {flies}", stacklevel=2)

    def _to_step(self, servo: Servo, address: Any) -> bool:
        """Whether a frame is new. A repeated one is answered again."""
        counts, before = self.counts, self._address
        new = address != before
        if servo.frame == self._last and not new:
            counts.repeated += 1
            self._send(address)
            return False
        if servo.frame <= self._last:
            again = servo.frame + _LATE < self._last or (servo.frame == 0 and self._last > 1)
            if not (new or again):
                counts.stale += 1  # a late copy
                return False
        if before is not None and (new or servo.frame <= self._last):
            counts.restarts += 1
            if new:
                warnings.warn(
                    f"an autopilot at {_place(address)} goes on, since {_place(before)} is silent", stacklevel=2
                )
        elif self._last >= 0:
            counts.skipped += servo.frame - self._last - 1
        counts.frames += 1
        self._address, self._last = address, servo.frame
        return True

    def _send(self, address: Any) -> None:
        if self._sent:
            try:
                self._socket.sendto(self._sent, address)
            except OSError:  # it has gone away; its next packet comes from elsewhere
                return


def _place(address: Any) -> str:
    return ":".join(map(str, address[:2]))


def steps_of(rate: float, timestep: float) -> int:
    """Time steps of a frame. Raises InputError unless the rate divides the step rate, and fits the autopilot."""
    steps = round(1.0 / (rate * timestep)) if 10.0 < rate < np.inf else 0
    if steps < 1 or abs(steps * rate * timestep - 1.0) > 1e-9:
        raise InputError(f"--rate {rate:g}: must be above 10 Hz and divide the step rate, {1.0 / timestep:g} Hz")
    return steps
