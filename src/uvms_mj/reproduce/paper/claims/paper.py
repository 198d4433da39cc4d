"""The paper's claims in abstract, proposition 1, section 5 and conclusion, one row for each.

The thresholds are data. The text of the predicate and the verdict are both derived from them. Where the paper uses
words such as "almost", "similar" or "severe", this project chose the number and gives its reason.
"""

from ....analysis import metrics
from . import measures
from .base import AS_EXPECTED, AS_FOR_EXPECTED, Claim, Measured, Row, Runs
from .gsta import GSTA

WORLD_AND_OTHER_LAWS: tuple[Claim, ...] = (
    Claim(
        "expected-force",
        "The reference is 10 mm inside the wall; with K_x = 150 N/m this demands 1.5 N.",
        "eq. (12), sec. 5",
        "force at rest that eq. (12) demands [N]",
        measures.demanded,
        **AS_EXPECTED,
        because="0.5 %: the paper gives two digits and neglects the compliance of the wall",
        paper="1.5",
    ),
    Claim(
        "reference-smooth",
        "The filtered reference has a continuous acceleration.",
        "sec. 5",
        "largest change of the desired acceleration in 1 ms, over its largest value [%]",
        measures.reference_jump,
        at_most=5.0,
        because="a jump would be 100 %",
    ),
    Claim(
        "wall-spring",
        "The wall is a stiff linear spring along x and exerts no force in other directions.",
        "eq. (34)",
        "largest deviation from k_c (x - x_c), over the peak [%]",
        measures.spring,
        at_most=0.1,
        because="the width of a line in a figure; the inertia of the contact contributes 6e-5 of the peak",
    ),
    Claim(
        "impedance-short",
        "Impedance control alone stops a little short of the wall.",
        "fig. 1",
        "least distance to the wall [mm]",
        measures.gap,
        at_least=0.1,
        at_most=20.0,
        because='the gap exceeds the deflection of the wall under 10 N; "not quite" is taken as 2 % of the way',
    ),
    Claim(
        "impedance-no-contact",
        "Impedance control alone makes no contact.",
        "fig. 1",
        "number of touches",
        lambda runs: Measured(float(runs.traces["impedance"].touches[-1]), "counted at every step"),
        at_most=0.0,
        because='"not established"',
    ),
    Claim(
        "impedance-current",
        "The unknown current keeps impedance control from reaching the expected force.",
        "eq. (5), fig. 1",
        "force at rest, no current [N]",
        lambda runs: Measured(metrics.final_force(runs.sweep["impedance_still"])[0]),
        **AS_FOR_EXPECTED,
        paper="1.5",
    ),
    Claim(
        "impedance-left",
        "The current pushes away from the wall and to the left.",
        "sec. 5",
        "y at rest, impedance control [mm]",
        lambda runs: Measured(1e3 * float(runs.traces["impedance"].p_WB[-1, 1])),
        at_least=1.0,
        because="y points to the left; a smaller value could be lost in the resolution of a figure",
    ),
    Claim(
        "impedance-retuned",
        "A reference further inside the wall, here by 20 mm, or a greater stiffness would bring impedance control into "
        "contact.",
        "sec. 5.2",
        "force at rest, smaller of the two runs [N]",
        measures.retuned,
        at_least=0.1,
        because="a deflection of the wall of more than one micrometre",
    ),
    Claim(
        "impedance-tuning",
        "With that tuning impedance control still depends on the disturbance and the wall: it does not reach the "
        "demanded force.",
        "sec. 5.2",
        "shortfall of the force at rest from that of eq. (12), smaller of the two runs [%]",
        measures.still_missing,
        at_least=5.0,
        because='ten times the tolerance for "expected"',
    ),
    Claim(
        "fosm-force",
        "First-order sliding mode reaches almost 1.5 N.",
        "fig. 5",
        "force at rest [N]",
        measures.force("fosm"),
        at_least=1.455,
        at_most=1.496,
        because='"almost": below it by at most 3 %, and by more than the 2 mN due to the compliance of the wall',
        paper="almost 1.5",
    ),
    Claim(
        "fosm-not-exact",
        "The first-order law does not quite achieve the desired impedance.",
        "eq. (12), fig. 6",
        "impedance error at rest, rms [N]",
        measures.impedance_error("fosm"),
        at_least=1e-3,
        because="the resolution of a force sensor",
    ),
    Claim(
        "fosm-boundary-layer",
        "The boundary layer keeps the first-order law from reaching the expected force.",
        "eqs. (31), (32), sec. 6",
        "part of the force shortfall that the static balance inside the layer does not explain [%]",
        measures.unexplained,
        at_most=1.0,
        because='"as expected": a hundredth of the shortfall',
    ),
    Claim(
        "fosm-inside",
        "The first-order law's sliding variable is inside the boundary layer at all times.",
        "eq. (32), fig. 6",
        "fraction of the time, at every step",
        measures.inside,
        at_least=1.0 - 1e-9,
        because="every step, up to rounding in sums over 2e5 steps",
    ),
    Claim(
        "fosm-well-inside",
        "The first-order law's sliding variable is well inside the boundary layer, not just at its edge.",
        "fig. 6",
        "largest |s_i| / epsilon",
        measures.well_inside,
        at_most=0.5,
        because="sat(s/epsilon) uses at most half of K_s: the reserve is at least as large as the part in use",
    ),
    Claim(
        "fosm-quiet",
        "The first-order law does not chatter after its initial transient.",
        "fig. 7",
        "chattering index after 0.1 s, over that before 0.1 s",
        measures.quiet,
        at_most=0.01,
        because="two orders of magnitude less than in the transient",
    ),
    Claim(
        "fosm-transient",
        "The first-order law switches rapidly in the first fraction of a second.",
        "fig. 7",
        "reversals of thrust above 0.1 N",
        measures.reversals("fosm"),
        at_least=20.0,
        because="in 0.1 s: hundreds of hertz, more than a thruster can follow",
    ),
    Claim(
        "fosm-epsilon",
        "A smaller boundary layer causes severe chattering (here half the width).",
        "eq. (31), sec. 5.2",
        "mean change of thrust per control period, sum of its three components [N]",
        measures.severe("fosm_half_epsilon"),
        at_least=10.0,
        because="more at every step than the largest thrust that the task needs at rest, 7 N",
    ),
    Claim(
        "fosm-gain",
        "A greater gain K_s causes severe chattering (here twice the gain).",
        "eq. (31), sec. 5.2",
        "mean change of thrust per control period, sum of its three components [N]",
        measures.severe("fosm_double_K_s"),
        at_least=10.0,
        because="more at every step than the largest thrust that the task needs at rest, 7 N",
    ),
)

CLAIMS: tuple[Claim, ...] = (*WORLD_AND_OTHER_LAWS, *GSTA)


def judge(runs: Runs) -> list[Row]:
    """Measure and judge every claim."""
    return [Row.of(claim, runs) for claim in CLAIMS]
