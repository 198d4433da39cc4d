"""The page of an identification: coefficients, unknowns that can't be told apart, and residuals."""

import numpy as np

from ...views.figures.style import BLACK, GREY, LINE, Figure, panels, styled
from ..pages import Page, Part, Picture, Section, Table, Text, facts, given, number, rendered
from .data import Data
from .file import File
from .fit import Fit
from .problem import Problem
from .result import Result

_INTERVALS = (
    "Intervals are of 95 %, from the information at the fit and the residuals of each signal; residuals that are "
    "correlated in time count as fewer. They hold if the model is right."
)
_FIGURE = (
    "Left: measured (points) and simulated (line) over time; right of the dashed line the data are held out. Middle: "
    "what is left. Right: its correlation with itself; white noise stays within the dashed lines."
)
_NONE_HELD = "No data are held out, so nothing shows how the vehicle predicts what it was not fitted to."
_LAGS = 40


def page(file: File, problem: Problem, result: Result) -> str:
    """The report as HTML."""
    lead = given(
        Text(file.description, "lead") if file.description else None,
        *(Text(note, "warning") for note in result.notes),
    )
    sections = [
        Section("coefficients", "Coefficients", [_coefficients(result), Text(_INTERVALS, "soft")]),
        Section("apart", "What the data tell apart", _apart(result)),
        Section("held", "Held-out data", _held(result)),
        *(
            Section(
                f"experiment-{i}",
                data.name,
                [_picture(problem, result, i)],
                "keep",
            )
            for i, data in enumerate(problem.data)
        ),
        Section("unknowns", "Unknowns of the experiments", [_unknowns(result)]),
        Section(
            "data", "Data", [facts([(data.name, _said(data, result.fit, i)) for i, data in enumerate(problem.data)])]
        ),
    ]
    return rendered(Page(f"{file.name}: coefficients from measurements", lead, sections))


def _picture(problem: Problem, result: Result, i: int) -> Picture:
    return Picture(f"residuals-{i}", _FIGURE, residuals(problem, result, i))


def _said(data: Data, found: Fit, i: int) -> str:
    parts = [
        f"{c.name}: {len(c.t)} samples, noise {s:.3g} {c.unit}"
        for c, s in zip(data.channels, found.sigmas[i], strict=True)
    ]
    return f"{data.path.name}, {data.experiment.kind}; {'; '.join(parts)}"


def _coefficients(result: Result) -> Table:
    rows = [
        (
            f"{each.name} [{each.unit}]",
            [
                number(each.start),
                number(each.value) if each.given else "–",
                f"± {number(each.half_width, 2)}" if each.given else "",
                each.why_not,
            ],
        )
        for each in result.coefficients
    ]
    return Table("", ["before", "found", "95 %", "why not"], rows).shown("Coefficients")


def _apart(result: Result) -> list[Part]:
    values = result.fit.eigenvalues
    said = f"Eigenvalues of the information, in units of the scales: from {values[0]:.3g} to {values[-1]:.3g}."
    parts: list[Part] = [Text(said)]
    if result.apart:
        rows = [(", ".join(names), [number(deviation, 3)]) for names, deviation in result.apart]
        parts.append(Table("together", ["deviation over scale"], rows).shown("Not told apart"))
    else:
        parts.append(Text("All are told apart."))
    if result.correlated:
        rows = [(f"{a}, {b}", [f"{r:.3f}"]) for a, b, r in result.correlated]
        parts.append(Table("pair", ["correlation"], rows).shown("Correlations beyond 0.9"))
    return parts


def _held(result: Result) -> list[Part]:
    if not result.held_out:
        return [Text(_NONE_HELD, "warning")]
    rows = [
        (
            f"{each.experiment}, {each.channel} [{each.unit}]",
            [f"{each.samples}", number(each.fitted, 3), number(each.before, 3), number(each.mean, 3)],
        )
        for each in result.held_out
    ]
    heads = ["samples", "fitted", "vehicle before", "mean of the fitted data"]
    return [Table("rms error", heads, rows).shown("Errors on held-out data")]


def _unknowns(result: Result) -> Part:
    if not result.unknowns:
        return Text("There are none.")
    rows = [
        (f"{of}, {name} [{unit}]", [number(value), f"± {number(half, 2)}" if np.isfinite(half) else "–"])
        for of, name, unit, value, half in result.unknowns
    ]
    return Table("", ["found", "95 %"], rows).shown("Unknowns of the experiments")


def residuals(problem: Problem, result: Result, i: int) -> Figure:
    """Measured and simulated, residual, and its correlation, for each channel of experiment i."""
    data = problem.data[i]
    predicted, errors = problem.predicted(i, result.x), problem.errors(i, result.x)
    motion = data.experiment.kind == "motion"
    along = "time [s]" if motion else "row"
    with styled():
        figure, axes = panels(3 * len(data.channels), 3, 0.3, 1.5)
        for k, (channel, y, e) in enumerate(zip(data.channels, predicted, errors, strict=True)):
            left, middle, right = axes[3 * k : 3 * k + 3]
            x = channel.t + data.t_0 if motion else channel.t + 1
            left.plot(x, channel.y, ".", color=GREY, markersize=2)
            left.plot(x, y, "-" if motion else "+", color=BLACK, linewidth=LINE)
            middle.plot(x, e, "." if motion else "+", color=BLACK, markersize=2 if motion else 4)
            if np.isfinite(data.held_from) and motion:
                for ax in (left, middle):
                    ax.axvline(data.held_from + data.t_0, color=GREY, linewidth=LINE, linestyle=(0, (3, 2)))
            left.set_ylabel(f"{channel.name} [{channel.unit}]", parse_math=False)
            middle.set_ylabel("residual", parse_math=False)
            r = e - e.mean()
            lags = np.arange(1, min(_LAGS, len(r) // 2) + 1)
            power = float(r @ r) or 1.0
            right.vlines(lags, 0.0, [float(r[:-lag] @ r[lag:]) / power for lag in lags], color=BLACK, linewidth=LINE)
            for sign in (-1.0, 1.0):
                right.axhline(sign * 1.96 / np.sqrt(len(r)), color=GREY, linewidth=LINE, linestyle=(0, (3, 2)))
            right.set_xlim(0.0, float(lags[-1]) + 1.0)
            right.set_ylabel("correlation")
            if k == len(data.channels) - 1:
                for ax, label in zip((left, middle, right), (along, along, "lag [samples]"), strict=True):
                    ax.set_xlabel(label)
    return figure
