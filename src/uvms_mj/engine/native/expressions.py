"""Translation of a kernel's expressions to LLVM. :mod:`.translator` has the statements and says what a kernel is."""

import ast
import inspect
import math
import types
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

import numpy as np
from llvmlite import ir

from .values import BOOL, BYTE, DOUBLE, FLAG, FLOAT, INT, NUMBERS, SCALARS, WORD, Kind, Value, scalar, view

_MATH = {math.sqrt: "sqrt", math.exp: "exp", math.log: "log", math.sin: "sin", math.cos: "cos", np.sin: "sin"}
_MATH |= {math.floor: "floor", np.floor: "floor"}
_BITS = {"BitAnd": "and_", "BitOr": "or_", "BitXor": "xor", "LShift": "shl", "RShift": "ashr"}
_COMPARISONS = {"Lt": "<", "LtE": "<=", "Gt": ">", "GtE": ">=", "Eq": "==", "NotEq": "!="}


class Untranslatable(TypeError):
    """A kernel uses Python beyond the language of kernels."""


INTRINSICS: dict[Any, Callable[[ir.IRBuilder, Sequence[ir.Value]], Value | None]] = {}
"""Functions that translate to code of their own; their arguments are 64-bit integers."""


class Expressions:
    """The expressions of one function."""

    at: ir.IRBuilder
    entry: ir.IRBuilder

    def __init__(self, function: types.FunctionType, call: Callable[..., Value | None], fused: bool) -> None:
        self.function, self.call_function = function, call
        self.rounding = ("contract",) if fused else ()  # of a sum of products: once, or at each operation
        self.variables: dict[str, tuple[Kind, list[ir.Value]]] = {}
        self.names = {name: value for names in inspect.getclosurevars(function)[2::-1] for name, value in names.items()}
        self.line = 1

    def refuse(self, reason: str) -> NoReturn:
        code = self.function.__code__
        line = code.co_firstlineno + self.line - 1
        raise Untranslatable(f"{code.co_filename}:{line}, {self.function.__qualname__}: {reason}")

    # memory

    def place(self, node: ast.expr) -> tuple[ir.Value, np.dtype]:
        """Pointer to an entry of an array or a field of a record, and its type."""
        if isinstance(node, ast.Subscript):
            return self._entry(self.value(node.value), node.slice)
        if not isinstance(node, ast.Attribute):
            self.refuse(f"{ast.unparse(node)} is not a variable, an entry of an array or a field of a record")
        record = self.value(node.value)
        fields = record.kind.base.fields if record.kind.inner is None else None
        if fields is None or node.attr not in fields:
            self.refuse(f"{ast.unparse(node.value)} has no field {node.attr}")
        dtype, offset = fields[node.attr][:2]
        return self._shifted(record.llvm[0], WORD(offset)), dtype

    def _entry(self, array: Value, index: ast.expr) -> tuple[ir.Value, np.dtype]:
        indices = [self.number(each, INT) for each in (index.elts if isinstance(index, ast.Tuple) else [index])]
        inner, base = array.kind.inner, array.kind.base
        if inner is None or len(indices) != 1 + len(inner):
            self.refuse("an array has as many indices as dimensions")
        if any(isinstance(each, ir.Constant) and each.constant < 0 for each in indices):
            self.refuse("an index counts from the front")
        at = indices[0]
        for size, each in zip(inner, indices[1:], strict=True):
            at = self.at.add(self.at.mul(at, WORD(size)), each)
        return self._shifted(array.llvm[0], self.at.mul(at, WORD(base.itemsize))), base

    def _shifted(self, pointer: ir.Value, distance: ir.Value) -> ir.Value:
        return self.at.gep(pointer, [distance], source_etype=BYTE)

    # values

    def value(self, node: ast.expr) -> Value:
        visit = getattr(self, f"_{type(node).__name__}", None)
        if visit is None:
            self.refuse(f"kernels have no {type(node).__name__}: {ast.unparse(node)}")
        return visit(node)

    def number(self, node: ast.expr, base: np.dtype) -> ir.Value:
        """A number, converted to a type."""
        return self.converted(self.value(node), base)

    def converted(self, value: Value, base: np.dtype) -> ir.Value:
        """A number, converted to a type. A float becomes an integer only by ``int``."""
        (number, *_), of = value.llvm, value.kind.base
        if not value.kind.is_number or (of == FLOAT and base == INT):
            self.refuse(f"a number of type {base.name} is needed here")
        if of == base:
            return number
        if base == BOOL:
            if of == FLOAT:
                return self.at.fcmp_unordered("!=", number, DOUBLE(0.0))
            return self.at.icmp_signed("!=", number, WORD(0))
        if of == BOOL:
            number = self.at.zext(number, WORD)
        if base == INT:
            return number
        return DOUBLE(float(number.constant)) if isinstance(number, ir.Constant) else self.at.sitofp(number, DOUBLE)

    def known(self, node: ast.expr) -> Any:
        """What a global name of the function stands for, such as ``math.sqrt``; None for anything else."""
        if isinstance(node, ast.Name) and node.id not in self.variables:
            if node.id not in self.names:
                self.refuse(f"{node.id} has no value")
            return self.names[node.id]
        return getattr(self.known(node.value), node.attr, None) if isinstance(node, ast.Attribute) else None

    def constant(self, value: Any) -> Value:
        base = NUMBERS.get(type(value))
        if base is None:
            self.refuse(f"{value!r} is not a number")
        return scalar(SCALARS[base](value), base)

    def _Constant(self, node: ast.Constant) -> Value:
        return self.constant(node.value)

    def _Name(self, node: ast.Name) -> Value:
        if node.id not in self.variables:
            return self.constant(self.known(node))
        kind, slots = self.variables[node.id]
        return Value(kind, tuple(self.at.load(s, typ=t) for s, t in zip(slots, kind.llvm, strict=True)))

    def _Attribute(self, node: ast.Attribute) -> Value:
        known = self.known(node)
        return self._read(node) if known is None else self.constant(known)

    def _Subscript(self, node: ast.Subscript) -> Value:
        of = node.value
        if isinstance(of, ast.Attribute) and of.attr == "shape":
            array, axis = self.value(of.value), node.slice
            if array.kind.inner is not None and isinstance(axis, ast.Constant) and axis.value == 0:
                return scalar(array.llvm[1], INT)
        return self._read(node)

    def _read(self, node: ast.expr) -> Value:
        pointer, dtype = self.place(node)
        if dtype == BOOL:
            return scalar(self.at.trunc(self.at.load(pointer, typ=BYTE), FLAG), BOOL)
        if dtype in SCALARS:
            return scalar(self.at.load(pointer, typ=SCALARS[dtype]), dtype)
        return view(pointer, dtype)

    def _BinOp(self, node: ast.BinOp) -> Value:
        return self.operation(node.op, self.value(node.left), self.value(node.right))

    def operation(self, operator: ast.operator, left: Value, right: Value) -> Value:
        name = type(operator).__name__
        floats = name == "Div" or FLOAT in (left.kind.base, right.kind.base)
        base = FLOAT if floats else INT
        a, b = self.converted(left, base), self.converted(right, base)
        if name in ("Add", "Sub", "Mult"):
            name = {"Mult": "mul"}.get(name, name.lower())
            if floats:
                return scalar(getattr(self.at, f"f{name}")(a, b, flags=self.rounding), FLOAT)
            return scalar(getattr(self.at, name)(a, b), INT)
        if name == "Div":
            return scalar(self.at.fdiv(a, b), FLOAT)
        if not floats and name in _BITS:
            return scalar(getattr(self.at, _BITS[name])(a, b), INT)
        if floats or name not in ("FloorDiv", "Mod"):
            self.refuse(f"kernels have no {name} of {base.name}")
        quotient, rest = self.at.sdiv(a, b), self.at.srem(a, b)  # rounded towards zero; Python rounds down
        odd = self.at.and_(
            self.at.icmp_signed("!=", rest, WORD(0)), self.at.icmp_signed("<", self.at.xor(rest, b), WORD(0))
        )
        if name == "FloorDiv":
            return scalar(self.at.sub(quotient, self.at.zext(odd, WORD)), INT)
        return scalar(self.at.select(odd, self.at.add(rest, b), rest), INT)

    def _UnaryOp(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            return scalar(self.at.not_(self.number(node.operand, BOOL)), BOOL)
        if not isinstance(node.op, ast.USub):
            self.refuse(f"kernels have no {type(node.op).__name__}")
        value = self.value(node.operand)
        base = FLOAT if value.kind.base == FLOAT else INT
        number = self.converted(value, base)
        if isinstance(number, ir.Constant):
            return self.constant(-number.constant)
        return scalar((self.at.fneg if base == FLOAT else self.at.neg)(number), base)

    def _Compare(self, node: ast.Compare) -> Value:
        if len(node.ops) != 1 or type(node.ops[0]).__name__ not in _COMPARISONS:
            self.refuse("a comparison is one of < <= > >= == != between two numbers")
        return self._comparison(
            _COMPARISONS[type(node.ops[0]).__name__], self.value(node.left), self.value(node.comparators[0])
        )

    def _comparison(self, operator: str, left: Value, right: Value) -> Value:
        base = FLOAT if FLOAT in (left.kind.base, right.kind.base) else INT
        a, b = self.converted(left, base), self.converted(right, base)
        if base == INT:
            return scalar(self.at.icmp_signed(operator, a, b), BOOL)
        compare = self.at.fcmp_unordered if operator == "!=" else self.at.fcmp_ordered  # with NaN, only != is true
        return scalar(compare(operator, a, b), BOOL)

    def _BoolOp(self, node: ast.BoolOp) -> Value:
        result = self.entry.alloca(FLAG)
        first, *others = node.values
        self.at.store(self.number(first, BOOL), result)
        for other in others:
            so_far = self.at.load(result, typ=FLAG)
            with self.at.if_then(so_far if isinstance(node.op, ast.And) else self.at.not_(so_far)):
                self.at.store(self.number(other, BOOL), result)
        return scalar(self.at.load(result, typ=FLAG), BOOL)

    def _IfExp(self, node: ast.IfExp) -> Value:
        with self.at.if_else(self.number(node.test, BOOL)) as (then, otherwise):
            with then:
                value = self.value(node.body)
                base = value.kind.base
                number = self.converted(value, base)
                result = self.entry.alloca(number.type)
                self.at.store(number, result)
            with otherwise:
                self.at.store(self.number(node.orelse, base), result)
        return scalar(self.at.load(result, typ=number.type), base)

    # calls

    def _Call(self, node: ast.Call) -> Value:
        result = self.call(node)
        if result is None:
            self.refuse(f"{ast.unparse(node.func)} returns nothing; an annotation would say bool, int or float")
        return result

    def call(self, node: ast.Call) -> Value | None:
        function = self.known(node.func)
        arguments = [self.value(each) for each in node.args]
        if node.keywords:
            self.refuse("arguments have no names here")
        if function in (min, max):
            best, *others = arguments
            for other in others:
                best = self._better("<" if function is min else ">", best, other)
            return best
        if function in (float, int):
            base = FLOAT if function is float else INT
            if base == INT and arguments[0].kind.base == FLOAT:
                return scalar(self.at.fptosi(arguments[0].llvm[0], WORD), INT)
            return scalar(self.converted(arguments[0], base), base)
        if function is abs or function in _MATH:
            return scalar(self._c_function(_MATH.get(function, "fabs"), arguments), FLOAT)
        if function is np.sign:
            return self._sign(self.converted(arguments[0], FLOAT))
        if function in INTRINSICS:
            return INTRINSICS[function](self.at, [self.converted(each, INT) for each in arguments])
        if not isinstance(function, types.FunctionType):
            self.refuse(f"kernels can't call {ast.unparse(node.func)}")
        return self.call_function(self.at, function, arguments, fused=bool(self.rounding))

    def _better(self, operator: str, best: Value, other: Value) -> Value:
        """As in Python: the first one, unless the other one is less (greater)."""
        base = FLOAT if FLOAT in (best.kind.base, other.kind.base) else INT
        chosen = self._comparison(operator, other, best).llvm[0]
        return scalar(self.at.select(chosen, self.converted(other, base), self.converted(best, base)), base)

    def _c_function(self, name: str, arguments: Sequence[Value]) -> ir.Value:
        code = self.at.module.declare_intrinsic(f"llvm.{name}", [DOUBLE])
        return self.at.call(code, [self.converted(each, FLOAT) for each in arguments])

    def _sign(self, x: ir.Value) -> Value:
        """-1, 0 or 1; of NaN, NaN."""
        zero, one = DOUBLE(0.0), DOUBLE(1.0)
        flat = self.at.select(self.at.fcmp_ordered("==", x, zero), zero, x)
        minus = self.at.select(self.at.fcmp_ordered("<", x, zero), DOUBLE(-1.0), flat)
        return scalar(self.at.select(self.at.fcmp_ordered(">", x, zero), one, minus), FLOAT)
