"""The runs of the paper's section 5, one for each law."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class PaperRun:
    """One run of the paper: the label in figures and tables, the name of the law, and its gains by dotted key."""

    label: str
    law: str
    gains: Mapping[str, Any] = field(default_factory=dict)


RUNS: Mapping[str, PaperRun] = {
    "impedance": PaperRun("impedance", "impedance"),
    "fosm": PaperRun("first-order", "fosm"),
    "gsta": PaperRun("GSTA", "gsta", {"controller.nominal": True}),
    "gsta_alone": PaperRun("GSTA alone", "gsta", {"controller.nominal": False}),
}
"""The paper's runs by the names of their logs, which are also the arguments of :func:`uvms_mj.views.figures.paper`."""
LABELS = {name: run.label for name, run in RUNS.items()}
TUNED = ("fosm", "gsta")
"""Laws with gains of their own, which can be set for the study."""
