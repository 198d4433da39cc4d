"""Plans: a study file as a list of runs, its errors, the order and the seeds of its runs."""

import itertools
import tomllib
from random import Random

import numpy as np
import pytest
import tomli_w

from uvms_mj import InputError, Scenario
from uvms_mj.files import shipped
from uvms_mj.studies.plan import Plan

LEAST = """
[base]
scenario = "push_wall"
[design]
runs = 60
seed = 7
[[vary]]
key = "wall.stiffness"
distribution = "loguniform"
low = 2e4
high = 2e5
"""
SEVERAL = """
name = "several"
laws = ["gsta", {name = "fosm", label = "first-order", controller.K_s = 24.0}, {label = "strong", controller.k_1 = 8.0}]
[base.reference]
waypoints = [{time = 1.0, position = [1.01, 0.0, 0.0]}]
[design]
repeats = 2
[[vary]]
key = "simulation.duration"
values = [0.5, 2]
[[vary]]
keys = ["initial.position[1]", "reference.waypoints[0].position[1]"]
low = [0.0, 0.1]
high = [0.1, 0.3]
number = 3
[[vary]]
key = "controller.epsilon"
laws = ["first-order"]
values = [1e-3, 2e-3]
[[vary]]
key = "impedance.K_d[4]"
values = [40, 50.0]
"""
LAW = """
from dataclasses import dataclass
from uvms_mj import Controller, gain

@dataclass(frozen=True)
class Mine(Controller):
    gain_p: float = gain(2.0, "1/s", "gain")

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            tau_cmd[i] = signals.tau_nom[i]
"""


def plan(text: str, **overrides) -> Plan:
    return Plan.from_dict(tomllib.loads(text), overrides={key.replace("__", "."): x for key, x in overrides.items()})


def faults(text: str, **overrides) -> dict[str, str]:
    with pytest.raises(InputError) as raised:
        plan(text, **overrides)
    return {fault.key: fault.message for fault in raised.value.faults}


@pytest.fixture(scope="module")
def several() -> Plan:
    return plan(SEVERAL)


def test_the_least_file():
    least = plan(LEAST)
    assert (least.runs, least.draws, least.design, least.repeats, least.engine) == (60, 60, "random", 1, "auto")
    assert [law.label for law in least.laws] == ["gsta"]
    assert least.base == Scenario.load("push_wall")
    assert least.varied == ("wall.stiffness",)
    assert least.units == {"wall.stiffness": "N/m"}
    assert least.steps == 60 * least.base.steps
    assert "contact.peak_N" in least.metrics
    assert least.logs.kind == "none"
    assert least.notes == ()
    stiffness = [least.run(index).values["wall.stiffness"] for index in range(60)]
    assert stiffness == [point for (point,) in least.points]
    assert min(stiffness) >= 2e4
    assert max(stiffness) <= 2e5
    assert "60 runs" in least.text()
    assert "wall.stiffness [N/m]: loguniform (low 20000.0, high 200000.0)" in least.text()


def test_the_index_of_a_run_is_draw_then_law_then_repeat(several):
    indices = itertools.product(range(several.draws), [law.label for law in several.laws], range(2))
    runs = [several.run(index) for index in range(several.runs)]
    assert [(run.draw, run.law, run.repeat) for run in runs] == list(indices)
    assert [run.index for run in runs] == list(range(2 * 3 * 2 * 3 * 2 * 2))
    for index in (-1, several.runs):
        with pytest.raises(IndexError, match="from 0 to 143"):
            several.run(index)


def test_the_overrides_of_a_run_make_its_scenario_from_the_base(several):
    for index in range(several.runs):
        scenario = several.scenario(index)
        run = several.run(index)
        assert several.base.updated(run.overrides) == scenario
        values = run.values
        y = scenario.initial.position[1]
        assert y == values["initial.position[1]"]
        assert scenario.reference.waypoints[0].position[1] == values["reference.waypoints[0].position[1]"]
        np.testing.assert_allclose(2.0 * y + 0.1, values["reference.waypoints[0].position[1]"])
        assert scenario.impedance.K_d == (150.0, 1500.0, 1500.0, 50.0, values["impedance.K_d[4]"], 50.0)
        assert scenario.simulation.duration == values["simulation.duration"]
        assert scenario.simulation.seed == run.seed


def test_keys_of_one_wall_vary_with_their_components():
    wall = {"shape": "plane", "position": [1.3, 0.0, 0.0]}
    tables = {
        "base": {"scenario": "push_wall", "walls": [wall, wall], "wall": {"present": False}},
        "vary": [
            {"key": "walls[1].friction", "values": [0.1, 0.2]},
            {"key": "walls[1].attitude_deg[2]", "values": [5.0]},
        ],
    }
    plan = Plan.from_dict(tables)
    first, second = plan.scenario(1).walls
    assert (first.friction, second.friction) == (0.0, 0.2)
    assert (first.attitude_deg, second.attitude_deg) == ((0.0, 0.0, 0.0), (0.0, 0.0, 5.0))
    assert plan.units == {"walls[1].friction": "", "walls[1].attitude_deg[2]": "deg"}
    assert Plan.from_dict(plan.tables).scenario(1) == plan.scenario(1)


def test_what_readers_should_know_stays_with_the_plan():
    about = {"version": 3, "literature": ["Hogan 1985"]}
    plan = Plan.from_dict(tomllib.loads(LEAST) | {"about": about})
    assert plan.about == Plan.from_dict(plan.tables).about == about
    assert "about" not in Plan.from_dict(tomllib.loads(LEAST)).tables


def test_thruster_positions_vary_by_component_once_the_base_has_them():
    text = KEY + 'key = "vehicle.thruster_offset[2][1]"\ndistribution = "normal"\nmean = 0\ndeviation = 0.01'
    text += "\n[design]\nruns = 4"
    assert "give it a value in [base]" in faults(text)["vary[0]"]
    moved = plan(text.replace("[[vary]]", "[base.vehicle]\nthruster_offset = [" + "[0, 0, 0]," * 6 + "]\n[[vary]]"))
    assert moved.units == {"vehicle.thruster_offset[2][1]": "m"}
    for index in range(4):
        offsets = moved.scenario(index).vehicle.thruster_offset
        assert offsets == tuple((0.0, moved.points[index][0] if i == 2 else 0.0, 0.0) for i in range(6))


def test_a_law_has_its_own_settings_and_its_own_keys(several):
    for index in range(several.runs):
        run, law = several.run(index), several.scenario(index).controller
        if run.law == "first-order":
            assert (law.label(), law.K_s, law.epsilon) == ("fosm", 24.0, run.values["controller.epsilon"])
        else:
            assert run.values["controller.epsilon"] is None
            assert (law.label(), law.k_1) == ("gsta", 8.0 if run.law == "strong" else 5.0)


def test_settings_of_the_base_that_a_law_leaves_out_are_noted_once_a_law():
    made = plan(
        """
        base = {scenario = "push_wall", "controller.k_1" = 2.0, "thrusters.name" = "t200", "thrusters.voltage" = 14.0}
        laws = ["gsta", "fosm", {name = "gsta", label = "b", "controller.k_1" = 3.0, "thrusters.name" = "ideal"}]
        vary = [{key = "wall.stiffness", values = [1e4, 1e5, 1e6]}]
        """
    )
    own, thrusters = made.notes
    assert own == "laws[1]: controller.name: fosm takes the place of gsta, so controller.k_1 is left out"
    assert thrusters == "laws[2]: thrusters.name: ideal takes the place of t200, so thrusters.voltage is left out"
    assert made.text().endswith(f"note: {own}\nnote: {thrusters}")
    assert Plan.from_dict(made.tables).notes == made.notes


def test_the_steps_are_those_of_all_scenarios(several):
    assert several.steps == sum(several.scenario(index).steps for index in range(several.runs))


def test_the_seed_is_the_same_for_all_laws_and_differs_between_draws_and_repeats(several):
    seeds: dict[tuple[int, int], set[int]] = {}
    for index in range(several.runs):
        run = several.run(index)
        seeds.setdefault((run.draw, run.repeat), set()).add(run.seed)
    assert all(len(each) == 1 for each in seeds.values())
    assert len(set().union(*seeds.values())) == len(seeds) == several.draws * 2
    one_law = plan(SEVERAL.replace('laws = ["gsta", {', "laws = [{"))
    assert [one_law.run(4 * draw).seed for draw in range(24)] == [several.run(6 * draw).seed for draw in range(24)]
    assert plan(SEVERAL, design__seed=1).run(0).seed != several.run(0).seed
    assert all(float(seed) == seed for (seed,) in seeds.values())


@pytest.mark.parametrize("text", [LEAST, SEVERAL, LEAST.replace("runs = 60", 'runs = 64\nkind = "sobol"')])
def test_the_tables_of_a_plan_give_the_same_plan_also_as_toml(text):
    once = plan(text)
    for tables in (once.tables, tomllib.loads(tomli_w.dumps(once.tables))):
        again = Plan.from_dict(tables)
        assert again.tables == once.tables
        assert again.points == once.points
        assert (again.base, again.varied, again.units) == (once.base, once.varied, once.units)
        assert [again.run(i) for i in range(again.runs)] == [once.run(i) for i in range(once.runs)]


def test_every_error_of_a_file_is_reported_at_once():
    found = faults(
        """
        laws = ["gsta", "fosmm", {name = "fosm", controller.K_s = -1}, {name = "gsta"}, 3]
        [base]
        scenario = "push_wall"
        [base.wal]
        stiffness = 3
        [base.wall]
        damping = "soft"
        [design]
        sed = 7
        repeats = 0
        [[vary]]
        key = "wall.stiffnes"
        values = [1e4, 1e5]
        [[vary]]
        key = "wall.stiffness"
        distribution = "logunifor"
        hig = 2e5
        [[vary]]
        key = "wall.position"
        low = 2
        high = 1
        number = 3
        [keep]
        metrics = ["contact.peek_N", "wall_time_s", "status"]
        logs = "worst"
        [run]
        engine = "cuda"
        time_limit_s = -1
        [report]
        """
    )
    assert list(found) == [
        "design.repeats",
        "design.sed",
        "keep.logs.metric",
        "run.engine",
        "run.time_limit_s",
        "report",
        "vary[1].distribution",
        "vary[1].hig",
        "vary[2].low",
        "base.wal.stiffness",
        "base.wall.damping",
        "laws[1].name",
        "laws[2].controller.K_s",
        "laws[3].label",
        "laws[4]",
        "keep.metrics[0]",
        "keep.metrics[1]",
        "keep.metrics[2]",
        "vary[0]",
    ]
    assert "did you mean 'high'?" in found["vary[1].hig"]
    assert "did you mean 'seed'?" in found["design.sed"]
    assert "did you mean 'wall'?" in found["base.wal.stiffness"]
    assert "did you mean 'fosm'?" in found["laws[1].name"]
    assert "used twice" in found["laws[3].label"]
    assert "did you mean 'contact.peak_N'?" in found["keep.metrics[0]"]
    assert "differs from one execution" in found["keep.metrics[1]"]
    assert found["vary[0]"] == "wall.stiffnes: no such key; did you mean 'stiffness'?"


KEY = '[base]\nscenario = "push_wall"\n[[vary]]\n'


@pytest.mark.parametrize(
    ("text", "key", "words"),
    [
        (KEY + 'key = "wal.stiffness"\nvalues = [1.0, 2.0]', "vary[0]", "did you mean 'wall'?"),
        (KEY + 'key = "wall.stiffness"\nvalues = [1.0, -1]', "vary[0].values[1]", "-1.0 must be from 0.001"),
        (KEY + 'key = "wall.stiffness"\nvalues = [1e11]', "vary[0].values[0]", "too stiff for a time step"),
        (KEY + 'key = "wall.stiffness"\nlow = 1e3\nhigh = 1e11\nnumber = 3', "vary[0].high", "too stiff"),
        (KEY + 'key = "initial.position[3]"\nvalues = [1.0]', "vary[0]", "has 3 components, [0] to [2]"),
        (KEY + 'key = "impedance.M_d[0]"\nvalues = [1.0]', "vary[0]", "has no components in the base scenario"),
        (KEY + 'key = "wall.stiffness[0]"\nvalues = [1.0]', "vary[0]", "has no component 0"),
        (KEY + 'key = "walls[0].friction"\nvalues = [1.0]', "vary[0]", "the scenario has 0 [[walls]]"),
        (KEY + 'key = "walls[0].position[1]"\nvalues = [1.0]', "vary[0]", "the scenario has 0 [[walls]]"),
        (KEY + 'key = "controller.K_s"\nvalues = [1.0, 2.0]', "vary[0]", "gsta has no such gain"),
        (KEY + 'key = "vehicle.model"\nvalues = ["bluerov9"]', "vary[0].values[0]", "did you mean 'bluerov2'?"),
        (
            'laws = ["gsta", "fosm"]\n' + KEY + 'key = "controller.K_s"\nvalues = [9.0, 8.0]',
            "vary[0]",
            'laws = ["fosm"]',
        ),
        (KEY + 'key = "wall.damping"\nvalues = [1.0]\nlaws = ["fosm"]', "vary[0].laws[0]", "no law 'fosm'"),
        (
            KEY + 'key = "wall.damping"\nvalues = [1.0]\n[[vary]]\nkey = "wall.damping"\nvalues = [2.0]',
            "vary[1]",
            "varies in vary[0] already",
        ),
        (
            KEY + 'key = "initial.position"\nvalues = [[0, 0, 0]]\n[[vary]]\nkey = "initial.position[0]"\nvalues = [0]',
            "vary[1]",
            "varies in vary[0] already",
        ),
        (
            "[base.reference]\nwaypoints = [{time = 1.0, position = [1.0, 0.0, 0.0]}]\n"
            '[[vary]]\nkey = "reference.waypoints[0].position[1]"\nvalues = [0]\n'
            '[[vary]]\nkey = "reference.waypoints[0].position"\nvalues = [[1, 0, 0]]',
            "vary[1]",
            "varies in vary[0] already",
        ),
        (
            KEY + 'key = "wall.friction"\ndistribution = "normal"\nmean = 0.0\ndeviation = 0.1\n[design]\nruns = 9',
            "vary[0].deviation",
            "a truncated_normal has a least and a greatest value",
        ),
        (
            'laws = [{name = "gsta", controller.k_1 = 1.0}]\n' + KEY + 'key = "controller.k_1"\nvalues = [2.0]',
            "laws[0].controller.k_1",
            "no effect",
        ),
        ('laws = ["external"]\n' + KEY + 'key = "wall.damping"\nvalues = [1.0]', "laws[0].name", "another law"),
        ("laws = []\n[base]", "laws", "is empty"),
        ('laws = "gsta"\n[base]', "laws", "must be a list of laws"),
        ('base = "push_wall"', "base", "is not a table"),
        ('laws = ["gsta"]', "base", "lacks this key"),
        ('[base]\nlaws = ["gsta"]', "base.laws", "write it above [base]"),
        ('name = "../other"\n[base]', "name", "without /"),
        ('name = ""\n[base]', "name", "of 1 to 200 bytes"),
        ('name = "a\\u0000"\n[base]', "name", "printable"),
        ('[base]\nscenario = "push_wal"', "base", "did you mean 'push_wall'?"),
        ('[base]\n[keep]\nlogs = {kind = "listed", indices = [0, 1]}', "keep.logs.indices[1]", "no run 1"),
        ('[base]\n[keep]\nlogs = {kind = "failed", k = 3}', "keep.logs.k", "no effect"),
        ('[base]\n[keep]\nmetrics = ["effort_N2s", "effort_N2s"]', "keep.metrics[1]", "given twice"),
        ('[base]\n[keep]\nmetrics = ["none.py:peak"]', "keep.metrics[0]", "none.py'"),
    ],
)
def test_an_error_names_its_place(text, key, words):
    found = faults(text)
    assert list(found) == [key]
    assert words in found[key]


def test_a_missing_table_is_named_without_the_rest_of_the_file():
    assert faults('laws = ["gsta"]')["base"] == "lacks this key"


@pytest.mark.parametrize(
    ("names", "wrong"),
    [
        (["a.py:status"], 0),  # a column of every row
        (["a.py:contact"], 0),  # {"peak_N": ...} would be the shipped contact.peak_N
        (["effort_N2s", "a.py:effort_N2s"], 1),
        (["a.py:wall"], 0),  # {"stiffness": ...} would be the key that varies
        (["a.py:peak", "b.py:peak"], 1),
    ],
)
def test_no_metric_of_a_user_takes_the_columns_of_others(tmp_path, monkeypatch, names, wrong):
    monkeypatch.chdir(tmp_path)
    words = {name.partition(":")[2] for name in names if ".py" in name}
    for file in ("a.py", "b.py"):
        (tmp_path / file).write_text("".join(f"def {word}(trace):\n    return 1.0\n" for word in words))
    found = faults(KEY + f'key = "wall.stiffness"\nvalues = [1e4]\n[keep]\nmetrics = {names}')
    assert list(found) == [f"keep.metrics[{wrong}]"]
    assert "rename the function" in found[f"keep.metrics[{wrong}]"]


def test_an_extreme_that_runs_as_it_is_drawn_is_no_error():
    moving = KEY + 'keys = ["wall.stiffness", "simulation.timestep"]\nvalues = [[1e11, 1e-6], [1e5, 1e-4]]'
    assert plan(moving).runs == 2
    coarse = KEY + 'key = "simulation.timestep"\nvalues = [1e-2]\n[[vary]]\nkey = "wall.stiffness"\nvalues = [{}]'
    assert plan(coarse.format("1e3")).runs == 1
    assert "no draw can run with gsta: wall.stiffness: 1e+08 N/m is too stiff" in faults(coarse.format("1e8"))["vary"]


def test_no_scenario_is_made_for_a_draw_before_it_is_asked_for(monkeypatch):
    made = []
    original = Scenario.from_dict.__func__
    monkeypatch.setattr(
        Scenario, "from_dict", classmethod(lambda cls, *a, **k: made.append(1) or original(cls, *a, **k))
    )
    few, many = (plan(LEAST, design__runs=runs) for runs in (10, 100_000))
    assert (few.runs, many.runs) == (10, 100_000)
    assert many.steps == 10_000 * few.steps
    assert many.points[:10] == few.points
    assert len(made) < 20


def test_overrides_set_the_study_or_its_base_scenario():
    changed = plan(LEAST, design__runs=5, keep__logs="failed", run__engine="mujoco", simulation__duration=2.0, name="x")
    assert (changed.runs, changed.logs.kind, changed.engine, changed.name) == (5, "failed", "mujoco", "x")
    assert changed.base.simulation.duration == 2.0
    found = faults(LEAST, design__run=5, wal__stiffness=1.0, wall__stiffness=1e4, vary="x", simulation__seed=3)
    assert set(found) == {"design.run", "wal.stiffness", "wall.stiffness", "vary", "simulation.seed"}
    assert "varies this key" in found["wall.stiffness"]


def test_files_are_found_beside_the_study_and_kept_with_absolute_paths(tmp_path, monkeypatch):
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / "mine.py").write_text(LAW)
    (folder / "base.toml").write_text("[wall]\nstiffness = 3e4\n")
    (folder / "peaks.py").write_text("def peak(trace):\n    return float(trace.push.max())\n")
    (folder / "s.toml").write_text(
        'laws = ["gsta", "mine.py:Mine"]\n[base]\nscenario = "base.toml"\n'
        '[[vary]]\nkey = "controller.gain_p"\nlaws = ["Mine"]\nvalues = [1.0, 2.0]\n'
        '[keep]\nmetrics = ["effort_N2s", "peaks.py:peak"]\n'
    )
    monkeypatch.chdir(tmp_path)
    loaded = Plan.load("study/s.toml")
    assert loaded.name == "s"
    assert loaded.base.wall.stiffness == 3e4
    assert loaded.laws[1].source == f"{folder}/mine.py:Mine"
    assert loaded.metrics == ("effort_N2s", f"{folder}/peaks.py:peak")
    assert [loaded.scenario(i).controller.label() for i in range(loaded.runs)] == ["gsta", "Mine"] * 2
    assert loaded.scenario(3).controller.gain_p == 2.0
    monkeypatch.chdir(folder)
    (folder / "base.toml").unlink()
    assert Plan.from_dict(loaded.tables).tables == loaded.tables


@pytest.mark.parametrize(
    ("text", "place", "missing"),
    [
        ('laws = ["mine.py:Mine"]\n[base]\n', "laws[0].name", "no file '{folder}/mine.py'"),
        ('[base]\ncontroller.name = "mine.py:Mine"\n', "base.controller.name", "no file '{folder}/mine.py'"),
        ('[base]\nscenario = "base.toml"\n', "", "scenario '{folder}/base.toml': no such file"),
        ('[base]\nvehicle.model = "mine.xml"\n', "", "no draw can run with gsta: vehicle.model '/"),
        ('[base]\n[keep]\nmetrics = ["peaks.py:peak"]\n', "keep.metrics[0]", "no file '{folder}/peaks.py'"),
    ],
)
def test_files_of_a_study_are_beside_it_and_not_in_the_current_folder(tmp_path, monkeypatch, text, place, missing):
    folder = tmp_path / "study"
    folder.mkdir()
    (tmp_path / "mine.py").write_text(LAW)
    (tmp_path / "base.toml").write_text("[wall]\nstiffness = 3e4\n")
    (tmp_path / "peaks.py").write_text("def peak(trace):\n    return float(trace.push.max())\n")
    (tmp_path / "mine.xml").write_text(shipped("models")["bluerov1"].read_text())
    (folder / "s.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        Plan.load("study/s.toml")
    assert any(missing.format(folder=folder) in fault.message for fault in caught.value.faults), caught.value
    assert place in str(caught.value)
    for path in tmp_path.glob("*.*"):
        path.rename(folder / path.name)
    assert Plan.load("study/s.toml").runs == 1


ODD = [
    None,
    True,
    -1,
    1e300,
    float("nan"),
    "x",
    "wall.stiffness",
    "a.b[0]",
    [],
    [[]],
    {},
    {"a": 1},
    10**30,
    b"x",
    [None],
]


def places(tables, way=()):
    """The way to every value of nested tables and lists."""
    items = tables.items() if isinstance(tables, dict) else enumerate(tables) if isinstance(tables, list) else ()
    for key, value in items:
        yield (*way, key)
        yield from places(value, (*way, key))


@pytest.mark.parametrize("seed", range(40))
def test_a_mutated_file_is_a_plan_or_an_input_error(seed):
    rng = Random(seed)
    tables = tomllib.loads(rng.choice([LEAST, SEVERAL]))
    *way, last = rng.choice(list(places(tables)))
    inner = tables
    for key in way:
        inner = inner[key]
    if rng.random() < 0.3:
        del inner[last]
    else:
        inner[last] = rng.choice(ODD)
    try:
        mutated = Plan.from_dict(tables)
    except InputError:
        return
    assert Plan.from_dict(mutated.tables).tables == mutated.tables
    assert [mutated.run(i).index for i in range(mutated.runs)] == list(range(mutated.runs))


def test_a_study_that_is_not_there_or_not_toml(tmp_path):
    with pytest.raises(InputError, match="study 'nowhere': neither a file nor built in"):
        Plan.load("nowhere")
    (tmp_path / "s.toml").write_text("a = [")
    with pytest.raises(InputError, match="not a study in TOML"):
        Plan.load(tmp_path / "s.toml")
    with pytest.raises(InputError, match="is not a mapping of tables"):
        Plan.from_dict([1, 2])


def test_a_study_without_keys_compares_laws_or_repeats():
    assert plan('laws = ["gsta", "fosm"]\n[base]').runs == 2
    repeated = plan('[base]\n[design]\nkind = "random"\nruns = 4\nrepeats = 3')
    assert (repeated.runs, repeated.points) == (12, ((),) * 4)
    assert len({repeated.run(i).seed for i in range(12)}) == 12
