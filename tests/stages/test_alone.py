"""A user's code is alone in its run: what another run has loaded, kept or changed is not in it."""

import gc
import importlib
import inspect
import multiprocessing
import pickle
import random
import sys
import threading
import traceback
from pathlib import Path

import cloudpickle
import numpy as np
import pytest

from law_files import HEADER, law_file, one_liner
from short_study import HERE
from uvms_mj import InputError, LawError, Scenario, Simulation, simulate
from uvms_mj.engine.vehicle_run import PlainPythonWarning
from uvms_mj.stages.namespace import PREFIX, source_files
from uvms_mj.studies.bundle import StudyBundle
from uvms_mj.studies.study import Study

SHORT = {"simulation.duration": 0.2, "simulation.timestep": 1e-3}
PD = "tau_cmd[:] = signals.g_hat - {gain} * signals.eta_e - 150.0 * signals.nu_e"
plainly = pytest.mark.filterwarnings("ignore::uvms_mj.engine.vehicle_run.PlainPythonWarning")


def end(source: str, **overrides: object) -> list[float]:
    """Where a run ends."""
    return simulate(Scenario.load("push_wall", {**SHORT, **overrides}, source), engine="free_body").p_WB[-1].tolist()


def with_helpers(folder: Path, gain: float) -> str:
    """A law whose gain is in a module beside it, and in a package's module that imports by a relative name."""
    (folder / "parts").mkdir(parents=True)
    (folder / "utils.py").write_text(f"HALF = {gain / 2}\n")
    (folder / "parts" / "__init__.py").write_text("from .whole import both\n")
    (folder / "parts" / "whole.py").write_text("import utils\n\n\ndef both(x):\n    return x + utils.HALF\n")
    header = f"{HEADER}import utils\nfrom parts import both\n"
    return f"{law_file(folder, one_liner('Law', PD.format(gain='both(utils.HALF)')), header=header)}:Law"


def test_modules_of_one_name_do_not_meet(tmp_path):
    soft, stiff = with_helpers(tmp_path / "soft", 50.0), with_helpers(tmp_path / "stiff", 200.0)
    alone = [
        end(f"{law_file(tmp_path, one_liner('Law', PD.format(gain=gain)), f'law_{gain:.0f}.py')}:Law")
        for gain in (50.0, 200.0)
    ]
    assert alone[0] != alone[1]
    for order in ((0, 1), (1, 0)):
        found = {k: end((soft, stiff)[k]) for k in order}
        assert [found[0], found[1]] == alone


@pytest.mark.parametrize("module", ["utils.py", "parts/whole.py"])
def test_an_edited_module_is_seen_by_the_next_run_of_the_same_scenario(tmp_path, module):
    source = with_helpers(tmp_path, 50.0)
    scenario = Scenario.load("push_wall", SHORT, source)
    before = simulate(scenario, engine="free_body").p_WB[-1].tolist()
    text = (tmp_path / module).read_text()
    (tmp_path / module).write_text(text.replace("25.0", "100.0").replace("x + utils.HALF", "x + utils.HALF + 150.0"))
    after = simulate(scenario, engine="free_body").p_WB[-1].tolist()
    assert before != after == end(source) == end(with_helpers(tmp_path / "other", 200.0))
    assert not list(tmp_path.rglob("__pycache__"))


def test_a_stage_that_is_pickled_is_loaded_from_its_file(tmp_path):
    source = with_helpers(tmp_path, 50.0)
    scenario = Scenario.load("push_wall", {**SHORT, "controller.period": 0.002}, source)
    for pickler in (pickle, cloudpickle):
        text = pickler.dumps(scenario)
        (tmp_path / "utils.py").write_text("HALF = 100.0\n")
        again = pickle.loads(text)
        assert again.controller.period == 0.002
        module = sys.modules[type(again.controller).__module__]
        assert module.utils.HALF == 100.0
        (tmp_path / "utils.py").write_text("HALF = 25.0\n")


def test_python_finds_the_source_of_what_is_loaded(tmp_path):
    source = with_helpers(tmp_path, 50.0)
    kind = type(Scenario.load("push_wall", SHORT, source).controller)
    file = source.rpartition(":")[0]
    assert inspect.getsource(kind) in Path(file).read_text()
    assert inspect.getsourcefile(kind) == file
    assert kind.source() == source
    law_file(
        tmp_path,
        one_liner("Wrong", "utils.fails(signals.t)\ntau_cmd[:] = eval('0.0')"),
        "wrong.py",
        f"{HEADER}import utils\n",
    )
    (tmp_path / "utils.py").write_text("def fails(t):\n    return eval('{}')['key']\n")
    with pytest.warns(PlainPythonWarning), pytest.raises(LawError) as caught:
        end(f"{tmp_path}/wrong.py:Wrong")
    lines = [frame.line for frame in traceback.extract_tb(caught.value.__cause__.__traceback__)]
    assert "return eval('{}')['key']" in lines


def test_what_is_missing_is_named_as_it_is_imported(tmp_path):
    with_helpers(tmp_path, 50.0)
    for line, words in (
        ("import parts.no", "No module named 'parts.no'"),
        ("from utils import no", "cannot import name 'no' from 'utils'"),
    ):
        file = law_file(tmp_path, one_liner("Law", "tau_cmd[:] = 0.0"), "wrong.py", f"{HEADER}{line}\n")
        with pytest.raises(InputError) as caught:
            Scenario.load("push_wall", SHORT, f"{file}:Law")
        assert words in str(caught.value)
        assert PREFIX not in str(caught.value)


def test_a_study_takes_packages_with_relative_imports_and_imports_within_functions(tmp_path):
    source = with_helpers(tmp_path, 50.0)
    (tmp_path / "late.py").write_text("from parts import both\n")
    file = Path(source.rpartition(":")[0])
    file.write_text(file.read_text() + "\n\ndef later():\n    import late\n")
    study = Study.from_dict({"laws": [source], "base": {"scenario": "push_wall"}})
    names = {"/".join(Path(name).parts[1:]) for name in StudyBundle.of(study.plan).files}
    assert names == {"my_law.py", "utils.py", "late.py", "parts/__init__.py", "parts/whole.py"}
    module = sys.modules[type(Scenario.load("push_wall", SHORT, source).controller).__module__]
    assert {path.name for path in source_files(module)} == {Path(name).name for name in names}


def test_a_package_that_is_installed_in_a_folder_of_the_path_is_no_file_of_a_law(tmp_path, monkeypatch):
    """pip install --target: NumPy of such a folder is no helper of the law; a module beside the packages is."""
    there = tmp_path / "there"
    (there / "bought_k").mkdir(parents=True)
    (there / "bought_k" / "__init__.py").write_text("GAIN = 25.0\n")
    (there / "bought_k-1.0.dist-info").mkdir()
    (there / "bought_k-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: bought-k\nVersion: 1.0\n")
    (there / "bought_k-1.0.dist-info" / "RECORD").write_text("bought_k/__init__.py,,\n")
    (there / "own_k.py").write_text("GAIN = 25.0\n")
    monkeypatch.setattr(sys, "path", [*sys.path, str(there)])
    header = f"{HEADER}from bought_k import GAIN\nfrom own_k import GAIN as MORE\n"
    file = law_file(tmp_path, one_liner("Law", "tau_cmd[:] = -(GAIN + MORE) * signals.eta_e"), "my_law.py", header)
    module = sys.modules[type(Scenario.load("push_wall", SHORT, f"{file}:Law").controller).__module__]
    assert {path.name for path in source_files(module)} == {"my_law.py", "own_k.py"}


def test_a_module_of_another_folder_is_what_its_file_means_or_refused(tmp_path, monkeypatch):
    """A process loads it once: neither another folder's module of this name nor an older text of it runs unsaid."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    path = "import os, sys\nsys.path.{}(os.path.join(os.path.dirname(__file__), 'parts_of_h'))\nimport gains_of_h\n"
    sources = []
    for name, way in (("a", "append"), ("b", "append"), ("c", "insert")):
        (tmp_path / name / "parts_of_h").mkdir(parents=True)
        (tmp_path / name / "parts_of_h" / "gains_of_h.py").write_text(f"GAIN = {ord(name)}.0\n")
        header = HEADER + path.format(way).replace("insert(", "insert(0, ")
        law = one_liner("Law", PD.format(gain="gains_of_h.GAIN"))
        sources.append(f"{law_file(tmp_path / name, law, header=header)}:Law")
    try:
        first = end(sources[0])
        for other in sources[1:]:
            with pytest.raises(InputError, match=r"gains_of_h would be .*a process loads it once"):
                end(other)
        assert end(sources[0]) == first
        (tmp_path / "a" / "parts_of_h" / "gains_of_h.py").write_text("GAIN = 50.00\n")
        for _ in range(2):
            with pytest.raises(InputError, match=r"gains_of_h, .*has changed; a process loads it once"):
                end(sources[0])
        sys.path[:] = [place for place in sys.path if not place.startswith(str(tmp_path / "c"))]
        importlib.reload(sys.modules["gains_of_h"])
        assert end(sources[0]) != first
    finally:
        sys.modules.pop("gains_of_h", None)


def test_a_module_of_a_run_goes_with_it(tmp_path):
    source = with_helpers(tmp_path, 50.0)
    end(source)
    gc.collect()
    before = {name for name in sys.modules if name.startswith(PREFIX)}
    maps = Path("/proc/self/maps")
    mapped = len(maps.read_text().splitlines()) if maps.exists() else 0
    for _ in range(30):
        end(source, **{"simulation.duration": 0.001})
    gc.collect()
    assert {name for name in sys.modules if name.startswith(PREFIX)} <= before
    if mapped:
        assert len(maps.read_text().splitlines()) <= mapped + 10


REMEMBERS = """
import random
from collections import deque

BUFFER, SUM = deque(maxlen=50), [0.0]


class Pid:
    def __init__(self):
        self.integral = np.zeros(6)

    def update(self, e, h):
        self.integral += e * h
        return -200.0 * e - 4000.0 * self.integral


PID = Pid()


def average(e):
    BUFFER.append(e)
    return sum(BUFFER) / len(BUFFER)


@dataclass(frozen=True)
class Law(Controller):
    uses_task = False

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.g_hat - 150.0 * signals.nu_e + WHAT
"""
KEEPS = {
    "an object": "PID.update(signals.eta_e, signals.period)",
    "a deque": "-200.0 * average(signals.eta_e)",
    "a deque of copies": "-200.0 * average(signals.eta_e.copy())",
    "NumPy's generator": "np.random.randn(6)",
    "Python's generator": "random.gauss(0.0, 1.0)",
}


def remembers(folder: Path, what: str) -> str:
    return f"{law_file(folder, REMEMBERS.replace('WHAT', KEEPS[what]))}:Law"


@plainly
@pytest.mark.parametrize("what", KEEPS)
def test_what_a_stage_in_python_keeps_ends_with_its_run(tmp_path, what):
    source = remembers(tmp_path, what)
    first = end(source)
    outer = random.getstate(), str(np.random.get_bit_generator().state)
    assert end(source) == end(source) == first
    assert (random.getstate(), str(np.random.get_bit_generator().state)) == outer
    with Simulation(Scenario.load("push_wall", SHORT, source), engine="free_body") as sim:
        for _ in range(2):
            sim.step(200)
            assert sim.signals.p_WB.tolist() == first
            sim.reset()
        sim.set({"wall.position": 1.5})
        sim.reset(seed=1)
        sim.step(200)
        assert (sim.signals.p_WB.tolist() == first) == ("generator" not in what)


@plainly
def test_random_numbers_of_runs_in_threads_are_their_own(tmp_path):
    """NumPy's and Python's generators are one for the process."""
    source = remembers(tmp_path, "NumPy's generator")
    alone, found = end(source), dict[int, list[float]]()
    threads = [threading.Thread(target=lambda i=i: found.update({i: end(source)})) for i in range(3)]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(interval)
    assert list(found.values()) == [alone] * 3


@plainly
def test_a_signal_that_is_kept_stays_as_it_was(tmp_path):
    """The list has the values of its instants, as a list of copies has; an array that is written in place, too."""
    assert end(remembers(tmp_path, "a deque")) == end(remembers(tmp_path, "a deque of copies"))
    body = """
PAST, COPIES = [], []


@dataclass(frozen=True)
class Law(Controller):
    uses_task = False
    states = {"x": 2}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.t
        state_dot.x[:] = 1.0
        PAST.append((signals, signals.eta_e[:3], signals["M_hat"].T, state.x, tau_cmd))
        kept = signals.eta_e[:3].copy(), signals.M_hat.T.copy(), state.x.copy(), tau_cmd.copy()
        COPIES.append((float(signals.t), *kept))
        for (whole, *kept), (t, *copies) in zip(PAST, COPIES):
            assert whole.t == t
            assert all((a == b).all() for a, b in zip(kept, copies))
"""
    assert end(f"{law_file(tmp_path, body)}:Law", **{"simulation.duration": 0.05})


@plainly
@pytest.mark.slow
@pytest.mark.processes
def test_the_rows_of_a_study_do_not_depend_on_their_order_or_on_the_workers(tmp_path):
    tables = {
        "laws": [remembers(tmp_path, "an object")],
        "base": {"scenario": "push_wall", "simulation": {"duration": 0.2, "timestep": 1e-3}},
        "vary": [{"key": "current.speed", "values": [0.0, 0.1, 0.2, 0.05]}],
    }
    back = tables | {"vary": [{"key": "current.speed", "values": [0.05, 0.2, 0.1, 0.0]}]}
    frames = [
        Study.from_dict(each).run(tmp_path / str(k), **how).frame.sort_values("current.speed")
        for k, (each, how) in enumerate(
            [(tables, {"executor": HERE}), (tables, {"workers": 2}), (back, {"workers": 1})]
        )
    ]
    numbers = [frame.filter(like="final.").to_numpy() for frame in frames]
    assert len({tuple(row) for row in numbers[0]}) == 4
    assert all(np.array_equal(each, numbers[0]) for each in numbers[1:])


@plainly
def test_a_global_of_a_module_is_one_for_all_its_functions(tmp_path):
    body = """
LAST = 0.0


def last():
    return LAST


@dataclass(frozen=True)
class Law(Controller):
    uses_task = False

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        global LAST
        tau_cmd[:] = {"last": last()}["last"]
        LAST = signals.t
"""
    trace = simulate(Scenario.load("push_wall", SHORT, f"{law_file(tmp_path, body)}:Law"), engine="free_body")
    np.testing.assert_allclose(trace.tau_cmd[2:-1, 0], trace.t[2:-1] - 1e-3, atol=1e-12)


def test_what_lives_on_is_said(tmp_path):
    library = "import ctypes\nLIBM = ctypes.CDLL(None)\nLIBM.cos.restype = ctypes.c_double\n"
    body = one_liner("Law", "tau_cmd[:] = LIBM.cos(ctypes.c_double(0.0)) * signals.tau_nom")
    file = law_file(tmp_path, body, header=f"{HEADER}{library}")
    with pytest.warns(PlainPythonWarning, match="which a process loads once: what it keeps lives on from run to run"):
        assert end(f"{file}:Law") == end("impedance")


@pytest.mark.processes
@pytest.mark.parametrize(
    ("line", "status", "said"),
    [
        ("os.fork()", 0, "the copy ends here"),
        ("ctypes.CDLL(None).exit(0)", 2, "your law Law (my_law.py) ended the process by exit()"),
    ],
)
def test_a_stage_that_copies_or_ends_the_process_is_named(tmp_path, line, status, said):
    from forked import done

    body = one_liner("Law", f"tau_cmd[:] = 0.0\nif signals.instant == 50:\n    {line}")
    file = law_file(tmp_path, body, header=f"{HEADER}import ctypes\nimport os\n")
    arguments = ("run", "-q", "--engine", "free_body", "simulation.duration=0.1", "-c", f"{file}:Law", "-o", "out")
    ended = done(*arguments, cwd=tmp_path)
    assert ended.exit_code == status
    assert said in ended.stderr
    assert not multiprocessing.active_children()


def test_the_note_on_an_import_within_a_law_names_the_users_line(tmp_path):
    law = one_liner("Law", "tau_cmd[:] = __import__('math').pi")
    source = f"{law_file(tmp_path, law)}:Law"
    with pytest.warns(PlainPythonWarning, match="the language has no __import__"):
        end(source)
