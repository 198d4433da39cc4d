"""The list of contacts in the record of a run: walls, pairs, and what is recorded of them."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...plant.contacts import Contacts
from ...stages.signals import Signal, contact_signals
from .image import Image

_OF_CONTACT = ("stiffness", "damping", "friction", "tangential_stiffness", "tangential_damping")
_OF_PAIR = (
    *("surface", "capsule", "carrier", "solved", "ends_C", "radius", "layer_depth", "layer_stiffness"),
    *("bumper_stiffness", "bumper_damping"),
)
"""Settings; the other fields are states and forces, which go on if a setting changes during a run."""


def place_carriers(run: np.ndarray, contacts: Contacts) -> None:
    """Set the places of the frames of contacts on their links."""
    for record, carrier in zip(run["carriers"][0], contacts.carriers, strict=True):
        record["link"], record["p_LC"], record["R_LC"] = carrier.link + 1, carrier.p, carrier.R
        record["p_BC"], record["R_BC"] = carrier.p, carrier.R  # those on the base never change


def write_contacts(image: Image, run: np.ndarray, setup: Any) -> None:
    """Set the numbers of a scenario with as many walls and pairs."""
    contacts = setup.contacts
    surfaces, pairs = contacts.records(setup.lightest, setup.mass_along_face)
    walls = ([("wall", contacts.paper)] if contacts.paper else []) + list(contacts.surfaces)
    for record, (key, wall) in zip(surfaces, walls, strict=True):
        if wall.motion:
            record["table"], record["rows"] = image.put(f"{key}.motion", np.array(wall.motion, float))
    run["surfaces"][0][: len(surfaces)] = surfaces
    own = run["pairs"][0][: len(pairs)]
    for name in _OF_PAIR:
        own[name] = pairs[name]
    for name in _OF_CONTACT:
        own["contact"][name] = pairs["contact"][name]
    run["surface_count"], run["pair_count"] = len(surfaces), len(pairs)


def recorded_contacts(run: np.ndarray, contacts: Contacts) -> Iterator[tuple[Signal, np.ndarray]]:
    """The signals of the contacts beside that of the probe and [wall], each with its memory; none without one."""
    n, first = len(contacts.pairs), int(contacts.paper is not None)
    if n:
        forces, depths = (run[name][0][first : first + n] for name in ("f_pairs", "depths"))
        memory = (run["push"], forces, depths, run["true"]["tau_springs_B"])
        yield from zip(contact_signals(n), memory, strict=True)
