"""Figures of a study: success rates, distributions, sensitivities, and values over a single factor."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from ...views.figures.style import BLACK, GREY, LINE, PAGE_IN, SMALL, Figure, panels, stripe, styled
from .data import Factor, Metric, StudyRows, spans_decades
from .sensitivity import Sensitivities
from .statistics import Estimate, rate

MOST_PANELS = 12
_COLUMNS = 3
_POINTS = 500
"""Most points of a curve: quantiles at equal steps of probability, which a figure cannot show more finely."""
_MOST_DOTS = 1500
"""Most dots of a law in a panel; of more runs, so many evenly chosen ones."""
ABOVE_PANEL = 1.045
"""Height of marks above a panel, over its own: there they cover no point."""
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


def distributions(data: StudyRows) -> Figure | None:
    """Cumulative distributions of all metrics that vary, at most :data:`MOST_PANELS`."""
    metrics = data.varying[:MOST_PANELS]
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
    """Cumulative distribution of a metric for each law, as shares of all its runs. A curve that ends below 1, at an
    open circle, lacks the runs without a value."""
    values = data.values(metric)
    for i, law in enumerate(data.laws):
        rows = data.rows[law]
        found = np.sort(values[rows][np.isfinite(values[rows])])
        if not len(found):
            continue
        x, share = cumulative(found)
        top = len(found) / len(rows)
        ax.plot(x, top * share, color=data.colours[law], drawstyle="steps-post", **stripe(i, len(data.laws)))
        if top < 1.0:
            ax.plot(x[-1], top, "o", color=data.colours[law], markerfacecolor="white", markersize=3.5, zorder=4.0)
    scale(ax, values)
    ax.set_ylim(0.0, 1.02)
    ax.set_xlabel(metric.label, parse_math=False)
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
        ax.margins(x=0.04)


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
    if not e and value < 1e4:
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
            names = [factor.name if _leftmost(ax) else "" for factor in factors]
            ax.set_yticks(range(len(factors)), names, parse_math=False)
            ax.set_ylim(len(factors) - 0.5, -0.5)
            if found.sobol:
                left, right = ax.get_xlim()
                ax.set_xlim(min(-0.05, max(left - 0.03, -0.5)), max(1.05, min(right + 0.03, 1.5)))
            else:
                ax.set_xlim(-1.05, 1.05)
            ax.axvline(0.0, color=GREY, linewidth=0.6)
            ax.set_title(metric.label, parse_math=False)
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


def profile(data: StudyRows, factor: Factor) -> Figure | None:
    """Metrics over the only factor of a study: a dot for each run, and crosses above the panel for runs that do not
    succeed."""
    metrics = data.varying[: 2 * _COLUMNS]
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
            ax.set_xlabel(factor.label, parse_math=False)
            ax.set_ylabel(metric.label, parse_math=False)
        _name_laws(figure, data)
    return figure


def _name_laws(figure: Figure, data: StudyRows, more: Sequence[Line2D] = (), *, striped: bool = False) -> None:
    """Add the legend of the laws, with the number of runs that completed, and ``striped`` with the curves' dashes."""
    handles = []
    for i, (law, rows) in enumerate(data.rows.items()):
        completed = int(data.completed[rows].sum())
        label = law if completed == len(rows) else f"{law} ({completed} of {len(rows)} runs completed)"
        look = stripe(i, len(data.laws)) if striped else {}
        handles.append(Line2D([], [], color=data.colours[law], label=label, **(look | {"linewidth": 2.0 * LINE})))
    columns = max(1, min(len(handles) + len(more), 6 if len(data.laws) > 3 else 5))
    legend = figure.legend(handles=[*handles, *more], loc="outside upper center", ncols=columns)
    for text in legend.get_texts():
        text.set_parse_math(False)
