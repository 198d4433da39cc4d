"""An autopilot in the loop: packets byte for byte, frames in lockstep, and the geometry of ArduSub's frames."""

import json
import re
import socket
import struct
import threading
import time
import warnings

import numpy as np
import pytest

from uvms_mj import InputError, Scenario, simulate
from uvms_mj.engine.ardupilot import FRAMES, ArduPilot, Servo, given_motors, motors_of, reply, steps_of
from uvms_mj.errors import HostWarning
from uvms_mj.physics.frames import quat_from_euler_deg, rotation_matrix
from uvms_mj.records.mcap import McapLog
from uvms_mj.records.trace import Trace
from uvms_mj.setup.base import set_up

HEAVY = {
    "vehicle.model": "bluerov2_heavy",
    "controller.name": "external",
    "actuation.name": "autopilot",
    "thrusters.name": "t200",
    "current.speed": 0.0,
}
NEUTRAL = [1500] * 8


def packet(frame: int, pwm: list[int] = NEUTRAL, rate: int = 400, channels: int = 16) -> bytes:
    magic = {16: 18458, 32: 29569}[channels]
    return struct.pack(f"<HHI{channels}H", magic, rate, frame, *pwm, *[0] * (channels - len(pwm)))


def found(text: str) -> dict[str, list[float]]:
    """What ArduPilot's older parser finds: it goes to the first match of a section, then of a key, then of a number."""
    values = {}
    for section, key in (
        ("", "timestamp"),
        ("imu", "gyro"),
        ("imu", "accel_body"),
        ("", "position"),
        ("", "quaternion"),
        ("", "velocity"),
    ):
        rest = text[text.index(f'"{section}"') :] if section else text
        rest = rest[rest.index(f'"{key}":') + len(key) + 3 :]
        numbers = re.match(r"\[([^\]\s]*)\]|([^,}\s]*)", rest)
        values[key] = [float(word) for word in (numbers[1] or numbers[2]).split(",")]
    return values


def test_a_servo_packet_is_read_byte_for_byte():
    data = bytes.fromhex("1a48 9001 07000000".replace(" ", "")) + bytes.fromhex("dc05" * 8 + "0000" * 8)
    assert Servo.of(data) == Servo(400, 7, (1500,) * 8 + (0,) * 8)
    wide = packet(3, channels=32)
    assert wide[:2] == bytes.fromhex("8173")
    assert Servo.of(wide) == Servo(400, 3, (1500,) * 8 + (0,) * 24)


@pytest.mark.parametrize(
    "noise", [b"", b"\x1a", packet(1)[:-1], packet(1) + b"\0", b"\0" * 40, packet(1, channels=32)[:40]]
)
def test_noise_is_no_packet(noise):
    assert Servo.of(noise) is None


def test_the_answer_is_read_by_both_parsers_to_the_last_bit():
    numbers = np.random.default_rng(1).normal(size=(5, 4)) * 10.0 ** np.arange(-9, 11, 4)[:, None]
    given = numbers[0, :3], numbers[1, :3], numbers[2, :3], numbers[3], numbers[4, :3]
    data = reply(1.25, *given)
    assert data.startswith(b"\n{")
    assert data.endswith(b"}\n")
    assert b" " not in data
    strict = json.loads(data)
    searched = found(data.decode())
    for key, values in zip(("gyro", "accel_body", "position", "quaternion", "velocity"), given, strict=True):
        assert searched[key] == values.tolist() == {**strict, **strict["imu"]}[key]
    assert searched["timestamp"] == [1.25] == [strict["timestamp"]]


def test_an_answer_byte_for_byte():
    data = reply(0.0025, (0.0, 0.5, -1.0), (0.0, 0.0, -9.81), (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), (0.1, 0.0, 0.0))
    assert data == (
        b'\n{"timestamp":0.0025,"imu":{"gyro":[0.0,0.5,-1.0],"accel_body":[0.0,0.0,-9.81]},'
        b'"position":[1.0,2.0,3.0],"quaternion":[1.0,0.0,0.0,0.0],"velocity":[0.1,0.0,0.0]}\n'
    )


@pytest.mark.parametrize(("model", "frame"), [("bluerov2_heavy", "vectored_6dof"), ("bluerov2", "vectored")])
def test_each_motor_acts_as_its_frame_says(model, frame):
    """A pulse width above 1500 us of each motor gives forces and moments of the signs of ArduSub's factors."""
    B = set_up(Scenario.load("push_wall", {"vehicle.model": model})).vehicle.B
    name, motors, signs = motors_of(B)
    assert name == frame
    assert sorted(motors) == list(range(len(FRAMES[frame])))
    for k, (motor, sign) in enumerate(zip(motors, signs, strict=True)):
        surge, sway, heave, roll, pitch, yaw = sign * B[:, k] * [1, -1, -1, 1, -1, -1]  # in FRD
        wrench = np.array([roll, pitch, yaw, -heave, surge, sway])  # throttle is up
        factors = np.array(FRAMES[frame][motor])
        assert (np.sign(wrench)[factors != 0] == factors[factors != 0]).all(), motor


def test_motors_may_be_given():
    motors, signs = given_motors("2,-1,3", 3)
    assert motors.tolist() == [1, 0, 2]
    assert signs.tolist() == [1.0, -1.0, 1.0]
    for wrong in ("1,2", "1,1,2", "0,1,2", "a,b,c"):
        with pytest.raises(InputError, match="must be 3 motor numbers"):
            given_motors(wrong, 3)
    with pytest.raises(InputError, match="none of ArduSub's frames"):
        motors_of(np.eye(6))


def test_a_rate_divides_the_step_rate():
    assert steps_of(400.0, 1e-4) == 25
    for rate in (333.0, 5.0, 2e4, 0.0):
        with pytest.raises(InputError, match="must be above 10 Hz and divide the step rate"):
            steps_of(rate, 1e-4)


class Pilot(threading.Thread):
    """An autopilot that blocks for an answer, and sends a frame again without one. Its clock is the answers'."""

    def __init__(self, port: int, frames: int, pwm=lambda frame: NEUTRAL, disturb=None, first: int = 0) -> None:
        super().__init__(daemon=True)
        self.port, self.frames, self.pwm, self.disturb, self.first = (
            port,
            frames,
            pwm,
            disturb or (lambda *_: [1]),
            first,
        )
        self.times: list[float] = []
        self.answers: list[bytes] = []

    def run(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.settimeout(0.05)
            for frame in range(self.first, self.first + self.frames):
                data = packet(frame, self.pwm(frame))
                while True:
                    for copies in self.disturb(frame):
                        for _ in range(copies):
                            peer.sendto(data, ("127.0.0.1", self.port))
                    try:
                        answer = peer.recv(4096)
                        while json.loads(answer)["timestamp"] <= (self.times[-1] if self.times else -1.0):
                            answer = peer.recv(4096)  # a second copy of an earlier answer
                        break
                    except TimeoutError:
                        continue
                self.times.append(json.loads(answer)["timestamp"])
                self.answers.append(answer)


def session(frames: int, rate: float = 1000.0, sinks=(), keys=(), **pilot) -> tuple[Trace, Pilot, ArduPilot]:
    scenario = Scenario.load("push_wall", {**HEAVY, **dict(keys), "simulation.duration": frames / rate})
    _, motors, signs = motors_of(set_up(scenario).vehicle.B)
    peer = ArduPilot(motors, signs, steps_of(rate, 1e-4), port=0)
    port = peer._socket.getsockname()[1]
    try:
        other = Pilot(port, frames, **pilot)
        other.start()
        trace = simulate(scenario, engine="free_body", peer=peer, sinks=sinks)
        other.join(30.0)
    finally:
        peer.close()
    return trace, other, peer


def forward(frame: int) -> list[int]:
    return [1300, 1300, 1700, 1700, 1500, 1500, 1500, 1500] if frame > 20 else NEUTRAL


def test_a_frame_is_stepped_once_and_the_log_has_its_number_and_pulse_widths(tmp_path):
    trace, pilot, peer = session(300, sinks=[McapLog(tmp_path / "run.mcap")], pwm=forward)
    np.testing.assert_allclose(pilot.times, 1e-3 * np.arange(1, 301), rtol=2e-8)
    counts = {**vars(peer.counts), "repeated": 0}  # while the run began
    assert counts == {**dict.fromkeys(counts, 0), "frames": 300}
    read = Trace.load(tmp_path / "run.mcap")
    assert np.array_equal(read["frame"][:-1, 0], np.minimum(np.arange(300), 299))
    assert read.pwm_cmd[-1].tolist() == [1700.0, 1700.0, 1300.0, 1300.0, 1500.0, 1500.0, 1500.0, 1500.0]
    assert read.nu[-1, 0] > 0.1
    again, other, _ = session(300, pwm=forward)
    assert pilot.answers == other.answers
    for signal in trace.signals:
        np.testing.assert_array_equal(trace[signal.name], again[signal.name])


@pytest.mark.slow
def test_lost_repeated_and_late_packets_neither_step_twice_nor_lose_a_frame():
    random = np.random.default_rng(0)
    clean, _, _ = session(500, pwm=forward)

    def disturb(frame: int):
        return [0 if random.random() < 0.1 else 2 if random.random() < 0.05 else 1]

    trace, pilot, peer = session(500, pwm=forward, disturb=disturb)
    assert peer.counts.frames == 500
    assert peer.counts.skipped == peer.counts.restarts == 0
    assert peer.counts.repeated > 15
    np.testing.assert_allclose(pilot.times, 1e-3 * np.arange(1, 501), rtol=2e-8)
    np.testing.assert_array_equal(trace.p_WB, clean.p_WB)


def test_an_autopilot_that_is_started_again_goes_on(monkeypatch):
    monkeypatch.setattr("uvms_mj.engine.ardupilot.SILENT_S", 0.3)
    scenario = Scenario.load("push_wall", {**HEAVY, "simulation.duration": 0.2})
    _, motors, signs = motors_of(set_up(scenario).vehicle.B)
    peer = ArduPilot(motors, signs, 10, port=0)
    port = peer._socket.getsockname()[1]
    first, second = Pilot(port, 100), Pilot(port, 100)

    def both() -> None:
        first.run()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.sendto(b"noise", ("127.0.0.1", port))
        second.run()

    thread = threading.Thread(target=both, daemon=True)
    thread.start()
    with pytest.warns(UserWarning, match=r"an autopilot at 127.0.0.1:\d+ goes on, since 127.0.0.1:\d+ is silent"):
        trace = simulate(scenario, engine="free_body", peer=peer)
    thread.join(30.0)
    peer.close()
    assert (peer.counts.frames, peer.counts.restarts, peer.counts.noise, peer.counts.skipped) == (200, 1, 0, 0)
    assert peer.counts.strays > 1  # the noise, and first frames until the other one has been silent
    assert second.times[0] == pytest.approx(0.101)
    assert trace.t[-1] == pytest.approx(0.2)


def test_the_answer_is_what_an_inertial_unit_measures():
    """At rest the specific force is that of gravity, up, and the quaternion turns it to NED."""
    for angles in ((0.0, 0.0, 0.0), (20.0, 10.0, 70.0)):
        keys = {"initial.attitude_deg": list(angles), "simulation.duration": 1e-3}
        _, pilot, _ = session(1, keys=keys)
        said = json.loads(pilot.answers[-1])
        S = np.diag([1.0, -1.0, -1.0])
        R = rotation_matrix(np.array(said["quaternion"]))  # FRD to NED
        np.testing.assert_allclose(R, S @ rotation_matrix(quat_from_euler_deg(*angles)) @ S, atol=1e-4)
        force = R @ np.array(said["imu"]["accel_body"])
        np.testing.assert_allclose(force, [0.0, 0.0, -9.81], atol=1.0)  # it begins to turn
        np.testing.assert_allclose(said["position"], [0.0, 0.0, 5.0], atol=1e-3)


def test_an_accelerometer_feels_the_true_attitude():
    noisy = {"navigation.name": "sensors", "navigation.attitude_noise": [0.1, 0.1, 0.1]}
    (_, true, _), (_, measured, _) = session(20, pwm=forward), session(20, pwm=forward, keys=noisy)
    for a, b in zip(map(json.loads, true.answers), map(json.loads, measured.answers), strict=True):
        assert a["imu"] == b["imu"]
        assert a["quaternion"] != b["quaternion"]


def test_a_port_in_use_is_one_sentence():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port} of 127.0.0.1: another program has it"):
            ArduPilot(np.arange(8), np.ones(8), 10, port=port)


def test_copies_of_a_frame_that_waited_are_answered_once():
    """ArduPilot repeats a frame while the plant is busy. An answer to each would leave it behind for good."""
    scenario = Scenario.load("push_wall", {**HEAVY, "simulation.duration": 0.01})
    _, motors, signs = motors_of(set_up(scenario).vehicle.B)
    peer = ArduPilot(motors, signs, 25, port=0)
    place = ("127.0.0.1", peer._socket.getsockname()[1])
    answers = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as pilot:
        pilot.settimeout(0.3)
        for _ in range(6):
            pilot.sendto(packet(0), place)
        thread = threading.Thread(
            target=simulate, args=(scenario,), kwargs={"engine": "free_body", "peer": peer}, daemon=True
        )
        thread.start()
        for frame in (1, 2, 3):
            answers.append(json.loads(pilot.recv(4096))["timestamp"])
            pilot.sendto(packet(frame), place)
        answers.append(json.loads(pilot.recv(4096))["timestamp"])
        thread.join(10.0)
    peer.close()
    np.testing.assert_allclose(answers, [0.0025, 0.005, 0.0075, 0.01], rtol=2e-8)
    assert peer.counts.repeated == 5


def test_a_frame_that_is_repeated_after_its_answer_is_answered_again():
    scenario = Scenario.load("push_wall", {**HEAVY, "simulation.duration": 0.01})
    _, motors, signs = motors_of(set_up(scenario).vehicle.B)
    peer = ArduPilot(motors, signs, 25, port=0)
    place = ("127.0.0.1", peer._socket.getsockname()[1])
    thread = threading.Thread(target=simulate, args=(scenario,), kwargs={"engine": "free_body", "peer": peer})
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as pilot:
        pilot.settimeout(10.0)
        thread.start()
        times = []
        for frame in (0, 1, 1, 1, 2, 2, 3):
            pilot.sendto(packet(frame), place)
            times.append(json.loads(pilot.recv(4096))["timestamp"])
        thread.join(10.0)
    peer.close()
    np.testing.assert_allclose(times, [0.0025, 0.005, 0.005, 0.005, 0.0075, 0.0075, 0.01], rtol=2e-8)
    assert (peer.counts.frames, peer.counts.repeated) == (4, 3)


def test_an_autopilot_whose_restart_has_the_same_address():
    peer = ArduPilot(np.arange(8), np.ones(8), 10, port=0)
    stepped = [peer._to_step(Servo(400, frame, ()), ("127.0.0.1", 1)) for frame in (0, 1, 500, 499, 0, 1)]
    assert stepped == [True, True, True, False, True, True]
    assert (peer.counts.restarts, peer.counts.stale) == (1, 1)
    peer.close()


def test_packets_of_others_are_ignored_and_said_once():
    """Before and after each frame of the autopilot another program sends one, with its own pulse widths and numbers."""
    clean, _, _ = session(100, pwm=forward)
    scenario = Scenario.load("push_wall", {**HEAVY, "simulation.duration": 0.1})
    _, motors, signs = motors_of(set_up(scenario).vehicle.B)
    peer = ArduPilot(motors, signs, 10, port=0)
    port = peer._socket.getsockname()[1]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))

        def disturb(frame: int) -> list[int]:
            if frame:
                other.sendto(packet(5000 + frame, [1900] * 8), ("127.0.0.1", port))
            return [1]

        pilot = Pilot(port, 100, pwm=forward, disturb=disturb)
        pilot.start()
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            trace = simulate(scenario, engine="free_body", peer=peer)
        pilot.join(30.0)
        peer.close()
        with pytest.raises(BlockingIOError):  # it got no answer
            other.recv(100, socket.MSG_DONTWAIT)
        place = f"127.0.0.1:{other.getsockname()[1]}"
    found = [str(each.message) for each in said if "ignored" in str(each.message)]
    assert len(found) == 1
    assert f"ignored what {place} sends" in found[0]
    np.testing.assert_array_equal(trace.pwm_cmd, clean.pwm_cmd)
    np.testing.assert_array_equal(trace.nu, clean.nu)
    assert (peer.counts.frames, peer.counts.restarts, peer.counts.skipped) == (100, 0, 0)
    assert peer.counts.strays >= 99


def test_the_first_autopilot_takes_over_again_from_a_stray_that_came_while_it_was_silent(monkeypatch):
    monkeypatch.setattr("uvms_mj.engine.ardupilot.SILENT_S", 0.0)
    peer = ArduPilot(np.arange(8), np.ones(8), 10, port=0)
    place = ("127.0.0.1", peer._socket.getsockname()[1])
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stray,
        warnings.catch_warnings(record=True) as said,
    ):
        warnings.simplefilter("always")
        for sender, frame in ((one, 7), (stray, 9000), (one, 8), (one, 9)):
            sender.sendto(packet(frame), place)
            time.sleep(0.01)
            assert peer._next().frame == frame
    assert len(said) == 2
    peer.close()


def test_it_listens_where_the_user_says_and_beyond_loopback_with_a_warning():
    """Another address of loopback stands for another machine's."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        peer = ArduPilot(np.arange(8), np.ones(8), 1, port=0, host="127.0.0.2")
    assert peer._socket.getsockname()[0] == "127.0.0.2"
    peer.close()
    elsewhere = "192.0.2.1"  # an address for documentation: nothing listens there
    with (
        pytest.warns(
            HostWarning, match=f"--host {elsewhere}: machines that reach this address can command the vehicle"
        ),
        pytest.raises(InputError, match=f"of {elsewhere}: "),
    ):
        ArduPilot(np.arange(8), np.ones(8), 1, port=0, host=elsewhere)
