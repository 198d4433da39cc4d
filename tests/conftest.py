"""Shared fixtures, and what belongs to the marker bits. Runs of the paper's scenario are made once for all tests that
look at them."""

import gc
import os
import signal
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is imported: workers fill the cores, and waiting threads spin

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import settings

from uvms_mj import InputError, Scenario, Trace, simulate
from uvms_mj.cli import main
from uvms_mj.engine import simulation
from uvms_mj.engine.engines import refusals

gc.set_threshold(20_000, 20, 20)  # to search for garbage as often as Python does would be a tenth of all work

settings.register_profile("here", deadline=None, max_examples=25, derandomize=True)
settings.load_profile("here")


HERE = Path(__file__).parent
FOR_EACH_COMMIT = {
    *("actuation", "analysis", "compiler", "control", "engine", "envs", "guidance", "navigation", "physics", "plant"),
    *("setup", "stages", "test_borders.py", "test_house.py", "test_refusals.py", "test_scenario.py"),
}
"""Folders and modules whose tests have the marker bits unless they are slow."""


LONGEST = (
    *("test_site.py", "test_fleet.py", "test_pages.py", "test_bench.py", "test_figures.py", "test_rerun_viewers.py"),
    *("test_notebook.py", "test_video.py"),
)
"""Modules that begin first, in this order, so that no worker waits for another one at the end."""
WITH_MUJOCO = {"engine", "envs", "physics", "plant"}
"""Folders whose tests are about MuJoCo's steps. Elsewhere a run that names no engine takes free_body, which is several
times as fast and has the same laws, sensors and walls (tests/engine), where it can."""


def _is_read(name, config):
    """Whether a folder or module of the tests is read: with the marker bits alone, only what has such tests."""
    return config.option.markexpr != "bits" or name in FOR_EACH_COMMIT


def pytest_configure(config):
    """Each worker begins to read at another place, so that it finds byte code that another one has made."""
    worker = getattr(config, "workerinput", None)
    if worker and config.args_source is pytest.Config.ArgsSource.TESTPATHS:
        names = sorted({path.relative_to(HERE).parts[0] for path in HERE.rglob("test_*.py")})
        names = [name for name in names if _is_read(name, config)]
        first = len(names) * int(worker["workerid"].removeprefix("gw")) // worker["workercount"]
        config.args = [str(HERE / name) for name in (*names[first:], *names[:first])]


def pytest_ignore_collect(collection_path, config):
    within = collection_path.relative_to(HERE).parts
    return True if within and not _is_read(within[0], config) else None


def pytest_collection_modifyitems(items):
    order = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: (order.get(item.path.name, len(order)), item.path))
    for item in items:
        place = item.path.relative_to(HERE).parts[0]
        if place in FOR_EACH_COMMIT and not any(item.get_closest_marker(each) for each in ("slow", "long")):
            item.add_marker("bits")


def pytest_collection_finish():
    """What was imported stays."""
    gc.freeze()


_HANDLERS = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}


@pytest.fixture(autouse=True)
def _signals():
    """A command that runs in this process takes its signals."""
    yield
    for number, handler in _HANDLERS.items():
        signal.signal(number, handler)
    signal.set_wakeup_fd(-1)


@pytest.fixture(autouse=True)
def _calls(request, monkeypatch):
    """The calls of a study are made in this process, unless a test is about the processes."""
    if not request.node.get_closest_marker("processes"):
        here, one = Lock(), "uvms_mj.studies.pool.executors.Workers._call"

        def call(workers, function, *arguments, **named):
            with here:
                return function(*arguments, **named)

        monkeypatch.setattr(one, call)


_MUJOCO = simulation.ENGINES["mujoco"]


def _fast(setup):
    return (_MUJOCO if refusals(setup) else simulation.ENGINES["free_body"])(setup)


@pytest.fixture(scope="module", autouse=True)
def _engine(request):
    with pytest.MonkeyPatch.context() as patch:
        if request.path.relative_to(HERE).parts[0] not in WITH_MUJOCO:
            patch.setitem(simulation.ENGINES, "fast", _fast)
            patch.setitem(simulate.__kwdefaults__, "engine", "fast")
        yield


@pytest.fixture(scope="session")
def driver():
    """A test of pictures is skipped where nothing draws without a window."""
    from uvms_mj.views.video import underwater

    try:
        underwater.gl_context(16, 16).free()
    except InputError as error:
        pytest.skip(str(error))


@pytest.fixture
def undrawn(monkeypatch):
    """Figures and scenes are made and written as empty pictures: tests/views lays them out and draws them."""
    for name in (
        "matplotlib.layout_engine.ConstrainedLayoutEngine.execute",
        "matplotlib.figure.Figure.draw",
        "uvms_mj.views.figures.compose.place",
        "mujoco.mjr_render",
    ):
        monkeypatch.setattr(name, lambda *_: None)


@cache
def _paper_run(controller: str, **gains: Any) -> Trace:
    overrides = {f"controller.{name}": value for name, value in gains.items()}
    return simulate(Scenario.load("push_wall", overrides, controller))


@pytest.fixture(scope="session")
def paper_run():
    """A function of law and gains that gives the trace of the paper's scenario, 20 s."""
    return _paper_run


def smooth_vehicle_overrides(duration: float) -> dict[str, Any]:
    """A short approach far from any wall, with everything in motion: a smooth problem for orders of convergence."""
    return {
        "simulation.duration": duration,
        "wall.position": 50.0,
        "reference.step_time": 0.0,
        "reference.target": [0.4, 0.3, -0.2],
        "initial.attitude_deg": [10.0, -8.0, 15.0],
        "initial.velocity": [0.1, -0.1, 0.05, 0.1, 0.2, -0.1],
    }


@pytest.fixture
def smooth_overrides():
    return smooth_vehicle_overrides


@pytest.fixture
def rng():
    return np.random.default_rng(20261121)


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A function that runs the command in this process and returns exit code, standard output and standard error."""
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(main, [str(a) for a in arguments])
