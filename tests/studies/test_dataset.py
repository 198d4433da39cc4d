"""The rows of a study as an xarray Dataset: the same numbers as the frame, over the design."""

import numpy as np
import pytest

from synthetic_study import VARY, frame_of, plan_of, pushes

GRID = [
    {"key": "wall.stiffness", "low": 2e4, "high": 2e5, "number": 4, "spacing": "log"},
    {"keys": ["current.speed", "estimates.inertia"], "values": [[0.1, 0.9], [0.3, 1.1], [0.2, 1.0]]},
]
METRICS = ("contact.peak_N", "contact.final_N", "contact.settled", "contact.touches")


def made(**design):
    from uvms_mj.studies.results import dataset

    plan = plan_of(repeats=2, **design)
    frame = frame_of(plan, pushes())
    frame.loc[frame["index"] % 11 == 3, "status"] = "unstable"
    frame = frame[frame["index"] % 7 != 5]  # not done
    return plan, frame, dataset(plan, frame)


@pytest.mark.parametrize(
    "design", [{"vary": GRID}, {"vary": VARY, "kind": "random", "runs": 9}], ids=["grid", "random"]
)
def test_a_dataset_is_its_frame(design):
    plan, frame, found = made(**design)
    rows = found.to_dataframe().reset_index()
    rows = rows[rows["status"] != "not done"]
    assert len(rows) == len(frame)
    assert (found["status"] == "not done").sum() == plan.runs - len(frame)
    by = [*plan.varied, "law", "repeat"]
    both = frame.merge(rows, on=by, suffixes=("", "_of_dataset"))
    assert len(both) == len(frame)
    done = both["status"] == "completed"
    assert 0 < done.sum() < len(both)
    for name in METRICS:
        theirs = both[f"{name}_of_dataset"].astype(float)
        assert np.array_equal(theirs[done], both[name][done].astype(float), equal_nan=True), name
        assert theirs[~done].isna().all()
    for name in ("status", "message", "engine"):
        assert both[f"{name}_of_dataset"].equals(both[name]), name


def test_a_grid_has_its_keys_as_dimensions():
    _, frame, found = made(vary=GRID)
    assert dict(found.sizes) == {"wall.stiffness": 4, "current.speed": 3, "law": 3, "repeat": 2}
    assert np.allclose(found["wall.stiffness"], np.geomspace(2e4, 2e5, 4))
    assert found["estimates.inertia"].dims == ("current.speed",)
    assert found["estimates.inertia"].to_numpy().tolist() == [0.9, 1.1, 1.0]
    row = frame[frame["status"] == "completed"].iloc[8]
    place = {key: row[key] for key in ("wall.stiffness", "current.speed", "law", "repeat")}
    assert found["contact.peak_N"].sel(place).item() == row["contact.peak_N"]


def test_draws_have_their_values_as_coordinates():
    plan, _, found = made(vary=VARY, kind="latin_hypercube", runs=9)
    assert dict(found.sizes) == {"draw": 9, "law": 3, "repeat": 2}
    for i, key in enumerate(plan.varied):
        assert found[key].dims == ("draw",)
        assert found[key].to_numpy().tolist() == [point[i] for point in plan.points]


def test_quantities_have_their_units():
    plan, _, found = made(vary=GRID)
    units = {"wall.stiffness": "N/m", "current.speed": "m/s", "contact.peak_N": "N", "effort_N2s": "N² s"}
    assert {name: found[name].attrs["units"] for name in units} == units
    assert found["final.position_m.x"].attrs["units"] == "m"
    assert found.attrs["name"] == plan.name


def test_a_key_of_one_law_names_it():
    vary = [{"key": "controller.k_1", "values": [1.0, 2.0, 3.0], "laws": ["gsta"]}]
    from uvms_mj.studies.results import dataset

    plan = plan_of(vary)
    found = dataset(plan, frame_of(plan, lambda given: {"contact.peak_N": given["index"]}))
    assert found["controller.k_1"].attrs["laws"] == ["gsta"]
    assert found["contact.peak_N"].sel({"controller.k_1": 2.0, "law": "fosm"}).item() == 4.0
