"""The static force of the list of contacts, for the balance of a vehicle at rest."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..physics.pairs import pair_force


class Springs:
    """The walls and bumpers of a run's :class:`uvms_mj.plant.contacts.Contacts` at rest, without dampers and friction.

    Attributes:
        scale: factor of the forces, for a solution by continuation.
        friction: whether each contact has friction.
        depths: (n,) depth of each contact at the latest pose [m].
    """

    def __init__(self, setup: Any) -> None:
        surfaces, pairs, self._tables = setup.contacts.records(lambda _: 1.0)
        self.friction = pairs["contact"]["friction"] > 0.0
        for name in ("damping", "friction"):
            pairs["contact"][name] = 0.0
        pairs["bumper_damping"] = 0.0
        self._surfaces, self._pairs = surfaces.view(np.recarray), pairs.view(np.recarray)
        self.scale, self.depths = 1.0, np.zeros(len(pairs))

    @property
    def scales(self) -> tuple[float, ...]:
        """Factors of the forces by which the set of contacts at rest is found; the last is one."""
        return (1e-2, 0.1, 1.0) if len(self) else (1.0,)

    def __len__(self) -> int:
        return len(self._pairs)

    def wrench(self, position: np.ndarray, R_WB: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The wrench (6,) on a vehicle whose contact bodies are fixed to B, in B at its origin, and the normal force
        (n,) of each contact."""
        wrenches, normal = self.wrenches([(position, R_WB)])
        return wrenches[0], normal

    def wrenches(self, poses: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
        """The wrench (m, 6) on each carrier in its frame at its origin, for their positions (3,) and attitudes (3, 3)
        in W, and the normal force (n,) of each contact."""
        total, normal, nu = np.zeros((len(poses), 6)), np.zeros(len(self)), np.zeros(6)
        for i, pair in enumerate(self._pairs):
            p_WC, R_WC = poses[pair.carrier]
            pair_force(pair, self._surfaces[pair.surface], p_WC, R_WC, nu, 1.0)
            total[pair.carrier] += pair.contact.tau_B
            normal[i], self.depths[i] = pair.f_n, pair.depth
        return self.scale * total, self.scale * normal
