"""Thrusts from outside: the caller of a Simulation sets u."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .base import Actuation


@dataclass(frozen=True)
class External(Actuation):
    """Thrusts from outside: the caller of a Simulation sets u."""

    name = "external"
    external: ClassVar[bool] = True

    @staticmethod
    def step(settings, state, given, state_dot, u):
        pass
