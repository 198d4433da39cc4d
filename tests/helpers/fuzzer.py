"""Fuzzer for ``uvms-mj``: runs mutated inputs in processes with limits, and checks what must hold for any input.

The workers are those of a study: one that ends, or hangs for too long, loses its own input only.
"""

import contextlib
import faulthandler
import functools
import io
import json
import os
import resource
import signal
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SOFT_S, HARD_S = 8.0, 90.0
"""Processor time after which an input is interrupted as by Ctrl-C, and wall time after which its process ends [s]."""
MEMORY = 3 << 30
"""Memory that a worker may allocate beyond its memory at the start [B]."""


@dataclass(frozen=True)
class Failure:
    """An input that violated a check. Its seed reproduces it."""

    seed: int
    kind: str
    arguments: str
    what: str


# ----------------------------------------------------------------------------------------------------- in a worker


def verdict(case: Any, folder: Path) -> str:
    """Run an input in the empty folder ``folder``. Returns a description of the failure, or an empty string."""
    from uvms_mj.cli import main

    for name, data in case.files.items():
        (folder / name).write_bytes(data)
    out, err = io.TextIOWrapper(io.BytesIO(), encoding="utf-8"), io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    status, raised = 0, ""
    before = Path.cwd()
    os.chdir(folder)
    signal.signal(signal.SIGPROF, lambda *_: signal.raise_signal(signal.SIGINT))
    signal.setitimer(signal.ITIMER_PROF, SOFT_S)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            main(list(case.arguments), prog_name="uvms-mj")
    except SystemExit as exit_:
        status = exit_.code if isinstance(exit_.code, int) else 1
    except BaseException:
        raised = traceback.format_exc()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        os.chdir(before)
    if raised:
        return raised
    texts = []
    for stream in (out, err):
        stream.flush()
        texts.append(stream.buffer.getvalue().decode(errors="replace"))
    return _wrong(case, folder, status, *texts)


def _wrong(case: Any, folder: Path, status: int, out: str, err: str) -> str:
    if "Traceback" in err:
        return f"a traceback on standard error:\n{err}"
    if status == 2 and not ("error: " in err or "Error: " in err):
        return f"status 2 without a message:\n{err}"
    if status == 2 and len(err) > 20_000:
        return f"a message of {len(err)} characters"
    if status not in (0, 2, 3, 130):
        return f"status {status}:\n{err}"
    if (folder / "MUJOCO_LOG.TXT").exists():
        return "MuJoCo wrote MUJOCO_LOG.TXT"
    left = {path.name for path in folder.iterdir()} - set(case.files)
    if case.arguments[0] == "run" and status in (0, 3, 130):
        return _wrong_run(folder, status, json.loads(out), err)
    if case.arguments[0] == "run" and left - {"out", "runs"}:
        return f"left behind: {left}"
    if case.original is not None and status == 0 and case.arguments[0] == "info":
        return _wrong_log(case, folder)
    return "" if status != 130 else f"took longer than {SOFT_S:g} s:\n{err}"


def _wrong_run(folder: Path, status: int, report: dict[str, Any], err: str) -> str:
    """Check that a completed run is physical and that its log agrees with the report."""
    import numpy as np

    from uvms_mj import Trace

    if status == 130 and not report["steps"]:
        return f"no step within {SOFT_S:g} s:\n{err}"
    expected = {0: "completed", 3: "unstable", 130: "interrupted"}[status]
    if report["status"] != expected:
        return f"status {status} of a run that is {report['status']}"
    logs = list(folder.rglob("run.mcap"))
    if len(logs) != 1:
        return f"{len(logs)} logs"
    trace = Trace.load(logs[0])
    rows = trace.rows()
    if status == 0 and not np.isfinite(rows).all():
        return "a completed run with numbers that are not finite"
    turned = np.abs(np.linalg.norm(trace.quat_WB, axis=1) - 1.0)
    if status == 0 and turned.max(initial=0.0) > 1e-6:
        return f"an attitude of length 1 + {turned.max():g}"
    if status == 0 and trace.scenario.wall.friction == 0.0 and (trace.f_contact_W[:, 0] > 1e-9).any():
        return "a wall that pulls"
    return ""


def _wrong_log(case: Any, folder: Path) -> str:
    """Check that the rows read from a damaged log are the first rows of the original."""
    import numpy as np

    from uvms_mj import Trace

    (folder / "original.mcap").write_bytes(case.original)
    there, was = Trace.load(folder / "x.mcap"), Trace.load(folder / "original.mcap")
    same = len(there) <= len(was) and np.array_equal(there.rows(), was.rows()[: len(there)])
    return "" if same and there.scenario == was.scenario else "damage that was not found"


@functools.cache
def _limited() -> None:
    """Import and compile everything, and then limit this process, once."""
    from mutations import SHORT
    from uvms_mj import Scenario, simulate
    from uvms_mj.control import BUILT_IN

    signal.signal(signal.SIGINT, signal.default_int_handler)
    for name in BUILT_IN:
        simulate(Scenario.load("push_wall", SHORT, name))
    if sys.platform == "linux":
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, resource.RLIM_INFINITY))
    with contextlib.suppress(OSError):
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def work(seed: int) -> str:
    """Run the input of a seed in a worker. Returns a description of the failure, or an empty string."""
    from mutations import case

    _limited()
    faulthandler.dump_traceback_later(HARD_S, exit=True)  # shows where it hangs
    try:
        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
            return verdict(case(seed), Path(folder))
    finally:
        faulthandler.cancel_dump_traceback_later()


# --------------------------------------------------------------------------------------------------- in the parent


def campaign(
    seeds: range, workers: int = 2, progress: Callable[[int, Failure | None], None] = lambda done, failure: None
) -> tuple[list[Failure], dict[str, int]]:
    """Run all seeds. Returns the failures and the number of inputs of each kind.

    ``progress`` is called with the number of finished inputs and the failure of the last one, or None.
    """
    from mutations import case
    from uvms_mj.studies.pool.executors import WorkerLost, executor_of

    failures, kinds = list[Failure](), Counter[str]()
    with executor_of(None, workers) as pool:
        calls = {pool.submit(work, seed): seed for seed in seeds}
        for call in as_completed(calls):
            one = case(calls[call])
            try:
                what = call.result()
            except WorkerLost as lost:
                what = f"its process ended, or hung for {HARD_S:g} s, see above: {lost}"
            failure = Failure(calls[call], one.kind, repr(one.arguments)[:300], what) if what else None
            kinds[one.kind] += 1
            failures += [failure] if failure else []
            progress(kinds.total(), failure)
    return sorted(failures, key=lambda failure: failure.seed), dict(kinds)


def told(failures: Iterable[Failure]) -> str:
    """Readable text of failures, with the seed and arguments that reproduce each."""
    return "\n\n".join(f"seed {f.seed} ({f.kind}): {f.arguments}\n{f.what.rstrip()}" for f in failures)
