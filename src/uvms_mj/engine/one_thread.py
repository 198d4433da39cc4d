"""A Simulation is used by one thread at a time."""

import threading

from .native.attachment import Attachment


class OneThread:
    """A context in which the vehicle is attached and no other thread uses the Simulation.

    Raises:
        RuntimeError: the vehicle is detached, or another thread is in this context.
    """

    def __init__(self, attachment: Attachment) -> None:
        self._attachment, self._lock = attachment, threading.RLock()

    def __enter__(self) -> None:
        if self._attachment.detached:
            raise RuntimeError("the Simulation is closed; make a new one")
        if not self._lock.acquire(blocking=False):
            raise RuntimeError("another thread uses this Simulation at this moment; give each thread its own")

    def __exit__(self, *exception: object) -> None:
        self._lock.release()
