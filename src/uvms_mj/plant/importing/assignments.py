"""The numbers that a program in Python or MATLAB assigns to names. Nothing is executed.

Plain assignments of numbers and matrices are computed: arithmetic, a few functions, names that were assigned before.
A name that is assigned in a branch or a loop, by an entry, or by anything else, has no number from there on.
"""

import ast
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from ..coefficients import LARGEST
from .reading import Source

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


class Numbers:
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


def python(source: Source, text: str) -> Numbers:
    """The numbers of the module, of its class and of the class's ``__init__``."""
    try:
        module = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise source.fault("", f"is not Python: {getattr(error, 'msg', None) or 'it is nested too deep'}") from None
    classes = [each for each in module.body if isinstance(each, ast.ClassDef)]
    if len(classes) > 1:
        raise source.fault("", f"has {len(classes)} classes: keep the class of the vehicle")
    numbers = Numbers(matlab=False)
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


def _run(numbers: Numbers, body: Sequence[ast.stmt], prefix: str) -> None:
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


def matlab(source: Source, text: str) -> Numbers:
    """The numbers of the first function of a file, or of a script."""
    numbers, depth, begun = Numbers(matlab=True), 0, False
    for line, tokens in _statements(text):
        words = [each for kind, each in tokens if kind != "space"]
        names = [each for kind, each in tokens if kind == "name"]
        if words[0] == "function":
            if begun:  # another function, or one of a script: its names are others
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
        begun = True
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
