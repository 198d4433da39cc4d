"""A vehicle with other coefficients of its base, by the names that its file gives them.

A name is a derivative of the base, such as ``X_udot``, ``Y_r`` or ``N_rr``, with the sign of the literature, or
``displaced_mass`` [kg], or ``center_of_buoyancy.x``, ``.y`` or ``.z`` [m], or a product of velocities that the file
has, such as ``Yuv`` or ``Yr|r|``. Added mass is symmetric: ``Y_rdot`` also sets ``N_vdot``, and is the same
coefficient.
"""

import dataclasses
import functools
import re
from collections.abc import Mapping

import numpy as np

from ..errors import Fault, InputError, suggestion
from .coefficients import DERIVATIVES, LARGEST
from .products import Product, product
from .vehicle import Vehicle

DISPLACED_MASS = "displaced_mass"
CENTRE = "center_of_buoyancy"
_CENTRES = {f"{CENTRE}.{axis}": i for i, axis in enumerate("xyz")}
_ROUNDING = 1e-9
_RIGID = re.compile(r"(vehicle\.)?(mass|inertia|I_?[xyz]{1,2}|center_of_gravity|r_g)(\W.*)?", re.IGNORECASE)
_NOT_RIGID = (
    "is not fitted: motions show mass and inertia with the added mass only. Weigh the vehicle, write mass, inertia and "
    "centre of gravity into its file, and free X_udot to N_rdot, or center_of_buoyancy"
)
_UNITS = {
    "M_A": (("kg", "kg m"), ("kg m", "kg m^2")),
    "D_linear": (("N s/m", "N s"), ("N s", "N m s")),
    "D_quadratic": (("N s^2/m^2", "N s^2"), ("N s^2/m", "N m s^2")),
}
"""Units by the halves of wrench and velocity."""
_PRODUCT_UNITS = ("N s^2/m^2", "N s^2/m", "N s^2", "N m s^2")
"""Units by the number of rotations among wrench and both velocities."""


@functools.cache
def places() -> Mapping[str, tuple[str, int, int]]:
    """Matrix, row and column of each derivative by its name."""
    return {str(names[i, j]): (whole, i, j) for whole, names in DERIVATIVES.items() for i in range(6) for j in range(6)}


def names() -> list[str]:
    """All names without products."""
    return [DISPLACED_MASS, *_CENTRES, *places()]


def unit_of(name: str) -> str:
    """The unit of a coefficient."""
    if (term := product(name)) is not None:
        return _PRODUCT_UNITS[sum(i // 3 for i in (term.axis, term.first, term.second))]
    if name in places():
        whole, i, j = places()[name]
        return _UNITS[whole][i // 3][j // 3]
    return "kg" if name == DISPLACED_MASS else "m"


def twin_of(name: str) -> str:
    """The other name of a coefficient of the added mass, or of a product: Yvu of Yuv; its own name for every other
    coefficient."""
    if (term := product(name)) is not None and not term.bars:
        return f"{name[0]}{name[2]}{name[1]}"
    whole, i, j = places().get(name, ("", 0, 0))
    return str(DERIVATIVES["M_A"][j, i]) if whole == "M_A" else name


def check_name(name: str, key: str) -> None:
    """Raise InputError, with the key where it stands, for a name that is no coefficient."""
    if _RIGID.fullmatch(name):
        raise InputError([Fault(key, f"{name!r} {_NOT_RIGID}")])
    if name not in names() and product(name) is None:
        raise InputError([Fault(key, f"{name!r} is no coefficient of a vehicle; {suggestion(name, names())}")])


def _place_of(vehicle: Vehicle, name: str) -> int | None:
    """The place of a product among the vehicle's; None for another coefficient. Raises InputError if it has none."""
    if (wanted := product(name)) is None:
        return None
    for k, each in enumerate(vehicle.products):
        if each.term == wanted.term:
            return k
    given = ", ".join(each.name for each in vehicle.products) or "none"
    wrong = f"the vehicle's file has no such product of velocities; it has {given}. Write it there, with 0"
    raise InputError([Fault(name, wrong)])


def value_of(vehicle: Vehicle, name: str) -> float:
    """The value of a coefficient, with the sign of the literature. Raises InputError for a product that it lacks."""
    if (k := _place_of(vehicle, name)) is not None:
        return vehicle.products[k].coefficient
    if name in places():
        whole, i, j = places()[name]
        return 0.0 - float(getattr(vehicle, whole)[i, j])
    return vehicle.displaced_mass if name == DISPLACED_MASS else float(vehicle.r_b[_CENTRES[name]])


def changed(vehicle: Vehicle, values: Mapping[str, float]) -> Vehicle:
    """The vehicle with other values of coefficients by name. Raises InputError for a vehicle that is not physical:
    added mass that is not positive semi-definite, an inertia M_RB + M_A that is not positive definite, damping that
    feeds energy into a single axis, or a negative displaced mass."""
    arrays = {name: getattr(vehicle, name).copy() for name in (*DERIVATIVES, "r_b")}
    displaced, products, faults = vehicle.displaced_mass, list[Product](vehicle.products), list[Fault]()
    for name, value in values.items():
        check_name(name, "coefficient")
        if not abs(value) <= LARGEST:
            faults.append(Fault(name, f"{value:g}: must be finite and at most {LARGEST:g}"))
        elif (k := _place_of(vehicle, name)) is not None:
            products[k] = dataclasses.replace(products[k], coefficient=float(value))
        elif name == DISPLACED_MASS:
            displaced = float(value)
        elif name in _CENTRES:
            arrays["r_b"][_CENTRES[name]] = value
        else:
            whole, i, j = places()[name]
            arrays[whole][i, j] = 0.0 - value
            if whole == "M_A":
                arrays[whole][j, i] = 0.0 - value
    M_A = arrays["M_A"]
    if not faults and (least := np.linalg.eigvalsh(M_A)[0]) < -_ROUNDING * np.abs(M_A).max():
        faults.append(Fault("M_A", f"is not positive semi-definite: its least eigenvalue is {least:g}"))
    if not faults and np.linalg.eigvalsh(vehicle.M_RB + M_A)[0] <= 0.0:
        faults.append(Fault("M_RB + M_A", "is not positive definite"))
    for whole in ("D_linear", "D_quadratic"):
        for i in np.flatnonzero(np.diag(arrays[whole]) < 0.0):
            wrong = f"{-arrays[whole][i, i]:g} is not dissipative: must not be positive"
            faults.append(Fault(str(DERIVATIVES[whole][i, i]), wrong))
    if displaced < 0.0:
        faults.append(Fault(DISPLACED_MASS, f"{displaced:g} kg: must not be negative"))
    if faults:
        raise InputError(faults, "coefficients")
    for array in arrays.values():
        array.setflags(write=False)
    return dataclasses.replace(vehicle, displaced_mass=displaced, products=tuple(products), **arrays)
