"""Machine code of pure Python functions: compiled before the run, and kept on disk.

A function marked as a kernel (:mod:`uvms_mj.physics.kernels`) stays a plain Python function. The package's own
functions and users' stages are translated by :mod:`uvms_mj.compiler`. Their machine code is kept as object files, so
that a warm start loads it in milliseconds: of a function of the package by a fingerprint of all sources that affect it,
so that a warm start translates nothing; of a user's stage by its translation.
"""

import contextlib
import ctypes
import functools
import os
import pickle
import sys
import threading
import types
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import llvmlite.binding as llvm
import numpy as np

from ...compiler.apart import forked
from ...compiler.refusals import Untranslatable
from ...compiler.targets import LIBM, optimize
from ...physics.kernels import compilers
from .memory import at_address
from .objects import keep, object_name, read, recall, remember, uncollected

_PACKAGE = Path(__file__).parents[2]

_MOST_GAPS = 8
"""So many reasons why a function is not compiled are said."""
_engines: list[llvm.ExecutionEngine] = []  # machine code lives as long as its engine


@functools.cache
def target_machine(level: int = 3) -> llvm.TargetMachine:
    """This processor, for code on which LLVM spends its level of work, at most 3."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple()
    reloc = "static" if target.name.startswith("x86") else "default"
    features = llvm.get_host_cpu_features().flatten()
    return target.create_target_machine(
        llvm.get_host_cpu_name(), features, level, reloc, codemodel="jitdefault", jit=True
    )


def load(name: str) -> tuple[int, ...] | None:
    """The addresses of the functions of an object on disk; None if it is missing, damaged or can't be linked."""
    found = read(name)
    return None if found is None else link(found[0], found[1]["symbols"], found[1]["externals"])


def link(code: bytes, symbols: Iterable[str], externals: Iterable[str]) -> tuple[int, ...] | None:
    """The addresses of functions of an object file; None if a symbol that it uses is unknown in this process."""
    machine = target_machine()
    process = ctypes.CDLL(None)
    for external in externals:  # LLVM silently links a call of an unknown symbol to address 0
        if llvm.address_of_symbol(external) is None and not hasattr(process, external):
            return None
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    return tuple(engine.get_function_address(symbol) for symbol in symbols)


PLAIN = "UVMS_MJ_PLAIN"
"""Environment variable for debugging: if it is set, every stage and kernel runs as plain Python."""
_STAGE = "uvms_mj_stage"
_lock = threading.RLock()
short_run: ContextVar[bool] = ContextVar("short_run", default=False)
"""Whether machine code is for one short run: code that is not kept is made when the run needs
it, and optimized less. It has the same numbers, since neither an optimization nor LLVM's choice of instructions changes
a rounding. Fused code is always optimized: it decides which sums are rounded once."""


@dataclass(frozen=True)
class NativeFunction:
    """Machine code of a function with so many ``arguments``. ``code`` gives its address, and waits if LLVM still makes
    it. ``files`` are the sources that the number which it returns may refer to
    (:func:`uvms_mj.compiler.refusals.place`). Equal machine code of users' stages has one ``name``."""

    arguments: int
    code: Callable[[], int]
    files: tuple[str, ...] = ()
    name: str = ""

    @functools.cached_property
    def address(self) -> int:
        return self.code()

    def wait(self) -> None:
        """Wait until LLVM has made it."""
        self.code()

    @functools.cached_property
    def ctypes(self) -> Any:
        """A ctypes function to call it from Python."""
        return ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * self.arguments)(self.address)


class NotCompiled(Exception):
    """A function runs as plain Python; the message is the reason."""


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Compile alone, and without garbage collection: it would look at every instruction of a module in vain."""
    with _lock, uncollected():
        yield


def plain_python() -> bool:
    """Whether everything runs as plain Python."""
    return os.environ.get(PLAIN, "0") not in ("", "0")


def made_once(make: Callable[..., Any]) -> Any:
    """As :func:`functools.cache`, of machine code, and beside it of what stands for it where all is plain Python."""
    cached = functools.cache(lambda plain, *arguments: make(*arguments))
    found: Any = functools.wraps(make)(lambda *arguments: cached(plain_python(), *arguments))
    found.cache_clear = cached.cache_clear
    return found


def native_function(function: Any, parameters: Sequence[np.dtype | str], fused: bool = False) -> NativeFunction:
    """A C function of 64-bit integers from one of the package's functions, loaded from disk or compiled. It returns the
    number that the function returns, or 0.

    ``parameters`` are int64 or dtypes: a record or an array is passed by its address. ``fused`` is whether functions
    marked so are rounded once (:func:`uvms_mj.physics.kernels.fused`).
    """
    (native,) = native_functions({function: parameters}, fused)
    return native


def native_functions(
    parameters: Mapping[Any, Sequence[np.dtype | str]], fused: bool = False
) -> tuple[NativeFunction, ...]:
    """As :func:`native_function`, several functions, which share what they call, from one module."""
    dtypes = [tuple(np.dtype(each) for each in kinds) for kinds in parameters.values()]
    with compiling():
        if plain_python():
            return tuple(map(_plain_function, parameters, dtypes))
        return _native_functions(tuple(zip(parameters, dtypes, strict=True)), fused, short_run.get() and not fused)


def native_stage(function: Any, records: Mapping[Any, tuple[np.dtype, str]]) -> NativeFunction:
    """A C function of five 64-bit integers from a user's stage (:mod:`.user_stage`). ``records`` are the functions that
    stand for the record at an address, each with its dtype and why it can't be changed. Raises Mistake or NotCompiled.
    """
    if plain_python():
        raise NotCompiled(f"{PLAIN} is set")
    from .translation import parts_of

    with compiling():
        parts = parts_of(function, records)
        known = object_name([b"translation", *parts]) if parts is not None else ""
        kept = recall(known) if known else None
        if kept is not None and (found := _stage(kept[1]["object"], kept[1]["files"])) is not None:
            return found
        module, files = _translated(function, records)
        # its text has all of its code, but for the functions of libm, which are added behind it
        name = object_name([b"stage", module.encode()], sources=LIBM in module)
        found = _stage(name, files)
        if found is None:
            make = functools.partial(_object, module, 1)
            found = _begun_stage(name, _made_in_a_copy(make) if short_run.get() else make, files)
            if not short_run.get():
                found.wait()
        if known:
            remember(known, b"", {"object": name, "files": files})
        return found


_stages: dict[str, Callable[[], int]] = {}
"""The addresses of users' stages by the names of their objects. Each is loaded once: it takes two mappings of memory,
of which a process has 65530."""


def _stage(name: str, files: Sequence[str]) -> NativeFunction | None:
    """The machine code of a user's stage, loaded or from disk; None if it is not kept."""
    if name not in _stages and (addresses := load(name)) is not None:
        _stages[name] = lambda: addresses[0]
    return NativeFunction(5, _stages[name], tuple(files), name) if name in _stages else None


def _begun_stage(name: str, make: Callable[[], tuple[bytes, list[str]]], files: Sequence[str]) -> NativeFunction:
    """The machine code of a user's stage, which is linked when it is asked for."""

    @functools.cache
    def address() -> int:
        try:
            (found,) = _taken(name, [_STAGE], *make())
        except Exception as error:
            raise NotCompiled(f"the compiler failed: {type(error).__name__}: {str(error)[:200]}") from error
        _stages[name] = lambda: found
        return found

    return NativeFunction(5, address, tuple(files), name)


def _translated(function: Any, records: Mapping[Any, tuple[np.dtype, str]]) -> tuple[str, list[str]]:
    """The module of a user's stage, and its source files. What the translator can't do is a lack of the language, also
    if it fails."""
    from ...compiler.refusals import Lacking, Mistake
    from .intrinsics import stage_module

    try:
        return stage_module(function, records, _STAGE)
    except Lacking as lacking:
        found = _gaps(functools.partial(stage_module, function, records, _STAGE), lacking)
        raise NotCompiled("; ".join(found)) from lacking
    except Mistake:
        raise
    except Exception as error:
        raise NotCompiled(f"the compiler failed: {type(error).__name__}: {str(error)[:200]}") from error


def _gaps(translate: Callable[..., Any], lacking: Untranslatable) -> list[str]:
    """All that a function has and the language lacks, each with its line: the statement that met it is left out, with
    what depends on it, and the function is translated again."""
    from ...compiler.refusals import Lacking

    found, left_out, error = list[str](), set[tuple[str, int]](), lacking
    while len(found) <= _MOST_GAPS:
        where = f" ({Path(error.file).name}, line {error.line}: {error.words})" if error.words else ""
        if isinstance(error, Lacking) and (said := f"{error.reason}{where}") not in found:
            found.append(said)
        place = error.file, error.line
        if place in left_out or not isinstance(error, Lacking) or error.file.startswith(str(_PACKAGE)):
            place = error.outermost  # what follows from it
        if place in left_out:
            break
        left_out.add(place)
        try:
            translate(left_out=left_out)
            break
        except Untranslatable as further:
            error = further
        except Exception:  # a function without some of its statements may be none
            break
    return found if len(found) <= _MOST_GAPS else [*found[:_MOST_GAPS], "and more"]


@functools.cache
def _native_functions(
    parts: tuple[tuple[Any, tuple[np.dtype, ...]], ...], fused: bool, short: bool
) -> tuple[NativeFunction, ...]:
    made_of = [b"fused" if fused else b""]
    for function, dtypes in parts:
        layout = [repr(each) for each in dtypes]
        source = Path(function.__code__.co_filename).read_bytes()
        made_of += [source, function.__qualname__.encode(), *(each.encode() for each in layout)]
    name = object_name(made_of)
    addresses = load(name)
    if addresses is not None:
        return tuple(NativeFunction(len(of[1]), lambda at=at: at) for at, of in zip(addresses, parts, strict=True))
    symbols = {f"uvms_mj_{name}_{k}": part for k, part in enumerate(parts)}
    if short:
        module = _next_module[0]
        module.names.append(name)
        module.parts |= symbols
        return tuple(NativeFunction(len(part[1]), functools.partial(module.at, each)) for each, part in symbols.items())
    from .intrinsics import kernel_module

    made = _begun(_compiled, str(kernel_module(symbols, fused)), name, list(symbols), 1)
    return tuple(NativeFunction(len(dtypes), lambda k=k: made()[k]) for k, (_, dtypes) in enumerate(parts))


_MOST_S = 60.0
"""A copy of this process that has made no module by then waits in vain [s]."""


def _made_in_a_copy(make: Callable[[], tuple[bytes, list[str]]]) -> Callable[[], tuple[bytes, list[str]]]:
    """Begin to make an object in a copy of this process, and return a function that waits for it once. This process
    makes it where the copy has ended early, or is not sure to work: elsewhere than on Linux, or while LLVM, which lets
    in one thread, works in another one."""
    busy = any(each.name == _OF_LLVM for each in threading.enumerate())
    begun = forked(lambda: pickle.dumps(make()), _MOST_S) if sys.platform == "linux" and not busy else bytes

    def made() -> tuple[bytes, list[str]]:
        found = begun()
        return pickle.loads(found) if found else make()

    return made


_OF_LLVM = "uvms-mj LLVM"
"""Name of the threads in which LLVM works."""


class _Module:
    """Functions for a short run: all that wait when the first of them is needed, or at :func:`begin_module`, are one
    module, which has once what they share. ``names`` are the names of their objects."""

    def __init__(self) -> None:
        self.names, self.parts, self._addresses = list[str](), dict[str, Any](), dict[str, int]()
        self._object: Callable[[], tuple[bytes, list[str]]] = self._made

    def begin(self) -> None:
        """Begin to make the object."""
        if _next_module[0] is self:
            _next_module[0] = _Module()
        if self.parts and read(self._name) is None:
            self._object = _made_in_a_copy(self._made)

    @property
    def _name(self) -> str:
        return object_name([b"short", *(each.encode() for each in self.names)], sources=False)

    def _made(self) -> tuple[bytes, list[str]]:
        from .intrinsics import kernel_module

        return _object(str(kernel_module(self.parts)), 0)

    def at(self, symbol: str) -> int:
        """The address of a function."""
        with compiling():
            if not self._addresses:
                if _next_module[0] is self:
                    _next_module[0] = _Module()
                name, symbols = self._name, list(self.parts)
                addresses = load(name)
                if addresses is None:
                    made, self._object = self._object, self._made
                    addresses = _taken(name, symbols, *made())
                self._addresses = dict(zip(symbols, addresses, strict=True))
            return self._addresses[symbol]


def begin_module() -> None:
    """Begin to make those functions for a short run that have been asked for."""
    with compiling():
        _next_module[0].begin()


_next_module = [_Module()]
"""The module that takes functions for short runs."""


def _begun(function: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
    """Begin a call in a thread of its own, and return a function that waits for its result: while LLVM compiles one
    module, Python translates the next one."""
    made = Future[Any]()

    def call() -> None:
        try:
            made.set_result(function(*arguments))
        except BaseException as error:
            made.set_exception(error)

    threading.Thread(target=call, name=_OF_LLVM).start()
    return made.result


def _on_arrays(function: Callable, arrays: Sequence[np.ndarray]) -> Callable[..., Any] | None:
    """A kernel that Python calls with integers, on arrays that lie densely in memory; None if all is plain Python."""
    if plain_python():
        return None
    integers = function.__code__.co_argcount - len(arrays)
    kinds = [each.dtype if each.shape == (1,) else np.dtype((each.dtype, each.shape)) for each in arrays]
    code = native_function(function, [*kinds, *["i8"] * integers]).ctypes
    call = functools.partial(code, *(each.ctypes.data for each in arrays))
    call.arrays = arrays  # type: ignore[attr-defined]  # they live as long as it
    return call


compilers.append(_on_arrays)


@functools.cache
def _plain_function(function: Callable, dtypes: tuple[np.dtype, ...]) -> NativeFunction:
    """The function itself, to be called like machine code, with its arithmetic: products are summed in its order."""
    from .twin import twin

    plain = twin(cast(types.FunctionType, function))

    def call(*words: int) -> int:
        result = plain(*(at_address(word, dtype) for word, dtype in zip(words, dtypes, strict=True)))
        return 0 if result is None else int(result)

    code = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * len(dtypes))(call)
    return NativeFunction(len(dtypes), lambda: ctypes.cast(code, ctypes.c_void_p).value or 0)


def _compiled(text: str, name: str, entries: list[str], level: int = 1) -> tuple[int, ...]:
    """Compile a module, keep its object on disk and return the addresses of its functions."""
    return _taken(name, entries, *_object(text, level))


def _object(text: str, level: int) -> tuple[bytes, list[str]]:
    """The object of a module, and the symbols that it takes from others."""
    machine = target_machine(3 if level else 0)
    module = llvm.parse_assembly(text)
    optimize(module, machine, llvm.get_process_triple(), level)
    code = machine.emit_object(module)
    symbols = (*module.functions, *module.global_variables)
    return code, [each.name for each in symbols if each.is_declaration and not each.name.startswith("llvm.")]


def _taken(name: str, entries: list[str], code: bytes, externals: list[str]) -> tuple[int, ...]:
    """Keep an object on disk, and return the addresses of its functions."""
    keep(name, code, entries, externals)
    addresses = link(code, entries, externals)
    assert addresses is not None, f"{entries} use an unknown symbol among {externals}"
    return addresses
