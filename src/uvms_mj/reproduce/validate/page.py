"""The page and its figures: what was measured, what was simulated, what was fitted, and what would tell the models
apart."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ...studies.pages import Picture, Table, rendered
from ...views.figures.style import ABOVE, BLACK, GREY, LINE, PAGE_IN, SMALL, Figure, keys, line, panels, styled
from .data import Attitude
from .results import AGREE, BEFORE, FITTED_ON, HEIGHTS, PITCH, ROLL, YAW, Comparison
from .vehicle import (
    AMPLITUDE,
    FASTEST,
    FOAM,
    HEIGHT,
    MASS,
    PERIOD,
    STATIC,
    VARIANTS,
    WEIGHTS,
    Variant,
    righting,
    swing,
    vehicle,
)

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


FITTED = "as is, height fitted"
CONSTANT = "the best constant pitch"
"""A naive model: no pitch that stays the same has a smaller error."""

_TRIALS = (
    "Every trial: measured by two instruments, and simulated. The dotted line is where the arm begins to move. Yaw has "
    "no restoring moment; it counts from the beginning."
)
_HEIGHTS = "Rms error of the pitch over the height of the centre of buoyancy. Dotted: published; dashed: fitted."
_SWING = "Axis d swings about the stretched arm, at most 30 deg/s: the pitch by each model, and its difference."


def numbers(results: Comparison) -> dict[str, Any]:
    """What was found, in degrees and metres, as plain numbers."""
    agreeing, models = results.agreeing, _models(results)
    in_motion = [results.pitch(k, Variant(), 0.0, results.trials[k].starts - BEFORE).rms for k in agreeing]
    lags = [results.lag(k, Variant()) for k in agreeing]
    aligned = [results.pitch(k, Variant(), late).rms for k, late in zip(agreeing, lags, strict=True)]
    spread = np.degrees([results.spread(k, Variant()) for k in agreeing]).mean(axis=0)
    clocks, instruments = np.array([results.instruments(k) for k in range(len(results.trials))]).T
    judged = {name: errors for name, (errors, _) in models.items()}
    reference = results.swings()[VARIANTS[0]].angles[:, PITCH]
    return {
        "trials": [trial.name for trial in results.trials],
        "instruments_differ_deg": np.degrees(instruments).tolist(),
        "disagreeing": _disagreeing(results),
        "agree_within_deg": _deg(AGREE),
        "rms_pitch_deg": _each(results, "rms"),
        "peak_pitch_deg": _each(results, "peak"),
        "judged_on": {name: len(errors) for name, errors in judged.items()},
        "mean_rms_pitch_deg": {name: _deg(errors.mean()) for name, errors in judged.items()},
        "median_rms_pitch_deg": {name: _deg(np.median(errors)) for name, errors in judged.items()},
        "mean_rms_pitch_of_all_deg": _deg(results.errors(Variant(), range(len(results.trials))).mean()),
        "mean_rms_pitch_aligned_deg": _deg(np.mean(aligned)),
        "mean_rms_pitch_in_motion_deg": _deg(np.mean(in_motion)),
        "mean_rms_pitch_imu_deg": _deg(np.mean([results.angle(k, Variant(), PITCH, "imu").rms for k in agreeing])),
        "mean_rms_roll_deg": _deg(np.mean([results.angle(k, Variant(), ROLL, "mocap").rms for k in agreeing])),
        "lag_s": {"least": min(lags), "mean": float(np.mean(lags)), "greatest": max(lags)},
        "lag_of_the_instruments_s": {
            name: float(of(clocks[agreeing]))
            for name, of in (("least", np.min), ("mean", np.mean), ("greatest", np.max))
        },
        "mean_rms_instruments_deg": _deg(instruments[agreeing].mean()),
        "spread_measured_deg": float(spread[0]),
        "spread_simulated_deg": float(spread[1]),
        "fitted_on": [results.trials[k].name for k in results.fitted_on],
        "height_m": {
            "published": HEIGHT,
            "fitted": results.fitted.height,
            "fitted with hydrostatics alone": results.fitted_static.height,
        },
        "every_choice_deg": {
            name: _deg(np.quantile(results.choices, part))
            for name, part in (("least", 0.0), ("median", 0.5), ("greatest", 1.0))
        },
        "righting_Nm": {
            name: float(np.linalg.norm(righting(vehicle(variant, q := results.trials[0].q[0]), q)))
            for name, variant in (("published", Variant()), ("fitted", results.fitted))
        },
        "swing_pitch_deg": {
            name: _deg(np.abs(found.angles[:, PITCH] - reference).max()) for name, found in results.swings().items()
        },
        "swing_span_deg": _deg(np.ptp(reference)),
    }


def page(results: Comparison, versions: Mapping[str, str]) -> str:
    """The page as HTML."""
    return rendered(
        Path(__file__).with_name("pool.html"),
        title="Against a pool: a vehicle whose arm moves",
        found=numbers(results),
        fitted_on=FITTED_ON,
        fitted=FITTED,
        summary=summary(results),
        swing={"period": PERIOD, "amplitude": np.degrees(AMPLITUDE), "speed": np.degrees(FASTEST)},
        trim=(MASS, len(WEIGHTS), len(FOAM)),
        pitch=pitch(results),
        others=others(results),
        rest=rest(results),
        pictures={
            "trials": Picture("trials", _TRIALS, trials(results)),
            "heights": Picture("heights", _HEIGHTS, heights(results)),
            "swing": Picture("swing", _SWING, fast_swing(results)),
        },
        versions=sorted(versions.items()),
    )


def pitch(results: Comparison) -> Table:
    """Rms and peak error of the pitch of each trial [deg], by model."""
    models = [variant for _, variant in _models(results).values() if variant]
    names = [name for name, (_, variant) in _models(results).items() if variant]
    heads = ["the two instruments: rms", *(f"{name}, {what}" for name in names for what in ("rms", "peak"))]
    rows = []
    for k, trial in _moving(results):
        errors = [results.pitch(k, model) for model in models]
        cells = [_text(value) for each in errors for value in (each.rms, each.peak)]
        mark = " *" if k in results.fitted_on else "" if k in results.agreeing else " (instruments disagree)"
        rows.append((f"{trial.name}{mark}", [_text(results.instruments(k)[1]), *cells]))
    return Table("trial", heads, rows)


def summary(results: Comparison) -> Table:
    """Mean and median over the trials of the rms error of the pitch [deg], by model, the naive ones among them."""
    rows = [
        (name, [_text(errors.mean()), _text(np.median(errors)), f"{len(errors)} trials"])
        for name, (errors, _) in _models(results).items()
    ]
    return Table("model", ["mean", "median", "over"], rows)


def _models(results: Comparison) -> dict[str, tuple[np.ndarray, Variant | None]]:
    """The models by name: the rms errors of the pitch of the trials that each is judged on [rad], and its variant. A
    fitted one is judged on the trials that are left, and naive ones stand beside each of ours."""
    models = {name: (results.errors(Variant(name)), Variant(name)) for name in (*VARIANTS, STATIC)}
    fitted = {FITTED: results.fitted, f"{STATIC}, height fitted": results.fitted_static}
    models |= {name: (results.errors(variant, results.left), variant) for name, variant in fitted.items()}
    return {**models, CONSTANT: (np.array([results.constant(k) for k in results.agreeing]), None)}


def _disagreeing(results: Comparison) -> list[str]:
    return [trial.name for k, trial in _moving(results) if k not in results.agreeing]


def others(results: Comparison) -> Table:
    """Clocks, instruments and the other angles of each trial, of the model as it is."""
    heads = [
        "lag of the arm's clock [s]",
        "pitch rms, aligned",
        f"pitch rms from {BEFORE:g} s before the motion",
        "pitch rms against the inertial unit",
        "the two instruments: rms",
        "roll rms",
        "yaw rms",
    ]
    rows = []
    for k, trial in _moving(results):
        late = results.lag(k, Variant())
        values = (
            results.pitch(k, Variant(), late).rms,
            results.pitch(k, Variant(), 0.0, trial.starts - BEFORE).rms,
            results.angle(k, Variant(), PITCH, "imu").rms,
            results.instruments(k)[1],
            results.angle(k, Variant(), ROLL, "mocap").rms,
            results.angle(k, Variant(), YAW, "mocap").rms,
        )
        rows.append((trial.name, [f"{late:+.2f}".replace("-", "−"), *map(_text, values)]))
    return Table("trial", heads, rows)


def rest(results: Comparison) -> Table:
    """Roll and pitch of the records at rest: measured by both instruments, and predicted."""
    heads = ["motion capture: mean", "least", "greatest", "inertial unit: mean", "as it is", "height fitted"]
    rows = []
    for record in results.resting:
        for which, name in ((ROLL, "roll"), (PITCH, "pitch")):
            seen, other = record.mocap.angles[:, which], record.imu.angles[:, which]
            found = [results.at_rest(record, variant)[which] for variant in (Variant(), results.fitted)]
            values = (seen.mean(), seen.min(), seen.max(), other.mean(), *found)
            rows.append((f"{record.name}, {name}", [_text(value) for value in values]))
    return Table("record at rest", heads, rows)


def _each(results: Comparison, what: str) -> dict[str, list[float]]:
    """rms or peak of the error of the pitch of each trial [deg], by model."""
    return {
        name: [_deg(getattr(results.pitch(k, variant), what)) for k, _ in _moving(results)]
        for name, (_, variant) in _models(results).items()
        if variant
    }


def _moving(results: Comparison) -> Any:
    return list(enumerate(results.trials))


def _deg(value: Any) -> float:
    return float(np.degrees(value))


def _text(radians: float) -> str:
    return f"{np.degrees(radians):.2f}".replace("-", "−")
