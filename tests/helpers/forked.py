"""Processes that start at once, as copies of one that has imported the package: for what ends, limits or stops one."""

import faulthandler
import multiprocessing
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from types import SimpleNamespace

from uvms_mj.cli import main

_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(
    [f"uvms_mj.{name}" for name in ("cli", "engine.run", "records.mcap", "studies.study", "studies.tune.tuning")]
)


def _work(what: str | Sequence[str], folder: Path, environment: Mapping[str, str], streams: Sequence[str]) -> None:
    for number, path in enumerate(streams, start=1):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
    faulthandler.enable()
    os.chdir(folder)
    os.environ.update(environment)
    if isinstance(what, str):
        sys.path.insert(0, "")
        exec(what, {"__name__": "__main__"})
    else:
        main(what)


def started(
    *arguments: str,
    cwd: Path,
    code: str = "",
    environment: Mapping[str, str] | None = None,
    streams: Sequence[str] = (),
) -> ForkServerProcess:
    """A process with this command in it, or with some code. ``streams`` are files for its standard output and its
    standard error. It may have processes of its own, so whoever starts it ends it."""
    given = code or list(map(str, arguments)), cwd, dict(environment or {}), list(streams)
    process = _CONTEXT.Process(target=_work, args=given)
    process.start()
    return process


def ended(process: ForkServerProcess, seconds: float = 120.0) -> int:
    """The exit status of a process, which is killed if it takes longer."""
    process.join(seconds)
    if process.is_alive():
        process.kill()
        process.join()
        raise AssertionError(f"the process did not end in {seconds:g} s")
    return process.exitcode


def done(
    *arguments: object, cwd: Path, code: str = "", environment: Mapping[str, str] | None = None
) -> SimpleNamespace:
    """A process that ended: its exit status and what it said, as a command run by CliRunner."""
    with tempfile.TemporaryDirectory() as folder:
        streams = [f"{folder}/out", f"{folder}/err"]
        status = ended(started(*arguments, cwd=cwd, code=code, environment=environment, streams=streams))
        out, err = (Path(each).read_text() for each in streams)
    return SimpleNamespace(exit_code=status, stdout=out, stderr=err)
