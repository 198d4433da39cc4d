"""Stages and metrics that misbehave: for each the text of a file, and what is said of it.

``test_misbehaving_stages.py`` runs the stages in its process, ``scripts/misbehave.py`` all of them with the command.
"""

import textwrap
from dataclasses import dataclass

HEADER = """
from dataclasses import dataclass, field
import functools, math, os, sys
import numpy as np
from uvms_mj import Controller, gain
from uvms_mj.actuation import Actuation, Thrusters, pseudo_inverse
from uvms_mj.guidance import Guidance, station_keep
from uvms_mj.navigation import Navigation, Observer, perfect

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
def forever(x):
    while x >= 0.0:
        x += 1.0
    return x

@njit
def deeper(n):
    return deeper(n + 1) + 1.0 if n >= 0 else 0.0

class Odd(Exception):
    def __str__(self):
        raise ValueError

class Base(BaseException):
    pass
"""
SIGNATURE = "def law(gains, state, signals, state_dot, tau_cmd):"
GAINS = """
k: float = gain(5.0, "1", "gain")
flag: bool = gain(True, "1", "flag")
three: tuple[float, float, float] = gain((1.0, 2.0, 3.0), "1", "gains")
states = {"xi": 6, "eta": 3}
"""
SET = "tau_cmd[:] = signals.tau_nom\n"
OUT_OF_BOUNDS = "(is out of bounds|IndexError)"


def declared(body: str, base: str = "Controller") -> str:
    """The text of a file whose class Law has this body."""
    return f"{HEADER}\n@dataclass(frozen=True)\nclass Law({base}):\n{textwrap.indent(body, '    ')}"


def law(body: str) -> str:
    """The text of a file whose law has this body."""
    return declared(f"{GAINS}@staticmethod\n{SIGNATURE}\n{textwrap.indent(body, '    ')}\n")


def stage(base: str, right: str, late: str, last: str = "out") -> str:
    """The text of a file whose stage does it right at first, and has a setting and a state."""
    step = (
        f"def step(settings, state, given, state_dot, {last}):\n    {right}\n    if given.t > 0.01:\n        {late}\n"
    )
    return declared(f"k: float = gain(5.0, '1', 'setting')\nstates = {{'xi': 3}}\n@staticmethod\n{step}", base)


LAWS = {
    "as_strided(tau_cmd, (131072,), (8,))[131071] = 0.0": "as_strided reaches numbers beyond",
    "as_strided(gains.three, (8,), (-8,))[7] = 0.0": "as_strided reaches numbers beyond",
    "put(state.xi, 100)": OUT_OF_BOUNDS,
    "put(tau_cmd, int(signals.t * 1e15) + 6)": "IndexError.*line",
    "tau_cmd += np.ones(7)": "broadcast.* in my_law.py, line",
    "tau_cmd += np.ones((2, 6))": "broadcast.* in my_law.py, line",
    "signals.M_hat.T.flat[36] = 0.0": f"{OUT_OF_BOUNDS}|read-only",
    "tau_cmd[np.array([1, 6])] = 1.0": OUT_OF_BOUNDS,
    "tau_cmd[4] = np.nan": r"set tau_cmd\[4\] to nan.*my_law.py, line \d+: tau_cmd",
    "state_dot.eta[1] = np.nan": r"set state_dot.eta\[1\] to nan",
    "state.eta[2] = np.nan": r"state.eta\[2\]",
    "tau_cmd[0] = np.sqrt(-signals.t)": "line .*np.sqrt",
    "tau_cmd[:] = np.linalg.solve(signals.M_hat * np.nan, signals.s)": "nan.*line",
    "gains.k = 3.0": "read-only in my_law.py, line",
    "gains.three[2] = 0.0": "read-only in my_law.py, line",
    "raise Base('x')": "your law Law ",
    "raise Odd": "your law Law ",
    "sys.exit(0)": "SystemExit",
    "deeper(0)": "your law Law ",
    "x = np.zeros(1 << 45)": "your law Law ",
}
"""What a law does after 10 ms, and what is said of it."""
DECLARED = {
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
"""Bodies of classes that violate the contract, beside a law."""
NO_LAW = {
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
    "law: async": (f"@staticmethod\nasync {SIGNATURE}\n    pass", "no async"),
    "law: yields": (f"@staticmethod\n{SIGNATURE}\n    yield 3", "no yield"),
    "law: a class": ("law = staticmethod(Odd)", "written with def"),
    "law: jitted badly": (f"@staticmethod\n@njit\n{SIGNATURE}\n    tau_cmd[9] = 0.0", OUT_OF_BOUNDS),
    "law: a lambda": (
        "law = staticmethod(lambda gains, state, signals, state_dot, tau_cmd: 3)",
        "must fill all six",
    ),
    "law: unknown signals": (
        f"@staticmethod\n{SIGNATURE}\n    tau_cmd[:] = signals.p - signals.etae * gains.q",
        "did you mean 'p_WB'(.|\n)*did you mean 'eta_e'(.|\n)*gains has no 'q'",
    ),
    "law: the truth": (f"@staticmethod\n{SIGNATURE}\n    tau_cmd[:] = signals.tau_dist", "yardstick"),
    "law: unknown states": (f"@staticmethod\n{SIGNATURE}\n    state_dot.z[:] = 0.0", "declares no states"),
}
GOOD = law(SET)
FILES = {
    "empty": ("", "no class"),
    "syntax": (f"{GOOD}\ndef (:\n", "SyntaxError"),
    "tabs": ("if True:\n\tx = 1\n        y = 2\n", "TabError"),
    "null byte": (f"{GOOD}\n\0", "null byte"),
    "divides": (f"1 / 0\n{GOOD}", "line 1: ZeroDivisionError"),
    "exits": (f"import sys\nsys.exit(0)\n{GOOD}", "line 2: SystemExit"),
    "exits with a text": (f"raise SystemExit('bye')\n{GOOD}", "SystemExit: bye"),
    "raises BaseException": (f"raise BaseException('x')\n{GOOD}", "BaseException: x"),
    "raises what has no text": (f"{GOOD}\nraise Odd\n", "line \\d+: Odd"),
    "imports nothing": (f"import nowhere_at_all\n{GOOD}", "ModuleNotFoundError"),
    "recurses": ("def f():\n    f()\nf()\n", "RecursionError"),
    "not a Controller": ("class Law:\n    pass\n", "no class"),
    "not decorated": (GOOD.replace("@dataclass(frozen=True)", ""), "must be decorated"),
    "not frozen": (GOOD.replace("(frozen=True)", ""), "non-frozen"),
    "another name": (GOOD.replace("class Law(", "class Lew("), "its laws are"),
    "an instance": (f"{GOOD}\nLaw = Law()\n", "no law 'Law'"),
    "metaclass": ("class M(type):\n    def __getattribute__(s, n): 1 / 0\nclass Law(metaclass=M): pass\n", ""),
    "wrong decorator": (GOOD.replace("@staticmethod", "@staticmethod\n    @functools.partial"), "written with def"),
    "njit outside": (GOOD.replace("@staticmethod", "@njit\n    @staticmethod"), "must be a @staticmethod"),
}
STAGES = {
    "navigation: matrix": (
        stage("Navigation", "perfect(given, out)", "out.R_WB[0, 0] = -1.0"),
        "out.R_WB to another attitude than out.quat_WB",
    ),
    "reference: root": (
        stage("Guidance", "station_keep(settings, given, out)", "out.p_d[0] = np.sqrt(-given.t)"),
        "your guidance stage Law .*line .*np.sqrt",
    ),
    "observer: setting": (
        stage("Observer", "out.f_contact_m_W[:] = out.tau_contact_m_B[:] = 0.0", "settings.k = 3.0"),
        "read-only in my_law.py, line",
    ),
    "thrusters: late index": (
        stage("Thrusters", "u[:] = given.u_cmd", "u[int(given.t * 1e6) + 100] = 1.0", "u"),
        "your thruster model Law .*IndexError.*line",
    ),
    "actuation: unset": (
        stage("Actuation", "pass", "pass", "u"),
        r"your actuation stage Law .* left u\[0\] unset: .* must fill all (6|six)",
    ),
    "actuation: root": (
        stage("Actuation", "pseudo_inverse(given, u)", "u[0] = np.sqrt(-given.t)", "u"),
        "your actuation stage Law .*line .*np.sqrt",
    ),
}
"""By the table of the scenario and what goes wrong."""
ENDLESS = {
    "while": "x = 0.0\n    while x >= 0.0:\n        x += 1.0\n    tau_cmd[0] = x",
    "pass": "while True:\n        pass",
    "range": "x = 0.0\n    for i in range(10**17):\n        x += math.sin(i * x)\n    tau_cmd[0] = x",
    "helper": "tau_cmd[0] = forever(0.0)",
    "plain Python": "while getattr(sys, 'path'):\n        pass",
}
"""Loops that only Ctrl-C ends."""
METRICS = {
    "raises": ("return trace.nowhere", "nowhere"),
    "text": ("return 'five'", "'five' is not a number"),
    "array": ("return trace.p_WB", "is not a number"),
    "complex": ("return 1j", "is not a number"),
    "generator": ("yield 3", "is not a number"),
    "dictionary": ("return {'a': 1.0, 'b': 'x'}", "metric.b: 'x' is not a number"),
    "exits": ("sys.exit(3)", "SystemExit: 3"),
    "base": ("raise Base('x')", "Base: x"),
    "odd": ("raise Odd", "Odd"),
    "recursion": ("return metric(trace)", "RecursionError"),
    "writes": ("trace.p_WB[:] = 0.0", "read-only"),
    "dies": ("os._exit(5)", "process"),
}
"""Bodies of metrics of a study, whose row says what went wrong."""
METRIC_FILES = {
    "arguments": ("def metric():\n    return 1.0\n", 0, "argument"),
    "missing": ("def metrik(trace):\n    return 1.0\n", 2, "no function 'metric'.*metrik"),
    "a number": ("metric = 3\n", 2, "no function 'metric'"),
    "syntax": ("def metric(trace:\n", 2, "SyntaxError"),
    "file exits": ("import sys\nsys.exit(0)\n", 2, "SystemExit"),
}
"""Files of metrics, the exit status of a study with them, and what is said."""


@dataclass(frozen=True)
class Case:
    """A file's text, a pattern of what is said of it, the scenario's table that takes it, the exit status of the
    command, and whether only Ctrl-C ends it."""

    text: str
    said: str
    table: str = "controller"
    status: int = 2
    endless: bool = False


def cases() -> dict[str, Case]:
    """All cases by name; those of the table ``metric`` are metrics of a study."""
    set_late = f"{SET}if signals.t > 0.01:\n    "
    found = {f"law: {late}": Case(law(set_late + late), said) for late, said in LAWS.items()}
    found |= {
        "returned": Case(law("return signals.tau_nom"), "must fill all six entries"),
        "rebound": Case(law("tau = -200.0 * signals.eta_e"), "must fill all six entries"),
        "half set": Case(law("tau_cmd[:3] = 1.0"), "unset: a law must fill all six entries of tau_cmd"),
        "a state of 10,000": Case(declared("states = {'a': 10_000, 'b': 1}\n"), "at most 10000"),
        "too large": Case(law(f"{set_late}tau_cmd[0] = 1e300"), "tau_cmd", status=3),
        "interrupts itself": Case(law(f"{SET}raise KeyboardInterrupt"), "stopped from outside", status=130),
    }
    for name, (body, said) in DECLARED.items():
        found[name] = Case(declared(f"{body}\n@staticmethod\n{SIGNATURE}\n    {SET}"), said)
    found |= {name: Case(declared(f"{body}\n"), said) for name, (body, said) in NO_LAW.items()}
    found |= {f"file: {name}": Case(text, said) for name, (text, said) in FILES.items()}
    found |= {name: Case(text, said, name.partition(":")[0]) for name, (text, said) in STAGES.items()}
    for name, body in ENDLESS.items():
        found[f"endless: {name}"] = Case(law(set_late + body), "stopped from outside", status=130, endless=True)
    for name, (body, said) in METRICS.items():
        found[f"metric: {name}"] = Case(f"{HEADER}\ndef metric(trace):\n    {body}\n", said, "metric", 0)
    for name, (text, status, said) in METRIC_FILES.items():
        found[f"metric: {name}"] = Case(text, said, "metric", status)
    return found
