"""The calls that a study makes in its workers. They take the study as a parcel and return plain values."""

import dataclasses
from typing import TYPE_CHECKING, Any

from .. import check, rows
from .parcel import Parcel

if TYPE_CHECKING:
    from ..plan import Plan


def rows_of(parcel: Parcel, indices: tuple[int, ...]) -> list[dict[str, Any]]:
    """The rows of some runs."""
    plan = plan_of(parcel)
    return [rows.one_row(plan, index) for index in indices]


def compared(parcel: Parcel, index: int, engine: str) -> dict[str, Any]:
    """The row of a run in one engine with what the check of the engines compares."""
    plan = dataclasses.replace(plan_of(parcel), metrics=check.METRICS, time_limit_s=None)
    return rows.one_row(plan, index, engine)


def log_of(parcel: Parcel, index: int, engine: str) -> bytes:
    """The log of a run."""
    return rows.log_of(plan_of(parcel), index, engine)


_plans: dict[str, "Plan"] = {}
"""The last plan by the digest of its parcel."""


def plan_of(parcel: Parcel) -> "Plan":
    """The plan of a parcel, unpacked once a process."""
    parcel.check_code()
    if parcel.digest not in _plans:
        _plans.clear()
        _plans[parcel.digest] = parcel.plan()
    return _plans[parcel.digest]
