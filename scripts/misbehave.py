"""Run ``uvms-mj run`` with every stage of ``tests/helpers/misbehaving.py``, each in a separate process, and
``uvms-mj study`` with every metric.

    python scripts/misbehave.py              all of them
    python scripts/misbehave.py gain file    cases whose names contain one of these words

Each run must end with its expected message on standard error and its expected exit status, without a traceback, a
signal or a hang. If it wrote a log, the log must load. A study must end with the expected message in its row, or on
standard error if the metric is refused.
"""

import re
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import click
import pyarrow.parquet as pq

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from misbehaving import Case, cases
from uvms_mj import Trace

LIMIT_S = 120.0
STUDY = """
laws = ["gsta"]
[base]
scenario = "push_wall"
simulation.duration = 0.02
[run]
engine = "free_body"
[design]
runs = 1
[keep]
metrics = ["my_law.py:metric"]
[[vary]]
key = "wall.stiffness"
distribution = "uniform"
low = 2e4
high = 2e5
"""


def trouble(case: Case) -> str:
    """Run the stage or the metric of a case; return a description of the failure, or an empty string."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "my_law.py").write_text(case.text, encoding="utf-8")
        Path(folder, "study.toml").write_text(STUDY, encoding="utf-8")
        arguments = ["run", f"{case.table}.name=my_law.py:Law", "simulation.duration=0.05"]
        if case.table == "metric":
            arguments = ["study", "study.toml", "-j", "1"]
        command = [sys.executable, "-m", "uvms_mj", *arguments, "-q", "-o", "out"]
        process = subprocess.Popen(command, cwd=folder, stdout=-1, stderr=-1, text=True)
        log = Path(folder, "out", "run.mcap")
        if case.endless:
            _interrupt(process, log)
        try:
            _, errors = process.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return "it hangs"
        if process.returncode != case.status:
            return f"status {process.returncode}, not {case.status}: {errors.strip()[-500:]}"
        if case.table == "metric" and case.status == 0:
            errors += _message(Path(folder, "out", "rows"))
        if "Traceback" in errors or not errors.strip() or not re.search(case.said, errors):
            return f"it says: {errors.strip()[-500:]}"
        if log.exists():
            trace = Trace.load(log)
            if trace.status.name in ("completed", "truncated") or (len(trace) == 0 and trace.steps > 10):
                return f"its log: {trace.status.name}, {len(trace)} rows"
        return ""


def _message(rows: Path) -> str:
    """The message of a study's only row, which must not be completed."""
    (row,) = pq.read_table(rows).to_pylist()
    return "" if row["status"] == "completed" else row["message"]


def _interrupt(process: subprocess.Popen, log: Path) -> None:
    """Send Ctrl-C after the run has started and its stage has entered its endless loop."""
    end = time.monotonic() + LIMIT_S
    while not log.exists() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.1)
    time.sleep(2.0)
    process.send_signal(signal.SIGINT)


@click.command(help=__doc__)
@click.argument("words", nargs=-1)
@click.option("--jobs", default=2, show_default=True, help="Number of parallel runs.")
def main(words: tuple[str, ...], jobs: int) -> None:
    chosen = {name: case for name, case in cases().items() if not words or any(word in name for word in words)}
    wrong = 0
    with ThreadPoolExecutor(jobs) as pool:
        for name, found in zip(chosen, pool.map(trouble, chosen.values()), strict=True):
            wrong += bool(found)
            click.echo(f"{name}: {found or 'ok'}")
    click.echo(f"{len(chosen)} stages and metrics, {wrong} failures")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
