"""Input at the borders of what is read: each gives an answer or one clear error, and never a traceback."""

from pathlib import Path

import numpy as np
import pytest

from uvms_mj import InputError, McapLog, Scenario, Study, Trace, simulate
from uvms_mj.plant.geometry import Geometry
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.studies.plan import Plan
from uvms_mj.studies.results import STUDY, VERSION, check_same, units_of
from uvms_mj.studies.tune import Tuning
from uvms_mj.studies.tune.search import JOURNAL, Journal, checksum, optuna

MODELS = Path(__file__).parents[1] / "models"
LONG = "x" * 256
BASE = {"base": {"scenario": "push_wall"}}


@pytest.mark.parametrize(
    "load",
    [
        lambda: Scenario.load(LONG),
        lambda: Scenario.load("push_wall", controller=f"{LONG}.py:Law"),
        lambda: simulate(Scenario.load("push_wall", {"vehicle.model": LONG})),
        lambda: Plan.load(LONG),
        lambda: Plan.from_dict({"base": {"scenario": LONG}}),
        lambda: Plan.from_dict(BASE | {"keep": {"metrics": [f"{LONG}.py:metric"]}}),
        lambda: Study.load(LONG),
        lambda: Tuning.load(LONG),
        lambda: Trace.load(LONG),
        lambda: Mjcf.find(LONG),
    ],
)
def test_a_name_that_the_system_does_not_take_is_no_file(load):
    with pytest.raises(InputError, match=LONG[:100]):
        load()


@pytest.mark.parametrize(
    "wall",
    [
        {"wall.position": 1e6},
        {"walls": [{"shape": "plane", "stiffness": 1e4, "position": [1e6, 0.0, 0.0]}]},
        {"walls": [{"shape": "sphere", "radius": 1.0, "stiffness": 1e4, "position": [1e6, 1e6, 1e6]}]},
        {"wall.position": 1e6, "bumper.stiffness": 1e3},
    ],
)
def test_a_wall_at_the_greatest_coordinate_is_far_away(tmp_path, wall):
    """Its face and its picture are beyond the greatest coordinate of an input."""
    trace = simulate(
        Scenario.load("push_wall", {"simulation.duration": 0.002, **wall}), sinks=[McapLog(tmp_path / "run.mcap")]
    )
    read = Trace.load(tmp_path / "run.mcap")
    np.testing.assert_array_equal(read.p_WB, trace.p_WB)
    assert trace.touches[-1] == 0.0


def test_a_vehicle_that_reaches_far_is_refused_by_name(tmp_path):
    text = (MODELS / "bluerov1.xml").read_text()
    changed = text.replace('size=".110 .003 .016"', 'size="1e9 1 1"')
    assert changed != text
    (tmp_path / "big.xml").write_text(changed)
    with pytest.raises(InputError, match=r"reach 1e\+09 m to the front of bluerov1; at most 10000 m"):
        simulate(Scenario.load("push_wall", {"vehicle.model": str(tmp_path / "big.xml")}))


@pytest.mark.parametrize("forged", ["5", "[1, 2]", "{}", "null", '"AA"', '"?"'])
def test_a_mesh_that_is_not_base64_is_refused(forged):
    data = f'{{"shapes": [], "meshes": {{"m": {{"vertices": {forged}, "triangles": ""}}}}, "links": []}}'
    with pytest.raises(InputError, match=r"meshes\.m\.vertices"):
        Geometry.from_json(data.encode())


@pytest.fixture
def journal(tmp_path):
    """A function that opens a journal of three trials."""
    module = optuna()
    own = Journal(tmp_path, "search", "minimize")
    for number in range(3):
        trial = module.trial.create_trial(
            value=0.5 * number,
            params={"controller.k_1": 1.25 + number},
            distributions={"controller.k_1": module.distributions.FloatDistribution(1.0, 20.0)},
            user_attrs={"outcome": {"state": "feasible", "objective": 0.5 * number}},
        )
        trial.number = number
        trial.set_user_attr("checksum", checksum(trial))
        own.add(trial)
    return lambda: Journal(tmp_path, "search", "minimize").trials


def test_a_flipped_bit_of_a_journal_is_refused_or_changes_no_trial(journal, tmp_path, rng):
    """In every line; a bit of a date or of the name of a worker is of no trial."""
    path, sound = tmp_path / JOURNAL, [(t.number, t.params, t.value, t.user_attrs) for t in journal()]
    data, messages = path.read_bytes(), []
    for at in rng.choice(8 * len(data), 150, replace=False):
        changed = bytearray(data)
        changed[at // 8] ^= 1 << (at % 8)
        path.write_bytes(changed)
        try:
            found = [(t.number, t.params, t.value, t.user_attrs) for t in journal()]
        except InputError as error:
            found, messages = [], [*messages, str(error)]
        assert found == sound[: len(found)]  # without its last newline the last line counts as unfinished
    assert len(messages) > 75
    assert all("trials.journal: damaged" in each for each in messages)


@pytest.mark.parametrize(
    "text", ["[]", "5", "{}", "{", '{"code": []}', '{"code": {}, "files": 1, "units": {}, "study": ""}']
)
def test_a_damaged_version_of_a_study_is_said(text, tmp_path):
    (tmp_path / VERSION).write_text(text)
    (tmp_path / STUDY).write_text('name = "mine"\n')
    with pytest.raises(InputError, match=r"is of no study|can't be read"):
        check_same(tmp_path / STUDY, {"name": "mine"}, {"study": "", "code": {}, "files": {}})
    assert units_of(tmp_path, ["wall.stiffness"]) == {}
