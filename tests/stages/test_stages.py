"""The contract of a stage in the four rooms: loading, checks, records, and each shipped function as plain Python."""

import contextlib
import dataclasses
import re
import textwrap
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uvms_mj import Gsta, InputError, LawError, Scenario, Simulation, simulate
from uvms_mj.actuation import Actuation, PseudoInverse
from uvms_mj.actuation.propeller import thrust_curve
from uvms_mj.control import Controller, External, Ideal, ImpedanceTask
from uvms_mj.control.base import NoClosedForm, SteadyState
from uvms_mj.control.task import tracking_errors
from uvms_mj.control.theory.predictions import steady_state
from uvms_mj.guidance import FilteredSteps, Guidance, station_keep
from uvms_mj.guidance.filtered_steps import MOST_WAYPOINTS
from uvms_mj.navigation import Navigation, Perfect
from uvms_mj.scenario import STAGES
from uvms_mj.setup.base import set_up
from uvms_mj.setup.deployment import resolution
from uvms_mj.stages.loader import table_of
from uvms_mj.stages.signals import (
    CLOCK,
    GIVEN,
    MEASURED,
    REFERENCE,
    TASK,
    TASK_GIVEN,
    TRUE,
    TRUTH,
    actuation_given,
    record_dtype,
)

HEADER = """
from dataclasses import dataclass
from uvms_mj import *
from uvms_mj.navigation import Encoder, Observer, Wrist, perfect
from uvms_mj.actuation import Joints, Thrusters, pseudo_inverse
"""


def own(table, body="", members=""):
    """The class of a stage for a table, with a setting that its function uses."""
    room = STAGES[table].base.room
    step = f"@staticmethod\ndef {room.method}({', '.join(room.arguments)}):\n"
    step += textwrap.indent(body or f"x = {room.arguments[0]}.radius", "    ")
    inside = f'"One sentence."\nradius: float = setting(0.1, "1", "a setting")\n{members}\n{step}'
    return f"class Own({STAGES[table].base.__name__}):\n{textwrap.indent(inside, '    ')}"


def record(signals, **values):
    """A record of signals, zero except for the given values."""
    array = np.zeros(1, record_dtype(signals)).view(np.recarray)
    for name, value in values.items():
        array[name] = value
    return array[0]


def settings_of(stage, setup=None):
    return stage.record(setup).view(np.recarray)[0]


def states_of(stage, n=6):
    return tuple(type(stage).state_record(n).view(np.recarray)[0] for _ in range(2))


def file_with(tmp_path, body, frozen="@dataclass(frozen=True)"):
    path = tmp_path / "own.py"
    path.write_text(f"{HEADER}\n{frozen}\n{body}\n")
    return f"{path}:Own"


@pytest.fixture(scope="module")
def setup():
    return set_up(
        Scenario.load("push_wall", {"initial.position": [0.1, 0.2, -0.3], "reference.attitude_deg": [0, 0, 9]})
    )


@pytest.fixture
def rng():
    return np.random.default_rng(11)


# the contract in the four rooms


@pytest.mark.parametrize("table", STAGES)
def test_a_users_stage_is_loaded_validated_and_written_back(tmp_path, table):
    source = file_with(tmp_path, own(table))
    scenario = Scenario.load("push_wall", {f"{table}.name": source, f"{table}.radius": 2})
    stage = getattr(scenario, table)
    assert stage.radius == 2.0
    assert stage.label() == "Own"
    assert not stage.is_shipped
    assert Scenario.from_dict(scenario.to_dict()).to_dict() == scenario.to_dict()
    again = scenario.updated({f"{table}.radius": 3.0})
    assert type(getattr(again, table)) is type(stage)
    assert getattr(again, table).radius == 3.0
    with pytest.raises(InputError, match=rf"{table}.radios: Own has no such .*did you mean 'radius'"):
        Scenario.load("push_wall", {f"{table}.name": source, f"{table}.radios": 2})
    with pytest.raises(InputError, match=rf"{table}.radius: 'x' is not a finite number"):
        Scenario.load("push_wall", {f"{table}.name": source, f"{table}.radius": "x"})


@pytest.mark.parametrize("table", STAGES)
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("radius: float", "label: float", "'label' is an attribute of every"),
        (
            "    @",
            "    states = {'std': 1}\n    @",
            "'std' is an attribute of NumPy's records; give the state another name",
        ),
        ("@staticmethod", "", "must be a @staticmethod"),
        ("state_dot,", "", r"must take \("),
        ("    @", "    states = {'x': 0}\n    @", "states.x: 0 must be a whole number from 1 to 10000"),
        ("    @", "    name = 3\n    @", "name: 3 is not a string"),
        (".radius", ".radios", r"own.py, line \d+: (settings|gains) has no 'radios'; did you mean 'radius'"),
    ],
)
def test_a_stage_that_violates_the_contract_is_refused_with_its_place(tmp_path, table, old, new, said):
    with pytest.raises(InputError, match=said) as caught:
        Scenario.load("push_wall", {f"{table}.name": file_with(tmp_path, own(table).replace(old, new, 1))})
    assert f"{table}.name: " in str(caught.value)


@pytest.mark.parametrize(
    ("table", "body", "said"),
    [
        ("reference", "out.p_d[0] = given.tau_nom[0]", "given has no 'tau_nom'"),
        ("reference", "out.p_D[0] = 0.0", "out has no 'p_D'; did you mean 'p_d'"),
        ("navigation", "x = given.p_d", "given has no 'p_d'; choose from .*p_WB"),
        ("navigation", "out.f_contact_W[:] = 0.0", "out has no 'f_contact_W'.*'f_contact_m_W'"),
        ("navigation", "state_dot.bia[0] = 0.01", "state_dot has no 'bia'; did you mean 'bias'"),
        ("controller", "tau_cmd[:] = signals.s", "signals has no 's'; the class has uses_task = False"),
        ("controller", "tau_cmd[:] = signals.M[0]", "yardstick"),
        ("controller", "tau_cmd[:] = gains.nu_e", "gains has no 'nu_e'; signals.nu_e is a signal"),
        ("actuation", "u[:] = settings.period", "given.period is the period"),
        ("actuation", "pseudo_inverse(given.tau, u)", "given has no 'tau'; did you mean 'tau_cmd'"),
        ("thrusters", "u[:] = given.u", "given has no 'u'; .*u_cmd"),
    ],
)
def test_wrong_fields_are_found_in_each_room(tmp_path, table, body, said):
    members = 'states = {"bias": 3}' + ("\nuses_task = False" if table == "controller" else "")
    with pytest.raises(InputError, match=said):
        Scenario.load("push_wall", {f"{table}.name": file_with(tmp_path, own(table, body, members))})


@pytest.mark.parametrize(
    ("table", "members", "said"),
    [
        ("controller", "uses_task = 0", "uses_task: 0 is not true or false"),
        ("controller", 'states = {"x": "joints"}', "states.x: 'joints' is not the number of thrusters"),
        ("actuation", 'states = {"x": "thruster"}', "states.x: 'thruster' must be"),
        ("joints", 'memory = {"x": "thrusters"}', "memory.x: 'thrusters' is not the number of joints"),
        ("controller", 'states = {"x": 1}\nmemory = {"x": 2}', "'x' is both a state and memory"),
        ("controller", 'memory = {"x": 10_001}', "memory.x: 10001 must be a whole number"),
        ("controller", 'memory = {"x": (101, 100)}', "memory has 10100 numbers in all; at most 10000 are allowed"),
        (
            "controller",
            'memory = {"x": (3, 0)}',
            r"memory.x: \[3, 0\] must be .*, or a tuple of them, as in \(15, 15\)",
        ),
        ("controller", 'memory = {"x": ()}', r"memory.x: \[\] must be a whole number"),
        ("actuation", 'memory = {"x": ("joints", 2)}', "memory.x: 'joints' is not the number of thrusters"),
        ("controller", 'states = {"x": (3, 3)}', "states.x: .* is a shape, which memory may have; a state is a vector"),
        (
            "navigation",
            'memory = {"P": (2, 2)}\nstart_values = {"P": [1, 2, 3, 4]}',
            r"shape \(4,\); the state has \(2, 2\)",
        ),
        (
            "navigation",
            'memory = {"P": (2, 2)}\nstart_values = {"P": [[1], [2, 3]]}',
            "must be a finite number or a list",
        ),
    ],
)
def test_wrong_declarations_are_named(tmp_path, table, members, said):
    with pytest.raises(InputError, match=said):
        Scenario.load("push_wall", {f"{table}.name": file_with(tmp_path, own(table, members=members))})


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("../own.py", "must be a path below the folder"),
        ("none.txt", "files: no file 'none.txt' in"),
        ("own.py", "MB in all; at most 1e-05 MB are allowed"),
    ],
)
def test_files_of_a_class_are_below_its_folder_and_small(tmp_path, monkeypatch, name, said):
    monkeypatch.setattr("uvms_mj.stages.contract._MOST_BYTES", 10)
    with pytest.raises(InputError, match=said):
        Scenario.load("push_wall", controller=file_with(tmp_path, own("controller", members=f"files = ['{name}']")))


@pytest.mark.parametrize("table", STAGES)
def test_a_wrong_name_is_answered_with_the_right_ones(tmp_path, table):
    choice = STAGES[table]
    default = choice.default.name
    cases = {
        default[:-1]: f"did you mean '{default}'",
        3: "3 is not the name of any",
        "nowhere.py:Own": "no file 'nowhere.py'",
        file_with(tmp_path, own(table)).replace(":Own", ":Other"): "no .* 'Other' in .*its .* are .*Own",
    }
    for name, said in cases.items():
        with pytest.raises(InputError, match=f"{table}.name: .*{said}"):
            Scenario.load("push_wall", {f"{table}.name": name})


def test_every_stage_has_documented_settings_and_states():
    for cls in (ImpedanceTask, *(cls for choice in STAGES.values() for cls in choice.shipped.values())):
        assert cls.__doc__, cls
        assert set(cls.units) == set(cls.states), cls
        for field in cls.setting_fields():
            assert field.metadata["unit"], (cls, field.name)
            assert field.metadata["meaning"], (cls, field.name)


def test_a_table_makes_an_equal_stage():
    stages = (
        FilteredSteps(waypoints=({"time": 1.0, "position": (1.0, 2.0, 3.0)},)),
        Perfect(period=0.01),
        Gsta(k_1=3.0),
    )
    for stage in (*stages, PseudoInverse()):
        assert STAGES[stage.room.table].load(table_of(stage)) == stage


def test_a_derived_class_is_shipped_if_it_differs_in_its_settings_only():
    @dataclass(frozen=True)
    class Strong(Gsta):
        k_1: float = 50.0

    @dataclass(frozen=True)
    class Other(PseudoInverse):
        @staticmethod
        def step(settings, state, given, state_dot, u):
            u[:] = 0.0

    assert Strong().is_shipped
    assert not Other().is_shipped


@pytest.mark.parametrize(
    ("table", "module", "shipped", "base", "out"),
    [
        ("encoder", "navigation.encoder", "PerfectEncoder", "Encoder", "out"),
        ("observer", "navigation.observer", "NoObserver", "Observer", "out"),
        ("wrist", "navigation.wrist", "NoWrist", "Wrist", "reading"),
        ("thrusters", "actuation.thrusters", "IdealThrusters", "Thrusters", "u"),
        ("actuation", "actuation.base", "External", "Actuation", "u"),
    ],
)
def test_a_function_that_no_run_would_call_is_refused(tmp_path, table, module, shipped, base, out):
    """It was left out of the run without a word, and a closed form was announced without it."""
    (tmp_path / "own.py").write_text(
        f"from dataclasses import dataclass\nfrom uvms_mj.{module} import {shipped}\n\n\n"
        f"@dataclass(frozen=True)\nclass Own({shipped}):\n    @staticmethod\n"
        f"    def step(settings, state, given, state_dot, {out}):\n        pass\n"
    )
    with pytest.raises(InputError, match=f"it derives from {shipped}, which no run calls; derive it from {base}$"):
        Scenario.load("push_wall", {f"{table}.name": f"{tmp_path / 'own.py'}:Own"})


def test_a_derived_thruster_model_with_another_function_has_no_closed_form(tmp_path):
    (tmp_path / "own.py").write_text(
        "from dataclasses import dataclass\nfrom uvms_mj.actuation import THRUSTERS\n\n\n"
        "@dataclass(frozen=True)\nclass Weak(THRUSTERS['general']):\n    @staticmethod\n"
        "    def step(settings, state, given, state_dot, u):\n        u[:] = 0.5 * given.u_cmd\n"
    )
    for name, known in (("general", True), (f"{tmp_path / 'own.py'}:Weak", False)):
        keys = {"thrusters.name": name, "controller.name": "impedance", "wall.stiffness": 2e3, "current.speed": 0.0}
        found = steady_state(set_up(Scenario.load("push_wall", keys)))
        assert isinstance(found, SteadyState) == known
    assert found == NoClosedForm("closed forms are known for the shipped thruster models only")


_OWN_THRUSTERS = """
from dataclasses import dataclass

from uvms_mj.actuation import THRUSTERS


class Halved:
    @staticmethod
    def step(settings, state, given, state_dot, u):
        u[:] = 0.5 * given.u_cmd


@dataclass(frozen=True)
class Named(THRUSTERS["t200"]):
    pass


@dataclass(frozen=True)
class Weak(THRUSTERS["t200"]):
    @staticmethod
    def step(settings, state, given, state_dot, u):
        u[:] = 0.5 * given.u_cmd


@dataclass(frozen=True)
class Weaker(Weak):
    pass


@dataclass(frozen=True)
class Mixed(Halved, THRUSTERS["t200"]):
    pass


@dataclass(frozen=True)
class OfPoints(THRUSTERS["t200"]):
    @staticmethod
    def step(settings, state, given, state_dot, u):
        u[:] = settings.thrust[settings.thrust.shape[0] - 1]
"""


@pytest.mark.parametrize(
    ("name", "known"), [("Named", True), ("Weak", False), ("Weaker", False), ("Mixed", False), ("OfPoints", False)]
)
def test_a_derived_thruster_model_with_another_function_has_not_the_curve_of_the_shipped_one(tmp_path, name, known):
    """Its pulse widths were recorded as 0 us, its push was said to have the steps of the T200's curve, and the pulse
    widths of a caller went through this curve. Its function has the points of the curve as before."""
    (tmp_path / "own.py").write_text(_OWN_THRUSTERS)
    keys = {"thrusters.name": f"{tmp_path / 'own.py'}:{name}", "simulation.duration": 0.01}
    scenario = Scenario.load("push_wall", keys)
    found = resolution(set_up(scenario))
    assert isinstance(found, str) != known
    assert known or found == f"thrusters.name is {name} without a curve that is inverted"
    trace = simulate(scenario, engine="free_body")
    assert ("pwm" in trace.arrays) == known
    assert name != "OfPoints" or (trace.u[-1] == thrust_curve(16.0).thrust[-1]).all()
    assert (scenario.thrusters.mean_delay() > 0.0) == known
    pulses = scenario.updated({"actuation.name": "pwm"})
    with contextlib.nullcontext() if known else pytest.raises(InputError, match=r"pwm needs thrusters\.name = t200"):
        Simulation(pulses, engine="free_body").close()


def test_a_derived_reference_with_another_function_has_not_the_rest_of_the_shipped_one(tmp_path):
    """It pushed with 5.1 N beside 0 N announced. A rest of its own counts."""
    text = (
        "from dataclasses import dataclass\nfrom uvms_mj.guidance import FilteredSteps\n\n\n"
        "@dataclass(frozen=True)\nclass Deeper(FilteredSteps):\n    @staticmethod\n"
        "    def step(settings, state, given, state_dot, out):\n        out.p_d[0], out.quat_d[0] = 1.05, 1.0\n"
    )
    (tmp_path / "own.py").write_text(text)
    rests = "\n    def rests_at(self):\n        return 1.05, 0.0, 0.0\n"
    (tmp_path / "rests.py").write_text(text + rests)
    none, own = (
        set_up(Scenario.load("push_wall", {"reference.name": f"{tmp_path / file}:Deeper"}))
        for file in ("own.py", "rests.py")
    )
    assert none.rest_pose[0] is None
    assert isinstance(steady_state(none), NoClosedForm)
    assert own.rest_pose[0] == (1.05, 0.0, 0.0)


def test_groups_share_their_memory():
    """Each stage is given the beginning of the record that the stages before it have filled."""
    whole = record_dtype(GIVEN + TRUTH)
    for signals in (CLOCK + MEASURED, TASK_GIVEN, GIVEN, CLOCK + MEASURED + REFERENCE):
        part = record_dtype(signals)
        assert [whole.fields[name][:2] for name in part.names] == [part.fields[name][:2] for name in part.names]
    assert External.given() == TASK_GIVEN
    assert Gsta.given() == GIVEN
    assert Ideal.given() == GIVEN + TRUTH
    names = [signal.name for signal in GIVEN + TRUTH]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("stage", [Perfect(), Gsta(), ImpedanceTask(), PseudoInverse(), FilteredSteps()])
def test_a_record_of_settings_is_never_empty_and_whole_numbers_long(stage, setup):
    made = stage.record(setup)
    assert made.dtype.itemsize >= 8
    assert made.dtype.itemsize % 8 == 0


def test_states_of_the_thrusters_have_their_number(tmp_path):
    states = 'states = {"thrust": "thrusters"}'
    stage = Scenario.load(
        "push_wall", {"actuation.name": file_with(tmp_path, own("actuation", members=states))}
    ).actuation
    assert type(stage).state_record(8)["thrust"].shape == (1, 8)


def test_what_is_not_allowed_in_a_setting_is_named():
    @dataclass(frozen=True)
    class Texts(Navigation):
        text: str = "x"

    with pytest.raises(InputError, match=r"navigation.text: 'x': a setting is a number, true or false"):
        Texts()


# the shipped stages


def test_perfect_navigation_gives_the_truth(rng):
    given = record(CLOCK + TRUE, **{s.name: rng.normal(size=s.shape) for s in TRUE})
    out = record(MEASURED)
    Perfect.step(settings_of(Perfect()), *states_of(Perfect())[:1], given, None, out)
    for known, true in zip(MEASURED, TRUE, strict=False):  # TRUE has more signals
        assert np.array_equal(out[known.name], given[true.name])


@pytest.mark.parametrize("n", [0, 1, 3, MOST_WAYPOINTS])
def test_the_reference_does_not_depend_on_the_room_for_its_steps(setup, n, rng):
    """The same numbers as from arrays of the steps' own length, for any number of steps with one record."""
    times = np.sort(rng.uniform(0.0, 5.0, n))
    waypoints = [
        {"time": t, "position": p} for t, p in zip(times.tolist(), rng.normal(size=(n, 3)).tolist(), strict=True)
    ]
    stage = FilteredSteps(waypoints=waypoints, attitude_deg=(0.0, 0.0, 30.0))
    settings, steps = settings_of(stage, setup), stage.steps
    assert settings.dtype == settings_of(FilteredSteps(), setup).dtype
    for t in (0.0, 0.5, 1.2, 4.0, 60.0):
        out, wanted, given = record(REFERENCE), record(REFERENCE), record(CLOCK + MEASURED, t=t)
        FilteredSteps.step(settings, None, given, None, out)
        arrays = {"times": np.array([w.time for w in steps]), "positions": np.array([w.position for w in steps])}
        start = np.array(setup.scenario.initial.position)
        own = SimpleNamespace(**arrays, start=start, bandwidth=stage.bandwidth, quat_d=settings.quat_d)
        FilteredSteps.step(own, None, given, None, wanted)
        assert out == wanted
        assert np.allclose(out.quat_d, Rotation.from_euler("z", 30.0, degrees=True).as_quat(scalar_first=True))
    assert stage.rests_at() == steps[-1].position


def test_hold_keeps_the_first_position(setup):
    @dataclass(frozen=True)
    class Still(Guidance):
        @staticmethod
        def step(settings, state, given, state_dot, out):
            station_keep(settings, given, out)

    out, stage = record(REFERENCE, p_d_dot=1.0, p_d_ddot=1.0), Still(attitude_deg=(0.0, 0.0, 180.0))
    for instant, p_WB in enumerate(([1.0, 2.0, 3.0], [4.0, 5.0, 6.0])):
        Still.step(settings_of(stage), None, record(CLOCK + MEASURED, p_WB=p_WB, instant=instant), None, out)
        assert np.array_equal(out.p_d, [1.0, 2.0, 3.0])
        assert not out.p_d_dot.any()
        assert not out.p_d_ddot.any()
        assert np.allclose(out.quat_d, [0.0, 0.0, 0.0, 1.0])
    assert stage.rests_at() is None


@pytest.mark.parametrize("wrong", [(1.0, 2.0), (1.0, 2.0, np.nan), "x"])
def test_a_rest_that_is_no_position_is_refused(wrong):
    @dataclass(frozen=True)
    class Odd(Guidance):
        def rests_at(self):
            return wrong

    with pytest.raises(InputError, match=r"Odd.rests_at returned .*three numbers"):
        Odd()


def test_allocation_solves_for_the_wrench_within_the_limits(setup, rng):
    vehicle = setup.vehicle
    B, n = vehicle.B, len(vehicle.thrusters)
    limits = {"u_min": vehicle.u_min, "u_max": vehicle.u_max}
    for size in (1.0, 1e4):
        tau_cmd = B @ rng.normal(size=n) * size
        given = record(actuation_given(n), tau_cmd=tau_cmd, B=B, B_pinv=np.linalg.pinv(B), **limits)
        u = np.zeros(n)
        PseudoInverse.step(None, None, given, None, u)
        assert np.allclose(u, np.clip(np.linalg.lstsq(B, tau_cmd, rcond=None)[0], vehicle.u_min, vehicle.u_max))
    given = record(actuation_given(n), tau_cmd=B @ np.ones(n), B=B, B_pinv=np.linalg.pinv(B), u_min=-1e9, u_max=1e9)
    PseudoInverse.step(None, None, given, None, u)
    assert np.allclose(B @ u, B @ np.ones(n))


def test_external_stages_leave_what_the_caller_has_set():
    for choice in (STAGES["controller"], STAGES["actuation"]):
        cls = choice.shipped["external"]
        out = np.arange(6.0)
        cls.function()(None, None, None, None, out)
        assert np.array_equal(out, np.arange(6.0))
        assert cls.external
        assert not choice.default.external


def task_inputs(rng, setup):
    design, impedance = setup.design, setup.scenario.impedance
    quat = Rotation.random(random_state=4).as_quat(scalar_first=True)
    given = record(
        TASK_GIVEN,
        **{s.name: rng.normal(size=s.shape) for s in TASK_GIVEN if s.kind == "f8"},
    )
    for name, value in {"M_hat": design.M_hat, "M_d": design.M_d, "D_d": design.D_d, "quat_WB": quat}.items():
        given[name][:] = value
    given.K_d[:], given.K_f[:], given.F_d[:] = impedance.K_d, impedance.K_f, impedance.F_d
    given.R_WB[:] = Rotation.from_quat(quat, scalar_first=True).as_matrix()
    given.quat_d[:] = Rotation.random(random_state=5).as_quat(scalar_first=True)
    tracking_errors(given, given)
    return given


def test_the_task_is_equations_7_14_15_and_23(setup, rng):
    task = ImpedanceTask(F_1=2.0, F_2=(0.5, 1.0, 2.0, 3.0, 4.0, 5.0), A=(-1.0, -2.0, -3.0, -4.0, -5.0, -6.0))
    given, out = task_inputs(rng, setup), record(TASK)
    state, state_dot = states_of(task)
    state.zeta[:] = rng.normal(size=6)
    ImpedanceTask.step(settings_of(task, setup), state, given, state_dot, out)
    F_1, F_2, A, zeta = (np.array(x) for x in (task.F_1, task.F_2, task.A, state.zeta))
    pull = given.K_d * given.eta_e + given.D_d @ given.nu_e - given.K_f * (given.tau_contact_m_B - given.F_d)
    w = np.linalg.solve(given.M_d, pull)
    q_w, q_v = given.quat_e[0], given.quat_e[1:]
    omega_e = given.nu_e[3:]
    eta_e_dot = np.concatenate([given.nu_e[:3], 0.5 * (q_w * omega_e + np.cross(q_v, omega_e))])
    wrenches = given.C_hat_nu + given.D_hat_nu + given.g_hat - given.tau_contact_m_B
    assert np.allclose(out.w, w)
    assert np.allclose(out.s, given.nu_e + F_1 * given.eta_e + F_2 * zeta)
    assert np.allclose(out.tau_nom, given.M_hat @ (given.nu_d_dot - w) + wrenches)
    inside = w + A * F_1 * given.eta_e + A * given.nu_e - F_1 * eta_e_dot
    assert np.allclose(state_dot.zeta, A * zeta + inside / F_2)
    for name, value in {"F_1": F_1, "F_2": F_2, "A": A, "zeta": zeta}.items():
        assert np.array_equal(out[name], value)


def test_the_integral_task_begins_with_s_zero_and_integrates_the_impedance(setup, rng):
    """With A = 0 and F_1 = F_2 = 1, s_dot = nu_e_dot + w: eq. (20), whatever the poses."""
    task = ImpedanceTask(integral=True, F_2=2.0)
    given, out = task_inputs(rng, setup), record(TASK)
    state, state_dot = states_of(task)
    ImpedanceTask.step(settings_of(task, setup), state, given, state_dot, out)
    assert np.abs(out.s).max() < 1e-14
    kept = state.zeta.copy()
    given.instant = 1
    given.nu_e[:] += 1.0
    ImpedanceTask.step(settings_of(task, setup), state, given, state_dot, out)
    assert np.array_equal(state.zeta, kept)
    assert np.allclose(out.s, 1.0)


def test_tracking_errors_are_those_of_the_motion(rng):
    """eta_e_dot of a finite difference is nu_e, and nu_d_dot the derivative of nu_d, both in the rotating B."""
    p, v, p_d, v_d, a_d, omega = rng.normal(size=(6, 3))
    R_0, h = Rotation.random(random_state=6), 1e-6

    def at(t):
        R = R_0 * Rotation.from_rotvec(omega * t)  # omega in B
        quat = R.as_quat(scalar_first=True)
        given = record(
            TASK_GIVEN,
            p_WB=p + v * t,
            quat_WB=quat,
            R_WB=R.as_matrix(),
            nu=np.concatenate([R.inv().apply(v), omega]),
            p_d=p_d + v_d * t + 0.5 * a_d * t * t,
            p_d_dot=v_d + a_d * t,
            p_d_ddot=a_d,
            quat_d=[1.0, 0.0, 0.0, 0.0],
        )
        tracking_errors(given, given)
        return given

    before, here, after = at(-h), at(0.0), at(h)
    p_e_dot = (after.eta_e[:3] - before.eta_e[:3]) / (2 * h)
    assert np.allclose(p_e_dot + np.cross(omega, here.eta_e[:3]), here.nu_e[:3], atol=1e-8)
    v_d_dot = ((after.nu - after.nu_e) - (before.nu - before.nu_e))[:3] / (2 * h)
    assert np.allclose(v_d_dot, here.nu_d_dot[:3], atol=1e-8)
    assert np.array_equal(here.nu_e[3:], omega)
    sign = 1.0 if R_0.as_quat(scalar_first=True)[0] >= 0.0 else -1.0
    assert np.allclose(here.quat_e, sign * R_0.as_quat(scalar_first=True))


def test_a_stages_functions_change_only_their_outputs(setup, rng):
    given, out = task_inputs(rng, setup), record(TASK)
    before = given.copy()
    task = ImpedanceTask()
    ImpedanceTask.step(settings_of(task, setup), states_of(task)[0], given, states_of(task)[1], out)
    assert given.tobytes() == before.tobytes()


def test_the_base_classes_are_not_stages_to_choose():
    for base in (Guidance, Navigation, Actuation):
        with pytest.raises(NotImplementedError):
            base.step(None, None, None, None, None)
        assert re.search(r"given", base.__doc__)
    assert dataclasses.is_dataclass(Guidance)


def list_stage(tmp_path, default="(0.3, 0.0, 0.0)", states="{}", frozen="@dataclass(frozen=True)"):
    members = f'bias: tuple[float, float, float] = setting({default}, "N", "bias")\nstates = {states}'
    return file_with(tmp_path, own("navigation", "perfect(given, out)", members), frozen)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ([], "[] has 0 values; 3 are needed"),
        ([0.3, 0], "[0.3, 0] has 2 values; 3 are needed"),
        ([1, 2, 3, 4], "[1, 2, 3, 4] has 4 values; 3 are needed"),
    ],
)
def test_a_list_of_the_wrong_length_is_one_sentence(tmp_path, value, words):
    source = {"navigation.name": list_stage(tmp_path)}
    with pytest.raises(InputError, match=re.escape(f"push_wall: navigation.bias: {words}") + "$"):
        Scenario.load("push_wall", source | {"navigation.bias": value})
    with (
        Simulation(Scenario.load("push_wall", source)) as sim,
        pytest.raises(InputError, match=re.escape(f"reset: navigation.bias: {words}") + "$"),
    ):
        sim.reset(overrides={"navigation.bias": value})


def test_a_number_in_place_of_a_list_is_answered_with_the_default(tmp_path):
    source = list_stage(tmp_path)
    with pytest.raises(InputError, match=r"80 is not a list of numbers; its default is \[0\.3, 0\.0, 0\.0\]$"):
        Scenario.load("push_wall", {"navigation.name": source, "navigation.bias": 80})


def test_a_wrong_default_is_said_to_be_the_classs(tmp_path):
    with pytest.raises(InputError, match=r"has 2 values; 3 are needed; it is the default in the class Own"):
        Scenario.load("push_wall", {"navigation.name": list_stage(tmp_path, "(0.3, 0.0)")})


@pytest.mark.parametrize("name", ["key", "period", "nu", "s", "tau_cmd", "quat_WB_m", "u", "class"])
def test_a_state_may_not_take_the_name_of_a_signal_or_a_word_of_python(tmp_path, name):
    with pytest.raises(InputError, match=rf"'{name}' is .*; give the state another name$"):
        Scenario.load("push_wall", {"navigation.name": list_stage(tmp_path, states=repr({name: 3}))})


def test_a_key_of_the_stage_in_use_is_suggested(tmp_path):
    with pytest.raises(InputError, match=r"did you mean 'disturbance.bias' or 'navigation.bias'\?"):
        Scenario.load("push_wall", {"navigation.name": list_stage(tmp_path), "bias": 3})


def test_a_stage_in_the_wrong_table_is_sent_to_its_own(tmp_path):
    with pytest.raises(InputError, match=r"it is a navigation stage: use navigation.name"):
        Scenario.load("push_wall", controller=list_stage(tmp_path))
    with pytest.raises(InputError, match=r"controller: is a stage; give it to simulate"):
        Scenario.load("push_wall", {"controller": Gsta()})


@pytest.mark.parametrize("frozen", ["", "@dataclass\n"])
def test_a_missing_decorator_is_one_error(tmp_path, frozen):
    with pytest.raises(InputError, match=r"@dataclass\(frozen=True\)") as caught:
        Scenario.load("push_wall", {"navigation.name": list_stage(tmp_path, frozen=frozen)})
    assert len(caught.value.faults) == 1


def test_memory_is_kept_and_neither_advances_nor_is_recorded(tmp_path):
    """A queue of two samples in memory delays the position by two periods."""
    body = ["perfect(given, out)", "out.p_WB[0] = state.queue[1]", "state.queue[1] = state.queue[0]"]
    body = "\n".join([*body, "state.queue[0] = given.p_WB[0]"])
    late = file_with(tmp_path, own("navigation", body, 'memory = {"queue": 2}'))
    overrides = {"simulation.duration": 0.01, "initial.velocity": [1.0, 0, 0, 0, 0, 0]}
    overrides["navigation.name"] = late
    trace = simulate(Scenario.load("push_wall", overrides), log_rate=1e4)
    assert np.array_equal(trace.p_WB_m[2:, 0], trace.p_WB[:-2, 0])
    assert np.ptp(trace.p_WB[:, 0]) > 1e-3
    assert "queue" not in set(trace)


# start values: where a class declares them, a run begins and a reset returns to them

RIGHT = {
    "controller": "tau_cmd[:] = 0.0",
    "navigation": "perfect(given, out)",
    "actuation": "pseudo_inverse(given, u)",
    "thrusters": "u[:] = given.u_cmd",
}
STARTS = '{"decays": [1.0, -2.0, 3.0], "kept": 0.5}'


@pytest.mark.parametrize("plain", [False, True])
def test_memory_has_the_shape_that_the_class_declares(tmp_path, plain):
    """A matrix that starts at [[1, 2], [3, 4]] is squared at each instant, and a row for each thruster counts them. A
    reset returns to the start."""
    body = RIGHT["thrusters"] + "\nstate.P[:] = state.P @ state.P\nstate.seen += 1.0\nstate.of_P[:] = state.P.ravel()"
    body += "\nstate.of_seen[:] = state.seen.sum(axis=1)" + ("\nrepr(state)" if plain else "")
    members = 'states = {"of_P": 4, "of_seen": "thrusters"}\nmemory = {"P": (2, 2), "seen": ("thrusters", 3)}'
    members += '\nstart_values = {"P": [[1.0, 2.0], [3.0, 4.0]]}'
    file = file_with(tmp_path, own("thrusters", body, members))
    with Simulation(Scenario.load("push_wall", {"thrusters.name": file}), engine="free_body") as sim:
        assert bool(sim.slow_stages) == plain
        for _ in range(2):
            sim.step(3)
            assert sim.signals["of_P"].tolist() == np.linalg.matrix_power([[1, 2], [3, 4]], 8).ravel().tolist()
            assert sim.signals["of_seen"].tolist() == [9.0] * 6
            assert "P" not in sim.signals
            sim.reset()


def test_a_number_that_is_not_finite_in_a_matrix_is_named_with_its_place(tmp_path):
    body = RIGHT["thrusters"] + "\nstate.P[1, 0] = state.P[0, 0] / state.P[0, 1]"
    file = file_with(tmp_path, own("thrusters", body, 'memory = {"P": (2, 3)}'))
    with pytest.raises(LawError, match=r"let state.P\[1, 0\] become nan"):
        simulate(Scenario.load("push_wall", {"thrusters.name": file}), engine="free_body")


def starting(tmp_path, table, starts=STARTS, size=3, plain=False):
    body = f"{RIGHT[table]}\nfor i in range(len(state.decays)):\n    state_dot.decays[i] = -2.0 * state.decays[i]\n"
    body += "for i in range(2):\n    state_dot.zero[i] = state.kept[i]"
    body += "\nrepr(state)" if plain else ""  # which is not in the language
    members = f'states = {{"decays": {size}, "zero": 2}}\nmemory = {{"kept": 2}}\nstart_values = {starts}'
    settings = {f"{table}.name": file_with(tmp_path, own(table, body, members)), "simulation.timestep": 1e-3}
    return Scenario.load("push_wall", settings)


@pytest.mark.parametrize(
    ("table", "plain"), [("controller", False), ("navigation", False), ("thrusters", False), ("controller", True)]
)
def test_states_and_memory_begin_at_their_values_and_return_to_them(tmp_path, table, plain):
    """Explicit Euler of x' = -2 x from the start, and of y' = 0.5 from zero, with the memory that stays as it was."""
    start, h = np.array([1.0, -2.0, 3.0]), 1e-3
    with Simulation(starting(tmp_path, table, plain=plain), engine="free_body") as sim:
        assert bool(sim.slow_stages) == plain
        for steps in (10, 7):
            assert np.array_equal(sim.signals["decays"], start)
            assert not sim.signals["zero"].any()
            sim.step(steps)
            n = steps if table in ("navigation", "reference") else steps - 1  # the law's instant is in the next step
            assert sim.signals["decays"] == pytest.approx(start * (1.0 - 2.0 * h) ** n, rel=1e-14)
            assert sim.signals["zero"] == pytest.approx(np.full(2, 0.5 * h * n), rel=1e-14)
            sim.reset()


def test_a_list_for_the_thrusters_has_their_number(tmp_path):
    six, five = ('{"decays": [1, 2, 3, 4, 5, 6], "kept": 0.5}', '{"decays": [1, 2, 3, 4, 5], "kept": 0.5}')
    with Simulation(starting(tmp_path, "actuation", six, '"thrusters"'), engine="free_body") as sim:
        assert sim.signals["decays"].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    scenario = starting(tmp_path, "actuation", five, '"thrusters"')
    with pytest.raises(
        InputError, match=r"^actuation.name: Own: start_values\['decays'\] has 5 numbers; the state has 6"
    ):
        Simulation(scenario, engine="free_body")


@pytest.mark.parametrize(
    ("starts", "said"),
    [
        ('{"decayz": 1.0}', "start_values has 'decayz', which is not a state; did you mean 'decays'?"),
        ('{"decays": [1.0, 2.0]}', "start_values['decays'] has 2 numbers; the state has 3"),
        ('{"kept": [1.0, float("nan")]}', "start_values.kept: [1.0, nan] must be a finite number or a list of them"),
        ('{"zero": "one"}', "start_values.zero: 'one' must be a finite number or a list of them"),
        ('{"zero": [[1.0, 2.0]]}', "start_values['zero'] has the shape (1, 2); the state has (2,)"),
        ('{"zero": [[1.0], [2.0, 3.0]]}', "start_values.zero: [[1.0], [2.0, 3.0]] must be a finite number or a list"),
        ('{"zero": True}', "start_values.zero: True must be a finite number or a list of them"),
        ("[1.0]", "start_values: [1.0] is not a table"),
    ],
)
def test_wrong_start_values_are_named(tmp_path, starts, said):
    with pytest.raises(InputError, match=rf"controller.name: Own in .*own\.py: {re.escape(said)}"):
        starting(tmp_path, "controller", starts)


class Further:
    """A further base class of a law."""


@dataclass(frozen=True)
class Mixed(Controller, Further):
    k: float = 1.0

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[0] = -gains.k * signals.eta_e[0]


def test_a_law_with_a_further_base_class_keeps_its_contract():
    assert Mixed().k == 1.0

    class Wrong(Mixed):
        def label(self):
            return "mine"

    with pytest.raises(InputError, match="'label' is a method of every law; give yours another name"):
        dataclass(frozen=True)(Wrong)()
