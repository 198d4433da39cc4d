"""Studies: the same rows after any interruption, for any workers and order; nothing lost, nothing twice."""

import concurrent.futures
import errno
import json
import multiprocessing
import os
import random
import shutil
import signal
import time
import tomllib
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pyarrow as pa
import pytest
from pandas.testing import assert_frame_equal

from forked import ended, started
from short_study import HERE, study_text
from uvms_mj import InputError, Scenario, Study, files, simulate
from uvms_mj.files import plain
from uvms_mj.studies import bundle, results
from uvms_mj.studies.pool.execution import kept
from uvms_mj.studies.pool.executors import WorkerLost, Workers

METRICS = """
import os


def kills_its_worker(trace):
    if trace.scenario.wall.stiffness > 1.6e5 and trace.header.law.source == "gsta":
        os._exit(7)
    return 1.0


def depends(trace):
    if trace.scenario.wall.stiffness > 1e5:
        raise ValueError("too stiff")
    return {"stiffness": trace.scenario.wall.stiffness}
"""


def same(a: Path, b: Path) -> None:
    """The rows of two folders are equal, bit for bit."""
    assert_frame_equal(results.frame(a), results.frame(b), check_exact=True)


def parts(folder: Path) -> int:
    return len(list((folder / "rows").glob("part-*.parquet")))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A study that ran without an interruption."""
    path = tmp_path_factory.mktemp("whole") / "s.toml"
    path.write_text(study_text(runs=6))
    return Study.load(path).run(path.with_name("out"), executor=HERE)


@pytest.mark.processes
def test_the_rows_are_the_same_for_any_number_of_workers_and_any_order(whole, study_file, tmp_path):
    class Shuffled(concurrent.futures.ThreadPoolExecutor):
        """The last call first, in this process."""

        def submit(self, function, /, *args, **kwargs):
            future = concurrent.futures.Future()
            waiting.append((future, function, args))
            if len(waiting) >= 3 or len(waiting) + sum(done) == 12:
                while waiting:
                    done.append(1)
                    each, call, given = waiting.pop()
                    each.set_result(call(*given))
            return future

    waiting, done = [], []
    study = Study.load(study_file(runs=6))
    study.run(tmp_path / "two", workers=2)
    study.run(tmp_path / "shuffled", executor=Shuffled(1))
    same(whole.folder, tmp_path / "two")
    same(whole.folder, tmp_path / "shuffled")
    assert whole.frame["index"].tolist() == list(range(12))


def test_an_executor_may_have_jobs_that_are_asked_whether_they_are_done(whole, study_file, tmp_path):
    """As submitit's."""

    class Job:
        def __init__(self, function, arguments):
            self.function, self.arguments, self.asked = function, arguments, 0

        def done(self):
            self.asked += 1
            return self.asked > 1

        def result(self):
            assert self.asked > 1
            return self.function(*self.arguments)

    class Jobs:
        def submit(self, function, *arguments):
            return Job(function, arguments)

    Study.load(study_file(runs=6)).run(tmp_path / "out", executor=Jobs())
    same(whole.folder, tmp_path / "out")


def test_a_study_that_is_done_runs_nothing(whole):
    class Nothing(concurrent.futures.Executor):
        def submit(self, *_, **__):
            raise AssertionError

    before = {path: path.stat().st_mtime_ns for path in whole.folder.rglob("*") if path.is_file()}
    Study.load(whole.folder).run(executor=Nothing())
    assert {path: path.stat().st_mtime_ns for path in whole.folder.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("written", [0, 1, 2])
def test_a_study_that_was_killed_before_its_first_run_can_be_started_again(whole, written, tmp_path, monkeypatch):
    put, left = results.put, written

    def killed(path, write):
        nonlocal left
        if not left:
            raise KeyboardInterrupt
        left -= 1
        put(path, write)

    monkeypatch.setattr(results, "put", killed)
    with pytest.raises(KeyboardInterrupt):
        Study(whole.plan).run(tmp_path, executor=HERE)
    monkeypatch.undo()
    same(Study(whole.plan).run(tmp_path, executor=HERE).folder, whole.folder)


@pytest.mark.parametrize("damage", ["cut", "flipped", "emptied", "exchanged", "of another study"])
def test_a_damaged_part_is_run_again(whole, study_file, tmp_path, damage):
    folder = tmp_path / "other"
    shutil.copytree(whole.folder, folder)
    study = Study.load(folder)
    path = folder / "rows" / "part-00003.parquet"
    if damage in ("exchanged", "of another study"):
        other = Study.load(study_file(runs=6), {"wall.damping": 1.0}).run(tmp_path / "another", executor=HERE)
        sources = {
            "exchanged": path.with_name("part-00004.parquet"),
            "of another study": other.folder / "rows" / path.name,
        }
        path.write_bytes(sources[damage].read_bytes())
    else:
        data = bytearray(path.read_bytes())
        data[4:64] = bytes(each ^ 1 for each in data[4:64])
        path.write_bytes({"cut": data[:-20], "flipped": data, "emptied": b""}[damage])
        with pytest.raises(InputError, match=r"part-00003\.parquet: damaged"):
            _ = study.frame
    study.run(folder, executor=HERE)
    assert study.damaged == ("part-00003.parquet",)
    same(whole.folder, folder)


@pytest.mark.parametrize(
    ("stray", "said"), [("copy", r"two parts have the row 3"), ("other", "a part of another study")]
)
def test_a_part_that_is_not_the_studys_counts_no_run(whole, study_file, stray, said, tmp_path):
    folder = tmp_path / "out"
    shutil.copytree(whole.folder, folder)
    if stray == "copy":
        shutil.copy(folder / "rows" / "part-00003.parquet", folder / "rows" / "part-00003 (copy).parquet")
    else:
        other = Study.load(study_file(runs=6), {"design.seed": 9}).run(tmp_path / "other", executor=HERE)
        shutil.copy(other.folder / "rows" / "part-00004.parquet", folder / "rows")
    with pytest.raises(InputError, match=said):
        _ = Study.load(folder).frame


def test_a_shipped_vehicle_is_a_part_of_the_study(whole, tmp_path, monkeypatch):
    models = {**files.shipped("models"), "bluerov1": tmp_path / "bluerov1.xml"}
    models["bluerov1"].write_text(files.shipped("models")["bluerov1"].read_text().replace('mass="7.31"', 'mass="8.31"'))
    monkeypatch.setattr(bundle, "shipped", lambda kind: models)
    bundle.code.cache_clear()
    try:
        with pytest.raises(InputError, match=r"begun with other code: vehicles \w+ then, \w+ now"):
            Study(whole.plan).run(whole.folder, executor=HERE)
    finally:
        bundle.code.cache_clear()


def test_a_flipped_bit_is_found_or_changes_nothing(whole, tmp_path):
    source, part, chance = whole.folder / "rows" / "part-00002.parquet", tmp_path / "part", random.Random(7)
    sound, data, found = results.read(source), source.read_bytes(), 0
    for _ in range(300):
        place = chance.randrange(8 * len(data))
        part.write_bytes(data[: place // 8] + bytes([data[place // 8] ^ 1 << place % 8]) + data[place // 8 + 1 :])
        try:
            assert results.read(part).equals(sound)
        except (OSError, ValueError, pa.ArrowException):
            found += 1
    assert found > 100


def test_the_data_set_opens_as_it_is(whole):
    import duckdb
    import polars

    rows, frame = whole.folder / "rows", whole.frame
    assert_frame_equal(pd.read_parquet(rows), frame, check_exact=True)
    read = polars.read_parquet(rows / "*.parquet")
    assert read["contact.peak_N"].to_list() == frame["contact.peak_N"].tolist()
    found = duckdb.sql(f"select law, count(*) from '{rows}/*.parquet' group by law order by law").fetchall()
    assert found == [("gsta", 6), ("impedance", 6)]


def test_a_folder_with_another_study_is_refused_by_name(whole, study_file, here):
    with pytest.raises(InputError, match=r"contains the study 's', which differs in design\.runs"):
        Study.load(study_file(runs=7)).run(whole.folder)
    done = here("study", study_file(runs=7), "--out", whole.folder)
    assert done.stderr.startswith("error: ")  # nothing is printed of a study that is refused
    assert len(done.stderr.splitlines()) == 1
    other = Study.load(study_file(runs=6), {"wall.damping": 1.0})
    with pytest.raises(InputError, match=r"differs in base\.wall\.damping"):
        other.run(whole.folder)


def test_a_file_that_changed_since_the_study_began_is_refused(study_file, tmp_path):
    metric = tmp_path / "metric.py"
    metric.write_text("def one(trace):\n    return 1.0\n")
    path = study_file(runs=1, metrics=', "metric.py:one"')
    Study.load(path).run(tmp_path / "out", executor=HERE)
    metric.write_text("def one(trace):\n    return 2.0\n")
    with pytest.raises(InputError, match=r"since its study began, metric\.py changed"):
        Study.load(path).run(tmp_path / "out", executor=HERE)


def test_two_studies_in_one_folder_are_refused(whole):
    from uvms_mj.files import locked

    with locked(whole.folder), pytest.raises(InputError, match="another run is writing there"):
        whole.run()


@pytest.mark.processes
def test_a_run_that_kills_its_workers_is_a_row_and_the_others_go_on(study_file, tmp_path):
    (tmp_path / "metric.py").write_text(METRICS)
    path = study_file(runs=3, metrics=', "metric.py:kills_its_worker"')
    frame = Study.load(path).run(tmp_path / "out", workers=1).frame
    lost = (frame["wall.stiffness"] > 1.6e5) & (frame["law"] == "gsta")
    assert 0 < lost.sum() < 6
    assert (frame.loc[lost, "status"] == "lost").all()
    assert (frame.loc[~lost, "status"] == "completed").all()
    assert "three worker processes ended" in frame.loc[lost, "message"].iloc[0]


def test_parts_whose_runs_all_failed_have_the_columns_of_the_others(study_file, tmp_path):
    (tmp_path / "metric.py").write_text(METRICS)
    path = study_file(runs=6, metrics=', "metric.py:depends"')
    frame = Study.load(path).run(tmp_path / "out", executor=HERE).frame
    assert frame["depends.stiffness"].isna().sum() == (frame["status"] == "failed").sum() > 0
    assert len({tuple(pd.read_parquet(each).columns) for each in (tmp_path / "out" / "rows").iterdir()}) == 1


def test_a_full_disk_stops_the_study_and_it_goes_on(whole, study_file, tmp_path, monkeypatch):
    study, left, fsync = Study.load(study_file(runs=6)), [12], os.fsync

    def full(place):
        left[0] -= 1
        if left[0] < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(place)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="No space left"):
            study.run(tmp_path / "full", executor=HERE)
    done = parts(tmp_path / "full")
    assert 0 < done < 12
    assert not list((tmp_path / "full" / "rows").glob(".*"))
    study.run(tmp_path / "full", executor=HERE)
    same(whole.folder, tmp_path / "full")


@pytest.mark.processes
def test_a_worker_that_is_killed_loses_nothing(whole, study_file, tmp_path):
    pool = Workers(2)

    def kill(what, done, failed, total):
        if done and done % 6 == 0 and done not in killed:
            killed.add(done)
            os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)

    killed: set[int] = set()
    Study.load(study_file(runs=6)).run(tmp_path / "out", executor=pool, progress=kill)
    pool.shutdown(wait=False)
    assert killed
    same(whole.folder, tmp_path / "out")


@pytest.mark.processes
def test_a_call_that_ends_its_worker_says_how():
    pool = Workers(1)
    with pytest.raises(WorkerLost, match=r"EXIT\(3\)"):
        pool.submit(os._exit, 3).result()
    assert pool.submit(len, "four").result() == 4
    with pytest.raises(ZeroDivisionError):
        pool.submit(divmod, 1, 0).result()
    pool.shutdown()
    with pytest.raises(RuntimeError, match="after shutdown"):
        pool.submit(len, "four")


@pytest.mark.parametrize("kind", ["failed", "listed", "worst"])
def test_the_logs_that_are_kept_are_those_of_the_rows(study_file, tmp_path, kind):
    from uvms_mj import Trace

    (tmp_path / "metric.py").write_text(METRICS)
    logs = {
        "failed": '"failed"',
        "listed": '{kind = "listed", indices = [1, 5]}',
        "worst": '{kind = "worst", k = 2, metric = "contact.peak_N"}',
    }
    metric = ', "metric.py:depends"' if kind == "failed" else ""
    path = study_file(runs=6, keep=f"logs = {logs[kind]}", metrics=metric)
    study = Study.load(path).run(tmp_path / "out", executor=HERE)
    frame = study.frame
    expected = {
        "failed": frame.index[frame["status"] != "completed"].tolist(),
        "listed": [1, 5],
        "worst": sorted(frame["contact.peak_N"].nlargest(2).index),
    }[kind]
    found = sorted((study.folder / "logs").iterdir())
    assert [path.name for path in found] == [f"row-{index:05d}.mcap" for index in expected]
    for index, log in zip(expected, found, strict=True):
        trace = Trace.load(log)
        assert trace.force_peak[-1] == frame["contact.peak_N"][index] or kind == "failed"
        assert trace.p_WB[-1, 0] == frame["final.position_m.x"][index] or kind == "failed"


@pytest.mark.parametrize(
    ("metric", "worst"), [("a", [2, 0]), ("v", [1, 2]), ("path/m.py:f", [0, 1]), ("flag", [1, 0]), ("text", [])]
)
def test_the_worst_runs_have_the_largest_metric(metric, worst):
    rows = pd.DataFrame({"index": [0, 1, 2], "a": [1.0, None, 2.0], "v.x": [0.0, -3.0, 1.0], "v.y": [1.0, 0.0, 2.0]})
    rows = rows.assign(**{"f.one": [5.0, 1.0, None], "flag": [False, True, None], "text": ["a", "b", None]})
    plan = SimpleNamespace(logs=SimpleNamespace(kind="worst", metric=metric, k=2))
    assert kept(plan, rows) == worst


def alive(marker: str) -> list[str]:
    """The processes whose environment has a marker."""
    found = []
    for place in Path("/proc").iterdir():
        try:
            if place.name.isdigit() and marker.encode() in (place / "environ").read_bytes():
                found.append(place.name)
        except OSError:
            continue
    return found


def ends(marker: str) -> bool:
    """Whether the processes with a marker end soon."""
    end = time.monotonic() + 5.0
    while alive(marker) and time.monotonic() < end:
        time.sleep(0.05)
    return not alive(marker)


def begun(folder: Path, path: Path, marker: str, workers: int) -> ForkServerProcess:
    command = ("study", path, "-j", workers, "-q", "-o", folder)
    streams = [str(path.with_name("out.txt")), str(path.with_name("err.txt"))]
    return started(*command, cwd=path.parent, environment={"UVMS_MJ_TEST": marker}, streams=streams)


def until(folder: Path, number: int) -> None:
    end = time.monotonic() + 60.0
    while parts(folder) < number and time.monotonic() < end:
        time.sleep(0.02)


@pytest.mark.slow
def test_kill_9_at_random_moments_changes_no_row(study_file, tmp_path, here):
    path, folder = study_file(runs=30), tmp_path / "killed"
    Study.load(path).run(tmp_path / "whole", executor=HERE)
    chance = random.Random(12)
    for attempt in range(2):
        marker = f"kill-{os.getpid()}-{attempt}"
        process = begun(folder, path, marker, 2 - attempt)
        until(folder, chance.randrange(15 * attempt, 15 * attempt + 15))
        time.sleep(chance.random() * 0.2)
        process.kill()
        process.join()
        assert ends(marker)
    assert 0 < parts(folder) < 60
    done = here("study", folder, "-q")
    assert (done.exit_code, done.stderr) == (0, "")
    same(tmp_path / "whole", folder)
    assert not list(folder.rglob(".*"))


@pytest.mark.slow
def test_an_interrupted_study_says_how_to_go_on(study_file, tmp_path):
    path, folder, marker = study_file(runs=200), tmp_path / "stopped", f"stop-{os.getpid()}"
    process = begun(folder, path, marker, 1)
    until(folder, 3)
    process.terminate()
    assert ended(process, 10.0) == 128 + signal.SIGTERM
    said = path.with_name("err.txt").read_text()
    assert "of 400 runs are done and kept: the same command goes on" in said
    assert len(said.splitlines()) == 1
    assert ends(marker)
    assert 3 <= parts(folder) < 400


class Unlucky(concurrent.futures.Executor):
    """Calls in this process; each call that repeats a run ends its worker once, as somebody's kill -9 does."""

    size = 1

    def __init__(self):
        self.struck = set()

    def submit(self, function, /, *args, **kwargs):
        future = concurrent.futures.Future()
        if function.__name__ in ("compared", "log_of") and (function.__name__, *args[1:]) not in self.struck:
            self.struck.add((function.__name__, *args[1:]))
            future.set_exception(WorkerLost("killed"))
        else:
            future.set_result(function(*args))
        return future


def test_a_worker_that_somebody_ends_changes_neither_the_check_nor_the_logs(study_file, tmp_path):
    path = study_file(runs=2, engine="auto", keep='logs = {kind = "listed", indices = [1]}')
    pool = Unlucky()
    study = Study.load(path).run(tmp_path / "out", executor=pool)
    assert {name for name, *_ in pool.struck} == {"compared", "log_of"}
    assert study.check["within"].all()
    assert (study.check["number"] == "contact.peak_N").any()
    assert (tmp_path / "out" / "logs" / "row-00001.mcap").stat().st_size > 0


def test_a_damaged_check_is_made_again(study_file, tmp_path):
    study = Study.load(study_file(runs=2, engine="auto")).run(tmp_path / "out", executor=Unlucky())
    before = study.check
    (tmp_path / "out" / "check.parquet").write_bytes(b"PAR1")
    with pytest.raises(InputError, match=r"check\.parquet: damaged"):
        _ = study.check
    study.run(executor=Unlucky())
    assert study.damaged == ("check.parquet",)
    assert_frame_equal(study.check, before, check_exact=True)


def test_vehicles_can_vary(tmp_path):
    """Vehicles with six and with eight thrusters in one study; each run is that of `simulate`."""
    names = ["bluerov1", "bluerov2_heavy"]
    text = study_text().replace("runs = 4", "").partition("[[laws]]")[0]
    text += f'[[laws]]\nname = "gsta"\n[[vary]]\nkey = "vehicle.model"\nvalues = {names}\n'
    (tmp_path / "vehicles.toml").write_text(text)
    study = Study.load(tmp_path / "vehicles.toml").run(tmp_path / "out", executor=HERE)
    assert study.frame["vehicle.model"].tolist() == names
    base = tomllib.loads(text)["base"]
    del base["scenario"]
    for name, peak in zip(names, study.frame["contact.peak_N"], strict=True):
        scenario = Scenario.from_dict(base, {"vehicle.model": name}, "gsta")
        assert simulate(scenario, engine="free_body").force_peak.max() == peak
    assert study.frame["contact.peak_N"].nunique() == 2


LISTS = """
name = "lists"
[base]
scenario = "push_wall"
simulation.duration = 0.05
simulation.timestep = 1e-3
[[vary]]
key = "impedance.K_f"
values = [[1.0, 1, 1, 1, 1, 1], [0.5, 0.5, 0.5, 0.5, 0.5, 0.25]]
[[vary]]
keys = ["impedance.F_d", "wall.stiffness"]
values = [[[-1.5, 0, 0, 0, 0, 0], 1e4], [[-3.0, 0, 0, 0, 0, 0], 1e5]]
[[vary]]
key = "vehicle.contact_bodies"
values = [[{position = [0.2, 0.0, 0.0], radius = 0.1}], []]
"""


@pytest.mark.usefixtures("undrawn")
def test_lists_and_tables_vary_like_numbers(tmp_path):
    """They are run, read, gone on with, found again in the rows, the data set and the report, and replayed."""
    (tmp_path / "s.toml").write_text(LISTS)
    study = Study.load(tmp_path / "s.toml").run(tmp_path / "out", executor=HERE)
    first = study.frame
    assert (first["status"] == "completed").all()
    (tmp_path / "out" / "rows" / "part-00003.parquet").unlink()
    again = Study.load(tmp_path / "out").run(executor=HERE)
    assert again.damaged == ()
    assert_frame_equal(again.frame, first, check_exact=True)
    lists = ["impedance.K_f", "impedance.F_d", "vehicle.contact_bodies"]
    for row in again.frame.to_dict("records"):
        values = again.plan.run(row["index"]).values
        assert [json.loads(row[key]) for key in lists] == [plain(values[key]) for key in lists]
        assert row["wall.stiffness"] == values["wall.stiffness"]
        assert list(again.plan.scenario(row["index"]).impedance.K_f) == values["impedance.K_f"]
    rows = again.dataset()
    chosen = rows.sel({key: first[key].iloc[5] for key in lists})
    assert chosen["final.position_m.x"].item() == first["final.position_m.x"].iloc[5]
    assert "[0.5, 0.5, 0.5, 0.5, 0.5, 0.25]" in again.report().read_text()
    with pytest.raises(InputError, match=r"'impedance.K_f': its values are no numbers"):
        again.plot("map", over=["impedance.K_f"])


def test_values_of_several_kinds_are_texts(tmp_path):
    text = LISTS.partition("[[vary]]")[0] + '[[vary]]\nkey = "controller.delay"\nvalues = [0, 0.001]\n'
    (tmp_path / "s.toml").write_text(text + '[[vary]]\nkey = "thrusters.name"\nvalues = ["ideal", "t200"]\n')
    plan = Study.load(tmp_path / "s.toml").plan
    assert results.schema_of(plan).field("controller.delay").type == pa.float64()
    assert results.schema_of(plan).field("thrusters.name").type == pa.string()
    assert [results.in_a_column(each) for each in ("x", True, [1.0, "a"], None)] == ["x", "true", '[1.0, "a"]', None]
