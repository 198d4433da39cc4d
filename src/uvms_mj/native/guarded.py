"""How numba compiles a user's law and the functions that it calls.

Numba trusts array code more than NumPy does. Here an index out of bounds and operands of the wrong shape raise, in the
law and in every function that it calls, also in those that the user marked with ``numba.njit`` and in numba's own. A
loop that never ends listens to signals. Imported only where something has to be compiled.
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
from numba.core import compiler, config, ir, ir_utils, untyped_passes
from numba.core.cgutils import get_or_insert_function
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError, UnsupportedError
from numba.extending import intrinsic
from numba.np import arrayobj, npyimpl
from numba.np.ufunc.dufunc import DUFunc
from numba.np.ufunc.gufunc import GUFunc

from .checked_arrays import same_shapes, within_bounds

__all__ = ["NumbaError", "guarded", "guarded_function", "twin"]

_lock = threading.RLock()
_PATIENCE = 1 << 20
"""Turns of a loop from one look at signals to the next: about a millisecond."""


@contextlib.contextmanager
def guarded(law: bool) -> Iterator[None]:
    """For a law, check indices and shapes in all that is compiled; for the core, in nothing, whatever
    NUMBA_BOUNDSCHECK is set to."""
    names = ((config, "BOUNDSCHECK"), (npyimpl, "numpy_ufunc_kernel"), (arrayobj, "make_array_flat_cls"))
    with _lock:
        config.reload_config()  # numba does so when it compiles, which would undo what is set here
        before = [getattr(module, name) for module, name in names]
        config.BOUNDSCHECK = int(law)  # type: ignore[attr-defined]
        if law:
            npyimpl.numpy_ufunc_kernel = same_shapes(npyimpl.numpy_ufunc_kernel)
            arrayobj.make_array_flat_cls = within_bounds(arrayobj.make_array_flat_cls)
        try:
            yield
        finally:
            for (module, name), value in zip(names, before, strict=True):
                setattr(module, name, value)


def guarded_function(function: Any, **options: Any) -> Dispatcher:
    """A function that numba compiles with the checks of this module."""
    return numba.njit(pipeline_class=_Compiler, boundscheck=True, **options)(function)


_twins: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()


def twin(value: Any) -> Any:
    """What stands in for a function that the user marked with ``numba.njit`` or ``numba.vectorize``: that one may be
    compiled already, or be loaded from numba's cache, without checks."""
    if isinstance(value, GUFunc):
        raise UnsupportedError("a function of numba.guvectorize is called, whose exceptions numba drops")
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
    """Every loop counts its turns and looks at signals now and then; every function that is called is a twin."""

    _name = "uvms_mj_guards"

    def __init__(self) -> None:
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
    """What ``module.name`` or ``package.module.name`` is; None for an attribute of anything else."""
    owner = ir_utils.guard(ir_utils.get_definition, code, value.value)
    if isinstance(owner, ir.Global | ir.FreeVar):
        owner = owner.value
    elif isinstance(owner, ir.Expr) and owner.op == "getattr":
        owner = _attribute(code, owner)
    return getattr(owner, value.attr, None) if isinstance(owner, python.ModuleType) else None


@register_pass(mutates_CFG=False, analysis_only=True)
class _NoRecursion(FunctionPass):
    """A function that calls itself could overrun the stack, which ends the process; as plain Python it raises."""

    _name = "uvms_mj_no_recursion"

    def __init__(self) -> None:
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
    """One more turn of a loop; now and then run Python's signal handlers, and raise if one of them did."""

    def generate(context, builder, signature, arguments):
        one, flag = arguments[0].type(1), llvm.IntType(32)
        turns = builder.add(arguments[0], one)

        def python(name, returns, *given):
            kind = llvm.FunctionType(returns, [value.type for value in given])
            return builder.call(get_or_insert_function(builder.module, kind, name), given)

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
