"""The table of a study for a paper: numbers of the rows, units in the heads, texts that LaTeX takes, figures."""

import io
import re
import shutil
import subprocess

import numpy as np
import pandas as pd
import pytest

from short_study import HERE
from uvms_mj import InputError, Study
from uvms_mj.studies.report.tables import latex, statistics, to_csv, to_latex

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
            for name, q in (("5 %", 0.05), ("median", 0.5), ("95 %", 0.95)):
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
            p = found.loc[law, ("success [%]", end)] / 100.0
            assert (share - p) ** 2 == pytest.approx(z**2 * p * (1.0 - p) / 5, abs=1e-12)
        assert found.loc[law, ("success [%]", "low")] <= 100.0 * share <= found.loc[law, ("success [%]", "high")]
    assert "% low, high: 95 % interval" in to_latex(found)


def test_csv_gives_the_same_numbers_again(study):
    found = study.statistics(METRICS)
    again = pd.read_csv(io.StringIO(to_csv(found)), index_col="law")
    assert np.array_equal(again.to_numpy(), found.to_numpy(), equal_nan=True)
    assert "contact.peak [N] median" in again.columns


def test_texts_for_latex():
    assert latex("a_b & 50 % {x} #1 $") == r"a\_b \& 50 \% \{x\} \#1 \$"
    assert latex("[m/s^2]") == "[m/s$^{2}$]"
    assert latex("[s^-1]") == "[s$^{-1}$]"
    assert latex("[N² s]") == "[N$^2$ s]"
    frame = pd.DataFrame({("x", ""): [1.5e-7, np.nan, -2.0]}, index=pd.Index(["a", "b", "c"], name="law"))
    text = to_latex(frame)
    for cell in (r"a & $1.5 \cdot 10^{-7}$ \\", r"b & -- \\", r"c & $-2$ \\"):
        assert cell in text


@pytest.mark.skipif(not shutil.which("pdflatex"), reason="needs pdflatex")
def test_latex_takes_the_table(study, tmp_path):
    study.save_table(tmp_path / "table.tex", METRICS)
    text = (tmp_path / "table.tex").read_text()
    cells = [line.count(" & ") for line in text.splitlines() if line.endswith(r"\\")]
    assert cells[1:] == [13, 13, 13]
    plain = r"\documentclass{article}\providecommand\toprule{\hline}\providecommand\midrule{\hline}"
    plain += r"\providecommand\bottomrule{\hline}\begin{document}\input{table.tex}\end{document}"
    (tmp_path / "paper.tex").write_text(plain)
    tex = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"]
    done = subprocess.run(tex, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-1000:]


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
    for kind in ("tex", "csv"):
        assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"mine.{kind}").read_bytes()
    printed = here("study", "table", folder, "--metrics", "contact.peak_N").stdout
    assert f"{study.statistics(['contact.peak_N']).iloc[1, 5]:.4g}" in printed
    refused = here("study", "table", folder, "--out", "a.xls")
    assert "must end in .tex or .csv" in refused.stderr
    assert "exists" in here("study", "table", folder, "--out", "a.tex").stderr


def test_a_figure_of_a_study_for_a_paper(study, tmp_path, here):
    words = ("study", "plot", str(study.folder), "--what", "distributions", "--width", "column", "--fonts", "serif")
    done = here(*words, "--out", "x.pdf")
    assert done.exit_code == 0, done.output
    data = (tmp_path / "x.pdf").read_bytes()
    assert re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ", data) == [b"252"]
    assert b"STIX" in data
    narrow = study.plot("distributions", width="column")
    assert narrow.axes[0].get_subplotspec().get_gridspec().ncols == 2
    with pytest.raises(InputError, match="needs at least 5 inches"):
        study.plot("overview", width="column")


def test_the_distributions_of_named_metrics_are_its_panels(study):
    figure = study.plot("distributions", metrics=["effort_N2s", "contact.peak_N"])
    assert [ax.get_xlabel() for ax in figure.axes if ax.get_visible()] == ["effort [N² s]", "contact.peak [N]"]
    rows = study.frame[study.frame["law"] == "impedance"]
    assert figure.axes[0].lines[0].get_xdata()[1:] == pytest.approx(np.sort(rows["effort_N2s"]))
    with pytest.raises(InputError, match=r"did you mean 'contact\.peak_N'"):
        study.plot("distributions", metrics=["contact.peek_N"])
    with pytest.raises(InputError, match="are for distributions, not for 'map'"):
        study.plot("map", metrics=["contact.peak_N"])
