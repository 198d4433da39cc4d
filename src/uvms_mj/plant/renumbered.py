"""A copy of a vehicle's file with other coefficients of its base, and with texts that say where they come from."""

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import Fault, InputError
from .changed_coefficients import CENTRE, DISPLACED_MASS, changed, places, twin_of
from .coefficients import DERIVATIVES
from .mjcf import Mjcf, parsed
from .own_vehicle import copied
from .products import NAME, product

_FIXED = "its file gives coefficients in a way that this copy can't change"
_EXACT = 1e-12
"""Largest difference, relative to the largest entry, between the copy as it is read and the wanted numbers."""


def renumbered(
    origin: str, path: Path, name: str, values: Mapping[str, float], texts: Mapping[str, str]
) -> dict[str, bytes]:
    """The files of a copy of a vehicle under another name, the main one ``NAME.xml`` first, with other coefficients.

    Args:
        origin: the original, for the texts of the copy.
        path: the vehicle's file.
        name: of the copy, of its body and of its file.
        values: the new values by the names of :mod:`.changed_coefficients`.
        texts: ``<text>`` entries by name, each in place of the original's.

    Raises:
        InputError: the vehicle can't be read or copied, the new one is not physical, or the copy would not have the
            values, because the file gives a coefficient where this can't change it.
    """
    wanted = changed(Mjcf.find(str(path)).vehicle, values)
    files = copied(origin, path, name, (), "")
    main = f"{name}.xml"
    trees = {each: parsed(each, data, comments=True) for each, data in files.items() if data.lstrip()[:1] == b"<"}
    custom = trees[main].find("custom")
    custom = ElementTree.SubElement(trees[main], "custom") if custom is None else custom
    numerics = {e.get("name"): e for tree in trees.values() for e in tree.iter("numeric")}
    matrices = {whole: getattr(wanted, whole) for whole in DERIVATIVES}
    for each, value in values.items():
        if each in places():
            whole = places()[each][0]
            if whole in numerics:
                _set(custom, numerics, whole, matrices[whole].ravel().tolist())
                continue
            for twin in {each, twin_of(each)}:
                if twin == each or twin in numerics:
                    _set(custom, numerics, twin, [value])
        elif product(each) is not None:
            texts = {**texts, NAME: " ".join(f"{p.name} {p.coefficient:.17g}" for p in wanted.products)}
        elif each == DISPLACED_MASS:
            _set(custom, numerics, each, [value])
        else:
            _set(custom, numerics, CENTRE, wanted.r_b.tolist())
    written = {e.get("name"): e for tree in trees.values() for e in tree.iter("text")}
    for key, text in texts.items():
        if key in written:
            written[key].set("data", text)
        else:
            _entry(custom, "text", key, text)
    prolog = files[main].decode().partition("<mujoco")[0]
    for each, tree in trees.items():
        files[each] = ElementTree.tostring(tree)
    files[main] = prolog.encode() + files[main] + b"\n"
    read = Mjcf(main, files).vehicle
    for each in (*DERIVATIVES, "r_b", "M_RB"):
        ours, theirs = getattr(wanted, each), getattr(read, each)
        if np.abs(ours - theirs).max() > _EXACT * max(np.abs(ours).max(), 1e-3):
            raise InputError([Fault(each, _FIXED)], origin)
    if read.products != wanted.products:
        raise InputError([Fault(NAME, _FIXED)], origin)
    return files


def _set(custom: Element, numerics: dict[str | None, Element], name: str, numbers: list[float]) -> None:
    """Give a ``<numeric>`` other numbers; one that is missing is added."""
    data = " ".join(f"{x:.17g}" if x else "0" for x in numbers)
    if name in numerics:
        numerics[name].set("data", data)
        numerics[name].attrib.pop("size", None)
    else:
        numerics[name] = _entry(custom, "numeric", name, data)


def _entry(custom: Element, tag: str, name: str, data: str) -> Element:
    """A new entry at the end of ``<custom>``, on a line of its own."""
    entry = ElementTree.SubElement(custom, tag, {"name": name, "data": data})
    entry.tail = "\n    "
    return entry
