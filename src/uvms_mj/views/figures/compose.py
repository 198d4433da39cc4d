"""Composes panels into figures: the paper's twelve, an overview of them, and the same quantities of any logs."""

import contextlib
import difflib
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Never

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.gridspec import GridSpec
from matplotlib.legend import Legend
from matplotlib.lines import Line2D

from ...errors import InputError, shortened
from ...records.header import Status
from ...records.trace import Trace
from ...stages.signals import AXES, OF_JOINTS
from . import panels
from .overlay import Overlay
from .panels import ANGULAR, LINEAR, Panel
from .scales import logarithmic, number, place, prefix_of
from .style import (
    BLACK,
    COLUMN_IN,
    GREY,
    PAGE_IN,
    SMALL,
    Figure,
    band_handles,
    height_of,
    size_in,
    styled,
    ticks,
    typeset,
    width_of,
)

WHATS = ("position", "attitude", "velocity", "force", "sliding", "tau", "thrusters", "integral", "joints", "summary")
"""Quantities that :func:`plot` can draw, besides each signal by its name."""
RUNS = ("impedance", "fosm", "gsta", "gsta_alone")
"""The paper's runs."""
_SUMMARY = ("position", "force", "sliding", "tau", "integral", "joints")
"""The quantities in a summary of several runs."""
_OF_THRUSTERS = ("u", "u_cmd", "pwm")
"""The signals of the thrusters, as far as they are recorded."""
MOST_ROWS = 30
"""Most rows of panels in one figure."""
LONGEST_NAME = 30
"""Most characters of a run's name in a legend; of longer names the end is shown."""
_HEIGHT_IN, _LEAST_IN = 1.75, 0.5
"""Height of an ordinary panel; least height of a row of panels, and of the legend [in]."""
_COLUMNS = 6
"""Columns of the grid, so that one, two, three or six panels fill the width of a figure."""

Rows = Sequence[Sequence[Panel]]


def paper(traces: Mapping[str, Trace], fine: Mapping[str, Trace]) -> dict[str, Figure]:
    """Draw the paper's figures 1-12, ``fig01`` to ``fig12``, and all of them on one page, ``overview``.

    Args:
        traces: the paper's runs by the names in :data:`RUNS`.
        fine: at least the first :data:`SWITCHING_S` of the same runs at every step, for the insets of tau; not needed
            for the impedance law.

    Raises:
        InputError: a run is missing or too short, or a trace of ``fine`` is not at every step.
    """
    _check(traces, fine)
    with styled():
        numbered = _numbered(traces, fine)
        figures = {}
        for i, (_, panel) in numbered.items():
            more = panels.pair_handles() if i in (11, 12) else ()
            figures[f"fig{i:02d}"] = _grid([[panel]], COLUMN_IN, "", more)
        figures["overview"] = _overview(numbered)
    return figures


def plot(
    traces: Trace | Mapping[str, Trace],
    what: str | Sequence[str] = "summary",
    width: str | float | None = None,
    fonts: str | None = None,
    height: str | float | None = None,
) -> Figure:
    """Draw one figure of a run, or of several runs on the same axes.

    Args:
        traces: a run, or several runs by name.
        what: one or several of :data:`WHATS`, of the names of recorded signals, or of their components, ``tau.x``.
        width: of the figure: a name of :data:`WIDTHS`, "column", "ieee-page", a length with its unit, "88mm", or a
            number [in]; default: a column for one run, a page for several runs, components side by side and the
            summary.
        fonts: "sans", "serif", "cm", or "latex", whose texts LaTeX sets when a .pdf or .pgf is written; default: sans.
        height: of the figure, a length with its unit, or a number [in]; default: by its panels.

    For one run, components with the same unit share a panel. For several runs, each component has a panel and each run
    has the colour of its law. The size of the figure does not depend on the number of runs. Raises InputError if a
    trace has fewer than two samples, no run has the quantity, or there are too many panels.
    """
    if isinstance(traces, Trace):
        traces = {traces.scenario.controller.label(): traces}
    if not isinstance(traces, Mapping):
        raise InputError(f'traces: {shortened(traces)} is not a run; give several by name, {{"gsta": trace, ...}}')
    whats = ["force" if each == "push" else each for each in ([what] if isinstance(what, str) else what)]
    _drawable(traces)
    for each in whats:
        check_quantity(each, traces)
    with typeset(fonts) if fonts else contextlib.nullcontext(), styled():
        named = _named(traces)
        if len(named) == 1:
            ((name, trace),) = named.items()
            rows = [row for each in whats for row in of_one(name, trace, each)]
            return _grid(rows, width_of(width, COLUMN_IN if "summary" not in whats else PAGE_IN), name, height=height)
        runs = Overlay(named)
        rows = [row for each in whats for row in _of_several(runs, each)]
        return _grid(rows, width_of(width, PAGE_IN), "", height=height)


def check_quantity(what: str, traces: Mapping[str, Trace]) -> None:
    """Raise InputError for a quantity that is none of :data:`WHATS`, and no signal or component of any trace."""
    name, errors = what.partition(".")[0], list[InputError]()
    for header in (trace.header for trace in traces.values() if name in trace.arrays):
        try:
            header.part(what)
        except InputError as error:
            errors.append(error)
        else:
            return
    if errors:
        raise errors[0]
    if what not in WHATS:
        signals = dict.fromkeys(name for trace in traces.values() for name in trace)
        close = difflib.get_close_matches(what, [*WHATS, *signals], 1)
        every = f"choose from {', '.join(WHATS)}, or a signal: {', '.join(signals)}"
        hint = f"did you mean {close[0]!r}?" if close else every
        raise InputError(f"{what}: is neither a quantity to draw nor a recorded signal; {hint}")


# The paper


def _check(traces: Mapping[str, Trace], fine: Mapping[str, Trace]) -> None:
    for what, given, needed in (("traces", traces, RUNS), ("fine", fine, RUNS[1:])):
        missing = [name for name in needed if name not in given]
        if missing:
            raise InputError(f"{what}: {', '.join(missing)} is missing")
        _drawable(given)
    for name, trace in fine.items():
        if trace.header.row_steps != 1:
            raise InputError(f"fine: {name} is not at every step; run it with log_rate 'full'")
        if trace.t[-1] < panels.SWITCHING_S - 1e-9:
            raise InputError(f"fine: {name} ends at {trace.t[-1]:g} s; it must last at least {panels.SWITCHING_S:g} s")


def _drawable(traces: Mapping[str, Trace]) -> None:
    if not traces:
        raise InputError("there is no log to draw")
    for label, trace in traces.items():
        if len(trace) < 2:
            raise InputError(f"{label}: has fewer than two samples; a line needs two")


def _numbered(traces: Mapping[str, Trace], fine: Mapping[str, Trace]) -> dict[int, tuple[str, Panel]]:
    """Title and panel by the number of the figure in the paper."""
    impedance, fosm, gsta, alone = (traces[name] for name in RUNS)
    return {
        1: ("impedance", panels.position(impedance)),
        2: ("impedance", panels.vector(impedance, "s")),
        3: ("impedance", panels.tau(impedance, None)),
        4: ("first order", panels.position(fosm)),
        5: ("first order", panels.force(fosm)),
        6: ("first order", panels.vector(fosm, "s")),
        7: ("first order", panels.tau(fosm, fine["fosm"])),
        8: ("GSTA", panels.position(gsta)),
        9: ("GSTA", panels.force(gsta)),
        10: ("GSTA", panels.vector(gsta, "s")),
        11: ("GSTA", panels.tau(gsta, fine["gsta"], alone, fine["gsta_alone"])),
        12: ("GSTA", panels.integral(gsta, alone)),
    }


def _overview(numbered: Mapping[int, tuple[str, Panel]]) -> Figure:
    """One row per quantity, one column per law. z takes the place of the force of the law that makes no contact."""
    order = (1, 4, 8, 2, 6, 10, 3, 7, 11, 12, 5, 9)
    rows = [order[i : i + 3] for i in range(0, len(order), 3)]
    heights = [max(numbered[i][1].height for i in row) for row in rows]
    figure = Figure(figsize=(PAGE_IN, 0.6 + _HEIGHT_IN * sum(heights)))
    axes = list(figure.subplots(4, 3, height_ratios=heights).flat)
    for ax, i in zip(axes, order, strict=True):
        ax.set_title(f"{i}  {numbered[i][0]}")
    cells = [(ax, numbered[i][1]) for ax, i in zip(axes, order, strict=True)]
    fill(cells)
    for ax in axes[:-3]:
        ax.set_xlabel("")
    _finish(figure, cells, panels.pair_handles()[3:])
    return figure


# Any log


def of_one(label: str, trace: Trace, what: str) -> Rows:
    """Linear and angular components in one column; side by side in a summary."""
    every_step = trace.header.row_steps == 1 and trace.t[0] == 0.0
    fine = trace if every_step and trace.t[-1] > 10.0 * panels.SWITCHING_S else None

    def halves(name: str) -> list[Panel]:
        return [panels.vector(trace, name, part) for part in (LINEAR, ANGULAR) if name in trace.arrays]

    def states() -> Rows:
        return [
            halves(signal.name) if signal.components == AXES else [panels.state(trace, signal)]
            for signal in panels.states_of(trace)
        ]

    def whole(name: str, panel: Callable[[Trace], Panel]) -> list[Panel]:
        return [panel(trace)] if name in trace.arrays or not trace.header.measured else []

    def thrust() -> Rows:
        if trace.header.measured and "tau" not in trace.arrays:
            return []
        return [[panels.tau(trace, fine), panels.vector(trace, "tau", ANGULAR)]]

    at, turned, _ = trace.header.task_frame
    rows: dict[str, Callable[[], Rows]] = {
        "position": lambda: [whole(at, panels.position)],
        "attitude": lambda: [whole(turned, panels.attitude)],
        "velocity": lambda: [halves(trace.header.task_frame[2])],
        "force": lambda: [whole("f_contact_W", panels.force)],
        "sliding": lambda: [halves("s")],
        "tau": thrust,
        "thrusters": lambda: [panels.of_signal(trace, name) for name in _OF_THRUSTERS if name in trace.arrays],
        "integral": states,
        "joints": lambda: [panels.joint_panels(trace)],
    }
    if what == "summary":
        drawn = [
            [*whole(at, panels.position), *whole("f_contact_W", panels.force)],
            *rows["sliding"](),
            *rows["tau"](),
            *states(),
        ]
        arm = panels.joint_panels(trace)
        drawn += [arm[i : i + 2] for i in range(0, len(arm), 2)]
        return [row for row in drawn if row] or _refuse([label], what)
    if what not in WHATS:
        one_each = what.partition(".")[0] in OF_JOINTS and "." not in what
        return [[panel] for panel in (panels.of_joints if one_each else panels.of_signal)(trace, what)]
    drawn = [[panel] for row in rows[what]() for panel in row]
    return drawn or _refuse([label], what)


def _of_several(runs: Overlay, what: str) -> Rows:
    def having(number: int) -> Overlay:
        """The runs and logs that have the position or the attitude."""
        names = {label: trace.header.task_frame[number] for label, trace in runs.traces.items()}
        return runs.of([label for label, trace in runs.traces.items() if names[label] in trace.arrays])

    def pushing() -> Rows:
        some = runs.of([label for label, trace in runs.traces.items() if "f_contact_W" in trace.arrays])
        return [[panels.forces(some.traces, some.looks)]] if some.traces else []

    def posed(number: int, panel: Callable[[Overlay, int], Panel]) -> Rows:
        some = having(number)
        return [[panel(some, i) for i in range(3)]] if some.traces else []

    rows: dict[str, Callable[[], Rows]] = {
        "position": lambda: posed(0, Overlay.position),
        "attitude": lambda: posed(1, Overlay.attitude),
        "velocity": lambda: [row for name in runs.velocities for row in runs.signal(name)],
        "force": pushing,
        "sliding": lambda: runs.signal("s"),
        "tau": lambda: runs.signal("tau"),
        "thrusters": lambda: [row for name in _OF_THRUSTERS for row in runs.signal(name)],
        "integral": lambda: [row for name in runs.states() for row in runs.signal(name)],
        "joints": lambda: [row for name in panels.SIGNALS for row in runs.signal(name)],
    }
    if what == "summary":
        return [row for each in _SUMMARY for row in rows[each]()]
    if what not in WHATS:
        return runs.signal(what)
    return rows[what]() or _refuse(list(runs.traces), what)


_MISSING = {
    "sliding": ("its law has no sliding variable", "no law has a sliding variable"),
    "integral": ("its law has no integral term and no other state", "no law has an integral term or another state"),
    "joints": ("its vehicle has no joints", "no vehicle has joints"),
}
"""Words for a quantity that not every run has: of one run, and of several."""


def _refuse(names: Sequence[str], what: str) -> Never:
    one, several = _MISSING.get(what, (f"has not measured its {what}", f"none of them has measured its {what}"))
    if len(names) > 1:
        raise InputError(f"{', '.join(names)}: {several}")
    others = ", ".join(each for each in WHATS if each != what)
    raise InputError(f"{names[0]}: {one}; draw one of {others}")


def _grid(
    rows: Rows, width: float, title: str, more: Sequence[Line2D] = (), height: str | float | None = None
) -> Figure:
    """A figure of rows of panels; each row fills the width of the figure."""
    if len(rows) > MOST_ROWS:
        raise InputError(f"{len(rows)} rows of panels are too many for one figure; draw one quantity at a time")
    heights = [max(panel.height for panel in row) for row in rows]
    high = height_of(height, 0.55 + _HEIGHT_IN * sum(heights))
    if high < _LEAST_IN * (1 + len(rows)):
        raise InputError(f"height: {high:.3g} inches are too low for {len(rows)} rows of panels and the legend")
    figure = Figure(figsize=(width, high))
    grid = GridSpec(len(rows), _COLUMNS, figure=figure, height_ratios=heights)
    drawn = []
    for i, row in enumerate(rows):
        wide = max(1, _COLUMNS // len(row))
        drawn += [(figure.add_subplot(grid[i, wide * j : wide * (j + 1)]), panel) for j, panel in enumerate(row)]
    if title:
        _entitle(drawn[0][0], title)
    fill(drawn)
    for ax, _ in drawn[: -len(rows[-1])]:
        ax.set_xlabel("")
    _finish(figure, drawn, more)
    return figure


def _named(traces: Mapping[str, Trace]) -> dict[str, Trace]:
    """Traces by unique names that fit into a figure, with the status of runs that did not complete."""
    named: dict[str, Trace] = {}
    for i, (label, trace) in enumerate(traces.items()):
        name = label if len(label) <= LONGEST_NAME else f"...{label[3 - LONGEST_NAME :]}"
        name = name if trace.status is Status.completed else f"{name} ({trace.status.name})"
        named[name if name not in named else f"{name} {i + 1}"] = trace
    return named


def _entitle(ax: Axes, text: str) -> None:
    """Set a title no wider than its panel; of a longer title the end is shown."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    room = size_in(ax)[0] * figure.dpi
    title = ax.set_title(text, parse_math=False)
    while text and title.get_window_extent().width > room:
        text = text[1 + len(text) // 20 :]
        title.set_text(f"...{text}")


# All figures


def fill(cells: Sequence[tuple[Axes, Panel]]) -> None:
    """Draw panels, each with its own range and prefix. All panels of a figure share range and prefix of time."""
    end = 0.0
    for ax, panel in cells:
        power, prefix = panel.scale
        ticks(ax, 6)
        panel.draw(ax)
        end = max(end, ax.get_xlim()[1])
        if panel.within is None:
            number(ax.yaxis, power)
        else:
            logarithmic(ax, panel.within, panel.scaled(prefix), power, "· " if prefix.startswith("10") else "")
        ax.set_ylabel(panel.label(prefix))
    power, prefix = prefix_of(end)
    for ax, _ in cells:
        ax.set_xlim(right=end)
        number(ax.xaxis, power)
        ax.set_xlabel(f"time [{prefix}s]")


def _finish(figure: Figure, cells: Sequence[tuple[Axes, Panel]], more: Sequence[Line2D] = ()) -> None:
    """Add the legend, then the insets, which need the final sizes, and the name of each line in the SVG."""
    axes = [ax for ax, _ in cells]
    _legend(figure, axes, [*more, *band_handles(axes)])
    with_insets = [(ax, panel) for ax, panel in cells if panel.insets]
    if with_insets:
        engine = figure.get_layout_engine()
        assert engine is not None
        engine.execute(figure)
    for ax, panel in with_insets:
        place(ax, panel.insets, panel.scale[0])
    for i, each in enumerate(figure.findobj(lambda artist: bool(artist.get_gid()))):
        each.set_gid(f"{each.get_gid()}-{i}")


def _legend(figure: Figure, axes: Sequence[Axes], more: Sequence[Artist]) -> None:
    """Add one legend above all axes, ordered by rows; where a colour has another meaning in another panel, one above
    each panel, for which the figure grows."""
    of_panels = [_labelled(ax) for ax in axes]
    others = {str(handle.get_label()): handle for handle in more}
    if _one_meaning(of_panels):
        found: dict[str, Artist] = {}
        for each in of_panels:
            found |= {label: handle for label, handle in each.items() if label not in found}
        found |= others
    else:
        _above_each(figure, dict(zip(axes, of_panels, strict=True)))
        found = others
    _in_rows(found, 0.97 * figure.bbox.width, lambda **how: figure.legend(loc="outside upper center", **how))


def _labelled(ax: Axes) -> dict[str, Artist]:
    """The first handle of each label of a panel."""
    found: dict[str, Artist] = {}
    for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
        found.setdefault(label, handle)
    return found


def _one_meaning(of_panels: Sequence[Mapping[str, Artist]]) -> bool:
    """Whether each colour stands for the same in all panels that have it. Black and grey are of references and levels,
    which their dashes tell apart."""
    meanings: dict[str, set[frozenset[str]]] = {}
    for found in of_panels:
        coloured: dict[str, set[str]] = {}
        for label, handle in found.items():
            if isinstance(handle, Line2D):
                coloured.setdefault(to_hex(handle.get_color()).upper(), set()).add(label)
        for shade, labels in coloured.items():
            meanings.setdefault(shade, set()).add(frozenset(labels))
    return all(len(each) == 1 for shade, each in meanings.items() if shade not in (BLACK, GREY))


_GAP_PT = 2.0
"""Space between a panel and its own legend [pt]."""


def _above_each(figure: Figure, of_panels: Mapping[Axes, Mapping[str, Artist]]) -> None:
    """Add a legend above each panel, and below its title, and make the figure higher by the legends of each row."""
    engine = figure.get_layout_engine()
    assert engine is not None
    engine.execute(figure)  # for the widths of the panels
    rows: dict[int, float] = {}
    for ax, found in of_panels.items():
        look = functools.partial(ax.legend, loc="lower left", borderaxespad=0.0, fontsize=SMALL)
        legend = _in_rows(found, 0.97 * size_in(ax)[0] * figure.dpi, look)
        if legend is None:
            continue
        high = legend.get_window_extent().height / figure.dpi + _GAP_PT / 72.0
        legend.set_bbox_to_anchor((0.0, 1.0 + _GAP_PT / 72.0 / size_in(ax)[1]), transform=ax.transAxes)
        for where in ("left", "right"):
            if text := ax.get_title(loc=where):
                ax.set_title(text, loc=where, pad=72.0 * high + 3.0, parse_math=False)
        spec = ax.get_subplotspec()
        row = spec.rowspan.start if spec is not None else 0
        rows[row] = max(rows.get(row, 0.0), high)
    figure.set_figheight(figure.get_figheight() + sum(rows.values()))


def _in_rows(found: Mapping[str, Artist], room: float, make: Callable[..., Legend]) -> Legend | None:
    """A legend, ordered by rows, in as few rows as a width [pixels] allows; None without an entry."""
    for rows in range(1, len(found) + 1):
        columns = -(-len(found) // rows)
        labels = [label for i in range(columns) for label in list(found)[i::columns]]
        legend = make(handles=[found[label] for label in labels], labels=labels, ncols=columns)
        if columns == 1 or legend.get_window_extent().width < room:
            return legend
        legend.remove()
    return None
