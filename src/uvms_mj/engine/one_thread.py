"""A Simulation is used by one thread at a time."""

import threading

from .base import Engine


class OneThread:
    """A context in which the engine is open and no other thread uses the Simulation.

    Raises:
        RuntimeError: the engine is closed, or another thread is in this context.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine, self._lock = engine, threading.RLock()

    def __enter__(self) -> None:
        if self._engine.closed:
            raise RuntimeError("the Simulation is closed; make a new one")
        if not self._lock.acquire(blocking=False):
            raise RuntimeError("another thread uses this Simulation at this moment; give each thread its own")

    def __exit__(self, *exception: object) -> None:
        self._lock.release()
