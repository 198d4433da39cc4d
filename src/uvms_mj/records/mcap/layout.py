"""Byte layout of rows in an MCAP file. NumPy lays out the messages of a block of rows at a time.

A row is one message of each sampled topic, side by side. At regular intervals, a message with the force arrows precedes
a row. All messages of a topic have the same size, so that rows are a structured array, and blocks of as many rows
differ in their numbers only.
"""

import functools
import struct
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from mcap.opcode import Opcode

from ..header import Header
from . import topics
from .ros2 import STAMP
from .topics import Topic

_HEAD = np.dtype([("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("when", "u1", (20,))])
_WHEN = np.dtype([("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")])
_WHEN_AT = _HEAD.itemsize - 20
_MESSAGE = struct.Struct("<BQHIQQ")
_INDEX = [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("bytes", "<u4")]
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
        self.sources: list[tuple[str, str]] = []  # field, and the name of its values
        for channel, topic in channels:
            start, body = len(template), len(template) + _HEAD.itemsize
            starts.append(start)
            head = np.zeros(1, _HEAD)
            head["opcode"], head["channel"] = Opcode.MESSAGE, channel
            head["length"] = _HEAD.itemsize - 9 + len(topic.message.data)
            template += head.tobytes() + topic.message.data
            fields[f"{channel}.when"] = (("u1", (20,)), body - 20)
            self.sources.append((f"{channel}.when", ".when"))
            for name, hole in topic.message.holes.items():
                fields[f"{channel}/{name}"] = ((hole.kind, (hole.count,)), body + hole.offset)
                self.sources.append((f"{channel}/{name}", STAMP if name.startswith(STAMP) else name))
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

    def rows(self, raw: np.ndarray) -> np.ndarray | None:
        """Bytes (n, size) as n records with the fields of :attr:`dtype`; None if their layout differs."""
        for row in (raw[0], raw[-1]) if len(raw) else ():
            if not np.array_equal(row[self._constant], self.template[self._constant]):
                return None
        return raw.reshape(-1).view(self.dtype)

    def place_of(self, signal: str) -> tuple[str, list[int] | slice]:
        """Field with the numbers of a signal and their order in it. Raises KeyError without such a field."""
        for field in self.dtype.names or ():
            name = field.partition("/")[2]
            if name in (signal, f"{signal}.xyzw"):
                return field, slice(None) if name == signal else [3, 0, 1, 2]
        raise KeyError(signal)


class Block:
    """The messages of n rows as bytes, ``data``, with the force arrows between them, and the number of messages and the
    MessageIndex record of each channel."""

    def __init__(self, pieces: Sequence[tuple[Records, int]]) -> None:
        self.data = np.concatenate([np.tile(records.template, n) for records, n in pieces])
        self._views: dict[Records, list[np.ndarray]] = {}
        places: dict[Records, list[np.ndarray]] = {}
        base = 0
        for records, n in pieces:
            end = base + n * records.size
            self._views.setdefault(records, []).append(self.data[base:end].view(records.dtype))
            places.setdefault(records, []).append(base + np.arange(n) * records.size)
            base = end
        self.counts: dict[int, int] = {}
        self._indexes: dict[Records, np.ndarray] = {}
        for records, each in places.items():
            place = np.concatenate(each)
            n = len(place)
            index = np.zeros(len(records.channels), np.dtype([*_INDEX, ("entries", "<u8", (n, 2))]))
            index["opcode"], index["length"], index["bytes"] = Opcode.MESSAGE_INDEX, 6 + 16 * n, 16 * n
            index["channel"] = records.channels
            index["entries"][:, :, 1] = place + records.starts[:, None]
            self._indexes[records] = index
            self.counts |= dict.fromkeys(records.channels, n)

    def fill(
        self, records: Records, values: Mapping[str, np.ndarray], sequence: np.ndarray, log_ns: np.ndarray
    ) -> None:
        """Set the numbers of all n messages of some records: values (n, count) for each hole, row numbers (n,) and log
        times (n,) [ns]."""
        stamps = np.stack(np.divmod(log_ns, 1_000_000_000), axis=1)
        given = {**values, ".when": _when(sequence, log_ns), STAMP: stamps}
        first = 0
        for piece in self._views[records]:
            rows = slice(first, first + len(piece))
            for field, name in records.sources:
                piece[field] = given[name][rows]
            first += len(piece)
        self._indexes[records]["entries"][:, :, 0] = log_ns

    def index_bytes(self) -> tuple[bytes, dict[int, int]]:
        """The MessageIndex records, and where each channel's begins."""
        offsets: dict[int, int] = {}
        base = 0
        for records, index in self._indexes.items():
            offsets |= {channel: base + i * index.itemsize for i, channel in enumerate(records.channels)}
            base += index.nbytes
        return b"".join(index.tobytes() for index in self._indexes.values()), offsets


def _when(sequence: np.ndarray, log_ns: np.ndarray) -> np.ndarray:
    """The bytes (n, 20) of row numbers (n,) and log times (n,) [ns] in messages."""
    when = np.empty(len(log_ns), _WHEN)
    when["sequence"], when["log"], when["publish"] = sequence & 0xFFFFFFFF, log_ns, log_ns
    return when.view(np.uint8).reshape(-1, 20)


def messages_in(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """The messages in the bytes of a block: channel, log time [ns] and content of each."""
    at = 0
    while at < len(data):
        _, length, channel, _, log_ns, _ = _MESSAGE.unpack_from(data, at)
        end = at + 9 + length
        yield channel, log_ns, data[at + _MESSAGE.size : end]
        at = end


class Format:
    """The channels of a log and the layout of its rows. ``names`` are the topics in their order; default: a new log's.
    Raises KeyError if a topic is unknown, or no topic has a signal.

    Messages of constant values are made only where they are written: who reads a log needs no closed form.

    Attributes:
        number, types: channel and ROS 2 type of each topic, in their order.
        row_records, arrow_records: the messages of a row, and the messages of the force arrows.
    """

    def __init__(self, header: Header, names: Sequence[str] | None = None) -> None:
        self.header = header
        self._rows = {topic.name: topic for topic in topics.sampled(header)}
        arrows = topics.arrows()
        self._arrows = {arrows.name: arrows}
        types = topics.ONCE | {name: topic.type for name, topic in (self._arrows | self._rows).items()}
        names = [*self._once[0], *self._arrows, *self._rows] if names is None else names
        self.number, self.types = {name: i + 1 for i, name in enumerate(names)}, {name: types[name] for name in names}
        self.row_records, self.arrow_records = self._records(self._rows), self._records(self._arrows)
        self._places = [self.row_records.place_of(signal.name) for signal in header.signals[1:]]  # t is the log time
        self.timestep, steps = header.scenario.simulation.timestep, header.scenario.steps
        self.most_rows = -(-steps // header.row_steps) + 1
        """Number of rows of a complete run."""
        self.arrow_every = max(1, round(1.0 / (topics.ARROWS_HZ * self.timestep * header.row_steps)))
        """Number of rows from one message of force arrows to the next."""
        self._block = functools.lru_cache(maxsize=2)(self._new_block)

    def _records(self, group: Mapping[str, Topic]) -> Records:
        return Records([(number, group[name]) for name, number in self.number.items() if name in group])

    @functools.cached_property
    def _once(self) -> tuple[dict[str, Topic], dict[str, np.ndarray]]:
        """The topics of constant values, and the values for their holes."""
        once, values = topics.once(self.header)
        return {topic.name: topic for topic in once}, values

    @functools.cached_property
    def once_records(self) -> Records:
        """The messages of constant values."""
        return self._records(self._once[0])

    @property
    def topics(self) -> tuple[Topic, ...]:
        """The topics in their order."""
        known = self._once[0] | self._arrows | self._rows
        return tuple(known[name] for name in self.number)

    def times(self, first_row: int, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Time [s] and log time [ns] of n rows (n,)."""
        steps = np.minimum(
            np.arange(first_row, first_row + n, dtype=np.int64) * self.header.row_steps, self.header.scenario.steps
        )
        t = steps * self.timestep
        return t, np.rint(t * _NS).astype(np.int64)

    def once_block(self) -> Block:
        """The messages of constant values, at time zero."""
        zero = np.zeros(1, np.int64)
        block = Block([(self.once_records, 1)])
        block.fill(self.once_records, {name: value[None] for name, value in self._once[1].items()}, zero, zero)
        return block

    def _new_block(self, into: int, n: int) -> Block:
        """A block of n rows with the force arrows between them; the last arrows precede it by ``into`` rows."""
        pieces: list[tuple[Records, int]] = []
        while n > 0:
            size = min(n, self.arrow_every - into)
            pieces += [(self.arrow_records, 1)] * (into == 0) + [(self.row_records, size)]
            into, n = 0, n - size
        return Block(pieces)

    def block(self, rows: np.ndarray, first_row: int) -> tuple[Block, np.ndarray]:
        """The messages of rows (n, width), valid until the next call, and the log times (n,) of the rows [ns]."""
        _, log_ns = self.times(first_row, len(rows))
        sequence = np.arange(first_row, first_row + len(rows), dtype=np.int64)
        block = self._block(first_row % self.arrow_every, len(rows))
        block.fill(self.row_records, topics.columns(self.header, rows), sequence, log_ns)
        some = sequence % self.arrow_every == 0
        if some.any():
            values = topics.force_columns(self.header, rows[some])
            block.fill(self.arrow_records, values, sequence[some] // self.arrow_every, log_ns[some])
        return block, log_ns

    def _belong(self, records: np.ndarray, first_row: int, log_ns: np.ndarray) -> bool:
        """Whether records have the expected row numbers and times, on every channel."""
        when = _when(np.arange(first_row, first_row + len(log_ns)), log_ns)
        return all(np.array_equal(records[f"{channel}.when"], when) for channel in self.row_records.channels)

    def is_once(self, data: bytes) -> bool:
        """Whether a chunk has the messages of constant values. The drawings may differ between versions."""
        channels, at = [], 0
        while at + _HEAD.itemsize <= len(data):
            opcode, length, channel = struct.unpack_from("<BQH", data, at)
            if opcode != Opcode.MESSAGE or length < _HEAD.itemsize - 9:
                return False
            channels.append(channel)
            at += 9 + length
        return at == len(data) and channels == [number for name, number in self.number.items() if name in topics.ONCE]

    def rows_of(self, raw: np.ndarray, first_row: int) -> np.ndarray | None:
        """Rows (n, width) of a chunk's bytes, equal bit for bit to those given to :meth:`block`.

        None if the chunk's layout, row numbers or times do not fit rows from first_row on.
        """
        row, arrow = self.row_records, self.arrow_records
        found, at = [], 0
        while at < len(raw):
            into = first_row % self.arrow_every
            if into == 0:  # only the place of the arrows is checked, because their looks may differ between versions
                if len(raw) - at < arrow.size or not np.array_equal(raw[at : at + _WHEN_AT], arrow.template[:_WHEN_AT]):
                    return None
                at += arrow.size
            n = min(self.arrow_every - into, (len(raw) - at) // row.size, self.most_rows - first_row)
            if n < 1:
                return None
            records = row.rows(raw[at : at + n * row.size].reshape(n, row.size))
            t, log_ns = self.times(first_row, n)
            if records is None or not self._belong(records, first_row, log_ns):
                return None
            found.append(np.concatenate([t[:, None], *(records[field][:, i] for field, i in self._places)], axis=1))
            first_row, at = first_row + n, at + n * row.size
        return np.concatenate(found) if found else None
