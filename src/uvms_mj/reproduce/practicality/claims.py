"""The claims of the page, each with its measured value and its threshold."""

from collections.abc import Sequence

import numpy as np

from ...studies.pages import number
from ..paper.claims.base import Claim, Measured, Row
from .axes import AXES, MAPS, RETUNED, STEPS
from .plans import DEMANDED
from .results import Results

_AXES = {axis.name: axis for axis in AXES}


def _ideal(results: Results, law: str) -> tuple[float, float]:
    """Mean push and range of the push with everything ideal [N]."""
    row = results.along(_AXES["force_delay"], law).iloc[0]
    return float(row["contact.final_N"]), float(row["force_error_N"])


def impedance(results: Results) -> Measured:
    force, _ = _ideal(results, "impedance")
    return Measured(force, f"{number(DEMANDED)} N demanded")


def error_of(law: str):
    """Relative force error of a law with everything ideal [%]."""

    def measure(results: Results) -> Measured:
        force, error = _ideal(results, law)
        return Measured(100.0 * abs(error) / (force - error), f"presses with {number(force)} N")

    return measure


def over_prediction(name: str, law: str):
    """Value of an axis up to which a law works, over the one at which the contact force becomes too old."""

    def measure(results: Results) -> Measured:
        axis, found = _AXES[name], results.boundaries[name, law]
        expected = results.predicted(axis, law)
        if found.between is None or expected is None:
            return Measured(None, "no boundary")
        detail = f"works to {found.last:g} s, not at {found.first:g} s; too old from {expected:.3g} s on"
        return Measured(found.between / expected, detail)

    return measure


def ages_over_stiffness(results: Results) -> Measured:
    """Median over the stiffnesses of the delay up to which GSTA works, over the limit of the force's age."""
    name, x, y = MAPS[1]
    frame = results.frames[name].assign(works=results.works(name))
    limits = {stiffness: delay for delay, stiffness in results.limits(name, "gsta")}
    ratios = []
    for stiffness, limit in limits.items():
        rows = frame[(frame["law"] == "gsta") & (frame[y.key] == stiffness)].sort_values(x.key)
        works = rows["works"].to_numpy()
        if works[0] and not works.all():
            first = int(np.argmin(works))
            ratios.append(float(np.sqrt(np.prod(rows[x.key].to_numpy(float)[first - 1 : first + 1]))) / limit)
    detail = f"{len(ratios)} stiffnesses, from {number(min(ratios))} to {number(max(ratios))}" if ratios else ""
    return Measured(float(np.median(ratios)) if ratios else None, detail)


def one_over_other(one: tuple[str, str], other: tuple[str, str], detail: str):
    """Value of an axis up to which a law works, over that of another axis or law, each given by its axis and law. The
    detail has a place for each of the two values."""

    def measure(results: Results) -> Measured:
        ours, theirs = results.boundaries[one].last, results.boundaries[other].last
        if ours is None or not theirs:
            return Measured(None, "no boundary")
        return Measured(ours / theirs, detail.format(ours, theirs))

    return measure


def at_real(name: str, law: str):
    """Force error of a law at the real value of an axis [% of the demanded push]."""

    def measure(results: Results) -> Measured:
        axis = _AXES[name]
        rows = results.along(axis, law)
        row = rows.iloc[int(np.argmin(np.abs(rows[axis.key].to_numpy(float) - axis.real)))]
        error, spread = float(row["force_error_N"]), float(row["force_range_N"])
        detail = f"at {axis.text(row[axis.key])}: {error:+.2g} N, varies by {spread:.2g} N"
        return Measured(100.0 * abs(error) / DEMANDED, detail)

    return measure


def noise(results: Results) -> Measured:
    """Noise of the force sensor up to which GSTA works [N]."""
    found = results.boundaries["force_noise", "gsta"]
    return Measured(found.last, found.why)


def steps_with(law: str, bumper: bool):
    """Number of steps from ideal to a pool after which a law works."""

    def measure(results: Results) -> Measured:
        survived = results.steps_survived(law, bumper)
        stop = f"stops at: {STEPS[survived][0]}" if survived < len(STEPS) else "works after all steps"
        return Measured(float(survived - 1), stop)

    return measure


def bumper_at_100_hz(results: Results) -> Measured:
    """Force error of GSTA with the retuned gains and the bumper at 100 Hz [N]."""
    row = results.step(RETUNED, True, 1)
    return Measured(abs(float(row["force_error_N"])), f"varies by {float(row['force_range_N']):.2g} N")


_PERIODS = "GSTA to {:g} s, the first-order law to {:g} s"
_FACTORS = "to {:g} times the model's, retuned to {:g} times"


def harmless(name: str, text: str, where: str, because: str) -> Claim:
    """GSTA presses with the demanded force within 1 % at the real value of the axis of this name."""
    return Claim(name, text, where, "force error [%]", at_real(name, "gsta"), at_most=1.0, because=because)


CLAIMS: Sequence[Claim] = (
    Claim(
        "impedance",
        "Impedance control alone does not press with the demanded force in a current that it does not know.",
        "everything ideal",
        "push [N]",
        impedance,
        at_most=0.9 * DEMANDED,
        because="a tenth of the demanded push is the limit of the page",
    ),
    Claim(
        "gsta_ideal",
        "GSTA presses with the demanded force.",
        "everything ideal",
        "force error [%]",
        error_of("gsta"),
        at_most=1.0,
        because="s is zero at rest",
    ),
    Claim(
        "fosm_ideal",
        "First-order sliding mode presses with a force that is wrong by a few per cent.",
        "everything ideal",
        "force error [%]",
        error_of("fosm"),
        at_least=1.0,
        at_most=10.0,
        because="s is not zero inside the boundary layer",
    ),
    Claim(
        "control_period",
        "GSTA works down to the control rate at which the contact force is too old.",
        "control period",
        "boundary over prediction",
        over_prediction("control_period", "gsta"),
        at_least=0.5,
        at_most=1.5,
        because="the prediction is D_d/(K_f k_c) for the mean age of the force; the axis has steps of 1.4",
    ),
    Claim(
        "force_delay",
        "GSTA works up to the delay of the force sensor at which the contact force is too old.",
        "delay of the force sensor",
        "boundary over prediction",
        over_prediction("force_delay", "gsta"),
        at_least=0.5,
        at_most=1.5,
        because="as above",
    ),
    Claim(
        "stiffness",
        "What decides is the age of the force times the stiffness of the wall.",
        "map over delay and stiffness",
        "boundary over prediction",
        ages_over_stiffness,
        at_least=0.5,
        at_most=1.5,
        because="the limit of the age is D_d/(K_f k_c) for all stiffnesses",
    ),
    Claim(
        "lag",
        "A lag of the thrusters matters less than an old force.",
        "time constant of the thrusters",
        "lag over delay",
        one_over_other(("thruster_lag", "gsta"), ("force_delay", "gsta"), "lag to {:g} s, delay to {:g} s"),
        at_least=10.0,
        because="a lag of the thrusters leaves the force as old as the motion that the law compares it with",
    ),
    Claim(
        "rate",
        "GSTA needs a lower control rate than first-order sliding mode.",
        "control period",
        "period over period",
        one_over_other(("control_period", "gsta"), ("control_period", "fosm"), _PERIODS),
        at_least=3.0,
        because="the first-order law has the gain K_s/epsilon inside its boundary layer",
    ),
    Claim(
        "noise",
        "GSTA works with the noise of a force sensor.",
        "noise of the force sensor",
        "noise [N]",
        noise,
        at_least=0.5,
        because="the real value of the axis",
    ),
    harmless(
        "voltage",
        "GSTA does not need to know the voltage of the battery.",
        "voltage",
        "a wrong thrust is a disturbance of bounded rate",
    ),
    harmless(
        "dead_band",
        "A dead band of the thrusters does not matter while the current loads them.",
        "dead band",
        "the thrusters hold the vehicle against the current and stay outside the dead band",
    ),
    harmless(
        "friction",
        "Friction does not change the push of a vehicle that does not slide.",
        "friction of the wall",
        "the force of friction is along the wall",
    ),
    harmless(
        "added_mass",
        "GSTA does not need to know the added mass.",
        "true added mass over the model's",
        "a wrong inertia is a disturbance of bounded rate",
    ),
    Claim(
        "retuned_model",
        "The gains for a low control rate pay with robustness: they bear less error of the added mass.",
        "true added mass over the model's",
        "factor over factor",
        one_over_other(("added_mass", "gsta"), ("added_mass", RETUNED), _FACTORS),
        at_least=1.5,
        because="their integral term, k_2, is a tenth of the paper's",
    ),
    Claim(
        "rigid",
        "On a wall of 1e5 N/m a control rate of 100 Hz alone stops GSTA.",
        "steps from ideal to a pool",
        "steps",
        steps_with("gsta", False),
        at_most=0.0,
        because="the force is older than D_d/(K_f k_c)",
    ),
    Claim(
        "bumper",
        "With a bumper of 2e3 N/m retuned GSTA holds the demanded force at 100 Hz.",
        "steps from ideal to a pool",
        "force error [N]",
        bumper_at_100_hz,
        at_most=0.01,
        because="the force is then younger than D_d/(K_f k_c)",
    ),
    Claim(
        "pool",
        "With the bumper it also works with a real force sensor at 100 Hz.",
        "steps from ideal to a pool",
        "steps",
        steps_with(RETUNED, True),
        at_least=2.0,
        because="the second step is the force sensor",
    ),
)
"""All claims in the order of the page."""


def judge(results: Results) -> list[Row]:
    """The claims with their measured values and verdicts."""
    return [Row.of(claim, results) for claim in CLAIMS]
