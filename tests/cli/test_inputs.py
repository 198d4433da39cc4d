"""Bad input, streams, signals and folders: one message, the right exit status, bounded time and memory."""

import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
from click.testing import CliRunner

from uvms_mj import InputError, McapLog, Scenario, Trace, simulate
from uvms_mj.analysis.ranges import no_overflow
from uvms_mj.analysis.setup import set_up
from uvms_mj.analysis.wall import wall_faults
from uvms_mj.cli import main
from uvms_mj.files import parse_setting, parsed_toml
from uvms_mj.plant.mujoco_warnings import MujocoWarning, mujoco_warnings
from uvms_mj.scenario import STAGES, keys
from uvms_mj.stages.signals import GIVEN, RECORDED, TRUE, actuation_given

COMMAND = [sys.executable, "-m", "uvms_mj"]
SHORT = {"simulation.duration": 0.005}


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(main, [str(a) for a in arguments])


def refused(overrides, match):
    with pytest.raises(InputError, match=match):
        simulate(Scenario.load("push_wall", SHORT | overrides))


# ------------------------------------------------------------------------------------------------------------ numbers


@pytest.mark.parametrize(("frequency", "acts_as"), [(5000.0, "5000 Hz"), (9999.0, "1 Hz"), (10000.0, "0 Hz")])
def test_a_disturbance_that_the_time_step_would_alias_is_refused(frequency, acts_as):
    refused({"disturbance.frequency_hz": [0.0, 0.0, frequency, 0.0, 0.0, 0.0]}, rf"frequency_hz\[2\].*act as {acts_as}")
    t = 1e-4 * np.arange(1000)
    aliased = float(acts_as.split()[0])
    assert np.allclose(np.abs(np.sin(2 * np.pi * frequency * t)), np.abs(np.sin(2 * np.pi * aliased * t)), atol=1e-9)


def test_a_disturbance_below_half_the_step_rate_runs():
    overrides = {"disturbance.frequency_hz": [4999.0] * 6, "disturbance.amplitude": [1.0] * 6}
    assert simulate(Scenario.load("push_wall", SHORT | overrides)).status.name == "completed"
    refused({"disturbance.frequency_hz": [-1.0] + [0.0] * 5}, r"must be from 0 to 1e\+07 Hz")


HUGE = [key for key, default, _ in keys() if isinstance(default, float | tuple) and key != "reference.waypoints"]


@pytest.mark.parametrize("key", HUGE)
@pytest.mark.parametrize("value", [1e308, -1e308, 10**400])
def test_every_quantity_has_a_range(key, value):
    default = next(default for name, default, _ in keys() if name == key)
    with pytest.raises(InputError, match=key.replace(".", r"\.")) as caught:
        Scenario.load("push_wall", {key: [value] * len(default) if isinstance(default, tuple) else value})
    assert "must" in str(caught.value) or "not a finite number" in str(caught.value)


@pytest.mark.parametrize("key", ["impedance.M_d", "impedance.D_d"])
def test_a_matrix_has_a_range(key):
    for value in ([1e10] * 6, [[1e10] * 6] * 6, [10**400] * 6):
        with pytest.raises(InputError, match=rf"{key}: .* must have numbers from -1e\+09 to 1e\+09 (kg|N s/m)"):
            Scenario.load("push_wall", {key: value})


def test_an_error_names_the_number_of_the_wall_that_is_too_large_for_the_step():
    """The stability limit of symplectic Euler is h^2 k/m + 2 h b/m < 4."""
    setup = set_up(Scenario())
    h, m = 1e-4, setup.design.along_normal(setup.design.M)

    def found(k, b):
        wall = Scenario.load("push_wall", {"wall.stiffness": k, "wall.damping": b})
        return list(wall_faults(wall, setup.design, setup.reach))

    for k, b in [(1.0, 1e9), (1e5, 2.6e5), (5.2e9, 0.0), (2e9, 1.7e5), (1e5, 2.5e5), (5.1e9, 0.0)]:
        assert (h * h * k + 2.0 * h * b >= 4.0 * m) == bool(found(k, b))
    (fault,) = found(1e5, 1e9)
    assert fault.key == "wall.damping"
    assert "choose less than 2.562e+05 N s/m" in fault.message
    (fault,) = found(1e10, 0.0)
    assert fault.key == "wall.stiffness"
    assert "choose less than 5.124e+09 N/m" in fault.message


def test_an_overflow_names_the_keys_with_extreme_numbers():
    refused({"impedance.M_d": [1e-300, 1.0, 1.0, 1.0, 1.0, 1.0]}, r"impedance\.M_d\[0\]: 1e-300 is too small")
    with pytest.raises(InputError, match="no finite result"), no_overflow(Scenario()):
        np.linalg.inv(np.zeros((2, 2)))


# --------------------------------------------------------------------------------------------------------------- text


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[[" * 3000, "nested too deeply"),
        ("x = " + "[" * 3000 + "]" * 3000, "nested too deeply"),
        ("x = " + "9" * 5000, "thousands of digits"),
        ("a." * 60_000 + "a = 1", "fifty words"),
        ('"a".' * 60_000 + "a = 1", "fifty words"),
        ("x" * 2_000_000, "more than 1000000 characters"),
    ],
)
def test_toml_is_read_in_bounded_time(here, text, said):
    start = time.monotonic()
    with pytest.raises(ValueError, match=said if text[0] != "[" else "."):
        parsed_toml(text)
    Path("x.toml").write_text(text)
    done = here("run", "x.toml")
    assert (done.exit_code, "not a scenario in TOML" in done.stderr) == (2, True)
    assert time.monotonic() - start < 5.0


def test_settings_that_are_deep_or_long_are_refused(here):
    for value in ("[" * 3000, "[" * 3000 + "]" * 3000, "9" * 5000, "0x" + "f" * 5000):
        for key in ("reference.waypoints", "wall.stiffness"):
            done = here("run", "--set", f"{key}={value}")
            assert done.exit_code == 2, done.output
            assert len(done.stderr) < 1000
    with pytest.raises(InputError, match="one key and one value"):
        parse_setting("wall.stiffness=1\nx=2")


def test_a_message_stays_short():
    with pytest.raises(InputError) as caught:
        Scenario.from_dict({f"a{i}": 1 for i in range(1000)})
    assert len(str(caught.value).splitlines()) == 52
    assert "1000 errors" in str(caught.value)
    assert "and 950 more" in str(caught.value)
    with pytest.raises(InputError) as caught:
        Scenario.from_dict({"a" * 5000: 1})
    assert len(str(caught.value)) < 500


# ------------------------------------------------------------------------------------------------------- command line


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("run", "-c", "gsta", "-c", "fosm"), "--controller is given more than once"),
        (("run", "-o", "a", "--out", "b"), "--out is given more than once"),
        (("run", "--set", "wall.damping=1", "wall.damping=2"), "wall.damping: is given twice, 1 and 2"),
        (("export", "", "--to", "csv"), "must not be empty"),
        (("info", ""), "must not be empty"),
        (("run", ""), "must not be empty"),
    ],
)
def test_what_is_said_twice_or_not_at_all_is_refused(here, arguments, said):
    done = here(*arguments)
    assert done.exit_code == 2
    assert said in done.stderr
    assert not list(Path().iterdir())


def test_flags_and_settings_may_be_repeated(here):
    done = here("run", "-q", "-q", "-s", "simulation.duration=0.002", "-s", "wall.damping=1", "wall.damping=1")
    assert done.exit_code == 0, done.stderr


def test_keys_and_signals_list_all(here):
    text = "".join(here("keys").stdout.split())
    listed = ("controller.period", "task.F_1", "task.integral", "simulation.seed", "{time=1.0,position=[1.01")
    for word in (*listed, *(f"{table}.name" for table in STAGES)):
        assert word in text
    text = here("signals").stdout
    for each in (*GIVEN, *TRUE, *actuation_given(6), *RECORDED):
        assert each.name in text


def test_stages_lists_all_with_settings_and_states(here, tmp_path):
    """`controllers` is the part of `stages` for laws; a stage of a file is listed as a shipped one is."""
    text = here("stages").stdout
    rooms = {"guidance": "reference", "navigation": "navigation", "control": "controller", "actuation": "actuation"}
    for room, table in rooms.items():
        part = here("stages", room).stdout
        assert part in text
        for name, cls in STAGES[table].shipped.items():
            assert f"{name}: " in part
            for word in (*(field.name for field in cls.setting_fields()), *cls.states):
                assert word in part, (name, word)
    assert here("controllers").stdout in here("stages", "control").stdout
    assert "zeta (6)" in here("stages", "control").stdout
    (tmp_path / "lag.py").write_text(LAG)
    own = here("stages", "actuation", f"{tmp_path / 'lag.py'}:Lag").stdout
    for word in ("Lag: Slow thrusters.", "T_u", "0.3", "thrust (thrusters)"):
        assert word in own
    wrong = here("stages", "navigation", f"{tmp_path / 'lag.py'}:Lag")
    assert wrong.exit_code == 2
    assert "no class derived from Navigation" in wrong.stderr


LAG = """
from dataclasses import dataclass
from uvms_mj.actuation import Actuation
from uvms_mj.stages.base import setting

@dataclass(frozen=True)
class Lag(Actuation):
    "Slow thrusters."
    T_u: float = setting(0.3, "s", "time constant")
    states = {"thrust": "thrusters"}

    @staticmethod
    def step(settings, state, given, state_dot, u):
        u[:] = state.thrust
"""


def test_plot_replaces_with_force_only(here):
    here("run", "-q", "simulation.duration=0.05", "-o", "r")
    for command in (("plot", "--what", "force", "--out", "x.svg"), ("export", "--out", "x.npz")):
        arguments = (command[0], "r/run.mcap", *command[1:])
        assert here(*arguments).exit_code == 0
        again = here(*arguments)
        assert again.exit_code == 2
        assert "--force" in again.stderr
        Path(command[-1]).write_text("")
        assert here(*arguments, "--force").exit_code == 0
        assert Path(command[-1]).stat().st_size


@pytest.mark.parametrize("closed", [">&-", ">&- 2>&-", "<&-", "<&- >&- 2>&-"])
def test_closed_streams_stop_nothing(tmp_path, closed):
    """Closed standard streams do not stop a run, and no file of the run gets the descriptor of a stream."""
    command = f"{sys.executable} -m uvms_mj run simulation.duration=0.005 --out here {closed}"
    assert subprocess.run(["bash", "-c", command], cwd=tmp_path, timeout=120).returncode == 0
    assert Trace.load(tmp_path / "here" / "run.mcap").status.name == "completed"
    keys_ = f"{sys.executable} -m uvms_mj keys {closed}"
    assert subprocess.run(["bash", "-c", keys_], stdout=subprocess.DEVNULL, timeout=60).returncode == 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    "place", ["uvms_mj.cli", "click", "uvms_mj.scenario", "mujoco", "uvms_mj.engine.run", "llvmlite"]
)
def test_a_signal_during_an_import_ends_with_one_line(tmp_path, number, place):
    """The signal arrives exactly when the import of a module begins, as one of a user may in the first half second."""
    code = f"""if True:
        import os, sys
        class Sends:
            def find_spec(self, name, path=None, target=None):
                if name == {place!r}:
                    sys.meta_path.remove(self)
                    os.kill(os.getpid(), {int(number)})
        sys.argv = ["uvms-mj", "run", "-q", "--out", "here"]
        from uvms_mj.__main__ import main
        sys.meta_path.insert(0, Sends())
        main()
    """
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 128 + number, done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert "interrupted" in done.stderr
    assert not list(tmp_path.iterdir())


def test_an_exception_that_a_signal_became_is_still_the_signal(here, monkeypatch):
    """An import in C replaces KeyboardInterrupt by ImportError."""

    def interrupted(*_, **__):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ImportError("numpy._core failed to import") from None

    monkeypatch.setattr("uvms_mj.engine.run.set_up", interrupted)
    done = here("run", "-q")
    assert done.exit_code == 130
    assert done.stderr == "interrupted before the first step\n"


# ------------------------------------------------------------------------------------------------ environment, folders


def test_an_unknown_mujoco_gl_stops_no_command(tmp_path):
    environment = os.environ | {"MUJOCO_GL": "xyz"}
    run = [*COMMAND, "run", "-q", "simulation.duration=0.002"]
    done = subprocess.run(run, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def test_a_cache_folder_that_cannot_be_written_is_named_and_leaves_nothing(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "temporary").mkdir()
    code = """if True:
        import os, warnings
        from uvms_mj.engine.native import objects
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            folder = objects._folder()
            assert objects._folder() == folder
        assert len(said) == 1, said
        assert folder.is_dir() and os.environ["UVMS_MJ_CACHE_DIR"] == str(folder)
        print(said[0].message)
    """
    environment = os.environ | {"UVMS_MJ_CACHE_DIR": str(tmp_path / "file"), "TMPDIR": str(tmp_path / "temporary")}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert str(tmp_path / "file") in done.stdout
    assert "set UVMS_MJ_CACHE_DIR" in done.stdout
    assert not list((tmp_path / "temporary").iterdir())


def test_numba_disable_jit_leaves_the_core_compiled(tmp_path):
    """Users set NUMBA_DISABLE_JIT to debug their laws. The core must compile even with an empty cache."""
    code = """if True:
        import sys
        from uvms_mj import Scenario, simulate
        from uvms_mj.engine.native.compilation import NotCompiled, native_law
        assert simulate(Scenario.load("push_wall", {"simulation.duration": 0.01})).status.name == "completed"
        assert "numba" not in sys.modules
        try:
            native_law(1, [], lambda: None)
        except NotCompiled as error:
            print(error)
    """
    environment = os.environ | {"UVMS_MJ_CACHE_DIR": str(tmp_path), "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "NUMBA_DISABLE_JIT is set\n"


def test_runs_into_one_folder_at_a_time(tmp_path):
    command = [*COMMAND, "run", "-q", "simulation.duration=2", "--out", "here"]
    runs = [subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) for _ in range(4)]
    said = [run.communicate(timeout=240)[1] for run in runs]
    for run, text in zip(runs, said, strict=True):
        assert run.returncode in (0, 2), text
        assert run.returncode == 0 or "another run is writing there" in text
    assert any(run.returncode == 0 for run in runs)
    for folder in {path.parent for path in tmp_path.rglob("scenario.toml")}:
        assert Trace.load(folder / "run.mcap").status.name == "completed"


def test_an_existing_log_is_named(tmp_path):
    path = tmp_path / "run.mcap"
    scenario = Scenario.load("push_wall", SHORT)
    simulate(scenario, sinks=[McapLog(path)])
    before = path.read_bytes()
    for kind in (InputError, FileExistsError):
        with pytest.raises(kind, match=r"run\.mcap: exists; give the log another name"):
            simulate(scenario, sinks=[McapLog(path)])
    assert path.read_bytes() == before


def test_mujocos_warnings_are_ours_and_leave_no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = mujoco.get_mju_user_warning()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        scenario = Scenario.load("push_wall", SHORT | {"wall.stiffness": 1e9, "wall.position": -1e6})
        assert simulate(scenario).status.name == "unstable"
    assert [str(each.message)[:8] for each in said if each.category is MujocoWarning] == ["MuJoCo: "]
    assert mujoco.get_mju_user_warning() is before
    assert not list(tmp_path.iterdir())


def test_an_unknown_signal_gets_a_suggestion():
    trace = simulate(Scenario.load("push_wall", SHORT))
    with pytest.raises(KeyError) as caught:
        trace["f_contact"]
    assert str(caught.value) == "no signal 'f_contact'; did you mean 'f_contact_W'?"
    with pytest.raises(AttributeError, match="did you mean 'f_contact_W'"):
        _ = trace.f_contact


def test_a_scenario_prints_what_differs_from_the_defaults():
    assert repr(Scenario()) == "<Scenario 'push_wall', gsta, defaults>"
    other = Scenario.load("push_wall", {"wall.stiffness": 2e4, "controller.K_s": 3.0}, "fosm")
    assert repr(other).splitlines()[1:] == ["    wall.stiffness = 20000.0", "    controller.K_s = 3.0>"]


def test_warnings_of_mujoco_reach_the_thread_that_stepped(monkeypatch):
    """Two threads collect warnings at the same time. Afterwards the user's handler is installed again."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    said: dict[str, list[str]] = {"0": [], "1": []}
    monkeypatch.setattr(
        warnings, "warn", lambda text, *_, **__: said[threading.current_thread().name].append(str(text))
    )
    inside, first_left = threading.Barrier(2), threading.Event()

    def collect(dof):
        with mujoco_warnings():
            inside.wait(10)
            if dof == 1:
                first_left.wait(10)
            data = mujoco.MjData(model)
            data.qvel[dof] = np.nan
            mujoco.mj_step(model, data)
        first_left.set()

    def mine(text):
        pass

    mujoco.set_mju_user_warning(mine)
    try:
        threads = [threading.Thread(target=collect, args=(dof,), name=str(dof)) for dof in (0, 1)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert mujoco.get_mju_user_warning() is mine
    finally:
        mujoco.set_mju_user_warning(None)
    for dof in ("0", "1"):
        (text,) = said[dof]
        assert f"QVEL at DOF {dof}" in text
