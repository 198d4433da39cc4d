"""Machine code of a module for a processor: this one, or another one."""

from collections.abc import Sequence
from dataclasses import dataclass

import llvmlite.binding as llvm

from .symbols import LIBM


@dataclass(frozen=True)
class Target:
    """A processor for which code is emitted.

    Attributes:
        triple, processor, features: as LLVM calls them.
        assembly: whether its code is text; otherwise it is an object file.
        reloc: how addresses are found: "pic" for a shared library.
        compact: whether small code counts more than its speed.
        codemodel: how far apart code and data may be: "small" for an object that a linker takes.
    """

    triple: str
    processor: str = ""
    features: str = ""
    assembly: bool = False
    reloc: str = "default"
    codemodel: str = "jitdefault"
    compact: bool = False

    def machine(self) -> llvm.TargetMachine:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        target = llvm.Target.from_triple(self.triple)
        level = 2 if self.compact else 3
        return target.create_target_machine(self.processor, self.features, level, self.reloc, self.codemodel)

    def code(self, module: llvm.ModuleRef, level: int = 1) -> bytes:
        """The code of a module, which it optimizes."""
        return self.emitted(self.optimized(module, level))

    def optimized(self, module: llvm.ModuleRef, level: int = 1) -> llvm.ModuleRef:
        """A module that is optimized, itself."""
        optimize(module, self.machine(), self.triple, level, self.compact)
        return module

    def emitted(self, module: llvm.ModuleRef) -> bytes:
        """The code of a module that is optimized."""
        machine = self.machine()
        module.triple, module.data_layout = self.triple, str(machine.target_data)
        return machine.emit_assembly(module).encode() if self.assembly else machine.emit_object(module)


PTX = Target("nvptx64-nvidia-cuda", "sm_90", "+ptx80", assembly=True)
WASM = Target("wasm32-unknown-unknown")
AARCH64 = Target("aarch64-unknown-linux-gnu")
X86_64 = Target("x86_64-unknown-linux-gnu", "x86-64-v2", reloc="pic")
"""Of a shared library, for any processor of the last fifteen years."""


def optimize(
    module: llvm.ModuleRef, machine: llvm.TargetMachine, triple: str, level: int = 1, compact: bool = False
) -> None:
    """Optimize a module for a processor, and add the functions of :mod:`.libm` to it that it still calls."""
    _optimize(module, machine, triple, level, compact)
    if (library := _libm_of(module)) is not None:
        _optimize(library, machine, triple, level, compact)
        take_in(library, module)


def inline_libm(module: llvm.ModuleRef) -> None:
    """Add the functions of :mod:`.libm` to a module that it calls, as parts of their callers."""
    if (library := _libm_of(module, inlined=True)) is not None:
        take_in(library, module)


def libm_symbols(module: llvm.ModuleRef) -> list[str]:
    """The functions of :mod:`.libm` that a module calls, by their symbols."""
    return [each.name for each in module.functions if each.is_declaration and each.name.startswith(LIBM)]


def libm_text(symbols: Sequence[str], inlined: bool = False) -> str:
    """The module of functions of :mod:`.libm`, as LLVM's text; empty if there are none."""
    if not symbols:
        return ""
    from .unit import libm_module  # a warm start compiles nothing

    return str(libm_module(symbols, inlined))


def _libm_of(module: llvm.ModuleRef, inlined: bool = False) -> llvm.ModuleRef | None:
    """The functions of :mod:`.libm` that a module calls, if any."""
    text = libm_text(libm_symbols(module), inlined)
    return llvm.parse_assembly(text) if text else None


def take_in(library: llvm.ModuleRef, module: llvm.ModuleRef) -> None:
    """Add the functions of :mod:`.libm` to a module."""
    symbols = [each.name for each in library.functions if each.name.startswith(LIBM)]
    module.link_in(library)
    for symbol in symbols:
        module.get_function(symbol).linkage = "internal"


def _optimize(module: llvm.ModuleRef, machine: llvm.TargetMachine, triple: str, level: int, compact: bool) -> None:
    module.triple, module.data_layout = triple, str(machine.target_data)
    module.verify()
    first = llvm.create_new_module_pass_manager()
    first.add_global_dead_code_eliminate_pass()  # a function that nothing calls takes no others in
    first.add_always_inliner_pass()
    first.add_global_dead_code_eliminate_pass()
    if level == 0:  # a fifth of the time, for code that runs shortly: its steps take a third longer
        first.add_sroa_pass()
        first.add_simplify_cfg_pass()
        first.add_instruction_combine_pass()
        first.add_simplify_cfg_pass()
        first.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=1)))
        return
    # higher levels take twice as long and make no step faster
    tuning = llvm.create_pipeline_tuning_options(speed_level=level)
    tuning.inlining_threshold = 50
    if compact:  # vectors of three to six numbers: a loop over parts of them is longer, and no faster
        tuning.size_level, tuning.loop_unrolling, tuning.loop_vectorization = 1, False, False
    passes = llvm.create_pass_builder(machine, tuning)
    first.run(module, passes)
    passes.getModulePassManager().run(module, passes)
