"""Arithmetic of numbers, as NumPy and Python do it."""

import ast
import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from llvmlite import ir

from . import library
from .emission import Emission
from .refusals import CONVERSION, DIVISION, OVERFLOW, RAISED
from .symbols import LIBM
from .values import BOOL, DOUBLE, FLAG, FLOAT, INT, RANK, SCALARS, WORD, Value, scalar, whole

_BITS = {"BitAnd": "and_", "BitOr": "or_", "BitXor": "xor", "LShift": "shl", "RShift": "ashr"}
COMPARISONS = {"Lt": "<", "LtE": "<=", "Gt": ">", "GtE": ">=", "Eq": "==", "NotEq": "!="}
_KNOWN = {"Add": operator.add, "Sub": operator.sub, "Mult": operator.mul}
_OVERFLOW = {"Add": "sadd", "Sub": "ssub", "Mult": "smul"}
_COMPARED: dict[str, Callable[[Any, Any], bool]] = {
    **{"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge},
    **{"==": operator.eq, "!=": operator.ne},
}
_INSTRUCTIONS = ("sqrt", "floor", "ceil", "trunc", "rint", "fabs")
"""Functions of the C library that processors have instructions for."""
_PARTS = {"sin": ("sincos", 0), "cos": ("sincos", 1)}
"""Functions that are a part of the result of another one of :mod:`.libm`."""
_LARGEST = 2.0**63


def of_libm(module: ir.Module, symbol: str, n: int) -> ir.Function:
    """A function of :mod:`.libm` of n floats, by its symbol. It depends on them alone, so that LLVM calls it once for
    equal ones. What optimizes the module defines it (:func:`.targets.optimize`)."""
    code = module.globals.get(symbol)
    if code is None:
        both = ir.LiteralStructType([DOUBLE, DOUBLE])
        returned = both if any(symbol == LIBM + of for of, _ in _PARTS.values()) else DOUBLE
        code = ir.Function(module, ir.FunctionType(returned, [DOUBLE] * n), symbol)
        code.attributes.update(("nounwind", "readnone"))
    return code


class Scalars(Emission):
    """Operations on numbers."""

    trying = False
    """Whether an exception of Python's would be caught here."""

    def constant(self, value: object) -> Value:
        """A Python number."""
        if type(value) not in (bool, int, float, np.bool_, np.int64, np.float64):
            self.lack(f"a {type(value).__name__} is not a number of Python's, of float64 or of int64")
        if isinstance(value, bool | np.bool_):
            return scalar(FLAG(bool(value)), BOOL)
        if isinstance(value, int | np.int64):
            if not -(1 << 63) <= int(value) < 1 << 63:
                self.lack("an integer has 64 bits")
            return whole(int(value))
        return scalar(DOUBLE(float(value)), FLOAT)  # type: ignore[arg-type]  # a float

    def common(self, values: Sequence[Value]) -> np.dtype:
        """The type of a result of several numbers, at least an integer."""
        return max((value.kind.base for value in values), key=RANK.index, default=INT)

    def converted(self, value: Value, base: np.dtype) -> ir.Value:
        """A number, converted to a type. A float becomes an integer only by ``int``."""
        if not value.kind.is_number:
            self.mistake(f"a number is needed here, not {value.kind.described()}")
        (number,), of = value.llvm, value.kind.base
        if of == FLOAT and base == INT:
            self.lack("an integer is needed here, not a float; write int(...)")
        if of == base:
            return number
        if isinstance(number, ir.Constant):
            python = {INT: int, FLOAT: float, BOOL: bool}[base]
            return SCALARS[base](python(number.constant))
        if base == BOOL:
            if of == FLOAT:
                return self.at.fcmp_unordered("!=", number, DOUBLE(0.0))
            return self.at.icmp_signed("!=", number, WORD(0))
        if of == BOOL:
            number = self.at.zext(number, WORD)
        return number if base == INT else self.at.sitofp(number, DOUBLE)

    def float_of(self, value: Value) -> ir.Value:
        return self.converted(value, FLOAT)

    # operators

    def operation(self, name: str, left: Value, right: Value) -> Value:
        """``left + right`` and so on; ``name`` is the name of the operator's class in ast."""
        a, b = left.constant, right.constant
        base = self.common([left, right])
        if base == BOOL and name in _KNOWN and self.unit.checked:
            self.lack("NumPy adds truth values in a way of its own; write int(a) + int(b)")
        if base != FLOAT and name in _KNOWN and a is not None and b is not None:
            return self.constant(_KNOWN[name](int(a), int(b)))
        if name == "Pow":
            return self.power(left, right)
        if name in _BITS:
            return self._bits(name, left, right)
        base = FLOAT if name == "Div" or base == FLOAT else INT
        x, y = self.converted(left, base), self.converted(right, base)
        if name in _KNOWN:
            word = {"Mult": "mul"}.get(name, name.lower())
            if base == FLOAT:
                return scalar(getattr(self.at, f"f{word}")(x, y, flags=self.rounding), FLOAT)
            return scalar(getattr(self.at, word)(x, y), INT)
        if name == "Div":
            return scalar(self.at.fdiv(x, y), FLOAT)
        if name not in ("FloorDiv", "Mod"):
            self.lack(f"the language has no {name}")
        if base == FLOAT:
            return self.written(library.floor_divide if name == "FloorDiv" else library.remainder, [left, right])
        return self._whole_division(name, x, y)

    def of_python(self, name: str, left: Value, right: Value) -> Value:
        """As :meth:`operation`, of two numbers of Python. Its integers grow where a processor's wrap, and the quotient
        of two of them is rounded once: a user's function ends early there."""
        if self.trying and name in ("Div", "FloorDiv", "Mod"):  # Python's floats raise, NumPy's do not
            self.demand(self.comparison("!=", right, whole(0)).llvm[0], RAISED)
        if self.trying and name == "Pow":
            self.lack("a power within try: a float of Python's may be too large; write np.power")
        known = left.constant is not None and right.constant is not None
        if not self.unit.checked or self.ours or known or FLOAT in (left.kind.base, right.kind.base):
            return self.operation(name, left, right)
        x, y = self.converted(left, INT), self.converted(right, INT)
        if name == "Pow" and right.constant is not None and right.constant >= 0:
            return self._whole_power(left, int(right.constant), wide=True)
        if name in _OVERFLOW and self.common([left, right]) == INT:
            both = self.at.call(self._overflowing(_OVERFLOW[name]), [x, y])
            self.demand(self.at.not_(self.at.extract_value(both, 1)), OVERFLOW)
            return scalar(self.at.extract_value(both, 0), INT)
        result = self.operation(name, left, right)
        if name == "Div":
            self._demand_float(left, right)
        if name == "LShift":
            self.demand(self.at.icmp_signed("==", self.at.ashr(result.llvm[0], y), x), OVERFLOW)
        return result

    def _overflowing(self, name: str) -> ir.Function:
        kind = ir.FunctionType(ir.LiteralStructType([WORD, FLAG]), [WORD, WORD])
        return self.at.module.declare_intrinsic(f"llvm.{name}.with.overflow", [WORD], kind)

    def _demand_float(self, *values: Value) -> None:
        """End a user's function early where an integer is no float."""
        for value in values:
            if value.kind.base == INT and value.constant is None:
                far = self.at.add(value.llvm[0], WORD(1 << 53))
                self.demand(self.at.icmp_unsigned("<=", far, WORD(1 << 54)), OVERFLOW)

    def reciprocal(self, value: Value) -> Value:
        """``1.0 / value``."""
        if value.kind.base != FLOAT:
            self.lack("np.reciprocal of integers is an integer; write 1.0 / x")
        return self.operation("Div", self.constant(1.0), value)

    def written(self, function, values: Sequence[Value]) -> Value:
        """The value of a function of :mod:`.library`."""
        result = self.unit.call(self, function, values, bool(self.rounding))
        assert result is not None
        return result

    def _bits(self, name: str, left: Value, right: Value) -> Value:
        base = self.common([left, right])
        if base == FLOAT:
            self.mistake("only integers have bits")
        if name in ("LShift", "RShift"):
            base, by = INT, self.converted(right, INT)
            if isinstance(by, ir.Constant):
                if not 0 <= by.constant < 64:
                    self.lack("an integer is shifted by 0 to 63 bits")
            elif self.unit.checked:
                self.demand(self.at.icmp_unsigned("<", by, WORD(64)), CONVERSION)
        return scalar(getattr(self.at, _BITS[name])(self.converted(left, base), self.converted(right, base)), base)

    def _whole_division(self, name: str, a: ir.Value, b: ir.Value) -> Value:
        """Division of integers, rounded down. The processor rounds towards zero, and traps where it can't divide."""
        if isinstance(a, ir.Constant) and isinstance(b, ir.Constant) and b.constant:
            return whole(a.constant // b.constant if name == "FloorDiv" else a.constant % b.constant)
        if self.unit.checked:
            self.demand(self.at.icmp_signed("!=", b, WORD(0)), DIVISION)
            negative = self.at.icmp_signed("==", b, WORD(-1))  # the least integer by -1 traps, too
            b = self.at.select(negative, WORD(1), b)  # divided by 1, the rest is 0
            a = self.at.select(negative, self.at.neg(a), a)
        quotient, rest = self.at.sdiv(a, b), self.at.srem(a, b)
        odd = self.at.and_(
            self.at.icmp_signed("!=", rest, WORD(0)), self.at.icmp_signed("<", self.at.xor(rest, b), WORD(0))
        )
        if name == "FloorDiv":
            return scalar(self.at.sub(quotient, self.at.zext(odd, WORD)), INT)
        return scalar(self.at.select(odd, self.at.add(rest, b), rest), INT)

    def power(self, left: Value, right: Value, of_arrays: bool = False) -> Value:
        """``left ** right``; ``of_arrays``, as NumPy's loop has it for one exponent of all: 0.5 is a square root there,
        and -1 a quotient. An exponent that is known only in the run takes the same ways as one that is known before."""
        exponent = right.constant if right.kind.base != FLOAT or isinstance(right.llvm[0], ir.Constant) else None
        if FLOAT not in (left.kind.base, right.kind.base) and (exponent is None or exponent < 0):
            self.lack("the exponent of an integer must be a constant of at least 0; write float(...) ** n")
        if left.kind.base != FLOAT and right.kind.base != FLOAT:
            return self._whole_power(left, int(exponent))  # type: ignore[arg-type]  # None is refused above
        x = scalar(self.float_of(left), FLOAT)
        ways: dict[float, Callable[[], Value]] = {1.0: lambda: x, 2.0: lambda: self.operation("Mult", x, x)}
        if of_arrays:
            ways[0.5] = lambda: self.c_function("sqrt", [x])
        if of_arrays and self.unit.checked:
            ways[-1.0] = lambda: self.operation("Div", self.constant(1.0), x)
        if exponent is not None and exponent in ways:
            return ways[exponent]()
        result = self.c_function("pow", [x, right])
        if exponent is not None or not self.unit.checked or self.ours:
            return result
        for known, way in ways.items():
            is_known = self.comparison("==", right, self.constant(known)).llvm[0]
            result = self.chosen(is_known, way(), result)
        return result

    def _whole_power(self, base: Value, exponent: int, wide: bool = False) -> Value:
        if base.constant is not None:
            return self.constant(int(base.constant) ** exponent)
        multiplied = self.of_python if wide else self.operation
        result, square = whole(1), scalar(self.converted(base, INT), INT)
        while exponent:
            if exponent & 1:
                result = multiplied("Mult", result, square)
            exponent >>= 1
            square = multiplied("Mult", square, square) if exponent else square
        return result

    def negative(self, value: Value) -> Value:
        base = FLOAT if value.kind.base == FLOAT else INT
        number = self.converted(value, base)
        if isinstance(number, ir.Constant):
            return self.constant(-number.constant)
        return scalar((self.at.fneg if base == FLOAT else self.at.neg)(number), base)

    def inverted(self, value: Value) -> Value:
        """``~value``."""
        if value.kind.base == FLOAT:
            self.mistake("only integers have bits")
        return scalar(self.at.not_(self.converted(value, value.kind.base)), value.kind.base)

    def negation(self, value: Value) -> Value:
        """``not value``."""
        test = self.converted(value, BOOL)
        return self.constant(not test.constant) if isinstance(test, ir.Constant) else scalar(self.at.not_(test), BOOL)

    def comparison(self, sign: str, left: Value, right: Value) -> Value:
        base = FLOAT if FLOAT in (left.kind.base, right.kind.base) else INT
        a, b = self.converted(left, base), self.converted(right, base)
        if isinstance(a, ir.Constant) and isinstance(b, ir.Constant):
            return self.constant(_COMPARED[sign](a.constant, b.constant))
        if base == INT:
            return scalar(self.at.icmp_signed(sign, a, b), BOOL)
        compare = self.at.fcmp_unordered if sign == "!=" else self.at.fcmp_ordered  # with NaN, only != is true
        return scalar(compare(sign, a, b), BOOL)

    def chosen(self, test: ir.Value, yes: Value, no: Value) -> Value:
        """One of two numbers."""
        base = BOOL if yes.kind.base == no.kind.base == BOOL else self.common([yes, no])
        return scalar(self.at.select(test, self.converted(yes, base), self.converted(no, base)), base)

    def is_nan(self, value: Value) -> ir.Value:
        number = self.float_of(value)
        return self.at.fcmp_unordered("uno", number, number)

    # functions

    def better(self, sign: str, best: Value, other: Value) -> Value:
        """As ``min`` and ``max`` of Python: the first one, unless the other one is less (greater)."""
        return self.chosen(self.comparison(sign, other, best).llvm[0], other, best)

    def extreme(self, sign: str, left: Value, right: Value) -> Value:
        """As ``np.minimum`` and ``np.maximum``: NaN if either is NaN."""
        keep = self.comparison(f"{sign}=", left, right).llvm[0]
        if left.kind.base == FLOAT:
            keep = self.at.or_(keep, self.is_nan(left))
        return self.chosen(keep, left, right)

    def c_function(self, name: str, values: Sequence[Value]) -> Value:
        """A function of the C library, of floats: an instruction of the processor, or a function of :mod:`.libm`."""
        numbers = [self.float_of(value) for value in values]
        if name == "copysign":
            code = self.at.module.declare_intrinsic("llvm.copysign", [DOUBLE], ir.FunctionType(DOUBLE, [DOUBLE] * 2))
        elif name in _INSTRUCTIONS:
            code = self.at.module.declare_intrinsic(f"llvm.{name}", [DOUBLE])
        elif all(isinstance(number, ir.Constant) for number in numbers):  # with the bits of plain Python
            return self.constant(self.unit.own[name](*(number.constant for number in numbers)))
        else:
            name, part = _PARTS.get(name, (name, None))
            result = self.at.call(of_libm(self.at.module, LIBM + name, len(numbers)), numbers)
            return scalar(result if part is None else self.at.extract_value(result, part), FLOAT)
        return scalar(self.at.call(code, numbers), FLOAT)

    def sign(self, value: Value) -> Value:
        """-1, 0 or 1; of NaN, NaN."""
        base = FLOAT if value.kind.base == FLOAT else INT
        x = scalar(self.converted(value, base), base)
        zero, one = (self.constant(float(i)) if base == FLOAT else whole(i) for i in (0, 1))
        flat = self.chosen(self.comparison("==", x, zero).llvm[0], zero, x)
        minus = self.chosen(self.comparison("<", x, zero).llvm[0], self.negative(one), flat)
        return self.chosen(self.comparison(">", x, zero).llvm[0], one, minus)

    def magnitude(self, value: Value) -> Value:
        """``abs``."""
        if value.kind.base == FLOAT:
            return self.c_function("fabs", [value])
        x = scalar(self.converted(value, INT), INT)
        return self.chosen(self.comparison("<", x, whole(0)).llvm[0], self.negative(x), x)

    def as_integer(self, value: Value) -> Value:
        """``int(value)``. Only a number that fits an integer becomes one, as in Python."""
        if value.kind.base != FLOAT:
            return scalar(self.converted(value, INT), INT)
        number = self.float_of(value)
        if isinstance(number, ir.Constant) and abs(number.constant) < _LARGEST:
            return whole(int(number.constant))
        size = self.c_function("fabs", [value]).llvm[0]
        self.demand(self.at.fcmp_ordered("<", size, DOUBLE(_LARGEST)), CONVERSION)
        return scalar(self.at.fptosi(number, WORD), INT)

    def fits_python(self, name: str, value: Value) -> Value:
        """``math.floor`` and others that give an integer. A shipped kernel gets it as a float, which never fails."""
        rounded = self.c_function(name, [value])
        return self.as_integer(rounded) if self.unit.checked else rounded

    def truth(self, value: Value) -> ir.Value:
        """A number as a truth value."""
        return self.converted(value, BOOL)


def operator_name(node: ast.operator) -> str:
    return type(node).__name__
