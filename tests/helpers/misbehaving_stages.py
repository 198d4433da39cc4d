"""Stages and metrics that misbehave: those of :mod:`misbehaving_laws`, and sensors, references, observers, thrusters,
allocations and metrics of a study.

``test_misbehaving_stages.py`` and ``scripts/misbehave.py`` use these data.
"""

import textwrap
from dataclasses import dataclass, replace

import misbehaving_laws
from misbehaving_laws import HEADER, OUT_OF_BOUNDS, Case


@dataclass(frozen=True)
class Kind:
    """What users write for a table of a scenario: the base class, a first statement that does it right, an array of the
    output, the name of the last argument, and a setting's noun."""

    base: str
    right: str
    array: str
    noun: str
    last: str = "out"
    helper: str = ""


KINDS = {
    "navigation": Kind(
        "Navigation", "perfect(given, out)", "out.nu", "navigation stage", helper="uvms_mj.navigation import perfect"
    ),
    "reference": Kind(
        "Guidance",
        "station_keep(settings, given, out)",
        "out.p_d",
        "guidance stage",
        helper="uvms_mj.guidance import station_keep",
    ),
    "observer": Kind(
        "Observer",
        "out.f_contact_m_W[:] = 0.0\nout.tau_contact_m_B[:] = 0.0",
        "out.tau_contact_m_B",
        "observer",
        helper="uvms_mj.navigation import Observer",
    ),
    "thrusters": Kind(
        "Thrusters", "u[:] = given.u_cmd", "u", "thruster model", "u", "uvms_mj.actuation import Thrusters"
    ),
    "actuation": Kind(
        "Actuation",
        "pseudo_inverse(given, u)",
        "u",
        "actuation stage",
        "u",
        "uvms_mj.actuation import pseudo_inverse",
    ),
}


def cases() -> dict[str, Case]:
    """All cases by name."""
    found = misbehaving_laws.cases()
    for table, kind in KINDS.items():
        for name, case in {**_steps(kind), **_classes(kind)}.items():
            found[f"{table}: {name}"] = replace(case, table=table)
    for table, name, body, said in _ATTITUDES:
        found[f"{table}: {name}"] = Case(stage(KINDS[table], _late(KINDS[table], body)), said=said, table=table)
    return found | {f"metrics: {name}": case for name, case in _metrics().items()}


def stage(kind: Kind, body: str, members: str = 'states = {"xi": 3}') -> str:
    """The text of a file whose stage has this body."""
    step = f"@staticmethod\ndef step(settings, state, given, state_dot, {kind.last}):\n{textwrap.indent(body, '    ')}"
    own = textwrap.indent(f"k: float = gain(5.0, '1', 'setting')\n{members}\n{step}", "    ")
    return f"{_head(kind)}class Law({kind.base}):\n{own}\n"


def _head(kind: Kind) -> str:
    base = f"from uvms_mj import {kind.base}\n" if kind.base not in kind.helper else ""
    return f"{HEADER}\n{base}from {kind.helper}\n\n@dataclass(frozen=True)\n"


def _late(kind: Kind, body: str) -> str:
    return f"{kind.right}\nif given.t > 0.01:\n{textwrap.indent(body, '    ')}"


def _steps(kind: Kind) -> dict[str, Case]:
    """Functions that misbehave some time after the start."""
    array, your = kind.array, f"your {kind.noun} Law "
    bodies = {
        "nan": (f"{array}[1] = np.nan", rf"{your}.*set {array}\[1\] to nan"),
        "infinite derivative": ("state_dot.xi[2] = np.inf", rf"{your}.*set state_dot.xi\[2\] to inf"),
        "root": (f"{array}[0] = np.sqrt(-given.t)", f"{your}.*line .*np.sqrt"),
        "index": (f"{array}[100] = 1.0", f"{your}.*{OUT_OF_BOUNDS}"),
        "late index": (f"{array}[int(given.t * 1e6) + 100] = 1.0", f"{your}.*IndexError.*line"),
        "overrun": (f"as_strided({array}, (5001,), (8,))[5000] = 0.0", f"{your}.*as_strided reaches numbers beyond"),
        "shape": (f"{array}[:] = np.ones(11)", f"{your}.*is wrong in .*line"),
        "given": ("given.t = 3.0", "given can only be read"),
        "setting": ("settings.k = 3.0", "a setting is constant during a run"),
        "raise": ("raise ValueError('no')", f"{your}.*raised ValueError: no in .*line"),
        "exit": ("sys.exit(0)", f"{your}.*SystemExit"),
        "recursion": ("deeper_still(0)", f"{your}.*RecursionError"),
        "base": ("raise Base('x')", f"{your}.*Base: x"),
    }
    found = {name: Case(stage(kind, _late(kind, body)), said=said) for name, (body, said) in bodies.items()}
    found["unset"] = Case(stage(kind, "x = given.t"), said=f"{your}.*(must fill all|left .* unset)")
    found["field"] = Case(stage(kind, "x = given.nowhere"), said="given has no 'nowhere'")
    endless = _late(kind, "x = 0.0\nwhile x >= 0.0:\n    x += 1.0")
    return found | {"endless": Case(stage(kind, endless), 130, "stopped from outside", endless=True)}


def _classes(kind: Kind) -> dict[str, Case]:
    """Classes that violate the contract."""
    return {
        "states": Case(stage(kind, kind.right, "states = {'xi': 0}"), said="states.xi: 0 must be a whole number"),
        "no step": Case(f"{_head(kind)}class Law({kind.base}):\n    k: float = 3.0\n", said="'step'"),
        "period": Case(stage(kind, kind.right, "period: float = 1.23456e-3"), said="period"),
    }


_ATTITUDES = (
    ("navigation", "length", "out.quat_WB[0] = 3.0", "out.quat_WB to length .*unit quaternion"),
    ("navigation", "matrix", "out.R_WB[0, 0] = -1.0", "out.R_WB to another attitude than out.quat_WB"),
    ("reference", "length", "out.quat_d[:] = 0.0", "out.quat_d to length 0.*unit quaternion"),
)


def _metrics() -> dict[str, Case]:
    """Metrics of a study: its row says what went wrong, or the file is refused."""
    bodies = {
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
    found = {
        name: Case(f"{HEADER}\ndef metric(trace):\n    {body}\n", 0, said, table="metric")
        for name, (body, said) in bodies.items()
    }
    files = {
        "arguments": ("def metric():\n    return 1.0\n", 0, "argument"),
        "missing": ("def metrik(trace):\n    return 1.0\n", 2, "no function 'metric'.*metrik"),
        "a number": ("metric = 3\n", 2, "no function 'metric'"),
        "syntax": ("def metric(trace:\n", 2, "SyntaxError"),
        "file exits": ("import sys\nsys.exit(0)\n", 2, "SystemExit"),
    }
    return found | {name: Case(text, status, said, table="metric") for name, (text, status, said) in files.items()}
