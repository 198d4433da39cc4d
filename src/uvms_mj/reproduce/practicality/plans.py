"""The studies of the page: one along each axis of axes.toml, two maps, and the steps from ideal to a pool."""

import dataclasses
import itertools
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...quantities import leaves
from ...studies.plan import Plan

PART = 0.1
"""Largest error of the mean push, as part of the demanded one."""
DEMANDED = 1.5
"""Push that the ideal scenario demands of a rigid wall [N]."""
METRICS = (
    *("force_error_N", "force_range_N", "contact.final_N", "contact.peak_N", "contact.touches"),
    *("chattering_N_per_s", "saturated_s", "contact.settled"),
)
SUCCESS = {"force_error_N": [-PART * DEMANDED, PART * DEMANDED], "force_range_N": [0.0, DEMANDED]}
"""A law works if it presses with the demanded force within a tenth, and the force varies by no more than itself."""
STEPS_NAME = "steps"


@dataclass(frozen=True)
class Axis:
    """One way from ideal to real.

    Attributes:
        name: of its study.
        title: for figures and tables.
        key: the scenario's key that varies; a rate is named by its period.
        unit: unit of the key.
        values: from ideal to worse than real.
        real: a value as in a pool.
        source: of the real value, and how far to trust it.
        base: further keys of the axis.
    """

    name: str
    title: str
    key: str
    unit: str
    values: tuple[float, ...]
    real: float
    source: str
    base: Mapping[str, Any]

    @property
    def logarithmic(self) -> bool:
        """Whether the values are drawn on a logarithmic scale."""
        positive = [value for value in self.values if value > 0.0]
        return max(positive) / min(positive) > 30.0

    def text(self, value: float) -> str:
        """A value with its unit."""
        return f"{value:g}" if self.unit == "1" else f"{value:g} {self.unit}"

    @property
    def table(self) -> dict[str, Any]:
        """The axis as an entry of ``[[vary]]``."""
        return {"key": self.key, "values": list(self.values)}


def _keys(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Nested tables by dotted keys."""
    return dict(leaves(tables, lists=False))


_FILE = tomllib.loads(Path(__file__).with_name("axes.toml").read_text(encoding="utf-8"))
BASE, BUMPER, SMOOTHER = (_keys(_FILE[name]) for name in ("base", "bumper", "retuned"))
RETUNED = "gsta retuned"
LAWS: Sequence[Mapping[str, Any]] = (
    {"name": "impedance"},
    {"name": "fosm"},
    {"name": "gsta"},
    {"name": "gsta", "label": RETUNED, **SMOOTHER},
)
"""The paper's laws with the paper's gains, and GSTA with the retuned ones."""
AXES: Mapping[str, Axis] = {
    each["name"]: Axis(**each | {"values": tuple(each["values"]), "base": _keys(each.get("base", {}))})
    for each in _FILE["axis"]
}
"""The axes by name."""
MAPS: Mapping[str, tuple[Axis, Axis]] = {
    f"{name}_and_stiffness": (
        dataclasses.replace(AXES[name], values=tuple(_FILE["maps"]["periods"])),
        dataclasses.replace(AXES["wall_stiffness"], values=tuple(_FILE["maps"]["stiffnesses"])),
    )
    for name in _FILE["maps"]["axes"]
}
"""Maps over two axes, by the name of their study."""
STEPS: Sequence[tuple[str, Mapping[str, Any]]] = tuple(
    (each["title"], _keys(each.get("keys", {}))) for each in _FILE["step"]
)
"""The steps from ideal to a pool: title and keys."""


def step_label(law: str, bumper: bool, number: int) -> str:
    """Label of GSTA with the gains ``law`` after a number of steps."""
    return f"{law}{' with bumper' if bumper else ''} {number}"


def laws_of_steps() -> list[dict[str, Any]]:
    """GSTA with both sets of gains after each step, with and without the bumper, as ``[[laws]]`` of a study."""
    laws, keys = [], dict[str, Any]()
    for number, (_, more) in enumerate(STEPS):
        if more.get("navigation.name"):
            keys = {key: value for key, value in keys.items() if not key.startswith("navigation.")}
        keys |= more
        if keys.get("thrusters.name"):
            keys["thrusters.assumed_voltage"] = 16.0
        for (law, gains), bumper in itertools.product((("gsta", {}), (RETUNED, SMOOTHER)), (False, True)):
            own = {**keys, **gains, **(BUMPER if bumper else {})}
            laws.append({"name": "gsta", "label": step_label(law, bumper, number), **own})
    return laws


def plans(overrides: Mapping[str, Any]) -> dict[str, Plan]:
    """The studies by name. ``overrides`` are dotted keys of the ideal scenario. Raises InputError if one is invalid."""
    found = {axis.name: _plan(axis.name, axis.base, LAWS, (axis,), overrides) for axis in AXES.values()}
    found |= {name: _plan(name, {}, LAWS, pair, overrides) for name, pair in MAPS.items()}
    return found | {STEPS_NAME: _plan(STEPS_NAME, {}, laws_of_steps(), (), overrides)}


def _plan(
    name: str,
    base: Mapping[str, Any],
    laws: Sequence[Mapping[str, Any]],
    axes: Sequence[Axis],
    overrides: Mapping[str, Any],
) -> Plan:
    tables = {
        "name": name,
        "base": {**BASE, **base, **overrides},
        "laws": [dict(law) for law in laws],
        "vary": [axis.table for axis in axes],
        "keep": {"metrics": list(METRICS)},
        "success": dict(SUCCESS),
        "run": {"engine": "free_body"},
    }
    return Plan.from_dict(tables, place="practicality")
