"""Sentences at the top of a study's report, made from its numbers."""

from collections.abc import Sequence

from .data import StudyRows
from .paired import Paired
from .sensitivity import SUCCESS, Sensitivities
from .tables import Failure, signed

MOST_METRICS = 2
WEAK = 0.3
"""A sensitivity below this is not named."""


def findings(data: StudyRows, pairs: Sequence[Paired], found: Sensitivities, failures: Sequence[Failure]) -> list[str]:
    """What the numbers show: differences between laws, the strongest influences, the most frequent failure."""
    return [*_differences(pairs), *_influences(data, found), *_failures(failures)]


def _differences(pairs: Sequence[Paired]) -> list[str]:
    sentences = []
    for pair in pairs:
        parts, compared = [], pair.metrics[:MOST_METRICS]
        rate = pair.success
        if rate.low > 0.0 or rate.high < 0.0:
            low, high = (signed(100.0 * each) for each in (rate.low, rate.high))
            parts.append(f"success {signed(100.0 * rate.value)} points ({low} to {high})")
        for each in compared:
            if each.matters:
                unit = f" {each.metric.unit}" if each.metric.unit else ""
                interval = f"{signed(each.median.low)} to {signed(each.median.high)}"
                parts.append(f"{each.metric.short} {signed(each.median.value)}{unit} ({interval})")
        names = ", ".join(["success", *(each.metric.short for each in compared)])
        text = ", ".join(parts) or f"no difference above 1 % is resolved in {names}"
        sentences.append(f"{pair.second} against {pair.first}, in the same draws: {text}.")
    return sentences


def _influences(data: StudyRows, found: Sensitivities) -> list[str]:
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
