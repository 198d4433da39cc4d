"""Calls on an executor: each has one answer, whatever ends the workers, and a lost one is made again in its parts."""

import time
from collections import Counter
from concurrent.futures import Future, ThreadPoolExecutor
from random import Random

import pytest

from uvms_mj import InputError
from uvms_mj.studies.pool.execution import run_by_run
from uvms_mj.studies.pool.executors import ATTEMPTS, WorkerLost, each_call


class Losing(ThreadPoolExecutor):
    """Calls on threads, of which ``strikes`` ends the workers of some, by the call and the number of its try."""

    def __init__(self, strikes):
        super().__init__(3)
        self.strikes, self.tries = strikes, Counter()

    def submit(self, function, /, *arguments):
        self.tries[arguments] += 1
        if not self.strikes(arguments, self.tries[arguments]):
            return super().submit(function, *arguments)
        future = Future()
        future.set_exception(WorkerLost("killed"))
        return future


def squares(name, indices):
    return [(i, i * i) for i in indices]


def made(executor, calls):
    """The answer of each index, and the indices that were given up."""
    found, lost = {}, []

    def done(call, answer):
        if isinstance(answer, WorkerLost):
            (index,) = call[1]
            lost.append(index)
        else:
            assert not found.keys() & {i for i, _ in answer}
            found.update(answer)

    each_call(executor, squares, iter(calls), done, lambda: None, run_by_run)
    return found, sorted(lost)


BLOCKS = [("a", tuple(range(i, i + 4))) for i in range(0, 20, 4)]


@pytest.mark.parametrize("seed", range(5))
def test_every_run_has_one_answer_if_workers_end_now_and_then(seed):
    rng = Random(seed)
    with Losing(lambda call, tries: tries < ATTEMPTS and rng.random() < 0.4) as executor:
        assert made(executor, BLOCKS) == ({i: i * i for i in range(20)}, [])


def test_a_run_that_ends_every_worker_is_given_up_alone():
    with Losing(lambda call, tries: 7 in call[1]) as executor:
        found, lost = made(executor, BLOCKS)
    assert (sorted({*found, *lost}), lost) == (list(range(20)), [7])
    assert executor.tries[("a", (7,))] == ATTEMPTS
    assert executor.tries[("a", (4, 5, 6, 7))] == 1  # then run by run
    assert executor.tries[("a", (0, 1, 2, 3))] == 1


def test_an_executor_that_refuses_calls_is_one_sentence():
    executor = ThreadPoolExecutor(1)
    executor.shutdown()
    with pytest.raises(InputError, match=r"the workers can't go on: RuntimeError: .*the same command goes on"):
        each_call(executor, squares, BLOCKS, lambda call, answer: None, lambda: None)


def test_progress_is_told_while_a_call_takes_long():
    told = []
    with ThreadPoolExecutor(1) as executor:
        each_call(executor, time.sleep, [(1.0,)], lambda call, answer: told.append("done"), lambda: told.append("tick"))
    assert told.index("done") >= 3
    with ThreadPoolExecutor(1) as executor, pytest.raises(KeyboardInterrupt):
        each_call(executor, time.sleep, [(0.1,)] * 9, lambda call, answer: None, _interrupt)


def _interrupt():
    raise KeyboardInterrupt


def test_without_calls_there_is_nothing_to_tell():
    with ThreadPoolExecutor(1) as executor:
        each_call(executor, squares, [], lambda call, answer: None, _interrupt)
