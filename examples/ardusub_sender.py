"""A law on the thrusters of an ArduSub: measurements come by MAVLink, and its pulses go to the gate in the autopilot.

    ./loop 9100 &
    python ardusub_sender.py udpin:127.0.0.1:14551 heavy/impedance.toml --motors=-1,-2,-3,-4,-5,6,7,-8

It does not arm. W begins where the law does, with x along the heading then. It ends where the vehicle is disarmed,
leaves MANUAL, or has parameters that are not as told, and the gate then makes the pulses neutral.
"""

import argparse
import math
import os
import socket
import struct
import sys
import time
import tomllib
import zlib
from pathlib import Path
from typing import Any

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

MANUAL, GATE_FRAME, NEUTRAL, LEAST, MOST = 19, 40001, 1500, 1100, 1900
POSE_AND_VELOCITY = 3
FRESH_S, LATE_S = 0.1, 0.4
"""The greatest age of a measurement, and of the last frame that the gate says to have taken [s]."""


class Refused(Exception):
    """Why the law may not drive this vehicle."""


class Law:
    """The program loop.c of an export, on a UDP port of this machine. ``about`` is the export's NAME.toml."""

    def __init__(self, about: dict[str, Any], port: int) -> None:
        library = about["library"]
        self.export, self.period, self.layout = library["export"], library["period_s"], int(library["layout"], 16)
        self.start = about["scenario"].get("initial", {}).get("position", [0.0, 0.0, 0.0])
        self.filters = "navigation" in library.get("stages", [])
        self.instant = 0
        self.peer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.peer.connect(("127.0.0.1", port))

    def __call__(self, t: float, measured: list[float] | None) -> tuple[int, list[float], list[float], list[float]]:
        """Status, tau_cmd, thrusts and pulses for p_WB, quat_WB and nu at a time [s]; None: nothing is measured."""
        numbers = measured or [0.0] * 13
        body = struct.pack("<dQ13d", t, POSE_AND_VELOCITY if measured else 0, *numbers)
        front = struct.pack("<8sIIQQ", b"uvms-mj2", len(body), ~len(body) & 0xFFFFFFFF, self.instant, self.layout)
        frame = front + body + struct.pack("<I", zlib.crc32(front + body))
        self.peer.settimeout(0.1)
        for _ in range(3):  # a frame that comes again gets the same answer; meanwhile the gate makes the pulses neutral
            try:
                self.peer.send(frame)
                answer = self.peer.recv(4096)
                while struct.unpack_from("<Q", answer, 16)[0] != self.instant:
                    answer = self.peer.recv(4096)
                break
            except (TimeoutError, ConnectionRefusedError):
                continue
        else:
            raise Refused("the law's program does not answer")
        if zlib.crc32(answer[:-4]) != struct.unpack("<I", answer[-4:])[0]:
            raise Refused("the law's program gives a damaged answer")
        self.instant += 1
        status, export, _ = struct.unpack_from("<qQQ", answer, 32)
        if export != self.export:
            raise Refused(f"the law's program is export {export}, and not {self.export}")
        command = struct.unpack(f"<{(len(answer) - 60) // 8}d", answer[56:-4])
        n, odd = divmod(len(command) - 13, 2)  # tau_cmd, thrusts, pulses, tau_hat, saturated
        if self.filters:
            raise Refused("this export takes samples for its Kalman filter; export it with navigation.name=perfect")
        if odd or n < 1:
            raise Refused("this export has no pulses; its scenario needs thrusters.name=t200")
        return status, list(command[:6]), list(command[6 : 6 + n]), list(command[6 + n : 6 + 2 * n])


def rotation(roll: float, pitch: float, yaw: float) -> list[list[float]]:
    """From FRD to NED, (3, 3), for angles [rad] in the order yaw, pitch, roll."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (roll, pitch, yaw))
    return [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]


def quaternion(roll: float, pitch: float, yaw: float) -> list[float]:
    """The same rotation, w x y z."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(0.5 * a), math.sin(0.5 * a)) for a in (roll, pitch, yaw))
    return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]


class Home:
    """Where the law begins: the scenario's initial position in W, whose x axis is along the heading there."""

    def __init__(self, attitude: Any, position: Any, start: list[float]) -> None:
        self.yaw, self.at, self.start = attitude.yaw, (position.x, position.y, position.z), start

    def measured(self, attitude: Any, position: Any) -> list[float]:
        """p_WB [m], quat_WB and nu [m/s, rad/s] of ATTITUDE and LOCAL_POSITION_NED. W and B have y left and z up."""
        flip = (1.0, -1.0, -1.0)
        d = [a - b for a, b in zip((position.x, position.y, position.z), self.at, strict=True)]
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        turned = (c * d[0] + s * d[1], -s * d[0] + c * d[1], d[2])
        w, x, y, z = quaternion(attitude.roll, attitude.pitch, attitude.yaw - self.yaw)
        R = rotation(attitude.roll, attitude.pitch, attitude.yaw)
        v_ned = (position.vx, position.vy, position.vz)
        v = [sum(R[k][i] * v_ned[k] for k in range(3)) for i in range(3)]
        omega = (attitude.rollspeed, attitude.pitchspeed, attitude.yawspeed)
        return [
            *(p + f * a for p, f, a in zip(self.start, flip, turned, strict=True)),
            *(w, x, -y, -z),
            *(f * a for f, a in zip(flip, v, strict=True)),
            *(f * a for f, a in zip(flip, omega, strict=True)),
        ]


def raw_pulses(pwm: list[float], motors: list[int], directions: list[int]) -> list[int]:
    """Pulses [us] of motors 1.. from the pulses of the law's thrusters, in whole microseconds.

    Args:
        motors: of each thruster its motor, from 1, with the sign of its pulse.
        directions: MOT_n_DIRECTION of each motor, which raw pulses do not pass through.
    """
    if len(pwm) != len(motors):
        raise Refused(f"the export has {len(pwm)} thrusters, and --motors has {len(motors)}")
    raw = [NEUTRAL] * len(motors)
    for pulse, motor in zip(pwm, motors, strict=True):
        n = abs(motor) - 1
        raw[n] = round(NEUTRAL + directions[n] * math.copysign(1.0, motor) * (pulse - NEUTRAL))
    if not all(LEAST <= each <= MOST for each in raw):
        raise Refused(f"pulses of {min(raw)} to {max(raw)} us: must be {LEAST} to {MOST}")
    return raw


def gate_frame(counter: int, session: int, directions: list[int], frame: int, export: int, pulses: list[int]) -> Any:
    """The message to the gate."""
    bits = sum(1 << n for n, direction in enumerate(directions) if direction < 0)
    payload = struct.pack("<IHBBBB16s", counter, session, 1, len(pulses), bits, frame, str(export).encode())
    payload += struct.pack(f"<{len(pulses)}H", *pulses)
    return mavlink.MAVLink_tunnel_message(1, 1, GATE_FRAME, len(payload), list(payload.ljust(128, b"\0")))


class Vehicle:
    """The autopilot at the other end of a MAVLink connection."""

    def __init__(self, place: str) -> None:
        self.link: Any = mavutil.mavlink_connection(place, source_system=255, source_component=191)
        self.last: dict[str, tuple[Any, float]] = {}
        self.parameters: dict[str, float] = {}
        self.gate: float | None = None
        self.counter, self.behind = 0, 0.0
        self.gate_heard, self.beat = -1e9, -1e9

    def listen(self, seconds: float) -> None:
        """Take what comes for so long, and send a heartbeat each second."""
        until = time.monotonic() + seconds
        while True:
            now = time.monotonic()
            if now - self.beat >= 1.0 and self.last:
                self.beat = now
                self.link.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
            message = self.link.recv_match(blocking=True, timeout=max(0.0, min(until - now, 0.05)))
            if message is not None and message.get_srcSystem() == 1 and message.get_srcComponent() == 1:
                self._take(message)
            if time.monotonic() >= until:
                return

    def _take(self, message: Any) -> None:
        kind, now = message.get_type(), time.monotonic()
        self.last[kind] = message, now
        if kind == "PARAM_VALUE":
            self.parameters[message.param_id] = message.param_value
        elif kind == "NAMED_VALUE_FLOAT" and message.name == "GATE":
            self.gate, self.gate_heard = message.value, now
        elif kind == "NAMED_VALUE_FLOAT" and message.name == "GATE_SEQ":
            self.behind = self.counter - message.value
        elif kind == "STATUSTEXT":
            print(message.text, flush=True)

    def wait(self, what: str, seconds: float, found: Any) -> None:
        until = time.monotonic() + seconds
        while not found():
            if time.monotonic() > until:
                raise Refused(f"no {what} within {seconds:g} s")
            self.listen(0.02)

    def read(self, names: list[str]) -> dict[str, float]:
        """Parameters as they are now: a value that came before it was asked for does not count."""
        self.listen(0.1)
        for name in names:
            self.parameters.pop(name, None)
        for _ in range(10):
            missing = [name for name in names if name not in self.parameters]
            if not missing:
                return {name: self.parameters[name] for name in names}
            for name in missing[:8]:
                self.link.mav.param_request_read_send(1, 1, name.encode(), -1)
            self.listen(0.2)
        raise Refused(f"{missing[0]} can't be read")

    def fresh(self, kind: str) -> Any:
        message, at = self.last.get(kind, (None, -1e9))
        return message if time.monotonic() - at <= FRESH_S else None

    def stop(self) -> str:
        """Why the law may not drive now; empty if it may."""
        heartbeat = self.last["HEARTBEAT"][0]
        if not heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED:
            return "disarmed"
        return "" if heartbeat.custom_mode == MANUAL else "not MANUAL"


def checked(vehicle: Vehicle, directions: list[int]) -> int:
    """FRAME_CONFIG, if the vehicle's parameters are as the law believes. Raises Refused."""
    motors = range(1, len(directions) + 1)
    wanted: dict[str, float] = {f"SERVO{n}_FUNCTION": 32 + n for n in motors}
    wanted |= {f"MOT_{n}_DIRECTION": directions[n - 1] for n in motors}
    found = vehicle.read([*wanted, "FRAME_CONFIG"])
    for name, value in wanted.items():
        if found[name] != value:
            raise Refused(f"{name} is {found[name]:g} on the vehicle, and not {value:g}")
    return int(found["FRAME_CONFIG"])


def drive(vehicle: Vehicle, law: Law, motors: list[int], directions: list[int], seconds: float, wait: float) -> None:
    """Let the law drive for so long. Raises Refused where it may not, or not any longer."""
    print("waits for an autopilot", flush=True)
    vehicle.wait("heartbeat of an autopilot", 30.0, lambda: "HEARTBEAT" in vehicle.last)
    for message in (mavlink.MAVLINK_MSG_ID_ATTITUDE, mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED):
        interval = 1e6 * law.period, *[0.0] * 5
        vehicle.link.mav.command_long_send(1, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message, *interval)
    frame = checked(vehicle, directions)
    vehicle.wait("gate in the autopilot", 5.0, lambda: time.monotonic() - vehicle.gate_heard < 1.5)
    print("waits until the vehicle is armed and in MANUAL", flush=True)
    vehicle.wait("armed vehicle in MANUAL", wait, lambda: not vehicle.stop())
    kinds = ("ATTITUDE", "LOCAL_POSITION_NED")
    vehicle.wait("pose and velocity", 10.0, lambda: all(vehicle.fresh(kind) for kind in kinds))
    attitude, position = (vehicle.last[kind][0] for kind in kinds)
    home = Home(attitude, position, law.start)
    session, said, neutrals = 1 + int.from_bytes(os.urandom(2), "little") % 65535, 0, 0
    begun = due = time.monotonic()
    while (now := time.monotonic()) - begun < seconds:
        if why := vehicle.stop():
            raise Refused(why)
        if now - vehicle.gate_heard > 1.5:
            raise Refused("the gate in the autopilot is silent")
        if now - begun > 1.5 and vehicle.gate != session:
            raise Refused("the gate is closed")
        if vehicle.gate == session and vehicle.behind * law.period > LATE_S:
            raise Refused(f"the gate is {vehicle.behind * law.period:.1f} s behind")
        attitude, position = (vehicle.fresh(kind) for kind in kinds)
        status, _, _, pwm = law(now - begun, home.measured(attitude, position) if attitude and position else None)
        if status != said:
            said = status
            print(f"{now - begun:.2f} s: the law has status {status}", flush=True)
        neutrals = neutrals + 1 if status < 0 else 0
        if neutrals * law.period > 1.0:
            raise Refused(f"the law has refused each call for a second, with status {status}")
        vehicle.counter += 1
        pulses = raw_pulses(pwm, motors, directions)
        vehicle.link.mav.send(gate_frame(vehicle.counter, session, directions, frame, law.export, pulses))
        due = max(due + law.period, now)
        vehicle.listen(due - time.monotonic())


def numbers(text: str) -> list[int]:
    found = [int(word) for word in text.split(",")]
    if sorted(map(abs, found)) != list(range(1, len(found) + 1)):
        raise argparse.ArgumentTypeError("must name each motor once, with a sign, as -1,-2,3")
    return found


def signs(text: str) -> list[int]:
    found = [int(word) for word in text.split(",")]
    if not set(found) <= {1, -1}:
        raise argparse.ArgumentTypeError("must be 1 or -1 for each motor, as 1,1,-1")
    return found


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="ardusub_sender.py", description=__doc__.splitlines()[0])
    parser.add_argument("connection", help="of pymavlink, as udpin:127.0.0.1:14551")
    parser.add_argument("about", type=Path, help="NAME.toml of the export")
    parser.add_argument("--motors", type=numbers, required=True, help="of each thruster its motor, with its sign")
    parser.add_argument("--directions", type=signs, help="MOT_n_DIRECTION of each motor, as tried in air [default: 1]")
    parser.add_argument("--port", type=int, default=9100, help="of the law's program, loop")
    parser.add_argument("--seconds", type=float, default=60.0, help="for which the law drives")
    parser.add_argument("--wait", type=float, default=600.0, help="for an armed vehicle in MANUAL [s]")
    given = parser.parse_args(arguments)
    directions = given.directions or [1] * len(given.motors)
    if len(directions) != len(given.motors):
        parser.error("--directions must have as many numbers as --motors")
    law = Law(tomllib.loads(given.about.read_text(encoding="utf-8")), given.port)
    try:
        drive(Vehicle(given.connection), law, given.motors, directions, given.seconds, given.wait)
    except Refused as why:
        print(f"ends: {why}", flush=True)
        return 3
    print("ends: the time is over", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
