"""Mutated inputs for :mod:`fuzzer`: scenarios, settings, vehicle files, laws and logs with random errors."""

from collections.abc import Callable
from typing import Any

import tomli_w

from mutated_logs import log
from mutated_values import TOKENS, Case, Random, mild, mutated_bytes, value
from mutated_vehicles import vehicle
from uvms_mj import Scenario
from uvms_mj.control import BUILT_IN
from uvms_mj.scenario import keys

SHORT = {"simulation.duration": 0.004}


def case(seed: int) -> Case:
    """The input of a seed. It is the same in every process."""
    rng = Random(seed)
    kind = rng.choices(list(KINDS), [weight for weight, _ in KINDS.values()])[0]
    return KINDS[kind][1](rng)


_UNKNOWN = ("wall", "controller", "wall.x", "x", "x.y", "", ".", "a.b.c", "reference.waypoints.0", "controller.K_s")
_KEYS = tuple(key for key, _, _ in keys())


def _key(rng: Random, law: str) -> str:
    """A key of a scenario, in most cases one that exists."""
    if rng.random() < 0.1:
        return rng.choice(_UNKNOWN)
    gains = tuple(f"controller.{f.name}" for f in BUILT_IN[law].setting_fields())
    return rng.choice((*_KEYS, *gains, "name", "description"))


def _tables(rng: Random) -> dict[str, Any]:
    """A valid, short scenario with random options."""
    law = rng.choice(list(BUILT_IN))
    start: dict[str, Any] = dict(SHORT)
    if rng.random() < 0.4:
        start |= {"wall.position": 1e-6, "reference.step_time": 0.0}  # contact at once
    if rng.random() < 0.2:
        start["reference.waypoints"] = [{"time": 0.001 * i, "position": [0.1 * i, 0.0, 0.0]} for i in range(3)]
    if rng.random() < 0.2:
        start |= {"disturbance.amplitude": [1.0] * 6, "disturbance.frequency_hz": [1.0, 10.0, 100.0, 0.0, 2.0, 3.0]}
    return Scenario.load("push_wall", start, law).to_dict()


def scenario_values(rng: Random) -> Case:
    tables = _tables(rng)
    law = tables["controller"]["name"]
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        table, _, key = _key(rng, law).partition(".")
        if not key:
            tables[table] = value(rng)
        elif isinstance(tables.get(table, {}), dict):
            old = tables.get(table, {}).get(key)
            new = mild(rng, old) if old is not None and rng.random() < 0.7 else value(rng)
            tables.setdefault(table, {})[key] = new
    return Case("scenario", ("run", "mine.toml", "--json", "-o", "out"), {"mine.toml": _toml(tables)})


def _toml(tables: dict[str, Any]) -> bytes:
    return tomli_w.dumps(tables).encode(errors="surrogateescape")


def scenario_text(rng: Random) -> Case:
    text = mutated_bytes(rng, _toml(_tables(rng)), TOKENS)
    return Case("text", ("run", "mine.toml", "--json", "-o", "out"), {"mine.toml": text})


_RATES = ("full", "", "0", "-1", "nan", "inf", "1e-300", "1e300", "7", "1e4", "x")
_LAWS = (*BUILT_IN, "", "x", "x.py:Y", "..:", ":", "a/b.py:", "gsta ")
_ODD = ("--set", "-o", "--from", "--json", "--", "-", "--out=", "é", "push_wall", "-s==")


def settings(rng: Random) -> Case:
    arguments = ["run", "--json", "-o", "out"]
    tables = Scenario.load("push_wall", SHORT).to_dict()
    given = {"simulation.duration": "0.004"}
    for _ in range(rng.choice((1, 1, 2, 3))):
        key = _key(rng, "gsta")
        old = tables.get(key.partition(".")[0], {})
        old = old.get(key.partition(".")[2]) if isinstance(old, dict) else old
        new = mild(rng, old) if old is not None and rng.random() < 0.7 else value(rng)
        text = tomli_w.dumps({"x": new}).partition("=")[2].strip().replace("\n", " ")
        if rng.random() < 0.2:
            text = mutated_bytes(rng, text.encode(errors="replace"), TOKENS).decode(errors="replace")
        given[key] = text
    for key, text in given.items():
        setting = f"{key}={text}".replace("\x00", "")
        arguments += ["--set", setting] if rng.random() < 0.7 or setting[:1] == "-" else [setting]
    if rng.random() < 0.2:
        arguments += ["-c", rng.choice(_LAWS)]
    if rng.random() < 0.2:
        arguments += ["--log-rate", rng.choice(_RATES)]
    if rng.random() < 0.05:
        arguments += [rng.choice(_ODD)]
    return Case("set", tuple(arguments))


_LAW = '''"""A law."""
from dataclasses import dataclass
import numpy as np
from uvms_mj import Controller, gain

@dataclass(frozen=True)
class Law(Controller):
    """PI about the reference."""
    k_p: float = gain(20.0, "1/s^2", "gain")
    k_i: float = gain(2.0, "1/s^3", "integral gain")
    states = {"xi": 6}
    units = {"xi": "m s, s"}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            state_dot.xi[i] = signals.eta_e[i]
            tau_cmd[i] = signals.tau_nom[i] - gains.k_i * state.xi[i] - gains.k_p * signals.s[i]
'''
_WORDS = [
    "nan",
    "None",
    "1e300",
    "0",
    "-1",
    "7",
    "True",
    "'x'",
    "[]",
    "np.nan",
    "signals.x",
    "state",
    "gains",
    "lambda: 0",
    "1/0",
    "raise",
    "return",
    "print",
    "np.linalg.solve",
    "np.ones(7)",
    "yield",
    "import os",
    "import nothing",
    "exit()",
    "pass",
    "{'xi': 0}",
    "{'xi': 5.0}",
    "{'t': 6}",
    "{'xi': 10**6}",
    "{1: 2}",
    "staticmethod(print)",
    "law",
    "tau_cmd",
    "async",
]


def law(rng: Random) -> Case:
    lines = _LAW.splitlines()
    for _ in range(rng.choice((1, 1, 2, 3))):
        i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
        action = rng.randrange(5)
        if action == 0:
            lines[i] = ""
        elif action == 1:
            lines[i], lines[j] = lines[j], lines[i]
        elif action == 2:
            lines.insert(i, lines[j])
        else:
            words = lines[i].replace("(", " ( ").replace("[", " [ ").replace(".", " . ").split(" ")
            k = rng.randrange(len(words))
            words[k] = rng.choice(_WORDS)
            lines[i] = " ".join(words)
    arguments = ("run", "--json", "-o", "out", "simulation.duration=0.004", "-c", "mine.py:Law")
    return Case("law", arguments, {"mine.py": "\n".join(lines).encode()})


KINDS: dict[str, tuple[float, Callable[[Random], Case]]] = {
    "scenario": (5.0, scenario_values),
    "text": (3.0, scenario_text),
    "set": (4.0, settings),
    "vehicle": (4.0, vehicle),
    "law": (1.0, law),
    "log": (3.0, log),
}
"""Weight and mutator of each kind of input."""
