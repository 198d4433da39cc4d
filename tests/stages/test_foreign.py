"""Stages in C and in libraries: they give the numbers of the same stage in Python, bit for bit."""

import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from uvms_mj import InputError, Scenario, Simulation, StageFault, Trace, simulate
from uvms_mj.cli.new import IN_C, write_new
from uvms_mj.compiler import libm
from uvms_mj.engine.native.tools import compiler, tool
from uvms_mj.records.mcap import McapLog
from uvms_mj.scenario import STAGES
from uvms_mj.stages.foreign import Records, header
from uvms_mj.studies.bundle import StudyBundle
from uvms_mj.studies.study import Study

PD = """
#include "uvms_stage.h"

int NAME(const struct settings *gains, struct state *state, const struct signals *signals, struct state *state_dot,
    double *tau_cmd)
{
    for (int i = 0; i < 6; i++)
        tau_cmd[i] = signals->g_hat[i] - gains->k_p * signals->eta_e[i] - gains->k_d * signals->nu_e[i];
    return 0;
}
"""
PD_TOML = """
stage = "controller"
uses_task = false
settings.k_p = {default = 200.0, above = 0.0, unit = "N/m, N m", meaning = "stiffness"}
settings.k_d = {default = 150.0, at_least = 0.0}
"""
GSTA = """
#include "uvms_stage.h"

int gsta_in_c(const struct settings *gains, struct state *state, const struct signals *signals, struct state *state_dot,
    double *tau_cmd)
{
    double a[6];
    for (int i = 0; i < 6; i++) {
        double s = signals->s[i], sgn = (s > 0.0) - (s < 0.0), root = sqrt(fabs(s)) * sgn;
        double phi_1 = root + gains->beta * s;
        double phi_2 = 0.5 * sgn + 1.5 * gains->beta * root + gains->beta * gains->beta * s;
        a[i] = -gains->k_1 * phi_1 + state->z[i];
        state_dot->z[i] = -gains->k_2[i] * phi_2;
        tau_cmd[i] = 0.0;
        if (gains->nominal) {
            a[i] -= signals->A[i] * s;
            tau_cmd[i] = signals->tau_nom[i];
        }
    }
    for (int j = 0; j < 6; j++)
        for (int i = 0; i < 6; i++)
            tau_cmd[i] += signals->M_hat[i][j] * a[j];
    return 0;
}
"""
GSTA_TOML = """
stage = "controller"
settings.k_1 = {default = 5.0, at_least = 0.0}
settings.k_2 = {default = [10.0, 10.0, 10.0, 10.0, 10.0, 10.0], at_least = 0.0}
settings.beta = {default = 5.0, at_least = 0.0}
settings.nominal = {default = true}
states.z = {size = 6, unit = "m/s^2, rad/s^2"}
"""


def written(folder: Path, name: str, code: str = PD, description: str = PD_TOML) -> str:
    folder.joinpath(f"{name}.c").write_text(code.replace("NAME", name))
    folder.joinpath(f"{name}.toml").write_text(description)
    return str(folder / f"{name}.c")


def library(folder: Path, name: str, **given: str) -> str:
    """A library that was compiled with the header of its description."""
    file = written(folder, name, **given)
    write_new("header", str(folder / f"{name}.toml"))
    built = folder / f"lib{name}.so"
    options = ["-shared", "-fPIC", "-O2", "-ffp-contract=off", "-o", str(built), file, "-lm"]
    subprocess.run([*compiler(), *options], check=True)
    return f"{built}:{name}"


CLOSE = {"rtol": 1e-4, "atol": 1e-5}
"""Of two stages whose sin, cos or log are the C library's in one and the project's in the other: GSTA amplifies the
last digit in its command and the accelerations."""


def assert_same(a: Trace, b: Trace, called: dict[str, str] | None = None, **close: float) -> None:
    """``called`` are names of signals of b that are others in a; bit for bit without ``close``."""
    names = {signal.name: (called or {}).get(signal.name, signal.name) for signal in b.signals}
    assert [signal.name for signal in a.signals] == list(names.values())
    assert a.status is b.status
    for name, in_a in names.items():
        if close:
            np.testing.assert_allclose(a[in_a], b[name], err_msg=name, **close)
        else:
            np.testing.assert_array_equal(a[in_a], b[name], err_msg=name)


NEAR = {"initial.position": [0.95, 0.0, 0.0], "reference.step_time": 0.0, "simulation.duration": 2.6}
"""A run that touches the wall at 2.3 s."""


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_a_law_in_c_is_the_law_in_python_bit_for_bit(tmp_path, engine):
    scenario = Scenario.load("push_wall", NEAR)
    in_c = scenario.updated({}, controller=written(tmp_path, "gsta_in_c", GSTA, GSTA_TOML))
    ours = simulate(scenario, engine=engine)
    assert ours.push.max() > 1.0
    assert_same(ours, simulate(in_c, engine=engine))


@pytest.mark.parametrize("kind", IN_C)
def test_a_stage_of_the_template_in_c_is_the_template_in_python(tmp_path, monkeypatch, kind):
    monkeypatch.chdir(tmp_path)
    write_new(kind, "in_c", language="c")
    write_new(kind, "in_python")
    table = {"law": "controller", "sensor": "navigation"}.get(kind, kind)
    given = {"current.speed": 0.0, "wall.stiffness": 2e3} if kind == "observer" else {}
    scenario = Scenario.load("push_wall", NEAR | given)
    key = "effects" if kind == "effect" else f"{table}.name"
    theirs, ours = (
        scenario.updated({key: [{"name": name}] if kind == "effect" else name})
        for name in ("in_c.c", "in_python.py:InPython")
    )
    called, close = {"tau_InPython": "tau_in_c"}, CLOSE if kind in ("reference", "sensor") else {}
    assert_same(simulate(theirs, engine="free_body"), simulate(ours, engine="free_body"), called, **close)
    with Simulation(theirs, engine="free_body") as a, Simulation(ours, engine="free_body") as b:  # after a reset, too
        for sim in (a, b):
            sim.step(100)
            sim.reset({"current.speed": 0.05})
            sim.step(100)
        for name in b.signals:
            mine, other = (np.array(each, float) for each in (a.signals[called.get(name, name)], b.signals[name]))
            np.testing.assert_allclose(mine, other, err_msg=name, **(close or {"rtol": 0.0}))


@pytest.mark.parametrize("table", [table for table in STAGES if table != "wrist"])
def test_a_c_compiler_gives_the_records_the_sizes_and_places_that_the_loop_gives_them(tmp_path, table):
    description = f'stage = "{table}"\nsettings = {{a = {{default = true}}, b = {{default = [1.0, 2.0]}}}}\n'
    description += "states = {x = {size = 3, start = [1, 2.5, 3]}, queue = {size = 5, advanced = false, start = 0.5}}\n"
    kind = STAGES[table].stage_class(written(tmp_path, "sized", "", description))
    assert [each.tolist() for each in kind.start_record()[0]] == [[1.0, 2.5, 3.0], [0.5] * 5]
    records = Records.of(kind(), 7)
    structs = {"settings": records.settings, "state": records.state}
    structs |= {"signals" if table == "controller" else "given": records.given}
    structs |= {"out": records.out} if records.out.names else {}
    lines = [
        f'printf("%zu %zu\\n", offsetof(struct {name}, {field if field != "_" else "unused"}), '
        f"sizeof(((struct {name} *)0)->{field if field != '_' else 'unused'}));"
        for name, dtype in structs.items()
        for field in dtype.names
    ]
    program = tmp_path / "sizes.c"
    body = header(kind, records) + "\n#include <stdio.h>\n#include <stddef.h>\nint main(void) {\n" + "\n".join(lines)
    program.write_text(f"{body}\nreturn sizeof(struct settings) != {records.settings.itemsize};\n}}\n")
    subprocess.run([*compiler(), "-o", str(tmp_path / "sizes"), str(program), "-lm"], check=True)
    printed = subprocess.run([str(tmp_path / "sizes")], check=True, capture_output=True, text=True).stdout.splitlines()
    places = [(dtype.fields[f][1], dtype.fields[f][0].itemsize) for dtype in structs.values() for f in dtype.names]
    assert [tuple(map(int, line.split())) for line in printed] == places


def test_a_header_says_units_and_meanings_and_frames(tmp_path):
    description = PD_TOML.replace('"stiffness"', '"stiff */ ness"')
    kind = STAGES["controller"].stage_class(written(tmp_path, "pd", PD, description))
    text = " ".join(header(kind, Records.of(kind(), 6)).split())
    assert "double k_p; /* [N/m, N m] stiff * / ness */" in text
    assert "double t; /* [s] time of the instant */" in text
    assert "double p_WB[3]; /* [m] position of B's origin, in W */" in text
    assert "double M_hat[6][6]; /* [kg, kg m, kg m^2]" in text


_TWO = ("pow", "hypot", "fmod", "atan2")
_FUNCTIONS_OF_PYTHON = """
import math
from dataclasses import dataclass
from uvms_mj import Controller

@dataclass(frozen=True)
class InPython(Controller):
    uses_task = False

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            x = 0.5 + 0.45 * math.sin(40.0 * signals.t + i)
            total = 0.0
LINES
            tau_cmd[i] = 0.001 * total
"""
_FUNCTIONS_OF_C = """
#include "uvms_stage.h"

int in_c(const struct settings *gains, struct state *state, const struct signals *signals, struct state *state_dot,
    double *tau_cmd)
{
    for (int i = 0; i < 6; i++) {
        double x = 0.5 + 0.45 * sin(40.0 * signals->t + i), total = 0.0;
LINES
        tau_cmd[i] = 0.001 * total;
    }
    return 0;
}
"""


def test_functions_of_math_h_have_the_bits_of_python(tmp_path):
    """All functions of this project."""
    x = {"acosh": "1.0 + x"}
    calls = [f"{each}({x.get(each, 'x')}{', 0.5 + i' if each in _TWO else ''})" for each in libm.FUNCTIONS]
    lines = "\n".join(f"            total += math.{each}" for each in calls)
    in_c = "\n".join(f"total += {each};" for each in calls)
    (tmp_path / "in_python.py").write_text(_FUNCTIONS_OF_PYTHON.replace("LINES", lines))
    (tmp_path / "in_c.c").write_text(_FUNCTIONS_OF_C.replace("LINES", in_c))
    (tmp_path / "in_c.toml").write_text('stage = "controller"\nuses_task = false\n')
    found = [
        simulate(Scenario.load("push_wall", {"simulation.duration": 0.2}, str(tmp_path / law)), engine="free_body")
        for law in ("in_python.py:InPython", "in_c.c")
    ]
    assert np.unique(found[0].tau_cmd).size > 1000
    assert np.array_equal(found[0].tau_cmd, found[1].tau_cmd)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a library finds its own functions first")
def test_a_law_calls_its_own_function_also_where_the_c_library_has_one_of_its_name(tmp_path):
    """gamma, the logarithm of the gamma function, is in the C library of this process."""
    helper = "__attribute__((noinline)) double gamma(double x) { return 2.0 * x; }\n\nint NAME("
    found = []
    for name, form in (("plain", "2.0 * (signals->eta_e[i])"), ("helped", "gamma(signals->eta_e[i])")):
        law = PD.replace("signals->eta_e[i]", form).replace("int NAME(", helper).replace("NAME", name)
        (tmp_path / f"{name}.c").write_text(law)
        (tmp_path / f"{name}.toml").write_text(PD_TOML)
        found.append(simulate(Scenario.load("push_wall", {"simulation.duration": 0.1}, str(tmp_path / f"{name}.c"))))
    assert np.array_equal(found[0].tau_cmd, found[1].tau_cmd)


def test_each_run_has_static_data_of_its_own(tmp_path):
    counting = PD.replace(
        "{\n    for", "{\n    static double calls;\n    calls += 1.0;\n    state->count[0] = calls;\n    for", 1
    )
    file = written(tmp_path, "counting", counting, f"{PD_TOML}states.count = {{size = 1}}\n")
    scenario = Scenario.load("push_wall", {"controller.name": file})
    with Simulation(scenario, engine="free_body") as a, Simulation(scenario, engine="free_body") as b:
        threads = [threading.Thread(target=sim.step, args=(n,)) for sim, n in ((a, 3000), (b, 2000))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert (a.signals.count, b.signals.count) == (3000.0, 2000.0)


def test_a_library_is_the_c_file_that_it_was_made_of(tmp_path):
    scenario = Scenario.load("push_wall", {"simulation.duration": 6.0})
    names = library(tmp_path, "pd"), str(tmp_path / "pd.c")
    a, b = (
        simulate(scenario.updated({"controller.k_p": 300.0}, controller=name), engine="free_body") for name in names
    )
    assert_same(a, b)
    assert (a.header.law.source, b.header.law.source) == ("libpd.so:pd", "pd.c:pd")
    assert a.header.law.code == ""
    assert "struct signals" in b.header.law.code


@pytest.mark.slow
def test_a_study_varies_a_gain_in_c_as_one_in_python(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_new("law", "in_c", language="c")
    write_new("law", "in_python")
    frames = []
    for name in ("in_c.c", "in_python.py:InPython"):
        tables = {
            "laws": [name],
            "base": {"scenario": "push_wall", "simulation": {"duration": 0.2}},
            "run": {"engine": "free_body"},
            "design": {"runs": 6, "seed": 7},
            "vary": [{"key": "controller.k_p", "distribution": "uniform", "low": 100.0, "high": 300.0}],
        }
        frames.append(Study.from_dict(tables).run(tmp_path / Path(name).stem, workers=2).frame.drop(columns="law"))
    assert len(frames[0]) == 6
    assert frames[0].equals(frames[1])


@pytest.mark.slow
@pytest.mark.processes
def test_a_crash_in_c_loses_its_own_run(tmp_path, monkeypatch):
    monkeypatch.setattr("uvms_mj.studies.pool.executors.ATTEMPTS", 1)
    crash = PD.replace("return 0;", "return gains->k_p > 200.0 ? *(volatile int *)8 : 0;")
    tables = {
        "laws": [written(tmp_path, "crash", crash)],
        "base": {"scenario": "push_wall", "simulation": {"duration": 0.5}},
        "run": {"engine": "free_body"},
        "vary": [{"key": "controller.k_p", "values": [100.0, 250.0, 180.0]}],
    }
    frame = Study.from_dict(tables).run(tmp_path / "out", workers=1).frame
    assert list(frame["status"] == "completed") == [True, False, True]


@pytest.mark.parametrize("plain", ["", "1"])
def test_what_a_stage_in_c_does_wrong_is_named(tmp_path, monkeypatch, plain):
    monkeypatch.setenv("UVMS_MJ_PLAIN", plain)
    for code, words in (
        (PD.replace("return 0;", "return signals->t > 0.002 ? -7 : 0;"), "your law wrong (wrong.c) returned -7"),
        (PD.replace("return 0;", "tau_cmd[3] = signals->t / 0.0; return 0;"), "set tau_cmd[3] to "),
        (PD.replace("i < 6", "i < 5"), "left tau_cmd[5] unset"),
    ):
        file = written(tmp_path, "wrong", code)
        with Simulation(Scenario.load("push_wall", {"controller.name": file}), engine="free_body") as sim:
            with pytest.raises(StageFault) as raised:
                sim.step(300)
            assert words in str(raised.value)
            sim.reset()
            assert sim.t == 0.0


LAW = 'stage = "controller"\n'
REFUSED = [
    ("no_file.c", None, None, "no file 'no_file.c'"),
    ("pd.c", PD, None, "no file pd.toml in"),
    ("pd-1.c", PD, PD_TOML, "'pd-1' is not the name of a C function"),
    ("pd.c", "int NAME(", PD_TOML, "pd.c does not compile with"),
    ("pd.c", PD.replace("int NAME", "int other"), PD_TOML, "has no function pd"),
    ("pd.c", PD.replace("k_d", "k_v"), PD_TOML, "k_v"),
    ("pd.c", PD, 'stage = "control"', "stage: 'control' is not a table of a scenario"),
    ("pd.c", PD, f"{LAW}setings = 3\n", "setings: no such key; did you mean 'settings'?"),
    ("pd.c", PD, f"{LAW}states = 3\n", "states: 3 is not a table"),
    ("pd.c", PD, f'{LAW}uses_task = "no"\n', "uses_task"),
    ("pd.c", PD, f'{LAW}settings.k = {{default = "a"}}\n', "settings.k.default: 'a' must be a finite number"),
    ("pd.c", PD, f"{LAW}settings._ = {{default = 1.0}}\n", "settings._: '_' is no name of a field in C"),
    ("pd.c", PD, f"{LAW}settings.double = {{default = 1.0}}\n", "'double' is no name of a field in C"),
    ("pd.c", PD, f"{LAW}settings.period = {{default = 1e-3}}\n", "settings.period: is a key of every controller"),
    ("pd.c", PD, f"{PD_TOML}settings.k = {{default = 1.0, at_most = 0.5}}\n", "controller.k: 1.0 must be at most 0.5"),
    ("pd.c", PD, f"{PD_TOML}settings.k = {{default = 1.0, below = 1.0}}\n", "controller.k: 1.0 must be less than 1"),
    ("pd.c", PD, PD_TOML.replace("= 200.0", "= 0.0"), "controller.k_p: 0.0 must be greater than 0"),
    ("pd.c", PD, PD_TOML.replace("= 150.0", "= [1, -1]"), "controller.k_d[1]: -1.0 must be at least 0"),
    ("pd.c", PD, f"{LAW}states.x = {{size = 0}}\n", "states.x.size: 0 must be a whole number"),
    ("pd.c", PD, f"{LAW}states.nu = {{size = 6}}\n", "'nu' is the name of a signal"),
    ("pd.c", PD, f"{LAW}stage", "not a description in TOML"),
    ("libpd.so", "text", PD_TOML, "names no function; give "),
    ("libpd.so:pd", "text", PD_TOML, "is not a library that this machine loads"),
    ("libpd.so:pd", None, PD_TOML, "no file"),
    # what C forgives and a law does not survive
    ("pd.c", PD.replace("tau_cmd[i] =", 'tau_cmd[i] = atof("1") *'), PD_TOML, "implicit"),
    ("pd.c", PD.replace("return 0;", ""), PD_TOML, "return-type"),
    ("pd.c", PD.replace("for (int", "float *p = tau_cmd; for (int"), PD_TOML, "incompatible"),
]


@pytest.mark.parametrize(("name", "code", "description", "words"), REFUSED, ids=lambda each: str(each)[:20])
def test_what_can_not_be_a_stage_is_refused_in_one_sentence(tmp_path, monkeypatch, name, code, description, words):
    monkeypatch.chdir(tmp_path)
    if code is not None:
        Path(name.partition(":")[0]).write_text(code.replace("NAME", "pd"))
    if description is not None:
        Path("pd.toml").write_text(description)
    with pytest.raises(InputError) as raised:
        Simulation(Scenario.load("push_wall", {"controller.name": name}), engine="free_body")
    assert words in str(raised.value)


def test_a_library_of_other_records_is_refused(tmp_path):
    scenario = Scenario.load("push_wall")
    name = library(tmp_path, "pd")
    for change, words in (
        (("above = 0.0", "above = 1.0"), ""),
        (("k_d", "k_v"), "was compiled with other records; compile it again"),
        (("default = 150.0", "default = [1.0, 2.0]"), "its settings have 24 bytes there, 32 here"),
    ):
        (tmp_path / "pd.toml").write_text(PD_TOML.replace(*change))
        with Simulation(scenario, engine="free_body"):
            pass
        if not words:
            Simulation(scenario.updated({}, controller=name), engine="free_body").close()
            continue
        with pytest.raises(InputError, match=words):
            Simulation(scenario.updated({}, controller=name), engine="free_body")


def test_a_library_without_the_number_of_its_records_is_refused(tmp_path):
    written(tmp_path, "bare")
    (tmp_path / "bare.c").write_text("int bare(void) { return 0; }\n")
    options = ["-shared", "-fPIC", "-o", str(tmp_path / "libbare.so"), str(tmp_path / "bare.c")]
    subprocess.run([*compiler(), *options], check=True)
    with pytest.raises(InputError, match="has no bare_records: include"):
        Simulation(Scenario.load("push_wall", {"controller.name": f"{tmp_path}/libbare.so:bare"}), engine="free_body")


def test_the_compiler_of_the_package_ziglang_gives_the_same_numbers(tmp_path, monkeypatch):
    pytest.importorskip("ziglang")
    file = written(tmp_path, "gsta_in_c", GSTA, GSTA_TOML)
    scenario = Scenario.load("push_wall", {"simulation.duration": 7.0, "controller.name": file})
    here = simulate(scenario, engine="free_body")
    monkeypatch.setenv("CC", f"{sys.executable} -m ziglang cc")
    assert_same(here, simulate(scenario, engine="free_body"))


def test_without_a_compiler_one_sentence_says_so(tmp_path, monkeypatch):
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    file = written(tmp_path, "pd")
    with pytest.raises(InputError, match="no C compiler: install one"):
        Simulation(Scenario.load("push_wall", {"controller.name": file}), engine="free_body")


def test_a_log_has_the_code_and_its_description(tmp_path):
    file = written(tmp_path, "pd")
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.1, "controller.name": file})
    simulate(scenario, sinks=[McapLog(tmp_path / "run.mcap")])
    trace = Trace.load(tmp_path / "run.mcap")
    assert trace.header.law.source == "pd.c:pd"
    assert trace.header.law.code == (tmp_path / "pd.c").read_text()
    assert trace.header.law.files == {"pd.toml": PD_TOML.encode()}
    with pytest.raises(InputError, match="never run"):
        simulate(trace.scenario)
    again = simulate(trace.scenario.updated({}, controller=file))
    assert_same(again, simulate(trace.scenario.updated({"controller.name": file})))


def test_the_header_of_another_stage_is_not_overwritten(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_new("law", "one", language="c")
    with pytest.raises(InputError, match="is the header of another stage; give each stage in C a folder of its own"):
        write_new("sensor", "other", language="c")
    assert {path.name for path in tmp_path.iterdir()} == {"one.c", "one.toml", "uvms_stage.h"}
    write_new("sensor", "other", out="sensor", language="c")
    write_new("header", "one.toml")


@pytest.mark.parametrize(
    ("include", "files"),
    [
        ('#include "gain.h"', {"pd.toml", "gain.h"}),
        ('#include "../common/gain.h"', {"pd.toml"}),
        ('#define WHICH "../common/gain.h"\n#include WHICH', {"pd.toml"}),
    ],
)
def test_a_change_of_any_header_is_compiled(tmp_path, include, files):
    """Also of one above the law's folder, and by a path that leads through another folder."""
    for folder in ("common", "laws", "scenarios"):
        (tmp_path / folder).mkdir()
    written(tmp_path / "laws", "pd", f"{include}\n" + PD.replace("gains->k_p *", "GAIN * gains->k_p *"))
    law = str(tmp_path / "scenarios" / ".." / "laws" / "pd.c")
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.2})
    found = []
    for value, k_p in (("1.0", 400.0), ("2.0", 200.0), ("1.0", 200.0)):
        for gain in (tmp_path / "common" / "gain.h", tmp_path / "laws" / "gain.h"):
            gain.write_text(f"#define GAIN {value}\n")
        trace = simulate(scenario.updated({"controller.k_p": k_p}, controller=law), engine="free_body")
        assert set(trace.header.law.files) == files
        found.append(trace.tau)
    np.testing.assert_array_equal(found[0], found[1])
    assert not np.array_equal(found[0], found[2])


def test_a_law_in_cpp_is_a_library(tmp_path):
    if shutil.which("g++") is None:
        pytest.skip("no g++")
    written(tmp_path, "pd")
    write_new("header", str(tmp_path / "pd.toml"))
    (tmp_path / "pd.c").rename(tmp_path / "pd.cpp")
    options = ["-shared", "-fPIC", "-O2", "-ffp-contract=off", "-o", "libpd.so", "pd.cpp"]
    subprocess.run(["g++", *options], check=True, cwd=tmp_path)
    Simulation(Scenario.load("push_wall", {"controller.name": f"{tmp_path}/libpd.so:pd"}), engine="free_body").close()


def test_a_library_without_its_end_is_refused(tmp_path):
    name = library(tmp_path, "pd")
    whole = (tmp_path / "libpd.so").read_bytes()
    for share in (0.005, 0.1, 0.3, 0.5):
        (tmp_path / "libpd.so").write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(InputError, match=r"libpd\.so is not a library that this machine loads"):
            Simulation(Scenario.load("push_wall", {"controller.name": name}), engine="free_body")


def test_a_library_finds_another_beside_it(tmp_path):
    (tmp_path / "helper.c").write_text("double helped(double x) { return 2.0 * x; }\n")
    options = ["-shared", "-fPIC", "-O2"]
    subprocess.run([*compiler(), *options, "-o", "libhelper.so", "helper.c"], check=True, cwd=tmp_path)
    written(tmp_path, "pd", "double helped(double);\n" + PD.replace("gains->k_p *", "helped(0.5) * gains->k_p *"))
    write_new("header", str(tmp_path / "pd.toml"))
    last = ["-o", "libpd.so", "pd.c", "-L.", "-lhelper", "-Wl,-rpath,$ORIGIN"]
    subprocess.run([*compiler(), *options, *last], check=True, cwd=tmp_path)
    Simulation(Scenario.load("push_wall", {"controller.name": f"{tmp_path}/libpd.so:pd"}), engine="free_body").close()
    assert sorted(path.name for path in tmp_path.glob(".*")) == []
    study = Study.from_dict({"laws": [f"{tmp_path}/libpd.so:pd"], "base": {"scenario": "push_wall"}})
    assert "libhelper.so" in {Path(name).name for name in StudyBundle.of(study.plan).files}


def test_a_log_s_gains_are_those_of_the_file_however_it_is_named(tmp_path):
    file = written(tmp_path, "pd")
    scenario = Scenario.load(
        "push_wall", {"simulation.duration": 0.1, "controller.name": file, "controller.k_p": 900.0}
    )
    simulate(scenario, sinks=[McapLog(tmp_path / "run.mcap")], engine="free_body")
    recorded = Trace.load(tmp_path / "run.mcap").scenario
    for name in (file, f"{file}:pd"):
        assert recorded.updated({}, controller=name).controller.k_p == 900.0


def test_a_compiler_that_is_no_command_is_named(tmp_path, monkeypatch):
    file = written(tmp_path, "pd", PD + f"/* {tmp_path} */")
    for given, words in (
        ("'", "No closing quotation"),
        ("no_such_cc", "the C compiler no_such_cc"),
        ("false", "status 1"),
    ):
        monkeypatch.setenv("CC", given)
        with pytest.raises(InputError, match=words):
            Simulation(Scenario.load("push_wall", {"controller.name": file}), engine="free_body")


COUNTS = PD.replace("{\n    for", "{\n    state->count[0] = COUNT;\n    for", 1)
COUNTED = f"{PD_TOML}states.count = {{size = 1, advanced = false}}\n"


def count_of(source: str, resets: int = 1) -> list[float]:
    """How often a law has been called, by its own static data, after 50 instants of each run of a Simulation."""
    found = []
    with Simulation(Scenario.load("push_wall", {"controller.name": source}), engine="free_body") as sim:
        for _ in range(1 + resets):
            sim.step(50)
            found.append(float(sim.memory.stages.stages["controller"].state["count"][0, 0]))
            sim.reset()
    return found


@pytest.mark.parametrize("suffix", ["c", "cpp"])
@pytest.mark.parametrize("beside", [False, True])
def test_static_data_begin_each_run_anew(tmp_path, suffix, beside):
    """Of a library and of one beside it, in C and of C++ templates, which g++ makes unique in a process."""
    if suffix == "cpp" and shutil.which("g++") is None:
        pytest.skip("no g++")
    tool = "g++" if suffix == "cpp" else compiler()[0]
    build = [tool, "-shared", "-fPIC", "-O2", "-ffp-contract=off"]
    linkage = 'extern "C" ' if suffix == "cpp" else ""
    calls, own = "calls", "static double calls;\n"
    if suffix == "cpp":
        own = "template <class T> struct Of { static T calls; };\ntemplate <class T> T Of<T>::calls;\n"
        calls = "Of<double>::calls"
    counts = f"{own}{linkage}double counted(void) {{ return {calls} += 1.0; }}\n"
    written(tmp_path, "pd", COUNTS.replace("COUNT", "counted()"), COUNTED)
    write_new("header", str(tmp_path / "pd.toml"))
    head, last = counts, list[str]()
    if beside:
        (tmp_path / f"helper.{suffix}").write_text(counts)
        options = ["-o", "libhelper.so", "-Wl,-soname,libhelper.so", f"helper.{suffix}"]
        subprocess.run([*build, *options], check=True, cwd=tmp_path)
        head, last = f"{linkage}double counted(void);\n", ["-L.", "-lhelper", "-Wl,-rpath,$ORIGIN"]
    text = (tmp_path / "pd.c").read_text()
    (tmp_path / f"pd.{suffix}").write_text(head + text)
    subprocess.run([*build, "-o", "libpd.so", f"pd.{suffix}", *last], check=True, cwd=tmp_path)
    before = sorted(path.name for path in tmp_path.iterdir())
    sources = [f"{tmp_path}/libpd.so:pd"] + ([f"{tmp_path}/pd.c"] if suffix == "c" and not beside else [])
    for source in sources:
        for _ in range(2):
            assert count_of(source) == [50.0, 50.0]
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_random_numbers_of_c_begin_each_run_anew(tmp_path):
    source = written(tmp_path, "pd", "#include <stdlib.h>\n" + COUNTS.replace("COUNT", "rand()"), COUNTED)
    first = count_of(source)
    assert count_of(source) == first
    assert len(set(first)) == 1


def test_a_file_that_the_assembler_reads_is_compiled(tmp_path):
    data = 'extern const double gain_of_file;\n__asm__(".section .rodata\\n.balign 8\\n.global gain_of_file\\n"\n'
    data += '"gain_of_file: .inc" "bin \\"gain.bin\\"\\n.text\\n");\n'
    source = written(tmp_path, "pd", data + COUNTS.replace("COUNT", "gain_of_file"), COUNTED)
    for gain in (2.0, 3.0):
        (tmp_path / "gain.bin").write_bytes(np.float64(gain).tobytes())
        assert count_of(source, 0) == [gain]


def test_a_damaged_library_that_is_kept_is_compiled_again(tmp_path, monkeypatch):
    from uvms_mj.engine.native import objects, shared_library

    for module in (objects, shared_library):
        monkeypatch.setattr(module, "cache_folder", lambda: tmp_path)
    source = written(tmp_path, "pd", COUNTS.replace("COUNT", "7"), COUNTED)
    assert count_of(source) == [7.0, 7.0]
    (kept,) = tmp_path.glob("c-*.so")
    whole = kept.read_bytes()
    for damaged in (whole[:100], b"", bytes([whole[0] ^ 1]) + whole[1:]):
        kept.write_bytes(damaged)
        assert count_of(source) == [7.0, 7.0]
        assert kept.read_bytes() == whole


@pytest.mark.filterwarnings("ignore::uvms_mj.engine.vehicle_run.PlainPythonWarning")
@pytest.mark.parametrize("plain", ["", "1"])
def test_floating_point_modes_that_a_stage_changes_are_its_own(tmp_path, monkeypatch, plain):
    monkeypatch.setenv("UVMS_MJ_PLAIN", plain)
    rounds = PD.replace("return 0;", "if (gains->k_d > 150.0) fesetround(FE_UPWARD);\n    return 0;")
    source = written(tmp_path, "pd", "#include <fenv.h>\n" + rounds)
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.003, "controller.name": source})
    ours = simulate(scenario.updated({"controller.k_d": 151.0}), engine="free_body")
    without = written(tmp_path / "without", "pd") if (tmp_path / "without").mkdir() is None else ""
    theirs = simulate(scenario.updated({"controller.k_d": 151.0}, controller=without), engine="free_body")
    assert_same(ours, theirs)
    assert np.nextafter(1.0, 2.0) * (1.0 - 2.0**-53) == 1.0  # 1 + 2**-52 upward


@pytest.mark.processes
def test_a_law_in_c_that_prints_or_exits(tmp_path):
    """What it prints is not in JSON; and exit(0) is no success."""
    import json

    from forked import done

    says = PD.replace("return 0;", 'printf("said by C\\n"); if (signals->t > gains->k_p) exit(0);\n    return 0;')
    source = written(tmp_path, "pd", "#include <stdio.h>\n#include <stdlib.h>\n" + says)
    common = ("run", "--engine", "free_body", "simulation.duration=0.05", "-c", source, "--json")
    whole = done(*common, "controller.k_p=200.0", cwd=tmp_path)
    assert whole.exit_code == 0
    assert json.loads(whole.stdout)["status"] == "completed"
    assert "said by C" in whole.stderr
    ended = done(*common, "controller.k_p=0.02", cwd=tmp_path)
    assert (ended.exit_code, ended.stdout) == (2, "")
    assert "your law pd (pd.c) ended the process by exit()" in ended.stderr


@pytest.mark.processes
@pytest.mark.parametrize("instant", [0.0, 0.02, 0.05])
@pytest.mark.parametrize(
    ("call", "status", "said"),
    [
        ("exit(0)", 2, "ended the process by exit()"),
        ("_exit(0)", 2, "ended the process by exit()"),
        ("fork()", 0, "a stage has copied the process by fork: the copy ends here"),
    ],
)
def test_a_law_in_c_that_ends_or_copies_the_process_at_any_instant_is_named(tmp_path, instant, call, status, said):
    """Also at the first and at the last instant, which Python steps."""
    from forked import done

    when = f"if (signals->t > {instant - 5e-5} && signals->t < {instant + 5e-5})"
    headers = "#include <stdlib.h>\n#include <unistd.h>\n"
    ends = written(tmp_path, "pd", headers + PD.replace("return 0;", f"{when} {call};\n    return 0;"))
    ended = done(
        "run", "--engine", "free_body", "-q", "simulation.duration=0.05", "-c", ends, "-o", "ended", cwd=tmp_path
    )
    assert ended.exit_code == status
    assert ended.stderr.count(said) == 1


def test_a_tool_that_a_signal_ends_is_called_once_more(tmp_path):
    once = "test -e begun && echo made && exit 0; touch begun; kill -SEGV $$"
    assert tool(["sh", "-c", once], tmp_path).stdout == "made\n"
    always = tool(["sh", "-c", "echo x >> starts; kill -SEGV $$"], tmp_path)
    assert always.returncode == -signal.SIGSEGV
    assert (tmp_path / "starts").read_text() == "x\n" * 2
    assert tool(["sh", "-c", "echo x >> wrong; exit 1"], tmp_path).returncode == 1
    assert (tmp_path / "wrong").read_text() == "x\n"
