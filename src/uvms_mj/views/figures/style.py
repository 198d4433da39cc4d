"""Style, colours and sizes of all figures, lines that are thinned without loss of extremes, and reproducible files."""

import contextlib
import io
import itertools
import logging
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backend_bases import RendererBase
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure as _Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator, ScalarFormatter

from ...errors import InputError, suggestion
from ...files import atomic_write
from ...stages.signals import AXES

STYLE = Path(__file__).with_name("uvms_mj.mplstyle")
"""Style file with fonts, widths and colours."""
PT_IN = 72.27
"""Points of TeX in an inch."""
COLUMN_IN, PAGE_IN = 252.0 / PT_IN, 516.0 / PT_IN
"""Width of one column and of two columns of a paper, as the class IEEEtran has them [in]. A wider figure would be an
overfull box."""
WIDTHS = {
    "column": COLUMN_IN,
    "page": PAGE_IN,
    "ieee-column": COLUMN_IN,
    "ieee-page": PAGE_IN,
    "elsevier-column": 90.0 / 25.4,
    "elsevier-middle": 140.0 / 25.4,
    "elsevier-page": 190.0 / 25.4,
}
"""Widths by name [in]: IEEE's, which are also the widths of any paper with two columns, and Elsevier's, which has one
of 1.5 columns."""
_LENGTH = re.compile(r"\s*(\d+\.?\d*|\.\d+)\s*(in|cm|mm|pt)\s*")
_UNITS_IN = {"in": 1.0, "cm": 1.0 / 2.54, "mm": 1.0 / 25.4, "pt": 1.0 / PT_IN}
"""Units of a width [in]."""
_NARROWEST_IN, _WIDEST_IN = 1.0, 40.0
FONTS: dict[str, Any] = {
    "sans": {},
    "serif": {"font.family": ["STIXGeneral", "DejaVu Sans"], "mathtext.fontset": "stix"},
    "cm": {
        "font.family": ["cmr10", "DejaVu Serif"],
        "mathtext.fontset": "cm",
        "axes.formatter.use_mathtext": True,  # cmr10 has no minus sign
    },
}
"""Fonts by name: the style file's, Times as STIX has it, Computer Modern."""
FONTS["latex"] = FONTS["cm"]  # to lay the figure out; LaTeX sets its texts when it is written
_fonts: ContextVar[str] = ContextVar("fonts", default="sans")
_width: ContextVar[float] = ContextVar("width", default=PAGE_IN)
_PANEL_IN = 1.7
"""Least width of a panel beside others [in]."""
SMALL = 6.0
"""Size of the text in an inset [pt]."""
BLACK, GREY = "#000000", "#777777"
"""Colours of references and expected values, and of the wall."""

_CYCLE = mpl.rc_params_from_file(STYLE, use_default_template=False)["axes.prop_cycle"].by_key()["color"]
COLOURS = dict(zip((*AXES[:3], "force", *AXES[3:]), _CYCLE, strict=True))
"""Colours of the components and of the contact force, the same in every figure."""
JOINTS = ("#332288", "#999933", "#882255", "#DDCC77", "#117733", "#661100", "#5A3FD0")
"""Colours of the joints in their order. Colour-blind readers can tell them from each other and from the components, and
neighbours differ in grey. Most are of Tol's muted scheme."""
LINE = 1.0
"""Width of every line of samples [pt], so that no line dominates."""
_PERIOD, _STRIPE, _MOST_STRIPES = 7.0, 2.5, 6
"""Length of a dash pattern and least length of one line's stripe in it, in line widths; number of distinct patterns."""
BAND: dict[str, Any] = {"step": "pre", "alpha": 0.35, "linewidth": 0.0, "zorder": 1.8}
"""Look of the range between two rows: below all lines, in the colour of its line."""
_UNSEEN = 1e-3
"""A band that exceeds its line by less than this fraction of the line's usual range is narrower than a pixel."""
_SEEN = 5e-3
"""A band that exceeds its line by this fraction of its panel, in one of a hundred rows, needs a legend."""
_BEYOND: WeakKeyDictionary[Artist, float] = WeakKeyDictionary()
"""How far a band exceeds its line in one of a hundred rows."""
PIXELS_PER_INCH = 300
"""Resolution for which lines are thinned."""

_METADATA: dict[str, dict[str, Any]] = {
    "png": {"metadata": {"Software": None}},
    "svg": {"metadata": {"Date": None}},
    "pdf": {"metadata": {"CreationDate": None}},
    "pgf": {},
}
FORMATS = tuple(_METADATA)


class Figure(_Figure):
    """matplotlib's figure, which a notebook shows even if nothing has imported pyplot. pyplot does not keep it open.

    It is written in the style and the fonts in which it was drawn, whatever the user's settings are.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._set_in = _fonts.get()

    def savefig(self, fname: Any, *, format: str | None = None, rc: Any = None, **options: Any) -> None:
        """Write the figure, as matplotlib does, with further settings ``rc`` of matplotlib. LaTeX sets the texts of a
        .pgf, and of a .pdf with the fonts "latex".

        Raises InputError without a LaTeX where one is needed, and for a picture of pixels or an SVG with the fonts
        "latex".
        """
        name = os.fspath(fname) if isinstance(fname, str | os.PathLike) else ""
        kind = format or Path(str(name)).suffix.lower().removeprefix(".") or "png"
        by_latex = kind == "pgf" or self._set_in == "latex"
        if by_latex and kind not in ("pgf", "pdf"):
            raise InputError(f"a .{kind} can't have the fonts 'latex'; write a .pdf or .pgf, or choose 'cm' or 'serif'")
        if by_latex:
            options["backend"] = "pgf"
        latex = _in_latex(self) if by_latex else contextlib.nullcontext()
        bands = [area for area in self.findobj(PolyCollection) if by_latex and kind == "pdf"]
        with styled(self._set_in), mpl.rc_context(rc), latex, _rasterized(bands), _without_words_of_fonts():
            super().savefig(fname, format=kind, **(_METADATA.get(kind, {}) | options))

    def draw(self, renderer: Any) -> None:
        """Draw the figure. A figure that is written is drawn twice by matplotlib: first for its layout alone, without
        output, and then without its layout engine. The first time, only the layout is made here."""
        engine, without_output = self.get_layout_engine(), _is_disabled(renderer)
        if self.canvas.is_saving() and without_output and isinstance(engine, ConstrainedLayoutEngine):
            with contextlib.suppress(ValueError):  # as matplotlib does
                engine.execute(self)
        else:
            super().draw(renderer)

    def _repr_png_(self) -> bytes:
        file, kept = io.BytesIO(), self._set_in
        try:
            self._set_in = "cm" if kept == "latex" else kept
            self.savefig(file, format="png", dpi=self.dpi)
        finally:
            self._set_in = kept
        return file.getvalue()


def _is_disabled(renderer: Any) -> bool:
    """Whether matplotlib draws for the layout alone: then its renderer has functions without effect in place of its
    own. Another version that does it otherwise draws the whole figure."""
    return getattr(getattr(renderer, "draw_path", None), "__wrapped__", None) is RendererBase.draw_path


def stripe(i: int, n: int) -> dict[str, Any]:
    """Line style of line i of n. Where lines coincide, each remains visible as a stripe of its colour.

    The first line is solid and drawn first. Each later line is drawn above it with shorter dashes than the line before,
    down to half of the pattern.
    """
    shown = min(n, _MOST_STRIPES)
    period = max(_PERIOD, _STRIPE * shown)
    gap = 0.5 * period * (i % shown) / max(1, shown - 1)
    dashes = (0.0, (period - gap, gap)) if gap else "solid"
    return {"linewidth": LINE, "linestyle": dashes, "zorder": 2.0 + 0.01 * i}


def thin(t: np.ndarray, values: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """The least and the greatest sample of each pixel column, with their own times, and the first and last sample.

    From times (n,) and values (n,), these are at most 2 columns + 2 samples; all samples if there are no more.
    """
    n = len(t)
    if n <= 2 * columns + 2:
        return t, values
    width = -(-n // columns)
    at = np.minimum(np.arange(-(-n // width) * width), n - 1).reshape(-1, width)
    blocks = values[at]
    finite = np.isfinite(blocks)
    low = np.where(finite, blocks, np.inf).argmin(axis=1)
    high = np.where(finite, blocks, -np.inf).argmax(axis=1)
    rows = np.arange(len(at))
    kept = np.unique(np.concatenate([[0], at[rows, low], at[rows, high], [n - 1]]))
    return t[kept], values[kept]


def beyond(values: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """How far a band (n,) exceeds the line through the samples (n,); zero where it does not.

    Row k of the band is for the time from row k - 1 to row k. The line crosses this time from sample to sample.
    """
    before = np.concatenate([values[:1], values[:-1]])
    with np.errstate(invalid="ignore"):
        found = np.maximum(high - np.maximum(before, values), np.minimum(before, values) - low)
    return np.where(found > 0.0, found, 0.0)


def thin_band(
    t: np.ndarray, low: np.ndarray, high: np.ndarray, columns: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, least and greatest value of each pixel column of a band (n,), all without loss of extremes."""
    n = len(t)
    starts = np.arange(1, n, max(1, -(-n // columns)))  # the band begins at the first sample, and a block after it
    ends = np.concatenate([[0], starts[1:] - 1, [n - 1]])
    starts = np.concatenate([[0], starts])
    return t[ends], np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)


def panels(n: int, columns: int, top: float, height: float, **how: Any) -> tuple[Figure, list[Axes]]:
    """A figure as wide as a page, or as :func:`typeset` says, with n panels in rows of at most ``columns``, fewer in a
    narrow figure, and its panels. A row has this height [in], the space above the rows is ``top`` [in], and ``how`` is
    as for ``Figure.subplots``."""
    width = _width.get()
    columns = max(1, min(n, columns, int(width / _PANEL_IN)))
    rows = -(-n // columns)
    figure = Figure(figsize=(width, top + height * rows))
    axes = list(figure.subplots(rows, columns, squeeze=False, **how).flat)
    for ax in axes[n:]:
        ax.remove()
    return figure, axes[:n]


def keys(colours: Mapping[str, str]) -> list[Line2D]:
    """The handles of a legend, each a line in a colour beside its name."""
    return [Line2D([], [], color=colour, linewidth=2.0 * LINE, label=name) for name, colour in colours.items()]


ABOVE: dict[str, Any] = {"loc": "outside upper center", "fontsize": SMALL, "frameon": False}
"""Look of a small legend above all panels."""


def size_in(ax: Axes) -> tuple[float, float]:
    """Width and height of an axes [in]; approximate before the layout is computed."""
    figure, box = ax.get_figure(root=True), ax.get_position()
    assert figure is not None
    return figure.get_figwidth() * box.width, figure.get_figheight() * box.height


def _gaps(t: np.ndarray) -> np.ndarray:
    """The samples behind which there is a gap: the next one is much later than usually. A run has none."""
    apart = np.diff(t)
    return np.flatnonzero(apart > 2.5 * np.median(apart)) if len(apart) > 1 else np.zeros(0, int)


def line(
    ax: Axes,
    t: np.ndarray,
    values: np.ndarray,
    name: str,
    band: tuple[np.ndarray, np.ndarray] | None = None,
    **look: Any,
) -> None:
    """Draw samples (n,) as one line, above the area from the least to the largest value since the sample before, if
    their ``band`` is given. ``name`` is the line's group id in an SVG."""
    columns = max(100, round(size_in(ax)[0] * PIXELS_PER_INCH))
    if len(gaps := _gaps(t)):
        ends = [0, *(gaps + 1).tolist(), len(t)]
        for i, (a, b) in enumerate(itertools.pairwise(ends)):
            part = None if band is None else (band[0][a:b], band[1][a:b])
            line(ax, t[a:b], values[a:b], name, part, **(look if i == 0 else look | {"label": None}))
        return
    (drawn,) = ax.plot(*thin(t, values, columns), gid=name, **look)
    low, high = (values, values) if band is None else band
    further = beyond(values, low, high)
    finite = values[np.isfinite(values)]
    if not len(finite) or not further.max() > _UNSEEN * np.ptp(np.percentile(finite, [1.0, 99.0])):
        return
    low, high = (np.where(further > 0.0, edge, values) for edge in (low, high))
    area = ax.fill_between(*thin_band(t, low, high, columns), gid=f"{name}.band", color=drawn.get_color(), **BAND)
    _BEYOND[area] = float(np.percentile(further, 99.0))


def band_handles(axes: Sequence[Axes]) -> list[Patch]:
    """Legend entry of the bands, if some band can be seen beside its line on linear axes, or is on others."""
    for ax in axes:
        low, high = ax.get_ylim()
        seen = _SEEN * (high - low) if ax.get_yscale() == "linear" else 0.0
        if any(_BEYOND.get(area, 0.0) > seen for area in ax.collections):
            return [Patch(facecolor=GREY, alpha=BAND["alpha"], linewidth=0.0, label="range between rows")]
    return []


def ticks(ax: Axes, most: int) -> None:
    """Set at most ``most`` intervals with round numbers on both axes."""
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))


@contextlib.contextmanager
def styled(fonts: str | None = None) -> Iterator[None]:
    """A context with the settings of the style file and matplotlib's defaults, independent of the user's settings, and
    with fonts of :data:`FONTS`; default: the fonts of :func:`typeset`."""
    with mpl.rc_context(fname=STYLE), mpl.rc_context(FONTS[fonts or _fonts.get()]):
        yield


@contextlib.contextmanager
def typeset(fonts: str, width: float = PAGE_IN) -> Iterator[None]:
    """A context in which figures are drawn in these fonts, one of :data:`FONTS`, and figures of :func:`panels` in a
    width [in]. Raises InputError for other fonts."""
    if fonts not in FONTS:
        raise InputError(f"fonts {fonts!r}: {suggestion(fonts, FONTS)}")
    tokens = _fonts.set(fonts), _width.set(width)
    try:
        yield
    finally:
        _fonts.reset(tokens[0])
        _width.reset(tokens[1])


def width_of(given: str | float | None, default: float) -> float:
    """A width in inches: a number, a name of :data:`WIDTHS`, or a length with its unit, ``"88mm"``, in in, cm, mm or
    points of TeX, pt. Raises InputError for others."""
    return default if given is None else _length("width", given, WIDTHS)


def height_of(given: str | float | None, default: float) -> float:
    """A height in inches: a number, or a length with its unit as of :func:`width_of`. Raises InputError for others."""
    return default if given is None else _length("height", given, {})


def _length(what: str, given: str | float, names: Mapping[str, float]) -> float:
    said = f"{given:g}" if isinstance(given, float | int) else repr(given)
    long = names.get(given) if isinstance(given, str) else float(given)
    if long is None:
        found = _LENGTH.fullmatch(str(given))
        if found is None:
            lengths = f"a length with its unit, in, cm, mm or pt ({PT_IN:g} pt are an inch): 88mm"
            choices = f"{suggestion(str(given), names)}, or {lengths}" if names else f"is not {lengths}"
            raise InputError(f"{what} {said}: {choices}")
        long = float(found[1]) * _UNITS_IN[found[2]]
    if not _NARROWEST_IN <= long <= _WIDEST_IN:
        raise InputError(f"{what} {said}: must be from {_NARROWEST_IN:g} to {_WIDEST_IN:g} inches")
    return long


_POWER = re.compile(r"\^(?:\(([-\d/]+)\)|(-?\d+))")
"""A power in a unit, s^2 or m^(1/2)."""
_GREEK = (
    *("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "kappa", "lambda", "mu", "nu", "xi", "rho"),
    *("sigma", "tau", "phi", "chi", "psi", "omega"),
)
_SYMBOL = re.compile(rf"({'|'.join(_GREEK)}|[A-Za-z])((?:_[A-Za-z0-9]+)*)")
"""The name of a signal that is a symbol with subscripts: nu, p_WB, tau_q_cmd."""
_WORDS = re.compile(r"(.+?)((?:_(?:[A-Z]+\d*|[a-z]))*)")
"""The name of a signal that is words with subscripts: wave_head, wrench_m_S."""
_ABOVE = {"dot": r"\dot{%s}", "hat": r"\hat{%s}", "ddot": r"\ddot{%s}"}


def unit_text(unit: str) -> str:
    """A unit as it is typeset: powers are raised, and us are µs."""
    raised = {"2": "²", "3": "³"}
    unit = _POWER.sub(lambda found: raised.get(found[2], f"$^{{{found[1] or found[2]}}}$"), unit)
    return re.sub(r"\bus\b", "µs", unit)


def symbol(name: str, component: str = "") -> str:
    """The name of a signal as it is typeset: a symbol or words, with their subscripts, of which the component is the
    last. It stands behind words that have none: ``contact depths 2``."""
    of_symbol, of_words = _SYMBOL.fullmatch(name), _WORDS.fullmatch(name)
    found = of_symbol or of_words
    if found is None:
        return name
    stem, below = found[1], found[2].split("_")[1:]
    if of_symbol:
        stem = stem if len(stem) == 1 else f"\\{stem}"
        for word in [each for each in below if each in _ABOVE]:
            below.remove(word)
            stem = _ABOVE[word] % stem
    behind = component.replace("_", " ")
    if component.replace(",", "").isalnum() and (of_symbol or below):
        below, behind = [*below, component], ""
    under = f"_{{\\mathrm{{{','.join(below)}}}}}" if below else ""
    words = re.sub("(?<=.)_(?=.)", " ", stem) + (f"${under}$" if under else "")
    text = f"${stem}{under}$" if of_symbol else words
    return f"{text} {behind}" if behind else text


def titled(place: str, unit: str = "", text: str = "") -> str:
    """The label of an axis for a key or a metric by its place, in words, ``wall stiffness [N/m]``, whose last one is
    typeset if it is a symbol: ``controller.k_1`` ends with k₁. A text of a user's own stands as it is."""
    words, component = place.split("."), []
    while len(words) > 1 and (words[-1] in AXES or words[-1].isdigit()):
        component.insert(0, words.pop())
    last = symbol(words[-1], "".join(component))
    if last.startswith("$"):
        words, component = [*words[:-1], last], []
    text = text or " ".join([each if each.startswith("$") else each.replace("_", " ") for each in words] + component)
    return f"{text} [{unit_text(unit)}]" if unit else text


_MATHS = {
    "τ": r"$\tau$",
    "²": "$^2$",
    "³": "$^3$",
    "⁶": "$^6$",
    "⁹": "$^9$",
    "⁻": "$^-$",
    "·": r"$\cdot$",
    "±": r"$\pm$",
    "µ": r"$\mu$",
    "&": r"\&",
    "#": r"\#",
}
"""LaTeX of the characters in texts of figures that its fonts may lack."""


_LATEX_ON_DEBIAN = (
    "On Debian or Ubuntu, as root: apt install texlive-latex-recommended texlive-pictures texlive-fonts-recommended"
)


@contextlib.contextmanager
def _without_words_of_fonts() -> Iterator[None]:
    """A context in which fontTools says nothing about the dates in matplotlib's own fonts."""
    logger = logging.getLogger("fontTools")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


@contextlib.contextmanager
def _rasterized(areas: Sequence[Artist]) -> Iterator[None]:
    """A context in which areas are pixels: LaTeX would take half a minute for the edges of a band."""
    kept = [area.get_rasterized() for area in areas]
    try:
        for area in areas:
            area.set_rasterized(True)
        yield
    finally:
        for area, each in zip(areas, kept, strict=True):
            area.set_rasterized(each)


@contextlib.contextmanager
def _in_latex(figure: Figure) -> Iterator[None]:
    """A context in which a figure's texts are LaTeX, in the fonts of the document. Raises InputError without a LaTeX,
    which measures them."""
    system = next((name for name in ("pdflatex", "xelatex", "lualatex") if shutil.which(name)), None)
    if system is None:
        raise InputError(
            "LaTeX's fonts and a .pgf need pdflatex, xelatex or lualatex, to measure the texts; a .pdf in other fonts "
            f"needs none. {_LATEX_ON_DEBIAN}"
        )
    texts = [(text, text.get_text()) for text in figure.findobj(Text)]
    axes = [axis.get_major_formatter() for axis in figure.findobj(Axis)]
    numbers = [each for each in axes if isinstance(each, ScalarFormatter) and each.get_useMathText()]
    with mpl.rc_context({"pgf.texsystem": system, "pgf.rcfonts": False}):
        try:
            for each in numbers:  # as mathtext they have a macro of matplotlib's
                each.set_useMathText(False)
            for text, written in texts:
                text.set_text("".join(_MATHS.get(letter, letter) for letter in written))
            yield
        except RuntimeError as error:  # LaTeX's own
            said = re.search(r"^! *(?:LaTeX Error: )?(.+)", str(error), re.MULTILINE)  # the rest is LaTeX's log
            why = " ".join((said[1] if said else str(error)).split())
            remedy = f" {_LATEX_ON_DEBIAN}" if "not found" in why else ""
            raise InputError(f"{system} can't set the texts of the figure: {why}{remedy}") from None
        finally:
            for text, written in texts:
                text.set_text(written)
            for each in numbers:
                each.set_useMathText(True)


def save(figure: Figure, path: str | os.PathLike, formats: Sequence[str] = ("png", "svg")) -> list[Path]:
    """Write a figure to files, and return them in the order of ``formats``, some of :data:`FORMATS`. The path has no
    suffix. The same figure gives the same bytes. Existing files are replaced atomically. Raises InputError if a file
    can't be written."""
    stem = Path(path)
    files = [stem.with_name(f"{stem.name}.{kind}") for kind in formats]
    for file, kind in zip(files, formats, strict=True):
        drawn = io.BytesIO()  # on a full disk matplotlib's PDF writer fails a second time in closing the file
        figure.savefig(drawn, format=kind)
        with atomic_write(file) as part:
            part.write_bytes(drawn.getvalue())
    return files
