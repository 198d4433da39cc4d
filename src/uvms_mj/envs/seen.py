"""What a reward or an observation of one's own is given."""

from collections.abc import Callable, Mapping

import numpy as np

from ..engine.batch import Batch
from ..errors import suggestion


class Seen:
    """All n environments at the end of a control step, for a reward or an observation of one's own. A single
    environment is n = 1, so that one function serves both.

    Attributes:
        force_d: (n,) desired pushing force [N].
        action: (n, m) action of the step, cut to -1 and 1; zero at a reset.
        force: (n,) mean pushing force of the step [N]; zero at a reset.
        effort_rate: (n, 6) mean square of tau during the step [N^2, N^2 m^2]; zero at a reset.

    A signal by its name is an array (n, ...): ``seen.nu``, ``seen["nu"]``. Functions of each number give the same bits
    for any n; products of matrices may differ by rounding.
    """

    def __init__(
        self, batch: Batch, force_d: np.ndarray, action: np.ndarray, force: np.ndarray, effort_rate: np.ndarray
    ) -> None:
        self._batch = batch
        self.force_d, self.action, self.force, self.effort_rate = force_d, action, force, effort_rate

    def __getitem__(self, name: str) -> np.ndarray:
        return self._batch.read((name,))[name]

    def __getattr__(self, name: str) -> np.ndarray:
        if name.startswith("_") or name not in self._batch.names:
            raise AttributeError(f"no signal {name!r}; {suggestion(name, self._batch.names)}")
        return self[name]


Observe = Callable[[Seen], np.ndarray | Mapping[str, np.ndarray]]
Reward = Callable[[Seen], np.ndarray]
