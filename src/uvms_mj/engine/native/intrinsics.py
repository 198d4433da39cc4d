"""Machine code for the functions of :mod:`.memory`. Imported only when something has to be compiled."""

import platform
import types
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
from llvmlite import ir

from ...compiler.emission import Emission, Intrinsic
from ...compiler.unit import Unit, translate
from ...compiler.values import FLOAT, INT, OUTSIDE, POINTER, WORD, Place, Value, contiguous, scalar, view
from ...physics.kernels import fused_kernels
from . import memory

_FLAG = ir.IntType(32)


def _array(base: np.dtype, *inner: int):
    def generate(at, arguments):
        address, n = arguments
        size = n.constant if isinstance(n, ir.Constant) else None
        if at.unit.cells and size is not None and isinstance(address, ir.Constant):
            return Value(contiguous(base, (size, *inner)), (Place(address.constant),), roots=frozenset({OUTSIDE}))
        pointer = at.at.inttoptr(address, POINTER)
        kind = contiguous(base, (size, *inner))
        return Value(kind, (pointer, n) if size is None else (pointer,), roots=frozenset({OUTSIDE}))

    return generate


def _record(dtype: np.dtype, readonly: str = ""):
    def generate(at, arguments):
        (address,) = arguments
        if at.unit.cells and isinstance(address, ir.Constant):
            return view(Place(address.constant), dtype, readonly)
        return view(at.at.inttoptr(address, POINTER), dtype, readonly)

    return generate


def _external(builder: ir.IRBuilder, name: str, returns: ir.Type, *given: ir.Value) -> ir.Value:
    """A call of a C function."""
    kind = ir.FunctionType(returns, [value.type for value in given])
    return builder.call(_declared(builder.module, kind, name), given)


def _mj_factorM(at: Emission, arguments: Sequence[ir.Value]) -> None:
    _external(at.at, "mj_factorM", ir.VoidType(), *arguments)


def _shared(name: str, array: np.ndarray):
    """An array of this process, by its symbol."""

    def generate(at, arguments):
        builder = at.at
        memory = builder.module.globals.get(name) or ir.GlobalVariable(builder.module, ir.IntType(8), name)
        return Value(contiguous(array.dtype, array.shape), (memory,), roots=frozenset({OUTSIDE}))

    return generate


def _call_code(at: Emission, arguments: Sequence[ir.Value]) -> Value:
    builder = at.at
    function, *addresses = arguments
    kind = ir.FunctionType(WORD, [WORD] * len(addresses))
    return scalar(builder.call(builder.inttoptr(function, kind.as_pointer()), addresses), INT)


def _call_step(at: Emission, arguments: Sequence[ir.Value]) -> Value:
    builder = at.at
    function, instance, clock = arguments
    double = ir.DoubleType()
    places = [builder.add(clock, WORD(8 * i)) for i in range(2)]
    t_and_h = [builder.load(builder.inttoptr(place, double.as_pointer()), typ=double) for place in places]
    kind = ir.FunctionType(_FLAG, [WORD, double, double, _FLAG])
    status = builder.call(builder.inttoptr(function, kind.as_pointer()), [instance, *t_and_h, _FLAG(1)])
    return scalar(builder.sext(status, WORD), INT)


def _settle_modes(at: Emission, arguments: Sequence[ir.Value]) -> None:
    """The library's function takes as long as a short stage: on x86 it is called where the modes have changed."""
    builder = at.at
    changed = ir.Constant(ir.IntType(1), 1)
    if platform.machine() in ("x86_64", "AMD64"):
        place, byte = builder.alloca(_FLAG), ir.IntType(8).as_pointer()
        read = builder.module.declare_intrinsic("llvm.x86.sse.stmxcsr", (), ir.FunctionType(ir.VoidType(), [byte]))
        builder.call(read, [builder.bitcast(place, byte)])
        control = builder.and_(builder.load(place), _FLAG(0xFFC0))  # without the flags of exceptions
        changed = builder.icmp_signed("!=", control, _FLAG(0x1F80))
    with builder.if_then(changed, likely=False):
        _external(builder, "fesetenv", _FLAG, WORD(memory.DEFAULT_MODES))


def signalled(builder: ir.IRBuilder) -> ir.Value:
    """Whether a signal handler raises, as it does at Ctrl-C; then ``stopped`` of :mod:`.memory` is set."""
    lock = _external(builder, "PyGILState_Ensure", _FLAG)
    raised = builder.icmp_signed("!=", _external(builder, "PyErr_CheckSignals", _FLAG), _FLAG(0))
    with builder.if_then(raised, likely=False):
        _external(builder, "PyErr_Clear", ir.VoidType())
        word = builder.module.globals.get("uvms_mj_stopped") or ir.GlobalVariable(
            builder.module, WORD, "uvms_mj_stopped"
        )
        builder.store(WORD(1), word)
    _external(builder, "PyGILState_Release", ir.VoidType(), lock)
    return builder.zext(raised, WORD)


INTRINSICS: dict[Any, Intrinsic] = {
    memory.floats: _array(FLOAT),
    memory.triples: _array(FLOAT, 3),
    memory.integers: _array(INT),
    memory.registered: _shared("uvms_mj_registry", memory.registry),
    memory.frozen_clock: _shared("uvms_mj_clock", memory.clock),
    memory.mj_factorM: _mj_factorM,
    memory.call_code: _call_code,
    memory.call_step: _call_step,
    memory.settle_modes: _settle_modes,
}


def call_linked(symbols: Sequence[str]) -> Intrinsic:
    """Calls of stages that are linked into the same module, where a stage's ``code_at`` is its number, 1 for the first
    symbol. Processors without a common memory have no address of a stage."""

    def generate(at, arguments):
        builder = at.at
        number, *addresses = arguments
        kind = ir.FunctionType(WORD, [WORD] * len(addresses))
        start, end, results = builder.block, builder.append_basic_block(), []
        for symbol in symbols:
            block = builder.append_basic_block()
            builder.position_at_end(block)
            results.append((builder.call(_declared(builder.module, kind, symbol), addresses), block))
            builder.branch(end)
        builder.position_at_end(start)
        choice = builder.switch(number, end)
        for k, (_, block) in enumerate(results):
            choice.add_case(WORD(k + 1), block)
        builder.position_at_end(end)
        wrong = builder.phi(WORD)
        for result, block in [*results, (WORD(0), start)]:
            wrong.add_incoming(result, block)
        return scalar(wrong, INT)

    return generate


def _declared(module: ir.Module, kind: ir.FunctionType, name: str) -> ir.Function:
    return module.globals.get(name) or ir.Function(module, kind, name)


def kernel_module(
    parts: Mapping[str, tuple[types.FunctionType, Sequence[np.dtype]]],
    fused: bool = False,
    linked: Sequence[str] = (),
) -> ir.Module:
    """The module of functions of the package, which are trusted, by their symbols, each with its parameters. Stages are
    called by their addresses, or by their number among the symbols ``linked``."""
    calls = {memory.call_code: call_linked(linked)} if linked else {}
    unit = Unit("kernels", intrinsics=INTRINSICS | calls, fused=fused_kernels if fused else ())
    for symbol, (function, parameters) in parts.items():
        translate(unit, function, parameters, symbol)
    return unit.module


def records_of(records: Mapping[Any, tuple[np.dtype, str]]) -> dict[Any, Intrinsic]:
    """The functions that stand for the record at an address (:mod:`.user_stage`)."""
    return {reader: _record(*kind) for reader, kind in records.items()}


def stage_module(
    function: types.FunctionType,
    records: Mapping[Any, tuple[np.dtype, str]],
    name: str,
    interrupted: Callable[[ir.IRBuilder], ir.Value] | None = signalled,
    left_out: Collection[tuple[str, int]] = (),
) -> tuple[str, list[str]]:
    """The module of a user's stage, which is checked, as LLVM's text, and its source files. ``interrupted`` and
    ``left_out`` as in :class:`uvms_mj.compiler.unit.Unit`."""
    unit = Unit(name, True, INTRINSICS | records_of(records), (), interrupted, left_out=left_out)
    translate(unit, function, [INT] * 5, name)
    return str(unit.module), unit.files


def linked_stage_module(
    function: types.FunctionType, records: Mapping[Any, tuple[np.dtype, str]], name: str, symbol: str = ""
) -> str:
    """As :func:`stage_module`, for another processor: without interrupts and without functions of a C library of its
    own. A stage in C is called by its ``symbol``, and keeps the floating-point modes."""

    def in_c(at: Emission, arguments: Sequence[ir.Value]) -> Value:
        words = arguments[1:]
        kind = ir.FunctionType(_FLAG, [POINTER] * len(words))
        given = [at.at.inttoptr(word, POINTER) for word in words]
        return scalar(at.at.sext(at.at.call(_declared(at.at.module, kind, symbol), given), WORD), INT)

    instead = {memory.call_code: in_c, memory.settle_modes: lambda at, arguments: None} if symbol else {}
    unit = Unit(name, True, INTRINSICS | instead | records_of(records), (), None)
    translate(unit, function, [INT] * 5, name)
    return str(unit.module)
