"""Rows reach the sinks complete and in order, also under interrupts, failing sinks and slow sinks."""

import itertools
import sys
import time

import numpy as np
import pytest

from forked import done as forked
from uvms_mj import Scenario, SinkError, Status, simulate
from uvms_mj.records.writing import Writing

SHORT = Scenario.load("push_wall", {"simulation.duration": 0.5})


class Kept:
    """A sink that keeps rows and outcome."""

    def begin(self, header):
        self.blocks, self.outcome = [], None

    def write(self, rows):
        self.blocks.append(rows)

    def end(self, outcome):
        self.outcome = outcome


STORM = """if True:
    import random, signal
    import numpy as np
    from uvms_mj import Scenario, Status, simulate
    from uvms_mj.engine.engines import MujocoEngine
    from test_writing import Kept

    MujocoEngine.chunk_steps = 1  # rows are passed on at every step, so that interrupts often come at that moment
    scenario = Scenario.load("push_wall", {"simulation.duration": 2000.0})
    dice = random.Random(1)

    def interrupt(*_):
        signal.signal(signal.SIGALRM, signal.SIG_IGN)
        raise KeyboardInterrupt

    class Begun(Kept):
        def begin(self, header):
            super().begin(header)
            signal.signal(signal.SIGALRM, interrupt)
            signal.setitimer(signal.ITIMER_REAL, dice.uniform(0.002, 0.03))

    met = 0
    for _ in range(150):
        sink = Begun()
        try:
            trace = simulate(scenario, sinks=[sink], log_rate="full")
        except KeyboardInterrupt:  # before or after the steps
            continue
        assert trace.status is Status.interrupted
        assert sink.outcome == trace.outcome
        if not sink.blocks:  # before the first row
            assert not len(trace)
            continue
        met += 1
        rows = np.concatenate(sink.blocks)
        assert np.array_equal(rows[:, 0], trace.t)
        assert np.array_equal(np.rint(np.diff(rows[:, 0]) / 1e-4), np.ones(len(rows) - 1)), "a row is missing or double"
    assert met > 50, met
"""


def test_an_interrupt_at_any_line_of_a_start_is_nothing_else():
    """Also at a line of Python's own modules: threading.Thread.start makes a RuntimeError of some."""
    for moment in itertools.count():
        left = iter(range(moment))

        def at_a_line(frame, event, arg, left=left):
            if next(left, None) is None:
                raise KeyboardInterrupt
            return at_a_line

        sys.settrace(at_a_line)
        try:
            Writing([Kept()], None)
            break  # there are no more lines
        except KeyboardInterrupt:
            continue
        finally:
            sys.settrace(None)
    assert moment > 10


def test_no_interrupt_at_any_moment_hangs_a_run_or_loses_a_row(request):
    done = forked(code=STORM, cwd=request.path.parent)
    assert done.exit_code == 0, done.stderr


@pytest.mark.parametrize("kind", [OSError, SystemExit, MemoryError])
@pytest.mark.parametrize("when", ["write", "end"])
def test_a_sink_that_fails_stops_the_run_and_nothing_else(kind, when):
    sink = Kept()

    def fail(*_):
        raise kind(28, "No space left on device")

    setattr(sink, when, fail)
    with pytest.raises(SinkError, match="No space left on device") as caught:
        simulate(SHORT, sinks=[sink])
    assert isinstance(caught.value.__cause__, kind)
    assert caught.value.trace.status is (Status.failed if when == "write" else Status.completed)


def test_sinks_get_every_row_in_order_whatever_they_take():
    quick, slow = Kept(), Kept()
    write = slow.write
    slow.write = lambda rows: (time.sleep(0.02), write(rows))
    trace = simulate(SHORT, sinks=[quick, slow])
    for sink in (quick, slow):
        assert np.array_equal(np.concatenate(sink.blocks)[:, 0], trace.t)
        assert sink.outcome == trace.outcome
