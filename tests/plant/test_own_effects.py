"""Effects of a user's own: forces on the true vehicle, in engines, closed forms, logs, studies and FMUs."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from uvms_mj import InputError, Scenario, Simulation, Trace, simulate
from uvms_mj.cli.new import write_new
from uvms_mj.control.base import NoClosedForm, SteadyState
from uvms_mj.setup.base import set_up
from uvms_mj.setup.checks import SamplingWarning
from uvms_mj.studies.results import frame
from uvms_mj.views.figures.panels import states_of

HEADER = """
from dataclasses import dataclass
import numpy as np
from uvms_mj import Effect, setting
"""


def effect_file(folder, body, name="my_effect.py") -> str:
    """The path of a file with effects."""
    path = folder / name
    path.write_text(HEADER + body)
    return str(path)


def effect(name, lines, more="") -> str:
    """The text of an effect without settings whose wrench these lines set."""
    body = "\n        ".join(lines.splitlines())
    return f"""
@dataclass(frozen=True)
class {name}(Effect):
    k: float = setting(1.0, "N", "factor")
{more}
    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        {body}
"""


BRUSH = effect("Brush", "tau[:] = 0.0\ntau[0] = -settings.k * given.nu_r[0] + 4.0\ntau[5] = 0.1")
RUN = {"simulation.timestep": 1e-3, "simulation.duration": 25.0, "reference.target": [1.03, 0.0, -0.5]}


@pytest.mark.parametrize("law", ["impedance", "gsta", "ideal", "dob_impedance", "pid"])
def test_a_vehicle_rests_where_the_closed_form_says(tmp_path, law):
    name = f"{effect_file(tmp_path, BRUSH)}:Brush"
    scenario = Scenario.load("push_wall", RUN | {"effects": [{"name": name, "k": 50.0}]}, law)
    trace = simulate(scenario, engine="free_body", log_rate=10.0)
    assert isinstance(trace.analytic, SteadyState)
    without = simulate(scenario.updated({"effects": []}), engine="free_body", log_rate=10.0)
    assert abs(trace.p_WB[-1] - without.p_WB[-1]).max() > 1e-6 or law in ("gsta", "dob_impedance", "pid")
    assert trace.push[-1] == pytest.approx(trace.analytic.force, rel=1e-4)
    assert np.allclose(trace.p_WB[-1], trace.analytic.position, rtol=0.0, atol=1e-5)
    R, v_c_W = Rotation.from_quat(trace.quat_WB[-1], scalar_first=True), scenario.current.velocity_W
    assert trace.tau_Brush[-1] == pytest.approx([4.0 + 50.0 * R.inv().apply(v_c_W)[0], 0, 0, 0, 0, 0.1], abs=5e-3)


def test_both_engines_and_plain_python_agree(tmp_path, monkeypatch):
    name = f"{effect_file(tmp_path, BRUSH)}:Brush"
    changes = {"simulation.duration": 0.5, "initial.velocity": [0.5, 0.2, 0.0, 0.1, 0.0, 0.3], "wall.position": 0.1}
    scenario = Scenario.load("push_wall", changes | {"effects": [{"name": name, "k": 50.0}]})
    free, whole = (simulate(scenario, engine=engine) for engine in ("free_body", "mujoco"))
    np.testing.assert_allclose(free.p_WB, whole.p_WB, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(free.tau_Brush, whole.tau_Brush, rtol=0.0, atol=1e-6)
    monkeypatch.setenv("UVMS_MJ_PLAIN", "1")
    short = scenario.updated({"simulation.duration": 0.02})
    with pytest.warns(UserWarning, match="runs as plain Python"):
        plain = simulate(short, engine="free_body")
    np.testing.assert_allclose(plain.p_WB, free.p_WB[: len(plain.t)], rtol=0.0, atol=1e-12)


def test_the_templates_in_python_and_in_c_are_one_effect(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "py").mkdir()
    write_new("effect", "my_brush", out="py")
    write_new("effect", "in_c", out="c", language="c")
    changes = {"simulation.duration": 0.3, "initial.velocity": [0.5, 0.2, 0.0, 0.1, 0.0, 0.3]}
    traces = [
        simulate(
            Scenario.load("push_wall", changes | {"effects": [{"name": str(name), "k": 60.0}]}), engine="free_body"
        )
        for name in (f"{tmp_path / 'py' / 'my_brush.py'}:MyBrush", tmp_path / "c" / "in_c.c")
    ]
    np.testing.assert_allclose(traces[0].p_WB, traces[1].p_WB, rtol=0.0, atol=1e-12)
    assert abs(traces[0].tau_MyBrush[1:, 4]).min() > 0.0


def test_a_cone_rises_and_sinks_at_its_terminal_speeds(tmp_path):
    """A wave energy converter's cone: its drag is 3782 N s^2/m^2 upwards and 2700 downwards, its net weight or buoyancy
    1962 N."""
    lines = "tau[:] = 0.0\nw = given.nu_r[2]\ntau[2] = -(3782.0 if w > 0.0 else 2700.0) * abs(w) * w"
    name = f"{effect_file(tmp_path, effect('Cone', lines))}:Cone"
    calm = {
        "vehicle.linear_damping": 0.0,
        "vehicle.quadratic_damping": 0.0,
        "current.speed": 0.0,
        "wall.present": False,
    }
    for force, speed in ((1962.0, 0.72026), (-1962.0, -0.85245)):
        scenario = Scenario.load(
            "push_wall",
            calm
            | {
                "wall.present": False,
                "simulation.timestep": 1e-3,
                "controller.name": "external",
                "effects": [{"name": name}],
            }
            | {"disturbance.bias": [0.0, 0.0, force, 0.0, 0.0, 0.0]},
        )
        with Simulation(scenario, engine="free_body") as sim:
            weight = (sim.setup.vehicle.displaced_mass - sim.setup.vehicle.mass) * 9.81
            sim.step(3000)
            assert sim.signals.nu[2] == pytest.approx(speed, abs=2e-5 + abs(weight) / 1962.0)


def test_damping_that_grows_with_the_forward_speed_is_that_of_scipy(tmp_path):
    """tau = -u D nu with a full D, as of ECA's A9."""
    D = np.random.default_rng(4).normal(size=(6, 6)) * np.outer([8, 8, 8, 0.5, 0.5, 0.5], [1, 1, 1, 0.3, 0.3, 0.3])
    D[0, 0] = 60.0
    text = f"D = np.array({D.tolist()})\n" + effect("A9", "tau[:] = -given.nu_r[0] * (D @ given.nu_r)")
    name = f"{effect_file(tmp_path, text)}:A9"
    start = np.array([1.0, 0.2, -0.1, 0.1, -0.2, 0.3])
    changes = {
        "vehicle.linear_damping": 0.0, "vehicle.quadratic_damping": 0.0, "current.speed": 0.0, "wall.present": False,
        "controller.name": "external", "initial.velocity": start.tolist(), "effects": [{"name": name}],
    }  # fmt: skip
    vehicle = set_up(Scenario.load("push_wall", {"vehicle.quadratic_damping": 0.0})).vehicle
    M, m, d = vehicle.M, vehicle.mass, vehicle.displaced_mass

    def rates(_, y):
        nu, R = y[7:], Rotation.from_quat(y[3:7], scalar_first=True)
        momentum = M @ nu
        turning = np.r_[np.cross(nu[3:], momentum[:3]), np.cross(nu[3:], momentum[3:]) + np.cross(nu[:3], momentum[:3])]
        up = R.inv().apply([0.0, 0.0, 9.81])
        static = np.r_[(d - m) * up, np.cross(d * np.array(vehicle.r_b) - m * np.array(vehicle.r_g), up)]
        w, v = y[3], y[4:7]
        quat_dot = 0.5 * np.r_[-v @ nu[3:], w * nu[3:] + np.cross(v, nu[3:])]
        return np.r_[R.apply(nu[:3]), quat_dot, np.linalg.solve(M, static - turning - nu[0] * (D @ nu))]

    y_0 = np.r_[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, start]
    end = solve_ivp(rates, (0.0, 0.5), y_0, rtol=1e-10, atol=1e-12).y[:, -1]
    errors = []
    for h in (4e-4, 2e-4, 1e-4):
        with Simulation(Scenario.load("push_wall", changes | {"simulation.timestep": h}), engine="free_body") as sim:
            sim.step(round(0.5 / h))
            errors.append(abs(np.r_[sim.signals.p_WB, sim.signals.nu] - np.r_[end[:3], end[7:]]).max())
    assert errors[2] < 1e-3
    for coarse, fine in itertools.pairwise(errors):
        assert coarse / fine == pytest.approx(2.0, rel=0.1)  # semi-implicit Euler


LAG = effect(
    "Lag",
    "state_dot.pull[0] = 2.0 * (given.nu_r[0] - state.pull[0])\ntau[:] = 0.0\ntau[0] = -settings.k * state.pull[0]",
    more='    states = {"pull": 1}\n    units = {"pull": "m/s"}\n',
)


def test_an_effect_with_a_state_is_recorded_reset_and_has_no_closed_form(tmp_path):
    name = f"{effect_file(tmp_path, LAG)}:Lag"
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.2, "effects": [{"name": name, "k": 30.0}]})
    trace = simulate(scenario, engine="free_body")
    assert "the effect Lag has states" in str(trace.analytic)
    np.testing.assert_allclose(trace.tau_Lag[:, 0], -30.0 * trace.pull[:, 0], rtol=1e-12)
    with Simulation(scenario, engine="free_body") as sim:
        sim.step(2000)
        first = sim.signals.p_WB.copy()
        sim.reset()
        sim.step(2000)
        assert np.array_equal(first, sim.signals.p_WB)
        sim.reset({"effects[0].k": 60.0})
        sim.step(2000)
        other = simulate(scenario.updated({"effects[0].k": 60.0}), engine="free_body")
        assert np.array_equal(sim.signals.p_WB, other.p_WB[-1])
        assert not np.array_equal(first, other.p_WB[-1])


@pytest.mark.parametrize(
    ("lines", "reason"),
    [
        ("tau[:] = 0.0\ntau[0] = given.u[0]", "depends on the thrusts"),
        ("tau[:] = 0.0\ntau[0] = np.sin(given.t)", "depends on the time"),
        ("tau[:] = 0.0\ntau[0] = given['t']", "depends on the time"),
        ("tau[:] = 0.0\nif given.p_WB[0] > 0.5:\n    tau[0] = 1e-3 * given.t", "depends on the time"),
        ("tau[:] = 0.0\nif given.p_WB[0] > 0.5:\n    tau[0] = np.log(given.p_WB[0] - 9.0)", "is not finite"),
    ],
)
def test_what_is_not_known_at_rest_has_no_closed_form(tmp_path, lines, reason):
    name = f"{effect_file(tmp_path, effect('E', lines))}:E"
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.01, "effects": [{"name": name}]}))
    assert isinstance(trace.analytic, NoClosedForm)
    assert reason in str(trace.analytic)


def test_mistakes_are_named_with_their_place(tmp_path):
    name = f"{effect_file(tmp_path, BRUSH)}:Brush"
    for given, words in (
        ([{"k": 3.0}], r"effects\[0\].*needs a name"),
        ([{"name": name}, {"name": name, "kk": 3.0}], r"effects\[1\]\.kk"),
        ([{"name": name, "k": "high"}], r"effects\[0\]\.k"),
        ([{"name": "gsta"}], r"effects\[0\]\.name"),
        ([{"name": name.replace("Brush", "Broom")}], r"no effect 'Broom'"),
        ({"name": name}, r"effects.*is a list of tables; write effects = \[\{name"),
        (name, r"is a list of tables; write effects = \[\{name = .*Brush"),
        ([3], r"effects\[0\]"),
    ):
        with pytest.raises(InputError, match=words):
            Scenario.load("push_wall", {"effects": given})
    with pytest.raises(InputError, match=r"the list is called effects: effects = \[\{name"):
        Scenario.load("push_wall", {"effect.name": name})
    with pytest.raises(InputError, match=r"it is an effect: use effects = \[\{name"):
        Scenario.load("push_wall", controller=name)
    scenario = Scenario.load("push_wall", {"effects": [{"name": name}]})
    with pytest.raises(InputError, match=r"the scenario has 1 \[\[effects\]\]"):
        scenario.updated({"effects[1].k": 2.0})
    with pytest.raises(InputError, match="at most 8"):
        Simulation(scenario.updated({"effects": 9 * [{"name": name}]}))
    with (
        Simulation(scenario, engine="free_body") as sim,
        pytest.raises(InputError, match="can't add or remove an effect"),
    ):
        sim.reset({"effects": []})


def test_an_array_as_a_setting_is_told_what_to_write(tmp_path):
    text = effect("Wide", "tau[:] = 0.0").replace("k: float = setting(1.0,", "k: np.ndarray = setting(np.eye(3),")
    with pytest.raises(InputError, match=r"my_effect.py, line \d: TypeError: a setting is a tuple"):
        Scenario.load("push_wall", {"effects": [{"name": f"{effect_file(tmp_path, text)}:Wide"}]})


def test_an_effect_that_is_not_finite_stops_the_run_with_its_name(tmp_path):
    lines = "tau[:] = 0.0\nif given.t > 0.0099:\n    tau[0] = np.sqrt(-given.t)"
    name = f"{effect_file(tmp_path, effect('Bad', lines))}:Bad"
    with pytest.raises(Exception, match="Bad"):
        simulate(Scenario.load("push_wall", {"simulation.duration": 0.02, "effects": [{"name": name}]}))


def test_no_law_sees_an_effect(tmp_path):
    """The record of a law has it only by the motion that it measures."""
    name = f"{effect_file(tmp_path, effect('Pull', 'tau[:] = settings.k'))}:Pull"
    scenario = Scenario.load("push_wall", {"effects": [{"name": name, "k": 3.0}]}, "ideal")
    with Simulation(scenario, engine="free_body") as sim:
        sim.prepare()
        assert not sim.signals.tau_dist.any()
        sim.step(1)
        assert (sim.signals.tau_Pull == 3.0).all()


def test_two_files_of_one_name_and_two_effects_of_one_class(tmp_path):
    folders = [tmp_path / "a", tmp_path / "b"]
    names = []
    for folder, number in zip(folders, (1.0, 2.0), strict=True):
        folder.mkdir()
        (folder / "numbers_.py").write_text(f"PULL = {number}\n")
        text = "from numbers_ import PULL\n" + effect("Pull", "tau[:] = settings.k * PULL")
        names.append(f"{effect_file(folder, text)}:Pull")
    given = [{"name": names[0]}, {"name": names[1]}, {"name": names[0], "k": 5.0}]
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.01, "effects": given}), engine="free_body")
    found = [trace.tau_Pull_0[-1][0], trace.tau_Pull_1[-1][0], trace.tau_Pull_2[-1][0]]
    assert found == [1.0, 2.0, 5.0]


def test_two_effects_of_one_class_have_states_of_their_own(tmp_path):
    """Recorded with the numbers of the effects, in memory, in a log and in its figures."""
    lines = "tau[:] = 0.0\ntau[0] = state.x[0]\nstate_dot.x[0] = settings.k"
    ramp = effect("Ramp", lines, '    states = {"x": 1}')
    name = f"{effect_file(tmp_path, ramp)}:Ramp"
    given = {"effects": [{"name": name, "k": 2.0}, {"name": name, "k": 3.0}]}
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.01} | given), engine="free_body")
    assert trace.x_1[-1, 0] == trace.tau_Ramp_1[-1, 0] == pytest.approx(0.03)
    assert trace.x_0[-1, 0] == pytest.approx(0.02)
    trace.save(tmp_path / "run.mcap")
    loaded = Trace.load(tmp_path / "run.mcap")
    assert np.array_equal(loaded.x_1, trace.x_1)
    assert [signal.name for signal in states_of(loaded)][-2:] == ["x_0", "x_1"]


def test_a_log_has_the_effect_and_runs_again_with_its_file(tmp_path, here):
    effect_file(tmp_path, BRUSH)
    common = ("run", "-q", "--engine", "free_body", "simulation.duration=0.1", "-o")
    done = here(*common, "out", 'effects=[{name = "my_effect.py:Brush", k = 60.0}]')
    assert done.exit_code == 0, done.stderr
    log = tmp_path / "out" / "run.mcap"
    whole = Trace.load(log)
    assert whole.tau_Brush.shape == (len(whole.t), 6)
    assert whole.scenario.effects[0].k == 60.0
    refused = here("run", "-q", "--from", log)
    assert refused.exit_code == 2
    assert "--set effects[0].name=path/to/my_effect.py:Brush" in refused.stderr
    again = here("run", "-q", "--from", log, "--set", "effects[0].name=my_effect.py:Brush", "-o", "again")
    assert again.exit_code == 0, again.stderr
    assert np.array_equal(Trace.load(tmp_path / "again" / "run.mcap").p_WB, whole.p_WB)


@pytest.mark.processes
def test_a_study_varies_it_and_takes_it_to_its_workers(tmp_path, here, monkeypatch):
    effect_file(tmp_path, BRUSH)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")  # names of files are relative to the study
    (tmp_path / "s.toml").write_text(
        """
[base]
scenario = "push_wall"
simulation = {duration = 0.2, timestep = 1e-3}
effects = [{name = "my_effect.py:Brush", k = 10.0}]
[[vary]]
key = "effects[0].k"
values = [10.0, 50.0, 90.0]
[keep]
metrics = ["effort_N2s", "final.position_m"]
"""
    )
    frames = []
    for folder, workers in (("one", 1), ("two", 2)):
        done = here("study", "../s.toml", "-o", tmp_path / folder, "-j", workers, "-q")
        assert done.exit_code == 0, done.stderr
        frames.append(frame(tmp_path / folder))
    assert frames[0].filter(like="final").equals(frames[1].filter(like="final"))
    assert len(set(frames[0]["effort_N2s"])) == 3


def test_the_plant_as_an_fmu_has_the_effect_in_it(tmp_path):
    fmpy = pytest.importorskip("fmpy", reason="needs the extra fmi")
    from uvms_mj.engine.plant_fmu import write_fmu

    name = f"{effect_file(tmp_path, BRUSH)}:Brush"
    changes = {"simulation.timestep": 1e-3, "simulation.duration": 0.2, "effects": [{"name": name, "k": 50.0}]}
    scenario = Scenario.load("push_wall", changes)
    path = Path(tmp_path, "plant.fmu")
    write_fmu(scenario, path, with_law=True)
    found = fmpy.simulate_fmu(str(path), stop_time=0.2, output_interval=1e-3, output=["p_WB[1]", "p_WB[2]"])
    trace = simulate(scenario, engine="free_body")
    np.testing.assert_array_equal(found["p_WB[1]"], trace.p_WB[: len(found), 0])
    assert abs(found["p_WB[1]"][-1]) > 1e-4


COUNTS = """
called = 0

@dataclass(frozen=True)
class Counts(Effect):
    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        global called
        called += 1
        tau[:] = 0.0
        tau[0] = 0.001 * called
"""
DRAWS = effect("Draws", "tau[:] = 0.0\ntau[0] = np.random.normal()")


@pytest.mark.filterwarnings("ignore::uvms_mj.engine.vehicle_run.PlainPythonWarning")
@pytest.mark.parametrize(("name", "body"), [("Counts", COUNTS), ("Draws", DRAWS)])
def test_an_effect_that_is_no_function_of_what_it_is_given_has_no_closed_form(tmp_path, name, body):
    """And no slopes at rest, of which a note would speak. Calls for either are in no run: a run and its repetition
    after a reset are the same."""
    effects = {"effects": [{"name": f"{effect_file(tmp_path, body)}:{name}"}]}
    scenario = Scenario.load("push_wall", effects | {"simulation.timestep": 1e-3, "simulation.duration": 0.01})
    with pytest.warns(SamplingWarning, match="is not checked: .* differs from call to call"):
        trace = simulate(scenario)
    assert isinstance(trace.analytic, NoClosedForm)
    assert "depends on more than it is given" in trace.analytic.reason
    if name == "Counts":
        assert trace.tau_Counts[:, 0] == pytest.approx(0.001 * np.arange(1, 12))
        with Simulation(scenario) as sim:
            assert sim.notes
            sim.step(5)
            first = sim.signals.tau_Counts.copy()
            sim.reset()
            sim.step(5)
            assert np.array_equal(sim.signals.tau_Counts, first)


def test_a_note_on_print_names_who_prints(tmp_path):
    silent = effect("Silent", "tau[:] = 0.0")
    loud = effect("Loud", "tau[:] = 0.0\nif given.t < 1e-9:\n    said(given.t)")
    helper = "\n\ndef said(t):\n    print(t)\n"
    path = effect_file(tmp_path, silent + loud + helper)
    for name, notes in (("Silent", 0), ("Loud", 1)):
        with Simulation(Scenario.load("push_wall", {"effects": [{"name": f"{path}:{name}"}]})) as sim:
            assert sum("prints nothing" in note for note in sim.notes) == notes
