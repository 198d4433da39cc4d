"""Figures: lines agree with the recorded signals, colours are consistent, and nothing overlaps."""

import dataclasses
import functools
import itertools
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar
from unittest.mock import patch

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from traces import TASK, without
from tree_run import tool_run
from uvms_mj import Controller, InputError, Scenario, simulate
from uvms_mj.cli.plot import FORMATS
from uvms_mj.stages.signals import AXES, BAND, RECORDED
from uvms_mj.views import colours, figures
from uvms_mj.views.figures import panels, style
from uvms_mj.views.figures.panels import JOINTS, Panel
from uvms_mj.views.figures.scales import early, logarithmic, rebounds
from uvms_mj.views.figures.style import COLOURS, stripe, thin, thin_band

PAPER = [*(f"fig{i:02d}" for i in range(1, 13)), "overview"]
OF_FOUR = ("position", "force", "sliding", "tau", "integral", "summary")
LEVELS = ("expected", "analytic", "wall", "motor limit")
LAWS = {"impedance": {}, "fosm": {}, "gsta": {}, "gsta_alone": {"nominal": False}}


@pytest.fixture(scope="module")
def traces(paper_run):
    return {name: paper_run(name.removesuffix("_alone"), **gains) for name, gains in LAWS.items()}


@pytest.fixture(scope="module")
def fine():
    def start(name, gains):
        overrides = {"simulation.duration": 0.02} | {f"controller.{key}": value for key, value in gains.items()}
        return simulate(Scenario.load("push_wall", overrides, name.removesuffix("_alone")), log_rate="full")

    return {name: start(name, gains) for name, gains in LAWS.items()}


@pytest.fixture(scope="module")
def drawn(traces, fine):
    """The paper's figures, and plots of one log, of several logs and of unusual logs, by name."""
    plots = {
        f"{what} of one": figures.plot({"gsta": traces["gsta"]}, what) for what in ("force", "integral", "summary")
    }
    tree = tool_run()
    plots |= {f"{what} of a tree": figures.plot({"tree": tree}, what) for what in ("position", "joints", "summary")}
    plots["joints of trees"] = figures.plot({"a": tree, "b": tree, **traces}, "joints")
    for what in OF_FOUR:
        plots[f"{what} of four"] = figures.plot(traces, what)
    plots["summary at every step"] = figures.plot({"a $name_ that is too long " * 5: fine["fosm"]}, "summary")
    plots["states of a user's law"] = figures.plot({"Odd": odd_run()}, "integral")
    plots["states of laws of four"] = figures.plot({"Odd": odd_run(), **traces}, "integral")
    plots["tau of twenty of four"] = figures.plot(many(traces, 20), "tau")
    return figures.paper(traces, fine) | plots


@pytest.fixture(scope="module")
def texts(drawn):
    """Every figure, drawn once without output: each visible text of it with its box."""
    found, draw = {name: [] for name in drawn}, Text.draw
    for name, figure in drawn.items():

        def record(text, renderer, boxes=found[name]):
            draw(text, renderer)
            if text.get_visible() and text.get_text().strip():
                boxes.append((text.get_text(), text.get_window_extent(renderer).padded(-0.5)))

        FigureCanvasAgg(figure)
        with patch.object(Text, "draw", record):
            figure.draw_without_rendering()
    return found


def many(traces, n):
    """n runs with long names, of the paper's laws in turn."""
    laws = list(traces)
    return {f"a run of a sweep, number {i} of {n}: {laws[i % 4]}": traces[laws[i % 4]] for i in range(n)}


@dataclass(frozen=True)
class Odd(Controller):
    """A law with states of all sizes."""

    states: ClassVar = {"xi": 6, "w_": 1, "four": 4, "many": 40}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(40):
            state_dot.many[i] = i
        for i in range(6):
            state_dot.xi[i] = signals.eta_e[i]
            tau_cmd[i] = signals.tau_nom[i]


@functools.cache
def odd_run():
    return simulate(Scenario.load("push_wall", {"simulation.duration": 0.2}), controller=Odd())


def lines_of(figure, ax=None):
    """Signal name and line of all lines with data in a figure, or in one of its axes."""
    found = (ax or figure).findobj(lambda artist: isinstance(artist, Line2D) and bool(artist.get_gid()))
    return [(each.get_gid().rpartition("-")[0], each) for each in found]


def inset_of(figure):
    (ax,) = figure.axes
    (inset,) = ax.child_axes
    return inset


def values_of(trace, name):
    """Samples (n,) from which the line ``name`` is drawn."""
    if name == "push":
        return trace.push
    signal, _, component = name.partition(".")
    return trace[signal][:, "xyz".index(component)]


# Appearance


def test_no_text_lies_on_another_or_leaves_the_picture(drawn, texts):
    for which, figure in drawn.items():
        boxes = texts[which]
        assert len(boxes) > 10
        for text, box in boxes:
            inside = box.x0 >= 0 and box.y0 >= 0 and box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1
            assert inside, f"{which}: {text!r} leaves the picture"
        for (a, box_a), (b, box_b) in itertools.combinations(boxes, 2):
            assert not box_a.overlaps(box_b), f"{which}: {a!r} overlaps {b!r}"


def test_neither_insets_nor_legends_lie_on_lines(drawn, texts):
    insets = 0
    for name, figure in drawn.items():
        legends = [*figure.legends, *(ax.get_legend() for ax in figure.axes if ax.get_legend())]
        assert len(figure.legends) == 1 or len(legends) >= len(figure.axes), name
        for ax in figure.axes:
            for legend in legends:
                assert not legend.get_window_extent().overlaps(ax.get_window_extent()), name
            for inset in ax.child_axes:
                insets += 1
                box = inset.get_tightbbox()
                for signal, line in lines_of(figure, ax):
                    if line.axes is ax:
                        path = line.get_path().transformed(ax.transData)
                        assert not path.intersects_bbox(box, filled=False), f"{name}: an inset hides {signal}"
                for text in inset.findobj(Text):
                    assert text.get_fontsize() >= 6.0
    assert insets > 20


@pytest.mark.parametrize("low", [0.0, -3e-3, -10.0])
@pytest.mark.parametrize("within", [1e-1, 1e-3, 1e-5, 1e-8])
def test_numbers_of_a_logarithmic_axis_do_not_touch(low, within):
    with style.styled():
        figure = Figure(figsize=(style.PAGE_IN / 3.0, 1.75))
        ax = figure.subplots()
        ax.plot([0.0, 1.0], [low, 10.0])
        logarithmic(ax, within, "m", 1e-3, "m")
        FigureCanvasAgg(figure).draw()
        boxes = [text.get_window_extent() for text in ax.get_yticklabels() if text.get_text()]
    assert len(boxes) >= 3
    assert all(lower.y1 < upper.y0 for lower, upper in itertools.pairwise(boxes))


def test_a_legend_has_no_two_lines_that_look_the_same_and_says_what_its_levels_are(drawn):
    entries = {}
    for which in ("summary of a tree", "joints of a tree", "force of one", "summary of one"):
        (legend,) = drawn[which].legends
        if "tree" in which:
            labels = {ax.get_ylabel() for ax in drawn[which].axes}
            assert {"joint position q [rad]", "joint position q [m]", "manipulability [1]"} <= labels
        looks = [
            (text.get_text(), to_hex(line.get_color()), tuple(line._dash_pattern[1] or ()))
            for text, line in zip(legend.get_texts(), legend.legend_handles, strict=True)
            if isinstance(line, Line2D)
        ]
        assert len({look[1:] for look in looks}) == len(looks), (which, looks)
        entries[which] = {text for text, *_ in looks}
    assert {"shoulder", "hinge", "roll", "pitch"} <= entries["summary of a tree"]
    levels = {"expected at a rigid wall", "analytic, at rest at this wall"}
    assert levels <= entries["force of one"] & entries["summary of one"]


@pytest.mark.parametrize("width", ["ieee-column", "elsevier-page"])
def test_where_a_colour_has_two_meanings_each_panel_has_its_legend(width):
    heavy = {"vehicle.model": "bluerov2_heavy", "simulation.duration": 0.05}
    trace = simulate(Scenario.load("push_wall", heavy), engine="free_body")
    figure = figures.plot(trace, ["thrusters", "force", "position"], width=width)
    FigureCanvasAgg(figure).draw()
    assert not figure.legends
    names = [name.replace("_", " ") for name in trace.header.mjcf.vehicle.thrusters]
    for ax in figure.axes:
        legend = ax.get_legend()
        box = legend.get_window_extent()
        assert {text.get_text() for text in legend.get_texts()} == {*ax.get_legend_handles_labels()[1]}
        assert not any(box.overlaps(other.get_window_extent()) for other in figure.axes)
        assert 0.0 <= box.x0 < box.x1 <= figure.bbox.x1
    assert {text.get_text() for text in figure.axes[0].get_legend().get_texts()} == {*names}
    alike = figures.plot(trace, ["force", "position", "tau"], width=width)
    assert len(alike.legends) == 1
    assert not any(ax.get_legend() for ax in alike.axes)


@pytest.mark.parametrize(
    ("name", "width"),
    [("elsevier-column", 90.0), ("elsevier-middle", 140.0), ("elsevier-page", 190.0)],
)
def test_a_width_of_a_publisher_is_the_width_of_the_pdf(traces, tmp_path, name, width):
    figures.plot(traces["gsta"], "force", width=name, fonts="serif").savefig(tmp_path / "f.pdf")
    box = (tmp_path / "f.pdf").read_bytes().partition(b"/MediaBox [ 0 0 ")[2].split()[0]
    assert float(box) * 25.4 / 72.0 == pytest.approx(width, abs=0.05)


@pytest.mark.parametrize(("name", "points"), [("column", 252.0), ("ieee-column", 252.0), ("page", 516.0)])
def test_a_figure_fits_the_width_of_ieeetran(traces, tmp_path, name, points):
    """TeX's width of the page of the PDF, which has big points, is the class's, and not above it."""
    figures.plot(traces["gsta"], "force", width=name, fonts="serif").savefig(tmp_path / "f.pdf")
    box = float((tmp_path / "f.pdf").read_bytes().partition(b"/MediaBox [ 0 0 ")[2].split()[0])
    assert points - 0.01 < box * 72.27 / 72.0 <= points + 1e-4
    if shutil.which("pdflatex"):
        width = rf"\hbadness=10000 \hfuzz=0.001pt \hsize={points:g}pt \parindent=0pt \includegraphics{{f}}\par"
        text = rf"\documentclass{{article}}\usepackage{{graphicx}}\begin{{document}}{width}\end{{document}}"
        (tmp_path / "paper.tex").write_text(text)
        command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout[-1000:]
        assert "Overfull" not in done.stdout


def test_units_and_symbols_are_typeset():
    assert style.unit_text("N s^2/m^2") == "N s²/m²"
    assert style.unit_text("m^(1/2)/s^(3/2)") == "m$^{1/2}$/s$^{3/2}$"
    assert style.unit_text("kg s^-1") == "kg s$^{-1}$"
    assert style.unit_text("us") == "µs"
    assert style.unit_text("plus") == "plus"
    assert style.titled("contact.peak", "N") == "contact peak [N]"
    assert style.titled("final.position.x", "m") == "final position x [m]"
    assert style.titled("controller.k_1", "m^(1/2)/s^(3/2)") == r"controller $k_{\mathrm{1}}$ [m$^{1/2}$/s$^{3/2}$]"
    assert style.titled("impedance.K_d.0") == r"impedance $K_{\mathrm{d,0}}$"
    assert style.symbol("nu_dot", "x") == r"$\dot{\nu}_{\mathrm{x}}$"
    assert style.symbol("tau_q_cmd") == r"$\tau_{\mathrm{q,cmd}}$"
    assert style.symbol("p_d_ddot") == r"$\ddot{p}_{\mathrm{d}}$"
    assert style.symbol("stretch_W", "x") == r"stretch$_{\mathrm{W,x}}$"
    assert style.symbol("contact_depths", "2") == "contact depths 2"
    assert style.symbol("u", "front_left") == "$u$ front left"
    for name in ("manipulability", "pwm", "sw1", "w_"):
        assert style.symbol(name) == name
    for signal in RECORDED:
        assert "_" not in re.sub(r"\$.*?\$", "", style.symbol(signal.name)), "a reader sees words and symbols"
    figure = Figure()  # matplotlib can set each of them
    for i, name in enumerate([*(signal.name for signal in RECORDED), "xi_1"]):
        figure.text(0.0, 0.01 * i, style.symbol(name))
    for i, unit in enumerate({signal.unit for signal in RECORDED}):
        figure.text(0.5, 0.01 * i, style.unit_text(unit))
    FigureCanvasAgg(figure).draw()


def test_a_signal_has_the_same_colour_everywhere(drawn):
    okabe_ito = {"#0072b2", "#009e73", "#e69f00", "#d55e00", "#cc79a7", "#56b4e9", "#999999"}
    assert {colour.lower() for colour in COLOURS.values()} == okabe_ito
    seen = set()
    for name, figure in drawn.items():
        for signal, line in lines_of(figure):
            quantity, _, component = signal.partition(".")
            if quantity in ("p_d", "expected", "analytic"):
                assert to_hex(line.get_color()) == "#000000", (name, signal)
                assert line.is_dashed(), (name, signal)
            elif "of four" not in name and quantity in ("p_WB", "s", "tau", "z", "xi"):
                assert to_hex(line.get_color()) == COLOURS[component].lower(), (name, signal)
            elif "of four" not in name and quantity == "push":
                assert to_hex(line.get_color()) == COLOURS["force"].lower(), name
            elif quantity in ("q", "tau_q") and "trees" not in name:
                joint = ("shoulder", "extension", "hinge").index(component)
                assert to_hex(line.get_color()) == JOINTS[joint].lower(), (name, signal)
            seen.add(quantity)
    assert seen >= {"p_WB", "p_d", "wall", "push", "expected", "analytic", "s", "tau", "z", "xi", "many", "q", "tau_q"}


def test_no_line_is_louder_than_another(drawn):
    for name, figure in drawn.items():
        for ax in figure.findobj(Axes):
            lines = [line for signal, line in lines_of(figure, ax) if line.axes is ax and signal not in LEVELS]
            lines = [line for line in lines if to_hex(line.get_color()) != "#000000"]
            assert len({line.get_linewidth() for line in lines}) <= 1, name


@pytest.mark.parametrize("n", [2, 3, 6])
def test_of_lines_that_coincide_each_shows_a_part(n):
    """The dashes of all lines are drawn on top of each other in order."""
    at = np.linspace(0.0, 600.0, 60_001)
    top = np.zeros(len(at), dtype=int)
    orders = []
    for i in range(n):
        look = stripe(i, n)
        orders.append(look["zorder"])
        if look["linestyle"] == "solid":
            top[:] = i
        else:
            offset, (on, off) = look["linestyle"]
            top[(at + offset) % (on + off) < on] = i
    assert orders == sorted(orders)
    assert np.bincount(top, minlength=n).min() / len(at) > 0.4 / n


def test_linear_and_angular_components_have_axes_of_their_own(drawn):
    """All lines of an axes have the unit of its label."""
    angular = {"roll", "pitch", "yaw"}
    units = {"s": ("m/s", "rad/s"), "tau": ("N", "N m"), "z": ("m/s²", "rad/s²")}
    seen = set()
    for name, figure in drawn.items():
        for ax in figure.axes:
            parts = {signal for signal, line in lines_of(figure, ax) if "." in signal}
            kinds = {signal.partition(".")[2] in angular for signal in parts}
            assert len(kinds) <= 1, (name, parts)
            for signal in {signal.partition(".")[0] for signal in parts} & set(units):
                unit = ax.get_ylabel().rpartition("[")[2].rstrip("]").lstrip("mµn" if kinds == {True} else "µn")
                assert unit.endswith(units[signal][kinds == {True}]), (name, ax.get_ylabel())
                assert "," not in unit
                seen.add((signal, *kinds))
    assert len(seen) == 6


def test_axes_have_labels_with_units_and_nothing_is_wider_than_its_column(drawn):
    for name in PAPER:
        figure = drawn[name]
        assert figure.get_figwidth() == (style.PAGE_IN if name == "overview" else style.COLUMN_IN)
        for ax in figure.axes:
            assert ax.get_ylabel().endswith("]"), name
        assert figure.axes[-1].get_xlabel() == "time [s]"


def test_small_numbers_are_read_in_small_units_and_the_data_stay_in_si(drawn, traces):
    ax = drawn["fig06"].axes[0]
    assert "µm/s" in ax.get_ylabel()
    texts = ax.yaxis.get_major_formatter().format_ticks(ax.get_yticks())
    assert [float(text.replace("\N{MINUS SIGN}", "-")) for text in texts] == pytest.approx(1e6 * ax.get_yticks())
    assert ax.dataLim.y0 == traces["fosm"].s_low[:, :3].min()


# Agreement with the recorded signals


FIGURES = {
    1: ("impedance", ("p_WB", "p_d")),
    2: ("impedance", ("s",)),
    3: ("impedance", ("tau",)),
    4: ("fosm", ("p_WB", "p_d")),
    5: ("fosm", ("push",)),
    6: ("fosm", ("s",)),
    7: ("fosm", ("tau",)),
    8: ("gsta", ("p_WB", "p_d")),
    9: ("gsta", ("push",)),
    10: ("gsta", ("s",)),
    11: ("gsta", ("tau",)),
    12: ("gsta", ("z",)),
}


@pytest.mark.parametrize("number", FIGURES)
def test_each_of_the_papers_figures_has_its_run_and_its_quantity(drawn, traces, number):
    run, quantities = FIGURES[number]
    ax = drawn[f"fig{number:02d}"].axes[0]
    expected = {q if q == "push" else f"{q}.{axis}" for q in quantities for axis in "xyz"}
    main = [(name, line) for name, line in lines_of(drawn[f"fig{number:02d}"], ax) if line.axes is ax]
    assert expected == {name for name, _ in main} - {"wall", "expected", "analytic"}
    for name, line in main:
        if name in expected:
            alone = number in (11, 12) and line.is_dashed()
            check_samples(line, traces["gsta_alone" if alone else run], name)


def check_samples(line, trace, name):
    """The line's points are samples and include the extremes of every block of 40 samples."""
    t, y = line.get_data()
    values = values_of(trace, name)
    rows = np.searchsorted(trace.t, t)
    assert np.array_equal(trace.t[rows], t)
    assert np.array_equal(values[rows], y)
    assert (t[0], t[-1]) == (trace.t[0], trace.t[-1])
    for start in range(0, len(values) - 80, 40):
        near = y[(rows >= start - 40) & (rows < start + 80)]
        assert near.min() <= values[start : start + 40].min()
        assert near.max() >= values[start : start + 40].max()


def test_with_nominal_control_is_solid_and_without_is_dashed(drawn, traces):
    for name, signal in (("fig11", "tau"), ("fig12", "z")):
        ax = drawn[name].axes[0]
        for axis in "xyz":
            pair = [line for each, line in lines_of(drawn[name], ax) if each == f"{signal}.{axis}" and line.axes is ax]
            assert [line.get_linestyle() for line in pair] == ["-", "--"]
            largest = [np.abs(line.get_ydata()).max() for line in pair]
            runs = [traces[run] for run in ("gsta", "gsta_alone")]
            assert largest == [np.abs(values_of(run, f"{signal}.{axis}")).max() for run in runs]
    texts = [text.get_text() for text in drawn["fig11"].legends[0].get_texts()]
    assert texts == ["x", "y", "z", "with nominal control", "without"]


def turns(values):
    """Number of reversals of a signal."""
    steps = np.diff(values)
    return int((steps[1:] * steps[:-1] < 0).sum())


def test_the_insets_of_tau_show_every_step_of_the_first_orders_chatter(drawn, fine, traces):
    until = round(figures.SWITCHING_S / 1e-4) + 1
    for name, run in (("fig07", "fosm"), ("fig11", "gsta")):
        shown = dict(reversed(lines_of(drawn[name], inset_of(drawn[name]))))
        for axis in "xyz":
            values = fine[run].tau[:until, "xyz".index(axis)]
            assert np.array_equal(shown[f"tau.{axis}"].get_ydata(), values)
            assert turns(shown[f"tau.{axis}"].get_ydata()) == turns(values)
    assert turns(fine["fosm"].tau[:until, 0]) > 80  # a period of two steps
    assert turns(fine["gsta"].tau[:until, 0]) < 5
    coarse = traces["fosm"].t <= figures.SWITCHING_S
    assert turns(traces["fosm"].tau[coarse, 0]) < 9


def test_impacts_and_rest_of_the_contact_force_can_both_be_read(drawn, traces):
    for name, run in (("fig05", "fosm"), ("fig09", "gsta")):
        figure, trace = drawn[name], traces[run]
        ax, rest = figure.axes[0], trace.analytic.force
        impacts, at_rest = ax.child_axes
        low, high = at_rest.get_ylim()
        assert ax.get_ylim()[0] < 0.0 < trace.push.max() < ax.get_ylim()[1]
        assert low < rest < 1.5 < high < 1.6
        levels = {signal: line.get_ydata()[0] for signal, line in lines_of(figure, at_rest)}
        assert levels["expected"] == pytest.approx(1.5)
        assert levels["analytic"] == pytest.approx(rest, rel=1e-5)
        first, last = impacts.get_xlim()
        gaps = trace.t[(trace.push <= 0.0) & (trace.t > trace.first_contact[-1])]
        assert first < trace.first_contact[-1] < gaps[-1] < last < 8.0
        (shown,) = [line for signal, line in lines_of(figure, impacts) if signal == "push"]
        inside = (trace.t >= first) & (trace.t <= last)
        assert shown.get_ydata().max() == trace.push[inside].max() == trace.push.max()
        touches = (np.diff((trace.push[inside] > 0.0).astype(int)) == 1).sum()
        assert (np.diff((shown.get_ydata() > 0.0).astype(int)) == 1).sum() == touches > 5


def test_a_window_of_the_impacts_alone_has_no_inset_of_a_rest(traces):
    """While the vehicle still rebounds, or has just ceased, nothing rests."""
    trace = traces["gsta"]
    last = trace.t[(trace.push <= 0.0) & (trace.t > trace.first_contact[-1])][-1]
    for end, rests in ((last - 0.05, False), (last + 0.5, False), (20.0, True)):
        (ax,) = figures.plot(trace.between(4.8, end), "force").axes
        assert ("at rest" in {each.get_title(loc="left") for each in ax.child_axes}) == rests


def test_a_height_is_the_height_of_the_figure(traces):
    for height, inches in (("60mm", 60.0 / 25.4), (3.0, 3.0), ("144.54pt", 2.0)):
        assert figures.plot(traces["gsta"], "force", height=height).get_figheight() == pytest.approx(inches)
    for height in ("column", "60", "0.5in", 50.0):
        with pytest.raises(InputError, match="height"):
            figures.plot(traces["gsta"], "force", height=height)
    with pytest.raises(InputError, match="too low for 2 rows"):
        figures.plot(traces, "tau", height="1in")


def test_the_window_of_the_impacts_comes_from_the_trace():
    t = np.linspace(0.0, 10.0, 10_001)
    bounces = np.where((t > 3.0) & (t < 4.0), np.maximum(0.0, np.sin(40.0 * (t - 3.0))), np.where(t >= 4.0, 0.7, 0.0))
    first, last = rebounds(t, bounces, bounces)
    gaps = t[(bounces <= 0.0) & (t > 3.05)]
    assert 2.9 < first < 3.0
    assert gaps[-1] < last < 4.6
    assert rebounds(t, np.minimum(bounces, 0.0), bounces) is None  # between two rows it leaves the wall until the end
    banded = np.minimum(bounces, np.r_[0.0, bounces[:-1]])
    assert rebounds(t, banded, bounces) == pytest.approx((first, last), abs=0.05)
    stays, bounces_on = np.where(t > 3.0, 1.0, 0.0), np.where(t > 3.0, 1.0 + np.sin(40.0 * t) - 0.5, 0.0)
    for push in (np.zeros_like(t), stays, bounces_on):
        assert rebounds(t, push, push) is None
    assert rebounds(t, np.r_[0.0, stays[:-1]], stays) is None  # the zero before the contact is no loss


@pytest.mark.parametrize(
    ("unit", "size", "scale"),
    [("m", 2e-3, (1e-3, "m")), ("m/s²", 2e-3, (1e-3, "m")), ("N m", 2e-6, (1e-6, "µ"))]
    + [(unit, 2e-3, (1e-3, "10⁻³ ")) for unit in ("", "1", "1/s", "m²", "m$^{1/2}$/s", "kg")],
)
def test_an_axis_has_a_prefix_if_its_unit_can_have_one(unit, size, scale):
    assert Panel("q", unit, lambda ax: None, size).scale == scale
    bare = unit in ("", "1")
    label = Panel("q", unit, lambda ax: None, size).label(scale[1])
    assert label == ("q [10⁻³]" if bare else f"q [{scale[1]}{unit}]")


@pytest.mark.parametrize(("law", "shown"), [("none", False), ("gsta", True)])
def test_a_vehicle_without_a_law_has_no_reference(law, shown):
    drift = simulate(Scenario.load("push_wall", {"simulation.duration": 0.1}, law))
    for runs in (drift, {"a": drift, "b": drift}):
        for what in ("position", "attitude"):
            lines = [line for ax in figures.plot(runs, what).axes for line in ax.lines]
            assert any(line.get_label() == "reference" for line in lines) == shown


def test_a_push_of_several_contacts_is_not_called_the_contact_force():
    """The sum of oblique normal forces is larger than the size of their sum, which the arrow of a video has."""
    pile, wall = (simulate(Scenario.load(each, {"simulation.duration": 6.0})) for each in ("press_pile", "push_wall"))
    net = np.linalg.norm(pile.f_contact_W[-1])
    assert pile.push[-1] > 1.1 * net > 0.0
    assert wall.push[-1] == np.linalg.norm(wall.f_contact_W[-1]) > 0.0
    assert [panels.force(each).quantity for each in (pile, wall)] == ["pushing force", "contact force"]


def test_two_vectors_of_three_have_a_panel_each():
    pile = simulate(Scenario.load("press_pile", {"simulation.duration": 0.1}))
    first, second = figures.plot(pile, "f_contacts_W").axes
    assert first.get_ylabel() == r"$f_{\mathrm{contacts,W,1}}$ [N]"
    assert second.get_ylabel() == r"$f_{\mathrm{contacts,W,2}}$ [N]"
    assert [line.get_label() for line in second.lines] == ["x", "y", "z"]
    both = figures.plot({"a": pile, "b": pile}, "f_contacts_W").axes
    assert [ax.get_ylabel() for ax in both][3:5] == [rf"$f_{{\mathrm{{contacts,W,2,{axis}}}}}$ [N]" for axis in "xy"]


def test_a_panel_shows_what_follows_a_transient_and_its_inset_the_transient(drawn, traces):
    """In fig. 10, s is of the order of mm/s for 50 ms and of um/s for the rest of the run."""
    trace, ax, inset = traces["gsta"], drawn["fig10"].axes[0], inset_of(drawn["fig10"])
    window = inset.get_xlim()[1]
    lows, highs = (edge[trace.t >= window, :3] for edge in trace.band("s"))
    low, high = ax.get_ylim()
    assert low < lows.min() < highs.max() < high
    assert high - low < 2.0 * (highs.max() - lows.min()) + 1e-9
    assert inset.get_ylim()[1] > trace.s[:, :3].max() > 100.0 * high
    own = dataclasses.replace(traces["gsta"].header.law, source="my.py:Mine")
    sources = {**trace.header.sources, "controller": own}
    mine = dataclasses.replace(trace, header=dataclasses.replace(trace.header, sources=sources))
    (first, _) = figures.plot({"mine": mine}, "sliding").axes
    assert first.child_axes[0].get_xlim() == inset.get_xlim()


def test_a_transient_is_found_where_there_is_one():
    t = np.linspace(0.0, 20.0, 20_001)
    decay = np.exp(-t / 0.01)[:, None]
    window = early(t, decay + 1e-3 * np.sin(t)[:, None])
    assert window in (0.1, 0.05)
    assert early(t, np.exp(-t / 5.0)[:, None]) == 0.0
    assert early(t, np.sin(t)[:, None]) == 0.0
    assert early(t, np.zeros((len(t), 3))) == 0.0


def test_the_force_that_is_expected_knows_a_force_reference():
    """Eq. (7) at a rigid wall against a value derived from GSTA's force at rest at a compliant wall."""
    impedance = {"impedance.K_f": [0.5, 1.0, 1.0, 1.0, 1.0, 1.0], "impedance.F_d": [-4.0, 0.0, 0.0, 0.0, 0.0, 0.0]}
    trace = simulate(Scenario.load("push_wall", impedance | {"simulation.duration": 1e-3}))
    levels = {name: line.get_ydata()[0] for name, line in lines_of(figures.plot({"gsta": trace}, "force"))}
    give = 0.5 / 150.0
    rigid = trace.analytic.force * (give + 1e-5) / give  # two springs in series; the wall's compliance is 1e-5 m/N
    assert levels["expected"] == pytest.approx(rigid, rel=1e-9)
    assert levels["expected"] == pytest.approx((0.01 + 4.0 * give) / give)


def test_positions_show_the_reference_and_how_far_from_the_wall_the_vehicle_rests(drawn):
    for name in ("fig01", "fig04", "fig08"):
        figure = drawn[name]
        shown = dict(lines_of(figure, inset_of(figure)))
        low, high = inset_of(figure).get_ylim()
        assert set(shown) == {"p_WB.x", "p_d.x", "wall"}
        assert list(shown["wall"].get_ydata()) == [1.0, 1.0]
        assert low < shown["p_WB.x"].get_ydata()[-1] < shown["p_d.x"].get_ydata()[-1] < high
    assert dict(lines_of(drawn["fig01"]))["p_WB.x"].get_ydata()[-1] == pytest.approx(0.9967, abs=1e-4)


@given(st.integers(1, 5000), st.integers(1, 700), st.integers(0, 2**32 - 1))
def test_thinning_keeps_the_extremes_of_every_column(n, columns, seed):
    values = np.random.default_rng(seed).normal(size=n)
    values[seed % n] = np.nan
    t = np.arange(n) * 1e-3
    few_t, few = thin(t, values, columns)
    assert len(few) <= 2 * columns + 2
    assert (np.diff(few_t) > 0).all()
    rows = np.searchsorted(t, few_t)
    assert np.array_equal(values[rows], few, equal_nan=True)
    assert {0, n - 1} <= set(rows)
    if len(few) == n:
        return
    width = -(-n // columns)
    for start in range(0, n, width):
        block = values[start : start + width]
        if np.isfinite(block).any():
            kept = values[rows[(rows >= start) & (rows < start + width)]]
            assert (np.nanmin(kept), np.nanmax(kept)) == (np.nanmin(block), np.nanmax(block))


# Any log


def test_a_users_states_are_drawn_whatever_their_sizes(drawn):
    trace = odd_run()
    figure = drawn["states of a user's law"]
    assert [ax.get_ylabel().partition(" [10")[0] for ax in figure.axes] == [
        *("state $\\xi$", "state $\\xi$", "state w_", "state four", "state many")
    ]
    linear, angular, w, four, many = ([line for _, line in lines_of(figure, ax)] for ax in figure.axes)
    xi = [*linear, *angular]
    assert (len(linear), len(angular), len(w), len(four), len(many)) == (3, 3, 1, 4, 2)
    assert len({line.get_color() for line in xi}) == 6
    for i, line in enumerate(xi):
        assert np.array_equal(line.get_ydata(), trace.xi[:, i])
    assert np.array_equal(many[1].get_ydata(), trace.many.max(axis=1))
    own = [[text.get_text() for text in ax.get_legend().get_texts()] for ax in figure.axes if ax.get_legend()]
    assert "range of the 40 numbers of many" in own[-1]  # a colour of four numbers is another one's of xi


def test_runs_lie_on_the_same_axes_each_in_the_colour_of_its_law_everywhere(drawn, traces):
    laws = [trace.header.law.source for trace in traces.values()]
    expected = {label: to_hex([c / 255 for c in rgb]) for label, rgb in zip(traces, colours.of_runs(laws), strict=True)}
    assert len(set(expected.values())) == 4
    for what in OF_FOUR:
        for ax in drawn[f"{what} of four"].axes:
            for signal, line in lines_of(drawn[f"{what} of four"], ax):
                if line.get_label() in expected:
                    assert to_hex(line.get_color()) == expected[line.get_label()], (what, signal)
    force = drawn["force of four"]
    assert [line.get_label() for s, line in lines_of(force, force.axes[0]) if s == "push"][:4] == list(traces)


def test_every_run_can_be_seen_beside_one_that_is_a_thousand_times_as_large(traces):
    """Every line stays inside its axes and is visibly different from zero."""
    gsta = traces["gsta"]
    names = ("tau", "f_contact_W", *BAND["tau"], *BAND["push"])
    loud = dataclasses.replace(gsta, arrays={**gsta.arrays, **{name: 1e3 * gsta[name] for name in names}})
    runs = {"loud": loud, "quiet": gsta}
    for what in ("tau", "force"):
        for ax in figures.plot(runs, what).axes:
            for signal, line in lines_of(ax.figure, ax):
                if line.axes is not ax or line.get_label() not in runs:
                    continue
                y = (ax.transData - ax.transAxes).transform(line.get_xydata())[:, 1]
                assert y.min() >= 0.0, signal
                assert y.max() <= 1.0, signal
                if np.abs(line.get_ydata()).max() > 1e-3:
                    zero = (ax.transData - ax.transAxes).transform((0.0, 0.0))[1]
                    assert np.abs(y - zero).max() > 0.08, (signal, line.get_label())
            if ax.get_yscale() == "symlog":
                assert "log beyond" in ax.get_title(loc="right")


def test_a_run_that_diverged_is_drawn_with_others(traces, tmp_path):
    gsta = traces["gsta"]
    wild = {name: np.array(values) for name, values in gsta.arrays.items()}
    growth = np.geomspace(1.0, 1e200, len(gsta))
    for name in ("tau", "s", "p_WB", "f_contact_W", "z"):
        wild[name] *= growth[:, None]
        wild[name][-3:] = np.nan
    wild = dataclasses.replace(gsta, arrays=wild)
    figures.save(figures.plot({"wild": wild}, "summary"), tmp_path / "alone", ("png",))
    for what in ("position", "force", "tau"):
        FigureCanvasAgg(figures.plot({"wild": wild, "tame": gsta}, what)).draw()


def test_a_range_holds_every_runs_rest(drawn, traces):
    for what in ("force", "sliding", "tau", "position"):
        for ax in drawn[f"{what} of four"].axes:
            low, high = ax.get_ylim()
            for signal, line in lines_of(ax.figure, ax):
                if line.get_label() in traces and line.axes is ax:
                    assert low <= line.get_ydata()[-1] <= high, (what, signal)


def test_a_figure_of_many_runs_is_as_large_as_one_of_few(drawn, traces):
    few, twenty = drawn["tau of four"], drawn["tau of twenty of four"]
    assert tuple(twenty.get_size_inches()) == tuple(few.get_size_inches())
    assert twenty.get_size_inches()[1] < 16.0
    names = [text.get_text() for text in twenty.legends[0].get_texts()]
    assert len([name for name in names if name.startswith("...")]) == 20
    assert all(len(name) <= 34 for name in names)
    crowd = figures.plot(many(traces, 60), "force")
    names = [text.get_text() for text in crowd.legends[0].get_texts()]
    of_laws = [name for name in names if name.endswith("runs)") and not name.startswith("analytic")]
    assert sorted(of_laws) == ["fosm (15 runs)", "gsta (30 runs)", "impedance (15 runs)"]


def test_what_is_wrong_is_said(traces, fine):
    with pytest.raises(InputError, match="did you mean 'sliding'"):
        figures.plot(traces, "slidng")
    with pytest.raises(InputError, match="give several by name"):
        figures.plot([*traces.values()])
    with pytest.raises(InputError, match="fosm: its law has no integral term"):
        figures.plot({"fosm": traces["fosm"]}, "integral")
    with pytest.raises(InputError, match="impedance, fosm: no law has an integral term"):
        figures.plot({"impedance": traces["impedance"], "fosm": traces["fosm"]}, "integral")
    nothing = dataclasses.replace(traces["gsta"], arrays={"t": np.empty(0)})
    with pytest.raises(InputError, match="gsta: has fewer than two samples"):
        figures.plot({"gsta": nothing}, "tau")
    with pytest.raises(InputError, match="traces: fosm is missing"):
        figures.paper({name: trace for name, trace in traces.items() if name != "fosm"}, fine)
    with pytest.raises(InputError, match="gsta is not at every step"):
        figures.paper(traces, fine | {"gsta": traces["gsta"]})
    shorter = simulate(Scenario.load("push_wall", {"simulation.duration": 0.005}), log_rate="full")
    with pytest.raises(InputError, match=r"gsta ends at 0.005 s; it must last at least 0.01 s"):
        figures.paper(traces, fine | {"gsta": shorter})
    with pytest.raises(InputError, match="no log"):
        figures.plot({}, "tau")


def test_the_legend_says_whose_each_expected_force_is(traces):
    """Of runs that rest at different forces, each line has another name and other dashes, also in the inset."""
    other = simulate(
        Scenario.load("push_wall", {"simulation.duration": 7.0, "wall.stiffness": 2e3}), engine="free_body"
    )
    runs = {"soft": other, "hard": traces["gsta"], "first": traces["fosm"]}
    dashes: dict[str, set[str]] = {}
    figure = figures.plot(runs, "force")
    for ax in (figure.axes[0], *figure.axes[0].child_axes):
        drawn = [line for line in ax.lines if str(line.get_gid()).startswith("analytic")]
        if not drawn:
            continue
        found = {line.get_label().partition(" (")[2].rstrip(")"): line for line in drawn}
        assert set(found) == {"hard", "soft", "first"} if ax is figure.axes[0] else {"hard", "first"}
        dashes |= {name: dashes.get(name, set()) | {str(line._unscaled_dash_pattern)} for name, line in found.items()}
        for name, line in found.items():
            assert line.get_ydata() == pytest.approx([runs[name].analytic.force] * 2, rel=1e-6)
    assert all(len(each) == 1 for each in dashes.values()), "the inset has other dashes"
    assert len({*itertools.chain(*dashes.values())}) == 3
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert len(set(texts)) == len(texts) == 3 + len({t for t in texts if t.startswith(("expected", "analytic"))})
    alike = figures.plot({"a": traces["gsta"], "b": traces["gsta_alone"]}, "force")
    texts = [text.get_text() for text in alike.legends[0].get_texts()]
    assert texts.count("analytic, at rest at this wall") == 1


def test_a_law_without_the_impedance_task_has_no_sliding_variable_to_draw(traces):
    less = without(traces["gsta"], *TASK)
    for runs in ({"a": less}, {"a": less, "b": less}):
        summary = {name for name, _ in lines_of(figures.plot(runs, "summary"))}
        assert {"p_WB.x", "push", "tau.x", "z.x"} <= summary
        assert "s.x" not in summary
        with pytest.raises(InputError, match=r"a: its law has no sliding variable; draw|a, b: no law has a sliding"):
            figures.plot(runs, "sliding")
    both = figures.plot({"with": traces["gsta"], "without": less}, "sliding")
    assert [name for name, _ in lines_of(both)] == [f"s.{axis}" for axis in AXES]


def test_a_law_without_the_impedance_task_has_no_expected_force(traces):
    with_task, without_task = traces["gsta"], without(traces["gsta"], *TASK)
    assert {"expected", "analytic"} <= {name for name, _ in lines_of(figures.plot({"a": with_task}, "force"))}
    assert "expected" not in {name for name, _ in lines_of(figures.plot({"a": without_task}, "force"))}


def test_the_states_of_every_stage_are_drawn_and_a_single_number_has_a_plain_name():
    stages = Path(__file__).parents[1] / "data" / "users_stages.py"
    sources = {"navigation.name": f"{stages}:Noisy", "reference.name": f"{stages}:Circle"}
    trace = simulate(Scenario.load("push_wall", sources | {"simulation.duration": 0.01}))
    names = {name for name, _ in lines_of(figures.plot({"a": trace}, "integral"))}
    assert {"z.x", "drift.x", "phase"} < names
    assert "phase" in trace.to_dataframe()
    both = {name for name, _ in lines_of(figures.plot({"a": trace, "b": trace}, "integral"))}
    assert {"z.x", "drift.x", "phase"} < both


def test_an_inset_gets_some_room_and_is_left_out_where_that_is_not_enough(traces, rng):
    n = 20_000
    header = dataclasses.replace(traces["gsta"].header, row_steps=1)

    def drawn(highest):
        """A panel filled with lines, first up to 1 and later up to ``highest``."""
        tau = rng.uniform(-1.0, 1.0, size=(n, 6))
        tau[n // 4 :] = rng.uniform(-1.0, highest, size=(n - n // 4, 6))
        arrays = MappingProxyType({"t": np.arange(n) * 1e-4, "tau": tau})
        full = dataclasses.replace(traces["gsta"], header=header, arrays=arrays)
        return figures.plot({"full": full}, "tau").axes[0]

    for highest, top in ((-0.5, 1.2), (0.1, 2.2)):
        ax = drawn(highest)
        (inset,) = ax.child_axes
        assert inset.get_xlim() == (0.0, figures.SWITCHING_S)
        assert 1.0 < ax.get_ylim()[1] < top
    assert drawn(0.1).get_ylim()[1] > 1.2
    full = drawn(1.0)
    assert not full.child_axes
    assert full.get_ylim()[1] < 1.2


# Files


def test_the_same_figure_gives_the_same_files_whatever_the_users_settings(traces, tmp_path):
    def files(name):
        (tmp_path / name).mkdir()
        figure = figures.plot({"gsta": traces["gsta"]}, "force")
        return [
            path.read_bytes() for path in figures.save(figure, tmp_path / name / "v1.force", FORMATS[:3])
        ]  # .pgf needs a LaTeX

    ours = files("a")
    with mpl.rc_context({"font.size": 20, "lines.linewidth": 9, "svg.fonttype": "path", "svg.hashsalt": None}):
        assert files("b") == ours
    assert sorted(path.name for path in (tmp_path / "b").iterdir()) == ["v1.force.pdf", "v1.force.png", "v1.force.svg"]
    svg = ours[FORMATS.index("svg")].decode()
    assert ">time [s]</text>" in svg
    assert "date" not in svg
    ids = [part.split('"')[0] for part in svg.split(' id="')[1:]]
    assert len(ids) == len(set(ids))


@given(st.integers(2, 3000), st.integers(1, 400), st.integers(0, 2**32 - 1))
def test_a_thinned_band_keeps_the_extremes_of_every_column(n, columns, seed):
    rng = np.random.default_rng(seed)
    t, high = np.arange(n) * 1e-3, rng.normal(size=n)
    low = high - rng.random(n)
    few_t, few_low, few_high = thin_band(t, low, high, columns)
    assert len(few_t) <= columns + 1
    rows = np.searchsorted(t, few_t)
    starts = np.concatenate([[0], rows[:-1] + 1])
    assert rows[-1] == n - 1
    assert np.array_equal(few_low, [low[a : b + 1].min() for a, b in zip(starts, rows, strict=True)])
    assert np.array_equal(few_high, [high[a : b + 1].max() for a, b in zip(starts, rows, strict=True)])


def test_a_figure_of_a_slow_log_reaches_as_far_as_one_of_every_step():
    """GSTA's s and tau alternate at every step: a line through every hundredth step is flat."""
    scenario = Scenario.load("push_wall", {"simulation.duration": 3.0})
    full, slow = (simulate(scenario, engine="free_body", log_rate=rate) for rate in ("full", 100))
    for what in ("tau", "sliding"):
        (every, of_slow) = (figures.plot({"gsta": trace}, what) for trace in (full, slow))
        for expected, ax in zip(every.axes, of_slow.axes, strict=True):
            if what == "sliding":  # without the transient
                assert ax.get_ylim() == pytest.approx(expected.get_ylim(), rel=0.3)
            else:
                assert tuple(ax.dataLim.intervaly) == pytest.approx(tuple(expected.dataLim.intervaly), rel=1e-12)
    late = slow.t > 2.0
    low, high = slow.band("s")
    area = next(each for each in of_slow.axes[0].collections if each.get_gid().startswith("s.z.band"))
    shown = area.get_paths()[0].vertices
    reach = high[late, 2].max() - low[late, 2].min()
    assert np.ptp(shown[shown[:, 0] > 2.0, 1]) == reach > 1e3 * np.ptp(slow.s[late, 2])
    entries = [text.get_text() for text in of_slow.legends[0].get_texts()]
    assert "range between rows" in entries
    assert "range between rows" not in [text.get_text() for text in every.legends[0].get_texts()]
