"""Expressions and calls."""

import ast
import builtins
import inspect
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from llvmlite import ir

from .builtin import FUNCTIONS, METHODS, PROPERTIES
from .cells import CELLS
from .emission import Module
from .forms import Forms, Given
from .known import LIST, MISSING
from .scalars import COMPARISONS, operator_name
from .values import (
    BOOL,
    INT,
    NONE,
    NOTHING,
    WORD,
    Form,
    Kind,
    Memory,
    Place,
    Value,
    bundle,
    is_dense,
    items_of,
    known_object,
    leaves_of,
    scalar,
    whole,
)


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


class Expressions(Forms):
    """The expressions of one function."""

    def __init__(self, unit: Module, function: types.FunctionType, source: Sequence[str], fused: bool) -> None:
        super().__init__(unit, function, source, fused)
        self.variables: dict[str, Variable] = {}
        self.constants: dict[str, Value] = {}  # names that stand for one number
        self.evaluated: dict[int, Value] = {}  # by the ids of nodes: what is known already
        self.of_turn: frozenset[str] = frozenset()  # names of the comprehensions around this place
        self.assigned: set[str] = set()  # names that have a value here, whichever way led here
        self.locals = set(function.__code__.co_varnames) | set(function.__code__.co_cellvars)
        seen = inspect.getclosurevars(function)
        self.names = {**vars(builtins), **seen.builtins, **seen.globals, **seen.nonlocals}

    def lasting(self, value: Value) -> Value:
        """A value that outlives its statement: of a new array in a loop, which each turn makes again, a copy."""
        raise NotImplementedError  # lifetimes have it

    # names

    def _Name(self, node: ast.Name) -> Value:
        if node.id not in self.locals:
            return self.frozen(self.known(node))
        if node.id not in self.assigned:
            some = any(node.id in each for each in (self.variables, self.constants))
            self.mistake(f"{node.id} {'may have' if some else 'has'} no value here")
        if node.id in self.constants:
            return self.constants[node.id]
        return self.variable(node.id)

    def kind_of_name(self, name: str) -> Kind | None:
        """The kind of what a local name stands for, if it has a value here."""
        return self.variables[name].kind if name in self.assigned and name in self.variables else None

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
            *before, last = [partial(self._tested, each) for each in node.values]
            return self.deciding(before, node.op, last).llvm[0]
        return self.is_true(self.value(node))

    def _tested(self, node: ast.expr) -> Value:
        return scalar(self.test(node), BOOL)

    def _Attribute(self, node: ast.Attribute) -> Value:
        known = self.known(node)
        if known is not MISSING:
            return self.frozen(known)
        owner = self.value(node.value)
        if (known := self.object_of(owner)) is not MISSING and (known := self.attribute_of(known, node)) is not MISSING:
            return self.frozen(known)
        if (field := self.field_of(owner, node.attr)) is not None:
            return field
        if owner.kind.base.fields is None and (owner.kind.is_array or owner.kind.is_number):
            if node.attr in PROPERTIES:
                self._demand_numpys(owner, node.attr)
                return PROPERTIES[node.attr](self, owner)
            words = f"{owner.kind.described()} has no {node.attr!r}"
            return self.lack(f"{words} in the language") if hasattr(np.ndarray, node.attr) else self.mistake(words)
        if node.attr == "shape" and owner.kind.is_array:
            return self.shape_tuple(owner)
        return self._of_numpy(self.read(self.field(owner, node.attr, node.value)))

    def _Subscript(self, node: ast.Subscript) -> Value:
        if (known := self._table(node)) is not None:
            return known
        if (known := self.known(node.value)) is np.r_ or known is np.c_:
            return self._joined(node, known)
        array = self.value(node.value)
        if self.is_dict(array):
            return self.of_dict(array, node)
        part = self.part(array, node.slice)
        return part if array.kind.items is not None else self._of_numpy(self.read(part))

    def _joined(self, node: ast.Subscript, by: Any) -> Value:
        """``np.r_[...]`` and ``np.c_[...]`` of numbers and arrays; NumPy itself says what they are."""
        parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if any(isinstance(each, ast.Slice | ast.Starred | ast.Constant) and not _is_number(each) for each in parts):
            self.lack("the language has np.r_ and np.c_ of numbers and arrays; write np.arange, or np.concatenate")
        values = [self.as_array(self.value(each)) for each in parts]
        with self.refused_by_numpy():
            order = by[tuple(self.numbered(values))] if len(values) > 1 else by[self.numbered(values)[0]]
            like = by[tuple(map(self.like, values))] if len(values) > 1 else by[self.like(values[0])]
        return self.laid(self.gathered(values, order), like)

    @staticmethod
    def _of_numpy(value: Value) -> Value:
        """A number that NumPy gives."""
        return replace(value, of_numpy=True) if value.kind.is_number else value

    def _table(self, node: ast.Subscript) -> Value | None:
        """An entry of a global tuple or list of numbers, or of tuples of numbers, which is a constant array."""
        known = self.known(node.value)
        if type(known) not in (tuple, list) or not known or isinstance(node.slice, ast.Slice | ast.Constant):
            return None
        kinds = {(type(each), len(each)) if type(each) in (tuple, list) else (type(each), -1) for each in known}
        are_rows = len(kinds) == 1 and min(kinds, key=str)[1] > 0
        numbers = [number for each in known for number in each] if are_rows else known
        if not all(type(number) in (int, float) for number in numbers):
            return None
        row = self.read(self.part(self._frozen_array(np.array(known)), node.slice))
        if not row.kind.is_array:
            return row
        entries = [self.element(row, [WORD(k)]) for k in range(row.kind.sizes[0])]
        return bundle(entries, LIST if type(known[0]) is list else None)

    def _BinOp(self, node: ast.BinOp) -> Value:
        name, left, right = operator_name(node.op), self.value(node.left), self.value(node.right)
        if (found := self.reduced_operation(name, left, right)) is not None:
            return found
        found = self.binary(name, left, right)
        return self._of_numpy(found) if name == "MatMult" else found

    def _UnaryOp(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            return self.negation(scalar(self.test(node.operand), BOOL))
        value = self.value(node.operand)
        if value.kind.base == BOOL and not (value.kind.is_array and isinstance(node.op, ast.Invert)):
            self.lack("a truth value of Python's has other signs and bits than NumPy's; write not x, or int(x)")
        if isinstance(node.op, ast.UAdd):
            return self.copied(value, keeps_order=True) if value.kind.is_array else value
        function = self.negative if isinstance(node.op, ast.USub) else self.inverted
        return self.elementwise(function, value)

    def _Compare(self, node: ast.Compare) -> Value:
        values = [self.value(node.left)]
        if len(node.ops) == 1:
            return self._compared(node.ops[0], values[0], self.value(node.comparators[0]), node)
        *before, last = [partial(self._link, node, k, values) for k in range(len(node.ops))]
        return self.deciding(before, ast.And(), last)

    def _link(self, node: ast.Compare, k: int, values: list[Value]) -> Value:
        """One comparison of a chain; its right side is evaluated only if it is reached."""
        if len(values) == k + 1:
            values.append(self.value(node.comparators[k]))
        result = self._compared(node.ops[k], values[k], values[k + 1], node)
        if not result.kind.is_number:
            self.mistake("a chain of comparisons is of numbers; use & between arrays")
        return result

    def _compared(self, operator: ast.cmpop, left: Value, right: Value, node: ast.Compare) -> Value:
        name = type(operator).__name__
        if name in ("Is", "IsNot"):
            same = self.same_object(left, right)
            return same if name == "Is" else self.negation(same)
        if name in ("In", "NotIn"):
            found = self.contains(left, right)
            return found if name == "In" else self.negation(found)
        known = [self.object_of(each) for each in (left, right)]
        items = [each.kind.items is not None for each in (left, right)]
        if (known != [MISSING] * 2 or any(items)) and not any(each.kind.is_array for each in (left, right)):
            if name not in ("Eq", "NotEq"):
                self.lack("the language compares texts, tuples and objects by == or != only")
            found = self.equal(left, right)
            return found if name == "Eq" else self.negation(found)
        if left.kind.is_none or right.kind.is_none:
            if name not in ("Eq", "NotEq"):
                self.mistake("None is not compared with a number")
            return self.constant((left.kind.is_none == right.kind.is_none) == (name == "Eq"))
        return self.elementwise(lambda a, b: self.comparison(COMPARISONS[name], a, b), left, right)

    def _BoolOp(self, node: ast.BoolOp) -> Value:
        *before, last = [partial(self.value, each) for each in node.values]
        return self.deciding(before, node.op, last)

    def deciding(
        self, operands: Iterable[Callable[[], Value]], operator: ast.boolop, last: Callable[[], Value]
    ) -> Value:
        """The first operand that decides, or the last one, as in Python; operands behind it are not evaluated."""
        found, is_and = [], isinstance(operator, ast.And)
        for operand in operands:
            value = operand()
            test = self.is_true(value)
            if isinstance(test, ir.Constant):
                if bool(test.constant) != is_and:
                    break
                continue
            decided, further = self.at.append_basic_block(), self.at.append_basic_block()
            self.at.cbranch(test, *((further, decided) if is_and else (decided, further)))
            found.append((value, decided))
            self.at.position_at_end(further)
        else:
            value = last()
        if not found:
            return value
        found.append((value, self.at.block))
        return self.merged(found, self.at.append_basic_block())

    def _NamedExpr(self, node: ast.NamedExpr) -> Value:
        value = self.value(node.value)
        with self.on_a_way():  # the expression around it may not reach it
            self.assign(node.target, value)
        return self._Name(ast.Name(node.target.id, ast.Load()))

    def on_a_way(self) -> AbstractContextManager[None]:
        raise NotImplementedError  # statements have it

    def assign(self, target: ast.expr, value: Value) -> None:
        raise NotImplementedError  # statements have it

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
        remains what it was."""
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
        if not is_dense(kind):
            self.lack("it is a part of a new array; write .copy() behind it")
        out = replace(self.temporary(kind.base, kind.sizes), kind=replace(kind, readonly=""))
        for value, block in found:
            self.at.position_at_end(block)
            self.fill(out, value)
            self.at.branch(end)
        self.at.position_at_end(end)
        return out

    def unified(self, values: Sequence[Value]) -> Kind:
        """The one kind of several values of which one is taken. Refuses values of different kinds."""
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
            if all(kind.form == first.form for kind in kinds):
                return Kind(NOTHING, items=tuple(self.unified(column) for column in columns), form=first.form)
        if all(kind.is_array and kind.shape == first.shape for kind in kinds):
            if all(kind.strides == first.strides and kind.base == first.base for kind in kinds):
                return replace(first, readonly=next((kind.readonly for kind in kinds if kind.readonly), ""))
            self.lack("it is an array in one order or of one type here, and in another one there")
        same = [kind.base == first.base and kind.shape == first.shape and kind.form == first.form for kind in kinds]
        if all(same) and all(kind.items is None for kind in kinds):
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
        node = self._starred(node)
        known = self.known(node.func)
        if known is MISSING and isinstance(node.func, ast.Attribute):
            owner = self.value(node.func.value)
            found = self._of_object(owner, node)
            if found is not MISSING:
                return found
            method = METHODS.get(node.func.attr)
            if method is None:
                self.lack(f"the language has no method {node.func.attr}")
            self._demand_numpys(owner, node.func.attr)
            found = FUNCTIONS[method](self, [Given(owner), *node.args], self._keywords(node))
            return found if found is None or node.func.attr in _TO_PYTHON else self._of_numpy(found)
        if known is MISSING and not isinstance(node.func, ast.Name | ast.Attribute):
            return self._of_value(self.value(node.func), node)
        if known is MISSING and isinstance(node.func, ast.Name):
            return self._of_value(self._Name(node.func), node)
        if isinstance(getattr(known, "__self__", None), np.ufunc) and isinstance(node.func, ast.Attribute):
            method = METHODS.get(node.func.attr)  # as in np.add.reduce(x)
            if method is None:
                self.lack(f"the language has no {ast.unparse(node.func)}")
            return FUNCTIONS[method](self, [node.func.value, *node.args], self._keywords(node))
        return self._of_known(known, node)

    def _demand_numpys(self, owner: Value, name: str) -> None:
        """Refuse what a number of NumPy's has, and one of Python's has not, unless it surely is NumPy's."""
        if owner.kind.is_number and not owner.of_numpy and self.unit.checked:
            self.lack(
                f"whether this number is Python's, which has no {name!r}, or NumPy's is not known; write np.float64(x)"
            )

    def _of_object(self, owner: Value, node: ast.Call) -> Any:
        """A method of what is no array; MISSING if it is one."""
        assert isinstance(node.func, ast.Attribute)
        name = node.func.attr
        if (known := self.object_of(owner)) is not MISSING and (
            known := self.attribute_of(known, node.func)
        ) is not MISSING:
            return self._of_known(known, node)
        if (field := self.field_of(owner, name)) is not None:
            return self._of_value(field, node)
        form = owner.kind.form
        if isinstance(form, Form) and isinstance(form.of, type) and form.of not in (list, dict):
            if name == "_replace" and issubclass(form.of, tuple) and not node.args:
                return self.replaced(owner, {name: self.value(each) for name, each in self._keywords(node).items()})
            method = inspect.getattr_static(form.of, name, None)
            if isinstance(method, types.FunctionType):
                return self._of_known(method, ast.Call(node.func, [Given(owner), *node.args], node.keywords))
        found = self.method_of(owner, name, node)
        return MISSING if found is None else found

    def _of_value(self, function: Value, node: ast.Call) -> Value | None:
        """A call of what a local name, an entry or a field stands for."""
        form, known = function.kind.form, self.object_of(function)
        if self.trying and known is MISSING:
            self.lack("within try, functions of NumPy alone are called; write the call before it")
        if isinstance(form, Form) and isinstance(form.of, types.FunctionType):
            captured = dict(zip(form.keys, items_of(function)[1:], strict=True))
            return self.unit.call(self, form.of, self._arguments(form.of, node, captured), bool(self.rounding))
        if isinstance(form, Form) and form.of is partial:
            first, *rest = items_of(function)[1:]
            n = len(rest) - len(form.keys)
            named = {each.arg: each for each in node.keywords}
            held = [ast.keyword(name, Given(each)) for name, each in zip(form.keys, rest[n:], strict=True)]
            keywords = [*(each for each in held if each.arg not in named), *node.keywords]
            return self._of_value(first, ast.Call(node.func, [*map(Given, rest[:n]), *node.args], keywords))
        if known is MISSING:
            return self.lack(f"{ast.unparse(node.func)} is not a function that is known when compiling")
        return self._of_known(known, node)

    def _of_known(self, known: Any, node: ast.Call) -> Value | None:
        if isinstance(known, types.MethodType) and not self.is_foreign(known.__func__):
            owner = Given(self.frozen(known.__self__))
            return self._of_known(known.__func__, ast.Call(node.func, [owner, *node.args], node.keywords))
        if self.trying and not _ends_early(known):
            self.lack("within try, functions of NumPy alone are called; write the call before it")
        if isinstance(known, str):
            self.mistake(f"{known!r} can't be called")
        if (written := _hashed(known)) in FORMS:
            found = FORMS[written](self, node)
            return self._of_numpy(found) if found is not None and written is np.float64 else found
        if written in FUNCTIONS:
            found = FUNCTIONS[written](self, node.args, self._keywords(node))
            is_numpys = found is not None and (isinstance(written, np.ufunc) or written in _NUMPYS)
            return self._of_numpy(found) if is_numpys else found
        if written in self.unit.intrinsics:
            return self.unit.intrinsics[written](self, [self._word(each) for each in node.args])
        known = getattr(known, "py_func", known)  # of a function that numba.njit has marked
        known = self.unit.instead.get(_hashed(known), known)
        if known is np.lib.stride_tricks.as_strided:
            self.forbid("as_strided reaches numbers beyond an array; write slices")
        if isinstance(known, type) and not self.is_foreign(known):
            named = {name: self.value(each) for name, each in self._keywords(node).items()}
            made = self.made_by(known, [self.value(each) for each in node.args], named)
            if made is not None:
                return made
        if not isinstance(known, types.FunctionType) or known.__module__.partition(".")[0] in _FOREIGN:
            self.lack(f"the language has no {ast.unparse(node.func)}")
        result = self.unit.call(self, known, self._arguments(known, node), bool(self.rounding))
        if (
            result is not None
            and isinstance(result.kind.form, Form)
            and isinstance(result.kind.form.of, types.FunctionType)
        ):
            self.lack("a function that another one returns is not compiled")
        return result

    def _starred(self, node: ast.Call) -> ast.Call:
        """A call whose arguments behind stars are given one by one."""
        if any(isinstance(each, ast.Starred) for each in node.args) or any(each.arg is None for each in node.keywords):
            keywords = []
            for each in node.keywords:
                if each.arg is not None:
                    keywords.append(each)
                    continue
                entries = self.entries(self.value(each.value))
                keywords += [ast.keyword(str(key), Given(value)) for key, value in entries.items()]
            if len({each.arg for each in keywords}) < len(keywords):
                self.mistake("an argument is given twice")
            return ast.Call(node.func, self.spread(node.args), keywords)
        return node

    def _word(self, node: ast.expr) -> ir.Value:
        """An integer, or the address of an array."""
        value = self.value(node)
        if value.place is not None:
            return WORD(value.place.offset)
        return self.at.ptrtoint(value.llvm[0], WORD) if value.kind.is_array else self.converted(value, INT)

    def _keywords(self, node: ast.Call) -> dict[str, ast.expr]:
        return {str(each.arg): each.value for each in node.keywords}

    def _arguments(
        self, function: types.FunctionType, node: ast.Call, captured: Mapping[str, Value] = types.MappingProxyType({})
    ) -> list[Value]:
        """The arguments in the order of the function's parameters."""
        keywords = self._keywords(node)
        values = [self.value(each) for each in node.args]
        named = {name: self.value(each) for name, each in keywords.items()}
        try:
            signature = inspect.signature(function, follow_wrapped=False)
            bound = signature.bind(*values, **named, **captured)
        except TypeError as error:
            self.mistake(f"{function.__name__}: {error}")
        bound.apply_defaults()
        if hasattr(function, "__wrapped__"):
            self.lack("a function with a decorator is not compiled")
        return [self._argument(signature.parameters[name].kind, given) for name, given in bound.arguments.items()]

    def _argument(self, kind: Any, given: Any) -> Value:
        """One argument; of ``*x`` and ``**x``, the tuple or the dict."""
        if kind is inspect.Parameter.VAR_POSITIONAL:
            return bundle([self.held(each) for each in given])
        if kind is inspect.Parameter.VAR_KEYWORD:
            return self.dict_of({name: self.held(each) for name, each in given.items()})
        return given if isinstance(given, Value) else self.frozen(given)


# what is called as a form


def _sum_of(at: Expressions, node: ast.Call) -> Value | None:
    """A function of one thing that it runs over: of a generator, a tuple of its values."""
    known = at.known(node.func)
    if known is sum and node.args and _is_lazy(at, node.args[0]):
        return _added(at, node)
    args = [Given(bundle(at.listed(each))) if _is_lazy(at, each) else each for each in node.args]
    if len(args) == 1 and not node.keywords:
        value = at.value(args[0])
        if at.is_dict(value):
            value = bundle([at.frozen(key) for key in at.entries(value)])
        args = [Given(value)]
    return FUNCTIONS[known](at, args, at._keywords(node))


def _added(at: Expressions, node: ast.Call) -> Value:
    """``sum`` of a generator: each value is added before the next one is made, which may change it."""
    start = [*node.args[1:], *(each.value for each in node.keywords if each.arg == "start")]
    if len(start) > 1 or len(node.args) + len(node.keywords) > 1 + len(start):
        at.mistake("sum takes what it runs over, and start")
    result = at.value(start[0]) if start else whole(0)
    for each in at.each_of(node.args[0]):
        result = at.binary("Add", result, each)
    return result


def _is_lazy(at: Expressions, node: ast.expr) -> bool:
    if isinstance(node, ast.GeneratorExp):
        return True
    return isinstance(node, ast.Call) and at.known(node.func) in (map, zip, enumerate, range, reversed)


def _one(at: Expressions, node: ast.Call, most: int = 1) -> list[ast.expr]:
    if len(node.args) > most or node.keywords:
        at.lack(f"the language has no such arguments of {ast.unparse(node.func)}")
    return node.args


def _all(at: Expressions, node: ast.Call, operator: ast.boolop) -> Value | None:
    (one,) = _one(at, node) or at.mistake("all and any run over one thing")
    if not _is_lazy(at, one):
        value = at.value(one)
        if value.kind.items is None and not at.is_dict(value):
            return FUNCTIONS[at.known(node.func)](at, [Given(value)], {})
        one = Given(value)
    return at.all_or_any(one, operator)


def _items(at: Expressions, node: ast.Call, form: Any) -> Value:
    nodes = _one(at, node)
    return bundle([at.held(each) for each in at.listed(nodes[0])] if nodes else [], form)


def _dict(at: Expressions, node: ast.Call) -> Value:
    found: dict[Any, Value] = {}
    for each in node.args:
        found |= at.entries(at.value(each))
    return at.dict_of(found | {str(each.arg): at.held(at.value(each.value)) for each in node.keywords})


def _print(at: Expressions, node: ast.Call) -> None:
    for each in [*node.args, *(keyword.value for keyword in node.keywords)]:
        at.value(each)


def _isinstance(at: Expressions, node: ast.Call) -> Value:
    if len(node.args) != 2:
        at.mistake("isinstance takes an object, and types")
    return at.is_instance(*(at.value(each) for each in node.args))


def _attribute(at: Expressions, node: ast.Call) -> Value:
    """``hasattr`` and ``getattr`` of a record, of an object with fields, and of what is known when compiling."""
    is_asked = at.known(node.func) is hasattr
    if len(node.args) not in ((2,) if is_asked else (2, 3)) or node.keywords:
        at.mistake("hasattr and getattr take an object, a name, and getattr a value")
    owner, name = at.value(node.args[0]), at.python(at.value(node.args[1]))
    if not isinstance(name, str):
        at.needs_constant("the name of an attribute")
    fields = owner.kind.base.fields if owner.kind.items is None and not owner.kind.is_array else None
    if fields is None and at.object_of(owner) is MISSING and at.field_of(owner, name) is None:
        at.lack("hasattr and getattr are of what is known when compiling")
    if fields is not None and name not in fields and (name.startswith("_") or hasattr(np.record, name)):
        at.lack(f"the language has no {name} of a record")
    known = at.object_of(owner)
    if known is not MISSING:
        at.demand_unchanged(known, name, node)
    there = name in fields if fields is not None else known is MISSING or hasattr(known, name)
    if is_asked:
        return at.constant(there)
    usual = at.value(node.args[2]) if len(node.args) == 3 else None
    if there or usual is None:
        return at.value(ast.copy_location(ast.Attribute(Given(owner), name, ast.Load()), node))
    return usual


def _length(at: Expressions, node: ast.Call) -> Value | None:
    value = at.value(_one(at, node)[0])
    known = at.object_of(value)
    if at.is_dict(value) or isinstance(known, str | frozenset):
        return at.constant(len(at.entries(value) if at.is_dict(value) else known))
    return FUNCTIONS[len](at, [Given(value)], {})


def _number(at: Expressions, node: ast.Call) -> Value | None:
    """``float("inf")``, and ``float`` and ``int`` of numbers."""
    known, values = at.known(node.func), [at.value(each) for each in node.args]
    if len(values) == 1 and isinstance(text := at.object_of(values[0]), str):
        try:
            return at.constant(known(text))
        except ValueError as error:
            at.mistake(str(error))
    return FUNCTIONS[known](at, [Given(each) for each in values], at._keywords(node))


def _partial(at: Expressions, node: ast.Call) -> Value:
    values = [at.held(at.value(each)) for each in [*node.args, *(each.value for each in node.keywords)]]
    return bundle([known_object(partial), *values], Form(partial, tuple(str(each.arg) for each in node.keywords)))


def _range(at: Expressions, node: ast.Call) -> Value:
    known = [at.python(at.value(each)) for each in node.args]
    if MISSING in known:
        at.lack("a range is run over here, or its bounds are known when compiling")
    return known_object(range(*known))


FORMS: dict[Any, Callable[[Expressions, ast.Call], Value | None]] = {
    sum: _sum_of,
    min: _sum_of,
    max: _sum_of,
    all: partial(_all, operator=ast.And()),
    any: partial(_all, operator=ast.Or()),
    tuple: partial(_items, form=None),
    list: partial(_items, form=LIST),
    dict: _dict,
    print: _print,
    isinstance: _isinstance,
    hasattr: _attribute,
    getattr: _attribute,
    len: _length,
    float: _number,
    np.float64: _number,
    int: _number,
    range: _range,
    partial: _partial,
}
"""Functions that are called with expressions that are no numbers, or with any number of them."""


def _is_number(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def _ends_early(known: Any) -> bool:
    """Whether machine code of a call surely ends early where Python raises."""
    of_numpy = str(getattr(known, "__module__", None)).startswith("numpy") or isinstance(known, np.ufunc)
    return of_numpy or any(known is each for each in _NEVER_RAISE)


_NEVER_RAISE = (abs, len, float, bool, range, enumerate, zip, print)
"""Functions of Python that raise nowhere in the run."""
_TO_PYTHON = ("item", "tolist")
"""Methods of an array that give numbers of Python."""
_NUMPYS = (np.int64, np.sum, np.mean, np.dot, np.linalg.norm, np.linalg.det, np.trace)
"""Functions besides the element-wise ones that give numbers of NumPy."""


def _hashed(known: Any) -> Any:
    try:
        hash(known)
    except TypeError:
        return None
    return known


_FOREIGN = ("numpy", "scipy", "math", "builtins")
"""Packages whose functions are in the language by name only."""
_SPOKEN = {
    "GeneratorExp": "generator here; write a list, or a loop",
    "Lambda": "lambda; write a function with def at the top of the file",
    "SetComp": "set",
    "With": "with",
    "Delete": "del",
    "Import": "import within a function",
    "ImportFrom": "import within a function",
    "FunctionDef": "function within a function; define it at the top of the file",
    "Global": "global; keep what changes in a state or a memory",
    "Nonlocal": "nonlocal",
    "ClassDef": "class within a function",
    "Match": "match",
}
