"""Success of a run: that it completed and has settled, or is within the limits of the study's table ``[success]``."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import Fault, suggestion
from ...files import shortened
from ...quantities import leaves

if TYPE_CHECKING:
    import pandas as pd

COMPLETED = "completed"
SETTLED = "contact.settled"

Limit = bool | tuple[float, float]


def limits(given: Mapping[str, Any], metrics: Sequence[str], faults: list[Fault]) -> dict[str, Limit]:
    """The limits of the table ``[success]`` by metric: true or false, or the least and the greatest value.

    A metric is one of ``metrics`` or a component of one, ``final.position_m.x``. Errors are appended to ``faults``.
    """
    found: dict[str, Limit] = {}
    for name, value in leaves(given, lists=False):
        place = f"success.{name}"
        if name not in metrics and name.rpartition(".")[0] not in metrics:
            faults.append(Fault(place, f"is not one of keep.metrics; {suggestion(name, metrics)}"))
        elif isinstance(value, bool):
            found[name] = value
        elif _is_range(value):
            found[name] = (float(value[0]), float(value[1]))
        else:
            faults.append(Fault(place, f"{shortened(value)} must be true, false, or a range [low, high]"))
    return found


def _is_range(value: Any) -> bool:
    numbers = isinstance(value, list | tuple) and len(value) == 2 and all(type(each) in (int, float) for each in value)
    return numbers and not any(map(math.isnan, value)) and value[0] <= value[1]


def successes(frame: "pd.DataFrame", given: Mapping[str, Limit]) -> np.ndarray:
    """Whether each row (n,) is a success."""
    import pandas as pd

    met = (frame["status"] == COMPLETED).to_numpy()
    if not given:
        return met & frame[SETTLED].eq(True).to_numpy() if SETTLED in frame else met
    for name, limit in given.items():
        if isinstance(limit, bool):
            met = met & frame[name].eq(limit).to_numpy()
        else:
            met = met & pd.to_numeric(frame[name], errors="coerce").between(*limit).to_numpy()
    return met


def in_words(given: Mapping[str, Limit], settled: bool) -> str:
    """The definition of success. ``settled`` is whether the rows have :data:`SETTLED`."""
    if not given:
        return "a run succeeds if it completed" + (" and has settled" if settled else "")
    parts = [
        f"{name} is {str(limit).lower()}" if isinstance(limit, bool) else f"{name} is from {limit[0]:g} to {limit[1]:g}"
        for name, limit in given.items()
    ]
    return f"a run succeeds if it completed, and {', and '.join(parts)}"
