"""xacro, expanded by its own package, with what it could execute or read taken away.

xacro evaluates expressions as Python and may include any file. Here an expression is arithmetic, and is computed by
:func:`computed`; files are read by :class:`..reading.Source`, in the folders named; environment variables, YAML and
other functions are refused by name.
"""

import ast
import contextlib
import io
import math
import operator
import threading
import xml.dom.minidom
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from ...errors import InputError, needs_extra, shortened
from .reading import Source

MOST_MACROS, MOST_TEXT, MOST_POWER = 50_000, 10_000, 64
"""Bounds on the calls of macros, on the characters of an expression and its text, and on an exponent."""
_TWO: dict[type[ast.AST], Any] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_ONE: dict[type[ast.AST], Any] = {ast.USub: operator.neg, ast.UAdd: operator.pos, ast.Not: operator.not_}
_MATH = [
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "atan2",
    "sqrt",
    "radians",
    "degrees",
    "fabs",
    "floor",
    "ceil",
    "exp",
    "log",
    "hypot",
    "pow",
]
_FUNCTIONS = {name: getattr(math, name) for name in _MATH if name != "pow"}
_FUNCTIONS |= {
    "abs": abs,
    "min": min,
    "max": max,
    "round": round,
    "float": float,
    "int": int,
    "str": str,
    "len": len,
    "bool": bool,
}
_CONSTANTS = {"pi": math.pi, "e": math.e, "tau": math.tau, "True": True, "False": False, "true": True, "false": False}
_lock = threading.Lock()
_PATCHED = ("safe_eval", "eval_extension", "parse", "handle_macro_call", "load_yaml")
"""The parts of xacro that this module replaces while a file is expanded."""


def computed(expression: str, symbols: Any) -> Any:
    """The value of an expression: numbers, texts and properties, by arithmetic, comparisons and functions of math.
    Raises ValueError for anything else."""
    if len(expression) > MOST_TEXT:
        raise ValueError(f"an expression has more than {MOST_TEXT} characters")
    try:
        return _value(ast.parse(expression.strip(), mode="eval").body, symbols)
    except (SyntaxError, TypeError, ArithmeticError, RecursionError, MemoryError) as error:
        raise ValueError(f"{shortened(expression)}: {error or type(error).__name__}") from None


def _value(node: ast.expr, symbols: Any) -> Any:
    match node:
        case ast.Constant(value=int() | float() | str() | bool() as value):
            return value
        case ast.Name(id=name):
            if name in symbols and not callable(symbols[name]):
                return _plain(symbols[name])
            if name in _CONSTANTS:
                return _CONSTANTS[name]
            raise ValueError(f"{name!r} is no property of the file")
        case ast.Attribute(value=ast.Name(id="math" | "python"), attr=name) if name in _CONSTANTS:
            return _CONSTANTS[name]
        case ast.BinOp(op=ast.Pow()):
            a, b = _value(node.left, symbols), _value(node.right, symbols)
            return _power(a, b)
        case ast.BinOp():
            a, b = _value(node.left, symbols), _value(node.right, symbols)
            text = isinstance(a, str) and isinstance(b, str)
            if not (all(isinstance(x, int | float) for x in (a, b)) or (text and isinstance(node.op, ast.Add))):
                raise ValueError("arithmetic is with numbers, and + joins two texts")
            return _plain(_TWO[type(node.op)](a, b)) if type(node.op) in _TWO else _unknown(node.op)
        case ast.UnaryOp():
            return _ONE[type(node.op)](_value(node.operand, symbols)) if type(node.op) in _ONE else _unknown(node.op)
        case ast.BoolOp():
            values = [_value(each, symbols) for each in node.values]
            return all(values) if isinstance(node.op, ast.And) else any(values)
        case ast.Compare():
            values = [_value(each, symbols) for each in (node.left, *node.comparators)]
            found = [
                _TWO[type(op)](a, b) if type(op) in _TWO else _unknown(op)
                for op, a, b in zip(node.ops, values, values[1:], strict=False)
            ]
            return all(found)
        case ast.IfExp():
            return _value(node.body if _value(node.test, symbols) else node.orelse, symbols)
        case ast.Call(keywords=[]):
            name = node.func.id if isinstance(node.func, ast.Name) else ""
            if isinstance(node.func, ast.Attribute) and isinstance(node.func.value, ast.Name):
                name = node.func.attr if node.func.value.id in ("math", "python") else ""
            arguments = [_value(each, symbols) for each in node.args]
            if name == "pow" and len(arguments) == 2:
                return _power(*arguments)
            if name in _FUNCTIONS:
                return _plain(_FUNCTIONS[name](*arguments))
            raise ValueError(
                f"{ast.unparse(node.func)}() is not computed; the functions are {', '.join(sorted(_FUNCTIONS))}"
            )
    raise ValueError(f"{ast.unparse(node)} is not computed: an expression is arithmetic with properties")


def _power(a: Any, b: Any) -> float:
    if not all(isinstance(x, int | float) for x in (a, b)) or abs(b) > MOST_POWER:
        raise ValueError(f"a power has numbers, and an exponent of at most {MOST_POWER}")
    return float(a) ** b


def _unknown(op: ast.AST) -> Any:
    raise ValueError(f"the operator {type(op).__name__} is not computed")


def _plain(value: Any) -> Any:
    """A number, a text or a truth value of bounded length."""
    if not isinstance(value, bool | int | float | str) or (isinstance(value, str) and len(value) > MOST_TEXT):
        raise ValueError(f"{shortened(value)} is no number and no short text")
    if isinstance(value, int) and abs(value) > 1e300:
        raise ValueError("a number is too large")
    return value


def expanded(source: Source, text: str) -> Element:
    """The root of a xacro text with its macros expanded. Raises InputError."""
    with needs_extra("xacro"):
        import xacro
    missing = [name for name in _PATCHED if not hasattr(xacro, name)]
    if missing:
        raise InputError(f"this version of xacro has no {', '.join(missing)}: install xacro>=2.0,<3")
    source.refuse_entities(text, "")
    try:
        document = xml.dom.minidom.parseString(text.encode())
    except Exception as error:
        raise source.fault("", f"is not well-formed XML: {error}") from None
    with (
        _lock,
        _guarded(source, xacro),
        contextlib.redirect_stderr(io.StringIO()),
        contextlib.redirect_stdout(io.StringIO()),
    ):
        try:
            xacro.init_stacks(str(source.path))
            xacro.process_doc(document, mappings={}, verbosity=0)
            written = document.toxml()
        except InputError:
            raise
        except RecursionError:
            raise source.fault("", "its macros call each other without end") from None
        except Exception as error:  # of xacro, whose classes are its own
            file = Path(xacro.filestack[-1]).name if getattr(xacro, "filestack", None) else source.path.name
            cause = error.__context__ if isinstance(error.__context__, InputError) else getattr(error, "exc", None)
            if isinstance(cause, InputError):
                raise cause from None
            raise source.fault(f"xacro in {file}", " ".join(str(error).split()) or type(error).__name__) from None
    if len(written) > 10 * 2**20:
        raise source.fault("", "its macros expand to more than 10 MiB")
    return source.xml(written)


@contextlib.contextmanager
def _guarded(source: Source, xacro: Any) -> Iterator[None]:
    """xacro with expressions, files and macros of this module."""
    before = {name: getattr(xacro, name) for name in _PATCHED}
    calls = 0

    def safe_eval(expression: str, symbols: Any, *_: Any) -> Any:
        return computed(expression, symbols)

    def eval_extension(text: str) -> Any:
        words = text.removeprefix("$(").removesuffix(")").split()
        match words:
            case ["find", name]:
                return str(source.package(name, text))
            case ["arg", name]:
                arguments = xacro.substitution_args_context["arg"]
                if name not in arguments:
                    raise source.fault(text, "has no default: write one in the file, <xacro:arg default=.../>")
                return arguments[name]
            case ["dirname"]:
                return str(Path(xacro.filestack[-1]).parent)
            case ["eval", *_]:
                return str(computed(text[len("$(eval ") : -1], xacro.substitution_args_context["arg"]))
        raise source.fault(
            text, "is not evaluated: $(find), $(arg), $(dirname) and $(eval) are; nothing of the environment is read"
        )

    def parse(given: Any, filename: Any = None) -> Any:
        if given is not None:
            return before["parse"](given, filename)
        path = source.within(Path(filename), f"<xacro:include> {Path(filename).name}")
        text = source.text(path, f"<xacro:include> {Path(filename).name}")
        source.refuse_entities(text, path.name)
        return xml.dom.minidom.parseString(text.encode())

    def handle_macro_call(*arguments: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls > MOST_MACROS:
            raise source.fault("", f"its macros are called more than {MOST_MACROS} times")
        return before["handle_macro_call"](*arguments)

    def load_yaml(*_: Any) -> Any:
        raise source.fault("load_yaml", "is not read: write the numbers as properties")

    ours = (safe_eval, eval_extension, parse, handle_macro_call, load_yaml)
    try:
        for name, function in zip(_PATCHED, ours, strict=True):
            setattr(xacro, name, function)
        yield
    finally:
        for name, function in before.items():
            setattr(xacro, name, function)
