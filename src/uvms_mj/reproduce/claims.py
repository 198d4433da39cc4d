"""A claim: a sentence, a measured quantity, a threshold and a verdict. Claims are rows of a TOML file."""

import enum
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..studies.pages import Fragment, filled

STYLE = Path(__file__).with_name("claims.css")
"""Style of a page with claims."""


@dataclass(frozen=True)
class Measured:
    """A measured value, None if it cannot be measured, and the quantities it is computed from, in words. ``explained``
    is whether the runs show the reason given in the claim's explanation."""

    value: float | None
    detail: str = ""
    explained: bool = False


class Verdict(enum.Enum):
    """Result of checking a claim."""

    holds = "the runs confirm it"
    explained = "the runs do not confirm it, for a stated reason that was itself measured"
    fails = "the runs do not confirm it"


@dataclass(frozen=True)
class Claim:
    """A sentence that can be checked.

    Attributes:
        text: the sentence, in this project's words.
        where: equation, figure or section of the paper, or axis of the page.
        measured: name and unit of the measured quantity, ``force at rest [N]``; without a unit it is a pure number.
        measure: function that measures the quantity.
        at_least, at_most: limits of the predicate; infinite for none. One of them is required.
        because: reason for the threshold.
        paper: the paper's value; empty if the paper gives none.
        explanation: known reason why the claim does not hold in the paper's scenario; empty for most claims. It counts
            only if the measurement confirms it.
    """

    id: str
    text: str
    where: str
    measured: str
    measure: Callable[[Any], Measured] = field(repr=False)
    at_least: float = -np.inf
    at_most: float = np.inf
    because: str = ""
    paper: str = ""
    explanation: str = ""

    def __post_init__(self) -> None:
        if -self.at_least == self.at_most == np.inf:
            raise ValueError(f"claim {self.id} has no threshold")

    @property
    def quantity(self) -> str:
        """Name of the measured quantity."""
        return self.measured.partition(" [")[0]

    @property
    def unit(self) -> str:
        """Unit of the measured quantity; "1" for a pure number."""
        return self.measured.partition(" [")[2].removesuffix("]") or "1"

    @property
    def predicate(self) -> str:
        """The threshold in words."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.at_least == -np.inf:
            return f"at most {self.at_most:g}{unit}"
        if self.at_most == np.inf:
            return f"at least {self.at_least:g}{unit}"
        return f"{self.at_least:g} to {self.at_most:g}{unit}"

    def holds(self, value: float | None) -> bool:
        """Whether a value meets the threshold; False for None and NaN."""
        return value is not None and bool(self.at_least <= value <= self.at_most)


@dataclass(frozen=True)
class Row:
    """A claim with its measured value and verdict."""

    claim: Claim
    measured: Measured
    verdict: Verdict

    @classmethod
    def of(cls, claim: Claim, results: Any) -> "Row":
        """Measure and judge a claim in the results of its runs. A claim that can't be measured fails, e.g. if a run is
        too short."""
        try:
            measured = claim.measure(results)
        except (ArithmeticError, AttributeError, LookupError, ValueError) as error:
            measured = Measured(None, f"can't be measured: {error}")
        if claim.holds(measured.value):
            return cls(claim, measured, Verdict.holds)
        return cls(claim, measured, Verdict.explained if claim.explanation and measured.explained else Verdict.fails)

    def as_dict(self) -> dict[str, Any]:
        """Row for JSON and CSV. A value that is not finite becomes None."""
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


def claims_in(file: Path, measures: Mapping[str, Callable[..., Measured]]) -> tuple[Claim, ...]:
    """The claims of a TOML file: a table for each id, with the attributes of :class:`Claim`. Its ``measure`` names one
    of the ``measures``, which is called with the results and the arguments ``of``."""

    def bound(measure: str, of: Sequence[Any] = ()) -> Callable[[Any], Measured]:
        function = measures[measure]
        return lambda results: function(results, *of)

    tables = tomllib.loads(file.read_text(encoding="utf-8"))
    call = {name: bound(table.pop("measure"), table.pop("of", ())) for name, table in tables.items()}
    return tuple(Claim(name, measure=call[name], **table) for name, table in tables.items())


def judged(claims: Sequence[Claim], results: Any) -> list[Row]:
    """The claims with their measured values and verdicts."""
    return [Row.of(claim, results) for claim in claims]


def counted(rows: Sequence[Row]) -> dict[Verdict, int]:
    """Number of claims with each verdict."""
    return {verdict: sum(row.verdict is verdict for row in rows) for verdict in Verdict}


def as_part(rows: Sequence[Row]) -> Fragment:
    """Claims with their verdicts, and how many there are of each, as a part of a page."""
    return Fragment(filled(Path(__file__).with_name("claims.html"), rows=rows, counts=counted(rows)))
