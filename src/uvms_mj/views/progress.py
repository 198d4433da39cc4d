"""Progress bars: by rich on a terminal, and in a notebook one output that is replaced, so that it has a single line
when the notebook is stored."""

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from html import escape
from typing import Any

Update = Callable[..., None]
"""Takes the counts done and in total, and fields of the text beside the bar."""
EVERY_S = 0.2
"""Least time between two states of a bar in a notebook [s]."""


@contextlib.contextmanager
def bar(what: str, text: str = "{share:.0%}", **fields: Any) -> Iterator[Update]:
    """A progress bar where somebody sees it: on standard error if it is a terminal, or in a notebook.

    ``text`` stands beside it, with the fields, ``done``, ``total``, ``share`` and ``what``, which an update may change.
    """
    if _in_notebook():
        shown = _Notebook(what, text, fields)
        try:
            yield shown.update
        finally:
            shown.end()
    elif sys.stderr.isatty():
        with _terminal(what, text, fields) as update:
            yield update
    else:
        yield lambda *counts, **fields: None


@contextlib.contextmanager
def following(
    progress: Callable[..., None] | bool | None, what: str, text: str, given: Callable[..., dict[str, Any]]
) -> Iterator[Callable[..., None]]:
    """A run's progress: the user's function, a bar for True, nothing otherwise. ``given`` makes the fields of
    the bar, ``done`` and ``total`` among them, of the arguments of a call."""
    if callable(progress):
        yield progress
    elif progress:
        with bar(what, text) as update:
            yield lambda *arguments: update(**given(*arguments))
    else:
        yield lambda *arguments: None


def _in_notebook() -> bool:
    """Whether the output goes to a notebook."""
    shell = sys.modules.get("IPython")
    shell = None if shell is None else shell.get_ipython()
    return hasattr(shell, "kernel")


def _filled(text: str, what: str, done: float, total: float | None, fields: dict[str, Any]) -> str:
    share = done / total if total else 0.0
    return text.format(what=what, done=done, total=total or 0, share=share, **fields)


@contextlib.contextmanager
def _terminal(what: str, text: str, fields: dict[str, Any]) -> Iterator[Update]:
    import rich.console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[text]}"), TimeRemainingColumn())
    with Progress(*columns, console=rich.console.Console(stderr=True, markup=False), transient=True) as progress:
        task = progress.add_task(what, total=None, text="")

        def update(done: float, total: float, *, what: str = what, **more: Any) -> None:
            said = _filled(text, what, done, total, {**fields, **more})
            progress.update(task, completed=done, total=total, description=what, text=said)

        yield update


class _Notebook:
    """A bar in the output of a cell."""

    def __init__(self, what: str, text: str, fields: dict[str, Any]) -> None:
        from IPython.display import display

        self._began = self._last = time.monotonic()
        self._what, self._text, self._fields = what, text, fields
        self._done, self._total = 0.0, 0.0
        self._handle = display(self._shown(), raw=True, display_id=True)

    def update(self, done: float, total: float, *, what: str | None = None, **more: Any) -> None:
        self._done, self._total, self._what = done, total, what or self._what
        self._fields |= more
        if time.monotonic() - self._last > EVERY_S:
            self._last = time.monotonic()
            self._handle.update(self._shown(), raw=True)

    def end(self) -> None:
        self._handle.update(self._shown(), raw=True)

    def _shown(self) -> dict[str, str]:
        """The bar as HTML, and as text for what shows no HTML."""
        said = _filled(self._text, self._what, self._done, self._total, self._fields) if self._total else ""
        said = f"{said} {time.monotonic() - self._began:.1f} s".lstrip()
        bar = f"<progress max='{self._total or 1:g}' value='{self._done:g}' style='vertical-align: middle;'></progress>"
        html = f"<div>{escape(self._what)} {bar} {escape(said)}</div>"
        return {"text/html": html, "text/plain": f"{self._what}: {said}"}
