"""The numbers of a vehicle in a program of PythonVehicleSimulator or MSS, of which nothing is executed.

Plain assignments of numbers and matrices are computed: arithmetic, a few functions, names that were assigned before.
A name that is assigned in a branch or a loop, by an entry, or by anything else, has no number from there on.
The axes of both projects are forward, right, down about CO (Fossen, Handbook of Marine Craft Hydrodynamics and Motion
Control, 2021); derivatives are negative, MA and D positive, inertia about CG.
"""

import ast
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from ...errors import Fault, InputError
from ..coefficients import DERIVATIVES, LARGEST
from ..record import VehicleRecord
from .reading import Source
from .table import Table, record_of, validated

_LONGEST = 100_000
"""Bound on the text of a program [characters]."""
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(np, name) for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "deg2rad", "abs")},
    "diag": lambda a: np.diag(np.ravel(a)) if min(np.atleast_2d(a).shape) == 1 else np.diag(a),
    **dict.fromkeys(("array", "float", "float64"), lambda a: np.array(a, float)),
    **dict.fromkeys(("pow", "power"), np.power),
    **dict.fromkeys(("eye", "identity"), lambda n: np.eye(_small(n))),
    "_rows": lambda rows: np.block([[np.atleast_2d(each) for each in row] for row in rows]),
}
_BLOCKS = ("if", "for", "while", "switch", "try", "parfor", "spmd")
_TOKEN = re.compile(
    r"(?P<space>[ \t]+)|(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z]\w*)"
    r"|(?P<text>\"[^\"\n]*\")|(?P<op>\.\*|\./|\.\^|\.'|[=~<>]=|&&|\|\||.|\n)"
)
_OPERATORS = {"*": "@", ".*": "*", "./": "/", "^": "**", ".^": "**", "'": ".T", ".'": ".T"}


class _NoNumberError(Exception):
    """An expression is no plain number or matrix."""


def _small(n: Any) -> int:
    if np.ndim(n) or n not in range(1, 7):
        raise _NoNumberError
    return int(n)


class _Numbers:
    """Names and their numbers; None where a name is assigned and has no number."""

    def __init__(self, matlab: bool) -> None:
        self.matlab = matlab
        self.found: dict[str, Any] = {}
        self.used: set[str] = set()
        self.skipped: set[str] = set()

    def assign(self, name: str, expression: ast.expr | None) -> None:
        try:
            with np.errstate(all="ignore"):
                value = None if expression is None else self.value(expression)
        except (_NoNumberError, ValueError, TypeError, ArithmeticError, LookupError, RecursionError):
            value = None
        self.found[name] = value

    def lose(self, name: str) -> None:
        """Forget the number of a name, and of every name of the same array."""
        old = self.found.get(name)
        for each, value in self.found.items() if isinstance(old, np.ndarray) else ():
            if value is old:
                self.found[each] = None
        self.found[name] = None

    def value(self, node: ast.expr) -> Any:
        found = self._value(node)
        if not isinstance(found, list):
            if np.size(found) > 36 or np.iscomplexobj(found) or not np.all(np.abs(found) <= LARGEST):
                raise _NoNumberError
            if self.matlab and np.size(found) == 1:
                found = np.float64(np.ravel(found)[0])
        return found

    def _value(self, node: ast.expr) -> Any:
        name = _dotted(node)
        if name in self.found:
            self.used.add(name)
            if self.found[name] is None:
                raise _NoNumberError
            return self.found[name]
        if name in ("pi", "math.pi", "np.pi", "numpy.pi"):
            return np.float64(np.pi)
        match node:
            case ast.Constant(value=int() | float()) if not isinstance(node.value, bool):
                return np.float64(node.value)
            case ast.List() | ast.Tuple():
                return [self.value(each) for each in node.elts]
            case ast.UnaryOp(op=ast.USub() | ast.UAdd()):
                value = np.asarray(self.value(node.operand), float)[()]
                return -value if isinstance(node.op, ast.USub) else value
            case ast.BinOp():
                return self._binary(node)
            case ast.Attribute(attr="T"):
                return np.transpose(self.value(node.value))
            case ast.Subscript():
                return np.asarray(self.value(node.value))[self._index(node.slice)]
            case ast.Call(func=func) if all(
                (each.arg, _dotted(each.value)) == ("dtype", "float") for each in node.keywords
            ):
                return self._call(_dotted(func), node.args)
        raise _NoNumberError

    def _call(self, name: str, args: Sequence[ast.expr]) -> Any:
        if self.matlab and self.found.get(name) is not None:  # MATLAB writes entries as calls, from 1
            self.used.add(name)
            entry = [_whole(each) - 1 for each in args]
            value = np.atleast_2d(self.found[name])
            if min(entry) < 0 or (len(entry) == 1 and min(value.shape) > 1):
                raise _NoNumberError
            return np.ravel(value)[entry[0]] if len(entry) == 1 else value[tuple(entry)]
        module, _, function = name.rpartition(".")
        known = module in (("",) if self.matlab else ("", "np", "numpy", "math"))
        if not known or name in self.found or function not in _FUNCTIONS:
            raise _NoNumberError
        if function == "array" and len(args) == 2 and _dotted(args[1]) in ("float", "np.float64"):
            args = args[:1]
        return _FUNCTIONS[function](*(self.value(each) for each in args))

    def _index(self, node: ast.expr) -> Any:
        return tuple(_whole(each) for each in (node.elts if isinstance(node, ast.Tuple) else [node]))

    def _binary(self, node: ast.BinOp) -> Any:
        if any(isinstance(each, ast.List | ast.Tuple) for each in (node.left, node.right)):
            raise _NoNumberError  # lists of Python join and repeat
        a, b = self.value(node.left), self.value(node.right)
        match node.op:
            case ast.Add():
                return a + b
            case ast.Sub():
                return a - b
            case ast.Mult():
                return a * b
            case ast.MatMult():
                return a @ b if np.ndim(a) and np.ndim(b) else a * b
            case ast.Div() if np.ndim(b) == 0:
                return a / b
            case ast.Pow() if np.ndim(a) == np.ndim(b) == 0:
                if not (self.matlab and any(_is_power(each) for each in (node.left, node.right))):
                    return np.float64(a) ** np.float64(b)  # MATLAB's a^b^c is another than Python's
        raise _NoNumberError


def _is_power(node: ast.expr) -> bool:
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow)


def _whole(node: ast.expr) -> int:
    value = node.value if isinstance(node, ast.Constant) else None
    if isinstance(value, int | float) and not isinstance(value, bool) and value == int(value):
        return int(value)
    raise _NoNumberError


def _dotted(node: ast.AST) -> str:
    if isinstance(node, ast.Attribute):
        before = _dotted(node.value)
        return f"{before}.{node.attr}" if before else ""
    return node.id if isinstance(node, ast.Name) else ""


def _python(source: Source, text: str) -> _Numbers:
    """The numbers of the module, of its class and of the class's ``__init__``."""
    try:
        module = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise source.fault("", f"is not Python: {getattr(error, 'msg', None) or 'it is nested too deep'}") from None
    classes = [each for each in module.body if isinstance(each, ast.ClassDef)]
    if len(classes) > 1:
        raise source.fault("", f"has {len(classes)} classes: keep the class of the vehicle")
    numbers = _Numbers(matlab=False)
    _run(numbers, module.body, "")
    for each in classes:
        _run(numbers, each.body, "self.")
        for start in each.body:
            if isinstance(start, ast.FunctionDef) and start.name == "__init__":
                for argument in ast.walk(start.args):
                    if isinstance(argument, ast.arg):
                        numbers.found[argument.arg] = None
                numbers.found.pop("self", None)
                _run(numbers, start.body, "")
    return numbers


def _run(numbers: _Numbers, body: Sequence[ast.stmt], prefix: str) -> None:
    for each in body:
        match each:
            case ast.Assign(targets=[target], value=value) if name := _dotted(target):
                numbers.assign(prefix + name, value)
            case ast.AnnAssign(target=target, value=ast.expr() as value) if name := _dotted(target):
                numbers.assign(prefix + name, value)
            case ast.FunctionDef() | ast.ClassDef():
                if not prefix:
                    numbers.found[each.name] = None
            case ast.Import() | ast.ImportFrom():
                for name in {alias.asname or alias.name for alias in each.names} & {*numbers.found}:
                    numbers.lose(name)
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                pass
            case _:
                numbers.skipped.add(f"line {each.lineno}")
                for node in ast.walk(each):
                    targets = [node.value] if isinstance(node, ast.Subscript) else [node]
                    stored = isinstance(getattr(node, "ctx", None), ast.Store | ast.Del)
                    while stored and isinstance(targets[0], ast.Subscript):
                        targets = [targets[0].value]
                    if stored and (name := _dotted(targets[0])):
                        numbers.lose(prefix + name)


def _matlab(source: Source, text: str) -> _Numbers:
    """The numbers of the first function of a file, or of a script."""
    numbers, depth, functions = _Numbers(matlab=True), 0, 0
    for line, tokens in _statements(text):
        words = [each for kind, each in tokens if kind != "space"]
        names = [each for kind, each in tokens if kind == "name"]
        if words[0] == "function":
            functions += 1
            if functions > 1:
                break
            for each in names[1:]:
                numbers.lose(each)
        elif words[0] == "end":
            depth -= 1
        elif depth == 0 and len(words) > 2 and words[1] == "=" and tokens[0][0] == "name":
            numbers.assign(words[0], _expression(tokens[[each for _, each in tokens].index("=") + 1 :]))
        else:
            depth += words[0] in _BLOCKS
            numbers.skipped.add(f"line {line}")
            equals = [i for i, each in enumerate(words) if each == "="]
            lost = {words[i - 1] for i in equals}
            if not all(each.isidentifier() for each in lost):  # [a, b] = ..., a(1, 2) = ...
                lost = {*words[: equals[-1]]}
            for each in lost & {*names} - {*_BLOCKS}:
                numbers.lose(each)
    return numbers


def _statements(text: str) -> Iterator[tuple[int, list[tuple[str, str]]]]:
    """The statements of a MATLAB text: the line on which each begins, and its tokens with their kinds."""
    lines, inside = text.replace("\r", "").split("\n"), 0
    for i, each in enumerate(lines):
        inside += (each.strip() == "%{") - (inside > 0 and each.strip() == "%}")
        lines[i] = "" if inside else each
    text = "\n".join(lines)
    found: list[tuple[str, str]] = []
    depth, at, line, begun = 0, 0, 1, 1
    while at < len(text):
        match = _TOKEN.match(text, at)
        assert match is not None
        kind, each = str(match.lastgroup), match[0]
        if each == "%" or text.startswith("...", at):
            end = text.find("\n", at) % (len(text) + 1)
            at = end + (each != "%")
            line += each != "%"
            continue
        operand = bool(found) and (found[-1][0] in ("name", "number") or found[-1][1] in (")", "]", "'"))
        if each == "'" and not operand:  # a text, not a transpose
            kind, each = "text", (re.compile(r"'[^'\n]*'?").match(text, at) or match)[0]
        at += len(each)
        depth += (each in "([{") - (each in ")]}") if kind == "op" else 0
        if kind == "op" and depth <= 0 and each in ";,\n":
            if any(kind != "space" for kind, _ in found):
                yield begun, found[1:] if found[0][0] == "space" else found
            found, depth = [], 0
        else:
            begun = line if not found else begun
            found.append((kind, each))
        line += each == "\n"
    if any(kind != "space" for kind, _ in found):
        yield begun, found[1:] if found[0][0] == "space" else found


def _expression(tokens: Sequence[tuple[str, str]]) -> ast.expr | None:
    """An expression of MATLAB as Python's, in which * is @ and [a b; c d] is rows; None if there is none."""
    out, open_, last, spaced = list[str](), list[str](), "", False
    for i, (kind, each) in enumerate(tokens):
        if kind == "space":
            spaced = True
            continue
        inside = bool(open_) and open_[-1] == "["
        begins = kind in ("number", "name") or each in ("(", "[")
        sign = each in ("+", "-") and spaced and i + 1 < len(tokens) and tokens[i + 1][0] != "space"
        if inside and last == "operand" and (sign or (spaced and begins)):
            out.append(",")
        if kind == "text" or each in ("\\", "{", "}", ":", "@", "~", "!", "&", "|"):
            return None
        if each == "[":
            out.append("_rows([[")
        elif each == "]":
            out.append("]])")
        elif inside and each in (";", "\n"):
            if last == "operand":
                rest = (each for kind, each in tokens[i + 1 :] if kind != "space" and each not in (";", "\n"))
                out.append("" if next(rest, "]") == "]" else "],[")
        else:
            out.append(repr(float(each)) if kind == "number" else _OPERATORS.get(each, each))
        if each in ("(", "["):
            open_.append(each)
        elif each in (")", "]") and open_:
            open_.pop()
        last = "operand" if kind in ("number", "name") or each in (")", "]", "'", ".'") else "other"
        spaced = False
    try:
        return ast.parse("".join(out), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None


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

    def __init__(self, numbers: _Numbers) -> None:
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
    numbers = (_matlab if source.path.suffix.lower() == ".m" else _python)(source, text)
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


def _say(source: Source, numbers: _Numbers) -> None:
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
