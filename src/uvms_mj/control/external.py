"""A wrench from outside: the caller of a Simulation sets tau_cmd."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .base import Controller


@dataclass(frozen=True)
class External(Controller):
    """A wrench from outside: the caller of a Simulation sets tau_cmd."""

    name = "external"
    external: ClassVar[bool] = True
    uses_task: ClassVar[bool] = False

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        pass
