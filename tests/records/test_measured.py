"""Logs of a real vehicle: made by a run with another clock, gaps, noise, units and frames."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from mcap.writer import Writer

from uvms_mj import InputError, Scenario, Trace, simulate
from uvms_mj.cli import main
from uvms_mj.physics.frames import quat_from_euler_deg, rotation_matrix
from uvms_mj.records import columns
from uvms_mj.records.clocks import aligned

LATE = 12.34567
"""The clock of the log is ahead of that of the run by this [s]."""
SAMPLE = 1.0 / 97.0
KGF = 9.80665
SETTINGS = {
    "vehicle.model": "bluerov2_heavy",
    "thrusters.name": "t200",
    "bumper.stiffness": 2e3,
    "initial.position": [0.95, 0.0, 0.0],
    "reference.step_time": 1.5,
    "simulation.duration": 6.0,
    "simulation.timestep": 5e-4,
    "controller.k_1": 1.0,
    "controller.k_2": 1.0,
    "controller.beta": 2.0,
    "task.A": -20.0,
}
TABLE = """
log = "LOG"
run = "run.mcap"
time = {column = "time", unit = "ms"}
clock = {signal = "push"}

[signals.push]
column = "load"
unit = "kgf"
sign = -1

[signals.p_WB]
columns = ["north", "east", "down"]
unit = "cm"
frame = "NED"

[signals.pwm]
columns = ["pwm1", "", "", "", "", "", "", ""]
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with the run, and the samples of its vehicle by the instruments of the log."""
    folder = tmp_path_factory.mktemp("dive")
    trace = simulate(Scenario.load("push_wall", SETTINGS), engine="free_body", log_rate=400)
    trace.save(folder / "run.mcap")
    t = np.arange(0.3, 5.9, SAMPLE)
    rng = np.random.default_rng(3)
    at = {name: np.interp(t, trace.t, values) for name, values in (
        ("push", trace.push), ("x", trace.p_WB[:, 0]), ("y", trace.p_WB[:, 1]), ("z", trace.p_WB[:, 2]),
        ("pwm", trace.pwm[:, 0]),
    )}  # fmt: skip
    frame = pd.DataFrame({
        "time": 1e3 * (t + LATE),
        "load": -(at["push"] + rng.normal(0.0, 0.05, len(t))) / KGF,
        "north": 100.0 * at["x"],
        "east": -100.0 * at["y"],
        "down": -100.0 * at["z"],
        "pwm1": at["pwm"],
    })  # fmt: skip
    frame.loc[(t > 5.0) & (t < 5.2), "load"] = np.nan
    frame = frame[(t < 2.0) | (t > 2.6)]
    return SimpleNamespace(folder=folder, trace=trace, frame=frame)


def written(made, kind: str, table: str = TABLE, name: str = "dive"):
    """The path of a table, with the log in a format beside it."""
    path = made.folder / f"{name}.{kind}"
    if kind == "csv":
        made.frame.to_csv(path, index=False)
    elif kind == "parquet":
        made.frame.to_parquet(path, index=False)
    else:
        with open(path, "wb") as file:
            writer = Writer(file)
            writer.start(library="another")
            schema = writer.register_schema(name="any", encoding="jsonschema", data=b"{}")
            channel = writer.register_channel(topic="/dive", message_encoding="json", schema_id=schema)
            for row in made.frame.to_dict("records"):
                stamp = round(1e6 * row.pop("time"))
                data = json.dumps({key: value for key, value in row.items() if np.isfinite(value)}).encode()
                writer.add_message(channel_id=channel, log_time=stamp, publish_time=stamp, data=data)
            writer.finish()
        table = re.sub(r'"(load|north|east|down|pwm1)"', r'"/dive.\1"', table)
    text = made.folder / f"{name}_{kind}.toml"
    text.write_text(table.replace("LOG", path.name))
    return text


@pytest.mark.parametrize("kind", ["csv", "parquet", "mcap"])
def test_the_offset_is_found_within_a_sample_and_the_samples_are_those_of_the_run(kind, made):
    """With noise, two gaps, a missing start and end, and seven missing components."""
    found, run = Trace.load(written(made, kind)), made.trace
    offset = float(re.search(r"offset (\S+) s, by the correlation of push", found.notes[0])[1])
    assert abs(offset + LATE) < SAMPLE
    expected = {name: np.interp(found.t, run.t, values) for name, values in (("x", run.p_WB[:, 0]), ("push", run.push))}
    assert np.abs(found.p_WB[:, 0] - expected["x"]).max() < 2e-3
    assert np.abs(found.push - expected["push"]).max() < 0.4
    assert np.isnan(found.pwm[:, 1:]).all()
    assert np.isfinite(found.pwm[:, 0]).all()
    assert not ((found.t > 2.02) & (found.t < 2.58)).any()
    assert not ((found.t > 5.02) & (found.t < 5.18)).any()
    assert np.abs(np.diff(found.t)[np.diff(found.t) < 0.02] - SAMPLE).max() < 5e-4
    assert re.search(r"gaps: push 0\.\d+ s, p_WB 0\.\d+ s, pwm 0\.\d+ s; \d+ of \d+ rows are left out", found.notes[1])
    assert "missing components: pwm.2, pwm.3" in found.notes[2]
    assert found.analytic.force == run.analytic.force
    assert found.touches[-1] == run.touches[-1] == 1


@pytest.mark.parametrize("lag", [-3.217, 0.0, 0.4104, 25.0])
def test_the_clocks_of_two_records_are_aligned_at_any_offset_and_scale(lag):
    t, s = np.arange(0.0, 8.0, 0.01), np.arange(1.0, 6.0, 0.013)
    t = t[(t < 3.0) | (t > 3.5)]

    def signal(x):
        return np.sin(3.0 * x) * np.exp(-0.2 * x) + np.cos(7.1 * x)

    offset, correlation, other = aligned((t - lag, 5.0 + 3.0 * signal(t)), (s, signal(s)))
    assert abs(offset - lag) < 1e-3
    assert correlation > 0.999
    assert np.isnan(other)


def test_an_offset_that_another_one_is_as_good_as_is_named():
    """A signal that repeats itself is as good a period later. In noise the greatest of many correlations is large, too,
    and it is not at the true offset."""
    t = np.arange(0.0, 20.0, 0.02)
    offset, correlation, other = aligned((t[:700] + 3.0, np.sin(t[:700])), (t, np.sin(t)))
    assert correlation > 0.999
    periods = (np.array([offset, other]) + 3.0) / (2.0 * np.pi)
    assert np.abs(periods - periods.round()).max() < 2e-3
    assert abs(periods[0] - periods[1]) > 0.99
    rng = np.random.default_rng(2)
    short, long = rng.normal(size=10), rng.normal(size=1000)
    _, correlation, other = aligned((t[:10], short), (t, long))
    assert correlation > 0.5
    assert np.isfinite(other)
    noisy = np.sign(np.sin(0.4 * t)) + t + rng.normal(0.0, 0.5, len(t))
    offset, _, other = aligned((t[200:900] + 3.0, noisy[200:900]), (t, np.sign(np.sin(0.4 * t)) + t))
    assert abs(offset + 3.0) < 0.05
    assert np.isnan(other)


def test_events_align_the_clocks_and_say_how_much_they_differ(made):
    events = f"clock = {{events = [[{1.0 + LATE}, 1.0], [{4.0 + LATE}, 4.002]]}}"
    found = Trace.load(written(made, "csv", TABLE.replace('clock = {signal = "push"}', events), "events"))
    assert "by 2 events, which differ by 0.002 s" in found.notes[0]
    assert f"offset {round(-LATE + 0.001, 4)} s" in found.notes[0]


def test_frames_and_angles_are_turned_into_ours(made):
    """Roll, pitch and yaw from NED to FRD, a velocity in FRD, and a position in ENU, against rotation matrices."""
    t = np.arange(0.0, 3.0, 0.01)
    roll, pitch, yaw = 20.0 + 0.0 * t, -10.0 + 3.0 * t, 100.0 * t
    frame = pd.DataFrame(
        {"t": t, "a": roll, "b": pitch, "c": yaw, "e": 0.1 * t, "n": 0.2 * t, "u": -0.3 * t, "one": 1.0 + t}
    )
    frame.to_csv(made.folder / "frames.csv", index=False)
    table = made.folder / "frames.toml"
    table.write_text(
        'log = "frames.csv"\nrun = "run.mcap"\n'
        '[signals.quat_WB]\ncolumns = ["a", "b", "c"]\nunit = "deg"\nframe = "NED"\n'
        '[signals.p_WB]\ncolumns = ["e", "n", "u"]\nframe = "ENU"\n'
        '[signals.nu]\ncolumns = ["one", "one", "one", "one", "one", "one"]\nunit = "cm/s, deg/s"\nframe = "FRD"\n'
    )
    found = Trace.load(table)
    flip = np.diag([1.0, -1.0, -1.0])
    for i in (0, 100, 250):
        theirs = rotation_matrix(quat_from_euler_deg(20.0, -10.0 + 3.0 * found.t[i], 100.0 * found.t[i]))
        assert np.abs(rotation_matrix(found.quat_WB[i]) - flip @ theirs @ flip).max() < 1e-4
        assert found.p_WB[i] == pytest.approx([0.2 * found.t[i], -0.1 * found.t[i], -0.3 * found.t[i]], abs=1e-12)
        ahead, turn = 0.01 * (1.0 + found.t[i]), np.radians(1.0 + found.t[i])
        assert found.nu[i] == pytest.approx([ahead, -ahead, -ahead, turn, -turn, -turn])


def spoilt(column: str, row: int, value) -> str:
    """The lines of a CSV file with one cell replaced; ``row`` is that of the file, from 1."""
    rows = [
        ["time", "load", "north", "east", "down", "pwm1"],
        *([f"{10 * i}", "-0.1", "1", "2", "3", "1500"] for i in range(20)),
    ]
    rows[row - 1][rows[0].index(column)] = value
    return "\n".join(",".join(each) for each in rows) + "\n"


@pytest.mark.parametrize(
    ("column", "row", "value", "said"),
    [
        ("time", 7, "10", r"column 'time', row 7: the time goes back or stands still"),
        ("time", 7, "", r"column 'time', row 7: the time is missing"),
        ("load", 9, "nan", r"column 'load', row 9: nan is not finite"),
        ("load", 9, "4.x", r"column 'load', row 9: '4\.x' is not a number"),
        ("down", 9, "1,5", r"row 9: has 7 cells, and the first row names 6 columns"),
        ("north", 1, "n", r"has no column 'north'; "),
        ("load", 9, "1_0", r"column 'load', row 9: '1_0' is not a number"),
        ("down", 1, "load", r"2 columns are called 'load'"),
        ("down", 1, "time", r"2 columns are called 'time'"),
        ("time", 1, "T", r"has no column 'time' of the time"),
    ],
)
def test_a_bad_cell_is_one_sentence_with_file_column_and_row(column, row, value, said, made):
    (made.folder / "bad.csv").write_text(spoilt(column, row, value))
    table = made.folder / "bad.toml"
    table.write_text(TABLE.replace("LOG", "bad.csv"))
    with pytest.raises(InputError, match=rf"bad\.csv: {said}") as caught:
        Trace.load(table)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("column", "value", "said"), [("load", "4.x", "'4.x' is not a number"), ("down", "1,5", "has")]
)
@pytest.mark.parametrize("blank", ["\n", "  \n"])
def test_blank_lines_are_left_out_and_counted(column, value, said, blank, made):
    lines = spoilt(column, 9, value).splitlines(keepends=True)
    (made.folder / "bad.csv").write_text("".join([*lines[:4], 3 * blank, *lines[4:], 2 * blank]))
    table = made.folder / "bad.toml"
    table.write_text(TABLE.replace("LOG", "bad.csv"))
    with pytest.raises(InputError, match=rf"row 12: {re.escape(said)}"):
        Trace.load(table)


@pytest.mark.parametrize(
    ("was", "is_now", "said"),
    [
        ('unit = "kgf"', 'unit = "mm"', r"signals\.push\.unit: 'mm' is no unit of it; choose from N"),
        ('frame = "NED"', 'frame = "FRD"', r"signals\.p_WB\.frame: 'FRD' is no frame of it"),
        ("sign = -1", "sign = 2", r"signals\.push\.sign: 2 must be 1 or -1"),
        ("sign = -1", "sing = -1", r"signals\.push\.sing: no such key; did you mean 'sign'"),
        ("[signals.push]", "[signals.pushes]", r"signals\.pushes: is no signal of the run; did you mean 'push'"),
        ('"east", ', "", r"signals\.p_WB\.columns: needs 3 names"),
        ('signal = "push"', 'signal = "p_WB"', r"clock\.signal: needs a component, p_WB\.x"),
        ('signal = "push"', 'signal = "nu.x"', r"clock\.signal: nu is not in signals"),
        ('{signal = "push"}', "{}", r"clock: needs one of"),
        ('{signal = "push"}', "{offset = 1e5}", r"no time in common"),
        ('unit = "ms"', 'unit = "h"', r"time\.unit: 'h' is no unit of it"),
        ('run = "run.mcap"', "", r"the key run is missing"),
        ('{signal = "push"}', "{offset = nan}", r"clock\.offset: nan must be a finite number"),
        ('{signal = "push"}', "{offset = true}", r"clock\.offset: True must be a finite number"),
        ('{signal = "push"}', "{events = [12.8, 0.5]}", r"clock\.events: needs a list of \[time of the log"),
        (
            '{signal = "push"}',
            "{events = [[inf, 0.5]]}",
            r"clock\.events: \[inf, 0\.5\] must be a finite number, or a list",
        ),
        ('unit = "ms"', 'unit = ["ms"]', r"time\.unit: \['ms'\] is no unit of it"),
        ('unit = "ms"', 'unit = "s"', r"clock\.signal: push does not move, or too few samples .* is time\.unit right"),
        ('column = "load"', "column = 3", r"signals\.push\.columns: needs one name"),
        ('column = "load"', 'column = ""', r"clock\.signal: push is missing in the log"),
        ('column = "load"', 'column = "load"\ncolumns = ["load"]', r"signals\.push: give column or columns, not both"),
    ],
)
def test_a_bad_table_is_one_sentence(was, is_now, said, made):
    assert was in TABLE
    with pytest.raises(InputError, match=said) as caught:
        Trace.load(written(made, "csv", TABLE.replace(was, is_now, 1), "wrong"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("other", "said"), [(";", "';'"), ("\t", r"'\\t'")])
def test_cells_with_another_separator_are_named(other, said, made):
    (made.folder / "other.csv").write_text(spoilt("load", 9, "-0.2").replace(",", other))
    (made.folder / "other.toml").write_text(TABLE.replace("LOG", "other.csv"))
    with pytest.raises(InputError, match=f"its cells are separated by {said}; write it with commas"):
        Trace.load(made.folder / "other.toml")


def test_an_attitude_has_no_offset(made):
    frame = pd.DataFrame({"t": np.arange(9) / 8.0, "w": 1.0, "z": 0.0})
    frame.to_csv(made.folder / "attitude.csv", index=False)
    table = 'log = "attitude.csv"\nrun = "run.mcap"\n[signals.quat_WB]\ncolumns = ["w", "z", "z", "z"]\noffset = 0.1\n'
    (made.folder / "attitude.toml").write_text(table)
    with pytest.raises(InputError, match=r"quat_WB\.offset: an attitude has none"):
        Trace.load(made.folder / "attitude.toml")


def test_a_signal_that_does_not_agree_aligns_no_clocks(made):
    noise = made.frame.assign(load=np.random.default_rng(0).normal(size=len(made.frame)))
    other = SimpleNamespace(folder=made.folder, frame=noise)
    with pytest.raises(InputError, match=r"push of the log and of the run do not agree, their greatest correlation is"):
        Trace.load(written(other, "csv", name="noise"))


def test_messages_in_another_encoding_are_refused(made):
    with open(made.folder / "cdr.mcap", "wb") as file:
        writer = Writer(file)
        writer.start(library="another")
        schema = writer.register_schema(name="any", encoding="ros2msg", data=b"")
        channel = writer.register_channel(topic="/dive", message_encoding="cdr", schema_id=schema)
        writer.add_message(channel_id=channel, log_time=1, publish_time=1, data=b"\0" * 8)
        writer.finish()
    (made.folder / "cdr.toml").write_text(TABLE.replace("LOG", "cdr.mcap"))
    with pytest.raises(InputError, match=r"cdr\.mcap: the messages of /dive are in cdr, and only JSON is read"):
        Trace.load(made.folder / "cdr.toml")


@pytest.mark.usefixtures("undrawn")
def test_the_commands_take_the_log_beside_the_run(made):
    """A log of the push alone: what it lacks is left out, and named where it is asked for."""
    table = str(written(made, "csv", TABLE.split("[signals.p_WB]")[0], "alone"))
    run, out = str(made.folder / "run.mcap"), made.folder

    def done(*words: object, status: int = 0):
        result = CliRunner().invoke(main, [*map(str, words), *(["--force"] if words[0] != "info" else [])])
        assert result.exit_code == status, result.output
        return result

    told = json.loads(done("info", table, "--json").stdout)
    assert told["engine"] == "measured"
    assert told["contact"]["analytic_N"] == made.trace.analytic.force
    assert abs(told["contact"]["final_N"] - told["contact"]["analytic_N"]) < 0.05
    assert told["final"]["position_m"] is None
    assert any("by the correlation of push" in note for note in told["warnings"])
    assert "its clock: offset -12.3" in done("info", table).output
    done("plot", table, "--out", out / "one.png")
    done("plot", run, table, "--what", "summary,position,force", "--out", out / "both.svg")
    done("compare", run, table, "--out", out / "both.html")
    assert "its clock: offset -12.3" in (out / "both.html").read_text(encoding="utf-8")
    done("export", "log", table, "--out", out / "samples.csv")
    assert '"f_contact_W.x [N]"' in (out / "samples.csv").read_text().splitlines()[0]
    assert "has not measured its position" in done("plot", table, "--what", "position", status=2).output
    with pytest.raises(InputError, match="real vehicle's log, which is no run"):
        Trace.load(table).save(out / "again.mcap")


def test_a_csv_of_numbers_alone_is_read_as_one_with_a_place_for_each_cell(tmp_path, monkeypatch):
    """Both ways have the same bits, and the same messages: rows are counted in the file, blank lines too."""
    values = np.random.default_rng(3).normal(size=(200, 2)) * 10.0 ** np.arange(-100, 100)[:, None]
    head, *body = ["t, a,b", *(f"{0.1 * i:.17g}, {a:.17g},{b:.5e}" for i, (a, b) in enumerate(values))]
    texts = {
        "plain": [head, *body],
        "windows": ["\ufeff" + head, *(each + "\r" for each in body), "\r"],
        "blank": [head, *body[:50], "", *body[50:]],
        "gap": [head, *body[:50], "5.0,,1", *body[51:]],
        "quoted": [head, *body[:50], '"5.0","2","3"', *body[51:]],
        "back": [head, *body[:50], "", *body[50:99], "0.5,1,1", *body[100:]],
        "nan": [head, *body[:50], "5.0,nan,1", *body[51:]],
        "short": [head, *body[:50], "5.0,1", *body[51:]],
        "word": [head, *body[:50], "5.0,1_0,2", *body[51:]],
    }
    for name, lines in texts.items():
        path, found = tmp_path / f"{name}.csv", []
        path.write_text("\n".join(lines), encoding="utf-8")
        for way in (columns._plain, lambda path: None):
            monkeypatch.setattr(columns, "_plain", way)
            try:
                read = columns.columns_of(path, "t", 1.0)
                found.append(np.concatenate([*read["a"], *read["b"]]))
            except InputError as error:
                found.append(np.frombuffer(str(error).encode(), np.uint8))
            monkeypatch.undo()
        np.testing.assert_array_equal(*found, err_msg=name)
