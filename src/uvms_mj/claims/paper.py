"""What the paper's section 5 and conclusion say of its runs, each sentence as a row.

A claim's thresholds are data, from which both its predicate's text and its verdict are made. A comment says why a
threshold is where it is.
"""

from .. import metrics
from . import measures
from .base import Claim, Measured, Row, Runs
from .gsta import GSTA

# What the paper says. Where it says "almost", "similar", "severe", the number is this project's.

WORLD_AND_OTHER_LAWS: tuple[Claim, ...] = (
    Claim(
        "expected-force",
        "The reference lies 10 mm inside the wall, which with K_x = 150 N/m asks for 1.5 N.",
        "eq. (12), sec. 5",
        "force at rest that eq. (12) demands",
        "N",
        measures.demanded,
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
        measures.reference_jump,
        at_most=5.0,  # a jump would be 100
    ),
    Claim(
        "wall-spring",
        "The wall is a stiff linear spring along x, and pushes in no other direction.",
        "eq. (34)",
        "largest deviation from k_c (x - x_c), over the peak",
        "%",
        measures.spring,
        at_most=0.1,
    ),
    Claim(
        "impedance-short",
        "Impedance control alone stops a little short of the wall.",
        "fig. 1",
        "least distance to the wall",
        "mm",
        measures.gap,
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
        "A reference further inside, here 20 mm, or a greater stiffness would bring impedance control into contact.",
        "sec. 5.2",
        "least force at rest of the two",
        "N",
        measures.retuned,
        at_least=0.1,
    ),
    Claim(
        "impedance-tuning",
        "So tuned, impedance control still depends on disturbance and wall: it does not reach the force it asks for.",
        "sec. 5.2",
        "force at rest missing to that of eq. (12), least of the two",
        "%",
        measures.still_missing,
        at_least=5.0,  # ten times what "expected" allows
    ),
    Claim(
        "fosm-force",
        "First-order sliding mode reaches almost 1.5 N.",
        "fig. 5",
        "force at rest",
        "N",
        measures.force("fosm"),
        at_least=1.455,  # "almost": short of it by no more than 3 %
        at_most=1.496,  # and by more than the wall's give, which is 2 mN
        paper="almost 1.5",
    ),
    Claim(
        "fosm-not-exact",
        "The first-order law does not quite achieve the desired impedance.",
        "eq. (12), fig. 6",
        "impedance error at rest, rms",
        "N",
        measures.impedance_error("fosm"),
        at_least=1e-3,  # what a force sensor still resolves
    ),
    Claim(
        "fosm-boundary-layer",
        "It is the boundary layer that keeps the first-order law from the expected force.",
        "eqs. (31), (32), sec. 6",
        "part of the missing force that the static balance inside the layer does not explain",
        "%",
        measures.unexplained,
        at_most=1.0,
    ),
    Claim(
        "fosm-inside",
        "The first-order law's sliding variable is inside the boundary layer at all times.",
        "eq. (32), fig. 6",
        "part of the time, of every step",
        "1",
        measures.inside,
        at_least=1.0 - 1e-9,  # every step; sums of 2e5 steps round
    ),
    Claim(
        "fosm-well-inside",
        "Its sliding variable is well inside, not just at the edge.",
        "fig. 6",
        "largest |s_i| / epsilon",
        "1",
        measures.well_inside,
        at_most=0.5,  # sat(s/epsilon) then uses at most half of K_s: the law keeps as much in reserve as it uses
    ),
    Claim(
        "fosm-quiet",
        "The first-order law does not chatter after its initial transient.",
        "fig. 7",
        "chattering index after 0.1 s over that before",
        "1",
        measures.quiet,
        at_most=0.01,
    ),
    Claim(
        "fosm-transient",
        "The first-order law switches rapidly in the first fraction of a second.",
        "fig. 7",
        "reversals of thrust above 0.1 N",
        "1",
        measures.reversals("fosm"),
        at_least=20.0,  # in 0.1 s: hundreds of hertz, which no thruster follows
    ),
    Claim(
        "fosm-epsilon",
        "A smaller boundary layer brings severe chattering (here half of it).",
        "eq. (31), sec. 5.2",
        "mean change of thrust in a control period, sum of its three components",
        "N",
        measures.severe("fosm_half_epsilon"),
        at_least=10.0,  # at every step more than the largest thrust that the task needs at rest, 7 N
    ),
    Claim(
        "fosm-gain",
        "A greater gain K_s brings severe chattering (here twice the gain).",
        "eq. (31), sec. 5.2",
        "mean change of thrust in a control period, sum of its three components",
        "N",
        measures.severe("fosm_double_K_s"),
        at_least=10.0,
    ),
)

CLAIMS: tuple[Claim, ...] = (*WORLD_AND_OTHER_LAWS, *GSTA)


def judge(runs: Runs) -> list[Row]:
    """Every claim measured and judged."""
    return [Row.of(claim, runs) for claim in CLAIMS]
