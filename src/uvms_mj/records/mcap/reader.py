"""Reading of logs: the exact numbers or one clear error. A log that was cut off is read up to the cut.

The contents of a log are never executed, unpickled or written to disk. A complete file has a checksum over all data. A
file that was cut off lacks it, but each chunk and each attachment has its own, and the rows must be consecutive.
"""

import contextlib
import dataclasses
import errno
import os
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, Metadata, Schema
from mcap.records import Header as FileHeader

from ...errors import InputError
from ...files import is_file
from ..header import Header, Outcome, Status
from .attachments import MOST_BYTES, header_of, outcome_of, refuse_large
from .layout import CHUNK_BYTES, Format
from .sink import MAGIC, sealed
from .topics import below

_BLOCK = 512
"""Smallest unit that a disk writes [bytes]."""
_STRIDE = 1 << 20
"""Bytes read at a time, in search of the end of what was written before a power cut: the rest is read as zeros."""
_TORN = (EndOfFile, McapError, struct.error)
"""Exceptions of the mcap package for an incomplete record."""


class _CutOff(Exception):
    """The file ends in the middle of a record, or before its end mark."""


def read(path: str | os.PathLike) -> tuple[Header, np.ndarray, Outcome, dict[str, bytes]]:
    """Read a log: its header, the rows (n, width) of its signals, its outcome, and all attachments by name.

    A log that was cut off is read up to the cut. The outcome's message describes the missing part; its status is
    ``truncated`` unless the log contains the outcome. Raises InputError if the file can't be read, is not a log of
    uvms-mj, or is damaged.
    """
    with _opened(path) as reader:
        return reader.read()


def read_files(path: str | os.PathLike) -> tuple[Header, dict[str, bytes]]:
    """Read the header and the attached files of a log; raises as :func:`read` does.

    The samples are not read, because each attachment has its own checksum.
    """
    with _opened(path) as reader:
        return reader.read_header(), reader.files


@contextlib.contextmanager
def _opened(path: str | os.PathLike) -> Iterator["_Reader"]:
    if not os.fspath(path):
        raise InputError("the name of a log is empty")
    path = Path(path)
    if os.path.exists(path) and not (path.is_file() or path.is_dir()):
        raise InputError(f"{path}: is not a regular file, but a pipe or a device")
    try:
        with open(path, "rb") as file:
            yield _Reader(file)
    except OSError as error:
        inside = path / "run.mcap"
        hint = f"; did you mean {inside}?" if is_file(inside) else ""
        raise InputError(f"{path}: can't read it: {error.strerror}{hint}") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (*_TORN, UnicodeDecodeError, KeyError, OverflowError) as error:
        raise InputError(f"{path}: is damaged: {type(error).__name__} {error}") from None


class _Reader:
    def __init__(self, file: BinaryIO) -> None:
        self.file = file
        self.size = os.fstat(file.fileno()).st_size
        magic = file.read(len(MAGIC))
        if magic != MAGIC:
            raise InputError("is empty" if not self.size else "is not an MCAP file")
        file.seek(max(len(MAGIC), self.size - len(MAGIC)))
        self.whole = file.read() == MAGIC  # then no part may be missing
        self.written = self.size if self.whole else _end_of_writing(file, self.size)
        self.size = min(self.size, -(-self.written // _BLOCK) * _BLOCK)
        file.seek(len(MAGIC))
        self.crc = zlib.crc32(MAGIC)
        self.files: dict[str, bytes] = {}
        self.header: Header | None = None
        self.blocks: list[np.ndarray] = []
        self.rows = 0

    def read(self) -> tuple[Header, np.ndarray, Outcome, dict[str, bytes]]:
        missing = ""
        try:
            self._data_section()
            self._summary()
        except _CutOff as cut:
            if self.whole:
                raise InputError(f"is damaged: {cut}") from None
            if self.header is None:
                raise InputError(f"was cut off before its first sample: {cut}") from None
            missing = str(cut)
        assert self.header is not None
        outcome = outcome_of(self.files["outcome.json"]) if "outcome.json" in self.files else None
        rows = np.concatenate(self.blocks) if self.blocks else np.zeros((0, self.header.width))
        return self.header, rows, self._outcome(outcome, missing), self.files

    def read_header(self) -> Header:
        """Read the part of the log before the samples."""
        try:
            self._data_section(header_only=True)
        except _CutOff as cut:
            raise InputError(f"was cut off before its first sample: {cut}") from None
        assert self.header is not None
        return self.header

    def _outcome(self, outcome: Outcome | None, missing: str) -> Outcome:
        header = self.header
        assert header is not None
        h, steps = header.scenario.simulation.timestep, header.scenario.steps
        if outcome is not None:
            whole = outcome.status is Status.completed
            begun = -(-outcome.steps // header.row_steps)  # rows of steps; the state after the last step is one more
            rows = (begun + 1,) if whole else (begun, begun + 1)
            if outcome.steps > steps or (whole and outcome.steps < steps) or self.rows not in rows:
                raise InputError(f"is damaged: {self.rows} rows do not fit {outcome.steps} steps")
            if not missing:
                return outcome
            note = f"all samples are present, but the end of the file is missing: {missing}"
            return dataclasses.replace(outcome, message=f"{outcome.message} ({note})".strip())
        last = min((self.rows - 1) * header.row_steps, steps) if self.rows else 0
        there = (
            f"it has {self.rows} rows up to t = {last * h:g} s of {steps * h:g} s" if self.rows else "it has no rows"
        )
        return Outcome(Status.truncated, f"the log was cut off ({missing}); {there}", last, 0.0)

    def _records(self) -> Iterator[tuple[int, bytes]]:
        """Top-level records of the data section, DataEnd included."""
        while True:
            at = self.file.tell()
            if at + 9 > self.size:
                raise _CutOff(f"it ends at byte {self.size}, without an end mark")
            head = self.file.read(9)
            opcode, length = struct.unpack("<BQ", head)
            if not self.whole and at >= self.written:
                raise _CutOff(f"all bytes from byte {at} on are zero")
            if length > self.size - at - 9:
                raise _CutOff(f"the record at byte {at} is incomplete")
            if length > MOST_BYTES:
                raise InputError(f"is damaged: a record of {length / 1e6:.4g} MB at byte {at}")
            content = self.file.read(length)
            if opcode != Opcode.DATA_END:
                self.crc = zlib.crc32(content, zlib.crc32(head, self.crc))
            yield opcode, content
            if opcode == Opcode.DATA_END:
                return

    def _data_section(self, header_only: bool = False) -> None:
        """Read up to DataEnd, whose checksum covers the data section, or with ``header_only`` up to the first chunk."""
        format: Format | None = None
        notes: dict[str, str] = {}
        channels: list[tuple[int, bytes]] = []
        for number, (opcode, content) in enumerate(self._records()):
            stream = ReadDataStream(BytesIO(content))
            if number == 0:
                if opcode != Opcode.HEADER or not FileHeader.read(stream).library.startswith("uvms-mj"):
                    raise InputError("is an MCAP file, but not a log that uvms-mj wrote")
            elif opcode == Opcode.ATTACHMENT:
                self._attachment(stream, content)
            elif opcode == Opcode.METADATA:
                notes |= Metadata.read(stream).metadata
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                channels.append((opcode, content))
            elif opcode == Opcode.CHUNK:
                if format is None:
                    self.header = header_of(self.files)
                    format = _format(self.header, channels, notes)
                if header_only:
                    return
                try:
                    self._chunk(format, Chunk.read(stream))
                except (InputError, *_TORN):
                    if self.file.tell() <= self.written:
                        raise
                    raise _CutOff("the last chunk is zero-filled (interrupted write)") from None
            elif opcode == Opcode.DATA_END:
                if DataEnd.read(stream).data_section_crc != self.crc:
                    raise InputError("is damaged: its checksum does not match")
            elif opcode != Opcode.MESSAGE_INDEX:
                raise InputError(f"is damaged: unknown record type {opcode}")
        if "outcome.json" not in self.files or format is None:
            raise InputError("is damaged: the run's outcome is missing")

    def _attachment(self, stream: ReadDataStream, content: bytes) -> None:
        attachment = Attachment.read(stream)
        if zlib.crc32(content[:-4]) != int.from_bytes(content[-4:], "little"):
            raise InputError(f"is damaged: the attachment {attachment.name!r}")
        if attachment.name in self.files:
            raise InputError(f"is damaged: two attachments {attachment.name!r}")
        self.files[attachment.name] = attachment.data
        refuse_large(self.files)

    def _chunk(self, format: Format, chunk: Chunk) -> None:
        """Read the rows of a chunk, which must continue the rows before it."""
        size, most = chunk.uncompressed_size, 2 * max(CHUNK_BYTES, format.row_records.size)  # of rows
        try:
            fits = chunk.compression == "zstd" and zstandard.frame_content_size(chunk.data) == size
            if not fits or (size > most and size > 2 * format.once_records.size):
                raise InputError("is damaged: a chunk has an impossible size")
            data = zstandard.ZstdDecompressor().decompress(chunk.data, allow_extra_data=False)
        except zstandard.ZstdError as error:
            raise InputError(f"is damaged: {error}") from None
        if zlib.crc32(data) != chunk.uncompressed_crc:
            raise InputError("is damaged: a chunk's checksum does not match")
        if not self.rows and format.is_once(data):
            return
        rows = format.rows_of(np.frombuffer(data, np.uint8), self.rows)
        if rows is None:
            raise InputError(f"is damaged: the chunk after row {self.rows} has a wrong layout")
        self.blocks.append(rows)
        self.rows += len(rows)

    def _summary(self) -> None:
        """Check the summary section after the data. It is not used, but damage to it is reported."""
        start = self.file.tell()
        if self.size - start > start + MOST_BYTES:  # an index is smaller than the data that it refers to
            raise InputError("is damaged: its index is larger than its data")
        rest = self.file.read(self.size - start)
        footer_size = 9 + 20
        if len(rest) < footer_size + len(MAGIC) or not self.whole:
            raise _CutOff("its index is incomplete")
        summary, end = rest[: -footer_size - len(MAGIC)], rest[-footer_size - len(MAGIC) : -len(MAGIC)]
        footer = Footer.read(ReadDataStream(BytesIO(end[9:])))
        if footer.summary_start != start or footer.summary_crc != zlib.crc32(end[:-4], zlib.crc32(summary)):
            raise InputError("is damaged: the checksum of its index does not match")


def _format(header: Header, records: list[tuple[int, bytes]], notes: dict[str, str]) -> Format:
    """The layout of a log's rows. Raises InputError if the metadata or channels are damaged, or the topics are not
    a log's with this header."""
    raw = b"".join(struct.pack("<BQ", opcode, len(content)) + content for opcode, content in records)
    if notes != sealed(notes) or notes.get("crc32 of channels") != f"{zlib.crc32(raw):08x}":
        raise InputError("is damaged: its metadata or channels are wrong")
    kinds: dict[int, str] = {}
    found: dict[str, tuple[int, str | None]] = {}
    for opcode, content in records:
        stream = ReadDataStream(BytesIO(content))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            kinds[schema.id] = schema.name
        else:
            channel = Channel.read(stream)
            found[channel.topic.removeprefix(below(header))] = channel.id, kinds.get(channel.schema_id)
    with contextlib.suppress(KeyError):  # of a topic or a signal
        format = Format(header, list(found))
        if found == {name: (format.number[name], kind.replace("/", "/msg/")) for name, kind in format.types.items()}:
            return format
    version = header.versions.get("uvms-mj", "of another version")
    raise InputError(f"was written by uvms-mj {version}, whose topics differ from this version's")


def _end_of_writing(file: BinaryIO, size: int) -> int:
    """Offset of the zeros at the end of a file of ``size`` bytes; ``size`` if there are none."""
    while size:
        size = _end_of_data(file, size)
        start = max(0, size - 1) // _STRIDE * _STRIDE
        file.seek(start)
        if rest := file.read(size - start).rstrip(b"\0"):
            return start + len(rest)
        size = start
    return 0


def _end_of_data(file: BinaryIO, size: int) -> int:
    """Offset of the hole at the end of the first ``size`` bytes of a sparse file; ``size`` if there is none. The hole
    is not read, because it may be of any size."""
    end = 0
    try:
        while end < size and (start := os.lseek(file.fileno(), end, os.SEEK_DATA)) < size:
            end = os.lseek(file.fileno(), start, os.SEEK_HOLE)
    except (OSError, AttributeError) as error:  # no data follows, or the file system or Python does not report holes
        return end if getattr(error, "errno", None) == errno.ENXIO else size
    return min(end, size)
