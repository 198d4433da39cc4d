"""Machine code: files in the cache, their fingerprint, and edits that are seen."""

import ast
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from forked import done as forked
from law_files import law_file, one_liner
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.compiler import apart
from uvms_mj.control import BUILT_IN
from uvms_mj.engine.native import compilation, objects, run_memory
from uvms_mj.engine.simulation import engine_of
from uvms_mj.physics.kernels import kernels
from uvms_mj.setup.base import set_up

LAWS = Path(__file__).parents[1] / "data" / "users_laws.py"


def test_a_cache_folder_that_cannot_be_written_is_named_and_leaves_nothing(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "temporary").mkdir()
    code = """if True:
        import os, warnings
        from uvms_mj.engine.native import objects
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            folder = objects.cache_folder()
            assert objects.cache_folder() == folder
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


@pytest.mark.slow
def test_everything_runs_as_plain_python_on_demand(capsys):
    """With UVMS_MJ_PLAIN, neither kernels nor stages are compiled, for a debugger; the numbers are the same but for the
    rounding of NumPy's products, which OpenBLAS may fuse."""
    code = """if True:
        import sys
        from uvms_mj import Scenario, simulate
        scenario = Scenario.load("push_wall", {"simulation.duration": 0.002, "wall.position": 1e-4})
        for engine in ("mujoco", "free_body"):
            trace = simulate(scenario, engine=engine, log_rate="full")
            print([float(each).hex() for name in ("p_WB", "tau") for each in trace[name][-1]])
        print("uvms_mj.compiler.unit" in sys.modules, file=sys.stderr)
    """
    environment = os.environ | {"UVMS_MJ_PLAIN": "1", "PYTHONWARNINGS": "ignore"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stderr.strip() == "False"
    exec(code, {})
    compiled, plain = (
        [[float.fromhex(each) for each in re.findall(r"-?0x[^']+", line)] for line in text.splitlines()]
        for text in (capsys.readouterr().out, done.stdout)
    )
    assert len(plain) == 2
    np.testing.assert_allclose(compiled, plain, rtol=1e-9, atol=1e-15)


@pytest.mark.slow
def test_closed_forms_are_the_same_as_plain_python_on_demand(capsys):
    """The motion to the rest is machine code, and with UVMS_MJ_PLAIN the same functions in Python."""
    code = """if True:
        import sys
        from uvms_mj import Scenario
        from uvms_mj.control.theory.predictions import steady_state
        from uvms_mj.setup.checks import checked
        for law, keys in (("gsta", {}), ("impedance", {"wall.stiffness": 2e3}), ("pid", {"bumper.stiffness": 5e3})):
            found = steady_state(checked(Scenario.load("push_wall", keys, law)))
            print(law, f"{found.force:.10g}", *(f"{1.0 + x:.12f}" for x in found.position))
        print("uvms_mj.compiler.unit" in sys.modules, file=sys.stderr)
    """
    environment = os.environ | {"UVMS_MJ_PLAIN": "1", "PYTHONWARNINGS": "ignore"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stderr.strip() == "False"
    exec(code, {})
    assert capsys.readouterr().out == done.stdout


SHORT = {"simulation.duration": 0.2}


@pytest.mark.slow
def test_an_edit_to_any_file_that_a_law_uses_is_seen_at_the_next_run(tmp_path):
    """A constant and a compiled function are edited within a second, in a file that the law's file imports."""
    body = "from helper import FACTOR, double\n" + one_liner(
        "Scaled", "for i in range(6):\n    tau_cmd[i] = FACTOR * double(1.0)"
    )
    law_file(tmp_path, body)

    def tau_with(factor, product):
        (tmp_path / "helper.py").write_text(f"FACTOR = {factor}\ndef double(x):\n    return {product} * x\n")
        out = f"out-{factor}-{product}"
        command = ("run", "-q", "-c", "my_law.py:Scaled", "simulation.duration=0.001", "-o", out)
        assert forked(*command, cwd=tmp_path).exit_code == 0
        return Trace.load(tmp_path / out / "run.mcap").tau[-1, 0]

    assert tau_with(1.0, 2.0) == pytest.approx(2.0)
    assert tau_with(3.0, 2.0) == pytest.approx(6.0)
    assert tau_with(3.0, 5.0) == pytest.approx(15.0)


@pytest.mark.parametrize(
    "change",
    [
        lambda facts: {},
        lambda facts: None,
        lambda facts: facts | {"symbols": [""]},
        lambda facts: facts | {"externals": []},
        lambda facts: facts | {"sha256": 1},
        lambda facts: {name: value for name, value in facts.items() if name != "symbols"},
    ],
)
def test_torn_facts_about_machine_code_are_compiled_again(tmp_path, monkeypatch, change):
    simulate(Scenario.load("push_wall", SHORT))
    for file in objects.cache_folder().glob("*.json"):
        code, facts = file.with_suffix(".o").read_bytes(), json.loads(file.read_bytes())
        if facts["externals"] and compilation.load(file.stem):
            break
    monkeypatch.setattr(objects, "cache_folder", lambda: tmp_path)
    (tmp_path / f"{file.stem}.o").write_bytes(code)
    (tmp_path / file.name).write_text(json.dumps(facts))
    assert compilation.load(file.stem)
    (tmp_path / file.name).write_text(json.dumps(change(facts)))
    assert compilation.load(file.stem) is None


def test_what_a_killed_process_left_in_the_cache_is_forgotten_in_time(tmp_path, monkeypatch):
    monkeypatch.setattr(objects, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(objects, "_KEPT_OBJECTS", 1)
    left = tmp_path / "new-left"
    for name in ("new-left", "new-now", "new-then"):
        (tmp_path / name).mkdir()
    (left / "torn.o").write_bytes(b"x")
    os.utime(left, (0.0, 0.0))
    objects.keep("name", b"code", ["symbol"], [])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["name.json", "name.o", "new-now", "new-then"]


def test_what_plain_python_does_is_apart_from_machine_code(monkeypatch):
    """In one process, in any order."""
    setup, made = set_up(Scenario.load("push_wall", SHORT)), []
    for plain in ("0", "1", "0", "1"):
        monkeypatch.setenv(compilation.PLAIN, plain)
        code = run_memory.RunMemory(setup, engine_of("free_body", setup)).code
        made.append([each.address for each in code.values()])
    assert made[:2] == made[2:]
    assert not {*made[0]} & {*made[1]}


def test_a_cache_that_takes_nothing_stops_no_run(monkeypatch):
    """In a missing folder, as on a full disk, no file can be written."""
    monkeypatch.setattr(objects, "cache_folder", lambda: Path("/nowhere/at/all"))
    compilation._native_functions.cache_clear()
    assert simulate(Scenario.load("push_wall", SHORT)).status.name == "completed"


def test_the_fingerprint_covers_all_that_reaches_the_machine_code():
    """Every kernel's file is in the fingerprint, and every file of the package that such a file imports, directly or
    not. Errors and validated types of settings aside, which compute nothing in a kernel."""
    package = Path(compilation.__file__).parents[2]
    covered = {path for room in objects._ROOMS for path in (package / room).rglob("*.py")}
    found: set[Path] = set()
    todo = [Path(function.__code__.co_filename) for function in kernels]
    todo = [path for path in todo if package in path.parents]  # other tests have kernels of their own
    todo += [Path(law.law.__code__.co_filename) for law in BUILT_IN.values()]
    assert len(todo) > 30
    while todo:
        path = todo.pop()
        if path in found:
            continue
        found.add(path)
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.level:
                folder = path.parents[node.level - 1] / (node.module or "").replace(".", "/")
                file = folder.with_suffix(".py")
                todo += [file] if file.is_file() else [folder / f"{a.name}.py" for a in node.names]
    assert set(objects._sources()) == {path.read_bytes() for path in covered}
    marked = {path for path in package.rglob("*.py") if re.search(r"^@(kernel|fused)\b", path.read_text(), re.M)}
    assert len(marked) > 20
    assert marked <= covered  # also where this process has not imported it
    assert {str(path.relative_to(package)) for path in found - covered} <= {"errors.py", "quantities.py", "files.py"}


@pytest.mark.parametrize(
    ("name", "settings"), [("push_wall", {"initial.position": [0.96, 0.0, 0.0]}), ("tool_push", {})]
)
def test_code_of_a_short_run_has_the_same_bits(tmp_path, monkeypatch, name, settings):
    """It is other code, which LLVM optimizes less; of joints it is not, where LLVM decides what is rounded once."""
    scenario = Scenario.load(name, SHORT | settings)
    usual = simulate(scenario).rows()
    monkeypatch.setenv("UVMS_MJ_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(objects, "cache_folder", objects.cache_folder.__wrapped__)
    levels, made = [], compilation._object
    monkeypatch.setattr(compilation, "_object", lambda text, level: levels.append(level) or made(text, level))
    compilation._native_functions.cache_clear()
    run_memory.entry_points.cache_clear()
    before = compilation.short_run.set(True)
    try:
        short = simulate(scenario).rows()
    finally:
        compilation.short_run.reset(before)
    assert 0 in levels
    np.testing.assert_array_equal(short, usual)


def _early(call):
    """A copy of this process that ends without a result."""
    return apart.forked(lambda: os._exit(1))


def _late(call):
    """A copy that waits for a lock for ever."""
    return apart.forked(lambda: time.sleep(60.0) or b"", 0.1)


@pytest.mark.parametrize("copy", [apart.forked, _early, _late])
def test_the_functions_of_a_short_run_are_one_module(tmp_path, monkeypatch, copy):
    """Stages and the loop share what they call. A copy of this process makes it; if it does not, this process does.
    Another run of the process takes the same machine code."""
    monkeypatch.setenv("UVMS_MJ_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(objects, "cache_folder", objects.cache_folder.__wrapped__)
    scenario, made, taken = Scenario.load("push_wall", SHORT), [], compilation._taken
    here, compiled = [], compilation._object
    monkeypatch.setattr(compilation, "_taken", lambda *given: made.append(given[1]) or taken(*given))
    monkeypatch.setattr(compilation, "_object", lambda *given: here.append(given[1]) or compiled(*given))
    monkeypatch.setattr(compilation, "forked", lambda call, most_s: copy(call))
    compilation._native_functions.cache_clear()
    run_memory.entry_points.cache_clear()
    before = compilation.short_run.set(True)
    try:
        one, other = (
            run_memory.RunMemory(setup, engine_of("free_body", setup), lambda memory: None)
            for setup in (set_up(scenario), set_up(scenario))
        )
    finally:
        compilation.short_run.reset(before)
    assert here == ([] if copy is apart.forked and sys.platform == "linux" else [0])
    assert len(made) == 1
    assert len(made[0]) > len(one.stages.stages)
    assert [each.address for each in one.code.values()] == [each.address for each in other.code.values()]


@pytest.mark.parametrize("copy", [apart.forked, _early, _late])
def test_a_users_stage_of_a_short_run_is_made_beside_the_set_up(tmp_path, monkeypatch, copy):
    """A copy of this process makes it, as long as LLVM does not work in another thread here; otherwise this process
    does, when the run needs it."""
    monkeypatch.setenv("UVMS_MJ_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(objects, "cache_folder", objects.cache_folder.__wrapped__)
    monkeypatch.setattr(compilation, "_stages", {})
    monkeypatch.setattr(compilation, "forked", lambda call, most_s: copies.append(call) or copy(call))
    here, copies, compiled = [], [], compilation._object
    monkeypatch.setattr(compilation, "_object", lambda *given: here.append(given[1]) or compiled(*given))
    scenario = Scenario.load("push_wall", SHORT, f"{LAWS}:Backstepping")
    rows = [simulate(scenario).rows()]
    assert here.count(1) > 0
    for busy in (False, True):
        monkeypatch.setattr(compilation, "_stages", {})
        for file in tmp_path.iterdir():
            file.unlink()
        here.clear()
        copies.clear()
        wait = threading.Event()
        other = threading.Thread(target=wait.wait, name=compilation._OF_LLVM if busy else "of a user")
        other.start()
        before = compilation.short_run.set(True)
        try:
            rows.append(simulate(scenario).rows())
        finally:
            compilation.short_run.reset(before)
            wait.set()
            other.join()
        made_here = busy or copy is not apart.forked or sys.platform != "linux"
        assert (here.count(1) > 0) is made_here
        assert bool(copies) is not busy
    np.testing.assert_array_equal(rows[0], rows[1])
    np.testing.assert_array_equal(rows[0], rows[2])


def test_a_users_stage_that_llvm_cannot_make_runs_as_plain_python(tmp_path, monkeypatch):
    """Also in a short run, which learns it when the run needs the code. The numbers are the same."""
    monkeypatch.setenv("UVMS_MJ_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(objects, "cache_folder", objects.cache_folder.__wrapped__)
    scenario = Scenario.load("push_wall", SHORT | {"simulation.duration": 0.01}, f"{LAWS}:Backstepping")
    usual, made = simulate(scenario), compilation._object

    def fails(text, level):
        if compilation._STAGE in text:
            raise RuntimeError("no registers are left")
        return made(text, level)

    monkeypatch.setattr(compilation, "_object", fails)
    for short in (False, True):
        monkeypatch.setattr(compilation, "_stages", {})
        for file in tmp_path.iterdir():
            file.unlink()
        before = compilation.short_run.set(short)
        try:
            with pytest.warns(UserWarning, match="runs as plain Python.*no registers are left"):
                trace = simulate(scenario)
        finally:
            compilation.short_run.reset(before)
        np.testing.assert_array_equal(trace.rows(), usual.rows())


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777])
def test_a_folder_that_others_may_write_is_not_used(tmp_path, monkeypatch, mode):
    """They could put code into it, which this process would run."""
    folder = tmp_path / "shared"
    folder.mkdir()
    monkeypatch.setenv("UVMS_MJ_CACHE_DIR", str(folder))
    folder.chmod(0o700)
    assert objects.cache_folder.__wrapped__() == folder
    folder.chmod(mode)
    with pytest.warns(objects.CacheWarning, match=f"other users may write there.*chmod go-w {folder}"):
        used = objects.cache_folder.__wrapped__()
    assert used != folder
    assert not list(folder.iterdir())


def test_a_folder_that_is_made_is_the_users_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("UVMS_MJ_CACHE_DIR", str(tmp_path / "a" / "b"))
    before = os.umask(0)
    try:
        assert objects.cache_folder.__wrapped__().stat().st_mode & 0o777 == 0o700
    finally:
        os.umask(before)


@pytest.mark.skipif(sys.platform != "linux", reason="a copy of a process is made on Linux alone")
def test_a_copy_ends_if_nobody_takes_its_result():
    """It is more than a pipe holds; the process that has begun the copy ends, as an export does that is refused."""
    code = """if True:
        import os, time
        from uvms_mj.compiler.apart import forked
        forked(lambda: time.sleep(0.2) or bytes(1 << 20))
        os._exit(0)
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=30)  # to the copy's end
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(sys.platform != "linux", reason="a copy of a process is made on Linux alone")
def test_a_part_of_a_result_of_a_copy_is_none():
    def dies():  # while the pipe, which holds less, is full
        threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGKILL)).start()
        return bytes(1 << 20)

    assert apart.forked(lambda: b"whole")() == b"whole"
    assert apart.forked(lambda: 1 / 0)() == b""
    result = apart.forked(dies)
    time.sleep(1.0)
    assert result() == b""
