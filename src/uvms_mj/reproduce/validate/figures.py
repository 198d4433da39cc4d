"""Figures of the page: all trials, the mean error over the height, and the fast swing."""

import numpy as np
from matplotlib.axes import Axes

from ...views.figures.style import ABOVE, BLACK, GREY, LINE, PAGE_IN, SMALL, Figure, keys, line, panels, styled
from .data import Attitude
from .results import HEIGHTS, PITCH, ROLL, YAW, Comparison
from .swing import swing
from .vehicle import HEIGHT, STATIC, VARIANTS, Variant

_AS_IS, _FITTED, _OTHER, _PALE = "#0b5c8a", "#c4541b", "#4d8a3c", "#b9c2cb"
_NAMES = {ROLL: "roll", PITCH: "pitch", YAW: "yaw"}
_DASHES = (0.0, (4.0, 1.5))
_COLUMNS = 3


def trials(results: Comparison) -> Figure:
    """Measured and simulated roll, pitch and yaw of every trial, over time: a row a trial."""
    rows = len(results.trials)
    with styled():
        figure = Figure(figsize=(PAGE_IN, 0.5 + 1.0 * rows))
        grid = figure.subplots(rows, len(_NAMES), squeeze=False)
        for k, row in enumerate(grid):
            for angle, ax in zip(_NAMES, row, strict=True):
                _angle(ax, results, k, angle)
            row[0].set_ylabel(results.trials[k].name)
        for angle, name in _NAMES.items():
            grid[0, angle].set_title(f"{name} [deg]")
            grid[-1, angle].set_xlabel("t [s]")
        _legend(figure)
    return figure


def pitches(results: Comparison) -> Figure:
    """Measured and simulated pitch of every trial, over time: a panel a trial."""
    with styled():
        figure, axes = panels(len(results.trials), _COLUMNS, 0.5, 1.45)
        for k, ax in enumerate(axes):
            _angle(ax, results, k, PITCH)
            ax.set_title(results.trials[k].name)
        for ax in axes[::_COLUMNS]:
            ax.set_ylabel("pitch [deg]")
        for ax in axes[(len(axes) - 1) // _COLUMNS * _COLUMNS :]:
            ax.set_xlabel("t [s]")
        _legend(figure)
    return figure


def _legend(figure: Figure) -> None:
    measured = {"motion capture": GREY, "inertial unit": _PALE}
    simulated = {"as it is": _AS_IS, "height of the centre of buoyancy fitted": _FITTED, "hydrostatics alone": _OTHER}
    handles = keys(measured | simulated)
    handles[-1].set(linestyle=_DASHES, linewidth=1.2 * LINE)
    figure.legend(handles=handles, ncols=5, **(ABOVE | {"fontsize": 7.0}))


def _angle(ax: Axes, results: Comparison, k: int, angle: int) -> None:
    trial, begin = results.trials[k], results.responses[k, Variant()].t[0]
    for measured, colour, width in ((trial.mocap, GREY, 0.5), (trial.imu, _PALE, 1.0)):
        values = _degrees(measured, angle, begin)
        line(ax, measured.t, values, "measured", color=colour, linewidth=width * LINE)
    for variant, colour in ((Variant(), _AS_IS), (results.fitted, _FITTED)):
        found = results.responses[k, variant]
        line(ax, found.t, _degrees(found, angle, begin), "simulated", color=colour, linewidth=LINE)
    static = results.responses[k, Variant(STATIC)]
    if angle != YAW:
        ax.plot(static.t, np.degrees(static.angles[:, angle]), color=_OTHER, linewidth=0.8 * LINE, linestyle=_DASHES)
    ax.axvline(trial.starts, color=BLACK, linewidth=0.6 * LINE, linestyle=":")
    ax.margins(x=0.0)


def _degrees(attitude: Attitude, angle: int, begin: float) -> np.ndarray:
    values = attitude.angles[:, angle]
    return np.degrees(values - np.interp(begin, attitude.t, values) if angle == YAW else values)


def heights(results: Comparison) -> Figure:
    """Rms error of the pitch over the height of the centre of buoyancy: each trial, and the mean."""
    errors = np.degrees(results.over_heights("as is"))
    x = 1e3 * np.array(HEIGHTS)
    with styled():
        figure = Figure(figsize=(0.5 * PAGE_IN, 2.2))
        ax = figure.subplots()
        for k, each in zip(results.agreeing, errors, strict=True):
            ax.plot(x, each, color=_OTHER if k in results.fitted_on else _PALE, linewidth=0.6 * LINE)
        ax.plot(
            x,
            errors[len(results.fitted_on) :].mean(axis=0),
            color=_AS_IS,
            linewidth=1.6 * LINE,
            marker="o",
            markersize=3,
        )
        ax.axvline(1e3 * HEIGHT, color=GREY, linewidth=0.6 * LINE, linestyle=":")
        ax.axvline(1e3 * results.fitted.height, color=_FITTED, linewidth=0.6 * LINE, linestyle="--")
        ax.set_xlabel("height of the centre of buoyancy [mm]")
        ax.set_ylabel("rms error of the pitch [deg]")
        ax.set_ylim(0.0, 1.05 * float(errors.max()))
        handles = keys({"fitted on": _OTHER, "left": _PALE, "mean of those left": _AS_IS})
        ax.legend(handles=handles, fontsize=SMALL, frameon=False, loc="upper center")
    return figure


def fast_swing(results: Comparison) -> Figure:
    """The swing of axis d, the pitch of each model, and the differences to the model as it is."""
    found = results.swings()
    shades = dict(zip(VARIANTS, (_AS_IS, _FITTED, _OTHER), strict=True))
    motion, first = swing(), found[VARIANTS[0]]
    with styled():
        figure = Figure(figsize=(PAGE_IN, 3.6))
        grid = figure.subplots(3, 1, sharex=True, height_ratios=(1, 2, 2))
        grid[0].plot(first.t, np.degrees(motion.q(first.t)[:, 1]), color=GREY, linewidth=LINE)
        for name, shade in shades.items():
            pitch = np.degrees(found[name].angles[:, PITCH])
            grid[1].plot(first.t, pitch, color=shade, linewidth=LINE, label=name)
            grid[2].plot(first.t, pitch - np.degrees(first.angles[:, PITCH]), color=shade, linewidth=LINE)
        for ax, label in zip(grid, ("axis d [deg]", "pitch [deg]", "difference [deg]"), strict=True):
            ax.set_ylabel(label)
        grid[2].set_xlabel("t [s]")
        figure.legend(*grid[1].get_legend_handles_labels(), ncols=3, **ABOVE)
    return figure
