"""The command ``uvms-mj`` in a process of its own."""

import subprocess
import sys

COMMAND = [sys.executable, "-X", "faulthandler", "-m", "uvms_mj"]


def run(*arguments, cwd, command=COMMAND, **options):
    return subprocess.run(
        [*command, *map(str, arguments)], cwd=cwd, capture_output=True, text=True, timeout=240.0, **options
    )


def no_constants(name):
    raise ValueError(f"{name} is not JSON")
