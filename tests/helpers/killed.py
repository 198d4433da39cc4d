"""The command ``uvms-mj`` in processes that start at once, to be killed: copies of one that has imported it."""

import faulthandler
import multiprocessing
import os
from multiprocessing.context import ForkServerProcess
from pathlib import Path

from uvms_mj import McapLog, simulate
from uvms_mj.cli import main

_IMPORTED = McapLog, simulate
_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload([__name__])


def _command(folder: Path, arguments: list[str]) -> None:
    faulthandler.enable()
    os.chdir(folder)
    main(arguments)


def started(*arguments: str, cwd: Path) -> ForkServerProcess:
    """A process with this command in it."""
    process = _CONTEXT.Process(target=_command, args=(cwd, list(arguments)), daemon=True)
    process.start()
    return process
