"""Functions of the language as machine code, to compare with plain Python."""

import ctypes
import hashlib
import linecache
import textwrap
import types
from collections.abc import Callable, Sequence
from typing import Any

import llvmlite.binding as llvm
import numpy as np

from uvms_mj.compiler.refusals import place
from uvms_mj.compiler.targets import inline_libm
from uvms_mj.compiler.unit import Unit, translate
from uvms_mj.engine.native.compilation import target_machine

_engines: list[Any] = []


class Compiled:
    """A function of records and arrays, given by their dtypes, as machine code that checks."""

    def __init__(
        self, function: types.FunctionType, kinds: Sequence[Any], readonly: dict[int, str] | None = None, **options: Any
    ) -> None:
        dtypes = [np.dtype(kind) for kind in kinds]
        self.unit = Unit("tested", **({"checked": True} | options))
        translate(self.unit, function, dtypes, "tested", readonly or {})
        self.text = str(self.unit.module)
        module = llvm.parse_assembly(self.text)
        machine = target_machine()
        module.triple, module.data_layout = llvm.get_process_triple(), str(machine.target_data)
        inline_libm(module)
        module.verify()
        passes = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=3))
        passes.getModulePassManager().run(module, passes)
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
        engine.add_object_file(llvm.ObjectFileRef.from_data(machine.emit_object(module)))
        engine.finalize_object()
        _engines.append(engine)
        kind = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * len(dtypes))
        self.code = kind(engine.get_function_address("tested"))

    def __call__(self, *memory: np.ndarray) -> int:
        """Call it; the number that says why it ended early, or 0."""
        return self.code(*(each.ctypes.data for each in memory))

    def place(self, code: int) -> tuple[int, str, int]:
        return place(code, self.unit.files)


def defined(source: str, names: dict[str, Any]) -> types.FunctionType:
    """The last function of a source, with these global names; its file is known by its text alone."""
    file = f"<{hashlib.sha256(source.encode()).hexdigest()[:12]}>"
    linecache.cache[file] = len(source), None, source.splitlines(keepends=True), file
    names = {"__name__": "tested"} | names
    exec(compile(source, file, "exec"), names)
    return [each for each in names.values() if isinstance(each, types.FunctionType)][-1]


def function_of(arguments: str, body: str, names: dict[str, Any]) -> types.FunctionType:
    """A function with this body."""
    return defined(f"def tested({arguments}):\n{textwrap.indent(body, '    ')}\n", names)


def arguments(kinds: Sequence[Any], random: np.random.Generator, scale: float = 1.0) -> list[np.ndarray]:
    """Memory for each argument, with random numbers."""
    found = []
    for kind in map(np.dtype, kinds):
        memory = np.zeros(1, kind) if kind.names else np.zeros(kind.shape, kind.base)
        _randomize(memory, random, scale)
        found.append(memory)
    return found


def _randomize(memory: np.ndarray, random: np.random.Generator, scale: float) -> None:
    if memory.dtype.names:
        for name in memory.dtype.names:
            _randomize(memory[name], random, scale)
    elif memory.dtype == bool:
        memory[...] = random.random(memory.shape) < 0.5
    elif memory.dtype == np.int64:
        memory[...] = random.integers(-5, 6, memory.shape)
    else:
        memory[...] = scale * random.normal(size=memory.shape)


def as_python(memory: np.ndarray) -> Any:
    """An argument as Python has it."""
    return memory.view(np.recarray)[0] if memory.dtype.names else memory


def compare(
    function: Callable,
    kinds: Sequence[Any],
    runs: int = 20,
    exact: bool = True,
    seed: int = 0,
    scale: float = 1.0,
    code: Compiled | None = None,
) -> None:
    """Machine code, ``code`` if it is there, and plain Python must leave equal numbers in all arguments, bit for bit or
    to 1e-12."""
    code = code or Compiled(function, kinds)  # type: ignore[arg-type]
    random = np.random.default_rng(seed)
    for _ in range(runs):
        mine = arguments(kinds, random, scale)
        theirs = [memory.copy() for memory in mine]
        assert code(*mine) == 0
        with np.errstate(all="ignore"):
            function(*(as_python(memory) for memory in theirs))
        for a, b in zip(mine, theirs, strict=True):
            assert_equal(a, b, exact)


def assert_equal(a: np.ndarray, b: np.ndarray, exact: bool, name: str = "") -> None:
    if a.dtype.names:
        for name in a.dtype.names:
            assert_equal(a[name], b[name], exact, name)
    elif exact:
        np.testing.assert_array_equal(a, b, err_msg=name)
        if a.dtype == np.float64:
            assert (np.signbit(a) == np.signbit(b))[~np.isnan(a)].all()
    else:
        largest = np.abs(b[np.isfinite(b)]).max(initial=1.0)
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12 * largest, err_msg=name)


__all__ = ["Compiled", "arguments", "as_python", "compare", "defined", "function_of"]
