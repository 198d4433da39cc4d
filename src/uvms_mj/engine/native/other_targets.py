"""The closed loop of free_body for another processor: one module with its stages."""

from collections.abc import Mapping, Sequence
from typing import Any

import llvmlite.binding as llvm
import numpy as np

from ...compiler.targets import Target
from ...compiler.values import INT
from .callback import evaluate_alone
from .intrinsics import kernel_module, stage_module
from .loop import free_steps
from .pipeline import CompiledStage
from .record import Shape, with_numbers
from .user_stage import between_copies

STEPS = "uvms_mj_free_steps"
"""The symbol of :func:`.loop.free_steps`: a function of three 64-bit integers that returns one. The
first is the address of the record of a run, which has it in ``address``, too."""


def water_for(target: Target, kind: np.dtype, fused: bool, symbol: str) -> bytes:
    """The water on a vehicle with a record of :func:`.record.alone_dtype` in an evaluation of MuJoCo, whose function
    mj_factorM it uses, as an object file. The function has the addresses of the record, of mjModel and of mjData.
    ``fused`` is for a vehicle with joints."""
    parts: dict[str, Any] = {symbol: (evaluate_alone, [with_numbers(kind), INT, INT])}
    return target.code(llvm.parse_assembly(str(kernel_module(parts, fused=fused))))


def loop_for(
    target: Target, shape: Shape, stages: Sequence[CompiledStage], entries: Mapping[str, Any] | None = None
) -> bytes:
    """The loop for runs of a shape with these stages, as an object file or as text, and further ``entries`` of a record
    and an integer, by their symbols.

    It uses no symbol besides functions of the C library. The ``code_at`` of a stage's record is its number, 1 for the
    first. Nobody can interrupt an endless loop of a user's stage. Raises Untranslatable if the language lacks what a
    stage uses.
    """
    symbols = [f"uvms_mj_stage_{k}" for k in range(1, len(stages) + 1)]
    kernels: dict[str, Any] = {}
    users = []
    for symbol, stage in zip(symbols, stages, strict=True):
        function = type(stage.stage).function()
        if stage.users:
            parts = between_copies(function, stage.stage.room, stage.kinds)
            users.append(stage_module(*parts, symbol, interrupted=None)[0])
        else:
            settings, state, given, out = stage.kinds
            kernels[symbol] = function, [settings, state, given, state, out]
    run = with_numbers(shape.layout)
    kernels[STEPS] = free_steps, [run, INT, INT]  # after the stages that it calls
    kernels |= {symbol: (function, [run, INT]) for symbol, function in (entries or {}).items()}
    module = llvm.parse_assembly(str(kernel_module(kernels, linked=symbols)))
    for text in users:
        module.link_in(llvm.parse_assembly(text))
    for function in module.functions:
        if not function.is_declaration and function.name not in (STEPS, *(entries or ())):
            function.linkage = "internal"
    return target.code(module)
