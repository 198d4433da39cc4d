"""Laws that misbehave: for each, the text of a file with a class Law, and the required end of a run with it.

:mod:`misbehaving_stages` adds other stages.
"""

import textwrap
from dataclasses import dataclass

HEADER = """
from dataclasses import dataclass, field
import functools, math, os, sys
import numpy as np
from uvms_mj import Controller, Gsta, gain

as_strided = np.lib.stride_tricks.as_strided

class njit:  # marks a function as that of numba does
    def __init__(self, function):
        self.py_func = function

    def __call__(self, *arguments):
        return self.py_func(*arguments)

@njit
def put(x, i):
    x[i] = 1.0

@njit
def put_into_new(n, i):
    x = np.zeros(n)
    x[i] = 1.0
    return x.sum()

@njit
def forever(x):
    while x >= 0.0:
        x += 1.0
    return x

@njit
def deeper(n):
    return deeper(n + 1) + 1.0 if n >= 0 else 0.0

def deeper_still(n):
    return deeper_still(n + 1) + 1.0

class Odd(Exception):
    def __str__(self):
        raise ValueError

class Base(BaseException):
    pass
"""
GAINS = """    k: float = gain(5.0, "1", "gain")
    flag: bool = gain(True, "1", "flag")
    three: tuple[float, float, float] = gain((1.0, 2.0, 3.0), "1", "gains")
    states = {"xi": 6, "eta": 3}
"""
SIGNATURE = "    def law(gains, state, signals, state_dot, tau_cmd):\n"


@dataclass(frozen=True)
class Case:
    """A file's text, the exit status of a run with its law, a pattern of the message on standard error, whether only
    Ctrl-C ends it, and the scenario's table that takes the law or stage."""

    text: str
    status: int = 2
    said: str = ""
    endless: bool = False
    table: str = "controller"


def law(body: str) -> str:
    """The text of a file whose law has this body."""
    lines = textwrap.indent(body, "        ")
    return f"{HEADER}\n@dataclass(frozen=True)\nclass Law(Controller):\n{GAINS}    @staticmethod\n{SIGNATURE}{lines}\n"


def declared(body: str, law: bool = True) -> str:
    """The text of a file whose class Law has this body."""
    function = f"    @staticmethod\n{SIGNATURE}        tau_cmd[:] = signals.tau_nom\n" if law else ""
    return f"{HEADER}\n@dataclass(frozen=True)\nclass Law(Controller):\n{textwrap.indent(body, '    ')}\n{function}"


def cases() -> dict[str, Case]:
    """All cases by name."""
    found: dict[str, Case] = {}
    for family in (overruns, helpers, shapes, flats, numbers, exceptions, memory, declarations, files, endless):
        for name, case in family().items():
            found[f"{family.__name__}: {name}"] = case
    return found


SET = "tau_cmd[:] = signals.tau_nom\n"
OUT_OF_BOUNDS = "(is out of bounds|IndexError)"
LATE = f"{SET}if signals.t > 0.01:\n    "


def overruns() -> dict[str, Case]:
    """Writes through a view beyond either end of an array, by one number up to a megabyte."""
    places = [
        ("tau_cmd", (6, 7, 45, 5000, 131_071)),
        ("state.eta", (3, 4, 2000, 130_000)),
        ("state_dot.eta", (3, 12, 600, 131_000)),
        ("signals.zeta", (400, 10_000, 131_000)),
        ("gains.three", (7, 50, 131_000)),
        ("tau_cmd", (-1, -8, -300, -131_071)),
        ("state.xi", (-1, -9, -4000, -131_000)),
        ("state_dot.xi", (-1, -70, -131_000)),
        ("signals.p_WB", (-3, -90, -131_000)),
        ("gains.three", (-1, -2, -500, -131_000)),
    ]
    found = {}
    for array, reaches in places:
        for reach in reaches:
            sign = 1 if reach > 0 else -1
            write = f"as_strided({array}, ({abs(reach) + 1},), ({8 * sign},))[{abs(reach)}] = 0.0"
            found[f"{array}[{reach}]"] = Case(
                law(LATE + write), said="your law Law .*: as_strided reaches numbers beyond"
            )
    return found


def helpers() -> dict[str, Case]:
    """A user's functions, marked as numba's, with an index out of bounds."""
    found = {}
    for index in ("6", "7", "100", "10**6", "2**40", "-7", "-100"):
        for array in ("tau_cmd", "state.xi", "np.zeros(6)"):
            said = f"line \\d+: .*{OUT_OF_BOUNDS}"
            found[f"put({array}, {index})"] = Case(law(f"{LATE}put({array}, {index})"), said=said)
        found[f"put_into_new({index})"] = Case(law(f"{SET}put_into_new(3, {index})"), said=OUT_OF_BOUNDS)
    for index in ("int(signals.t) + 6", "int(-7 - signals.t)", "int(signals.t * 1e15) + 6"):
        found[f"put(tau_cmd, {index})"] = Case(law(f"{LATE}put(tau_cmd, {index})"), said="IndexError.*line")
    return found


def shapes() -> dict[str, Case]:
    """Operands of the wrong shape."""
    statements = [
        *(f"tau_cmd {op}= np.ones(7)" for op in ("+", "-", "*", "/", "**", "//")),
        *(f"tau_cmd += np.ones({n})" for n in ("(2, 6)", "5", "(1, 6)", "0")),
        "tau_cmd[:] = np.ones(7)",
        "tau_cmd[:] = signals.M_hat",
        "tau_cmd[:] = signals.M_hat @ np.ones(7)",
        "tau_cmd[:3] = signals.s",
        "tau_cmd += signals.M_hat",
        "state_dot.eta[:] = signals.s",
        "state_dot.eta += signals.s",
        "np.add(signals.s, np.ones(7), tau_cmd)",
        "np.sqrt(np.ones(7), tau_cmd)",
        "np.multiply(signals.M_hat, signals.M_hat, tau_cmd)",
        "np.clip(np.ones(7), 0.0, 1.0, tau_cmd)",
        "np.dot(signals.M_hat, np.ones(7), tau_cmd)",
        "np.dot(signals.M_hat, signals.s, state_dot.eta)",
        "signals.M_hat[0] = np.ones(7)",
        "signals.M_hat += np.ones(5)",
        "tau_cmd[np.array([1, 2])] = np.ones(3)",
        "tau_cmd[np.ones(6) > 0.0] = np.ones(5)",
    ]
    return {each: Case(law(SET + each), said="your law Law .*(raised|is wrong in .*line)") for each in statements}


def flats() -> dict[str, Case]:
    """Indices out of bounds: of ``flat``, of slices and in arrays of indices."""
    statements = [
        *(f"tau_cmd.flat[{i}] = 0.0" for i in (6, 45, 3000, -7)),
        *(f"state.xi.flat[{i}] = 0.0" for i in (6, 8, 3000)),
        "signals.M_hat.flat[36] = 0.0",
        "signals.M_hat.T.flat[36] = 0.0",
        "tau_cmd[6] = 1.0",
        "tau_cmd[0] = signals.M_hat[5, 6]",
        "tau_cmd[np.array([1, 6])] = 1.0",
        "tau_cmd[int(signals.t * 1e6) + 100] = 1.0",
        "tau_cmd[1:3][2] = 0.0",
    ]
    return {each: Case(law(LATE + each), said=f"your law Law .*({OUT_OF_BOUNDS}|read-only)") for each in statements}


def numbers() -> dict[str, Case]:
    """Numbers that are not finite or were never set, and changed gains."""
    bodies = {
        "tau_cmd nan": (f"{LATE}tau_cmd[4] = np.nan", r"set tau_cmd\[4\] to nan"),
        "tau_cmd inf": (f"{LATE}tau_cmd[2] = np.inf", r"set tau_cmd\[2\] to inf"),
        "tau_cmd -inf": (f"{LATE}tau_cmd[5] = -np.inf", r"set tau_cmd\[5\] to -inf"),
        "unused state": (f"{LATE}state_dot.eta[1] = np.nan", r"set state_dot.eta\[1\] to nan"),
        "unused state inf": (f"{LATE}state_dot.xi[5] = np.inf", r"set state_dot.xi\[5\] to inf"),
        "state itself": (f"{LATE}state.eta[2] = np.nan", r"state.eta\[2\]"),
        "state overflows": (f"{SET}state_dot.eta[0] = 1e308 * (1.0 + state.eta[0])", r"state"),
        "root": (f"{LATE}x = math.sqrt(1.0 - 1e9 * signals.t)\n    tau_cmd[0] = x", "line"),
        "numpy root": (f"{LATE}x = np.sqrt(-signals.t)\n    tau_cmd[0] = x", "line .*np.sqrt"),
        "logarithm": (f"{SET}tau_cmd[:] = np.log(signals.t - 0.01)", "line"),
        "zero by zero": (f"{SET}tau_cmd[0] = signals.t / (signals.t * 0.0)", "line"),
        "zero by zero in arrays": (f"{SET}tau_cmd[:] = 0.0 * signals.s / (0.0 * signals.s)", "line"),
        "solve": (f"{LATE}tau_cmd[:] = np.linalg.solve(signals.M_hat * np.nan, signals.s)", "nan.*line"),
        "singular": (f"{LATE}tau_cmd[:] = np.linalg.solve(signals.M_hat * 0.0, signals.s)", "LinAlgError.*line"),
        "inv": (
            f"{LATE}tau_cmd[:] = np.linalg.inv(signals.M_hat * np.inf) @ signals.s",
            "LinAlgError|nan|invalid",
        ),
        "not set": ("x = signals.tau_nom", "must fill all six entries"),
        "returned": ("return signals.tau_nom", "must fill all six entries"),
        "half set": ("tau_cmd[:3] = 0.0", r"left tau_cmd\[3\] unset"),
        "rebound": ("tau_cmd = signals.tau_nom", "must fill all six entries"),
        "empty array read": (f"{SET}tau_cmd[0] = np.max(np.zeros(0))", "your law Law .*is wrong in"),
        "gain": (f"{LATE}gains.k = 3.0", "a gain is constant during a run"),
        "number of a gain": (f"{LATE}gains.three[2] = 0.0", "a gain is constant during a run"),
        "gains of an array": (f"{LATE}gains.three[:] = 0.0", "a gain is constant during a run"),
        "flag": (f"{LATE}gains.flag = False", "a gain is constant during a run"),
        "gain to nan": (f"{LATE}gains.k = np.nan", "a gain is constant during a run"),
    }
    found = {name: Case(law(body), said=said) for name, (body, said) in bodies.items()}
    found["too large"] = Case(law(f"{LATE}tau_cmd[0] = 1e300"), 3, "tau_cmd")
    return found


def exceptions() -> dict[str, Case]:
    """Exceptions of many types, raised by the law or by an operation in it."""
    raised = [
        "ValueError('no')",
        "KeyError(1)",
        "StopIteration",
        "GeneratorExit",
        "MemoryError",
        "RecursionError('x')",
        "SystemExit(0)",
        "SystemExit(3)",
        "Odd",
        "Base('x')",
        "BaseException('x')",
        "Exception('x' * 10**6)",
        "ValueError('two\\nlines')",
        "ValueError('größer als möglich')",
        "ValueError('\\x1b[31m')",
        "UnicodeEncodeError('utf-8', 'x', 0, 1, 'y')",
        "InterruptedError('x')",
        "BrokenPipeError(32, 'x')",
        "OSError(28, 'x')",
        "Warning('x')",
    ]
    found = {f"raise {each}": Case(law(f"{LATE}raise {each}"), said="your law Law ") for each in raised}
    more = {
        "assert": "assert signals.t < 0",
        "exit": "sys.exit(0)",
        "raise a number": "raise 3",
        "names in other letters": "größe = tau_cmd[6]",
        "unknown name": "tau_cmd[0] = nowhere",
        "unknown attribute": "tau_cmd[0] = np.nowhere",
        "text": "tau_cmd[0] = 'text'",
        "list": "tau_cmd[:] = [1.0, 'text', None, 1.0, 2.0, 3.0]",
        "complex": "tau_cmd[0] = 1j",
        "none": "tau_cmd[0] = None",
        "not callable": "tau_cmd(3)",
        "wrong arguments": "put(tau_cmd)",
        "wrong type to a helper": "put('text', None)",
        "dictionary": "tau_cmd[0] = {1: 2.0}[3]",
        "list index": "tau_cmd[0] = [1.0, 2.0][5]",
        "pop": "[1.0].pop(3)",
        "divide": "tau_cmd[0] = 1 / (signals.t * 0.0)",
        "modulo": "tau_cmd[0] = 5 % int(signals.t * 0.0)",
        "eval": "eval('1 / 0')",
        "open": "open('/nowhere/at/all')",
        "import": "import nowhere",
        "recursion": "deeper_still(0)",
        "compiled recursion": "deeper(0)",
        "reshape": "tau_cmd[0] = signals.s.reshape(7)[0]",
        "unpack": "a, b = signals.s",
        "keyword": "np.sum(signals.s, nowhere=3)",
    }
    found |= {name: Case(law(SET + body), said="your law Law ") for name, body in more.items()}
    found["interrupts itself"] = Case(law(f"{SET}raise KeyboardInterrupt"), 130, "stopped from outside")
    return found


def memory() -> dict[str, Case]:
    """Requests for more memory than the machine or the limits allow."""
    sizes = ("1 << 45", "1 << 60", "(1 << 31, 1 << 31)", "-1")
    found = {f"np.zeros({n})": Case(law(f"{SET}x = np.zeros({n})"), said="your law Law ") for n in sizes}
    found["eye"] = Case(law(f"{SET}x = np.eye(1 << 24)\ntau_cmd[0] = x[0, 0]"), said="your law Law ")
    found["text"] = Case(law(f"{SET}x = 'a' * (1 << 60)"), said="your law Law ")
    found["states"] = Case(declared("states = {'a': 10_000, 'b': 1}"), said="at most 10000")
    return found


def declarations() -> dict[str, Case]:
    """Classes that violate the contract."""
    bodies = {
        "states: a number": ("states = 6", "states: 6 is not a table"),
        "states: a size of 0": ("states = {'x': 0}", "states.x: 0 must be a whole number"),
        "states: a text": ("states = {'x': '6'}", "states.x: '6' must be a whole number"),
        "states: true": ("states = {'x': True}", "states.x: True must be a whole number"),
        "states: no name": ("states = {'a b': 6}", "'a b' is not a name"),
        "states: a number's name": ("states = {5: 6}", "5 is not a string"),
        "states: of a signal": ("states = {'p_WB': 6}", "is the name of a signal"),
        "states: a property": ("states = property(lambda self: {'x': 6})", "states: .* is not a table"),
        "units: a number": ("states = {'xi': 6}\nunits = {'xi': 5}", "units.xi: 5 is not a string"),
        "units: a text": ("units = 'm'", "units: 'm' is not a table"),
        "units: of no state": ("states = {'xi': 6}\nunits = {'xii': 'm'}", "did you mean 'xi'"),
        "name: a number": ("name = 5", "name: 5 is not a string"),
        "name: lines": ("name = 'a\\nb'", "name: .* must be printable"),
        "name: long": ("name = 'a' * 1000", "name: .* at most 100"),
        "uses_truth: a text": ("uses_truth = 'yes'", "uses_truth"),
        "uses_truth: true": ("uses_truth = True", "yardstick"),
        "__post_init__: exits": ("def __post_init__(self):\n    sys.exit(3)", "SystemExit: 3"),
        "__post_init__: raises": ("def __post_init__(self):\n    raise Base('x')", "Base: x"),
        "__post_init__: raises what has no text": ("def __post_init__(self):\n    raise Odd", "Law: Odd"),
        "__init__: raises": ("def __init__(self):\n    1 / 0", "ZeroDivisionError"),
        "label: a number": ("label = 3", "'label' is a method of every law"),
        "record: another": ("def record(self):\n    return 3", "'record' is a method of every law"),
        "gain named as a method": ("label: float = 3.0", "'label' is an attribute of every law"),
        "gain of no type": ("k: nowhere = 3.0", "nowhere"),
        "gain of an odd type": ("k: 3 = 3.0", "not a valid type of a gain"),
        "gain of broken text": ("k: '1 +' = 3.0", "not a valid type of a gain"),
        "gain of a file": ("k: object = field(default_factory=lambda: sys.stdin)", "a gain is a number"),
        "gain without a value": ("k: float", "needs this gain"),
        "gain: nan": ("k: float = math.nan", "not a finite number"),
        "gain: text": ("k: float = 'five'", "not a finite number"),
        "gain: factory": ("k: float = field(default_factory=lambda: 1 / 0)", "ZeroDivisionError"),
        "period: negative": ("period: float = -1.0", "period"),
        "period: no multiple": ("period: float = 1.23456e-3", "period"),
    }
    found = {name: Case(declared(body), said=said) for name, (body, said) in bodies.items()}
    laws = {
        "law: print": ("law = staticmethod(print)", "written with def"),
        "law: partial": ("law = staticmethod(functools.partial(print, 3))", "written with def"),
        "law: a number": ("law = 3", "must be a @staticmethod"),
        "law: a method": ("def law(self, state, signals, state_dot, tau_cmd):\n    pass", "must be a @staticmethod"),
        "law: none": ("k: float = 3.0", "no method 'law'"),
        "law: few arguments": ("@staticmethod\ndef law(gains, state):\n    pass", "must take"),
        "law: keywords": (
            "@staticmethod\ndef law(*, gains, state, signals, state_dot, tau_cmd):\n    pass",
            "must take",
        ),
        "law: async": (f"@staticmethod\nasync {SIGNATURE.strip()}\n    pass", "no async"),
        "law: yields": (f"@staticmethod\n{SIGNATURE.strip()}\n    yield 3", "no yield"),
        "law: a class": ("law = staticmethod(Odd)", "written with def"),
        "law: jitted badly": (f"@staticmethod\n@njit\n{SIGNATURE.strip()}\n    tau_cmd[9] = 0.0", OUT_OF_BOUNDS),
        "law: a lambda": (
            "law = staticmethod(lambda gains, state, signals, state_dot, tau_cmd: 3)",
            "must fill all six",
        ),
        "law: unknown signals": (
            f"@staticmethod\n{SIGNATURE.strip()}\n    tau_cmd[:] = signals.p - signals.etae * gains.q",
            "did you mean 'p_WB'(.|\n)*did you mean 'eta_e'(.|\n)*gains has no 'q'",
        ),
        "law: the truth": (f"@staticmethod\n{SIGNATURE.strip()}\n    tau_cmd[:] = signals.tau_dist", "yardstick"),
        "law: unknown states": (f"@staticmethod\n{SIGNATURE.strip()}\n    state_dot.z[:] = 0.0", "declares no states"),
    }
    return found | {name: Case(declared(body, law=False), said=said) for name, (body, said) in laws.items()}


def files() -> dict[str, Case]:
    """Files that can't be loaded."""
    good = law(SET)
    texts = {
        "empty": ("", "no class"),
        "syntax": (f"{good}\ndef (:\n", "SyntaxError"),
        "tabs": ("if True:\n\tx = 1\n        y = 2\n", "TabError"),
        "null byte": (f"{good}\n\0", "null byte"),
        "divides": (f"1 / 0\n{good}", "line 1: ZeroDivisionError"),
        "exits": (f"import sys\nsys.exit(0)\n{good}", "line 2: SystemExit"),
        "exits with a text": (f"raise SystemExit('bye')\n{good}", "SystemExit: bye"),
        "raises BaseException": (f"raise BaseException('x')\n{good}", "BaseException: x"),
        "raises what has no text": (f"{good}\nraise Odd\n", "line \\d+: Odd"),
        "imports nothing": (f"import nowhere_at_all\n{good}", "ModuleNotFoundError"),
        "recurses": ("def f():\n    f()\nf()\n", "RecursionError"),
        "not a Controller": ("class Law:\n    pass\n", "no class"),
        "not decorated": (good.replace("@dataclass(frozen=True)", ""), "must be decorated"),
        "not frozen": (good.replace("(frozen=True)", ""), "non-frozen"),
        "another name": (good.replace("class Law(", "class Lew("), "its laws are"),
        "an instance": (f"{good}\nLaw = Law()\n", "no law 'Law'"),
        "metaclass": ("class M(type):\n    def __getattribute__(s, n): 1 / 0\nclass Law(metaclass=M): pass\n", ""),
        "wrong decorator": (good.replace("@staticmethod", "@staticmethod\n    @functools.partial"), "written with def"),
        "njit outside": (good.replace("@staticmethod", "@njit\n    @staticmethod"), "must be a @staticmethod"),
    }
    return {name: Case(text, said=said) for name, (text, said) in texts.items()}


def endless() -> dict[str, Case]:
    """Loops that only Ctrl-C ends."""
    bodies = {
        "while": "x = 0.0\n    while x >= 0.0:\n        x += 1.0\n    tau_cmd[0] = x",
        "pass": "while True:\n        pass",
        "range": "x = 0.0\n    for i in range(10**17):\n        x += math.sin(i * x)\n    tau_cmd[0] = x",
        "helper": "tau_cmd[0] = forever(0.0)",
        "plain Python": "while getattr(sys, 'path'):\n        pass",
    }
    return {name: Case(law(LATE + body), 130, "stopped from outside", True) for name, body in bodies.items()}
