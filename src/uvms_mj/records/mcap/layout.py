"""Byte layout of rows in an MCAP file. NumPy lays out the messages of a block of rows at a time.

A row is one message of each sampled topic, side by side. At regular intervals, a message with the force arrows precedes
a row. All messages of a topic have the same size, so that rows are a structured array.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from mcap.opcode import Opcode

from ..header import Header
from ..mcap import topics
from .cdr import STAMP
from .topics import Topic

_HEAD = np.dtype([("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("when", "u1", (20,))])
_WHEN = np.dtype([("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")])
_NS = 1e9
CHUNK_BYTES = 8 * 2**20
"""Largest size of a chunk before compression, unless a single row is larger."""


class Records:
    """Message records of topics, side by side: a template and the places of the numbers in it."""

    def __init__(self, channels: Sequence[tuple[int, Topic]]) -> None:
        self.channels = tuple(channel for channel, _ in channels)
        fields: dict[str, tuple[tuple[str, tuple[int, ...]], int]] = {}
        template = bytearray()
        starts: list[int] = []
        self._from: list[tuple[str, str]] = []  # field, and the name of its values
        for channel, topic in channels:
            start, body = len(template), len(template) + _HEAD.itemsize
            starts.append(start)
            head = np.zeros(1, _HEAD)
            head["opcode"], head["channel"] = Opcode.MESSAGE, channel
            head["length"] = _HEAD.itemsize - 9 + len(topic.message.data)
            template += head.tobytes() + topic.message.data
            fields[f"{channel}.when"] = (("u1", (20,)), body - 20)
            self._from.append((f"{channel}.when", ".when"))
            for name, hole in topic.message.holes.items():
                fields[f"{channel}/{name}"] = ((hole.kind, (hole.count,)), body + hole.offset)
                self._from.append((f"{channel}/{name}", STAMP if name.startswith(STAMP) else name))
        self.starts = np.array(starts)
        self.size = len(template)
        self.template = np.frombuffer(bytes(template), np.uint8)
        self.dtype = np.dtype(
            {
                "names": list(fields),
                "formats": [kind for kind, _ in fields.values()],
                "offsets": [offset for _, offset in fields.values()],
                "itemsize": self.size,
            }
        )
        self._constant = np.ones(self.size, bool)
        for (kind, shape), offset in fields.values():
            self._constant[offset : offset + np.dtype((kind, shape)).itemsize] = False

    def lay_out(self, values: Mapping[str, np.ndarray], sequence: np.ndarray, log_ns: np.ndarray) -> np.ndarray:
        """Bytes (n, size) of n rows.

        Args:
            values: (n, count) for each hole.
            sequence: (n,) row numbers.
            log_ns: (n,) log times [ns].
        """
        raw = np.empty((len(log_ns), self.size), np.uint8)
        raw[:] = self.template
        when = np.empty(len(log_ns), _WHEN)
        when["sequence"], when["log"], when["publish"] = sequence & 0xFFFFFFFF, log_ns, log_ns
        given = dict(values)
        given[".when"] = when.view(np.uint8).reshape(-1, 20)
        given[STAMP] = np.stack(np.divmod(log_ns, 1_000_000_000), axis=1)
        rows = raw.reshape(-1).view(self.dtype)
        for field, name in self._from:
            rows[field] = given[name]
        return raw

    def rows(self, raw: np.ndarray) -> np.ndarray | None:
        """Bytes (n, size) as n records with the fields of :attr:`dtype`; None if their layout differs."""
        for row in (raw[0], raw[-1]) if len(raw) else ():
            if not np.array_equal(row[self._constant], self.template[self._constant]):
                return None
        return raw.reshape(-1).view(self.dtype)


class Format:
    """The channels of a log and the layout of its rows, derived from its header alone."""

    def __init__(self, header: Header) -> None:
        self.header = header
        self.once, self.once_values = topics.once(header)
        self.arrows = topics.arrows(header)
        self.sampled = topics.sampled(header)
        self.topics = (*self.once, self.arrows, *self.sampled)
        number = {topic.name: i + 1 for i, topic in enumerate(self.topics)}
        self.number = number
        self.row_records = Records([(number[topic.name], topic) for topic in self.sampled])
        self.arrow_records = Records([(number[self.arrows.name], self.arrows)])
        self.once_records = Records([(number[topic.name], topic) for topic in self.once])
        step = header.scenario.simulation.timestep
        self.timestep = step
        self.arrow_every = max(1, round(1.0 / (topics.ARROWS_HZ * step * header.row_steps)))
        """Number of rows from one message of force arrows to the next."""

    def times(self, first_row: int, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Time [s] and log time [ns] of n rows (n,)."""
        steps = np.minimum(
            np.arange(first_row, first_row + n, dtype=np.int64) * self.header.row_steps, self.header.scenario.steps
        )
        t = steps * self.timestep
        return t, np.rint(t * _NS).astype(np.int64)

    def groups(self, first_row: int, n: int) -> Iterator[tuple[int, int, bool]]:
        """n rows in groups (start, stop, whether force arrows precede the group), counted from first_row."""
        start = 0
        while start < n:
            into = (first_row + start) % self.arrow_every
            stop = min(n, start + self.arrow_every - into)
            yield start, stop, into == 0
            start = stop

    def once_bytes(self) -> np.ndarray:
        """The messages of constant values, at time zero."""
        zero = np.zeros(1, np.int64)
        values = {name: value[None] for name, value in self.once_values.items()}
        return self.once_records.lay_out(values, zero, zero).reshape(-1)

    def row_bytes(self, rows: np.ndarray, first_row: int) -> list[tuple[Records, int, np.ndarray, np.ndarray]]:
        """Rows (n, width) as pieces: Records, number of rows n, bytes (n, size) and log times (n,) [ns] of each."""
        _, log_ns = self.times(first_row, len(rows))
        sequence = np.arange(first_row, first_row + len(rows), dtype=np.int64)
        raw = self.row_records.lay_out(topics.columns(self.header, rows), sequence, log_ns)
        pieces = []
        for start, stop, with_arrows in self.groups(first_row, len(rows)):
            if with_arrows:
                values = {k: v[None] for k, v in topics.arrow_columns(self.header, rows[start]).items()}
                one = slice(start, start + 1)
                count = sequence[one] // self.arrow_every
                pieces.append(
                    (self.arrow_records, 1, self.arrow_records.lay_out(values, count, log_ns[one]), log_ns[one])
                )
            pieces.append((self.row_records, stop - start, raw[start:stop], log_ns[start:stop]))
        return pieces

    def belong(self, records: np.ndarray, first_row: int, log_ns: np.ndarray) -> bool:
        """Whether records have the expected row numbers and times, on every channel."""
        sequence = np.arange(first_row, first_row + len(log_ns)) & 0xFFFFFFFF
        for channel in self.row_records.channels:
            when = np.ascontiguousarray(records[f"{channel}.when"]).view(_WHEN).reshape(-1)
            same = (when["sequence"] == sequence) & (when["log"] == log_ns) & (when["publish"] == log_ns)
            if not same.all():
                return False
        return True

    def columns_of(self, records: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Rows (n, width) from their records, equal bit for bit to those given to :meth:`row_bytes`."""
        columns = []
        for signal in self.header.signals:
            if signal.name == "t":
                columns.append(t[:, None])
                continue
            for name, order in ((signal.name, slice(None)), (f"{signal.name}.xyzw", [3, 0, 1, 2])):
                field = next((f for f in self.row_records.dtype.names or () if f.partition("/")[2] == name), None)
                if field is not None:
                    columns.append(records[field][:, order])
                    break
        return np.concatenate(columns, axis=1)


def message_indexes(pieces: Sequence[tuple[Records, int, np.ndarray, np.ndarray]]) -> dict[int, bytes]:
    """MessageIndex record of each channel of a chunk: times and offsets of its messages."""
    times: dict[Records, list[np.ndarray]] = {}
    places: dict[Records, list[np.ndarray]] = {}
    base = 0
    for records, n, _, log_ns in pieces:
        times.setdefault(records, []).append(log_ns)
        places.setdefault(records, []).append(base + np.arange(n) * records.size)
        base += n * records.size
    indexes: dict[int, bytes] = {}
    for records, each in times.items():
        log_ns, place = np.concatenate(each), np.concatenate(places[records])
        n = len(log_ns)
        head = [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("bytes", "<u4"), ("entries", "<u8", (n, 2))]
        index = np.zeros(len(records.channels), np.dtype(head))
        index["opcode"], index["length"], index["bytes"] = Opcode.MESSAGE_INDEX, 6 + 16 * n, 16 * n
        index["channel"] = records.channels
        index["entries"][:, :, 0] = log_ns
        index["entries"][:, :, 1] = place + records.starts[:, None]
        indexes |= {channel: index[i].tobytes() for i, channel in enumerate(records.channels)}
    return indexes
