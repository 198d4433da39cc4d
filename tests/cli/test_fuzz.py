"""A short fuzzing campaign: no traceback, wrong status, hang or unbounded memory. scripts/fuzz.py runs a long one."""

import pytest

from fuzzer import campaign, told


@pytest.mark.processes
def test_mutated_inputs_are_refused_in_one_message_or_run_as_they_say():
    failures, kinds = campaign(range(90_000, 90_070), workers=1)
    assert not failures, told(failures)
    assert sum(kinds.values()) == 70
    assert set(kinds) == {"scenario", "text", "set", "vehicle", "law", "log", "forged"}
