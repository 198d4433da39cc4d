"""Logs of other formats are refused with the version that reads them."""

import re

import pytest

from recorded import rewritten, same
from uvms_mj import InputError, Trace
from uvms_mj.plant import looks
from uvms_mj.records.mcap import attachments, topics


def test_another_format_is_refused_with_the_version_that_reads_it(logged, tmp_path):
    _, path = logged
    now = attachments.FORMAT

    def forged(number):
        (tmp_path / "x.mcap").write_bytes(
            rewritten(path, lambda n, d: (n, re.sub(rb'("format": )\d+', rb"\g<1>%d" % number, d)))
        )
        return tmp_path / "x.mcap"

    for number in (0, -3):
        with pytest.raises(
            InputError, match=rf"has log format {number}, which uvms-mj [\d.]+ reads; this version reads"
        ):
            Trace.load(forged(number))
    with pytest.raises(InputError, match=rf"has log format {now + 1}, which uvms-mj [\d.]+ or later reads"):
        Trace.load(forged(now + 1))


def test_a_log_is_read_whatever_the_order_of_its_topics_and_the_looks_of_its_markers(logged, tmp_path, monkeypatch):
    """They may change from version to version."""
    trace, _ = logged
    sampled = topics.sampled
    monkeypatch.setattr(topics, "sampled", lambda header: sampled(header)[::-1])
    monkeypatch.setattr(looks, "WALL_RGBA", (1.0, 0.0, 0.0, 1.0))
    trace.save(tmp_path / "run.mcap")
    monkeypatch.undo()
    same(trace, Trace.load(tmp_path / "run.mcap"))
