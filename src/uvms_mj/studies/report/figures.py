"""Figures of a study: success rates, distributions, sensitivities, and values over one or two factors, with the
region of failures hatched.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import PolyCollection
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator
from matplotlib.tri import Triangulation

from ...views.figures.style import BLACK, GREY, LINE, PAGE_IN, SMALL, Figure, panels, stripe, styled, titled
from .data import Factor, Metric, StudyRows, spans_decades
from .statistics import SUCCESS, Estimate, Sensitivities, rate

MOST_PANELS = 12
_COLUMNS = 3
_POINTS = 500
"""Most points of a curve: quantiles at equal steps of probability, which a figure cannot show more finely."""
_MOST_DOTS = 1500
"""Most dots of a law in a panel; of more runs, so many evenly chosen ones."""
ABOVE_PANEL = 1.045
"""Height of marks above a panel, over its own: there they cover no point."""
_MARGIN = 0.04
"""Room for a dot beside the first and the last value, as a share of the range."""
_BULK = (0.02, 0.98)
"""Quantiles between which values are shown if a few others would make them look flat."""


def success_rates(data: StudyRows) -> dict[str, Estimate]:
    """Success rate of each law that has a run."""
    return {
        law: rate(int(data.success[rows].sum()), len(rows), len(np.unique(data.frame["draw"].to_numpy()[rows])))
        for law, rows in data.rows.items()
        if len(rows)
    }


def overview(data: StudyRows, rates: Mapping[str, Estimate]) -> Figure:
    """Success rates with intervals, beside the distributions of the first two metrics."""
    with styled():
        shown = data.varying[:2]
        figure = Figure(figsize=(PAGE_IN, max(1.75, 0.7 + 0.2 * len(rates))))
        axes = figure.subplots(1, 1 + len(shown), squeeze=False)[0]
        _rates(axes[0], data, rates)
        for i, (ax, metric) in enumerate(zip(axes[1:], shown, strict=True)):
            distribution(ax, data, metric, first=i == 0)
        _name_laws(figure, data, striped=True)
    return figure


def _rates(ax: Axes, data: StudyRows, rates: Mapping[str, Estimate]) -> None:
    lowest = min(each.low for each in rates.values())
    for i, (law, each) in enumerate(rates.items()):
        ax.plot([100.0 * each.low, 100.0 * each.high], [i, i], color=data.colours[law], linewidth=2.2 * LINE)
        ax.plot(100.0 * each.value, i, "o", color=data.colours[law], markersize=4.5, clip_on=False)
    ax.set_yticks(range(len(rates)), list(rates), parse_math=False)
    ax.set_ylim(len(rates) - 0.4, -0.6)
    ax.set_xlim(0.0 if lowest < 0.8 else 100.0 - 1.15 * max(100.0 - 100.0 * lowest, 0.1), 100.0)
    ax.grid(False, axis="y")
    ax.set_xlabel("runs that succeed [%], with 95 % interval")


def distributions(data: StudyRows, metrics: Sequence[Metric] = ()) -> Figure | None:
    """Cumulative distributions of metrics, by default of all that vary, at most :data:`MOST_PANELS`."""
    metrics = metrics or data.varying[:MOST_PANELS]
    if not metrics:
        return None
    with styled():
        figure, axes = panels(len(metrics), _COLUMNS, 0.35, 1.55)
        for ax, metric in zip(axes, metrics, strict=True):
            distribution(ax, data, metric, first=_leftmost(ax))
        _name_laws(figure, data, striped=True)
    return figure


def _leftmost(ax: Axes) -> bool:
    place = ax.get_subplotspec()
    return place is None or place.is_first_col()


def distribution(ax: Axes, data: StudyRows, metric: Metric, first: bool) -> None:
    """Cumulative distribution of a metric for each law, as shares of all its runs. A curve ends at a dot, or below 1 at
    an open circle if it lacks the runs without a value."""
    values, ends = data.values(metric), list[tuple[float, Line2D]]()
    for i, law in enumerate(data.laws):
        rows = data.rows[law]
        found = np.sort(values[rows][np.isfinite(values[rows])])
        if not len(found):
            continue
        x, share = cumulative(found)
        top = len(found) / len(rows)
        ax.plot(x, top * share, color=data.colours[law], drawstyle="steps-post", **stripe(i, len(data.laws)))
        # marked, since the end of a curve may be in a gap of its dashes
        face = "white" if top < 1.0 else data.colours[law]
        end: dict[str, Any] = {"markerfacecolor": face, "markersize": 3.5, "zorder": 4.0, "clip_on": False}
        ends += [(float(x[-1]), *ax.plot([x[-1]], [top], "o", color=data.colours[law], **end))]
    scale(ax, values)
    low, high = ax.get_xlim()
    for at, each in ends:  # an end beyond the limits would stand outside the axes, and take room in the layout
        each.set_visible(low <= at <= high)
    ax.set_ylim(0.0, 1.02)
    ax.set_xlabel(metric.axis)
    if first:
        ax.set_ylabel("share of runs")


def cumulative(ordered: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (k,) and cumulative shares (k,) of sorted values (n,), at most :data:`_POINTS`."""
    n = len(ordered)
    at = np.arange(n) if n <= _POINTS else np.unique(np.linspace(0, n - 1, _POINTS).round().astype(int))
    return np.r_[ordered[0], ordered[at]], np.r_[0.0, (at + 1.0) / n]


def scale(ax: Axes, values: np.ndarray) -> None:
    """Make x logarithmic if values (n,) need it, and limit it to the bulk of them if a few others are far away."""
    found = values[np.isfinite(values)]
    if not len(found):
        return
    if spans_decades(found):
        decades(ax, "x")
        ax.margins(x=_MARGIN)
        return
    low, high = np.quantile(found, _BULK)
    if len(found) >= 20 and np.ptp(found) > 5.0 * (high - low) > 0.0:
        margin = 0.2 * (high - low)
        ax.set_xlim(low - margin, high + margin)
        beyond = int(((found < low - margin) | (found > high + margin)).sum())
        ax.set_title(
            f"{beyond} {'run' if beyond == 1 else 'runs'} beyond", loc="right", fontsize=SMALL, color="#555555"
        )
    else:
        ax.margins(x=_MARGIN)


def decades(ax: Axes, name: str) -> None:
    """Make the axis "x" or "y" logarithmic, with more ticks a decade for fewer decades."""
    axis: Axis = ax.xaxis if name == "x" else ax.yaxis
    (ax.set_xscale if name == "x" else ax.set_yscale)("log")
    low, high = axis.get_data_interval()
    span = high / low if low > 0.0 else np.inf
    subs = (1.0, 2.0, 5.0) if span < 12.0 else (1.0, 3.0) if span < 150.0 else (1.0,)
    axis.set_major_locator(LogLocator(subs=subs, numticks=8))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: rounded(value)))


def rounded(value: float) -> str:
    """A round number of an axis: with a power of ten where it is large or small. A prefix such as the m of milli would
    read as a unit."""
    mantissa, e, exponent = f"{value:g}".partition("e")
    if not e and 1e-3 <= value < 1e4:
        return mantissa
    if not e:
        exponent = str(int(np.floor(np.log10(value))))
        mantissa = f"{value / 10.0 ** int(exponent):g}"
    return f"$10^{{{int(exponent)}}}$" if mantissa == "1" else f"${mantissa}\\cdot10^{{{int(exponent)}}}$"


def sensitivity(found: Sensitivities, data: StudyRows) -> Figure:
    """One panel for each metric: a row for each factor, a dot with its interval for each law; open circles are Sobol
    indices of first order."""
    strongest = {f: max(found.strength(metric, f) for metric in found.of) for f in found.factors}
    factors = sorted(found.factors, key=lambda factor: -strongest[factor])[: _COLUMNS * 4]
    with styled():
        height = max(1.0, 0.6 + (0.12 + 0.09 * len(data.laws)) * len(factors))
        figure, axes = panels(len(found.of), _COLUMNS, 0.35, height)
        for ax, (metric, laws) in zip(axes, found.of.items(), strict=True):
            for i, law in enumerate(data.laws):
                if law in laws:
                    offset = 0.6 * ((i + 0.5) / len(data.laws) - 0.5)
                    each = laws[law]
                    at = [found.factors.index(factor) for factor in factors]
                    _dots(ax, [each.main[f] for f in at], offset, data.colours[law], filled=True)
                    if each.first:
                        _dots(ax, [each.first[f] for f in at], offset, data.colours[law], filled=False)
            names = [titled(factor.name) if _leftmost(ax) else "" for factor in factors]
            ax.set_yticks(range(len(factors)), names)
            ax.set_ylim(len(factors) - 0.5, -0.5)
            if found.sobol:
                left, right = ax.get_xlim()
                ax.set_xlim(min(-0.05, max(left - 0.03, -0.5)), max(1.05, min(right + 0.03, 1.5)))
            else:
                ax.set_xlim(-1.05, 1.05)
            ax.axvline(0.0, color=GREY, linewidth=0.6)
            ax.set_title(metric.axis)
            ax.set_xlabel("Sobol index" if found.sobol else "rank correlation")
        look: dict[str, Any] = {"color": BLACK, "marker": "o", "linestyle": "none", "markersize": 3.5}
        faces = (("total", BLACK), ("first order", "white")) if found.sobol else ()
        _name_laws(figure, data, [Line2D([], [], markerfacecolor=face, label=name, **look) for name, face in faces])
    return figure


def _dots(ax: Axes, estimates: Sequence[Estimate | None], offset: float, colour: str, *, filled: bool) -> None:
    for y, each in enumerate(estimates):
        if each is not None:
            if filled:
                ax.plot([each.low, each.high], [y + offset] * 2, color=colour, linewidth=LINE, solid_capstyle="butt")
            face = colour if filled else "white"
            ax.plot(each.value, y + offset, "o", color=colour, markerfacecolor=face, markersize=3.2)


def profile(data: StudyRows, factor: Factor, metrics: Sequence[Metric] = ()) -> Figure | None:
    """Metrics, by default the first that vary, over one factor: a dot for each run, and crosses above the panel for
    runs that do not succeed."""
    metrics = metrics or data.varying[: 2 * _COLUMNS]
    if not metrics or not factor.numeric:
        return None
    x = data.of(factor)
    with styled():
        figure, axes = panels(len(metrics), _COLUMNS, 0.35, 1.7)
        for ax, metric in zip(axes, metrics, strict=True):
            y = data.values(metric)
            for law, rows in data.rows.items():
                some = rows[:: max(1, -(-len(rows) // _MOST_DOTS))]
                ax.plot(
                    x[some],
                    y[some],
                    ".",
                    color=data.colours[law],
                    markersize=2.5,
                    alpha=0.8,
                    rasterized=len(some) > 300,
                )
                lost = some[~data.success[some]]
                if len(lost):  # a line without points would disturb the layout
                    look: dict[str, Any] = {"color": data.colours[law], "markersize": 3.5, "clip_on": False}
                    ax.plot(x[lost], np.full(len(lost), ABOVE_PANEL), "x", transform=ax.get_xaxis_transform(), **look)
            if factor.logarithmic:
                decades(ax, "x")
            if spans_decades(y):
                decades(ax, "y")
            ax.margins(x=0.03)
            ax.set_xlabel(factor.axis)
            ax.set_ylabel(metric.axis)
        _name_laws(figure, data)
    return figure


def _name_laws(figure: Figure, data: StudyRows, more: Sequence[Line2D] = (), *, striped: bool = False) -> None:
    """Add the legend of the laws, with the number of runs that completed, and ``striped`` with the curves' dashes."""
    handles = []
    for i, (law, rows) in enumerate(data.rows.items()):
        completed = int(data.completed[rows].sum())
        label = law if completed == len(rows) else f"{law} ({completed} of {len(rows)} runs completed)"
        look = stripe(i, len(data.laws)) if striped else {"linewidth": 2.0 * LINE}
        handles.append(Line2D([], [], color=data.colours[law], label=label, **look))
    columns = max(1, min(len(handles) + len(more), 6 if len(data.laws) > 3 else 5))
    length = 3.2 if striped else None  # room for the dashes, by which a print without colours tells laws apart
    legend = figure.legend(handles=[*handles, *more], loc="outside upper center", ncols=columns, handlelength=length)
    for text in legend.get_texts():
        text.set_parse_math(False)


MOST_PAIRS, MOST_METRICS, MOST_LAWS = 3, 2, 4
MOST_ALONE = 5
"""Most metrics over the only pair of a study."""
_BESIDE = 2
"""Maps of one law beside each other."""
_MOST_NODES = 5000
"""Most nodes of a triangulation; more are binned."""
_PER_CELL, _MOST_CELLS = 8, 20
"""Runs of a law in a cell, on average; most cells along an axis."""
_TELLING = 0.1
"""Least sensitivity of a metric to both factors of a map."""
_FEW_DECADES = 5
"""Decades up to which a logarithmic scale has levels at 1, 2 and 5."""
_MOST_LABELS = 8
"""Most labels of the colours of a map."""
_HATCH = "////"
_COLOURS = "cividis"
"""A sequential map of colours that colour-blind readers see in the same order."""
_BLANK = ListedColormap(["white"])
"""Of a metric that is the same in every run."""


def pairs(found: Sensitivities) -> list[tuple[Factor, Factor]]:
    """The pairs of factors to which the metrics are most sensitive, strongest first; the factors keep their order."""
    total = {f: sum(found.strength(metric, f) for metric in found.of) for f in found.factors}
    ordered = sorted(itertools.combinations(found.factors, 2), key=lambda pair: -total[pair[0]] - total[pair[1]])
    return ordered[:MOST_PAIRS]


def shown(found: Sensitivities, pair: tuple[Factor, Factor], first: bool) -> list[Metric]:
    """The metrics to draw over a pair: metrics that are sensitive to both factors, the most sensitive first. The first
    pair has at least two, and success if it varies. The only pair has the first metrics of the study."""

    def least(metric: Metric) -> float:
        return min(found.strength(metric, factor) for factor in pair)

    metrics = [metric for metric in found.of if metric is not SUCCESS]
    if len(found.factors) == len(pair):
        return ([SUCCESS] if SUCCESS in found.of else []) + metrics[:MOST_ALONE]
    metrics.sort(key=lambda metric: -least(metric))
    if first:
        return ([SUCCESS] if SUCCESS in found.of else []) + metrics[:MOST_METRICS]
    return [metric for metric in metrics[:MOST_METRICS] if least(metric) >= _TELLING]


def maps(data: StudyRows, pair: tuple[Factor, Factor], metrics: Sequence[Metric]) -> Figure:
    """Maps over a pair of factors: a row for each metric, a column for each law; of one law, two metrics a row."""
    laws = [law for law in data.laws if len(data.rows[law])][:MOST_LAWS]
    with styled(), mpl.rc_context({"figure.constrained_layout.wspace": 0.05, "hatch.linewidth": 0.4}):
        columns = len(laws) if len(laws) > 1 else min(_BESIDE, len(metrics))
        number = -(-len(metrics) * len(laws) // columns)
        figure = Figure(figsize=(PAGE_IN, 0.55 + number * min(2.1, 0.4 + 0.6 * PAGE_IN / (columns + 0.5))))
        axes = figure.subplots(number, columns, squeeze=False, sharex=True, sharey=True)
        rows = axes if len(laws) > 1 else axes.reshape(-1, 1)
        for row, metric in zip(rows, metrics, strict=False):
            _row(figure, row, data, laws, pair, metric)
        below = list(axes[-1])
        if len(metrics) < len(rows):  # the last place is free
            rows[-1][0].remove()
            below[-1] = axes[-2][-1]
            below[-1].tick_params(labelbottom=True)
        for ax, law in zip(axes[0], laws, strict=False):
            ax.set_title(law, parse_math=False, color=data.colours[law], fontweight="bold")
        for row in axes:
            row[0].set_ylabel(pair[1].axis, fontsize=_size(pair[1].label))
        for ax in below:
            ax.set_xlabel(pair[0].axis, fontsize=_size(pair[0].label))
    return figure


def _row(
    figure: Figure,
    row: np.ndarray,
    data: StudyRows,
    laws: Sequence[str],
    pair: tuple[Factor, Factor],
    metric: Metric,
) -> None:
    """The maps of a metric, one for each law, with their colour bar."""
    values = 100.0 * data.success if metric is SUCCESS else data.values(metric)
    scale = _colours(values, metric)
    drawn = None
    for ax, law in zip(row, laws, strict=True):
        drawn = _draw(ax, data, law, pair, metric, values, scale) or drawn
        limits: tuple[Any, ...] = (ax.set_xlim, ax.set_ylim)
        for axis, limit, factor in zip("xy", limits, pair, strict=True):
            if factor.logarithmic:
                decades(ax, axis)
            if factor.limits is not None:
                limit(factor.limits)
        ax.grid(False)
    if drawn is None:
        return
    if scale["cmap"] is _BLANK:  # a colour would say nothing
        for ax in row:
            text = f"{rounded(float(np.nanmin(values)))} in every run"
            ax.text(0.5, 0.5, text, ha="center", va="center", transform=ax.transAxes)
        return
    bar = figure.colorbar(drawn, ax=row, pad=0.01, fraction=0.05, aspect=14, extend=scale["extend"])
    bar.set_label("success [%]" if metric is SUCCESS else metric.axis)
    bar.outline.set_linewidth(0.4)
    if metric is SUCCESS:
        bar.set_ticks(range(0, 101, 20))
    elif isinstance(scale["norm"], LogNorm):
        levels = scale["levels"].tolist()
        levels = levels[:: -(-len(levels) // _MOST_LABELS)]
        bar.set_ticks(levels, labels=[rounded(level) for level in levels])
        bar.minorticks_off()


def _size(label: str) -> float:
    """Size of a label that fits beside a map [pt]."""
    return min(8.0, max(6.5, 8.0 * 32.0 / len(label)))


def _colours(values: np.ndarray, metric: Metric) -> dict[str, Any]:
    """Arguments of contours: the scale of the colours of a metric, the same for all laws, its levels, and the ends
    beyond which there are values."""
    if metric is SUCCESS:
        ends = (-1e-6, *range(10, 100, 10), 100.0 + 1e-6)  # a band excludes its ends
        return {"norm": Normalize(0.0, 100.0), "levels": np.array(ends), "extend": "neither", "cmap": _COLOURS}
    found = values[np.isfinite(values)]
    low, high = np.quantile(found, (0.01, 0.99)) if len(found) else (0.0, 1.0)
    if high <= low:  # a few runs alone differ
        low, high = found.min(), found.max()
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        levels = np.array([low - 1.0, low + 1.0])
        return {"norm": Normalize(*levels), "levels": levels, "extend": "neither", "cmap": _BLANK}
    if len(found) and spans_decades(found):
        levels = _round_levels(float(low), float(high))
        return {"norm": LogNorm(levels[0], levels[-1]), "levels": levels, "extend": "both", "cmap": _COLOURS}
    levels = np.asarray(MaxNLocator(9, steps=[1, 2, 2.5, 5, 10]).tick_values(float(low), float(high)))
    inside = not len(found) or (levels[0] <= found.min() and found.max() <= levels[-1])
    extend = "neither" if inside else "both"
    return {"norm": Normalize(levels[0], levels[-1]), "levels": levels, "extend": extend, "cmap": _COLOURS}


def _round_levels(low: float, high: float) -> np.ndarray:
    """Levels 1, 2, 5, 10 ... from below ``low`` to above ``high``; of many decades, powers of ten."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    each = (1.0, 2.0, 5.0) if last - first <= _FEW_DECADES else (1.0,)
    levels = np.array([step * 10.0**power for power in range(first, last + 1) for step in each])
    start = np.searchsorted(levels, low, side="right") - 1
    return levels[start : np.searchsorted(levels, high) + 1]


def _draw(
    ax: Axes,
    data: StudyRows,
    law: str,
    pair: tuple[Factor, Factor],
    metric: Metric,
    values: np.ndarray,
    scale: dict[str, Any],
) -> Any:
    """Draw one map, and return what has the colours; None without a run."""
    rows = data.rows[law]
    x, y = (data.of(factor)[rows] for factor in pair)
    middle = "mean" if metric is SUCCESS else "median"
    table = pd.DataFrame({"x": x, "y": y, "value": values[rows], "success": data.success[rows].astype(float)})
    table = table[np.isfinite(x) & np.isfinite(y)]
    if not len(table):
        return None
    nodes = table.groupby(["x", "y"]).agg({"value": middle, "success": "mean"}).reset_index()
    flat = min(nodes["x"].nunique(), nodes["y"].nunique()) < 3
    if not flat and len(nodes) <= _MOST_NODES and (data.plan.design == "grid" or len(data.factors) == 2):
        return _contours(ax, nodes, pair, scale)
    return _cells(ax, table, pair, scale, middle)


def _contours(ax: Axes, nodes: pd.DataFrame, pair: tuple[Factor, Factor], scale: dict[str, Any]) -> Any:
    """Contours over the nodes of a grid, or over scattered draws of two factors. Triangles of a node without a value
    have no colour and are hatched, as is the region where fewer than half of the runs succeed."""
    x, y, value, success = (nodes[name].to_numpy() for name in nodes)
    mesh = Triangulation(*(_unit(each, factor.logarithmic) for each, factor in zip((x, y), pair, strict=True)))
    lost = ~np.isfinite(value)
    without = lost[mesh.triangles].any(axis=1)
    drawn = None
    if not without.all():
        part = Triangulation(x, y, mesh.triangles, mask=without)
        clean = np.where(lost, 0.0, value)
        drawn = ax.tricontourf(part, clean, **scale)
        ax.tricontour(part, clean, levels=scale["levels"], colors="white", linewidths=0.3)
    if success.min() < 0.5:
        whole = Triangulation(x, y, mesh.triangles)
        ax.tricontourf(whole, success, levels=[-1.0, 0.5], colors="none", hatches=[_HATCH])
        ax.tricontour(whole, success, levels=[0.5], colors="black", linewidths=0.8)
    _hatch(ax, [np.column_stack([x[each], y[each]]) for each in mesh.triangles[without]])
    ax.set_xlim(x.min(), x.max())
    ax.set_ylim(y.min(), y.max())
    return drawn


def _unit(values: np.ndarray, log: bool) -> np.ndarray:
    """Values on their axis, from 0 to 1."""
    values = np.log(values) if log else values
    return (values - values.min()) / max(float(np.ptp(values)), 1e-300)


def _cells(ax: Axes, table: pd.DataFrame, pair: tuple[Factor, Factor], scale: dict[str, Any], middle: str) -> Any:
    """Medians in cells with about the same number of runs, hatched where fewer than half of the runs succeed."""
    most = int(np.clip(np.sqrt(len(table) / _PER_CELL), 3, _MOST_CELLS))
    binned = [_edges(table[name].to_numpy(), most, factor) for name, factor in zip("xy", pair, strict=True)]
    edges, codes = [each for each, _ in binned], [each for _, each in binned]
    cells = table.groupby([codes[0], codes[1]]).agg({"value": middle, "success": "mean"})
    medians = np.full((len(edges[1]) - 1, len(edges[0]) - 1), np.nan)
    at = np.array([*cells.index])
    medians[at[:, 1], at[:, 0]] = cells["value"]
    drawn = ax.pcolormesh(*edges, medians, norm=scale["norm"], cmap=scale["cmap"], rasterized=True)
    lost = at[cells["success"].to_numpy() < 0.5]
    if len(lost):
        corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
        outlines = [[(edges[0][i + a], edges[1][j + b]) for a, b in corners] for i, j in lost]
        _hatch(ax, outlines)
    return drawn


def _hatch(ax: Axes, outlines: Sequence[Any]) -> None:
    if len(outlines):
        ax.add_collection(PolyCollection(outlines, facecolors="none", edgecolors="black", hatch=_HATCH, linewidths=0.0))


def _edges(values: np.ndarray, most: int, factor: Factor) -> tuple[np.ndarray, np.ndarray]:
    """Edges of at most ``most`` bins with about the same number of values (n,), and the bin (n,) of each. Few distinct
    values have a bin each."""
    values = np.log(values) if factor.logarithmic else values
    distinct = np.unique(values)
    if len(distinct) <= most:
        middles = (distinct[1:] + distinct[:-1]) / 2.0
        first, last = (middles[0], middles[-1]) if len(middles) else (distinct[0] - 0.5, distinct[0] + 0.5)
        edges = np.r_[2.0 * distinct[0] - first, middles, 2.0 * distinct[-1] - last]
    else:
        edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, most + 1)))
    codes = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    edges = np.exp(edges) if factor.logarithmic else edges
    if factor.limits is not None:
        edges[[0, -1]] = factor.limits
    return edges, codes
