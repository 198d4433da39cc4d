"""Translation of kernels to LLVM: a small part of Python, enough for the equations of the loop.

Numba compiles nearly all of Python's arithmetic, and takes 14 s for the core. Kernels need little of it: numbers,
arrays and records of known shape, loops over ranges, calls of other kernels. For that little, a walk over the syntax
tree is enough, and LLVM's own compiler does the rest. A function outside this language raises :class:`Untranslatable`
with its file, its line and the reason. Numba compiles users' laws, which may use all that numba knows.

Floating-point operations are those of the source, in its order, so the results are those of plain Python. But a
division by zero gives inf or NaN, indices are not checked, and an integer has 64 bits. Each variable has one type.
"""

import ast
import inspect
import textwrap
import types
from collections.abc import Sequence

import numpy as np
from llvmlite import ir

from ...files import parsed
from ...physics.kernels import fused_kernels
from .expressions import Expressions
from .values import BOOL, BYTE, DOUBLE, FLAG, INT, NUMBERS, POINTER, SCALARS, WORD, Kind, Value, scalar, view


def translate(function: types.FunctionType, parameters: Sequence[np.dtype], name: str) -> ir.Module:
    """A module with one C function of 64-bit integers: each is a number or the address of a record or an array.

    It returns what the Python function returns, a 64-bit integer or a double, or 0 if it returns nothing. Raises
    Untranslatable if the function, or one that it calls, is not in the language of kernels.
    """
    unit, returns = _Unit(name), DOUBLE if inspect.get_annotations(function).get("return") is float else WORD
    entry = ir.Function(unit.module, ir.FunctionType(returns, [WORD] * len(parameters)), name)
    builder = ir.IRBuilder(entry.append_basic_block())
    arguments = [
        scalar(word, INT) if dtype == INT else view(builder.inttoptr(word, POINTER), dtype)
        for word, dtype in zip(entry.args, parameters, strict=True)
    ]
    result = unit.call(builder, function, arguments)
    value = WORD(0) if result is None else result.llvm[0]
    builder.ret(builder.zext(value, WORD) if value.type == FLAG else value)
    return unit.module


class _Unit:
    """A module: each function is translated once for each combination of its arguments' types."""

    def __init__(self, name: str) -> None:
        self.module = ir.Module(name)
        self._done: dict[tuple, tuple[ir.Function, np.dtype | None]] = {}

    def call(
        self, builder: ir.IRBuilder, function: types.FunctionType, arguments: Sequence[Value], fused: bool = False
    ) -> Value | None:
        kinds, fused = tuple(argument.kind for argument in arguments), fused or function in fused_kernels
        if (function, kinds, fused) not in self._done:
            returns = NUMBERS.get(inspect.get_annotations(function, eval_str=True).get("return"))
            result = ir.VoidType() if returns is None else SCALARS[returns]
            signature = ir.FunctionType(result, [each for kind in kinds for each in kind.llvm])
            code = ir.Function(self.module, signature, self.module.get_unique_name(f"{function.__name__}."))
            code.linkage = "internal"
            self._done[function, kinds, fused] = code, returns
            _Function(self, function, code, returns, fused).translate(kinds)
        code, returns = self._done[function, kinds, fused]
        result = builder.call(code, [each for argument in arguments for each in argument.llvm])
        return None if returns is None else scalar(result, returns)


class _Function(Expressions):
    """One function for one combination of its arguments' types."""

    def __init__(
        self, unit: _Unit, function: types.FunctionType, code: ir.Function, returns: np.dtype | None, fused: bool
    ) -> None:
        super().__init__(function, unit.call, fused)
        self.code, self.returns = code, returns
        self.entry = ir.IRBuilder(code.append_basic_block())  # has the variables, which LLVM moves to registers
        self.at = ir.IRBuilder(code.append_basic_block())
        self._loops: list[tuple[ir.Block, ir.Block]] = []  # where continue and break lead

    def translate(self, kinds: Sequence[Kind]) -> None:
        begin = self.at.block
        tree = parsed(textwrap.dedent(inspect.getsource(self.function))).body[0]
        if not isinstance(tree, ast.FunctionDef) or len(tree.args.args) != len(kinds):
            self.refuse(f"it can't be called with {len(kinds)} arguments")
        given = iter(self.code.args)
        for argument, kind in zip(tree.args.args, kinds, strict=True):
            self._assign(argument.arg, Value(kind, tuple(next(given) for _ in kind.llvm)))
        self._body(tree.body)
        if not self.at.block.is_terminated:
            if self.returns is None:
                self.at.ret_void()
            else:  # LLVM removes it
                self.at.unreachable()
        self.entry.branch(begin)

    def _body(self, statements: Sequence[ast.stmt]) -> None:
        for statement in statements:
            if self.at.block.is_terminated:
                return
            self.line = statement.lineno
            visit = getattr(self, f"_{type(statement).__name__}", None)
            if visit is None:
                self.refuse(f"kernels have no {type(statement).__name__}")
            visit(statement)

    def _Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            self.call(node.value)
        elif not (isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)):
            self.refuse("nothing uses this value")

    def _Assign(self, node: ast.Assign) -> None:
        (target, *others), value = node.targets, node.value
        if others:
            self.refuse("one assignment at a time")
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            values = [self.value(each) for each in value.elts]
            for each, its_value in zip(target.elts, values, strict=True):
                self._store(each, its_value)
        else:
            self._store(target, self.value(value))

    def _AugAssign(self, node: ast.AugAssign) -> None:
        self._store(node.target, self.operation(node.op, self.value(node.target), self.value(node.value)))

    def _store(self, target: ast.expr, value: Value) -> None:
        if isinstance(target, ast.Name):
            self._assign(target.id, value)
            return
        pointer, base = self.place(target)
        number = self.converted(value, base)
        self.at.store(self.at.zext(number, BYTE) if base == BOOL else number, pointer)

    def _assign(self, name: str, value: Value) -> None:
        if name not in self.variables:
            self.variables[name] = value.kind, [self.entry.alloca(each) for each in value.kind.llvm]
        kind, slots = self.variables[name]
        if value.kind != kind:
            if not kind.is_number:
                self.refuse(f"{name} is of another type before")
            value = scalar(self.converted(value, kind.base), kind.base)
        for slot, each in zip(slots, value.llvm, strict=True):
            self.at.store(each, slot)

    def _If(self, node: ast.If) -> None:
        test = self.number(node.test, BOOL)
        if not node.orelse:
            with self.at.if_then(test):
                self._body(node.body)
            return
        with self.at.if_else(test) as (then, otherwise):
            with then:
                self._body(node.body)
            with otherwise:
                self._body(node.orelse)

    def _For(self, node: ast.For) -> None:
        call, variable = node.iter, node.target
        if not (isinstance(call, ast.Call) and self.known(call.func) is range and isinstance(variable, ast.Name)):
            self.refuse("a loop is over a range")
        bounds = [self.number(each, INT) for each in call.args]
        start, stop = (WORD(0), bounds[0]) if len(bounds) == 1 else bounds[:2]
        step = bounds[2] if len(bounds) == 3 else WORD(1)
        if not isinstance(step, ir.Constant) or node.orelse:
            self.refuse("the step of a range is a constant, and a loop has no else")
        counter = self.entry.alloca(WORD)
        self.at.store(start, counter)
        test, inside, advance, end = (self.at.append_basic_block() for _ in range(4))
        self.at.branch(test)
        self.at.position_at_end(test)
        count = self.at.load(counter, typ=WORD)
        self.at.cbranch(self.at.icmp_signed("<" if step.constant > 0 else ">", count, stop), inside, end)
        self.at.position_at_end(inside)
        self._assign(variable.id, scalar(count, INT))
        self._loops.append((advance, end))
        self._body(node.body)
        self._loops.pop()
        if not self.at.block.is_terminated:
            self.at.branch(advance)
        self.at.position_at_end(advance)
        self.at.store(self.at.add(self.at.load(counter, typ=WORD), step), counter)
        self.at.branch(test)
        self.at.position_at_end(end)

    def _Continue(self, node: ast.Continue) -> None:
        self.at.branch(self._loops[-1][0])

    def _Break(self, node: ast.Break) -> None:
        self.at.branch(self._loops[-1][1])

    def _Pass(self, node: ast.Pass) -> None:
        pass

    def _Return(self, node: ast.Return) -> None:
        if node.value is None or self.returns is None:
            if node.value is not None or self.returns is not None:
                self.refuse("a function has an annotation, bool, int or float, if and only if it returns a number")
            self.at.ret_void()
        else:
            self.at.ret(self.number(node.value, self.returns))
