"""A function as plain Python with the arithmetic of its machine code.

Machine code and NumPy round some operations in other ways: a product of matrices is summed in another order, an
exponential is a function of this project. Plain Python and machine code can then differ in the last digit, and a
difference of two large numbers in all digits. In a twin, every call and every operator of this kind is a call of what
computes as machine code does. All else is Python's. So a twin and machine code have equal bits, and any difference is a
fault.

The module checks once more the work that the compiler and a twin share, so that a fault of it does not hide in both: a
text must be the function's, and a result NumPy's but for rounding.
"""

import ast
import builtins
import contextlib
import copy
import dis
import functools
import math
import types
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ...compiler.builtin import METHODS, OF_C
from ...compiler.libm import FUNCTIONS
from ...compiler.library import REPLACED
from ...files import function_tree

_FOREIGN = ("numpy", "scipy", "math", "builtins", "functools")
_OURS = __name__.partition(".")[0]
_OPERATORS: dict[type, str] = {ast.MatMult: "product", ast.Pow: "power"}
_EXACT = ("sqrt", "fabs", "copysign", "fmod")
_OF_CALLS = ("PUSH_NULL", "PRECALL", "CALL", "EXTENDED_ARG", "NOP")
_MARK = "__as_machine_code__"
_PLAIN = set(vars(builtins)) - {"print", "pow", "map", "filter", "sorted", "getattr"}
"""Functions of Python's own that call no other function."""
_OF_C = 1e-9
"""Largest difference from NumPy, as a share of the largest number, but for equations of a bad condition."""


def twin(function: types.FunctionType) -> Callable:
    """The twin of a function; the function itself if it has no source, or another one since it was loaded."""
    names = function.__globals__
    if _MARK in names:
        return function
    code = function.__code__
    if code not in _codes:
        _codes[code] = _translated(function)
    names = {**names, _MARK: _Arithmetic}
    made = types.FunctionType(_codes[code], names, function.__name__, function.__defaults__, function.__closure__)
    made.__kwdefaults__ = function.__kwdefaults__
    return made


_codes: dict[types.CodeType, types.CodeType] = {}


def _translated(function: types.FunctionType) -> types.CodeType:
    """The code of a function's twin."""
    code = function.__code__
    try:
        tree, _ = function_tree(function)
    except (OSError, SyntaxError, IndexError):  # as of one of several lambdas in a line
        return code
    if not isinstance(tree, ast.FunctionDef):
        return code
    with contextlib.suppress(RecursionError):
        return _with_arithmetics(tree, function)
    return code  # of a sum of hundreds of terms


def _with_arithmetics(tree: ast.FunctionDef, function: types.FunctionType) -> types.CodeType:
    code = function.__code__
    tree.decorator_list, tree.returns = [], None
    for argument in ast.walk(tree.args):
        if isinstance(argument, ast.arg):
            argument.annotation = None
    nothing = ast.copy_location(ast.Constant(None), tree)
    tree.args.defaults = [nothing for _ in tree.args.defaults]  # the function has them
    tree.args.kw_defaults = [each and nothing for each in tree.args.kw_defaults]
    ours = function.__module__.partition(".")[0] == _OURS
    if not ours and [*_operations(_compiled(tree, function))] != [*_operations(code)]:
        return code
    return _compiled(_Arithmetics().visit(tree), function)


def _compiled(tree: ast.FunctionDef, function: types.FunctionType) -> types.CodeType:
    """The code of a tree where the function stands: in its class, with the same names around it."""
    code = function.__code__
    body: list[Any] = [tree]
    around = function.__qualname__.split(".")[-2:-1]
    names = ["outer", *(name for name in around if name.isidentifier()), tree.name]
    outer: Any = ast.parse(f"def outer({', '.join(code.co_freevars)}):\n    return 0")
    for name in reversed(names[1:-1]):
        within: Any = ast.parse(f"class {name}:\n    pass")
        within.body[0].body = body
        body = within.body
    of_file = [name for name in names[1:2] if name not in code.co_freevars]
    outer.body[0].body = [ast.copy_location(ast.Global(of_file), outer.body[0]), *body] if of_file else body
    found: Any = compile(outer, code.co_filename, "exec", dont_inherit=True)
    for name in names:
        found = next(each for each in found.co_consts if isinstance(each, types.CodeType) and each.co_name == name)
    return _lower(found, code.co_firstlineno - 1)


def _lower(code: types.CodeType, lines: int) -> types.CodeType:
    """A code so many lines further down in its file."""
    within = tuple(_lower(each, lines) if isinstance(each, types.CodeType) else each for each in code.co_consts)
    return code.replace(co_firstlineno=code.co_firstlineno + lines, co_consts=within)


def _operations(code: types.CodeType) -> Iterator[Any]:
    """The effect of a code, wherever it stands in a file: a name that the file imports is called in another way."""
    yield code.co_argcount, code.co_kwonlyargcount, code.co_varnames
    for each in dis.get_instructions(code):
        if isinstance(each.argval, types.CodeType):
            yield from _operations(each.argval)
        elif each.opcode in dis.hasconst:
            is_text = isinstance(each.argval, str)  # a tree's lines have another margin than the file's
            yield type(each.argval), each.argval.split() if is_text else repr(each.argval)
        elif each.opname not in _OF_CALLS:
            leads = each.opcode in dis.hasjrel or each.opcode in dis.hasjabs
            yield each.opname.replace("METHOD", "ATTR"), None if leads else each.argval


class _Arithmetics(ast.NodeTransformer):
    """Let operators and calls be calls of :class:`_Arithmetic`."""

    def _call(self, name: str, node: ast.expr, *arguments: ast.expr, keywords: Any = ()) -> ast.expr:
        place = {each: getattr(node, each) for each in node._attributes}  # which compile() asks for
        function = ast.Attribute(ast.Name(_MARK, ast.Load(), **place), name, ast.Load(), **place)
        return ast.Call(function, [*arguments], [*keywords], **place)

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        name = _OPERATORS.get(type(node.op))
        return node if name is None else self._call(name, node, node.left, node.right)

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.stmt:
        self.generic_visit(node)
        name = _OPERATORS.get(type(node.op))
        if name is None or any(isinstance(each, ast.Call) for each in ast.walk(node.target)):
            return node
        before: Any = copy.deepcopy(node.target)
        before.ctx = ast.Load()
        called = ast.copy_location(ast.Constant(name), node)
        value = self._call("in_place", node.value, called, before, node.value)
        return ast.copy_location(ast.Assign([node.target], value), node)

    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id in _PLAIN:
            return node
        return self._call("call", node, node.func, *node.args, keywords=node.keywords)


class _Arithmetic:
    """Functions that compute as machine code does."""

    @staticmethod
    def product(a: Any, b: Any) -> Any:
        """``a @ b``; each sum is in the order of the indices."""
        exact = a @ b  # raises what Python raises
        a, b = np.asarray(a), np.asarray(b)
        if not exact.size or not 0 < a.ndim <= 2 or not 0 < b.ndim <= 2 or "f" not in a.dtype.kind + b.dtype.kind:
            return exact
        left, right = a if a.ndim == 2 else a[None], b if b.ndim == 2 else b[:, None]
        sums = np.add.accumulate(left[:, :, None] * right, axis=1)[:, -1] if a.shape[-1] else exact
        return sums.reshape(exact.shape)[()]

    @staticmethod
    def power(base: Any, exponent: Any, of_arrays: bool = False) -> Any:
        """``base ** exponent``; ``of_arrays``, as NumPy's loop has it for one exponent of all."""
        exact = base**exponent if not of_arrays else np.power(base, exponent)
        if np.asarray(exact).dtype.kind != "f":
            return exact
        if np.ndim(exponent) == 0:
            of_arrays = of_arrays or isinstance(base, np.ndarray)
            if exponent == 1 or (of_arrays and exponent in (-1, 0.5, 2)):
                return exact
            if exponent == 2:
                return base * base
        return _if_near(_of_c("pow", 2)(base, exponent), exact, _OF_C)

    @staticmethod
    def in_place(name: str, before: Any, value: Any) -> Any:
        """``before @= value``, or ``before **= value``."""
        result = getattr(_Arithmetic, name)(before, value)
        if isinstance(before, np.ndarray):
            before[...] = result
            return before
        return result

    @staticmethod
    def call(function: Any, /, *arguments: Any, **keywords: Any) -> Any:
        """A call of a function of the user's, of NumPy's, or of an array."""
        if type(function) is types.FunctionType and function.__module__.partition(".")[0] not in _FOREIGN:
            return twin(function)(*arguments, **keywords)
        if function is map and arguments:
            return map(functools.partial(_Arithmetic.call, arguments[0]), *arguments[1:], **keywords)
        if type(function) is types.BuiltinMethodType and isinstance(function.__self__, np.ndarray):
            of_numpy = getattr(np, function.__name__, None) if function.__name__ in METHODS else None
            if _replaced(of_numpy) is None:
                return function(*arguments, **keywords)
            function, arguments = of_numpy, (function.__self__, *arguments)
        if type(function) is types.MethodType:
            return twin(function.__func__)(function.__self__, *arguments, **keywords)
        if type(function) is functools.partial:
            keywords = function.keywords | keywords
            return _Arithmetic.call(function.func, *function.args, *arguments, **keywords)
        if (plain := getattr(function, "py_func", None)) is not None:  # numba.njit has marked it
            return twin(plain)(*arguments, **keywords)
        other = _replaced(function)
        return function(*arguments, **keywords) if other is None else other(*arguments, **keywords)


def _replaced(function: Any) -> Callable | None:
    """A function that computes as machine code does where NumPy's function or Python's does not."""
    try:
        return _others().get(function)
    except TypeError:  # it has no hash
        return None


@functools.cache
def _others() -> dict[Any, Callable]:
    found: dict[Any, Callable] = {print: _nothing}
    for function, (name, n) in OF_C.items():
        if name not in _EXACT:
            own = _of_library if isinstance(function, np.ufunc) else _of_python
            found[function] = functools.partial(own, function, name, n)
    for function in (np.sum, np.mean, np.prod, np.std, np.var, np.average):
        found[function] = functools.partial(_in_order, function)
    found |= dict.fromkeys((np.matmul, np.dot), _product)
    found |= {np.power: _power_of_arrays, pow: _power, np.linalg.norm: _norm, math.log: _logarithm}
    return found | {function: functools.partial(_ours, function, ours) for function, ours in REPLACED.items()}


def _if_near(mine: Any, theirs: Any, share: float) -> Any:
    """The machine code's result, if it differs from NumPy's by rounding only; otherwise NumPy's."""
    a, b = np.asarray(mine), np.asarray(theirs)
    finite = np.abs(b[np.isfinite(b)])
    if share >= 1.0 and a.shape == b.shape:
        return mine  # no digit of theirs is sure
    most = share * finite.max() if finite.size else 0.0
    near = a.shape == b.shape and np.allclose(a, b, rtol=0.0, atol=most + 1e-300, equal_nan=True)
    return mine if near else theirs


def _of_library(function: Callable, name: str, n: int, *arguments: Any, out: Any = None, where: Any = True) -> Any:
    """A function of :mod:`uvms_mj.compiler.libm` in place of NumPy's."""
    result = _if_near(_of_c(name, n)(*arguments), function(*arguments), _OF_C)
    return result if out is None else _put(result, out, where)


def _of_python(function: Callable, name: str, n: int, *arguments: Any) -> Any:
    """As :func:`_of_library`, of a function of Python's, which raises where that does not."""
    exact = function(*arguments)
    return float(_if_near(FUNCTIONS[name](*map(float, arguments)), exact, _OF_C))


def _logarithm(x: Any, *base: Any) -> Any:
    exact = math.log(x, *base)
    parts = [FUNCTIONS["log"](float(each)) for each in (x, *base)]
    return float(_if_near(parts[0] / parts[1] if base else parts[0], exact, _OF_C))


def _nothing(*_: Any, **__: Any) -> None:
    """The run has printed it already."""


@functools.cache
def _of_c(name: str, n: int) -> Callable:
    """The compiler's function of this name in C, in plain Python, of the entries of arrays."""
    of_entries = np.frompyfunc(FUNCTIONS[name], n, 1)

    def call(*arguments: Any) -> Any:
        floats = (np.asarray(each, float) for each in arguments)
        return np.asarray(of_entries(*floats), float)[()]

    return call


def _put(result: Any, out: Any, where: Any = True) -> Any:
    (out,) = out if isinstance(out, tuple) else (out,)
    np.copyto(out, result, casting="unsafe", where=where)
    return out


def _in_order(function: Callable, a: Any, *further: Any, **keywords: Any) -> Any:
    """A sum in the order of the indices, whatever the order in memory."""
    return function(np.ascontiguousarray(a) if np.ndim(a) else a, *further, **keywords)


def _product(a: Any, b: Any, out: Any = None) -> Any:
    result = _Arithmetic.product(a, b) if np.ndim(a) and np.ndim(b) else a * b
    return result if out is None else _put(result, out)


def _power(base: Any, exponent: Any, *further: Any) -> Any:
    return pow(base, exponent, *further) if further else _Arithmetic.power(base, exponent)


def _power_of_arrays(base: Any, exponent: Any, out: Any = None, *, where: Any = True) -> Any:
    result = _Arithmetic.power(base, exponent, of_arrays=True)
    return result if out is None else _put(result, out, where)


def _norm(x: Any, *further: Any, **keywords: Any) -> Any:
    exact = np.linalg.norm(np.ascontiguousarray(x), *further, **keywords)
    order = keywords.get("ord", further[0] if further else None)
    whole = keywords.get("axis", further[1] if len(further) > 1 else None) is None
    if not whole or not (order is None or (order, np.ndim(x)) in (("fro", 2), (2, 1))):
        return exact
    flat = np.ravel(x)
    return np.reshape(np.sqrt(_Arithmetic.product(flat, flat)), np.shape(exact))[()]


def _ours(theirs: Callable, ours: Any, *arguments: Any, **keywords: Any) -> Any:
    """A function of :mod:`uvms_mj.compiler.library` in NumPy's place; where NumPy raises, it raises."""
    exact, result = theirs(*arguments, **keywords), twin(ours)(*arguments, **keywords)
    return result if isinstance(exact, tuple) else _if_near(result, exact, _lost(arguments[0]) if arguments else np.inf)


def _lost(matrix: Any) -> float:
    """The share of the largest number by which two ways to solve equations may differ: rounding times the condition."""
    try:
        if np.ndim(matrix) != 2:
            return _OF_C
        condition = float(np.linalg.cond(matrix))
    except ValueError:  # of several arrays
        return _OF_C
    except np.linalg.LinAlgError:
        return np.inf
    return max(_OF_C, 1e3 * np.finfo(float).eps * condition) if np.isfinite(condition) else np.inf
