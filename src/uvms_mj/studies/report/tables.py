"""Tables of a study's report: laws, quantiles, differences, failures, the worst runs, and what was studied; and
its numbers by law as a data frame, CSV or LaTeX, for a paper."""

import math
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from ...errors import InputError
from ...files import atomic_write
from ..pages import ROUNDING, Cell, Table, keyed, marked, number
from ..plan import Plan
from ..plan.metrics import COMPLETED
from . import figures
from .data import Metric, StudyRows
from .latex import Column, LatexTable, Stacked, ranged
from .statistics import Estimate, Paired, paired

HEAD_METRICS = 3
"""Metrics in the table of laws at the top of the page."""
QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
MOST_FAILURES = 12
MOST_WORST_METRICS = 2
COSTS = ("contact.peak_N", "effort_N2s", "saturated_s", "contact.touches", "contact.relative_error")
"""Metrics of which a large value is bad."""
_NUMBER = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")
"""A number in a message: messages that differ in their numbers only are one failure."""
_FOLDERS = re.compile(r"(?<![\w.])/(?:[^\s/,'\"]+/)+")


def percent(estimate: Estimate) -> tuple[str, str]:
    """A rate and its interval in per cent, with the digits that the interval supports."""
    digits = 1 if estimate.high - estimate.low < 0.2 else 0
    low, high = (f"{100.0 * each:.{digits}f}" for each in (estimate.low, estimate.high))
    return f"{100.0 * estimate.value:.{digits}f} %", f"{low} to {high} %"


def spread(values: np.ndarray) -> tuple[str, str]:
    """Median, and the range from the 5 % to the 95 % quantile."""
    found = values[np.isfinite(values)]
    if not len(found):
        return "–", ""
    low, middle, high = np.quantile(found, (0.05, 0.5, 0.95))
    return short(middle), f"{short(low)} to {short(high)}"


def short(value: float) -> str:
    """A number with three digits."""
    return number(value, 3)


def laws(data: StudyRows, rates: Mapping[str, Estimate]) -> Table:
    """The first table: of each law its rate of success, medians of the first metrics, its runs, and the runs without
    success by their status."""
    metrics = list(data.varying[:HEAD_METRICS])
    found = []
    for law, rate in rates.items():
        rows = data.rows[law]
        statuses = data.frame["status"].to_numpy()[rows]
        counts = pd.Series(statuses[statuses != COMPLETED]).value_counts()
        ended = [f"{count} {status}" for status, count in counts.items()]
        unmet = int((data.completed[rows] & ~data.success[rows]).sum())
        ended += [f"{unmet} {'outside the limits' if data.plan.success else 'not settled'}"] if unmet else []
        spreads = [spread(data.values(metric)[rows]) for metric in metrics]
        cells = [
            marked("<strong>{}</strong> <small>{}</small>", *percent(rate)),
            *(marked("{} <small>{}</small>", *each) for each in spreads),
            Cell(str(len(rows)), "n"),
            ", ".join(ended) or "none",
        ]
        found.append((keyed(data.colours[law], marked("<strong>{}</strong>", law)), cells))
    heads = ["success", *(metric.label for metric in metrics), Cell("runs", "n"), "without success"]
    return Table("law", heads, found, "laws", "Success of each law")


def quantiles(data: StudyRows) -> list[Table]:
    """One table for each metric: a row for each law."""
    heads = ["runs", "mean", *("min" if q == 0.0 else "max" if q == 1.0 else f"{q:.0%}" for q in QUANTILES)]
    found = []
    for metric in data.metrics:
        rows = []
        for law, at in data.rows.items():
            values = data.values(metric)[at]
            values = values[np.isfinite(values)]
            numbers = [values.mean(), *np.quantile(values, QUANTILES)] if len(values) else [np.nan] * (len(heads) - 1)
            rows.append((law, [len(values), *(number(each, digits_of(numbers)) for each in numbers)]))
        found.append(Table(metric.label, heads, rows, caption=metric.meaning))
    return found


def digits_of(numbers: Sequence[float]) -> int:
    """Digits that resolve the differences of numbers to about three digits."""
    spread, largest = float(np.ptp(numbers)), float(np.abs(numbers).max())
    return 3 + min(4, math.ceil(math.log10(largest / spread))) if 0.0 < spread < largest else 3


def differences(pairs: Sequence[Paired]) -> list[Table]:
    """One table for the success and for each metric, with a row for each pair of laws."""
    found: dict[str, list[tuple[str, list[Any]]]] = {}
    for pair in pairs:
        name, rate = f"{pair.second} minus {pair.first}", pair.success
        points = (f"{100.0 * each:+.1f}".replace("-", "−") for each in (rate.value, rate.low, rate.high))
        counts = f"{pair.only_first} draws", f"{pair.only_second} draws"
        row = (name, _difference(pair.draws, points, counts, pair.among_all.apart))
        found.setdefault("success [% points], mean", []).append(row)
        for each in pair.metrics:
            numbers = map(signed, (each.median.value, each.median.low, each.median.high))
            shares = f"{100.0 * each.smaller:.0f} % of draws", f"{100.0 * each.larger:.0f} % of draws"
            row = (name, _difference(each.draws, numbers, shares, each.among_all.apart))
            found.setdefault(f"{each.metric.label}, median", []).append(row)
    heads = ["draws", "difference", "95 % interval", "smaller in", "larger in", "resolved among all"]
    return [Table(head, heads, rows) for head, rows in found.items()]


def _difference(draws: int, numbers: Iterable[str], counts: tuple[str, str], among_all: bool) -> list[Any]:
    value, low, high = numbers
    return [draws, value, f"{low} to {high}", *counts, "yes" if among_all else "no"]


def signed(value: float) -> str:
    """A difference with three digits and its sign."""
    return ("+" if value >= ROUNDING else "") + short(value)


def failures(data: StudyRows) -> tuple[Table, int]:
    """The most frequent failures, alike but for the numbers of their messages, and the number of further kinds."""
    lost = data.frame[~data.completed]
    alike = lost["message"].fillna("").map(lambda text: _NUMBER.sub("…", str(text)))
    found: list[tuple[str, list[Any]]] = []
    for (law, status, _), group in lost.groupby([lost["law"], lost["status"], alike], sort=False):
        one = group.iloc[0]
        message = str(one["message"] or "") if len(group) == 1 else alike[group.index[0]]
        share = f"{100.0 * len(group) / len(data.rows[law]):.3g} %"
        found.append((law, [status, message or "–", len(group), share, int(one["index"])]))
    found.sort(key=lambda each: -each[1][2])
    listed = Table("law", ["status", "message", "runs", "share", "e.g. row"], found[:MOST_FAILURES])
    return listed, max(0, len(found) - MOST_FAILURES)


def worst(data: StudyRows, folder: str) -> Table:
    """For each law: its first run that did not complete, its first that completed without success, and the runs with
    the largest values of a few metrics. A row has why it is there, the varied values, and the command that replays it.
    """
    order = [data.plan.logs.metric, *COSTS]
    known = {metric.name: metric for metric in data.varying}
    metrics = [known[name] for name in dict.fromkeys([*order, *known]) if name in known][:MOST_WORST_METRICS]
    found = []
    for law, rows in data.rows.items():
        chosen: dict[int, list[str]] = {}
        for mask, why in ((~data.completed, ""), (data.completed & ~data.success, "completed without success")):
            some = rows[mask[rows]]
            if len(some):
                chosen.setdefault(int(some[0]), []).append(why or str(data.frame["status"].iloc[some[0]]))
        for metric in metrics:
            values = np.abs(data.values(metric)[rows])
            if np.isfinite(values).any():
                at = int(rows[np.nanargmax(values)])
                value = data.values(metric)[at]
                name = metric.short
                text = f"largest {'|' + name + '|' if value < 0.0 else name}: {short(value)} {metric.unit}".rstrip()
                chosen.setdefault(at, []).append(text)
        name = keyed(data.colours[law], law)
        found += [(name, ["; ".join(why), _replayed(data, at, folder)]) for at, why in chosen.items()]
    return Table("law", ["why", "values, and the command that replays the run"], found, "worst", "The worst runs")


def _replayed(data: StudyRows, at: int, folder: str) -> Markup:
    """The varied values of a run, and the command that replays it."""
    row = data.frame.iloc[at]
    values = [
        f"{key} {text_of(row[key])}{f' {unit}' if (unit := data.plan.units.get(key, '')) else ''}"
        for key in data.plan.varied
        if row[key] is not None and row[key] == row[key]
    ]
    command = f"uvms-mj run --from {shlex.quote(folder)} --row {int(row['index'])} --viewer"
    return marked("{}<code>{}</code>", ", ".join(values), command)


def text_of(value: Any) -> str:
    """A varied value: a number with three digits, or a text."""
    return short(float(value)) if isinstance(value, float | int | np.number) else without_folders(str(value))


def without_folders(text: str) -> str:
    """A text with the names of files in place of their absolute paths."""
    return _FOLDERS.sub("", text)


def studied(data: StudyRows, versions: Mapping[str, str]) -> list[tuple[str, str]]:
    """The plan of a study: base scenario, laws, keys with their values, design, runs, engine."""
    plan, frame = data.plan, data.frame
    rows = [("base scenario", plan.base.name)]
    for law in plan.laws:
        source = law.source.rpartition("/")[2]
        settings = ", ".join(f"{key} = {value}" for key, value in law.overrides.items())
        about = ", ".join(part for part in ("" if source == law.label else source, settings) if part)
        rows.append(("law", f"{law.label}: {about}" if about else law.label))
    for each in plan.variations:
        unit = plan.units.get(each.places[0], "")
        only = f"; {', '.join(each.laws)} only" if each.laws else ""
        rows.append((", ".join(each.places), f"{without_folders(each.range())}{f' {unit}' if unit else ''}{only}"))
    repeats = f", {plan.repeats} repeats each" if plan.repeats > 1 else ""
    rows.append(("design", f"{plan.design.replace('_', ' ')}, {len(plan.points)} draws{repeats}, seed {plan.seed}"))
    done = f"{len(frame)} of {plan.runs}" if len(frame) < plan.runs else f"{plan.runs}"
    rows.append(("runs", f"{done}, with {number(float(frame['steps'].sum()))} time steps"))
    stepping = plan.base.simulation
    rows.append(("base time", f"{stepping.duration:g} s in steps of {stepping.timestep:g} s"))
    engines = frame["engine"].value_counts()
    rows.append(("engine", ", ".join(f"{engine}: {count} runs" for engine, count in engines.items())))
    return rows + [(f"version of {name}", version) for name, version in versions.items()]


FORMATS = ("tex", "csv")
_SHARE = {"share": "value", "interval low": "low", "interval high": "high"}
"""The attribute of an estimate by its head."""
_QUANTILES = {"median": 0.5, "quantile 5 %": 0.05, "quantile 95 %": 0.95}
_SUCCESS = "success [%]"
_POINTS, _DIFFERENCE = "success [points]", ("difference", "interval low", "interval high", "resolved among all")


def statistics(
    plan: Plan, frame: pd.DataFrame, metrics: Sequence[str] = (), labels: Mapping[str, str] | None = None
) -> pd.DataFrame:
    """One row a law: its runs, the share that succeeds [%] with the ends of its 95 % interval (Wilson's), and of each
    metric the median and the quantiles of 5 and 95 %.

    The columns have two heads: the quantity with its unit, and the number. ``attrs["meanings"]`` has by the first head
    the meaning of a shipped metric, and its time. ``metrics`` are names of kept metrics; default: the first three that
    vary. ``labels`` stand in place of names of laws and metrics. Raises InputError for an unknown one.
    """
    data = StudyRows(plan, frame, labels or {})
    chosen = data.named(metrics) or list(data.varying[:HEAD_METRICS])
    rates = figures.success_rates(data)
    rows: dict[str, dict[tuple[str, str], float]] = {}
    for law, at in data.rows.items():
        row = {("runs", ""): float(len(at))}
        for name, attribute in _SHARE.items():
            row[_SUCCESS, name] = 100.0 * getattr(rates[law], attribute) if law in rates else np.nan
        for metric in chosen:
            values = data.values(metric)[at]
            values = values[np.isfinite(values)]
            for name, q in _QUANTILES.items():
                row[metric.label, name] = float(np.quantile(values, q)) if len(values) else np.nan
        rows[law] = row
    medians = "Of success the 95 % interval (Wilson's); of the others medians, and the quantiles of 5 % and 95 %"
    return _with_heads(rows, "law", chosen, f"{medians} over the runs that completed.")


def comparison(
    plan: Plan, frame: pd.DataFrame, metrics: Sequence[str] = (), labels: Mapping[str, str] | None = None
) -> pd.DataFrame:
    """One row a pair of laws, ``"B − A"``: the draws that both have done, and of success [points] and each metric the
    difference of B from A in the same draws, the ends of its 95 % interval, and whether it is resolved with all others
    at once: 1 where the interval of all has no zero. Of success it is the difference of the shares, of a metric the
    median.

    Heads, ``attrs``, ``metrics`` and ``labels`` are as for :func:`statistics`. Raises InputError for an unknown metric,
    or if there are no two laws that ran.
    """
    data = StudyRows(plan, frame, labels or {})
    chosen = data.named(metrics) or list(data.varying[:HEAD_METRICS])
    pairs = paired(data, chosen)
    if not pairs:
        raise InputError(f"{plan.name}: has no two laws with runs in the same draws")
    rows = {f"{each.second} − {each.first}": _row_of(each, chosen) for each in pairs}
    n = sum(1 + len(each.metrics) for each in pairs)
    said = (
        "B − A: the difference in the same draws, of success of the shares, of the others the median difference, and "
        f"below it the 95 % interval. *: the interval has no zero, also if all {n} intervals hold at once."
    )
    return _with_heads(rows, "laws", chosen, said)


def _row_of(pair: Paired, metrics: Sequence[Metric]) -> dict[tuple[str, str], float]:
    """A row of :func:`comparison`; nan of a metric that has no interval, in fewer than eight draws."""
    found = {each.metric: (each.median, each.among_all.apart) for each in pair.metrics}
    points = Estimate(*(100.0 * each for each in (pair.success.value, pair.success.low, pair.success.high)))
    row = {("draws", ""): float(pair.draws)}
    for head, (one, resolved) in (
        (_POINTS, (points, pair.among_all.apart)),
        *((metric.label, found.get(metric, (Estimate(np.nan, np.nan, np.nan), False))) for metric in metrics),
    ):
        numbers = (one.value, one.low, one.high, float(resolved))
        row |= {(head, name): number for name, number in zip(_DIFFERENCE, numbers, strict=True)}
    return row


def _with_heads(
    rows: Mapping[str, Mapping[tuple[str, str], float]], corner: str, metrics: Sequence[Metric], said: str
) -> pd.DataFrame:
    found = pd.DataFrame.from_dict(rows, orient="index")
    found.columns = pd.MultiIndex.from_tuples(found.columns)
    found.index.name, counted = corner, found.columns[0]
    found[counted] = found[counted].astype(int)
    meanings = {metric.label: metric.meaning for metric in metrics if metric.meaning}
    found.attrs |= {"meanings": meanings, "said": said}
    return found


def to_csv(found: pd.DataFrame) -> str:
    """The table as CSV: one line of heads, each with its unit, and all digits."""
    flat = found.copy()
    flat.columns = [" ".join(filter(None, each)) for each in found.columns]
    return str(flat.to_csv(lineterminator="\n"))


def printed(found: pd.DataFrame, comment: str = "") -> LatexTable:
    """The table of :func:`statistics` or :func:`comparison` for a paper: a row for each law or pair, and below each
    number its range, with the digits that the range supports. The runs are in the note if all rows have as many."""
    columns, counted = [], found.columns[0]
    if found[counted].nunique() > 1:
        columns.append(Column(counted[0], "", [Stacked(str(n)) for n in found[counted]]))
    for head in dict.fromkeys(found.columns.get_level_values(0)[1:]):
        values = found[head].to_numpy(dtype=float)
        numbers, stars = ranged(values[:, :3], values.shape[1] > 3), values[:, 3:].any(axis=1)
        cells = [
            replace(cell, value=f"{cell.value}*") if star else cell
            for cell, star in zip(numbers.cells, stars, strict=True)
        ]
        name, _, unit = head.removesuffix("]").partition(" [")
        factor = f"10^{numbers.exponent}" if numbers.exponent else ""
        unit = " ".join(filter(None, (factor, unit)))
        columns.append(Column(name, f"[{unit}]" if unit else "", cells))
    corner, names = str(found.index.name), [*map(str, found.index)]
    return LatexTable(corner, names, columns, note(found), [*filter(None, comment.splitlines())])


def note(found: pd.DataFrame) -> str:
    """How the numbers of :func:`statistics` or :func:`comparison` are to be read: their ranges, the runs, and what each
    metric is."""
    counted = found.columns[0]
    each = {"runs": "runs of each law", "draws": "draws of each pair"}[counted[0]]
    number = f"{found[counted].iloc[0]} {each}. " if found[counted].nunique() == 1 else ""
    said = [f"{head.partition(' [')[0]}: {meaning}." for head, meaning in found.attrs.get("meanings", {}).items()]
    return " ".join([f"{number}{found.attrs['said']}", *said])


def write(found: pd.DataFrame, path: Path, comment: str = "") -> None:
    """Write the table by the ending of the file. Raises InputError for another one than :data:`FORMATS`, or if it can't
    be written."""
    kind = path.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise InputError(f"{path}: the name must end in .{' or .'.join(FORMATS)}")
    with atomic_write(path) as part:
        part.write_text(to_csv(found) if kind == "csv" else printed(found, comment).text, encoding="utf-8")
