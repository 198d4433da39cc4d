"""A vehicle in a plain table, TOML or CSV, whose conventions are said in it.

A publication's numbers are copied as they stand, with the axes, the points and the signs that they have there:

===================  =========================================================================================
``frame``            "flu": x forward, y left, z up; "ned": x forward, y right, z down
``about``            the point of added mass, damping and products: "origin", "cg", or three coordinates
``signs``            "derivatives": negative for added mass and damping; "matrices": positive
``origin``           where B's origin shall be: "origin" of the table, or "cg"
===================  =========================================================================================

A CSV file has the same keys in a column ``key`` and their values in ``value``, as ``body.mass, 13.5``.
"""

import csv
import io
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass
from scipy.optimize import nnls

from ...errors import Fault, InputError, faults_of, suggestion
from ...files import parsed_toml
from ...quantities import STRICT, Positive, Real
from ..coefficients import DENSITY, DERIVATIVES
from ..geometry import Shape
from ..own_vehicle import FORCES, Thruster
from ..products import _TERM  # the form of a product's name
from ..record import PartRecord, VehicleRecord, word
from ..vehicle import AXES
from .bodies import possible, right_signs, symmetric
from .moving import NED, Pose, about_cg, mirrored, mirrored_products, moved, product_name
from .reading import Source

Three = Annotated[tuple[Real, ...], Field(min_length=3, max_length=3)]
Six = Annotated[tuple[Real, ...], Field(min_length=3, max_length=6)]
Frame = Literal["flu", "ned"]


@dataclass(frozen=True, config=STRICT)
class Body:
    """Mass and buoyancy, in the axes of the table, from its origin.

    Attributes:
        mass: [kg].
        inertia: Ixx Iyy Izz, or with Ixy Ixz Iyz [kg m^2].
        cg, cb: centres of gravity and of buoyancy [m].
        displaced_mass: [kg]; or volume [m^3] with density [kg/m^3].
        inertia_about: "cg" or "origin".
        products_of_inertia: "matrix": Ixy is the entry of the matrix; "integral": it is the integral of x y dm.
        size: length, width and height of a box that is drawn [m].
    """

    mass: Positive
    inertia: Six
    inertia_about: Literal["cg", "origin"] = "cg"
    products_of_inertia: Literal["matrix", "integral"] | None = None
    cg: Three = (0.0, 0.0, 0.0)
    cb: Three = (0.0, 0.0, 0.0)
    displaced_mass: Positive | None = None
    volume: Positive | None = None
    density: Positive = DENSITY
    size: Three | None = None

    def __post_init__(self) -> None:
        if (self.displaced_mass is None) == (self.volume is None):
            raise ValueError("give one of displaced_mass [kg] and volume [m^3]")
        if len(self.inertia) not in (3, 6):
            raise ValueError("inertia has 3 numbers, Ixx Iyy Izz, or 6, with Ixy Ixz Iyz")
        if len(self.inertia) == 6 and any(self.inertia[3:]) and self.products_of_inertia is None:
            raise ValueError('say products_of_inertia = "matrix" or "integral": they have opposite signs')
        if self.size is not None and min(self.size) <= 0.0:
            raise ValueError("size must be positive")

    def matrix(self) -> np.ndarray:
        """Inertia (3, 3) about the point of ``inertia_about`` [kg m^2], in the axes of the table."""
        return _inertia(self.inertia, self.products_of_inertia)


@dataclass(frozen=True, config=STRICT)
class ThrusterTable:
    """A thruster in the axes of the table: position [m], direction of positive thrust, and limits [N]."""

    name: str
    position: Three
    direction: Three
    min: Real | None = None
    max: Real | None = None

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[A-Za-z]\w{0,63}", self.name, re.ASCII):
            raise ValueError(f"name {self.name!r} must be a word of letters, digits and _ that begins with a letter")
        if np.linalg.norm(self.direction) < 1e-6:
            raise ValueError("direction has no length")
        if (self.min is None) != (self.max is None):
            raise ValueError("give both limits, min and max, or neither")
        if self.min is not None and self.max is not None and not self.min < self.max:
            raise ValueError(f"the least thrust, {self.min:g} N, must be below the greatest, {self.max:g} N")


_Coefficients = dict[str, Real | list[list[Real]]]


@dataclass(frozen=True, config=STRICT)
class Table:
    """A whole table; the keys are explained above."""

    frame: Frame
    about: Literal["origin", "cg"] | Three
    signs: Literal["derivatives", "matrices"]
    body: Body
    added_mass: _Coefficients
    linear_damping: _Coefficients = Field(default_factory=dict)
    quadratic_damping: _Coefficients = Field(default_factory=dict)
    products: dict[str, Real] = Field(default_factory=dict)
    thrusters: tuple[ThrusterTable, ...] = ()
    origin: Literal["origin", "cg"] = "origin"
    name: str = ""
    description: str = ""
    source: str = ""
    licence: str = ""
    trust: str = ""


@dataclass(frozen=True, config=STRICT)
class MassReport:
    """The mass properties that a CAD program prints, in its own axes and units.

    Attributes:
        frame: as in a table: "flu" or "ned".
        mass, cg, inertia: in the units of ``mass_unit`` and ``length_unit``; inertia in their product.
    """

    frame: Frame
    mass: Positive
    cg: Three
    inertia: Annotated[tuple[Real, ...], Field(min_length=6, max_length=6)]
    inertia_about: Literal["cg", "origin"]
    products_of_inertia: Literal["matrix", "integral"]
    mass_unit: Literal["kg", "g", "lb"] = "kg"
    length_unit: Literal["m", "cm", "mm", "in"] = "m"

    def in_B(self) -> tuple[float, np.ndarray, np.ndarray]:
        """Mass [kg], centre of gravity (3,) [m] and inertia (3, 3) about it [kg m^2], in B."""
        kg = {"kg": 1.0, "g": 1e-3, "lb": 0.45359237}[self.mass_unit]
        m = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}[self.length_unit]
        signs = NED[:3] if self.frame == "ned" else np.ones(3)
        mass, r_g = kg * self.mass, m * signs * np.array(self.cg)
        I_o = kg * m**2 * signs[:, None] * _inertia(self.inertia, self.products_of_inertia) * signs
        return mass, r_g, about_cg(I_o, mass, r_g) if self.inertia_about == "origin" else I_o


def _inertia(given: tuple[float, ...], products: str | None) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = (*given, *(0.0,) * (6 - len(given)))
    sign = -1.0 if products == "integral" else 1.0
    return np.array([[xx, sign * xy, sign * xz], [sign * xy, yy, sign * yz], [sign * xz, sign * yz, zz]])


def described(source: Source, text: str) -> VehicleRecord:
    """The vehicle of a table. Raises InputError with the key of each error."""
    tables = _rows(source, text) if source.path.suffix.lower() == ".csv" else _toml(source, text)
    given = validated(source, Table, tables)
    return record_of(source, given)


def _toml(source: Source, text: str) -> dict[str, Any]:
    try:
        return parsed_toml(text)
    except (tomllib.TOMLDecodeError, ValueError) as error:
        raise source.fault("", f"is not TOML: {error}") from None


def _rows(source: Source, text: str) -> dict[str, Any]:
    """The keys and values of a CSV file as the tables of TOML."""
    lines = [
        (n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and not line.lstrip().startswith("#")
    ]
    separator = max(",;\t", key=lines[0][1].count) if lines else ","
    cells = [(n, [each.strip() for each in next(csv.reader([line], delimiter=separator))]) for n, line in lines]
    if not cells or cells[0][1][:2] != ["key", "value"]:
        raise source.fault("row 1", "the head must be key, value; a row is body.mass, 13.5 or body.cg, 0 0 0.01")
    tables: dict[str, Any] = {}
    for n, row in cells[1:]:
        if len(row) < 2:
            raise source.fault(f"row {n}", "has no value")
        *tops, last = row[0].split(".")
        table: Any = tables
        for top in tops:
            table = table.setdefault(top, {})
            if not isinstance(table, dict):
                raise source.fault(f"row {n}", f"{row[0]!r} is below a key that has a value")
        if last in table:
            raise source.fault(f"row {n}", f"{row[0]!r} is given twice")
        table[last] = _cell(row[1])
    if isinstance(found := tables.get("thrusters"), dict):
        tables["thrusters"] = [
            {"name": name, **(each if isinstance(each, dict) else {})} for name, each in found.items()
        ]
    return tables


def _cell(text: str) -> Any:
    try:
        values = [float(each) for each in text.split()]
    except ValueError:
        return text
    return values[0] if len(values) == 1 else values


def validated(source: Source, kind: Any, tables: Mapping[str, Any]) -> Any:
    """The tables as a kind of record. Raises InputError with the key of each error."""
    try:
        return TypeAdapter(kind).validate_python({key: _tuples(value) for key, value in tables.items()})
    except ValidationError as error:
        fields = {"": [*kind.__dataclass_fields__], "body": [*Body.__dataclass_fields__]}
        raise InputError(faults_of(error, choices=fields), str(source.path)) from None


def _tuples(value: Any) -> Any:
    """Lists as tuples, but for whole matrices."""
    if isinstance(value, dict):
        return {key: _tuples(each) for key, each in value.items()}
    if isinstance(value, list) and not any(isinstance(each, list) for each in value):
        return tuple(_tuples(each) for each in value)
    return value


def record_of(source: Source, given: Table) -> VehicleRecord:
    """The vehicle of a table, in B."""
    body, signs = given.body, NED if given.frame == "ned" else np.ones(6)
    three = signs[:3]
    r_g, r_b = three * np.array(body.cg), three * np.array(body.cb)
    I_o = three[:, None] * body.matrix() * three
    I_g = possible(source, about_cg(I_o, body.mass, r_g) if body.inertia_about == "origin" else I_o, "the body")
    matrices = {name: mirrored(_matrix(source, given, name), signs) for name in ("M_A", "D_linear", "D_quadratic")}
    terms = mirrored_products(_terms(source, given), signs)
    point = (
        {"origin": np.zeros(3), "cg": r_g}.get(given.about)
        if isinstance(given.about, str)
        else three * np.array(given.about)
    )
    assert point is not None
    zero = r_g if given.origin == "cg" else np.zeros(3)
    matrices = _moved(source, matrices, terms, point - zero)
    matrices["M_A"] = symmetric(source, matrices["M_A"], "added_mass", "added mass")
    displaced = body.displaced_mass if body.displaced_mass is not None else body.density * (body.volume or 0.0)
    shapes: tuple[Shape, ...] = ()
    if body.size is not None:
        a, b, c = (x / 2.0 for x in body.size)
        x, y, z = (-zero).tolist()
        shapes = (Shape("box", (a, b, c), (x, y, z), (1.0, 0.0, 0.0, 0.0), (0.55, 0.6, 0.65, 1.0)),)
    name = word(given.name or source.path.stem)
    part = PartRecord(
        name, body.mass, r_g - zero, I_g, displaced_mass=displaced, r_b=r_b - zero, shapes=shapes, **matrices
    )
    thrusters = tuple(_thruster(each, three, zero) for each in given.thrusters)
    if given.origin == "cg" and r_g.any():
        source.say("B's origin is the centre of gravity: all places are moved by -cg")
    products = {product_name(*key): c for key, c in terms.items()}
    texts = {key: getattr(given, key) for key in ("description", "source", "licence", "trust")}
    return VehicleRecord(part, thrusters, (), products, **texts)


def _thruster(given: ThrusterTable, signs: np.ndarray, zero: np.ndarray) -> Thruster:
    direction = signs * np.array(given.direction) / np.linalg.norm(given.direction)
    x, y, z = (signs * np.array(given.position) - zero + 0.0).tolist()
    a, b, c = (direction + 0.0).tolist()
    limits = None if given.min is None or given.max is None else (given.min, given.max)
    return Thruster(given.name, (x, y, z), (a, b, c), limits)


def _moved(source: Source, matrices: dict[str, np.ndarray], terms: Mapping, r: np.ndarray) -> dict[str, np.ndarray]:
    """Matrices about the origin, from those about the point r (3,) of B. Raises InputError for quadratic damping."""
    if np.abs(r).max() < 1e-12:
        return matrices
    if matrices["D_quadratic"].any() or terms:
        what = "quadratic damping" if matrices["D_quadratic"].any() else "products of velocities"
        said = f"{what} can't be moved to another point: its form abs(v) v holds where it was measured"
        raise source.fault("about", f'{said}. Write origin = "cg" with about = "cg", so that B\'s origin is there')
    place = " ".join(f"{x:.6g}" for x in r)
    source.say(f"added mass and linear damping are moved to B's origin, from the point {place} m of B")
    pose = Pose(np.eye(3), r)
    return matrices | {name: moved(matrices[name], pose) for name in ("M_A", "D_linear")}


_TABLES = {"M_A": "added_mass", "D_linear": "linear_damping", "D_quadratic": "quadratic_damping"}


def _matrix(source: Source, given: Table, name: str) -> np.ndarray:
    """A matrix (6, 6) with positive diagonal, in the axes of the table."""
    table, key = getattr(given, _TABLES[name]), _TABLES[name]
    factor = -1.0 if given.signs == "derivatives" else 1.0
    if "matrix" in table:
        if len(table) > 1:
            raise source.fault(key, "has a matrix and derivatives; give one of them")
        found = np.array(table["matrix"], float) if all(len(row) == 6 for row in table["matrix"]) else np.zeros((0, 0))
        if found.shape != (6, 6):
            raise source.fault(f"{key}.matrix", "must have 6 rows of 6 numbers")
    else:
        names = DERIVATIVES[name]
        found = np.zeros((6, 6))
        for word_, value in table.items():
            places = np.argwhere(names == word_)
            if not len(places):
                raise source.fault(f"{key}.{word_}", f"is no derivative; {suggestion(word_, names.ravel().tolist())}")
            if isinstance(value, list):
                raise source.fault(f"{key}.{word_}", "must be a number")
            i, j = places[0]
            found[i, j] = value
        if name == "M_A":
            found = np.where(found == 0.0, found.T, found)
        missing = [each for i, each in enumerate(np.diag(names)) if each not in table]
        if missing and name == "M_A":
            raise source.fault(key, f"lacks {', '.join(missing)}; write 0 for what is not known")
    return right_signs(source, factor * found, key.replace("_", " "), key, f'signs = "{given.signs}"')


def _terms(source: Source, given: Table) -> dict[tuple[int, int, int, bool], float]:
    """The products by axis, first and second velocity, and bars: forces, whatever the signs of the matrices."""
    found: dict[tuple[int, int, int, bool], float] = {}
    for name, value in given.products.items():
        match = _TERM.fullmatch(name)
        if match is None or min(map(len, match.groups()[1:])) > 1:
            raise source.fault(f"products.{name}", "is no product of velocities, as Yuv, Yr|r| or Xv|u|")
        first, second = sorted(match.groups()[1:], key=len)
        j, k = ("uvwpqr".index(each.strip("|")) for each in (first, second))
        found["XYZKMN".index(match[1]), j, k, len(second) > 1] = value
    return found


def mass_report(path: Path) -> MassReport:
    """The mass report in a TOML file. Raises InputError."""
    source = Source(path)
    return validated(source, MassReport, _toml(source, source.text(path)))


_SPEEDS = {"m_s": 1.0, "kn": 1852.0 / 3600.0, "rad_s": 1.0, "deg_s": np.pi / 180.0}
_LOADS = {**FORCES, "Nm": 1.0}


def drag_table(path: Path) -> dict[int, tuple[float, float, float]]:
    """Linear and quadratic damping of the axes that a table of speeds and forces has, and the rms of what is left.

    The table is a CSV with the columns ``axis`` (surge to yaw), ``speed_m_s`` (_kn, _rad_s, _deg_s) and ``force_N``
    (_kgf, _Nm): the force that holds the vehicle at the speed. D u + Q abs(u) u is fitted by least squares, D, Q >= 0.

    Returns:
        By the index of the axis: D [N s/m], Q [N s^2/m^2], rms [N]; of angular axes in N m and rad/s.

    Raises:
        InputError: with the row and the column of each error.
    """
    source = Source(path)
    lines = [
        (n, each)
        for n, each in enumerate(source.text(path).splitlines(), 1)
        if each.strip() and not each.startswith("#")
    ]
    if not lines:
        raise source.fault("", "is empty; its columns are axis, speed_m_s, force_N")
    separator = max(",;\t", key=lines[0][1].count)
    rows = [
        (n, [cell.strip() for cell in next(csv.reader(io.StringIO(line), delimiter=separator))]) for n, line in lines
    ]
    heads, faults = rows[0][1], list[Fault]()
    speed = next((each for each in heads if each.removeprefix("speed_") in _SPEEDS), None)
    load = next((each for each in heads if each.removeprefix("force_").removeprefix("moment_") in _LOADS), None)
    if speed is None or load is None or "axis" not in heads:
        raise source.fault(
            "row 1", "the columns are axis, speed_m_s (or _kn, _rad_s, _deg_s) and force_N (or force_kgf, moment_Nm)"
        )
    factors = _SPEEDS[speed.removeprefix("speed_")], _LOADS[load.removeprefix("force_").removeprefix("moment_")]
    points: dict[int, list[tuple[float, float]]] = {}
    for n, cells in rows[1:]:
        if len(cells) != len(heads):
            faults.append(Fault(f"row {n}", f"has {len(cells)} values; the head has {len(heads)} columns"))
            continue
        row = dict(zip(heads, cells, strict=True))
        if row["axis"] not in AXES:
            faults.append(Fault(f"row {n}, column axis", f"{row['axis']!r}: {suggestion(row['axis'], AXES)}"))
            continue
        try:
            v, f = float(row[speed]) * factors[0], float(row[load]) * factors[1]
        except ValueError:
            faults.append(Fault(f"row {n}", f"{row[speed]!r}, {row[load]!r} are not both numbers"))
            continue
        if not np.isfinite([v, f]).all() or v * f < 0.0 or v == 0.0:
            faults.append(
                Fault(f"row {n}", f"speed {v:g} and force {f:g} must be finite, of one sign, and the speed not zero")
            )
            continue
        points.setdefault(AXES.index(row["axis"]), []).append((abs(v), abs(f)))
    faults += [
        Fault(AXES[axis], f"has one speed in {len(each)} rows: linear and quadratic damping need two")
        for axis, each in points.items()
        if len({v for v, _ in each}) < 2
    ]
    if not points and not faults:
        faults.append(Fault("", "has no row below its head"))
    if faults:
        raise InputError(faults, str(path))
    found = {}
    for axis, each in points.items():
        v, f = np.array(each).T
        (D, Q), _ = nnls(np.column_stack([v, v**2]), f)
        found[axis] = float(D), float(Q), float(np.sqrt(np.mean((D * v + Q * v**2 - f) ** 2)))
    return found
