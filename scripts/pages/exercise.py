"""docs/start/exercise.md: the answers by hand, and the closed forms that the pool shows."""

from collections.abc import Iterator

import numpy as np

from uvms_mj import Scenario
from uvms_mj.control.base import SteadyState
from uvms_mj.control.theory.predictions import steady_state
from uvms_mj.setup.base import set_up

K_X, LINEAR, QUADRATIC = 150.0, 4.03, 18.18
"""Stiffness [N/m]; drag of the BlueROV1 in surge [N s/m, N s^2/m^2]."""


def closed_form(law: str, **settings: float) -> SteadyState:
    named = {key.replace("__", "."): value for key, value in settings.items()}
    rest = steady_state(set_up(Scenario.load("push_wall", named, law)))
    assert isinstance(rest, SteadyState), rest
    return rest


def drag(speed: float) -> float:
    return (LINEAR + QUADRATIC * 0.5 * speed) * 0.5 * speed


def numbers() -> Iterator[tuple]:
    stiff = 1.0 + K_X / 1e5
    soft = closed_form("gsta", wall__stiffness=300.0).force
    yield "1.5/(1 + 150/300) = {} N, at any", soft
    pool = closed_form("impedance", current__speed=0.2).force
    yield "$d$ = {} N, so that $F$ = {} N by hand. The pool has {} N", drag(0.2), (1.5 - drag(0.2)) / stiff, pool
    u = max(np.roots([QUADRATIC, LINEAR, -1.5]))
    before, last = (closed_form("impedance", current__speed=v).force for v in (0.400, 0.404))
    off = 0.404 + 0.004 * last / (before - last)  # the push falls to zero there
    yield "gives $u$ = {} m/s and $v_c = 2u$ = {} m/s.", u, 2.0 * u
    yield "The turned vehicle of the pool loses it at\n   {} m/s", off
    d, wide = drag(0.5), closed_form("fosm", controller__epsilon=0.01).force
    yield "$d$ = {} N. With", d
    yield "the loss is {} N and the push {} N; with", d / 191.0 / stiff, closed_form("fosm").force
    yield "they are {} N and {} N.", d / 20.0 / stiff, wide
    damping = 2.0 * (12.81 * K_X) ** 0.5
    yield "the desired damping $D_x$ = {} N s/m", damping
    longest = damping / 50.0 + 0.1
    yield "$D_x/k_c$ = {} ms, so that the longest $T$ is {} ms: {} Hz", damping / 100.0, longest, 1e3 / longest
    slow = closed_form("gsta", controller__period=0.002, wall__stiffness=2e4)
    yield "the push comes to {} N at 500 Hz", slow.force
