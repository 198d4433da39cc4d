"""Expressions and calls."""

import ast
import inspect
import types
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from llvmlite import ir

from .arrays import Arrays
from .builtin import FUNCTIONS, METHODS, PROPERTIES
from .cells import CELLS
from .emission import Module
from .scalars import COMPARISONS, operator_name
from .values import (
    BOOL,
    FLAG,
    INT,
    NONE,
    NOTHING,
    OUTSIDE,
    WORD,
    Kind,
    Memory,
    Place,
    Value,
    bundle,
    contiguous,
    items_of,
    leaves_of,
    scalar,
)

MISSING = object()
"""What a name stands for that is not known when compiling."""


@dataclass
class Variable:
    """A name's present kind, and where its LLVM values are. ``block`` is the list of statements that has set it.
    ``numbers`` are the values themselves, of a name that is bound once and not in a loop, so that the binding is on
    every way to each use."""

    kind: Kind
    slots: list[ir.Value]
    block: int
    steady: bool = True
    numbers: tuple[Any, ...] | None = None

    @property
    def at_place(self) -> bool:
        """Whether it is known when compiling where it is in a record with cells."""
        return bool(self.numbers) and isinstance(self.numbers[0], Place)


class Expressions(Arrays):
    """The expressions of one function."""

    def __init__(self, unit: Module, function: types.FunctionType, source: Sequence[str], fused: bool) -> None:
        super().__init__(unit, function, source, fused)
        self.variables: dict[str, Variable] = {}
        self.constants: dict[str, Value] = {}  # names that stand for one number
        self.evaluated: dict[int, Value] = {}  # by the ids of nodes: what is known already
        self.assigned: set[str] = set()  # names that have a value here, whichever way led here
        self.locals = set(function.__code__.co_varnames) | set(function.__code__.co_cellvars)
        seen = inspect.getclosurevars(function)
        self.names = {**seen.builtins, **seen.globals, **seen.nonlocals}

    def lasting(self, value: Value) -> Value:
        """A value that outlives its statement: of a new array in a loop, which each turn makes again, a copy."""
        raise NotImplementedError  # lifetimes have it

    # names

    def known(self, node: ast.expr) -> Any:
        """What a global name, such as ``math.sqrt``, stands for; MISSING for anything else."""
        if isinstance(node, ast.Name):
            if node.id in self.locals:
                return MISSING
            if node.id not in self.names:
                self.mistake(f"{node.id} is not defined")
            return self.names[node.id]
        if not isinstance(node, ast.Attribute):
            return MISSING
        owner = self.known(node.value)
        if not isinstance(owner, types.ModuleType | type):
            return MISSING
        try:
            return getattr(owner, node.attr)
        except AttributeError:
            return self.mistake(f"{ast.unparse(node.value)} has no {node.attr!r}")

    def frozen(self, value: Any) -> Value:
        """A global number, tuple or array as a constant."""
        if value is None:
            return Value(NONE, ())
        if isinstance(value, tuple):
            return bundle([self.frozen(each) for each in value])
        if isinstance(value, np.ndarray):
            return self._frozen_array(value)
        if isinstance(value, np.void):
            self.lack("a global record is not a constant; write its numbers")
        if isinstance(value, list | dict | set | str):
            self.lack(f"a {type(value).__name__} is not a number; write a tuple or np.array([...])")
        return self.constant(value)

    def _frozen_array(self, array: np.ndarray) -> Value:
        if type(array) is not np.ndarray or array.dtype not in (np.dtype("f8"), INT, BOOL) or not array.dtype.isnative:
            self.lack(f"a constant array has numbers of float64, int64 or bool, not {array.dtype}")
        base = {"f": np.dtype("f8"), "i": INT, "b": BOOL}[array.dtype.kind]
        memory = self.unit.constant_array(np.ascontiguousarray(array, base))
        why = "it is a constant of the compiled code; keep what changes in a state or a memory"
        return Value(contiguous(base, array.shape, f"lacks: {why}"), (memory,), roots=frozenset({OUTSIDE}))

    def _Name(self, node: ast.Name) -> Value:
        if node.id not in self.locals:
            return self.frozen(self.known(node))
        if node.id not in self.assigned:
            some = any(node.id in each for each in (self.variables, self.constants))
            self.mistake(f"{node.id} {'may have' if some else 'has'} no value here")
        if node.id in self.constants:
            return self.constants[node.id]
        return self.variable(node.id)

    def variable(self, name: str) -> Value:
        raise NotImplementedError  # statements have it

    # values

    def visit(self, node: ast.AST) -> Any:
        """Write the code of an expression or a statement."""
        name = type(node).__name__
        visit = getattr(self, f"_{name}", None)
        return visit(node) if visit is not None else self.lack(f"the language has no {_SPOKEN.get(name, name)}")

    def value(self, node: ast.expr) -> Value:
        if id(node) in self.evaluated:
            return self.evaluated.pop(id(node))
        return self.visit(node)

    def number(self, node: ast.expr, base: np.dtype) -> ir.Value:
        """A number, converted to a type."""
        return self.converted(self.value(node), base)

    def test(self, node: ast.expr) -> ir.Value:
        """A truth value."""
        if isinstance(node, ast.BoolOp):
            return self._deciding([partial(self._tested, each) for each in node.values], node.op).llvm[0]
        return self._is_true(self.value(node))

    def _tested(self, node: ast.expr) -> Value:
        return scalar(self.test(node), BOOL)

    def _is_true(self, value: Value) -> ir.Value:
        if value.kind.is_none or value.kind.items is not None:
            return FLAG(bool(value.kind.items))
        if value.kind.is_array and value.kind.sizes and value.kind.size == 1:
            value = self.element(value, [WORD(0)] * len(value.kind.sizes))
        if not value.kind.is_number:
            self.mistake(f"{value.kind.described()} is neither true nor false; use .any() or .all()")
        return self.truth(value)

    def _Constant(self, node: ast.Constant) -> Value:
        if isinstance(node.value, str | bytes | complex):
            self.lack(f"the language has no {type(node.value).__name__}")
        return self.frozen(node.value)

    def _Tuple(self, node: ast.Tuple | ast.List) -> Value:
        if any(isinstance(each, ast.Starred) for each in node.elts):
            self.lack("the language has no *x")
        return bundle([self.value(each) for each in node.elts])

    _List = _Tuple

    def _Attribute(self, node: ast.Attribute) -> Value:
        known = self.known(node)
        if known is not MISSING:
            return self.frozen(known)
        owner = self.value(node.value)
        if owner.kind.base.fields is None and (owner.kind.is_array or owner.kind.is_number):
            if node.attr in PROPERTIES:
                return PROPERTIES[node.attr](self, owner)
            words = f"{owner.kind.described()} has no {node.attr!r}"
            return self.lack(f"{words} in the language") if hasattr(np.ndarray, node.attr) else self.mistake(words)
        if node.attr == "shape" and owner.kind.is_array:
            return self.shape_tuple(owner)
        return self.read(self.field(owner, node.attr, node.value))

    def _Subscript(self, node: ast.Subscript) -> Value:
        if (known := self._table(node)) is not None:
            return known
        array = self.value(node.value)
        part = self.part(array, node.slice)
        return part if array.kind.items is not None else self.read(part)

    def _table(self, node: ast.Subscript) -> Value | None:
        """An entry of a global tuple of numbers, which is a constant array."""
        known = self.known(node.value)
        if not isinstance(known, tuple) or isinstance(node.slice, ast.Slice):
            return None
        array = np.array(known) if all(isinstance(each, int | float | tuple) for each in known) else None
        if array is None or array.dtype.kind not in "fi" or isinstance(node.slice, ast.Constant):
            return None
        return self.read(self.part(self._frozen_array(array), node.slice))

    def _BinOp(self, node: ast.BinOp) -> Value:
        return self.binary(operator_name(node.op), self.value(node.left), self.value(node.right))

    def _UnaryOp(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            return self.negation(scalar(self.test(node.operand), BOOL))
        value = self.value(node.operand)
        if value.kind.base == BOOL and not (value.kind.is_array and isinstance(node.op, ast.Invert)):
            self.lack("a truth value of Python's has other signs and bits than NumPy's; write not x, or int(x)")
        if isinstance(node.op, ast.UAdd):
            return self.copied(value) if value.kind.is_array else value
        function = self.negative if isinstance(node.op, ast.USub) else self.inverted
        return self.elementwise(function, value)

    def _Compare(self, node: ast.Compare) -> Value:
        values = [self.value(node.left)]
        if len(node.ops) == 1:
            return self._compared(node.ops[0], values[0], self.value(node.comparators[0]), node)
        return self._deciding([partial(self._link, node, k, values) for k in range(len(node.ops))], ast.And())

    def _link(self, node: ast.Compare, k: int, values: list[Value]) -> Value:
        """One comparison of a chain; what it compares with is evaluated only if it is reached."""
        if len(values) == k + 1:
            values.append(self.value(node.comparators[k]))
        result = self._compared(node.ops[k], values[k], values[k + 1], node)
        if not result.kind.is_number:
            self.mistake("a chain of comparisons is of numbers; use & between arrays")
        return result

    def _compared(self, operator: ast.cmpop, left: Value, right: Value, node: ast.Compare) -> Value:
        name = type(operator).__name__
        if name in ("Is", "IsNot"):
            if not right.kind.is_none:
                self.lack("`is` compares with None only")
            return self.constant(left.kind.is_none == (name == "Is"))
        if left.kind.items is not None or right.kind.items is not None:
            if left.kind.items is None or right.kind.items is None or name not in ("Eq", "NotEq"):
                self.lack("a tuple is compared with a tuple only, by == or !=")
            pairs = [items_of(left), items_of(right)]
            if any(item.constant is None for items in pairs for item in items):
                self.lack("tuples are compared if their numbers are known when compiling")
            same = [item.constant for item in pairs[0]] == [item.constant for item in pairs[1]]
            return self.constant(same == (name == "Eq"))
        if name not in COMPARISONS:
            self.lack("the language has no `in`; write the comparisons")
        if left.kind.is_none or right.kind.is_none:
            if name not in ("Eq", "NotEq"):
                self.mistake("None is not compared with a number")
            return self.constant((left.kind.is_none == right.kind.is_none) == (name == "Eq"))
        return self.elementwise(lambda a, b: self.comparison(COMPARISONS[name], a, b), left, right)

    def _BoolOp(self, node: ast.BoolOp) -> Value:
        return self._deciding([partial(self.value, each) for each in node.values], node.op)

    def _deciding(self, operands: Sequence[Callable[[], Value]], operator: ast.boolop) -> Value:
        """The first operand that decides, or the last one, as in Python; those behind it are not evaluated."""
        found, is_and = [], isinstance(operator, ast.And)
        for operand in operands:
            value = operand()
            test = self._is_true(value) if operand is not operands[-1] else None
            if test is None or isinstance(test, ir.Constant):
                if test is None or bool(test.constant) != is_and:
                    break
                continue
            decided, further = self.at.append_basic_block(), self.at.append_basic_block()
            self.at.cbranch(test, *((further, decided) if is_and else (decided, further)))
            found.append((value, decided))
            self.at.position_at_end(further)
        if not found:
            return value
        found.append((value, self.at.block))
        return self.merged(found, self.at.append_basic_block())

    def _IfExp(self, node: ast.IfExp) -> Value:
        test = self.test(node.test)
        if isinstance(test, ir.Constant):
            return self.value(node.body if test.constant else node.orelse)
        found = []
        ends = [self.at.append_basic_block() for _ in range(3)]
        self.at.cbranch(test, ends[0], ends[1])
        for block, part in zip(ends, (node.body, node.orelse), strict=False):
            self.at.position_at_end(block)
            found.append((self.value(part), self.at.block))
        return self.merged(found, ends[2])

    def merged(self, found: Sequence[tuple[Value, ir.Block]], end: ir.Block) -> Value:
        """The value of whichever block is left for ``end``, where the code then goes on: an array is a pointer, and
        remains the one that it is."""
        values = [value for value, _ in found]
        kind = self.unified(values)
        if kind.is_array and all(value.fresh for value in values):
            return self._merged_copies(found, end, kind)
        slots = [self.entry.alloca(each) for each in kind.llvm]
        for value, block in found:
            self.at.position_at_end(block)
            value = self.lasting(value)
            for slot, number in zip(slots, self.adapted(value, kind), strict=True):
                self.at.store(number, slot)
            self.at.branch(end)
        self.at.position_at_end(end)
        numbers = tuple(self.at.load(slot, typ=each) for slot, each in zip(slots, kind.llvm, strict=True))
        new = any(leaf.fresh for value in values for leaf in leaves_of(value))
        roots = frozenset({Memory(own=True)} if new else ()).union(*(value.roots for value in values))
        return Value(kind, numbers, False, not new and all(value.steady for value in values), roots=roots)

    def _merged_copies(self, found: Sequence[tuple[Value, ir.Block]], end: ir.Block, kind: Kind) -> Value:
        """One new array of several, of which nobody holds any."""
        out = self.temporary(kind.base, kind.sizes)
        for value, block in found:
            self.at.position_at_end(block)
            self.fill(out, value)
            self.at.branch(end)
        self.at.position_at_end(end)
        return out

    def unified(self, values: Sequence[Value]) -> Kind:
        """The one kind of several values of which one is taken. Refuses those of different kinds."""
        kinds = [value.kind for value in values]
        if all(kind.is_number for kind in kinds):
            if {kind.base for kind in kinds} == {BOOL, INT}:
                self.lack("it is a truth value here, and a number there")
            return Kind(self.base_of(values))
        first = kinds[0]
        if any(kind.readonly != first.readonly for kind in kinds):
            self.may_write(*kinds)
        if first.items is not None and all(k.items is not None and len(k.items) == len(first.items) for k in kinds):
            columns = zip(*(items_of(value) for value in values), strict=True)
            return Kind(NOTHING, items=tuple(self.unified(column) for column in columns))
        if all(kind.is_array and kind.shape == first.shape for kind in kinds):
            if all(kind.strides == first.strides and kind.base == first.base for kind in kinds):
                return replace(first, readonly=next((kind.readonly for kind in kinds if kind.readonly), ""))
            self.lack("it is an array in one order or of one type here, and in another one there")
        if all(kind.base == first.base and kind.shape == first.shape and kind.items is None for kind in kinds):
            return replace(first, readonly=next((kind.readonly for kind in kinds if kind.readonly), ""))
        return self.lack(f"it is {' or '.join(dict.fromkeys(kind.described() for kind in kinds))}")

    def adapted(self, value: Value, kind: Kind) -> Sequence[ir.Value]:
        """The LLVM values of a value as one of another kind."""
        if kind.is_number:
            return (self.converted(value, kind.base),)
        if kind.items is not None:
            pairs = zip(items_of(value), kind.items, strict=True)
            return tuple(each for item, its in pairs for each in self.adapted(item, its))
        if value.place is None:
            return value.llvm
        memory = self.unit.cells.in_memory(self, value)
        self.may_write(memory.kind)
        return memory.llvm

    def may_write(self, *kinds: Kind) -> None:
        """Note that arrays in the memory of cells are written, since what writes one of several does not say which."""
        for kind in kinds:
            if kind.readonly.startswith(CELLS):
                self.unit.cells.writes_memory(kind.readonly)

    # calls

    def _Call(self, node: ast.Call) -> Value:
        result = self.call(node)
        return result if result is not None else Value(NONE, ())

    def call(self, node: ast.Call) -> Value | None:
        known = self.known(node.func)
        if known is MISSING and isinstance(node.func, ast.Attribute):
            method = METHODS.get(node.func.attr)
            if method is None:
                self.lack(f"the language has no method {node.func.attr}")
            return FUNCTIONS[method](self, [node.func.value, *node.args], self._keywords(node))
        if known is MISSING:
            self.lack(f"{ast.unparse(node.func)} is not a function that is known when compiling")
        if (written := _hashed(known)) in FUNCTIONS:
            return FUNCTIONS[written](self, node.args, self._keywords(node))
        if written in self.unit.intrinsics:
            return self.unit.intrinsics[written](self, [self._word(each) for each in node.args])
        known = getattr(known, "py_func", known)  # of a function that numba.njit has marked
        known = self.unit.instead.get(known, known)
        if known is np.lib.stride_tricks.as_strided:
            self.forbid("as_strided reaches numbers beyond an array; write slices")
        if not isinstance(known, types.FunctionType) or known.__module__.partition(".")[0] in _FOREIGN:
            self.lack(f"the language has no {ast.unparse(node.func)}")
        return self.unit.call(self, known, self._arguments(known, node), bool(self.rounding))

    def _word(self, node: ast.expr) -> ir.Value:
        """An integer, or the address of an array."""
        value = self.value(node)
        if value.place is not None:
            return WORD(value.place.offset)
        return self.at.ptrtoint(value.llvm[0], WORD) if value.kind.is_array else self.converted(value, INT)

    def _keywords(self, node: ast.Call) -> dict[str, ast.expr]:
        if any(isinstance(each, ast.Starred) for each in node.args) or any(each.arg is None for each in node.keywords):
            self.lack("the language has no *x and **x")
        return {str(each.arg): each.value for each in node.keywords}

    def _arguments(self, function: types.FunctionType, node: ast.Call) -> list[Value]:
        """The arguments in the order of the function's parameters."""
        keywords = self._keywords(node)
        values = [self.value(each) for each in node.args]
        named = {name: self.value(each) for name, each in keywords.items()}
        try:
            bound = inspect.signature(function, follow_wrapped=False).bind(*values, **named)
        except TypeError as error:
            self.mistake(f"{function.__name__}: {error}")
        bound.apply_defaults()
        if hasattr(function, "__wrapped__"):
            self.lack("a function with a decorator is not compiled")
        if bound.kwargs or len(bound.args) != function.__code__.co_argcount:
            parameters = inspect.signature(function, follow_wrapped=False).parameters.values()
            if any(each.kind in (each.VAR_POSITIONAL, each.VAR_KEYWORD) for each in parameters):
                self.lack(f"{function.__name__} takes any number of arguments")
        given = [*bound.args, *bound.kwargs.values()]
        return [each if isinstance(each, Value) else self.frozen(each) for each in given]


def _hashed(known: Any) -> Any:
    try:
        hash(known)
    except TypeError:
        return None
    return known


_FOREIGN = ("numpy", "scipy", "math", "builtins")
"""Packages whose functions are in the language by name only."""
_SPOKEN = {
    "ListComp": "list comprehension; write a loop",
    "GeneratorExp": "generator; write a loop",
    "Lambda": "lambda; write a function with def at the top of the file",
    "Dict": "dict",
    "Set": "set",
    "JoinedStr": "str",
    "NamedExpr": ":=",
    "Starred": "*x",
    "With": "with",
    "Try": "try",
    "Delete": "del",
    "Import": "import within a function",
    "ImportFrom": "import within a function",
    "FunctionDef": "function within a function; define it at the top of the file",
    "Global": "global; keep what changes in a state or a memory",
    "Nonlocal": "nonlocal",
    "ClassDef": "class within a function",
    "Match": "match",
}
