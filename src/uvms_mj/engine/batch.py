"""``Batch``: many Simulations that are stepped together, on all cores."""

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from ..errors import Fault, InputError
from .native.many_runs import many_runs
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

    With the engine free_body and compiled stages, all steps of a thread are one call of machine code. Otherwise the
    Simulations of a thread step one after another.

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
        self._parts, self._places = _parts(memory), dict[tuple[str, ...], np.ndarray]()

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
        indices = which.tolist()
        if not indices:
            return found
        if all(self._simulations[i].all_native for i in indices):
            self._step_natively(n, which)
            stopped = self.read([STOP])[STOP][which] != 0
            for i in which[stopped].tolist():
                self._simulations[i].check()
                diverged = self._simulations[i].diverged
                assert diverged is not None
                found[i] = diverged
            return found

        def one_by_one(first: int, last: int) -> None:
            for i in indices[first:last]:
                try:
                    self._simulations[i].step(n)
                except Diverged as diverged:
                    found[i] = diverged

        self._share(len(indices), one_by_one)
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

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Signals of all Simulations by name, as arrays (n, ...) of their own."""
        key = tuple(names)
        places = self._places_of(key)
        table = np.empty((len(self), places.size))
        self._copy("gather", places, table)
        found, at = {}, 0
        for name in key:
            part = self._parts[name]
            found[name] = table[:, at : at + part.size].copy().view(part.kind).reshape(len(self), *part.shape)
            at += part.size
        return found

    def _places_of(self, names: tuple[str, ...]) -> np.ndarray:
        """The places of all numbers of some signals."""
        if names not in self._places:
            parts = [self._parts[name] for name in names]
            each = [np.arange(part.first, part.first + part.size) for part in parts]
            self._places[names] = np.concatenate(each) if each else np.zeros(0, int)
        return self._places[names]

    def write(self, command: str, values: np.ndarray, which: np.ndarray) -> None:
        """Set ``tau_cmd`` or ``u_cmd`` (k, ...) of k Simulations, where the caller of a Simulation sets it."""
        self._copy("scatter", self._places_of((command,)), np.ascontiguousarray(values, float), which)

    def _copy(self, way: str, places: np.ndarray, table: np.ndarray, which: np.ndarray | slice = slice(None)) -> None:
        runs = self._addresses[which]
        many_runs()[way].ctypes(runs.ctypes.data, len(runs), places.ctypes.data, places.size, table.ctypes.data)

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


def _parts(memory: RunMemory) -> dict[str, _Part]:
    """The signals by name, what the caller may command, and why the run has stopped."""
    stages = memory.stages
    own = {STOP: memory.run["stop"].reshape(()), "tau_cmd": stages.tau_cmd, "u_cmd": stages.u_cmd}
    arrays = memory.views() | own
    return {name: _Part(memory.image.place(array), array.shape, array.dtype.str) for name, array in arrays.items()}
