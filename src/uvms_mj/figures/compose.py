"""From panels to figures: the paper's twelve, an overview of them, and the same of any log."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..faults import InputError, suggestion
from ..recording import Status
from ..trace import Trace
from . import panels
from .lines import place, size_in, ticks
from .panels import Panel, largest, number, prefix_of
from .style import COLUMN_IN, PAGE_IN, styled

WHATS = ("position", "force", "sliding", "tau", "integral", "summary")
"""What :func:`plot` draws."""
RUNS = ("impedance", "fosm", "gsta", "gsta_alone")
"""The paper's runs."""
MOST_PANELS = 60
"""In one figure."""
_HEIGHT_IN = 1.75


def paper(traces: Mapping[str, Trace], fine: Mapping[str, Trace]) -> dict[str, Figure]:
    """The paper's figures 1-12, ``fig01`` to ``fig12``, and all of them on a page, ``overview``.

    Args:
        traces: the paper's runs by the names in :data:`RUNS`.
        fine: the first :data:`SWITCHING_S` or more of the same runs at every step, for the insets of tau; that of the
            impedance law is not needed.

    Raises:
        InputError: a run is missing or too short, or what should be at every step is not.
    """
    _check(traces, fine)
    with styled():
        numbered = _numbered(traces, fine)
        figures = {}
        for i, (_, panel) in numbered.items():
            figure = Figure(figsize=(COLUMN_IN, 2.3))
            ax = figure.subplots()
            _fill([[(ax, panel)]])
            _finish(figure, [ax], panels.pair_handles() if i in (11, 12) else ())
            figures[f"fig{i:02d}"] = figure
        figures["overview"] = _overview(numbered)
    return figures


def plot(traces: Mapping[str, Trace], what: str) -> Figure:
    """One figure of one or several runs, a panel or for ``summary`` a column for each.

    Args:
        traces: by the names that stand above the panels.
        what: one of :data:`WHATS`.

    Raises:
        InputError: a log has no samples, its law has no state to draw, or there would be too many panels.
    """
    if what not in WHATS:
        raise InputError(f"{what}: nothing to draw by that name; {suggestion(what, WHATS)}")
    _drawable(traces)
    with styled():
        columns = {_title(label, trace): _panels(label, trace, what) for label, trace in traces.items()}
        return _side_by_side(columns) if what == "summary" else _stacked(columns)


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
            raise InputError(f"fine: {name} ends at {trace.t[-1]:g} s; it takes {panels.SWITCHING_S:g} s")


def _drawable(traces: Mapping[str, Trace]) -> None:
    if not traces:
        raise InputError("there is no log to draw")
    for label, trace in traces.items():
        if len(trace) < 2:
            raise InputError(f"{label}: has not two samples to draw a line through")


def _numbered(traces: Mapping[str, Trace], fine: Mapping[str, Trace]) -> dict[int, tuple[str, Panel]]:
    """Title and panel by the paper's numbers."""
    impedance, fosm, gsta, alone = (traces[name] for name in RUNS)
    return {
        1: ("impedance", panels.position(impedance)),
        2: ("impedance", panels.sliding(impedance)),
        3: ("impedance", panels.tau(impedance, None)),
        4: ("first order", panels.position(fosm)),
        5: ("first order", panels.force(fosm)),
        6: ("first order", panels.sliding(fosm)),
        7: ("first order", panels.tau(fosm, fine["fosm"])),
        8: ("GSTA", panels.position(gsta)),
        9: ("GSTA", panels.force(gsta)),
        10: ("GSTA", panels.sliding(gsta)),
        11: ("GSTA", panels.tau(gsta, fine["gsta"], alone, fine["gsta_alone"])),
        12: ("GSTA", panels.integral(gsta, alone)),
    }


def _overview(numbered: Mapping[int, tuple[str, Panel]]) -> Figure:
    """A row for each quantity, a column for each law; the one law that never touches leaves its place to z."""
    order = (1, 4, 8, 2, 6, 10, 3, 7, 11, 12, 5, 9)
    figure = Figure(figsize=(PAGE_IN, 7.6))
    axes = list(figure.subplots(4, 3).flat)
    for ax, i in zip(axes, order, strict=True):
        title, _ = numbered[i]
        ax.set_title(f"{i}  {title}")
    _fill([[(ax, numbered[i][1])] for ax, i in zip(axes, order, strict=True)])
    _only_below(axes[column::3] for column in range(3))
    _finish(figure, axes, panels.pair_handles()[3:])
    return figure


# Any log


def _panels(label: str, trace: Trace, what: str) -> Sequence[Panel]:
    fine = trace if trace.header.row_steps == 1 and trace.t[-1] > 10.0 * panels.SWITCHING_S else None
    one: dict[str, Callable[[], Panel]] = {
        "position": lambda: panels.position(trace),
        "force": lambda: panels.force(trace),
        "sliding": lambda: panels.sliding(trace),
        "tau": lambda: panels.tau(trace, fine),
    }
    if what in one:
        return [one[what]()]
    states = panels.states_of(trace)
    if what == "summary":
        return [*(make() for make in one.values()), *states]
    if not states:
        raise InputError(f"{label}: its law has no integral term and no other state; draw {', '.join(one)} or summary")
    return states


def _stacked(columns: Mapping[str, Sequence[Panel]]) -> Figure:
    """All panels below each other."""
    cells = [(title, panel) for title, column in columns.items() for panel in column]
    figure, axes = _grid(len(cells), 1)
    drawn = []
    for (title, panel), (ax,) in zip(cells, axes, strict=True):
        _entitle(ax, title)
        drawn.append((ax, panel))
    _fill(_by_quantity(drawn))
    _only_below([[ax for ax, _ in drawn]])
    _finish(figure, [ax for ax, _ in drawn])
    return figure


def _side_by_side(columns: Mapping[str, Sequence[Panel]]) -> Figure:
    """A column for each log."""
    figure, axes = _grid(max(map(len, columns.values())), len(columns))
    drawn, stacks = [], []
    for i, (title, column) in enumerate(columns.items()):
        _entitle(axes[0][i], title)
        stack = [row[i] for row in axes]
        for ax in stack[len(column) :]:
            ax.remove()
        stacks.append(stack[: len(column)])
        drawn += list(zip(stack, column, strict=False))
    _fill(_by_quantity(drawn))
    _only_below(stacks)
    _finish(figure, [ax for ax, _ in drawn])
    return figure


def _grid(rows: int, columns: int) -> tuple[Figure, list[list[Axes]]]:
    if rows * columns > MOST_PANELS:
        raise InputError(f"{rows * columns} panels are too many for a picture; draw fewer logs, or not all of each")
    width = COLUMN_IN if columns == 1 else 2.7 * columns
    figure = Figure(figsize=(width, 0.55 + _HEIGHT_IN * rows))
    return figure, figure.subplots(rows, columns, squeeze=False).tolist()


def _title(label: str, trace: Trace) -> str:
    return label if trace.status is Status.completed else f"{label} ({trace.status.name})"


def _entitle(ax: Axes, text: str) -> None:
    """A title no longer than its panel; of a long one the end."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    room = size_in(ax)[0] * figure.dpi
    title = ax.set_title(text, parse_math=False)
    while text and title.get_window_extent().width > room:
        text = text[1 + len(text) // 20 :]
        title.set_text(f"...{text}")


# What all share


def _by_quantity(cells: Iterable[tuple[Axes, Panel]]) -> list[list[tuple[Axes, Panel]]]:
    groups = defaultdict(list)
    for ax, panel in cells:
        groups[panel.quantity, panel.unit].append((ax, panel))
    return list(groups.values())


def _fill(groups: Iterable[Sequence[tuple[Axes, Panel]]]) -> None:
    """Draw panels; those of a group, which have the same quantity, get the same range and prefix, and time has one in
    all of a figure."""
    groups = list(groups)
    for group in groups:
        power, prefix = prefix_of(max(panel.largest for _, panel in group))
        for ax, panel in group:
            ticks(ax, 6)
            panel.draw(ax)
            number(ax.yaxis, power)
            ax.set_ylabel(panel.label(prefix))
        place(((ax, panel.inset) for ax, panel in group), power)
    axes = [ax for group in groups for ax, _ in group]
    power, prefix = prefix_of(max(largest(ax.get_xlim()) for ax in axes))
    for ax in axes:
        number(ax.xaxis, power)
        ax.set_xlabel(f"time [{prefix}s]")


def _only_below(stacks: Iterable[Sequence[Axes]]) -> None:
    """The label of time at the lowest panel alone."""
    for stack in stacks:
        for ax in stack[:-1]:
            ax.set_xlabel("")


def _finish(figure: Figure, axes: Iterable[Axes], more: Sequence[Line2D] = ()) -> None:
    """One legend above all axes, read row by row, in as few rows as the width allows; a name for each line in SVG."""
    found: dict[str, Artist] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    found |= {str(handle.get_label()): handle for handle in more}
    for rows in range(1, len(found) + 1):
        columns = -(-len(found) // rows)
        labels = [label for i in range(columns) for label in list(found)[i::columns]]
        legend = figure.legend(
            handles=[found[label] for label in labels], labels=labels, loc="outside upper center", ncols=columns
        )
        if columns == 1 or legend.get_window_extent().width < 0.97 * figure.bbox.width:
            break
        legend.remove()
    for i, each in enumerate(figure.findobj(lambda artist: isinstance(artist, Line2D) and bool(artist.get_gid()))):
        each.set_gid(f"{each.get_gid()}-{i}")
