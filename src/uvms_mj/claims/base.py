"""What a claim is: a sentence, what is measured for it, a threshold, and a verdict."""

import enum
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..trace import Trace


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
        explained: whether the claim's explanation was itself found in the runs.
    """

    value: float | None
    detail: str = ""
    explained: bool = False


class Verdict(enum.Enum):
    """What became of a claim."""

    holds = "the runs bear it out"
    explained = "the runs do not bear it out, for a reason that is given and was itself measured"
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
        because: why the threshold is where it is.
        paper: the paper's value, where it gives one.
        explanation: why it is known not to hold in the paper's scenario; empty for most. It counts only where the
            measurement finds it in the runs.
    """

    id: str
    text: str
    where: str
    quantity: str
    unit: str
    measure: Callable[[Runs], Measured] = field(repr=False)
    at_least: float | None = None
    at_most: float | None = None
    because: str = ""
    paper: str = ""
    explanation: str = ""

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

    @classmethod
    def of(cls, claim: Claim, runs: Runs) -> "Row":
        """A claim measured and judged. One that can't be measured fails, as in a run too short or of another law."""
        try:
            measured = claim.measure(runs)
        except (ArithmeticError, AttributeError, LookupError, ValueError) as error:
            measured = Measured(None, f"can't be measured: {error}")
        if claim.holds(measured.value):
            return cls(claim, measured, Verdict.holds)
        return cls(claim, measured, Verdict.explained if claim.explanation and measured.explained else Verdict.fails)

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
            "because": claim.because,
            "verdict": self.verdict.name,
            "reason": claim.explanation if self.verdict is Verdict.explained else "",
        }


def number(value: float | None) -> str:
    """A number as a reader wants it: four digits, a true minus, powers of ten; a dash for None, nan and infinity.

    Below 1e-9, in SI units, it is rounding of sums over 1e5 steps, and is shown as 0.
    """
    if value is None or not np.isfinite(value):
        return "–"
    if abs(value) < 1e-9:
        return "0"
    if value == round(value) and abs(value) < 1e4:
        return f"{value:.0f}".replace("-", "−")
    mantissa, e, exponent = f"{value:.4g}".partition("e")
    raised = str(int(exponent)).translate(_RAISED) if e else ""
    return (f"{mantissa}·10{raised}" if e else mantissa).replace("-", "−")


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
