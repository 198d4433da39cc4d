"""Build the pool: the closed loop of free_body as one JavaScript file that runs in a reader's browser.

    python scripts/build_pool.py --out site     write pool.js, pool.html and numbers.html into site

It needs the extra ``docs``, whose package ``ziglang`` has the linker ``wasm-ld``. A page with ``<div id="pool"></div>``
and ``<script src="pool.js"></script>`` shows the pool; with ``data-numbers`` the div has all numbers, and the scenario
as TOML. The page's own sources are in docs/pool.

The plant, the wall, the stages and the laws are from the package, compiled by its compiler. A law begins with a
copy of the record of a native run. Which numbers of the record a key of the scenario sets is found by comparing the
records of native runs. Each number is the key's value times a factor, or it is taken from the run of each choice that
the page offers; a key that does anything else is refused. D_d is computed by the package's own kernel.
"""

import base64
import dataclasses
import functools
import gzip
import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import llvmlite.binding as llvm
import numpy as np

from uvms_mj import Scenario, Simulation
from uvms_mj.compiler.targets import WASM
from uvms_mj.control.task import natural_damping
from uvms_mj.engine.native.intrinsics import kernel_module
from uvms_mj.engine.native.other_targets import STEPS, loop_for
from uvms_mj.engine.native.record import Shape, integers_of, with_numbers
from uvms_mj.views.colours import LAWS as COLOURS
from uvms_mj.views.colours import legible

SOURCES = Path(__file__).parents[1] / "docs" / "pool"
LAWS = ("gsta", "fosm", "impedance")
DAMPING = "uvms_mj_damping"
SAMPLE_S = 0.002
"""Time from one sample of a plot to the next [s]."""


@dataclasses.dataclass(frozen=True)
class Key:
    """A number that a reader may change.

    Attributes:
        key: key of the scenario; with [i], the entry of a list.
        symbol, words, unit: as the page shows it. Text between underscores is a subscript.
        least, most: range of the number as the page shows it.
        law: the law whose gain it is; empty for all laws.
        steps: whether the slider has equal steps ("linear") or equal ratios ("log").
        shown: "rate" for a period that the page shows as a rate, "minus" for the opposite of the number.
        first: whether the first page has it.
        choices: the only values that the page offers.
    """

    key: str
    symbol: str
    words: str
    unit: str
    least: float
    most: float
    law: str = ""
    steps: str = "linear"
    shown: str = ""
    first: bool = True
    choices: tuple[float, ...] = ()


_PERIODS = tuple(1.0 / rate for rate in (50, 100, 200, 500, 1000, 2000, 5000, 10000))
KEYS = (
    Key("wall.stiffness", "k_c_", "wall stiffness", "N/m", 1e2, 1e6, steps="log"),
    Key("wall.damping", "b_c_", "wall damping", "N s/m", 0.0, 500.0, first=False),
    Key("current.speed", "v_c_", "current speed", "m/s", 0.0, 1.0),
    Key("controller.period", "1/T", "control rate", "Hz", 50.0, 1e4, shown="rate", choices=_PERIODS),
    Key("impedance.K_d[0]", "K_d,x_", "surge stiffness", "N/m", 10.0, 1500.0, steps="log"),
    Key("impedance.K_d[1]", "K_d,y_", "sway stiffness", "N/m", 10.0, 5e3, first=False),
    Key("impedance.K_d[2]", "K_d,z_", "heave stiffness", "N/m", 10.0, 5e3, first=False),
    Key("impedance.K_d[3]", "K_d,φ_", "roll stiffness", "N m", 1.0, 500.0, first=False),
    Key("impedance.K_d[4]", "K_d,θ_", "pitch stiffness", "N m", 1.0, 500.0, first=False),
    Key("impedance.K_d[5]", "K_d,ψ_", "yaw stiffness", "N m", 1.0, 500.0, first=False),
    Key("impedance.F_d[0]", "−F_d,x_", "desired push", "N", 0.0, 10.0, shown="minus"),
    Key("task.F_1", "F_1_", "gain of the pose error", "1/s", 0.0, 10.0, first=False),
    Key("task.F_2", "F_2_", "gain of ζ", "1", 0.1, 10.0, first=False),
    Key("task.A", "A", "pole of ζ", "1/s", -500.0, 0.0, first=False),
    Key("controller.k_1", "k_1_", "gain of φ_1_", "m^1/2^/s^3/2^", 0.0, 15.0, "gsta"),
    Key("controller.k_2", "k_2_", "gain of φ_2_", "m/s^3^", 0.0, 60.0, "gsta"),
    Key("controller.beta", "β", "linear part of φ", "(s/m)^1/2^", 0.0, 20.0, "gsta"),
    Key("controller.K_s", "K_s_", "switching gain", "m/s^2^", 0.0, 60.0, "fosm"),
    Key("controller.epsilon", "ε", "boundary layer", "m/s", 1e-4, 1e-1, "fosm", "log"),
)
READ = ("p_WB", "quat_WB", "s", "u", "force_peak", "D_d")
"""The signals that the page reads."""


def damping(run):
    """Set D_d to Ott's design for M_d and K_d of the record, for a damping ratio of 1."""
    natural_damping(run.signals.M_d, run.signals.K_d, 1.0, run.signals.D_d)


def overrides(values: Mapping[str, float]) -> dict[str, Any]:
    """Values of keys as overrides of the default scenario."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        name, _, index = key.partition("[")
        if index:
            found.setdefault(name, list(_default(Scenario(), name)))[int(index[:-1])] = value
        else:
            found[name] = value
    return found


def default_of(key: Key) -> float:
    """The value of a key in the default scenario."""
    scenario = Scenario.load("push_wall", controller=key.law or LAWS[0])
    if key.key == "controller.period":
        return scenario.control_period
    name, _, index = key.key.partition("[")
    value = _default(scenario, name)
    return float(value[int(index[:-1])] if index else value[0] if isinstance(value, tuple) else value)


def _default(scenario: Scenario, name: str) -> Any:
    table, _, word = name.partition(".")
    return getattr(getattr(scenario, table), word)


def simulation(law: str, values: Mapping[str, float]) -> Simulation:
    """The native run of a law with values of keys."""
    return Simulation(Scenario.load("push_wall", overrides(values), law), engine="free_body", looks=False)


class Loops:
    """The native runs of the laws at their start, and the module of all their stages.

    Attributes:
        images: for each law the numbers of its records at the start, as integers.
        shape: the shape of all of them.
        stages: the stages of the module, each once.
    """

    def __init__(self) -> None:
        runs = {law: simulation(law, {}) for law in LAWS}
        self.stages: dict[tuple[Any, str], Any] = {}
        for run in runs.values():
            for stage in run._stages.running:
                self.stages.setdefault(_code(stage), stage)
        self.images = {law: self.image(run) for law, run in runs.items()}
        (self.shape,) = {run._memory.shape for run in runs.values()}
        self.first = runs[LAWS[0]]

    def image(self, run: Simulation) -> np.ndarray:
        """The numbers of the records of a run at its start, as integers, with the addresses that the page needs."""
        memory, numbers = run._memory, list(self.stages)
        words = memory.image.fixed.view("<i8").copy()
        codes = run._stages.rows["code_at"]
        for k, stage in enumerate(run._stages.running):
            words[memory.image.place(codes[k : k + 1])] = 1 + numbers.index(_code(stage))
        words[memory.image.place(memory.run["address"])] = 0  # the page sets it
        return words

    def places(self, law: str, key: Key, default: float) -> tuple[list[Any], bool]:
        """The numbers of the record that a key sets, each with its place, its factor or its values for the choices, and
        whether it is an integer. And whether D_d depends on the key.

        Raises:
            ValueError: a number is not the key's value times a factor.
        """
        unit = -1.0 if key.most <= 0.0 else 1.0
        values = key.choices or (unit, default, 2.0 * (default or unit))
        images = [self.image(simulation(law, {key.key: value})) for value in values]
        signals, memory = self.first._memory.run["signals"], self.first._memory.image
        first = memory.place(signals["D_d"])
        changed = {int(p) for image in images for p in np.nonzero(image != self.images[law])[0]}
        damped = changed & set(range(first, first + 36))
        found = []
        for place in sorted(changed - damped):
            words = np.array([image[place] for image in images])
            whole = place in _integers(self.shape)
            numbers = words if whole else words.view("f8")
            if key.choices:
                found.append([place, numbers.tolist(), whole])
                continue
            factor = float(numbers[0]) / unit
            if whole or any(factor * value != number for value, number in zip(values, numbers, strict=True)):
                raise ValueError(f"{key.key} sets the number at {place} to {numbers} for {values}: no factor of it")
            found.append([place, factor, whole])
        return found, bool(damped)


def _code(stage: Any) -> tuple[Any, str]:
    """What the machine code of a stage depends on."""
    return type(stage.stage).function(), repr(stage.kinds)


@functools.cache
def _integers(shape: Shape) -> set[int]:
    """The places of the integers of a run's record."""
    return {at // 8 for at in integers_of(shape.layout)}


def module(loops: Loops) -> bytes:
    """The closed loop with the stages of all laws, and :func:`damping`, as a WebAssembly module."""
    run = with_numbers(loops.shape.layout)
    kernels: dict[str, Any] = {DAMPING: (damping, [run])}
    kernel = WASM.code(llvm.parse_assembly(str(kernel_module(kernels))))
    with tempfile.TemporaryDirectory() as folder:
        objects = {"loop.o": loop_for(WASM, loops.shape, list(loops.stages.values())), "damping.o": kernel}
        for name, code in objects.items():
            Path(folder, name).write_bytes(code)
        exports = [f"--export={name}" for name in (STEPS, DAMPING, "__heap_base")]
        options = ["--no-entry", "--strip-all", *exports]
        command = [sys.executable, "-m", "ziglang", "wasm-ld", *options, *objects, "-o", "pool.wasm"]
        subprocess.run(command, cwd=folder, check=True)
        return Path(folder, "pool.wasm").read_bytes()


def packed(content: bytes) -> str:
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()


def data() -> dict[str, Any]:
    """All that the page needs to know of the runs."""
    loops = Loops()
    memory, setup = loops.first._memory, loops.first.setup
    views = memory.views()
    fields = {name: [memory.image.place(views[name]), max(1, views[name].size)] for name in READ}
    run, plant = memory.run, memory.run["plant"]
    others = {name: run[name] for name in ("address", "t")}
    others |= {"solved": plant["solved"], "v_c_W": plant["water"]["v_c_W"]}
    for name, array in others.items():
        fields[name] = [memory.image.place(array), array[0].size]
    keys, lists = [], {key.key.partition("[")[0] for key in KEYS if "[" in key.key}
    for key in KEYS:
        default, places, damped = default_of(key), {}, False
        for law in LAWS:
            if key.law in ("", law):
                places[law], damped = loops.places(law, key, default)
        keys.append({**dataclasses.asdict(key), "value": default, "places": places, "damped": damped})
    scenario, target = setup.scenario, setup.rest_pose[0]
    assert target is not None
    return {
        "wasm": packed(module(loops)),
        "images": {law: packed(image.tobytes()) for law, image in loops.images.items()},
        "entries": {"steps": STEPS, "damping": DAMPING},
        "fields": fields,
        "keys": keys,
        "lists": {name: list(_default(scenario, name)) for name in sorted(lists)},
        "sample_s": SAMPLE_S,
        "sample_steps": round(SAMPLE_S / scenario.simulation.timestep),
        **{name: _diagonal(getattr(setup.vehicle, name)) for name in ("M_A", "D_linear", "D_quadratic")},
        "M_d_inv": setup.design.M_d_inv.tolist(),
        "D_d": setup.design.D_d.ravel().tolist(),
        "timestep": scenario.simulation.timestep,
        "current": dataclasses.replace(scenario.current, speed=1.0).velocity_W,
        "x_c": scenario.wall.position,
        "x_d": target[0],
        "probe": setup.plant.probe.radius,
        "colours": {law: "#{:02x}{:02x}{:02x}".format(*legible(COLOURS[law])) for law in LAWS},
    }


def _diagonal(matrix: np.ndarray) -> list[float]:
    """The diagonal of a matrix that has nothing else: the page's closed form takes no other."""
    assert np.array_equal(matrix, np.diag(np.diag(matrix)))
    return np.diag(matrix).tolist()


def script(content: dict[str, Any]) -> str:
    """The JavaScript file of the pool."""
    named = {"DATA": content, "STYLE": _source("pool.css"), "WORKER": _source("worker.js")}
    parts = [_source(name) for name in ("rest.js", "scene.js", "plot.js", "pool.js")]
    constants = [f"const {name} = {json.dumps(value, ensure_ascii=False)};" for name, value in named.items()]
    return "\n".join(['"use strict";', "(() => {", *constants, *parts, "})();", ""])


def _source(name: str) -> str:
    return (SOURCES / name).read_text(encoding="utf-8")


def write(folder: Path) -> None:
    """Write pool.js into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "pool.js").write_text(script(data()), encoding="utf-8")


@click.command()
@click.option("--out", default="pool", type=click.Path(path_type=Path), show_default=True)
def main(out: Path) -> None:
    """Write pool.js into a folder, with two pages that show it from their files."""
    write(out)
    for name in ("pool.html", "numbers.html"):
        (out / name).write_text(_source(name), encoding="utf-8")
    for file in sorted(out.iterdir()):
        print(f"{file}: {file.stat().st_size / 1000:.1f} kB")


if __name__ == "__main__":
    main()
