"""The entrance of the compiler: one module of LLVM from Python functions."""

import ast
import types
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from llvmlite import ir

from ..files import function_tree
from . import library
from .emission import Emission, Module
from .expressions import A_COPY
from .function import Function
from .lifetimes import Again, Plan
from .refusals import Lacking
from .values import (
    DOUBLE,
    FLAG,
    INT,
    POINTER,
    WORD,
    Kind,
    Value,
    argument_kind,
    bundle,
    contiguous,
    items_of,
    scalar,
    view,
)


class Unit(Module):
    """A module that translates functions. Each is translated once for each combination of its arguments' kinds."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._done: dict[tuple, _Done] = {}
        self._underway: list[types.FunctionType] = []

    def call(
        self, at: Emission, function: types.FunctionType, arguments: Sequence[Value], fused: bool = False
    ) -> Value | None:
        """Write a call. Refuses a function that calls itself."""
        if function in self._underway:
            at.lack(f"{function.__name__} calls itself; write a loop")
        kinds, fused = tuple(argument_kind(argument) for argument in arguments), fused or function in self.fused
        key = (function, kinds, fused)
        if key not in self._done:
            self._done[key] = self._translated(function, kinds, fused)
        done = self._done[key]
        words = [w for a, kind in zip(arguments, kinds, strict=True) if kind.constant is None for w in a.llvm]
        result = at.reserve(done.size)
        code = at.at.call(done.code, [*words, result])
        if not fused:  # where a function stands decides which of its sums are rounded once
            done.called_by([*done.callers, at.at.function])
        if self.checked:
            failed = at.at.icmp_signed("!=", code, WORD(0))
            with at.at.if_then(failed, likely=False):
                if function.__module__ == library.__name__:  # it failed where the user has called it
                    code = at.at.or_(at.at.and_(code, WORD(255)), WORD(at.code(0)))
                at.at.ret(code)
        return done.result(at, result, arguments)

    def _translated(self, function: types.FunctionType, kinds: tuple[Kind, ...], fused: bool) -> "_Done":
        tree, source = definition(function)
        signature = ir.FunctionType(WORD if self.checked else ir.VoidType(), _parameters(kinds))
        plan, frame = Plan(), self.frame
        self._underway.append(function)
        try:
            while True:
                code = ir.Function(self.module, signature, self.module.get_unique_name(f"{function.__name__}."))
                code.linkage = "internal"
                self.frame = frame
                body = Function(self, function, tree, source, fused, plan)
                try:
                    body.translate(code, kinds)
                    return _Done.of(body, code)
                except Again:
                    self.drop(code)
        finally:
            self._underway.pop()

    def drop(self, draft: ir.Function) -> None:
        """Take a draft back, with its calls."""
        del self.module.globals[draft.name]
        for done in self._done.values():
            done.called_by([each for each in done.callers if each is not draft])


def _parameters(kinds: Sequence[Kind]) -> list[ir.Type]:
    return [*(each for kind in kinds for each in kind.llvm), POINTER]


@dataclass
class _Done:
    """A translated function. Its last argument is the memory [bytes] for its result: the numbers of it one after the
    other, of an array the address, or all entries if the array is the function's own."""

    code: ir.Function
    kind: Kind | None
    size: int = 0
    copies: bool = False
    readonly: str = ""
    callers: list[ir.Function] = field(default_factory=list)

    def called_by(self, callers: list[ir.Function]) -> None:
        """Set the functions with its calls. If it is called once, it becomes a part of its caller before LLVM looks at
        either: that takes less time, and the loop is no slower."""
        self.callers = callers
        attributes = self.code.attributes
        attributes.add("alwaysinline") if len(callers) == 1 else attributes.discard("alwaysinline")

    @classmethod
    def of(cls, body: Function, code: ir.Function) -> "_Done":
        """Write the ends of a function's body, where it returns."""
        values = [value for _, value in body.returns]
        if all(value.kind.is_none for value in values):
            done = cls(code, None)
        else:
            kind = body.unified(values)
            own = [value for value in values if not value.outer]
            mixed = len(own) not in (0, len(values))
            done = cls(code, kind, copies=bool(own), readonly=A_COPY if mixed else "")
            done.size = sum(size for _, size in done._leaves(kind))
        for block, value in body.returns:
            body.at.position_at_end(block)
            if done.kind is not None:
                done._store(body, value, done.kind, code.args[-1], 0)
            body.at.ret_void() if not body.unit.checked else body.at.ret(WORD(0))
        body.finish()
        return done

    def _leaves(self, kind: Kind) -> list[tuple[Kind, int]]:
        """The parts of a result with their sizes [bytes]."""
        if kind.items is not None:
            return [leaf for item in kind.items for leaf in self._leaves(item)]
        if kind.is_array and self.copies:
            return [(kind, -(-kind.size * kind.base.itemsize // 8) * 8)]
        return [(kind, 8 * len(kind.llvm))]

    def _store(self, body: Function, value: Value, kind: Kind, memory: ir.Value, at: int) -> int:
        """Store a part of the result at an offset; returns that of the next."""
        if kind.items is not None:
            for item, its in zip(items_of(value), kind.items, strict=True):
                at = self._store(body, item, its, memory, at)
            return at
        place = body.shifted(memory, WORD(at))
        if kind.is_array and self.copies:
            body.fill(Value(contiguous(kind.base, kind.sizes), (place,)), value)
        else:
            for k, number in enumerate(body.adapted(value, kind)):
                body.store(number, body.shifted(place, WORD(8 * k)))
        return at + self._leaves(kind)[0][1]

    def result(self, at: Emission, memory: ir.Value, arguments: Sequence[Value]) -> Value | None:
        """The result of a call, from its memory."""
        if self.kind is None:
            return None
        steady, outer = all(each.steady for each in arguments), all(each.outer for each in arguments)
        arrays = [each for each in arguments if each.kind.is_array or each.kind.items is not None]
        fresh = any(each.fresh for each in arrays)  # then the result may be in memory of this statement
        readonly = A_COPY if fresh and not all(each.fresh for each in arrays) else ""

        def read(kind: Kind, place: int) -> tuple[Value, int]:
            if kind.items is not None:
                items = []
                for each in kind.items:
                    item, place = read(each, place)
                    items.append(item)
                return bundle(items), place
            after, pointer = place + self._leaves(kind)[0][1], at.shifted(memory, WORD(place))
            if kind.is_number:
                return at.load(pointer, kind.base), after
            if kind.is_array and self.copies:
                return Value(contiguous(kind.base, kind.sizes, self.readonly), (pointer,), fresh=True), after
            words = [at.at.load(at.shifted(pointer, WORD(8 * k)), typ=each) for k, each in enumerate(kind.llvm)]
            kind = replace(kind, readonly=kind.readonly or readonly)
            return Value(kind, tuple(words), fresh, steady, outer), after

        return read(self.kind, 0)[0]


def definition(function: types.FunctionType) -> tuple[ast.FunctionDef, list[str]]:
    """The tree of a function, and the lines of its source. Raises Lacking for one that has none."""
    try:
        tree, source = function_tree(function)
    except (OSError, TypeError, SyntaxError, IndexError):
        raise Lacking(function, 1, "", "its source is not in a file") from None
    if not isinstance(tree, ast.FunctionDef):
        raise Lacking(function, 1, source[0].strip(), "a function is written with def")
    return tree, source


def translate(
    unit: Unit,
    function: types.FunctionType,
    parameters: Sequence[np.dtype],
    name: str,
    readonly: Mapping[int, str] = types.MappingProxyType({}),
) -> None:
    """Add a C function of 64-bit integers to a unit: each is a number or the address of a record or an array.

    It returns what the Python function returns, a 64-bit integer or a double, or 0 if it returns nothing; in a checked
    unit 0, or why and where it ended early. ``readonly`` says of parameters, by their position, why nothing may be
    stored in them. Raises Untranslatable.
    """
    tree, source = definition(function)
    if len(tree.args.args) != len(parameters):
        raise Lacking(function, 1, source[0].strip(), f"it can't be called with {len(parameters)} arguments")
    draft = ir.Function(unit.module, ir.FunctionType(WORD, [WORD] * len(parameters)), f"{name}.draft")
    result = _entry(unit, draft, function, parameters, readonly, source)  # to know its type
    unit.drop(draft)
    returns = DOUBLE if result is not None and result.type == DOUBLE else WORD
    entry = ir.Function(unit.module, ir.FunctionType(returns, [WORD] * len(parameters)), name)
    _entry(unit, entry, function, parameters, readonly, source)


def _entry(
    unit: Unit,
    entry: ir.Function,
    function: types.FunctionType,
    parameters: Sequence[np.dtype],
    readonly: Mapping[int, str],
    source: Sequence[str],
) -> ir.Value | None:
    """Write the C function's body. Returns what it returns."""
    at = Emission(unit, function, source, fused=False)
    at.at = at.entry = ir.IRBuilder(entry.append_basic_block())
    arguments = []
    for k, (word, dtype) in enumerate(zip(entry.args, parameters, strict=True)):
        number = dtype == INT
        arguments.append(
            scalar(word, INT) if number else view(at.at.inttoptr(word, POINTER), dtype, readonly.get(k, ""))
        )
    result = unit.call(at, function, arguments)
    if result is None or unit.checked or not result.kind.is_number:
        at.at.ret(WORD(0))
        return None
    value = result.llvm[0]
    at.at.ret(at.at.zext(value, WORD) if value.type == FLAG else value)
    return value
