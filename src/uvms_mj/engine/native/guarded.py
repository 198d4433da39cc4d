"""Compilation of a user's law and of the functions that it calls, with checks.

Numba checks array code less than NumPy does. With the checks of this module, an index out of bounds and operands of the
wrong shape raise in the law and in every function that it calls, including functions that the user marked with
``numba.njit`` and numba's own. An endless loop can be interrupted by a signal. The module imports numba and is
therefore imported only to compile.
"""

import contextlib
import threading
import types as python
from collections.abc import Iterator
from typing import Any
from weakref import WeakKeyDictionary

import numba
from llvmlite import ir as llvm
from numba import types
from numba.core import cgutils, compiler, config, ir, ir_utils, untyped_passes
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError, UnsupportedError
from numba.extending import intrinsic
from numba.np import arrayobj, npyimpl
from numba.np.ufunc.dufunc import DUFunc
from numba.np.ufunc.gufunc import GUFunc

__all__ = ["NumbaError", "guarded", "guarded_function", "twin"]

_lock = threading.RLock()
_PATIENCE = 1 << 20
"""Iterations of a loop from one check for signals to the next: about a millisecond."""


@contextlib.contextmanager
def guarded() -> Iterator[None]:
    """Within this context numba checks indices and shapes in all code that it compiles. NUMBA_BOUNDSCHECK has no
    effect."""
    names = ((config, "BOUNDSCHECK"), (npyimpl, "numpy_ufunc_kernel"), (arrayobj, "make_array_flat_cls"))
    with _lock:
        config.reload_config()  # numba does this before it compiles, which would undo the settings below
        before = [getattr(module, name) for module, name in names]
        config.BOUNDSCHECK = 1  # type: ignore[attr-defined]  # numba sets it at import
        npyimpl.numpy_ufunc_kernel = _same_shapes(npyimpl.numpy_ufunc_kernel)
        arrayobj.make_array_flat_cls = _within_bounds(arrayobj.make_array_flat_cls)
        try:
            yield
        finally:
            for (module, name), value in zip(names, before, strict=True):
                setattr(module, name, value)


def guarded_function(function: Any, **options: Any) -> Dispatcher:
    """A dispatcher that compiles a function with the checks of this module."""
    return numba.njit(pipeline_class=_Compiler, boundscheck=True, **options)(function)


_twins: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()


def twin(value: Any) -> Any:
    """A copy with checks of a function that the user marked with ``numba.njit`` or ``numba.vectorize``. The original
    may have been compiled, or loaded from numba's cache, without checks. Any other value is returned unchanged. Raises
    UnsupportedError if the function is marked with ``numba.guvectorize``."""
    if isinstance(value, GUFunc):
        raise UnsupportedError("it calls a function of numba.guvectorize; numba drops its exceptions")
    if isinstance(value, DUFunc):
        if value not in _twins:
            inner: Any = value
            _twins[value] = numba.vectorize(identity=inner.identity)(inner._dispatcher.py_func)
        return _twins[value]
    if not isinstance(value, Dispatcher) or value.py_func.__module__.partition(".")[0] in ("numba", "uvms_mj"):
        return value
    if value.targetoptions.get("forceobj"):
        return value
    if value not in _twins:
        kept = {name: value.targetoptions[name] for name in ("fastmath", "inline") if name in value.targetoptions}
        _twins[value] = guarded_function(value.py_func, error_model="python", **kept)
    return _twins[value]


@register_pass(mutates_CFG=False, analysis_only=False)
class _Guards(FunctionPass):
    """Adds a count of iterations and a check for signals to every loop, and replaces called functions by twins."""

    _name = "uvms_mj_guards"

    def __init__(self) -> None:  # abstract in numba
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        code = state.func_ir
        for block in code.blocks.values():
            for line in block.find_insts(ir.Assign):
                _use_twin(code, line)
        blocks, loops = code.blocks, ir_utils.compute_cfg_from_blocks(code.blocks).loops()
        if loops:
            first = blocks[min(blocks)]
            turns = first.scope.define(ir_utils.mk_unique_var("turns"), code.loc)
            first.body.insert(0, ir.Assign(ir.Const(0, code.loc), turns, code.loc))
        for header in loops:
            block = blocks[header]
            count = block.scope.define(ir_utils.mk_unique_var("count"), block.loc)
            call = ir.Expr.call(count, [turns], (), block.loc)
            at = int(block is first)
            block.body[at:at] = [
                ir.Assign(ir.Global("count", _count, block.loc), count, block.loc),
                ir.Assign(call, turns, block.loc),
            ]
        code._definitions = ir_utils.build_definitions(blocks)
        return True


def _use_twin(code: Any, line: Any) -> None:
    value = line.value
    if isinstance(value, ir.Global | ir.FreeVar):
        value.value = twin(value.value)
    elif isinstance(value, ir.Expr) and value.op == "getattr":
        found = _attribute(code, value)
        if twin(found) is not found:
            line.value = ir.Global(value.attr, twin(found), value.loc)


def _attribute(code: Any, value: Any) -> Any:
    """The value of ``module.name`` or ``package.module.name``; None for an attribute of anything else."""
    owner = ir_utils.guard(ir_utils.get_definition, code, value.value)
    if isinstance(owner, ir.Global | ir.FreeVar):
        owner = owner.value
    elif isinstance(owner, ir.Expr) and owner.op == "getattr":
        owner = _attribute(code, owner)
    return getattr(owner, value.attr, None) if isinstance(owner, python.ModuleType) else None


@register_pass(mutates_CFG=False, analysis_only=True)
class _NoRecursion(FunctionPass):
    """Refuses recursion: it could overflow the stack and kill the process. As plain Python it raises."""

    _name = "uvms_mj_no_recursion"

    def __init__(self) -> None:  # abstract in numba
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        if any(isinstance(kind, types.RecursiveCall) for kind in state.typemap.values()):
            raise UnsupportedError(f"{state.func_id.func_name} calls itself")
        return False


class _Compiler(compiler.CompilerBase):
    def define_pipelines(self) -> list[Any]:
        passes = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_Guards, untyped_passes.LiteralUnroll)
        passes.add_pass_after(_NoRecursion, compiler.NopythonTypeInference)
        passes.finalize()
        return [passes]


@intrinsic
def _count(typing_context, turns):
    """Count an iteration. Every _PATIENCE iterations, run Python's signal handlers and raise if one of them raised."""

    def generate(context, builder, signature, arguments):
        one, flag = arguments[0].type(1), llvm.IntType(32)
        turns = builder.add(arguments[0], one)

        def python(name, returns, *given):
            kind = llvm.FunctionType(returns, [value.type for value in given])
            return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), given)

        due = builder.icmp_signed("==", builder.and_(turns, turns.type(_PATIENCE - 1)), turns.type(0))
        with builder.if_then(due, likely=False):
            lock = python("PyGILState_Ensure", flag)
            raised = builder.icmp_signed("!=", python("PyErr_CheckSignals", flag), flag(0))
            with builder.if_then(raised, likely=False):
                python("PyErr_Clear", llvm.VoidType())
                word = builder.module.globals.get("uvms_mj_stopped") or llvm.GlobalVariable(
                    builder.module, turns.type, "uvms_mj_stopped"
                )
                builder.store(one, word)
            python("PyGILState_Release", llvm.VoidType(), lock)
            with builder.if_then(raised, likely=False):
                context.call_conv.return_user_exc(builder, RuntimeError, ("stopped by a signal",))
        return turns

    return types.intp(types.intp), generate


def _same_shapes(kernel: Any) -> Any:
    """Wrap numba's loop over the elements of an array operation with NumPy's check of the output's shape, as in
    ``a += b`` and ``np.add(a, b, out)``."""

    def checked(context, builder, signature, arguments, ufunc, kernel_class):
        outputs = [
            (arg, kind)
            for arg, kind in zip(arguments[ufunc.nin :], signature.args[ufunc.nin :], strict=False)
            if isinstance(kind, types.ArrayCompatible)
        ]
        inputs = list(zip(arguments, signature.args, strict=False))[: ufunc.nin]
        for output, kind in outputs:
            shape = npyimpl._prepare_argument(context, builder, output, kind).shape
            for argument, input_kind in (*inputs, *outputs):
                given = getattr(npyimpl._prepare_argument(context, builder, argument, input_kind), "shape", ())
                _refuse_unless_broadcast(context, builder, given, shape)
        return kernel(context, builder, signature, arguments, ufunc, kernel_class)

    return checked


def _refuse_unless_broadcast(context: Any, builder: Any, given: Any, shape: Any) -> None:
    one = context.get_constant(types.intp, 1)
    wrong = cgutils.false_bit
    if len(given) > len(shape):
        wrong = cgutils.true_bit
    for n, wanted in zip(reversed(given), reversed(shape), strict=False):
        fits = builder.or_(builder.icmp_signed("==", n, one), builder.icmp_signed("==", n, wanted))
        wrong = builder.or_(wrong, builder.not_(fits))
    with cgutils.if_unlikely(builder, wrong):
        message = "operands could not be broadcast to the shape of the output"
        context.call_conv.return_user_exc(builder, ValueError, (message,))


def _within_bounds(make: Any) -> Any:
    """Wrap numba's maker of the class behind ``array.flat`` with a check of the index. As in NumPy, a negative index
    counts from the end."""

    def checked_class(kind):
        plain: Any = make(kind)

        def index_of(context, builder, array, index):
            size = array.nitems
            index = context.cast(builder, index, types.intp, types.intp) if index.type == size.type else index
            index = builder.sext(index, size.type) if index.type.width < size.type.width else index
            negative = builder.icmp_signed("<", index, index.type(0))
            index = builder.select(negative, builder.add(index, size), index)
            cgutils.do_boundscheck(context, builder, index, size)
            return index

        class Checked(plain):
            def getitem(self, context, builder, kind, array, index):
                return super().getitem(context, builder, kind, array, index_of(context, builder, array, index))

            def setitem(self, context, builder, kind, array, index, value):
                super().setitem(context, builder, kind, array, index_of(context, builder, array, index), value)

        return Checked

    return checked_class
