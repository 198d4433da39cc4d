"""The installed package: the wheel is complete, and a cold and a warm start give the same bits."""

import json
import os
import pkgutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np

from forked import done as forked
from uvms_mj import Trace
from uvms_mj.cli import main
from uvms_mj.cli.new import KINDS
from uvms_mj.files import shipped

ROOT = Path(__file__).parents[1]
SHORT = ("--set", "simulation.duration=0.05")


def test_cold_and_warm_machine_code_give_the_same_bits(tmp_path):
    """The first run compiles everything, the second loads it from the cache. A broken cache entry is recompiled."""
    environment = {"UVMS_MJ_CACHE_DIR": str(tmp_path / "cache")}
    for name in ("cold", "warm"):
        done = forked("run", "--set", "simulation.duration=0.5", "wall.position=0.001", "reference.step_time=0",
                      "-q", "--log-rate", "full", "--out", name, cwd=tmp_path, environment=environment)  # fmt: skip
        assert done.exit_code == 0, done.stderr
    cold, warm = (Trace.load(tmp_path / name / "run.mcap") for name in ("cold", "warm"))
    assert cold["touches"][-1] > 0
    for name in cold:
        assert np.array_equal(cold[name], warm[name]), name
    broken = next((tmp_path / "cache").glob("*.o"))
    broken.write_bytes(broken.read_bytes()[:100])
    assert forked("run", *SHORT, "-q", cwd=tmp_path, environment=environment).exit_code == 0


def test_the_wheel_has_everything_and_runs_from_anywhere(tmp_path):
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q"]
    wheel = [*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", str(tmp_path / "dist"), str(ROOT)]
    subprocess.run(wheel, check=True, capture_output=True)
    (file,) = (tmp_path / "dist").glob("*.whl")
    with zipfile.ZipFile(file) as archive:
        names = archive.namelist()
    assert {f"uvms_mj/models/{name}.xml" for name in shipped("models")} <= set(names)
    assert {f"uvms_mj/cli/templates/{template}.txt" for template, _ in KINDS.values()} <= set(names)
    assert "uvms_mj/scenarios/push_wall.toml" in names
    assert "uvms_mj/py.typed" in names  # so that a type checker reads the annotations
    assert {f"uvms_mj/examples/{path.name}" for path in shipped("examples").values()} <= set(names)
    site = tmp_path / "site"
    subprocess.run([*pip, "install", "--no-deps", "--target", str(site), str(file)], check=True, capture_output=True)
    environment = os.environ | {"PYTHONPATH": str(site)}
    code = f"import uvms_mj.cli; print(uvms_mj.__file__); uvms_mj.cli.main({['run', *SHORT, '--json']})"
    python = [sys.executable, "-c", code]
    done = subprocess.run(python, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=240.0)
    assert done.returncode == 0, done.stderr
    where, _, report = done.stdout.partition("\n")
    assert where.startswith(str(site))
    assert json.loads(report)["status"] == "completed"


CALLS = {
    "run": ("simulate", "Scenario.load", "McapLog"),
    "sitl": ("simulate", "engine.ardupilot.ArduPilot"),
    "study": ("Study.load", "Study.run", "Study.plot", "Study.report"),
    "tune": ("Tuning.load", "Tuning.run", "Tuning.report"),
    "identify": ("Identification.load", "Identification.run"),
    "bench": ("reproduce.bench.bench",),
    "archive": ("reproduce.archive.archive",),
    "paper": ("reproduce.paper.repeat",),
    "practicality": ("reproduce.practicality.repeat",),
    "validate": ("reproduce.validate.repeat",),
    "converge": ("converge",),
    "certify": ("certify",),
    "replay": ("views.rerun.show", "views.rerun.serve", "views.rerun.save"),
    "video": ("video", "still"),
    "plot": ("plot", "Trace.plot"),
    "compare": ("compare",),
    "info": ("Trace.load",),
    "export": ("Trace.export", "engine.plant_fmu.write_fmu", "engine.water_plugin.write_plugin"),
    "controllers": ("control.BUILT_IN",),
    "stages": ("scenario.STAGES",),
    "vehicles": ("Mjcf.find", "files.shipped"),
    "new": ("cli.new.write_new",),
    "keys": ("scenario.keys",),
    "signals": ("stages.signals.RECORDED",),
    "metrics": ("studies.plan.metrics.METRICS",),
}
"""For each command the calls that do the same in Python."""


def test_every_command_has_its_call_in_python():
    assert set(CALLS) == set(main.commands)
    for calls in CALLS.values():
        for call in calls:
            assert pkgutil.resolve_name(f"uvms_mj.{call}" if call[0].islower() and "." in call else f"uvms_mj:{call}")
