"""Mutated logs: damaged at random, or forged with valid checksums."""

import struct
import zlib
from functools import cache
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

import zstandard
from mcap.records import Attachment, Chunk, DataEnd
from mcap.stream_reader import StreamReader

from mutated_values import TOKENS, Case, Random, mutated_bytes, value
from uvms_mj import McapLog, Scenario, simulate
from uvms_mj.records.mcap.sink import record_bytes

COMMANDS = ("run", "info", "export", "certify", "plot")


@cache
def _log(law: str) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder, "run.mcap")
        simulate(Scenario.load("push_wall", {"simulation.duration": 0.03}, law), sinks=[McapLog(path)])
        return path.read_bytes()


def log(rng: Random) -> Case:
    data = original = _log(rng.choice(("gsta", "fosm")))
    forged = rng.random() < 0.5
    if forged:
        data = _forged(rng, data)
    elif rng.random() < 0.3:
        data = data[: rng.randrange(len(data))] + bytes(rng.choice((0, 0, 512, 100_000)))
    else:
        data = mutated_bytes(rng, data)
    command = rng.choices(COMMANDS, (2, 8, 2, 2, 0.5))[0]
    arguments = {
        "run": ("run", "--from", "x.mcap", "--json", "-o", "out"),
        "info": ("info", "x.mcap", "--json"),
        "export": ("export", "x.mcap", "--to", rng.choice(("csv", "npz", "parquet", "mat"))),
        "certify": ("certify", "--from", "x.mcap", "--json"),
        "plot": ("plot", "x.mcap", "--what", "force", "--out", "x.svg"),
    }[command]
    return Case("forged" if forged else "log", arguments, {"x.mcap": data}, None if forged else original)


def _forged(rng: Random, data: bytes) -> bytes:
    """A log with changed records and valid checksums, as made by someone who knows the format."""
    records = list(StreamReader(BytesIO(data), emit_chunks=True).records)
    chosen = rng.choice([r for r in records if isinstance(r, Attachment | Chunk)] + records)
    out = bytearray(data[:8])
    for record in records:
        if isinstance(record, DataEnd):
            record.data_section_crc = zlib.crc32(out)
        if record is chosen:
            if isinstance(record, Attachment):
                record.data = _changed_file(rng, record.data)
            elif isinstance(record, Chunk):
                _change_chunk(rng, record)
            else:
                raw = record_bytes(record)
                action = rng.randrange(3)
                if action == 0:  # a wrong record length
                    raw = raw[:1] + struct.pack("<Q", rng.choice((0, 1, 2**20, 2**40, 2**63, 2**64 - 1))) + raw[9:]
                out += raw * (0 if action == 1 else 2) if action else raw
                continue
        out += record_bytes(record)
    return bytes(out + data[-8:]) if rng.random() < 0.5 else bytes(out)


def _changed_file(rng: Random, data: bytes) -> bytes:
    if rng.random() < 0.5:
        return mutated_bytes(rng, data, (*TOKENS, b"null", b"{}", b'"' + b"A" * 999 + b'"', b"1," * 9999))
    words = data.split(b" ")
    words[rng.randrange(len(words))] = repr(value(rng)).encode(errors="replace")
    return b" ".join(words)


def _change_chunk(rng: Random, chunk: Chunk) -> None:
    data = zstandard.ZstdDecompressor().decompress(chunk.data)
    data = mutated_bytes(rng, data) if rng.random() < 0.7 else data[: rng.randrange(len(data))]
    chunk.data, chunk.uncompressed_crc = zstandard.ZstdCompressor().compress(data), zlib.crc32(data)
    chunk.uncompressed_size = len(data)
