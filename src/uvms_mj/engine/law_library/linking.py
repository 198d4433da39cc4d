"""The targets of a law's library, and the tools that make it: LLVM for the stages, ziglang for C, archives and
links."""

import functools
import importlib.metadata
import importlib.util
import os
import platform
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from ...compiler.apart import Apart, Ended, emit
from ...compiler.targets import Target
from ...errors import InputError
from ..native.objects import object_name, recall, remember, uncollected
from ..native.tools import tool
from . import elf_object


@dataclass(frozen=True)
class Machine:
    """A processor that a library is made for.

    Attributes:
        target: as LLVM calls it.
        zig: the options of ziglang's C compiler.
        clang: the options of the clang in it, besides the target's triple.
        shared: whether it has shared libraries.
        rounds: whether it has instructions that round a number to a whole one.
        what: in words.
        emulator: the processor as qemu calls it.
    """

    target: Target
    zig: tuple[str, ...]
    clang: tuple[str, ...]
    shared: bool
    what: str
    emulator: str
    rounds: bool = True

    @property
    def compiler(self) -> str:
        """The command that compiles a program for it on another machine, where there is no Linux a program for qemu's
        ARM."""
        options = self.zig if self.shared else MACHINES["armv7"].zig
        return " ".join(["python -m ziglang cc", *(each for each in options if each != "-fPIC"), "-static"])


def _small(triple: str, processor: str, features: str = "", reloc: str = "pic") -> Target:
    return Target(triple, processor, features, reloc=reloc, codemodel="small", compact=True)


_ARM = ("-target", "arm-linux-musleabihf")
_PIC = "-fPIC"
MACHINES = {
    "x86_64": Machine(
        _small("x86_64-unknown-linux-gnu", "x86-64-v2"),
        ("-target", "x86_64-linux-musl", "-fPIC"),
        (_PIC,),
        True,
        "Linux on x86-64, any processor of the last fifteen years",
        "x86_64",
    ),
    "aarch64": Machine(
        _small("aarch64-unknown-linux-gnu", "cortex-a53"),
        ("-target", "aarch64-linux-musl", "-fPIC"),
        (_PIC,),
        True,
        "Linux on ARM with 64 bits: Raspberry Pi 3 to 5, Jetson",
        "aarch64",
    ),
    "armv7": Machine(
        _small("armv7-unknown-linux-gnueabihf", "cortex-a7", "+vfp4,+neon"),
        (*_ARM, "-mcpu=cortex_a7", "-fPIC"),
        ("-mcpu=cortex-a7", _PIC),
        True,
        "Linux on ARM with 32 bits and hard floats: BlueOS on a Raspberry Pi",
        "arm",
        rounds=False,
    ),
    "thumbv7em": Machine(
        _small("thumbv7em-unknown-none-eabihf", "cortex-m7", "+fp-armv8d16", reloc="static"),
        ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m7+fp_armv8d16"),
        ("-mcpu=cortex-m7",),
        False,
        "Cortex-M7 with a double-precision unit, bare metal: STM32F7 and H7, i.MX RT",
        "arm",
    ),
}
_FREESTANDING = Path(__file__).with_name("freestanding")
_LIBC = _FREESTANDING / "libc.c"
HELPERS = {"memcpy", "memmove", "memset"} | {
    f"__aeabi_{n}" for n in ("d2lz", "d2ulz", "l2d", "ul2d", "ldivmod", "uldivmod")
}
HELPERS |= {f"__aeabi_mem{word}{n}" for word in ("clr", "cpy", "move") for n in ("", 4, 8)} | {"__aeabi_memset"}
"""Functions that move memory, and helpers of ARM's ABI. A program without a C library has these."""
_OF_MATH = (
    "acos asin atan atan2 cos sin tan acosh asinh atanh cosh sinh tanh exp exp2 expm1 frexp ilogb ldexp log log10 "
    "log1p log2 logb modf scalbn scalbln cbrt fabs hypot pow sqrt erf erfc lgamma tgamma ceil floor nearbyint rint "
    "lrint llrint round lround llround trunc fmod remainder remquo copysign nan nextafter nexttoward fdim fmax fmin fma"
)
C_LIBRARY = {f"{each}{kind}" for each in _OF_MATH.split() for kind in ("", "f", "l")} | {"memcmp"}
"""Functions of a C library that keep nothing and have no effect: math.h of C99, and a comparison."""
_BOARD = ("-M", "mps2-an500", "-display", "none", "-monitor", "none", "-serial", "none")
_BOARD += ("-chardev", "file,id=said,path=/dev/stdout", "-semihosting-config", "enable=on,chardev=said", "-kernel")
_C = ("-std=c99", "-Os", "-ffp-contract=off", "-ffreestanding", "-fno-stack-protector")
_C += ("-fno-unwind-tables", "-fno-asynchronous-unwind-tables", "-fomit-frame-pointer", "-w")


def zig() -> list[str]:
    """The command of ziglang. Raises InputError if it is not installed."""
    found = importlib.util.find_spec("ziglang")
    if found is None or found.origin is None:
        raise InputError("no module 'ziglang', which compiles for other processors: pip install 'uvms-mj[c]'")
    return [str(Path(found.origin).with_name("zig"))]  # without a start of Python for each call


@functools.cache
def _version() -> str:
    return importlib.metadata.version("ziglang")


def headers(machine: Machine) -> list[str]:
    """Options that give a file of C the headers of a C library, and of Linux where it is the system."""
    found, name = Path(*zig()).with_name("lib") / "libc" / "include", machine.emulator
    of_linux = (f"{name.removesuffix('_64')}-linux-any", "any-linux-any") if machine.shared else ()
    return [
        word for each in (f"{name}-linux-musl", "generic-musl", *of_linux) for word in ("-isystem", str(found / each))
    ]


def run(command: Sequence[str], folder: Path) -> None:
    """Run a tool in a folder. Raises InputError with its last line."""
    done = tool(command, folder)
    if done.returncode:
        said = (done.stderr.strip().splitlines() or [f"status {done.returncode}"])[:6]
        raise InputError("\n".join([f"{' '.join(command[:4])}:", *said]))


_ROUNDING = """
define internal double @uvms_mj_rint(double %x) {
  %size = call double @llvm.fabs.f64(double %x)
  %small = fcmp olt double %size, 0x4330000000000000
  %sum = fadd double %size, 0x4330000000000000
  %whole = fsub double %sum, 0x4330000000000000
  %signed = call double @llvm.copysign.f64(double %whole, double %x)
  %result = select i1 %small, double %signed, double %x
  ret double %result
}
define internal double @uvms_mj_floor(double %x) {
  %near = call double @uvms_mj_rint(double %x)
  %above = fcmp ogt double %near, %x
  %below = fsub double %near, 1.0
  %result = select i1 %above, double %below, double %near
  ret double %result
}
define internal double @uvms_mj_ceil(double %x) {
  %minus = fneg double %x
  %floor = call double @uvms_mj_floor(double %minus)
  %result = fneg double %floor
  ret double %result
}
define internal double @uvms_mj_trunc(double %x) {
  %size = call double @llvm.fabs.f64(double %x)
  %floor = call double @uvms_mj_floor(double %size)
  %result = call double @llvm.copysign.f64(double %floor, double %x)
  ret double %result
}
"""
"""The whole numbers beside a number, for a processor without an instruction for them: a sum with 2^52 is rounded to a
whole number. Each result is exact."""
_ROUNDED = re.compile(r"@llvm\.(floor|ceil|trunc|rint)\.f64")


def without_rounding(text: str) -> str:
    """LLVM's text with functions in place of the instructions that round to whole numbers."""
    if not _ROUNDED.search(text):
        return text
    lines = [line for line in text.splitlines() if not (line.startswith("declare") and _ROUNDED.search(line))]
    text = _ROUNDED.sub(r"@uvms_mj_\1", "\n".join(lines)) + _ROUNDING
    for name in ("fabs.f64(double)", "copysign.f64(double, double)"):
        if f"declare double @llvm.{name}" not in text:
            text += f"declare double @llvm.{name}\n"
    return text


def emitted(text: str, machines: Sequence[Machine], apart: Apart) -> list[bytes]:
    """The object of LLVM's text for each machine, made in the process ``apart``, which is kept on disk."""
    jobs = {}
    for each in machines:
        own = text if each.rounds else without_rounding(text)
        jobs[object_name([b"emitted", own.encode(), repr(each.target).encode()])] = own, each.target
    objects = {name: found[0] for name in jobs if (found := recall(name)) is not None}
    if missing := [name for name in jobs if name not in objects]:
        for name, code in zip(missing, _emitted([jobs[name] for name in missing], apart), strict=True):
            objects[name] = code
            remember(name, code, {})
    return [objects[name] for name in jobs]


def kept(name: str, make: Callable[[], bytes]) -> bytes:
    """The bytes that are kept on disk by a name, which has all their sources; otherwise they are made, and kept."""
    found = recall(name)
    if found is not None:
        return found[0]
    made = make()
    remember(name, made, {})
    return made


def _emitted(jobs: Sequence[tuple[str, Target]], apart: Apart) -> list[bytes]:
    try:
        codes = apart.call(emit, jobs)
    except Ended as error:
        raise InputError(f"LLVM: {error}") from None
    for (_, target), code in zip(jobs, codes, strict=True):
        if not code:
            raise InputError(f"LLVM emits no code for {target.triple}: {apart.said()}")
    return codes


def linked(machine: Machine, name: str, objects: Sequence[str], folder: Path, out: Path) -> list[Path]:
    """Make the libraries of a target of objects in a folder, in a new folder ``out``."""
    out.mkdir(parents=True, exist_ok=True)
    archive = out / f"lib{name}.a"
    archive.unlink(missing_ok=True)
    run([*zig(), "ar", "rcsD", str(archive.resolve()), *objects], folder)
    made = [archive]
    if machine.shared:
        shared = out / f"lib{name}.so"
        if machine.emulator == "arm":
            objects = [*objects, _arm(machine, folder)]
        links = [*zig(), "ld.lld", "-shared", "-Bsymbolic", "--gc-sections", "--build-id=none", "-soname", shared.name]
        run([*links, "-z", "noexecstack", *objects, "-o", str(shared.resolve())], folder)
        made.append(shared)
    return made


def compiled_c(machine: Machine, source: str, folder: Path, options: Sequence[str] = (), out: str = "") -> str:
    """Compile a file of C in a folder; the name of its object."""
    out = out or f"{Path(source).stem}.o"
    run([*zig(), "cc", *machine.zig, *_C, *options, "-c", source, "-o", out], folder)
    return out


def own_c(machine: Machine, source: Path, folder: Path, options: Sequence[str] = ()) -> str:
    """As :func:`compiled_c`, a source of a library's own, whose object is kept on disk: it includes nothing but headers
    beside it, files of the folder ``freestanding`` and headers of ziglang. A user's file may include any others. The
    clang in it is called alone: ``zig cc`` takes two further processes."""
    read = [source, *sorted(source.parent.glob("*.h")), *sorted(_FREESTANDING.glob("*.[ch]"))]
    chosen = ["-target", machine.target.triple, *machine.clang, *_C, *options]
    made_of = [_version(), *chosen, *(each.name for each in read)]
    out = folder / f"{source.stem}.o"

    def make() -> bytes:
        of_clang = ["-nostdinc", "-isystem", str(Path(*zig()).with_name("lib") / "include")]
        of_system = headers(machine) if machine.shared else ["-isystem", str(_FREESTANDING)]
        run([*zig(), "clang", *chosen, *of_clang, *of_system, "-c", str(source.resolve()), "-o", out.name], folder)
        return out.read_bytes()

    parts = [b"C", *(word.encode() for word in made_of), *(each.read_bytes() for each in read)]
    out.write_bytes(kept(object_name(parts, sources=False), make))
    return out.name


def alien(code: bytes) -> list[str]:
    """The symbols that an object takes and that are neither helpers nor functions of :data:`C_LIBRARY`."""
    known = HELPERS | C_LIBRARY
    return [each for each in elf_object.undefined(code) if each not in known and not each.startswith("__aeabi_")]


def libm_of(name: str) -> str:
    """The prefix of the functions of libm in a library: two libraries of a program have their own ones."""
    return f"{name}_libm_"


def libm_calls(codes: Iterable[bytes], name: str) -> list[str]:
    """The functions of libm that objects of a library call, by their names in C."""
    prefix = libm_of(name)
    return sorted(
        {each.removeprefix(prefix) for code in codes for each in elf_object.undefined(code) if each.startswith(prefix)}
    )


def own_name(library: str, symbol: str) -> str:
    """The name in a library of a symbol of a user's file in C: a program may have two libraries of one file."""
    return f"{library}_own_{symbol}"


def with_own_names(text: str, library: str, symbols: Iterable[str]) -> str:
    """LLVM's text that calls functions by the names that they have in a library."""
    for each in symbols:
        text = re.sub(rf"@{each}(?![\w.$-])", f"@{own_name(library, each)}", text)
    return text


def prepare(machine: Machine, folder: Path, source: Path = _LIBC) -> str:
    """Compile a source of a program, by default what is in the program of each library, so that it is kept when the
    program is linked; the name of its object."""
    alone = replace(machine, clang=(*(each for each in machine.clang if each != _PIC), "-fno-pic"))
    return own_c(alone, source, folder, ("-fno-builtin", "-ffunction-sections"))


def _arm(machine: Machine, folder: Path) -> str:
    """Compile the helpers of ARM's ABI in a shared library; the name of their object."""
    return own_c(machine, _FREESTANDING / "arm.c", folder, ("-fvisibility=hidden",))


def program(machine: Machine, archive: Path, source: Path, folder: Path, data: str = "") -> Path:
    """A static program of a file of C, test.c or loop.c, for an emulator or for this processor, with a C library of
    some functions: one that ziglang builds takes minutes the first time. ``data``: a file of the folder whose bytes are
    in it."""
    objects = [*(prepare(machine, folder, each) for each in (source, _LIBC)), str(archive.resolve())]
    objects += ["-b", "binary", data] if data else []
    places = ("-e", "_start") if machine.shared else ("-T", str(_FREESTANDING / "cortex_m7.ld"))
    run([*zig(), "ld.lld", "--gc-sections", *places, *objects, "-o", source.stem], folder)
    return folder / source.stem


class Work:
    """The tools of the targets' libraries: a folder for each, LLVM in a process of its own, and threads that
    wait for tools. It begins at once with the common code of all tests, while its caller imports and reads:
    ``begun`` ends then."""

    def __init__(self, targets: Sequence[str], test: bool = True) -> None:
        """``test``: whether programs run here, where they can."""
        zig()
        self.test = test
        with ExitStack() as stack:
            self.apart = stack.enter_context(Apart())
            self.folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            self.pool = ThreadPoolExecutor(1 + (os.cpu_count() or 1))  # one waits for LLVM
            stack.callback(self.pool.shutdown, cancel_futures=True)
            stack.enter_context(uncollected())
            stack.callback(sys.setswitchinterval, sys.getswitchinterval())
            sys.setswitchinterval(2e-4)  # the threads read many small files, and ask for Python after each
            self._stack = stack.pop_all()
        for target in targets:
            (self.folder / target).mkdir()
        self.begun = self.pool.submit(self.prepare, targets)

    def prepare(self, targets: Sequence[str], *source: Path) -> None:
        """Compile what is in the program of a test, one after the other: a core is left to the caller."""
        for target in targets:
            machine, folder = MACHINES[target], self.folder / target
            if self.test and emulator(machine) is not None:
                prepare(machine, folder, *source)
            if not source and machine.shared and machine.emulator == "arm":
                _arm(machine, folder)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()


def emulator(machine: Machine) -> list[str] | None:
    """How a program of a target runs here; None if it does not."""
    if not machine.shared:  # a board with a Cortex-M7, and no operating system
        found = shutil.which(f"qemu-system-{machine.emulator}")
        return [found, *_BOARD] if found else None
    if sys.platform != "linux":
        return None  # qemu-user, and the start of the program, are for Linux
    if machine.emulator == platform.machine():
        return []
    found = shutil.which(f"qemu-{machine.emulator}")
    return [found] if found else None
