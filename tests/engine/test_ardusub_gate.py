"""The gate for ArduSub: its script in a stand-in, frames of pymavlink, the program that sends them, a push."""

import contextlib
import importlib.util
import json
import math
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import tomllib
from collections import deque
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from uvms_mj import Scenario, simulate
from uvms_mj.engine.ardupilot import ArduPilot, motors_of, steps_of
from uvms_mj.engine.law_library import linking
from uvms_mj.engine.law_library.library import write_library
from uvms_mj.engine.law_library.linking import MACHINES
from uvms_mj.physics.frames import quat_from_euler_deg, rotation_matrix
from uvms_mj.setup.base import set_up

pytest.importorskip("lupa", reason="a real Lua 5.3 runs the script: pip install lupa")
pytest.importorskip("pymavlink", reason="the frames are those of pymavlink: pip install pymavlink")
os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ardusub_standin import INSTRUCTIONS, Standin

pytestmark = pytest.mark.filterwarnings("ignore:controller.name. .* takes the place of")
EXAMPLES = Path(__file__).parents[2] / "examples"
GATE = (EXAMPLES / "ardusub_gate.lua").read_text()
EXPORT = 123456789012345
PULSES = [1450, 1550, 1460, 1540, 1470, 1530, 1480, 1520]
NEUTRAL = [1500] * 8
MIXER = [1600] * 8
MS = 1e-3


def _sender():
    spec = importlib.util.spec_from_file_location("ardusub_sender", EXAMPLES / "ardusub_sender.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


sender = _sender()


def script(export=EXPORT):
    assert GATE.count("local EXPORT = ''") == 1
    return GATE.replace("local EXPORT = ''", f"local EXPORT = '{export}'")


class Sending:
    """Frames of a sender at 50 Hz, into a stand-in."""

    def __init__(self, standin, session=7, counter=0, source=255):
        self.standin, self.session, self.counter = standin, session, counter
        self.mav = mavlink.MAVLink(None, srcSystem=source, srcComponent=191)

    def wire(self, pulses=PULSES, directions=(1,) * 8, frame=2, export=EXPORT, counter=None):
        self.counter += 1
        number = self.counter if counter is None else counter
        message = sender.gate_frame(number, self.session, list(directions), frame, export, list(pulses))
        data = message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256
        return bytes(data)


def ran(standin, seconds, make=None):
    """Loops of a stand-in, with a frame each 20 ms: the time [s] since the beginning, and the pulses."""
    begun, rows = standin.us, []
    for _ in range(round(seconds / 0.0025)):
        if make and standin.us % 20000 == 0 and (data := make()):
            standin.give(data)
        at = (standin.us - begun) * 1e-6
        rows.append((at, standin.loop()))
    return rows


def first(rows, pulses):
    """When the pulses were first those [s]; None: never."""
    return next((t for t, each in rows if each == pulses), None)


@pytest.fixture
def opened():
    """A stand-in whose gate is open."""
    standin = Standin(script())
    sending = Sending(standin)
    rows = ran(standin, 1.0, sending.wire)
    assert rows[-1][1] == PULSES
    assert standin.texts == ["gate: loaded", "gate: open, session 7"]
    assert standin.floats["GATE"] == 7.0
    return standin, sending


def stops(rows, within):
    """The pulses of the session end, are neutral for some 100 ms, and the mixer has the motors until the end."""
    neutral, mixed = first(rows, NEUTRAL), first(rows, MIXER)
    assert neutral <= within
    assert 0.08 <= mixed - neutral <= 0.12
    assert all(pulses == MIXER for t, pulses in rows if t >= mixed)
    assert all(pulses in (PULSES, NEUTRAL, MIXER) for _, pulses in rows)


def test_a_frame_is_read_back_by_pymavlink():
    """Every field that the script unpacks by place is where pymavlink and the layout say."""
    data = Sending(None, session=517).wire(directions=(1, -1, 1, 1, 1, 1, 1, -1))
    message = mavlink.MAVLink(None).parse_buffer(bytearray(data))[0]
    assert (message.get_type(), message.payload_type, message.target_system) == ("TUNNEL", 40001, 1)
    payload = bytes(message.payload[: message.payload_length])
    *numbers, export = struct.unpack_from("<IHBBBB16s", payload)
    assert numbers == [1, 517, 1, 8, 0b10000010, 2]
    assert int(export.rstrip(b"\0")) == EXPORT
    assert list(struct.unpack_from("<8H", payload, 26)) == PULSES


@pytest.mark.parametrize("pulses", [PULSES, [1100] * 8, [1900] * 8, [1500] * 6, [1300, 1536] * 3 + [1537, 1280]])
def test_the_scripts_checksum_and_pulses_are_those_of_pymavlink(pulses):
    """The last payload ends with a zero byte, which MAVLink 2 leaves out."""
    standin = Standin(script(), n=len(pulses))
    sending = Sending(standin)
    assert ran(standin, 0.6, lambda: sending.wire(pulses, (1,) * len(pulses)))[-1][1] == pulses
    assert standin.floats["GATE_BAD"] == 0.0


def test_every_bit_of_a_frame_is_guarded():
    """A frame with one bit changed, wherever it is behind the mark, gives no pulses; neither does one that is cut."""
    standin = Standin(script())
    data = Sending(standin).wire()
    for place in range(1, len(data)):
        for bit in range(8):
            standin.start()
            standin.loops = [0] * 8
            damaged = bytearray(data)
            damaged[place] ^= 1 << bit
            if place == 1 and damaged[1] > len(data) - 12:
                damaged += bytes(damaged[1] - len(data) + 12)
            standin.give(bytes(damaged))
            assert standin.loop() == MIXER, (place, bit)
    standin.start()
    standin.give(data)
    assert standin.loop() == PULSES


def test_without_an_export_the_script_opens_for_nobody():
    standin = Standin(GATE)
    rows = ran(standin, 0.5, Sending(standin).wire)
    assert {tuple(each) for _, each in rows} == {tuple(MIXER)}
    assert standin.texts[-1] == "gate: refused, EXPORT is not set"


def test_a_program_that_is_killed_leaves_neutral_pulses_and_then_the_mixer(opened):
    standin, _ = opened
    rows = ran(standin, 1.0)
    stops(rows, 0.12)
    assert standin.texts[-1] == "gate: closed, no fresh frames"


def test_a_script_that_ends_leaves_the_mixer(opened):
    standin, sending = opened
    standin.ended = "killed"
    rows = ran(standin, 1.0, sending.wire)
    assert first(rows, MIXER) <= 0.12
    assert all(pulses == MIXER for t, pulses in rows if t > 0.12)


def setting(name, value):
    return lambda standin: setattr(standin, name, value)


def parameter(name, value):
    return lambda standin: standin.parameters.update({name: value})


EVENTS = {
    "disarmed": (setting("armed", False), 0.01, "disarmed"),
    "another mode": (setting("mode", 0), 0.01, "not MANUAL"),
    "a motor turns the other way": (parameter("MOT_3_DIRECTION", -1.0), 1.01, "MOT_3_DIRECTION"),
    "a direction is none": (parameter("MOT_3_DIRECTION", 0.5), 1.01, "MOT_3_DIRECTION"),
    "an output is no motor": (parameter("SERVO5_FUNCTION", 0.0), 1.01, "SERVO5_FUNCTION"),
    "another frame": (parameter("FRAME_CONFIG", 1.0), 1.01, "FRAME_CONFIG"),
}


@pytest.mark.parametrize(("event", "within", "said"), EVENTS.values(), ids=EVENTS)
def test_an_event_closes_the_gate_and_ends_the_session(opened, event, within, said):
    """The same session stays closed when all is well again; a new one opens."""
    standin, sending = opened
    before = standin.armed, standin.mode, dict(standin.parameters)
    event(standin)
    stops(ran(standin, 2.0, sending.wire), within)
    assert standin.texts[-1] == f"gate: closed, {said}"
    standin.armed, standin.mode, standin.parameters = before
    rows = ran(standin, 1.5, sending.wire)
    assert {tuple(each) for _, each in rows} == {tuple(MIXER)}
    assert ran(standin, 0.1, Sending(standin, 8).wire)[-1][1] == PULSES


@pytest.mark.parametrize(("event", "within", "said"), EVENTS.values(), ids=EVENTS)
def test_what_closes_the_gate_keeps_it_closed_from_the_start(event, within, said):
    standin = Standin(script())
    event(standin)
    rows = ran(standin, 1.5, Sending(standin).wire)
    assert {tuple(each) for _, each in rows} == {tuple(MIXER)}
    assert standin.texts[1:] == [f"gate: refused, {said}"]


def wrong(sending, **changes):
    return lambda: sending.wire(**changes)


BAD = {
    "the same frame again": {"counter": 50},
    "a counter that goes back": {"counter": 3},
    "zeros": {"pulses": [0] * 8},
    "one pulse too long": {"pulses": [*PULSES[:-1], 1901]},
    "one pulse too short": {"pulses": [1099, *PULSES[1:]]},
}


@pytest.mark.parametrize("changes", BAD.values(), ids=BAD)
def test_frames_that_are_no_orders_are_as_none(opened, changes):
    standin, sending = opened
    stops(ran(standin, 0.95, wrong(sending, **changes)), 0.12)
    assert standin.texts[-1] == "gate: closed, no fresh frames"
    assert standin.floats["GATE_BAD"] > 20.0


@pytest.mark.parametrize("changes", [{"export": EXPORT + 1}, {"directions": (1, -1, *[1] * 6)}, {"frame": 1}])
def test_a_session_that_believes_something_else_is_refused(changes):
    """Another export, and parameters as they were when they were read."""
    standin = Standin(script())
    rows = ran(standin, 0.5, wrong(Sending(standin), **changes))
    assert {tuple(each) for _, each in rows} == {tuple(MIXER)}


@pytest.mark.parametrize("newest", [True, False])
@pytest.mark.parametrize("source", [254, 255])
def test_another_system_and_a_second_sender_are_not_heard(opened, source, newest):
    """Their frames come before those of the session, and behind them."""
    standin, sending = opened
    other = Sending(standin, 9, source=source)

    def both():
        frames = [sending.wire(), other.wire([1700] * 8)]
        standin.give(frames[not newest])
        return frames[newest]

    assert {tuple(each) for _, each in ran(standin, 0.8, both)} == {tuple(PULSES)}
    stops(ran(standin, 0.95, Sending(standin, 10, source=254).wire), 0.12)


def test_a_frame_for_another_vehicle_is_left_alone():
    standin = Standin(script(), SYSID_THISMAV=2.0)
    rows = ran(standin, 0.6, Sending(standin).wire)
    assert {tuple(each) for _, each in rows} == {tuple(MIXER)}
    assert standin.floats["GATE_OK"] == 0.0


def test_frames_of_a_session_that_is_over_take_no_place(opened):
    """They do not come between the frames of a new session, which is late for a moment."""
    standin, old = opened
    standin.armed = False
    ran(standin, 0.1, Sending(standin, 8).wire)  # the new one is refused, and the first one is silent
    old.session, old.counter = 8, 10
    standin.armed = True
    ran(standin, 1.2)
    new = Sending(standin, 9)
    assert ran(standin, 2.0, new.wire)[-1][1] == PULSES
    ran(standin, 0.3)
    ran(standin, 0.1, old.wire)
    assert ran(standin, 0.1, new.wire)[-1][1] == PULSES


def test_a_sender_that_was_silent_for_a_second_must_begin_anew(opened):
    standin, sending = opened
    ran(standin, 0.5)
    assert ran(standin, 0.1, sending.wire)[-1][1] == PULSES  # it was late, and the vehicle is as it was
    ran(standin, 1.2)
    assert first(ran(standin, 0.5, sending.wire), PULSES) is None
    assert ran(standin, 0.1, Sending(standin, 8).wire)[-1][1] == PULSES


def test_a_script_that_is_started_again_waits_for_a_new_session(opened):
    """It has forgotten which sessions are over, but a session begins with its first frames."""
    standin, sending = opened
    standin.armed = False
    ran(standin, 0.5, sending.wire)
    standin.armed = True
    standin.start()
    rows = ran(standin, 0.5, sending.wire)
    assert {tuple(each) for _, each in rows} == {tuple(MIXER)}
    assert ran(standin, 0.1, Sending(standin, 8).wire)[-1][1] == PULSES


def test_a_script_that_came_late_does_not_act_on_an_old_decision(opened):
    """The mode is asked for 0.7 s, in which the vehicle is disarmed: no pulse of the session is forced afterwards."""
    standin, sending = opened
    standin.give(sending.wire())
    standin.stalls_us = 700_000
    standin.armed = False
    rows = ran(standin, 0.5)
    assert first(rows, PULSES) is None


@pytest.mark.parametrize("flood", ["of the sender", "damaged", "foreign"])
def test_a_full_queue_does_not_end_the_script(opened, flood):
    """More frames than the queue holds at each call: the script stays below the limit of instructions."""
    standin, sending = opened
    foreign = Sending(standin, 9, source=254)

    def many():
        for _ in range(30):
            data = bytearray(foreign.wire() if flood == "foreign" else sending.wire())
            data[30] ^= flood == "damaged"
            standin.give(bytes(data))

    rows = ran(standin, 1.0, many)
    assert not standin.ended
    assert standin.instructions() < INSTRUCTIONS / 2
    assert (rows[-1][1] == PULSES) == (flood == "of the sender")


def test_the_standin_ends_a_script_that_takes_too_long():
    standin = Standin("local function f() for k = 1, 100000 do local x = k * k end return f, 5 end return f, 5")
    ran(standin, 0.1)
    assert "too many instructions" in standin.ended


# the program that sends, and the law

POOL = {
    "vehicle.model": "bluerov2_heavy",
    "thrusters.name": "t200",
    "current.speed": 0.0,
}
LAW = POOL | {"controller.period": 0.02, "actuation.name": "scaled", "observer.name": "momentum_observer"}
MOTORS = [-1, -2, -3, -4, -5, 6, 7, -8]


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Impedance control of a Heavy at 50 Hz: its folder, NAME.toml, and the program loop."""
    pytest.importorskip("ziglang")
    machine = MACHINES["x86_64"]
    if linking.emulator(machine) is None:
        pytest.skip("no qemu-x86_64")
    folder = tmp_path_factory.mktemp("impedance")
    scenario = Scenario.load("push_soft_wall_100hz", LAW, "impedance")
    write_library(scenario, folder, ["x86_64"], test=False)
    program = linking.program(machine, folder / "x86_64" / "libimpedance.a", folder / "loop.c", folder)
    return folder, tomllib.loads((folder / "impedance.toml").read_text()), [*linking.emulator(machine), str(program)]


@pytest.fixture
def port(exported):
    """A port on which the program answers."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with subprocess.Popen([*exported[2], str(port)]) as process:
        time.sleep(0.1)
        yield port
        process.kill()


def test_the_motors_are_those_of_the_plant():
    B = set_up(Scenario.load("push_wall", POOL)).vehicle.B
    name, motors, signs = motors_of(B)
    assert name == "vectored_6dof"
    assert [int((k + 1) * sign) for k, sign in zip(motors, signs, strict=True)] == MOTORS


@pytest.mark.parametrize("yaw", [0.0, 2.5])
def test_measurements_are_turned_as_the_plant_turns_them(yaw):
    """The inverse of what a plant answers an autopilot, where the law begins with some heading."""
    angles = np.array([0.2, -0.3, 0.7])
    quat = np.array(quat_from_euler_deg(*np.rad2deg(angles * [1, -1, -1])))  # in W, of FLU
    p, nu = np.array([1.0, 2.0, -0.5]), np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    flip = np.array([1.0, -1.0, -1.0])
    c, s = math.cos(yaw), math.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    here = np.array([3.0, -4.0, 5.0])
    at = SimpleNamespace(**dict(zip("xyz", here + turn @ (flip * p), strict=True)))
    R = np.array(rotation_matrix(quat)).reshape(3, 3)
    v_ned = turn @ (flip * (R @ nu[:3]))
    at.vx, at.vy, at.vz = v_ned
    attitude = SimpleNamespace(roll=angles[0], pitch=angles[1], yaw=angles[2] + yaw)
    attitude.rollspeed, attitude.pitchspeed, attitude.yawspeed = flip * nu[3:]
    begun = SimpleNamespace(yaw=yaw), SimpleNamespace(**dict(zip("xyz", here, strict=True)))
    found = np.array(sender.Home(*begun, [0.5, 0.0, 0.0]).measured(attitude, at))
    np.testing.assert_allclose(found[:3], p + np.array([0.5, 0.0, 0.0]), atol=1e-12)
    np.testing.assert_allclose(found[3:7] * np.sign(found[3]), quat * np.sign(quat[0]), atol=1e-12)
    np.testing.assert_allclose(found[7:], nu, atol=1e-12)


def test_raw_pulses_have_the_vehicles_directions():
    pwm = [1400.4, 1500.0, 1612.6]
    assert sender.raw_pulses(pwm, [2, -1, 3], [1, 1, 1]) == [1500, 1400, 1613]
    assert sender.raw_pulses(pwm, [2, -3, 1], [1, -1, -1]) == [1613, 1600, 1500]
    with pytest.raises(sender.Refused, match="must be 1100 to 1900"):
        sender.raw_pulses([1901.0], [1], [1])
    with pytest.raises(sender.Refused, match="the export has 1 thrusters, and --motors has 2"):
        sender.raw_pulses([1500.0], [1, 2], [1, 1])


def test_saturation_keeps_the_direction_of_the_wrench(exported, port):
    """Far from the reference the demanded wrench is beyond the thrusters: what they give has its direction to 1e-9."""
    B = set_up(Scenario.load("push_soft_wall_100hz", LAW, "impedance")).vehicle.B
    random, greatest = np.random.default_rng(3), []
    for _ in range(20):
        law = sender.Law(exported[1], port)
        p, nu = random.normal(size=3), random.normal(size=6)
        status, tau_cmd, thrusts, pwm = law(0.0, [*(20.0 * p), 1.0, 0.0, 0.0, 0.0, *(3.0 * nu)])
        assert status == 0
        given = B @ thrusts
        share = np.linalg.norm(given) / np.linalg.norm(tau_cmd)
        np.testing.assert_allclose(given, share * np.array(tau_cmd), atol=1e-9 * np.linalg.norm(tau_cmd))
        greatest.append(share)
        assert all(1100 <= each <= 1900 for each in sender.raw_pulses(pwm, MOTORS, [1] * 8))
    assert max(greatest) < 0.9


class Autopilot(threading.Thread):
    """The stand-in at 400 Hz in lockstep with a plant; at 50 Hz the law has its measurements and sends a frame."""

    def __init__(self, plant, law, export, seconds):
        super().__init__(daemon=True)
        self.plant, self.law, self.loops = plant, law, round(400 * seconds)
        self.standin = Standin(script(export))
        self.standin.mixer = NEUTRAL
        self.sending, self.statuses, self.commanded = Sending(self.standin), [], []

    def run(self):
        home = None
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.settimeout(0.05)
            for k in range(self.loops):
                data = struct.pack("<HHI16H", 18458, 400, k, *self.standin.loop(), *[0] * 8)
                answer = None
                while answer is None:
                    peer.sendto(data, ("127.0.0.1", self.plant))
                    with contextlib.suppress(TimeoutError):
                        answer = json.loads(peer.recv(4096))
                if k % 8:
                    continue
                attitude, position = self.seen(answer)
                home = home or sender.Home(attitude, position, self.law.start)
                status, _, _, pwm = self.law(k * 0.0025, home.measured(attitude, position))
                self.statuses.append(status)
                pulses = sender.raw_pulses(pwm, MOTORS, [1] * 8)
                self.commanded.append(pulses)
                self.standin.give(self.sending.wire(pulses, export=self.law.export))

    @staticmethod
    def seen(answer):
        """ATTITUDE and LOCAL_POSITION_NED, whose numbers are floats."""
        w, x, y, z = answer["quaternion"]
        angles = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)), math.asin(2 * (w * y - z * x))
        yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        numbers = [*angles, yaw, *answer["imu"]["gyro"], *answer["position"], *answer["velocity"]]
        names = ["roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed", "x", "y", "z", "vx", "vy", "vz"]
        each = SimpleNamespace(**dict(zip(names, map(float, np.float32(numbers)), strict=True)))
        return each, each


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [20.0, pytest.param(60.0, marks=pytest.mark.long)])
def test_a_push_on_a_wall_through_the_gate(exported, port, seconds):
    """In the pool of `uvms-mj sitl`: the law's push through gate and whole microseconds is that of the law in the
    simulation, within a tenth of what a microsecond is, 0.23 N."""
    keys = POOL | {"controller.name": "external", "actuation.name": "autopilot", "simulation.duration": seconds}
    keys["simulation.timestep"] = 5e-4  # a whole number of steps a loop
    scenario = Scenario.load("push_soft_wall_100hz", keys)
    _, motors, signs = motors_of(set_up(scenario).vehicle.B)
    peer = ArduPilot(motors, signs, steps_of(400.0, scenario.simulation.timestep), port=0)
    law = sender.Law(exported[1], port)
    pilot = Autopilot(peer._socket.getsockname()[1], law, law.export, seconds)
    with contextlib.closing(peer):
        pilot.start()
        trace = simulate(scenario, engine="free_body", peer=peer)
        pilot.join(30.0)
    assert set(pilot.statuses) == {0}
    assert pilot.standin.texts == ["gate: loaded", "gate: open, session 7"]
    assert pilot.standin.floats["GATE_BAD"] == 0.0
    ours = simulate(Scenario.load("push_soft_wall_100hz", LAW | {"simulation.duration": seconds}, "impedance"))
    late = trace.t > seconds - 5.0
    assert trace.push[late].min() > 0.0
    assert trace.push[late].mean() == pytest.approx(ours.push[late].mean(), abs=0.023)


class Flying(threading.Thread):
    """The stand-in in real time at the other end of a MAVLink connection, at rest. ``event`` happens to it 0.4 s after
    its gate has opened."""

    def __init__(self, export, event=None):
        super().__init__(daemon=True)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.place = f"udpin:127.0.0.1:{self.port}"
        self.standin = Standin(script(export))
        self.event, self.measures, self.rows, self.last_frame_us, self.ends = event, True, [], 0, False
        self.frames, self.happened_us = 0, None
        self.delay_us, self.on_the_way = 0, deque()

    def run(self):
        standin = self.standin
        link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{self.port}", source_system=1, source_component=1)
        begun, sent, told, floats, opened = time.monotonic(), {}, 0, 0, None

        def due(what, seconds):
            if standin.us - sent.get(what, -1e9) < 1e6 * seconds:
                return False
            sent[what] = standin.us
            return True

        with contextlib.closing(link):
            while not self.ends:
                time.sleep(0.002)
                while standin.us < 1e6 * (time.monotonic() - begun):
                    self.rows.append((standin.us, standin.loop()))
                while (message := link.recv_match()) is not None:
                    if message.get_type() == "PARAM_REQUEST_READ" and message.param_id in standin.parameters:
                        value = standin.parameters[message.param_id]
                        link.mav.param_value_send(message.param_id.encode(), value, 9, 1, 0)
                    elif message.get_type() == "TUNNEL":
                        self.on_the_way.append((standin.us + self.delay_us, bytes(message.get_msgbuf())))
                while self.on_the_way and self.on_the_way[0][0] <= standin.us:
                    standin.give(self.on_the_way.popleft()[1])
                    self.last_frame_us, self.frames = standin.us, self.frames + 1
                if due("heartbeat", 0.2):
                    link.mav.heartbeat_send(12, 3, 1 | 128 * standin.armed, standin.mode, 4)
                for name, value in standin.sent[floats:]:
                    link.mav.named_value_float_send(0, name.encode(), value)
                floats = len(standin.sent)
                if self.measures and due("measured", 0.02):
                    link.mav.attitude_send(0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
                    link.mav.local_position_ned_send(0, 1.0, 2.0, 5.0, 0.0, 0.0, 0.0)
                for text in standin.texts[told:]:
                    link.mav.statustext_send(6, text.encode())
                    opened = standin.us if "open" in text and opened is None else opened
                told = len(standin.texts)
                if self.event and opened is not None and standin.us > opened + 400_000:
                    self.happened_us = standin.us
                    self.event(self)
                    self.event = None

    def after(self, seconds=0.5):
        """Let it go on for so long, and end."""
        time.sleep(seconds)
        self.ends = True
        self.join(10.0)
        assert not self.is_alive()


def arguments(flying, exported, port, *more):
    about = exported[0] / "impedance.toml"
    motors = ",".join(map(str, MOTORS))
    return [flying.place, str(about), f"--motors={motors}", "--port", str(port), "--wait", "3", *more]


def of_standin(change):
    return lambda flying: change(flying.standin)


def neutral_and_mixed(flying):
    """The pulses are neutral within 0.3 s of the last frame, and then the mixer's until the end."""
    rows = [(us - flying.last_frame_us, pulses) for us, pulses in flying.rows if us >= flying.last_frame_us]
    neutral, mixed = first(rows, NEUTRAL), first(rows, MIXER)
    assert neutral <= 300_000
    assert neutral < mixed <= 300_000
    assert all(pulses == MIXER for us, pulses in rows if us >= mixed)


@pytest.mark.slow
def test_the_sender_drives_and_leaves_the_mixer(exported, port, capsys):
    flying = Flying(exported[1]["library"]["export"])
    flying.start()
    assert sender.main(arguments(flying, exported, port, "--seconds", "2")) == 0
    flying.after()
    said = capsys.readouterr().out
    assert "gate: open, session" in said
    assert "ends: the time is over" in said
    assert flying.frames > 50
    forced = {tuple(pulses) for _, pulses in flying.rows} - {tuple(MIXER), tuple(NEUTRAL)}
    assert forced
    neutral_and_mixed(flying)


@pytest.mark.slow
def test_a_sender_that_is_killed_leaves_neutral_pulses_and_then_the_mixer(exported, port):
    """With kill -9, while the gate is open."""
    flying = Flying(exported[1]["library"]["export"], event=lambda _: process.send_signal(signal.SIGKILL))
    flying.start()
    command = [sys.executable, str(EXAMPLES / "ardusub_sender.py"), *arguments(flying, exported, port)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    assert process.wait(20.0) == -signal.SIGKILL
    process.communicate()
    flying.after(1.0)
    assert flying.frames > 10
    assert flying.standin.texts[-1] == "gate: closed, no fresh frames"
    neutral_and_mixed(flying)


DURING = {
    "disarmed": (of_standin(setting("armed", False)), "ends: disarmed"),
    "another mode": (of_standin(setting("mode", 0)), "ends: not MANUAL"),
    "a parameter": (of_standin(parameter("MOT_3_DIRECTION", -1.0)), "ends: the gate is closed"),
    "the script": (of_standin(setting("ended", "killed")), "ends: the gate in the autopilot is silent"),
    "the link": (
        lambda flying: setattr(flying, "delay_us", 700_000),
        ("s behind", "ends: the gate is closed"),
    ),  # who is first
    "no measurements": (lambda flying: setattr(flying, "measures", False), "refused each call for a second"),
}


@pytest.mark.slow
@pytest.mark.parametrize(("event", "said"), DURING.values(), ids=DURING)
def test_the_sender_ends_and_says_why(exported, port, capsys, event, said):
    wanted = [said] if isinstance(said, str) else said
    for _ in range(3):  # a machine that is busy for .3 s has the gate closed before the event does it
        flying = Flying(exported[1]["library"]["export"], event)
        flying.start()
        assert sender.main(arguments(flying, exported, port, "--seconds", "20")) == 3
        flying.after(0.5 + 1e-6 * flying.delay_us)
        out = capsys.readouterr().out
        if any(each in out for each in wanted) or "ends: the gate is closed" not in out:
            break
    assert flying.frames > 10
    assert any(each in out for each in wanted), out
    late = [pulses for us, pulses in flying.rows if us > max(flying.happened_us + 1_400_000, flying.last_frame_us)]
    if "refused" in said:  # neutral pulses of the law, through an open gate
        assert {tuple(pulses) for pulses in late} <= {tuple(NEUTRAL), tuple(MIXER)}
    assert flying.rows[-1][1] == MIXER


BEFORE = {
    "a motor turns the other way": (parameter("MOT_3_DIRECTION", -1.0), (), "MOT_3_DIRECTION is -1 on the vehicle"),
    "an output is no motor": (parameter("SERVO5_FUNCTION", 0.0), (), "SERVO5_FUNCTION is 0 on the vehicle, and not 37"),
    "told otherwise": (lambda _: None, ("--directions=1,1,-1,1,1,1,1,1",), "MOT_3_DIRECTION is 1 on the vehicle"),
    "no such parameter": (lambda standin: standin.parameters.pop("MOT_8_DIRECTION"), (), "MOT_8_DIRECTION can't be"),
    "no script": (setting("ended", "killed"), (), "no gate in the autopilot within 5 s"),
    "disarmed": (setting("armed", False), (), "no armed vehicle in MANUAL within 3 s"),
    "no program": (lambda _: None, ("--port", "1"), "the law's program does not answer"),
    "other motors": (lambda _: None, ("--motors=1,2,3,4,5,6",), "the export has 8 thrusters, and --motors has 6"),
}


@pytest.mark.slow
@pytest.mark.parametrize(("change", "more", "said"), BEFORE.values(), ids=BEFORE)
def test_the_sender_refuses_what_is_not_as_told(exported, port, capsys, change, more, said):
    flying = Flying(exported[1]["library"]["export"])
    change(flying.standin)
    flying.start()
    assert sender.main(arguments(flying, exported, port, *more)) == 3
    flying.after(0.2)
    assert f"ends: {said}" in capsys.readouterr().out
    assert flying.frames == 0
    assert {tuple(pulses) for _, pulses in flying.rows} == {tuple(MIXER)}


def test_another_export_is_refused(exported, port):
    about = {**exported[1], "library": exported[1]["library"] | {"export": 5}}
    with pytest.raises(sender.Refused, match=r"is export \d+, and not 5"):
        sender.Law(about, port)(0.0, [0.0, 0.0, 0.0, 1.0, *[0.0] * 9])


def test_an_export_with_a_kalman_filter_is_refused(exported, port):
    """ArduSub gives an estimate, and no samples of its sensors."""
    library = exported[1]["library"]
    about = {**exported[1], "library": library | {"stages": ["navigation", *library["stages"]]}}
    with pytest.raises(sender.Refused, match=r"export it with navigation.name=perfect"):
        sender.Law(about, port)(0.0, [0.0, 0.0, 0.0, 1.0, *[0.0] * 9])


@pytest.mark.parametrize("more", ["--motors=1,1", "--motors=0,1", "--directions=1,2,1,1,1,1,1,1", "--directions=1"])
def test_wrong_arguments_end_with_status_2(tmp_path, more):
    (tmp_path / "law.toml").write_text("")
    with pytest.raises(SystemExit) as ended:
        sender.main(["udpin:127.0.0.1:1", str(tmp_path / "law.toml"), "--motors=1,2", more])
    assert ended.value.code == 2
