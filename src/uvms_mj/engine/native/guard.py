"""What code of users may do to the process besides its work: end it, or copy it."""

import contextlib
import ctypes
import functools
import os
from collections.abc import Iterator
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir

from .compilation import target_machine

COPIED = "uvms-mj: a stage has copied the process by fork, and the copy has come back from it: the copy ends here\n"
ENDED = "uvms-mj: {who} ended the process by exit()\n"
_MOST = 400


def end_copy(process: int) -> None:
    """End this process if its number is another one: it is a copy that a stage has made and that came back from it. Two
    of them would write into one log."""
    if os.getpid() != process:
        os.write(2, COPIED.encode())
        os._exit(1)


@contextlib.contextmanager
def no_exit(who: str) -> Iterator[None]:
    """A context in which ``exit()``, called by machine code, ends the process with a message and the status 2: it would
    end with what the code gave, 0 for example, and without a word."""
    handler = _handler()
    text = ENDED.format(who=who).encode()[:_MOST]
    ctypes.memmove(handler["text"], text, len(text))
    ctypes.c_int64.from_address(handler["length"]).value = len(text)
    armed = ctypes.c_int64.from_address(handler["armed"])
    armed.value += 1
    try:
        yield
    finally:
        armed.value -= 1


@functools.cache
def _handler() -> dict[str, int]:
    """The addresses of the words of the function that ``exit()`` calls: Python would be too late, and C's own functions
    for this have no condition."""
    module = ir.Module("at_exit")
    byte, word, flag = ir.IntType(8), ir.IntType(64), ir.IntType(32)
    kinds = {"armed": word, "length": word, "text": ir.ArrayType(byte, _MOST)}
    values: dict[str, Any] = {}
    for name, kind in kinds.items():
        values[name] = each = ir.GlobalVariable(module, kind, f"uvms_mj_{name}")
        each.initializer = ir.Constant(kind, None if name == "text" else 0)
    write = ir.Function(module, ir.FunctionType(word, [flag, byte.as_pointer(), word]), "write")
    end = ir.Function(module, ir.FunctionType(ir.VoidType(), [flag]), "_exit")
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [byte.as_pointer()]), "uvms_mj_at_exit")
    builder = ir.IRBuilder(function.append_basic_block())
    armed = builder.icmp_signed("!=", builder.load(values["armed"]), word(0))
    with builder.if_then(armed):
        text = builder.bitcast(values["text"], byte.as_pointer())
        builder.call(write, [flag(2), text, builder.load(values["length"])])
        builder.call(end, [flag(2)])
    builder.ret_void()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(str(module)), target_machine())
    engine.finalize_object()
    _kept.append(engine)
    ctypes.CDLL(None).__cxa_atexit(ctypes.c_void_p(engine.get_function_address("uvms_mj_at_exit")), None, None)
    return {name: engine.get_global_value_address(f"uvms_mj_{name}") for name in kinds}


_kept: list[Any] = []
"""The machine code that ``exit()`` calls, as long as the process lives: llvmlite frees nothing at its end."""
