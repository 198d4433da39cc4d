"""Products of velocities in a vehicle's MJCF: one ``<text name="products">`` of names and coefficients.

A name is an axis X Y Z K M N and two of the velocities u v w p q r, one of them perhaps between bars: ``Yuv -28.6``
adds -28.6 u v to the force along y, and ``Yr|r| 0.632`` adds 0.632 r abs(r). They are hydrodynamic derivatives of the
right-hand side, as in SNAME (1950) and Fossen (2021), in the axes of B: forward, left, up. The velocities are relative
to the water.
"""

import dataclasses
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from ..errors import Fault
from .coefficients import LARGEST, misspelt

NAME = "products"
_WRENCHES, _VELOCITIES = "XYZKMN", "uvwpqr"
_TERM = re.compile(r"([XYZKMN])(\|[uvwpqr]\||[uvwpqr])(\|[uvwpqr]\||[uvwpqr])")
_FORM = "an axis X Y Z K M N and two of u v w p q r, one of them perhaps between bars, as Yuv, Yr|r| or N|u|v"


@dataclass(frozen=True)
class Product:
    """One product: the coefficient times the first velocity times the second or its magnitude, on an axis. Axis and
    velocities are indices of tau and nu."""

    name: str
    axis: int
    first: int
    second: int
    bars: bool
    coefficient: float

    @property
    def record(self) -> tuple:
        """The numbers of :data:`uvms_mj.physics.effects.PRODUCT`."""
        return self.axis, self.first, self.second, self.bars, self.coefficient

    @property
    def term(self) -> tuple[int, int, int, bool]:
        """The velocities that it multiplies, the same for Yuv and Yvu."""
        first, second = (self.first, self.second) if self.bars else sorted((self.first, self.second))
        return self.axis, first, second, self.bars


def product(name: str) -> Product | None:
    """The product of a name, with the coefficient 0; None if it is no name of a product."""
    match = _TERM.fullmatch(name)
    if match is None or min(map(len, match.groups()[1:])) > 1:
        return None
    first, second = sorted(match.groups()[1:], key=len)  # bars behind
    i, j = (_VELOCITIES.index(each.strip("|")) for each in (first, second))
    return Product(name, _WRENCHES.index(match[1]), i, j, len(second) > 1, 0.0)


def read_products(
    model: mujoco.MjModel, base: int, prefix: str, D_quadratic: np.ndarray, faults: list[Fault], alone: bool = False
) -> tuple[Product, ...]:
    """The products of a vehicle on the body ``base`` whose entries have a prefix. Errors are appended to ``faults``:
    entries of links, unknown names, names or terms that occur twice, also in D_quadratic (6, 6), and numbers that are
    not finite. ``alone`` says that the model consists of the vehicle."""
    found: list[Product] = []
    bodies = {model.body(i).name for i in np.flatnonzero(model.body_rootid == base)}
    for name, data in _texts(model):
        owner, _, entry = name.rpartition(".")
        if name == prefix + NAME:
            found = [*_parsed(name, data, faults)]
        elif entry == NAME and (alone or owner in bodies):
            faults.append(Fault(name, f"products of velocities are known for the base only, as <text name={NAME!r}>"))
        elif alone and (wrong := misspelt(name.removeprefix(prefix), frozenset([NAME]))):
            faults.append(Fault(name, wrong))
    for k, product in enumerate(found):
        before = next((each.name for each in found[:k] if each.term == product.term), "")
        i, j = product.axis, product.first
        if before:
            faults.append(Fault(f"{prefix}{NAME} {product.name}", f"is given twice, before as {before}"))
        elif product.bars and product.second == j and D_quadratic[i, j]:
            derivative = f"{_WRENCHES[i]}_{_VELOCITIES[j] * 2}"
            wrong = f"is given twice, as {derivative} of D_quadratic too; take one of them out"
            faults.append(Fault(f"{prefix}{NAME} {product.name}", wrong))
    return tuple(found)


def _texts(model: mujoco.MjModel) -> Iterator[tuple[str, str]]:
    """The names and the data of the ``<text>`` entries."""
    for i in range(model.ntext):
        at, size = model.text_adr[i], model.text_size[i]
        yield (
            mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TEXT, i),
            bytes(model.text_data[at : at + size]).split(b"\0")[0].decode(errors="replace"),
        )


def _parsed(name: str, data: str, faults: list[Fault]) -> Iterator[Product]:
    words = data.split()
    if len(words) % 2:
        faults.append(Fault(name, f"has {len(words)} words: a name and a number by turns are needed"))
        return
    for term, number in zip(words[::2], words[1::2], strict=True):
        if (found := product(term)) is None:
            faults.append(Fault(f"{name} {term}", f"is no product of velocities: {_FORM}"))
            continue
        try:
            coefficient = float(number)
        except ValueError:
            coefficient = math.nan
        if not abs(coefficient) <= LARGEST:
            faults.append(Fault(f"{name} {term}", f"{number}: must be a finite number, at most {LARGEST:g}"))
            continue
        yield dataclasses.replace(found, coefficient=coefficient)
