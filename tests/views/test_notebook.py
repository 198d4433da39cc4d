"""What runs, scenarios, studies and vehicles show in a notebook, and what a notebook needs besides."""

import base64
import dataclasses
import io
import re
import sys
from html import unescape
from html.parser import HTMLParser

import matplotlib.pyplot as plt
import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient
from PIL import Image

from uvms_mj import Gsta, InputError, Mjcf, Scenario, Study, Trace, converge, plot, simulate
from uvms_mj.views import figures

SHORT = {"simulation.duration": 0.1}


class Read(HTMLParser):
    """The cells of the tables of a fragment, its texts and its pictures. Fails for a tag that is not closed."""

    def __init__(self, html):
        super().__init__()
        self.open, self.rows, self.images = [], [], []
        self.feed(html)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        assert tag not in ("script", "link", "iframe", "style")
        if tag == "img":
            self.images.append(dict(attrs)["src"])
            return
        self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data

    @property
    def pictures(self):
        for source in self.images:
            head, _, data = source.partition(",")
            assert head == "data:image/png;base64"
            yield Image.open(io.BytesIO(base64.b64decode(data)))


def read(shown):
    html = shown._repr_html_()
    assert not re.search(r"https?:", html)  # nothing from elsewhere
    assert "color: #" not in html  # texts have the colour of the notebook, light or dark
    return Read(html)


def test_a_run_shows_the_table_that_the_command_prints(trace, tmp_path, here):
    rows = dict(read(trace).rows)
    trace.save(tmp_path / "run.mcap")
    printed = here("info", str(tmp_path / "run.mcap")).stdout.partition("contents of the log")[0]
    lines = [line.strip("│ ").split("│") for line in printed.splitlines() if line.startswith("│")]
    ours = {name.strip(): value.strip() for name, value in lines}
    assert len(rows) >= 9
    for name, value in rows.items():
        assert ours[name] == value.strip()
    assert set(ours) - set(rows) == {"files", "error bars"}
    (picture,) = read(trace).pictures
    assert picture.width < 600


def test_a_run_without_a_row_and_one_that_diverged_show_themselves(trace):
    assert not read(Trace.of(trace.header, trace.rows()[:0], trace.outcome)).images
    wild = simulate(Scenario.load("push_wall", {"controller.k_2": 1e7, "controller.k_1": 1e5}))
    assert wild.status.name == "unstable"
    assert dict(read(wild).rows)["message"] == wild.message


def test_a_scenario_shows_what_differs_from_its_defaults():
    scenario = Scenario.load("push_wall", {"wall.stiffness": 2e4, "controller.k_1": 9.0, "vehicle.model": "lauv"})
    rows = {name: (value, default) for name, value, default in read(scenario).rows}
    assert rows == {
        "vehicle.model": ("'lauv'", "default 'bluerov1'"),
        "wall.stiffness": ("20000.0 N/m", "default 100000.0 N/m"),
        "controller.k_1": ("9.0 m^(1/2)/s^(3/2)", f"default {Gsta().k_1} m^(1/2)/s^(3/2)"),
    }
    assert len([*read(scenario).pictures]) == 1
    lost = dataclasses.replace(scenario, vehicle=dataclasses.replace(scenario.vehicle, model="gone.xml"))
    assert not read(lost).images


def test_texts_are_escaped():
    """Title, text and cells."""
    hostile = {"description": "<script>alert(1)</script> & more", "name": "<b>", "vehicle.model": "<i>x</i>.xml"}
    html = Scenario.load("push_wall", hostile)._repr_html_()
    assert not [tag for tag in ("<script", "<b>", "<i>") if tag in html]
    assert "<i>x</i>.xml" in unescape(html)
    assert "<script>alert(1)</script> & more" in unescape(html)


@pytest.mark.parametrize("name", ["bluerov1", "lauv", "planar_arm"])
def test_a_vehicle_shows_the_numbers_that_the_command_prints_and_itself(name, here):
    shown = read(Mjcf.find(name))
    rows = dict(shown.rows)
    printed = " ".join(here("vehicles", name).stdout.replace("│", " ").split())
    for word in ("M_RB", "M_A", "D_linear", "centre of buoyancy"):
        assert " ".join(rows[word].split("\n")[0].split()) in printed
    (picture,) = shown.pictures
    pixels = np.asarray(picture.convert("RGB")).astype(int)
    drawn = np.abs(pixels - pixels[0, 0]).sum(axis=2) > 30
    assert 0.05 < drawn.mean() < 0.9
    rows, columns = (np.flatnonzero(drawn.any(axis=axis)) for axis in (1, 0))
    for seen, size in ((rows, picture.height), (columns, picture.width)):  # nothing is cut off
        assert seen[0] > 0
        assert seen[-1] < size - 1


def test_plots_are_the_figures_of_the_command_and_pyplot_knows_none(trace, other):
    before = plt.get_fignums()
    for figure, same in (
        (trace.plot("force"), figures.plot({"gsta": trace}, "force")),
        (trace.between(1.0, 2.0).plot(["nu", "tau.x"], width=5.0), None),
        (plot({"a": trace, "b": other}, "tau"), figures.plot({"a": trace, "b": other}, "tau")),
    ):
        drawn = figure._repr_png_()
        assert drawn.startswith(b"\x89PNG")
        assert same is None or same._repr_png_() == drawn
    assert plt.get_fignums() == before
    assert trace.plot("force", width=5.0).get_figwidth() == 5.0
    with pytest.raises(InputError, match="did you mean 'velocity'"):
        trace.plot("velocty")
    cut = trace.between(1.0, 2.0)
    assert (cut.t[0], cut.t[-1], len(cut)) == (pytest.approx(1.0), pytest.approx(2.0), 1001)


def test_export_is_that_of_the_command(trace, tmp_path, here):
    trace.save(tmp_path / "run.mcap")
    trace.export(tmp_path / "a.csv", ["p_WB", "tau.x"], rate=50.0)
    log, out = str(tmp_path / "run.mcap"), str(tmp_path / "b.csv")
    assert here("export", log, "--out", out, "--signals", "p_WB,tau.x", "--rate", "50").exit_code == 0
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    with pytest.raises(InputError, match=r"must end in one of \.csv"):
        trace.export(tmp_path / "a.xls")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    tables = {
        "name": "small",
        "base": {"scenario": "push_wall", "simulation": {"duration": 0.05}, "wall": {"position": 0.001}},
        "laws": ["impedance", Gsta(k_1=8.0)],
        "vary": [{"key": "current.speed", "low": 0.1, "high": 0.5, "number": 4}],
    }
    return Study.from_dict(tables).run(tmp_path_factory.mktemp("study") / "small", workers=1)


def test_a_study_shows_its_plan_and_its_results(study, here):
    before = read(Study(study.plan))
    assert before.rows[0] == ["small", "8 runs, 4 draws (grid) x 2 laws; 4000 time steps"]
    shown = read(study)
    assert shown.rows[: len(before.rows)] == before.rows
    assert [tuple(row) for row in shown.rows[len(before.rows) :]] == study.table()
    assert study.table()[1][:3] == ("impedance", "4", "4")
    assert len([*shown.pictures]) == 1
    printed = here("study", str(study.folder), "--workers", "1").stdout
    assert all(cell in printed for row in study.table() for cell in row)


def test_a_study_plots_the_figures_of_its_report(study, tmp_path, request):
    before = plt.get_fignums()
    *others, of_map = (study.plot(what)._repr_png_() for what in ("overview", "distributions", "map"))
    assert all(each.startswith(b"\x89PNG") for each in (*others, of_map))
    assert study.plot("map", over=["current.speed"])._repr_png_() == of_map
    assert plt.get_fignums() == before
    for arguments, wrong in (
        ({"what": "maps"}, "did you mean 'map'"),
        ({"what": "map", "over": ["wall.stiffness"]}, "does not vary"),
        ({"over": ["current.speed"]}, "is for a map"),
    ):
        with pytest.raises(InputError, match=wrong):
            study.plot(**arguments)
    request.getfixturevalue("undrawn")
    page = study.report(tmp_path / "page.html").read_text()
    assert "current.speed" in page
    assert study.report() == study.folder / "report.html"


def test_convergence_shows_its_table():
    found = converge(Scenario.load("push_wall", SHORT), ["final.position_m"])
    assert [tuple(row) for row in read(found).rows] == found.table()


CELLS = (
    """
from dataclasses import dataclass
import numpy as np
from uvms_mj import Controller, Scenario, Study, Trace, gain, simulate
LIMIT = 0.5
WEIGHTS = np.ones(6)
""",
    """
def clipped(x):
    return min(max(x, -LIMIT), LIMIT)
""",
    '''
@dataclass(frozen=True)
class Mine(Controller):
    """Impedance control with a clipped integral."""
    k_i: float = gain(2.0, "1/s", "integral gain")
    states = {"e": 6}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        left = signals.K_d * signals.eta_e + signals.D_d @ signals.nu_e - signals.tau_contact_m_B
        for i in range(6):
            state_dot.e[i] = clipped(left[i])
        tau_cmd[:] = signals.tau_nom - gains.k_i * WEIGHTS * state.e
''',
    """
short = {"simulation.duration": 0.3, "reference.step_time": 0.0}
trace = simulate(Scenario.load("push_wall", short), Mine(k_i=3.0), engine="free_body", progress=True)
trace
""",
    """
tables = {"base": {"scenario": "push_wall", "simulation": {"duration": 0.3}, "reference": {"step_time": 0.0}},
          "laws": ["gsta", Mine(k_i=3.0)], "vary": [{"key": "wall.stiffness", "values": [1e4, 1e5]}]}
study = Study.from_dict(tables).run("study", workers=2, progress=True)
study
""",
    "trace.plot('position')",
    """
row = study.frame.iloc[3]
print([trace.notes, "class Mine" in trace.header.law.code, row["law"], row["status"],
       bool(row["final.position_m.x"] == trace.p_WB[-1, 0])])
""",
)


@pytest.mark.processes
def test_a_law_of_a_cell_runs_compiled_and_in_a_study_and_bars_are_one_output(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setenv("MPLBACKEND", "module://matplotlib_inline.backend_inline")
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in CELLS])
    NotebookClient(book, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    *_, run, study, picture, facts = (cell.outputs for cell in book.cells)
    for outputs in (run, study):
        bar, shown = outputs  # one bar, whatever number of times it was drawn, and the result
        assert "<progress" in bar["data"]["text/html"]
        assert "<table" in shown["data"]["text/html"]
    assert "0.3 s simulated" in run[0]["data"]["text/html"]
    assert "runs, 0 failed" in study[0]["data"]["text/html"]
    assert "image/png" in picture[0]["data"]
    # no note: the law was compiled; and a worker computes the same bits
    assert facts[0]["text"] == "[(), True, 'Mine', 'completed', True]\n"


def test_a_law_that_uses_what_has_no_text_is_refused_by_name(tmp_path, monkeypatch):
    import linecache

    from uvms_mj.stages.written import module_source

    text = CELLS[0] + "OPEN = open\nTHING = object()\n" + CELLS[2].replace("clipped(left[i])", "THING")
    file = str(tmp_path / "cell")
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    module = type(sys)("a_session")
    monkeypatch.setitem(sys.modules, "a_session", module)
    exec(compile(text, file, "exec"), vars(module))
    with pytest.raises(InputError, match="Mine uses THING, which has no text"):
        module_source(module.Mine)


def test_bad_input_is_its_message_and_no_traceback():
    """IPython asks the exception."""
    from IPython.core.interactiveshell import InteractiveShell
    from IPython.utils.capture import capture_output

    shell = InteractiveShell()
    with capture_output() as shown:
        shell.run_cell('from uvms_mj import Scenario\nScenario.load("push_wall", {"wall.stifness": 1.0})')
    assert "did you mean 'stiffness'" in shown.stdout + shown.stderr
    assert "Traceback" not in shown.stdout + shown.stderr
