"""What the paper says of its own law, each sentence as a row; thresholds as in :mod:`uvms_mj.claims.paper`."""

import numpy as np

from .. import metrics
from . import measures, robustness
from .base import Claim

GSTA: tuple[Claim, ...] = (
    Claim(
        "gsta-force",
        "With GSTA the contact force settles at the expected value.",
        "fig. 9",
        "force at rest",
        "N",
        measures.force("gsta"),
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
        measures.impedance_error("gsta"),
        at_most=1e-3,
    ),
    Claim(
        "gsta-moments",
        "GSTA achieves the desired impedance in the moments as well, with and without the nominal control.",
        "eq. (12)",
        "impedance error at rest, moments, rms",
        "N m",
        robustness.impedance_error_of_moments,
        at_most=1e-4,  # the 1e-3 N of the forces at an arm of 0.1 m
    ),
    Claim(
        "gsta-model-errors",
        "GSTA achieves the desired impedance despite model errors.",
        "abstract, eq. (11)",
        "impedance error at rest, rms, the larger of two runs with wrong estimates",
        "N",
        robustness.model_errors,
        at_most=1e-3,  # as without model errors
    ),
    Claim(
        "gsta-model-errors-force",
        "Despite model errors the contact force of GSTA settles at the expected value.",
        "abstract, eq. (11)",
        "force at rest, the less exact of two runs with wrong estimates",
        "N",
        robustness.force_with_model_errors,
        at_least=1.4925,  # as expected-force
        at_most=1.5075,
        paper="1.5",
    ),
    Claim(
        "gsta-half-inertia",
        "GSTA achieves the desired impedance despite model errors of any size (here M_hat is half of M).",
        "abstract, eq. (11)",
        "impedance error at rest, rms",
        "N",
        robustness.half_inertia,
        at_most=1e-3,
        explanation=(
            "Proposition 1 needs a perturbation with a bounded derivative. An error of the inertia puts a part of the "
            "acceleration into it, eq. (11), which at the wall changes as fast as the contact force. With half of the "
            "inertia the vehicle goes on bouncing; with 20 % too little or 50 % too much it comes to rest. The paper "
            "does not say how large an error may be."
        ),
    ),
    Claim(
        "gsta-finite-time",
        "GSTA brings the sliding variable to zero in finite time.",
        "proposition 1",
        "time of s to a band 16 times narrower, with a quarter of the time step, over that with the whole",
        "1",
        robustness.finite_time,
        at_most=1.1,  # an exponential approach from 0.04 m/s takes ln(16)/ln(4e4), a quarter, longer
    ),
    Claim(
        "gsta-robust",
        "GSTA is much more robust than the first-order law.",
        "figs. 5, 9",
        "impedance error at rest, over the first-order law's",
        "1",
        measures.ratio(measures.at_rest, measures.norm, "gsta", "fosm", "N"),
        at_most=0.1,  # "much": by an order of magnitude
    ),
    Claim(
        "gsta-sliding",
        "The difference shows in the sliding variable.",
        "figs. 6, 10",
        "largest |s_i| at rest, over the first-order law's",
        "1",
        measures.largest_s,
        at_most=0.1,
    ),
    Claim(
        "gsta-more-effort",
        "GSTA uses more control effort than impedance control.",
        "figs. 3, 11",
        "integral of the squared thrust, over impedance control's",
        "1",
        lambda runs: measures.effort(runs, "impedance"),
        at_least=1.01,  # a difference that shows
    ),
    Claim(
        "gsta-similar-effort",
        "GSTA uses a control effort similar to the first-order law's.",
        "figs. 7, 11",
        "integral of the squared thrust, over the first-order law's",
        "1",
        lambda runs: measures.effort(runs, "fosm"),
        at_least=0.95,
        at_most=1.05,
    ),
    Claim(
        "gsta-little-chattering",
        "With GSTA there is not much chattering.",
        "fig. 11",
        "mean change of thrust in a control period at rest, over the rms of the thrust",
        "%",
        measures.ripple,
        at_most=1.0,  # narrower than a line in a figure
    ),
    Claim(
        "gsta-smaller-steps",
        "GSTA chatters less than the first-order law, by the largest step-to-step change.",
        "figs. 7, 11, sec. 6",
        "largest step-to-step change of thrust, over the first-order law's",
        "1",
        measures.ratio(metrics.largest_change, np.max, "gsta", "fosm", "N"),
        at_most=0.5,  # "significantly": less than half
    ),
    Claim(
        "gsta-start-variation",
        "GSTA chatters less in the initial transient, by total variation.",
        "figs. 7, 11, insets",
        "total variation of thrust until 0.1 s, over the first-order law's",
        "1",
        measures.ratio(
            lambda trace: metrics.total_variation(trace, 0.0, measures.TRANSIENT_S),
            np.sum,
            "gsta",
            "fosm",
            "N",
        ),
        at_most=0.5,
    ),
    Claim(
        "gsta-start-smooth",
        "GSTA does not switch in the initial transient.",
        "fig. 11, inset",
        "reversals of thrust above 0.1 N",
        "1",
        measures.reversals("gsta"),
        at_most=0.0,
    ),
    Claim(
        "gsta-whole-variation",
        "GSTA chatters less than the first-order law over the whole run, by total variation.",
        "figs. 7, 11, sec. 6",
        "total variation of thrust, over the first-order law's",
        "1",
        measures.whole_variation,
        at_most=1.0,
        explanation=(
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
        "largest step-to-step change of thrust with a quarter of the time step, over that with the whole",
        "1",
        measures.continuity,
        at_most=0.6,  # eq. (24a) is of order sqrt(h) where s leaves zero: 0.5; a discontinuous input has 1
    ),
    Claim(
        "gsta-compliant",
        "GSTA remains compliant to the contact force: also while it rebounds it gives way as desired.",
        "eq. (12), sec. 6",
        "impedance error along x from the first contact on, over the contact force, both rms",
        "%",
        measures.compliance,
        at_most=5.0,  # a vehicle that does not give way leaves all of the contact force over: 100
    ),
    Claim(
        "gsta-stable",
        "With GSTA the contact force comes to rest.",
        "fig. 9",
        "range of the force in the last 0.5 s, over its mean",
        "%",
        measures.unrest,
        at_most=1.0,  # narrower than a line in a figure
    ),
    Claim(
        "alone-force",
        "Without the nominal control GSTA still reaches the expected force.",
        "sec. 5.2",
        "force at rest",
        "N",
        measures.force("gsta_alone"),
        at_least=1.4925,
        at_most=1.5075,
    ),
    Claim(
        "alone-impedance",
        "Without the nominal control GSTA still achieves the desired impedance.",
        "eq. (12), sec. 5.2",
        "impedance error at rest, rms",
        "N",
        measures.impedance_error("gsta_alone"),
        at_most=1e-3,
    ),
    Claim(
        "alone-actuation",
        "The thrust is nearly the same with and without the nominal control.",
        "fig. 11",
        "rms of the difference, over the rms of the thrust",
        "%",
        measures.actuation,
        at_most=2.0,  # two lines that cover each other in a figure
    ),
    Claim(
        "alone-integral",
        "Without the nominal control the integral term grows larger.",
        "fig. 12",
        "largest |z_i| of the force part, over that with the nominal control",
        "1",
        measures.integral,
        at_least=1.5,  # a difference that shows
    ),
)
