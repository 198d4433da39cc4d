"""The process is guarded against code of users that ends or copies it."""

import contextlib
import ctypes
import functools
import os
import threading
from collections.abc import Callable, Iterator
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir

from .compilation import target_machine

COPIED = "uvms-mj: a stage has copied the process by fork: the copy ends here\n"
ENDED = "uvms-mj: {who} ended the process by exit()\n"
_MOST = 400


def end_copy(process: int) -> None:
    """End this process if its number is another one: it is a copy that a stage has made and that came back from it. Two
    of them would write into one log."""
    if os.getpid() != process:
        os.write(2, COPIED.encode())
        os._exit(1)


@contextlib.contextmanager
def no_exit(who: str, no_copy: bool = True) -> Iterator[None]:
    """A context in which ``exit()``, called by machine code, ends the process with a message and the status 2: it would
    end with what the code gave, 0 for example, and without a word.

    ``no_copy``: ``fork()`` in this thread ends the copy at once. Its only thread may wait for ever for a lock of Python
    that another thread of the process held, so Python can't end it. Code in Python may want copies, see
    :func:`end_copy`.
    """
    handler = _handler()
    text = ENDED.format(who=who).encode()[:_MOST]
    ctypes.memmove(handler["text"], text, len(text))
    ctypes.c_int64.from_address(handler["length"]).value = len(text)
    armed, alone = (ctypes.c_int64.from_address(handler[name]) for name in ("armed", "alone"))
    before = alone.value
    armed.value += 1
    if no_copy:
        alone.value = threading.get_ident()
    try:
        yield
    finally:
        armed.value -= 1
        alone.value = before


@functools.cache
def _handler() -> dict[str, int]:
    """The addresses of the words of the functions that ``exit()`` and ``fork()`` call: Python would be too late, and
    C's own functions for this have no condition."""
    module = ir.Module("at_exit")
    byte, word, flag, nothing = ir.IntType(8), ir.IntType(64), ir.IntType(32), ir.VoidType()
    kinds = {"armed": word, "alone": word, "length": word, "text": ir.ArrayType(byte, _MOST)}
    values: dict[str, Any] = {}
    for name, kind in kinds.items():
        values[name] = each = ir.GlobalVariable(module, kind, f"uvms_mj_{name}")
        each.initializer = ir.Constant(kind, None if name == "text" else 0)
    copied = COPIED.encode()
    said = ir.GlobalVariable(module, ir.ArrayType(byte, len(copied)), "uvms_mj_copied")
    said.initializer = ir.Constant(said.value_type, bytearray(copied))
    write = ir.Function(module, ir.FunctionType(word, [flag, byte.as_pointer(), word]), "write")
    end = ir.Function(module, ir.FunctionType(nothing, [flag]), "_exit")
    self = ir.Function(module, ir.FunctionType(word, []), "pthread_self")

    def define(name: str, takes: list[ir.Type], condition: Callable, text: Any, length: Callable, status: int) -> None:
        builder = ir.IRBuilder(ir.Function(module, ir.FunctionType(nothing, takes), name).append_basic_block())
        with builder.if_then(condition(builder)):
            builder.call(write, [flag(2), builder.bitcast(text, byte.as_pointer()), length(builder)])
            builder.call(end, [flag(status)])
        builder.ret_void()

    define(
        "uvms_mj_at_exit", [byte.as_pointer()],
        lambda builder: builder.icmp_signed("!=", builder.load(values["armed"]), word(0)),
        values["text"], lambda builder: builder.load(values["length"]), 2,
    )  # fmt: skip
    define(
        "uvms_mj_at_fork", [],
        lambda builder: builder.icmp_signed("==", builder.load(values["alone"]), builder.call(self, [])),
        said, lambda builder: word(len(copied)), 1,
    )  # fmt: skip
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(str(module)), target_machine())
    engine.finalize_object()
    _kept.append(engine)
    at_exit, in_copy = (ctypes.c_void_p(engine.get_function_address(f"uvms_mj_at_{name}")) for name in ("exit", "fork"))
    process = ctypes.CDLL(None)
    process.__cxa_atexit(at_exit, None, None)
    # glibc exports it by this name alone
    register = getattr(process, "__register_atfork" if hasattr(process, "__register_atfork") else "pthread_atfork")
    register(None, None, in_copy, None)
    return {name: engine.get_global_value_address(f"uvms_mj_{name}") for name in kinds}


_kept: list[Any] = []
"""The machine code that ``exit()`` calls, as long as the process lives: llvmlite frees nothing at its end."""
