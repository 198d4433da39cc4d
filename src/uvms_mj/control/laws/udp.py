"""A law in another process, which answers over UDP in lockstep."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import Field

from ...quantities import Number, within
from ..base import Controller, gain

PORT = 9100


@dataclass(frozen=True)
class Udp(Controller):
    """A law of another process: it is given the signals of each instant, and answers with tau_cmd, in lockstep."""

    port: Annotated[int, Field(strict=True, ge=1, le=65535)] = gain(PORT, "1", "UDP port of the law on this machine")
    timeout: Annotated[Number, within(0.01, 3600.0, "s")] = gain(10.0, "s", "longest wall time without an answer")

    name = "udp"
    external: ClassVar[bool] = True
    by_caller: ClassVar[str] = "tau_cmd"

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        pass

    def at_rest(self, setup: Any) -> str:
        return "the law runs in another process"
