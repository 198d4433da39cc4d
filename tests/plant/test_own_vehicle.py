"""A copy of a vehicle's file for its owner, with its own thrusters or those of a table."""

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from uvms_mj import InputError, Scenario, simulate
from uvms_mj.cli import main
from uvms_mj.control.base import NoClosedForm
from uvms_mj.files import shipped
from uvms_mj.physics.frames import quat_from_euler_deg, rotation_matrix
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.plant.own_vehicle import read_thrusters, unreachable

ROOT = Path(__file__).parents[2]
HEAD = "name,x_m,y_m,z_m,dx,dy,dz,min_N,max_N\n"
TABLE = HEAD + "port,0.1,0.2,-0.05,1,0,0,-40,50\nstarboard,0.1,-0.2,-0.05,2,0,0,-40,50\nup,0,0,0.1,0,0,1,,\n"


@pytest.fixture
def new(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(main, ["new", "vehicle", "mine", *map(str, words)])


def same(a, b, but=()):
    """Whether two vehicles have the same numbers, besides some."""
    names = ("M_RB", "M_A", "D_linear", "D_quadratic", "displaced_mass", "r_b", "B", "u_min", "u_max")
    assert all(np.array_equal(getattr(a, each), getattr(b, each)) for each in names if each not in but)
    assert a.arm.joints == b.arm.joints
    for one, two in zip(a.arm.links, b.arm.links, strict=True):
        assert np.array_equal(one.M_A, two.M_A)


@pytest.mark.parametrize("origin", sorted(shipped("models")))
def test_a_copy_of_a_shipped_vehicle_is_the_vehicle_with_its_source_and_licence(new, origin):
    done = new("--from", origin)
    assert done.exit_code == 0, done.stderr
    copy, old = Mjcf.find("mine.xml"), Mjcf.find(origin)
    same(copy.vehicle, old.vehicle)
    assert copy.vehicle.body == "mine"
    assert copy.geometry.reach == old.geometry.reach
    assert copy.geometry.shapes == old.geometry.shapes
    for key in ("source", "licence"):
        assert copy.remarks[key] == old.remarks[key]
    assert copy.remarks["trust"] == f"changed copy of {origin}; the original: {old.remarks['trust']}"
    assert copy.remarks["description"].startswith(f"mine, changed copy of {origin}; ")
    text = Path("mine.xml").read_text()
    comments = re.findall(r"<!--(.*?)-->", shipped("models")[origin].read_text(), re.DOTALL)
    assert all(comment in text for comment in comments)


@pytest.mark.parametrize("origin", [*sorted(shipped("models")), None])
def test_thrusters_of_a_table_are_columns_of_B_and_everything_else_stays(new, origin, tmp_path):
    """Of a thruster at p with direction d: [d; p x d]."""
    Path("t.csv").write_text(TABLE)
    done = new(*(("--from", origin) if origin else ()), "--thrusters", "t.csv")
    assert done.exit_code == 0, done.stderr
    vehicle = Mjcf.find("mine.xml").vehicle
    assert vehicle.thrusters == ("port", "starboard", "up")
    expected = [[1, 0, 0, 0, -0.05, -0.2], [1, 0, 0, 0, -0.05, 0.2], [0, 0, 1, 0, 0, 0]]
    assert np.abs(vehicle.B.T - expected).max() < 1e-12
    assert vehicle.u_min.tolist() == [-40.0, -40.0, -np.inf]
    assert vehicle.u_max.tolist() == [50.0, 50.0, np.inf]
    text = Path("mine.xml").read_text()
    assert not any(f'"{name}"' in text for name in (Mjcf.find(origin).vehicle.thrusters if origin else ()))
    assert "POSITIONS ARE ESTIMATES" not in text  # of the old thrusters
    if origin:
        same(vehicle, Mjcf.find(origin).vehicle, but=("B", "u_min", "u_max"))
        assert "thrusters of t.csv" in Mjcf.find("mine.xml").remarks["trust"]
    assert "its 3 thrusters span 3 of 6 axes: they can't produce sway or roll" in done.stderr


ROUNDED = """t1,0.14,-0.092,0,-0.7067,-0.7075,0.0001,-40,50
t2,0.14,0.092,0,-0.7074,0.7068,0,-40,50
t3,-0.15,-0.092,0,0.707,-0.7072,0,-40,50
t4,-0.15,0.092,0,0.7071,0.7071,-0.0001,-40,50
t5,0,-0.109,0.077,0,0,1,-40,50
t6,0,0.109,0.077,0,0,1,-40,50
"""


def test_directions_of_four_digits_make_no_axis_and_no_closed_form(new):
    """The thrusters of a BlueROV2, which has no pitch: its vehicle with these digits must move as with all of them."""
    Path("t.csv").write_text(HEAD + ROUNDED)
    done = new("--from", "bluerov2", "--thrusters", "t.csv")
    assert "span 5 of 6 axes: they can't produce pitch" in done.stderr
    ends = []
    for model in ("mine.xml", "bluerov2"):
        trace = simulate(Scenario.load("push_wall", {"vehicle.model": model}), engine="free_body", log_rate=10.0)
        assert trace.analytic == NoClosedForm("the thrusters can't produce every wrench")
        assert any("span 5 of 6 axes, none gives pitch" in note for note in trace.notes)
        assert any("one more axis, mostly pitch" in note for note in trace.notes) == (model == "mine.xml")
        assert trace.saturation_time[-1] == 0.0
        ends.append((trace.first_contact[-1], trace.p_WB[-1]))
    assert ends[0][0] == pytest.approx(ends[1][0], abs=1e-2)
    assert ends[0][1] == pytest.approx(ends[1][1], abs=1e-3)


def test_it_runs_by_the_command_that_is_printed(new, tmp_path):
    Path("t.csv").write_text(TABLE)
    done = new("--from", "bluerov2_heavy", "--thrusters", "t.csv")
    words = done.stdout.strip().partition(": uvms-mj ")[2].split()
    run = CliRunner().invoke(main, [*words, "simulation.duration=0.01", "-q", "--engine", "free_body", "-o", "out"])
    assert run.exit_code == 0, run.stderr


def test_a_file_of_ones_own_is_copied_with_all_its_files(new, tmp_path):
    folder = tmp_path / "cad"
    folder.mkdir()
    (folder / "hull.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    cube = (ROOT / "examples" / "cube.xml").read_text()
    cube = cube.replace("<worldbody>", '<asset><mesh name="hull" file="hull.obj"/></asset><worldbody>', 1)
    hull = '<geom type="mesh" mesh="hull" mass="0" contype="0" conaffinity="0"/>'
    (folder / "own.xml").write_text(re.sub(r"(<inertial .*?/>)", rf"\1{hull}", cube, count=1))
    done = new("--from", folder / "own.xml")
    assert done.exit_code == 0, done.stderr
    assert (tmp_path / "hull.obj").exists()
    same(Mjcf.find("mine.xml").vehicle, Mjcf.find(str(folder / "own.xml")).vehicle)
    assert "hull" in Mjcf.find("mine.xml").geometry.meshes


def test_directions_as_angles_and_units_of_the_head(tmp_path):
    """x of the frame that yaw and pitch turn, as in initial.attitude_deg."""
    (tmp_path / "a.csv").write_text(
        "name;x_mm;y_cm;z_m;yaw_deg;pitch_deg;min_kgf;max_kgf\na;100;20;0.3;30;20;-4;5\nup;0;0;0;0;-90;;\n"
    )
    a, up = read_thrusters(tmp_path / "a.csv")
    assert a.position == pytest.approx((0.1, 0.2, 0.3))
    assert a.direction == pytest.approx(rotation_matrix(quat_from_euler_deg(0.0, 20.0, 30.0))[:, 0], abs=1e-15)
    assert a.limits == pytest.approx((-4 * 9.80665, 5 * 9.80665))
    assert up.direction == (0.0, 0.0, 1.0)
    assert up.limits is None


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("", "is empty; its columns are name, x_m, y_m, z_m"),
        (HEAD, "has no thruster below its head"),
        (HEAD.replace("x_m", "x"), "column 'x': its unit is missing or unknown: write x_m or x_cm or x_mm"),
        (HEAD.replace("max_N", "max_lbf"), "column 'max_lbf': its unit is missing or unknown: write max_N or max_kgf"),
        (HEAD.replace("dz", "dzz"), "column 'dzz': is not known; did you mean 'dz'?"),
        (HEAD.replace("dz,", ""), "needs a direction: dx, dy and dz, or yaw_deg and pitch_deg"),
        (HEAD.replace(",max_N", ""), "needs both limits, min and max, or neither"),
        (HEAD.replace("x_m,", ""), "lacks x; its columns are"),
        (HEAD + "a,0,0,0,1,0,0,-1\n", "row 2: has 8 values; the head has 9 columns"),
        (HEAD + "\n# more\na,0,0 m,0,1,0,0,-1,1\n", "row 4, column y_m: '0 m' is not a number; write the number alone"),
        (HEAD.replace(",", ";") + "a;0,1;0;0;1;0;0;-1;1\n", "row 2, column x_m: '0,1' is not a number; a number has a"),
        (HEAD + "a,0,0,0,0,0,0,-1,1\n", "row 2, columns dx, dy, dz: the direction has no length"),
        (HEAD + "a,0,0,0,1,0,0,2,1\n", "row 2: the least thrust, 2 N, must be below the greatest, 1 N"),
        (HEAD + "a,0,0,0,1,0,0,,1\n", "row 2, column min_N: is empty; give both limits or neither"),
        (HEAD + "a,0,0,0,1,0,0,-1,1\na,0,0,0,1,0,0,-1,1\n", "row 3, column name: 'a' is given twice"),
        (HEAD + "a b,0,0,0,1,0,0,-1,1\n", "row 2, column name: 'a b' must be a word of letters"),
        (HEAD + "a,1560,0,0,1,0,0,-1,1\n", "row 2, column x_m: 1560 is beyond 100"),
    ],
)
def test_what_is_wrong_in_a_table_is_named_with_its_row_and_column(tmp_path, table, said):
    path = tmp_path / "t.csv"
    path.write_text(table)
    with pytest.raises(InputError, match=re.escape(f"{path}: {said}")):
        read_thrusters(path)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        (np.eye(6), ""),
        (np.eye(6)[:, :5], "its 5 thrusters span 5 of 6 axes: they can't produce yaw"),
        (
            np.eye(6)[:, :1],
            "its 1 thruster spans 1 of 6 axes: they can't produce sway or heave or roll or pitch or yaw",
        ),
        (
            np.eye(6)[:, [0, 1, 2, 3, 5]] + 0.1 * np.outer(np.eye(6)[4], [1, 0, 0, 0, 0]),
            "its 5 thrusters span 5 of 6 axes: of surge, pitch only 1 can be chosen",
        ),
    ],
)
def test_what_the_thrusters_can_not_produce_follows_from_the_null_space(columns, said):
    class Given:
        B, thrusters = columns, tuple("abcdef"[: columns.shape[1]])

    assert unreachable(Given()) == said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--from", "bluerov3"), "vehicle.model 'bluerov3': is neither a file nor a shipped model; did you mean"),
        (("--thrusters", "no.csv"), "no.csv: can't read it: No such file"),
        (("--from", "lauv", "--thrusters", "taken.csv"), "lauv.xml: 'sun' is the name of another element"),
    ],
)
def test_bad_input_is_one_message_and_leaves_nothing(new, tmp_path, words, said):
    Path("taken.csv").write_text(HEAD + "sun,0,0,0,1,0,0,-1,1\n")
    done = new(*words)
    assert done.exit_code == 2
    assert done.stderr.startswith(f"error: {said}")
    assert not Path("mine.xml").exists()


def test_the_options_are_for_vehicles(new):
    done = CliRunner().invoke(main, ["new", "law", "mine", "--from", "bluerov1"])
    assert done.exit_code == 2
    assert done.stderr == "error: --from: is for a vehicle, not for a law\n"
