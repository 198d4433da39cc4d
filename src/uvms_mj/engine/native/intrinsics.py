"""Machine code for the functions of :mod:`.memory`. Imported only when something has to be compiled."""

import functools

import numpy as np
from llvmlite import ir
from numba import carray, types
from numba.core.cgutils import get_or_insert_function
from numba.extending import intrinsic, overload

from ..native import memory
from .layouts import CLOCKS, CONTEXT, LOOP, STAGE

_mj_factorM = types.ExternalFunction("mj_factorM", types.void(types.intp, types.intp))
_CAPACITY = memory.CAPACITY
_UNLOCKED = 1
"""PyGILState_UNLOCKED."""


@intrinsic
def _registry_address(typing_context):
    def generate(context, builder, signature, arguments):
        name = "uvms_mj_registry"
        symbol = builder.module.globals.get(name) or ir.GlobalVariable(builder.module, ir.IntType(8), name)
        return builder.ptrtoint(symbol, context.get_value_type(types.intp))

    return types.intp(), generate


@intrinsic
def pointer(typing_context, address):
    """An address as the pointer that numba.carray takes."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.intp), generate


@intrinsic
def _call_stage(typing_context, function, settings, state, given, state_dot, out):
    def generate(context, builder, signature, arguments):
        word, flag = context.get_value_type(types.int64), ir.IntType(32)
        target = builder.inttoptr(arguments[0], ir.FunctionType(word, [word] * 5).as_pointer())
        raised = builder.call(target, arguments[1:])

        def python(name, returns, *given):
            kind = ir.FunctionType(returns, [value.type for value in given])
            return builder.call(get_or_insert_function(builder.module, kind, name), given)

        # numba takes the GIL to raise an exception whose text is made at run time. Without its environment, which code
        # from disk lacks, it does not release the GIL, and the run would deadlock. The loop is called without the GIL.
        with builder.if_then(builder.icmp_signed("!=", raised, word(0)), likely=False):
            holds = builder.icmp_signed("!=", python("PyGILState_Check", flag), flag(0))
            with builder.if_then(holds, likely=False):
                python("PyErr_Clear", ir.VoidType())
                python("PyGILState_Release", ir.VoidType(), flag(_UNLOCKED))
        return raised

    return types.int64(*[types.int64] * 6), generate


@functools.cache
def register() -> None:
    """Register with numba, once, the code to compile in place of the plain functions."""

    @overload(memory.mj_factorM)
    def _(model, data):
        return lambda model, data: _mj_factorM(model, data)

    @overload(memory.floats)
    def _(address, n):
        return lambda address, n: carray(pointer(address), (n,), np.float64)

    @overload(memory.triples)
    def _(address, n):
        return lambda address, n: carray(pointer(address), (n, 3), np.float64)

    @overload(memory.integers)
    def _(address, n):
        return lambda address, n: carray(pointer(address), (n,), np.int64)

    @overload(memory.context_at)
    def _(address):
        return lambda address: carray(pointer(address), (1,), CONTEXT)[0]

    @overload(memory.loop_at)
    def _(address):
        return lambda address: carray(pointer(address), (1,), LOOP)[0]

    @overload(memory.registered)
    def _():
        return lambda: carray(pointer(_registry_address()), (_CAPACITY, 2), np.int64)

    @overload(memory.stage_at)
    def _(address):
        return lambda address: carray(pointer(address), (1,), STAGE)[0]

    @overload(memory.clock_at)
    def _(address):
        return lambda address: carray(pointer(address), (1,), CLOCKS)[0]

    @overload(memory.call_stage)
    def _(function, settings, state, given, state_dot, out):
        return lambda function, settings, state, given, state_dot, out: _call_stage(
            function, settings, state, given, state_dot, out
        )
