"""A law in another process gives the numbers of the same law in this one."""

import socket
import struct
import subprocess
import sys
import threading
import warnings
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from uvms_mj import InputError, McapLog, Scenario, Trace, simulate
from uvms_mj.cli import main
from uvms_mj.cli.new import write_new
from uvms_mj.engine.native.tools import compiler
from uvms_mj.engine.udp import MAGIC, SIGNALS, UdpLaw, serve
from uvms_mj.errors import HostWarning

PD = """
from dataclasses import dataclass
from uvms_mj import Controller

@dataclass(frozen=True)
class Pd(Controller):
    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.g_hat - 200.0 * signals.eta_e - 150.0 * signals.nu_e
"""


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Gsta:
    """The law of the paper, as its user would write it."""

    def __init__(self) -> None:
        self.z, self.z_dot = np.zeros(6), np.zeros(6)

    def __call__(self, signals) -> np.ndarray:
        self.z = self.z + signals.period * self.z_dot
        s, sgn = signals.s, np.sign(signals.s)
        root = np.sqrt(np.abs(s)) * sgn
        phi_1, phi_2 = root + 5.0 * s, 0.5 * sgn + 1.5 * 5.0 * root + 5.0 * 5.0 * s
        a = -5.0 * phi_1 + self.z - signals.A * s
        self.z_dot = -10.0 * phi_2
        tau = signals.tau_nom.copy()
        for j in range(6):
            tau += signals.M_hat[:, j] * a[j]
        return tau


def test_a_law_over_udp_is_that_in_process_bit_for_bit():
    port = free_port()
    scenario = Scenario.load("push_wall", {"simulation.duration": 8.0, "controller.period": 1e-3})
    threading.Thread(target=serve, args=(Gsta(), port, 8001), daemon=True).start()
    theirs = simulate(scenario.updated({"controller.port": port}, controller="udp"), engine="free_body")
    ours = simulate(scenario, engine="free_body")
    for signal in theirs.signals:
        np.testing.assert_array_equal(ours[signal.name], theirs[signal.name], err_msg=signal.name)


def test_without_a_law_one_sentence_says_so():
    keys = {"controller.name": "udp", "controller.port": free_port(), "controller.timeout": 0.3}
    with pytest.raises(InputError, match=r"controller.port: no law answers on UDP 127.0.0.1:\d+ within 0.3 s"):
        simulate(Scenario.load("push_wall", keys), engine="free_body")


def test_late_copies_and_noise_are_left_alone():
    port = free_port()

    def law() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.bind(("127.0.0.1", port))
            for k in range(101):
                data, address = peer.recvfrom(65536)
                assert data[:8] == MAGIC
                assert len(data) == 16 + SIGNALS.itemsize
                for number in (k - 1, k):
                    peer.sendto(b"noise", address)
                    peer.sendto(np.array([max(number, 0)], "<u8").tobytes() + np.full(6, float(k)).tobytes(), address)

    threading.Thread(target=law, daemon=True).start()
    keys = {"simulation.duration": 0.1, "controller.period": 1e-3, "controller.name": "udp", "controller.port": port}
    trace = simulate(Scenario.load("push_wall", keys), engine="free_body")
    np.testing.assert_array_equal(trace.tau_cmd[:, 0], np.arange(101.0))


def test_the_plant_listens_on_loopback_and_to_its_law_alone():
    """A program beside the law answers each request first, with other numbers."""
    port, listens = free_port(), set()

    def law() -> None:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
        ):
            peer.bind(("127.0.0.1", port))
            for k in range(101):
                _, address = peer.recvfrom(65536)
                listens.add(address[0])
                table = Path("/proc/net/udp").read_text() if sys.platform == "linux" else ""
                assert f"00000000:{address[1]:04X}" not in table  # any address
                other.sendto(struct.pack("<Q6d", k, *[1e3] * 6), address)
                peer.sendto(struct.pack("<Q6d", k, *[1.0] * 6), address)

    thread = threading.Thread(target=law, daemon=True)
    thread.start()
    keys = {"simulation.duration": 0.1, "controller.period": 1e-3, "controller.port": port}
    trace = simulate(Scenario.load("push_wall", keys, "udp"), engine="free_body")
    thread.join(10.0)
    assert listens == {"127.0.0.1"}
    np.testing.assert_array_equal(trace.tau_cmd, 1.0)


def test_a_server_answers_the_run_that_began_last():
    """A law that counts its calls sees the instants of one run at a time."""
    calls, port = [], free_port()

    def law(signals) -> np.ndarray:
        calls.append(float(signals.t))
        return np.full(6, float(len(calls)))

    thread = threading.Thread(target=serve, args=(law, port, 4), daemon=True)
    thread.start()
    record = np.zeros(1, SIGNALS)

    def asked(run: socket.socket, instant: int) -> float | None:
        record["t"] = instant
        run.sendto(MAGIC + struct.pack("<Q", instant) + record.tobytes(), ("127.0.0.1", port))
        try:
            return struct.unpack("<Q6d", run.recv(100))[1]
        except TimeoutError:
            return None

    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as old,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as new,
    ):
        old.settimeout(0.3)
        new.settimeout(5.0)
        while asked(old, 0) is None:  # until it serves
            pass
        assert asked(old, 1) == 2.0
        assert [asked(new, 0), asked(old, 2), asked(new, 1), asked(new, 1), asked(new, 2)] == [3.0, None, 4.0, 4.0, 5.0]
        assert calls == [0.0, 1.0, 0.0, 1.0, 2.0]
        asked(new, 3)
    thread.join(10.0)
    assert not thread.is_alive()


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda n: bytes(8), "8 bytes came, and an answer has 56"),
        (lambda n: struct.pack(">Q6d", n + 1, *[0.0] * 6), "was asked for"),
        (lambda n: struct.pack("<Q6d", n, 0.0, 0.0, np.nan, 0.0, 0.0, 0.0), r"answers nan for tau_cmd\[2\] at t = 0 s"),
    ],
)
def test_a_wrong_answer_is_told_from_none(answer, words):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as law:
        law.bind(("127.0.0.1", 0))
        law.settimeout(5.0)

        def reply() -> None:
            data, address = law.recvfrom(65536)
            law.sendto(answer(struct.unpack_from("<Q", data, 8)[0]), address)

        threading.Thread(target=reply, daemon=True).start()
        keys = {"controller.port": law.getsockname()[1], "controller.timeout": 0.3}
        with pytest.raises(InputError, match=words):
            simulate(Scenario.load("push_wall", keys, "udp"), engine="free_body")


def test_a_server_says_what_is_wrong_with_its_port_and_its_law():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        with pytest.raises(InputError, match="in use; choose another"):
            serve(Gsta(), other.getsockname()[1])
    request = MAGIC + struct.pack("<Q", 0) + np.zeros(1, SIGNALS).tobytes()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        port = free_port()
        thread = threading.Timer(0.2, lambda: asking.sendto(request, ("127.0.0.1", port)))
        thread.start()
        with pytest.raises(InputError, match="six numbers"):
            serve(lambda signals: np.zeros(3), port)


def test_the_example_is_pd_in_a_process_of_its_own(tmp_path):
    (tmp_path / "pd.py").write_text(PD)
    port = free_port()
    example = Path(__file__).parents[2] / "examples" / "udp_law.py"
    scenario = Scenario.load("push_wall", {"simulation.duration": 1.0, "controller.period": 1e-3})
    ours = simulate(scenario.updated({}, controller=f"{tmp_path}/pd.py:Pd"), engine="free_body")
    (tmp_path / "udp_law.toml").write_text('stage = "controller"\n')
    write_new("header", str(tmp_path / "udp_law.toml"))
    in_c, program = example.with_name("udp_law_in_c.c"), tmp_path / "udp_law"
    options = ["-O2", "-ffp-contract=off", "-I", str(tmp_path), "-o", str(program), str(in_c), "-lm"]
    subprocess.run([*compiler(), *options], check=True)
    for command in ([sys.executable, str(example)], [str(program)]):
        with subprocess.Popen([*command, str(port)]) as other:
            try:
                theirs = simulate(scenario.updated({"controller.port": port}, controller="udp"), engine="free_body")
            finally:
                other.kill()
        np.testing.assert_array_equal(ours.tau, theirs.tau)


MACHINE = "127.0.0.2"
"""Another address than the default's; it stands for another machine."""


def test_a_law_on_another_address_is_asked_where_its_user_says(tmp_path):
    """It has the numbers of the same law in process. What listens at the default's address is not asked."""
    port, here = free_port(), []
    scenario = Scenario.load("push_wall", {"simulation.duration": 1.0, "controller.period": 1e-3})
    threading.Thread(target=serve, args=(Gsta(), port, 1001, MACHINE), daemon=True).start()
    threading.Thread(target=serve, args=(lambda signals: here.append(1) or np.zeros(6), port), daemon=True).start()
    given = {"controller.port": port, "controller.host": MACHINE}
    log = McapLog(tmp_path / "run.mcap")
    theirs = simulate(scenario.updated(given, controller="udp"), engine="free_body", sinks=[log])
    ours = simulate(scenario, engine="free_body")
    assert np.array_equal(theirs.tau_cmd, ours.tau_cmd)
    assert not here
    assert Trace.load(tmp_path / "run.mcap").scenario.controller.host == "127.0.0.1"  # a log has no host


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", MACHINE])
def test_loopback_is_no_warning(host):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        UdpLaw(free_port(), 1.0, 1, host=host).close()


ELSEWHERE = "192.0.2.1"
"""An address for documentation. No machine has it, so nothing listens there."""


def test_another_machine_is_a_warning():
    with pytest.warns(HostWarning, match=f"controller.host {ELSEWHERE}: the run is sent over the network"):
        UdpLaw(free_port(), 1.0, 1, host=ELSEWHERE).close()
    with (
        pytest.warns(HostWarning, match=f"host {ELSEWHERE}: machines that reach this address are answered"),
        pytest.raises(InputError, match=f"of {ELSEWHERE}: "),
    ):
        serve(lambda signals: np.zeros(6), free_port(), host=ELSEWHERE)


def test_a_host_that_does_not_exist_is_one_sentence():
    given = {"controller.host": "no.such.host.invalid", "simulation.duration": 0.1}
    with pytest.warns(HostWarning), pytest.raises(InputError, match=r"controller.host: no.such.host.invalid: \w"):
        simulate(Scenario.load("push_wall", given, "udp"))


def test_a_log_sends_nothing_to_another_machine(tmp_path, monkeypatch):
    """Not even one that was forged: the host is named anew."""
    port, asked = free_port(), []
    given = {"simulation.duration": 0.01, "controller.period": 1e-3, "controller.port": port}
    threading.Thread(target=serve, args=(Gsta(), port, 11), daemon=True).start()
    trace = simulate(Scenario.load("push_wall", given, "udp"), engine="free_body")
    with monkeypatch.context() as forged:
        forged.setattr("uvms_mj.records.header.Udp.host", ELSEWHERE)
        trace.save(tmp_path / "a.mcap")
    assert Trace.load(tmp_path / "a.mcap").scenario.controller.host == ELSEWHERE
    monkeypatch.setattr(
        "uvms_mj.engine.run.UdpLaw.of", lambda scenario: asked.append(scenario.controller.host) or 1 / 0
    )
    for named in ([], ["controller.host=127.0.0.2"]):
        CliRunner().invoke(main, ["run", "--from", str(tmp_path / "a.mcap"), *named, "-o", str(tmp_path / "b")])
    assert asked == ["127.0.0.1", "127.0.0.2"]
