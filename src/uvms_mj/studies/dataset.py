"""The rows of a study as an xarray Dataset."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from .plan import Plan
from .plan.metric import unit_of_column
from .plan.success import COMPLETED

if TYPE_CHECKING:
    import xarray as xr

NOT_DONE = "not done"
"""Status of a run without a row."""
_TEXTS, _ENDS = ("status", "message", "engine"), ("status", "message", "steps", "warnings", "engine")
"""Columns of texts, and columns that also a run that did not complete has."""
_OF_ROWS = ("index", "draw", "law", "repeat", "seed")


def dataset(plan: Plan, frame: pd.DataFrame) -> "xr.Dataset":
    """The metrics, status, steps and engine of a study over its design, law and repeat.

    The dimensions of a grid are its varied keys; of keys that move together, the first is the dimension and the others
    are coordinates on it. Other designs have the dimension ``draw`` with the keys as coordinates. Units are attributes.
    A metric is nan, or None if it is a text, where the run did not complete or is not done; the status tells.
    """
    import xarray as xr

    axes, coordinates = _grid(plan) if plan.design == "grid" else _draws(plan)
    dims = (*axes, "law", "repeat")
    shape = (*axes.values(), len(plan.laws), plan.repeats)
    at = frame["index"].to_numpy()
    completed = (frame["status"] == COMPLETED).to_numpy()
    variables: dict[str, Any] = {}
    for name in frame.columns:
        if name in _OF_ROWS or name in plan.varied:
            continue
        kept = np.ones(len(frame), bool) if name in _ENDS else completed
        variables[name] = (dims, _filled(frame[name], at, kept, shape))
    found = xr.Dataset(
        variables,
        coordinates | {"law": [law.label for law in plan.laws], "repeat": np.arange(plan.repeats)},
        {"name": plan.name, "description": plan.description, "design": plan.design, "seed": plan.seed},
    )
    for each in plan.variations:
        for key in each.keys:
            found[key].attrs |= {"units": plan.units[key], "laws": list(each.laws or found["law"].values)}
    for name in variables:
        found[name].attrs["units"] = unit_of_column(name)
    return found


def _filled(values: pd.Series, at: np.ndarray, kept: np.ndarray, shape: Sequence[int]) -> np.ndarray:
    """Values (n,) of the runs ``at`` in an array of all runs. Numbers and flags become floats with nan for the rest."""
    texts = values.name in _TEXTS or values.map(lambda value: isinstance(value, str)).any()
    missing = (NOT_DONE if values.name == "status" else None) if texts else np.nan
    array = np.full(int(np.prod(shape)), missing, dtype=object if texts else float)
    array[at[kept]] = values.to_numpy(dtype=object if texts else float, na_value=None if texts else np.nan)[kept]
    return array.reshape(shape)


def _draws(plan: Plan) -> tuple[dict[str, int], dict[str, Any]]:
    """Sizes of the dimensions by name, and coordinates, of draws that are not a grid."""
    columns = zip(*plan.points, strict=True)
    keys = {key: ("draw", _coordinate(column)) for key, column in zip(plan.varied, columns, strict=True)}
    return {"draw": len(plan.points)}, keys | {"draw": np.arange(len(plan.points))}


def _grid(plan: Plan) -> tuple[dict[str, int], dict[str, Any]]:
    """Sizes of the dimensions by name, and coordinates, of a grid, whose last dimension changes fastest."""
    axes: dict[str, int] = {}
    coordinates: dict[str, Any] = {}
    for each in plan.variations:
        axes[each.keys[0]] = len(each.levels)
        for key, column in zip(each.keys, zip(*each.levels, strict=True), strict=True):
            coordinates[key] = (each.keys[0], _coordinate(column))
    return axes, coordinates


def _coordinate(values: Sequence[Any]) -> np.ndarray:
    """Values as an array; lists as texts."""
    if any(isinstance(value, list | tuple) for value in values):
        return np.array([str(value) for value in values])
    return np.array(values)
