"""How runs, scenarios and vehicles show themselves in a notebook: a table and a small picture, as HTML.

Tables take the colours of the notebook, light or dark. Pictures have a light ground of their own. Nothing is loaded
from elsewhere.
"""

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from .. import display
from ..errors import InputError
from ..plant.mjcf import Mjcf
from ..records.trace import Trace
from ..scenario import Scenario

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CELL = "padding: 1px 10px 1px 0; text-align: left; vertical-align: top; background: none; border: none;"
_DPI = 140


@display.figure.register(Trace)
def trace_figure(
    trace: Trace,
    what: str | Sequence[str],
    width: str | float | None,
    fonts: str | None,
    height: str | float | None,
) -> "Figure":
    """A figure of a run."""
    from . import figures

    return figures.plot(trace, what, width, fonts, height)


@display.html.register(Trace)
def trace_html(trace: Trace) -> str:
    """A run: the table that ``uvms-mj run`` prints, its warnings, and its force, or without a contact its position."""
    from ..analysis.summary import heading, rows, summary
    from . import figures

    report = summary(trace, {})
    table = [*rows(trace, report)]
    if trace.message:
        table.append(("message", trace.message))
    table += [("warning", each) for each in report["warnings"]]
    what = "position" if report["contact"]["first_s"] is None else "force"
    drawn = [figures.plot({"": trace}, what)] if len(trace) > 1 else []
    return block(heading(report), table, drawn)


@display.html.register(Scenario)
def scenario_html(scenario: Scenario) -> str:
    """A scenario: each key that differs from its default, beside the default, and a picture of its start. Without the
    vehicle's file there is no picture."""
    from .figures import bodies

    try:
        drawn = [bodies.scene(scenario)]
    except InputError:
        drawn = []
    law = scenario.controller.label()
    rows: list[tuple[str, ...]] = [
        (key, value, f"default {default}") for key, value, default in scenario.changes(units=True)
    ]
    rows = rows or [("every key", "has its default")]
    return block(f"{scenario.name} · {law} · {scenario.simulation.duration:g} s", rows, drawn, scenario.description)


@display.html.register(Mjcf)
def mjcf_html(mjcf: Mjcf) -> str:
    """A vehicle: its table as ``uvms-mj vehicles`` prints it, and a picture. Raises InputError if the file is not one
    physical vehicle."""
    from ..plant.description import described, rows
    from .figures import bodies

    about = described(mjcf)
    thrusters = ("thrusters", f"{len(about['thrusters'])}, which span {about['axes']} of 6 axes")
    joints = [("joints", ", ".join(link["joint"] for link in about["links"]))] if about["links"] else []
    table = [*rows(about), thrusters, *joints]
    return block(Path(mjcf.name).stem, table, [bodies.vehicle(mjcf)], about["description"])


def block(title: str, rows: Iterable[tuple[str, ...]], drawn: Iterable["Figure"] = (), text: str = "") -> str:
    """HTML of a title, a text, a table whose rows begin with their names, and figures beside it. Texts are escaped."""
    lines = "".join(
        f"<tr style='background: none;'>{''.join(_cell(i, each) for i, each in enumerate(row))}</tr>" for row in rows
    )
    said = f"<div style='opacity: 0.75; max-width: 60em;'>{escape(text)}</div>" if text else ""
    head = f"<div style='font-weight: bold;'>{escape(title)}</div>{said}"
    table = f"<table style='border-collapse: collapse; font-size: 90%; margin: 4px 0;'>{lines}</table>"
    pictures = "".join(map(picture, drawn))
    look = "display: flex; flex-wrap: wrap; gap: 16px; align-items: flex-start;"
    return f"<div>{head}<div style='{look}'><div>{table}</div>{pictures}</div></div>"


def _cell(i: int, text: str) -> str:
    kind, look = ("th", "opacity: 0.75; font-weight: normal; white-space: nowrap;") if i == 0 else ("td", "")
    look += " font-variant-numeric: tabular-nums; white-space: pre-wrap;" if i == 1 else ""
    return f"<{kind} style='{_CELL} {look}'>{escape(text)}</{kind}>"


def picture(figure: "Figure") -> str:
    """An ``img`` with a figure as PNG in its address, as wide as the figure on paper."""
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=_DPI)
    width = round(110 * figure.get_figwidth())
    source = f"data:image/png;base64,{base64.b64encode(data.getvalue()).decode()}"
    return f"<img alt='' style='width: {width}px; max-width: 100%; border-radius: 4px;' src='{source}'>"
