"""The page: what was measured, what was simulated, what was fitted, and what would tell the models apart."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...studies.pages import Picture, Table, rendered
from . import figures
from .results import AGREE, BEFORE, FITTED_ON, PITCH, ROLL, YAW, Comparison
from .swing import AMPLITUDE, FASTEST, PERIOD
from .vehicle import FOAM, HEIGHT, MASS, STATIC, VARIANTS, WEIGHTS, Variant, righting, vehicle

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
            "trials": Picture("trials", _TRIALS, figures.trials(results)),
            "heights": Picture("heights", _HEIGHTS, figures.heights(results)),
            "swing": Picture("swing", _SWING, figures.fast_swing(results)),
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
