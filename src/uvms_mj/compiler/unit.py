"""The entrance of the compiler: one module of LLVM from Python functions."""

import ast
import types
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from llvmlite import ir

from ..files import function_tree
from . import libm, library
from .emission import Emission, Module
from .expressions import A_COPY
from .function import Function
from .lifetimes import Again, Plan
from .refusals import Lacking
from .scalars import OWN
from .values import (
    BOOL,
    DOUBLE,
    FLOAT,
    INT,
    POINTER,
    WORD,
    Kind,
    Value,
    argument_kind,
    bundled,
    contiguous,
    kind_of,
    leaves_of,
    words_of,
)


class Unit(Module):
    """A module that translates functions. Each is translated once for each combination of its arguments' kinds."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.library == OWN:
            self.own = libm.FUNCTIONS
        self._done: dict[tuple, _Done] = {}
        self._underway: list[types.FunctionType] = []

    def done(self, function: types.FunctionType, kinds: tuple[Kind, ...], fused: bool) -> "_Done":
        """The translation of a function for arguments of these kinds."""
        key = (function, kinds, fused)
        if key not in self._done:
            self._done[key] = self._translated(function, kinds, fused)
        return self._done[key]

    def call(
        self, at: Emission, function: types.FunctionType, arguments: Sequence[Value], fused: bool = False
    ) -> Value | None:
        """Write a call. Refuses a function that calls itself."""
        if function in self._underway:
            at.lack(f"{function.__name__} calls itself; write a loop")
        kinds, fused = tuple(argument_kind(argument) for argument in arguments), fused or function in self.fused
        done = self.done(function, kinds, fused)
        words = [word for argument in arguments for word in words_of(argument)]
        result = at.reserve(done.size)
        code = at.at.call(done.code, [*words, *at.given, result])
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
        given = [POINTER] * (self.cells.pointers if self.cells else 0)
        parameters = [*(each for kind in kinds for each in kind.llvm), *given, POINTER]
        signature = ir.FunctionType(WORD if self.checked else ir.VoidType(), parameters)
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
                    done = _Done.of(body, code)
                    done.inlined = self.cells is not None
                    return done
                except Again:  # take the draft back, with its calls
                    del self.module.globals[code.name]
                    for done in self._done.values():
                        done.called_by([each for each in done.callers if each is not code])
        finally:
            self._underway.pop()


@dataclass
class _Done:
    """A translated function. Its last argument is the memory [bytes] for its result: the numbers of it one after the
    other, of an array the address, or all entries if the array is the function's own. ``leaves`` are its parts that are
    no tuples, with their sizes [bytes]."""

    code: ir.Function
    kind: Kind | None
    leaves: list[tuple[Kind, int]] = field(default_factory=list)
    copies: bool = False
    readonly: str = ""
    callers: list[ir.Function] = field(default_factory=list)
    inlined: bool = False

    def called_by(self, callers: list[ir.Function]) -> None:
        """Set the functions with its calls. If it is called once, it becomes a part of its caller before LLVM looks at
        either: that takes less time, and the loop is no slower."""
        self.callers = callers
        attributes = self.code.attributes
        attributes.add("alwaysinline") if len(callers) == 1 or self.inlined else attributes.discard("alwaysinline")

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
            done.leaves = [(leaf, done._bytes(leaf)) for leaf in kind.leaves]
        for block, value in body.returns:
            body.at.position_at_end(block)
            done._store(body, value, code.args[-1])
            body.at.ret_void() if not body.unit.checked else body.at.ret(WORD(0))
        body.finish()
        return done

    @property
    def size(self) -> int:
        return sum(size for _, size in self.leaves)

    def _bytes(self, kind: Kind) -> int:
        """The size of a part of the result."""
        if kind.is_array and self.copies:
            return -(-kind.size * kind.base.itemsize // 8) * 8
        return 8 * len(kind.llvm)

    def _store(self, body: Function, value: Value, memory: ir.Value) -> None:
        at = 0
        for part, (kind, size) in zip(leaves_of(value), self.leaves, strict=False):  # nothing of None
            place = body.shifted(memory, WORD(at))
            if kind.is_array and self.copies:
                body.fill(Value(contiguous(kind.base, kind.sizes), (place,)), part)
            else:
                for k, number in enumerate(body.adapted(part, kind)):
                    body.store(number, body.shifted(place, WORD(8 * k)))
            at += size

    def result(self, at: Emission, memory: ir.Value, arguments: Sequence[Value]) -> Value | None:
        """The result of a call, from its memory."""
        if self.kind is None:
            return None
        steady, outer = all(each.steady for each in arguments), all(each.outer for each in arguments)
        arrays = [each for each in arguments if each.kind.is_array or each.kind.items is not None]
        fresh = any(each.fresh for each in arrays)  # then the result may be in memory of this statement
        readonly = A_COPY if fresh and not all(each.fresh for each in arrays) else ""
        found, place = [], 0
        for kind, size in self.leaves:
            pointer = at.shifted(memory, WORD(place))
            place += size
            if kind.is_number:
                found.append(at.load(pointer, kind.base))
            elif kind.is_array and self.copies:
                found.append(Value(contiguous(kind.base, kind.sizes, self.readonly), (pointer,), fresh=True))
            else:
                words = [at.at.load(at.shifted(pointer, WORD(8 * k)), typ=each) for k, each in enumerate(kind.llvm)]
                kind = replace(kind, readonly=kind.readonly or readonly)
                found.append(Value(kind, tuple(words), fresh, steady, outer))
        return bundled(self.kind, iter(found))


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
    kinds = [Kind(INT) if dtype == INT else kind_of(dtype, readonly.get(k, "")) for k, dtype in enumerate(parameters)]
    number = unit.done(function, tuple(kinds), function in unit.fused).kind
    returned = number if number is not None and number.is_number and not unit.checked else None
    returns = DOUBLE if returned is not None and returned.base == FLOAT else WORD
    entry = ir.Function(unit.module, ir.FunctionType(returns, [WORD] * len(parameters)), name)
    at = Emission(unit, function, source, fused=False)
    at.at = at.entry = ir.IRBuilder(entry.append_basic_block())
    arguments = [
        Value(kind, (word if kind.is_number else at.at.inttoptr(word, POINTER),))
        for word, kind in zip(entry.args, kinds, strict=True)
    ]
    result = unit.call(at, function, arguments)
    if returned is None or result is None:
        at.at.ret(WORD(0))
    else:
        at.at.ret(at.at.zext(result.llvm[0], WORD) if returned.base == BOOL else result.llvm[0])
