"""The claims of the page, whose rows are in claims.toml: each has a measure here, a function of the results."""

from pathlib import Path

import numpy as np

from ...studies.pages import number
from ..claims import Measured, claims_in
from .plans import AXES, DEMANDED, MAPS, STEPS
from .results import Results


def _ideal(results: Results, law: str) -> tuple[float, float]:
    """Mean push and range of the push with everything ideal [N]."""
    row = results.along(AXES["force_delay"], law).iloc[0]
    return float(row["contact.final_N"]), float(row["force_error_N"])


def push(results: Results, law: str) -> Measured:
    """Mean push with everything ideal [N]."""
    return Measured(_ideal(results, law)[0], f"{number(DEMANDED)} N demanded")


def error(results: Results, law: str) -> Measured:
    """Relative force error of a law with everything ideal [%]."""
    force, off = _ideal(results, law)
    return Measured(100.0 * abs(off) / (force - off), f"presses with {number(force)} N")


def over_prediction(results: Results, name: str) -> Measured:
    """Value of an axis up to which GSTA works, over the one at which the contact force becomes too old."""
    axis, found = AXES[name], results.boundaries[name, "gsta"]
    expected = results.predicted(axis, "gsta")
    if found.between is None or expected is None:
        return Measured(None, "no boundary")
    detail = f"works to {found.last:g} s, not at {found.first:g} s; too old from {expected:.3g} s on"
    return Measured(found.between / expected, detail)


def ages_over_stiffness(results: Results) -> Measured:
    """Median over the stiffnesses of the delay up to which GSTA works, over the limit of the force's age."""
    name = "force_delay_and_stiffness"
    x, y = MAPS[name]
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


def one_over_other(results: Results, one: str, law: str, other: str, other_law: str, detail: str) -> Measured:
    """Value of the axis ``one`` up to which a law works, over that of another axis or law. The detail has a place for
    each of the two values."""
    ours, theirs = results.boundaries[one, law].last, results.boundaries[other, other_law].last
    if ours is None or not theirs:
        return Measured(None, "no boundary")
    return Measured(ours / theirs, detail.format(ours, theirs))


def error_at_real(results: Results, name: str, law: str) -> Measured:
    """Force error of a law at the real value of an axis [% of the demanded push]."""
    axis = AXES[name]
    rows = results.along(axis, law)
    row = rows.iloc[int(np.argmin(np.abs(rows[axis.key].to_numpy(float) - axis.real)))]
    off, spread = float(row["force_error_N"]), float(row["force_range_N"])
    detail = f"at {axis.text(row[axis.key])}: {off:+.2g} N, varies by {spread:.2g} N"
    return Measured(100.0 * abs(off) / DEMANDED, detail)


def last_value(results: Results, name: str, law: str) -> Measured:
    """The value of an axis up to which a law works."""
    found = results.boundaries[name, law]
    return Measured(found.last, found.why)


def steps_with(results: Results, law: str, bumper: bool) -> Measured:
    """Number of steps from ideal to a pool after which a law works."""
    survived = results.steps_survived(law, bumper)
    stop = f"stops at: {STEPS[survived][0]}" if survived < len(STEPS) else "works after all steps"
    return Measured(float(survived - 1), stop)


def error_after_step(results: Results, law: str, bumper: bool, step: int) -> Measured:
    """Force error of a law after a step [N]."""
    row = results.step(law, bumper, step)
    return Measured(abs(float(row["force_error_N"])), f"varies by {float(row['force_range_N']):.2g} N")


CLAIMS = claims_in(Path(__file__).with_name("claims.toml"), globals())
"""All claims in the order of the page."""
