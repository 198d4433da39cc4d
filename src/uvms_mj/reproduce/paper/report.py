"""A report about runs, of the paper or any others: one self-contained HTML file, for screens of any width and for
printing."""

import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...analysis import metrics, residual
from ...control.design import demanded_force
from ...control.laws.impedance import TOLD_THE_TRUTH
from ...errors import InputError
from ...quantities import leaves
from ...records.header import Status
from ...records.trace import MissingSignal, Trace, UnknownSignal
from ...studies import pages
from ...studies.pages import Group, Items, Page, Section, Table, Text, given, marked, rendered
from ...views import figures
from ..claims import STYLE, Row, as_part
from .claims import REST_S, TRANSIENT_S, linear_sum

_CLAIMS = (
    "Each row is a checkable claim from the paper’s abstract, proposition 1, section 5 or conclusion, with the value "
    "measured in these runs and the verdict against the stated threshold. Where the paper gives no number, the "
    "threshold is this project’s interpretation of its words; the reason is given below it."
)
_NUMBERS = (
    "Sums and norms are taken over the three force components. Effort, variation, impulse, peak and time with |s| < "
    "epsilon include every step, at any log rate; epsilon is 1e-3 for laws without a boundary layer. A dash means that "
    "the quantity cannot be measured or has not settled. Numbers below 1e-9 come from rounding and are shown as 0."
)
_LEVELS = "Expected: K_x (x_d - x_c), for a rigid wall. Analytic: force at rest of this law at this wall."

CAPTIONS: Mapping[str, str] = {
    "overview": "All runs: position, sliding variable and thrust; below, GSTA's integral term and the contact forces.",
    "fig01": "Position with impedance control alone. The current keeps the vehicle away from the wall.",
    "fig02": "Sliding variable with impedance control alone, which does not keep it at zero.",
    "fig03": "Thrust with impedance control alone.",
    "fig04": "Position with the first-order law.",
    "fig05": f"Contact force with the first-order law: impacts, then rest below the expected value. {_LEVELS}",
    "fig06": "Sliding variable with the first-order law, inside the boundary layer but not zero.",
    "fig07": "Thrust with the first-order law. The inset shows the initial switching at every step.",
    "fig08": "Position with GSTA.",
    "fig09": f"Contact force with GSTA: impacts, then rest at the expected value. {_LEVELS}",
    "fig10": "Sliding variable with GSTA after the reaching phase. It alternates at every step; the shade is its range "
    "between two rows. The inset shows the reaching phase.",
    "fig11": "Thrust with GSTA, with and without the nominal control. The inset shows every step.",
    "fig12": "Force part of GSTA's integral term, with and without the nominal control.",
}
"""Captions of the paper's figures, by name."""


@dataclass(frozen=True)
class Picture(pages.Picture):
    """A figure of the report. A figure of the paper is named by its number, fig01."""

    @property
    def number(self) -> str:
        """The number of the figure in the paper; empty for other figures."""
        digits = self.name.removeprefix("fig")
        return str(int(digits)) if digits.isdigit() else ""


MOST_COLUMNS = 6
"""Most columns of a table besides the names of its rows; more would be cut off on paper."""
MOST_NAMES = 4
"""Most runs that a heading names; for more runs it gives their number."""


def tables(what: str, runs: Sequence[str], lines: Sequence[tuple[str, Sequence[Any]]]) -> list[Table]:
    """Arrange values of runs in tables that fit on a page, for any number of runs.

    A few runs have one column each. More runs have one row each, and the quantities are spread over several tables.
    ``lines`` are names of quantities with the value in each run, under the heading ``what``.
    """
    if len(runs) <= MOST_COLUMNS:
        return [Table(what, runs, lines)]
    count = -(-len(lines) // MOST_COLUMNS)
    pages = [lines[len(lines) * i // count : len(lines) * (i + 1) // count] for i in range(count)]
    return [
        Table(
            "run", [name for name, _ in page], [(run, [values[i] for _, values in page]) for i, run in enumerate(runs)]
        )
        for page in pages
    ]


def names_of(traces: Mapping[str, Trace]) -> str:
    """The names of a few runs; for many runs, their number and the names of their laws."""
    if len(traces) <= MOST_NAMES:
        return ", ".join(traces)
    laws = Counter(trace.scenario.controller.label() for trace in traces.values())
    return f"{len(traces)} runs ({', '.join(f'{n} {law}' for law, n in laws.items())})"


def _rest(trace: Trace) -> float:
    return float(trace.t[-1]) - REST_S


def _impedance_error(trace: Trace, start: float) -> Any:
    """The norm of the impedance error from a time on [N]; None where it is not known."""
    try:
        return np.linalg.norm(residual.impedance_error(trace, start)[:3])
    except InputError:
        return None


def _percent(part: float | None) -> float | None:
    return None if part is None else 100.0 * part


MEASURES: tuple[tuple[str, str, Callable[[Trace], Any]], ...] = (
    ("contact force at rest", "N", metrics.rest_force),
    ("force that the desired impedance demands", "N", lambda trace: demanded_force(trace.scenario)),
    ("steady force error", "N", metrics.steady_force_error),
    ("first contact", "s", lambda trace: trace.first_contact[-1] if trace.touches[-1] else None),
    ("touches", "1", lambda trace: int(trace.touches[-1])),
    ("impact peak", "N", lambda trace: trace.force_peak[-1]),
    ("impulse of the first touch", "N s", metrics.impact_impulse),
    ("x in W settled to 2 %", "s", metrics.position_settling_time),
    ("force settled to 2 %", "s", metrics.force_settling_time),
    ("overshoot of x in W", "%", lambda trace: _percent(metrics.overshoot(trace))),
    ("impedance error, rms, whole run", "N", lambda trace: _impedance_error(trace, 0.0)),
    (f"impedance error, rms, last {REST_S:g} s", "N", lambda trace: _impedance_error(trace, _rest(trace))),
    ("control effort", "N² s", lambda trace: linear_sum(metrics.control_effort(trace))),
    ("total variation of thrust", "N", lambda trace: linear_sum(metrics.total_variation(trace))),
    (
        f"chattering index until {TRANSIENT_S:g} s",
        "N/s",
        lambda trace: linear_sum(metrics.chattering(trace, 0.0, TRANSIENT_S)),
    ),
    (f"chattering index, last {REST_S:g} s", "N/s", lambda trace: linear_sum(metrics.chattering(trace, _rest(trace)))),
    ("largest step-to-step change of thrust", "N", lambda trace: metrics.largest_change(trace)[:3].max()),
    (
        "time with |s_i| < epsilon, worst axis",
        "%",
        lambda trace: 100.0 * metrics.boundary_layer_share(trace).min() if "s" in trace.arrays else None,
    ),
    ("energy left in the wall at the end", "J", lambda trace: trace.wall_work[-1]),
    ("energy drawn from the wall, at most", "J", metrics.energy_from_wall),
)
"""Compared quantities: name, unit and measure. Sums and norms are taken over the three force components."""


def page(title: str, traces: Mapping[str, Trace], pictures: Sequence[Picture], rows: Sequence[Row] = ()) -> str:
    """The report as HTML, with at least one run, by the names used in the tables, figures, and claims with verdicts."""
    common, differing = _settings(traces)
    versions = {name: trace.header.versions for name, trace in traces.items()}
    first = next(iter(traces.values()))
    measures = tables(
        "quantity",
        list(traces),
        [(name if unit == "1" else f"{name} [{unit}]", values) for name, unit, values in measured(traces)],
    )
    notes = [marked("<b>{}</b>: {}", name, note) for name, trace in traces.items() for note in _notes(trace)]
    settings = given(
        Text("Settings that differ between the runs", "soft") if differing else None,
        *(
            table.shown("Settings that differ", "settings")
            for table in (tables("key", list(traces), differing) if differing else [])
        ),
        Table(
            "key",
            ["value"],
            [(key, [value]) for key, value in common],
            "settings",
            caption=f"{'Settings common to all runs' if len(traces) > 1 else 'Settings of the run'}; SI units, angles "
            "in degrees for keys that end in _deg",
        ),
    )
    code = [(key, sorted({v[key] for v in versions.values() if key in v})) for key in first.header.versions]
    sections = [
        *([Section("claims", "Claims", [Text(_CLAIMS), as_part(rows)])] if rows else []),
        Section(
            "numbers",
            "Numbers",
            given(
                Items(notes) if notes else None,
                Text(_NUMBERS, "soft"),
                *(table.shown("Numbers of each run") for table in measures),
            ),
        ),
        Section("figures", "Figures", [Group(pictures, "pictures")], "start"),
        Section("scenario", "Scenario", settings, "start"),
        Section(
            "versions",
            "Versions",
            [Items([marked("{} <b>{}</b>", name, ", ".join(values)) for name, values in code], "versions")],
        ),
    ]
    return rendered(Page(title, [Text(first.scenario.description or first.scenario.name, "lead")], sections, [STYLE]))


def measured(traces: Mapping[str, Trace]) -> list[tuple[str, str, list[float | None]]]:
    """Name, unit and values of all :data:`MEASURES`, one value per run; None if it cannot be measured."""
    return [
        (name, unit, [_finite(_of(measure, trace)) if len(trace) else None for trace in traces.values()])
        for name, unit, measure in MEASURES
    ]


def _of(measure: Callable[[Trace], Any], trace: Trace) -> Any:
    """A measure of a trace; None if it needs a signal that the log of a real vehicle lacks."""
    if not trace.header.measured:
        return measure(trace)
    try:
        return measure(trace)
    except (MissingSignal, UnknownSignal):
        return None


def _finite(value: Any) -> float | None:
    return None if value is None or not np.isfinite(value) else value if isinstance(value, int) else float(value)


def _settings(traces: Mapping[str, Trace]) -> tuple[list[tuple[str, str]], list[tuple[str, list[str]]]]:
    """Keys of the scenarios: common keys with their value, and differing keys with one value for each run."""
    scenarios = [leaves(trace.header.portable_scenario(), lists=False) for trace in traces.values()]
    tables = [{key: _text(value) for key, value in each} for each in scenarios]
    keys = list(dict.fromkeys(key for table in tables for key in table))
    common, differing = [], []
    for key in keys:
        values = [table.get(key, "–") for table in tables]
        if len(set(values)) == 1:
            common.append((key, values[0]))
        else:
            differing.append((key, values))
    return common, differing


def _text(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(_text(each) for each in value)}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _notes(trace: Trace) -> list[str]:
    ending = [] if trace.status is Status.completed else [f"{trace.status.name}: {trace.message}"]
    told = [f"the law is given {TOLD_THE_TRUTH}"] if trace.scenario.controller.uses_truth else []
    return [*told, *ending, *trace.notes]


_CAPTIONS = {
    "position": "Position in W and its reference",
    "force": "Contact force",
    "sliding": "Sliding variable",
    "tau": "Thrust",
}
"""Captions of the figures of a page."""
_NEEDED = {"position": "p_d", "force": "f_contact_W", "sliding": "s", "tau": "tau"}
"""Signals without which there is no such figure."""


def compare(traces: Mapping[str, Trace], path: str | os.PathLike) -> None:
    """Write the page that ``uvms-mj compare`` writes about runs, by their names in it. Raises InputError if the file
    can't be written."""
    captions = dict(_CAPTIONS)
    if any(trace.header.law.states for trace in traces.values()):
        captions["integral"] = "The laws' own states"
    if any(trace.header.geometry.links for trace in traces.values()):
        captions["joints"] = "Joints"
    pictures = [
        Picture(what, f"{caption}: {names_of(traces)}.", figures.plot(traces, what))
        for what, caption in captions.items()
        if any(_NEEDED.get(what, "t") in trace.arrays for trace in traces.values())
    ]
    names = ", ".join(dict.fromkeys(trace.scenario.name for trace in traces.values()))
    pages.write(Path(path), page(f"{names}: {names_of(traces)}", traces, pictures))
