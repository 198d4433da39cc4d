"""docs/how_to/sensor.md: the force sensor with a bias, and the age at which an old force undamps the contact."""

from collections.abc import Iterator

from page_look import DOCS
from uvms_mj import Scenario, simulate
from uvms_mj.control.theory.loop import ForceAge
from uvms_mj.setup.base import set_up

EXAMPLE = DOCS.parent / "examples" / "biased_force.py"


def numbers() -> Iterator[tuple]:
    sensor = {"navigation.name": f"{EXAMPLE}:BiasedForce", "navigation.bias": [0.5, 0.0, 0.0]}
    yield "gives $F$ = (1.5 + 0.5)/1.0015 = {} N", simulate(Scenario.load("push_wall", sensor)).push[-1]
    limit = ForceAge.of(set_up(Scenario.load("push_wall"))).limit
    yield "At the default wall (1e5 N/m) the limit is {} ms", 1e3 * limit
