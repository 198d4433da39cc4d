"""The table of a study for a paper: numbers of the rows, units in the heads, texts that LaTeX takes, figures."""

import io
import re
import shutil
import subprocess
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from short_study import HERE
from uvms_mj import InputError, Study
from uvms_mj.analysis.hold import HOLD_S
from uvms_mj.analysis.summary import NUMBERS
from uvms_mj.studies.report.data import StudyRows
from uvms_mj.studies.report.figures import distribution
from uvms_mj.studies.report.latex import Column, LatexTable, Stacked, latex, ranged
from uvms_mj.studies.report.tables import comparison, printed, statistics, to_csv
from uvms_mj.views.figures.style import panels

METRICS = ("contact.peak_N", "effort_N2s", "final.position_m.x")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    tables = {
        "name": "a_b",
        "base": {"scenario": "push_wall", "simulation": {"duration": 0.1}, "wall": {"position": 0.001}},
        "laws": ["impedance", {"name": "gsta", "label": "gsta_2 & 50 % #1"}],
        "vary": [{"key": "current.speed", "low": 0.1, "high": 0.5, "number": 5}],
    }
    return Study.from_dict(tables).run(tmp_path_factory.mktemp("study") / "small", executor=HERE)


def test_the_numbers_are_those_of_the_rows(study):
    found, frame = study.statistics(METRICS), study.frame
    for law, label in (("impedance", "impedance"), ("gsta_2 & 50 % #1", "gsta_2 & 50 % #1")):
        rows = frame[frame["law"] == law]
        assert found.loc[label, ("runs", "")] == len(rows) == 5
        for metric, head in zip(METRICS, ("contact.peak [N]", "effort [N² s]", "final.position.x [m]"), strict=True):
            for name, q in (("quantile 5 %", 0.05), ("median", 0.5), ("quantile 95 %", 0.95)):
                assert found.loc[label, (head, name)] == pytest.approx(rows[metric].quantile(q), rel=1e-12)
    with pytest.raises(InputError, match=r"did you mean 'contact\.peak_N'"):
        study.statistics(["contact.peek_N"])


def test_the_share_that_succeeds_has_the_interval_of_wilsons_equation(study):
    """The ends p of (x/n - p)^2 = z^2 p (1 - p) / n, with z = 1.96 to more digits."""
    found, z = study.statistics(METRICS), 1.959963984540054
    for law in found.index:
        share = study.frame["success"][study.frame["law"] == law].mean()
        assert found.loc[law, ("success [%]", "share")] == 100.0 * share
        for end in ("low", "high"):
            p = found.loc[law, ("success [%]", f"interval {end}")] / 100.0
            assert (share - p) ** 2 == pytest.approx(z**2 * p * (1.0 - p) / 5, abs=1e-12)
        ends = (found.loc[law, ("success [%]", f"interval {end}")] for end in ("low", "high"))
        assert next(ends) <= 100.0 * share <= next(ends)


def test_csv_gives_the_same_numbers_again(study):
    found = study.statistics(METRICS)
    again = pd.read_csv(io.StringIO(to_csv(found)), index_col="law")
    assert np.array_equal(again.to_numpy(), found.to_numpy(), equal_nan=True)
    assert "contact.peak [N] median" in again.columns


def test_texts_for_latex():
    assert latex("a_b & 50 % {x} #1 $") == r"a\_b \& 50~\% \{x\} \#1 \$"
    assert latex("[m/s^2]") == "[m/s$^{2}$]"
    assert latex("[s^-1]") == "[s$^{-1}$]"
    assert latex("[N² s]") == "[N$^2$ s]"
    assert latex("-3 to -.5, a-2, s^-1, (-1)") == r"$-$3 to $-$.5, a-2, s$^{-1}$, ($-$1)"
    assert latex("|F_d| < 1") == r"$|$F\_d$|$ $<$ 1"


@pytest.mark.parametrize(
    ("rows", "cells", "exponent"),
    [
        ([[17.2514, 10.19, 23.52], [17.2914, 10.26, 23.55]], ["17 (10 to 24)", "17 (10 to 24)"], 0),
        ([[1.49183, 1.48654, 1.49724], [1.49761, 1.4, 1.6]], ["1.492 (1.487 to 1.497)", "1.498 (1.400 to 1.600)"], 0),
        ([[391.83, 206.21, 1023.4]], ["390 (210 to 1020)"], 0),
        ([[-0.51, -1.2, 0.04]], ["−0.5 (−1.2 to 0.0)"], 0),
        ([[1234567.0, 1201234.0, 1300000.0]], ["1.235 (1.201 to 1.300)"], 6),
        ([[2.51e-7, 2.4e-7, 2.6e-7]], ["251 (240 to 260)"], -9),
        ([[3.0, 3.0, 3.0], [np.nan] * 3], ["3.00 (3.00 to 3.00)", "–"], 0),
        ([[1.0, 1.0 - 1e-8, 1.0 + 1e-8]], ["1.0000 (1.0000 to 1.0000)"], 0),
        ([[0.0, 0.0, 0.0]], ["0 (0 to 0)"], 0),
        ([[293.2, 160.2, 880.1], [363.7, 161.0, 7.08e6]], ["290 (160 to 880)", "360 (160 to 7.1·10^6)"], 0),
        ([[293.2, 160.2, 880.1], [4.1e6, 1.0e6, 7.08e6]], ["290 (160 to 880)", "4.1·10^6 (1.0·10^6 to 7.1·10^6)"], 0),
    ],
)
def test_a_number_has_the_digits_that_its_range_supports(rows, cells, exponent):
    """The narrowest range of a column has two digits, a number at most five, and a column one power of ten, unless its
    values span more decades than it has digits."""
    found = ranged(np.array(rows))
    assert [cell.text for cell in found.cells] == cells
    assert found.exponent == exponent


def pairs_of(rows, number):
    """A study of three laws and its rows, each with one number of a draw and a law, ``number(draw, law)``."""
    tables = {
        "base": {"scenario": "push_wall", "simulation": {"duration": 0.1}},
        "laws": ["impedance", "fosm", "gsta"],
        "vary": [{"key": "current.speed", "low": 0.1, "high": 0.5, "number": rows}],
        "keep": {"metrics": ["effort_N2s"]},
        "success": {"effort_N2s": [0.0, 100.0]},
    }
    plan = Study.from_dict(tables).plan
    given = [(i, i // 3, law) for i, law in enumerate(["impedance", "fosm", "gsta"] * rows)]
    frame = pd.DataFrame(given, columns=["index", "draw", "law"]).assign(repeat=0, status="completed", engine="mujoco")
    frame["current.speed"] = np.repeat(np.linspace(0.1, 0.5, rows), 3)
    frame["effort_N2s"] = [number(draw, law) for _, draw, law in given]
    frame["success"] = frame["effort_N2s"] < 100.0
    return plan, frame


def test_every_two_laws_are_compared_draw_by_draw(rng):
    """A difference of 3 in a spread of 40 is seen since it is of the same draws. Its median lies between two order
    statistics; a law that is equal but for noise of both signs is not resolved."""
    common, noise = rng.normal(50.0, 40.0, 40), rng.normal(0.0, 0.1, 40)
    more = {"impedance": lambda d: 0.0, "fosm": lambda d: noise[d], "gsta": lambda d: 3.0 + noise[d]}
    plan, frame = pairs_of(40, lambda draw, law: common[draw] + more[law](draw))
    found, head = comparison(plan, frame), "effort [N² s]"
    assert list(found.index) == ["fosm − impedance", "gsta − impedance", "gsta − fosm"]
    assert (found["draws", ""] == 40).all()
    for pair, change in zip(found.index, (noise, 3.0 + noise, np.full(40, 3.0)), strict=True):
        row = found.loc[pair, head]
        assert row["difference"] == pytest.approx(np.median(change))
        for end in ("interval low", "interval high"):
            assert np.isclose(row[end], change, rtol=0.0, atol=1e-9).any(), "no order statistic"
        assert row["interval low"] <= row["difference"] <= row["interval high"]
    assert list(found[head, "resolved among all"]) == [0.0, 1.0, 1.0]
    share = {law: (frame["effort_N2s"][frame["law"] == law] < 100.0).mean() for law in ("impedance", "gsta")}
    points = found.loc["gsta − impedance", ("success [points]", "difference")]
    assert points == pytest.approx(100.0 * (share["gsta"] - share["impedance"]))
    table = printed(found)
    assert [cell.value.endswith("*") for cell in table.columns[1].cells] == [False, True, True]
    assert [float(cell.value.strip("*")) for cell in table.columns[1].cells[1:]] == pytest.approx([3.0] * 2, abs=0.1)
    assert all(cell.value.startswith("+") for cell in table.columns[1].cells[1:])
    assert "all 6 intervals hold at once" in table.note


def test_two_laws_in_few_draws_have_no_interval_of_a_median():
    plan, frame = pairs_of(5, lambda draw, law: draw + len(law))
    found = comparison(plan, frame)
    assert np.isnan(found["effort [N² s]"].to_numpy(dtype=float)[:, :3]).all()
    assert {cell.value for cell in printed(found).columns[1].cells} == {"–"}
    one = Study.from_dict({"base": {"scenario": "push_wall"}, "vary": [{"key": "current.speed", "values": [0.1]}]}).plan
    with pytest.raises(InputError, match="no two laws"):
        comparison(one, frame[frame["law"] == "gsta"][:1])


def test_the_note_says_over_which_time_a_metric_is_taken(study, here):
    found = study.statistics(["contact.peak_N"])
    assert found.attrs["meanings"] == {"contact.peak [N]": NUMBERS["contact.peak_N"].meaning}
    data = StudyRows(study.plan, study.frame.assign(**{"hold.error_N": 1.0}))
    (metric,) = data.named(["hold.error_N"])
    assert "over the last 5 s" in metric.meaning
    assert f"last {HOLD_S:g} s" in metric.meaning, "the definition has another length"
    for text in (printed(found).text, here("study", "table", str(study.folder), "--metrics", "contact.peak_N").stdout):
        assert "contact.peak: largest push." in " ".join(text.split())


def compiled(tmp_path, text):
    """What pdflatex prints of a document with a text, in the class IEEEtran if it is there."""
    kind = r"\documentclass[journal]{IEEEtran}" if shutil.which("kpsewhich") and _has("IEEEtran.cls") else ""
    kind = kind or r"\documentclass{article}"
    rules = r"\usepackage{booktabs}" if _has("booktabs.sty") else r"\let\toprule\hline\let\midrule\hline"
    rules += "" if "usepackage" in rules else r"\let\bottomrule\hline"
    (tmp_path / "paper.tex").write_text(rf"{kind}{rules}\begin{{document}}{text}\end{{document}}")
    tex = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"]
    done = subprocess.run(tex, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-1000:]
    return done.stdout


def _has(file):
    return bool(subprocess.run(["kpsewhich", file], capture_output=True, text=True).stdout.strip())


@pytest.mark.skipif(not shutil.which("pdflatex"), reason="needs pdflatex")
@pytest.mark.parametrize("pairs", [False, True])
@pytest.mark.parametrize("metrics", [METRICS[:1], METRICS[:2], METRICS, (*METRICS, "final.position_m.y")])
def test_latex_takes_the_table_and_finds_it_as_narrow_as_it_is_said_to_be(study, tmp_path, metrics, pairs):
    """LaTeX measures it: in no paper it is wider than said, and two metrics of laws fit a column of IEEEtran."""
    study.save_table(tmp_path / "table.tex", metrics, pairs=pairs)
    said = printed(study.statistics(metrics, pairs=pairs))
    measure = r"\setbox0\hbox{\input{table.tex}}\typeout{WIDE \the\wd0}"
    for font in ("", r"\fontfamily{cmr}\fontsize{10}{12}\selectfont "):
        found = re.search(r"WIDE ([\d.]+)pt", compiled(tmp_path, font + measure))
        assert 0.75 * said.width < float(found[1]) <= said.width
    if len(metrics) <= 2 and not pairs:
        assert said.width <= 252.0
        assert "fits a column" in (tmp_path / "table.tex").read_text()
        text = r"\begin{table}\centering\input{table.tex}\end{table}x"
        assert "Overfull" not in compiled(tmp_path, text)


def test_a_wide_table_says_where_it_fits(study, tmp_path, here):
    done = here("study", "table", str(study.folder), "--metrics", ",".join(METRICS), "--out", "wide.tex")
    said = printed(study.statistics(METRICS))
    assert ("put it in table*" in done.stderr) == (said.width > 252.0)
    many = LatexTable("law", ["a"], [Column("a metric", "[N]", [Stacked("1.0", "0.5 to 1.5")])] * 6)
    assert "put it in table*" in many.fits
    assert "choose fewer columns" in LatexTable("law", ["a"], many.columns * 4).fits
    assert LatexTable("law", ["a" * 300], many.columns).width < many.width + 100.0


def test_a_law_without_a_finished_run_has_dashes(study):
    frame = study.frame.copy()
    frame.loc[frame["law"] == "impedance", "status"] = "unstable"
    found = statistics(study.plan, frame, METRICS)
    assert np.isnan(found.loc["impedance", ("contact.peak [N]", "median")])
    assert found.loc["impedance", ("success [%]", "share")] == 0.0


def test_the_commands_write_what_the_calls_write(study, tmp_path, here):
    folder = str(study.folder)
    study.save_table(tmp_path / "mine.tex")
    study.save_table(tmp_path / "mine.csv", METRICS)
    assert here("study", "table", folder, "--out", "a.tex").exit_code == 0
    assert here("study", "table", folder, "--out", "a.csv", "--metrics", ",".join(METRICS)).exit_code == 0
    study.save_table(tmp_path / "pairs_mine.tex", pairs=True)
    assert here("study", "table", folder, "--out", "pairs_a.tex", "--pairs").exit_code == 0
    assert (tmp_path / "pairs_a.tex").read_bytes() == (tmp_path / "pairs_mine.tex").read_bytes()
    for kind in ("tex", "csv"):
        assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"mine.{kind}").read_bytes()
    said = here("study", "table", folder, "--metrics", "contact.peak_N").stdout
    assert all(column.cells[1].text in said for column in printed(study.statistics(["contact.peak_N"])).columns)
    refused = here("study", "table", folder, "--out", "a.xls")
    assert "must end in .tex or .csv" in refused.stderr
    assert "exists" in here("study", "table", folder, "--out", "a.tex").stderr


def test_a_figure_of_a_study_for_a_paper(study, tmp_path, here):
    words = ("study", "plot", str(study.folder), "--what", "distributions", "--width", "column", "--fonts", "serif")
    done = here(*words, "--out", "x.pdf")
    assert done.exit_code == 0, done.output
    data = (tmp_path / "x.pdf").read_bytes()
    (box,) = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ", data)
    assert float(box) * 72.27 / 72.0 == pytest.approx(252.0, abs=0.01)
    assert b"STIX" in data
    narrow = study.plot("distributions", width="column")
    assert narrow.axes[0].get_subplotspec().get_gridspec().ncols == 2
    with pytest.raises(InputError, match="needs at least 5 inches"):
        study.plot("overview", width="column")


def test_the_distributions_of_named_metrics_are_its_panels(study):
    figure = study.plot("distributions", metrics=["effort_N2s", "contact.peak_N"])
    assert [ax.get_xlabel() for ax in figure.axes if ax.get_visible()] == ["effort [N² s]", "contact peak [N]"]
    rows = study.frame[study.frame["law"] == "impedance"]
    assert figure.axes[0].lines[0].get_xdata()[1:] == pytest.approx(np.sort(rows["effort_N2s"]))
    with pytest.raises(InputError, match=r"did you mean 'contact\.peak_N'"):
        study.plot("distributions", metrics=["contact.peek_N"])
    with pytest.raises(InputError, match="are for distributions and maps, not for 'overview'"):
        study.plot("overview", metrics=["contact.peak_N"])
    over = study.plot("map", over=["current.speed"], metrics=["effort_N2s"])
    assert [ax.get_ylabel() for ax in over.axes] == ["effort [N² s]"]


def test_words_of_a_paper_stand_in_place_of_names(study, tmp_path, here):
    """Laws, metrics and keys have other words, and the same numbers, heights and colours as without."""
    words = {"impedance": "ours", "effort_N2s": "thrust used", "current.speed": "current"}
    plain, found = study.statistics(["effort_N2s"]), study.statistics(["effort_N2s"], labels=words)
    assert list(found.index) == ["ours", "gsta_2 & 50 % #1"]
    assert "thrust used [N² s]" in found.columns.get_level_values(0)
    assert np.array_equal(found.to_numpy(), plain.to_numpy())
    assert study.statistics(pairs=True, labels=words).index[0] == "gsta_2 & 50 % #1 − ours"
    figure = study.plot("map", over=["current.speed"], metrics=["effort_N2s"], labels=words, height="70mm")
    (ax,) = figure.axes
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("current [m/s]", "thrust used [N² s]")
    assert figure.get_figheight() == pytest.approx(70.0 / 25.4)
    given = [option for name, text in words.items() for option in ("--label", f"{name}={text}")]
    table = here("study", "table", str(study.folder), "--metrics", "effort_N2s", *given)
    assert "ours" in table.stdout
    assert "impedance" not in table.stdout
    for wrong, why in (("impedence=a", "did you mean 'impedance'"), ("impedance", "NAME=TEXT"), ("=a", "NAME=TEXT")):
        assert why in here("study", "table", str(study.folder), "--label", wrong).stderr
    with pytest.raises(InputError, match="would stand for two laws"):
        study.plot(labels={"impedance": "gsta_2 & 50 % #1"})


def test_the_end_of_a_curve_beyond_the_limits_stands_not_outside_the_axes():
    values = np.r_[np.linspace(0.0, 1.0, 100), np.linspace(0.0, 1.0, 99), 50.0]
    rows = {"near": np.arange(200) < 100, "far": np.arange(200) >= 100}
    data = SimpleNamespace(values=lambda metric: values, laws=[*rows], rows=rows, colours=dict.fromkeys(rows, "black"))
    _, (ax,) = panels(1, 1, 0.5, 2.0)
    distribution(ax, data, SimpleNamespace(axis="q"), first=True)
    ends = [line for line in ax.lines if line.get_marker() == "o"]
    assert [each.get_visible() for each in ends] == [True, False]
    assert ax.get_xlim()[1] < 50.0
