"""Truncated and damaged logs give their beginning or one clear error."""

import dataclasses
import io
import itertools
import os
import random
import re
import struct
import time
import zlib

import numpy as np
import pytest
from mcap.stream_reader import StreamReader

from uvms_mj import InputError, McapLog, Scenario, Status, Trace, simulate


def test_rows_that_do_not_fit_the_steps_are_no_complete_log(logged, tmp_path):
    trace, _ = logged
    for outcome in (
        dataclasses.replace(trace.outcome, steps=trace.steps - trace.header.row_steps),
        dataclasses.replace(trace.outcome, steps=trace.steps + trace.header.row_steps),
    ):
        path = tmp_path / f"{outcome.steps}.mcap"
        dataclasses.replace(trace, outcome=outcome).save(path)
        with pytest.raises(InputError, match="do not fit"):
            Trace.load(path)


def tried(path):
    """A log's trace, or None and the error message."""
    try:
        return Trace.load(path), ""
    except InputError as error:
        return None, str(error)


def test_every_truncation_gives_a_beginning_or_one_clear_error(logged, tmp_path):
    trace, path = logged
    data = path.read_bytes()
    places = sorted(
        {*range(0, 64, 4), *random.Random(1).sample(range(len(data)), 40), *range(len(data) - 40, len(data), 3)}
    )
    cut = tmp_path / "cut.mcap"
    lengths = []
    for place in places:
        cut.write_bytes(data[:place])
        part, said = tried(cut)
        if part is None:
            assert "cut off before its first sample" in said or "not an MCAP" in said or not place
            continue
        assert part.status in (Status.truncated, trace.status)
        assert part.message
        lengths.append(len(part))
        for name in part:
            assert np.array_equal(part[name], trace[name][: len(part)]), (place, name)
        if part.status is not Status.truncated:
            assert len(part) == len(trace)
    assert lengths == sorted(lengths)
    assert lengths[-1] == len(trace)
    assert len(set(lengths)) > 3


def test_damaged_logs_never_pass_for_what_they_are_not(tmp_path):
    """Bits are flipped and logs truncated anywhere, including metadata and attachments."""
    log = tmp_path / "run.mcap"
    scenario = {
        "simulation.duration": 0.1,
        "wall.position": 0.002,
        "reference.step_time": 0.0,
        "description": "x" * 200,
    }
    trace = simulate(Scenario.load("push_wall", scenario), sinks=[McapLog(log)], engine="mujoco")
    data = log.read_bytes()
    dice = random.Random(20261121)
    ends = [m.start() for m in re.finditer(rb"uvms_mj|run\.json|scenario\.toml|outcome\.json|geometry\.json", data)]
    damaged = tmp_path / "damaged.mcap"
    told = 0
    for i in range(200):
        copy = bytearray(data)
        anywhere, elsewhere = dice.randrange(len(data)), dice.choice(ends) + dice.randrange(-40, 400)
        place = min(len(data) - 1, elsewhere) if i % 2 else anywhere  # half of them near metadata, the smaller part
        copy[place] ^= 1 << dice.randrange(8)
        if i % 5 == 0:
            copy = copy[: dice.randrange(len(copy))]
        damaged.write_bytes(copy)
        intact = bytes(copy) == data[: len(copy)]
        start = time.monotonic()
        part, said = tried(damaged)
        if part is None:
            assert said.startswith(str(damaged))
            assert len(said) < 600
            told += 1
        else:
            assert intact or i % 5 == 0 or "the end of the file is missing" in part.message, place
            assert part.status is Status.truncated or len(part) == len(trace)
            for name in part:
                assert np.array_equal(part[name], trace[name][: len(part)]), (place, name)
            assert part.scenario == trace.scenario
            assert part.header.mjcf == trace.header.mjcf
            assert part.header.law == trace.header.law
            assert part.header.geometry.shapes == trace.header.geometry.shapes
        assert time.monotonic() - start < 5.0
    assert told > 150


def ends_of_chunks(data: bytes) -> list[int]:
    ends, at = [], 8
    while at < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, at)
        at += 9 + length
        ends += [at] if opcode == 6 else []
    return ends


def test_a_record_that_reaches_beyond_a_whole_log_is_damage_and_no_cut(logged, tmp_path):
    data = bytearray(logged[1].read_bytes())
    struct.pack_into("<Q", data, ends_of_chunks(data)[0] + 1, len(data))
    (tmp_path / "long.mcap").write_bytes(data)
    with pytest.raises(InputError, match="is damaged: "):
        Trace.load(tmp_path / "long.mcap")


def test_a_tail_of_zeros_is_what_a_power_cut_left_unwritten(logged, tmp_path):
    trace, path = logged
    data, cut = path.read_bytes(), tmp_path / "cut.mcap"
    _, first, *_, last = ends_of_chunks(data)
    for block, part in itertools.product((512, 4096), (0.1, 0.9)):
        end = int(first + part * (last - first)) // block * block
        cut.write_bytes(data[:end])
        expected = Trace.load(cut)
        for zeros in (block, 5_000_003):
            cut.write_bytes(data[:end] + bytes(zeros))
            found = Trace.load(cut)
            assert found.status is Status.truncated
            assert len(found) == len(expected) > 0
            assert all(np.array_equal(found[name], expected[name]) for name in found)
    for byte in range(0, 60, 6):  # a block may also be written in part
        cut.write_bytes(data[: last - byte] + bytes(5000))
        found = Trace.load(cut)
        assert found.status is Status.truncated
        assert all(np.array_equal(found[name], trace[name][: len(found)]) for name in found)
    cut.write_bytes(data[:first] + bytes(100) + data[first + 100 :])  # a hole is not a truncation
    with pytest.raises(InputError, match="damaged"):
        Trace.load(cut)


def test_a_record_that_is_whole_is_kept_though_only_zeros_follow(logged, tmp_path):
    """The last record may end anywhere, also with a zero byte."""
    _, path = logged
    data, cut = path.read_bytes(), tmp_path / "cut.mcap"
    for end in ends_of_chunks(data)[1:]:
        cut.write_bytes(data[:end])
        expected = Trace.load(cut)
        cut.write_bytes(data[:end] + bytes(4096))
        assert len(Trace.load(cut)) == len(expected)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"not a log at all", "not an MCAP file"),
        (b"\x89MCAP0\r\n", "cut off"),
        (b"\x89MCAP0\r\n" + b"\xff" * 100, "cut off|damaged"),
        (b"\x89MCAP0\r\n\x0f" + struct.pack("<Q", 1 << 62) + b"x" * 50, "cut off|damaged"),
    ],
)
def test_what_is_no_log_gets_one_clear_error(tmp_path, here, content, message):
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(InputError, match=message):
        Trace.load(tmp_path / "x.mcap")
    for command in ("info", "replay"):
        done = here(command, "x.mcap")
        assert done.exit_code == 2
        assert done.stderr.startswith("error: x.mcap")


def test_a_log_without_a_checksum_is_damaged(logged, tmp_path):
    """MCAP allows 0 for none, but a log always has one: who writes 0 may have changed any row."""
    data = bytearray(logged[1].read_bytes())
    crc = data.rindex(b"\x0f" + struct.pack("<Q", 4)) + 9
    data[crc : crc + 4] = bytes(4)
    (tmp_path / "x.mcap").write_bytes(data)
    with pytest.raises(InputError, match="is damaged: its checksum does not match"):
        Trace.load(tmp_path / "x.mcap")


def test_a_pipe_is_no_log_and_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "run.mcap")
    with pytest.raises(InputError, match=r"run\.mcap: is not a regular file, but a pipe"):
        Trace.load(tmp_path / "run.mcap")


def test_an_mcap_file_of_somebody_elses_is_named_as_such(tmp_path):
    from mcap.writer import Writer

    buffer = io.BytesIO()
    writer = Writer(buffer)
    writer.start("ros2")
    writer.finish()
    (tmp_path / "x.mcap").write_bytes(buffer.getvalue())
    with pytest.raises(InputError, match="not a log that uvms-mj wrote"):
        Trace.load(tmp_path / "x.mcap")
    with pytest.raises(InputError, match="No such file"):
        Trace.load(tmp_path / "nowhere.mcap")
    with pytest.raises(InputError, match=r"directory$"):
        Trace.load(tmp_path)
    (tmp_path / "x.mcap").rename(tmp_path / "run.mcap")
    with pytest.raises(InputError, match=r"directory; did you mean .*run\.mcap\?"):
        Trace.load(tmp_path)


@pytest.mark.parametrize("keep", [0, 1, 100, 300])
def test_a_chunk_that_is_too_short_is_damage_whatever_its_checksum(logged, tmp_path, keep):
    import zstandard
    from mcap.records import Chunk, DataEnd

    from uvms_mj.records.mcap.sink import record_bytes

    out, number = bytearray(logged[1].read_bytes()[:8]), 0
    with open(logged[1], "rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, DataEnd):
                break
            if isinstance(record, Chunk):
                number += 1
                if number == 2:
                    data = zstandard.ZstdDecompressor().decompress(record.data)[:keep]
                    record.data, record.uncompressed_size = zstandard.ZstdCompressor().compress(data), keep
                    record.uncompressed_crc = zlib.crc32(data)
            out += record_bytes(record)
    (tmp_path / "x.mcap").write_bytes(out)
    with pytest.raises(InputError, match="damaged"):
        Trace.load(tmp_path / "x.mcap")
