"""A run repeats from its log alone, and a log has no path of the user's."""

import hashlib
import os
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from recorded import LAW, decoded, same
from uvms_mj import InputError, McapLog, Scenario, Status, Trace, simulate
from uvms_mj.cli import main
from uvms_mj.engine.vehicle_run import Again
from uvms_mj.records.mcap.attachments import outcome_of, without_paths

ROOT = Path(__file__).parents[2]


def test_a_run_repeats_from_its_log_bit_for_bit(here, tmp_path):
    """The vehicle's file and its parts have been deleted before. Gains can be changed on the command line."""
    folder = tmp_path / "vehicle"
    (folder / "parts").mkdir(parents=True)
    cube = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    (folder / "parts" / "nose.obj").write_text(cube)
    (folder / "more.xml").write_text('<mujoco><asset><mesh name="nose" file="parts/nose.obj"/></asset></mujoco>')
    text = (ROOT / "models" / "bluerov1.xml").read_text().replace("</asset>", '</asset><include file="more.xml"/>')
    text = text.replace("<freejoint", '<geom type="mesh" mesh="nose" pos=".2 0 0" mass="0"/><freejoint', 1)
    (folder / "mine.xml").write_text(text)
    settings = ["simulation.duration=0.3", "wall.position=0.002", "reference.step_time=0"]
    first = here("run", *settings, f"vehicle.model={folder / 'mine.xml'}", "-q", "-o", "a", "--log-rate", "500")
    assert first.exit_code == 0, first.stderr
    original = Trace.load(tmp_path / "a" / "run.mcap")
    assert set(original.header.mjcf.files) == {"mine.xml", "more.xml", "nose.obj"}
    assert original.header.geometry.reach == pytest.approx(0.3, abs=0.01)
    for file in sorted(folder.rglob("*"), reverse=True):
        file.unlink() if file.is_file() else file.rmdir()
    again = here("run", "--from", "a/run.mcap", "-q", "-o", "b")
    assert (again.exit_code, again.stderr) == (0, "")
    same(original, Trace.load(tmp_path / "b" / "run.mcap"))
    other = here("run", "--from", "b/run.mcap", "controller.k_1=6", "-q", "-o", "c")
    assert other.exit_code == 0, other.stderr
    changed = Trace.load(tmp_path / "c" / "run.mcap")
    assert changed.scenario.controller.k_1 == 6.0
    assert not np.array_equal(changed.tau, original.tau)


def test_a_users_law_is_recorded_and_never_run_from_a_log(here, tmp_path):
    path = tmp_path / "secret_place" / "my_law.py"
    path.parent.mkdir()
    path.write_text(LAW + "\nprint('ran', __file__)\n")
    done = here("run", "-c", f"{path}:Mine", "controller.k=3", "simulation.duration=0.2", "-q", "-o", "a")
    assert done.exit_code == 0, done.stderr
    log = tmp_path / "a" / "run.mcap"
    raw = log.read_bytes()
    assert b"secret_place" not in raw
    assert len(os.uname().nodename) < 6 or os.uname().nodename.encode() not in raw
    trace = Trace.load(log)
    assert trace.xi.shape[1:] == (6,)
    assert np.allclose(trace.odom[:, 0], trace.t)
    assert trace.scenario.controller.k == 3.0
    assert trace.scenario.controller.weights == (1.0, 2.0, 3.0)
    assert trace.scenario.controller.flag is True
    assert trace.header.law.source == "my_law.py:Mine"
    assert trace.header.law.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert trace.header.law.code == path.read_text()
    with pytest.raises(InputError, match="never run"):
        simulate(trace.scenario, mjcf=trace.header.mjcf)
    assert decoded(log, "/law/xi")["/law/xi"]
    refused = here("run", "--from", log, "-q", "-o", "b")
    assert refused.exit_code == 2
    assert "--controller" in refused.stderr
    assert "ran" not in refused.stdout
    shown = here("info", log, "--show", "law/my_law.py")
    assert shown.stdout == path.read_text()
    again = here("run", "--from", log, "-c", f"{path}:Mine", "-q", "-o", "c")
    assert again.exit_code == 0, again.stderr
    assert "sha256" not in again.stderr
    same(trace, Trace.load(tmp_path / "c" / "run.mcap"))
    path.write_text(LAW.replace("- gains.k", "- 2.0 * gains.k"))
    edited = here("run", "--from", log, "-c", f"{path}:Mine", "-q", "-o", "d")
    assert edited.exit_code == 0
    assert "differs from the recorded code" in edited.stderr


@pytest.mark.parametrize("folder", [".", "elsewhere"])
def test_a_stage_of_a_log_is_armed_again_with_its_file(tmp_path, monkeypatch, folder):
    """Also by the path that the log has; the recorded settings are kept."""
    (tmp_path / folder).mkdir(exist_ok=True)
    (tmp_path / folder / "mine.py").write_text(LAW)
    monkeypatch.chdir(tmp_path)
    law, settings = f"{folder}/mine.py:Mine", {"controller.k": 3.0, "simulation.duration": 0.02}
    trace = simulate(Scenario.load("push_wall", settings, law), sinks=[McapLog("run.mcap")])
    loaded = Trace.load("run.mcap").scenario
    with pytest.raises(InputError, match=re.escape('updated({"controller.name": "path/to/mine.py:Mine"})')):
        simulate(loaded)
    for again in (loaded.updated({"controller.name": law}), loaded.updated({}, str(Path(law).absolute()))):
        assert again.controller.k == 3.0
        same(trace, simulate(again))
    with pytest.raises(InputError, match="no file"):
        loaded.updated({"controller.name": "nowhere/mine.py:Mine"})


@pytest.mark.parametrize(
    "text", ["<mujoco", "\ufeff<mujoco", "<!-- hull -- and skids --><!-- <mesh file='/a/b.stl'/> --><mujoco"]
)
def test_no_path_of_a_users_is_in_a_model_and_the_log_is_enough_to_repeat(tmp_path, text):
    folder = tmp_path / "secret_place"
    folder.mkdir()
    (folder / "hull.obj").write_text("v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
    model = (ROOT / "models" / "bluerov1.xml").read_text().replace("<mujoco", text, 1)
    model = re.sub(r"<compiler ", f"<compiler meshdir='{folder}' ", model, count=1)
    with_mesh = model.replace("</asset>", '<mesh name="hull" file="hull.obj"/></asset>', 1)
    for name, text in (("plain", model), ("mesh", with_mesh)):
        (folder / f"{name}.xml").write_text(text, encoding="utf-8")
    for name in ("plain", "mesh"):
        scenario = Scenario.load(
            "push_wall", {"vehicle.model": str(folder / f"{name}.xml"), "simulation.duration": 0.1}
        )
        trace = simulate(scenario, sinks=[McapLog(tmp_path / f"{name}.mcap")])
        assert b"secret_place" not in (tmp_path / f"{name}.mcap").read_bytes()
    for file in folder.iterdir():
        file.unlink()
    for name in ("plain", "mesh"):
        loaded = Trace.load(tmp_path / f"{name}.mcap")
        same(trace, simulate(loaded.scenario, mjcf=loaded.header.mjcf))


@pytest.mark.parametrize(
    "said", ["open('/home/jo/my dir/a b.txt')", "file:///home/jo/x", "/home/jo/x: no", r"C:\\jo\\x", "~/jo/x"]
)
def test_what_a_law_raises_is_logged_without_folders(tmp_path, said):
    message = without_paths(f"RuntimeError: {said} in N/m and 'm/s', http://a.b/c")
    assert "jo" not in message
    assert "my dir" not in message
    assert message.endswith("in N/m and 'm/s', http://a.b/c")


def test_no_path_of_a_users_is_in_a_warning(here, tmp_path):
    path = tmp_path / "secret_place" / "slow.py"
    path.parent.mkdir()
    path.write_text(LAW.replace("state_dot.odom[0] = 1.0", "open(__file__).close(); state_dot.odom[0] = 1.0"))
    done = here("run", "-c", f"{path}:Mine", "simulation.duration=0.02", "-q", "-o", "a")
    assert "plain Python" in done.stderr
    assert b"secret_place" not in (tmp_path / "a" / "run.mcap").read_bytes()
    assert Trace.load(tmp_path / "a" / "run.mcap").notes


CHANGES = ((1000, {"impedance.F_d": [3.0, 0, 0, 0, 0, 0]}), (2003, {"controller.k_1": 8, "wall.stiffness": 2e4}))


def test_what_was_changed_in_a_run_is_changed_again_before_the_same_steps(tmp_path):
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.5})
    log = McapLog(tmp_path / "run.mcap")
    trace = simulate(scenario, sinks=[log], guides=[Again(CHANGES)], engine="free_body")
    assert trace.outcome.changes == CHANGES
    plain = simulate(scenario, engine="free_body")
    steps = np.flatnonzero((plain.rows() != trace.rows()).any(axis=1)) * trace.header.row_steps
    assert steps[0] == 1000
    ran = CliRunner().invoke(main, ["run", "--from", str(tmp_path / "run.mcap"), "-o", str(tmp_path / "again")])
    assert ran.exit_code == 0, ran.output
    assert "again after step 2003: controller.k_1 = 8, wall.stiffness = 20000.0" in ran.output
    again = Trace.load(tmp_path / "again" / "run.mcap")
    assert np.array_equal(again.rows(), trace.rows())
    assert again.outcome.changes == CHANGES


@pytest.mark.parametrize("log_rate", [1000.0, "full"])
def test_a_change_does_not_depend_on_how_the_run_is_cut_into_pieces(log_rate):
    """A guide that is asked at every seventh step changes what one changes that is asked at the steps alone."""

    class Sevenths(Again):
        def go_on(self, sim, change):
            return min(7, super().go_on(sim, change))

    scenario = Scenario.load("push_wall", {"simulation.duration": 0.3})
    once, often = (
        simulate(scenario, log_rate=log_rate, guides=[guide(CHANGES)], engine="free_body")
        for guide in (Again, Sevenths)
    )
    assert np.array_equal(once.rows(), often.rows())


@pytest.mark.parametrize("given", [{"controller.name": "mine.py:Mine"}, {"task.frame": "tool"}, {"walls": [{}]}])
def test_a_change_is_numbers(given):
    """A text would be a file that is loaded; none is."""
    with pytest.raises(InputError, match=f"{next(iter(given))}: only numbers change in a run"):
        simulate(Scenario.load("push_wall", {"simulation.duration": 0.1}), guides=[Again([(3, given)])])


def test_a_log_whose_changes_are_texts_is_damaged():
    with pytest.raises(InputError, match=r"outcome.json"):
        outcome_of(b'{"status": "%s", "message": "", "steps": 1, "wall_time_s": 0.0, "changes": [[0, {"a": "b"}]]}'
                   % Status.completed.value.encode())  # fmt: skip
