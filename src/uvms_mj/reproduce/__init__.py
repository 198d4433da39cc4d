"""Experiments that are repeated: each fills a folder with its runs, and writes a page and its numbers there."""

import json
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from ..studies.pages import PAGE as PAGE
from ..studies.pages import write
from ..views.progress import following

Progress = Callable[[float, int], None]
"""Called with the runs, steps or levels that are done, and their total."""


def running(progress: Progress | bool | None) -> AbstractContextManager[Progress]:
    """The bar of an experiment's runs, or the given function."""
    return following(progress, "running", "{share:.0%}", lambda done, total: {"done": done, "total": total})


def publish(folder: Path, page: str, **numbers: Any) -> None:
    """Write the page of an experiment, and NAME.json of each of its numbers."""
    write(folder / PAGE, page)
    for name, table in numbers.items():
        write(folder / f"{name}.json", json.dumps(table, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
