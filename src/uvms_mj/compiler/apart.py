"""LLVM in a process of its own. LLVM ends a process where it does not know what to do, as for some processors; and
llvmlite lets in one thread of a process at a time."""

import contextlib
import functools
import os
import pickle
import select
import signal
import subprocess
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self

import llvmlite.binding as llvm

from .targets import Target, libm_symbols, take_in


class Ended(Exception):
    """The process ended before it gave a result; the message is the last line that it said."""


class Apart:
    """A process that calls the functions of this module, one after the other. It begins without waiting."""

    def __init__(self) -> None:
        source = str(Path(__file__).parents[2])
        path = os.pathsep.join([source, *filter(None, [os.environ.get("PYTHONPATH")])])
        self._one = threading.Lock()
        self._said = tempfile.TemporaryFile()  # noqa: SIM115  # it is closed with the process
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", f"from {__name__} import _serve; _serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._said,
            env={**os.environ, "PYTHONPATH": path},
        )

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """The result of a function of this module there. Raises Ended."""
        to, of = self._process.stdin, self._process.stdout
        assert to is not None
        assert of is not None
        try:
            with self._one:
                pickle.dump((function.__name__, arguments), to)
                to.flush()
                return pickle.load(of)
        except (EOFError, OSError, pickle.UnpicklingError):
            raise Ended(self.said()) from None

    def said(self) -> str:
        """The last line of what LLVM said."""
        self._said.seek(0)
        return (self._said.read().decode(errors="replace").strip().splitlines() or ["no reason is given"])[-1]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        for each in (self._process.stdin, self._process.stdout, self._said):
            with contextlib.suppress(OSError):  # a call that was not taken
                if each is not None:
                    each.close()


def _serve() -> None:
    """Answer calls until the other end is closed."""
    given, taken = sys.stdin.buffer, sys.stdout.buffer
    with contextlib.suppress(EOFError, BrokenPipeError, KeyboardInterrupt):
        while True:
            name, arguments = pickle.load(given)
            pickle.dump(globals()[name](*arguments), taken)
            taken.flush()


_joined: list[llvm.ModuleRef] = []


def join(texts: Sequence[str]) -> list[str]:
    """Link modules to one, and return the functions of :mod:`.libm` that it calls, by their symbols."""
    module = llvm.parse_assembly(texts[0])
    for text in texts[1:]:
        module.link_in(llvm.parse_assembly(text))
    _joined[:] = [module]
    return libm_symbols(module)


def joined(libm: str, entry: str) -> str:
    """The module of :func:`join` with the functions of libm, as LLVM's text. All but ``entry``, which is hidden, are
    its own, and none has tables for unwinding."""
    (module,) = _joined
    if libm:
        take_in(llvm.parse_assembly(libm), module)
    for function in module.functions:
        if not function.is_declaration:
            function.add_function_attribute("nounwind")
            if function.name == entry:
                function.visibility = "hidden"
            else:
                function.linkage = "internal"
    return str(module)


def emit(jobs: Sequence[tuple[str, Target]]) -> list[bytes]:
    """The code of LLVM's text for each target: none where LLVM has ended its process. A text is optimized once for all
    its targets."""
    os.nice(10)  # the caller goes on with work that is waited for longer
    texts: dict[str, list[Target]] = {}
    for text, target in jobs:
        texts.setdefault(text, []).append(target)
    shared = _forked([functools.partial(_emit, text, targets) for text, targets in texts.items()])
    codes = {
        (text, target): code
        for (text, targets), found in zip(texts.items(), shared, strict=True)
        for target, code in zip(targets, pickle.loads(found) if found else [b""] * len(targets), strict=True)
    }
    return [codes[job] for job in jobs]


_WIDEST = Target("x86_64-unknown-linux-gnu", "x86-64-v2", compact=True)
"""The target for which a text for several ones is optimized. The text has numbers of the same sizes and alignments on
all of them, and no pointer in memory; an address of 64 bits is cut where pointers have 32, and none is lost."""


def _emit(text: str, targets: Sequence[Target]) -> bytes:
    module = _WIDEST.optimized(llvm.parse_assembly(text))
    return pickle.dumps(_forked([functools.partial(target.emitted, module) for target in targets]))


def _forked(calls: Sequence[Callable[[], bytes]]) -> list[bytes]:
    """The result of each call in a copy of this process: nothing where it has ended early."""
    return [each() for each in [forked(call) for call in calls]]


def forked(call: Callable[[], bytes], most_s: float | None = None) -> Callable[[], bytes]:
    """Begin a call in a copy of this process, and return a function that waits for its result, at most so long [s] if
    that is given: nothing where the copy has ended early, or is ended then."""
    end, into = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of other threads, whose locks the call does not take
        copy = os.fork()
    if copy == 0:
        try:
            os.close(end)  # or else a result that nobody takes any more would wait in the pipe for ever
            with os.fdopen(into, "wb") as out:
                out.write(call())
            os._exit(0)
        finally:
            os._exit(1)
    os.close(into)

    def result() -> bytes:
        with os.fdopen(end, "rb") as of:
            if not select.select([of], [], [], most_s)[0]:
                os.kill(copy, signal.SIGKILL)
            found = of.read()
        return found if os.waitpid(copy, 0)[1] == 0 else b""  # a part of a result is none

    return result
