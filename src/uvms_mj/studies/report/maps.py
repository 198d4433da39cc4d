"""Maps of metrics over two factors, with the region of failures hatched."""

import itertools
import math
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from ...views.figures.style import PAGE_IN, Figure, styled
from .data import Factor, Metric, StudyRows, spans_decades
from .figures import decades, rounded
from .sensitivity import SUCCESS, Sensitivities

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
    """The metrics to draw over a pair: those that are sensitive to both factors, the most sensitive first. The first
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
            row[0].set_ylabel(pair[1].label, parse_math=False, fontsize=_size(pair[1].label))
        for ax in below:
            ax.set_xlabel(pair[0].label, parse_math=False, fontsize=_size(pair[0].label))
    return figure


def _row(
    figure: Figure,
    row: Sequence[Axes],
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
    bar.set_label("success [%]" if metric is SUCCESS else metric.label, parse_math=False)
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
