"""The entrance of the compiler: one module of LLVM from Python functions."""

import ast
import functools
import types
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace

import numpy as np
from llvmlite import ir

from ..files import SourceChanged, function_tree
from . import libm, library
from .emission import Emission, Module
from .function import Function
from .lifetimes import Again, Plan
from .refusals import Lacking, Untranslatable
from .scalars import of_libm
from .symbols import LIBM
from .values import (
    BOOL,
    DOUBLE,
    FLOAT,
    INT,
    OUTSIDE,
    POINTER,
    WORD,
    Kind,
    Memory,
    Value,
    argument_kind,
    bundled,
    is_dense,
    kind_of,
    leaves_of,
    scalar,
    words_of,
)


class Unit(Module):
    """A module that translates functions. Each is translated once for each combination of its arguments' kinds."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.own = libm.FUNCTIONS
        self._done: dict[tuple, _Done] = {}
        self._underway: list[types.FunctionType] = []

    def done(self, function: types.FunctionType, kinds: tuple[Kind, ...], fused: bool) -> "_Done":
        """The translation of a function for arguments of these kinds."""
        key = (function, kinds, fused)
        if key not in self._done:
            self._done[key] = self._translated(function, kinds, fused)
        done = self._done[key]
        if self.cells:
            self.cells.take(done.constants)
        return done

    def forget(self) -> None:
        """Forget the functions that took a word for a constant that turned out to change, and their callers."""
        changes = self.cells.changes
        self._done = {key: done for key, done in self._done.items() if not any(map(changes, done.constants))}
        self.frame = sum(done.frame for done in self._done.values())

    def call(
        self, at: Emission, function: types.FunctionType, arguments: Sequence[Value], fused: bool = False
    ) -> Value | None:
        """Write a call. Refuses a function that calls itself."""
        if function in self._underway:
            at.lack(f"{function.__name__} calls itself; write a loop")
        kinds, fused = tuple(argument_kind(argument) for argument in arguments), fused or function in self.fused
        done = self.done(function, kinds, fused)
        if isinstance(at, Function) and at.turning is not None and done.mixes(arguments):
            arguments = [at.kept(argument) for argument in arguments]  # so that its result is in memory that lasts
            kinds = tuple(argument_kind(argument) for argument in arguments)
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
        if function not in self.trees:
            self.trees[function] = definition(function)
        tree, source = self.trees[function]
        given = [POINTER] * (self.cells.pointers if self.cells else 0)
        parameters = [*(each for kind in kinds for each in kind.llvm), *given, POINTER]
        signature = ir.FunctionType(WORD if self.checked else ir.VoidType(), parameters)
        plan, frame = Plan(), self.frame
        self._underway.append(function)
        try:
            with self.cells.within() if self.cells else nullcontext(()) as constants:
                while True:
                    code = ir.Function(self.module, signature, self.module.get_unique_name(f"{function.__name__}."))
                    code.linkage = "internal"
                    self.frame = frame
                    body = Function(self, function, tree, source, fused, plan)
                    try:
                        body.translate(code, kinds)
                        done = _Done.of(body, code)
                        done.inlined, done.constants, done.frame = self.cells is not None, constants, body.reserved
                        return done
                    except Untranslatable as error:
                        error.outermost = body.place_of_line()
                        raise
                    except Again:  # take the draft back, with its calls
                        del self.module.globals[code.name]
                        for done in self._done.values():
                            done.called_by([each for each in done.callers if each is not code])
        finally:
            self._underway.pop()


@dataclass
class _Done:
    """A translated function. Its last argument is the memory [bytes] for its result: its parts that are no tuples, one
    after the other."""

    code: ir.Function
    kind: Kind | None
    leaves: list["_Leaf"] = field(default_factory=list)
    callers: list[ir.Function] = field(default_factory=list)
    inlined: bool = False
    constants: Collection[int] = ()  # words of the cells that it takes for constants
    frame: int = 0  # bytes of its own local arrays

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
            done = cls(code, kind, _leaves(body, kind, values))
        for block, value in body.returns:
            body.at.position_at_end(block)
            done._store(body, value, code.args[-1])
            body.at.ret_void() if not body.unit.checked else body.at.ret(WORD(0))
        body.finish()
        return done

    @property
    def size(self) -> int:
        return sum(leaf.size for leaf in self.leaves)

    def mixes(self, arguments: Sequence[Value]) -> bool:
        """Whether a part of the result may be an array that a caller has just made, and may be another one, or another
        part may be the same."""
        made = [{k for k in leaf.arguments if _is_made(arguments[k])} for leaf in self.leaves]
        both = any(made[i] & made[k] for i in range(len(made)) for k in range(i))
        return both or any(of and not leaf.only(of) for of, leaf in zip(made, self.leaves, strict=True))

    def _store(self, body: Function, value: Value, memory: ir.Value) -> None:
        at = 0
        for part, leaf in zip(leaves_of(value), self.leaves, strict=False):  # nothing of None
            place, kind = body.shifted(memory, WORD(at)), leaf.kind
            at += leaf.size
            if kind.is_array and _is_own(body, part):
                numbers = body.shifted(place, WORD(8)) if leaf.given else place
                body.fill(Value(replace(kind, readonly=""), (numbers,)), part)
                if leaf.given:
                    body.store(numbers, place)
                continue
            for k, number in enumerate(body.adapted(part, kind)):
                body.store(number, body.shifted(place, WORD(8 * k)))

    def result(self, at: Emission, memory: ir.Value, arguments: Sequence[Value]) -> Value | None:
        """The result of a call, from its memory."""
        if self.kind is None:
            return None
        found, place, mixes = [], 0, self.mixes(arguments)
        for leaf in self.leaves:
            found.append(leaf.read(at, at.shifted(memory, WORD(place)), arguments, mixes))
            place += leaf.size
        return bundled(self.kind, iter(found))


@dataclass
class _Leaf:
    """A part of a function's result that is no tuple, in the memory of the result.

    An array may be the function's own; then its numbers are there. Or it is given, a part of an argument or a constant;
    then its address is there. If it may be either, so at different returns, its address is there, and room for numbers.

    Attributes:
        kind: its kind.
        own, given: of an array, which it may be.
        arguments: what it may be a view of: positions of arguments.
        constant: whether it may be a view of anything else.
    """

    kind: Kind
    own: bool = False
    given: bool = True
    arguments: frozenset[int] = frozenset()
    constant: bool = False

    @classmethod
    def of(cls, body: Function, kind: Kind, parts: Sequence[Value]) -> "_Leaf":
        """From the same part of all results."""
        own = [kind.is_array and _is_own(body, part) for part in parts]
        if any(own) and not is_dense(kind):
            body.lack("it returns a part of a new array; write .copy() behind it")
        if kind.is_number:
            return cls(kind)
        reached = {each for part, its in zip(parts, own, strict=True) if not its for each in body.origins(part)}
        arguments = frozenset(each.argument for each in reached if each.argument is not None)
        return cls(kind, any(own), not all(own), arguments, any(each.argument is None for each in reached))

    @property
    def size(self) -> int:
        """Its size in the memory of the result [bytes]."""
        numbers = -(-self.kind.size * self.kind.base.itemsize // 8) * 8 if self.own else 0
        return numbers + (8 * len(self.kind.llvm) if self.given else 0)

    def only(self, arguments: set[int]) -> bool:
        """Whether it is a part of one of these arguments, and of nothing else."""
        return self.arguments <= arguments and not self.own and not self.constant

    def read(self, at: Emission, place: ir.Value, arguments: Sequence[Value], mixes: bool) -> Value:
        """It, after a call. ``mixes``: it may be in memory that the caller has just made, and not alone."""
        kind = self.kind
        if kind.is_number:
            return at.load(place, kind.base)
        if not self.given:
            return Value(replace(kind, readonly=""), (place,), fresh=True)
        words = [at.at.load(at.shifted(place, WORD(8 * k)), typ=each) for k, each in enumerate(kind.llvm)]
        of = [arguments[k] for k in self.arguments]
        made = self.own or any(map(_is_made, of))
        roots = frozenset({Memory(own=True)} if made else ()) | ({OUTSIDE} if self.constant else set())
        return Value(
            kind,
            tuple(words),
            fresh=made and not mixes and not self.own and not self.constant,
            steady=all(each.steady for each in of),
            roots=roots.union(*(each.roots for each in of)),
            fleeting=(made and mixes) or self.own or any(each.fleeting for each in of),
        )


def _is_made(value: Value) -> bool:
    return any(leaf.fresh for leaf in leaves_of(value))


def _is_own(body: Function, array: Value) -> bool:
    """Whether an array that is returned is the function's own, so that the caller gets its numbers."""
    own = {each.own for each in body.origins(array)}
    if len(own) != 1:
        body.lack("it may return a part of an argument here, or a new array; write .copy(), or one return for each")
    return own.pop()


def _leaves(body: Function, kind: Kind, values: Sequence[Value]) -> list[_Leaf]:
    returned = [leaves_of(value) for value in values]
    for parts in returned:  # the caller would get two arrays where the function has one
        own = [body.origins(part) for part in parts if part.kind.is_array and _is_own(body, part)]
        if any(own[i] & own[k] for i in range(len(own)) for k in range(i)):
            body.lack("it returns two views of one array of its own; write .copy()")
    return [_Leaf.of(body, leaf, [parts[k] for parts in returned]) for k, leaf in enumerate(kind.leaves)]


def libm_module(symbols: Iterable[str], inlined: bool = False) -> ir.Module:
    """The module of functions of :mod:`.libm`, by their symbols (:func:`.scalars.of_libm`); ``inlined``, as parts of
    their callers. No product and sum is rounded once in it, wherever it is called."""
    unit = Unit("libm")
    for symbol in symbols:
        function = libm.CODE[symbol.removeprefix(LIBM)]
        code = of_libm(unit.module, symbol, function.__code__.co_argcount)
        at = Emission(unit, function, [""], fused=False)
        at.at = at.entry = ir.IRBuilder(code.append_basic_block())
        result = unit.call(at, function, [scalar(number, FLOAT) for number in code.args])
        assert result is not None
        numbers = [leaf.llvm[0] for leaf in leaves_of(result)]
        returned = numbers[0]
        if len(numbers) > 1:
            returned = code.function_type.return_type(ir.Undefined)
            for k, number in enumerate(numbers):
                returned = at.at.insert_value(returned, number, k)
        at.at.ret(returned)
    if inlined:
        for function in unit.module.functions:
            function.attributes.add("alwaysinline")
    return unit.module


@functools.lru_cache(maxsize=4096)
def _tree_of_ours(function: types.FunctionType) -> tuple[ast.stmt, list[str]]:
    """:func:`.files.function_tree` of a function of the package, whose source does not change: the modules of a run
    share most of what they call."""
    return function_tree(function)


def definition(function: types.FunctionType) -> tuple[ast.FunctionDef, list[str]]:
    """The tree of a function, and the lines of its source. Raises Lacking for one that has none."""
    ours = function.__module__.partition(".")[0] == __name__.partition(".")[0]
    try:
        tree, source = _tree_of_ours(function) if ours else function_tree(function)
    except SourceChanged:
        raise Lacking(function, 1, "", "its file has changed since it was loaded") from None
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
