"""Pictures of environments, as :func:`uvms_mj.still` draws them of a run."""

import atexit
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..engine.simulation import Simulation
from ..engine.vehicle_run import header_of
from ..errors import Fault, InputError
from ..views.video import LivePictures
from ..views.video.underwater import view_of
from .domain import numbers

SIZE = (640, 360)
"""Width and height of a picture in pixels, if none is given."""
MODES = ("rgb_array",)
"""Gymnasium's render modes that there are. It makes ``human`` (with pygame) and ``rgb_array_list`` of these."""
LONGEST = 3.0
"""Force of the longest arrow, in demanded forces."""


def checked_mode(given: Any) -> str | None:
    """A render mode, or None for no pictures. Raises InputError for another one."""
    if given is not None and given not in MODES:
        hint = "; gymnasium.make opens a window for it, which needs pygame" if given == "human" else ""
        raise InputError([Fault("render_mode", f"{given!r}: must be 'rgb_array' or None{hint}")])
    return given


class Pictures:
    """Pictures of several runs. A run has a scene of its own, which is made at the first picture of an episode.

    Args:
        size: width and height in pixels, even numbers.
        view: a view of ``uvms-mj video``.

    Raises:
        InputError: ``size`` is not two numbers, or there is no such view.
    """

    def __init__(self, size: Any = SIZE, view: Any = "overview") -> None:
        found = numbers(size)
        if found.shape != (2,) or not np.isfinite(found).all():
            raise InputError([Fault("render_size", f"{size!r}: must be a width and a height in pixels")])
        if not isinstance(view, str):
            raise InputError([Fault("render_view", f"{view!r}: must be the name of a view of uvms-mj video")])
        self._size, self._view = (int(found[0]), int(found[1])), view_of(view)
        self._kept: dict[int, tuple[int, LivePictures]] = {}

    def of(self, i: int, episode: int, sim: Simulation, force_d: float) -> np.ndarray:
        """The picture (height, width, 3), uint8, of run i at the instant in hand; its force is of the step before.

        Raises:
            InputError: no driver draws without a window, or the size is not possible.
        """
        row = _row(sim)
        made, pictures = self._kept.get(i, (None, None))
        if pictures is None or made != episode:
            if pictures is not None:
                pictures.close()
            given = {"view": self._view, "size": self._size, "largest": LONGEST * force_d}
            pictures = LivePictures(header_of(sim), np.stack([row, row]), **given)
            if not self._kept:
                atexit.register(_close, weakref.ref(self))  # after the driver's own, so that it is called before
            self._kept[i] = episode, pictures
        return pictures.of(row)

    def close(self) -> None:
        for _, pictures in self._kept.values():
            pictures.close()
        self._kept.clear()


def _close(pictures: "weakref.ref[Pictures]") -> None:
    """Close the pictures of an environment that nobody has closed."""
    if (found := pictures()) is not None:
        found.close()


def _row(sim: Simulation) -> np.ndarray:
    """(width,) what a run records, at the instant in hand."""
    signals = sim.signals
    parts: Sequence[np.ndarray] = [np.ravel(signals[signal.name]) for signal in sim.recorded]
    return np.concatenate(parts)
