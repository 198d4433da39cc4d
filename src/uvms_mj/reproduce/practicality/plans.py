"""The studies of the page: one along each axis, two maps, and the steps from ideal to a pool."""

from collections.abc import Mapping, Sequence
from typing import Any

from ...studies.plan import Plan
from .axes import AXES, BASE, LAWS, MAPS, Axis, laws_of_steps

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


def plans(overrides: Mapping[str, Any]) -> dict[str, Plan]:
    """The studies by name. ``overrides`` are dotted keys of the ideal scenario. Raises InputError if one is invalid."""
    found = {axis.name: _plan(axis.name, axis.base, LAWS, (axis,), overrides) for axis in AXES}
    found |= {name: _plan(name, {}, LAWS, pair, overrides) for name, *pair in MAPS}
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
        "base": {"scenario": "push_wall", **BASE, **base, **overrides},
        "laws": [dict(law) for law in laws],
        "vary": [axis.table for axis in axes],
        "keep": {"metrics": list(METRICS)},
        "success": dict(SUCCESS),
        "run": {"engine": "free_body"},
    }
    return Plan.from_dict(tables, place="practicality")
