"""The functions of :mod:`...compiler.libm` for stages in C, which call them by their names in C: so they have the same
bits on every processor, and the bits of the same stage in Python.

A C compiler knows nothing about them. It would put the root in place of a power of a half, and constants of its own.
"""

import functools
import re
from collections.abc import Iterable

import llvmlite.binding as llvm

from ...compiler.targets import LIBM, Target, libm_text
from .compilation import compiling
from .objects import object_name, recall, remember

HEADER = "uvms_math.h"
_PART = """
define hidden double @"{libm}{name}"(double %x) nounwind
{{
  %both = call {{double, double}} @"{libm}sincos"(double %x)
  %part = extractvalue {{double, double}} %both, {k}
  ret double %part
}}
"""
"""The sine and the cosine are parts of one function."""


def header(prefix: str = LIBM) -> str:
    """Declarations of the functions, whose symbols begin with a prefix, and their names in C, behind math.h."""
    return for_this_machine()[0].replace(LIBM, prefix)


def _header() -> str:
    from ...compiler.libm import FUNCTIONS

    lines = ["#include <math.h>"]
    for name, function in FUNCTIONS.items():
        numbers = ", ".join(["double"] * function.__code__.co_argcount)
        lines += [f"double {LIBM}{name}({numbers});", f"#undef {name}", f"#define {name} {LIBM}{name}"]
    return "\n".join([*lines, ""])


def text_of(names: Iterable[str], prefix: str = LIBM) -> str:
    """LLVM's text of functions by their names in C, which a library does not show. Their symbols begin with a
    prefix."""
    parts = {name: k for k, name in enumerate(("sin", "cos"))}
    chosen = sorted(names)
    symbols = dict.fromkeys(LIBM + ("sincos" if name in parts else name) for name in chosen)
    text = re.sub(rf'^define (?=[^@\n]*@"{LIBM}\w+"\()', "define hidden ", libm_text([*symbols]), flags=re.MULTILINE)
    text += "".join(_PART.format(libm=LIBM, name=each, k=parts[each]) for each in chosen if each in parts)
    return str(llvm.parse_assembly(text)).replace(LIBM, prefix)


@functools.cache
def for_this_machine() -> tuple[str, bytes]:
    """The header, and the object of all functions for a shared library of this machine. Both are kept on disk."""
    name = object_name([b"libm in C"])
    if (kept := recall(name)) is not None:
        return kept[1]["header"], kept[0]
    from ...compiler.libm import FUNCTIONS

    with compiling():
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        header, text = _header(), text_of(FUNCTIONS)
        code = Target(llvm.get_process_triple(), reloc="pic", codemodel="small").code(llvm.parse_assembly(text))
    remember(name, code, {"header": header})
    return header, code
