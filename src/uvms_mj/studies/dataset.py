"""The rows of a study as an xarray Dataset."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from .plan import Plan
from .plan.metrics import COMPLETED, unit_of_column

if TYPE_CHECKING:
    import xarray as xr

NOT_DONE = "not done"
"""Status of a run without a row."""
_TEXTS, _ENDS = ("status", "message", "engine"), ("status", "message", "steps", "warnings", "engine")
"""Columns of texts, and columns that also a run that did not complete has."""
_OF_ROWS = ("draw", "law", "repeat", "seed")


def dataset(plan: Plan, frame: pd.DataFrame) -> "xr.Dataset":
    """The metrics, status, steps and engine of a study over its design, law and repeat.

    The dimensions of a grid are its varied keys; of keys that move together, the first is the dimension and the others
    are coordinates on it. Other designs have the dimension ``draw`` with the keys as coordinates. Units are attributes.
    A metric is nan, or None if it is a text, where the run did not complete or is not done; the status tells.
    """
    import xarray as xr

    axes, coordinates = _design(plan)
    dims = (*axes, "law", "repeat")
    shape = (*axes.values(), len(plan.laws), plan.repeats)
    rows = frame.set_index("index").drop(columns=[*_OF_ROWS, *plan.varied])
    completed = rows["status"] == COMPLETED
    rows = rows.apply(lambda column: column if column.name in _ENDS else column.where(completed))
    rows = rows.reindex(range(plan.runs)).fillna({"status": NOT_DONE})
    variables: dict[str, Any] = {name: (dims, _plain(column).reshape(shape)) for name, column in rows.items()}
    found = xr.Dataset(
        variables,
        coordinates | {"law": [law.label for law in plan.laws], "repeat": np.arange(plan.repeats)},
        {"name": plan.name, "description": plan.description, "design": plan.design, "seed": plan.seed},
    )
    for each in plan.variations:
        for key in each.places:
            found[key].attrs |= {"units": plan.units[key], "laws": list(each.laws or found["law"].values)}
    for name in variables:
        found[name].attrs["units"] = unit_of_column(name)
    return found


def _plain(column: pd.Series) -> np.ndarray:
    """Texts with None for missing ones; numbers and flags as floats with nan."""
    if column.name in _TEXTS or column.map(lambda value: isinstance(value, str)).any():
        return column.astype(object).where(column.notna(), None).to_numpy()
    return column.to_numpy(dtype=float, na_value=np.nan)


def _design(plan: Plan) -> tuple[dict[str, int], dict[str, Any]]:
    """Sizes of the dimensions by name, and coordinates. The last dimension of a grid changes fastest."""
    if plan.design != "grid":
        keys = {key: ("draw", _coordinate([point[i] for point in plan.points])) for i, key in enumerate(plan.varied)}
        return {"draw": plan.draws}, keys | {"draw": np.arange(plan.draws)}
    coordinates = {
        key: (each.places[0], _coordinate([level[i] for level in each.levels]))
        for each in plan.variations
        for i, key in enumerate(each.places)
    }
    return {each.places[0]: len(each.levels) for each in plan.variations}, coordinates


def _coordinate(values: Sequence[Any]) -> np.ndarray:
    """Values as an array; lists as texts."""
    if any(isinstance(value, list | tuple) for value in values):
        return np.array([str(value) for value in values])
    return np.array(values)
