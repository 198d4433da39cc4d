"""Random programs of the language (:mod:`random_programs`): machine code gives what plain Python gives, bit for bit."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from compiled import Compiled, arguments, as_python, assert_equal, defined
from random_programs import GIVEN, OUT, Writer
from uvms_mj.compiler.refusals import Lacking


@pytest.mark.slow
@settings(max_examples=30, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(choose=st.randoms(use_true_random=False))
def test_a_random_program_gives_the_same_as_machine_code_and_as_plain_python(choose):
    program = defined(Writer(choose).program(), {})
    try:
        code = Compiled(program, [GIVEN, OUT])
    except Lacking:  # the language has not all of it
        return
    source = np.random.default_rng(1)
    for _ in range(6):
        mine = arguments([GIVEN, OUT], source)
        theirs = [memory.copy() for memory in mine]
        assert code(*mine) == 0
        with np.errstate(all="ignore"):
            program(*(as_python(memory) for memory in theirs))
        for name in OUT.names or ():  # whatever the signs of zeros, which have a table of their own
            assert_equal(mine[1][name] + 0.0, theirs[1][name] + 0.0, exact=True)
