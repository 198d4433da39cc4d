"""The memory of the list of contacts: walls, pairs, and what is recorded of them."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...physics.carriers import CARRIER
from ...physics.pairs import PAIR
from ...physics.surfaces import SURFACE
from ...plant.contacts import Contacts
from ...stages.signals import Signal, contact_signals

_OF_CONTACT = ("stiffness", "damping", "friction", "tangential_stiffness", "tangential_damping")
_OF_PAIR = (
    *("surface", "capsule", "carrier", "ends_C", "radius", "layer_depth", "layer_stiffness"),
    *("bumper_stiffness", "bumper_damping"),
)
"""Settings; the other fields are states and forces, which go on if a setting changes during a run."""


class ContactList:
    """The records of a run's :class:`uvms_mj.plant.contacts.Contacts`.

    Attributes:
        surfaces, pairs: SURFACE and PAIR records.
        f_W: (n, 3) force of each pair on the vehicle in W [N].
        depths: (n,) [m].
        carriers: CARRIER records; none if B carries all contacts.
    """

    def __init__(self, setup: Any) -> None:
        n = len(setup.contacts.pairs)
        self.surfaces, self.pairs = np.zeros(len(setup.contacts.surfaces), SURFACE), np.zeros(n, PAIR)
        self.f_W, self.depths = np.zeros((n, 3)), np.zeros(n)
        self.carriers = self._carried(setup.contacts)
        self._tables: list[list[np.ndarray]] = []  # those of the start and of now

    @property
    def state(self) -> list[np.ndarray]:
        """The arrays that a reset restores."""
        listed = [self.surfaces, self.pairs, self.f_W, self.depths] if len(self.pairs) else []
        return [*listed, self.carriers] if len(self.carriers) else listed

    @property
    def reached(self) -> dict[str, np.ndarray]:
        """The arrays whose addresses are in the LOOP record, by their fields."""
        return {
            "surfaces_at": self.surfaces,
            "pairs_at": self.pairs,
            "f_pairs_at": self.f_W,
            "depths_at": self.depths,
            "carriers_at": self.carriers,
        }

    @staticmethod
    def _carried(contacts: Contacts) -> np.ndarray:
        carriers = contacts.carriers if not all(carrier.is_B for carrier in contacts.carriers) else ()
        records = np.zeros(len(carriers), CARRIER)
        for record, carrier in zip(records, carriers, strict=True):
            record["link"], record["p_LC"], record["R_LC"] = carrier.link + 1, carrier.p, carrier.R
            record["p_BC"], record["R_BC"] = carrier.p, carrier.R  # those on the base never change
        return records

    def write(self, loop: np.ndarray, context: np.ndarray, setup: Any) -> None:
        """Set the numbers of a scenario with as many walls and pairs."""
        context["carriers"] = len(self.carriers)
        if not setup.contacts.surfaces:
            return
        surfaces, pairs, tables = setup.contacts.records(setup.lightest)
        self.surfaces[:] = surfaces
        for name in _OF_PAIR:
            self.pairs[name] = pairs[name]
        for name in _OF_CONTACT:
            self.pairs["contact"][name] = pairs["contact"][name]
        self._tables = [*self._tables[:1], tables]
        loop["surfaces"], context["pairs"] = len(surfaces), len(pairs)

    def recorded(self, loop: np.ndarray) -> Iterator[tuple[Signal, np.ndarray]]:
        """The signals of the list, each with its memory; none without a pair."""
        if len(self.pairs):
            memory = (loop["push"], self.f_W, self.depths, loop["true"]["tau_contact_B"])
            yield from zip(contact_signals(len(self.depths)), memory, strict=True)
