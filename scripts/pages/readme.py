"""README.md: the push at rest, at the body and at the tool, with its closed form."""

import functools
import warnings
from collections.abc import Iterator

from uvms_mj import Scenario, Trace, simulate


@functools.cache
def run(name: str, engine: str = "mujoco") -> Trace:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return simulate(Scenario.load(name, controller="gsta"), engine=engine)


def numbers() -> Iterator[tuple]:
    trace, tool = run("push_wall", "free_body"), run("tool_push")
    words = "| {} N in the run, {} N by the formula |"
    yield f"does not know {words}", trace.final_impulse[-1] / 0.5, trace.analytic.force
    yield f"floating vehicle {words}", tool.push[-1], tool.analytic.force
