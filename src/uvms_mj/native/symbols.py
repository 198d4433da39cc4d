"""What compiled code needs from outside it, by symbols that numba's disk cache can keep: the registry and MuJoCo's own functions."""

import ctypes
import sys
from pathlib import Path

import llvmlite.binding as llvm
import mujoco
import numpy as np
from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic

from ..compilation import kernel

CAPACITY = 1024
"""How many vehicles can be attached at once in one process."""

registry = np.zeros((CAPACITY, 2), dtype=np.int64)
"""Rows of (address of mjData, address of CONTEXT), zero where free; row 0 is (the last row ever used, 0).

Read by every callback without a lock, written under one: a row stays where it is, and its first number is written last and
cleared first, so that a callback in another thread never sees half a row.
"""


def _mujoco_function(name: str) -> int:
    """The address of a function in the MuJoCo library that this process has loaded already."""
    library = ctypes.CDLL(None)
    if not hasattr(library, name):
        library = ctypes.CDLL(str(_mujoco_library()))
    address = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
    assert address is not None
    return address


def _mujoco_library() -> Path:
    folder = Path(mujoco.__file__).parent
    pattern = "*mujoco*.dylib" if sys.platform == "darwin" else "libmujoco.so.*"
    return min(folder.glob(pattern))


llvm.add_symbol("uvms_mj_registry", registry.ctypes.data)
llvm.add_symbol("mj_factorM", _mujoco_function("mj_factorM"))

mj_factorM = types.ExternalFunction("mj_factorM", types.void(types.intp, types.intp))


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
def call_law(typing_context, function, gains, state, signals, state_dot, tau_cmd):
    """Call a compiled law by its address with the addresses of its records; 0 if it returned, 1 if it raised."""

    def generate(context, builder, signature, arguments):
        word = context.get_value_type(types.intp)
        function_type = ir.FunctionType(ir.IntType(32), [word] * 5)
        target = builder.inttoptr(arguments[0], function_type.as_pointer())
        return builder.call(target, arguments[1:])

    return types.int32(*[types.intp] * 6), generate


@kernel
def registered():
    """The registry, an array (CAPACITY, 2)."""
    return carray(pointer(_registry_address()), (CAPACITY, 2), np.int64)
