"""The page: claims, boundaries of each law along each axis, maps, and the steps from ideal to a pool."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from ...studies.pages import Page, Picture, Section, Table, Text, number, rendered, versions_of
from ...studies.report.figures import decades
from ...views import colours
from ...views.figures.style import ABOVE, GREY, LINE, PAGE_IN, Figure, keys, panels, styled
from ..claims import STYLE, Row, as_part
from .results import AXES, DEMANDED, LABELS, MAPS, PART, RETUNED, STEPS, Axis, Results, why

_STYLES = (STYLE, Path(__file__).with_name("practicality.css"))
_LEAD = (
    "The paper’s laws on the BlueROV2 Heavy, which presses on a wall in a current that it does not know: from ideal to "
    "real along each axis, and step by step to a pool."
)
_WORKS = (
    f"A law works if the mean push of the last 0.5 s is within {number(100.0 * PART)} % of {DEMANDED} N of the "
    f"demanded one, and varies by at most {DEMANDED} N."
)
_AXES = (
    "Everything else is ideal. Each cell has the last value at which the law works, and what it does at the next one. "
    "Where there is noise, a law works if it does in all of several runs with other random numbers, and the worst is "
    "shown."
)
_STEPS = (
    "Each step keeps those before it. The retuned gains are k_1 = k_2 = 1, beta = 2 and A = -20. The bumper has 2e3 "
    "N/m, in series with the wall’s 1e5 N/m."
)
_PROFILES = (
    "Push of the last 0.5 s along each axis, ideal on the left: mean, and its range as a line. A cross: the law does "
    "not work. Grey band: the demanded force within a tenth. Dotted: a value as in a pool. With noise, the worst of "
    f"{max(axis.repeats for axis in AXES.values())} runs."
)
_MAPS = (
    "Range of the push over the last 0.5 s, from least to greatest. Hatched: the law does not work. Grey: the push "
    "hardly varies and is wrong, or the vehicle is off the wall. Dashed: the contact force is as old as D_d/(K_f k_c) "
    "lets it be."
)


def page(results: Results, rows: Sequence[Row], versions: Mapping[str, str]) -> str:
    """The page as HTML."""
    runs = sum(len(frame) for frame in results.frames.values())
    sources = [(axis.title, [axis.text(axis.real), axis.source]) for axis in AXES.values()]
    sections = [
        Section("claims", "Claims", [as_part(rows)]),
        Section(
            "axes",
            "Axes",
            [
                Text(_AXES),
                boundaries(results).shown("Where each law stops working", "words"),
                Picture("profiles", _PROFILES, profiles(results)),
            ],
        ),
        Section("maps", "Maps", [Picture("maps-figure", _MAPS, maps(results))], "start"),
        Section("steps", "Steps to a pool", [Text(_STEPS), steps(results).shown("Steps to a pool", "words")]),
        Section(
            "sources",
            "Sources",
            [Table("axis", ["in a pool", "source and trust"], sources, "words"), versions_of(versions)],
        ),
    ]
    lead = [Text(_LEAD, "lead"), Text(f"{runs} runs; engine free_body. {_WORKS}", "soft")]
    return rendered(Page("From ideal to real: where each law stops working", lead, sections, _STYLES))


def boundaries(results: Results) -> Table:
    """Where each law stops working along each axis, and what it does there."""
    rows = []
    for axis in AXES.values():
        cells = []
        for law in LABELS:
            found = results.boundaries[axis.name, law]
            then = "; then it" if found.last is not None else ": it"
            cells.append(f"{found.text}{then} {found.why}" if found.why else found.text)
        rows.append((f"{axis.title} (in a pool {axis.text(axis.real)})", cells))
    return Table("axis", list(LABELS), rows)


def steps(results: Results) -> Table:
    """GSTA after each step, with both sets of gains, without and with the bumper."""
    columns = [(law, bumper) for law in ("gsta", RETUNED) for bumper in (False, True)]
    rows = []
    for stage, (title, _) in enumerate(STEPS):
        found = [results.step(law, bumper, stage) for law, bumper in columns]
        cells = [
            f"works: {row['force_error_N']:+.2g} N, varies by {row['force_range_N']:.2g} N"
            if row["works"]
            else why(row)
            for row in found
        ]
        rows.append((title if stage == 0 else f"+ {title}", cells))
    return Table("step", [f"{law}{' with bumper' if bumper else ''}" for law, bumper in columns], rows)


_COLUMNS = 2
_TOP = 2.0 * DEMANDED
"""Top of the panels [N]; a push above is drawn there."""
_HATCH, _WRONG = "#8c8c8c", "#d9d9d9"
_SHOWN = ("fosm", "gsta", "gsta retuned")
"""The laws of the maps; impedance control alone does not reach the wall."""


def _colours() -> dict[str, str]:
    return dict(zip(LABELS, colours.hex_of_runs([label.split()[0] for label in LABELS]), strict=True))


def profiles(results: Results) -> Figure:
    """The push of each law along the axes: mean and range of its last 0.5 s, and where the law stops working."""
    shown = _colours()
    with styled():
        figure, drawn = panels(len(AXES), _COLUMNS, 0.5, 1.35, sharey=True)
        for ax, axis in zip(drawn, AXES.values(), strict=True):
            _profile(ax, results, axis, shown)
        for ax in drawn[::_COLUMNS]:
            ax.set_ylabel("push [N]")
        handles = [*keys(shown), Line2D([], [], color=GREY, linestyle=":", label="as in a pool")]
        figure.legend(handles=handles, ncols=len(handles), **ABOVE)
    return figure


def _profile(ax: Axes, results: Results, axis: Axis, shown: dict[str, str]) -> None:
    least, (factor, _) = min(value for value in axis.values if value > 0.0), _in_ms(axis)
    for i, (law, colour) in enumerate(shown.items()):
        rows = results.along(axis, law)
        x = np.array(rows[axis.key], float)
        x = factor * np.where(x == 0.0, least / 2.0, x) * (1.03**i) if axis.logarithmic else x
        mean, half = rows["contact.final_N"].to_numpy(float), 0.5 * rows["force_range_N"].to_numpy(float)
        works = rows["works"].to_numpy()
        low, high = np.clip(mean - half, 0.0, _TOP), np.clip(mean + half, 0.0, _TOP)
        ax.vlines(x, low, high, color=colour, linewidth=1.1 * LINE, alpha=0.8)
        ax.plot(x[works], np.clip(mean, 0.0, _TOP)[works], "o", color=colour, markersize=2.6)
        ax.plot(x[~works], np.clip(mean, 0.0, _TOP)[~works], "x", color=colour, markersize=3.2)
    ax.axhspan(DEMANDED * (1.0 - PART), DEMANDED * (1.0 + PART), color="#000000", alpha=0.06, linewidth=0.0)
    ax.axvline(factor * axis.real, color=GREY, linestyle=":", linewidth=LINE)
    if axis.logarithmic:
        decades(ax, "x")
    if axis.values[-1] < axis.values[0]:
        ax.invert_xaxis()
    ax.set_ylim(-0.1, _TOP + 0.1)
    unit = "" if axis.unit == "1" else f" [{_in_ms(axis)[1]}]"
    ax.set_xlabel(f"{axis.title}{unit}", parse_math=False)


def _in_ms(axis: Axis) -> tuple[float, str]:
    """Factor of the values of an axis, and its unit: times are drawn in milliseconds."""
    return (1e3, "ms") if axis.unit == "s" else (1.0, axis.unit)


def maps(results: Results) -> Figure:
    """The range of the push over two axes, hatched where a law does not work, with the limit of the force's age. Grey
    where the push hardly varies and is wrong: there is none off the wall."""
    with styled(), mpl.rc_context({"hatch.linewidth": 0.5}):
        figure = Figure(figsize=(PAGE_IN, 0.5 + 2.0 * len(MAPS)))
        grid = figure.subplots(len(MAPS), len(_SHOWN), squeeze=False, sharey=True)
        drawn = None
        for row, (name, (x, y)) in zip(grid, MAPS.items(), strict=True):
            for ax, law in zip(row, _SHOWN, strict=True):
                drawn = _map(ax, results, name, law, x, y)
                ax.set_xlabel(f"{x.title} [ms]")
            row[0].set_ylabel("stiffness of the wall [N/m]")
        for ax, law in zip(grid[0], _SHOWN, strict=True):
            ax.set_title(law, color=_colours()[law], fontweight="bold", parse_math=False)
        assert drawn is not None
        bar = figure.colorbar(drawn, ax=grid, pad=0.01, fraction=0.04, aspect=24, extend="both")
        bar.set_label("range of the push over the last 0.5 s [N]")
        bar.outline.set_linewidth(0.4)
    return figure


def _map(ax: Axes, results: Results, name: str, law: str, x: Axis, y: Axis) -> Any:
    frame = results.frames[name].assign(works=results.works(name))
    frame = frame[frame["law"] == law]
    ranges = frame.pivot(index=y.key, columns=x.key, values="force_range_N").to_numpy(float)
    works = frame.pivot(index=y.key, columns=x.key, values="works").to_numpy(bool)
    across, up = 1e3 * _edges(x.values), _edges(y.values)
    ranges = np.clip(np.nan_to_num(ranges, nan=1e3), 1e-4, 1e3)
    wrong = ~works & (ranges <= DEMANDED)
    shown = np.ma.masked_array(ranges, wrong)
    ax.set_facecolor(_WRONG)
    drawn = ax.pcolormesh(across, up, shown, norm=LogNorm(1e-2, 10.0), cmap="cividis", rasterized=True)
    for i, j in np.argwhere(~works):
        size = across[j + 1] - across[j], up[i + 1] - up[i]
        ax.add_patch(Rectangle((across[j], up[i]), *size, fill=False, hatch="///", linewidth=0.0, edgecolor=_HATCH))
    limit = results.limits(name, law)
    ax.plot(1e3 * limit[:, 0], limit[:, 1], color="#ffffff", linewidth=2.2 * LINE)
    ax.plot(1e3 * limit[:, 0], limit[:, 1], color="#000000", linewidth=1.1 * LINE, linestyle="--")
    decades(ax, "x")
    decades(ax, "y")
    ax.set_xlim(across[0], across[-1])
    ax.set_ylim(up[0], up[-1])
    ax.grid(False)
    return drawn


def _edges(values: Sequence[float]) -> np.ndarray:
    """Edges of cells around values, halfway in their logarithm."""
    logs = np.log(values)
    middle = 0.5 * (logs[1:] + logs[:-1])
    return np.exp(np.concatenate([[2.0 * logs[0] - middle[0]], middle, [2.0 * logs[-1] - middle[-1]]]))
