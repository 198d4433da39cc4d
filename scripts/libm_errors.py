"""The errors and the time of the functions of the project's libm, on a processor whose long double has 64 bits.

    python scripts/libm_errors.py --count 10000000 exp sin      two functions; without names all

A row has a function, the largest error [ulp] of so many arguments, the argument that has it, and the time of a call
beside the time of the C library of this machine [ns]. The true values are NumPy's in long double, which are wrong by
some 2^-11 ulp; of erf and erfc, which it lacks, they are tested in tests/compiler/test_libm.py.
"""

import ctypes
import time
from collections.abc import Callable
from typing import Any

import click
import llvmlite.binding as llvm
import numpy as np

from uvms_mj.compiler import libm
from uvms_mj.compiler.targets import LIBM, optimize
from uvms_mj.engine.native.compilation import link, target_machine

TRUE: dict[str, Any] = {
    **{name: getattr(np, name) for name in ("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "cbrt", "hypot")},
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    **{f"a{name}": getattr(np, f"arc{name}") for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    **{"atan2": np.arctan2, "pow": np.power},
}
TWO = ("atan2", "hypot", "pow")
LOOP = """
declare {type} @"{symbol}"({inputs})
define void @"loop"(ptr %x, ptr %y, ptr %out, i64 %n) {{
entry:
  br label %turn
turn:
  %i = phi i64 [0, %entry], [%next, %turn]
  %px = getelementptr double, ptr %x, i64 %i
  %py = getelementptr double, ptr %y, i64 %i
  %po = getelementptr double, ptr %out, i64 %i
  %a = load double, ptr %px
  %b = load double, ptr %py
  %r = call {type} @"{symbol}"({given})
  {result}
  store double %s, ptr %po
  %next = add i64 %i, 1
  %more = icmp slt i64 %next, %n
  br i1 %more, label %turn, label %end
end:
  ret void
}}
"""


def loop_of(name: str, own: bool) -> Callable[..., None]:
    """Machine code of a loop over arguments."""
    pair = own and name in ("sin", "cos")
    symbol = (LIBM + ("sincos" if pair else name)) if own else name
    result = f"%s = extractvalue {{double, double}} %r, {int(name == 'cos')}" if pair else "%s = fadd double %r, -0.0"
    text = LOOP.format(
        type="{double, double}" if pair else "double",
        symbol=symbol,
        inputs="double, double" if name in TWO else "double",
        given="double %a, double %b" if name in TWO else "double %a",
        result=result,
    )
    module, machine = llvm.parse_assembly(text), target_machine()
    optimize(module, machine, llvm.get_process_triple())
    addresses = link(machine.emit_object(module), ["loop"], [] if own else [name])
    assert addresses is not None
    code = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 4)(addresses[0])
    return lambda x, y, out: code(x.ctypes.data, y.ctypes.data, out.ctypes.data, len(x))


def arguments(name: str, random: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Of all sizes that matter, half of them as large as the numbers of a run."""
    sizes = {
        **dict.fromkeys(("exp", "sinh", "cosh", "expm1"), (-20, 6.5)),
        **dict.fromkeys(("log", "log2", "log10", "cbrt"), (-700.0, 700.0)),
        **dict.fromkeys(("sin", "cos", "tan"), (-20.0, 600.0)),
        **dict.fromkeys(("asin", "acos", "atanh"), (-20.0, 0.0)),
        **{"exp2": (-20.0, 6.9), "tanh": (-20.0, 3.0), "acosh": (0.0, 100.0), "pow": (-20.0, 20.0)},
    }
    low, high = sizes.get(name, (-30.0, 30.0))
    x = np.exp(random.uniform(low, high, n))
    near = random.random(n) < 0.5
    x[near] = (
        random.uniform(1.0, 8.0, near.sum())
        if name == "acosh"
        else random.uniform(0.0, min(np.exp(high), 8.0), near.sum())
    )
    y = np.exp(random.uniform(-20.0, 3.0 if name == "pow" else 20.0, n))
    positive = name in ("log", "log2", "log10", "acosh", "pow")
    sign = 1.0 if positive else random.choice([-1.0, 1.0], n)
    x *= sign
    y *= random.choice([-1.0, 1.0], n)
    return (np.abs(x) if name == "log1p" else x), y


def errors(name: str, count: int) -> tuple[float, float, float, float]:
    """The largest error [ulp], its argument, and the time of a call of ours and of C's [ns]."""
    random, ours, theirs = np.random.default_rng(5), loop_of(name, True), loop_of(name, False)
    worst, at, took = 0.0, 0.0, [np.inf, np.inf]
    for _ in range(max(1, count // 100_000)):
        x, y = arguments(name, random, 100_000)
        out, other = np.empty_like(x), np.empty_like(x)
        for k, (code, into) in enumerate(((ours, out), (theirs, other))):
            begun = time.perf_counter()
            code(x, y, into)
            took[k] = min(took[k], (time.perf_counter() - begun) / len(x) * 1e9)
        wide = [each.astype(np.longdouble) for each in ((x, y) if name in TWO else (x,))]
        with np.errstate(all="ignore"):
            true = TRUE[name](*wide)
            unit = np.spacing(np.abs(true).astype(float)).astype(np.longdouble)
            apart = np.abs(out - true) / unit
        apart[~np.isfinite(apart)] = 0.0
        k = int(apart.argmax())
        if apart[k] > worst:
            worst, at = float(apart[k]), float(x[k])
    return worst, at, took[0], took[1]


@click.command(help=__doc__)
@click.option("--count", default=1_000_000, show_default=True, help="Arguments of each function.")
@click.argument("names", nargs=-1)
def main(count: int, names: tuple[str, ...]) -> None:
    for name in names or sorted(TRUE.keys() & libm.FUNCTIONS.keys()):
        worst, at, ours, theirs = errors(name, count)
        click.echo(f"{name:6} {worst:.3f} ulp at {at!r:24} {ours:6.1f} ns, C {theirs:6.1f} ns")


if __name__ == "__main__":
    main()
