"""A module of LLVM under construction: its settings, its constants and its files."""

import types
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from llvmlite import ir

from .values import POINTER, SCALARS, Value

Intrinsic = Callable[[ir.IRBuilder, Sequence[ir.Value]], "Value | None"]


@dataclass
class Module:
    """What the parts of a translation share.

    Attributes:
        name: of the module.
        checked: whether indices that are not constants, divisions of integers and conversions to integers are checked.
            A function then returns 0, or a number that says why and where it ended early (:mod:`.codes`).
        intrinsics: functions with code of their own, which get their arguments as integers, an array by its address.
        fused: functions in which, and in all that they call, a product and a sum may be rounded once.
        interrupted: writes code for a number that is not 0 if a user's loop shall end.
        library: prefix of the target's names for the functions of the C library.
        frame: bytes of local arrays so far.
        files: the sources' files, by their number in the codes.
    """

    name: str
    checked: bool = False
    intrinsics: Mapping[Any, Intrinsic] = field(default_factory=dict)
    fused: Collection[Any] = ()
    interrupted: Callable[[ir.IRBuilder], ir.Value] | None = None
    library: str = ""

    def __post_init__(self) -> None:
        self.module = ir.Module(self.name)
        self.frame, self.files = 0, list[str]()
        self._constants: dict[tuple, ir.Value] = {}

    def file(self, name: str) -> int:
        """The number of a file."""
        if name not in self.files:
            self.files.append(name)
        return self.files.index(name)

    def constant_array(self, array: np.ndarray) -> ir.Value:
        """Memory with the numbers of an array, which only is read."""
        key = (array.dtype, array.tobytes())
        if key not in self._constants:
            of = ir.IntType(8) if array.dtype == bool else SCALARS[array.dtype]
            kind = ir.ArrayType(of, array.size)
            memory = ir.GlobalVariable(self.module, kind, self.module.get_unique_name("constant"))
            memory.linkage, memory.global_constant = "internal", True
            memory.initializer = kind(array.ravel().tolist())
            memory.type = POINTER
            self._constants[key] = memory
        return self._constants[key]

    def call(
        self, at: Any, function: types.FunctionType, arguments: Sequence[Value], fused: bool = False
    ) -> Value | None:
        """Write a call."""
        raise NotImplementedError  # Unit translates the function
