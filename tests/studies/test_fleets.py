"""Studies with the engine gpu. Here the fleets are those of this machine's processor, which compute the same bits."""

import functools

import numpy as np
import pandas as pd
import pytest

from short_study import HERE, study_text
from uvms_mj import InputError, Study
from uvms_mj.cli.chosen import row_of
from uvms_mj.engine.native.devices import Gpu
from uvms_mj.studies.fleets import CpuWarning, Fleets, instants
from uvms_mj.studies.pool import execution


@pytest.fixture
def on_processor(monkeypatch):
    monkeypatch.setattr(execution, "Fleets", functools.partial(Fleets, device="cpu"))


def has_gpu():
    try:
        Gpu()
    except InputError:
        return False
    return True


def of_observers(metric, observers='"none"'):
    """The text of a study of one law. Its first run is the same for all observers and metrics, so that its fleet is
    compiled once."""
    return f"""
[base]
scenario = "push_wall"
simulation.timestep = 1e-3
controller.name = "impedance"
[[vary]]
key = "observer.name"
values = [{observers}]
[keep]
metrics = ["{metric}"]
[run]
engine = "gpu"
"""


def ran(tmp_path, name, text, duration=0.06):
    folder = tmp_path / name
    folder.mkdir()
    (folder / "s.toml").write_text(text)
    return Study.load(folder / "s.toml", {"simulation.duration": duration}).run(folder / "results", executor=HERE)


@pytest.mark.slow
def test_rows_are_those_of_free_body(tmp_path, on_processor):
    """The same touches and statuses; the numbers of a law without chatter to rounding; and the sample is compared."""
    text = study_text(runs=3, engine="gpu", metrics=', "contact.final_N", "effort_N2s", "chattering_N_per_s"')
    fleet = ran(tmp_path, "fleet", text, 0.6)
    usual = ran(tmp_path, "usual", text.replace('"gpu"', '"free_body"'), 0.6)
    assert set(fleet.frame["engine"]) == {"gpu"}
    ours, theirs = (study.frame.drop(columns="engine") for study in (fleet, usual))
    for column in ("index", "status", "steps", "warnings", "success", "contact.touches"):
        assert (ours[column] == theirs[column]).all(), column
    calm = ours["law"] == "impedance"
    pd.testing.assert_frame_equal(ours[calm], theirs[calm], rtol=1e-9, atol=1e-12)
    assert fleet.check["within"].all()
    assert {"status", "final.position_m.x", "contact.peak_N"} <= set(fleet.check["number"])
    assert list(fleet.check.columns[3:5]) == ["gpu", "free_body"]


def test_metrics_that_need_every_row_send_the_runs_to_the_processor(tmp_path, on_processor):
    text = study_text(runs=1, engine="gpu", metrics=', "hold.error_N"')
    with pytest.warns(CpuWarning, match=r"runs are not run on the GPU: keep\.metrics: hold\.error_N needs rows"):
        study = ran(tmp_path, "s", text)
    assert set(study.frame["engine"]) == {"free_body"}
    assert set(study.frame["status"]) == {"completed"}


def test_a_run_that_is_shorter_than_a_metric_needs_goes_to_the_processor(tmp_path, on_processor):
    with pytest.warns(CpuWarning, match="1 of 1 runs are not run on the GPU: a metric needs other rows"):
        study = ran(tmp_path, "s", of_observers("contact.settled"), 0.3)
    assert set(study.frame["engine"]) == {"free_body"}


def test_a_run_with_other_stages_is_not_computed_as_the_first_one(tmp_path, on_processor):
    """Its record has the same shape. It goes to the processor, and its log says free_body."""
    with pytest.warns(CpuWarning) as warned:
        study = ran(tmp_path, "s", of_observers("effort_N2s", '"none", "momentum_observer"'), 0.3)
    first, second = (str(each.message) for each in warned)
    assert first.startswith("1 of 2 runs are not run on the GPU: observer.name: is another one")
    assert second.startswith("1 of 1 runs of the sample are not compared with free_body: a metric needs other rows")
    assert study.check is None  # a run of 0.3 s has no such rows, and nothing differs
    assert study.frame["engine"].tolist() == ["gpu", "free_body"]
    for row in range(2):
        scenario, engine = row_of(str(study.folder), row, {}, None)
        assert (engine, scenario.observer.name) == ("free_body", study.frame["observer.name"][row])


@pytest.mark.skipif(has_gpu(), reason="this machine has a GPU")
def test_without_a_gpu_one_sentence_says_so(tmp_path):
    with pytest.raises(InputError, match=r"^no (GPU|module)") as error:
        ran(tmp_path, "s", study_text(runs=1, engine="gpu"))
    assert "\n" not in str(error.value)


def test_instants_of_rows():
    """The last row, and those of each length of the end, on the time steps."""
    assert instants(10, 0.1, [(0.0, 1.0)]) == [10]
    assert instants(20, 0.1, [(1.0, 0.5), (0.2, 0.1)]) == [10, 15, 18, 19, 20]
    assert instants(3, 0.1, [(1.0, 0.1)]) == [0, 1, 2, 3]  # a run that is shorter
    assert np.all(np.diff(instants(200_000, 1e-4, [(8.5, 0.5), (1.0, 0.01)])) > 0)
