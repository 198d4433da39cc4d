"""Helpers for tests of logs: a scenario with everything in it, a user's law, an independent decoder."""

import functools
from collections import defaultdict

import numpy as np
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, DataEnd
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory

from uvms_mj.records.mcap.sink import record_bytes

TOUCHING = {
    "simulation.duration": 0.4,
    "wall.position": 0.002,
    "wall.friction": 0.3,
    "reference.step_time": 0.0,
    "reference.target": [0.05, 0.02, 0.0],
    "disturbance.amplitude": [1.0, 0.5, 0.2, 0.1, 0.1, 0.1],
    "disturbance.frequency_hz": [1.0, 2.0, 3.0, 1.0, 2.0, 3.0],
    "initial.attitude_deg": [5.0, -4.0, 8.0],
    "reference.bandwidth": 10.0,
}
LAW = '''
from dataclasses import dataclass
from uvms_mj import Controller, gain

@dataclass(frozen=True)
class Mine(Controller):
    """Integral action, and a state that does not have six components."""
    k: float = gain(2.0, "1/s", "integral gain")
    weights: tuple[float, ...] = gain((1.0, 2.0, 3.0), "1", "weights")
    flag: bool = gain(True, "1", "a flag")
    states = {"xi": 6, "odom": 2}
    name = "mine"

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        state_dot.xi[:] = signals.eta_e
        state_dot.odom[0] = 1.0
        tau_cmd[:] = signals.tau_nom - gains.k * state.xi
'''


def same(a, b):
    assert list(a) == list(b)
    for name in a:
        assert np.array_equal(a[name], b[name]), name


@functools.lru_cache(maxsize=1)  # the tests of a module read one log
def decoded(path, *topics):
    """The messages of a log by topic, of all topics or of some, decoded by mcap-ros2-support: (log time, message) in
    file order."""
    messages = defaultdict(list)
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, ros in reader.iter_decoded_messages(topics or None):
            messages[channel.topic].append((message.log_time, ros))
    return messages


def rewritten(path, change):
    """A log with changed attachments and correct checksums."""
    out = bytearray(path.read_bytes()[:8])
    with open(path, "rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, DataEnd):
                break
            if isinstance(record, Attachment):
                record.name, record.data = change(record.name, record.data)
            out += record_bytes(record)
    assert out[8] == Opcode.HEADER
    return bytes(out)
