"""Headers of logs of an earlier format."""

import json
import tomllib

import pytest
import tomli_w

from recorded import LAW
from uvms_mj import InputError, Scenario, simulate
from uvms_mj.records.mcap.attachments import FORMAT, header_files, header_of


def test_a_header_of_format_1_is_read(tmp_path):
    """The earlier format has one law's source, and the task's gains among the law's."""
    path = tmp_path / "my_law.py"
    path.write_text(LAW)
    settings = {"simulation.duration": 0.01, "task.F_1": 2.0, "task.integral": True}
    trace = simulate(Scenario.load("push_wall", settings, f"{path}:Mine"))
    files = header_files(trace.header)
    run, tables = json.loads(files["run.json"]), tomllib.loads(files["scenario.toml"].decode())
    run |= {"format": 1, "law": run.pop("stages")["controller"]}
    del tables["task"]["frame"], tables["task"]["inertia_period"]  # keys of later formats
    tables["controller"] |= tables.pop("task")
    for table in ("navigation", "actuation"):
        del tables[table]
    del tables["reference"]["name"], tables["simulation"]["seed"]
    files |= {"run.json": json.dumps(run).encode(), "scenario.toml": tomli_w.dumps(tables).encode()}
    read, now = header_of(files), header_of(header_files(trace.header))
    assert read.scenario.to_dict() == now.scenario.to_dict()
    assert read.scenario.task == trace.scenario.task
    assert read.sources == now.sources
    assert read.law.code == LAW
    with pytest.raises(
        InputError, match=rf"log format {FORMAT + 1}, which .* or later reads; this version reads formats 1 to"
    ):
        header_of(files | {"run.json": json.dumps(run | {"format": FORMAT + 1}).encode()})
    with pytest.raises(InputError, match=r"run\.json: stages\.controller: 1 is not a table"):
        header_of(files | {"run.json": json.dumps(run | {"law": 1}).encode()})


def test_a_header_of_format_2_has_no_engine():
    """Then MuJoCo was the only one."""
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.01}), engine="free_body")
    files = header_files(trace.header)
    run = json.loads(files["run.json"])
    assert (run.pop("engine"), header_of(files).engine) == ("free_body", "free_body")
    old = header_of(files | {"run.json": json.dumps(run | {"format": 2}).encode()})
    assert old.engine == "mujoco"
    assert old.scenario.to_dict() == header_of(files).scenario.to_dict()


def test_a_header_of_format_3_has_no_observer_and_no_thrusters():
    """Stages that came later were those of the defaults."""
    files = header_files(simulate(Scenario.load("push_wall", {"simulation.duration": 0.01})).header)
    run, tables = json.loads(files["run.json"]), tomllib.loads(files["scenario.toml"].decode())
    run["format"] = 3
    for later in ("observer", "thrusters"):
        del run["stages"][later], tables[later]
    old = header_of(files | {"run.json": json.dumps(run).encode(), "scenario.toml": tomli_w.dumps(tables).encode()})
    assert old.scenario.to_dict() == header_of(files).scenario.to_dict()
    assert old.sources == header_of(files).sources
