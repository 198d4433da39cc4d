"""Sentences at the top of a study's report, made from its numbers."""

from collections.abc import Sequence

from .data import Data
from .paired import Paired
from .sensitivity import SUCCESS, Sensitivities
from .statistics import Estimate
from .tables import Failure, signed

MOST_METRICS = 2
WEAK = 0.3
"""A sensitivity below this is not named."""


def findings(data: Data, pairs: Sequence[Paired], found: Sensitivities, failures: Sequence[Failure]) -> list[str]:
    """What the numbers show: differences between laws, the strongest influences, the most frequent failure."""
    return [*_differences(data, pairs), *_influences(data, found), *_failures(failures)]


def _apart(estimate: Estimate) -> bool:
    """Whether an interval excludes zero."""
    return estimate.low > 0.0 or estimate.high < 0.0


def _differences(data: Data, pairs: Sequence[Paired]) -> list[str]:
    sentences = []
    for pair in pairs:
        parts = []
        rate = pair.success
        if _apart(rate):
            low, high = (signed(100.0 * each) for each in (rate.low, rate.high))
            parts.append(f"success {signed(100.0 * rate.value)} points ({low} to {high})")
        for metric, middle, _, _ in pair.metrics[:MOST_METRICS]:
            if _apart(middle):
                name, unit = metric.short, metric.unit
                interval = f"{signed(middle.low)} to {signed(middle.high)}"
                parts.append(f"{name} {signed(middle.value)}{f' {unit}' if unit else ''} ({interval})")
        text = ", ".join(parts) or "no difference of success or of the first metrics is resolved"
        sentences.append(f"{pair.second} against {pair.first}, in the same draws: {text}.")
    return sentences


def _influences(data: Data, found: Sensitivities) -> list[str]:
    what = "Sobol index of first order" if found.sobol else "rank correlation"
    parts = []
    for metric in (SUCCESS, *data.varying[:MOST_METRICS]):
        strongest = found.strongest(metric)
        if strongest is not None and abs(strongest[0]) >= WEAK:
            value, law, factor = strongest
            parts.append(f"{metric.short} with {factor.name} ({value:.2f}, {law})".replace("-", "−"))
    return [f"Strongest influence, by {what}: {'; '.join(parts)}."] if parts else []


def _failures(failures: Sequence[Failure]) -> list[str]:
    if not failures:
        return []
    total, first = sum(each.runs for each in failures), failures[0]
    message = f": {first.message.rstrip('.')}" if first.message else ""
    which = "all" if first.runs == total else f"most often {first.runs}"
    return [f"{total} runs did not complete, {which} of {first.law}, {first.status}{message}."]
