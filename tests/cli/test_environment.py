"""Environment variables of other libraries stop no command."""

import os
import subprocess
import sys

COMMAND = [sys.executable, "-m", "uvms_mj"]


def test_an_unknown_mujoco_gl_stops_no_command(tmp_path):
    environment = os.environ | {"MUJOCO_GL": "xyz"}
    run = [*COMMAND, "run", "-q", "simulation.duration=0.002"]
    done = subprocess.run(run, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
