"""Sink that writes a run to an MCAP file while the run goes on.

Records follow the MCAP specification, version 0, and are written by ``mcap``. Only the messages are laid out by NumPy,
because a run has millions. Every chunk is written at once in a single write, so that all written chunks can be read
after ``kill -9``.
"""

import errno
import os
import zlib
from io import FileIO
from pathlib import Path

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.records import Header as FileHeader

from ...errors import InputError
from ..header import Header, Outcome
from . import ros2
from .attachments import header_files, outcome_file
from .layout import CHUNK_BYTES, Block, Format
from .topics import below

MAGIC = b"\x89MCAP0\r\n"
METADATA, SEAL = "uvms_mj", "crc32"
_LEVEL, _LEVEL_OF_ONCE = -2, 3
"""zstd's levels for rows, half again as fast as level 1 for the same size within 5 %, and for the constant messages."""
_MEDIA = {".json": "application/json", ".toml": "application/toml", ".xml": "application/xml"}
_MEDIA |= {".py": "text/x-python", ".c": "text/x-c", ".h": "text/x-c"}


class LogExistsError(InputError, FileExistsError):
    """A log has the name of a file that exists. Nothing that was recorded is overwritten."""


class McapLog:
    """A sink that writes a log.

    Args:
        path: the new file; it must not exist.
    """

    def __init__(self, path: str | os.PathLike) -> None:
        self.path = Path(path)
        self._file: FileIO | None = None

    def begin(self, header: Header) -> None:
        """Write everything but the rows.

        Raises:
            LogExistsError: the file exists.
            OSError: the file can't be created.
        """
        self.format = Format(header)
        try:
            self._file = FileIO(self.path, "xb")
        except FileExistsError:
            raise LogExistsError(f"{self.path}: exists; give the log another name, or remove the file") from None
        self._rows = self._size = self._crc = self._chunks = self._end_ns = 0
        self._counts = dict.fromkeys(range(1, len(self.format.topics) + 1), 0)
        self._chunk_indexes = bytearray()
        self._indexes: list[McapRecord] = []
        self._compressor = zstandard.ZstdCompressor(level=_LEVEL_OF_ONCE)
        self._append(MAGIC + record_bytes(FileHeader("ros2", f"uvms-mj {header.versions.get('uvms-mj', '')}")))
        for name, data in header_files(header).items():
            self._attach(name, data)
        channels = b"".join(map(record_bytes, channel_records(self.format)))
        facts = sealed(metadata(header) | {"crc32 of channels": f"{zlib.crc32(channels):08x}"})
        note = record_bytes(Metadata(METADATA, facts))
        self._indexes.append(MetadataIndex(self._size, len(note), METADATA))
        self._append(note)
        self._append(channels)
        self._chunk(self.format.once_block(), np.zeros(1, np.int64))
        self._compressor = zstandard.ZstdCompressor(level=_LEVEL)

    def write(self, rows: np.ndarray) -> None:
        """Append rows (n, width) as one chunk, or as several if they exceed CHUNK_BYTES."""
        most = max(1, CHUNK_BYTES // self.format.row_records.size)
        for start in range(0, len(rows), most):
            part = rows[start : start + most]
            self._chunk(*self.format.block(part, self._rows))
            self._rows += len(part)

    def end(self, outcome: Outcome) -> None:
        """Write the outcome and the summary section, which makes a file quick to search."""
        self._attach("outcome.json", outcome_file(outcome))
        self._append(record_bytes(DataEnd(self._crc)))
        start = self._size
        records = [*channel_records(self.format), self._statistics(), *self._indexes]
        crc, offsets = 0, b""
        for kind in (Schema, Channel, Statistics, ChunkIndex, AttachmentIndex, MetadataIndex):
            found = (record_bytes(each) for each in records if isinstance(each, kind))
            data = self._chunk_indexes if kind is ChunkIndex else b"".join(found)
            offsets += record_bytes(SummaryOffset(data[0], self._size, len(data)))
            self._append(data)
            crc = zlib.crc32(data, crc)
        footer = record_bytes(Footer(start, self._size, 0))[:-4]  # the checksum covers all of the footer before it
        crc = zlib.crc32(footer, zlib.crc32(offsets, crc))
        self._append(offsets + footer + crc.to_bytes(4, "little") + MAGIC)
        assert self._file is not None
        self._file.close()

    def _statistics(self) -> Statistics:
        attachments = sum(isinstance(each, AttachmentIndex) for each in self._indexes)
        return Statistics(
            attachment_count=attachments,
            channel_count=len(self.format.topics),
            channel_message_counts={channel: n for channel, n in self._counts.items() if n},
            chunk_count=self._chunks,
            message_count=sum(self._counts.values()),
            message_end_time=self._end_ns,
            message_start_time=0,
            metadata_count=len(self._indexes) - attachments,
            schema_count=len({topic.type for topic in self.format.topics}),
        )

    def _append(self, data: bytes | bytearray) -> None:
        """Append all of data, after removing any remains of an interrupted or failed write."""
        assert self._file is not None
        if self._file.tell() != self._size:
            self._file.seek(self._size)
            self._file.truncate()
        view = memoryview(data)
        while len(view):
            written = self._file.write(view)
            if not written:
                raise OSError(errno.EIO, os.strerror(errno.EIO), str(self.path))
            view = view[written:]
        self._size, self._crc = self._size + len(data), zlib.crc32(data, self._crc)

    def _attach(self, name: str, data: bytes) -> None:
        media = _MEDIA.get(os.path.splitext(name)[1], "application/octet-stream")
        record = record_bytes(Attachment(create_time=0, log_time=self._end_ns, name=name, media_type=media, data=data))
        self._indexes.append(AttachmentIndex(self._size, len(record), self._end_ns, 0, len(data), name, media))
        self._append(record)

    def _chunk(self, block: Block, log_ns: np.ndarray) -> None:
        """Write one chunk and the indexes of its messages in a single write."""
        data = block.data.data
        compressed = self._compressor.compress(data)
        times = {"message_start_time": int(log_ns[0]), "message_end_time": int(log_ns[-1])}
        size, crc = len(data), zlib.crc32(data)
        chunk = record_bytes(
            Chunk(compression="zstd", data=compressed, uncompressed_crc=crc, uncompressed_size=size, **times)
        )
        indexes, offsets = block.index_bytes()
        start = self._size + len(chunk)
        index = ChunkIndex(
            chunk_length=len(chunk),
            chunk_start_offset=self._size,
            compression="zstd",
            compressed_size=len(compressed),
            message_index_length=len(indexes),
            message_index_offsets={channel: start + offset for channel, offset in offsets.items()},
            uncompressed_size=size,
            **times,
        )
        self._append(chunk + indexes)
        self._chunks += 1
        self._end_ns = times["message_end_time"]
        self._chunk_indexes += record_bytes(index)
        for channel, n in block.counts.items():
            self._counts[channel] += n


def channel_records(format: Format) -> list[McapRecord]:
    """The schemas and channels of a log."""
    kinds = list(dict.fromkeys(topic.type for topic in format.topics))
    schemas = [
        Schema(id=i + 1, data=ros2.schema_text(kind).encode(), encoding="ros2msg", name=kind.replace("/", "/msg/"))
        for i, kind in enumerate(kinds)
    ]
    channels = [
        Channel(
            id=format.number[topic.name],
            topic=below(format.header) + topic.name,
            message_encoding="cdr",
            schema_id=kinds.index(topic.type) + 1,
            metadata={
                "unit": topic.unit,
                "frame": topic.frame,
                "meaning": topic.meaning,
                "offered_qos_profiles": ros2.LATCHED_QOS if topic.latched else "",
            },
        )
        for topic in format.topics
    ]
    return [*schemas, *channels]


def metadata(header: Header) -> dict[str, str]:
    """Facts of a run for other tools to show. Loading a log uses the attachments instead."""
    return {
        "scenario": header.scenario.name,
        "controller": header.scenario.controller.label(),
        "law": header.law.source,
        "law_sha256": header.law.sha256 or "",
        "law_is_given": "the truth" if header.scenario.controller.uses_truth else "measurements and estimates",
        "vehicle": header.mjcf.name,
        "frames": "map is W (x to the wall, y left, z up), base_link is B (forward, left, up)",
        "units": "SI; radians; wrenches and twists linear first",
    } | {f"version {name}": version for name, version in header.versions.items()}


def sealed(values: dict[str, str]) -> dict[str, str]:
    """The values with a checksum of them; MCAP itself has none for metadata."""
    open_ = {name: value for name, value in values.items() if name != SEAL}
    return open_ | {SEAL: f"{zlib.crc32(repr(sorted(open_.items())).encode()):08x}"}


def record_bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()
