"""The signals of a Simulation between its steps."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..stages.words import no_signal


class Signals:
    """The signals of a Simulation by name: ``signals.nu``, ``signals["nu"]``.

    A scalar is a float. A vector is a live, read-only view: copy what you keep. Between steps the state, the
    measurements, the reference, the errors and the task are those of the instant in hand; tau_cmd, u, tau, nu_dot,
    f_contact_W and the running signals are those of the step before it.
    """

    def __init__(self, memories: Mapping[str, np.ndarray]) -> None:
        self.__dict__["_views"] = memories

    def __getitem__(self, name: str) -> Any:  # an array or a float
        try:
            return _value(self._views[name])
        except KeyError:
            raise KeyError(no_signal(name, self._views)) from None

    def __getattr__(self, name: str) -> Any:
        views = self.__dict__.get("_views", {})
        if name not in views:
            raise AttributeError(no_signal(name, views))
        return _value(views[name])

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"signals.{name} can't be assigned: signals are read-only")

    def __iter__(self) -> Iterator[str]:
        return iter(self._views)

    def __len__(self) -> int:
        return len(self._views)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._views]

    def __repr__(self) -> str:
        return f"<Signals {', '.join(self._views)}>"


def _value(view: np.ndarray) -> np.ndarray | float:
    return view if view.ndim else float(view)
