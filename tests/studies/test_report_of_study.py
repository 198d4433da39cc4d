"""The page of a study: its statistics against known answers, and its contents."""

import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from pages import HOSTILE, complete_by_itself
from synthetic_study import VARY, frame_of, plan_of, pushes
from uvms_mj import InputError
from uvms_mj.analysis.summary import NUMBERS
from uvms_mj.studies.report import page
from uvms_mj.studies.report.data import StudyRows, spans_decades
from uvms_mj.studies.report.figures import _edges, cumulative, maps, pairs, scale, shown, success_rates
from uvms_mj.studies.report.statistics import (
    SUCCESS,
    difference_of_rates,
    median,
    of_many,
    paired,
    rank_correlation,
    rate,
    sensitivities,
    sobol_indices,
)

MODEL = Path(__file__).parents[2] / "models" / "bluerov1.xml"
LAW = """
from dataclasses import dataclass

from uvms_mj import Fosm


@dataclass(frozen=True)
class Mine(Fosm):
    pass
"""
KEYS = ("wall.stiffness", "current.speed", "estimates.inertia")
UNIFORM = [{"key": key, "distribution": "uniform", "low": 0.1, "high": 1.0} for key in KEYS]


SPEEDS = {"key": "current.speed", "low": 0.0, "high": 0.5, "number": 5}
STIFFNESSES = {"key": "wall.stiffness", "low": 2e4, "high": 2e5, "number": 4, "spacing": "log"}
TARGETS = {"keys": ["reference.target[0]", "wall.position"], "values": [[1.0, 1.1], [2.0, 2.1], [3.0, 3.3]]}
INTEGRATORS = {"key": "simulation.integrator", "values": ["euler", "implicitfast"]}
GAINS = {"key": "controller.k_1", "low": 1.0, "high": 9.0, "number": 3, "laws": ["gsta"]}
DESIGNS = {
    "nothing": [],
    "one key": [VARY[0]],
    "a grid with two values": [STIFFNESSES, {"key": "current.speed", "values": [0.1, 0.3]}],
    "a grid": [STIFFNESSES, SPEEDS],
    "texts": [INTEGRATORS, STIFFNESSES],
    "keys together": [TARGETS],
    "one law only": [GAINS, SPEEDS],
}


def words(text):
    return " ".join(" ".join(complete_by_itself(text).text).split())


@pytest.fixture(scope="module")
def plan():
    return plan_of(kind="latin_hypercube", runs=150, keep={"logs": {"kind": "worst", "metric": "contact.peak_N"}})


@pytest.fixture(scope="module")
def frame(plan):
    return frame_of(plan, pushes())


@pytest.fixture(scope="module")
def few():
    """A plan of one key and a frame of one metric, whose page takes little time."""
    plan = plan_of([VARY[0]], laws=("gsta", "fosm"), runs=20, keep={"metrics": ["contact.peak_N"]})

    def row(given):
        status = np.where(given["draw"] == 3, "unstable", "completed")
        return {"contact.peak_N": np.sqrt(given["wall.stiffness"]) + given["draw"], "status": status}

    return plan, frame_of(plan, row)


# Statistics


@pytest.mark.parametrize("p", [0.02, 0.3, 0.9, 0.995])
def test_the_interval_of_a_rate_covers_the_true_rate(rng, p):
    runs = 200
    found = [rate(int(k), runs, runs) for k in rng.binomial(runs, p, 2000)]
    assert 0.93 <= np.mean([each.low <= p <= each.high for each in found]) <= 0.99


def test_repeats_of_a_draw_do_not_narrow_the_interval(rng):
    """All repeats of a draw end alike: four of them tell no more than one."""
    p, draws, repeats = 0.7, 60, 4
    found = [rate(int(k) * repeats, draws * repeats, draws) for k in rng.binomial(draws, p, 1500)]
    assert np.mean([each.low <= p <= each.high for each in found]) >= 0.93


def test_the_interval_of_a_rate_of_one_law_that_never_fails_is_not_empty():
    found = rate(60, 60, 60)
    assert found.value == found.high == 1.0
    assert found.low == pytest.approx(60.0 / (60.0 + 1.959964**2), abs=1e-6)  # Wilson's, in closed form


def test_the_interval_of_a_difference_of_rates_covers_the_true_one(rng):
    """Cells of the 2 x 2 table: both, only the first, only the second, neither."""
    cells = np.array([0.6, 0.25, 0.05, 0.1])
    hits = []
    for counts in rng.multinomial(150, cells, 1500):
        differences = np.repeat([0.0, -1.0, 1.0, 0.0], counts)
        found = difference_of_rates(differences)
        hits.append(found.low <= cells[2] - cells[1] <= found.high)
    assert 0.93 <= np.mean(hits) <= 0.98


def test_the_interval_of_a_median_covers_it_for_any_distribution(rng):
    for draw, true in ((rng.standard_cauchy, 0.0), (rng.standard_exponential, math.log(2.0))):
        found = [median(draw(41)) for _ in range(700)]
        assert 0.94 <= np.mean([each.low <= true <= each.high for each in found]) <= 0.99


@pytest.mark.parametrize(("n", "most"), [(8, 0.98), (120, 0.97)])
def test_the_interval_of_a_rank_correlation_covers_it(rng, n, most):
    """Of a normal pair, Spearman's correlation is 6/pi asin(rho/2). With eight pairs, an interval that forgets the 3 of
    Fisher's z covers it in 0.90 of the draws, the right one in 0.965."""
    rho = 0.6
    true = 6.0 / math.pi * math.asin(rho / 2.0)
    hits = []
    for _ in range(500):
        x, y = rng.multivariate_normal([0.0, 0.0], [[1.0, rho], [rho, 1.0]], n).T
        found = rank_correlation(x, np.exp(y))  # ranks do not see a monotonic function
        hits.append(found.low <= true <= found.high)
    assert 0.93 <= np.mean(hits) <= most


@pytest.mark.usefixtures("undrawn")
def test_the_indices_of_ishigamis_function_are_its_closed_form():
    """Through plan, rows, page: x_i uniform over -pi to pi, a = 7, b = 0.1."""
    a, b = 7.0, 0.1
    plan = plan_of(UNIFORM, laws=("gsta",), kind="sobol_indices", runs=5 * 4096, keep={"metrics": ["contact.peak_N"]})

    def row(given):
        x1, x2, x3 = (math.pi * (2.0 * (given[key] - 0.1) / 0.9 - 1.0) for key in KEYS)
        return {"contact.peak_N": np.sin(x1) + a * np.sin(x2) ** 2 + b * x3**4 * np.sin(x1)}

    data = StudyRows(plan, frame_of(plan, row))
    found = sensitivities(data)
    assert found.sobol
    ((metric, laws),) = found.of.items()
    first = b * math.pi**4 / 5.0 + b**2 * math.pi**8 / 50.0 + 0.5, a**2 / 8.0, 0.0
    both = 8.0 * b**2 * math.pi**8 / 225.0
    variance = sum(first) + both
    total = first[0] + both, first[1], both
    for exact, estimates in ((first, laws["gsta"].first), (total, laws["gsta"].main)):
        for value, estimate in zip(exact, estimates, strict=True):
            assert estimate.value == pytest.approx(value / variance, abs=0.02)
            assert estimate.low - 0.005 <= value / variance <= estimate.high + 0.005
            assert estimate.high - estimate.low < 0.15
    assert found.strongest(metric)[2].key == KEYS[1]
    text = words(page(plan, data.frame))
    assert "Sobol indices, by SALib" in text
    assert "Rank correlations" not in text


@pytest.mark.parametrize("n", [1, 3, 60])
def test_the_interval_of_a_share_is_within_shares_and_has_it(n):
    for passed in range(n + 1):
        found = rate(passed, n, n)
        assert 0.0 <= found.low <= passed / n <= found.high <= 1.0
        z, p = 1.959963984540054, passed / n  # Wilson's: both roots of (p - x)^2 = z^2 x (1 - x) / n
        for x in (found.low, found.high):
            assert (p - x) ** 2 == pytest.approx(z**2 * x * (1.0 - x) / n, abs=1e-12)


def test_an_index_of_few_blocks_and_its_interval_are_shares_of_the_variance():
    rng = np.random.default_rng(1)
    beyond = 0
    for _ in range(20):
        total, first, _ = sobol_indices(rng.normal(size=3 * 8), 1, 0)
        for each in (*total, *first):
            assert 0.0 <= each.low <= each.value <= each.high <= 1.0
            beyond += each.low == 0.0 or each.high == 1.0
    assert beyond > 10  # else the bounds are not tried


def test_a_block_of_sobol_samples_with_a_failed_run_is_left_out_and_said():
    plan = plan_of(UNIFORM, laws=("gsta",), kind="sobol_indices", runs=5 * 64, keep={"metrics": ["contact.peak_N"]})

    def row(given):
        status = np.where(given["index"] == 7, "unstable", "completed")
        return {"contact.peak_N": given["current.speed"], "status": status}

    data = StudyRows(plan, frame_of(plan, row))
    found = sensitivities(data)
    assert found.notes == [
        "gsta: 1 of 64 blocks of samples have a run without a value; the indices are of the others (contact.peak)"
    ]
    (indices,) = (laws["gsta"] for metric, laws in found.of.items() if metric is not SUCCESS)
    assert [each.value for each in indices.main] == pytest.approx([0.0, 1.0, 0.0], abs=0.05)


@pytest.mark.parametrize("n", [1, 10, 500, 20_001])
def test_a_thinned_distribution_is_the_distribution(rng, n):
    values = np.sort(rng.lognormal(size=n))
    x, share = cumulative(values)
    assert len(x) <= 502
    assert (x[0], share[0], x[-1], share[-1]) == (values[0], 0.0, values[-1], 1.0)
    drawn = share[np.searchsorted(x, values, side="right") - 1]
    assert np.abs(drawn - np.arange(1, n + 1) / n).max() <= 1.0 / 499.0 + 1.0 / n
    assert np.abs(share - stats.lognorm.cdf(x, 1.0)).max() < 1.63 / math.sqrt(n) + 0.002 or n == 1  # Kolmogorov, 1 %


def test_runs_without_a_value_lower_the_distribution_instead_of_leaving_it():
    plan = plan_of([VARY[0]], laws=("gsta", "fosm"), runs=40, keep={"metrics": ["contact.peak_N"]})

    def row(given):
        lost = (given["law"] == "fosm") & (given["draw"] % 4 == 0)
        return {"contact.peak_N": given["draw"] + 0.5, "status": np.where(lost, "unstable", "completed")}

    data = StudyRows(plan, frame_of(plan, row))
    from matplotlib.figure import Figure

    from uvms_mj.studies.report.figures import distribution

    ax = Figure().subplots()
    distribution(ax, data, data.metrics[0], first=True)
    tops = {line.get_color(): line.get_ydata()[-1] for line in ax.lines if len(line.get_ydata()) > 1}
    assert tops == {data.colours["gsta"]: 1.0, data.colours["fosm"]: 0.75}
    ends = {line.get_color(): line for line in ax.lines if line.get_marker() == "o"}
    for law, face in (("gsta", data.colours["gsta"]), ("fosm", "white")):
        line = ends[data.colours[law]]
        assert line.get_markerfacecolor() == face
        assert (*line.get_xdata(), *line.get_ydata()) == (39.5, tops[data.colours[law]]), "a gap may hide the end"
    low, high = ax.get_xlim()
    assert low < 0.5 < 39.5 < high, "the dots have room"


def test_a_run_far_away_is_counted_and_does_not_flatten_the_others(rng):
    from matplotlib.figure import Figure

    ax = Figure().subplots()
    scale(ax, np.r_[rng.uniform(-1.0, 1.0, 100), 500.0, np.nan])
    low, high = ax.get_xlim()
    assert -2.0 < low < -0.9
    assert 0.9 < high < 2.0
    assert ax.get_title(loc="right") == "1 run beyond"


# Laws in the same draws


def test_differences_are_of_the_same_draws(plan, frame):
    """A difference that is far smaller than the spread over the draws is resolved, since it is paired."""
    twin = frame.copy()
    of_gsta = twin[twin["law"] == "gsta"].set_index("draw")
    for law, more in (("fosm", 0.1), ("impedance", -0.2)):
        at = twin["law"] == law
        twin.loc[at, "contact.peak_N"] = of_gsta["contact.peak_N"].to_numpy() + more
        twin.loc[at, ["status", "contact.settled"]] = of_gsta[["status", "contact.settled"]].to_numpy()
    assert twin["contact.peak_N"].std() > 5.0
    found = {(pair.first, pair.second): pair for pair in paired(StudyRows(plan, twin))}
    assert list(found) == [("gsta", "fosm"), ("gsta", "impedance"), ("fosm", "impedance")]
    for (first, second), more in zip(found, (0.1, -0.2, -0.3), strict=True):
        peak, *_ = found[first, second].metrics
        assert peak.metric.name == "contact.peak_N"
        assert peak.median.value == pytest.approx(more)
        assert peak.median.low <= more + 1e-12
        assert peak.median.high >= more - 1e-12
        assert peak.smaller == (more < 0.0)
        assert peak.draws == len(plan.points)
        assert peak.matters == (abs(more) > 0.01 * peak.size)
        assert found[first, second].success.value == 0.0


@pytest.mark.usefixtures("undrawn")
def test_all_pairs_of_many_laws_are_in_the_report_with_what_holds_for_all_at_once(rng):
    """Five laws alike but for one: ten pairs, and the intervals that hold all at once are the wider ones."""
    laws = ("gsta", "fosm", "sta", "impedance", "pid")
    plan = plan_of([VARY[0]], laws=laws, runs=60, keep={"metrics": ["contact.peak_N"]})

    def row(given):
        values = rng.normal(10.0, 1.0, len(given["law"])) + 5.0 * (given["law"] == "pid")
        return {"contact.peak_N": values, "status": "completed"}

    frame = frame_of(plan, row)
    found = paired(StudyRows(plan, frame))
    assert {(each.first, each.second) for each in found} == {*itertools.combinations(laws, 2)}
    for each in found:
        for estimate, together in ((each.success, each.among_all), *((m.median, m.among_all) for m in each.metrics)):
            assert together.value == estimate.value
            assert together.low <= estimate.low
            assert together.high >= estimate.high
        assert each.metrics[0].among_all.apart == ("pid" in (each.first, each.second))
    text = words(page(plan, frame))
    assert "sta minus fosm" in text
    assert "pid minus impedance" in text
    assert "some of the 20 may miss by chance" in text
    assert of_many(1) == ""
    assert "all 10 at once with at least 50 %" in of_many(10)


def test_intervals_for_all_at_once_miss_in_one_study_of_twenty_at_most(rng):
    """Of six metrics without a difference: Bonferroni's intervals are all right in 95 % of the studies."""
    level, wrong = 1.0 - 0.05 / 6, 0
    for _ in range(400):
        wrong += any(median(rng.normal(size=40), level).apart for _ in range(6))
    assert wrong / 400 < 0.05 + 3.0 * math.sqrt(0.05 * 0.95 / 400)
    assert median(rng.normal(size=8), 1.0 - 1e-9).low == -math.inf


@pytest.mark.usefixtures("undrawn")
def test_the_report_says_over_which_time_its_metrics_are_taken():
    plan = plan_of([VARY[0]], laws=("gsta",), runs=20, keep={"metrics": ["hold.error_N", "contact.final_N"]})
    frame = frame_of(plan, lambda given: {"hold.error_N": given["draw"] + 0.5, "contact.final_N": given["draw"] + 1.0})
    text = words(page(plan, frame))
    assert text.count(NUMBERS["hold.error_N"].meaning) == 2  # below the table of laws, and above the quantiles
    assert "contact.final: mean push over the last 0.5 s." in text


def test_a_sign_of_success_counts_draws(plan, frame):
    data = StudyRows(plan, frame)
    success = frame.assign(success=data.success).pivot(index="draw", columns="law", values="success")
    for pair in paired(data):
        first, second = success[pair.first], success[pair.second]
        assert pair.only_first == (first & ~second).sum()
        assert pair.only_second == (second & ~first).sum()
        assert pair.success.value == pytest.approx(second.mean() - first.mean())
        assert pair.success.low <= pair.success.value <= pair.success.high


def test_the_rates_are_those_of_the_frame(plan, frame):
    met = (frame["status"] == "completed") & frame["contact.settled"]
    for law, found in success_rates(StudyRows(plan, frame)).items():
        assert found.value == pytest.approx(met[frame["law"] == law].mean())


def test_a_study_states_its_own_success(frame):
    limits = {"contact.final_N": [1.45, 1.55], "contact.settled": True}
    plan = plan_of(kind="latin_hypercube", runs=150, success=limits)
    assert plan_of(kind="latin_hypercube", runs=150, success={"contact": {"final_N": [1.45, 1.55]}}).success == {
        "contact.final_N": (1.45, 1.55)
    }
    expected = (
        (frame["status"] == "completed") & frame["contact.final_N"].between(1.45, 1.55) & frame["contact.settled"]
    )
    assert np.array_equal(StudyRows(plan, frame).success, expected)
    assert "contact.final_N is from 1.45 to 1.55, and contact.settled is true" in StudyRows(plan, frame).success_text


def test_faults_of_success_are_all_named():
    wrong = {"contact.peak": [0, 1], "contact.peak_N": [2.0, 1.0], "contact.settled": "yes", "contact.final_N": [1.0]}
    with pytest.raises(InputError) as raised:
        plan_of(runs=4, success=wrong)
    assert [fault.key for fault in raised.value.faults] == [f"success.{name}" for name in wrong]


# Maps


def test_maps_are_over_the_keys_that_matter(plan, frame):
    (first, *_) = pairs(sensitivities(StudyRows(plan, frame)))
    assert {factor.key for factor in first} == {"wall.stiffness", "current.speed"}
    assert [factor.logarithmic for factor in first] == [factor.key == "wall.stiffness" for factor in first]


@pytest.mark.parametrize(
    ("levels", "logarithmic"),
    [([1.0, 2.0, 3.0], False), ([1.0, 10.0, 100.0], True), ([0.0, 1.0, 10.0], False), ([1.0, 2.0], False)],
)
def test_an_axis_of_values_is_logarithmic_if_their_ratios_are_even(levels, logarithmic):
    plan = plan_of([{"key": "wall.stiffness", "values": [1e3 * x for x in levels] if levels[0] else [1e3, 2e3, 3e3]}])
    data = StudyRows(plan, frame_of(plan, lambda given: {"contact.peak_N": given["draw"]}))
    assert data.factors[0].logarithmic == logarithmic


def test_axes_of_results_are_logarithmic_where_they_span_decades():
    assert spans_decades(np.geomspace(1.0, 1000.0, 50))
    assert not spans_decades(np.linspace(1.0, 10.0, 50))
    assert not spans_decades(np.array([-1.0, 100.0, 1000.0]))
    assert not spans_decades(np.array([np.nan]))


def hatched(figure):
    """Whether each map of a figure has a hatched region, row by row."""
    return [
        any(each.get_hatch() or getattr(each, "hatches", [None])[0] for each in ax.collections) for ax in figure.axes
    ]


@pytest.mark.parametrize("kind", ["grid", "latin_hypercube"])
def test_the_region_of_failures_is_hatched(kind):
    if kind == "grid":
        plan = plan_of([STIFFNESSES, SPEEDS], laws=("gsta", "fosm"))
    else:
        plan = plan_of(laws=("gsta", "fosm"), kind=kind, runs=400)

    def row(given):
        lost = (given["law"] == "fosm") & (given["current.speed"] > 0.3)
        peak = given["wall.stiffness"] * (1.0 + given["current.speed"])
        status = np.where(lost, "unstable", "completed")
        return {"contact.peak_N": np.where(lost, np.nan, peak), "contact.settled": ~lost, "status": status}

    data = StudyRows(plan, frame_of(plan, row))
    found = sensitivities(data)
    (pair, *_) = pairs(found)
    metrics = shown(found, pair, first=True)
    assert [metric.name for metric in metrics] == ["success", "contact.peak_N"]
    figure = maps(data, pair, metrics)
    assert hatched(figure)[:4] == [False, True, False, True]  # gsta, fosm; below success, the peak
    assert {ax.get_xscale() for ax in figure.axes[:4]} == {"log"}
    assert {ax.get_yscale() for ax in figure.axes[:4]} == {"linear"}


@pytest.mark.parametrize("most", [3, 10])
def test_cells_have_about_the_same_number_of_runs(rng, most):
    plan = plan_of([VARY[0]], laws=("gsta",), runs=500)
    data = StudyRows(plan, frame_of(plan, lambda given: {"contact.peak_N": given["draw"]}))
    (factor,) = data.factors
    values = data.of(factor)
    edges, codes = _edges(values, most, factor)
    assert (edges[0], edges[-1]) == factor.limits == (2e4, 2e5)
    assert np.all((edges[codes] <= values) & (values <= edges[codes + 1]))
    counts = np.bincount(codes)
    assert len(counts) == most
    assert np.ptp(counts) <= 2


# The page

SECTIONS = ("laws", "distributions", "maps", "sensitivity", "differences", "failures", "runs", "quantiles", "study")


@pytest.fixture(scope="module")
def text(plan, frame):
    return page(plan, frame, "my results", {"uvms-mj": "1.2.3"})


def test_the_page_has_every_section_and_stands_alone(text):
    found = complete_by_itself(text)
    ids = [attributes["id"] for _, attributes in found.tags if "id" in attributes]
    assert [each for each in SECTIONS if each not in ids] == []
    assert len(found.of("img")) >= 4
    flat = " ".join(" ".join(found.text).split())
    for part in (
        "a study",
        "450 runs: 3 laws × 150 draws",
        "loguniform",
        "version of uvms-mj 1.2.3",
        "N/m",
        "not settled",
    ):
        assert part in flat
    for law in ("gsta", "fosm", "impedance"):
        assert law in flat


def test_failures_are_counted_by_message_without_its_numbers(frame, text):
    flat = words(text)
    unstable = int((frame["status"] == "unstable").sum())
    assert unstable > 3
    assert f"fosm unstable diverged at t = … s: |nu| = … m/s {unstable}" in flat


def test_the_worst_runs_have_their_command(frame, text):
    flat = words(text)
    done = frame[frame["status"] == "completed"]
    for law in ("gsta", "fosm", "impedance"):
        worst = done.loc[done[done["law"] == law]["contact.peak_N"].idxmax(), "index"]
        assert f"uvms-mj run --from 'my results' --row {worst} --viewer" in flat
    first = frame[frame["status"] == "unstable"]["index"].iloc[0]
    assert f"--row {first} --viewer" in flat


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("place", ["name", "description", "message", "label", "folder"])
def test_names_are_text_wherever_they_are(few, place):
    plan, frame = few
    odd = dataclasses.replace(plan, **{place: HOSTILE}) if place in ("name", "description") else plan
    rows = frame.assign(message=HOSTILE) if place == "message" else frame
    if place == "label":
        laws = [
            dataclasses.replace(law, label=f"{law.label}{HOSTILE}" if law.label == "gsta" else law.label)
            for law in plan.laws
        ]
        odd = dataclasses.replace(plan, laws=tuple(laws))
        rows = frame.assign(law=frame["law"].replace("gsta", f"gsta{HOSTILE}"))
    text = page(odd, rows, HOSTILE if place == "folder" else "out")
    assert "<script" not in text
    assert HOSTILE in "".join(complete_by_itself(text).text).replace("'\"'\"'", "'")


@pytest.mark.usefixtures("undrawn")
def test_no_folder_of_the_user_is_on_the_page(tmp_path):
    paths = []
    for name in ("one.xml", "two.xml"):
        paths.append(tmp_path / "secret" / name)
        paths[-1].parent.mkdir(exist_ok=True)
        paths[-1].write_bytes(MODEL.read_bytes())
    law = tmp_path / "secret" / "law.py"
    law.write_text(LAW)
    vary = [{"key": "vehicle.model", "values": [str(path) for path in paths]}]
    plan = plan_of(vary, laws=("gsta", f"{law}:Mine"))
    text = page(plan, frame_of(plan, lambda given: {"contact.peak_N": given["index"]}), "out")
    flat = words(text)
    assert "secret" not in text
    assert "Mine: law.py:Mine" in flat
    assert "2 values: one.xml, two.xml" in flat
    assert "vehicle.model two.xml" in flat


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("rows", [0, 1, 5, 30])
def test_a_study_that_is_not_done_has_a_page(few, rows):
    plan, frame = few
    flat = words(page(plan, frame[:rows]))
    assert f"{40 - rows} of 40 runs are not done yet" in flat


@pytest.mark.usefixtures("undrawn")
def test_a_study_all_of_whose_runs_failed_has_a_page(few):
    plan, frame = few
    lost = frame.assign(status="failed", message="ZeroDivisionError")
    metrics = list(frame.columns[frame.columns.get_loc("engine") + 1 :])
    flat = words(page(plan, lost.assign(**dict.fromkeys(metrics))))
    assert "No metric differs between the completed runs." in flat
    assert "40 runs did not complete" in flat


@pytest.mark.parametrize("vary", DESIGNS.values(), ids=DESIGNS)
def test_any_design_has_a_page(vary):
    grid = all("values" in each or "number" in each for each in vary)
    plan = plan_of(vary, laws=("gsta", "fosm"), **({} if grid and vary else {"kind": "random", "runs": 20}))

    def row(given):
        lost = given["draw"] % 7 == 3
        peak = 10.0 + given["draw"] + (given["law"] == "fosm")
        return {"contact.peak_N": np.where(lost, np.nan, peak), "status": np.where(lost, "unstable", "completed")}

    frame = frame_of(plan, row)
    for i, each in enumerate(plan.variations):
        if each.laws:
            frame.loc[~frame["law"].isin(each.laws), plan.varied[i]] = np.nan
    assert "contact.peak [N]" in words(page(plan, frame))


@pytest.mark.slow
def test_a_page_of_many_runs_is_small():
    plan = plan_of(kind="latin_hypercube", runs=12_000)
    frame = frame_of(plan, pushes())
    assert len(page(plan, frame)) < 2_000_000
