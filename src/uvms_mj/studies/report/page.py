"""The page of a study: what the laws do, how far they differ, on what it depends, and which runs to look at."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from ...errors import InputError, suggestion
from ..pages import Group, Items, Page, Part, Picture, Section, Table, Text, facts, given, rendered
from ..plan import Plan
from . import figures, tables
from .data import Metric, StudyRows
from .statistics import SUCCESS, Paired, Sensitivities, of_many, paired, sensitivities

if TYPE_CHECKING:
    import pandas as pd

_STYLE = Path(__file__).with_name("report.css")
_MAPS = (
    "Medians over all other keys, for the keys to which the metrics are most sensitive. Hatched: fewer than half of "
    "the runs succeed. Without colour: no run has the value."
)
_SOBOL = (
    "Sobol indices, by SALib: the share of a metric’s variance that a key explains by itself (first order) and with "
    "all its interactions (total). Intervals are bootstrapped."
)
_RANKS = (
    "Rank correlations, not Sobol indices, which need the design sobol_indices: +1 if a metric always grows with a "
    "key, −1 if it always falls. A dependence that rises and falls can have the rank correlation zero."
)
_PAIRED = (
    "Each draw has the same values and random numbers for all laws. The interval of a median is distribution-free; "
    "the interval of success is Agresti and Min’s. Metrics are compared in the draws that both laws completed."
)
_AMONG_ALL = (
    "“Resolved among all” is a difference whose interval has no zero where all intervals hold at once with 95 %, each "
    "with 1 − 0.05/{} (Bonferroni’s)."
)
_MOST_LAWS = 3
"""Laws of which each pair has a sentence; of more laws, each has one beside the first."""
_OVERVIEW = "Success rates with 95 % intervals, and the distributions of the first metrics as in the next section."


def page(
    plan: Plan,
    frame: "pd.DataFrame",
    folder: str = "",
    versions: Mapping[str, str] | None = None,
    checked: Sequence[Table] = (),
) -> str:
    """The report of a study as HTML.

    Args:
        plan: the runs of the study.
        frame: its rows so far.
        folder: path of its folder, for the commands that replay a run.
        versions: version by name of the code and of its packages.
        checked: differences between the engines.
    """
    data = StudyRows(plan, frame)
    rates = figures.success_rates(data)
    found = sensitivities(data)
    pairs = paired(data)
    failures, more = tables.failures(data)
    missing, said = plan.runs - len(frame), findings(data, pairs, found, failures)
    sections = [
        Section(
            "laws",
            "Laws",
            given(
                tables.laws(data, rates) if rates else Text("No run is done yet."),
                Items(said, "findings") if said else None,
                Picture("overview", _OVERVIEW, figures.overview(data, rates)) if rates else None,
                Text(_how_counted(data), "soft"),
            ),
        ),
        Section(
            "distributions",
            "Distributions",
            [_distributions(data) or Text("No metric differs between the completed runs.")],
            "keep",
        ),
        *_map_section(plan, _maps(data, found)),
        *_sensitivity_section(found, _sensitivity(data, found)),
    ]
    if differences := tables.differences(pairs):
        shown = [table.shown("Differences between two laws") for table in differences]
        sections.append(
            Section(
                "differences",
                "Differences in the same draws",
                [Text(" ".join(filter(None, (_PAIRED, *_together(pairs)))), "soft"), *shown],
                "differences",
                "Differences",
            )
        )
    sections += [
        Section(
            "failures",
            "Failures",
            given(
                failures.shown("Failures by message", "failures") if failures.rows else Text("Every run completed."),
                Text(f"{more} further kinds are not listed.", "soft") if more else None,
            ),
        ),
        Section("runs", "Runs to look at", [tables.worst(data, folder)]),
        Section(
            "quantiles",
            "Quantiles",
            [
                Text("Of the runs that completed and have the value.", "soft"),
                *(table.shown("Quantiles of a metric") for table in tables.quantiles(data)),
            ],
            "quantiles",
        ),
        Section(
            "study",
            "Study",
            [
                facts(tables.studied(data, versions or {})),
                *(table.shown("Differences between the engines") for table in checked),
            ],
        ),
    ]
    lead = given(
        Text(plan.description, "lead") if plan.description else None,
        Text(_line(data), "soft"),
        Text(f"{missing} of {plan.runs} runs are not done yet; this page is about the others.", "warning")
        if missing
        else None,
    )
    return rendered(Page(plan.name, lead, sections, [_STYLE]))


def _together(pairs: Sequence[Paired]) -> list[str]:
    """The joint meaning of all intervals of differences."""
    n = sum(1 + len(pair.metrics) for pair in pairs)
    return [of_many(n), _AMONG_ALL.format(n)] if n > 1 else []


def _how_counted(data: StudyRows) -> str:
    """How the rates, medians and intervals of the laws are to be read."""
    repeats = ", with the repeats of a draw counted as one run" if data.plan.repeats > 1 else ""
    grid = (
        "; a rate over a grid is the share of its points, and its interval holds for points drawn at random"
        if data.plan.design == "grid"
        else ""
    )
    of_laws = data.varying[: tables.HEAD_METRICS]
    meanings = " ".join(f"{metric.short}: {metric.meaning}." for metric in of_laws if metric.meaning)
    return (
        f"Here {data.success_text}. Medians are of completed runs, with the range from 5 % to 95 %. Intervals are "
        f"Wilson’s{repeats}{grid}. {meanings}"
    ).rstrip()


def _map_section(plan: Plan, pictures: Sequence[Picture]) -> list[Section]:
    """The section of the maps, if there are any."""
    if not pictures:
        return []
    many = len(plan.variations) > 1
    first: list[Part] = [Text(_MAPS, "soft")] if many or len(pictures) > 1 else []
    parts = [Group([*first, pictures[0]], "keep"), *pictures[1:]]
    return [Section("maps", "Maps" if many else "Over the varied key", parts, link="Maps")]


def _sensitivity_section(found: Sensitivities, picture: Picture | None) -> list[Section]:
    """The section of the sensitivities, if there are any."""
    if picture is None:
        return []
    notes = Items([f"{note}." for note in found.notes]) if found.notes else None
    parts = given(Text(_SOBOL if found.sobol else _RANKS, "soft"), picture, notes)
    return [Section("sensitivity", "Sensitivity", parts, "keep")]


DRAWN = ("overview", "distributions", "map", "sensitivity")
"""The figures of :func:`figure`."""


def figure(
    plan: Plan,
    frame: "pd.DataFrame",
    what: str = "overview",
    over: Sequence[str] = (),
    metrics: Sequence[str] = (),
    labels: Mapping[str, str] | None = None,
) -> Figure:
    """One figure of the report: one of :data:`DRAWN`, a map over one or two of the varied keys; default: the keys with
    the greatest effect; distributions or a map of kept metrics, by default of all that vary or of the first. ``labels``
    stand in place of names of laws, metrics and keys. Raises InputError if the study has no such figure."""
    data = StudyRows(plan, frame, labels or {})
    if what not in DRAWN:
        raise InputError(f"{what}: is no figure of a study; {suggestion(what, DRAWN)}")
    if over and what != "map":
        raise InputError(f"over: is for a map, not for {what!r}")
    if metrics and what not in ("distributions", "map"):
        raise InputError(f"metrics: are for distributions and maps, not for {what!r}")
    drawn: Figure | None
    if what == "overview":
        drawn = figures.overview(data, figures.success_rates(data))
    elif what == "distributions":
        drawn = figures.distributions(data, data.named(metrics))
    elif over:
        drawn = _map_over(data, over, data.named(metrics))
    else:
        found = sensitivities(data)
        made = [_sensitivity(data, found)] if what == "sensitivity" else _maps(data, found, data.named(metrics))
        drawn = made[0].figure if made and made[0] is not None else None
    if drawn is None:
        why = "no number of its runs varies" if data.factors else "no key varies"
        if what == "map" and data.factors and not any(factor.numeric for factor in data.factors):
            why = "its keys have no numbers"
        raise InputError(f"{plan.name}: has nothing for a figure of {what}: {why}")
    return drawn


def _map_over(data: StudyRows, over: Sequence[str], metrics: Sequence[Metric]) -> Figure | None:
    """A map of metrics, by default of the first, over one or two varied keys. Raises InputError for another number, or
    a key that does not vary."""
    known = {factor.key: factor for factor in data.factors}
    for key in over:
        if key not in known:
            raise InputError(f"over: {key!r} does not vary; {suggestion(key, known)}")
        if not known[key].numeric:
            raise InputError(f"over: {key!r}: its values are no numbers, so that it has no axis; the rows have them")
    if len(over) == 1:
        return figures.profile(data, known[over[0]], metrics)
    if len(over) != 2 or over[0] == over[1]:
        raise InputError("over: give one key, or two different ones")
    return figures.maps(data, (known[over[0]], known[over[1]]), metrics or data.varying[: figures.MOST_METRICS])


def _line(data: StudyRows) -> str:
    """The study in one line."""
    plan = data.plan
    keys = len(plan.variations)
    varied = f"{keys} {'variation' if keys == 1 else 'variations'}" if keys else "nothing varied"
    laws = "1 law" if len(data.laws) == 1 else f"{len(data.laws)} laws"
    repeats = f" × {plan.repeats} repeats" if plan.repeats > 1 else ""
    engines = ", ".join(map(str, data.frame["engine"].dropna().unique()))
    draws = f"{len(plan.points)} draws ({plan.design.replace('_', ' ')}, {varied})"
    return f"{len(data.frame)} runs: {laws} × {draws}{repeats}" + (f"; engine {engines}" if engines else "")


def _distributions(data: StudyRows) -> Picture | None:
    figure = figures.distributions(data)
    left_out = [metric.label for metric in data.varying[figures.MOST_PANELS :]]
    constant = [metric.label for metric in data.metrics if metric not in data.varying]
    caption = (
        "Cumulative distributions of the metrics, as shares of all runs of a law. A curve that ends below 1, at an "
        "open circle, lacks the runs that did not complete or have no such value."
    )
    if left_out:
        caption += f" Only in the tables: {', '.join(left_out)}."
    if constant:
        caption += f" The same in every run: {', '.join(constant)}."
    return None if figure is None else Picture("distributions-figure", caption, figure)


def _maps(data: StudyRows, found: Sensitivities, named: Sequence[Metric] = ()) -> list[Picture]:
    """Maps over the most telling pairs of factors, or the metrics over a single factor; of the ``named`` metrics, or of
    the most telling ones."""
    if len(data.factors) == 1:
        figure = figures.profile(data, data.factors[0], named)
        caption = f"Each run over {data.factors[0].label}. A cross above a panel is a run that did not succeed."
        return [] if figure is None else [Picture("over-1", caption, figure)]
    pictures = []
    for i, pair in enumerate(figures.pairs(found), 1):
        metrics = named or figures.shown(found, pair, i == 1)
        if metrics:
            caption = f"{pair[0].label} and {pair[1].label}: {', '.join(m.label for m in metrics)}."
            if len(data.laws) > figures.MOST_LAWS:
                caption += f" Only the first {figures.MOST_LAWS} laws."
            pictures.append(Picture(f"over-{i}", caption, figures.maps(data, pair, metrics)))
    return pictures


def _sensitivity(data: StudyRows, found: Sensitivities) -> Picture | None:
    if not found.of or not found.factors:
        return None
    kind = "Sobol indices" if found.sobol else "Spearman's rank correlations"
    caption = f"{kind} of {', '.join(m.label for m in found.of)} with the varied keys, and their 95 % intervals."
    if SUCCESS not in found.of:
        caption += " Success is the same in every run of a law."
    return Picture("sensitivity-figure", caption, figures.sensitivity(found, data))


_MOST_METRICS = 2
WEAK = 0.3
"""A sensitivity below this is not named."""


def findings(data: StudyRows, pairs: Sequence[Paired], found: Sensitivities, failures: Table) -> list[str]:
    """The findings of the numbers: differences between laws, the strongest influences, the most frequent failure."""
    first = [pair for pair in pairs if len(data.laws) <= _MOST_LAWS or pair.first == data.laws[0]]
    return [*_differences(first), *_influences(data, found), *_failures(failures)]


def _differences(pairs: Sequence[Paired]) -> list[str]:
    sentences = []
    for pair in pairs:
        parts, compared = [], pair.metrics[:_MOST_METRICS]
        rate = pair.success
        if rate.apart:
            low, high = (tables.signed(100.0 * each) for each in (rate.low, rate.high))
            parts.append(f"success {tables.signed(100.0 * rate.value)} points ({low} to {high})")
        for each in compared:
            if each.matters:
                unit = f" {each.metric.unit}" if each.metric.unit else ""
                interval = f"{tables.signed(each.median.low)} to {tables.signed(each.median.high)}"
                parts.append(f"{each.metric.short} {tables.signed(each.median.value)}{unit} ({interval})")
        names = ", ".join(["success", *(each.metric.short for each in compared)])
        text = ", ".join(parts) or f"no difference above 1 % is resolved in {names}"
        sentences.append(f"{pair.second} against {pair.first}, in the same draws: {text}.")
    return sentences


def _influences(data: StudyRows, found: Sensitivities) -> list[str]:
    what = "Sobol index of first order" if found.sobol else "rank correlation"
    parts = []
    for metric in (SUCCESS, *data.varying[:_MOST_METRICS]):
        strongest = found.strongest(metric)
        if strongest is not None and abs(strongest[0]) >= WEAK:
            value, law, factor = strongest
            parts.append(f"{metric.short} with {factor.name} ({value:.2f}, {law})".replace("-", "−"))
    return [f"Strongest influence, by {what}: {'; '.join(parts)}."] if parts else []


def _failures(failures: Table) -> list[str]:
    if not failures.rows:
        return []
    total = sum(cells[2] for _, cells in failures.rows)
    law, (status, message, runs, *_) = failures.rows[0]
    why = "" if message == "–" else f": {message.rstrip('.')}"
    which = "all" if runs == total else f"most often {runs}"
    return [f"{total} runs did not complete, {which} of {law}, {status}{why}."]
