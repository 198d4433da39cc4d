"""The program of an exported law on a serial line: the run's bits, and what noise, lost bytes and half frames give."""

import contextlib
import os
import pty
import select
import shutil
import socket
import struct
import subprocess
import threading
import time
import tomllib
import tty
import zlib

import numpy as np
import pytest

from uvms_mj import Scenario, simulate
from uvms_mj.engine.law_library import linking
from uvms_mj.engine.law_library.library import write_library
from uvms_mj.engine.law_library.linking import MACHINES
from uvms_mj.engine.udp import STATUSES, serve

pytest.importorskip("ziglang")
PERIOD = 1e-3
AT_THE_WALL = {
    "wall.stiffness": 2e3,
    "simulation.duration": 2.0,
    "controller.period": PERIOD,
    "initial.position": [0.99, 0.0, 0.0],
    "reference.step_time": 0.1,
}
OK, LATE, OTHER_HEADER, NOT_BEGUN, NOT_FINITE, MISSING, TIME_BACK, DAMAGED = (
    STATUSES[word][0]
    for word in ("OK", "LATE", "OTHER_HEADER", "NOT_BEGUN", "NOT_FINITE", "MISSING", "TIME_BACK", "DAMAGED")
)
ALL = 7
NO_INSTANT = 2**64 - 1
REST = np.array([0.99, 0.0, 0.0, 1.0, *[0.0] * 18])  # p_WB, quat_WB, nu, force and wrench


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """GSTA at the wall for all processors with Linux: its folder, the run, and the numbers of export and layout."""
    folder = tmp_path_factory.mktemp("export")
    scenario = Scenario.load("push_wall", AT_THE_WALL, "gsta")
    write_library(scenario, folder, [each for each in MACHINES if MACHINES[each].shared], test=False)
    about = tomllib.loads((folder / "gsta.toml").read_text())["library"]
    return folder, scenario, about["export"], int(about["layout"], 16)


def program_of(folder, target, place):
    machine = MACHINES[target]
    if linking.emulator(machine) is None:
        pytest.skip(f"no emulator of {target}: apt-get install qemu-user")
    for each in (*folder.glob("*.h"), folder / "loop.c"):
        shutil.copy(each, place)
    program = linking.program(machine, next((folder / target).glob("*.a")), place / "loop.c", place)
    return [*linking.emulator(machine), str(program)]


@pytest.fixture(scope="module")
def native(exported, tmp_path_factory):
    return program_of(exported[0], "x86_64", tmp_path_factory.mktemp("native"))


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        return peer.getsockname()[1]


class Line:
    """The other end of the program's line."""

    def __init__(self, command, layout):
        self.layout = layout
        self.end, self.theirs = pty.openpty()
        tty.setraw(self.theirs)
        self.process = subprocess.Popen([*command, os.ttyname(self.theirs)], stdout=subprocess.PIPE, text=True)
        self.came = b""

    def frame(self, instant, numbers=None, t=None, present=ALL, layout=None, more=b""):
        """At rest at instant 0, where the reference begins, and 1 mm ahead of it later."""
        if numbers is None:
            numbers = REST + 1e-3 * (np.arange(22) == 0) * (instant > 0)
        body = struct.pack(f"<dQ{len(numbers)}d", PERIOD * instant if t is None else t, present, *numbers) + more
        front = struct.pack("<8sIIQQ", b"uvms-mj2", len(body), ~len(body) & 0xFFFFFFFF, instant, layout or self.layout)
        return front + body + struct.pack("<I", zlib.crc32(front + body))

    def write(self, data):
        assert os.write(self.end, data) == len(data)

    def answer(self, timeout=10.0):
        """The next answer: instant, status, skipped bytes, numbers of the command; None without one in time."""
        size = 32 + 24 + 8 * 19 + 4
        while len(self.came) < size:
            if not select.select([self.end], [], [], timeout)[0]:
                assert not self.came
                return None
            self.came += os.read(self.end, 4096)
        data, self.came = self.came[:size], self.came[size:]
        magic, n, other, instant, layout = struct.unpack_from("<8sIIQQ", data)
        assert (magic, n, n ^ other, layout) == (b"uvms-mj2", size - 36, 0xFFFFFFFF, self.layout)
        assert zlib.crc32(data[:-4]) == struct.unpack("<I", data[-4:])[0]
        status, self.export, skipped = struct.unpack_from("<qQQ", data, 32)
        return instant, status, skipped, np.frombuffer(data[56:-4], "<f8")

    def asked(self, instant, *given, **more):
        self.write(self.frame(instant, *given, **more))
        return self.answer()

    def close(self):
        for each in (self.end, self.theirs):
            with contextlib.suppress(OSError):
                os.close(each)
        self.process.kill()
        self.process.communicate()


@pytest.fixture
def line(native, exported):
    with contextlib.closing(Line(native, exported[3])) as line:
        first = line.asked(0)  # it waits for the program to open the line
        assert first[:2] == (0, OK)
        yield line


@pytest.mark.parametrize("target", [each for each in MACHINES if MACHINES[each].shared])
def test_a_line_gives_the_runs_commands_bit_for_bit(exported, tmp_path, target):
    """2 s with the touch: a run whose law answers over the line is the run with the law, in all signals."""
    folder, scenario, export, layout = exported
    ours = simulate(scenario, engine="free_body")
    assert ours.push[0] == 0.0
    assert ours.push[-1] > 0.1
    statuses, thrusts = set(), []
    with contextlib.closing(Line(program_of(folder, target, tmp_path), layout)) as line:

        def law(signals):
            measured = [signals[name] for name in ("p_WB", "quat_WB", "nu", "f_contact_m_W", "tau_contact_m_B")]
            instant, *of_answer, command = line.asked(len(thrusts), np.concatenate(measured), t=signals.t)
            assert instant == len(thrusts)
            statuses.add(tuple(of_answer))
            thrusts.append(command[6:12])
            return command[:6]

        port = free_port()
        instants = round(AT_THE_WALL["simulation.duration"] / PERIOD) + 1
        thread = threading.Thread(target=serve, args=(law, port, instants), daemon=True)
        thread.start()
        theirs = simulate(scenario.updated({"controller.port": port}, controller="udp"), engine="free_body")
        thread.join(10.0)
    assert (statuses, line.export, len(thrusts)) == ({(OK, 0)}, export, instants)
    common = [name for name in ours if name in theirs]
    assert len(common) > 30
    for name in common:
        assert np.array_equal(ours[name], theirs[name], equal_nan=True), name
    assert np.array_equal(np.array(thrusts), ours.u)


def neutral(answer):
    return not answer[3][:12].any()


def test_noise_around_a_frame_is_skipped_and_counted(line):
    """Among it the beginning of a frame, and one whose length is a lie."""
    front = line.frame(1)[:32]
    noise = [bytes(range(256)), b"uvms-mj", b"uvms-mj2", front[:8] + b"\xff" * 8, b"u" * 9]
    total = 0
    for k, each in enumerate(noise, start=1):
        line.write(each)
        total += len(each)
        instant, status, skipped, command = line.asked(k)
        assert (instant, status, skipped) == (k, OK, total)
        assert command.any()


def test_a_length_that_is_no_length_holds_nothing_up(line):
    """The frame behind it is answered before the line has been silent for 0.1 s; the fastest of some trials counts."""
    times = []
    for k in range(1, 7):
        line.write(struct.pack("<8sIIQQ", b"uvms-mj2", 3000, 3000, k, line.layout))
        begun = time.monotonic()
        assert line.asked(k)[:2] in ((k, OK), (k, LATE))
        times.append(time.monotonic() - begun)
    assert min(times) < 0.09


def test_a_lost_byte_costs_one_frame_and_the_next_one_is_found(line):
    """A byte of a frame is left out, or another one, in each of its parts; the frame behind it is answered, and the law
    has taken one step."""
    skipped, k = 0, 0
    for place in (0, 7, 9, 15, 20, 31, 40, 100, 227):
        for cut in (True, False):
            k += 1
            whole = line.frame(99, np.full(22, 7.0))
            damaged = whole[:place] + (b"" if cut else bytes([whole[place] ^ 0x10])) + whole[place + 1 :]
            line.write(damaged + line.frame(k))
            skipped += len(damaged)
            assert line.answer()[:3] == (k, OK, skipped)
    assert line.answer(0.3) is None


@pytest.mark.parametrize("n", [1, 8, 20, 32, 100, 227])
def test_half_a_frame_gets_a_neutral_command_when_the_line_is_silent(line, n):
    line.write(line.frame(1)[:n])
    answer = line.answer()
    assert answer[:3] == (NO_INSTANT, DAMAGED, n)
    assert neutral(answer)
    after = line.asked(1)
    assert after[:3] == (1, OK, n)
    assert not neutral(after)


def test_noise_alone_is_answered_once(line):
    line.write(bytes(range(200)))
    answer = line.answer()
    assert answer[:3] == (NO_INSTANT, DAMAGED, 200)
    assert neutral(answer)
    assert line.answer(0.3) is None


def test_frames_may_come_in_pieces_and_several_at_once(line):
    for k in (1, 2):
        for byte in line.frame(k):
            line.write(bytes([byte]))
        assert line.answer()[:3] == (k, OK, 0)
    line.write(b"".join(line.frame(k) for k in range(3, 9)))
    assert [line.answer()[0] for _ in range(3, 9)] == [3, 4, 5, 6, 7, 8]


@pytest.mark.parametrize(
    ("wrong", "status"),
    [
        ({"layout": 5}, OTHER_HEADER),
        ({"more": bytes(8)}, OTHER_HEADER),
        ({"numbers": np.full(22, np.nan)}, NOT_FINITE),
        ({"present": 3}, MISSING),
        ({"t": 0.0}, TIME_BACK),
    ],
    ids=["another layout", "more numbers", "no numbers", "no force", "the time stands still"],
)
def test_a_frame_that_the_law_refuses_is_neutral_and_says_why(line, wrong, status):
    answer = line.asked(1, **wrong)
    assert answer[:2] == (1, status)
    assert neutral(answer)
    after = line.asked(2)
    assert after[:2] in ((2, OK), (2, LATE))
    assert not neutral(after)


COUNTING = """
from dataclasses import dataclass
from uvms_mj import Controller
@dataclass(frozen=True)
class Counting(Controller):
    uses_task = False
    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = 0.0
        tau_cmd[0] = signals.tau_hat[0] + 1.0
"""


@pytest.fixture(scope="module")
def counting(tmp_path_factory):
    """A law that asks for one newton more than the wrench that acted, in its program."""
    folder, place = tmp_path_factory.mktemp("counting"), tmp_path_factory.mktemp("place")
    (folder / "law.py").write_text(COUNTING)
    settings = {"controller.period": PERIOD, "simulation.duration": 0.05}
    write_library(Scenario.load("push_wall", settings, f"{folder}/law.py:Counting"), folder, ["x86_64"], test=False)
    about = tomllib.loads((folder / "counting.toml").read_text())["library"]
    return program_of(folder, "x86_64", place), int(about["layout"], 16)


@pytest.mark.parametrize(
    ("wrong", "status"),
    [({"layout": 5}, OTHER_HEADER), ({"present": 3}, MISSING), ({"numbers": np.full(22, np.nan)}, NOT_FINITE),
     (None, DAMAGED)],
    ids=["another layout", "no force", "no numbers", "half a frame"],
)  # fmt: skip
def test_the_law_knows_that_no_thrust_acted_after_a_neutral_command(counting, wrong, status):
    """The law counts the newtons that acted: 1, 2, 3, then nothing, so 1 again."""
    program, layout = counting
    with contextlib.closing(Line(program, layout)) as line:
        counted = [line.asked(k)[3][0] for k in range(3)]
        np.testing.assert_allclose(counted, [1.0, 2.0, 3.0], rtol=1e-12)
        if wrong is None:
            line.write(line.frame(3)[:100])
            answer = line.answer()
        else:
            answer = line.asked(3, **wrong)
        assert answer[1] == status
        assert neutral(answer)
        assert line.asked(4)[3][0] == 1.0


def test_a_frame_that_comes_again_has_the_same_answer(line):
    first = line.asked(1)
    again = line.asked(1)
    assert again[:3] == first[:3]
    assert again[3].tobytes() == first[3].tobytes()
    assert line.asked(2)[:2] == (2, OK)
    line.write(b"noise")
    assert line.answer()[1] == DAMAGED
    assert line.asked(2)[1] == TIME_BACK  # its command was overtaken by a neutral one, of which the law knows


def test_a_program_that_was_started_anew_waits_for_instant_0(native, exported):
    with contextlib.closing(Line(native, exported[3])) as line:
        answer = line.asked(7)
        assert answer[:2] == (7, NOT_BEGUN)
        assert neutral(answer)
        assert line.asked(0)[:2] == (0, OK)


def test_the_program_ends_when_the_line_is_closed(line):
    os.close(line.end)
    assert line.process.wait(10.0) == 1


def test_a_program_whose_answers_nobody_reads_goes_on(line):
    for k in range(1, 60):  # more bytes than the line holds
        line.write(line.frame(k))
    found = [line.answer()[0]]
    while (answer := line.answer(0.5)) is not None:
        found.append(answer[0])
    assert found[0] == 1
    assert line.asked(60)[1] in (OK, LATE)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["/dev/null"], "/dev/null: is no serial line of 115200 baud"),
        (["/dev/none", "9600"], "/dev/none: is no serial line of 9600 baud"),
        (["/dev/null", "7"], "/dev/null: 7 is no baud of a serial line"),
        (["9100", "9600"], "loop DEVICE"),
        (["tty"], "loop DEVICE"),
    ],
)
def test_a_wrong_line_is_named(native, given, said):
    done = subprocess.run([*native, *given], capture_output=True, text=True, timeout=10.0)
    assert done.returncode == 2
    assert said in done.stdout


def test_a_frame_is_a_datagram_too(native, exported):
    """The same frame over UDP; one that is damaged is answered, and what is no frame is not."""
    port, frame = free_port(), Line.frame
    line = type("Layout", (), {"layout": exported[3]})
    with (
        subprocess.Popen([*native, str(port)], stdout=subprocess.PIPE) as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer,
    ):
        try:
            peer.connect(("127.0.0.1", port))
            peer.settimeout(0.2)

            def asked(data):
                with contextlib.suppress(TimeoutError, ConnectionRefusedError):
                    peer.send(data)
                    found = peer.recv(4096)
                    return struct.unpack_from("<Q", found, 16)[0], struct.unpack_from("<q", found, 32)[0]
                return None

            while asked(frame(line, 0)) != (0, OK):
                pass
            assert asked(frame(line, 1)) == (1, OK)
            assert asked(frame(line, 2)[:-1]) == (NO_INSTANT, DAMAGED)
            assert asked(b"noise") is None
            assert asked(frame(line, 2)) == (2, OK)
        finally:
            process.kill()
