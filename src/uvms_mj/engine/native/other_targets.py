"""The closed loop of free_body for another processor: one module with its stages."""

from collections.abc import Sequence
from typing import Any

import llvmlite.binding as llvm

from ...compiler.targets import Target
from ...compiler.values import INT
from .callback import RIGID
from .entry import Entry
from .free_body import free_steps
from .intrinsics import kernel_module, stage_module
from .layouts import BODY, CONTEXT
from .user_stage import between_copies

STEPS = "uvms_mj_free_steps"
"""The symbol of :func:`.free_body.free_steps`: a function of four 64-bit integers that returns one."""


def loop_for(target: Target, stages: Sequence[Entry]) -> bytes:
    """The loop with these stages of a run, as an object file or as text. It uses no symbol besides functions of the C
    library. The ``code_at`` of a stage's record is its number, 1 for the first. Nobody can interrupt an endless loop of
    a user's stage. Raises Untranslatable if the language lacks what a stage uses.
    """
    symbols = [f"uvms_mj_stage_{k}" for k in range(1, len(stages) + 1)]
    kernels: dict[str, Any] = {}
    users = []
    for symbol, entry in zip(symbols, stages, strict=True):
        function = type(entry.stage).function()
        if entry.users:
            parts = between_copies(function, entry.stage.room, entry.kinds)
            users.append(stage_module(*parts, symbol, interrupted=None, library=target.library)[0])
        else:
            settings, state, given, out = entry.kinds
            kernels[symbol] = function, [settings, state, given, state, out]
    kernels[STEPS] = free_steps, [CONTEXT, BODY, INT, INT]  # after the stages that it calls
    module = llvm.parse_assembly(str(kernel_module(kernels, symbols, target.library, RIGID)))
    for text in users:
        module.link_in(llvm.parse_assembly(text))
    for function in module.functions:
        if not function.is_declaration and function.name != STEPS:
            function.linkage = "internal"
    return target.code(module)
