"""A law's library as a law of this package: the description beside it, by which ``--controller lib.so:NAME_law`` runs
it, and the numbers by which it knows the records of a run."""

from typing import Any

import numpy as np

from ...control.base import Controller
from ...scenario import Scenario
from ...stages.foreign import Description, OneSetting, OneState, Records
from ...stages.signals import record_dtype
from .border import GAIN, Border, Entry

SUFFIX = "_law"


class AsLaw:
    """The law that a library is in a run: its description and its records."""

    def __init__(self, border: Border, scenario: Scenario, name: str, header_words: int) -> None:
        self.border, self.name, law = border, f"{name}{SUFFIX}", scenario.controller
        self.gains = [each for each in border.settings if each.group == GAIN]
        self.impedance = [each for each in border.settings if each.group != GAIN]
        settings = {each.word: OneSetting(_default(law, each), each.unit, each.meaning) for each in self.gains}
        self.size = 2 * (header_words + border.chain.kind.itemsize // 8)  # halves of words, which are finite numbers
        instance = {"instance": OneState(self.size, advanced=False)}
        summary = f"The law {law.label()} of the library lib{name}.so."
        self.uses_task = type(law).uses_task
        self.description = Description("controller", summary, settings, instance, self.uses_task)
        kind = self.description.stage_class(self.name, __name__, [])
        self._given: Any = record_dtype(kind.given()).fields
        records = Records.of(kind(), border.chain.thrusters)
        self.numbers = [records.layout, *records.sizes]

    def place(self, entry: Entry) -> int:
        """The place of a field in what a law is given."""
        return self._given[entry.name][1] // 8

    def toml(self) -> dict[str, Any]:
        """The description as tables of TOML."""
        settings = {
            key: {"default": each.default, "unit": each.unit, "meaning": each.meaning}
            for key, each in self.description.settings.items()
        }
        states = {"instance": {"size": self.size, "advanced": False}}
        return {
            "stage": "controller",
            "summary": self.description.summary,
            "uses_task": self.uses_task,
            "settings": settings,
            "states": states,
        }


MOST = 10_000
"""Numbers that the memory of a stage may have."""


def not_asked(border: Border, scenario: Scenario) -> str:
    """Why no run can ask the library for its law's commands; empty if one can. A law of a run is called at the
    library's period and given all that it measures: pose, velocity and force at B."""
    chain = border.chain
    if chain.joints:
        return "the vehicle has joints"
    if chain.measured != "signals":
        return "the task is at a tool"
    if chain.filter is not None:
        return "it has the Kalman filter, and a law of a run is given no samples of sensors"
    if abs(chain.period - scenario.control_period) >= 1e-9:
        return "the delay is no whole number of control periods"
    return ""


def no_room(border: Border, header_words: int) -> str:
    """Why the memory of a law of a run has no room for an instance; empty if it has."""
    size = 2 * (header_words + border.chain.kind.itemsize // 8)
    return f"an instance has {size} halves of words, and a law of a run keeps {MOST} numbers" if size > MOST else ""


def _default(law: Controller, entry: Entry) -> Any:
    value: Any = getattr(law, entry.name)
    return [float(each) for each in value] if entry.shape else float(np.float64(value))
