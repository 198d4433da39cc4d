"""The page and its figures: what was measured, what was simulated, what was fitted, and what would tell the models
apart."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes

from ...studies.pages import (
    Group,
    Items,
    Page,
    Picture,
    Section,
    Table,
    Text,
    given,
    marked,
    number,
    rendered,
    versions_of,
)
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
    """The results in degrees and metres, as plain numbers."""
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
    found, resting = numbers(results), rest(results)
    fitted = [Text(text) for text in _fitted(found)]
    lead = [
        Text(_LEAD, "lead"),
        Text(
            f"{len(found['trials'])} trials of Kolano and Davidson (2023, UVMS-SysID-with-EAs, MIT). Angles in "
            "degrees. The motion capture measured the pitch.",
            "soft",
        ),
    ]
    sections = [
        Section("found", "Found", [Items(_found(found))]),
        Section(
            "pitch",
            "Pitch",
            [
                Text(_ERRORS),
                summary(results).shown("Error of the pitch over the trials, by model"),
                pitch(results).shown("Error of the pitch of each trial"),
            ],
        ),
        Section(
            "fit",
            "Fitted, and not",
            [Group([Group(fitted), Picture("heights", _HEIGHTS, heights(results))], "pictures")],
        ),
        Section(
            "apart",
            "What would tell the models apart",
            [Text(_apart(found)), Picture("swing", _SWING, fast_swing(results))],
        ),
        Section("trials-all", "All trials", [Picture("trials", _TRIALS, trials(results))], "start"),
        Section(
            "others",
            "Clocks and instruments",
            given(
                Text(f"{_CLOCKS[0]} (mean {number(found['mean_rms_pitch_in_motion_deg'], 2)}). {_CLOCKS[1]}"),
                others(results).shown("Clocks and instruments"),
                Text(_AT_REST) if resting.rows else None,
                resting.shown("Attitude at rest") if resting.rows else None,
                versions_of(versions),
            ),
        ),
    ]
    return rendered(Page("Against a pool: a vehicle whose arm moves", lead, sections))


_LEAD = (
    "A BlueROV2 with a Reach Alpha arm floats freely in a pool, its thrusters off, and the arm moves. Here it is "
    "simulated, with the arm driven along the measured joint angles."
)
_ERRORS = (
    "Error of the simulated pitch, over the whole record and with the clocks as recorded; nothing is taken off. A "
    "star: fitted on. “lumped”: one diagonal added mass of the vehicle, with the arm in its first posture; the "
    "links keep their drag."
)
_CLOCKS = (
    "The model as it is. Motion capture jumps where it takes one marker for another. In some trials something pushes "
    "the vehicle before its arm moves; the third column leaves that out",
    "A negative lag: the vehicle answers earlier than in the simulation.",
)
_AT_REST = "At rest there is nothing to simulate: the prediction is the attitude in which weight and buoyancy balance."


def _found(found: Mapping[str, Any]) -> list[Markup]:
    """The findings of the comparison, a sentence or two each."""
    mean = {name: number(value, 2) for name, value in found["mean_rms_pitch_deg"].items()}
    finer = {name: number(value, 3) for name, value in found["mean_rms_pitch_deg"].items()}
    apart = (
        marked(
            "They differ by more than {} in <b>{}</b>, where the motion capture has lost the vehicle. These trials are "
            "in no mean and no fit; with them the mean would be {} with nothing fitted.",
            number(found["agree_within_deg"], 2),
            ", ".join(found["disagreeing"]),
            number(found["mean_rms_pitch_of_all_deg"], 3),
        )
        if found["disagreeing"]
        else marked("They agree within {} in every trial.", number(found["agree_within_deg"], 2))
    )
    return [
        marked(
            "Nothing fitted: mean rms error of the pitch <b>{}</b>, median {}, offsets included. Published simulation: "
            "about 2.",
            mean["as is"],
            number(found["median_rms_pitch_deg"]["as is"], 2),
        ),
        marked(
            "Only the height of the centre of buoyancy fitted, on {}: mean of the other trials <b>{}</b>.",
            ", ".join(found["fitted_on"]),
            mean[FITTED],
        ),
        marked(
            "Hydrostatics alone, the attitude in which weight and buoyancy balance in each posture, has a mean of {}, "
            "and {} with its height fitted. The best constant pitch has {}.",
            mean["hydrostatics alone"],
            mean["hydrostatics alone, height fitted"],
            mean["the best constant pitch"],
        ),
        marked(
            "The two instruments differ from each other by {} (mean rms). {}",
            number(found["mean_rms_instruments_deg"], 2),
            apart,
        ),
        marked(
            "The motions are slow. Without the links’ added mass and drag the mean is {}, with lumped added mass {}, "
            "as it is {}. These data test weight, buoyancy and kinematics. They do not test added mass and drag: "
            "hydrostatics alone is as good.",
            finer["no water on the links"],
            finer["lumped"],
            finer["as is"],
        ),
    ]


def _fitted(found: Mapping[str, Any]) -> list[Markup]:
    """The fitted numbers, by us and by the authors, and the others."""
    height, choice = found["height_m"], found["every_choice_deg"]
    return [
        marked(
            "<b>By us, on these data:</b> the height of the centre of buoyancy above the centre of gravity, for the "
            "last columns only. It is {} mm as published and {} mm with the least mean rms error of {}, the first {} "
            "trials by name. The righting moment of vehicle, trim and arm grows from {} to {} N m per unit of "
            "sin(heel). With any other {} trials the mean of the remaining ones is {} to {}, median {}. As published "
            "the simulated pitch has a standard deviation of {}, the measured one {}: a vehicle that is too soft.",
            number(1e3 * height["published"], 3),
            number(1e3 * height["fitted"], 3),
            ", ".join(found["fitted_on"]),
            FITTED_ON,
            *(number(found["righting_Nm"][name], 3) for name in ("published", "fitted")),
            FITTED_ON,
            *(number(choice[name], 2) for name in ("least", "greatest", "median")),
            number(found["spread_simulated_deg"], 3),
            number(found["spread_measured_deg"], 3),
        ),
        marked(
            "<b>By the authors, on the attitude at rest:</b> the places of {} trim weights and {} blocks of foam, and "
            "the centre of buoyancy’s place along x. The arm’s masses, volumes, drag and joints, the vehicle’s {} kg "
            "and its displacement are measured or published, drag, inertia and added mass are of other BlueROV2s.",
            len(WEIGHTS),
            len(FOAM),
            str(MASS),
        ),
        marked(
            "<b>Not fitted:</b> the time between the clocks. The lag with the greatest correlation of simulated and "
            "measured pitch is shown below; it would change the mean from {} to {}.",
            number(found["mean_rms_pitch_deg"]["as is"], 2),
            number(found["mean_rms_pitch_aligned_deg"], 2),
        ),
    ]


def _apart(found: Mapping[str, Any]) -> Markup:
    """The motion in which the models differ most, and by how much."""
    differ = {name: number(value, 2) for name, value in found["swing_pitch_deg"].items()}
    return marked(
        "The models differ most in pitch when the arm swings near the period in which the model swings freely. The arm "
        "is stretched forwards, and axis d swings by {} deg with a period of {} s, which reaches its limit of {} "
        "deg/s. The pitch swings by {} from peak to peak. Without the links’ added mass and drag it differs by up to "
        "<b>{}</b>, with lumped added mass by up to <b>{}</b>; the instruments agree within {}. No trial has such a "
        "motion.",
        number(np.degrees(AMPLITUDE), 3),
        str(PERIOD),
        number(np.degrees(FASTEST)),
        number(found["swing_span_deg"], 2),
        differ["no water on the links"],
        differ["lumped"],
        number(found["mean_rms_instruments_deg"], 2),
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
