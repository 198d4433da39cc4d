"""The numbers of a study by law, as a table for a paper: a data frame, CSV, LaTeX."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...errors import InputError, suggestion
from ...files import atomic_write
from ..plan import Plan
from . import figures
from .data import StudyRows
from .tables import HEAD_METRICS

if TYPE_CHECKING:
    import pandas as pd

FORMATS = ("tex", "csv")
_QUANTILES = {"median": 0.5, "5 %": 0.05, "95 %": 0.95}
_ESCAPED = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "µ": r"$\mu$",
    "·": r"$\cdot$",
    "²": "$^2$",
    "³": "$^3$",
    **{letter: f"\\{letter}" for letter in "&%$#_{}"},
}
"""LaTeX of the characters that it does not take as they are."""
_POWER = re.compile(r"\^(-?\d+)")
"""A power in a unit, m/s^2."""


def statistics(plan: Plan, frame: "pd.DataFrame", metrics: Sequence[str] = ()) -> "pd.DataFrame":
    """One row a law: its runs, those that succeed [%], and of each metric the median and the quantiles of 5 and 95 %.

    The columns have two heads: the quantity with its unit, and the number. ``metrics`` are names of kept metrics;
    default: the first three that vary. Raises InputError for an unknown one.
    """
    import pandas as pd

    data = StudyRows(plan, frame)
    known = {metric.name: metric for metric in data.metrics}
    for name in metrics:
        if name not in known:
            raise InputError(f"metrics: the study has no {name!r}; {suggestion(name, known)}")
    chosen = [known[name] for name in metrics] or list(data.varying[:HEAD_METRICS])
    rates = figures.success_rates(data)
    rows: dict[str, dict[tuple[str, str], float]] = {}
    for law, at in data.rows.items():
        success = rates[law].value * 100.0 if law in rates else np.nan
        row = {("runs", ""): float(len(at)), ("success [%]", ""): success}
        for metric in chosen:
            values = data.values(metric)[at]
            values = values[np.isfinite(values)]
            for name, q in _QUANTILES.items():
                row[metric.label, name] = float(np.quantile(values, q)) if len(values) else np.nan
        rows[law] = row
    found = pd.DataFrame.from_dict(rows, orient="index")
    found.columns = pd.MultiIndex.from_tuples(found.columns)
    found.index.name = "law"
    found["runs", ""] = found["runs", ""].astype(int)
    return found


def to_csv(found: "pd.DataFrame") -> str:
    """The table as CSV: one line of heads, each with its unit, and all digits."""
    flat = found.copy()
    flat.columns = [" ".join(filter(None, each)) for each in found.columns]
    return str(flat.to_csv(lineterminator="\n"))


def to_latex(found: "pd.DataFrame", comment: str = "") -> str:
    """The table as LaTeX, for the package booktabs: four digits, heads with their units, texts escaped."""
    table = found.map(_number)
    table.columns = table.columns.map(lambda each: tuple(map(latex, each)))
    table.index = table.index.map(latex)
    names = [latex(str(found.index.name)), *[""] * (table.columns.nlevels - 1)]
    table = table.rename_axis(index=None).rename_axis(columns=names)
    form = "l" + "r" * len(table.columns)
    text = str(table.to_latex(escape=False, column_format=form, multicolumn_format="c"))
    said = "".join(f"% {line}\n" for line in comment.splitlines())
    return f"{said}% \\usepackage{{booktabs}}\n{text}"


def latex(text: str) -> str:
    """A text as LaTeX prints it; powers in units are raised."""
    parts = _POWER.split(text)  # text, power, text, ...
    escaped = ["".join(_ESCAPED.get(letter, letter) for letter in part) for part in parts[::2]]
    raised = [f"$^{{{power}}}$" for power in parts[1::2]]
    return "".join(a + b for a, b in zip(escaped, [*raised, ""], strict=True))


def _number(value: float) -> str:
    if not np.isfinite(value):
        return "--"
    mantissa, e, exponent = f"{value:.4g}".partition("e")
    if not e and mantissa.startswith("-"):
        return f"${mantissa}$"
    return f"${mantissa} \\cdot 10^{{{int(exponent)}}}$" if e else mantissa


def write(found: "pd.DataFrame", path: Path, comment: str = "") -> None:
    """Write the table by the ending of the file. Raises InputError for another one than :data:`FORMATS`, or if it can't
    be written."""
    kind = path.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise InputError(f"{path}: the name must end in .{' or .'.join(FORMATS)}")
    with atomic_write(path) as part:
        part.write_text(to_csv(found) if kind == "csv" else to_latex(found, comment), encoding="utf-8")
