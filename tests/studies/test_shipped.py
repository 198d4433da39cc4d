"""The studies that ship, and the metrics that they need."""

import pytest

from uvms_mj import files, simulate
from uvms_mj.analysis.metrics import chattering, final_force
from uvms_mj.control.design import demanded_force
from uvms_mj.control.theory.certificate import rate_bound
from uvms_mj.files import shipped, shipped_file
from uvms_mj.studies.plan import Plan
from uvms_mj.studies.rows import one_row

SHORT = {"simulation.duration": 0.3, "initial.position": [0.995, 0.0, 0.0], "reference.step_time": 0.0}


def test_the_studies_are_those_of_the_docs():
    assert sorted(shipped("studies")) == ["gain_map", "monte_carlo", "waves"]


def test_a_shipped_file_that_comes_or_goes_is_seen(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "_SHIPPED", {"notes": (".toml", tmp_path)})
    path = tmp_path / "mine.toml"
    for there in (False, True, False, True):
        path.write_text("") if there else path.unlink(missing_ok=True)
        assert shipped_file("notes", "mine") == shipped("notes").get("mine") == (path if there else None)
    assert shipped_file("notes", "../mine") is None


def test_monte_carlo_is_a_thousand_draws_of_the_papers_laws():
    plan = Plan.load("monte_carlo")
    assert (plan.draws, plan.runs, plan.steps) == (1000, 3000, 600_000_000)
    assert [law.label for law in plan.laws] == ["impedance", "fosm", "gsta"]
    assert all(law.scenario.controller == type(law.scenario.controller)() for law in plan.laws), "the paper's gains"
    assert all(plan.scenario(index).vehicle.mass == plan.scenario(index).vehicle.displaced_mass for index in (0, 2999))


@pytest.mark.parametrize("name", ["gain_map", "monte_carlo", "waves"])
def test_a_shipped_study_runs(name):
    plan = Plan.load(name, SHORT)
    for index in (0, plan.runs // 2, plan.runs - 1):
        row = one_row(plan, index, "free_body")
        assert row["status"] == "completed", row["message"]


@pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning")
def test_the_metrics_of_a_gain_map_are_those_of_the_run():
    """The certified rate by the bound of the gains; chattering and force error by the metrics of the whole trace."""
    metrics = ["certified_rate_m_per_s3", "chattering_N_per_s", "force_error_N"]
    tables = {**Plan.load("gain_map").tables, "keep": {"metrics": metrics}}
    plan = Plan.from_dict(tables, overrides={**SHORT, "simulation.duration": 1.5})
    row, trace = one_row(plan, 312, "free_body"), simulate(plan.scenario(312), engine="free_body")
    law = plan.scenario(312).controller
    assert row["certified_rate_m_per_s3"] == rate_bound(law.k_1, law.k_2)
    assert row["chattering_N_per_s"] == pytest.approx(chattering(trace, 0.5)[:3].sum(), rel=1e-12)
    assert row["chattering_N_per_s"] > 1.0
    assert row["force_error_N"] == final_force(trace)[0] - demanded_force(trace.scenario)
    assert Plan.load("gain_map").units["controller.k_2"] == "m/s^3"
