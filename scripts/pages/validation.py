"""docs/evidence/validation.md, from the records of the pool: the pitch of every trial, and the errors of the models."""

import functools
import itertools
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
from scipy.linalg import eigh
from scipy.signal import detrend, find_peaks

from page_look import written
from uvms_mj.engine.native.attachment import immerse
from uvms_mj.plant.arm import skew
from uvms_mj.reproduce.validate import page
from uvms_mj.reproduce.validate.data import records
from uvms_mj.reproduce.validate.page import CONSTANT, FITTED
from uvms_mj.reproduce.validate.page import numbers as found_in
from uvms_mj.reproduce.validate.results import FITTED_ON, PITCH, YAW, Comparison, compute
from uvms_mj.reproduce.validate.vehicle import AMPLITUDE, FASTEST, PERIOD, STATIC, Variant, model, righting, vehicle
from uvms_mj.studies.study import executor_of

PUSHED = {"003-1": (5.0, 13.0), "005-1": (2.0, 8.0)}
"""Trials in which something pushes the vehicle, and the time in which it then swings freely [s]."""


@functools.cache
def results(folder: str | Path) -> Comparison:
    with executor_of(None, None) as executor:
        return compute(*records(folder), executor, lambda done, total: None)


def period(variant: Variant, q: np.ndarray) -> float:
    """Period of the small swing in pitch about the balance of weight and buoyancy, with the joints held [s]."""
    data, given = mujoco.MjData(model()), vehicle(variant, q)
    data.qpos[:] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, *q
    with immerse(model(), data, given):
        mujoco.mj_forward(model(), data)
        M = np.zeros((model().nv, model().nv))
        mujoco.mj_fullM(model(), data, M)
    moment = righting(given, q)
    up = moment / np.linalg.norm(moment)
    stiffness = np.zeros((6, 6))
    stiffness[3:, 3:] = -skew(up) @ skew(moment)
    squares, shapes = eigh(stiffness, M[:6, :6])
    pitching = np.argmax(np.where(squares > 1e-6, np.abs(shapes[4]), 0.0))
    return float(2.0 * np.pi / np.sqrt(squares[pitching]))


def measured_period(found: Comparison, name: str) -> float:
    """Mean time between the peaks of the pitch of the inertial unit [s]."""
    (trial,) = (each for each in found.trials if each.name == name)
    begin, end = PUSHED[name]
    t = np.arange(begin, end, 0.02)
    pitch = detrend(np.interp(t, trial.imu.t, trial.imu.angles[:, PITCH]))
    times = [np.diff(t[find_peaks(sign * pitch, prominence=0.2 * np.ptp(pitch))[0]]) for sign in (1.0, -1.0)]
    return float(np.concatenate(times).mean())


def numbers(folder: str) -> Iterator[tuple]:
    found = results(folder)
    of = found_in(found)
    mean, median, over = of["mean_rms_pitch_deg"], of["median_rms_pitch_deg"], of["judged_on"]
    for row, name in {
        "as it is, nothing fitted": "as is",
        "links without added mass and drag": "no water on the links",
        "lumped added mass": "lumped",
        "naive: hydrostatics alone": STATIC,
        "as it is, height fitted": FITTED,
        "naive: hydrostatics alone, height fitted": f"{STATIC}, height fitted",
        "naive: the best constant pitch": CONSTANT,
    }.items():
        others = "the {} others" if "fitted on" in row else "{}"
        yield f"| {row} | {{}} | {{}} | {others} |", mean[name], median[name], over[name]
    yield "The two instruments differ by {} deg (mean rms;", of["mean_rms_instruments_deg"]
    yield "from {} to {} deg", min(of["instruments_differ_deg"]), max(of["instruments_differ_deg"])
    yield "changes the mean by {} deg", abs(mean["no water on the links"] - mean["as is"])
    yield "lumping the added mass by less than {} deg", (abs(mean["lumped"] - mean["as is"]), 1e-3)
    yield (
        "a standard deviation of {} deg, the measured one {} deg",
        of["spread_simulated_deg"],
        of["spread_measured_deg"],
    )
    yield "from {} to {} mm above", 1e3 * of["height_m"]["published"], 1e3 * of["height_m"]["fitted"]
    yield "hydrostatics alone to {} mm", 1e3 * of["height_m"]["fitted with hydrostatics alone"]
    yield "from {} to {} N m per unit", *of["righting_Nm"].values()
    choices = of["every_choice_deg"]
    number = len(list(itertools.combinations(found.agreeing, FITTED_ON)))
    yield (
        "Of all {} choices of three trials to fit on, the mean of the others is {} to {} deg, with a median of {} deg",
        *(
            number,
            choices["least"],
            choices["greatest"],
            choices["median"],
        ),
    )
    yield "has a mean rms error of {} deg", of["mean_rms_roll_deg"]
    turns = [
        np.degrees(np.abs(trial.mocap.angles[:, YAW] - trial.mocap.angles[0, YAW]).max()) for trial in found.trials
    ]
    yield "turn the vehicle by up to {} deg", max(turns)
    for name, q in ((name, next(k.q[0] for k in found.trials if k.name == name)) for name in PUSHED):
        values = measured_period(found, name), period(Variant(), q), period(found.fitted, q)
        yield f"| {name} | {{}} | {{}} | {{}} |", values[0], values[1], values[2]
    lags = of["lag_of_the_instruments_s"]
    yield "by {} to {} s, {} s on average", lags["least"], lags["greatest"], lags["mean"]
    lags = of["lag_s"]
    yield "The lags are {} to {} s, {} s on average", lags["least"], lags["greatest"], lags["mean"]
    yield "would be {} deg instead of {} deg", of["mean_rms_pitch_aligned_deg"], mean["as is"]
    yield "without the pushes, it is {} deg", of["mean_rms_pitch_in_motion_deg"]
    yield "against the inertial unit it is {} deg", of["mean_rms_pitch_imu_deg"]
    yield "axis d swings by {} deg with a period of {} s", np.degrees(AMPLITUDE), PERIOD
    yield "its limit of {} deg/s. The pitch then swings by {} deg", np.degrees(FASTEST), of["swing_span_deg"]
    dry, lumped = of["swing_pitch_deg"]["no water on the links"], of["swing_pitch_deg"]["lumped"]
    yield "it differs by up to {} deg, with lumped added mass by up to {} deg", dry, lumped
    apart = of["mean_rms_instruments_deg"]
    yield "{} and {} times\nthe difference of the instruments", (dry / apart, 0.06), (lumped / apart, 0.06)


def main(folder: str) -> None:
    written(page.pitches(results(folder)), "validation")
