"""What the paper's section 5 and conclusion say of its runs, each sentence as a row: measured, and judged.

A claim's thresholds are data, from which both its predicate's text and its verdict are made. A comment says why a
threshold is where it is.
"""

import enum
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from . import metrics
from .trace import Trace

TRANSIENT_S = 0.1
"""The "first fraction of a second": with the paper's gains the first-order law switches for its first 15 ms."""
REST_S = 1.0
"""How much of a run's end is taken as rest."""
REVERSAL_N = 0.1
"""A change of thrust larger than this shows in a figure: the ordinates of figs. 7 and 11 span tens of newtons."""


@dataclass(frozen=True, eq=False)
class Runs:
    """The runs of the study, by name.

    Attributes:
        traces: impedance, fosm, gsta, gsta_alone.
        fine: the beginning of the same runs at every step.
        sweep: variations, as :func:`uvms_mj.study.plan` names them.
    """

    traces: Mapping[str, Trace]
    fine: Mapping[str, Trace]
    sweep: Mapping[str, Trace]


@dataclass(frozen=True)
class Measured:
    """A number, or None where there is nothing to measure, and what it was made of.

    Attributes:
        value: the number.
        detail: what it was made of, in words.
        explained: whether the reason for a known departure was itself found in the runs.
    """

    value: float | None
    detail: str = ""
    explained: bool = False


class Verdict(enum.Enum):
    """What became of a claim."""

    holds = "the runs bear it out"
    departs = "the runs do not bear it out, for a reason that is stated and was measured"
    fails = "the runs do not bear it out"


@dataclass(frozen=True)
class Claim:
    """A sentence that can be checked.

    Attributes:
        id: short name.
        text: the sentence, in this project's words.
        where: equation, figure or section of the paper.
        quantity: what is measured.
        unit: its unit.
        measure: measures it.
        at_least, at_most: the predicate; at least one of them.
        paper: the paper's value, where it gives one.
        departure: why it is known not to hold in these runs, where the measurement finds the reason; empty for most.
    """

    id: str
    text: str
    where: str
    quantity: str
    unit: str
    measure: Callable[[Runs], Measured] = field(repr=False)
    at_least: float | None = None
    at_most: float | None = None
    paper: str = ""
    departure: str = ""

    def __post_init__(self) -> None:
        if self.at_least is None and self.at_most is None:
            raise ValueError(f"claim {self.id} has no threshold")

    @property
    def predicate(self) -> str:
        """The threshold in words."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.at_least is None:
            return f"at most {self.at_most:g}{unit}"
        if self.at_most is None:
            return f"at least {self.at_least:g}{unit}"
        return f"{self.at_least:g} to {self.at_most:g}{unit}"

    def holds(self, value: float | None) -> bool:
        """Whether the predicate is true of a value; of None or NaN it is not."""
        if value is None:
            return False
        low, high = (-np.inf if self.at_least is None else self.at_least), self.at_most
        return bool(low <= value <= (np.inf if high is None else high))


@dataclass(frozen=True)
class Row:
    """A claim with what was measured."""

    claim: Claim
    measured: Measured
    verdict: Verdict

    def as_dict(self) -> dict[str, Any]:
        """For JSON and CSV; a number that JSON does not have is None."""
        value = self.measured.value
        claim = self.claim
        return {
            "id": claim.id,
            "claim": claim.text,
            "where": claim.where,
            "quantity": claim.quantity,
            "unit": claim.unit,
            "paper": claim.paper or None,
            "ours": value if value is not None and np.isfinite(value) else None,
            "detail": self.measured.detail,
            "predicate": claim.predicate,
            "verdict": self.verdict.name,
            "reason": claim.departure if self.verdict is Verdict.departs else "",
        }


def number(value: float | None) -> str:
    """A number as a reader wants it: four digits, a true minus, powers of ten, a dash for none."""
    if value is None:
        return "–"
    if value == round(value) and abs(value) < 1e4:
        return f"{value:.0f}".replace("-", "−")
    mantissa, e, exponent = f"{value:.4g}".partition("e")
    raised = str(int(exponent)).translate(_RAISED) if e else ""
    return (f"{mantissa}·10{raised}" if e else mantissa).replace("-", "−")


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def judge(runs: Runs, claims: "Sequence[Claim] | None" = None) -> list[Row]:
    """Every claim measured and judged."""
    return [_row(claim, claim.measure(runs)) for claim in (CLAIMS if claims is None else claims)]


def _row(claim: Claim, measured: Measured) -> Row:
    if claim.holds(measured.value):
        return Row(claim, measured, Verdict.holds)
    return Row(claim, measured, Verdict.departs if claim.departure and measured.explained else Verdict.fails)


# What is measured


def _over(a: float, b: float) -> float | None:
    """One number over another, if it is there."""
    return float(a / b) if b else None


def gain(trace: Trace, name: str) -> float:
    """A gain of the law that was run."""
    return float(getattr(trace.scenario.controller, name))


def _force(run: str) -> Callable[[Runs], Measured]:
    """The mean pushing force over the last 0.5 s, of every step."""

    def measure(runs: Runs) -> Measured:
        trace = runs.traces[run]
        force, settled = metrics.final_force(trace)
        demanded = metrics.demanded_force(trace)
        return Measured(force, f"{'settled' if settled else 'not settled'}; eq. (12) demands {demanded:.4f} N")

    return measure


def _at_rest(trace: Trace) -> float:
    """Error of the desired impedance at rest: norm of the force part of eq. (12)'s residual [N]."""
    return float(np.linalg.norm(metrics.impedance_error(trace, trace.t[-1] - REST_S)[:3]))


def _impedance_error(run: str) -> Callable[[Runs], Measured]:
    return lambda runs: Measured(_at_rest(runs.traces[run]))


def _thrust(values: np.ndarray) -> float:
    """Sum over the three components of the force."""
    return float(values[:3].sum())


def _ratio(measure: Callable[[Trace], float], of: str, to: str, unit: str) -> Callable[[Runs], Measured]:
    """The same quantity of two runs, one over the other."""

    def ratio(runs: Runs) -> Measured:
        a, b = measure(runs.traces[of]), measure(runs.traces[to])
        return Measured(_over(a, b), f"{LABELS[of]} {number(a)}, {LABELS[to]} {number(b)} {unit}")

    return ratio


LABELS = {"impedance": "impedance", "fosm": "first-order", "gsta": "GSTA", "gsta_alone": "GSTA alone"}


def _demanded(runs: Runs) -> Measured:
    trace = runs.traces["gsta"]
    x_d, wall = trace.scenario.reference.steps[-1].position[0], trace.scenario.wall
    rigid = trace.scenario.impedance.K_d[0] * (x_d - wall.position)
    return Measured(metrics.demanded_force(trace), f"{number(rigid)} N if the wall did not give")


def _reference_jump(runs: Runs) -> Measured:
    """Largest change of the desired acceleration from row to row, to its largest value."""
    trace = runs.traces["gsta"]
    acceleration = np.diff(trace.p_d_dot[:, 0]) / np.diff(trace.t)
    jump = np.abs(np.diff(acceleration, prepend=0.0)).max() if len(acceleration) else 0.0
    return Measured(_over(100.0 * jump, np.abs(acceleration).max() if len(acceleration) else 0.0), "in rows of the log")


def _spring(runs: Runs) -> Measured:
    """Deviation of the wall's force from eq. (34), to its peak."""
    trace = runs.traces["gsta"]
    wall = trace.scenario.wall
    spring = np.zeros_like(trace.f_contact_W)
    spring[:, 0] = -wall.stiffness * np.maximum(0.0, trace.p_WB[:, 0] - wall.position)
    return Measured(
        _over(100.0 * np.abs(trace.f_contact_W - spring).max(), float(trace.force_peak[-1])), "at every row"
    )


def _gap(runs: Runs) -> Measured:
    trace = runs.traces["impedance"]
    x = trace.p_WB[:, 0]
    return Measured(
        1e3 * (trace.scenario.wall.position - float(x.max())),
        f"x ends at {x[-1]:.4f} m, yaw at {_yaw(trace):.2f} deg",
    )


def _yaw(trace: Trace) -> float:
    w, x, y, z = trace.quat_WB[-1]
    return float(np.degrees(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))))


def _retuned(runs: Runs) -> Measured:
    forces = {
        name: metrics.final_force(runs.sweep[name])[0] or 0.0 for name in ("impedance_nearer", "impedance_stiffer")
    }
    nearer, stiffer = forces.values()
    return Measured(min(nearer, stiffer), f"{nearer:.3f} N with the wall 20 mm nearer, {stiffer:.3f} N with 10 K_x")


def _inside(runs: Runs) -> Measured:
    share = metrics.boundary_layer_share(runs.traces["fosm"], TRANSIENT_S)
    whole = metrics.boundary_layer_share(runs.traces["fosm"])
    return Measured(float(share.min()), f"least of six axes; {number(float(whole.min()))} with the transient")


def _well_inside(runs: Runs) -> Measured:
    trace = runs.traces["fosm"]
    share = np.abs(trace.s[trace.t >= TRANSIENT_S]).max(axis=0) / gain(trace, "epsilon")
    return Measured(float(share.max()), f"in surge {share[0]:.2g}, in sway {share[1]:.2g}, in yaw {share[5]:.2g}")


def _quiet(runs: Runs) -> Measured:
    trace = runs.traces["fosm"]
    before, after = (_thrust(metrics.chattering(trace, *part)) for part in ((0.0, TRANSIENT_S), (TRANSIENT_S, np.inf)))
    return Measured(_over(after, before), f"{number(before)} N/s until {TRANSIENT_S:g} s, {number(after)} N/s later")


def _reversals(run: str) -> Callable[[Runs], Measured]:
    def measure(runs: Runs) -> Measured:
        count = metrics.reversals(runs.fine[run], REVERSAL_N, 0.0, TRANSIENT_S)
        return Measured(float(count[:3].sum()), f"surge {count[0]}, sway {count[1]}, heave {count[2]}")

    return measure


def _severe(variation: str) -> Callable[[Runs], Measured]:
    def measure(runs: Runs) -> Measured:
        as_printed, varied = (
            _thrust(metrics.mean_change(trace, 0.5, 1.0)) for trace in (runs.traces["fosm"], runs.sweep[variation])
        )
        return Measured(varied, f"between 0.5 and 1 s; {number(as_printed)} N with the paper's gains")

    return measure


def _ripple(runs: Runs) -> Measured:
    """Mean step-to-step change at rest, of the axis where it is largest, to the rms of the thrust."""
    trace = runs.traces["gsta"]
    change = metrics.mean_change(trace, trace.t[-1] - REST_S)[:3]
    rms = np.sqrt(_thrust(metrics.control_effort(trace)) / trace.t[-1])
    return Measured(_over(100.0 * change.max(), rms), f"{change.max():.3g} N of {rms:.3g} N")


def _whole_variation(runs: Runs) -> Measured:
    """Explained where the variation at rest is that of the sampled algorithm's own cycle, within 5 %.

    At rest s alternates between +-sigma, with 2 sigma = h k_1 sqrt(sigma) - h^2 k_2/4 from eqs. (24) and (27), and tau
    changes by M_hat 4 sigma/h from step to step.
    """
    measured = _ratio(lambda trace: _thrust(metrics.total_variation(trace)), "gsta", "fosm", "N")(runs)
    trace = runs.traces["gsta"]
    k_1, k_2 = gain(trace, "k_1"), gain(trace, "k_2")
    if k_1**2 < 2.0 * k_2:
        return measured
    cycle = 0.25 * (k_1 + np.sqrt(k_1**2 - 2.0 * k_2)) ** 2 * _thrust(np.diag(metrics.design_of(trace).M_hat))
    start = max(0.0, trace.t[-1] - REST_S)
    rest = _thrust(metrics.total_variation(trace, start)) / (trace.t[-1] - start) if len(trace) > 1 else 0.0
    detail = f"{measured.detail}; at rest {rest:.1f} N/s, by the cycle of sgn(s) {cycle:.1f} N/s"
    return Measured(measured.value, detail, explained=abs(rest - cycle) < 0.05 * cycle)


def _continuity(runs: Runs) -> Measured:
    coarse, fine = (
        metrics.largest_change(trace, TRANSIENT_S)[:3]
        for trace in (runs.traces["gsta"], runs.sweep["gsta_quarter_step"])
    )
    worst = int(np.argmax(coarse))
    return Measured(_over(fine[worst], coarse[worst]), f"{coarse[worst]:.3g} N, then {fine[worst]:.3g} N")


def _actuation(runs: Runs) -> Measured:
    """Rms of the difference of two runs' thrust, at the rows that both have."""
    a, b = runs.traces["gsta"].tau[:, :3], runs.traces["gsta_alone"].tau[:, :3]
    n = min(len(a), len(b))
    difference, rms = (float(np.sqrt((x**2).sum(axis=1).mean())) for x in (a[:n] - b[:n], a[:n]))
    return Measured(_over(100.0 * difference, rms), f"rms {difference:.3g} N of {rms:.3g} N")


def _integral(runs: Runs) -> Measured:
    a, b = (float(np.abs(runs.traces[name].z[:, :3]).max()) for name in ("gsta", "gsta_alone"))
    return Measured(_over(b, a), f"largest |z| {b:.3g} m/s² alone, {a:.3g} m/s² with the nominal control")


def _apparent_stiffness(runs: Runs) -> Measured:
    trace = runs.traces["gsta"]
    force, _ = metrics.final_force(trace)
    into = trace.scenario.reference.steps[-1].position[0] - float(trace.p_WB[-1, 0])
    return Measured(
        _over(force or 0.0, into * trace.scenario.impedance.K_d[0]),
        "force over distance to the reference, over K_x",
    )


def _passive(runs: Runs) -> Measured:
    trace = runs.traces["gsta"]
    stored = float(trace.force_peak[-1]) ** 2 / (2.0 * trace.scenario.wall.stiffness)
    least = metrics.least_wall_work(trace)
    return Measured(_over(least, stored), f"least {number(least)} J, stored at the peak {number(stored)} J")


# What the paper says. Where it says "almost", "similar", "severe", the number is this project's.

CLAIMS: tuple[Claim, ...] = (
    Claim(
        "expected-force",
        "The reference lies 10 mm inside the wall, which with K_x = 150 N/m asks for 1.5 N.",
        "eq. (12), sec. 5",
        "force at rest that eq. (12) demands",
        "N",
        _demanded,
        at_least=1.4925,  # 0.5 %: the paper gives two digits, and neglects the wall's compliance
        at_most=1.5075,
        paper="1.5",
    ),
    Claim(
        "reference-smooth",
        "The filtered reference has a continuous acceleration.",
        "sec. 5",
        "largest change of the desired acceleration in 1 ms, over its largest value",
        "%",
        _reference_jump,
        at_most=5.0,  # a jump would be 100
    ),
    Claim(
        "wall-spring",
        "The wall is a stiff linear spring along x, and pushes in no other direction.",
        "eq. (34)",
        "largest deviation from k_c (x - x_c), over the peak",
        "%",
        _spring,
        at_most=0.1,
    ),
    Claim(
        "impedance-short",
        "Impedance control alone stops a little short of the wall.",
        "fig. 1",
        "least distance to the wall",
        "mm",
        _gap,
        at_least=0.1,  # not in contact, by more than the wall gives under 10 N
        at_most=20.0,  # "not quite": 2 % of the way
    ),
    Claim(
        "impedance-no-contact",
        "Impedance control alone makes no contact.",
        "fig. 1",
        "number of touches",
        "1",
        lambda runs: Measured(float(runs.traces["impedance"].touches[-1]), "of every step"),
        at_most=0.0,
    ),
    Claim(
        "impedance-current",
        "It is the unknown current that keeps impedance control from the expected force.",
        "eq. (5), fig. 1",
        "force at rest, no current",
        "N",
        lambda runs: Measured(metrics.final_force(runs.sweep["impedance_still"])[0]),
        at_least=1.4925,  # as expected-force
        at_most=1.5075,
        paper="1.5",
    ),
    Claim(
        "impedance-left",
        "The current pushes away from the wall and to the left.",
        "sec. 5",
        "y at rest, impedance control",
        "mm",
        lambda runs: Measured(1e3 * float(runs.traces["impedance"].p_WB[-1, 1])),
        at_least=1.0,  # y is to the left; less could be rounding of a figure
    ),
    Claim(
        "impedance-retuned",
        "A reference further inside, or a greater stiffness, would bring impedance control into contact.",
        "sec. 5.2",
        "least force at rest of the two",
        "N",
        _retuned,
        at_least=0.1,
    ),
    Claim(
        "fosm-force",
        "First-order sliding mode reaches almost 1.5 N.",
        "fig. 5",
        "force at rest",
        "N",
        _force("fosm"),
        at_least=1.455,  # "almost": short of it by no more than 3 %
        at_most=1.496,  # and by more than the wall's give, which is 2 mN
        paper="almost 1.5",
    ),
    Claim(
        "fosm-not-exact",
        "The first-order law does not quite achieve the desired impedance, because of its boundary layer.",
        "eq. (12), fig. 6",
        "impedance error at rest, rms",
        "N",
        _impedance_error("fosm"),
        at_least=1e-3,  # a thousand times what GSTA leaves, and what a force sensor still resolves
    ),
    Claim(
        "fosm-inside",
        "The first-order law's sliding variable is inside the boundary layer at all times.",
        "eq. (32), fig. 6",
        "part of the time after 0.1 s",
        "1",
        _inside,
        at_least=1.0 - 1e-9,  # every step; sums of 2e5 steps round
    ),
    Claim(
        "fosm-well-inside",
        "Its sliding variable is well inside, not just at the edge.",
        "fig. 6",
        "largest |s_i| / epsilon after 0.1 s",
        "1",
        _well_inside,
        at_most=0.5,
    ),
    Claim(
        "fosm-quiet",
        "The first-order law does not chatter after its initial transient.",
        "fig. 7",
        "chattering index after 0.1 s over that before",
        "1",
        _quiet,
        at_most=0.01,
    ),
    Claim(
        "fosm-transient",
        "The first-order law switches rapidly in the first fraction of a second.",
        "fig. 7",
        "reversals of thrust above 0.1 N",
        "1",
        _reversals("fosm"),
        at_least=20.0,  # in 0.1 s: hundreds of hertz, which no thruster follows
    ),
    Claim(
        "fosm-epsilon",
        "A smaller boundary layer brings severe chattering (here half of it).",
        "eq. (31), sec. 5.2",
        "mean step-to-step change of thrust",
        "N",
        _severe("fosm_half_epsilon"),
        at_least=10.0,  # at every step more than the largest thrust that the task needs at rest, 7 N
    ),
    Claim(
        "fosm-gain",
        "A greater gain K_s brings severe chattering (here twice the gain).",
        "eq. (31), sec. 5.2",
        "mean step-to-step change of thrust",
        "N",
        _severe("fosm_double_K_s"),
        at_least=10.0,
    ),
    Claim(
        "gsta-force",
        "With GSTA the contact force settles at the expected value.",
        "fig. 9",
        "force at rest",
        "N",
        _force("gsta"),
        at_least=1.4925,  # as expected-force; the first-order law is outside
        at_most=1.5075,
        paper="1.5",
    ),
    Claim(
        "gsta-impedance",
        "GSTA achieves the desired impedance in spite of the current.",
        "eq. (12), fig. 9",
        "impedance error at rest, rms",
        "N",
        _impedance_error("gsta"),
        at_most=1e-3,
    ),
    Claim(
        "gsta-robust",
        "GSTA is much more robust than the first-order law.",
        "figs. 5, 9",
        "impedance error at rest, over the first-order law's",
        "1",
        _ratio(_at_rest, "gsta", "fosm", "N"),
        at_most=0.1,  # "much": by an order of magnitude
    ),
    Claim(
        "gsta-sliding",
        "The difference shows in the sliding variable.",
        "figs. 6, 10",
        "largest |s_i| at rest, over the first-order law's",
        "1",
        _ratio(
            lambda trace: float(np.abs(trace.s[trace.t >= trace.t[-1] - REST_S]).max()), "gsta", "fosm", "m/s, rad/s"
        ),
        at_most=0.1,
    ),
    Claim(
        "gsta-more-effort",
        "GSTA uses more control effort than impedance control.",
        "figs. 3, 11",
        "integral of the squared thrust, over impedance control's",
        "1",
        lambda runs: _effort(runs, "impedance"),
        at_least=1.01,  # a difference that shows
    ),
    Claim(
        "gsta-similar-effort",
        "GSTA uses a control effort similar to the first-order law's.",
        "figs. 7, 11",
        "integral of the squared thrust, over the first-order law's",
        "1",
        lambda runs: _effort(runs, "fosm"),
        at_least=0.95,
        at_most=1.05,
    ),
    Claim(
        "gsta-little-chattering",
        "With GSTA there is not much chattering.",
        "fig. 11",
        "mean step-to-step change at rest, over the rms of the thrust",
        "%",
        _ripple,
        at_most=1.0,  # narrower than a line in a figure
    ),
    Claim(
        "gsta-smaller-steps",
        "GSTA chatters less than the first-order law, by the largest step-to-step change.",
        "figs. 7, 11, sec. 6",
        "largest step-to-step change of thrust, over the first-order law's",
        "1",
        _ratio(lambda trace: float(metrics.largest_change(trace)[:3].max()), "gsta", "fosm", "N"),
        at_most=0.5,  # "significantly": less than half
    ),
    Claim(
        "gsta-start-variation",
        "GSTA chatters less in the initial transient, by total variation.",
        "figs. 7, 11, insets",
        "total variation of thrust until 0.1 s, over the first-order law's",
        "1",
        _ratio(lambda trace: _thrust(metrics.total_variation(trace, 0.0, TRANSIENT_S)), "gsta", "fosm", "N"),
        at_most=0.5,
    ),
    Claim(
        "gsta-start-smooth",
        "GSTA does not switch in the initial transient.",
        "fig. 11, inset",
        "reversals of thrust above 0.1 N",
        "1",
        _reversals("gsta"),
        at_most=0.0,
    ),
    Claim(
        "gsta-whole-variation",
        "GSTA chatters less than the first-order law over the whole run, by total variation.",
        "figs. 7, 11, sec. 6",
        "total variation of thrust, over the first-order law's",
        "1",
        _whole_variation,
        at_most=1.0,
        departure=(
            "Sampled, GSTA never comes to rest: sgn(s) changes with every step, and the thrust alternates by "
            "M (k_1 + sqrt(k_1^2 - 2 k_2))^2 / 4 times the time step, some hundredths of a newton. That is invisible "
            "in a figure, but it adds up, at the same rate whatever the step. The first-order law, once inside its "
            "boundary layer, is a smooth feedback and has no such ripple. The paper's sentence holds for the size of "
            "the steps and for the transient, not for their sum over the run."
        ),
    ),
    Claim(
        "gsta-continuous",
        "GSTA's control input is continuous.",
        "eq. (24), sec. 6",
        "largest step-to-step change until 0.1 s with a quarter of the time step, over that with the whole",
        "1",
        _continuity,
        at_most=0.6,  # eq. (24a) is of order sqrt(h) where s leaves zero: 0.5; a discontinuous input has 1
    ),
    Claim(
        "gsta-stiffness",
        "GSTA stays compliant to the contact force: it pushes as the desired spring does.",
        "eq. (12), sec. 6",
        "apparent stiffness at rest, over K_x",
        "1",
        _apparent_stiffness,
        at_least=0.995,  # as expected-force
        at_most=1.005,
    ),
    Claim(
        "gsta-passive",
        "Interaction is stable: the vehicle never draws energy from the wall.",
        "sec. 6",
        "least work done on the wall, over the most that it stored",
        "1",
        _passive,
        at_least=-1e-3,  # the trapezoid's error at a touch that begins and ends between two steps
    ),
    Claim(
        "alone-force",
        "Without the nominal control GSTA still reaches the expected force.",
        "sec. 5.2",
        "force at rest",
        "N",
        _force("gsta_alone"),
        at_least=1.4925,
        at_most=1.5075,
    ),
    Claim(
        "alone-impedance",
        "Without the nominal control GSTA still achieves the desired impedance.",
        "eq. (12), sec. 5.2",
        "impedance error at rest, rms",
        "N",
        _impedance_error("gsta_alone"),
        at_most=1e-3,
    ),
    Claim(
        "alone-actuation",
        "The thrust is nearly the same with and without the nominal control.",
        "fig. 11",
        "rms of the difference, over the rms of the thrust",
        "%",
        _actuation,
        at_most=2.0,  # two lines that cover each other in a figure
    ),
    Claim(
        "alone-integral",
        "Without the nominal control the integral term grows larger.",
        "fig. 12",
        "largest |z_i| of the force part, over that with the nominal control",
        "1",
        _integral,
        at_least=1.5,  # a difference that shows
    ),
)


def _effort(runs: Runs, other: str) -> Measured:
    """Of the thrust, with each axis in the detail."""
    a, b = (metrics.control_effort(runs.traces[name])[:3] for name in ("gsta", other))
    axes = ", ".join(
        f"{axis} {number(x)} and {number(y)}" for axis, x, y in zip(("surge", "sway"), a[:2], b[:2], strict=True)
    )
    return Measured(_over(_thrust(a), _thrust(b)), f"{axes} N² s")
