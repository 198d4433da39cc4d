"""``Batch``: many Simulations that are stepped together, on all cores."""

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from ..errors import Fault, InputError
from .native.loop import many_runs
from .native.run_memory import RunMemory
from .simulation import Diverged, Simulation

STOP = "stop"
"""Beside the signals, why a run has stopped: 0 if it has not."""
_WORTH_SHARING = 1000
"""Steps of all Simulations together from which on other threads are worth waking: some 0.2 ms of work."""


def cores() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Batch:
    """Simulations that are stepped together. Each has the numbers that it has alone, bit for bit, for any number of
    threads.

    With the engine free_body and compiled stages, all steps of a thread are one call of machine code. Otherwise, and
    while the first instants of a user's stage are compared with plain Python, the Simulations of a thread step one
    after another.

    Args:
        simulations: Simulations of one kind: the same stages, engine and vehicle. They belong to the batch from now
            on, but their owner resets them.
        threads: number of threads; default: one a core.

    Raises:
        InputError: ``threads`` is not a positive integer.
    """

    def __init__(self, simulations: Sequence[Simulation], threads: int | None = None) -> None:
        if threads is not None and (type(threads) is not int or threads < 1):
            raise InputError([Fault("threads", f"{threads!r}: must be a positive integer")])
        self._simulations = list(simulations)
        self._threads = min(threads or cores(), len(self._simulations))
        self._pool = ThreadPoolExecutor(self._threads - 1, "uvms-mj-batch") if self._threads > 1 else None
        for each in self._simulations:
            each.prepare()
        memory = self._simulations[0].memory
        self._addresses = np.array([each.memory.address for each in self._simulations], np.int64)
        self._all_at, self._native = self._addresses.ctypes.data, self._simulations[0].all_native
        self._parts, self._layouts = _parts(memory), dict[tuple[str, ...], _Layout]()

    @property
    def names(self) -> list[str]:
        """The names of the signals."""
        return list(self._simulations[0].signals)

    def __len__(self) -> int:
        return len(self._simulations)

    def __getitem__(self, i: int) -> Simulation:
        return self._simulations[i]

    def replace(self, i: int, simulation: Simulation) -> None:
        """Close a Simulation and put another one in its place. Raises InputError if it is of another kind."""
        simulation.prepare()
        memory = simulation.memory
        if _parts(memory) != self._parts or simulation.engine != self[i].engine:
            simulation.close()
            raise InputError("the runs of a batch have the same signals; these values need others")
        self._simulations[i].close()
        self._simulations[i], self._addresses[i] = simulation, memory.address

    def step(self, n: int, which: np.ndarray) -> dict[int, Diverged]:
        """Take n time steps in the Simulations of some indices. Returns the divergences by index.

        Raises:
            StageFault: a user's stage raised or violated its contract.
        """
        found: dict[int, Diverged] = {}
        if not len(which):
            return found
        if self._native and not any(self._simulations[i].compares for i in which[:1].tolist()):
            self._step_natively(n, which)
            stopped = self.read((STOP,))[STOP]
            for i in which[stopped[which] != 0].tolist() if stopped.any() else ():
                self._simulations[i].check()
                diverged = self._simulations[i].diverged
                assert diverged is not None
                found[i] = diverged
            return found

        indices = which.tolist()

        def one_by_one(first: int, last: int) -> None:
            for i in indices[first:last]:
                try:
                    self._simulations[i].step(n)
                except Diverged as diverged:
                    found[i] = diverged

        self._share(len(indices), one_by_one)
        self._native = self._native and all(each.all_native for each in self._simulations)
        return found

    def _step_natively(self, n: int, which: np.ndarray) -> None:
        memory, runs = self._simulations[0].memory, self._addresses[which]
        call, code = many_runs()["take_steps"].ctypes, memory.code
        given = n, code["free_steps"].address, code["advance"].address, memory.stages.control

        def together(first: int, last: int) -> None:
            call(runs.ctypes.data, first, last, *given)

        if n * len(runs) < _WORTH_SHARING:
            together(0, len(runs))
        else:
            self._share(len(runs), together)

    def _share(self, n: int, work: Callable[[int, int], None]) -> None:
        """Share n pieces of work among the threads, by their first index and their last one. This thread does the first
        part."""
        edges = [n * k // self._threads for k in range(self._threads + 1)]
        others: list[Future] = []
        if self._pool is not None:
            others = [self._pool.submit(work, edges[k], edges[k + 1]) for k in range(1, self._threads)]
        try:
            work(edges[0], edges[1])
        finally:
            for other in others:
                other.result()

    def read(self, names: tuple[str, ...]) -> dict[str, np.ndarray]:
        """Signals of all Simulations by name, as arrays (n, ...) of their own."""
        layout, n = self._layout(names), len(self._simulations)
        many_runs()["gather"].ctypes(self._all_at, n, layout.places_at, layout.places.size, layout.table_at)
        table = layout.table
        return {
            name: table[:, first:end].copy().view(kind).reshape(n, *shape)
            for name, first, end, shape, kind in layout.parts
        }

    def write(self, command: str, values: np.ndarray, which: np.ndarray) -> None:
        """Set ``tau_cmd`` or ``u_cmd`` (k, ...) of k Simulations, where the caller of a Simulation sets it."""
        layout, runs = self._layout((command,)), self._addresses[which]
        table = np.ascontiguousarray(values, float)
        given = runs.ctypes.data, len(runs), layout.places_at, layout.places.size, table.ctypes.data
        many_runs()["scatter"].ctypes(*given)

    def _layout(self, names: tuple[str, ...]) -> "_Layout":
        if names not in self._layouts:
            self._layouts[names] = _Layout([(name, self._parts[name]) for name in names], len(self))
        return self._layouts[names]

    def close(self) -> None:
        """Close all Simulations, and end the threads."""
        if self._pool is not None:
            self._pool.shutdown()
        for simulation in self._simulations:
            simulation.close()


@dataclass(frozen=True)
class _Part:
    """Where an array is in the memory of a run: its first number, its shape and its kind."""

    first: int
    shape: tuple[int, ...]
    kind: str

    @property
    def size(self) -> int:
        return math.prod(self.shape)


class _Layout:
    """Parts of a run one after another, as the columns of a table with one row a run."""

    def __init__(self, named: Sequence[tuple[str, _Part]], n: int) -> None:
        ends = np.cumsum([part.size for _, part in named]).tolist()
        self.parts = [
            (name, end - part.size, end, part.shape, part.kind) for (name, part), end in zip(named, ends, strict=True)
        ]
        places = [np.arange(part.first, part.first + part.size) for _, part in named]
        self.places = np.concatenate(places) if places else np.zeros(0, np.int64)
        self.table = np.zeros((n, self.places.size))
        self.places_at, self.table_at = self.places.ctypes.data, self.table.ctypes.data


def _parts(memory: RunMemory) -> dict[str, _Part]:
    """The signals by name, what the caller may command, and why the run has stopped."""
    stages = memory.stages
    own = {STOP: memory.run["stop"].reshape(()), "tau_cmd": stages.tau_cmd, "u_cmd": stages.u_cmd}
    arrays = memory.views() | own
    return {name: _Part(memory.image.place(array), array.shape, array.dtype.str) for name, array in arrays.items()}
