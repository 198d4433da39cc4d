"""The paper's claims about GSTA, one row for each. :mod:`.paper` describes the thresholds."""

import numpy as np

from ....analysis import metrics
from . import measures, robustness
from .base import AS_EXPECTED, AS_FOR_EXPECTED, Claim

GSTA: tuple[Claim, ...] = (
    Claim(
        "gsta-force",
        "With GSTA the contact force settles at the expected value.",
        "fig. 9",
        "force at rest [N]",
        measures.force("gsta"),
        **AS_EXPECTED,
        because="0.5 %, as for the expected force; the first-order law is outside this range",
        paper="1.5",
    ),
    Claim(
        "gsta-impedance",
        "GSTA achieves the desired impedance in spite of the current.",
        "eq. (12), fig. 9",
        "impedance error at rest, rms [N]",
        measures.impedance_error("gsta"),
        at_most=1e-3,
        because="the resolution of a force sensor; the first-order law is above it",
    ),
    Claim(
        "gsta-moments",
        "GSTA achieves the desired impedance in the moments as well, with and without the nominal control.",
        "eq. (12)",
        "impedance error at rest, moments, rms [N m]",
        robustness.impedance_error_of_moments,
        at_most=1e-4,
        because="the limit for forces, 1e-3 N, at an arm of 0.1 m",
    ),
    Claim(
        "gsta-model-errors",
        "GSTA achieves the desired impedance despite model errors.",
        "abstract, eq. (11)",
        "impedance error at rest, rms, larger of two runs with wrong estimates [N]",
        robustness.model_errors,
        at_most=1e-3,
        because="same as without model errors",
    ),
    Claim(
        "gsta-model-errors-force",
        "With GSTA the contact force settles at the expected value despite model errors.",
        "abstract, eq. (11)",
        "force at rest, worse of two runs with wrong estimates [N]",
        robustness.force_with_model_errors,
        **AS_FOR_EXPECTED,
        paper="1.5",
    ),
    Claim(
        "gsta-half-inertia",
        "GSTA achieves the desired impedance despite model errors of any size (here M_hat is half of M).",
        "abstract, eq. (11)",
        "impedance error at rest, rms [N]",
        robustness.half_inertia,
        at_most=1e-3,
        because="same as without model errors",
        explanation=(
            "Proposition 1 needs a perturbation with a bounded derivative. An inertia error adds a part of the "
            "acceleration to the perturbation, eq. (11), and at the wall the acceleration changes as fast as the "
            "contact force. With M_hat = M/2 the vehicle keeps bouncing; with M_hat 20 % too small or 50 % too large "
            "it comes to rest. The paper gives no limit for the error."
        ),
    ),
    Claim(
        "gsta-finite-time",
        "GSTA brings the sliding variable to zero in finite time.",
        "proposition 1",
        "time for s to reach a 16 times narrower band with a quarter of the time step, over that with the full step",
        robustness.finite_time,
        at_most=1.1,
        because="an exponential approach takes a quarter longer: ln(16)/ln(4e4)",
    ),
    Claim(
        "gsta-robust",
        "GSTA is much more robust than the first-order law.",
        "figs. 5, 9",
        "impedance error at rest, over the first-order law's",
        measures.ratio(measures.at_rest, measures.norm, "gsta", "fosm", "N"),
        at_most=0.1,
        because='"much": by an order of magnitude',
    ),
    Claim(
        "gsta-sliding",
        "The difference in robustness is visible in the sliding variable.",
        "figs. 6, 10",
        "largest |s_i| at rest, over the first-order law's",
        measures.largest_s,
        at_most=0.1,
        because="an order of magnitude",
    ),
    Claim(
        "gsta-more-effort",
        "GSTA uses more control effort than impedance control.",
        "figs. 3, 11",
        "integral of the squared thrust, over impedance control's",
        lambda runs: measures.effort(runs, "impedance"),
        at_least=1.01,
        because="a visible difference",
    ),
    Claim(
        "gsta-similar-effort",
        "GSTA uses a control effort similar to the first-order law's.",
        "figs. 7, 11",
        "integral of the squared thrust, over the first-order law's",
        lambda runs: measures.effort(runs, "fosm"),
        at_least=0.95,
        at_most=1.05,
        because='"similar": within 5 %',
    ),
    Claim(
        "gsta-little-chattering",
        "GSTA chatters little.",
        "fig. 11",
        "mean change of thrust per control period at rest, over the rms of the thrust [%]",
        measures.ripple,
        at_most=1.0,
        because="narrower than a line in a figure",
    ),
    Claim(
        "gsta-smaller-steps",
        "GSTA chatters less than the first-order law, by the largest step-to-step change.",
        "figs. 7, 11, sec. 6",
        "largest step-to-step change of thrust, over the first-order law's",
        measures.ratio(metrics.largest_change, np.max, "gsta", "fosm", "N"),
        at_most=0.5,
        because='"significantly": less than half',
    ),
    Claim(
        "gsta-start-variation",
        "GSTA chatters less in the initial transient, by total variation.",
        "figs. 7, 11, insets",
        "total variation of thrust until 0.1 s, over the first-order law's",
        measures.ratio(
            lambda trace: metrics.total_variation(trace, 0.0, measures.TRANSIENT_S), np.sum, "gsta", "fosm", "N"
        ),
        at_most=0.5,
        because="less than half",
    ),
    Claim(
        "gsta-start-smooth",
        "GSTA does not switch in the initial transient.",
        "fig. 11, inset",
        "reversals of thrust above 0.1 N",
        measures.reversals("gsta"),
        at_most=0.0,
        because='"continuous": no reversal',
    ),
    Claim(
        "gsta-whole-variation",
        "GSTA chatters less than the first-order law over the whole run, by total variation.",
        "figs. 7, 11, sec. 6",
        "total variation of thrust, over the first-order law's",
        measures.whole_variation,
        at_most=1.0,
        because='"less" than the first-order law',
        explanation=(
            "Sampled GSTA does not come to rest: sgn(s) changes at every step, and the thrust alternates by "
            "M (k_1 + sqrt(k_1^2 - 2 k_2))^2 / 4 times the time step, some hundredths of a newton. In a figure of the "
            "thrust this ripple is narrower than a line, but it adds up, at the same rate for any time step. The "
            "first-order law is a smooth feedback inside its boundary layer and has no such ripple. The paper's claim "
            "holds for the size of the changes and for the transient, but not for their sum over the run."
        ),
    ),
    Claim(
        "gsta-continuous",
        "GSTA's control input is continuous.",
        "eq. (24), sec. 6",
        "largest step-to-step change of thrust with a quarter of the time step, over that with the full step",
        measures.continuity,
        at_most=0.6,
        because="eq. (24a) is of order sqrt(h) where s leaves zero: 0.5; a discontinuous input gives 1",
    ),
    Claim(
        "gsta-compliant",
        "GSTA remains compliant to the contact force, with the desired impedance also during rebounds.",
        "eq. (12), sec. 6",
        "impedance error along x from the first contact on, over the contact force, both rms [%]",
        measures.compliance,
        at_most=5.0,
        because="for a vehicle that does not yield the error is the whole contact force: 100 %",
    ),
    Claim(
        "gsta-stable",
        "With GSTA the contact force comes to rest.",
        "fig. 9",
        "range of the force in the last 0.5 s, over its mean [%]",
        measures.unrest,
        at_most=1.0,
        because="narrower than a line in a figure",
    ),
    Claim(
        "alone-force",
        "Without the nominal control GSTA still reaches the expected force.",
        "sec. 5.2",
        "force at rest [N]",
        measures.force("gsta_alone"),
        **AS_FOR_EXPECTED,
    ),
    Claim(
        "alone-impedance",
        "Without the nominal control GSTA still achieves the desired impedance.",
        "eq. (12), sec. 5.2",
        "impedance error at rest, rms [N]",
        measures.impedance_error("gsta_alone"),
        at_most=1e-3,
        because="same as with the nominal control",
    ),
    Claim(
        "alone-actuation",
        "The thrust is nearly the same with and without the nominal control.",
        "fig. 11",
        "rms of the difference, over the rms of the thrust [%]",
        measures.actuation,
        at_most=2.0,
        because="the two lines coincide in a figure",
    ),
    Claim(
        "alone-integral",
        "Without the nominal control the integral term grows larger.",
        "fig. 12",
        "largest |z_i| of the force part, over that with the nominal control",
        measures.integral,
        at_least=1.5,
        because="a visible difference",
    ),
)
