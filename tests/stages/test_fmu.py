"""FMUs as stages: they give the numbers of the same stage in Python, bit for bit, and what does not fit is a list."""

import sys
import threading
import zipfile
from pathlib import Path

import numpy as np
import pytest

from fmus import build, description
from uvms_mj import InputError, McapLog, Scenario, Simulation, StageFault, Trace, simulate
from uvms_mj.reproduce.bench import bench
from uvms_mj.studies.study import Study

pytest.importorskip("fmpy", reason="needs the extra fmi")


def entries(name: str, n: int = 6) -> list[str]:
    return [f"{name}[{i + 1}]" for i in range(n)]


WRENCH = entries("tau_cmd")
PD = "for (int i = 0; i < 6; i++) r[20 + i] = r[14 + i] - r[0] * r[2 + i] - r[1] * r[8 + i];"
PD_GAINS = {"k_p": 200.0, "k_d": 150.0}
PD_INPUTS = [*entries("eta_e"), *entries("nu_e"), *entries("g_hat")]
PD_IN_PYTHON = '''
from dataclasses import dataclass
from uvms_mj import Controller, gain

@dataclass(frozen=True)
class Pd(Controller):
    """PD."""
    k_p: float = gain(200.0, "N/m", "stiffness")
    k_d: float = gain(150.0, "N s/m", "damping")

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            tau_cmd[i] = signals.g_hat[i] - gains.k_p * signals.eta_e[i] - gains.k_d * signals.nu_e[i]
'''
GSTA = """
    double *s = r + 3, *A = r + 9, *tau_nom = r + 15, *M_hat = r + 21, *tau = r + 57, a[6];
    for (int i = 0; i < 6; i++) {
        double sgn = (s[i] > 0.0) - (s[i] < 0.0), root = sqrt(fabs(s[i])) * sgn, beta = r[2];
        double phi_1 = root + beta * s[i], phi_2 = 0.5 * sgn + 1.5 * beta * root + beta * beta * s[i];
        a[i] = -r[0] * phi_1 + x[i];
        x[i] += h * (-r[1] * phi_2);
        a[i] -= A[i] * s[i];
        tau[i] = tau_nom[i];
    }
    for (int j = 0; j < 6; j++)
        for (int i = 0; i < 6; i++)
            tau[i] += M_hat[6 * i + j] * a[j];
"""
GSTA_INPUTS = [
    *(*entries("s"), *entries("A"), *entries("tau_nom")),
    *(f"M_hat[{i + 1},{j + 1}]" for i in range(6) for j in range(6)),
]


@pytest.fixture(scope="module")
def pd(tmp_path_factory) -> str:
    return str(build(tmp_path_factory.mktemp("fmu"), "pd", PD, PD_GAINS, PD_INPUTS, WRENCH))


@pytest.fixture(scope="module")
def gsta(tmp_path_factory) -> str:
    gains = {"k_1": 5.0, "k_2": 10.0, "beta": 5.0}
    return str(build(tmp_path_factory.mktemp("fmu"), "gsta", GSTA, gains, GSTA_INPUTS, WRENCH))


@pytest.fixture
def in_python(tmp_path) -> str:
    (tmp_path / "pd.py").write_text(PD_IN_PYTHON)
    return f"{tmp_path}/pd.py:Pd"


def assert_same(a, b) -> None:
    for signal in {*(s.name for s in a.signals)} & {*(s.name for s in b.signals)}:
        np.testing.assert_array_equal(a[signal], b[signal], err_msg=signal)


NEAR = {"initial.position": [0.95, 0.0, 0.0], "reference.step_time": 0.0, "simulation.duration": 2.6}
"""A run that touches the wall at 2.3 s."""


@pytest.mark.parametrize(("engine", "period"), [("free_body", 1e-4), ("mujoco", 1e-3)])
def test_a_law_as_an_fmu_is_the_law_in_python_bit_for_bit(pd, in_python, engine, period):
    scenario = Scenario.load("push_wall", NEAR | {"controller.period": period})
    gains = {"controller.k_p": 300.0}
    assert_same(*(simulate(scenario.updated(gains, controller=name), engine=engine) for name in (pd, in_python)))


def test_a_law_with_states_of_its_own_is_that_in_python(gsta):
    scenario = Scenario.load("push_wall", NEAR | {"controller.period": 1e-3})
    assert_same(simulate(scenario), simulate(scenario.updated({}, controller=gsta)))


def test_outputs_before_the_step_are_one_sample_late(pd, in_python):
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.5, "controller.period": 1e-3})
    before = scenario.updated({"controller.get_before_step": True}, controller=pd)
    late = scenario.updated({"controller.delay": 1e-3}, controller=in_python)
    ours, theirs = (simulate(each, engine="free_body") for each in (late, before))
    np.testing.assert_array_equal(ours.tau_cmd_delayed, theirs.tau_cmd)
    np.testing.assert_array_equal(ours.nu, theirs.nu)


@pytest.mark.filterwarnings("ignore::uvms_mj.engine.run.PlainPythonWarning")
def test_plain_python_gives_the_same(pd, monkeypatch):
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.02, "controller.name": pd})
    compiled = simulate(scenario, engine="free_body")
    monkeypatch.setenv("UVMS_MJ_PLAIN", "1")
    assert_same(compiled, simulate(scenario, engine="free_body"))


def test_a_reset_begins_the_fmu_anew_and_runs_beside_each_other_do_not_meet(gsta):
    scenario = Scenario.load("push_wall", {"controller.name": gsta})  # its library allows one instance
    with Simulation(scenario, engine="free_body") as fresh:
        fresh.step(500)
        tau = fresh.tau_cmd.copy()
    with Simulation(scenario, engine="free_body") as a, Simulation(scenario, engine="free_body") as b:
        a.step(500)
        a.reset({"controller.k_1": 1.0})
        a.step(500)
        assert not np.array_equal(a.tau_cmd, tau)
        a.reset()
        threads = [threading.Thread(target=sim.step, args=(500,)) for sim in (a, b)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        np.testing.assert_array_equal(a.tau_cmd, tau)
        np.testing.assert_array_equal(b.tau_cmd, tau)
        with pytest.raises(InputError, match="a parameter of an FMU can't change during a run"):
            a.set({"controller.k_1": 2.0})


def test_an_fmu_finds_a_library_beside_its_own(tmp_path, in_python):
    body = "double scaled(double); " + PD.replace("r[0]", "scaled(r[0])")
    beside = "double scaled(double x) { return x; }"
    path = build(tmp_path, "pd", body, PD_GAINS, PD_INPUTS, WRENCH, beside=beside)
    keys = {"simulation.duration": 0.5, "controller.period": 1e-3}
    runs = [simulate(Scenario.load("push_wall", keys, law), engine="free_body") for law in (str(path), in_python)]
    assert_same(*runs)


def test_variables_have_the_names_that_a_table_gives_them(tmp_path, pd):
    names = {f"e{i}": f"eta_e[{i + 1}]" for i in range(6)} | {f"v{i}": f"nu_e[{i + 1}]" for i in range(6)}
    names |= {f"g{i}": f"g_hat[{i + 1}]" for i in range(6)} | {f"F{i}": f"tau_cmd[{i + 1}]" for i in range(6)}
    own = list(names)
    unit = build(tmp_path, "named", PD, PD_GAINS, own[:18], own[18:])
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.2})
    other = scenario.updated({"controller.variables": names}, controller=str(unit))
    assert Scenario.from_dict(other.to_dict()).to_dict() == other.to_dict()
    assert_same(*(simulate(each, engine="free_body") for each in (scenario.updated({}, controller=pd), other)))


def test_a_sensor_may_be_an_fmu(tmp_path):
    sets = [*entries("p_WB", 3), *entries("quat_WB", 4), *(f"R_WB[{i},{j}]" for i in (1, 2, 3) for j in (1, 2, 3))]
    sets += entries("nu")
    force = [*entries("f_contact_m_W", 3), *entries("tau_contact_m_B")]
    truth = [*sets, *entries("f_springs_W", 3), *entries("tau_springs_B")]
    named = {f"true_{i}": name for i, name in enumerate(truth)}
    body = "for (int i = 0; i < 31; i++) r[31 + i] = r[i];"
    unit = build(tmp_path, "perfect_unit", body, {}, list(named), [*sets, *force])
    keys = {"navigation.name": str(unit), "navigation.variables": named}
    scenario = Scenario.load("push_wall", NEAR | {"navigation.period": 1e-4})
    a, b = (simulate(each, engine="free_body") for each in (scenario, scenario.updated(keys)))
    np.testing.assert_array_equal(a.f_contact_W, b.f_contact_W)


def test_a_study_varies_a_parameter_of_an_fmu(pd, in_python, tmp_path):
    frames = []
    for name in (pd, in_python):
        tables = {
            "laws": [name],
            "base": {"scenario": "push_wall", "simulation": {"duration": 0.1}},
            "run": {"engine": "free_body"},
            "vary": [{"key": "controller.k_p", "values": [100.0, 300.0]}],
        }
        folder = tmp_path / ("unit" if name == pd else "python")
        frames.append(Study.from_dict(tables).run(folder, workers=2).frame.drop(columns="law"))
    assert set(frames[0]["status"]) == {"completed"}
    assert frames[0].equals(frames[1])


@pytest.mark.slow
def test_a_benchmark_takes_an_fmu(pd, in_python, tmp_path):
    laws = bench([pd, "label=unit", in_python], tmp_path / "out", only=["two_contacts"], draws=1, workers=1)["laws"]
    cells = [law["tasks"]["two_contacts"] for law in laws]
    assert cells[0] == cells[1]
    assert [list(law["files"]) for law in laws] == [["pd.fmu"], ["pd.py"]]


def test_a_step_that_fails_ends_the_run_with_its_status(tmp_path, monkeypatch):
    unit = build(tmp_path, "failing", PD, PD_GAINS, PD_INPUTS, WRENCH, fails="t > 0.01")
    for plain in ("", "1"):
        monkeypatch.setenv("UVMS_MJ_PLAIN", plain)
        with Simulation(Scenario.load("push_wall", {"controller.name": str(unit)}), engine="free_body") as sim:
            with pytest.raises(StageFault, match=r"your law failing \(failing.fmu\) returned 3"):
                sim.step(300)
            assert sim.t == pytest.approx(0.0101)


def test_what_does_not_fit_is_one_list(tmp_path):
    inputs = ["eta_e[7]", "instant", "speed", "nu_e[1]"]
    unit = build(tmp_path, "wrong", "r[4] = r[3];", {}, inputs, [*WRENCH[:4], "tau_cmd[1,2]", "power"])
    with pytest.raises(InputError) as raised:
        Simulation(Scenario.load("push_wall", {"controller.name": str(unit)}), engine="free_body")
    said = str(raised.value)
    assert "the input eta_e[7] is no entry of eta_e, which is [6]" in said
    assert "the input instant is a whole number" in said
    assert "the input speed is no signal" in said
    assert "the output tau_cmd[1,2] is no entry of tau_cmd, which is [6]" in said
    missing = build(tmp_path, "missing", "", {}, ["eta_e[1]"], WRENCH[:5])
    with pytest.raises(InputError, match=r"no output of the FMU is tau_cmd\[6\]; name it in controller.variables"):
        Simulation(Scenario.load("push_wall", {"controller.name": str(missing)}), engine="free_body")


def archive(path, files: dict[str, str]) -> str:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as made:
        for name, text in files.items():
            made.writestr(name, text)
    return str(path)


def whole(**given: str) -> dict[str, str]:
    return {"modelDescription.xml": description("unit", PD_GAINS, PD_INPUTS, WRENCH, **given)}


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({"a": "b"}, "is not an FMU: it has no modelDescription.xml"),
        ({"modelDescription.xml": "<no"}, "its modelDescription.xml can't be read"),
        (whole(version="3.0"), "its modelDescription.xml"),
        (whole(kind="ModelExchange"), "has no co-simulation"),
        (whole(), "has no library unit.so for linux64; it has none"),
        (whole() | {"binaries/linux32/unit.so": "", "binaries/win32/unit.dll": ""}, "it has linux32, win32"),
        (whole() | {"binaries/linux64/unit.so": "text"}, "is not a library that this machine loads"),
        (whole() | {"../outside": "text"}, "outside of its folder"),
        (
            whole() | {f"resources/{i}": "0" * 250_000 for i in range(9)},
            "unpacks to 2.254 MB in 10 files; at most 2",
        ),
    ],
)
def test_what_is_no_fmu_for_this_machine_is_refused(tmp_path, monkeypatch, files, words):
    monkeypatch.setattr("uvms_mj.stages.fmu._MOST_BYTES", 2_000_000)  # of 537 MB
    path = archive(tmp_path / "unit.fmu", files)
    with pytest.raises(InputError) as raised:
        Simulation(Scenario.load("push_wall", {"controller.name": path}), engine="free_body")
    assert words in str(raised.value)


def test_a_link_in_an_archive_is_not_unpacked(tmp_path):
    path = archive(tmp_path / "unit.fmu", whole())
    with zipfile.ZipFile(path, "a") as made:
        link = zipfile.ZipInfo("resources/link")
        link.external_attr = 0o120777 << 16
        made.writestr(link, "/etc")
    with pytest.raises(InputError, match="would unpack 'resources/link' outside of its folder"):
        Scenario.load("push_wall", {"controller.name": path})


def test_a_file_of_text_is_no_fmu(tmp_path):
    (tmp_path / "unit.fmu").write_text("text")
    with pytest.raises(InputError, match="is not an FMU, which is a zip archive"):
        Scenario.load("push_wall", {"controller.name": str(tmp_path / "unit.fmu")})


PYTHON_UNIT = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class PythonUnit(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.k_p = 200.0
        self.numbers = {name: [0.0] * 6 for name in ("eta_e", "nu_e", "g_hat", "tau_cmd")}
        self.register_variable(Real("k_p", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        for name, values in self.numbers.items():
            causality = Fmi2Causality.output if name == "tau_cmd" else Fmi2Causality.input
            for i in range(6):
                get, put = (lambda v=values, i=i: v[i]), (lambda x, v=values, i=i: v.__setitem__(i, x))
                self.register_variable(Real(f"{name}[{i + 1}]", causality=causality, getter=get, setter=put))

    def do_step(self, t, h):
        n = self.numbers
        for i in range(6):
            n["tau_cmd"][i] = n["g_hat"][i] - self.k_p * n["eta_e"][i] - 150.0 * n["nu_e"][i]
        return True
"""


def test_a_unit_of_pythonfmu_is_a_law(tmp_path, in_python):
    pythonfmu = pytest.importorskip("pythonfmu.builder")
    (tmp_path / "python_unit.py").write_text(PYTHON_UNIT)
    unit = pythonfmu.FmuBuilder.build_FMU(str(tmp_path / "python_unit.py"), dest=str(tmp_path))
    keys = {"simulation.duration": 0.1, "controller.period": 1e-3}
    scenario = Scenario.load("push_wall", keys)
    gains = {"controller.k_p": 300.0}
    assert_same(
        *(simulate(scenario.updated(gains, controller=str(each)), engine="free_body") for each in (unit, in_python))
    )


def test_units_of_pythonfmu_with_one_script_name_do_not_meet(tmp_path, in_python):
    """Nor do the modules beside the scripts, nor what they keep from run to run."""
    pythonfmu, units = pytest.importorskip("pythonfmu.builder"), []
    for name, half in (("soft", 50.0), ("stiff", 100.0)):
        (folder := tmp_path / name).mkdir()
        (folder / "beside_it.py").write_text(f"HALF = {half}\nCALLS = []\n")
        text = PYTHON_UNIT.replace("do_step(self, t, h):", "do_step(self, t, h):\n        CALLS.append(t)")
        text = text.replace("self.k_p * ", "2.0 * HALF * (1.0 if len(CALLS) < 150 else 0.0) * ")
        (folder / "python_unit.py").write_text("from beside_it import CALLS, HALF\n" + text)
        script, beside = str(folder / "python_unit.py"), [str(folder / "beside_it.py")]
        units.append(pythonfmu.FmuBuilder.build_FMU(script, dest=str(folder), project_files=beside))
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.1, "controller.period": 1e-3})
    before, modules = list(sys.path), set(sys.modules)
    for order in ((0, 1), (1, 0), (1, 1)):
        for k in order:
            mine = scenario.updated({}, controller=str(units[k]))
            theirs = scenario.updated({"controller.k_p": (100.0, 200.0)[k]}, controller=str(in_python))
            assert_same(simulate(mine, engine="free_body"), simulate(theirs, engine="free_body"))
    assert sys.path == before
    assert not {"python_unit", "beside_it"} & (set(sys.modules) - modules)
    with Simulation(mine, engine="free_body") as sim, Simulation(theirs, engine="free_body") as other:
        for _ in range(2):
            for each in (sim, other):
                each.reset()
                each.step(1000)
            np.testing.assert_array_equal(sim.signals.tau_cmd, other.signals.tau_cmd)


def test_a_damaged_archive_is_one_sentence(tmp_path, pd):
    data = bytearray(Path(pd).read_bytes())
    for place in range(len(data) // 3, len(data) // 2):
        data[place] ^= 255
    (tmp_path / "damaged.fmu").write_bytes(data)
    with pytest.raises(InputError, match=r"damaged\.fmu: "):
        Simulation(Scenario.load("push_wall", {"controller.name": str(tmp_path / "damaged.fmu")}), engine="free_body")


def test_a_log_with_a_table_of_variables_is_read(tmp_path):
    names = {f"F{i}": f"tau_cmd[{i + 1}]" for i in range(6)}
    unit = build(tmp_path, "named", "", {}, [], list(names))
    keys = {"controller.name": str(unit), "controller.variables": names, "simulation.duration": 0.01}
    simulate(Scenario.load("push_wall", keys), engine="free_body", sinks=[McapLog(tmp_path / "run.mcap")])
    assert Trace.load(tmp_path / "run.mcap").scenario.controller.variables == names


def test_a_parameter_with_the_name_of_a_key_gets_one_of_its_own(tmp_path):
    parameters = {"period": 0.01, "class": 1.0, "a.b": 2.0, "a_b": 3.0, "unit": 4.0, "variables": 5.0}
    unit = build(
        tmp_path, "clash", "for (int i = 0; i < 6; i++) r[6 + i] = r[2] + 10.0 * r[3];", parameters, [], WRENCH
    )
    law = Scenario.load("push_wall", {"controller.name": str(unit)}).controller
    assert law.period is None
    assert (law.period_, law.class_, law.a_b, law.a_b_, law.unit_, law.variables_) == (0.01, 1.0, 2.0, 3.0, 4.0, 5.0)
    keys = {"controller.name": str(unit), "controller.a_b_": 7.0, "simulation.duration": 1e-3}
    assert simulate(Scenario.load("push_wall", keys), engine="free_body").tau_cmd[0, 0] == 72.0


def test_variables_that_are_no_exchange_are_named(tmp_path):
    unit = build(tmp_path, "twice", "", {"k": 1.0}, [], [*WRENCH, "extra"])
    for named, words in (
        ({"extra": "tau_cmd[1]"}, r"two outputs of the FMU are tau_cmd\[1\]"),
        ({"k": "eta_e[1]"}, "k is neither an input nor an output"),
        ({"no": "eta_e[1]"}, "the FMU has no variable 'no'"),
    ):
        with pytest.raises(InputError, match=words):
            Simulation(Scenario.load("push_wall", {"controller.name": str(unit), "controller.variables": named}))
