"""FMUs as stages: they give the numbers of the same stage in Python, bit for bit, and what does not fit is a list."""

import sys
import threading
import zipfile
from pathlib import Path

import numpy as np
import pytest

from fmus import build, description
from traces import products_are_plain_sums
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


def assert_same(a, b, rounding: float = 0.0) -> None:
    for signal in {*(s.name for s in a.signals)} & {*(s.name for s in b.signals)}:
        np.testing.assert_allclose(a[signal], b[signal], rtol=rounding, atol=1e-2 * rounding, err_msg=signal)


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


@pytest.mark.filterwarnings("ignore::uvms_mj.engine.vehicle_run.PlainPythonWarning")
def test_plain_python_gives_the_same(pd, monkeypatch):
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.01, "controller.name": pd})
    compiled = simulate(scenario, engine="free_body")
    monkeypatch.setenv("UVMS_MJ_PLAIN", "1")
    assert_same(compiled, simulate(scenario, engine="free_body"), 0.0 if products_are_plain_sums() else 1e-9)


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
    laws = bench([pd, "label=unit", in_python], tmp_path / "out", only=["two_bumpers"], at_most=1, workers=1)["laws"]
    cells = [law["tasks"]["two_bumpers"] for law in laws]
    assert cells[0] == cells[1]
    assert [list(law["files"]) for law in laws] == [["pd.fmu"], ["pd.py"]]


def test_a_step_that_fails_ends_the_run_with_its_status(tmp_path, monkeypatch):
    unit = build(tmp_path, "failing", PD, PD_GAINS, PD_INPUTS, WRENCH, fails="t > 0.002")
    for plain in ("", "1"):
        monkeypatch.setenv("UVMS_MJ_PLAIN", plain)
        with Simulation(Scenario.load("push_wall", {"controller.name": str(unit)}), engine="free_body") as sim:
            with pytest.raises(StageFault, match=r"your law failing \(failing.fmu\) returned 3"):
                sim.step(300)
            assert sim.t == pytest.approx(0.0021)


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


def test_a_unit_of_pythonfmu_imports_what_it_brings_during_the_run(tmp_path, in_python, monkeypatch):
    """Its own module, not another unit's and not one of this name on Python's path."""
    pythonfmu, units = pytest.importorskip("pythonfmu.builder"), []
    for name, half in (("soft", 50.0), ("stiff", 100.0), ("elsewhere", 1e3)):
        (folder := tmp_path / name).mkdir()
        (folder / "brought.py").write_text(f"HALF = {half}\nCALLS = []\n")
        line = (
            "do_step(self, t, h):\n        import brought\n        from brought import CALLS\n        CALLS.append(t)"
        )
        text = PYTHON_UNIT.replace("do_step(self, t, h):", line)
        text = text.replace("self.k_p * ", "2.0 * brought.HALF * (1.0 if len(CALLS) < 60 else 0.0) * ")
        (folder / "python_unit.py").write_text(text)
        script, beside = str(folder / "python_unit.py"), [str(folder / "brought.py")]
        units.append(pythonfmu.FmuBuilder.build_FMU(script, dest=str(folder), project_files=beside))
    monkeypatch.setattr(sys, "path", [str(tmp_path / "elsewhere"), *sys.path])
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.1, "controller.period": 1e-3})
    sims = [Simulation(scenario.updated({}, controller=str(each)), engine="free_body") for each in units[:2]]
    others = [
        Simulation(scenario.updated({"controller.k_p": k_p}, controller=str(in_python)), engine="free_body")
        for k_p in (100.0, 200.0)
    ]
    for _ in range(2):
        for each in (*sims, *others):
            each.reset()
        for _ in range(49):  # in turn; the law in Python has no part that ends
            for each in (*sims, *others):
                each.step(10)
        for mine, theirs in zip(sims, others, strict=True):
            np.testing.assert_array_equal(mine.signals.tau_cmd, theirs.signals.tau_cmd)
    assert "brought" not in sys.modules
    for each in (*sims, *others):
        each.close()


def test_a_unit_with_a_damaged_archive_is_one_sentence(tmp_path, pd):
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


KN = '<Unit name="kN"><BaseUnit kg="1" m="1" s="-2" factor="1000"/></Unit>'
MM = '<Unit name="mm"><BaseUnit m="1" factor="0.001"/></Unit>'
NEWTON = '<Unit name="newton"><BaseUnit kg="1" m="1" s="-2"/></Unit>'
KELVIN = '<Unit name="x"><BaseUnit K="1"/></Unit>'


@pytest.mark.parametrize(
    ("named", "unit", "units", "words"),
    [
        (
            "tau_cmd[1]",
            "kN",
            KN,
            "the output tau_cmd[1] is in kN, 1000 of the unit of SI; the signal tau_cmd[1] is in N",
        ),
        ("eta_e[2]", "mm", MM, "the input eta_e[2] is in mm, 0.001 of the unit of SI; the signal eta_e[2] is in m"),
        (
            "tau_cmd[1]",
            "kN",
            '<Unit name="kN"/>',
            "is in 'kN', which the FMU does not define by units of SI",
        ),
        ("nu_e[4]", "deg/s", '<Unit name="deg/s"/>', "is in 'deg/s', which the FMU does not define by units of SI"),
        ("tau_cmd[4]", "N", '<Unit name="N"/>', "the output tau_cmd[4] is in N; the signal tau_cmd[4] is in N m"),
        ("nu_e[4]", "Hz", '<Unit name="Hz"><BaseUnit s="-1"/></Unit>', "is in Hz; the signal nu_e[4] is in rad/s"),
        ("nu_e[4]", "Hz", '<Unit name="Hz"/>', "is in 'Hz', which the FMU does not define by units of SI"),
        ("eta_e[1]", "x", KELVIN, "the input eta_e[1] is in x; the signal eta_e[1] is in m"),
    ],
)
def test_a_unit_that_is_not_that_of_the_signal_is_refused(tmp_path, named, unit, units, words):
    files = {"modelDescription.xml": description(
        "unit", PD_GAINS, PD_INPUTS, WRENCH, units=units, attributes={named: f'unit="{unit}"'}
    )}  # fmt: skip
    scenario = Scenario.load("push_wall", {"controller.name": archive(tmp_path / "unit.fmu", files)})
    with pytest.raises(InputError) as raised:
        Simulation(scenario, engine="free_body")
    assert words in str(raised.value)


def test_units_of_si_are_taken_in_all_spellings(tmp_path, in_python):
    spelt = dict(zip(entries("tau_cmd"), ("N", "newton", "kg.m/s2", "N.m", "N*m", "Nm"), strict=True))
    spelt |= dict(zip(entries("nu_e"), ("m/s", "m.s-1", "m/sec", "rad/s", "1/s", "rad.s^-1"), strict=True))
    spelt |= {"eta_e[1]": "m", "eta_e[4]": "rad"}
    attributes = {name: f'unit="{unit}"' for name, unit in spelt.items()}
    units = NEWTON + "".join(f'<Unit name="{each}"/>' for each in {*spelt.values()} - {"newton"})
    unit = build(tmp_path, "pd", PD, PD_GAINS, PD_INPUTS, WRENCH, units=units, attributes=attributes)
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.1})
    assert_same(
        *(simulate(scenario.updated({}, controller=each), engine="free_body") for each in (str(unit), in_python))
    )


def test_ranges_of_parameters_are_those_of_the_settings(tmp_path):
    parameters = {"k": 1.0, "low[1]": 1.0, "low[2]": 2.0, "free": 0.0}
    attributes = {"k": 'min="0.5" max="4" unit="kN"', "low[1]": 'min="0"', "low[2]": 'max="3"'}
    unit = str(build(tmp_path, "ranges", "", parameters, [], WRENCH, units=KN, attributes=attributes))
    for keys, words in (
        ({"k": 5.0}, "controller.k: 5.0 must be from 0.5 to 4 kN"),
        ({"low": [-1.0, 2.0]}, "has -1 for low[1], which must be from 0 to inf"),
        ({"low": [1.0, 3.5]}, "has 3.5 for low[2], which must be from -inf to 3"),
    ):
        with pytest.raises(InputError) as raised:
            Scenario.load("push_wall", {f"controller.{name}": each for name, each in keys.items()}, unit)
        assert words in str(raised.value)
    law = Scenario.load("push_wall", {"controller.k": 4.0, "controller.free": 1e9}, unit).controller
    assert (law.k, law.low, law.free) == (4.0, (1.0, 2.0), 1e9)


@pytest.mark.parametrize("plain", ["", "1"])
@pytest.mark.filterwarnings("ignore::uvms_mj.engine.vehicle_run.PlainPythonWarning")
@pytest.mark.parametrize(
    ("named", "limits", "words"),
    [
        ("eta_e[1]", 'min="-1e-6" max="10"', r"the input eta_e\[1\] is -\d.*range -1e-06 to 10"),
        ("tau_cmd[6]", 'max="-1"', r"the output tau_cmd\[6\] is .*range -inf to -1"),
    ],
)
def test_a_number_out_of_a_declared_range_ends_the_run(tmp_path, monkeypatch, plain, named, limits, words):
    monkeypatch.setenv("UVMS_MJ_PLAIN", plain)
    unit = build(tmp_path, "ranged", PD, PD_GAINS, PD_INPUTS, WRENCH, attributes={named: limits})
    keys = {"controller.name": str(unit), "reference.step_time": 0.0}
    with Simulation(Scenario.load("push_wall", keys), engine="free_body") as sim:
        with pytest.raises(StageFault, match=words):
            sim.step(3000)
        assert sim.t > 0.0 or named != "eta_e[1]"


def test_no_parameter_is_left_out(tmp_path):
    """Entries with a gap, of a matrix, and names that no Python has are settings; each reaches its own number."""
    names = ["k[1]", "k[3]", "A[1,1]", "A[1,2]", "der(x)", "2nd", "_x", "a b", "one[1]", "\u00e4", "__init__"]
    body = "for (int i = 0; i < 6; i++) r[11 + i] = i < 5 ? r[2 * i] + 100 * r[2 * i + 1] : r[10];"
    unit = str(build(tmp_path, "gaps", body, dict.fromkeys(names, 0.0), [], WRENCH))
    settings = ["k_1", "k_3", "A_1_1", "A_1_2", "der_x", "parameter_2nd", "x", "a_b", "one", "parameter_", "init"]
    law = Scenario.load("push_wall", {"controller.name": unit}).controller
    assert [field.name for field in type(law).setting_fields()][:11] == settings
    keys = {f"controller.{name}": float(i + 1) for i, name in enumerate(settings)} | {"controller.one": [9.0]}
    trace = simulate(Scenario.load("push_wall", keys | {"simulation.duration": 1e-3}, unit), engine="free_body")
    np.testing.assert_array_equal(trace.tau_cmd[0], [201.0, 403.0, 605.0, 807.0, 1009.0, 11.0])


@pytest.mark.parametrize("compression", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_damaged_archive_is_one_sentence(tmp_path, compression):
    path = tmp_path / "unit.fmu"
    with zipfile.ZipFile(path, "w") as made:
        made.writestr("modelDescription.xml", whole()["modelDescription.xml"])
        made.writestr("binaries/linux64/unit.so", bytes(range(256)) * 100, compress_type=compression)
        place, size = made.infolist()[1].header_offset, made.infolist()[1].compress_size
    data = bytearray(path.read_bytes())
    for i in range(place + 60, place + 60 + min(200, size - 10)):
        data[i] ^= 0x55
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"unit.fmu: can't be unpacked: "):
        Simulation(Scenario.load("push_wall", {"controller.name": str(path)}), engine="free_body")
    unknown = bytearray(data)
    for sign, at in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):  # the method of compression
        unknown[unknown.rindex(sign) + at] = 77
    path.write_bytes(unknown)
    with pytest.raises(InputError, match=r"unit.fmu: can't be unpacked: .*compression"):
        Simulation(Scenario.load("push_wall", {"controller.name": str(path)}), engine="free_body")


def test_messages_have_their_numbers_and_do_not_control_a_terminal(tmp_path):
    said = '"%s of \\033[31m%g N at %d\\x9b31m", "limit", 2.5, 7'
    units = [
        build(tmp_path, name, PD, PD_GAINS, PD_INPUTS, WRENCH, fails="1", says=said.replace("limit", name))
        for name in ("one", "two")
    ]
    sims = [
        Simulation(Scenario.load("push_wall", {"controller.name": str(each)}), engine="free_body") for each in units
    ]
    for name, sim in zip(("one", "two"), sims, strict=True):
        with sim, pytest.raises(StageFault) as raised:
            sim.step()
        text = str(raised.value)
        assert f"{name} of \\x1b[31m2.5 N at 7" in text
        assert text.isprintable()
