"""The numbers of a vehicle in a program of PythonVehicleSimulator or MSS, by the names that both projects use.

The axes of both projects are forward, right, down about CO (Fossen, Handbook of Marine Craft Hydrodynamics and Motion
Control, 2021); derivatives are negative, MA and D positive, inertia about CG.
"""

import re
from collections.abc import Sequence

import numpy as np

from ...errors import Fault, InputError
from ..coefficients import DERIVATIVES
from ..record import VehicleRecord
from .assignments import Numbers, matlab, python
from .reading import Source
from .table import Table, record_of, validated

_LONGEST = 100_000
"""Bound on the text of a program [characters]."""
_RESTORING = re.compile(r"(self\.)?(G|G_?[1-6][1-6])")
"""Names of the matrix of restoring forces, and of its entries."""
_MISSING = {
    "mass": "the mass (m, mass, or W with g)",
    "displaced_mass": "the buoyancy (W and B, or volume or nabla with rho)",
    "cg": "the centre of gravity (r_bg, or xG, yG, zG)",
    "cb": "the centre of buoyancy (r_bb, or xB, yB, zB)",
    "inertia": "the inertia (Ig or I_o, or Ix, Iy, Iz)",
    "added_mass": "the added mass (MA or M_A, or Xudot, Yvdot, Zwdot, Kpdot, Mqdot, Nrdot)",
}


class _Quantities:
    """Numbers by the names that both projects use."""

    def __init__(self, numbers: Numbers) -> None:
        self.numbers = numbers
        self.faults: list[Fault] = []

    def all_of(self, *names: str, size: int = 1, needed: bool = True) -> list[np.ndarray]:
        """The numbers of names that have the size; a needed name without its number is a fault."""
        found = list[np.ndarray]()
        for each in (name for bare in names for name in (bare, f"self.{bare}") if name in self.numbers.found):
            value = self.numbers.found[each]
            if value is None and needed:
                self.faults.append(Fault(each, "is no plain number or matrix, or is changed in a branch or an entry"))
            elif value is not None and np.size(value) == size:
                self.numbers.used.add(each)
                found.append(np.array(value, float).reshape({1: (), 3: 3, 9: (3, 3), 36: (6, 6)}[size]))
        return found

    def one(self, *names: str, size: int = 1, needed: bool = True) -> np.ndarray | None:
        """The number of names that mean the same; None if there is none. It is a fault if they differ."""
        return self.same(" and ".join(names), self.all_of(*names, size=size, needed=needed))

    def same(self, place: str, found: Sequence[np.ndarray]) -> np.ndarray | None:
        if any(not np.allclose(each, found[0], rtol=1e-6, atol=0.0) for each in found):
            values = " and ".join(dict.fromkeys(f"{each:g}" if not each.ndim else "a matrix" for each in found))
            self.faults.append(Fault(place, f"differ in the file, {values}, where one number is needed"))
        return found[0] if found else None

    def derivatives(self, name: str) -> np.ndarray | None:
        """Minus the derivatives (6, 6), as X_udot is Xudot there; None if there is none."""
        found, some = np.zeros((6, 6)), False
        for (i, j), bare in np.ndenumerate(np.char.replace(DERIVATIVES[name], "_", "")):
            if (i == j or name != "D_quadratic") and (value := self.one(str(bare))) is not None:
                found[i, j], some = -value, True
        return found if some else None


def described(source: Source, text: str) -> VehicleRecord:
    """The vehicle of a program. Raises InputError that lists what is missing."""
    if len(text) > _LONGEST:
        raise source.fault("", f"is longer than {_LONGEST} characters: copy its numbers into a table, NAME.toml")
    numbers = (matlab if source.path.suffix.lower() == ".m" else python)(source, text)
    given = _Quantities(numbers)
    W, B, g = (given.one(each, needed=False) for each in "WBg")
    masses = given.all_of("mass", "m", "m_total")
    by_weight = [each for each in masses if W is not None and g is not None and np.isclose(each, W / g, rtol=1e-6)]
    mass = given.same("mass and m and m_total", by_weight or masses)
    if mass is None and W is not None and g is not None:
        mass = W / g
    volume, rho = given.one("volume", "nabla", "vol", needed=False), given.one("rho", needed=False)
    lifts = [mass * (B / W)] if W and B is not None and mass is not None else []
    if W and lifts and not 0.5 < B / W < 2.0:
        given.faults.append(Fault("B", f"is {B:g} and W is {W:g}: B is no buoyancy"))
    lifts += [rho * volume] if volume is not None and rho is not None else []
    places = {}
    for key, names, (x, y, z) in (
        ("cg", ("r_bg", "r_bG", "r_g"), ("xG", "yG", "zG")),
        ("cb", ("r_bb", "r_bB", "r_b"), ("xB", "yB", "zB")),
    ):
        three = [given.one(each, each.lower()) for each in (x, y, z)]
        whole = given.all_of(*names, size=3) + ([np.array(three, float)] if None not in three else [])
        places[key] = given.same(", ".join(names), whole)
    about = "cg"
    inertia = given.one("Ig", "I_g", size=9)
    if inertia is None and (inertia := given.one("Io", "I_o", size=9)) is not None:
        about = "origin"
    diagonal = [given.one(*pair) for pair in (("Ix", "Ixx"), ("Iy", "Iyy"), ("Iz", "Izz"))]
    if inertia is None and None not in diagonal:
        xy, xz, yz = (-(given.one(each) or 0.0) for each in ("Ixy", "Ixz", "Iyz"))
        xx, yy, zz = diagonal
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], float)
    if inertia is not None and not np.allclose(inertia, inertia.T, rtol=1e-9):
        given.faults.append(Fault("inertia", "is not symmetric"))
    M_A, by_names = given.one("MA", "M_A", size=36), given.derivatives("M_A")
    damping = {"D_linear": given.one("D", size=36, needed=False), "D_quadratic": None}
    units = M_A is None or by_names is None or np.allclose(M_A, by_names, rtol=1e-6)
    if units:
        damping = {name: given.derivatives(name) if each is None else each for name, each in damping.items()}
    else:
        source.say("the derivatives are in other units than MA (dimensionless): MA is read, and no derivative")
    M_A = by_names if M_A is None else M_A
    displaced = given.same("buoyancy, W B and rho volume", lifts)
    values = {"mass": mass, "displaced_mass": displaced, **places, "inertia": inertia, "added_mass": M_A}
    missing = [_MISSING[key] for key, value in values.items() if value is None]
    if by_names is not None and M_A is by_names:
        bare = [str(each).replace("_", "") for each in np.diag(DERIVATIVES["M_A"])]
        missing += [each for each in bare if not {each, f"self.{each}"} & {*numbers.found}]
        if displaced is not None and (np.abs(np.diag(M_A)[:3]) < 0.01 * displaced).all():
            given.faults.append(
                Fault("Xudot", f"below 1 % of {displaced:g} kg, as Yvdot and Zwdot: are they dimensionless?")
            )
    if missing or given.faults:
        lacks = f"lacks {', '.join(missing)}; " if missing else ""
        way = "a program is read and not executed: copy its numbers into a table, NAME.toml"
        raise InputError([*dict.fromkeys(given.faults), Fault("", lacks + way)], str(source.path))
    assert mass is not None
    assert displaced is not None
    assert inertia is not None
    assert M_A is not None
    _say(source, numbers)
    i, j = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    body = {"mass": float(mass), "displaced_mass": float(displaced), "inertia": inertia[i, j].tolist()}
    body |= {"inertia_about": about, "products_of_inertia": "matrix"}
    body |= {key: each.tolist() for key, each in places.items() if each is not None}
    tables = {"frame": "ned", "about": "origin", "signs": "matrices", "body": body}
    tables["added_mass"] = {"matrix": M_A.tolist()}
    for key, name in (("linear_damping", "D_linear"), ("quadratic_damping", "D_quadratic")):
        if (matrix := damping[name]) is not None:
            tables[key] = {"matrix": matrix.tolist()}
    return record_of(source, validated(source, Table, tables))


def _say(source: Source, numbers: Numbers) -> None:
    source.say(
        "read as forward, right, down about CO, in SI: inertia Ig, Ix, Iy, Iz about CG and Ixy the integral of x y dm, "
        "derivatives negative, MA and D positive, Xuu on abs(u) u"
    )
    source.say("forces that the program computes are not read: fins, propellers, cross-flow, time constants of damping")
    for name, value in numbers.found.items():
        if _RESTORING.fullmatch(name):
            source.say(
                "the restoring G of a surface vessel is left out: here all of the vehicle is under water, where weight "
                "and buoyancy alone restore it",
                name,
            )
        elif value is None:
            source.say("not read: no plain number or matrix", name)
        elif name not in numbers.used:
            source.say("a number for which there is no place here", name)
    for place in sorted(numbers.skipped, key=lambda each: int(each.split()[1])):
        source.say("not executed: a branch, a loop, a call or an entry", place)
